from dataclasses import replace
from math import comb

import numpy as np
import pytest
from scipy.special import softmax

from seatrial.selection.structure_prior import log_prior_by_size, log_priors
from seatrial.selection.structures import Structure, all_structures, structure_rules
from seatrial.selection.verdict import (
    DECIDED,
    DECISIONS,
    Evidence,
    Shortlist,
    _doubt,
    averaged,
    pair_verdicts,
    select,
    term_verdict,
)

OPTIONAL = ("X_u", "X_uabsu")
STRUCTURES = all_structures(structure_rules(["T_nabsn"], OPTIONAL))
"""Full, without X_u, without X_uabsu, neither."""


def selection(logs, errors=(0.0,) * 4, status=("",) * 4, structure_prior="equal"):
    evidences = [Evidence(z, e, "given", status=s) for z, e, s in zip(logs, errors, status, strict=True)]
    return select(STRUCTURES, evidences, OPTIONAL, structure_prior=structure_prior)


@pytest.mark.parametrize("shift", [0.0, 6951.0, -9e4])
def test_probabilities_are_the_softmax_of_the_log_evidences(shift):
    logs = np.array([-1.0, 0.5, 0.0, -3.0])
    found = selection(logs + shift)
    assert found.probability == pytest.approx(softmax(logs), abs=1e-10)
    assert found.inclusion == pytest.approx({"X_u": softmax(logs)[[0, 2]].sum(), "X_uabsu": softmax(logs)[:2].sum()})
    assert STRUCTURES[found.chosen].terms == ("T_nabsn", "X_uabsu")


def test_by_multiplicity_every_number_of_terms_is_equally_probable():
    """Of none, one and two terms 1/3 each; two structures share that of one."""
    logs = np.array([-1.0, 0.5, 0.0, -3.0])
    found = selection(logs, structure_prior="multiplicity")
    weights = np.exp(logs) * [1 / 3, 1 / 6, 1 / 6, 1 / 3]
    assert found.probability == pytest.approx(weights / weights.sum(), abs=1e-12)
    assert found.inclusion["X_u"] == pytest.approx(found.probability[[0, 2]].sum())
    assert (found.structure_prior, selection(logs).structure_prior) == ("multiplicity", "equal")


@pytest.mark.parametrize("k", [1, 5, 22, 63])
def test_the_prior_by_multiplicity_sums_to_the_same_for_every_number_of_terms(k):
    shares = [comb(k, j) * np.exp(one) for j, one in enumerate(log_prior_by_size("multiplicity", k))]
    assert shares == pytest.approx([1 / (k + 1)] * (k + 1))


def test_a_shortlist_is_of_all_terms_in_question():
    """One and three of five: 1/(6 * 5) and 1/(6 * 10); terms that are always there do not count."""
    optional = ["X_u", "X_u3", "X_0", "T_n", "T_un"]
    shortlist = [Structure("M-0", ("T_nabsn", "X_u")), Structure("M-1", ("T_nabsn", "X_u", "X_u3", "X_0"))]
    assert np.exp(log_priors(shortlist, optional, "multiplicity")) == pytest.approx([1 / 30, 1 / 60])


def test_hopeless_structures_have_no_probability():
    assert selection([0.0, -2000.0, -800.0, -np.inf]).probability.tolist() == [1, 0, 0, 0]


def test_errors_against_brute_force():
    """First order against 200 000 simulated sets of log evidences; the curvature left out is below 3 % here."""
    logs, errors = np.array([0.0, 0.4, -0.7, -0.2]), np.array([0.05, 0.02, 0.08, 0.01])
    found = selection(logs, errors)
    drawn = softmax(logs + errors * np.random.default_rng(0).normal(size=(200_000, 4)), axis=1)
    assert found.probability_error == pytest.approx(drawn.std(axis=0), rel=0.03)
    assert found.inclusion_error == pytest.approx(
        {"X_u": drawn[:, [0, 2]].sum(1).std(), "X_uabsu": drawn[:, :2].sum(1).std()}, rel=0.03
    )


def test_one_structure_is_certain_whatever_its_error():
    found = select(all_structures(structure_rules(["X_u"], [])), [Evidence(3.0, 0.5, "given")], ())
    assert (found.probability.tolist(), found.probability_error.tolist(), found.verdicts) == ([1.0], [0.0], ())


@pytest.mark.parametrize(
    ("inclusion", "words"),
    [
        (0.999, "the data support X_du3: probability 1.00 with it (± 0.01 Monte Carlo)"),
        (0.95, "the data support X_du3: probability 0.95 with it"),
        (0.9499, "the data favour X_du3, but do not settle it: probability 0.95 with it"),
        (0.75, "the data favour X_du3, but do not settle it: probability 0.75 with it"),
        (0.7499, "the data cannot decide about X_du3: probability 0.75 with it, 0.25 without"),
        (0.498, "the data cannot decide about X_du3: probability 0.50 with it, 0.50 without"),
        (0.2501, "the data cannot decide about X_du3: probability 0.25 with it, 0.75 without"),
        (0.25, "the data do not support X_du3: probability 0.75 without it"),
        (0.0, "the data do not support X_du3: probability 1.00 without it (± 0.01 Monte Carlo)"),
    ],
)
def test_words_at_each_threshold(inclusion, words):
    assert term_verdict("X_du3", inclusion, 0.0126).startswith(words)


def test_a_small_error_is_given_as_a_bound():
    assert term_verdict("X_u", 0.999, 0.0049).endswith("probability 1.00 with it (Monte Carlo error below 0.005)")


def test_pair_that_cannot_be_separated():
    """Either term alone explains the data; without both they are inexplicable."""
    found = selection([-3.0, 0.0, 0.0, -50.0])
    assert "cannot separate X_u from X_uabsu: at least one is needed (probability 1.00)" in found.verdicts[2]
    assert "X_u alone 0.49, X_uabsu alone 0.49, both 0.02" in found.verdicts[2]


@pytest.mark.parametrize(
    "logs",
    [[0.0, 0.0, 0.0, 0.0], [0.0, -9.0, -9.0, -9.0], [-9.0, 0.0, -9.0, -50.0], [0.0, 0.0, -9.0, -9.0]],
    ids=["undecided", "both needed", "second needed", "first undecided"],
)
def test_no_pair_verdict_where_the_data_are_clear_or_say_nothing(logs):
    assert len(selection(logs).verdicts) == 2


def test_pairs_are_all_looked_at():
    a, b, c = np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
    said = pair_verdicts({"X_u": a, "X_du3": b, "X_uabsu": c}, np.array([0.5, 0.01, 0.49]))
    assert len(said) == 1
    assert "X_u from X_uabsu" in said[0]


def test_unhealthy_evidence_is_named():
    status = ("", "", "repeats differ by 2.1 nats", "")
    (alarm,) = selection([0.0, 0.1, 0.2, 0.3], status=status).alarms
    assert alarm.startswith(
        "the evidence of M-2 is not reliable: repeats differ by 2.1 nats; a verdict changes if it is wrong by "
    )


def test_unhealthy_evidence_that_decides_nothing_is_no_alarm():
    """It is 500 nats behind, known to 0.8."""
    assert selection([0.0, 0.1, -500.0, 0.3], (0.0, 0.0, 0.8, 0.0), ("", "", "repeats differ", "")).alarms == ()


def test_structures_that_a_screening_left_out_keep_their_probability():
    """Of eight structures two are simulated, with 0.7 of the probability; terms are averaged over all eight."""
    structures = [Structure("M-0", ("X_u", "X_uabsu", "X_0")), Structure("M-1", ("X_u", "X_uabsu"))]
    evidences = [Evidence(0.0, 0.01, "given"), Evidence(2.0, 0.01, "given")]
    optional = ("X_u", "X_uabsu", "X_0", "X_u3")
    chances = {"X_u": 0.93, "X_uabsu": 0.99, "X_0": 0.3, "X_u3": 0.11}
    found = select(structures, evidences, optional, Shortlist(chances, [0.2, 0.5]))
    assert found.probability == pytest.approx(0.7 * softmax([0.0, 2.0]))
    assert found.outside == pytest.approx(0.3)
    assert found.inclusion["X_u"] == pytest.approx(0.93)
    assert found.inclusion["X_u3"] == pytest.approx(0.11)
    assert found.inclusion["X_0"] == pytest.approx(0.7 / (1 + np.exp(2.0)) + 0.3 - 0.2)
    assert found.verdicts[0].startswith("the data favour X_u, but do not settle it: probability 0.93 with it")
    assert found.verdicts[3].startswith("the data do not support X_u3: probability 0.89 without it")
    assert found.verdicts[-1].startswith(
        "2 structures were simulated. The others have a probability of 0.30 by the screening"
    )


@pytest.mark.parametrize("structure_prior", ["equal", "multiplicity"])
def test_a_verdict_changes_where_the_evidence_is_wrong_by_what_is_needed(structure_prior):
    """Each evidence is moved by a little less and a little more than is said, up and down."""
    logs = np.array([0.0, -2.0, 0.5, -6.0])
    known = selection(logs, structure_prior=structure_prior)

    def verdicts(moved):
        one = selection(moved, structure_prior=structure_prior)
        edges = [np.searchsorted(DECISIONS, p) for p in one.inclusion.values()]
        return [*edges, one.probability.max() >= DECIDED, one.chosen]

    for i, needed in enumerate(known.needed):
        within, beyond = (
            [verdicts(logs + sign * share * needed * np.eye(4)[i]) for sign in (-1, 1)] for share in (0.99, 1.01)
        )
        assert [one[:2] for one in within] == [verdicts(logs)[:2]] * 2
        assert any(one != verdicts(logs) for one in beyond)


def doubtful(difference=0.0, error=0.01):
    """An evidence in doubt, the other method of which is so far away."""
    table = {
        "importance": {"difference": 0.0, "status": "", "std_error": 0.01},
        "smc": {"difference": difference, "status": "", "std_error": 0.2},
    }
    return Evidence(0.0, error, "given", {"methods": table}, "in doubt")


def test_doubt_is_the_largest_of_what_may_be_wrong():
    assert _doubt(Evidence(0.0, 0.9, "given")) == 0.0
    assert _doubt(doubtful()) == pytest.approx(0.6, rel=0.01)
    assert _doubt(doubtful(-4.6)) == 4.6
    assert _doubt(doubtful(np.inf)) == 3.0
    assert _doubt(doubtful(error=0.7)) == pytest.approx(7.0)
    assert _doubt(Evidence(0.0, 0.01, "given", status="repeats differ")) == 3.0


def test_a_verdict_that_hangs_on_a_doubtful_evidence_is_withheld():
    """X_u leads by 4 nats; 4.6 less, and it does not. Where it leads by 20, nothing hangs on it."""
    structures = [Structure("M-0", ("X_u", "X_uabsu")), Structure("M-1", ("X_uabsu",))]
    reached = softmax([4.0 - 4.6, 0.0])[0]
    certain = Evidence(4.0, 0.01, "given")
    shaken, sure, plain = (
        select(structures, [leading, Evidence(0.0, 0.01, "given")], ("X_u",))
        for leading in (*(replace(doubtful(-4.6), log_value=lead) for lead in (4.0, 20.0)), certain)
    )
    assert [found.is_settled for found in (shaken, sure, plain)] == [False, True, True]
    assert [found.undecided == {} for found in (shaken, sure, plain)] == [False, True, True]
    assert plain.verdicts[0].startswith("the data support X_u")
    assert shaken.verdicts[0] == (
        "no verdict about X_u yet: its probability of 0.98 depends on an evidence that is not reliable, "
        f"and may be from {reached:.2f} to 1.00"
    )
    assert len(shaken.alarms) == 1
    assert sure.verdicts[0].startswith("the data support X_u: probability 1.00")
    assert sure.alarms == ()


@pytest.mark.parametrize(
    ("both", "only_a", "only_b", "said"),
    [
        (0.0, 0.5, 0.46, True),
        (0.0, 0.5, 0.44, False),
        (0.5, 0.41, 0.06, True),
        (0.5, 0.43, 0.04, False),
        (0.89, 0.055, 0.055, True),
        (0.9, 0.055, 0.045, False),
        (0.9, 0.045, 0.055, False),
    ],
)
def test_pairs_are_inseparable_where_one_is_needed_and_neither_alone_is(both, only_a, only_b, said):
    """At least one with 0.95, each with less than 0.95, and each alone with more than 0.05."""
    a, b = np.array([1.0, 1, 0, 0]), np.array([1.0, 0, 1, 0])
    chance = np.array([both, only_a, only_b, 1 - both - only_a - only_b])
    assert len(pair_verdicts({"X_u": a, "X_uabsu": b}, chance)) == said


@pytest.mark.parametrize(
    ("inclusion", "error", "noisy"),
    [
        (0.85, 0.051, True),
        (0.85, 0.049, False),
        (0.645, 0.051, False),
        (0.655, 0.051, True),
        (0.155, 0.051, True),
        (0.345, 0.051, True),
        (0.36, 0.051, False),
        (0.5, 0.124, False),
        (0.5, 0.126, True),
        (0.9, 0.2, True),
    ],
)
def test_noise_counts_within_two_errors_of_an_edge(inclusion, error, noisy):
    assert ("too noisy" in term_verdict("X_u", inclusion, error)) == noisy


@pytest.mark.parametrize(("lead", "alarms"), [(3.0 + 2.9, True), (3.0 + 3.0, False)])
def test_an_evidence_in_doubt_alarms_where_it_may_change_a_verdict(lead, alarms):
    """Three nats at least may be wrong: 2.94 nats behind after that is a probability of 5 %."""
    found = selection([0.0, -np.inf, -np.inf, -lead], status=("", "", "", "repeats differ"))
    assert bool(found.alarms) == alarms


def test_an_average_over_structures_has_the_moments_of_the_mixture():
    """Two normal distributions and a point at zero, drawn two hundred thousand times; to four standard errors."""
    share, random, n = np.array([0.5, 0.3, 0.2]), np.random.default_rng(4), 200_000
    moments = [
        {"X_u": (-1.0, 0.2), "T_nabsn": (3.0, 0.1)},
        {"X_u": (-2.0, 0.1), "T_nabsn": (3.0, 0.1)},
        {"T_nabsn": (3.0, 0.1)},
    ]
    which = random.choice(3, n, p=share)
    drawn = np.where(which == 2, 0.0, random.normal([-1.0, -2.0, 0.0], [0.2, 0.1, 0.0], (n, 3))[np.arange(n), which])
    found = averaged(moments, share)
    assert found["X_u"][0] == pytest.approx(drawn.mean(), abs=4 * drawn.std() / n**0.5)
    assert found["X_u"][1] == pytest.approx(drawn.std(), abs=4 * drawn.std() / n**0.5)
    assert found["T_nabsn"] == pytest.approx((3.0, 0.1))
