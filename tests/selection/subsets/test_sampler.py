"""Sampled posteriors over structures against the exact ones."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.selection.rule_masks import RuleMasks, _bit_numbers, count_allowed
from seatrial.selection.structure_prior import log_prior_by_size
from seatrial.selection.subsets import sampler, structure_chains
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.conjugate import GPrior, physical_prior
from seatrial.selection.subsets.gram import gram
from seatrial.selection.subsets.sampler import (
    MAX_PRESENCE_R_HAT,
    StructureSums,
    _look,
    _status,
    half_of,
    presence_r_hat,
    sample_subsets,
    subset_posterior,
)
from seatrial.selection.subsets.structure_chains import HOTTEST_SPREAD, RUNG_RATIO, _alike, _partners, rungs_between
from tests.selection.subsets.naive import NAMES, problem, some_prior

RULES = RuleMasks(parents=(0, 0b1, 0, 0b10000000, 0, 0, 0, 0, 0b11), groups=(0b110000,), exclusive=(0b1001100,))
SHORT = {"chains": 32, "moves": 500}
MANY = [f"t{i}" for i in range(64)]


def agrees(found, exact, share_of_covered=1.0):
    """Everything within 4.5 standard errors; what chains of this length hardly ever see shifts a mean by less than 0.02 sd."""
    errors = found.monte_carlo
    assert errors.status == ""
    assert errors.covered > share_of_covered - 1e-3
    off = np.abs(found.inclusion - exact.inclusion)
    assert (off < 4.5 * errors.inclusion_error + 1e-5).all()
    assert (np.abs(errors.renormalised - exact.inclusion) < 1 - errors.covered + 1e-3).all()
    sd = exact.coefficients().total
    assert (np.abs(found.mean - exact.mean) < 4.5 * errors.mean_error + 0.02 * sd).all()
    often = exact.inclusion > 0.03
    np.testing.assert_allclose(found.coefficients().total[often], sd[often], rtol=0.3)
    assert np.abs(found.joint - exact.joint).max() < 0.04
    assert found.count == exact.count
    np.testing.assert_array_equal(found.structures[:10], exact.structures[:10])
    np.testing.assert_allclose(found.log_evidence[:10], exact.log_evidence[:10], atol=1e-8)
    np.testing.assert_allclose(found.probability[:10], exact.probability[:10], rtol=0.01)


@pytest.mark.parametrize(
    ("prior", "options"),
    [
        (some_prior(10), {}),
        (GPrior(40.0, 2.0, 0.7), {"always": ["c", "e"]}),
        (some_prior(10, 0.3 / np.geomspace(0.1, 10, 10)), {"rules": RULES}),
        (some_prior(10), {"rules": RULES, "always": ["f"]}),
        (some_prior(10), {"log_prior": log_prior_by_size("multiplicity", 10)}),
        (some_prior(10), {"rules": RULES, "always": ["f"], "log_prior": log_prior_by_size("multiplicity", 9)}),
    ],
    ids=["free", "g-prior", "rules", "rules, certain term", "multiplicity", "multiplicity, rules, certain term"],
)
def test_against_all_structures(prior, options):
    stats = problem(10)[2]
    exact = all_subsets(stats, prior, NAMES[:10], **options)
    found = sample_subsets(stats, prior, NAMES[:10], **options, **SHORT)
    agrees(found, exact)
    assert options.get("rules", RuleMasks()).allowed(found.structures).all()


def test_a_collinear_pair_is_swapped():
    """One of two regressors of correlation 0.9998 is needed, and either does."""
    random = np.random.default_rng(4)
    phi = random.normal(size=(80, 11))
    phi[:, 7] = phi[:, 2] + 0.02 * random.normal(size=80)
    stats, prior = gram(phi, phi[:, 2] + random.normal(size=80)), physical_prior(np.ones(11), 1.0)
    exact = all_subsets(stats, prior, NAMES[:11])
    assert 0.2 < exact.inclusion[2] < 0.8
    assert 0.2 < exact.inclusion[7] < 0.8
    agrees(sample_subsets(stats, prior, NAMES[:11], **SHORT), exact)


@pytest.mark.proof
@pytest.mark.parametrize("rules", [None, RULES])
def test_twenty_terms_against_all_structures(rules):
    stats = problem(20, n=60, strength=1.0)[2]
    exact = all_subsets(stats, some_prior(20), NAMES[:20], rules=rules)
    agrees(sample_subsets(stats, some_prior(20), NAMES[:20], rules=rules), exact, 0.95)


@pytest.mark.proof
def test_stated_errors_are_the_spread_of_repeats(monkeypatch):
    """With all covered, the stated variance is s^2 of the chains plus the error e^2 itself: e^2 / (s^2 + e^2), e normal, has mean 0.344."""
    monkeypatch.setattr(sampler, "MIN_HELD_PROBABILITY", 2.0)
    stats, prior = problem(11)[2], some_prior(11)
    exact = all_subsets(stats, prior, NAMES[:11]).inclusion
    runs = [sample_subsets(stats, prior, NAMES[:11], seed=seed, chains=16, moves=400) for seed in range(8)]
    score = np.array([(run.inclusion - exact) / run.monte_carlo.inclusion_error for run in runs])
    assert 0.22 < np.mean(score**2) < 0.47


def test_the_same_seed_gives_the_same_numbers():
    stats, prior = problem(6)[2], some_prior(6)
    one, two, other = (sample_subsets(stats, prior, NAMES[:6], seed=seed, chains=8, moves=400) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.joint, two.joint)
    assert (one.joint != other.joint).any()


def test_one_entry_point_counts_or_samples():
    names, random = MANY[:28], np.random.default_rng(0)
    phi = random.normal(size=(200, 28))
    stats = gram(phi, phi[:, 3] - phi[:, 20] + random.normal(size=200))
    prior = physical_prior(np.ones(28), 1.0)
    options = {"seed": 3, "chains": 16, "moves": 600, "threads": 1}
    sampled = subset_posterior(stats, prior, names, **options)
    assert sampled.monte_carlo is not None
    assert sampled.count == 2**28
    assert {"t3", "t20"} <= set(sampled.terms(0))
    exact = subset_posterior(stats, prior, names, always=names[:16], **options)
    assert exact.monte_carlo is None
    assert exact.count == 2**12


def two_valleys():
    """Two quadruples of terms make nearly the same response, and no move of three terms leads over without a valley."""
    random = np.random.default_rng(1)
    phi = random.normal(size=(400, 8))
    mix = np.array([[1.0, 2.0, 1.0, -1.0], [2.0, -1.0, 1.0, 1.0], [1.0, 1.0, -2.0, 1.0], [-1.0, 1.0, 1.0, 2.0]])
    phi[:, 4:] = phi[:, :4] @ mix + 0.001 * random.normal(size=(400, 4))
    stats = gram(phi, phi[:, :4] @ np.ones(4) + 0.01 * random.normal(size=400))
    rules = RuleMasks(groups=(0b1111,), exclusive=tuple(1 << i | 1 << j for i, j in product(range(4), range(4, 8))))
    return stats, physical_prior(np.ones(8), 0.01), NAMES[:8], rules


@pytest.mark.proof
def test_ladders_lead_over_a_valley(monkeypatch):
    """By the visits alone, of which averages over the best structures would make nothing."""
    monkeypatch.setattr(sampler, "MIN_HELD_PROBABILITY", 2.0)
    stats, prior, names, rules = two_valleys()
    found = sample_subsets(stats, prior, names, rules=rules, chains=32, moves=800)
    assert found.monte_carlo.status == ""
    exact = all_subsets(stats, prior, names, rules=rules).inclusion
    np.testing.assert_allclose(found.inclusion, exact, atol=4.5 * found.monte_carlo.inclusion_error.max() + 1e-3)
    assert found.monte_carlo.inclusion_error.max() < 0.02


def test_chains_that_stay_apart_are_reported(monkeypatch):
    monkeypatch.setattr(sampler, "MIN_HELD_PROBABILITY", 2.0)
    monkeypatch.setattr(structure_chains, "HOTTEST_SPREAD", 1e9)
    stats, prior, names, rules = two_valleys()
    found = sample_subsets(stats, prior, names, rules=rules, chains=16, moves=400)
    assert "the chains disagree about" in found.monte_carlo.status
    assert found.monte_carlo.r_hat.max() > 1.4


def test_many_rows_and_rival_regressors_against_all_structures():
    """Evidences some thousands of nats apart: 2000 rows of little noise, of which no structure is quite the truth."""
    random = np.random.default_rng(2)
    u, r = 1 + 0.3 * random.normal(size=2000), 0.5 * random.normal(size=2000)
    powers = [u**i * r**j for i, j in ((0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1), (0, 3), (1, 3))]
    moduli = [u * np.abs(r), np.abs(r) * r, np.abs(r) * r * u, np.abs(r) ** 1.5]
    stats = gram(np.column_stack(powers + moduli), u**2 * np.tanh(2 * r) + np.exp(-u) + 1e-3 * random.normal(size=2000))
    prior, names = physical_prior(np.full(13, 3.0), 0.01), MANY[:13]
    exact = all_subsets(stats, prior, names)
    found = sample_subsets(stats, prior, names, **SHORT)
    assert found.monte_carlo.status == ""
    np.testing.assert_allclose(found.inclusion, exact.inclusion, atol=1e-6)
    np.testing.assert_allclose(found.mean, exact.mean, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(np.diag(found.within), np.diag(exact.within), rtol=1e-4)
    assert found.probability[0] == pytest.approx(exact.probability[0], rel=0.05)


@pytest.mark.parametrize("sure", [[], [3], [4], [0, 6]])
def test_allowed_structures_against_enumeration(sure):
    there = np.array(list(product([0, 1], repeat=9)), bool)
    kept = RULES.allowed(there @ (1 << np.arange(9))) & there[:, sure].all(1)
    assert count_allowed(RULES, sure, 9) == kept.sum()


def test_too_many_terms():
    phi = np.random.default_rng(0).normal(size=(100, 64))
    with pytest.raises(InputError, match=r"64 terms(.|\n)*at most 63"):
        subset_posterior(gram(phi, phi[:, 0]), physical_prior(np.ones(64), 1.0), MANY)


def test_r_hat_of_presence_by_a_naive_twin():
    """Shares of the moves in which a term was there, in the halves of two chains, and the variances within and between them."""
    moves, presence = 80, np.array([[[10.0, 20.0], [12.0, 20.0]], [[30.0, 40.0], [4.0, 40.0]]])
    lengths = np.array([half_of(moves) - moves // 4, moves - half_of(moves)])
    shares = [presence[half, chain, 0] / lengths[half] for half in (0, 1) for chain in (0, 1)]
    within = sum(share * (1 - share) for share in shares) / 4
    between = sum((share - sum(shares) / 4) ** 2 for share in shares) / 3
    assert presence_r_hat(presence, moves)[0] == pytest.approx(np.sqrt(1 + between / within), rel=1e-12)
    always = np.broadcast_to(lengths[:, None, None], (2, 2, 1)).astype(float)
    assert presence_r_hat(always, moves) == [1.0]


def test_likeness_is_the_squared_cosine_of_regressors():
    random = np.random.default_rng(3)
    phi = random.normal(size=(30, 3)) * np.array([1.0, 50.0, 0.01])
    cosines = [
        [(phi[:, i] @ phi[:, j]) ** 2 / (phi[:, i] @ phi[:, i]) / (phi[:, j] @ phi[:, j]) for j in range(3)]
        for i in range(3)
    ]
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = phi.T @ phi
    matrix[3, 3] = 1.0
    alike = _alike(SimpleNamespace(matrix=matrix), np.array([[0], [1], [2]]))
    assert alike == pytest.approx(np.array(cosines), rel=1e-12)
    pair = _alike(SimpleNamespace(matrix=matrix), np.array([[0, 3], [1, 2]]))
    assert pair[0, 1] == pytest.approx(max(cosines[0][1], cosines[0][2]), rel=1e-12)


def test_rules_term_by_term_by_a_naive_twin():
    """What each of nine terms wants and cannot stand, in sets: parents, the others of a group, and rivals."""
    wants, wanting, rivals = RULES.links(9)
    assert (len(wants), len(wanting), len(rivals)) == (9, 9, 9)
    for i in range(9):
        parents = set(_bit_numbers(RULES.parents[i])) if i < len(RULES.parents) else set()
        group = {j for g in RULES.groups for j in _bit_numbers(g) if i in _bit_numbers(g)}
        rival = {j for e in RULES.exclusive for j in _bit_numbers(e) if i in _bit_numbers(e)}
        assert set(_bit_numbers(wants[i])) == (parents | group) - {i}
        assert set(_bit_numbers(rivals[i])) == rival - {i}
        assert set(_bit_numbers(wanting[i])) == {j for j in range(9) if wants[j] >> i & 1}
    assert RuleMasks().links(3) == ([0, 0, 0],) * 3
    chain = RuleMasks(parents=(0, 0b1, 0b10, 0, 0b1000), exclusive=(0b11000,)).links(5)
    assert chain.decided(0b100) == (0b111, 0)
    assert chain.decided(0b10000) == (0b11000, 0b11000)
    assert chain.decided(0, 0b1) == (0, 0b111)


@pytest.mark.parametrize(("chains", "rungs"), [(4, 1), (8, 1), (4, 3), (32, 3)])
def test_few_chains_or_ladders_hold_all_of_sixty_four_structures(monkeypatch, chains, rungs):
    monkeypatch.setattr(sampler, "rungs_between", lambda *_: rungs)
    stats, prior = problem(6)[2], some_prior(6)
    found = sample_subsets(stats, prior, NAMES[:6], chains=chains, moves=400).monte_carlo
    assert 0.999 < found.covered <= 1.0
    for errors in (found.inclusion_error, found.mean_error):
        assert (errors >= 0).all()
        assert (errors < 1e-3).all()


def test_rungs_grow_until_the_hottest_hardly_tells_structures_apart():
    """Each is hotter by one factor; across the hottest, log evidences differ by no more than counts as alike."""
    for apart in (
        0.0,
        0.5 * HOTTEST_SPREAD,
        HOTTEST_SPREAD,
        1.01 * HOTTEST_SPREAD,
        RUNG_RATIO * HOTTEST_SPREAD * 0.99,
        RUNG_RATIO * HOTTEST_SPREAD * 1.01,
        1e4 * HOTTEST_SPREAD,
    ):
        needed = next(n for n in range(1, 99) if apart / RUNG_RATIO ** (n - 1) <= HOTTEST_SPREAD)
        assert rungs_between(-7.0, apart - 7.0) == needed


@pytest.mark.parametrize(("count", "always", "drawn"), [(25, 0, False), (26, 0, True), (40, 15, False), (40, 14, True)])
def test_up_to_25_optional_terms_are_counted_out(monkeypatch, count, always, drawn):
    monkeypatch.setattr(sampler, "all_subsets", lambda *_, **__: False)
    monkeypatch.setattr(sampler, "sample_subsets", lambda *_, **__: True)
    stats, names = gram(np.eye(3), np.ones(3)), MANY[:count]
    assert subset_posterior(stats, some_prior(count), names, always=names[:always]) == drawn


@pytest.mark.parametrize(
    ("inclusion", "r_hat", "error", "covered", "said"),
    [
        (0.5, 1.0, 0.0, 1.0, ""),
        (0.5, MAX_PRESENCE_R_HAT + 0.001, 0.0, 1.0, "the chains disagree about b"),
        (0.5, MAX_PRESENCE_R_HAT - 0.001, 0.0, 1.0, ""),
        (0.511, 1.0, 0.0, 1.0, "the probabilities of b by visits and by evidences differ by up to 0.011"),
        (0.489, 1.0, 0.0, 1.0, "differ by up to 0.011"),
        (0.509, 1.0, 0.0, 1.0, ""),
        (0.559, 1.0, 0.01, 1.0, ""),
        (0.561, 1.0, 0.01, 1.0, "differ by up to 0.061"),
        (0.609, 1.0, 0.0, 0.9, ""),
        (0.611, 1.0, 0.0, 0.9, "differ by up to 0.111"),
    ],
)
def test_what_is_wrong_with_the_chains_is_said(inclusion, r_hat, error, covered, said):
    """Beyond five errors, what was not evaluated and one hundredth."""
    errors = {"r_hat": np.array([1.0, r_hat]), "inclusion_error": np.array([0.0, error])}
    found = _status(("a", "b"), np.array([0.3, inclusion]), np.array([0.3, 0.5]), covered, errors)
    assert said in found
    assert bool(found) == bool(said)


def test_averages_over_the_best_are_off_by_what_the_rest_may_hold(monkeypatch):
    """The rest has the probability that the best leave, and coefficients of their root mean square."""
    monkeypatch.setattr(sampler, "MIN_HELD_PROBABILITY", 0.0)
    monkeypatch.setattr(sampler, "BEST_COUNT", 10)
    found = sample_subsets(problem(10)[2], some_prior(10), NAMES[:10], **SHORT)
    rest = 1 - found.probability[:10].sum()
    assert 0.05 < rest < 0.95
    assert found.monte_carlo.inclusion_error == pytest.approx(np.full(10, rest), rel=1e-4)
    square = np.diag(found.within + found.between) + found.mean**2
    assert found.monte_carlo.mean_error == pytest.approx(rest * np.sqrt(square), rel=1e-4)
    best, weight = found.structures[:10], found.probability[:10] / found.probability[:10].sum()
    there = best[:, None] >> np.arange(10, dtype=np.uint64) & np.uint64(1)
    assert found.inclusion == pytest.approx(weight @ there, rel=1e-4)


def test_errors_of_visits_are_no_less_than_what_the_evidences_say_and_the_rest_cannot_explain(monkeypatch):
    monkeypatch.setattr(sampler, "MIN_HELD_PROBABILITY", 2.0)
    found = sample_subsets(problem(10)[2], some_prior(10), NAMES[:10], **SHORT)
    errors = found.monte_carlo
    apart = np.abs(found.inclusion - errors.renormalised) - (1 - errors.covered)
    assert (errors.inclusion_error >= apart).all()
    assert (apart > 0).any()


def test_a_look_adds_the_means_of_the_terms_that_are_there():
    """By a loop over chains and terms: only cold chains count, and the mean stands in the last column of a swept matrix."""
    rng, cold = np.random.default_rng(2), np.array([0, 2, 3])
    walkers = SimpleNamespace(matrix=rng.normal(size=(4, 6, 6)), cold=cold)
    there = (rng.uniform(size=(3, 5)) < 0.5).astype(float)
    sums = StructureSums(np.zeros((5, 5)), np.zeros((6, 6)), np.zeros((5, 5)), np.zeros(1))
    seen = SimpleNamespace(mean=np.ones((3, 5)), sums=sums)
    _look(walkers, there, seen)
    expected = [[1.0 + walkers.matrix[chain, i, 5] * there[j, i] for i in range(5)] for j, chain in enumerate(cold)]
    np.testing.assert_allclose(seen.mean, expected)
    np.testing.assert_allclose(seen.sums.pairs, sum(np.outer(row, row) for row in there))


def test_partners_are_drawn_half_evenly_and_half_by_resemblance_or_rules():
    """Cumulative, up to one for any other unit and none for itself; a single unit has nobody to change with."""
    alike = np.array([[1.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 1.0]])
    shared = np.array([[False, False, True], [False, False, False], [True, False, False]])
    near = np.array([[0.0, 0.3, 1.0], [0.3, 0.0, 0.2], [1.0, 0.2, 0.0]])
    chance = 0.25 * (1 - np.eye(3)) + 0.5 * near / near.sum(1, keepdims=True)
    expected = np.column_stack([chance[:, 0], chance[:, :2].sum(1), np.ones(3), np.ones(3)])
    np.testing.assert_allclose(_partners(alike, shared), expected, atol=1e-8)
    np.testing.assert_array_equal(_partners(np.ones((1, 1)), np.zeros((1, 1), bool)), [[0.0, 1.0]])
