import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import NumericalError
from seatrial.estimation.priors import Normal
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc
from tests.estimation_cases import linear_gaussian, posterior

KEY = jax.random.key(2)
PAIR = linear_gaussian(2)


@pytest.mark.parametrize("d", [2, pytest.param(5, marks=pytest.mark.proof)])
def test_particles_follow_the_posterior(d):
    """Within 4 errors; a thousand resampled particles are worth a quarter of their number at least."""
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    sd = np.sqrt(np.diag(cov))
    result = sample_tempered_smc(problem.posterior, KEY, SMCSettings())
    values = np.asarray(problem.posterior.constrain(jnp.asarray(result.particles)))
    assert values.shape == (SMCSettings().particles_for(d), d)
    assert (np.abs(values.mean(0) - mean) < 4 * sd / np.sqrt(250)).all()
    assert values.std(0) == pytest.approx(sd, rel=4 / np.sqrt(2 * 250))
    assert np.abs(np.corrcoef(values.T) - cov / np.outer(sd, sd)).max() < 4 / np.sqrt(250)


def test_temperatures_rise_to_one():
    result = sample_tempered_smc(PAIR.posterior, KEY, SMCSettings())
    assert (np.diff(result.temperatures) > 0).all()
    assert result.temperatures[-1] == 1
    assert result.acceptance.shape == result.temperatures.shape
    assert ((result.acceptance > 0.1) & (result.acceptance < 0.9)).all()


@pytest.mark.proof
def test_first_temperature_keeps_the_stated_share():
    """Weights L^b of prior draws have the effective size asked for, up to that number's scatter."""
    first = sample_tempered_smc(PAIR.posterior, KEY, SMCSettings()).temperatures[0]
    draws = PAIR.posterior.sample_prior(jax.random.key(7), 100_000)
    weight = np.exp(first * np.asarray(jax.vmap(PAIR.posterior.log_likelihood)(draws)))
    assert weight.sum() ** 2 / (weight**2).sum() / weight.size == pytest.approx(SMCSettings().target_ess, abs=0.05)


@pytest.mark.proof
def test_evidence_is_unbiased():
    """The mean of Z over 40 runs, relative to the truth, within 4 of its errors."""
    ratio = np.exp(
        [
            sample_tempered_smc(PAIR.posterior, jax.random.key(i), SMCSettings()).log_evidence - PAIR.log_evidence
            for i in range(40)
        ]
    )
    assert abs(ratio.mean() - 1) < 4 * ratio.std(ddof=1) / np.sqrt(40)
    assert ratio.std() < 0.15


@pytest.mark.parametrize("sd", [1e-2, 1e3])
def test_likelihood_that_says_nothing(sd):
    """A design of zeros leaves the density of the residuals, however far from 0, and needs one step."""
    silent = PAIR._replace(design=np.zeros((20, 2)), sd=sd)
    result = sample_tempered_smc(silent.posterior, KEY, SMCSettings())
    assert result.log_evidence == pytest.approx(stats.norm(0, sd).logpdf(silent.measured).sum(), rel=1e-12)
    assert result.temperatures.tolist() == [1.0]


def test_same_key_same_bits():
    keys = (KEY, KEY, jax.random.key(5))
    first, again, other = (sample_tempered_smc(PAIR.posterior, key, SMCSettings()) for key in keys)
    assert first.particles.tobytes() == again.particles.tobytes()
    assert first.log_evidence == again.log_evidence
    assert first.log_evidence != other.log_evidence


def test_no_draw_can_be_simulated():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.where(v["a"] > 100.0, 0.0, -jnp.inf))
    with pytest.raises(NumericalError, match=r"none of \d+ draws.*Narrow the prior"):
        sample_tempered_smc(target, KEY, SMCSettings())


@pytest.mark.parametrize("share", [pytest.param(0.5, marks=pytest.mark.proof), 0.02])
def test_evidence_where_a_part_of_the_prior_cannot_be_simulated(share):
    """Under a standard normal prior exp(-a^2 / 2) above a bound alone: the posterior is a normal one, cut off there."""
    bound = stats.norm.isf(share)
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.where(v["a"] > bound, -0.5 * v["a"] ** 2, -jnp.inf))
    truth = np.sqrt(0.5) * stats.norm.sf(np.sqrt(2.0) * bound)
    runs = [sample_tempered_smc(target, jax.random.key(i), SMCSettings()) for i in range(40)]
    ratio = np.exp([run.log_evidence for run in runs]) / truth
    assert abs(ratio.mean() - 1) < 4 * ratio.std(ddof=1) / np.sqrt(40)
    assert all(run.alive == pytest.approx(share, abs=5 * np.sqrt(share / 512)) for run in runs)
    kept = stats.truncnorm(np.sqrt(2.0) * bound, np.inf, scale=np.sqrt(0.5))
    means = [run.particles.mean() for run in runs]
    assert np.mean(means) == pytest.approx(kept.mean(), abs=4 * np.std(means, ddof=1) / np.sqrt(40) + 1e-12)


def test_too_few_temperature_steps():
    with pytest.raises(NumericalError, match=r"stopped at temperature .* after 2 steps.*Use more particles"):
        sample_tempered_smc(PAIR.posterior, KEY, SMCSettings(), max_steps=2)


def test_moves_grow_with_dimension():
    assert [SMCSettings().moves_for(d) for d in (1, 4, 5, 10)] == [8, 8, 10, 20]
    assert SMCSettings(moves=3).moves_for(10) == 3


def test_progress_rises_to_its_total():
    seen = []
    sample_tempered_smc(PAIR.posterior, KEY, SMCSettings(), lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert seen[-1] == 1


@pytest.mark.proof
def test_particles_that_fill_no_vectors():
    """Usual numbers are multiples of 64, the particles simulated at once."""
    result = sample_tempered_smc(PAIR.posterior, KEY, SMCSettings(100))
    assert result.particles.shape == (100, 2)
    assert result.log_evidence == pytest.approx(PAIR.log_evidence, abs=4 * 2 / np.sqrt(100))
