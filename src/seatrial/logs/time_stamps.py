"""Time stamps of a log: read exactly, then trusted, thinned, or rebuilt from arrivals in bursts.

Rows that leave a source evenly, at a + b k, arrive at t_k = a + b k + d_k with delays d_k >= 0. The clock is the
line below every arrival with the least total delay: min sum_k (t_k - a - b k) subject to t_k >= a + b k, a linear
programme solved by the edge of the lower convex hull that spans the middle row. Where rows were lost k goes on without
them, so that the line is sought for each stretch between such holes.
"""

import math
from collections.abc import Callable
from decimal import Decimal

import numpy as np
from jaxtyping import Float, Int

from seatrial.core.errors import InputError
from seatrial.core.record import check_time
from seatrial.core.units import to_si
from seatrial.logs.source import Clock

_PLAUSIBLE_STEP = (1e-5, 1e3)
_USUAL_STEP = 0.03
_SHORT_STEP, _LONG_STEP = 1e-3, 10.0  # Seconds between samples below and above which the unit of a clock is doubted
_COMMON_UNITS = ("ns", "us", "ms", "s", "min")
_HOLE_SPACINGS, _HOLE_SECONDS = 20.0, 1.0  # Usual spacings and seconds beyond both of which a spacing is a hole
# Lengths of a hole on either side that tell the usual pace, and times this pace from which rows after it had only been
# held back
_AROUND_LENGTHS, _CAUGHT_UP_PACE = 4.0, 2.0


def hole_from(usual: float) -> float:
    """Return the spacing, s, beyond which samples that usually come every `usual` seconds have a hole."""
    return max(_HOLE_SECONDS, _HOLE_SPACINGS * usual)


def lost_after(time: Float[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
    """Return the rows after which others were lost: a hole follows, and then rows come no quicker than around it.

    Rows that were only held back come quicker than usual after the hole: about four times as many in a quarter of its length.

    Args:
        time: stamps, s, shape (n,); one that runs back counts as the latest before it.
    """
    time = np.maximum.accumulate(time)
    step = np.diff(time)
    if not (step > 0).any():
        return np.empty(0, int)
    at = np.flatnonzero(step > hole_from(float(np.median(step[step > 0]))))
    begin, end, length = time[at], time[at + 1], step[at]

    def rows_until(instant: np.ndarray) -> np.ndarray:
        return np.searchsorted(time, instant, side="right") - (at + 2)

    left, right = (
        np.maximum(begin - _AROUND_LENGTHS * length, time[0]),
        np.minimum(end + _AROUND_LENGTHS * length, time[-1]),
    )
    before = at - np.searchsorted(time, left)
    pace = (before + rows_until(right)) / np.maximum(begin - left + right - end, 1e-9)
    after = np.minimum(end + length / 4, time[-1])
    return at[rows_until(after) < _CAUGHT_UP_PACE * pace * (after - end)]


def elapsed(
    stamps: Int[np.ndarray, " n"] | Float[np.ndarray, " n"] | list[str], scale: Decimal
) -> tuple[Float[np.ndarray, " n"], Decimal]:
    """Return the time since the first stamp, subtracted before anything is rounded.

    Args:
        stamps: whole numbers as int64, floats of a binary log, or decimal numbers as text.
        scale: seconds in one unit.

    Returns:
        seconds since the first stamp, shape (n,), and that stamp in seconds, exactly.
    """
    if isinstance(stamps, np.ndarray):
        whole = stamps.dtype.kind == "i"
        count, first = (stamps - stamps[0]).astype(float), Decimal(int(stamps[0]) if whole else repr(float(stamps[0])))
    else:
        decimals = [Decimal(text) for text in stamps]
        first = decimals[0]
        count = np.array([float(value - first) for value in decimals])
    # Dividing by a whole number of units per second rounds once; multiplying by 1e-9 would round twice.
    return (count / float(1 / scale) if scale < 1 else count * float(scale)), first * scale


def checked_time(
    time: Float[np.ndarray, " n"], clock: Clock, line_of: Callable[[int], int], where: str
) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"], list[str]]:
    """Apply the chosen clock.

    Args:
        time: stamps, s.
        clock: which.
        line_of: line of a row in the file, for errors.
        where: file and column, for errors.

    Returns:
        strictly increasing time, s; the rows kept; and notes.

    Raises:
        InputError: time running backwards, or repeated stamps where the clock is `as_stamped`.
    """
    rows = np.arange(time.size)
    moving = rows if clock == "as_stamped" else np.flatnonzero(np.diff(time, prepend=-np.inf) != 0)
    _check_increasing(time[moving], moving, line_of, where)
    if clock == "even":
        rebuilt, notes = even_clock(time)
        _check_increasing(rebuilt, rows, line_of, where)
        return rebuilt, rows, notes
    dropped = time.size - moving.size
    return time[moving], moving, [f"{dropped} of {time.size} rows repeated a stamp and were dropped"] if dropped else []


def even_clock(arrival: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], list[str]]:
    """Rebuild the evenly spaced clock a + b k below arrival times that come in bursts, for each stretch between holes.

    The line rests on two rows and shares their delays: between them no rebuilt time is later than the truth by more
    than the greater of the two. A delay common to all rows cannot be told from a later clock; single rows that were lost
    shift the clock, which shows in the last note.

    Args:
        arrival: s, not decreasing.

    Returns:
        rebuilt time, s, and notes with the period and the delays.
    """
    stretches = np.split(arrival, lost_after(arrival) + 1)
    time = np.concatenate([_even_stretch(stretch) for stretch in stretches])
    longest = time[: stretches[0].size] if len(stretches) == 1 else _even_stretch(max(stretches, key=len))
    delay = np.maximum(arrival - time, 0.0)
    quiet = max(part.min() for part in np.array_split(delay, min(10, delay.size)))
    parts = f" in each of {len(stretches)} stretches, separated by lost rows" if len(stretches) > 1 else ""
    return time, [
        f"clock rebuilt{parts}: period {(longest[-1] - longest[0]) / max(longest.size - 1, 1):.6g} s. Rows arrived "
        f"{np.median(delay):.3g} s late at the median and "
        f"{delay.max():.3g} s at most; in every tenth of the rows one was at most {quiet:.2g} s late"
    ]


def _even_stretch(arrival: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the evenly spaced clock below the arrivals of rows of which none was lost."""
    index = np.arange(arrival.size)
    middle = (arrival.size - 1) / 2
    left, right = 0, arrival.size - 1
    while right > left:
        period = (arrival[right] - arrival[left]) / (right - left)
        below = int(np.argmin(arrival - period * index))
        drop = arrival[below] - arrival[left] - period * (below - left)
        if drop >= -1e-12 * max(abs(arrival[-1]), 1.0) or below in (left, right):
            return arrival[left] + period * (index - left)
        left, right = (below, right) if below <= middle else (left, below)
    return arrival.copy()


def is_plausible(time: Float[np.ndarray, " n"]) -> bool:
    """Return whether the median or the mean step of stamps, s, is one that a log can have."""
    low, high = _PLAUSIBLE_STEP
    return any(
        low <= abs(float(step)) <= high for step in (np.median(np.diff(time)), (time[-1] - time[0]) / (time.size - 1))
    )


def fitting_unit(step: float) -> str:
    """Return the unit in which a step, as it stands in a log, is nearest to a usual one."""
    far = {name: math.log(max(step * to_si(1.0, name, "s", name), 1e-300) / _USUAL_STEP) for name in _COMMON_UNITS}
    return min(far, key=lambda name: abs(far[name]))


def likelier_unit(step: float, unit: str) -> str | None:
    """Return the unit in which a step, as it stands in a log, is usual, if it is not in the stated one; None if no other is likelier."""
    if _SHORT_STEP <= step * to_si(1.0, unit, "s", unit) <= _LONG_STEP:
        return None
    best = fitting_unit(step)
    return best if best != unit else None


def unit_doubt(time: Float[np.ndarray, " n"], unit: str) -> str:
    """Return which unit would make rows as frequent as a vehicle's log has them, where the stated one does not; empty if it does.

    Args:
        time: s, as the unit says, rising, shape (n,).
        unit: as stated.
    """
    step = float(np.median(np.diff(time)))
    if _SHORT_STEP <= step <= _LONG_STEP:
        return ""
    in_file = step / to_si(1.0, unit, "s", unit)
    best = likelier_unit(in_file, unit)
    question = (
        f'; is it "{best}"? Then it would be one every {in_file * to_si(1.0, best, "s", best):.2g} s' if best else ""
    )
    return f'a row every {step:.2g} s with the unit "{unit}", where {_SHORT_STEP:g} s to {_LONG_STEP:g} s is usual{question}'


def check_unit(time: Float[np.ndarray, " n"], unit: str, where: str) -> None:
    """Refuse a time unit that makes the rows implausibly dense or sparse.

    Args:
        time: s, as the unit says, rising, shape (n,).
        unit: as stated.
        where: file and column, for the error.

    Raises:
        InputError: median and mean step both outside 1e-5 s to 1e3 s; suggests the unit that would fit.
    """
    if is_plausible(time):
        return
    low, high = _PLAUSIBLE_STEP
    step = float(np.median(np.diff(time)))
    in_file = step / to_si(1.0, unit, "s", where)
    best = fitting_unit(in_file)
    raise InputError(
        where,
        found=f'a median step of {step:.3g} s with the time unit "{unit}"',
        expected=f"between {low:g} s and {high:g} s",
        remedy=f'is the unit "{best}"? Then the step would be {in_file * to_si(1.0, best, "s", where):.3g} s',
    )


def _check_increasing(time: np.ndarray, rows: np.ndarray, line_of: Callable[[int], int], where: str) -> None:
    """Check as `check_time`, with the offending row numbered as a text editor shows it, blank lines counted."""
    bad = np.flatnonzero(~(np.diff(time) > 0))
    sample = int(bad[0]) + 1 if bad.size else 0
    check_time(time, where, line_of(int(rows[sample])) - sample)
