"""Values of parameters in lines: the coefficients first, then all other parameters."""

from collections.abc import Collection, Mapping, Sequence

from seatrial.core.coefficients import base_name
from seatrial.core.display_units import listed, measured
from seatrial.estimation.posterior.configurations import ConfigurationDifference

# Kinds of parameters that are no coefficients, by the first word of their names.
KINDS = {
    "sigma": "noise",
    "tau": "noise",
    "dof": "noise",
    "share": "noise",
    "drift": "noise",
    "process": "noise",
    "disturbance": "disturbances",
    "bias": "offsets of sensors",
    "lag": "lags",
    "delay": "delay",
    "current": "current",
    "gain": "thrusters",
    "reverse": "thrusters",
    "dead": "thrusters",
    "tether": "tether",
    "spread": "differences between trials",
    "dev": "differences between trials",
}


def other_kinds(names: Sequence[str]) -> str:
    """Return the kinds of parameters that are no coefficients: `noise and starting values`."""
    bases = list(map(base_name, names))
    kinds = [
        "starting values" if base.endswith("_0") else KINDS.get(base.partition("_")[0], "other unknowns")
        for base in bases
    ]
    return listed(list(dict.fromkeys(kinds)))


def value_text(mean: float, sd: float, shown: tuple[float, str], made_of: str = "") -> str:
    """Return a value with its ± in the unit shown, with `factor` such units in an SI unit, and the parts of the ±."""
    factor, unit = shown
    return f"{factor * mean:>12.5g} ± {factor * sd:<10.3g} {unit:<10} {made_of}".rstrip()


def change_text(one: ConfigurationDifference, shown: tuple[float, str]) -> str:
    """Return the change between two configurations in the unit shown, as `value_text`."""
    factor, unit = shown
    change = measured(factor * one.change, factor * one.sd, unit)
    return f"{one.name} changed from {one.first} to {one.second} by {change}"


def value_lines(texts: Mapping[str, str], terms: Collection[str]) -> list[str]:
    """Return a line for each parameter: the terms of a structure, then a heading and the others."""
    others = [name for name in texts if base_name(name) not in terms]
    lines = [f"{name:<16} {text}" for name, text in texts.items() if name not in others]
    return [
        *lines,
        *([f"{other_kinds(others)}:"] if others else []),
        *(f"  {name:<14} {texts[name]}" for name in others),
    ]
