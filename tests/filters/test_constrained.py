"""Sigma points kept inside bounds; test_textbook.py has the match with the textbook, test_linear.py wide bounds."""

import jax.numpy as jnp
import numpy as np

from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.numerics.gaussian import independent
from seatrial.numerics.state_space import StateSpace

N = 40
STEP, NO_CONTROL = np.ones(N), np.zeros((N, 0))


def transition(state, control, h):
    """A level that decays by its root, and is seen through its root: undefined below zero."""
    return (state[0] - 0.1 * h * jnp.sqrt(state[0]) + 0.05 * h,)


def observe(state, control):
    return (jnp.sqrt(state[0]) * state[1],)


SPACE = StateSpace(
    independent([0.5, 1.0], [0.6, 0.5]),
    jnp.array([0.05, 0.01]),
    jnp.array([0.1]),
    ("level", "gain"),
    ("flow",),
    1,
    transition,
    observe,
)


def flow():
    return np.abs(0.5 + 0.1 * np.random.default_rng(8).normal(size=(N, 1)))


def test_points_never_leave_the_bounds():
    """One point outside would make the root, and with it everything after, NaN."""
    bounds = ((0.0, 2.0), (0.2, 1.8))
    trace = run_filter(SquareRootUnscentedKalmanFilter(bounds=bounds), SPACE, NO_CONTROL, flow(), STEP)
    assert int(trace.failures) == 0
    assert np.isfinite(trace.log_likelihood)
    assert (np.asarray(trace.sds) > 0).all()
    assert (np.linalg.eigvalsh(trace.final.cov) > 0).all()
    for i, (lower, upper) in enumerate(bounds):
        assert (np.asarray(trace.means[:, i]) >= lower).all()
        assert (np.asarray(trace.means[:, i]) <= upper).all()
    assert trace.clipped[0] > 0


def test_without_bounds_the_same_trial_fails_loudly():
    trace = run_filter(SquareRootUnscentedKalmanFilter(), SPACE, NO_CONTROL, flow(), STEP)
    assert int(trace.failures) > 0
