"""A covariance that is lost must never pass unseen."""

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.gaussian import independent
from seatrial.core.state_space import StateSpace
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter, summarise_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.numerics.sigma_points import UnscentedRule

N = 12
FILTERS = {
    "extended": ExtendedKalmanFilter(), "unscented": UnscentedKalmanFilter(), "square root": SquareRootUnscentedKalmanFilter(),
    "constrained": SquareRootUnscentedKalmanFilter(bounds=((-10.0, 10.0),)),
}
INDEFINITE = UnscentedRule(0.1, beta=-1.0)
"""Gives x^2, for x standard normal, the variance -1: (1 - a^2)^2/a^2 - (1/a^2 - 2 + a^2) + beta."""


def run(method, transition=lambda x: 0.9 * x, observe=lambda x: x, *, mean=0.0, sd=1.0, noise=(0.1, 0.5), measurement=0.0):
    space = StateSpace(independent([mean], [sd]), jnp.array(noise[:1]), jnp.array(noise[1:]), ("x",), ("y",), 1,
                       lambda state, control, h: (transition(state[0]),), lambda state, control: (observe(state[0]),))
    data = np.zeros((N, 0)), np.full((N, 1), measurement), np.ones(N)
    trace = run_filter(method, space, *data)
    assert (summarise_filter(method, space, *data).failures > 0) == (trace.failures > 0)
    return trace


@pytest.mark.parametrize("measurement", [0.0, np.nan], ids=["measured", "never measured"])
@pytest.mark.parametrize("place", ["transition", "observe"])
@pytest.mark.parametrize("method", [UnscentedKalmanFilter(INDEFINITE), SquareRootUnscentedKalmanFilter(INDEFINITE),
                                    SquareRootUnscentedKalmanFilter(INDEFINITE, ((-10.0, 10.0),))], ids=["covariance", "square root", "constrained"])
def test_negative_variance_is_counted(method, place, measurement):
    trace = run(method, **{place: lambda x: x * x}, measurement=measurement)
    if place == "observe" and np.isnan(measurement):
        assert int(trace.failures) == 0
    else:
        assert int(trace.failures) > 0


HARSH = {
    "no initial spread given": {"sd": np.nan},
    "no noise at all": {"noise": (0.0, 0.0)},
    "vague prior, accurate sensor": {"sd": 1e9, "noise": (0.1, 0.01)},
    "sudden blow-up": {"transition": lambda x: 1e9 * x**3, "mean": 3.0},
    "blow-up unseen": {"transition": lambda x: 1e9 * x**3, "mean": 3.0, "measurement": np.nan},
    "leaves the domain": {"transition": lambda x: jnp.log(x), "mean": 0.5, "sd": 0.1},
}


@pytest.mark.parametrize("case", HARSH)
@pytest.mark.parametrize("name", FILTERS)
def test_no_failure_is_silent(name, case):
    """Standard deviations are positive and the likelihood finite, or failures says that they are not."""
    trace = run(FILTERS[name], **HARSH[case])
    healthy = np.isfinite(trace.log_likelihood) and (np.asarray(trace.sds) > 0).all() and np.isfinite(trace.sds).all()
    assert healthy or int(trace.failures) > 0


@pytest.mark.parametrize("name", FILTERS)
def test_failures_are_counted_once_for_each_sample(name):
    assert int(run(FILTERS[name], sd=np.nan).failures) == N
