"""Ranks of truths among draws: uniform where they should be, and the ways they fail named."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.diagnostics.calibration import (
    DRAWS,
    Calibration,
    ranks_of,
    spread_evenly,
    stays_within,
)
from seatrial.messages.predictions import calibration_lines, shape_of_ranks

REPLICATES = 400


def calibrated(scale=1.0, shift=0.0, seed=0):
    """Truth and posterior draws of a normal mean: scale and shift spoil the posterior."""
    random = np.random.default_rng(seed)
    ranks = []
    for _ in range(REPLICATES):
        truth = random.normal(size=2)
        centre = 0.5 * (truth + random.normal(size=2))
        draws = centre + shift + scale * np.sqrt(0.5) * random.normal(size=(500, 2))
        ranks.append(ranks_of(truth, draws))
    return Calibration(("a", "b"), np.array(ranks))


def test_ranks_of_a_right_posterior_are_uniform():
    found = calibrated()
    assert found.outside() == ()
    assert np.all(found.p_values() > 0.005)
    low, high = found.count_band()
    assert np.mean((found.counts() >= low) & (found.counts() <= high)) >= 0.95
    assert found.coverage(0.9) == pytest.approx(0.9, abs=3 * np.sqrt(0.09 / REPLICATES))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"scale": 0.7}, "overconfident: truths scatter 1.4 times as far as it states"),
        ({"scale": 2.0}, "too wide: truths scatter 0.5 times as far as it states"),
        ({"shift": 0.3}, "biased upwards: truths lie 0."),
        ({"shift": -0.3}, "biased downwards: truths lie 0."),
        ({"scale": 0.7, "shift": 0.3}, "below it; the posterior is overconfident"),
    ],
)
def test_a_wrong_posterior_is_caught_and_named(spoil, said):
    found = calibrated(**spoil)
    assert found.outside() == ("a", "b")
    assert said in calibration_lines(found)[-1]


def uniform(random, k, correlation, replicates=REPLICATES):
    """Uniform ranks of k quantities, their normal scores correlated."""
    common, own = random.normal(size=(replicates, 1)), random.normal(size=(replicates, k))
    scores = np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own
    return Calibration(tuple(map(str, range(k))), np.floor((DRAWS + 1) * stats.norm.cdf(scores)).astype(int))


@pytest.mark.parametrize(
    ("k", "correlation"),
    [(1, 0.0), (5, 0.0), (5, 0.9), (28, 0.0), (28, 0.9), pytest.param(100, 0.0, marks=pytest.mark.proof)],
)
def test_a_right_posterior_alarms_in_one_of_a_hundred_runs_whatever_the_quantities(k, correlation):
    """Of 500 runs at most 2 % plus chance; of one quantity, or of some that are independent, about 1 %."""
    random = np.random.default_rng(5)
    alarms = sum(bool(uniform(random, k, correlation).outside()) for _ in range(500))
    assert alarms <= stats.binom(500, 0.01).ppf(0.999)
    assert alarms >= stats.binom(500, 0.01 if correlation == 0.0 else 0.0).ppf(0.001)


def test_probability_of_a_band_by_hand():
    """One rank, R, is farthest off at R / 100, by sqrt(p / (1 - p)), or at the next place, by sqrt((1 - p) / p)."""
    assert stays_within(1, 1.0 - 1e-9) == 0.0
    assert stays_within(1, 1.0 + 1e-9) == pytest.approx(0.02)
    assert stays_within(1, np.sqrt(51 / 49) + 1e-9) == pytest.approx(0.04)
    assert stays_within(1, np.sqrt(99) + 1e-9) == pytest.approx(1.0)


def test_p_values_are_of_the_band_and_of_all_quantities_together():
    ranks = np.tile(np.arange(100), 4)
    spoilt = np.where(np.arange(400) < 40, 0, ranks)
    found = Calibration(("even", "spoilt", "other"), np.column_stack([ranks, spoilt, ranks]))
    even, bad, _ = found.p_values()
    away = (np.abs(found.distance()[1]) / np.sqrt(np.arange(1, 100) * np.arange(99, 0, -1) / 1e4 / 400)).max()
    assert even == 1.0
    assert bad == pytest.approx(3 * (1 - stays_within(400, away)), abs=1e-11)
    assert found.outside() == ("spoilt",)
    few = Calibration(("a",), np.where(np.arange(400) < 7, 0, ranks)[:, None])
    single = few.p_values()[0]
    assert 1e-4 < single < 0.2
    among = Calibration(("a", "b"), np.column_stack([few.ranks[:, 0], ranks])).p_values()[0]
    assert among == pytest.approx(2 * single)


def test_coverage_counts_the_ranks_inside():
    """Of ranks 0 to 99 the central half are 25 to 74, the central nine tenths 5 to 94."""
    each = Calibration(("a",), np.arange(100)[:, None])
    assert each.coverage(0.5) == pytest.approx([0.5])
    assert each.coverage(0.9) == pytest.approx([0.9])
    for rank, inside in ((24, 0), (25, 1), (74, 1), (75, 0)):
        assert Calibration(("a",), np.array([[rank]])).coverage(0.5) == inside


def test_rank_counts_draws_below():
    draws = np.arange(DRAWS)[:, None] + 0.5
    assert [int(ranks_of(np.array([x]), draws)[0]) for x in (-1.0, 1.0, 50.2, 200.0)] == [0, 1, 50, DRAWS]


def spread_out(width=1.0, shift=0.0, replicates=400):
    """Ranks of truths that lie evenly in a normal distribution so many times as wide as stated and shifted, in its deviations."""
    even = stats.norm.ppf((np.arange(replicates) + 0.5) / replicates)
    return np.floor((DRAWS + 1) * stats.norm.cdf(shift + width * even)).astype(int)


@pytest.mark.parametrize(
    ("spoil", "few", "enough", "said"),
    [
        ({"shift": 0.1}, 610, 740, "biased downwards: truths lie 0.1 of its standard deviations above it"),
        ({"shift": -0.1}, 610, 740, "biased upwards: truths lie 0.1 of its standard deviations below it"),
        ({"width": 1.1}, 380, 500, "overconfident: truths scatter 1.1 times"),
        ({"width": 0.9}, 280, 420, "too wide: truths scatter 0.9 times"),
    ],
)
def test_what_is_wrong_is_named_from_2_6_standard_errors_on(spoil, few, enough, said):
    """A mean of n has the error 1 / sqrt(n), a standard deviation 1 / sqrt(2 n): 0.1 is 2.6 of them for 676 and for 338."""
    assert said in shape_of_ranks(spread_out(**spoil, replicates=enough))
    assert said not in shape_of_ranks(spread_out(**spoil, replicates=few))
    assert "but not its place or width" in shape_of_ranks(spread_out(**spoil, replicates=few))


@pytest.mark.parametrize(("replicates", "k"), [(100, 1), (400, 3)])
def test_counts_of_all_bins_lie_within_the_band_that_the_binomial_gives(replicates, k):
    """Each tail of each bin has its part of one hundredth, and the band is the narrowest that leaves no more."""
    low, high = Calibration(tuple(map(str, range(k))), np.zeros((replicates, k), int)).count_band()
    law, tail = stats.binom(replicates, 1 / 20), 0.01 / 2 / (20 * k)
    assert law.cdf(low - 1) < tail <= law.cdf(low)
    assert law.sf(high) <= tail < law.sf(high - 1)


def test_counts_and_distances_by_hand():
    """Ranks 0 to 99 once each fill bins of five evenly; without the lower half the distribution lags by p up to one half."""
    even = np.arange(100)
    found = Calibration(("even", "upper"), np.column_stack([even, 50 + even // 2]))
    assert found.counts()[0].tolist() == [5] * 20
    assert found.counts()[1].tolist() == [0] * 10 + [10] * 10
    at = np.arange(1, 100) / 100
    assert found.distance()[0] == pytest.approx(0.0, abs=1e-12)
    assert found.distance()[1] == pytest.approx(
        np.maximum(0.0, np.ceil(200 * at - 100 - 1e-9) // 2 / 50) - at, abs=0.0101
    )


def test_band_of_the_distances_is_left_with_its_probability():
    """Narrower by a tenth of a percent it would be left by right ranks in more than 0.01 / k of runs."""
    at = np.arange(1, 100) / 100
    for k in (1, 4):
        band = Calibration(tuple(map(str, range(k))), np.zeros((50, k), int)).distance_band()
        width = band / np.sqrt(at * (1 - at) / 50)
        assert width == pytest.approx(width[0], rel=1e-12)
        assert 1 - stays_within(50, width[0]) <= 0.01 / k
        assert 1 - stays_within(50, width[0] - 0.05) > 0.01 / k


def test_words_hold_the_interval_s_share_and_what_chance_allows():
    ranks = np.tile(np.arange(100), 4)
    first, second, both = calibration_lines(Calibration(("a", "b"), np.column_stack([ranks, ranks])))
    low, high = (stats.binom(400, 0.9).ppf(p) / 400 for p in (0.0025, 0.9975))
    assert first.startswith("a: the 90 % interval contains the truth in 90.0% of 400 replicates")
    assert f"(expected {low:.1%} to {high:.1%}), p = 1.000" in second
    assert "of 2 quantities" in both
    assert len(calibration_lines(Calibration(("a",), ranks[:, None]))) == 1


def test_draws_are_taken_evenly_from_the_first_to_the_last():
    draws = np.arange(1000.0)[:, None]
    taken = spread_evenly(draws)[:, 0]
    assert (taken.size, taken[0], taken[-1]) == (DRAWS, 0.0, 999.0)
    assert np.abs(np.diff(taken) - 999 / (DRAWS - 1)).max() <= 1.0


@pytest.mark.parametrize(("replicates", "width"), [(1, 1.05), (7, 1.5), (40, 2.2)])
def test_probability_of_the_band_by_counting_rank_after_rank(replicates, width):
    """Of those ranks that are not below j, each is j with probability 1 / (100 - j): a chain of binomial numbers."""
    chances = {0: 1.0}
    for j in range(1, 100):
        at, sd = j / 100, np.sqrt(j / 100 * (1 - j / 100) / replicates)
        after = {}
        for below, chance in chances.items():
            for more, share in enumerate(
                stats.binom(replicates - below, 1 / (101 - j)).pmf(range(replicates - below + 1))
            ):
                if abs((below + more) / replicates - at) <= width * sd + 1e-12:
                    after[below + more] = after.get(below + more, 0.0) + chance * share
        chances = after
    assert stays_within(replicates, width) == pytest.approx(sum(chances.values()), abs=1e-12)


def test_p_value_counts_ranks_as_far_off_as_those_found():
    """Of one rank, 0 is as far off as 99: two of a hundred; 40 lies within what 60 of the others do."""
    for rank, p in ((0, 0.02), (99, 0.02), (1, 0.04)):
        assert Calibration(("a",), np.array([[rank]])).p_values() == pytest.approx([p])
