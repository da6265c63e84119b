import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.priors import LogUniform, Normal, Uniform

PRIORS = [
    Uniform(-3.0, 2.0),
    Uniform(0.0, 0.15),
    Uniform(-2e6, 1e6),
    Uniform(1e-5, 3e-5),
    LogUniform(1e-4, 0.5),
    LogUniform(2.0, 2.5),
    Normal(0.0, 1.0),
    Normal(-2e-4, 3e-6),
]
Z = np.linspace(-45.0, 45.0, 90_001)
each_prior = pytest.mark.parametrize("prior", PRIORS, ids=str)


def textbook(prior):
    match prior:
        case Uniform(lower, upper):
            return stats.uniform(lower, upper - lower)
        case LogUniform(lower, upper):
            return stats.loguniform(lower, upper)
        case Normal(mean, sd):
            return stats.norm(mean, sd)


def expectation(values, prior):
    return np.trapezoid(np.asarray(values) * np.exp(prior.log_density(Z)), Z)


@each_prior
def test_density_of_z_integrates_to_one(prior):
    assert expectation(1.0, prior) == pytest.approx(1, abs=1e-12)


@each_prior
def test_z_is_nearly_standardised(prior):
    """Exactly so for the normal; the box is a uniform blurred by a logistic of scale 1/50, which adds 4 (pi/50)^2."""
    variance = 1.0 if isinstance(prior, Normal) else 1 + 4 * (np.pi / 50) ** 2
    assert expectation(Z, prior) == pytest.approx(0, abs=1e-12)
    assert expectation(Z**2, prior) == pytest.approx(variance, abs=1e-10)


@each_prior
def test_moments_and_bounds(prior):
    expected = textbook(prior)
    values = prior.constrain(jnp.asarray(Z))
    assert (prior.mean, prior.sd) == pytest.approx((expected.mean(), expected.std()), rel=1e-12)
    assert prior.bounds == pytest.approx(expected.support(), rel=1e-14)
    assert expectation(values, prior) == pytest.approx(expected.mean(), abs=1e-9 * expected.std())
    assert np.sqrt(expectation((values - prior.mean) ** 2, prior)) == pytest.approx(expected.std(), rel=1e-9)


@each_prior
def test_log_density_is_that_of_the_value_times_the_slope(prior):
    z, h = np.linspace(-1.9, 1.9, 39), 1e-5
    value = np.asarray(prior.constrain(jnp.asarray(z)))
    slope = np.asarray(prior.constrain(jnp.asarray(z + h)) - prior.constrain(jnp.asarray(z - h))) / (2 * h)
    assert np.allclose(prior.log_density(z), textbook(prior).logpdf(value) + np.log(slope), atol=1e-5)


@each_prior
def test_round_trip(prior):
    z = jnp.linspace(-2.2, 2.2, 45)
    value = textbook(prior).ppf([1e-9, 0.01, 0.3, 0.5, 0.9, 1 - 1e-9])
    assert np.allclose(prior.unconstrain(prior.constrain(z)), z, atol=1e-7)
    assert np.allclose(prior.constrain(prior.unconstrain(value)), value, rtol=1e-12, atol=1e-14 * prior.sd)


@pytest.mark.parametrize("fraction", [0.1, 0.25, 0.5, 0.9])
def test_box_is_a_straight_line_inside(fraction):
    """Away from the bounds by a tenth, z is the standardised value to 1 % of the prior's sd, so normal stays normal."""
    prior = Uniform(-3.0, 2.0)
    value = -3.0 + 5.0 * fraction
    assert float(prior.unconstrain(value)) == pytest.approx((value - prior.mean) / prior.sd, abs=1e-3)


@each_prior
def test_draws_follow_the_prior(prior):
    z = prior.sample(jax.random.key(0), (20_000,))
    value = np.asarray(prior.constrain(z))
    assert stats.kstest(value, textbook(prior).cdf).pvalue > 0.01
    assert abs(value.mean() - prior.mean) < 4 * prior.sd / np.sqrt(value.size)
    assert value.std() == pytest.approx(prior.sd, rel=4 / np.sqrt(2 * value.size))
    assert np.isfinite(z).all()
    assert np.asarray(prior.draw(jax.random.key(0), (20_000,))) == pytest.approx(value, rel=1e-9, abs=1e-9 * prior.sd)


@each_prior
def test_far_out_there_is_no_nan(prior):
    z = jnp.array([-1e100, -1e6, -500.0, -40.0, 40.0, 500.0, 1e6, 1e100])
    value, slope = jax.vmap(jax.value_and_grad(prior.constrain))(z)
    density, gradient = jax.vmap(jax.value_and_grad(prior.log_density))(z)
    lower, upper = prior.bounds
    assert np.isfinite([value, slope, gradient]).all()
    assert (lower <= value).all()
    assert (value <= upper).all()
    assert (density < -100).all()
    assert (jnp.sign(gradient) == -jnp.sign(z)).all()
