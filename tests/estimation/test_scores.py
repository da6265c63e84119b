"""Scores against numerical integration, scipy and textbook loops."""

import numpy as np
import pytest
from scipy import integrate, stats

from seatrial.estimation.prediction.prediction_scores import (
    SlowNoise,
    _innovations,
    coverage,
    crps_normal,
    effective_samples,
    explained_share,
    nrmse_fit,
    pit_distance,
    pit_shares,
    whiteness,
)
from tests.estimation_cases import slow_noise


@pytest.mark.parametrize(("y", "mean", "sd"), [(0.3, 0.0, 1.0), (-4.0, 1.0, 0.5), (2.0, 2.0, 3.0), (1e-3, 0.0, 1e-4)])
def test_normal_score_is_the_integral(y, mean, sd):
    """Split at the measurement, in units of the standard deviation, far beyond which nothing is left."""
    cdf = stats.norm(mean, sd).cdf
    low, high = min(mean, y) - 12 * sd, max(mean, y) + 12 * sd
    below = integrate.quad(lambda x: cdf(x) ** 2, low, y, epsabs=1e-13)[0]
    above = integrate.quad(lambda x: (1 - cdf(x)) ** 2, y, high, epsabs=1e-13)[0]
    assert crps_normal(np.array([y]), np.array([mean]), np.array([sd]))[0] == pytest.approx(below + above, rel=1e-7)


def test_a_fit_by_hand():
    measured, predicted = np.array([1.0, 2.0, 3.0, 6.0]), np.array([1.0, 2.0, 4.0, 5.0])
    assert explained_share(measured, predicted) == pytest.approx(1 - 2 / 14)
    assert nrmse_fit(measured, predicted) == pytest.approx(1 - np.sqrt(2 / 14))
    assert nrmse_fit(measured, measured) == 1.0
    assert np.isnan(explained_share(np.full(5, 0.1), np.zeros(5)))
    assert np.isnan(nrmse_fit(np.full(5, 0.1), np.zeros(5)))


def test_calibration_of_normal_residuals():
    """Quantiles of the normal are covered exactly and transform to a uniform grid."""
    z = stats.norm.ppf((np.arange(1000) + 0.5) / 1000)
    assert coverage(z, 0.5) == pytest.approx(0.5)
    assert coverage(z, 0.9) == pytest.approx(0.9)
    np.testing.assert_allclose(pit_shares(z), 0.1)
    assert pit_distance(z) == pytest.approx(0.0005)
    assert pit_distance(z + 1.0) == pytest.approx(0.383, abs=2e-3)
    assert pit_shares(np.full(3, 9.0))[-1] == 1.0


def test_portmanteau_is_calibrated_across_gaps():
    """Of 400 white series with gaps 5 % fall below p = 0.05, give or take three errors; of correlated ones nearly all."""
    rng = np.random.default_rng(4)
    p = []
    for _ in range(400):
        present = rng.random(200) < 0.6
        present[80:120] = False
        p.append(whiteness(np.flatnonzero(present) * 0.5, rng.normal(size=int(present.sum()))).p_value)
    assert abs(np.mean(np.array(p) < 0.05) - 0.05) < 3 * np.sqrt(0.05 * 0.95 / 400)
    assert abs(np.mean(np.array(p) < 0.5) - 0.5) < 3 * np.sqrt(0.25 / 400)


def autoregressive(rho, n, seed):
    return slow_noise(np.random.default_rng(seed), np.arange(n), -1 / np.log(rho))


def test_jitter_of_the_clock_does_not_shift_lags():
    rng = np.random.default_rng(6)
    e = autoregressive(0.9, 20_000, 6)
    time = 0.1 * (np.arange(e.size) + 0.2 * rng.uniform(-1, 1, e.size))
    np.testing.assert_allclose(whiteness(time, e).correlation[:5], 0.9 ** np.arange(1, 6), atol=0.04)


@pytest.mark.parametrize("values", [np.empty(0), np.zeros(1), np.zeros(50), np.full(50, 0.1)])
def test_nothing_to_test_is_no_evidence_against_whiteness(values):
    found = whiteness(np.arange(values.size, dtype=float), values)
    assert found.p_value == 1.0
    assert found.neighbours == 0.0
    assert effective_samples(np.arange(values.size, dtype=float), values) <= 1.0


@pytest.mark.parametrize("lags", [3, 20])
def test_autocorrelation_across_gaps_by_pairs(lags):
    """Products of all pairs that lie k intervals apart, over their number and the mean square; lags without a pair are left out."""
    at = np.array([0, 1, 3, 4, 5, 7, 8, 12, 13, 15, 16, 17, 19, 20, 21, 40, 41, 43])
    e = np.random.default_rng(9).normal(size=at.size)
    found, centred = whiteness(0.5 * at, e, lags), e - e.mean()
    expected = {}
    for lag in range(1, min(lags, at.size // 3) + 1):
        products = [
            a * b for a, i in zip(centred, at, strict=True) for b, j in zip(centred, at, strict=True) if j - i == lag
        ]
        if products:
            expected[lag] = (len(products), np.mean(products) / np.mean(centred**2))
    assert found.lag.tolist() == list(expected)
    assert found.pairs.tolist() == [pairs for pairs, _ in expected.values()]
    assert found.correlation == pytest.approx([r for _, r in expected.values()])
    n = at.size
    q = (n + 2) / n * sum(pairs * r**2 for pairs, r in expected.values())
    assert found.p_value == pytest.approx(stats.chi2.sf(q, len(expected)))
    assert found.interval == 0.5


@pytest.mark.parametrize(("count", "tested"), [(7, False), (8, True)])
def test_eight_samples_are_tested(count, tested):
    e = np.random.default_rng(10).normal(size=count)
    found = whiteness(0.5 * np.arange(count), e)
    assert (found.lag.size, found.correlation.size, found.pairs.size) == (2 * tested,) * 3
    assert (found.p_value < 1.0) == tested
    assert found.interval == 0.5
    assert (effective_samples(np.arange(count), e) != 1.0) == tested
    assert effective_samples(np.arange(0.0), np.empty(0)) == 0.0


def test_no_neighbours_have_no_correlation():
    """The lags that some pair of samples has need not begin with one."""
    e = np.random.default_rng(11).normal(size=12)
    found = whiteness(np.arange(12.0), e)._replace(lag=np.array([2, 3]), correlation=np.array([0.7, 0.1]))
    assert found.neighbours == 0.0
    assert found._replace(lag=np.array([1, 3])).neighbours == 0.7


def test_effective_samples_by_a_plain_sum():
    """n over one plus twice the correlations up to the first that is not positive, of lags below half of the samples."""
    for seed in range(5):
        e = autoregressive(0.5, 40, seed)
        c, total = e - e.mean(), 0.0
        for lag in range(1, 20):
            r = float(c[lag:] @ c[:-lag] / (c @ c))
            if r <= 0:
                break
            total += r
        assert effective_samples(np.arange(40.0), e) == pytest.approx(40 / (1 + 2 * total))


def test_what_is_new_in_coloured_residuals_is_white_by_the_factor_of_their_covariance():
    """Samples at uneven times: the inverse of the Cholesky factor of exp(-|t - t'| / tau) makes them independent, of variance one."""
    rng = np.random.default_rng(12)
    time, z = np.cumsum(rng.uniform(0.05, 1.0, 30)), rng.normal(size=30)
    for share in (1.0, 0.7):
        cov = share * np.exp(-np.abs(time[:, None] - time) / 0.4) + (1 - share) * np.eye(30)
        white = np.linalg.solve(np.linalg.cholesky(cov), z)
        np.testing.assert_allclose(_innovations(time, z, SlowNoise(0.4, share)), white, rtol=1e-9)
