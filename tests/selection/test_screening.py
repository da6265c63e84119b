from dataclasses import replace

import jax
import numpy as np
import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.selection.rules import TermLibrary, compile_rules, parse_rules
from seatrial.selection.screening import TermPrior, screen, worth
from seatrial.selection.subsets.gram import gram
from seatrial.vehicles.axis_equation import axis_equation
from tests.cases import DEDUCTION, MASS
from tests.estimation.row_cases import SHIP_TRUE, ship_motion, ship_record, surge_record
from tests.estimation_cases import GOLDEN_LOG_EVIDENCE, SIGMA

KEY = jax.random.key(0)
TRIM_SPEED = 1.541861549917
SURGE = ("X_u", "X_uabsu", "T_nabsn", "X_du3")
PRIOR = {
    "X_u": TermPrior(-1.21 / 2, 2.42 / np.sqrt(3)),
    "X_uabsu": TermPrior(-2.93 / 2, 5.86 / np.sqrt(3)),
    "T_nabsn": TermPrior(0.0, 0.01),
    "X_du3": TermPrior(0.0, 50 / np.sqrt(3)),
}


def compiled(library, *lines):
    return compile_rules(library, parse_rules(lines, library))


def library_of(names, signals):
    return TermLibrary(tuple(map(CoefficientName.parse, names)), signals)


@pytest.fixture(scope="module")
def golden():
    rules = compiled(library_of(SURGE, ("u", "n")), "always T_nabsn", "always X_u", "always X_uabsu")
    equations = [axis_equation("X", SURGE, MASS, DEDUCTION, trim={"u": TRIM_SPEED})]
    return screen(equations, rules, [surge_record(1)], {"u": SIGMA}, PRIOR, KEY)


def test_the_papers_pair_is_as_undecided_as_by_simulation(golden):
    """The golden evidences, the uniform prior of X_du3 at its estimate turned into this normal one.

    The rows' estimate of X_du3 lies within about half an sd of that by simulation, 1.5 sd from zero: 0.5 * 1.5 nats either way.
    """
    at = -8.7
    normal = np.exp(-0.5 * (at / PRIOR["X_du3"].sd) ** 2) / (np.sqrt(2 * np.pi) * PRIOR["X_du3"].sd)
    simulated = GOLDEN_LOG_EVIDENCE["M-1"] - GOLDEN_LOG_EVIDENCE["M-0 wide"] - np.log(normal / 0.01)
    by_terms = dict(
        zip((golden.posterior.terms(i) for i in range(2)), golden.posterior.log_evidence.tolist(), strict=True)
    )
    without = next(value for terms, value in by_terms.items() if "X_du3" not in terms)
    within = next(value for terms, value in by_terms.items() if "X_du3" in terms)
    assert without - within == pytest.approx(simulated, abs=0.9)
    assert 0.15 < golden.inclusion["X_du3"] < 0.6


def test_shortlist_is_the_most_probable(golden):
    assert len(golden.shortlist(most=1)) == 1
    both = golden.shortlist(most=8, covered=1.0 - 1e-9)
    assert {frozenset(terms) for terms in both} == {frozenset(SURGE), frozenset(SURGE[:3])}
    assert golden.sensitivity.scales.size == 5
    assert golden.fit.status == ""


def test_the_structure_of_two_axes_is_found_as_records_grow():
    """A linear ship among quadratic, cubic and cross-flow candidates of both axes, shared noise."""
    names = [f"{axis}_{form}" for axis in "YN" for form in ("v", "r", "vabsv", "rabsr", "delta_r")]
    library = library_of(names, ("v", "r", "delta_r"))
    true = {"Y_v", "Y_r", "Y_delta_r", "N_v", "N_r", "N_delta_r"}
    assert true < set(library.names)
    rules = compiled(library)
    equations = [axis_equation(axis, [name for name in library.names if name.startswith(axis)]) for axis in ("Y", "N")]
    prior = {name: TermPrior(0.0, 1.0) for name in library.names}
    chances = []
    for seconds in (20.0, 160.0):
        time = np.arange(0.0, seconds, 0.05)
        states = ship_motion(time) + 0.01 * np.random.default_rng(3).normal(size=(time.size, 2))
        found = screen(equations, rules, [ship_record(time, states)], {"v": 0.01, "r": 0.01}, prior, KEY)
        of_truth = [set(found.posterior.terms(i)) == true for i in range(found.posterior.structures.size)]
        chances.append(float(found.posterior.probability[of_truth].sum()))
    assert chances[0] < chances[1]
    assert chances[1] > 0.5
    assert {name for name, p in zip(found.posterior.names, found.posterior.inclusion, strict=True) if p > 0.5} == true
    averaged = dict(zip(found.posterior.names, found.posterior.coefficients().mean, strict=True))
    order = ("Y_v", "Y_r", "Y_delta_r", "N_v", "N_r", "N_delta_r")
    np.testing.assert_allclose([averaged[name] for name in order], SHIP_TRUE, atol=0.05)


def test_dependent_rows_count_for_what_they_are_worth():
    random = np.random.default_rng(0)
    stats = gram(random.normal(size=(40, 2)), random.normal(size=40))
    half = worth(stats, 20.0)
    assert half.n == 20
    np.testing.assert_allclose(half.matrix, stats.matrix / 2)
    np.testing.assert_array_equal(worth(stats, 80.0).matrix, stats.matrix)


@pytest.mark.parametrize(
    ("most", "covered", "length"),
    [(8, 0.49, 1), (8, 0.51, 2), (8, 0.79, 2), (8, 0.81, 3), (8, 0.98, 4), (8, 0.999, 4), (2, 0.98, 2), (1, 0.1, 1)],
)
def test_a_shortlist_ends_where_it_is_probable_enough(golden, most, covered, length):
    """Structures of probability 0.5, 0.3, 0.15 and 0.04, in that order; the rest are not listed."""
    posterior = replace(
        golden.posterior,
        structures=np.array([0b0111, 0b1111, 0b0011, 0b0001], np.uint64),
        probability=np.array([0.5, 0.3, 0.15, 0.04]),
    )
    found = replace(golden, posterior=posterior).shortlist(most, covered)
    assert found == tuple(golden.posterior.names[:terms] for terms in (3, 4, 2, 1)[:length])
