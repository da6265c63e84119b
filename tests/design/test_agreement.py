import numpy as np
import pytest
from scipy.stats import spearmanr

from seatrial.core.errors import InputError
from seatrial.design.utility_agreement import RESAMPLES, _interval, compare_utilities

RNG = np.random.default_rng(0)
EXPENSIVE = RNG.normal(size=30)
CHEAP = EXPENSIVE + 0.5 * RNG.normal(size=30)


def one(cheap, expensive=EXPENSIVE, std_error=0.0):
    return compare_utilities({"cheap": np.asarray(cheap)}, np.asarray(expensive), np.full(len(expensive), std_error))[0]


@pytest.mark.parametrize("cheap", [CHEAP, np.round(CHEAP)], ids=["all differ", "ties"])
def test_correlation_is_spearmans(cheap):
    found = one(cheap)
    assert found.correlation == pytest.approx(spearmanr(cheap, EXPENSIVE).statistic, rel=1e-12)
    assert found.interval[0] < found.correlation < found.interval[1]


def test_interval_holds_the_correlation_of_the_population():
    """Of normal variables of correlation 0.8, Spearman's is 6 / pi asin(0.4); 60 repeats of a 95 % interval."""
    rng, population = np.random.default_rng(1), 6 / np.pi * np.arcsin(0.4)
    inside = 0
    for _ in range(60):
        x, e = rng.normal(size=(2, 40))
        low, high = one(0.8 * x + 0.6 * e, x).interval
        inside += low <= population <= high
    assert inside >= 50


def test_monotone_utilities_choose_alike():
    found = one(np.exp(EXPENSIVE))
    assert (found.correlation, found.regret, found.chosen) == (pytest.approx(1.0), 0.0, found.best)
    assert one(np.exp(EXPENSIVE), std_error=0.3).regret_error == 0.0
    assert "chooses a design that is best" in found.words


def test_a_perfect_order_of_a_few_designs_is_not_certain():
    """Five of one order by chance alone: once in 120, less than once in forty, so that the bound lies above 0."""
    few, many = (one(np.arange(n), np.arange(n)).interval for n in (5, 12))
    assert 0.0 < few[0] < many[0] < 1.0
    assert few[1] == many[1] == 1.0
    low, high = one(-np.arange(5), np.arange(5)).interval
    assert (low, high) == (-1.0, -few[0])


def test_the_least_correlation_shows_a_perfect_order_once_in_forty():
    rho = 2 * np.sin(np.pi / 6 * one(np.arange(6), np.arange(6)).interval[0])
    x, e = np.random.default_rng(5).normal(size=(2, 40_000, 6))
    share = np.mean((np.argsort(x, 1) == np.argsort(rho * x + np.sqrt(1 - rho**2) * e, 1)).all(1))
    assert share == pytest.approx(0.025, abs=4 * np.sqrt(0.025 / 2000))


def test_monte_carlo_errors_widen_the_interval():
    exact, rough = (one(EXPENSIVE, std_error=error).interval for error in (1e-9, 0.5))
    assert rough[0] < exact[0] - 0.1
    assert one(EXPENSIVE, std_error=0.5).interval == rough


def test_regret_of_a_wrong_choice():
    found = one([0, 1, 2, 3, 9, 4], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert (found.chosen, found.best, found.regret) == (4, 5, 1.0)
    assert "loses 1 nat (20.0% of the range over these designs)" in found.words


def test_regret_within_the_monte_carlo_error():
    found = one([0, 1, 2, 3, 9, 4], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], std_error=0.6)
    assert found.regret_error == pytest.approx(0.6 * np.sqrt(2))
    assert "within two Monte Carlo standard errors of the difference, 1.7 nat" in found.words
    assert "Monte Carlo error 0.14" in one([0, 1, 2, 3, 9, 4], range(6), std_error=0.1).words


def test_utility_that_tells_nothing():
    found = one(np.ones(30))
    assert np.isnan(found.correlation)
    assert np.isnan(found.interval).all()
    assert "the same for all designs" in found.words


def test_each_by_its_name_and_the_same_bits():
    found = compare_utilities({"a": CHEAP, "b": -CHEAP}, EXPENSIVE, np.zeros(30))
    assert [x.name for x in found] == ["a", "b"]
    assert found[1].correlation == pytest.approx(-found[0].correlation)
    assert found[0].words.startswith("a beside expected information gain: rank correlation")
    assert found == compare_utilities({"a": CHEAP, "b": -CHEAP}, EXPENSIVE, np.zeros(30))


@pytest.mark.parametrize(
    ("cheap", "expensive"),
    [(CHEAP[:4], EXPENSIVE[:4]), (CHEAP[:9], EXPENSIVE), (np.where(CHEAP > 0, CHEAP, np.nan), EXPENSIVE)],
    ids=["few", "lengths", "nan"],
)
def test_what_cannot_be_compared(cheap, expensive):
    with pytest.raises(InputError, match=r"cheap|expected information gain"):
        one(cheap, expensive)


@pytest.mark.parametrize(("error", "within"), [(0.34, False), (0.36, True)])
def test_regret_within_two_errors_of_the_difference(error, within):
    """Of two designs sqrt(2) times that of one: 1 nat is 2 sqrt(2) 0.354."""
    words = one([0, 1, 2, 3, 9, 4], range(6), std_error=error).words
    assert ("seems to lose 1 nat" in words) == within
    assert ("loses 1 nat" in words) == (not within)


def test_interval_is_that_of_a_bootstrap_written_out():
    """Ranks of 2000 resamples: an independent bootstrap gives both ends to their own scatter."""
    found = one(CHEAP).interval
    rng = np.random.default_rng(99)
    again = [spearmanr(CHEAP[at], EXPENSIVE[at]).statistic for at in rng.integers(30, size=(2000, 30))]
    assert found == pytest.approx(np.quantile(again, [0.025, 0.975]), abs=0.03)


def test_an_interval_wants_half_of_the_resamples():
    spread = np.linspace(0.2, 0.8, RESAMPLES // 2)
    assert _interval(spread, 0.5, 30) == pytest.approx((0.215, 0.785))
    assert np.isnan(_interval(spread[1:], 0.5, 30)).all()
