"""The trial of Section IV and its posteriors against the golden trial of the other tests."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from studies.remus100.tests.studies import A, B
from studies.remus100.trial import around, doublets, paper_posterior, paper_trial, stamps, wide
from tests.cases import RPM
from tests.estimation_cases import golden_motion, golden_noise, golden_posterior, naive_doublets


def test_trial_is_the_golden_one():
    """The golden motion is a plain midpoint loop: the two integrators differ by 1e-6 m/s at most."""
    time, rev_per_s, speed = golden_motion()
    record = paper_trial(A, 0.1)
    np.testing.assert_allclose(record.time, time, atol=1e-12)
    np.testing.assert_allclose(record.channel("n"), 2 * np.pi * rev_per_s, rtol=1e-12)
    np.testing.assert_allclose(record.channel("u"), speed + golden_noise(), atol=1e-6)


@pytest.mark.parametrize(("period", "active"), [(10.0, 40.0), (29.0, 58.0), (7.0, 40.0)])
def test_doublets_phase_by_phase(period, active):
    expected = 2 * np.pi * naive_doublets(stamps(), 200, period, active)
    np.testing.assert_allclose(doublets(A, period, active), expected, rtol=1e-12)
    np.testing.assert_allclose(doublets(B) - B.turns, doublets(A) - A.turns, atol=1e-12)
    assert np.ptp(doublets(A)) == pytest.approx(400 * RPM)


def test_other_seeds_change_the_noise_alone():
    one, other = (paper_trial(A, None, seed).channel("u") for seed in (1, 2))
    noise = 0.0757 * np.random.default_rng(2).normal(size=6000)
    np.testing.assert_allclose(other - noise, one - golden_noise(), atol=1e-12)


def test_priors_are_about_half_the_truth():
    """200 % of the truth to either side of half of it; sigma up to twice its own, eq. (18)."""
    assert around(-1.21).bounds == pytest.approx((-3.025, 1.815))
    posterior = paper_posterior(A, [paper_trial(A, 0.1)], wide(A))
    bounds = {parameter.name: parameter.prior.bounds for parameter in posterior.parameters}
    assert list(bounds) == ["X_u", "X_uabsu", "T_nabsn", "X_du3", "sigma_u"]
    assert bounds["X_uabsu"] == pytest.approx((-7.325, 4.395))
    assert bounds["X_du3"] == (-50.0, 50.0)
    assert bounds["sigma_u"] == (0.0, 0.1514)


@pytest.mark.parametrize("model", ["M-1", "M-0 wide", "M-0 narrow"])
def test_posterior_is_the_golden_one(model):
    """Density at five draws of the prior about the truth; the data differ by 1e-6 m/s."""
    prior = {"M-1": None, "M-0 wide": wide(A), "M-0 narrow": around(0.1)}[model]
    ours, golden = paper_posterior(A, [paper_trial(A, 0.1)], prior), golden_posterior(model)
    truth = jnp.array([*A.truth.values(), *([0.1] if prior else []), A.sigma])
    z = ours.unconstrain(truth) + 0.02 * jax.random.normal(jax.random.key(0), (5, ours.dim))
    found, expected = (jax.vmap(target.log_density)(z) for target in (ours, golden))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
