r"""The coefficient-name grammar: a coefficient's name is its equation.

    name    = axis "_" ( factor+ | "0" )
    axis    = X Y Z (forces) | K M N (moments) | T (propeller thrust) | Q (propeller torque)
    factor  = ["abs"] ["d"] signal ["dot"] [power]

`abs` takes the modulus of the signal that follows, `d` its change from trim, `dot` its time derivative, and a digit from 2
to 9 raises it to a power; `0` alone is a constant force. So `X_uabsu` multiplies u|u|, `Y_uudelta_r` u^2 delta_r and
`X_du3` the cube of u - u_trim. Notation: SNAME (1950) as used by Fossen, Handbook of Marine Craft, 2nd ed., 2021.
"""

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import InputError
from seatrial.core.signals import FORCE, MOMENT, RATES, SIGNALS, Dimension
from seatrial.core.units import si_powers

AXES: dict[str, tuple[Dimension, str]] = {
    "X": (FORCE, "surge force"),
    "Y": (FORCE, "sway force"),
    "Z": (FORCE, "heave force"),
    "K": (MOMENT, "roll moment"),
    "M": (MOMENT, "pitch moment"),
    "N": (MOMENT, "yaw moment"),
    "T": (FORCE, "propeller thrust"),
    "Q": (MOMENT, "propeller torque"),
}
EXAMPLES = "write for example X_u, X_uabsu, T_nabsn or N_delta_r"
_SIGNAL = "|".join(sorted(map(re.escape, SIGNALS), key=len, reverse=True))
_MIN_LIKENESS = 0.7  # Likeness to a signal, of 1, from which it may have been meant
_FACTOR = re.compile(rf"(?P<abs>abs)?(?P<change>d)?(?P<signal>{_SIGNAL})(?P<dot>dot)?(?P<power>[2-9])?")


@dataclass(frozen=True)
class Factor:
    """One factor of a regressor: a signal with its modifiers."""

    signal: str
    modulus: bool = False
    change: bool = False
    derivative: bool = False
    power: int = 1

    @property
    def dimension(self) -> Dimension:
        """Dimension of the factor, power included."""
        base = SIGNALS[self.signal].dimension
        base = base.times(Dimension(s=-1)) if self.derivative else base
        return Dimension().times(base, self.power)

    @property
    def label(self) -> str:
        """LaTeX of the factor."""
        text = SIGNALS[self.signal].label
        text = rf"\dot{{{text}}}" if self.derivative else text
        text = rf"\Delta {text}" if self.change else text
        text = f"|{text}|" if self.modulus else text
        return text if self.power == 1 else f"{text}^{self.power}"

    def value(self, signals: Mapping[str, Any], trim: Mapping[str, float]) -> Any:
        """Evaluate on scalars or arrays; `trim` holds the equilibrium value of every signal written with `d`."""
        value = signals[self.signal + "dot" if self.derivative else self.signal]
        value = value - trim[self.signal] if self.change else value
        value = abs(value) if self.modulus else value
        return value**self.power if self.power > 1 else value


@dataclass(frozen=True)
class CoefficientName:
    """A hydrodynamic coefficient, read from its name; equal names are those with the same axis and regressor."""

    text: str = field(compare=False)
    axis: str
    factors: tuple[Factor, ...] = field(compare=False)
    key: tuple = field(repr=False)
    own_dimension: Dimension | None = field(default=None, compare=False, repr=False)

    @classmethod
    def parse(cls, text: str) -> "CoefficientName":
        """Read a name such as `X_uabsu`.

        Raises:
            InputError: malformed name; the message points at the first character that cannot be read.
        """
        check_kind(text, str, "coefficient name", EXAMPLES)
        return _read(text)

    @classmethod
    def own(cls, text: str, unit: str) -> "CoefficientName":
        """Return the name of a coefficient with a regressor that only the equation of its model contains.

        Args:
            text: no name of the grammar, for example `drag`.
            unit: SI, for example `1/m`.
        """
        return cls(text, "", (), (text,), Dimension(**si_powers(unit, f'coefficient "{text}", unit')))

    @property
    def is_added_mass(self) -> bool:
        """Whether the regressor is an acceleration, so that the term belongs with the inertia."""
        return any(factor.derivative for factor in self.factors)

    @cached_property
    def dimension(self) -> Dimension:
        """Exact dimension: that of the axis over that of the regressor."""
        if self.own_dimension is not None:
            return self.own_dimension
        result = AXES[self.axis][0]
        for factor in self.factors:
            result = result.times(factor.dimension, -1)
        return result

    @property
    def unit(self) -> str:
        """Exact SI unit, for example `kg/m`."""
        return str(self.dimension)

    @property
    def label(self) -> str:
        """LaTeX, without dollar signs, for example `X_{u|u|}`; words of an own name upright."""
        if self.own_dimension is not None:
            return rf"\mathrm{{{self.text}}}".replace("_", r"\_")
        return f"{self.axis}_{{{''.join(factor.label for factor in self.factors) or '0'}}}"

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals the regressor needs, each once, in the order written."""
        return tuple(dict.fromkeys(factor.signal for factor in self.factors))

    @property
    def trim_signals(self) -> tuple[str, ...]:
        """Signals with a trim value that the regressor needs."""
        return tuple(dict.fromkeys(factor.signal for factor in self.factors if factor.change))

    def parted_by_sign(self, other: "CoefficientName") -> tuple[str, ...]:
        """Return the signals that must change sign to separate two terms, as u for `X_uu` and `X_uabsu`; none for any other two."""
        pairs = list(zip(self.key, other.key, strict=False))
        alike = self.axis == other.axis and len(self.key) == len(other.key) and self.key != other.key
        alike = alike and all(a[0] == b[0] and sum(a[1:]) == sum(b[1:]) for a, b in pairs)
        bases = [a[0] for a, b in pairs if a != b] if alike else []
        return () if any(change or derivative for _, change, derivative in bases) else tuple(one for one, *_ in bases)

    def regressor(self, signals: Mapping[str, Any], trim: Mapping[str, float]) -> Any:
        """Evaluate the product of signals, on scalars or arrays of one shape, in SI.

        Args:
            signals: value of every signal in `self.signals` (accelerations under `udot`, …).
            trim: equilibrium value of every signal in `self.trim_signals`.
        """
        result: Any = 1.0
        for index, factor in enumerate(self.factors):
            value = factor.value(signals, trim)
            result = value if index == 0 else result * value
        return result

    def __str__(self) -> str:
        return self.text


@lru_cache(maxsize=4096)  # checks of many draws ask for the same names
def _read(text: str) -> CoefficientName:
    axis, separator, rest = text.partition("_")
    if axis not in AXES or not separator:
        raise InputError(
            f'coefficient name "{text}"',
            found=f'"{text}", which is not a term: "{axis}" instead of the axis',
            expected="an axis and an underscore, one of " + " ".join(f"{name}_" for name in AXES),
            remedy=EXAMPLES,
        )
    factors = () if rest == "0" else _factors(text, rest, offset=len(axis) + 1)
    return CoefficientName(text, axis, factors, _key(factors))


def _factors(text: str, rest: str, offset: int) -> tuple[Factor, ...]:
    factors, position = [], 0
    while position < len(rest):
        match = _FACTOR.match(rest, position)
        if match is None or (match["dot"] and (match["signal"] not in RATES or match["change"])):
            raise _malformed(text, offset + position)
        factors.append(
            Factor(
                match["signal"], bool(match["abs"]), bool(match["change"]), bool(match["dot"]), int(match["power"] or 1)
            )
        )
        position = match.end()
    if not factors:
        raise _malformed(text, offset)
    return tuple(factors)


def _malformed(text: str, position: int) -> InputError:
    rest = text[position:]
    near = difflib.get_close_matches(rest, SIGNALS, n=1, cutoff=_MIN_LIKENESS)
    return InputError(
        f'coefficient name "{text}", character {position + 1}\n  {text}\n  {" " * position}^',
        found=f'"{text}", which is not a term: ' + (f'"{rest}" is no signal' if rest else "nothing follows the axis"),
        expected="[abs][d]signal[dot][2-9] with a signal among "
        + " ".join(SIGNALS)
        + ' (dot only on u v w p q r), or "0" for a constant force',
        remedy=f'did you mean "{near[0]}"?' if near else EXAMPLES,
    )


def _key(factors: tuple[Factor, ...]) -> tuple:
    """Canonical form of the product: powers summed per signal, |s|^2 = s^2, order forgotten."""
    powers: dict[tuple, list[int]] = {}
    for factor in factors:
        power = powers.setdefault((factor.signal, factor.change, factor.derivative), [0, 0])
        power[factor.modulus] += factor.power
    return tuple(sorted((base, plain + modulus // 2 * 2, modulus % 2) for base, (plain, modulus) in powers.items()))


def base_name(name: str) -> str:
    """Return the name of a parameter without its configuration or its trial: `X_u` of `X_u@loaded`, `bias_u` of `bias_u[1]`."""
    return re.split(r"[@[]", name, maxsplit=1)[0]


def configuration_name(name: str, configuration: str) -> str:
    """Return the parameter name of a value of one configuration. Trials share it, so that it has none of the brackets of a trial."""
    return f"{name}@{configuration}"


def configuration_of(name: str) -> str:
    """Return the configuration in the name of a parameter: `loaded` of `X_u@loaded`; empty without one."""
    end = name[len(base_name(name)) :]
    return end[1:] if end.startswith("@") else ""


def is_coefficient(name: str) -> bool:
    """Whether a name can be read as that of a coefficient."""
    try:
        CoefficientName.parse(name)
    except InputError:
        return False
    return True
