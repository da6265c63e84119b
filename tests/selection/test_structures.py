import pytest

from seatrial.core.errors import InputError
from seatrial.selection.structures import MAX_STRUCTURES, Structure, structure_rules
from seatrial.selection.structures import all_structures as of_rules


def all_structures(always, optional, lines=()):
    return of_rules(structure_rules(always, optional, lines))


def test_all_subsets_the_full_one_first():
    assert all_structures(["T_nabsn"], ["X_u", "X_du3"]) == (
        Structure("M-0", ("T_nabsn", "X_u", "X_du3")),
        Structure("M-1", ("T_nabsn", "X_du3")),
        Structure("M-2", ("T_nabsn", "X_u")),
        Structure("M-3", ("T_nabsn",)),
    )


def test_the_empty_structure_is_no_candidate():
    structures = all_structures([], ["X_u", "X_uabsu", "X_du3"])
    assert len(structures) == 7
    assert len({frozenset(structure.terms) for structure in structures}) == 7
    assert [structure.label for structure in structures] == [f"M-{i}" for i in range(7)]
    assert [len(structure.terms) for structure in structures] == [3, 2, 2, 2, 1, 1, 1]


def test_without_optional_terms_there_is_one():
    assert all_structures(["X_u", "T_nabsn"], []) == (Structure("M-0", ("X_u", "T_nabsn")),)


def test_as_many_structures_as_can_be_simulated():
    optional = ["X_u", "X_uabsu", "X_u3", "X_du2", "X_du3", "T_nabsn"]
    assert len(all_structures(["X_udot"], optional)) == MAX_STRUCTURES == 2 ** len(optional)
    with pytest.raises(InputError, match="7 optional terms, 128 structures") as caught:
        all_structures([], [*optional, "T_un"])
    assert "at most 64 structures" in caught.value.expected
    assert "`always`" in caught.value.remedy


def test_rules_leave_out_what_they_forbid():
    structures = all_structures(
        ["T_nabsn"], ["X_u", "X_uabsu", "X_du3"], ["X_du3 requires X_uabsu", "at most one of X_u X_uabsu"]
    )
    assert [set(one.terms) - {"T_nabsn"} for one in structures] == [{"X_uabsu", "X_du3"}, {"X_uabsu"}, {"X_u"}, set()]
    with pytest.raises(InputError, match="X_u"):
        all_structures(["X_u"], ["X_uabsu"], ["never X_u"])


@pytest.mark.parametrize(
    ("always", "optional", "message"),
    [
        (["X_u"], ["X_u"], "term X_u\n.*same regressor as X_u"),
        (["X_uu"], ["X_u2"], "term X_u2\n.*same regressor as X_uu"),
        ([], ["X_uabsu", "X_du3", "X_absuu"], "term X_absuu\n.*same regressor as X_uabsu"),
        (["X_uv2x"], [], 'coefficient name "X_uv2x", character 6'),
        ([], [], "no term at all"),
    ],
)
def test_unusable_terms(always, optional, message):
    with pytest.raises(InputError, match=message):
        all_structures(always, optional)
