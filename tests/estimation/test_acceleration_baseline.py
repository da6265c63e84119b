"""Least squares of accelerations, simulated: on a vehicle of its own equations, written out by hand and solved by another integrator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.prediction.acceleration_baseline import acceleration_baseline
from seatrial.estimation.prediction.baselines import fit_baselines
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from tests.cases import TRUTH, paper_model
from tests.estimation_cases import golden_motion, make_trial

TERMS = ("Y_v", "Y_r", "Y_delta_r", "N_v", "N_r", "N_rabsr", "N_delta_r")
TRUE = np.array([-0.3, -0.2, 0.1, -0.05, -0.5, -1.0, -0.4])


def sway_yaw(*terms):
    equations = [axis_equation(axis, tuple(one for one in terms if one[0] == axis)) for axis in "YN"]
    return axes_vehicle("ship", equations)


def manoeuvre(seed, noise=0.0, n=900):
    """Sway and yaw under random rudder angles, solved to 1e-8."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(n)
    rudder = np.repeat(rng.normal(0.0, 0.3, n // 30), 30)
    y_v, y_r, y_d, n_v, n_r, n_rr, n_d = TRUE

    def rate(t, x):
        v, r = x
        d = rudder[min(int(t / 0.1 + 1e-9), n - 1)]
        return [y_v * v + y_r * r + y_d * d, n_v * v + n_r * r + n_rr * r * abs(r) + n_d * d]

    motion = solve_ivp(rate, (0.0, time[-1]), [0.0, 0.0], t_eval=time, max_step=0.1, rtol=1e-8, atol=1e-10).y
    v, r = motion + noise * rng.normal(size=motion.shape)
    channels = (
        Channel("delta_r", "rad", "control"),
        Channel("v", "m/s", "measurement"),
        Channel("r", "rad/s", "measurement"),
    )
    return make_record(time, {"delta_r": rudder, "v": v, "r": r}, channels, Provenance("test", ""), f"run {seed}")


def test_sway_and_yaw_are_found_back_and_simulated():
    """Noise of about 1 % of the motion, and a gap."""
    baseline = acceleration_baseline(sway_yaw(*TERMS))
    records = [manoeuvre(seed, noise=0.001) for seed in range(3)]
    records[0].measurement[100:140, 0] = np.nan
    found = baseline.fit(records[:2], ["v", "r"], ["delta_r"])
    assert [found.parameters[name] for name in ("Y_v", "N_r", "N_delta_r")] == pytest.approx(
        [-0.3, -0.5, -0.4], rel=0.1
    )
    scores = found.score(records[2])
    assert min(scores["v"].explained, scores["r"].explained) > 0.99
    late = found.score(records[2], start=400)
    assert min(late["v"].explained, late["r"].explained) > 0.99
    assert np.isnan(found.predict(records[2], start=400)[:400]).all()


def test_surge_without_noise_is_the_vehicle():
    time, rev, speed = golden_motion()
    model = paper_model(*TRUTH)
    record = make_trial(time, rev, u=speed)
    found = acceleration_baseline(model).fit([record], ["u"], ["n"])
    assert found.score(record)["u"].explained > 0.999


def test_what_cannot_be_fitted_says_why():
    record = manoeuvre(0)
    ship = acceleration_baseline(sway_yaw(*TERMS))
    with pytest.raises(InputError, match="there is no run to fit"):
        ship.fit([], ["r"], [])
    with pytest.raises(InputError, match="the vehicle has none of the channels u"):
        ship.fit([record], ["u"], [])
    surge = acceleration_baseline(paper_model(*TRUTH))
    with pytest.raises(InputError, match='u, which the equations need, has 0 measured samples in run "run 0"'):
        surge.fit([record], ["u"], [])
    held = record.control.copy()
    held[:] = 0.1
    constant = axes_vehicle("spin", [axis_equation("N", ("N_0", "N_r", "N_delta_r"))])
    _, refused = fit_baselines([replace(record, control=held)], ["r"], [], [acceleration_baseline(constant)])
    assert refused["accelerations"] == "these runs show only combinations of N_0, N_r, N_delta_r"


def test_a_fitted_vehicle_that_diverges_is_refused_in_words():
    """Yaw that speeds up by its own square until it ends: no rudder is needed to run away."""
    time = 0.1 * np.arange(200)
    yaw = 1.0 / (21.0 - time)
    rng = np.random.default_rng(0)
    rudder = 0.1 * rng.normal(size=200)
    channels = (Channel("delta_r", "rad", "control"), Channel("r", "rad/s", "measurement"))
    record = make_record(time, {"delta_r": rudder, "r": yaw}, channels, Provenance("test", ""), "runaway")
    longer = make_record(
        np.append(time, time + 20.0),
        {"delta_r": np.tile(rudder, 2), "r": np.append(yaw, np.full(200, np.nan))},
        channels,
        Provenance("test", ""),
        "longer",
    )
    model = axes_vehicle("spin", [axis_equation("N", ("N_rabsr", "N_delta_r"))])
    baseline = acceleration_baseline(model)
    fitted, refused = fit_baselines([longer], ["r"], ["delta_r"], [baseline])
    assert not fitted
    assert "diverges" in refused["accelerations"]
    with pytest.raises(NumericalError, match="diverges"):
        baseline.fit([longer], ["r"], ["delta_r"])
    assert baseline.fit([record], ["r"], ["delta_r"]).score(record)["r"].explained > 0.9
