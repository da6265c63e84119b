"""Whether a vehicle is alike on both sides of a plane, or when turned by a right angle about its keel, as the evidence of that.

In a mirror a velocity or force across the plane changes sign, and so does a rate or moment about an axis in the plane. A coefficient
whose term would change sign and its force not, or the other way round, is zero for a vehicle that looks the same in the mirror, and
thrusters that are mirror images have one gain. Turned about the keel, sway becomes heave, and each term another with one value and a
sign (M_q = N_r, M_w = -N_v). With c all the differences that are zero then, and the others' prior given c = 0,

    log Z(alike) - log Z(free) = log p(c = 0 | data) - log p(c = 0)

(Dickey, Ann. Math. Stat. 42, 1971); the first density is that of the normal with mean and covariance of the draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.vehicles.thrusters import Thruster

MIRRORS = ("bow and stern", "port and starboard", "top and bottom")  # By the axis across the mirror: x, y, z
TURNED = "sideways and up and down"
ACROSS = ("u v w", "X Y Z", "tau_X tau_Y tau_Z")  # Polar vectors: they change sign along the axis across the mirror
# Axial vectors: they change sign about the other two axes.
ABOUT = ("p q r", "K M N", "phi theta psi", "tau_K tau_M tau_N")
# What each axis and velocity becomes when the vehicle is turned by a right angle from starboard to down, and its sign.
QUARTER = {"Y": ("Z", 1), "Z": ("Y", -1), "M": ("N", 1), "N": ("M", -1), "X": ("X", 1), "K": ("K", 1)} | {
    "u": ("u", 1),
    "v": ("w", 1),
    "w": ("v", -1),
    "p": ("p", 1),
    "q": ("r", 1),
    "r": ("q", -1),
}
CLOSE = 1e-3  # Distance, m, and difference of a direction within which a thruster is the mirror image of another


class Restriction(NamedTuple):
    """A parameter that is zero, or a multiple of another, if the vehicle is alike.

    Attributes:
        first: its name.
        second: of the other; empty for none.
        sign: factor on the other.
    """

    first: str
    second: str = ""
    sign: int = 1


@dataclass(frozen=True)
class Symmetry:
    """How far the data support that a vehicle is alike.

    Attributes:
        sides: which are alike.
        restrictions: what is zero or equal then.
        log_evidence: for that, against all being free, nats.
    """

    sides: str
    restrictions: tuple[Restriction, ...]
    log_evidence: float


class PriorCurve(NamedTuple):
    """Density of a prior, per unit of the value, over nearly all of its support; `value` increases."""

    value: Float[np.ndarray, " n"]
    density: Float[np.ndarray, " n"]

    def at(self, value: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Density at some values; zero beyond the curve."""
        return np.interp(value, self.value, self.density, left=0.0, right=0.0)


def symmetries(
    priors: Mapping[str, PriorCurve], draws: Float[np.ndarray, "n d"], thrusters: Sequence[Thruster] = ()
) -> list[Symmetry]:
    """Weigh every symmetry of which some restriction is among the parameters, and possible by their priors.

    Args:
        priors: of each parameter, by name, in the order of the draws.
        draws: of the posterior, SI.
        thrusters: of an open frame.
    """
    names = list(priors)
    result = []
    for sides, restrictions in restrictions_of(names, thrusters).items():
        log_prior = np.array([_log_prior(one, priors) for one in restrictions])
        kept = tuple(one for one, value in zip(restrictions, log_prior, strict=True) if np.isfinite(value))
        if not kept:
            continue
        column = dict(zip(names, draws.T, strict=True))
        differences = np.stack([column[one.first] - one.sign * column.get(one.second, 0.0) for one in kept], axis=1)
        centre, spread = differences.mean(0), np.atleast_2d(np.cov(differences.T))
        if np.linalg.matrix_rank(spread) < len(kept):  # draws that do not move along one of them say nothing of it
            continue
        log_posterior = float(scipy.stats.multivariate_normal(centre, spread).logpdf(np.zeros(len(kept))))
        result.append(Symmetry(sides, kept, log_posterior - float(log_prior[np.isfinite(log_prior)].sum())))
    return result


def restrictions_of(names: Sequence[str], thrusters: Sequence[Thruster] = ()) -> dict[str, tuple[Restriction, ...]]:
    """Return by symmetry what it sets to zero, or equal, among some parameters; each of these is in one restriction at most."""
    terms = [term for name in names if (term := _term(name)) is not None]
    result = {}
    for axis, sides in enumerate(MIRRORS):
        zero = [Restriction(term.text) for term in terms if _parity(term, axis) < 0]
        result[sides] = (*zero, *_mirrored_gains(names, thrusters, axis))
    result[TURNED] = _turned(terms)
    return {sides: restrictions for sides, restrictions in result.items() if restrictions}


def mirror_of(thruster: Thruster, thrusters: Sequence[Thruster], axis: int = 1) -> int | None:
    """Return the place in a list of the mirror image of a thruster, itself perhaps, across x, y or z; None if there is none."""
    flip = np.ones(3)
    flip[axis] = -1.0
    place, push = flip * thruster.place, flip * thruster.column[:3]
    for index, other in enumerate(thrusters):
        if np.linalg.norm(place - other.place) < CLOSE and abs(abs(push @ other.column[:3]) - 1.0) < CLOSE:
            return index
    return None


def _term(name: str) -> CoefficientName | None:
    """Return the term of a hull of a name; None for thrust, torque and what stands for a propeller, a fin or the battery."""
    try:
        term = CoefficientName.parse(name)
    except InputError:
        return None
    ours = {one for group in (*ACROSS, *ABOUT) for one in group.split()}
    return term if term.axis in ours and ours.issuperset(term.signals) else None


def _sign(name: str, axis: int) -> int:
    """Sign of an axis or a signal in a mirror across x, y or z."""
    for vectors, changed in ((ACROSS, True), (ABOUT, False)):
        for group in vectors:
            if name in group.split():
                return -1 if (group.split().index(name) == axis) is changed else 1
    raise KeyError(name)


def _parity(term: CoefficientName, axis: int) -> int:
    """Return -1 if a mirror changes the sign of either the force or its term, 1 if of both or none; 0 if a trim forbids to say."""
    parity = _sign(term.axis, axis)
    for factor in term.factors:
        sign = _sign(factor.signal, axis)
        if factor.change and sign < 0:
            return 0
        parity *= 1 if factor.modulus else sign**factor.power
    return parity


def _mirrored_gains(names: Sequence[str], thrusters: Sequence[Thruster], axis: int) -> list[Restriction]:
    result = []
    for index, thruster in enumerate(thrusters):
        other = mirror_of(thruster, thrusters, axis)
        if other is not None and other > index:
            pairs = [(f"gain_{letter}_{index + 1}", f"gain_{letter}_{other + 1}") for letter in "fn"]
            result += [Restriction(*pair) for pair in pairs if {*pair} <= {*names}]
    return result


def _turned(terms: Sequence[CoefficientName]) -> tuple[Restriction, ...]:
    """Pairs of terms that a right angle about the keel turns into one another."""
    by_key = {(term.axis, term.key): term.text for term in terms}
    result: list[Restriction] = []
    for term in terms:
        if not term.factors or any(one.signal not in QUARTER or one.change for one in term.factors):
            continue
        axis, sign = QUARTER[term.axis]
        text = axis + "_"
        for factor in term.factors:
            signal, own = QUARTER[factor.signal]
            sign *= 1 if factor.modulus else own**factor.power
            power = str(factor.power) if factor.power > 1 else ""
            text += f"{'abs' * factor.modulus}{signal}{'dot' * factor.derivative}{power}"
        image = CoefficientName.parse(text)
        other = by_key.get((image.axis, image.key))
        used = {name for one in result for name in (one.first, one.second)}
        if other is not None and other != term.text and not {other, term.text} & used:
            result.append(Restriction(other, term.text, sign))
    return tuple(result)


def _log_prior(one: Restriction, priors: Mapping[str, PriorCurve]) -> float:
    """Log of the prior density of the difference at zero, per unit; minus infinity where the prior forbids it."""
    first = priors[one.first]
    if not one.second:
        density = float(first.at(np.zeros(1))[0])
    else:
        second = priors[one.second]
        value = np.union1d(first.value, one.sign * second.value)
        density = float(np.trapezoid(first.at(value) * second.at(one.sign * value), value))
    return float(np.log(density)) if density > 0 else -np.inf
