import numpy as np
import pytest
from scipy import signal

from seatrial.core.errors import InputError
from seatrial.sampling.diagnostics import geweke_score, geweke_scores, printed_geweke_scores

RNG_SEED = 0


def drifting(chains=100, n=1000):
    """Independent draws of standard deviation 1 about a mean that drifts by 2."""
    return np.random.default_rng(RNG_SEED).normal(size=(chains, n)) + 2 * np.arange(n) / n


def stationary(rho, chains, n=10_000):
    noise = np.random.default_rng(RNG_SEED).normal(size=(chains, n + 500))
    return signal.lfilter([np.sqrt(1 - rho**2)], [1, -rho], noise, axis=-1)[:, 500:]


def test_drift_of_two_sds_fails_the_proper_score_and_passes_the_printed_one():
    """Published: -11.8 and -0.92. Means differ by 1.4; the drift adds (0.2^2 and 1^2) / 12 to the variances of the draws."""
    first = [(geweke_scores(x).score[0], printed_geweke_scores(x).score[0]) for x in drifting()]
    proper, printed = np.array(first).T
    assert printed.mean() == pytest.approx(-1.4 / np.sqrt(2 + 1.04 / 12), abs=4 * printed.std() / 10)
    assert abs(printed.mean() + 0.92) < printed.std()
    assert abs(proper.mean() + 11.8) < proper.std()
    assert proper.max() < -5
    assert printed.min() > -1.5


def test_drift_fails_at_most_segments():
    (chain,) = drifting(1)
    assert (np.abs(geweke_scores(chain).score) > 2).mean() > 0.9
    assert (np.abs(printed_geweke_scores(chain).score) < 2).all()


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_stationary_chains_stay_in_the_band(rho):
    """Of 200 independent chains with 5 segments each that share the end: 95 %, with an error below 1.2 %."""
    scores = np.array([geweke_scores(x, intervals=5).score for x in stationary(rho, 200)])
    assert (np.abs(scores) < 2).mean() == pytest.approx(0.954, abs=0.048)
    assert np.sqrt((scores**2).mean()) == pytest.approx(1, abs=0.15)


def test_printed_scores_shrink_where_they_should_be_standard_normal():
    scores = np.array([printed_geweke_scores(x).score for x in stationary(0.0, 20)])
    assert np.abs(scores).max() < 0.2


def test_first_segment_is_the_score_of_the_chain():
    (chain,) = stationary(0.5, 1)
    for first, last in ((0.1, 0.5), (0.2, 0.4)):
        assert geweke_scores(chain, first, last).score[0] == geweke_score(chain, first, last)


def test_segments_and_printed_scores_by_hand():
    chain = np.random.default_rng(1).normal(size=200)
    found = printed_geweke_scores(chain, first=0.1, last=0.5, intervals=5)
    assert found.start.tolist() == [0, 20, 40, 60, 80]
    assert found.length == 20
    for start, score in zip(found.start, found.score, strict=True):
        a, b = chain[start : start + 20], chain[100:]
        assert score == pytest.approx((a.mean() - b.mean()) / np.sqrt(a.var() + b.var()), rel=1e-12)


def test_a_chain_that_never_moves_has_no_score():
    assert np.isnan(geweke_scores(np.ones(1000)).score).all()


@pytest.mark.parametrize("options", [{"first": 0.6}, {"first": 0.001}, {"last": 0.0}, {"intervals": 0}], ids=str)
def test_senseless_segments_are_refused(options):
    with pytest.raises(InputError, match="Geweke's scores"):
        geweke_scores(np.arange(1000.0), **options)
