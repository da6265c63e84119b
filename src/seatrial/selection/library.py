"""Term libraries: candidate coefficient names for an axis, by family, from the signals that a record measured.

    family      example on N           what it stands for
    constant    N_0                    trim error, asymmetry
    linear      N_r                    damping at low speed
    quadratic   N_rabsr                drag of separated flow, by the modulus
    cubic       N_r3                   its smooth alternative (Abkowitz 1964)
    mixed_cubic N_vvr                  the same, of two velocities
    cross_flow  N_rabsv                drag of one velocity in the presence of another
    lift        N_ur                   hull lift, proportional to forward speed
    induced     X_vr                   drag and centripetal force by velocities of the other plane
    surface     N_uudelta_r            rudder and stern plane, with speed squared, with speed and without
    propeller   T_nabsn                thrust at rest and its loss with speed
    command     N_tau_N                gain of a commanded force
    attitude    K_phi                  restoring moment
    change      X_du3                  departure from trim, as in the surge model of the paper

(Fossen, Handbook of Marine Craft, 2nd ed., 2021, chapters 6 and 7.) A vehicle that is its own mirror image cannot make a sway force
of an even product of v, p, r, phi, psi and delta_r, or a surge force of an odd one, moduli counted as even.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import SIGNALS
from seatrial.core.term_checks import check_trim

LATERAL_AXES = ("Y", "K", "N")
LATERAL_SIGNALS = frozenset(("v", "p", "r", "phi", "psi", "delta_r", "tau_Y", "tau_K", "tau_N"))
# Velocities that make most of the force on each axis, the main one first.
VELOCITIES = {
    "X": ("u",),
    "Y": ("v", "r", "p"),
    "Z": ("w", "q"),
    "K": ("p", "v", "r"),
    "M": ("q", "w"),
    "N": ("r", "v", "p"),
}
SURFACES = {"Y": ("delta_r",), "K": ("delta_r",), "N": ("delta_r",), "Z": ("delta_s",), "M": ("delta_s",)}
ATTITUDES = {"K": "phi", "M": "theta"}
CROSS_PLANES = (("v", "r"), ("w", "q"))


@dataclass(frozen=True)
class TermLibrary:
    """Candidate terms of one or several axes.

    Attributes:
        terms: each regressor once on its axis.
        signals: those that were measured or commanded.
    """

    terms: tuple[CoefficientName, ...]
    signals: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term.text for term in self.terms)

    def find(self, text: str, place: str) -> str:
        """Return the name under which the library has a term, whatever the order of its factors.

        Raises:
            InputError: malformed, of a signal that was not measured, or not in the library.
        """
        term = CoefficientName.parse(text)
        check_measured(term, self.signals, place)
        if term not in self.terms:
            raise InputError(
                place,
                found=f"{term}, which is not in the library",
                expected="one of " + ", ".join(self.names),
                remedy=nearest(text, self.names) + " or add it to the library",
            )
        return self.names[self.terms.index(term)]

    def __add__(self, other: "TermLibrary") -> "TermLibrary":
        """Return the terms of both, for several axes at once."""
        return TermLibrary(
            tuple(dict.fromkeys(self.terms + other.terms)), tuple(dict.fromkeys(self.signals + other.signals))
        )


def term_library(
    axis: str,
    signals: Sequence[str],
    families: Sequence[str] | None = None,
    extra: Sequence[str] = (),
    symmetric: bool = True,
    trim: Mapping[str, float] | None = None,
) -> TermLibrary:
    """Candidate terms of an axis.

    Args:
        axis: X, Y, Z, K, M or N; the thrust T belongs to X.
        signals: what the records have: velocities, attitudes and controls.
        families: of `FAMILIES`; all of them if not given, each with those of its terms whose signals there are, and X_du3 in
            place of X_u3 where the trim is known.
        extra: terms to add by name.
        symmetric: leave out what port-starboard symmetry forbids.
        trim: signals whose equilibrium is known, without which there are no terms of change.

    Raises:
        InputError: an unknown axis, family or signal; a family or extra term whose signals were not measured; an extra term that
            symmetry forbids; no term at all.
    """
    place, trim = f"term library of axis {axis}", trim or {}
    if axis not in VELOCITIES:
        raise InputError(
            place, found=f'"{axis}"', expected="one of " + " ".join(VELOCITIES), remedy="name an axis of motion"
        )
    for signal in signals:
        if signal not in SIGNALS:
            raise InputError(
                place, found=f'signal "{signal}"', expected="a known signal", remedy=nearest(signal, SIGNALS)
            )
    for family in families or ():
        if family not in FAMILIES:
            raise InputError(
                place, found=f'family "{family}"', expected="a known family", remedy=nearest(family, FAMILIES)
            )
    terms: dict[CoefficientName, None] = {}
    for family in FAMILIES if families is None else families:
        candidates = [CoefficientName.parse(text) for text in FAMILIES[family](axis)]
        allowed = [term for term in candidates if not (symmetric and breaks_symmetry(term))]
        usable = [term for term in allowed if set(term.signals) <= set(signals) and set(term.trim_signals) <= set(trim)]
        if families is not None and not usable:
            _explain_empty(family, allowed, signals, place, bool(candidates))
        terms.update(dict.fromkeys(usable))
    if families is None and CoefficientName.parse("X_du3") in terms:
        # at speeds of one sign the cube of the change is a combination of the cube with lower powers
        terms.pop(CoefficientName.parse("X_u3"))
    for text in extra:
        term = CoefficientName.parse(text)
        _check_extra(term, axis, signals, symmetric, trim, place)
        terms[term] = None
    if not terms:
        raise InputError(
            place,
            found=f"no term of the signals {', '.join(signals)}",
            expected="at least one",
            remedy="name other families, or map the velocities and controls of this axis",
        )
    return TermLibrary(tuple(terms), tuple(signals))


def breaks_symmetry(term: CoefficientName) -> bool:
    """Return whether a vehicle that is its own mirror image in the plane of x and z cannot have this term."""
    odd = sum(factor.power for factor in term.factors if factor.signal in LATERAL_SIGNALS and not factor.modulus) % 2
    return bool(odd) != (term.axis in LATERAL_AXES)


def check_measured(term: CoefficientName, signals: Sequence[str], place: str) -> None:
    """Check that a term's signals were measured.

    Raises:
        InputError: naming the term and the signal.
    """
    for signal in term.signals:
        if signal not in signals:
            raise InputError(
                f"{place}, term {term}",
                found=f'signal "{signal}" ({SIGNALS[signal].meaning}), which was not measured',
                expected="one of " + ", ".join(signals),
                remedy="leave the term out, or map the channel when importing",
            )


# Names that each family gives to an axis, before anything is left out.
FAMILIES: dict[str, Callable[[str], Iterable[str]]] = {
    "constant": lambda axis: (f"{axis}_0",),
    "linear": lambda axis: (f"{axis}_{s}" for s in VELOCITIES[axis]),
    "quadratic": lambda axis: (f"{axis}_{s}abs{s}" for s in VELOCITIES[axis]),
    "cubic": lambda axis: (f"{axis}_{s}3" for s in VELOCITIES[axis]),
    "mixed_cubic": lambda axis: (f"{axis}_{s}{s}{t}" for s, t in permutations(VELOCITIES[axis], 2)),
    "cross_flow": lambda axis: (f"{axis}_{s}abs{t}" for s, t in permutations(VELOCITIES[axis], 2)),
    "lift": lambda axis: (f"{axis}_u{s}" for s in VELOCITIES[axis] if s != "u"),
    "induced": lambda axis: (
        f"X_{s}{t}" for plane in CROSS_PLANES for s, t in combinations_with_replacement(plane, 2) if axis == "X"
    ),
    "surface": lambda axis: (
        f"{axis}_{speed}{d}"
        for d in SURFACES.get(axis, ("delta_rdelta_r", "delta_sdelta_s"))
        for speed in ("uu", "u", "")
    ),
    "propeller": lambda axis: ("T_nabsn", "T_absnu") if axis == "X" else (f"{axis}_nabsn", f"{axis}_absnu"),
    "command": lambda axis: (f"{axis}_tau_{axis}",),
    "attitude": lambda axis: (f"{axis}_{ATTITUDES[axis]}" for _ in range(axis in ATTITUDES)),
    "change": lambda axis: (f"{axis}_du3",) if axis == "X" else (),
}


def _explain_empty(
    family: str, allowed: Sequence[CoefficientName], signals: Sequence[str], place: str, any_at_all: bool
) -> None:
    for term in allowed:
        check_measured(term, signals, f"{place}, family {family}")
    if allowed:
        result = f"{allowed[0]}, a change of {', '.join(allowed[0].trim_signals)} from a trim that is not known"
        remedy = "give the trim, or leave the family out"
    elif any_at_all:
        result, remedy = (
            "only terms that port-starboard symmetry forbids",
            "leave the family out, or say symmetric = false",
        )
    else:
        result, remedy = "no term", "leave the family out"
    raise InputError(f"{place}, family {family}", found=result, expected="at least one term", remedy=remedy)


def _check_extra(
    term: CoefficientName, axis: str, signals: Sequence[str], symmetric: bool, trim: Mapping[str, float], place: str
) -> None:
    if term.axis not in ((axis, "T") if axis == "X" else (axis,)):
        raise InputError(
            f"{place}, term {term}",
            found=f'axis "{term.axis}" ({AXES[term.axis][1]})',
            expected=axis,
            remedy="add the term to the library of its own axis",
        )
    check_measured(term, signals, place)
    check_trim(term, trim, place)
    if symmetric and breaks_symmetry(term):
        parity = "even" if axis in LATERAL_AXES else "odd"
        raise InputError(
            f"{place}, term {term}",
            found=f"a product that is {parity} in the lateral signals, which port-starboard symmetry forbids on {axis}",
            expected=f"an {'odd' if parity == 'even' else 'even'} one, moduli counted as even",
            remedy="leave the term out, or say symmetric = false",
        )
