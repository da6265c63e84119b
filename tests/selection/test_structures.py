import pytest

from seatrial.core.errors import InputError
from seatrial.selection.structures import MAX_STRUCTURES, Structure, label_structures, structure_names, structure_rules
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


@pytest.mark.parametrize(
    ("sets", "names"),
    [
        (
            ["T_nabsn X_uabsu X_u X_du3", "T_nabsn X_uabsu X_du3", "T_nabsn X_uabsu"],
            ["linear and quadratic drag, cubic about trim", "quadratic drag, cubic about trim", "quadratic drag"],
        ),
        (["X_u X_uabsu T_un", "X_u X_uabsu"], ["linear and quadratic drag; T_un", "linear and quadratic drag"]),
        (["X_tau_X X_0 X_u2 X_u", "X_tau_X X_0"], ["linear and square drag", "no drag"]),
        (["X_du3 T_nabsn", "T_nabsn"], ["cubic drag about trim", "no drag"]),
        (["N_r N_rabsr Y_v", "N_r Y_v"], ["linear and quadratic yaw damping", "linear yaw damping"]),
        (["T_nabsn T_un Y_v N_r", "T_nabsn Y_v N_r"], ["T_un", "no optional term"]),
        (["Y_v Y_r Y_ur N_v N_r N_uv"], ["all 6 terms"]),
        (["X_u X_uabsu T_un T_n X_0", "X_u T_un T_n X_0"], ["linear and quadratic drag", "linear drag"]),
        (
            ["X_u X_uabsu N_r N_rabsr", "X_uabsu X_du3 N_ur Y_r", "X_du2 X_du3 N_r"],
            [
                "drag: linear and quadratic; yaw damping: linear and quadratic",
                "drag: quadratic, cubic about trim; N_ur and Y_r",
                "drag: square and cubic about trim; yaw damping: linear",
            ],
        ),
    ],
)
def test_a_structure_is_named_by_its_terms(sets, names):
    structures = label_structures([terms.split() for terms in sets])
    assert list(structure_names(structures).values()) == names


def test_no_two_of_many_structures_have_one_name():
    structures = all_structures(["T_nabsn"], ["X_0", "X_u", "X_uabsu", "X_du3", "T_un", "T_n"])
    assert len(set(structure_names(structures).values())) == len(structures) == 64
