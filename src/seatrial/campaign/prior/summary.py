"""What the priors mean, in words: a table of the parameters, what they do in metres per second, and what to mend."""

import numpy as np

from seatrial.campaign.prior.predictive import MOST, Believed, PriorPredictive, most_have
from seatrial.core.display_units import Shown

SOME = 0.01
"""Share of draws without a motion above which a prior is to be mended."""
WIDE = 4.0
"""Factor between the ends of the 90 % range of the steady speed above which a prior is called wide."""
HELD, HARDLY = 0.8, 0.5
"""Shares of the measured speeds inside the 90 % range above which the prior holds them, and below which it does not."""


def prior_lines(found: PriorPredictive, shown: Shown) -> list[str]:
    """The parameters' priors in the units in which they are `shown`, and what they mean together."""
    rows = [_row(item, *shown(item.name, item.unit)) for item in found.believed]
    heads = ("prior", "5 %", "50 %", "95 %", "unit", "steady speed if only this prior varies")
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    table = [
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(text.rjust(width) for text, width in zip(row[1:4], widths[1:4], strict=True)),
                row[4].ljust(widths[4]),
                row[5],
            ]
        ).rstrip()
        for row in (heads, *rows)
    ]
    return [*table, *prior_summary(found)]


def prior_summary(found: PriorPredictive) -> list[str]:
    """What the priors mean in metres per second and seconds."""
    said = [
        f"{found.diverged.size} draws over {found.over}",
        f"steady speed at {found.at}: {range_words(found.steady, 'm/s')}",
        f"time constant there: {range_words(found.settling, 's')}",
        f"draws that diverge: {_percent(found.diverged)}; draws that reach no steady speed: {_percent(np.isnan(found.steady))}",
    ]
    if np.isfinite(found.held):
        said.append(f"measured speeds inside the prior's 90 % range: {found.held:.0%}; {_verdict(found.held)}")
    return said


def prior_alarms(found: PriorPredictive) -> list[str]:
    """Why the priors are not to be used."""
    said = []
    if found.diverged.mean() > MOST:
        said.append(f"most draws from the prior diverge ({_percent(found.diverged)}): {_mend(found)}")
    elif not most_have(found.steady):
        said.append(
            f"most draws from the prior reach no steady speed ({_percent(np.isnan(found.steady))}): " + _mend(found)
        )
    if found.held < HARDLY:
        said.append(
            f"the prior misses the measured speeds, of which {found.held:.0%} lie inside its 90 % range: "
            "check units, signs and the channel map, then move or widen the priors"
        )
    return said


def prior_cautions(found: PriorPredictive) -> list[str]:
    """What about the priors is worth mending."""
    said = []
    if found.lost.mean() > SOME and found.diverged.mean() <= MOST and most_have(found.steady):
        said.append(
            f"{_percent(found.lost)} of the draws from the prior diverge or reach no steady speed, which no vehicle does: {_mend(found)}"
        )
    if most_have(found.steady) and not found.held < HARDLY:
        low, high = np.nanquantile(np.abs(found.steady), (0.05, 0.95))
        if high > WIDE * low:
            widest = max((item for item in found.believed if item.speed), key=_width)
            said.append(
                f"the prior is wide: 90 % of its steady speeds lie between {low:.2g} and {high:.2g} m/s, mostly "
                f"because of {widest.name}; if you know the vehicle better, narrow the priors, because the evidence depends on them"
            )
    if HARDLY <= found.held < HELD:
        said.append(
            f"the prior covers only part of the measured speeds, {found.held:.0%} inside its 90 % range: "
            "move or widen the priors"
        )
    return said


def range_words(values: np.ndarray, unit: str) -> str:
    """Median and 90 % range of what the draws that have it say; plain words where most have none."""
    if not most_have(values):
        return "most draws have none"
    low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
    which = "draws" if np.isnan(values).mean() <= SOME else "draws that have one"
    return f"{middle:.3g} {unit}, 90 % of {which} {low:.3g} to {high:.3g} {unit}"


def _row(item: Believed, factor: float, unit: str) -> tuple[str, ...]:
    numbers = (f"{factor * value:.4g}" for value in item.quantiles)
    alone = (
        ""
        if item.speed is None
        else "none"
        if np.isnan(item.speed[0])
        else f"{item.speed[0]:.3g} to {item.speed[1]:.3g} m/s"
    )
    return item.name, *numbers, unit, alone


def _width(item: Believed) -> float:
    assert item.speed is not None
    return float(np.nan_to_num(item.speed[1] - item.speed[0], nan=np.inf))


def _verdict(held: float) -> str:
    if held < HARDLY:
        return "the prior misses them"
    return "the prior covers them" if held >= HELD else "the prior covers part of them"


def _percent(which: np.ndarray) -> str:
    share = float(np.mean(which))
    return f"{share:.1%}" if 0 < share < 0.1 else f"{share:.0%}"


def _mend(found: PriorPredictive) -> str:
    """Name the coefficient that most sets the draws that run away apart, and what to do about it."""
    worst = max(found.believed, key=lambda item: abs(item.blame))
    if worst.name in found.unphysical:
        return f"set physical = true in [prior.{worst.name}]"
    also = f", and set physical = true in [prior.{found.unphysical[0]}]" if found.unphysical else ""
    if worst.blame == 0.0:
        return f"check the signs and units of the priors{also}"
    end, bound = ("large", "lower its upper bound") if worst.blame > 0 else ("small", "raise its lower bound")
    return f"those with a {end} {worst.name}; {bound} in [prior.{worst.name}]{also}"
