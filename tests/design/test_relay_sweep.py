from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.relay_sweep import RelaySweep, sweep_relay
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.relay import RelayFamily
from seatrial.numerics.gaussian import independent
from seatrial.numerics.state_space import StateSpace
from tests.cases import N0, RPM, THRUST, U0, X_U, X_UU, surge_rate
from tests.design.test_sweep import BELIEF_SD, PROCESS_SD, paper_space
from tests.filters.textbook import Problem, extended, unscented

TRUTH = np.array([U0, X_U, X_UU, THRUST])
SHORT = RelayFamily((("n", N0),), "n", "u", U0, duration=15.0, sample_time=0.1)
AMPLITUDES, THRESHOLDS = np.array([100.0, 200.0]) * RPM, np.array([0.1, 0.3])
FAST = ExtendedKalmanFilter()


def textbook(method, amplitude, threshold, noise):
    """Entropy reduction, peak speed, final sds and reversals of one relay test, by plain Euler loops and matrices."""

    def rate(u, control, x):
        return surge_rate(u, control / (2 * np.pi), *x[1:])

    n, h = SHORT.time().size, SHORT.sample_time
    u, side, speed, control, switches = U0, 1, [], [], 0
    for k in range(n):
        if side * (u + noise[k] - U0) >= threshold:
            side, switches = -side, switches + 1
        speed.append(u)
        control.append(N0 + side * amplitude)
        u = u + h * rate(u, control[-1], TRUTH)
    speed, control = np.array(speed), np.array(control)
    problem = Problem(
        TRUTH,
        np.diag(BELIEF_SD**2),
        lambda x, c, h: np.array([x[0] + h * rate(x[0], c, x), *x[1:]]),
        lambda x, c: np.array([x[0], rate(x[0], c, x)]),
        np.diag(PROCESS_SD**2),
        0.01 * np.eye(2),
    )
    measured = np.column_stack([speed, rate(speed, control, TRUTH)])
    last = method(problem, control, measured, np.full(n, h)).covs[-1]
    gain = 0.5 * (2 * np.log(BELIEF_SD[1:]).sum() - np.linalg.slogdet(last[1:, 1:])[1])
    return gain, np.abs(speed).max(), np.sqrt(np.diag(last)[1:]), switches


@pytest.mark.parametrize(
    ("method", "naive"),
    [
        (FAST, extended),
        pytest.param(SquareRootUnscentedKalmanFilter(), unscented, marks=pytest.mark.proof),
    ],
    ids=["extended", "square root"],
)
@pytest.mark.parametrize("noise_sd", [0.0, 0.04])
def test_every_design_alone_by_the_textbook(method, naive, noise_sd):
    noise = np.random.default_rng(3).normal(size=SHORT.time().size) * noise_sd
    sweep = sweep_relay(paper_space(BELIEF_SD), SHORT, AMPLITUDES, THRESHOLDS, method=method, noise=noise)
    assert sweep.gain.shape == sweep.switches.shape == sweep.reached.shape == (2, 2)
    assert sweep.final_sd.shape == (2, 2, 3)
    for i, amplitude in enumerate(AMPLITUDES):
        for j, threshold in enumerate(THRESHOLDS):
            gain, peak, sd, switches = textbook(naive, amplitude, threshold, noise)
            assert sweep.gain[i, j] == pytest.approx(gain, abs=1e-6)
            assert sweep.peak_speed[i, j] == pytest.approx(peak, rel=1e-12)
            assert sweep.final_sd[i, j] == pytest.approx(sd, rel=1e-6)
            assert sweep.switches[i, j] == switches


def test_unreachable_thresholds_are_never_best():
    """In 15 s, 100 rpm moves the speed by less than 0.23 m/s, and 200 rpm by 0.4 m/s one way but not back as well."""
    sweep = sweep_relay(paper_space(BELIEF_SD), SHORT, AMPLITUDES, np.array([0.1, 0.3, 0.4]), method=FAST)
    assert sweep.oscillates.tolist() == [[True, False, False], [True, True, False]]
    assert sweep.switches[:, 1:].tolist() == [[0, 0], [3, 1]]
    assert sweep.oscillates[sweep.best]
    assert sweep.gain[sweep.best] == sweep.gain[sweep.oscillates].max()


def test_no_design_oscillates():
    with pytest.raises(InputError, match="never on both sides") as caught:
        sweep_relay(paper_space(BELIEF_SD), SHORT, AMPLITUDES, np.array([0.6, 0.7]), method=FAST)
    assert "lower the thresholds" in caught.value.remedy


@pytest.mark.parametrize(
    ("limits", "rate", "allowed"),
    [
        (Limits(), np.inf, [True, True]),
        (Limits(upper=N0 + 150 * RPM), np.inf, [True, False]),
        (Limits(lower=N0 - 150 * RPM), np.inf, [True, False]),
        (Limits(rate=30 * 10.0), np.inf, [True, False]),
        (Limits(rate=300.0), 300.0, [True, True]),
    ],
    ids=["none", "upper", "lower", "rate", "slow enough"],
)
def test_designs_outside_the_limits_have_no_gain(limits, rate, allowed):
    """A reversal of 200 rpm is 41.9 rad/s within a sample of 0.1 s."""
    sweep = sweep_relay(
        paper_space(BELIEF_SD), replace(SHORT, rate=rate), AMPLITUDES, THRESHOLDS[:1], limits, method=FAST
    )
    assert np.isfinite(sweep.gain[:, 0]).tolist() == allowed
    assert allowed[sweep.best[0]]


@pytest.mark.parametrize(
    ("limits", "found"),
    [
        (Limits(upper=80.0), "upper limit 80, but the gentlest design reaches 89"),
        (Limits(rate=30.0), "rate limit 30, but the gentlest design reaches 209.4"),
    ],
)
def test_no_design_inside_the_limits(limits, found):
    with pytest.raises(InputError, match="control n") as caught:
        sweep_relay(paper_space(BELIEF_SD), SHORT, AMPLITUDES, THRESHOLDS, limits, method=FAST)
    assert found in caught.value.found


def test_motion_that_diverges():
    runaway = np.array([U0, X_U, 60.0, THRUST])
    with pytest.raises(NumericalError, match=r"first at amplitude.*threshold.*narrow the priors"):
        sweep_relay(paper_space(BELIEF_SD, runaway), SHORT, AMPLITUDES, THRESHOLDS, method=FAST)


def test_peak_speed_is_that_of_the_first_state_of_several():
    """du/dt = c f - u, and far faster a second state that follows: the largest |u| of a plain loop, from below zero too."""
    family = RelayFamily((("f", 0.0),), "f", "u", 0.0, duration=6.0, sample_time=0.05)
    space = StateSpace(
        independent([0.0, 5.0, 1.0], [0.1, 0.1, 0.2]),
        jnp.full(3, 1e-3),
        jnp.array([0.05]),
        ("u", "x", "c"),
        ("u",),
        2,
        lambda s, control, h: (s[0] + h * (s[2] * control[0] - s[0]), s[1] + h * (s[0] - s[1])),
        lambda s, control: (s[0],),
    )
    for start in (0.0, -2.0):
        truth = np.array([start, 5.0, 1.3])
        found = sweep_relay(space, family, np.array([1.0]), np.array([0.2]), method=FAST, truth=truth)
        u, side, reached = [start], 1, 0.0
        for _ in range(120):
            reached = max(reached, abs(u[-1]))
            side = -1 if u[-1] >= 0.2 else 1 if u[-1] <= -0.2 else side
            u.append(u[-1] + 0.05 * (1.3 * side - u[-1]))
        assert found.peak_speed[0, 0] == pytest.approx(np.abs(u[:-1]).max())
        assert found.reached[0, 0] == pytest.approx(reached)
        assert found.final_sd.shape == (1, 1, 1)
        assert 0 < found.final_sd[0, 0, 0] < 0.2


def test_two_reversals_are_an_oscillation():
    """One reversal is a step there and back; the best design is that of the highest gain among those that oscillate."""
    switches, gain = np.array([[0, 1, 2], [3, 2, 1]]), np.array([[9.0, 8.0, 2.0], [1.0, np.nan, 7.0]])
    grid = (np.ones(2), np.ones(3), gain, gain, gain[..., None], switches, gain)
    sweep = RelaySweep(SHORT, *grid)
    assert sweep.oscillates.tolist() == [[False, False, True], [True, True, False]]
    assert sweep.best == (0, 2)
