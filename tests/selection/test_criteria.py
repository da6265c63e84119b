from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.priors import Uniform
from seatrial.selection.criteria import deviance_criteria, mean_error, psis_loo, waic
from seatrial.selection.criterion import MonteCarloValue, PredictiveCriterion, compare
from tests.estimation_cases import linear_gaussian, posterior


class Exact(NamedTuple):
    """Closed forms of the linear-Gaussian problem, on the deviance scale."""

    mean_deviance: float
    p_d: float
    waic: np.ndarray
    loo: np.ndarray


def exact(problem) -> Exact:
    a, y, variance = problem.design, problem.measured, problem.sd**2
    mean, cov = problem.moments
    spread, residual = np.einsum("ij,jk,ik->i", a, cov, a), y - a @ mean
    constant = y.size * np.log(2 * np.pi * variance)
    density = stats.norm(0, np.sqrt(variance + spread)).logpdf(residual)
    point_variance = (2 * spread**2 + 4 * spread * residual**2) / (4 * variance**2)
    left_out = []
    for i in range(y.size):
        rest = problem._replace(design=np.delete(a, i, 0), measured=np.delete(y, i))
        m, c = rest.moments
        left_out.append(stats.norm(a[i] @ m, np.sqrt(variance + a[i] @ c @ a[i])).logpdf(y[i]))
    return Exact(
        constant + (residual @ residual + spread.sum()) / variance,
        spread.sum() / variance,
        -2 * (density - point_variance),
        -2 * np.array(left_out),
    )


def independent_draws(problem, chains=20, n=1000, seed=0):
    return np.random.default_rng(seed).multivariate_normal(*problem.moments, size=(chains, n))


def table_of(problem, draws):
    return stats.norm(draws @ problem.design.T, problem.sd).logpdf(problem.measured)


def assert_within(found: MonteCarloValue, value, errors=4):
    assert found.error > 0
    assert abs(found.value - value) < errors * found.error


@pytest.mark.parametrize("d", [1, 3])
def test_deviance_criteria(d):
    problem = linear_gaussian(d)
    truth = exact(problem)
    found = deviance_criteria(problem.posterior, independent_draws(problem))
    assert_within(found.mean_deviance, truth.mean_deviance)
    assert_within(found.p_d, truth.p_d)
    assert_within(found.dic, truth.mean_deviance + truth.p_d)
    assert_within(found.bpic, truth.mean_deviance + 2 * truth.p_d)
    assert found.p_d.error < 0.05
    assert found.mean_deviance.error == pytest.approx(np.sqrt(2 * d / 20_000), rel=0.4)


@pytest.mark.parametrize("d", [1, 3])
def test_waic_and_loo(d):
    """Importance weights of the sharpest measurement bias LOO by less than its Monte Carlo error."""
    problem = linear_gaussian(d)
    truth, table = exact(problem), table_of(problem, independent_draws(problem))
    for found, expected in ((waic(table), truth.waic), (psis_loo(table), truth.loo)):
        assert_within(found.value, expected.sum())
        assert found.value.error < 0.1
        assert np.allclose(found.pointwise, expected, atol=0.1)
        assert found.std_error == pytest.approx(np.sqrt(20) * expected.std(ddof=1), rel=0.05)
    assert psis_loo(table).status == ""


def test_effective_parameters():
    """Of LOO it is lppd less elpd; of WAIC the sum of variances."""
    problem = linear_gaussian(2)
    truth = exact(problem)
    mean, cov = problem.moments
    spread = np.einsum("ij,jk,ik->i", problem.design, cov, problem.design)
    lppd = stats.norm(problem.design @ mean, np.sqrt(problem.sd**2 + spread)).logpdf(problem.measured).sum()
    table = table_of(problem, independent_draws(problem))
    assert psis_loo(table).effective == pytest.approx(lppd + truth.loo.sum() / 2, abs=0.05)
    assert waic(table).effective == pytest.approx(lppd + truth.waic.sum() / 2, abs=0.05)


def test_monte_carlo_errors_are_honest():
    """Root mean square of 60 errors over what is stated is 1 with an error of 0.09, of which 4 are allowed."""
    problem = linear_gaussian(2)
    truth = exact(problem)
    scores = []
    for seed in range(60):
        draws = independent_draws(problem, 10, 200, seed)
        table, deviance = table_of(problem, draws), deviance_criteria(problem.posterior, draws)
        pairs = (
            (waic(table).value, truth.waic.sum()),
            (psis_loo(table).value, truth.loo.sum()),
            (deviance.mean_deviance, truth.mean_deviance),
            (deviance.p_d, truth.p_d),
            (deviance.dic, truth.mean_deviance + truth.p_d),
            (deviance.bpic, truth.mean_deviance + 2 * truth.p_d),
        )
        scores.append([(found.value - value) / found.error for found, value in pairs])
    assert np.abs(np.sqrt(np.mean(np.square(scores), 0)) - 1).max() < 0.37


def test_error_of_a_mean_of_correlated_draws():
    """Chains x_k = 0.9 x_(k-1) + e_k: the variance of a mean of n is (1 + 0.9) / (1 - 0.9) / n."""
    rng = np.random.default_rng(2)
    x, chain = rng.normal(size=8), []
    for _ in range(5000):
        x = 0.9 * x + np.sqrt(1 - 0.81) * rng.normal(size=8)
        chain.append(x)
    found = mean_error(np.array(chain).T)
    assert found == pytest.approx(np.sqrt(19 / 40_000), rel=4 / np.sqrt(2 * 23))


def test_influential_measurement_is_noticed():
    problem = linear_gaussian(2)
    design, measured = problem.design.copy(), problem.measured.copy()
    design[0], measured[0] = [40.0, -40.0], 30.0
    outlier = problem._replace(design=design, measured=measured)
    table = table_of(outlier, independent_draws(outlier))
    assert "use PSIS-LOO" in waic(table).status
    assert "Look for outliers" in psis_loo(table).status
    assert int(np.argmax(psis_loo(table).k_hat)) == 0


def test_draws_of_another_posterior_are_refused():
    def halves(values, data):
        return jnp.where(jnp.abs(values["a"] - 0.5) > 0.2, 0.0, -jnp.inf)

    target = posterior({"a": Uniform(0.0, 1.0)}, halves)
    draws = np.array([[0.1, 0.9] * 20])[..., None]
    with pytest.raises(NumericalError, match="several separate modes"):
        deviance_criteria(target, draws)


def predicted(pointwise, method="WAIC"):
    pointwise = np.asarray(pointwise, float)
    return PredictiveCriterion(method, MonteCarloValue(pointwise.sum(), 0.0), 1.0, 1.0, pointwise, np.empty(0), "")


def test_comparison_tells_a_needed_term():
    """Without the second coefficient the linear model misfits."""
    full = linear_gaussian(2)
    less = full._replace(design=full.design[:, :1])
    loos = [psis_loo(table_of(problem, independent_draws(problem))) for problem in (full, less)]
    found = compare(*loos)
    difference = exact(full).loo - exact(less).loo
    assert found.delta == pytest.approx(difference.sum(), rel=0.05)
    assert found.std_error == pytest.approx(np.sqrt(20) * difference.std(ddof=1), rel=0.2)
    assert "first" in found.verdict


def test_incomparable_criteria_are_refused():
    with pytest.raises(InputError, match="the same criterion"):
        compare(predicted([1, 2, 3]), predicted([1, 2]))
    with pytest.raises(InputError, match="PSIS-LOO of 3"):
        compare(predicted([1, 2, 3]), predicted([1, 2, 3], "PSIS-LOO"))


@pytest.mark.parametrize(("chains", "length", "pieces"), [(1, 16, 4), (1, 19, 4), (2, 400, 10), (32, 100, 1)])
def test_mean_error_by_batches_of_at_least_four(chains, length, pieces):
    series = np.random.default_rng(3).normal(size=(chains, length))
    batches = [part.mean() for chain in series for part in np.split(chain[length % pieces :], pieces)]
    assert mean_error(series) == pytest.approx(np.std(batches, ddof=1) / np.sqrt(chains * pieces), rel=1e-12)


@pytest.mark.parametrize("criterion", [waic, psis_loo])
def test_many_measurements_are_the_sum_of_a_few(criterion):
    """More than are handled at once: every contribution is the one of its own column, and influences add up before their error."""
    table = -0.5 * np.random.default_rng(3).normal(size=(2, 60, 1)) ** 2 + 0.2 * np.random.default_rng(4).normal(
        size=(2, 60, 1203)
    )
    whole = criterion(table)
    parts = [criterion(table[..., start : start + 401]) for start in (0, 401, 802)]
    np.testing.assert_allclose(whole.pointwise, np.concatenate([part.pointwise for part in parts]), rtol=1e-9)
    np.testing.assert_allclose(whole.k_hat, np.concatenate([part.k_hat for part in parts]), rtol=1e-6)
    assert whole.value.value == pytest.approx(whole.pointwise.sum())
    assert whole.effective == pytest.approx(sum(part.effective for part in parts))
    assert whole.std_error == pytest.approx(np.sqrt(1203) * whole.pointwise.std(ddof=1))


def test_waic_by_its_definition():
    """Log of the mean density less its variance, of each measurement; the error by the influence of each draw."""
    table = np.random.default_rng(5).normal(size=(4, 50, 6)) * 0.3
    flat, found = table.reshape(-1, 6), waic(table)
    lppd, variance = np.log(np.exp(flat).mean(0)), flat.var(0, ddof=1)
    np.testing.assert_allclose(found.pointwise, -2 * (lppd - variance))
    assert found.effective == pytest.approx(variance.sum())
    influence = (np.exp(flat - lppd) - (flat - flat.mean(0)) ** 2).sum(1).reshape(4, 50)
    assert found.value.error == pytest.approx(2 * mean_error(influence))


@pytest.mark.parametrize(("variance", "told"), [(0.39, False), (0.41, True)])
def test_measurements_are_too_influential_for_waic_beyond_a_variance(variance, told):
    column = np.random.default_rng(6).normal(size=(1, 400))
    column = (column - column.mean()) / column.std(ddof=1) * np.sqrt(variance)
    found = waic(np.stack([column, 0.1 * column], -1))
    assert ("1 of 2 measurements" in found.status) == told


@pytest.mark.parametrize(
    ("delta", "spread", "words"),
    [
        (7.9, 0.0, "do not separate"),
        (8.1, 0.0, "second model predicts better"),
        (-8.1, 0.0, "first model predicts better"),
        (19.9, 10.0, "do not separate"),
        (20.1, 10.0, "second model predicts better"),
    ],
)
def test_differences_count_from_eight_and_two_errors_on(delta, spread, words):
    """Contributions that differ by the same but for a spread, whose sum has that error."""
    zigzag = np.array([1.0, -1.0] * 50)
    zigzag *= spread / (10 * zigzag.std(ddof=1))
    found = compare(predicted(delta / 100 + zigzag), predicted(np.zeros(100)))
    assert found.std_error == pytest.approx(spread, abs=1e-9)
    assert words in found.verdict
    assert f"differs by {delta:+.1f} ± {spread:.1f}" in found.verdict


def test_monte_carlo_errors_of_both_models_count_in_the_difference():
    one, other = (replace(predicted(np.zeros(50)), value=MonteCarloValue(0.0, error)) for error in (3.0, 4.0))
    assert compare(one, other).std_error == pytest.approx(5.0)
