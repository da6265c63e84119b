"""Geweke's scores along a chain, with the variance of the mean and as the paper prints them."""

import numpy as np
import pytest
from scipy import signal

from seatrial.sampling.diagnostics import geweke_score, variance_of_mean
from studies.remus100.chains import geweke_scores


def autoregressive(rho, shape):
    """Stationary chains of unit variance, x_k = rho x_{k-1} + e_k."""
    noise = np.random.default_rng(0).normal(size=(*shape[:-1], shape[-1] + 500))
    return np.asarray(signal.lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=-1))[..., 500:]


def test_drift_of_two_sds_fails_the_proper_score_and_passes_the_printed_one():
    """Published: -11.8 and -0.92. Means differ by 1.4; the drift adds (0.2^2 and 1^2) / 12 to the variances of the draws."""
    drifting = np.random.default_rng(0).normal(size=(100, 1000)) + 2 * np.arange(1000) / 1000
    first = [(geweke_scores(x, variance_of_mean).score[0], geweke_scores(x, np.var).score[0]) for x in drifting]
    proper, printed = np.array(first).T
    assert printed.mean() == pytest.approx(-1.4 / np.sqrt(2 + 1.04 / 12), abs=4 * printed.std() / 10)
    assert abs(printed.mean() + 0.92) < printed.std()
    assert abs(proper.mean() + 11.8) < proper.std()
    assert proper.max() < -5
    assert printed.min() > -1.5


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_stationary_chains_stay_in_the_band(rho):
    """Of 200 independent chains with 5 segments each that share the end: 95 %, with an error below 1.2 %."""
    chains = autoregressive(rho, (200, 10_000))
    scores = np.array([geweke_scores(x, variance_of_mean, intervals=5).score for x in chains])
    assert (np.abs(scores) < 2).mean() == pytest.approx(0.954, abs=0.048)
    assert np.sqrt((scores**2).mean()) == pytest.approx(1, abs=0.15)


def test_segments_by_hand():
    (chain,) = autoregressive(0.5, (1, 200))
    scores = geweke_scores(chain, np.var, intervals=5)
    assert scores.start.tolist() == [0, 20, 40, 60, 80]
    for start, score in zip(*scores, strict=True):
        a, b = chain[start : start + 20], chain[100:]
        assert score == pytest.approx((a.mean() - b.mean()) / np.sqrt(a.var() + b.var()), rel=1e-12)
    assert geweke_scores(chain, variance_of_mean).score[0] == geweke_score(chain)
    assert np.isnan(geweke_scores(np.ones(1000), variance_of_mean).score).all()
