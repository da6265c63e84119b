"""CMA-ES on functions whose maxima are known, and on a family of doublets against its grid."""

import numpy as np
import pytest

from seatrial.design.global_search import GlobalOptimum, search_globally
from studies.remus100.fisher import fisher_information
from tests.cases import N0, RPM, TRUTH, U0, paper_model
from tests.estimation_cases import SIGMA, naive_doublets

LOWER, UPPER = np.array([-3.0, 100.0]), np.array([5.0, 300.0])
PEAK = np.array([1.7, 260.0])


def bowl(settings):
    """Quadratic of condition 100 in units of the box, maximum 3 at PEAK."""
    apart = (settings - PEAK) / (UPPER - LOWER)
    return 3.0 - apart[:, 0] ** 2 - 100 * (apart[:, 1] - 0.5 * apart[:, 0]) ** 2


def test_maximum_of_a_quadratic():
    found = search_globally(bowl, LOWER, UPPER, budget=800, seed=1)
    assert found.utility == pytest.approx(3.0, abs=1e-6)
    np.testing.assert_allclose((found.settings - PEAK) / (UPPER - LOWER), 0.0, atol=1e-3)
    assert found.settled
    assert (found.spread < 1e-2).all()


def test_the_higher_of_two_hills():
    """The lower hill is the wider; searches that settled there start again."""

    def hills(x):
        return np.exp(-((x - 0.25) ** 2).sum(1) / 0.1) + 1.5 * np.exp(-((x - 0.85) ** 2).sum(1) / 0.02)

    found = search_globally(hills, np.zeros(2), np.ones(2), budget=6000, seed=0)
    np.testing.assert_allclose(found.settings, 0.85, atol=1e-2)
    assert found.starts > 1


def test_maximum_on_the_edge_of_what_is_allowed():
    found = search_globally(lambda s: np.where(s[:, 1] > 200, np.nan, bowl(s)), LOWER, UPPER, budget=1600, seed=3)
    assert found.settings[1] <= 200
    # Along the edge the maximum is where the derivative in the first setting vanishes: -2 a + 100 (b - a / 2) = 0 at b = -0.3.
    a = 100 * -0.3 / 52
    expected = np.clip(PEAK[0] + a * 8, -3, 5)
    assert found.settings[0] == pytest.approx(expected, abs=0.2)


def test_a_constant_moves_no_design():
    """What is not allowed ranks below all that is, also where every utility is negative."""
    found = [
        search_globally(lambda s, c=c: np.where(s[:, 1] > 200, np.nan, bowl(s) - c), LOWER, UPPER, budget=320, seed=3)
        for c in (0.0, 50.0)
    ]
    np.testing.assert_array_equal(found[0].settings, found[1].settings)


def test_same_seed_same_result():
    one, same, other = (search_globally(bowl, LOWER, UPPER, budget=160, seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(one.settings, same.settings)
    assert np.array_equal(one.spread, same.spread)
    assert not np.array_equal(one.settings, other.settings)


def test_progress_and_whole_populations():
    shapes, seen = [], []
    search_globally(
        lambda s: (shapes.append(s.shape), bowl(s))[1], LOWER, UPPER, 100, 0, progress=lambda *p: seen.append(p)
    )
    assert shapes == [(16, 2)] * 6
    assert seen == [(16 * (i + 1), 96) for i in range(6)]


def test_best_doublet_of_a_grid_is_found():
    """Amplitude and period of one doublet: more than the best of 200 grid points less what the grid itself resolves."""
    time = np.arange(120) * 0.25

    def gain(settings):
        designs = [naive_doublets(time, a / RPM, p, active=p + 0.01) for a, p in settings]
        found = fisher_information(
            paper_model(), TRUTH, 2 * np.pi * np.stack(designs)[..., None], 0.25, [U0], {"u": SIGMA}
        )
        return 0.5 * np.linalg.slogdet(found)[1]

    lower, upper = np.array([50.0, 4.0]) * [RPM, 1], np.array([200.0, 28.0]) * [RPM, 1]
    grid = np.stack(np.meshgrid(np.linspace(50, 200, 4) * RPM, np.linspace(4, 28, 49)), -1).reshape(-1, 2)
    blocks = grid[:192].reshape(12, 16, 2)
    best = max(gain(block).max() for block in blocks)
    found = search_globally(gain, lower, upper, budget=480, seed=0)
    assert found.utility > best - 0.01
    assert N0 + found.settings[0] == pytest.approx(N0 + 200 * RPM, rel=1e-2)


def test_nothing_is_found_where_no_design_is_allowed():
    assert search_globally(lambda s: np.full(len(s), np.nan), LOWER, UPPER, budget=32, seed=0) is None


@pytest.mark.parametrize(("starts", "spread", "settled"), [(1, 0.011, False), (1, 0.009, True), (2, 0.5, True)])
def test_a_search_has_settled_that_began_again_or_ends_within_a_hundredth_of_the_box(starts, spread, settled):
    found = GlobalOptimum(PEAK, 3.0, starts, np.array([0.001, spread]))
    assert found.settled == settled
