"""Designs in words, in the units of the boundary."""

from seatrial.core.shown import shown_unit
from seatrial.manoeuvres.family import Family


def design_words(family: Family, amplitude: float, period: float) -> str:
    """Name one member of a family: `repeated doublet of ±200 rpm about 1194 rpm in n, period 10 s`."""
    factor, unit = shown_unit(family.control)
    return (
        f"{family.words} of {family.shape.sides}{amplitude * factor:.4g} {unit} about {family.trim * factor:.4g} {unit} "
        f"in {family.control}, {family.shape.period_is} {period:.3g} s"
    )
