"""Ranks of truths among draws: uniform where they should be, and the ways they fail named."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.calibration import DRAWS, Calibration, ranks_of

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
        ({"scale": 0.7}, "too small"),
        ({"scale": 1.5}, "too large"),
        ({"shift": 0.3}, "biased upwards"),
        ({"shift": -0.3}, "biased downwards"),
    ],
)
def test_a_wrong_posterior_is_caught_and_named(spoil, said):
    found = calibrated(**spoil)
    assert found.outside() == ("a", "b")
    assert said in found.lines()[-1]


def test_band_holds_uniform_ranks_as_often_as_it_says():
    random = np.random.default_rng(5)
    left = [bool(Calibration(("a",), random.integers(0, DRAWS + 1, (REPLICATES, 1))).outside()) for _ in range(1000)]
    assert sum(left) <= stats.binom(1000, 0.01).ppf(0.999)
    assert sum(left) >= stats.binom(1000, 0.01).ppf(0.001)


def test_rank_counts_draws_below():
    draws = np.arange(DRAWS)[:, None] + 0.5
    assert [int(ranks_of(np.array([x]), draws)[0]) for x in (-1.0, 1.0, 50.2, 200.0)] == [0, 1, 50, DRAWS]
