"""Stability under an autopilot against textbook loops and brute force; the information of innovations against generalised least squares."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.special import logsumexp

from seatrial.core.coefficients import CoefficientName
from seatrial.design.expected_gain import GainSettings, importance_gain
from seatrial.design.free_form_objective import courses, utilities, utility, utility_slope
from seatrial.design.free_form_problem import FreeFormProblem
from seatrial.design.loop_stability import best_gain_change, loop_growth
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.trial_plan import plan_trial
from seatrial.manoeuvres.autopilot import Autopilot, Loop
from seatrial.manoeuvres.free_form import SteppedInput
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.numerics.gaussian import Gaussian
from seatrial.vehicles.model import VehicleModel

H = 0.05
TURNING = VehicleModel(
    "turning",
    ("r", "psi"),
    ("delta_r",),
    (CoefficientName.parse("N_r"), CoefficientName.parse("N_delta_r")),
    (),
    False,
    lambda params, state, held: (params["N_r"] * state[0] + params["N_delta_r"] * held[0], state[0]),
)
"""Yaw about a fixed axis, without mass: everything of it is known in closed form."""


def plan(kp, kd, ki=0.0, every=1, **more):
    loop = Loop("psi", (("delta_r", 1.0),), kp, ki, kd, "r", every=every, interval=every * H)
    pilot = Autopilot(("delta_r",), (loop,), (-np.inf,), (np.inf,))
    return plan_trial(TURNING, (0.0, 0.0), {"r": 0.01, "psi": 0.02}, 400, H, autopilot=pilot, **more)


def test_growth_is_that_of_the_sampled_loop():
    """One step of the vehicle by its own exact formula; RK4 is that to 1e-7 here."""
    draws = np.array([[0.5, 1.0], [-0.2, 2.0], [0.5, 0.2]])
    found = loop_growth(plan(1.0, 1.5), np.zeros(2), draws)
    for rate, (a, b) in zip(found.rate, draws, strict=True):
        e = np.exp(a * H)
        move = np.array([[e, 0.0], [(e - 1) / a, 1.0]])
        push = np.array([b * (e - 1) / a, b * ((e - 1) / a - H) / a])
        closed = move + np.outer(push, [-1.5, -1.0])
        own = np.abs(np.linalg.eigvals(closed)).max()
        # Without an integral gain the sum of the errors is there, and leads nowhere: an eigenvalue of one.
        assert rate == pytest.approx(max(np.log(own), 0.0) / H, abs=1e-5)
    assert found.unstable.tolist() == [False, False, True]


@pytest.mark.parametrize(("kp", "kd", "gains"), [(-1.0, 1.5, ("kp",)), (-1.0, -1.5, ("kp", "kd"))])
def test_a_gain_or_a_loop_of_the_wrong_sign_is_named(kp, kd, gains):
    draws = np.array([[-0.2, 2.0 + 0.1 * i] for i in range(10)])
    change = best_gain_change(plan(kp, kd), np.zeros(2), draws)
    assert (change.gains, change.factor, change.unstable) == (gains, -1.0, 0.0)


@pytest.mark.parametrize("sd", [0.02, 3.0])
def test_the_autopilot_sees_the_noise_of_each_sensor(sd):
    """Noise over its standard deviation comes back in the channel's own unit, and nothing where the channel is not measured."""
    seen = replace(plan(1.0, 1.5), weight=np.where(np.arange(400)[:, None] % 2 == 0, [1 / 0.01, 1 / sd], 0.0))
    noise = np.random.default_rng(3).normal(size=(400, 2))
    errors = dict(zip(seen.autopilot.outputs, seen.moments(np.zeros((400, 1)), noise)[1].error, strict=True))
    np.testing.assert_allclose(np.asarray(errors["psi"])[::2], sd * noise[::2, 1])
    assert np.isnan(np.asarray(errors["psi"])[1::2]).all()


def test_slow_decisions_make_it_unstable_and_the_gain_to_lower_is_named():
    draws = np.array([[-0.2, 4.0 + 0.1 * i] for i in range(10)])
    assert not loop_growth(plan(1.0, 1.5), np.zeros(2), draws).unstable.any()
    slow = plan(1.0, 1.5, every=8)
    growth = loop_growth(slow, np.zeros(2), draws)
    assert growth.unstable.all()
    change = best_gain_change(slow, np.zeros(2), draws)
    assert (change.holds, change.gains, change.factor) == ("psi", ("kd",), 0.5)
    halved = replace(slow, autopilot=slow.autopilot.with_gain("psi", "kd", 0.5))
    assert change.unstable == loop_growth(halved, np.zeros(2), draws).unstable.mean()
    motion = np.array(jax.vmap(lambda values: slow.motion(values, np.tile([0.0, 0.01], (400, 1))))(draws))
    assert (np.abs(motion[:, -1]).max(1) > 100 * np.abs(motion[:, 40]).max(1)).all()


def test_too_little_derivative_is_doubled():
    draws = np.array([[0.5, 0.4]] * 5)
    change = best_gain_change(plan(1.0, 0.8), np.zeros(2), draws)
    assert (change.gains, change.factor, change.unstable) == (("kd",), 2.0, 0.0)


def outputs(values, applied):
    """Rate and heading by the exact formula of a held rudder, over their noise."""
    a, b = values
    e, r, psi, shown = np.exp(a * H), 0.0, 0.0, []
    for rudder in applied:
        shown.append((r / 0.01, psi / 0.02))
        psi += r * (e - 1) / a + b * rudder * ((e - 1) / a - H) / a
        r = r * e + b * rudder * (e - 1) / a
    return np.array(shown).ravel()


def slopes(values, applied):
    steps = [1e-6 * np.eye(2)[i] for i in range(2)]
    return np.array([(outputs(values + h, applied) - outputs(values - h, applied)) / 2e-6 for h in steps]).T


def test_information_is_that_given_the_controls_that_the_loop_made():
    told = np.column_stack([0.02 * np.sin(np.arange(400) / 9), np.where(np.arange(400) % 160 < 80, 0.3, -0.3)])
    values, made = np.array([0.3, 1.1]), plan(1.0, 1.5, every=2)
    applied = np.asarray(made.applied(values, told))[:, 0]
    by_hand = slopes(values, applied)
    np.testing.assert_allclose(np.asarray(made.information(values, told)), by_hand.T @ by_hand, rtol=1e-5)


def test_with_process_noise_it_is_that_of_generalised_least_squares():
    """The covariance of all outputs, from noise of each step carried on by powers of the transition."""
    told = np.column_stack([np.zeros(400), np.where(np.arange(400) % 160 < 80, 0.3, -0.3)])
    values, process = np.array([0.3, 1.1]), np.array([0.02, 0.01])
    made = plan(1.0, 1.5, process=process)
    e = np.exp(values[0] * H)
    move = np.array([[e, 0.0], [(e - 1) / values[0], 1.0]])
    states = np.zeros((800, 800))
    now = np.zeros((2, 2))
    powers = [np.linalg.matrix_power(move, k) for k in range(400)]
    for k in range(400):
        for j in range(k, 400):
            block = powers[j - k] @ now
            states[2 * j : 2 * j + 2, 2 * k : 2 * k + 2] = block
            states[2 * k : 2 * k + 2, 2 * j : 2 * j + 2] = block.T
        now = move @ now @ move.T + np.diag(process**2) * H
    scale = np.tile([1 / 0.01, 1 / 0.02], 400)
    cov = states * np.outer(scale, scale) + np.eye(800)
    by_hand = slopes(values, np.asarray(made.applied(values, told))[:, 0])
    expected = by_hand.T @ np.linalg.solve(cov, by_hand)
    np.testing.assert_allclose(np.asarray(made.information(values, told)), expected, rtol=1e-4)


@pytest.mark.proof
@pytest.mark.parametrize("turn", [0.15, 0.0], ids=["set-points", "noise alone"])
def test_expected_gain_through_an_autopilot_is_that_of_quadrature(turn):
    """The likelihood of outputs given the controls that the noisy loop made, by the vehicle's own formula, over a grid of the prior."""
    n, mean, sd = 120, np.array([-0.8, 1.0]), np.array([0.2, 0.3])
    loop = Loop("psi", (("delta_r", 1.0),), 8.0, 0.0, 6.0, "r", interval=H)
    pilot = Autopilot(("delta_r",), (loop,), (-np.inf,), (np.inf,))
    noise = {"r": 0.15, "psi": 0.2}
    trial = plan_trial(TURNING, (0.0, 0.0), noise, n, H, autopilot=pilot)
    wanted = np.where(np.arange(n) < n // 2, turn, -turn)
    control = np.column_stack([np.zeros(n), wanted])
    belief = Gaussian(mean, np.diag(sd))
    found = importance_gain(trial, belief, control, jax.random.key(1), GainSettings(outer=320, inner=128))

    nodes = np.linspace(-4.5, 4.5, 61)
    z = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), -1).reshape(-1, 2)
    grid, log_weights = mean + sd * z, 2 * np.log((nodes[1] - nodes[0]) / np.sqrt(2 * np.pi)) - 0.5 * (z**2).sum(1)
    random, gains = np.random.default_rng(2), []
    for truth in mean + sd * random.normal(size=(400, 2)):
        error, rows = random.normal(size=(n, 2)) * list(noise.values()), np.vstack([truth, grid])
        a, b = rows.T
        e = np.exp(a * H)
        r, psi, fits = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows))
        for k in range(n):
            shown = r[0] + error[k, 0], psi[0] + error[k, 1]
            fits -= 0.5 * (((shown[0] - r) / noise["r"]) ** 2 + ((shown[1] - psi) / noise["psi"]) ** 2)
            rudder = 8.0 * (wanted[k] - shown[1]) - 6.0 * shown[0]
            drift = b * rudder / a
            r, psi = (r + drift) * e - drift, psi + (r + drift) * (e - 1) / a - drift * H
        gains.append(fits[0] - logsumexp(fits[1:] + log_weights))
    error = np.hypot(np.std(gains) / np.sqrt(len(gains)), found.std_error)
    assert not found.status
    assert abs(found.value - np.mean(gains)) < 3 * error
    assert found.value > 8 * error


@pytest.mark.parametrize(
    "process", [None, pytest.param((0.02, 0.005), marks=pytest.mark.proof)], ids=["none", "process noise"]
)
def test_a_free_form_of_a_set_point_is_followed_through_the_autopilot(process):
    """Information as the plan's own, its gradient by differences, and the course as the plan's motion, in blocks that do not fit."""
    trial, draws = plan(2.0, 1.5, every=2, process=process), np.array([[0.5, 1.0], [-0.2, 2.0]])
    form = SteppedInput("psi_set", 0.1, 20.0, 1.0, 15.0, 7, edge=0.3)
    cov, limit = np.diag([0.2, 0.3]) ** 2, MotionLimit("psi", -2.0, 2.0)
    problem = FreeFormProblem(trial, form, Limits(-0.5, 0.5), draws, cov, {"delta_r": 0.02}, motion=(limit,))
    setup, x = problem.setup(), np.random.default_rng(4).uniform(-0.8, 0.8, 7)
    assert len(trial.step) % problem.block

    control = np.column_stack([np.full(400, 0.02), 0.1 + form.basis(trial.time) @ x * problem.span])
    seen = [cov @ np.asarray(trial.information(point, control)) for point in draws]
    expected = np.mean([0.5 * np.linalg.slogdet(np.eye(2) + one)[1] for one in seen])
    assert float(utility(setup, x, problem.block)) == pytest.approx(expected, rel=1e-9)

    step = 1e-5 * np.eye(7)
    ahead, behind = (utilities(setup, x + sign * step, problem.block)[0] for sign in (1, -1))
    slope = utility_slope(setup, x, problem.block)
    np.testing.assert_allclose(slope, (np.asarray(ahead) - behind) / 2e-5, rtol=1e-5, atol=1e-7)

    found = courses(setup, problem.watched(), x[None], problem.block)
    for at, point in enumerate(draws):
        psi = np.asarray(trial.motion(point, control))[:, 1]
        for i in range(400 // problem.block):
            block = psi[i * problem.block : (i + 1) * problem.block + 1]
            assert found.highest[0, at, i, 0] == pytest.approx(block.max(), abs=1e-12)
            assert found.lowest[0, at, i, 0] == pytest.approx(block.min(), abs=1e-12)
