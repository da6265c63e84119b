"""Ranks of truths among draws: uniform where they should be, and the ways they fail named."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.calibration import DRAWS, Calibration, ranks_of, stays_within

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
    assert said in found.lines()[-1]


def uniform(random, k, correlation, replicates=REPLICATES):
    """Uniform ranks of k quantities, their normal scores correlated."""
    common, own = random.normal(size=(replicates, 1)), random.normal(size=(replicates, k))
    scores = np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own
    return Calibration(tuple(map(str, range(k))), np.floor((DRAWS + 1) * stats.norm.cdf(scores)).astype(int))


@pytest.mark.parametrize(
    ("k", "correlation"),
    [(1, 0.0), (5, 0.0), (5, 0.9), (28, 0.0), (28, 0.9), pytest.param(100, 0.0, marks=pytest.mark.thorough)],
)
def test_a_right_posterior_alarms_in_one_of_a_hundred_runs_whatever_the_quantities(k, correlation):
    """Of 500 runs at most 2 % plus chance; of one quantity, or of some that are independent, about 1 %."""
    random = np.random.default_rng(5)
    alarms = sum(bool(uniform(random, k, correlation).outside()) for _ in range(500))
    assert alarms <= stats.binom(500, 0.01).ppf(0.999)
    assert alarms >= stats.binom(500, 0.01 if correlation == 0.0 else 0.0).ppf(0.001)


@pytest.mark.parametrize(("replicates", "width"), [(30, 2.5), (100, 3.0)])
def test_probability_of_the_band_against_simulated_ranks(replicates, width):
    random, at = np.random.default_rng(1), np.arange(1, 100) / 100
    drawn = random.multinomial(replicates, np.full(100, 0.01), 20_000)
    away = np.abs(drawn.cumsum(1)[:, :-1] / replicates - at) / np.sqrt(at * (1 - at) / replicates)
    expected = np.mean(away.max(1) <= width)
    assert stays_within(replicates, width) == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 20_000))


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
