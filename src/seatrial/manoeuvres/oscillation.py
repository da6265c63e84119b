"""What a self-oscillating test shows: its reversals, period and overshoots, the indices of a zigzag (IMO MSC.137(76), 2002).

An overshoot is how far the output goes beyond the threshold after the control was reversed; the period is the time from one
reversal to the next but one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from seatrial.manoeuvres.relay import RelayFamily


class Oscillation(NamedTuple):
    """Indices of S runs; NaN where a run has no such reversal.

    Attributes:
        reversals: how often the control was reversed, shape (S,).
        period: median time from one reversal to the next but one, s, shape (S,).
        first_overshoot: of the output, SI, shape (S,).
        second_overshoot: likewise, on the other side.
    """

    reversals: Int[np.ndarray, " S"]
    period: Float[np.ndarray, " S"]
    first_overshoot: Float[np.ndarray, " S"]
    second_overshoot: Float[np.ndarray, " S"]


def oscillation(
    family: RelayFamily, output: Float[np.ndarray, "S n"], seen: Float[np.ndarray, "S n"], threshold: float
) -> Oscillation:
    """Indices of runs of one design.

    Args:
        family: timing, effect and trim.
        output: as it was, SI.
        seen: as the relay saw it, with noise; NaN where it was not measured.
        threshold: change of the output from trim at which the control is reversed, SI.
    """
    at = [_reversals(family, row - family.output_trim, threshold) for row in np.asarray(seen)]
    driven = family.effect * (np.asarray(output) - family.output_trim)
    last = int(np.searchsorted(family.time(), family.start + family.active - 1e-9))
    periods = [np.median(np.diff(times[::2])) if times.size > 2 else np.nan for times in (family.time()[i] for i in at)]
    # The relay begins on the positive side, so that its first reversal is at the top and its second at the bottom.
    first = [_overshoot(row, i, 0, last, threshold) for row, i in zip(driven, at, strict=True)]
    second = [_overshoot(-row, i, 1, last, threshold) for row, i in zip(driven, at, strict=True)]
    return Oscillation(np.array([i.size for i in at]), np.array(periods), np.array(first), np.array(second))


def _reversals(family: RelayFamily, deviation: np.ndarray, threshold: float) -> np.ndarray:
    """Samples at which the relay changes side."""
    elapsed = family.time() - family.start + 1e-9
    driven = np.where((elapsed >= 0) & (elapsed < family.active), family.effect * deviation, np.nan)
    beyond = np.flatnonzero(np.abs(driven) >= threshold)
    sides = np.concatenate([[1.0], -np.sign(driven[beyond])])
    return beyond[np.diff(sides) != 0]


def _overshoot(driven: np.ndarray, at: np.ndarray, which: int, last: int, threshold: float) -> float:
    """Most beyond the threshold from one reversal to the next, or to the end of the test."""
    if at.size <= which:
        return float("nan")
    end = at[which + 1] if at.size > which + 1 else last
    return float(driven[at[which] : end + 1].max() - threshold)
