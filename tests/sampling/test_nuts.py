import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.priors import Normal
from seatrial.sampling import nuts
from seatrial.sampling import nuts as gradient
from seatrial.sampling.diagnostics import chain_findings, diagnose
from seatrial.sampling.nuts import FORWARD_UP_TO, log_density_for_gradients
from seatrial.sampling.run import ChainSettings, finish, is_finished
from seatrial.sampling.sampler import advance_chains, sample, start_chains
from tests.estimation_cases import THRUST_UNIT, golden_posterior, linear_gaussian, posterior, short_posterior
from tests.sampling.moments import assert_moments

KEY = jax.random.key(3)


def test_both_ways_give_the_gradient(monkeypatch):
    target = short_posterior("X_u", "X_uabsu")
    z = jnp.array([0.3, -0.2])
    naive = jax.jit(jax.grad(target.log_density))(z)
    found = []
    for up_to in (0, 2):
        monkeypatch.setattr(gradient, "FORWARD_UP_TO", up_to)
        found.append(jax.jit(jax.value_and_grad(log_density_for_gradients(target)))(z))
    for value, slope in found:
        np.testing.assert_allclose(value, target.log_density(z), rtol=1e-12)
        np.testing.assert_allclose(slope, naive, rtol=1e-9)


def test_few_parameters_go_forward_and_many_backward():
    assert gradient.forward_is_cheaper(FORWARD_UP_TO)
    assert not gradient.forward_is_cheaper(FORWARD_UP_TO + 1)

    def pushes_forward(d):
        text = str(jax.make_jaxpr(jax.grad(log_density_for_gradients(looped(d))))(jnp.zeros(d)))
        return "reverse=True" not in text

    def looped(d):
        def walk(values, data):
            total = sum(values.values())
            return -(jax.lax.scan(lambda x, _: (jnp.sin(x + total), None), total, None, length=7)[0] ** 2)

        return posterior({f"c{i}": Normal(0.0, 1.0) for i in range(d)}, walk)

    assert pushes_forward(FORWARD_UP_TO)
    assert not pushes_forward(FORWARD_UP_TO + 1)


def test_gradients_that_are_not_finite_count_as_none():
    """Beyond the edge the density is NaN, there taken as zero, and its gradient as zero."""
    target = posterior({"a": Normal(0.0, 1.0)}, lambda values, data: jnp.log(values["a"]))
    value, slope = jax.value_and_grad(log_density_for_gradients(target))(jnp.array([-1.0]))
    assert value == -jnp.inf
    assert slope == 0.0


@pytest.mark.parametrize("wrong", [1e-2, 1e2])
@pytest.mark.proof
def test_adaptation_forgets_a_wrong_first_covariance(wrong):
    problem = linear_gaussian(2)
    settings = ChainSettings(chains=32, warmup=500, draws=100)
    run = start_chains(nuts, problem.posterior, jax.random.normal(KEY, (32, 2)), wrong * jnp.eye(2))
    while not is_finished(run, settings):
        run = advance_chains(nuts, problem.posterior, run, KEY, settings)
    exact = problem.moments[1] / problem.prior_sd**2
    ratio = np.linalg.eigvals(np.linalg.solve(exact, np.asarray(run.state.inverse_mass))).real
    assert (np.abs(np.log(ratio)) < 0.35).all()
    assert finish(run).acceptance == pytest.approx(nuts.TARGET_ACCEPTANCE, abs=0.12)


@pytest.mark.proof
def test_many_parameters_with_gradients_backward():
    d = FORWARD_UP_TO + 1
    problem = linear_gaussian(d)
    mean, cov = problem.moments
    starts = jax.random.normal(KEY, (8, d))
    draws = sample(nuts, problem.posterior, starts, 0.1 * jnp.eye(d), KEY, ChainSettings(8, 400, 200))
    assert_moments(np.asarray(problem.posterior.constrain(jnp.asarray(draws.z))), mean, np.sqrt(np.diag(cov)))


@pytest.mark.proof
def test_golden_posterior():
    target = golden_posterior("M-1")
    mode = find_mode(target, key=KEY)
    starts = jnp.asarray(mode.z) + 1.5 * jax.random.normal(KEY, (8, target.dim)) @ jnp.linalg.cholesky(mode.cov).T
    draws = sample(nuts, target, starts, jnp.asarray(mode.cov), KEY, ChainSettings(8, 200, 200))
    values = np.asarray(target.constrain(jnp.asarray(draws.z)))
    scaled = values[:, :, :3] / np.array([1.0, 1.0, THRUST_UNIT])
    assert chain_findings(target.names, diagnose(values)) == []
    assert draws.faults() == []
    means, sds = np.array([-1.133, -2.962, 6.249]), np.array([0.103, 0.068, 0.044])
    assert np.abs((scaled.mean((0, 1)) - means) / sds).max() < 0.15
    assert scaled.std((0, 1)) == pytest.approx(sds, rel=0.08)
