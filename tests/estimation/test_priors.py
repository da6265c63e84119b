"""Every kind of prior against scipy.stats and quadrature; physical sides; cuts."""

import math
from math import inf

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.estimation.priors import (
    CORNER,
    DensityPrior,
    LogNormal,
    LogUniform,
    Normal,
    Prior,
    TruncatedNormal,
    Uniform,
    half_normal,
    nominal,
    physical_support,
    restricted,
    truncated_normal,
)

DENSITIES = {
    Prior.from_logpdf(lambda x: 3.0 - x / 2.0, 0.0, 30.0): stats.truncexpon(15.0, scale=2.0),
    Prior.from_logpdf(lambda x: jnp.log(-x) + 2.0 * jnp.log1p(x / 4.0), -4.0, 0.0): stats.beta(
        3, 2, loc=-4.0, scale=4.0
    ),
    Prior.from_logpdf(lambda x: -0.5 * ((x - 0.3) / 1e-3) ** 2, 0.2, 0.5): stats.truncnorm(-100.0, 200.0, 0.3, 1e-3),
}
"""Priors of one's own log density, and the textbook's."""
PRIORS = [
    *DENSITIES,
    Uniform(-3.0, 2.0),
    Uniform(0.0, 0.15),
    Uniform(-2e6, 1e6),
    Uniform(1e-5, 3e-5),
    LogUniform(1e-4, 0.5),
    LogUniform(2.0, 2.5),
    Normal(0.0, 1.0),
    Normal(-2e-4, 3e-6),
    LogNormal(0.05, 3.0),
    LogNormal(-3.0, 1.5),
    half_normal(0.1, lower=0.0),
    half_normal(3.0, upper=0.0),
    half_normal(2e-6, lower=5e-5),
    truncated_normal(-1.2, 0.5, upper=0.0),
    truncated_normal(1.0, 0.5, upper=0.0),
    truncated_normal(-1.0, 2.0, lower=0.0),
    truncated_normal(-40.0, 10.0, lower=0.0),
    truncated_normal(0.0, 1.0, -0.02, 0.05),
    truncated_normal(0.3, 1.0, -1.0, 1e6),
    truncated_normal(-3e-4, 1e-4, -1.0, 0.0),
]
Z = np.linspace(-45.0, 45.0, 90_001)


def given(prior):
    """Name a prior by what it was made of, without the moments that follow."""
    return f"density on {prior.bounds}" if isinstance(prior, DensityPrior) else str(prior).partition(", mean=")[0]


each_prior = pytest.mark.parametrize("prior", PRIORS, ids=given)


def textbook(prior):
    match prior:
        case Uniform(lower, upper):
            return stats.uniform(lower, upper - lower)
        case LogUniform(lower, upper):
            return stats.loguniform(lower, upper)
        case Normal(mean, sd):
            return stats.norm(mean, sd)
        case LogNormal(median, factor):
            return stats.lognorm(np.log(factor), scale=median) if median > 0 else Mirrored(LogNormal(-median, factor))
        case TruncatedNormal(location, scale, lower, upper):
            return stats.truncnorm((lower - location) / scale, (upper - location) / scale, location, scale)
        case DensityPrior():
            return DENSITIES[prior]


class Mirrored:
    """The negative of a textbook distribution."""

    def __init__(self, prior):
        self.of = textbook(prior)

    def mean(self):
        return -self.of.mean()

    def std(self):
        return self.of.std()

    def support(self):
        return -np.array(self.of.support())[::-1]

    def logpdf(self, value):
        return self.of.logpdf(-value)

    def ppf(self, share):
        return -self.of.isf(share)

    def cdf(self, value):
        return self.of.sf(-value)


# One program for all priors of a kind; operations one by one would be compiled for each.


@jax.jit
def constrain(prior, z):
    return prior.constrain(z)


@jax.jit
def log_density(prior, z):
    return prior.log_density(z)


@jax.jit
def round_trip(prior, z, value):
    """From z to z, and from a value to the value."""
    return prior.unconstrain(prior.constrain(z)), prior.constrain(prior.unconstrain(value))


def expectation(values, prior):
    return np.trapezoid(np.asarray(values) * np.exp(log_density(prior, Z)), Z)


@each_prior
def test_density_of_z_integrates_to_one(prior):
    assert expectation(1.0, prior) == pytest.approx(1, abs=1e-12)


@each_prior
def test_z_is_nearly_standardised(prior):
    """Exactly so for the normal and log-normal; the box is a uniform blurred by a logistic of scale 1/k, which adds 4 (pi/k)^2.

    Where a normal is cut on one side only, the corner moves z by less than it is wide, sqrt(12) / k = 0.02.
    """
    mean, variance = expectation(Z, prior), expectation(Z**2, prior)
    if isinstance(prior, TruncatedNormal | DensityPrior):
        assert abs(mean) < 0.02
        assert variance == pytest.approx(1, abs=0.03)
    else:
        exact = 1.0 if isinstance(prior, Normal | LogNormal) else 1 + 4 * (np.pi / CORNER) ** 2
        assert mean == pytest.approx(0, abs=1e-12)
        assert variance == pytest.approx(exact, abs=1e-10)


@each_prior
def test_moments_and_bounds(prior):
    expected = textbook(prior)
    values = constrain(prior, Z)
    assert (prior.mean, prior.sd) == pytest.approx((expected.mean(), expected.std()), rel=1e-9)
    assert prior.bounds == pytest.approx(expected.support(), rel=1e-14)
    assert expectation(values, prior) == pytest.approx(expected.mean(), abs=1e-9 * expected.std())
    assert np.sqrt(expectation((values - prior.mean) ** 2, prior)) == pytest.approx(expected.std(), rel=1e-9)


@each_prior
def test_log_density_is_that_of_the_value_times_the_slope(prior):
    z, h = np.linspace(-1.9, 1.9, 39), 1e-5
    value, above, below = (np.asarray(constrain(prior, one)) for one in (z, z + h, z - h))
    slope = (above - below) / (2 * h)
    shown = slope > 1e-6 * prior.sd
    assert shown.sum() > 25
    expected = textbook(prior).logpdf(value[shown]) + np.log(slope[shown])
    assert np.allclose(log_density(prior, z)[shown], expected, atol=1e-5)


@each_prior
def test_round_trip(prior):
    """Where a value is told from a bound; beyond z = -1.5 those of a half-normal far from zero are not, which holds e^-30 of it."""
    z = np.linspace(-1.5, 2.0, 45)
    value = textbook(prior).ppf([1e-9, 0.01, 0.3, 0.5, 0.9, 1 - 1e-9])
    z_again, value_again = round_trip(prior, z, value)
    assert np.allclose(z_again, z, atol=1e-7)
    assert np.allclose(value_again, value, rtol=1e-12, atol=1e-14 * prior.sd)


@pytest.mark.parametrize("fraction", [0.1, 0.25, 0.5, 0.9])
def test_box_is_a_straight_line_inside(fraction):
    """Away from the bounds by a tenth, z is the standardised value to 1 % of the prior's sd, so normal stays normal."""
    prior = Uniform(-3.0, 2.0)
    value = -3.0 + 5.0 * fraction
    assert float(prior.unconstrain(value)) == pytest.approx((value - prior.mean) / prior.sd, abs=1e-3)


@jax.jit
def drawn(prior, key):
    z = prior.sample(key, (20_000,))
    return z, prior.constrain(z), prior.draw(key, (20_000,))


@each_prior
def test_draws_follow_the_prior(prior):
    z, value, same = map(np.asarray, drawn(prior, jax.random.key(0)))
    assert stats.kstest(value, textbook(prior).cdf).pvalue > 0.01
    assert abs(value.mean() - prior.mean) < 4 * prior.sd / np.sqrt(value.size)
    assert value.std() == pytest.approx(prior.sd, rel=4 / np.sqrt(2 * value.size))
    assert np.isfinite(z).all()
    assert same == pytest.approx(value, rel=1e-9, abs=1e-9 * prior.sd)


@jax.jit
def with_slopes(prior, z):
    return [jax.vmap(jax.value_and_grad(function))(z) for function in (prior.constrain, prior.log_density)]


@each_prior
def test_far_out_there_is_no_nan(prior):
    z = np.array([-1e100, -1e6, -500.0, -40.0, 40.0, 500.0, 1e6, 1e100])
    (value, slope), (density, gradient) = with_slopes(prior, z)
    lower, upper = prior.bounds
    assert np.isfinite([value, slope, gradient]).all()
    assert (lower <= value).all()
    assert (value <= upper).all()
    assert (density < -50).all()
    assert (np.sign(gradient) == -np.sign(z)).all()


@jax.jit
def derivatives(prior, z):
    """First and second derivatives of the map and of the log density, forwards over backwards and backwards twice."""
    functions = prior.constrain, prior.log_density
    return [jax.vmap(d(f))(z) for f in functions for d in (jax.grad, lambda f: jax.grad(jax.grad(f)), jax.hessian)]


@each_prior
def test_derivatives_are_finite_where_samplers_go(prior):
    for first, twice, hessian in np.reshape(derivatives(prior, np.linspace(-8.0, 8.0, 321)), (2, 3, 321)):
        assert np.isfinite([first, twice, hessian]).all()
        assert np.allclose(twice, hessian, rtol=1e-6, atol=1e-9 * max(1.0, prior.sd))


@each_prior
def test_compiled_code_serves_all_of_a_kind(prior):
    """The numbers are leaves: a prior taken apart and put together, or traced, is the same."""
    leaves, structure = jax.tree.flatten(prior)
    assert all(isinstance(leaf, float) for leaf in leaves)
    assert jax.tree.unflatten(structure, leaves) == prior
    z = np.linspace(-1.5, 2.0, 8)
    value, density, back = jax.jit(lambda p, z: (p.constrain(z), p.log_density(z), p.unconstrain(p.constrain(z))))(
        prior, z
    )
    assert np.allclose(value, prior.constrain(z), rtol=1e-12, atol=1e-14 * prior.sd)
    assert np.allclose(density, prior.log_density(z), rtol=1e-10)
    assert np.allclose(back, z, atol=1e-7)


@pytest.mark.parametrize(
    "prior", [half_normal(0.1, lower=0.0), half_normal(3.0, upper=0.0), LogNormal(-3.0, 1.5)], ids=given
)
def test_values_close_to_a_bound_of_zero_keep_their_digits(prior):
    value = np.sign(prior.mean) * prior.sd * 10.0 ** -np.arange(1, 12)
    assert np.allclose(prior.constrain(prior.unconstrain(value)), value, rtol=1e-8, atol=0)


@pytest.mark.parametrize(
    ("make", "numbers", "message"),
    [
        (Uniform, (1.0, -5.0), "lower below upper"),
        (Uniform, (1.0, 1.0), "lower below upper"),
        (Uniform, (np.nan, 0.0), "Uniform prior, lower"),
        (Uniform, (-inf, 0.0), "Uniform prior, lower"),
        (Uniform, ("0", 1.0), "Uniform prior, lower"),
        (Uniform, (None, 1.0), "Uniform prior, lower"),
        (LogUniform, (0.0, 1.0), "LogUniform prior, lower"),
        (LogUniform, (2.0, 1.0), "lower below upper"),
        (Normal, (-3.0, -1.0), "Normal prior, sd"),
        (Normal, (0.0, 0.0), "Normal prior, sd"),
        (Normal, (np.nan, 1.0), "Normal prior, mean"),
        (LogNormal, (0.0, 2.0), "a median above or below 0"),
        (LogNormal, (1.0, 0.5), "LogNormal prior, factor"),
        (LogNormal, (1.0, np.nan), "LogNormal prior, factor"),
        (truncated_normal, (0.0, -1.0, 0.0), "scale"),
        (truncated_normal, (0.0, 1.0, 2.0, 1.0), "lower below upper"),
        (truncated_normal, (0.0, 1.0, np.nan), "lower"),
        (half_normal, (0.0,), "half-normal prior, scale"),
        (half_normal, ("10",), "half-normal prior, scale"),
    ],
)
def test_what_is_no_distribution_is_refused_where_it_is_made(make, numbers, message):
    with pytest.raises(InputError, match=message):
        make(*numbers)


@pytest.mark.parametrize("prior", [Uniform(0.0, 1.0), LogUniform(1.0, 2.0), Normal(0.0, 1.0), LogNormal(-1.0, 2.0)])
def test_compiled_code_may_fill_a_prior_with_anything(prior):
    """Marks, tracers and arrays of many priors pass; only what a person makes is checked."""
    leaves, structure = jax.tree.flatten(prior)
    for filling in (object(), None, 0, False):
        made = jax.tree.unflatten(structure, [filling] * len(leaves))
        assert jax.tree.leaves(made, is_leaf=lambda x: x is None) == [filling] * len(leaves)
    many = jax.tree.map(lambda x: jnp.stack([jnp.asarray(x), jnp.asarray(x)]), prior)
    drawn = jax.jit(jax.vmap(lambda one: one.constrain(0.3)))(many)
    np.testing.assert_allclose(drawn, float(prior.constrain(0.3)), rtol=1e-12)


def test_cuts_that_leave_nothing_are_refused():
    for make in (
        lambda: truncated_normal(5.0, 0.1, upper=0.0),
        lambda: truncated_normal(0.0, 1.0, 2.0, 1.0),
        lambda: truncated_normal(0.0, 1.0),
        lambda: half_normal(1.0),
        lambda: half_normal(1.0, lower=0.0, upper=1.0),
        lambda: restricted(Uniform(1.0, 2.0), -inf, 0.0),
        lambda: restricted(Uniform(0.0, 2.0), -inf, 0.0),
        lambda: restricted(LogNormal(2.0, 1.5), -inf, 3.0),
        lambda: restricted(half_normal(1.0, lower=0.0), -inf, 0.0),
        lambda: restricted(Normal(2.0, 0.1), -inf, 0.0),
    ):
        with pytest.raises(InputError, match="remedy"):
            make()


def test_a_cut_prior_is_the_same_prior_given_the_side():
    assert restricted(Uniform(-3.6, 1.2), -inf, 0.0) == Uniform(-3.6, 0.0)
    assert restricted(LogUniform(0.1, 90.0), -inf, 30.0) == LogUniform(0.1, 30.0)
    assert restricted(Normal(-1.0, 2.0), -inf, 0.0) == truncated_normal(-1.0, 2.0, upper=0.0)
    assert restricted(truncated_normal(-1.0, 2.0, lower=-4.0), -inf, 0.0) == truncated_normal(-1.0, 2.0, -4.0, 0.0)
    for inside in (Uniform(-3.0, 0.0), half_normal(1.0, upper=0.0), LogNormal(-3.0, 2.0)):
        assert restricted(inside, -inf, 0.0) is inside


@pytest.mark.parametrize(
    ("name", "support"),
    [
        ("X_u", (-inf, 0.0)),
        ("X_uabsu", (-inf, 0.0)),
        ("X_absuu", (-inf, 0.0)),
        ("X_u3", (-inf, 0.0)),
        ("N_rabsr", (-inf, 0.0)),
        ("Z_w", (-inf, 0.0)),
        ("X_udot", (-inf, 30.0)),
        ("Y_vdot", (-inf, 30.0)),
        ("X_uu", None),
        ("X_absu", None),
        ("X_du3", None),
        ("X_du", None),
        ("X_v", None),
        ("Y_vabsr", None),
        ("Y_uv", None),
        ("X_udot2", None),
        ("Y_rdot", None),
        ("X_0", None),
        ("X_tau_X", None),
        ("T_nabsn", None),
        ("Q_n", None),
    ],
)
def test_the_physical_side_follows_from_the_name(name, support):
    assert physical_support(CoefficientName.parse(name), 30.0) == support


@pytest.mark.parametrize("name", ["X_u", "X_uabsu", "X_u3", "X_uu2", "X_absuu"])
def test_a_term_on_its_physical_side_takes_energy_at_every_speed(name):
    term, speed = CoefficientName.parse(name), np.linspace(-4.0, 4.0, 81)
    assert physical_support(term, 30.0) == (-inf, 0.0)
    assert (speed * term.regressor({"u": speed}, {}) >= 0).all()


@pytest.mark.parametrize(
    ("density", "bounds", "found"),
    [
        (lambda x: math.log(x), (0.1, 1.0), "Error"),
        (lambda x: -x, (0.0, inf), "inf"),
        (lambda x: 0.0 * x - inf, (0.0, 1.0), "without a finite total"),
        (lambda x: -0.5 * ((x - 0.123) / 1e-7) ** 2, (-1e6, 1e6), "much narrower"),
    ],
)
def test_density_that_makes_no_prior_is_refused(density, bounds, found):
    with pytest.raises(InputError, match=found):
        Prior.from_logpdf(density, *bounds)


def test_one_value_stands_for_a_prior():
    """The mean, but of a logarithm the median: of a log-normal with a factor of 8 the mean is exp(ln(8)^2 / 2) = 8.7 times that."""
    wide = LogNormal(-4.6, 8.0)
    assert (nominal(wide), wide.mean) == pytest.approx((-4.6, -4.6 * 8.69), rel=1e-3)
    assert nominal(LogUniform(0.01, 100.0)) == pytest.approx(1.0)
    for prior in (Normal(3.0, 2.0), Uniform(-1.0, 4.0), half_normal(2.0, upper=0.0)):
        assert nominal(prior) == pytest.approx(prior.mean)
