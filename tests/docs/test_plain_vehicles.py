"""Plain loops of the studies move as the simulator does where both take small steps."""

import sys
from pathlib import Path

import numpy as np
import pytest

from seatrial.vehicles.simulate import simulate

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import plain_vehicles
import shortlists

STEP, REPEATED = 0.2, 40
"""Interval of the samples, s, and steps of either simulator in one."""


@pytest.mark.parametrize("seed", ["S", "T"], ids=shortlists.NAMES.get)
def test_plain_loops_move_as_the_simulator(seed):
    """With every term that a study has."""
    family = shortlists.WIDER[seed].family
    values = {name: prior.mean + prior.sd for name, prior in {**family.always, **family.optional}.items()}
    random = np.random.default_rng(1)
    n, rudder = 125.0 + random.uniform(-60.0, 60.0, 100), random.uniform(-0.23, 0.23, 100)
    if seed == "S":
        plain, start, control = plain_vehicles.surge(values, n, STEP, fine=REPEATED)[:, None], [1.5], n[:, None]
    else:
        plain = plain_vehicles.three_axes(values, n, rudder, STEP, fine=REPEATED)
        start, control = [1.5, 0.0, 0.0], np.column_stack([n, rudder])
    model = family.vehicle().build(free=list(values))
    steps = np.full(len(control) * REPEATED, STEP / REPEATED)
    motion = np.asarray(simulate(model, values, np.repeat(control, REPEATED, 0), steps, np.array(start)))[::REPEATED]
    assert np.abs(plain - motion).max() < 1e-5
