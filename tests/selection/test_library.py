"""Term libraries: what each family gives, what symmetry and missing signals leave out, and what is refused."""

import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import SIGNALS
from seatrial.selection.library import FAMILIES, LATERAL_SIGNALS, VELOCITIES, breaks_symmetry, term_library

SHIP = ("u", "v", "r", "delta_r", "n")


def test_surge():
    assert term_library("X", ("u", "n")).names == ("X_0", "X_u", "X_uabsu", "X_u3", "T_nabsn", "T_absnu")
    assert "X_du3" in term_library("X", ("u", "n"), trim={"u": 1.5}).names
    assert "X_u3" not in term_library("X", ("u", "n"), trim={"u": 1.5}).names


def test_yaw_of_a_ship():
    linear, modulus = {"N_r", "N_v"}, {"N_rabsr", "N_vabsv", "N_rabsv", "N_vabsr"}
    cubic, lift = {"N_r3", "N_v3", "N_rrv", "N_vvr"}, {"N_ur", "N_uv"}
    surface = {"N_uudelta_r", "N_udelta_r", "N_delta_r"}
    assert set(term_library("N", SHIP).names) == linear | modulus | cubic | lift | surface


def test_families_and_extra_terms():
    library = term_library("N", SHIP, ["linear", "lift"], extra=["N_uuv", "N_vu"])
    assert library.names == ("N_r", "N_v", "N_ur", "N_uv", "N_uuv")
    unsymmetric = term_library("N", SHIP, ["constant", "propeller"], symmetric=False)
    assert unsymmetric.names == ("N_0", "N_nabsn", "N_absnu")


def test_every_family_gives_readable_names_once():
    for axis in VELOCITIES:
        library = term_library(axis, tuple(SIGNALS), symmetric=False, trim={"u": 1.0})
        assert len(set(library.terms)) == len(library.terms)
        assert all(term.axis in (axis, "T") for term in library.terms)
    assert all(
        list(family(axis)) or name in ("induced", "change", "lift", "surface", "attitude", "mixed_cubic", "cross_flow")
        for name, family in FAMILIES.items()
        for axis in VELOCITIES
    )


@pytest.mark.parametrize("axis", VELOCITIES)
def test_a_mirrored_vehicle_feels_mirrored_forces(axis):
    """Evaluate every term of the symmetric library in a mirrored motion: lateral forces turn over, the others stay."""
    values = {name: 0.3 + 0.1 * k for k, name in enumerate(SIGNALS)}
    mirrored = {name: -value if name in LATERAL_SIGNALS else value for name, value in values.items()}
    sign = -1 if axis in ("Y", "K", "N") else 1
    for term in term_library(axis, tuple(SIGNALS), trim={"u": 1.0}).terms:
        assert term.regressor(mirrored, {"u": 1.0}) == pytest.approx(sign * term.regressor(values, {"u": 1.0}))
    left_out = set(term_library(axis, tuple(SIGNALS), symmetric=False).terms) - set(
        term_library(axis, tuple(SIGNALS)).terms
    )
    for term in left_out:
        assert term.regressor(mirrored, {}) == pytest.approx(-sign * term.regressor(values, {}))


@pytest.mark.parametrize(
    ("name", "breaks"),
    [
        ("Y_vabsr", False),
        ("Y_absvr", False),
        ("Y_vr", True),
        ("N_vvr", False),
        ("N_0", True),
        ("X_vr", False),
        ("X_v", True),
    ],
)
def test_symmetry_of_single_terms(name, breaks):
    assert breaks_symmetry(CoefficientName.parse(name)) is breaks


def test_two_axes():
    both = term_library("Y", SHIP, ["linear"]) + term_library("N", SHIP, ["linear"])
    assert both.names == ("Y_v", "Y_r", "N_r", "N_v")
    assert both.signals == SHIP


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("T", SHIP), "one of X Y Z K M N"),
        (("N", ("yaw",)), 'signal "yaw"'),
        (("N", SHIP, ["cubik"]), r'did you mean "(mixed_)?cubic"'),
        (
            ("N", ("u", "n"), ["surface"]),
            r'(?s)family surface, term N_uudelta_r.*signal "delta_r" \(rudder angle\), which was not measured',
        ),
        (("N", SHIP, ["constant"]), "only terms that port-starboard symmetry forbids"),
        (("N", SHIP, ["induced"]), "family induced\n  found:    no term"),
        (("X", SHIP, ["change"]), "trim that is not known"),
        (("N", SHIP, None, ["N_p"]), r"term N_p\n  found:    signal \"p\" \(roll rate\), which was not measured"),
        (("N", SHIP, None, ["Y_v"]), r'axis "Y" \(sway force\)'),
        (("N", SHIP, None, ["N_vr"]), "even in the lateral signals"),
        (("X", SHIP, None, ["X_du3"]), 'no trim value of "u"'),
        (("K", ("u", "n")), "no term of the signals u, n"),
    ],
)
def test_what_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        term_library(*arguments)
