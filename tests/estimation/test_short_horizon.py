"""A vehicle that leaves its course by itself: its eigenvalues against the closed form, and how it is forecast over short horizons."""

import numpy as np
import pytest

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.prediction.forecast import Forecaster
from seatrial.estimation.prediction.short_horizon import growth_rate, short_horizons, steady_eigenvalues
from seatrial.estimation.priors import LogUniform, Normal
from seatrial.messages.predictions import horizon_text
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation

STEP = 0.1
SURGE = axes_vehicle("forced", [axis_equation("X", ["X_u", "X_tau_X"])])
CHANNELS = (Channel("tau_X", "N", "control"), Channel("u", "m/s", "measurement"))
# White noise of the sensor, and next to no force and no error that drifts.
ERRORS = {
    "sigma_u": 0.01, "drift_u": 1e-6, "drift_time_u": 1.0, "disturbance_X": 1e-6, "disturbance_time_X": 1.0, "process_u": 0.0,
}  # fmt: skip


def driven(drag, gain, n=900):
    """A log under a feedback that keeps the speed near a slow wave."""
    random, speed, rows = np.random.default_rng(4), 0.0, []
    for k in range(n):
        force = float(gain * (np.sin(0.3 * k * STEP) - speed) + 0.3 * random.normal())
        rows.append((force, speed + 0.01 * random.normal()))
        grown = np.exp(drag * STEP)
        speed = grown * speed + force * (grown - 1) / drag
    force, measured = np.array(rows).T
    return make_record(np.arange(n) * STEP, {"tau_X": force, "u": measured}, CHANNELS, Provenance("own", ""), "1")


def forecaster(record, drag):
    priors = {"X_u": Normal(0.0, 1.0), "X_tau_X": Normal(1.0, 0.1), "sigma_u": LogUniform(1e-3, 1.0)}
    draws = {"X_u": np.full(2, drag), "X_tau_X": np.ones(2), "sigma_u": np.full(2, 0.01)}
    return Forecaster(make_posterior(SURGE, record, priors, start={"u": 0.0}), draws, (ERRORS,), {"u": 0.1})


def test_what_leaves_its_course_is_forecast_until_errors_have_grown():
    record = driven(0.8, 4.0)
    near = short_horizons(forecaster(record, 0.8), record, 2.0, [0.0])["u"]
    assert near.is_good
    assert near.one_step > near.one_step_held
    assert growth_rate(SURGE, {"X_u": 0.8, "X_tau_X": 1.0}, record) == pytest.approx(0.8)
    text = horizon_text(near, "u", 0.8, 89.9)
    assert "so controls do not determine 90 s: a small error grows by e in 1.2 s (eigenvalue +0.8 1/s)" in text
    assert "over 2 s" in text


def test_a_wrong_model_is_no_better_over_short_horizons():
    record = driven(0.8, 4.0)
    near = short_horizons(forecaster(record, -8.0), record, 2.0, [0.0])["u"]
    assert not near.is_good
    assert "accumulated errors are not the cause" in horizon_text(near, "u")
    assert short_horizons(forecaster(record, 0.8), record, 0.2, [0.0]) == {}


def test_eigenvalues_of_sway_and_yaw_are_those_of_the_characteristic_equation():
    """s^2 + a s + b = 0 with a the sum of both dampings and b Routh's stability of the course, at a speed of 2 m/s; below 0 it leaves."""
    terms = {"Y_uv": -0.2, "Y_ur": -0.6, "N_uv": -0.15, "N_ur": -0.3, "Y_udelta_r": 0.1, "N_udelta_r": -0.1}
    model = axes_vehicle("ship", [axis_equation(axis, [name for name in terms if name[0] == axis]) for axis in "YN"])
    channels = tuple(Channel(name, unit, kind) for name, unit, kind in (
        ("u", "m/s", "control"), ("delta_r", "rad", "control"), ("v", "m/s", "measurement"), ("r", "rad/s", "measurement")
    ))  # fmt: skip
    columns = {
        "u": np.full(9, 2.0),
        "delta_r": np.zeros(9),
        "v": np.sin(np.pi * np.arange(9.0) / 4),
        "r": np.sin(np.pi * np.arange(9.0) / 4),
    }
    record = make_record(np.arange(9.0), columns, channels, Provenance("own", ""), "1")
    for n_ur in (-0.6, -0.3):
        values = terms | {"N_ur": n_ur}
        a = -2.0 * (values["Y_uv"] + values["N_ur"])
        b = 4.0 * (values["Y_uv"] * values["N_ur"] - values["Y_ur"] * values["N_uv"])
        expected = np.roots([1.0, a, b])
        (found,) = steady_eigenvalues(model, values, record).values()
        np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), atol=1e-12)
        assert (growth_rate(model, values, record) > 0) == (b < 0)
