import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.priors import Normal
from seatrial.selection.evidence import ALIVE
from seatrial.selection.thermodynamic import (
    DEAD,
    Ladder,
    LadderSettings,
    _integrals,
    _jackknife,
    sample_ladder,
    spread,
    stepping_stone,
    thermodynamic,
)
from tests.estimation_cases import linear_gaussian, posterior
from tests.selection.targets import correlated, linear
from tests.selection.test_evidence import box, half_forbidden

KEY = jax.random.key(1)


def exact_ladder(d, b, draws=1000, copies=16, seed=0):
    """Independent draws of log L = -x.x / 2 under p L^b for standard normal p, and log Z = -d/2 log 2."""
    e = np.random.default_rng(seed).chisquare(d, size=(draws, b.size, copies))
    log_likelihood = -0.5 * e / (1.0 + b)[:, None]
    return Ladder(b, log_likelihood, np.full(b.size - 1, 0.5), 9.0, 0.0), -0.5 * d * np.log(2.0)


@pytest.mark.parametrize(
    "problem",
    [
        lambda: linear(2),
        pytest.param(box, marks=pytest.mark.proof),
        pytest.param(half_forbidden, marks=pytest.mark.proof),
        pytest.param(lambda: correlated(5), marks=pytest.mark.proof),
    ],
    ids=["linear 2", "box", "half forbidden", "correlated 5"],
)
@pytest.mark.proof
def test_known_evidence(problem):
    target, exact = problem()
    ladder = sample_ladder(target, KEY)
    for found in (stepping_stone(ladder), thermodynamic(ladder)):
        assert found.status == ""
        assert 0 < found.std_error < 0.1
        assert abs(found.log_value - exact) < 4 * found.std_error


@pytest.mark.proof
def test_stated_errors_cover_for_chains():
    """Of 20 runs more than 4 miss by over 2 stated errors in one of 500 trials, if 0.9 are to be expected."""
    target, exact = linear(2)
    missed = np.zeros(2)
    for i in range(20):
        ladder = sample_ladder(target, jax.random.key(i), LadderSettings(draws=500))
        found = [estimate(ladder) for estimate in (stepping_stone, thermodynamic)]
        missed += [abs(one.log_value - exact) > 2 * one.std_error for one in found]
    assert (missed <= 4).all()


@pytest.mark.parametrize("estimate", [stepping_stone, thermodynamic])
@pytest.mark.parametrize("d", [2, 20])
def test_stated_errors_cover_for_exact_draws(estimate, d):
    """Of 100 ladders about 4.6 miss by over 2 stated errors, and by chance more than 12 in one of 1000 trials."""
    b = np.linspace(0.0, 1.0, 17) ** 2
    found = [(estimate(ladder), exact) for ladder, exact in (exact_ladder(d, b, 200, seed=i) for i in range(100))]
    assert sum(abs(one.log_value - exact) > 2 * one.std_error for one, exact in found) <= 12


def test_integral_of_a_known_curve():
    """E_b = -1 / (1 + b), variance 1 / (1 + b)^2 for d = 2: the error falls with the fourth power of the steps."""

    def error(n):
        b = np.linspace(0.0, 1.0, n + 1)
        two_points = np.stack([-1 / (1 + b) - 1 / (1 + b), -1 / (1 + b) + 1 / (1 + b)])
        return abs(_integrals(b, np.repeat(two_points[:, :, None], 2, 2))[0] + np.log(2.0))

    assert np.log2(error(8) / error(16)) == pytest.approx(4.0, abs=0.1)


def test_stated_discretisation_error_bounds_that_of_exact_draws():
    """So many draws that the ladder's own error shows: 0.1 nat at 5 rungs."""
    b = np.linspace(0.0, 1.0, 5) ** 2
    ladder, exact = exact_ladder(40, b, draws=20_000)
    found = thermodynamic(ladder)
    assert found.diagnostics["discretisation_error"] > 0
    assert abs(found.log_value - exact) < 3 * found.std_error


def test_jackknife_of_a_mean_is_its_standard_error():
    x = np.random.default_rng(0).normal(size=16)
    rows = np.array([x.mean(), *(np.delete(x, i).mean() for i in range(16))])
    widened = stats.t.ppf(0.975, 15) / stats.norm.ppf(0.975)
    assert _jackknife(rows) == pytest.approx(x.std(ddof=1) / 4 * widened, rel=1e-10)


def test_spread_of_a_ladder_that_refuses_alike_changes_nothing():
    b = np.geomspace(1e-3, 1.0, 9)
    b[0] = 0.0
    assert spread(b, np.full(8, 0.3)) == pytest.approx(b, abs=1e-12)


def test_spread_moves_rungs_to_where_swaps_are_refused():
    b = np.linspace(0.0, 1.0, 9)
    new = spread(b, np.array([0.9, *[0.1] * 7]))
    assert (np.diff(new) > 0).all()
    assert new[1] < 0.5 * b[1]
    assert new[[0, -1]].tolist() == [0.0, 1.0]


@pytest.mark.proof
def test_coarse_ladder_is_reported():
    target, _ = linear(2)
    ladder = sample_ladder(target, KEY, LadderSettings(rungs=5, warmup=250, draws=250))
    for estimate in (stepping_stone, thermodynamic):
        assert "use more rungs" in estimate(ladder).status


def test_halves_that_differ_are_reported():
    ladder, _ = exact_ladder(2, np.linspace(0.0, 1.0, 9))
    moved = ladder._replace(log_likelihood=ladder.log_likelihood + np.repeat([0.0, 1.0], 500)[:, None, None])
    assert "two halves" in stepping_stone(moved).status


def test_draws_that_never_arrive_are_reported():
    ladder, _ = exact_ladder(2, np.linspace(0.0, 1.0, 9))
    assert "all the way" in thermodynamic(ladder._replace(arrivals=0.1)).status


def test_no_finite_likelihood():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.full((), -jnp.inf))
    with pytest.raises(NumericalError, match="Narrow the prior"):
        sample_ladder(target, KEY, LadderSettings(rungs=5, copies=4))


@pytest.mark.parametrize("wrong", [{"rungs": 8}, {"rungs": 3}, {"copies": 2}, {"draws": 100}, {"warmup": 10}])
def test_sizes_that_cannot_be(wrong):
    with pytest.raises(InputError, match="odd number"):
        sample_ladder(linear(2)[0], KEY, LadderSettings(**wrong))


@pytest.mark.proof
def test_same_key_same_bits_and_progress_ends():
    target, _ = linear(2)
    settings, seen = LadderSettings(rungs=5, warmup=250, draws=250), []
    first = sample_ladder(target, KEY, settings, lambda done, total: seen.append((done, total)))
    again = sample_ladder(target, KEY, settings)
    assert stepping_stone(first) == stepping_stone(again)
    assert np.array_equal(first.log_likelihood, again.log_likelihood)
    assert seen == [(1, 2), (2, 2)]


def naive_stepping(b, logs):
    """log Z: sum over rungs of the log mean of L^(step), over all draws and copies of the rung."""
    return sum(np.log(np.mean(np.exp((b[k + 1] - b[k]) * logs[:, k]))) for k in range(b.size - 1))


def naive_integral(b, logs, dead=-1e6):
    """Trapezoid of the means less step^2 / 12 of the change of the variances, over what can be simulated, and its log share."""
    total = np.log(np.mean(logs[:, 0] > dead)) if (logs[:, 0] <= dead).any() else 0.0
    kept = [logs[:, k][logs[:, k] > dead] for k in range(b.size)]
    for k in range(b.size - 1):
        step = b[k + 1] - b[k]
        total += step * (kept[k].mean() + kept[k + 1].mean()) / 2 - step**2 * (kept[k + 1].var() - kept[k].var()) / 12
    return total


@pytest.mark.parametrize(("estimate", "naive"), [(stepping_stone, naive_stepping), (thermodynamic, naive_integral)])
def test_value_error_and_drift_by_naive_twins(estimate, naive):
    """Errors by leaving out one copy of five after another, widened as Student's t; drift of the halves in its own."""
    b = np.array([0.0, 0.1, 0.35, 0.7, 1.0])
    ladder, _ = exact_ladder(3, b, 60, 5)
    logs, found = ladder.log_likelihood, estimate(ladder)

    def jackknife(of):
        without = [of(np.delete(logs, m, 2)) for m in range(5)]
        widened = stats.t.ppf(0.975, 4) / stats.norm.ppf(0.975)
        return np.sqrt(sum((x - np.mean(without)) ** 2 for x in without) * 4 / 5) * widened

    assert found.log_value == pytest.approx(naive(b, logs), rel=1e-10)
    error = jackknife(lambda x: naive(b, x))
    if estimate is thermodynamic:
        cut = abs(naive(b, logs) - naive(b[::2], logs[:, ::2])) / 8
        assert found.diagnostics["monte_carlo_error"] == pytest.approx(error)
        assert found.diagnostics["discretisation_error"] == pytest.approx(cut)
        error = np.hypot(error, cut)
    assert found.std_error == pytest.approx(error)

    def change(x):
        return naive(b, x[:30]) - naive(b, x[30:])

    assert found.diagnostics["drift"] == pytest.approx(abs(change(logs)) / jackknife(change))
    assert (found.diagnostics["rungs"], found.diagnostics["alive"]) == (5, 1.0)


def test_a_part_of_the_prior_that_cannot_be_simulated_lowers_the_integral_by_its_share():
    b = np.linspace(0.0, 1.0, 5) ** 2
    ladder, _ = exact_ladder(2, b, 400, 4)
    logs = ladder.log_likelihood.copy()
    logs[::4, 0] = 10 * DEAD
    found = thermodynamic(ladder._replace(log_likelihood=logs))
    assert found.log_value == pytest.approx(naive_integral(b, logs, DEAD), rel=1e-10)
    assert found.diagnostics["alive"] == 0.75


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ""),
        ({"swap": np.array([0.5, 0.11, 0.5, 0.5])}, ""),
        ({"swap": np.array([0.5, 0.09, 0.5, 0.5])}, "between temperatures 0.25 and 0.5 only 9% of the swaps"),
        ({"arrivals": 1.01}, ""),
        ({"arrivals": 0.99}, "all the way"),
    ],
)
def test_complaints_about_the_ladder_from_both_sides(changes, said):
    ladder, _ = exact_ladder(2, np.linspace(0.0, 1.0, 5), 400)
    found = stepping_stone(ladder._replace(**changes))
    assert said in found.status
    assert bool(found.status) == bool(said)
    if "swap" in changes:
        assert found.diagnostics["lowest_swap"] == changes["swap"].min()


@pytest.mark.parametrize(("shift", "told"), [(0.9, False), (1.1, True)])
def test_drift_counts_from_four_errors_on(shift, told):
    """The halves are moved apart until they differ by a given multiple of four of the errors of their difference."""
    ladder, _ = exact_ladder(2, np.linspace(0.0, 1.0, 5), 400)
    logs = ladder.log_likelihood.copy()
    logs[200:] = logs[:200]
    base = np.sign(np.arange(16) - 7.5) * 0.1  # copies that differ alike in both halves give the difference an error
    logs[200:] += base[None, None]
    one = stepping_stone(ladder._replace(log_likelihood=logs))

    def moved(by):
        other = logs.copy()
        other[200:] += by
        return stepping_stone(ladder._replace(log_likelihood=other))

    slope = moved(1.0).diagnostics["drift"]
    by = (4.0 * shift - one.diagnostics["drift"]) / slope
    for _ in range(5):
        by += (4.0 * shift - moved(by).diagnostics["drift"]) / slope
    assert ("two halves" in moved(by).status) == told


@pytest.mark.parametrize(("alive", "told"), [(ALIVE + 0.001, False), (ALIVE - 0.001, True)])
def test_a_prior_of_which_hardly_any_can_be_simulated_is_told(alive, told):
    ladder, _ = exact_ladder(2, np.linspace(0.0, 1.0, 5), 5000, 4)
    logs = ladder.log_likelihood.copy()
    counted = np.floor(np.arange(5001) * alive)
    logs[np.diff(counted) == 0, 0] = 10 * DEAD
    assert ("can be simulated" in thermodynamic(ladder._replace(log_likelihood=logs)).status) == told


def test_share_of_the_draws_that_count_is_kish_s():
    """Of n weights (sum w)^2 / sum w^2 count; below 2 % of some rung's a few carry the ratio."""
    b = np.linspace(0.0, 1.0, 5)
    ladder, _ = exact_ladder(2, b, 400, 4)
    found = stepping_stone(ladder)
    w = np.exp(0.25 * ladder.log_likelihood[:, :-1])
    shares = [w[:, k].sum() ** 2 / (w[:, k] ** 2).sum() / w[:, k].size for k in range(4)]
    assert found.diagnostics["lowest_share"] == pytest.approx(min(shares))
    for share, told in ((0.025, False), (0.015, True)):
        logs = np.full_like(ladder.log_likelihood, -1.0)
        few = round(share * 400)
        logs[few:, 2] = -400.0
        assert ("carry the step" in stepping_stone(ladder._replace(log_likelihood=logs)).status) == told


@pytest.mark.parametrize(("cut", "told"), [(0.09, False), (0.11, True)])
def test_an_uncertain_integral_is_told(cut, told):
    """A mean log-likelihood that falls at one rung in the middle: what every second rung changes is known, and an eighth is stated."""
    b = np.linspace(0.0, 1.0, 5)
    logs = np.zeros((200, 5, 4))
    logs[:, 1] = 8 * cut / 0.25
    found = thermodynamic(Ladder(b, logs, np.full(4, 0.5), 9.0, 0.0))
    assert found.diagnostics["discretisation_error"] == pytest.approx(cut)
    assert ("uncertain by" in found.status) == told


@pytest.mark.proof
def test_where_every_swap_is_accepted_the_prior_arrives_every_second_iteration():
    """Measurements that see nothing: neighbours swap always, even and odd pairs in turn, so that draws climb a rung an iteration."""
    problem = linear_gaussian(2)
    blind = problem._replace(design=np.zeros_like(problem.design))
    found = sample_ladder(blind.posterior, KEY, LadderSettings(rungs=5, warmup=250, draws=250))
    assert found.swap == pytest.approx(1.0)
    assert found.arrivals == pytest.approx(125.0, abs=1.0)
    assert found.log_likelihood.shape == (250, 5, 16)
    assert found.highest - blind.log_evidence == pytest.approx(-np.log(2 * np.pi), abs=0.01)
    for estimate in (stepping_stone, thermodynamic):
        assert estimate(found).log_value == pytest.approx(blind.log_evidence)
