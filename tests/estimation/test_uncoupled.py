"""Coordinates for trials that differ, on a normal hierarchy whose posterior is a quadrature over the spread alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.noncentred import Uncoupled, coupled, in_posterior, uncouple
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.sample_posterior import spread_starts
from seatrial.estimation.priors import Normal, half_normal
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS, sample
from seatrial.selection.importance import importance_evidence

KEY = jax.random.key(5)
LABELS = ("1", "2", "3")
MEASURED, ERROR = np.array([-3.3, -2.9, -2.2]), np.array([0.05, 0.2, 0.02])
COMMON, COMMON_SD, SPREAD, GAIN_SD = -3.0, 0.6, 0.5, 0.1


class Hierarchy:
    """Trial i measures the common value, its own deviation, and a gain that all share."""

    varying, labels = ("X_u",), LABELS

    def __call__(self, values, data):
        own = jnp.stack([values["X_u"] + values["spread_X_u"] * values[f"dev_X_u[{label}]"] for label in LABELS])
        miss = (data[0] - own - values["gain"]) / data[1]
        return jnp.sum(-0.5 * miss**2 - jnp.log(data[1] * jnp.sqrt(2 * jnp.pi)))


def hierarchy(error=ERROR):
    own = [Parameter(f"dev_X_u[{label}]", "1", "", Normal(0.0, 1.0)) for label in LABELS]
    priors = {
        "X_u": Normal(COMMON, COMMON_SD),
        "spread_X_u": half_normal(SPREAD, lower=0.0),
        "gain": Normal(0.0, GAIN_SD),
    }
    shared = [Parameter(name, "1", "", prior) for name, prior in priors.items()]
    return Posterior((*shared, *own), Hierarchy(), (jnp.asarray(MEASURED), jnp.asarray(error)))


def by_quadrature():
    """Log evidence, and mean and sd of the common value, the spread and the gain: all but the spread is normal given it."""
    tau = np.linspace(1e-5, 8 * SPREAD, 40_001)
    log_weight, mean, second = np.empty(tau.size), np.empty((tau.size, 3)), np.empty((tau.size, 3))
    prior, design = np.array([COMMON_SD**2, GAIN_SD**2]), np.ones((3, 2))
    for k, t in enumerate(tau):
        cov = np.diag(ERROR**2 + t**2) + design @ np.diag(prior) @ design.T
        gain, miss = np.diag(prior) @ design.T @ np.linalg.inv(cov), MEASURED - COMMON
        here = np.array([COMMON, 0.0]) + gain @ miss
        spread = np.diag(np.diag(prior) - gain @ design @ np.diag(prior))
        log_weight[k] = -0.5 * (miss @ np.linalg.solve(cov, miss) + np.linalg.slogdet(2 * np.pi * cov)[1])
        mean[k], second[k] = (here[0], t, here[1]), (spread[0] + here[0] ** 2, t**2, spread[1] + here[1] ** 2)
    log_weight += np.log(2 / (SPREAD * np.sqrt(2 * np.pi))) - 0.5 * (tau / SPREAD) ** 2
    weight = np.exp(log_weight - log_weight.max()) * (tau[1] - tau[0])
    total, top = weight.sum(), log_weight.max()
    mean, second = weight @ mean / total, weight @ second / total
    return np.log(total) + top, mean, np.sqrt(second - mean**2)


@pytest.fixture(scope="module")
def problem():
    posterior = hierarchy()
    mode = find_mode(posterior, key=KEY)
    return posterior, mode, *uncouple(posterior, mode)


@pytest.mark.proof
def test_there_and_back(problem):
    posterior, _, target, _ = problem
    z = posterior.sample_prior(KEY, 50)
    assert np.asarray(coupled(target, target.uncoupled(z))) == pytest.approx(np.asarray(z), abs=1e-10)
    assert np.asarray(target.sample_prior(KEY, 50)) == pytest.approx(np.asarray(target.uncoupled(z)), abs=1e-12)


@pytest.mark.proof
def test_density_is_that_of_the_posterior_times_the_volume(problem):
    posterior, _, target, _ = problem
    for x in np.random.default_rng(0).normal(size=(5, posterior.dim)):
        _, log_volume = np.linalg.slogdet(np.asarray(jax.jacfwd(target.coupled)(jnp.asarray(x))))
        there = coupled(target, x)
        assert target.log_likelihood(jnp.asarray(x)) == pytest.approx(float(posterior.log_likelihood(there)), abs=1e-9)
        assert target.log_prior(jnp.asarray(x)) == pytest.approx(
            float(posterior.log_prior(there)) + log_volume, abs=1e-9
        )


@pytest.mark.proof
def test_chains_against_quadrature(problem):
    """In its own coordinates the same run has R-hat of 1.2 and more; bounds are 5 Monte Carlo standard errors."""
    posterior, _, target, there = problem
    starts = spread_starts(target, there, 32, KEY)
    settings = ChainSettings(32, 500, 1500)
    drawn = sample(SAMPLERS["independence-metropolis"], target, starts, jnp.asarray(there.cov), KEY, settings)
    draws = in_posterior(target, drawn)
    values = np.asarray(posterior.constrain(jnp.asarray(draws.z)))
    health = diagnose(values)
    assert health.r_hat.max() < 1.02
    _, mean, sd = by_quadrature()
    ess = health.ess_bulk[:3]
    assert (np.abs(values.mean((0, 1))[:3] - mean) < 5 * sd / np.sqrt(ess)).all()
    assert (np.abs(values.std((0, 1))[:3] / sd - 1) < 5 / np.sqrt(ess)).all()
    at = draws.z[3, 7]
    density = posterior.log_prior(jnp.asarray(at)) + posterior.log_likelihood(jnp.asarray(at))
    assert draws.log_density[3, 7] == pytest.approx(float(density), abs=1e-8)


@pytest.mark.proof
def test_evidence_against_quadrature(problem):
    found = importance_evidence(problem[0], KEY, problem[1])
    assert not found.status
    assert found.log_value == pytest.approx(by_quadrature()[0], abs=4 * found.std_error)


@pytest.mark.proof
def test_trials_that_know_nothing_change_nothing():
    posterior = hierarchy(error=np.full(3, 1e6))
    target, _ = uncouple(posterior, find_mode(posterior, key=KEY))
    assert isinstance(target, Uncoupled)
    z = posterior.sample_prior(KEY, 5)
    assert np.asarray(target.uncoupled(z)) == pytest.approx(np.asarray(z), abs=1e-6)


def test_posterior_without_a_hierarchy_is_its_own_target(problem):
    plain = Posterior(problem[0].parameters, lambda values, data: 0.0, ())
    target, mode = uncouple(plain, problem[1])
    assert target is plain
    assert mode is problem[1]


def test_what_the_trials_know_is_that_of_the_normal_hierarchy(problem):
    """Trial i knows its own value to be what it measured less the gain, with the information 1 / error^2."""
    target = problem[2]
    np.testing.assert_allclose(target.information, 1 / ERROR[None] ** 2, rtol=1e-6)
    np.testing.assert_allclose(target.slope[0, :, 2], -GAIN_SD, rtol=1e-6)
    np.testing.assert_allclose(target.slope[0][:, [0, 1, 3, 4, 5]], 0.0, atol=1e-9)
    np.testing.assert_allclose(target.at, MEASURED[None], rtol=1e-6)
    assert (float(target.origin[0]), float(target.scale[0])) == pytest.approx((COMMON, COMMON_SD))


def test_mode_in_these_coordinates_has_their_curvature(problem):
    """Its place, precision and covariance are those of the posterior's carried over by the slopes of the map."""
    _, mode, target, there = problem
    np.testing.assert_allclose(coupled(target, there.z), mode.z, atol=1e-9)
    slope = np.asarray(jax.jacfwd(target.coupled)(jnp.asarray(there.z)))
    np.testing.assert_allclose(there.precision, slope.T @ mode.precision @ slope, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(there.cov @ there.precision, np.eye(6), atol=1e-5)


class TwoValues:
    """Trial i measures two values that both differ between trials, each by its own error, and a gain with the second."""

    varying, labels = ("X_u", "Y_v"), LABELS
    measured, error = np.array([[-3.3, -2.9, -2.2], [7.0, 7.4, 6.5]]), np.array([[0.05, 0.2, 0.1], [0.3, 0.1, 0.4]])

    def __call__(self, values, data):
        own = [
            [values[name] + values[f"spread_{name}"] * values[f"dev_{name}[{label}]"] for label in LABELS]
            for name in self.varying
        ]
        known = jnp.stack([jnp.stack(row) for row in own]) + jnp.array([[0.0], [1.0]]) * values["gain"]
        return -0.5 * jnp.sum(((self.measured - known) / self.error) ** 2)


@pytest.mark.proof
def test_given_their_spreads_two_values_that_vary_are_not_correlated():
    """Values, deviations and trials keep their places: curvature is the identity at the mode's spreads, and the way back is the way."""
    priors = {
        "gain": Normal(0.0, GAIN_SD),
        **{"X_u": Normal(COMMON, COMMON_SD), "Y_v": Normal(6.0, 2.0)},
        **{f"spread_{name}": half_normal(SPREAD, lower=0.0) for name in TwoValues.varying},
        **{f"dev_{name}[{label}]": Normal(0.0, 1.0) for name in TwoValues.varying for label in LABELS},
    }
    posterior = Posterior(tuple(Parameter(name, "1", "", prior) for name, prior in priors.items()), TwoValues(), ())
    target, there = uncouple(posterior, find_mode(posterior, key=KEY))
    assert isinstance(target, Uncoupled)
    inside = [1, 2, *range(5, 11)]
    hessian = jax.jit(jax.hessian(lambda x: target.log_prior(x) + target.log_likelihood(x)))(jnp.asarray(there.z))
    assert -np.asarray(hessian)[np.ix_(inside, inside)] == pytest.approx(np.eye(8), abs=1e-5)
    z = posterior.sample_prior(KEY, 5)
    assert np.asarray(coupled(target, target.uncoupled(z))) == pytest.approx(np.asarray(z), abs=1e-9)
