"""In a linear system every filter is the Kalman filter: exact conditioning of one joint normal distribution."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.numerics.state_space import StateSpace
from tests.filters.surge_trial import GAPS

N = 25
RNG = np.random.default_rng(11)
CONTROL, STEP = RNG.normal(size=(N, 1)), RNG.uniform(0.1, 0.3, N)
MEASUREMENT = RNG.normal(size=(N, 2))
MEAN = np.array([0.5, -0.2, 0.1])
CHOL = np.array([[1.0, 0, 0], [0.3, 0.8, 0], [-0.2, 0.1, 0.5]])
PROCESS_SD, MEASUREMENT_SD = np.array([0.05, 0.1, 0.02]), np.array([0.3, 0.2])
OUTPUT = np.array([[1.0, 0, 0], [0, 1.0, 0.5]])

FILTERS = {
    "extended": ExtendedKalmanFilter(),
    "unscented": UnscentedKalmanFilter(),
    "unscented, small alpha": UnscentedKalmanFilter(UnscentedRule(0.1)),
    "square root": SquareRootUnscentedKalmanFilter(),
    "square root, small alpha": SquareRootUnscentedKalmanFilter(UnscentedRule(1e-3)),
    "constrained, wide": SquareRootUnscentedKalmanFilter(bounds=((-1e3, 1e3), (-np.inf, np.inf), (-50.0, np.inf))),
}


def matrices(h):
    """Position, velocity and an unknown constant force with linear drag, by Euler: x' = A x + b c."""
    return np.array([[1, h, 0], [0, 1 - 0.3 * h, h], [0, 0, 1]]), np.array([0, h, 0])


def transition(state, control, h):
    position, velocity, force = state
    return position + h * velocity, velocity + h * (-0.3 * velocity + force + control[0])


def observe(state, control):
    return state[0], state[1] + 0.5 * state[2]


SPACE = StateSpace(
    Gaussian(jnp.asarray(MEAN), jnp.asarray(CHOL)),
    jnp.asarray(PROCESS_SD),
    jnp.asarray(MEASUREMENT_SD),
    ("position", "velocity", "force"),
    ("position", "log"),
    2,
    transition,
    observe,
)


def joint_distribution():
    """Mean and covariance of the states at all samples, stacked."""
    mean, cov = [MEAN], np.zeros((3 * N, 3 * N))
    cov[:3, :3] = CHOL @ CHOL.T
    for k in range(N - 1):
        past, now, ahead = slice(0, 3 * (k + 1)), slice(3 * k, 3 * k + 3), slice(3 * k + 3, 3 * k + 6)
        a, b = matrices(STEP[k])
        mean.append(a @ mean[-1] + b * CONTROL[k])
        cov[ahead, past] = a @ cov[now, past]
        cov[past, ahead] = cov[ahead, past].T
        cov[ahead, ahead] = a @ cov[now, now] @ a.T + np.diag(PROCESS_SD**2)
    return np.concatenate(mean), cov


@pytest.mark.parametrize("gaps", GAPS)
@pytest.mark.parametrize("name", FILTERS)
def test_exact_conditioning(name, gaps):
    measurement = GAPS[gaps](MEASUREMENT)
    seen = np.isfinite(measurement).ravel()
    mean, cov = joint_distribution()
    h = np.kron(np.eye(N), OUTPUT)[seen]
    y_cov = h @ cov @ h.T + np.diag(np.tile(MEASUREMENT_SD**2, N)[seen])
    cross, residual = cov[-3:] @ h.T, measurement.ravel()[seen] - h @ mean
    trace = run_filter(FILTERS[name], SPACE, CONTROL, measurement, STEP)
    tolerance = 1e-6 if "small alpha" in name else 1e-11
    assert float(trace.log_likelihood) == pytest.approx(multivariate_normal.logpdf(residual, cov=y_cov), rel=tolerance)
    assert np.allclose(trace.final.mean, mean[-3:] + cross @ np.linalg.solve(y_cov, residual), rtol=0, atol=tolerance)
    assert np.allclose(trace.final.cov, cov[-3:, -3:] - cross @ np.linalg.solve(y_cov, cross.T), rtol=0, atol=tolerance)
    assert int(trace.failures) == 0
    assert not trace.clipped.any()
