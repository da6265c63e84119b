"""Let go from a tilt, without a thrust: what a roll, a pitch and a rise tell of weight, buoyancy and the centre of buoyancy."""

import numpy as np
import pytest

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.first_guess import fit_motion
from seatrial.estimation.priors import Normal
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.simulate import simulate

STEP, SAMPLES = 0.05, 400
PRIORS = {"net_weight": Normal(0.0, 5.0), "x_b": Normal(0.0, 0.02), "z_b": Normal(0.0, 0.02)}


def test_releases_give_the_balance_of_the_catalogue_back():
    vehicle = load_vehicle("bluerov2_heavy")
    model = vehicle.build(attitude="quaternion", unknowns=tuple(PRIORS))
    hull, rng = vehicle.hull, np.random.default_rng(1)
    truth = {"net_weight": hull.weight - hull.buoyancy, "x_b": 0.0, "z_b": hull.centre_of_buoyancy[2]}
    assert [(one.name, one.stated) for one in model.unknowns] == [(name, truth[name]) for name in PRIORS]
    records, starts = [], []
    for label, angles in {"roll": (0.6, 0.0, 0.0), "pitch": (0.0, 0.6, 0.0)}.items():
        start = [*np.zeros(6), *map(float, quaternion_of_angles(*angles))]
        control = np.zeros((SAMPLES, 8))
        states = simulate(model, vehicle.coefficients, control, np.full(SAMPLES, STEP), np.array(start))
        shown = np.asarray(states) + 0.002 * rng.normal(size=(SAMPLES, 10))
        columns = {**dict(zip(model.controls, control.T, strict=True)), **dict(zip(model.states, shown.T, strict=True))}
        channels = tuple(
            Channel(name, signal_unit(name), "control" if name in model.controls else "measurement") for name in columns
        )
        records.append(make_record(STEP * np.arange(SAMPLES), columns, channels, Provenance("release", ""), label))
        starts.append(start)
    known = {name: Normal(value, 1e-3 * abs(value)) for name, value in vehicle.coefficients.items()}
    found = fit_motion(model, records, starts, {**known, **PRIORS})
    for name, value in truth.items():
        assert found[name][0] == pytest.approx(value, abs=0.03 * abs(value) + 2e-4), name
