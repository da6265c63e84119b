"""A vehicle that runs away, predicted from measured states along the way: against its exact solution, step by step."""

import numpy as np
import pytest

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.prediction.short_horizon import short_horizons
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import Simulator
from seatrial.messages.predictions import horizon_text
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle

STEP, MASS = 0.1, 2.0
FORCED = whole_vehicle(Hull("forced", MASS, fixed={"X_tau_X": 1.0}), ["X_u"], moves=("u",))
SIMULATOR = Simulator(FORCED, (Sensor("u"),))
CHANNELS = (Channel("tau_X", "N", "control"), Channel("u", "m/s", "measurement"))


def exact(speed, force, drag):
    """Speed one step later under a held force, of m du/dt = X_u u + tau."""
    grown = np.exp(drag / MASS * STEP)
    return grown * speed + force * (grown - 1) / drag


def driven(drag, gain, n=900, noise=0.01):
    """A log under a feedback that keeps the speed near a slow wave."""
    random, speed, rows = np.random.default_rng(4), 0.0, []
    for k in range(n):
        force = float(gain * (np.sin(0.3 * k * STEP) - speed) + 0.3 * random.normal())
        rows.append((force, speed + noise * random.normal()))
        speed = exact(speed, force, drag)
    force, measured = np.array(rows).T
    return make_record(np.arange(n) * STEP, {"tau_X": force, "u": measured}, CHANNELS, Provenance("own", ""), "1")


@pytest.mark.parametrize("gaps", [False, True])
def test_shares_are_those_of_the_exact_solution_from_each_restart(gaps):
    record = driven(0.8, 4.0)
    if gaps:
        record.measurement[1::3] = np.nan
    found = short_horizons(SIMULATOR, {"X_u": 0.8}, record)
    assert found is not None
    u, force = record.channel("u"), record.channel("tau_X")
    known, errors, held, last = np.flatnonzero(np.isfinite(u)), [], [], -1000
    steps = round(found["u"].horizon / STEP)
    for start in known:
        if start - last < steps:
            continue
        last, speed = start, u[start]
        for k in range(start, min(start + steps, u.size - 1)):
            speed = exact(speed, force[k], 0.8)
            errors.append(u[k + 1] - speed)
            held.append(u[k + 1] - u[start])
    assert found["u"].horizon == pytest.approx(0.1 * 89.9)
    assert found["u"].explained == pytest.approx(1 - np.nanmean(np.square(errors)) / np.nanvar(u), abs=1e-6)
    assert found["u"].held == pytest.approx(1 - np.nanmean(np.square(held)) / np.nanvar(u), abs=1e-12)
    assert gaps or found["u"].one_step == pytest.approx(
        1 - np.mean((u[1:] - exact(u[:-1], force[:-1], 0.8)) ** 2) / u.var(), abs=1e-6
    )


def test_a_vehicle_that_runs_away_is_told_from_one_that_does_not():
    away = short_horizons(SIMULATOR, {"X_u": 0.8}, driven(0.8, 4.0))
    steady = short_horizons(SIMULATOR, {"X_u": -0.8}, driven(-0.8, 4.0))
    assert away is not None
    assert steady is not None
    assert away["u"].growth == pytest.approx(np.exp(0.4 * (89.9 - 8.9)), rel=0.05)
    assert away["u"].leaves
    assert not steady["u"].leaves
    said = horizon_text(away["u"], "u")
    assert said.startswith("the vehicle leaves its course by itself, a small error grows ")
    assert "over 9 s" in said


def test_a_wrong_model_is_no_better_over_short_horizons():
    found = short_horizons(SIMULATOR, {"X_u": -40.0}, driven(0.8, 4.0))
    assert found is not None
    assert not found["u"].is_good
    assert "errors that add up do not explain it" in horizon_text(found["u"], "u")


def test_a_state_that_is_not_measured_leaves_nothing_to_restart_from():
    record = driven(0.8, 4.0)
    record.measurement[:] = np.nan
    assert short_horizons(SIMULATOR, {"X_u": 0.8}, record) is None
    assert short_horizons(SIMULATOR, {"X_u": 0.8}, driven(0.8, 4.0, n=12)) is None
