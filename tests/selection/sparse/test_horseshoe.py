from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats as distributions

from seatrial.core.errors import InputError
from seatrial.sampling.run import ChainSettings
from seatrial.selection.sparse.horseshoe import FREEDOM, Horseshoe, HorseshoeTarget, horseshoe
from seatrial.selection.sparse.thresholded import thresholded_least_squares
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.gram import gram
from seatrial.selection.subsets.prior import unit_information
from tests.selection.sparse.test_thresholded import data
from tests.selection.subsets.naive import NAMES

KEY = jax.random.key(2)
SETTINGS = ChainSettings(chains=4, warmup=400, draws=400)


def small_target():
    phi, y = data(30, k=12)
    phi = phi[:, :3] / np.sqrt((phi[:, :3] ** 2).mean(0))
    y = y / np.sqrt((y**2).mean())
    numbers = (phi.T @ phi, phi.T @ y, 30.0, 0.5, 2.0)
    return phi, y, HorseshoeTarget(*(jnp.asarray(x) for x in numbers))


def test_densities_against_the_definitions():
    phi, y, target = small_target()
    z = np.array([0.3, -1.0, 2.0, 0.4, -0.3, 1.2, -0.5, 0.2, -0.4])
    lam, t, w, s = np.exp(z[3:6]), np.exp(z[6]), np.exp(z[7]), np.exp(z[8])
    tau, width = t * 0.5 * s / np.sqrt(30), 2.0 * w
    c = z[:3] * tau * np.sqrt(width**2 * lam**2 / (width**2 + tau**2 * lam**2))
    likelihood = distributions.norm(phi @ c, s).logpdf(y).sum()
    half = distributions.halfcauchy.logpdf
    square = distributions.invgamma(FREEDOM / 2, scale=FREEDOM / 2).logpdf(w**2) + np.log(2 * w**2)
    prior = (
        distributions.norm.logpdf(z[[0, 1, 2, 8]]).sum()
        + (half(lam) + np.log(lam)).sum()
        + half(t)
        + np.log(t)
        + square
    )
    np.testing.assert_allclose(target.parts(jnp.asarray(z))[0], c, rtol=1e-12)
    np.testing.assert_allclose(target.log_likelihood(jnp.asarray(z)), likelihood, rtol=1e-12)
    np.testing.assert_allclose(target.log_prior(jnp.asarray(z)), prior, rtol=1e-12)


def test_prior_draws_have_the_prior():
    """Kolmogorov and Smirnov, each of six at one in a million."""
    draws = np.asarray(small_target()[2].sample_prior(KEY, 4000))
    inverse = distributions.invgamma(FREEDOM / 2, scale=FREEDOM / 2).cdf
    for values, cdf in [
        (draws[:, 0], distributions.norm.cdf),
        (np.exp(draws[:, 3]), distributions.halfcauchy.cdf),
        (np.exp(draws[:, 6]), distributions.halfcauchy.cdf),
        (np.exp(2 * draws[:, 7]), inverse),
        (draws[:, 8], distributions.norm.cdf),
    ]:
        assert distributions.kstest(values, cdf).pvalue > 1e-6


@pytest.mark.thorough
def test_three_ways_on_a_sparse_truth():
    """All find four real terms in 400 rows; in 30 rows the horseshoe hedges, between what is real and what is not."""
    real = np.isin(np.arange(12), [1, 4, 6, 9])
    for n in (400, 30):
        phi, y = data(n, seed=1)
        stats = gram(phi, y)
        shrunk = horseshoe(stats, NAMES[:12], KEY, settings=SETTINGS)
        exact = all_subsets(stats, unit_information(stats, 1.0), NAMES[:12])
        path = thresholded_least_squares(stats, NAMES[:12])
        assert shrunk.health.r_hat.max() < 1.05
        if n == 400:
            assert shrunk.terms == exact.median_model() == path.terms == ("b", "e", "g", "j")
            full = np.linalg.solve(stats.matrix, stats.moment)
            error = np.sqrt(np.diag(np.linalg.inv(stats.matrix)))
            mean = shrunk.coefficients.mean((0, 1))
            assert (np.abs(mean - full)[real] < 1.5 * error[real]).all()
            assert (np.abs(mean)[~real] <= np.abs(full)[~real] + 0.2 * error[~real]).all()
            assert shrunk.noise_sd.mean() == pytest.approx(1.0, abs=0.1)
            certain = shrunk.pseudo_inclusion
        else:
            assert shrunk.pseudo_inclusion[real].min() < certain[real].min()
            assert shrunk.pseudo_inclusion[real].mean() > shrunk.pseudo_inclusion[~real].mean() + 0.2


def test_bad_questions():
    phi, y = data(30)
    stats = gram(phi, y)
    for options, said in [
        ({"expected": 0.0}, "expected number of terms"),
        ({"expected": 12.0}, "12 of 12"),
        ({"slab": 0.0}, "scale of the slab"),
    ]:
        with pytest.raises(InputError, match=said):
            horseshoe(stats, NAMES[:12], KEY, **options)
    with pytest.raises(InputError, match="zero throughout"):
        horseshoe(gram(phi, np.zeros(30)), NAMES[:12], KEY)
    with pytest.raises(InputError, match="1 of 1"):
        horseshoe(gram(phi[:, :1], y), NAMES[:1], KEY)


def test_prior_draws_of_different_parts_are_independent():
    """Of coefficients, their scales, the slab and the noise, in the order they were drawn: each of 28 correlations at one in 10 000."""
    draws = np.asarray(small_target()[2].sample_prior(KEY, 4000))
    parts = [draws[:, :3].ravel(), draws[:, 3:7].ravel(), draws[:, 7], draws[:, 8]]
    columns = [*draws.T]
    for one, other in [*combinations(parts, 2), *combinations(columns, 2)]:
        n = min(one.size, other.size)
        for turned in (one, np.abs(one)):
            assert distributions.spearmanr(turned[:n], other[:n]).pvalue > 1e-5


def test_summaries_of_the_draws_by_hand():
    """Means of 1 - kappa over all chains and draws; a term is real where its central 95 % lies on one side of zero."""
    rng = np.random.default_rng(0)
    kappa = rng.random((2, 50, 3))
    at = np.linspace(-1, 1, 100).reshape(2, 50)
    coefficients = np.stack([at + 0.96, at + 0.94, at - 0.96], -1)
    found = Horseshoe(NAMES[:3], coefficients, kappa, np.ones((2, 50)), None, "")
    share = [np.mean([1 - x for x in kappa[..., j].ravel()]) for j in range(3)]
    assert found.pseudo_inclusion == pytest.approx(share)
    assert found.effective_terms == pytest.approx(sum(share))
    assert found.terms == (NAMES[0], NAMES[2])
