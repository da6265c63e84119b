"""Rules: read from text, compiled to masks that say what the sentences say, counted, and refused where they contradict."""

from itertools import permutations, product

import numpy as np
import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.selection.rules import (
    Always,
    AtMostOne,
    Never,
    Requires,
    TermLibrary,
    Together,
    compile_rules,
    heredity,
    parse_rules,
)
from seatrial.selection.structures import count_structures


def library_of(names, signals):
    return TermLibrary(tuple(map(CoefficientName.parse, names)), signals)


def lateral_terms(axis, velocities):
    """Linear, quadratic, cubic and cross-flow terms, lift, and the rudder."""
    pairs = list(permutations(velocities, 2))
    forms = [*velocities, *(f"{s}abs{s}" for s in velocities), *(f"{s}3" for s in velocities)]
    forms += [*(f"{s}{s}{t}" for s, t in pairs), *(f"{s}abs{t}" for s, t in pairs), *(f"u{s}" for s in velocities)]
    return [f"{axis}_{form}" for form in (*forms, "uudelta_r", "udelta_r", "delta_r")]


LIBRARY = library_of(lateral_terms("N", "rv"), ("u", "v", "r", "delta_r"))
SHORT = TermLibrary(
    tuple(term for term in LIBRARY.terms if term.text not in ("N_vabsv", "N_vabsr", "N_udelta_r")), LIBRARY.signals
)
LINES = {
    "N_ur requires N_r": Requires("N_ur", ("N_r",)),
    "N_rabsv requires N_r and N_v": Requires("N_rabsv", ("N_r", "N_v")),
    "N_absvr requires N_r, N_v  # another spelling of N_rabsv": Requires("N_rabsv", ("N_r", "N_v")),
    "always N_delta_r": Always("N_delta_r"),
    "never N_v3": Never("N_v3"),
    "together N_rrv N_vvr": Together(("N_rrv", "N_vvr")),
    "at most one of N_rabsr N_r3": AtMostOne(("N_rabsr", "N_r3")),
}


def keeps(rule, terms):
    """What the sentence says, in words of sets."""
    match rule:
        case Requires(term, parents):
            return term not in terms or set(parents) <= terms
        case Always(term):
            return term in terms
        case Never(term):
            return term not in terms
        case Together(some):
            return len(set(some) & terms) in (0, len(some))
        case AtMostOne(some):
            return len(set(some) & terms) <= 1


def allowed_sets(rules, library):
    sets = (
        {name for name, there in zip(library.names, bits, strict=True) if there}
        for bits in product((0, 1), repeat=len(library.names))
    )
    return {frozenset(terms) for terms in sets if all(keeps(rule, terms) for rule in rules)}


@pytest.mark.parametrize(("line", "rule"), LINES.items())
def test_lines_are_read(line, rule):
    assert parse_rules(["", "# a comment", line], LIBRARY) == (rule,)
    assert parse_rules([str(rule)], LIBRARY) == (rule,)


def test_heredity():
    rules = {rule.term: rule.parents for rule in heredity(LIBRARY)}
    assert rules["N_rabsv"] == ("N_r", "N_v")
    assert rules["N_ur"] == ("N_r",)
    assert rules["N_uudelta_r"] == ("N_delta_r",)
    assert "N_rabsr" not in rules
    powers = {rule.term: rule.parents for rule in heredity(LIBRARY, powers=True)}
    assert powers["N_rabsr"] == powers["N_r3"] == ("N_r",)
    assert set(parse_rules(["heredity of powers"], LIBRARY)) == set(heredity(LIBRARY, powers=True))
    assert parse_rules(["heredity"], LIBRARY) == heredity(LIBRARY)


@pytest.mark.parametrize(
    "lines",
    [
        [],
        ["heredity"],
        ["heredity of powers"],
        list(LINES),
        ["heredity", "always N_uv", "never N_v3", "at most one of N_rabsr N_r3 N_ur"],
        ["N_r requires N_v", "N_v requires N_ur", "N_ur requires N_r"],
        ["always N_rabsr", "at most one of N_rabsr N_r3", "N_ur requires N_r3", "together N_ur N_uv"],
    ],
)
def test_masks_allow_what_the_sentences_allow(lines):
    rules = parse_rules(lines, SHORT)
    compiled, expected = compile_rules(SHORT, rules), allowed_sets(rules, SHORT)
    allowed = compiled.masks.allowed(np.arange(2 ** len(compiled.optional), dtype=np.uint64))
    found = [compiled.terms(s) for s in np.flatnonzero(allowed).tolist()]
    assert {frozenset(terms) for terms in found} == expected
    assert count_structures(compiled) == len(found) == len(expected)


def test_forced_terms_leave_the_search():
    compiled = compile_rules(LIBRARY, parse_rules(["heredity", "always N_rabsv", "never N_delta_r"], LIBRARY))
    assert compiled.always == ("N_r", "N_v", "N_rabsv")
    assert compiled.never == ("N_uudelta_r", "N_udelta_r", "N_delta_r")
    assert not any(compiled.masks.parents[compiled.optional.index(name)] for name in ("N_ur", "N_uv", "N_vabsr"))


@pytest.mark.parametrize("seed", range(15))
def test_counts_of_random_rules(seed):
    """Against every one of 2^10 structures."""
    rng = np.random.default_rng(seed)
    library = TermLibrary(LIBRARY.terms[:10], LIBRARY.signals)

    def pick(n):
        return tuple(str(name) for name in rng.choice(library.names, n, replace=False))

    rules = [Requires(a, (b, c)) for a, b, c in (pick(3) for _ in range(4))] + [Together(pick(2)), AtMostOne(pick(3))]
    try:
        compiled = compile_rules(library, rules)
    except InputError:
        assert set(library.names) != set().union(*allowed_sets(rules, library))
    else:
        assert count_structures(compiled) == len(allowed_sets(rules, library))


def test_a_large_library_is_counted_at_once():
    signals = ("u", "v", "p", "r", "delta_r")
    names = [lateral_terms(axis, "rvp") for axis in "NY"]
    free, one, two = (library_of(terms, signals) for terms in ([*names[0], *names[1]], *names))
    compiled = compile_rules(free, heredity(free))
    apart = [count_structures(compile_rules(library, heredity(library))) for library in (one, two)]
    assert len(compiled.optional) == 54
    assert count_structures(compiled) == apart[0] * apart[1]
    assert count_structures(compile_rules(LIBRARY, ())) == 2**15


@pytest.mark.parametrize(
    ("lines", "one", "other"),
    [
        (["always N_r", "never N_r"], "always N_r", "never N_r"),
        (["never N_r", "always N_ur", "N_ur requires N_r"], "never N_r", "N_ur requires N_r"),
        (["N_ur requires N_r", "at most one of N_ur N_r"], "N_ur requires N_r", "at most one of N_ur N_r"),
        (["together N_ur N_r", "at most one of N_ur N_r"], "together N_ur N_r", "at most one of N_ur N_r"),
        (["always N_r", "always N_v", "at most one of N_r N_v"], "always N_v", "at most one of N_r N_v"),
        (["together N_r N_v", "never N_r", "always N_v"], "never N_r", "together N_r N_v"),
    ],
)
def test_contradictions_name_both_rules(lines, one, other):
    with pytest.raises(InputError) as error:
        compile_rules(LIBRARY, parse_rules(lines, LIBRARY))
    assert f'"{one}"' in error.value.where
    assert f'"{other}"' in error.value.where


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("N_r needs N_v", '"A requires B"'),
        ("always", "one, each once"),
        ("together N_r", "at least two"),
        ("together N_r N_r", "at least two, each once"),
        ("never Y_v", "not in the library"),
        ("always N_p", r'signal "p" \(roll rate\), which was not measured'),
        ("always N_x", "is not a term"),
    ],
)
def test_lines_that_cannot_be_read(line, words):
    with pytest.raises(InputError, match=words) as error:
        parse_rules(["heredity", "", line], LIBRARY)
    assert error.value.where.startswith(f'rule in line 3, "{line}"')


def test_a_parent_outside_the_library():
    with pytest.raises(
        InputError, match=r'rule "N_ur requires N_rrr"\n  found:    N_rrr, which is not in the library|N_r3'
    ):
        compile_rules(library_of(("N_r", "N_ur"), ("u", "r")), [Requires("N_ur", ("N_rrr",))])


def test_nothing_left():
    small = library_of(("N_r",), ("r",))
    with pytest.raises(InputError, match="no term that the rules allow"):
        count_structures(compile_rules(small, [Never("N_r")]))
