import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import seatrial as st
from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior.mode import Mode, find_mode, maximise_from
from seatrial.estimation.priors import Normal, Uniform, half_normal
from seatrial.sampling.target import evaluate
from seatrial.selection import importance
from seatrial.selection.importance import (
    MISSING_TAIL_INDEX,
    ImportanceSettings,
    ProposalComponent,
    Weights,
    _complaints,
    _draw,
    _log_proposal,
    bent,
    edges_of,
    evidence_of,
    importance_evidence,
    importance_sample,
    laplace_proposal,
    refit,
    straightened,
    weigh,
)
from tests.estimation_cases import GOLDEN_LOG_EVIDENCE, golden_posterior, linear_gaussian, normal_about, posterior
from tests.selection.targets import linear
from tests.selection.test_evidence import box, half_forbidden, parabola, short_surge

KEY = jax.random.key(1)
PAIR = linear_gaussian(2)


@pytest.mark.parametrize(
    "problem",
    [
        lambda: linear(2),
        pytest.param(lambda: linear(10), marks=pytest.mark.proof),
        box,
        half_forbidden,
    ],
    ids=["linear 2", "linear 10", "box", "half forbidden"],
)
def test_known_evidence(problem):
    target, exact = problem()
    found = importance_evidence(target, KEY)
    assert found.status == ""
    assert 0 < found.std_error < 0.02
    assert abs(found.log_value - exact) < 4 * found.std_error


@pytest.mark.proof
@pytest.mark.parametrize("model", ["M-0 wide", "M-0 narrow"])
def test_golden_evidence(model):
    """`M-0 narrow` has its mode at the edge of the prior, where the Laplace approximation alone is 4.7 nats off.

    M-1 is in studies/remus100/tests/test_evidence.py.
    """
    found = importance_evidence(golden_posterior(model), KEY, settings=ImportanceSettings(draws=81920))
    assert found.status == ""
    assert found.std_error < 0.003
    assert found.diagnostics["efficiency"] > 0.5
    assert found.log_value == pytest.approx(GOLDEN_LOG_EVIDENCE[model], abs=0.01)


@pytest.mark.proof
def test_a_ridge_that_ends_at_the_prior_is_found():
    """A ridge of correlation -0.9999 whose ends lie at the bounds of the prior: its corners are sharper than the ridge is thin."""
    target, exact = short_surge()
    found = importance_evidence(target, KEY)
    assert found.status == ""
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.04


@pytest.mark.proof
def test_a_ridge_that_bends_is_reported():
    """Few draws of a normal meet the ends of a parabola, and those have great weight."""
    target, exact = parabola(0.02)
    found = importance_evidence(target, KEY)
    assert "Pareto k" in found.status
    assert abs(found.log_value - exact) < 1.0


def test_stated_errors_are_honest():
    """Of 40 errors in units of what is stated, the root mean square has a standard error of 11 %."""
    mode = find_mode(PAIR.posterior, key=KEY)
    found = [
        importance_evidence(PAIR.posterior, jax.random.key(i), mode, ImportanceSettings(draws=1024, pilot=1024))
        for i in range(40)
    ]
    scores = [(evidence.log_value - PAIR.log_evidence) / evidence.std_error for evidence in found]
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.45)


def test_mixture_density_is_that_of_its_draws():
    """Against scipy's multivariate t; and since both are normalised, the mean of N(0, I) / q is 1 within 4 errors."""
    centre, factor = np.array([1.0, -2.0]), np.array([[0.7, 0.0], [0.4, 0.3]])
    proposal = ProposalComponent(centre, factor)
    z = _draw(proposal, np.random.default_rng(0), 20_000)
    log_q = _log_proposal(proposal, z)
    scale = factor @ factor.T
    expected = 0.8 * stats.multivariate_t(centre, scale, 8).pdf(z) + 0.2 * stats.multivariate_t(
        centre, 4 * scale, 8
    ).pdf(z)
    assert log_q == pytest.approx(np.log(expected), abs=1e-10)
    ratio = stats.multivariate_normal(centre, 0.5 * scale).pdf(z) / np.exp(log_q)
    assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(ratio.size))


def leaning(offset):
    """A likelihood normal in a and eight others, of correlation -0.95 with the first; its peak lies beyond the bound 0 of a.

    The others are free, so that they are integrated in closed form, and a by quadrature.
    """
    others = 8
    mean = np.concatenate([[0.02 * offset], np.full(others, 0.3)])
    cov = np.diag(np.full(1 + others, 0.02**2))
    cov[0, 1] = cov[1, 0] = -0.95 * 0.02**2
    slope, within = cov[1:, 0] / cov[0, 0], cov[1:, 1:] - np.outer(cov[1:, 0], cov[0, 1:]) / cov[0, 0]

    nodes = np.linspace(-0.4, 0.0, 40_001)
    given = mean[1:] + (nodes[:, None] - mean[0]) * slope
    log_others = 0.5 * np.linalg.slogdet(2 * np.pi * within)[1]
    log_others = log_others + stats.multivariate_normal(np.zeros(others), np.eye(others) + within).logpdf(given)
    height = np.exp(log_others - 0.5 * ((nodes - mean[0]) / 0.02) ** 2) / 8.0
    priors = {"a": Uniform(-8.0, 0.0), **{f"b{i}": Normal(0.0, 1.0) for i in range(others)}}
    return normal_about(priors, mean, np.linalg.inv(cov)), np.log(np.trapezoid(height, nodes))


@pytest.mark.parametrize("offset", [-3.0, 0.0, 1.0, 6.0])
def test_a_posterior_that_leans_on_a_bound_is_weighed_evenly(offset):
    """As of a term that is not needed: drawn without a cut the index of the tail is up to 0.74."""
    target, exact = leaning(offset)
    found = importance_evidence(target, KEY)
    assert found.status == ""
    assert found.diagnostics["k_hat"] < 0.3
    assert found.diagnostics["efficiency"] > 0.4
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.06


def test_a_peak_beyond_a_bound_leaves_no_heavy_tail():
    """Two standard deviations beyond it, where the density falls off slower than a t about the mean of what is left."""
    target = normal_about({"a": Uniform(0.0, 1.0)}, [1.2], [[100.0]])
    exact = np.log(0.1 * np.sqrt(2 * np.pi) * (stats.norm.cdf(-2.0) - stats.norm.cdf(-12.0)))
    for seed in range(6):
        found = importance_evidence(target, jax.random.key(seed))
        assert found.diagnostics["k_hat"] < 0.3
        assert abs(found.log_value - exact) < 4 * found.std_error < 0.06


def test_the_density_of_a_cut_proposal_is_that_of_its_draws():
    """Two components cut at bounds, one free: the mean of prior over proposal is 1, and the first is a t cut at its bounds."""
    target = posterior(
        {"a": Uniform(0.0, 1.0), "b": half_normal(2.0, lower=0.0), "c": Normal(0.0, 1.0)}, lambda v, data: jnp.zeros(())
    )
    edges = edges_of(target)
    assert np.isfinite(edges).tolist() == [[True, True], [True, False], [False, False]]
    factor = np.linalg.cholesky(np.array([[1.0, 0.5, -0.3], [0.5, 0.8, 0.2], [-0.3, 0.2, 1.2]]))
    proposal = ProposalComponent(np.array([0.4, -0.2, 0.1]), factor, edges=edges)
    z = _draw(proposal, np.random.default_rng(0), 40_000)
    ratio = np.exp(evaluate(target, z) - _log_proposal(proposal, z))
    assert ratio.mean() == pytest.approx(1.0, abs=4 * ratio.std() / np.sqrt(ratio.size))
    line = straightened(z, edges)
    np.testing.assert_allclose(bent(line, edges), z, atol=1e-9)

    def below(x):
        parts = [(share, stats.t(8, 0.4, scale).cdf) for share, scale in ((0.8, 1.0), (0.2, 2.0))]
        return sum(share * (cdf(x) - cdf(edges[0, 0])) / np.diff(cdf(edges[0])) for share, cdf in parts)

    assert stats.kstest(line[:, 0], below).pvalue > 1e-3


def test_proposal_is_nowhere_wider_than_the_prior():
    """Precisions of 1e-4 and 100 along the axes: variances of 1, the prior's, and 0.01."""
    precision = np.diag([1e-4, 100.0])
    mode = Mode(np.zeros(2), precision, np.linalg.inv(precision), 0.0, 0.0, np.zeros(2), np.ones(2), False)
    factor = laplace_proposal(mode).factor
    assert factor @ factor.T == pytest.approx(np.diag([1.0, 0.01]), abs=1e-12)


def mirrored(values, data):
    """Two peaks of standard deviation 0.03, the right one with so many times the weight."""
    at, weight = data
    left, right = (-0.5 * ((values["a"] - side * at) / 0.03) ** 2 for side in (-1, 1))
    return jnp.logaddexp(left, jnp.log(weight) + right)


def two_peaks(at, weight=1.0):
    """Peaks at -a and a under a standard normal prior, and the evidence of the left one."""
    target = posterior({"a": Normal(0.0, 1.0)}, mirrored, (jnp.asarray(at), jnp.asarray(weight)))
    return target, np.log(0.03 * np.sqrt(2 * np.pi)) + stats.norm(0, np.hypot(1.0, 0.03)).logpdf(at)


def test_second_peak_within_reach_is_learnt():
    target, one = two_peaks(0.1)
    found = importance_evidence(target, KEY)
    assert found.status == ""
    assert found.diagnostics["refits"] > 0
    assert abs(found.log_value - one - np.log(2)) < 4 * found.std_error


def test_second_peak_out_of_reach_is_missed_without_a_sign():
    """Half of the evidence is never seen, and no diagnostic of the weights can tell: what a second method is for."""
    target, one = two_peaks(1.0)
    found = importance_evidence(target, KEY)
    assert found.status == ""
    assert abs(found.log_value - one) < 4 * found.std_error


def test_peaks_that_are_given_are_all_weighed_each_by_its_share():
    """Nineteen twentieths of the evidence lie in the second peak: half of the draws are shared equally, half by that."""
    target, one = two_peaks(1.0, 19.0)
    modes = [maximise_from(target, np.array([at])) for at in (-1.0, 1.0)]
    drawn = importance_sample(target, KEY, modes[0], further=modes[1:])
    found = evidence_of(drawn)
    assert (found.status, found.method) == ("", "importance sampling about 2 modes")
    assert abs(found.log_value - one - np.log(20)) < 4 * found.std_error < 0.04
    assert np.mean(drawn.z > 0) == pytest.approx(0.25 + 0.5 * 0.95, abs=0.01)


def test_refit_of_two_proposals_by_a_naive_twin():
    """Each draw is shared by the proposals' densities there; share, centre and scale are then those of a single one's refit."""
    random = np.random.default_rng(4)
    pair = [
        ProposalComponent(np.array([-1.0, 0.0]), 0.3 * np.eye(2), 0.4),
        ProposalComponent(np.array([1.0, 0.0]), 0.2 * np.eye(2), 0.6),
    ]
    z = np.concatenate([_draw(one, random, 300) for one in pair])
    log_weight = random.normal(size=600)
    weights = Weights(z, log_weight, log_weight - np.log(np.exp(log_weight).sum()), 0.1, 300.0)
    density = np.array([one.share * np.exp(_log_proposal(one, z)) for one in pair])
    belongs = np.exp(weights.smoothed) * density / density.sum(0)
    for before, after, part in zip(pair, refit(pair, weights), belongs, strict=True):
        share = part / part.sum()
        centre, trust = share @ z, 1 / (share**2).sum()
        cov = trust * np.cov(z.T, aweights=share, ddof=0) + 4 * before.factor @ before.factor.T
        assert after.share == pytest.approx(0.25 + 0.5 * part.sum())
        assert after.centre == pytest.approx(centre)
        assert after.factor @ after.factor.T == pytest.approx(cov / (trust + 4))


@pytest.mark.parametrize(
    ("k_hat", "ess", "words"),
    [
        (0.5, 500.0, ""),
        (0.69, 401.0, ""),
        (0.71, 401.0, "Pareto k 0.71"),
        (0.69, 399.0, "only 399 effective draws"),
        (0.8, 500.0, "Pareto k 0.80"),
        (np.nan, 500.0, "Pareto k"),
        (0.5, 30.0, "only 30 effective draws"),
    ],
)
def test_complaints(k_hat, ess, words):
    said = "; ".join(_complaints(Weights(np.empty((0, 1)), np.empty(0), np.empty(0), k_hat, ess)))
    assert words in said
    assert bool(words) == bool(said)


def test_more_is_drawn_where_too_few_draws_count():
    target, exact = linear(2)
    found = importance_evidence(target, KEY, settings=ImportanceSettings(draws=256))
    assert (found.status, found.diagnostics["ess"] >= 400) == ("", True)
    assert 512 < found.diagnostics["draws"] < 1024
    assert abs(found.log_value - exact) < 4 * found.std_error


def test_few_draws_are_reported(monkeypatch):
    monkeypatch.setattr(importance, "MAX_DRAW_FACTOR", 1.0)
    assert (
        "effective draws"
        in importance_evidence(PAIR.posterior, KEY, settings=ImportanceSettings(draws=128, pilot=128)).status
    )


def test_no_finite_density():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda v, data: jnp.full((), -jnp.inf))
    with pytest.raises(NumericalError, match="none of 64 draws"):
        weigh(target, [ProposalComponent(np.zeros(1), np.eye(1))], KEY, 64)


def test_a_single_draw_that_counts_is_no_tail():
    """All others lie over 700 nats lower: their smoothed weights would be no numbers, and the shares of a refit neither."""
    target = posterior({"x": Normal(0.0, 1.0)}, lambda values, data: -1e9 * values["x"] ** 2)
    proposal = importance.ProposalComponent(np.zeros(1), np.eye(1))
    weights = importance.weigh(target, [proposal], jax.random.key(0), 256)
    assert np.isfinite(weights.smoothed).sum() >= 1
    assert np.exp(weights.smoothed).sum() == pytest.approx(1.0)
    assert weights.k_hat == MISSING_TAIL_INDEX
    (refitted,) = importance.refit([proposal], weights)
    assert refitted.share == pytest.approx(1.0)


def test_same_key_same_bits():
    mode = find_mode(PAIR.posterior, key=KEY)
    first, again, other = (
        importance_evidence(PAIR.posterior, key, mode).log_value for key in (KEY, KEY, jax.random.key(5))
    )
    assert first == again != other


def test_weights_by_their_definition():
    """log(p L / q) of every draw, q the mixture of both proposals by their shares; effective size 1 / sum w^2."""
    pair = [
        ProposalComponent(np.array([-0.5, 0.0]), np.eye(2), 0.25),
        ProposalComponent(np.array([0.5, 0.0]), 0.8 * np.eye(2), 0.75),
    ]
    found = weigh(PAIR.posterior, pair, KEY, 2000)
    q = sum(one.share * np.exp(_log_proposal(one, found.z)) for one in pair)
    log_weight = evaluate(PAIR.posterior, found.z) - np.log(q)
    assert found.log_weight == pytest.approx(log_weight, abs=1e-9)
    w = np.exp(log_weight - log_weight.max())
    w /= w.sum()
    assert found.ess == pytest.approx(1 / (w**2).sum())
    assert np.exp(found.smoothed).sum() == pytest.approx(1.0)
    off = np.abs(np.exp(found.smoothed) - w)
    assert np.sum(off > 1e-9) <= 0.2 * 2000, "only the tail is smoothed"
    first = np.mean(np.exp(_log_proposal(pair[0], found.z[:500])) > 0)
    assert (found.z.shape, first) == ((2000, 2), 1.0)
    assert found.z[:500].mean(0) == pytest.approx([-0.5, 0.0], abs=0.25)
    assert found.z[500:].mean(0) == pytest.approx([0.5, 0.0], abs=0.2)


def test_evidence_of_given_weights_by_hand():
    """Mean of the weights, its relative error from their variance, and what was done."""
    random = np.random.default_rng(2)
    log_weight = random.normal(size=3000)
    w = np.exp(log_weight)
    ess = w.sum() ** 2 / (w**2).sum()
    found = evidence_of(Weights(np.zeros((3000, 1)), log_weight, log_weight, 0.3, ess, 2, 3))
    assert found.log_value == pytest.approx(np.log(w.mean()))
    assert found.std_error == pytest.approx(w.std() / w.mean() / np.sqrt(3000))
    assert found.method == "importance sampling about 3 modes"
    assert found.diagnostics == pytest.approx(
        {"k_hat": 0.3, "ess": ess, "efficiency": ess / 3000, "draws": 3000, "refits": 2, "modes": 3}
    )


@pytest.mark.parametrize(
    ("efficiency", "k_hat", "modes", "refits"),
    [(0.51, 0.69, 1, 0), (0.49, 0.1, 1, 2), (0.9, 0.71, 1, 2), (0.51, 0.69, 2, 1)],
)
def test_the_proposal_is_refitted_until_enough_draws_count(monkeypatch, efficiency, k_hat, modes, refits):
    """At half of them and a tail index of 0.7 it is left; of several modes the shares are learnt once, and twice is all."""
    asked = []

    def canned(target, proposals, key, n):
        asked.append((n, [one.share for one in proposals]))
        return Weights(np.zeros((n, 2)), np.zeros(n), np.zeros(n), k_hat, efficiency * n)

    monkeypatch.setattr(importance, "weigh", canned)
    monkeypatch.setattr(importance, "refit", lambda proposals, weights, edges: proposals)
    mode = find_mode(PAIR.posterior, key=KEY)
    found = importance_sample(PAIR.posterior, KEY, mode, ImportanceSettings(1000, 100, 2), [mode] * (modes - 1))
    assert (found.refits, found.modes) == (refits, modes)
    assert [n for n, _ in asked] == [100] * (refits + 1) + [1000]
    assert asked[0][1] == [1 / modes] * modes


def test_proposal_without_draws_keeps_its_place_and_half_of_its_share():
    pair = [ProposalComponent(np.zeros(1), np.eye(1), 0.5), ProposalComponent(np.array([500.0]), 0.01 * np.eye(1), 0.5)]
    z = np.random.default_rng(1).normal(size=(400, 1))
    found = refit(pair, Weights(z, np.zeros(400), np.full(400, -np.log(400)), 0.1, 400.0))
    assert [one.share for one in found] == pytest.approx([0.75, 0.25])


@pytest.mark.parametrize("narrowest", [1.0, 1e-3, 1e-14])
def test_a_proposal_exists_where_its_covariance_is_singular_by_rounding(narrowest):
    """Near a spread of 0 precisions reach 1e28, of which Cholesky's factorisation of the covariance finds no root."""
    rng = np.random.default_rng(3)
    turned, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    sd = np.geomspace(narrowest, 1.0, 5)
    mode = Mode(np.zeros(5), turned / sd**2 @ turned.T, turned * sd**2 @ turned.T, 0.0, 0.0, np.zeros(5), sd, False)
    factor = laplace_proposal(mode).factor
    assert np.array_equal(factor, np.tril(factor))
    assert (np.diagonal(factor) > 0).all()
    if narrowest > 1e-4:
        np.testing.assert_allclose(factor @ factor.T, mode.cov, rtol=0, atol=1e-10)


@pytest.mark.proof
def test_centred_schools_end_in_a_value_with_what_speaks_against_it():
    """Rubin 1981: the density rises without bound where the spread of the schools goes to 0."""
    effect, sd = jnp.array([28.0, 8, -3, 7, -1, 1, 18, 12]), jnp.array([15.0, 10, 16, 11, 9, 11, 10, 18])

    def log_density(values):
        school = jnp.stack([values[f"school_{i}"] for i in range(8)])
        between = jnp.sum(-0.5 * ((school - values["mean"]) / values["spread"]) ** 2 - jnp.log(values["spread"]))
        return between - 0.5 * jnp.sum(((effect - school) / sd) ** 2)

    priors = {f"school_{i}": st.Uniform(-100.0, 100.0) for i in range(8)}
    priors |= {"mean": st.Normal(0.0, 5.0), "spread": st.Uniform(0.0, 50.0)}
    small = st.EvidenceSettings(repeats=2, smc=st.SMCSettings(particles=256))
    found = st.log_evidence(st.posterior_of_density(log_density, priors), key=1, settings=small)
    assert np.isfinite(found.log_value)
    assert found.status != ""
