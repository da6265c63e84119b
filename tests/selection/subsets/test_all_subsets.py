import numpy as np
import pytest
from scipy.special import betaln

import seatrial.selection.subsets.all_subsets as engine
from seatrial.core.errors import InputError, NumericalError
from seatrial.selection.rule_masks import RuleMasks
from seatrial.selection.screening import sensitivity
from seatrial.selection.structure_prior import log_prior_by_size
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.conjugate import GPrior, evidence_of, physical_prior, unit_information
from seatrial.selection.subsets.gram import gram
from tests.selection.subsets.naive import NAMES, agree, naive_all, problem, some_prior


@pytest.fixture
def small_blocks(monkeypatch):
    """Several prefixes and several blocks already at eight terms."""
    monkeypatch.setattr(engine, "BLOCK_LEVELS", 3)
    monkeypatch.setattr(engine, "BLOCK_LANES", 4)


@pytest.mark.parametrize(
    "prior", [some_prior(8), some_prior(8, np.linspace(-1, 1, 8)), GPrior(40.0, 2.0, 0.7)], ids=str
)
def test_all_structures_against_the_naive_twin(prior):
    phi, y, stats = problem(8)
    agree(all_subsets(stats, prior, NAMES[:8]), naive_all(prior, phi, y))


@pytest.mark.parametrize("k", [1, 2, 5])
def test_few_terms(k):
    phi, y, stats = problem(k)
    agree(all_subsets(stats, some_prior(k), NAMES[:k]), naive_all(some_prior(k), phi, y))


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("prior", [some_prior(8, np.linspace(-1, 1, 8)), GPrior(40.0, 2.0, 0.7)], ids=str)
def test_prefixes_and_certain_terms(prior):
    phi, y, stats = problem(8)
    for always in ((), (2,), (1, 6)):
        found = all_subsets(stats, prior, NAMES[:8], always=[NAMES[i] for i in always])
        agree(found, naive_all(prior, phi, y, always))


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("always", [(), (1, 6)], ids=str)
def test_structures_of_another_prior_against_the_naive_twin(always):
    """Their log evidences are without it; the third term requires the first two."""
    phi, y, stats = problem(8, strength=0.1)
    k = 8 - len(always)
    prior, rules = some_prior(8), RuleMasks(parents=(0, 0, 0b11))
    options = {"always": [NAMES[i] for i in always], "rules": rules}
    found = all_subsets(stats, prior, NAMES[:8], log_prior=log_prior_by_size("multiplicity", k), **options)

    def log_prior(there):
        return betaln(there.sum() - len(always) + 1, 8 - there.sum() + 1)

    agree(found, naive_all(prior, phi, y, always, lambda there: not there[2] or there[:2].all(), log_prior))
    equal = all_subsets(stats, prior, NAMES[:8], log_prior=log_prior_by_size("equal", k), **options)
    np.testing.assert_array_equal(equal.joint, all_subsets(stats, prior, NAMES[:8], **options).joint)
    assert np.abs(equal.inclusion - found.inclusion).max() > 0.01


@pytest.mark.parametrize("by", ["equal", "multiplicity"])
def test_where_the_data_say_nothing_the_prior_stays(by):
    """Of 22 terms: the mean number and the mean square of a binomial, or of a uniform number."""
    k = 22
    stats = gram(1e-9 * problem(k)[0], np.random.default_rng(1).normal(size=40))
    names = tuple(f"t{i}" for i in range(k))
    found = all_subsets(stats, physical_prior(np.full(k, 1e-9), 1.0), names, log_prior=log_prior_by_size(by, k))
    square = 11**2 + {"equal": k / 4, "multiplicity": k * (k + 2) / 12}[by]
    assert found.inclusion.sum() == pytest.approx(11)
    assert found.joint.sum() == pytest.approx(square)


def test_a_prior_for_another_number_of_terms_is_refused():
    _, _, stats = problem(4)
    with pytest.raises(InputError, match=r'log_prior_by_size\("multiplicity", 3\)'):
        all_subsets(stats, some_prior(4), NAMES[:4], always=["a"], log_prior=np.zeros(5))


def test_threads_change_nothing():
    _, _, stats = problem(18, n=60, strength=2.0)
    one, two = (all_subsets(stats, some_prior(18), NAMES[:18], threads=n) for n in (1, 2))
    for name in ("structures", "probability", "joint", "mean", "within", "between"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_order_of_the_terms_does_not_matter_beyond_a_block():
    """Sixteen terms forwards and backwards: other prefixes, other blocks, blocks left out or not."""
    phi, y, stats = problem(16, n=80, strength=3.0)
    one = all_subsets(stats, some_prior(16), NAMES[:16], top=300)
    prior = some_prior(16)
    turned = type(prior)(prior.precision[::-1], prior.shape, prior.rate)
    two = all_subsets(gram(phi[:, ::-1], y), turned, NAMES[:16][::-1], top=300)
    np.testing.assert_allclose(one.probability, two.probability, rtol=1e-9)
    assert [set(one.terms(i)) for i in range(50)] == [set(two.terms(i)) for i in range(50)]
    np.testing.assert_allclose(one.joint, two.joint[::-1, ::-1], atol=1e-11)
    np.testing.assert_allclose(one.coefficients().total, two.coefficients().total[::-1], rtol=1e-9)
    for rank in (0, 7, 299):
        assert abs(evidence_of(stats, prior, one.numbers(rank)).log_evidence - one.log_evidence[rank]) < 1e-9
    assert one.probability.sum() < 1
    assert all_subsets(stats, prior, NAMES[:16], top=1).structures.size == 1
    assert (np.diff(one.probability) <= 0).all()


RULES = {
    "parents": RuleMasks(parents=(0, 0, 0b11, 0b1, 0, 0b1000100, 0b1)),
    "groups": RuleMasks(groups=(0b110, 0b1110000)),
    "exclusive": RuleMasks(exclusive=(0b1010100, 0b11)),
    "all": RuleMasks(parents=(0, 0b1, 0, 0b10000000), groups=(0b110000,), exclusive=(0b1001100,)),
}


@pytest.mark.usefixtures("small_blocks")
def test_blocks_left_out_do_not_count():
    """Without the third term, on which blocks differ, structures are hundreds of nats worse."""
    phi, y, stats = problem(8, strength=300.0)
    agree(all_subsets(stats, some_prior(8), NAMES[:8]), naive_all(some_prior(8), phi, y), 1e-9)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("which", RULES)
@pytest.mark.parametrize("always", [(), (3,)])
def test_rules_against_brute_force(which, always):
    rules, (phi, y, stats), prior = RULES[which], problem(8), some_prior(8)
    found = all_subsets(stats, prior, NAMES[:8], always=[NAMES[i] for i in always], rules=rules)
    naive = naive_all(prior, phi, y, always, lambda there: _keeps(rules, set(np.flatnonzero(there))))
    agree(found, naive)
    assert rules.allowed(found.structures).all()
    everything = np.arange(2**8)
    assert rules.allowed(everything).tolist() == [_keeps(rules, _members(number)) for number in everything]


def test_terms_are_recovered_and_named():
    _, _, stats = problem(12, n=400, strength=3.0)
    found = all_subsets(stats, unit_information(stats, 1.0), NAMES[:12])
    assert found.terms(0) == ("a", "b", "c")
    assert (found.inclusion[:3] > 0.99).all()
    assert found.count == 4096


def test_prior_scale_decides():
    """A wider prior costs each term the log of the factor (Lindley): few terms in the end, and the pair follows."""
    stats, prior = problem(6)[2], some_prior(6)
    found = sensitivity(stats, prior, NAMES[:6], (0.01, 1.0, 1e6))
    base = all_subsets(stats, prior, NAMES[:6])
    np.testing.assert_allclose(found.inclusion[1], base.inclusion)
    assert abs(found.log_bayes_factor[1] - (base.log_evidence[0] - base.log_evidence[1])) < 1e-10
    assert found.inclusion[2].sum() < 0.01 < found.inclusion[1].sum()
    pair = [[base.numbers(i) for i in (0, 1)], prior.scaled(0.01)]
    expected = np.subtract(*(evidence_of(stats, pair[1], terms).log_evidence for terms in pair[0]))
    assert abs(found.log_bayes_factor[0] - expected) < 1e-12


def _members(number):
    return {i for i in range(8) if number >> i & 1}


def _keeps(rules, there):
    """The rules in words of sets."""
    parents = all(_members(rules.parents[i]) <= there for i in there if i < len(rules.parents))
    groups = all(_members(g) & there in (set(), _members(g)) for g in rules.groups)
    return parents and groups and all(len(_members(e) & there) <= 1 for e in rules.exclusive)


def _spoilt(how):
    phi, y, _ = problem(4)
    if how == "pair":
        phi[:, 3] = -2 * phi[:, 1]
    elif how == "constants":
        phi[:, 1], phi[:, 2] = 2.0, 0.3
    elif how == "zero":
        phi[:, 2] = 0
    elif how == "three":
        phi[:, 3] = phi[:, 0] / 0.1 + phi[:, 1] / 0.5
    elif how == "few":
        phi, y = phi[:3], y[:3]
    return gram(phi, y)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("pair", "b and d are proportional.*-1.0000000000"),
        ("constants", "b and c are proportional.*1.0000000000"),
        ("zero", "c is zero throughout"),
        ("three", "a combination of the regressors of a, b, d vanishes"),
        ("few", "3 measurements for 4 terms"),
    ],
)
def test_data_that_cannot_tell(how, said):
    with pytest.raises(InputError, match=said):
        all_subsets(_spoilt(how), some_prior(4), NAMES[:4])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rules": RuleMasks(exclusive=(0b11,)), "always": ["a", "b"]}, "no structure that keeps them all"),
        ({"rules": RuleMasks(parents=(0b10,), exclusive=(0b11,)), "always": ["a"]}, "no structure that keeps them all"),
    ],
)
def test_bad_question(options, said):
    with pytest.raises(InputError, match=said):
        all_subsets(problem(4)[2], some_prior(4), NAMES[:4], **options)


def test_numbers_out_of_range():
    phi, _, stats = problem(4)
    with pytest.raises(NumericalError, match="more than a number can represent"):
        all_subsets(stats, some_prior(4).scaled(1e100), NAMES[:4])
    with pytest.raises(NumericalError, match="fits the response exactly"):
        all_subsets(gram(phi, phi @ np.ones(4) * 1e9), GPrior(1e30, 2.0, 1e-30), NAMES[:4])
