"""The place from which a mode is sought: least squares on motion that SciPy integrated, and a mode that prior draws miss."""

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.first_guess import _inside, first_guess, turn_of_sensor
from seatrial.estimation.posterior.mode import find_mode, maximise_from
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.sampling.target import evaluate
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle

TRUTH = {"Y_v": -0.8, "Y_ur": -0.3, "Y_delta_r": 0.4, "N_v": -1.5, "N_r": -2.0, "N_rabsr": -6.0, "N_delta_r": -1.2}
PRIORS = {name: Normal(0.0, 5.0) for name in TRUTH}


def model():
    axes = {axis: [name for name in TRUTH if name[0] == axis] for axis in "YN"}
    return axes_vehicle("turning", [axis_equation(axis, names) for axis, names in axes.items()])


def record(noise=0.0, count=401, step=0.1, gaps=False):
    """Sway and yaw under steps of the rudder, by SciPy over each interval; speed 1.5 m/s."""
    t, random = TRUTH, np.random.default_rng(4)
    time = step * np.arange(count)
    rudder = 0.25 * np.sign(np.sin(0.9 * time + 0.3 * np.sin(0.37 * time)))
    state, rows = np.zeros(2), []
    for k in range(count):
        rows.append(state)

        def rates(_, x, delta=rudder[k]):
            v, r = x
            return (
                t["Y_v"] * v + t["Y_ur"] * 1.5 * r + t["Y_delta_r"] * delta,
                t["N_v"] * v + t["N_r"] * r + t["N_rabsr"] * r * abs(r) + t["N_delta_r"] * delta,
            )

        state = solve_ivp(rates, (0.0, step), state, rtol=1e-9, atol=1e-12).y[:, -1]
    v, r = (np.array(rows) + noise * random.normal(size=(count, 2))).T
    if gaps:
        v = np.where(np.arange(count) % 3, np.nan, v)
    columns = {"u": np.full(count, 1.5), "delta_r": rudder, "v": v, "r": r}
    channels = tuple(
        Channel(name, signal_unit(name), "control" if name in ("u", "delta_r") else "measurement") for name in columns
    )
    return make_record(time, columns, channels, Provenance("made", "0" * 64), "1")


@pytest.mark.parametrize(("noise", "gaps", "within"), [(0.0, False, 0.03), (0.0, True, 0.25), (0.002, False, 0.25)])
def test_least_squares_are_near_the_truth(noise, gaps, within):
    found = first_guess(model(), [record(noise, gaps=gaps)], [(0.0, 0.0)], PRIORS)
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, rel=within, abs=1e-9), name


def test_the_guess_stays_inside_the_priors():
    priors = PRIORS | {"N_delta_r": Uniform(-1.0, 3.0)}
    found = first_guess(model(), [record()], [(0.0, 0.0)], priors)
    assert -1.0 < found["N_delta_r"] < -0.99
    assert np.isfinite(priors["N_delta_r"].unconstrain(found["N_delta_r"]))


def test_added_mass_is_found_by_several_steps():
    """Forces over an unknown mass are no longer linear in the coefficients."""
    vehicle = whole_vehicle(
        Hull("boat", 30.0, thrust_deduction=0.0, fixed={}, trim={"u": 1.0}),
        ("X_udot", "X_uabsu", "T_nabsn"),
        moves=("u",),
    )
    truth, priors = {"X_udot": -6.0, "X_uabsu": -5.0, "T_nabsn": 5e-4}, {}
    time = 0.1 * np.arange(600)
    n = 100.0 + 40.0 * np.sign(np.sin(0.7 * time))
    u, rows = 1.0, []
    for k in range(time.size):
        rows.append(u)
        for _ in range(20):
            u += 0.005 * (truth["T_nabsn"] * n[k] * abs(n[k]) + truth["X_uabsu"] * u * abs(u)) / 36.0
    columns = {"n": n, "u": np.array(rows)}
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    log = make_record(time, columns, channels, Provenance("made", "0" * 64), "1")
    # Only two of the three can be told from force and motion; the third is where its narrow prior is.
    priors = {"X_udot": Normal(-2.0, 10.0), "X_uabsu": Normal(-5.0, 0.01), "T_nabsn": Normal(1e-3, 1e-3)}
    found = first_guess(vehicle, [log], [(1.0,)], priors)
    assert found["T_nabsn"] == pytest.approx(truth["T_nabsn"], rel=0.03)
    assert found["X_udot"] == pytest.approx(truth["X_udot"], abs=1.0)


def test_nothing_is_guessed_where_no_velocity_is_measured():
    log = record()
    blind = make_record(
        log.time,
        {name: log.channel(name) for name in ("u", "delta_r")} | {"psi": 0.1 * log.time},
        (*(channel for channel in log.channels if channel.role == "control"), Channel("psi", "rad", "measurement")),
        Provenance("made", "0" * 64),
        "1",
    )
    assert first_guess(model(), [blind], [(0.0, 0.0)], PRIORS) == {}


@pytest.mark.parametrize(
    ("angle", "count", "noise"),
    [(0.45, 400, 0.05), (0.45, 3, 0.05), (0.3, 400, 0.05), (-0.2, 400, 0.02), (3.1, 400, 0.02), (-0.26, 400, 0.002)],
)
def test_the_turn_of_a_sensor_is_told_where_the_coefficients_can_be_fitted(angle, count, noise):
    """Linear surge and sway under steps, in closed form, seen from aside; three samples are too few for four coefficients."""
    truth = {"X_u": -9.0, "T_nabsn": 2e-3, "Y_v": -30.0, "Y_delta_r": 60.0}
    hull = Hull("boat", 30.0, thrust_deduction=0.0, fixed={}, trim={"u": 1.0})
    vehicle = whole_vehicle(hull, tuple(truth), moves=("u", "v"))
    time = 0.1 * np.arange(count)
    n, delta = 100.0 + 40.0 * np.sign(np.sin(0.7 * time)), 0.3 * np.sign(np.sin(1.1 * time))
    true = np.zeros((count, 2))
    for k in range(count - 1):
        steady = np.array([truth["T_nabsn"] * n[k] ** 2 / 9.0, truth["Y_delta_r"] * delta[k] / 30.0])
        true[k + 1] = steady + (true[k] - steady) * np.exp(-0.1 * np.array([9.0, 30.0]) / 30.0)
    u, v = (true + noise * np.random.default_rng(1).normal(size=(count, 2))).T
    shown = {"u": np.cos(angle) * u + np.sin(angle) * v, "v": np.cos(angle) * v - np.sin(angle) * u}
    channels = tuple(
        Channel(name, signal_unit(name), "measurement" if name in shown else "control")
        for name in ("n", "delta_r", "u", "v")
    )
    log = make_record(time, {"n": n, "delta_r": delta, **shown}, channels, Provenance("made", "0" * 64), "1")
    priors = {name: Normal(value, 0.5 * abs(value)) for name, value in truth.items()}
    turn = turn_of_sensor(vehicle, log, (1.0, 0.0), priors, ("u", "v"))
    assert (turn is not None) == (count > 3)
    if turn is not None:
        assert turn.axis == 2
        assert abs(np.angle(np.exp(1j * (turn.angle - angle)))) < 3 * turn.sd < 0.25


@pytest.mark.proof
def test_the_mode_is_found_where_draws_of_wide_priors_end_on_another_hill():
    vehicle, log = model(), record(noise=0.002)
    sensors = [Sensor("v", "white"), Sensor("r", "white")]
    likelihood, data = output_error(vehicle, [log], sensors, [(0.0, 0.0)])
    wide = {name: Normal(0.0, 10.0) for name in TRUTH}
    parameters = [Parameter(str(t), vehicle.unit_of(t), t.label, wide[str(t)]) for t in vehicle.coefficients]
    parameters += [Parameter(f"sigma_{name}", "", "", LogUniform(1e-4, 1.0)) for name in ("v", "r")]
    guess = first_guess(vehicle, [log], [(0.0, 0.0)], wide)
    places = np.array([guess.get(parameter.name, np.nan) for parameter in parameters])
    plain = Posterior(tuple(parameters), likelihood, data)
    draws = np.array(plain.sample_prior(jax.random.key(0), 32))
    alone = maximise_from(plain, draws[np.argmax(evaluate(plain, draws))])
    helped = find_mode(Posterior(plain.parameters, likelihood, data, places), key=jax.random.key(0), starts=32, tries=1)
    assert helped.log_density > alone.log_density + 50
    for value, sd, (name, truth) in zip(helped.values, helped.sd, TRUTH.items(), strict=False):
        assert abs(value - truth) < 4 * sd, name


def test_a_guess_outside_is_brought_in_by_a_thousandth_of_the_prior_s_deviation():
    prior = Uniform(2e-3, 8e-3)
    hair = 6e-6 / np.sqrt(12)
    assert [_inside(x, prior) for x in (-1.0, 5e-3, 1.0)] == pytest.approx([2e-3 + hair, 5e-3, 8e-3 - hair], rel=1e-9)
