"""Filters judge their errors rightly: where the truth is drawn from the model, squared errors are chi-squared."""

import jax
import numpy as np
import pytest

from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from tests.cases import X_U, naive_rk4, surge_rate
from tests.filters.surge_trial import GAPS, MEASUREMENT_SD, PROCESS_SD, TRUE_STATE, surge_space, surge_trial

N_TRIALS = 200
PRIOR_SD = np.array([0.05, 0.2, 0.003])


def simulated_trials():
    """Truth drawn from the prior and moved with process noise; measurements and final states, trials first."""
    rng = np.random.default_rng(21)
    control, _, step = surge_trial()
    x = TRUE_STATE + PRIOR_SD * rng.normal(size=(N_TRIALS, 3))
    measured = []
    for k, h in enumerate(step):
        coefficients, n = x[:, 1:].T, control[k, 0] / (2 * np.pi)
        clean = np.column_stack([x[:, 0], surge_rate(x[:, 0], n, X_U, *coefficients)])
        measured.append(clean + MEASUREMENT_SD * rng.normal(size=clean.shape))
        final = x
        moved = naive_rk4(lambda u, n=n, known=coefficients: surge_rate(u, n, X_U, *known), x[:, 0], h)
        x = np.column_stack([moved, x[:, 1:]]) + PROCESS_SD * rng.normal(size=x.shape)
    return control, np.stack(measured, axis=1), step, final


@pytest.mark.parametrize("gaps", ["complete", "two rates"])
@pytest.mark.parametrize(
    "method",
    [
        ExtendedKalmanFilter(),
        UnscentedKalmanFilter(),
        pytest.param(SquareRootUnscentedKalmanFilter(), marks=pytest.mark.proof),
    ],
    ids=["extended", "unscented", "square root"],
)
def test_innovations_and_errors_are_chi_squared(method, gaps):
    """Bounds are four standard errors of the mean of chi-squared variables, whose variance is twice their mean."""
    control, complete, step, final = simulated_trials()
    measurement = np.stack([GAPS[gaps](trial) for trial in complete])
    space = surge_space(mean=TRUE_STATE, sd=PRIOR_SD)
    trace = jax.vmap(lambda y: run_filter(method, space, control, y, step))(measurement)
    n_measured = np.isfinite(measurement).sum()
    assert int(trace.failures.sum()) == 0
    assert float(trace.nis.sum()) == pytest.approx(n_measured, abs=4 * np.sqrt(2 * n_measured))
    error = np.asarray(trace.final.mean) - final
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(trace.final.cov), error)
    assert nees.mean() == pytest.approx(3, abs=4 * np.sqrt(2 * 3 / N_TRIALS))
