"""Priors in words: a table of the parameters, their effect on the motion, and corrections."""

from typing import TYPE_CHECKING

import numpy as np

from seatrial.core.display_units import Shown, listed, shown_unit
from seatrial.core.normal import Z90
from seatrial.core.result_table import aligned
from seatrial.design.prior_belief import MAX_LOST_SHARE, QUANTILE_LEVELS, most_have

if TYPE_CHECKING:
    from seatrial.campaign.prior.predictive import Believed, PriorPredictive

MAX_ODD_SHARE = 0.01  # Share of draws without a motion above which a prior needs a correction
WIDE = 4.0  # Factor between the ends of the 90 % range of the steady speed above which a prior is called wide
# Range of a channel in all draws and over the whole trial, SI, below which the trial does not move it
STILL_RANGE = 1e-9
# Shares of the measured speeds inside the 90 % range above which the prior covers them, and below which it misses them
HELD_SHARE, HARDLY_SHARE = 0.8, 0.5


def prior_lines(predictive: "PriorPredictive", shown: Shown) -> list[str]:
    """Return the priors of the parameters in the units in which they are `shown`, and the motion that they imply."""
    what, named = ("largest value in the trial", True) if predictive.settled is None else ("steady speed", False)
    rows = [_row(item, *shown(item.name, item.unit), named) for item in predictive.believed]
    heads = ("prior", "5 %", "50 %", "95 %", "unit", f"{what} if only this prior varies")
    return [*aligned((heads, *rows), left=(0, 4, 5)), *prior_summary(predictive)]


def prior_summary(predictive: "PriorPredictive") -> list[str]:
    """Return the motion that the priors imply, in the units of display."""
    messages, lost = [f"{predictive.diverged.size} draws over {predictive.over}"], _percent(predictive.diverged)
    if predictive.settled is not None:
        none = _percent(np.isnan(predictive.settled.speed))
        messages.append(f"steady speed at {predictive.settled.at}: {range_words(predictive.settled.speed, 'm/s')}")
        messages.append(f"time constant there: {range_words(predictive.settled.time_constant, 's')}")
        messages.append(f"draws that diverge: {lost}; draws that reach no steady speed: {none}")
    else:
        for one in predictive.channels:
            factor, unit = shown_unit(one.channel)
            if np.isfinite(one.bands).any():
                low, high = (factor * end for end in (one.bands[0].min(), one.bands[-1].max()))
                is_still = np.ptp(one.bands) < STILL_RANGE
                messages.append(
                    f"{one.channel} does not move in this trial, so its priors have no effect{_moving(predictive)}"
                    if is_still
                    else f"{one.channel}: 90 % of draws between {low:.3g} and {high:.3g} {unit}"
                )
        messages.append(f"draws that diverge: {lost}")
    held = [one for one in predictive.channels if np.isfinite(one.held)]
    return messages + [
        f"{_measured(predictive, one.channel)} inside the prior's 90 % range: {one.held:.0%}; {_verdict(one.held)}"
        for one in held
    ]


def prior_alarms(predictive: "PriorPredictive") -> list[str]:
    """Return reasons against the use of the priors."""
    messages = []
    if predictive.diverged.mean() > MAX_LOST_SHARE:
        messages.append(f"most draws from the prior diverge ({_percent(predictive.diverged)}): {_mend(predictive)}")
    elif predictive.settled is not None and not most_have(predictive.settled.speed):
        none = _percent(np.isnan(predictive.settled.speed))
        messages.append(f"most draws from the prior reach no steady speed ({none}): {_mend(predictive)}")
    return messages + [
        f"the prior misses the {_measured(predictive, one.channel)} ({one.held:.0%} inside its 90 % range): "
        "check units, signs and the channel map, then move or widen the priors"
        for one in predictive.channels
        if one.held < HARDLY_SHARE
    ]


def prior_cautions(predictive: "PriorPredictive") -> list[str]:
    """Return recommended corrections of the priors."""
    messages, settled = [], predictive.settled
    has_motion = predictive.diverged.mean() <= MAX_LOST_SHARE and (settled is None or most_have(settled.speed))
    if predictive.lost.mean() > MAX_ODD_SHARE and has_motion:
        none = "diverge" if settled is None else "diverge or reach no steady speed"
        stiff = bool(predictive.stiff.sum() > 0.5 * predictive.lost.sum())
        what = (
            f"of the draws from the prior change too quickly for steps of {predictive.step:.3g} s, and diverge: {_mend(predictive)}. "
            "Shorter steps help too: sample_time of [design], step of [import]"
            if stiff
            else f"of the draws from the prior are unphysical (they {none}): {_mend(predictive)}"
        )
        messages.append(f"{_percent(predictive.lost)} {what}")
    missed = any(one.held < HARDLY_SHARE for one in predictive.channels)
    if settled is not None and most_have(settled.speed) and not missed:
        low, high = np.nanquantile(np.abs(settled.speed), (QUANTILE_LEVELS[0], QUANTILE_LEVELS[-1]))
        if high > WIDE * low:
            widest = max((item for item in predictive.believed if item.alone), key=_width)
            messages.append(
                f"the prior is wide: 90 % of its steady speeds lie between {low:.2g} and {high:.2g} m/s, mostly "
                f"because of {widest.name}. If you know the vehicle better, narrow the priors: the evidence depends on them"
            )
    return messages + [
        f"the prior covers only part of the {_measured(predictive, one.channel)} ({one.held:.0%} inside its 90 % range): "
        "move or widen the priors"
        for one in predictive.channels
        if HARDLY_SHARE <= one.held < HELD_SHARE
    ]


def range_words(values: np.ndarray, unit: str) -> str:
    """Return median and 90 % range over the draws that have the quantity; words if most have none."""
    if not most_have(values):
        return "most draws have none"
    low, middle, high = np.nanquantile(values, (0.05, 0.5, 0.95))
    which = "draws" if np.isnan(values).mean() <= MAX_ODD_SHARE else "draws that have one"
    return f"{middle:.3g} {unit}, 90 % of {which} {low:.3g} to {high:.3g} {unit}"


def _row(item: "Believed", factor: float, unit: str, named: bool) -> tuple[str, ...]:
    numbers = (f"{factor * value:.4g}" for value in item.quantiles)
    return item.name, *numbers, unit, _reach(item, named)


def _reach(item: "Believed", named: bool) -> str:
    if item.alone is None:
        return ""
    channel, *ends = vars(item.alone).values()
    if np.isnan(ends).any():
        return "none"
    if ends[1] - ends[0] < STILL_RANGE:
        return "no motion in this trial"
    factor, unit = shown_unit(channel)
    low, high = (f"{factor * end:.3g}" for end in ends)
    return f"{channel} " * named + f"{low} to {high} {unit}"


def _moving(predictive: "PriorPredictive") -> str:
    """Return how to move a control that stays at its trim; empty if all move."""
    still = [name for name, values in predictive.control.items() if np.ptp(values) == 0]
    return f": `together` of [design] moves {listed(still)} as well" if still else ""


def _measured(predictive: "PriorPredictive", channel: str) -> str:
    return "measured speeds" if predictive.settled is not None else f"measured {channel}"


def _width(item: "Believed") -> float:
    assert item.alone is not None
    return float(np.nan_to_num(item.alone.high - item.alone.low, nan=np.inf))


def _verdict(held: float) -> str:
    if held < HARDLY_SHARE:
        return "the prior misses them"
    return "the prior covers them" if held >= HELD_SHARE else "the prior covers part of them"


def _percent(which: np.ndarray) -> str:
    share = float(np.mean(which))
    return f"{share:.1%}" if 0 < share < 0.1 else f"{share:.0%}"


def _mend(predictive: "PriorPredictive") -> str:
    """Return the coefficient that best separates draws without a motion, and its correction."""
    worst = max(predictive.believed, key=lambda item: abs(item.blame))
    if worst.name in predictive.unphysical:
        return _cut(predictive, worst.name)
    also = f", and {_cut(predictive, predictive.unphysical[0])}" if predictive.unphysical else ""
    if worst.blame == 0.0:
        return f"check the signs and units of the priors{also}"
    end = "upper" if worst.blame > 0 else "lower"
    narrow = f"narrow [prior.{worst.name}] there, by a bound or a smaller sd, scale or factor"
    return f"the cause is {worst.name} near the {end} end of its prior; {narrow}{also}"


def _cut(predictive: "PriorPredictive", name: str) -> str:
    """Return how to restrict the prior of a coefficient to physical values; that of a published vehicle may have no section."""
    words = f"set dissipative = true in [prior.{name}]"
    if predictive.settled is not None:
        return words
    low, middle, high = next(item.quantiles for item in predictive.believed if item.name == name)
    sd = (high - low) / (2 * Z90)
    added = f'distribution = "normal", mean = {middle:.2g}, sd = {sd:.2g} and dissipative = true'
    return f"{words}; if the file has no such section, add it with {added}"
