import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.priors import Uniform
from seatrial.selection.savage_dickey import _tail, savage_dickey
from studies.remus100.tests.test_bridge import exact_draws
from tests.estimation_cases import linear_gaussian, posterior


def nested_pair(d, seed=1):
    """A linear problem, and the exact log Bayes factor of its middle coefficient, near 0 in truth."""
    full = linear_gaussian(d, seed)
    reduced = full._replace(design=np.delete(full.design, d // 2, axis=1))
    return full, f"c{d // 2}", full.log_evidence - reduced.log_evidence


def of_shape(z):
    """A posterior in name only: the draws are given."""
    return posterior({"a": Uniform(-1.0, 1.0)}, lambda v, data: 0.0), np.asarray(z)[..., None]


@pytest.mark.proof
@pytest.mark.parametrize("d", [3, 9])
def test_nested_pair_in_closed_form(d):
    full, name, exact = nested_pair(d)
    found = savage_dickey(full.posterior, name, exact_draws(full, length=1000))
    assert found.status == ""
    assert 0 < found.std_error < 0.2
    assert abs(found.log_value - exact) < 4 * found.std_error


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_stated_errors_cover(correlation):
    """Of 100 runs more than 12 miss by over 2 stated errors in one of 1000 trials, if 4.6 are to be expected."""
    full, name, exact = nested_pair(3)
    missed = 0
    for i in range(100):
        draws = exact_draws(full, length=1000, seed=i, correlation=correlation)
        found = savage_dickey(full.posterior, name, draws)
        missed += abs(found.log_value - exact) > 2 * found.std_error
    assert missed <= 12


def test_skewed_draws():
    """A gamma of shape 4, of which a normal is 0.2 nats off at its mode."""
    draws = np.random.default_rng(0).gamma(4.0, 0.2, size=(4, 4000)) - 0.6
    target, z = of_shape(draws)
    exact = float(target.parameters[0].prior.log_density(0.0)) - np.log(0.6**3 / 0.2**4 / 6 * np.exp(-3.0))
    found = savage_dickey(target, "a", z)
    assert found.status == ""
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.3


def test_value_in_the_tail_is_reported():
    target, z = of_shape(0.1 * np.random.default_rng(0).normal(size=(4, 1000)) + 0.36)
    assert "standard deviations from the posterior mean" in savage_dickey(target, "a", z).status


def test_no_draw_near_the_value():
    target, z = of_shape(0.1 * np.random.default_rng(0).normal(size=(4, 1000)) + 1.2)
    with pytest.raises(NumericalError, match=r"only 0 effective draws .*compare the evidences"):
        savage_dickey(target, "a", z)


@pytest.mark.parametrize(
    ("name", "at", "shape", "words"),
    [
        ("b", 0.0, (4, 1000), "a parameter of the posterior"),
        ("a", 1.0, (4, 1000), "a value inside the prior"),
        ("a", -2.0, (4, 1000), "a value inside the prior"),
        ("a", 0.0, (4, 100), "at least 1000 draws"),
    ],
)
def test_bad_input(name, at, shape, words):
    target, z = of_shape(np.random.default_rng(0).normal(size=shape))
    with pytest.raises(InputError, match=words):
        savage_dickey(target, name, z, at=at)


def test_chains_that_never_moved():
    target, z = of_shape(np.zeros((4, 1000)))
    with pytest.raises(NumericalError, match="never moved"):
        savage_dickey(target, "a", z)


@pytest.mark.proof
def test_the_kernel_s_bias_is_part_of_the_stated_error():
    """At the peak of a Laplace density: a kernel narrower by sqrt 2 is higher by more than chance, and the error states that much."""
    draws = np.random.default_rng(5).laplace(scale=0.1, size=(4, 10_000))
    target, z = of_shape(draws)
    x = z[..., 0]
    found = savage_dickey(target, "a", z)
    width = 2.34 * x.std() * found.diagnostics["ess"] ** -0.2
    wide, narrow = (guided(x.ravel(), w) for w in (width, width / np.sqrt(2)))
    assert found.diagnostics["log_density"] == pytest.approx(wide, abs=1e-9)
    assert 0.03 < narrow - wide < found.std_error < 1.5 * (narrow - wide)


def guided(x, width):
    """Log density at 0 by an Epanechnikov kernel over the ratio to the normal of these draws, one draw after another."""
    total, law = 0.0, stats.norm(x.mean(), x.std())
    for one in x[np.abs(x) < width]:
        total += 0.75 * (1 - (one / width) ** 2) / width * law.pdf(0.0) / law.pdf(one)
    return np.log(total / x.size)


def test_away_from_the_mean_the_kernel_is_that_of_the_draws_there():
    """At 0, 1.2 deviations from the mean: by a plain sum over the draws within the width, and how many those are worth."""
    x = 0.1 * np.random.default_rng(6).normal(size=(4, 3000)) + 0.12
    target, z = of_shape(x)
    found = savage_dickey(target, "a", z)
    assert found.status == ""
    ess = found.diagnostics["ess"]
    width = 2.34 * x.std() * ess**-0.2
    assert found.diagnostics["log_density"] == pytest.approx(guided(x.ravel(), width), abs=1e-9)
    assert found.diagnostics["distance"] == pytest.approx(-x.mean() / x.std())
    assert found.diagnostics["near"] == pytest.approx(np.mean(np.abs(x) < width) * ess)
    assert found.log_value == pytest.approx(
        float(target.parameters[0].prior.log_density(0.0)) - found.diagnostics["log_density"]
    )
    assert ess == pytest.approx(12_000, rel=0.1)
    assert ess <= 12_000


def test_error_by_leaving_out_stretches():
    """By a loop over 20 stretches, and the bias that a kernel narrower by sqrt 2 tells of."""
    x = 0.1 * np.random.default_rng(7).standard_t(5, size=(4, 1500)) + 0.05
    target, z = of_shape(x)
    found = savage_dickey(target, "a", z)
    width = 2.34 * x.std() * found.diagnostics["ess"] ** -0.2
    stretches = [part for chain in x for part in np.array_split(chain, 5)]
    without = [guided(np.concatenate(stretches[:i] + stretches[i + 1 :]), width) for i in range(20)]
    scatter = np.sqrt(19 / 20 * sum((w - np.mean(without)) ** 2 for w in without))
    bias = guided(x.ravel(), width) - guided(x.ravel(), width / np.sqrt(2))
    assert found.std_error == pytest.approx(np.hypot(scatter, bias))


@pytest.mark.parametrize(("near", "told"), [(99.0, True), (101.0, False)])
def test_fewer_than_a_hundred_effective_draws_about_the_value_are_told(near, told):
    said = _tail("a", 0.0, -2.5, near)
    assert bool(said) == told
    assert not told or f"2.5 standard deviations from the posterior mean, with only {near:.0f} effective" in said


@pytest.mark.parametrize(("draws", "enough"), [(249, False), (250, True)])
def test_a_thousand_draws_are_enough(draws, enough):
    target, z = of_shape(0.1 * np.random.default_rng(0).normal(size=(4, draws)))
    if enough:
        assert np.isfinite(savage_dickey(target, "a", z).log_value)
    else:
        with pytest.raises(InputError, match="4 chains of 249"):
            savage_dickey(target, "a", z)
