"""Bands judged by all held-back runs together: ranges against exact binomials, verdicts against noise of known size."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.prediction.pooled_coverage import (
    band_factor,
    pooled_verdict,
    probability_of_so_few,
    run_residuals,
    share_range,
)

TIME = np.arange(400) * 0.1


def slow(tau, seed, scale=1.0):
    """An Ornstein-Uhlenbeck process of correlation time tau, s."""
    rng, rho, e = np.random.default_rng(seed), np.exp(-0.1 / tau), [np.random.default_rng(seed + 999).normal()]
    for _ in range(TIME.size - 1):
        e.append(rho * e[-1] + np.sqrt(1 - rho**2) * rng.normal())
    return scale * np.array(e)


def run(errors, *, motion=None, motion_sd=0.0, noise=1.0):
    motion = 5 * np.sin(0.3 * TIME[: errors.size]) if motion is None else motion
    return run_residuals(TIME[: errors.size], motion + errors, motion, np.full(errors.size, motion_sd), noise)


def white_runs(scale, count=6, seed=0, **options):
    random = np.random.default_rng(seed)
    return [run(scale * random.normal(size=TIME.size), **options) for _ in range(count)]


def slow_runs(scale, count, tau=4.0):
    return [run(slow(tau, seed, scale)) for seed in range(count)]


@pytest.mark.parametrize(("k", "n"), [(18, 29), (29, 29), (0, 12), (9, 10)])
def test_range_and_probability_are_those_of_whole_numbers(k, n):
    exact = stats.binomtest(k, n).proportion_ci(0.95, "exact")
    assert share_range(k / n, n) == pytest.approx((exact.low, exact.high))
    assert probability_of_so_few(k / n, n) == pytest.approx(stats.binom(n, 0.9).cdf(k))


def test_factor_holds_nine_tenths_of_the_samples_and_its_range_the_truth():
    """Errors 1.8 times those stated: of 200 sets of 60 samples at least 90 % of ranges hold 1.8, three errors below 95 %."""
    random, held = np.random.default_rng(3), 0
    for _ in range(200):
        z = 1.8 * random.normal(size=60)
        factor, lower, upper = band_factor(z, 60)
        assert np.mean(np.abs(z) <= factor * stats.norm.ppf(0.95)) == pytest.approx(0.9, abs=1 / 60)
        held += lower <= 1.8 <= upper
    assert held >= 180


def test_right_bands_pass_and_narrow_ones_fail_with_the_factor_that_mends_them():
    right = pooled_verdict(white_runs(1.0), "u")
    assert (right.level, right.runs, right.samples) == ("pass", 6, 2400)
    assert right.lower < 0.9 < right.upper
    wrong = pooled_verdict(white_runs(1.8), "u")
    assert (wrong.level, wrong.verdict.code) == ("fail", "bands-too-narrow")
    assert wrong.widen_lower < 1.8 < wrong.widen_upper
    assert wrong.verdict.remedies[0] == "widen-bands"
    wide = pooled_verdict(white_runs(0.5), "u")
    assert (wide.level, wide.verdict.code) == ("caution", "bands-too-wide")


def test_runs_that_tell_nothing_alone_tell_something_together():
    alone, together = pooled_verdict(slow_runs(2.0, 1), "u"), pooled_verdict(slow_runs(2.0, 12), "u")
    assert alone.effective < 20
    assert alone.level == "unjudged"
    assert alone.verdict.code == "runs-too-few"
    assert together.effective > 20
    assert together.level == "fail"


def test_false_alarms_of_slow_residuals_are_rare():
    """Of 100 right sets of eight runs at most 8 fail, three errors above the 2.5 % of the test."""
    found = [
        pooled_verdict([run(slow(2.0, 100 * trial + seed)) for seed in range(8)], "u").level for trial in range(100)
    ]
    assert found.count("fail") <= 8
    assert found.count("unjudged") <= 5


def test_an_error_of_the_motion_that_runs_share_counts_once():
    """The same input twice: coefficients that are off move both runs alike; of half the variance 1 / 0.25 samples are left.

    Apart, each run is shifted as a whole: 1 / 0.25 samples of each, and of both the square of the sum over the sum of squares.
    """
    random = np.random.default_rng(5)
    runs = [run(random.normal(size=size) + 1.0, motion_sd=1.0) for size in (400, 200)]
    found = pooled_verdict(runs, "u")
    assert found.effective == pytest.approx(4, abs=0.1)
    assert found.level == "unjudged"
    assert pooled_verdict(runs, "u", shared=0.0).effective == pytest.approx(4 * 600**2 / (400**2 + 200**2), rel=0.1)


def test_three_runs_are_worth_what_their_shares_scatter_by():
    """Shares of n samples in all scatter by m (1 - m) 3 / n; two runs are too few to tell."""
    errors = [scale * np.random.default_rng(seed).normal(size=400) for seed, scale in enumerate((0.8, 1.2, 1.8))]
    shares = np.array([np.mean(np.abs(one) <= stats.norm.ppf(0.95)) for one in errors])
    expected = shares.mean() * (1 - shares.mean()) * 3 / shares.var(ddof=1)
    assert pooled_verdict([run(one) for one in errors], "u").effective == pytest.approx(expected, rel=1e-6)
    assert pooled_verdict([run(one) for one in errors[:2]], "u").effective > 100


def test_wrong_units_fail_however_few_the_samples():
    motion = 0.1 * np.sin(0.3 * TIME)
    for factor in (57.3, 60.0, 1000.0):
        wrong = run_residuals(TIME, factor * motion, motion, np.full(TIME.size, 0.001), 0.005)
        assert pooled_verdict([wrong], "r").level == "fail"
        short = run_residuals(TIME[7:10], factor * motion[7:10], motion[7:10], np.full(3, 0.001), 0.005)
        assert pooled_verdict([short], "r").level == "fail"


def test_a_run_of_three_samples_is_not_judged():
    found = pooled_verdict([run(np.array([0.1, -0.2, 0.3]))], "u")
    assert found.level == "unjudged"
    assert found.effective <= 3


@pytest.mark.parametrize(
    ("noise", "level", "code"), [(0.75, "caution", "little-motion-predicted"), (0.5, "fail", "bands-too-narrow")]
)
def test_a_run_s_own_mean_that_predicts_better_is_never_passed(noise, level, code):
    motion, random = np.sin(0.3 * TIME), np.random.default_rng(6)
    runs = [
        run_residuals(TIME, motion + 0.3 * random.normal(size=400), -0.05 * motion, np.zeros(400), noise)
        for _ in range(4)
    ]
    found = pooled_verdict(runs, "u")
    assert found.explained < 0
    assert (found.level, found.verdict.code) == (level, code)


def test_what_was_not_measured_or_diverges():
    nothing = run_residuals(TIME, np.full(400, np.nan), np.zeros(400), np.zeros(400), 1.0)
    assert pooled_verdict([nothing], "u").level == "unjudged"
    assert pooled_verdict([], "u").level == "unjudged"
    away = run_residuals(TIME, np.zeros(400), np.where(TIME > 9, np.inf, 0.0), np.zeros(400), 1.0)
    found = pooled_verdict([away, *white_runs(1.0, 2)], "u")
    assert (found.level, found.verdict.code) == ("fail", "runs-diverge")


def test_one_run_that_is_beyond_chance_among_as_many_fails_all():
    """Of all samples of a slow error so many may lie inside by chance, were it not for the run that holds hardly any."""
    found = pooled_verdict([run(slow(0.5, 1)), run(slow(0.5, 2)), run(slow(0.5, 3, 4.0))], "u")
    assert found.upper > 0.9 or found.coverage > 0.6
    assert found.p_value < 0.00135
    assert found.level == "fail"
    assert (found.verdict.values["least"], found.verdict.values["most"]) == (found.least, found.most)


def test_so_few_inside_are_no_pass_where_chance_allows_them():
    """Errors of 1.35 times those stated that remember 8 s: of 40 sets of three runs at most one in ten passes."""
    sets = [[run(slow(8.0, 100 * trial + seed, 1.35)) for seed in range(3)] for trial in range(40)]
    found = [pooled_verdict(one, "u") for one in sets]
    assert not [one for one in found if one.level == "pass" and one.coverage < 0.85]
    assert any(one.verdict.code == "bands-doubtful" for one in found)


def test_samples_are_worth_what_their_squared_correlation_leaves():
    """Of an Ornstein-Uhlenbeck process n / N is (1 + q) / (1 - q), q the square of the correlation of neighbours; all gaps count."""
    q = np.exp(-2 * 0.1 / 2.0)
    alike = [pooled_verdict([run(slow(2.0, 50 * trial + seed)) for seed in range(20)], "u", 0.0) for trial in range(5)]
    assert np.mean([one.samples / one.effective for one in alike]) == pytest.approx((1 + q) / (1 - q), rel=0.15)
    shifted = pooled_verdict(
        [run(0.1 * error.z + shift) for error, shift in zip(white_runs(1.0, 2), (1, -1), strict=True)], "u"
    )
    assert shifted.effective == pytest.approx(2, rel=0.1)
