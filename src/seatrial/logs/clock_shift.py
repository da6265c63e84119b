"""How far the clocks of two logs differ: the shift at which something that both recorded correlates best."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from seatrial.core.errors import InputError
from seatrial.core.units import to_si
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import format_of
from seatrial.logs.guess import Guess
from seatrial.logs.log_table import read_stamped
from seatrial.logs.source import LogSource
from seatrial.logs.summary import TableSummary

MAX_STEPS = 1 << 17  # Steps of the grid on which the longer of two curves is compared, at most
MIN_OVERLAP = 0.5  # Share of the shorter curve that has to lie on the other
MIN_COMMON_STEPS = 16  # Steps in common, at least
# Share of the best correlation from which another shift is worth naming, and down to which a shift is as good as the
# best
RIVAL_SHARE, BEST_SHARE = 0.95, 0.99


class Samples(NamedTuple):
    """A curve in one log: times, s, increasing, and values, NaN if there is none; shape (n,)."""

    time: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]


class ClockShift(NamedTuple):
    """How far two clocks differ.

    Attributes:
        shift: what to add to the stamps of the second log, s.
        correlation: there.
        rival: another shift that fits almost as well, s; None if there is none.
        lower: least shift about the best one whose correlation is nearly as high, s: how sharp the peak is.
        upper: largest such shift, s.
    """

    shift: float
    correlation: float
    rival: float | None
    lower: float
    upper: float

    def later(self, seconds: float) -> "ClockShift":
        """Return the same of a second log whose stamps are less by so many seconds."""
        rival = None if self.rival is None else self.rival + seconds
        moved = {"shift": self.shift + seconds, "lower": self.lower + seconds, "upper": self.upper + seconds}
        return self._replace(rival=rival, **moved)


def shift_between(first: Samples, second: Samples) -> ClockShift:
    """Find the shift of the second curve's clock at which it correlates best with the first, of either sign.

    Both curves become means over the steps of one grid, as long as the slower of the two samples. At each shift by whole steps Pearson's
    correlation is that of the part in common; a parabola through the best and its neighbours gives the fraction of a step.

    Args:
        first: the curve whose clock is kept.
        second: the same quantity, or one that follows it without delay: a delay between the two would be part of the shift.

    Raises:
        InputError: a curve that is too short or never moves.
    """
    first, second = (_known(one, name) for one, name in ((first, "first"), (second, "second")))
    longest = max(np.ptp(first.time), np.ptp(second.time))
    step = max(*(float(np.median(np.diff(one.time))) for one in (first, second)), longest / MAX_STEPS)
    a, b = (_means(one, step) for one in (first, second))
    lag, correlation = _correlations(a, b)
    if lag.size == 0 or not np.isfinite(correlation).any():
        raise InputError(
            "two curves to align",
            found=f"{a.size} and {b.size} steps of {step:.3g} s, of which no {MIN_COMMON_STEPS} in common move",
            expected="curves that both move while they overlap",
            remedy="choose other columns, or type the shift",
        )
    size = np.nan_to_num(np.abs(correlation), nan=-1.0)
    best = int(np.argmax(size))
    around = size[max(best - 1, 0) : best + 2]
    part = vertex(around) if around.min() >= 0 else 0.0
    before, after = np.append(-np.inf, size[:-1]), np.append(size[1:], -np.inf)
    peaks = (size >= before) & (size > after) & (size > RIVAL_SHARE * size[best])
    peaks[best] = False
    rival = int(np.argmax(np.where(peaks, size, -np.inf))) if peaks.any() else None
    between, place = float(first.time[0] - second.time[0]), float(lag[best]) + part
    left, right = (_reach(size[::way], at) for way, at in ((-1, size.size - 1 - best), (1, best)))
    return ClockShift(
        between + place * step,
        float(correlation[best]),
        None if rival is None else between + float(lag[rival]) * step,
        between + min(lag[best] - left, place) * step,
        between + max(lag[best] + right, place) * step,
    )


def _reach(size: Float[np.ndarray, " l"], best: int) -> float:
    """Return how many steps after the best one the correlation is nearly as high, by straight lines between the steps."""
    after, level = size[best:], BEST_SHARE * size[best]
    below = np.flatnonzero(after < level)
    if not below.size:
        return float(after.size - 1)
    end = int(below[0])
    return end - 1 + float((after[end - 1] - level) / (after[end - 1] - after[end]))


def _known(curve: Samples, name: str) -> Samples:
    is_present = np.isfinite(curve.value) & np.isfinite(curve.time)
    known = Samples(np.asarray(curve.time, float)[is_present], np.asarray(curve.value, float)[is_present])
    if known.time.size < MIN_COMMON_STEPS or np.ptp(known.value) == 0 or not np.ptp(known.time) > 0:
        raise InputError(
            f"the {name} curve to align",
            found=f"{known.time.size} numbers" + (", all the same" if known.time.size >= MIN_COMMON_STEPS else ""),
            expected=f"at least {MIN_COMMON_STEPS} that move",
            remedy="choose another column, or type the shift",
        )
    return known


def _means(curve: Samples, step: float) -> Float[np.ndarray, " m"]:
    """Means of the straight lines between the samples over each step from the first sample on, less the mean of all."""
    count = max(int(np.ptp(curve.time) / step), 1)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (curve.value[1:] + curve.value[:-1]) * np.diff(curve.time))])
    edges = curve.time[0] + step * np.arange(count + 1)
    inside = np.clip(np.searchsorted(curve.time, edges, side="right") - 1, 0, curve.time.size - 2)
    past = edges - curve.time[inside]
    slope = np.diff(curve.value)[inside] / np.diff(curve.time)[inside]
    means = np.diff(area[inside] + past * (curve.value[inside] + 0.5 * slope * past)) / step
    return means - means.mean()


def _correlations(
    a: Float[np.ndarray, " m"], b: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " l"], Float[np.ndarray, " l"]]:
    """Shifts by whole steps with enough in common, and Pearson's correlation of a[i + shift] and b[i] at each; NaN if one is flat."""
    lag = np.arange(1 - b.size, a.size)
    start, stop = np.maximum(lag, 0), np.minimum(a.size, b.size + lag)
    count = stop - start
    size = 1 << int(np.ceil(np.log2(a.size + b.size)))
    product = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)[lag]
    sum_a, square_a = (sums_between(values, start, stop) for values in (a, a**2))
    sum_b, square_b = (sums_between(values, start - lag, stop - lag) for values in (b, b**2))
    spread = (square_a - sum_a**2 / count, square_b - sum_b**2 / count)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = (product - sum_a * sum_b / count) / np.sqrt(spread[0] * spread[1])
    flat = (spread[0] <= 1e-9 * square_a.max()) | (spread[1] <= 1e-9 * square_b.max())
    enough = count >= max(MIN_COMMON_STEPS, MIN_OVERLAP * min(a.size, b.size))
    return lag[enough], np.where(flat, np.nan, np.clip(correlations, -1.0, 1.0))[enough]


def sums_between(
    values: Float[np.ndarray, " n"], first: Int[np.ndarray, " l"], last: Int[np.ndarray, " l"]
) -> Float[np.ndarray, " l"]:
    """Return sums of neighbouring values, from each `first` to before its `last`."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return total[last] - total[np.minimum(first, last)]


def vertex(three: Float[np.ndarray, " n"]) -> float:
    """Return the place of the top of the parabola through three neighbours, from the middle one, in steps; 0 if there are fewer."""
    if three.size < 3 or (bend := three[0] - 2 * three[1] + three[2]) >= 0:
        return 0.0
    return float(np.clip(0.5 * (three[0] - three[2]) / bend, -0.5, 0.5))


# Do the clocks of several logs of one run meet? If not, by how much they differ, found where both logs hold one
# quantity.

MIN_CORRELATION = 0.5  # Correlation from which a shift is offered


@dataclass(frozen=True)
class ClocksApart:
    """Two logs whose stamps do not overlap.

    Attributes:
        first: name of the log whose clock is kept.
        later: from its first stamp to that of the second log, s.
        channel: that both logs hold and that tells the shift; empty if none does.
        shift: of the second log's clock.
    """

    first: str
    later: float
    channel: str = ""
    shift: ClockShift | None = None

    @property
    def words(self) -> str:
        """In a sentence, with what to do."""
        side = "after" if self.later > 0 else "before"
        apart = f"the clocks do not meet: its first stamp is {abs(self.later):.6g} s {side} that of {self.first}"
        if self.shift is None:
            return (
                f"{apart}, and no quantity in both logs gives the shift. Find an event in both, such as a start or a turn, and add to "
                'this log shift = "… s", the seconds to add to its stamps'
            )
        return f'{apart}; shift = "{self.shift.shift:.3f} s" adds the difference: {self.surety}'

    @property
    def surety(self) -> str:
        """How sure the shift is; empty if there is none."""
        if self.shift is None:
            return ""
        rival = "" if self.shift.rival is None else f"; {self.shift.rival:.3f} s fits almost as well"
        half = (self.shift.upper - self.shift.lower) / 2
        return f"{self.channel} is in both logs, correlation {self.shift.correlation:.3f}, ± {half:.2g} s{rival}"


def clocks_apart(
    first: LogFile,
    second: LogFile,
    tables: tuple[Sequence[TableSummary], Sequence[TableSummary]],
    guessed: tuple[Sequence[Guess], Sequence[Guess]],
) -> ClocksApart | None:
    """Return by how much the clocks of two logs differ; None if their stamps overlap, or a log has no clock.

    Args:
        first: log whose clock is kept.
        second: the other.
        tables: of both.
        guessed: a column for each channel, of both.
    """
    spans = [span for some, guesses in zip(tables, guessed, strict=True) if (span := _span(some, guesses)) is not None]
    if len(spans) < 2 or (spans[0][0] < spans[1][1] and spans[1][0] < spans[0][1]):
        return None
    name, later = first.path.name, spans[1][0] - spans[0][0]
    others = {guess.channel: guess for guess in guessed[1]}
    best = ClocksApart(name, later)
    for one in (guess for guess in guessed[0] if guess.channel in others):
        try:
            (epoch, kept), (other_epoch, other) = (
                _samples(first, tables[0], one),
                _samples(second, tables[1], others[one.channel]),
            )
            shift = shift_between(kept, other).later(float(epoch - other_epoch))
        except InputError:  # a curve that never moves tells nothing; the sentence says what to do then
            continue
        if abs(shift.correlation) >= max(MIN_CORRELATION, abs(best.shift.correlation) if best.shift else 0.0):
            best = ClocksApart(name, later, one.channel, shift)
    return best


def _span(tables: Sequence[TableSummary], guessed: Sequence[Guess]) -> tuple[float, float] | None:
    """First and last stamp of the table of the first guess, s."""
    table = next((one for one in tables if guessed and one.info.name == guessed[0].table), None)
    clock = table.clock if table else None
    if table is None or clock is None:
        return None
    column = next((one for one in table.columns if one.name == clock.name and one.count), None)
    scale = to_si(1.0, clock.unit, "s", "clock")
    return None if column is None else (column.least * scale, column.greatest * scale)


def _samples(log: LogFile, tables: Sequence[TableSummary], guess: Guess) -> tuple[Decimal, Samples]:
    clock = next(one.clock for one in tables if one.info.name == guess.table)
    if clock is None:
        raise InputError(log.path.name, found="no clock", expected="a clock", remedy="name the column of time")
    text = asdict(log.layout) if format_of(log.path).is_text else {}
    read = read_stamped(
        LogSource(log.path, clock.name, clock.unit, {}, table=guess.table if len(tables) > 1 else None, **text),
        [guess.column],
    )
    return read.epoch, Samples(read.time, read.numbers(guess.column))
