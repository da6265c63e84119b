"""A covariance that is lost must never pass unseen."""

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.numerics.gaussian import independent
from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.numerics.state_space import StateSpace

N = 12
BOUNDS = ((-10.0, 10.0),)
FILTERS = {
    "extended": ExtendedKalmanFilter(),
    "unscented": UnscentedKalmanFilter(),
    "square root": SquareRootUnscentedKalmanFilter(),
    "constrained": SquareRootUnscentedKalmanFilter(bounds=BOUNDS),
}
INDEFINITE = UnscentedRule(0.1, beta=-1.0)
"""Gives x^2, for x standard normal, the variance -1: (1 - a^2)^2/a^2 - (1/a^2 - 2 + a^2) + beta."""
INDEFINITE_FILTERS = {
    "unscented": UnscentedKalmanFilter(INDEFINITE),
    "square root": SquareRootUnscentedKalmanFilter(INDEFINITE),
    "constrained": SquareRootUnscentedKalmanFilter(INDEFINITE, BOUNDS),
}


def transition(state, control, h):
    return (control[0] * state[0] + control[1] * state[0] ** 2 + control[2] * state[0] ** 3,)


def observe(state, control):
    return (control[3] * state[0] + control[4] * state[0] ** 2,)


def run(method, moves=(0.9, 0.0, 0.0), seen=(1.0, 0.0), *, mean=0.0, sd=1.0, noise=(0.1, 0.5), measurement=0.0):
    """Run over a constant measurement; `moves` and `seen` are the coefficients of polynomials in the state."""
    space = StateSpace(
        independent([mean], [sd]), jnp.array(noise[:1]), jnp.array(noise[1:]), ("x",), ("y",), 1, transition, observe
    )
    return run_filter(method, space, np.tile([*moves, *seen], (N, 1)), np.full((N, 1), measurement), np.ones(N))


@pytest.mark.parametrize(
    "settings",
    [
        {"moves": (0.0, 1.0, 0.0)},
        {"moves": (0.0, 1.0, 0.0), "measurement": np.nan},
        {"seen": (0.0, 1.0)},
    ],
    ids=["in a prediction", "in a prediction without measurement", "of the innovation"],
)
@pytest.mark.parametrize("name", INDEFINITE_FILTERS)
def test_negative_variance_is_counted(name, settings):
    assert int(run(INDEFINITE_FILTERS[name], **settings).failures) > 0


HARSH = {
    "no initial spread given": {"sd": np.nan},
    "no noise at all": {"noise": (0.0, 0.0)},
    "vague prior, accurate sensor": {"sd": 1e9, "noise": (0.1, 0.01)},
    "very vague prior": {"sd": 1e7, "noise": (0.1, 0.3)},
    "sudden blow-up": {"moves": (0.0, 0.0, 1e9), "mean": 3.0},
    "blow-up unseen": {"moves": (0.0, 0.0, 1e9), "mean": 3.0, "measurement": np.nan},
}


@pytest.mark.parametrize("case", HARSH)
@pytest.mark.parametrize("name", FILTERS)
def test_no_failure_is_silent(name, case):
    """Standard deviations are positive and the likelihood finite, or `failures` says that they are not."""
    trace = run(FILTERS[name], **HARSH[case])
    sds = np.asarray(trace.sds)
    healthy = np.isfinite(trace.log_likelihood) and (sds > 0).all() and np.isfinite(sds).all()
    assert healthy or int(trace.failures) > 0


@pytest.mark.parametrize("name", FILTERS)
def test_a_sample_is_counted_once(name):
    assert int(run(FILTERS[name], sd=np.nan).failures) == N
