"""What a table of a log holds, gathered while it streams by: of each column a range, of each clock the sums of its steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from seatrial.core.units import to_si
from seatrial.logs.formats.protocol import TIME_UNITS, Block, TableInfo, time_unit_at_end
from seatrial.logs.formats.unit_in_name import ENDINGS, name_and_units
from seatrial.logs.time_stamps import fitting_unit, is_plausible, likelier_unit, lost_after

# Steps up, without one down, of a column that is taken for a clock though its name does not say so
MIN_CLOCK_STEPS = 10
# Seconds, and share of the shorter duration, by both of which two clocks of one table must differ to disagree
_CLOCK_DIFFERENCE, _CLOCK_DIFFERENCE_SHARE = 0.5, 0.01
MIN_BURST_SPREAD = 0.5  # Standard deviation of the step, as a share of the mean step, from which rows come in bursts
# Standard deviation of the step, as a share of it, below which a clock may count rows, and above which another shows
# that it does
_EVEN_SPREAD, _UNEVEN_SPREAD = 1e-5, 1e-3
_SMALLEST_SHOWN, _LARGEST_SHOWN = 1e-6, 1e15
_LONGEST_STEP = 1e18  # A step, in seconds, beyond which the sums would overflow


@dataclass(frozen=True)
class ColumnSummary:
    """One column as in the log, in the unit of the log; NaN if it has no number.

    Attributes:
        name: of the column.
        unit: as the log states it, if it does.
        count: finite numbers.
        rows: rows in all.
        infinite: numbers that are not finite.
        least: smallest number.
        greatest: largest number.
        mean: of the finite numbers.
        sd: their standard deviation about it.
    """

    name: str
    unit: str | None
    count: int
    rows: int
    infinite: int
    least: float
    greatest: float
    mean: float = math.nan
    sd: float = math.nan

    @property
    def missing(self) -> float:
        """Share of rows without a number."""
        return 1.0 - (self.count + self.infinite) / self.rows if self.rows else 1.0

    @property
    def constant(self) -> bool:
        """Whether it never changes."""
        return self.count > 0 and self.least == self.greatest

    @property
    def trouble(self) -> str:
        """What makes it doubtful, in a word; empty for a column that may be mapped."""
        size = max(abs(self.least), abs(self.greatest)) if self.count else 0.0
        if not self.count:
            return "no number"
        if self.infinite:
            return f"{self.infinite} infinite"
        if 0 < size < _SMALLEST_SHOWN or size > _LARGEST_SHOWN:
            return f"garbage? ({size:.1g} at most)"
        return "constant" if self.constant else ""


@dataclass(frozen=True)
class ClockSummary:
    """A column as a clock; times in seconds.

    Attributes:
        name: of the column.
        unit: of its stamps.
        duration: from the first stamp to the last.
        rate: rows per second, Hz, without gaps in which rows were lost.
        jitter: standard deviation of the step, without these.
        gap: longest step.
        repeated: stamps equal to the one before.
        backward: stamps earlier than the one before.
        holes: in which rows were lost.
        lost: their length, all together.
        is_named: whether its name says that it is a clock; else it was taken for one because it rises in every row.
    """

    name: str
    unit: str
    duration: float
    rate: float
    jitter: float
    gap: float
    repeated: int
    backward: int
    holes: int = 0
    lost: float = 0.0
    is_named: bool = True

    @property
    def moves(self) -> bool:
        """Whether it was set at all."""
        return self.duration != 0


@dataclass(frozen=True)
class TableSummary:
    """One table: its clocks, the best first, and its columns."""

    info: TableInfo
    rows: int
    clocks: tuple[ClockSummary, ...]
    columns: tuple[ColumnSummary, ...]

    @property
    def clock(self) -> ClockSummary | None:
        """The first clock that moves and never runs back, else the first that moves."""
        moving = [clock for clock in self.clocks if clock.moves]
        return next((clock for clock in moving if not clock.backward), moving[0] if moving else None)


@dataclass(eq=False)
class _Column:
    """Running range of one column, and its mean and sum of squares about that (Chan, Golub and LeVeque, 1979)."""

    count: int = 0
    infinite: int = 0
    least: float = math.inf
    greatest: float = -math.inf
    mean: float = 0.0
    squares: float = 0.0

    def summary(self, name: str, unit: str | None, rows: int) -> ColumnSummary:
        if not self.count:
            return ColumnSummary(name, unit, 0, rows, self.infinite, math.nan, math.nan)
        sd = math.sqrt(self.squares / self.count)
        return ColumnSummary(name, unit, self.count, rows, self.infinite, self.least, self.greatest, self.mean, sd)

    def take(self, values: np.ndarray) -> None:
        if values.dtype.kind == "f":
            self.infinite += int(np.isinf(values).sum())
            values = values[np.isfinite(values)]
        if values.size:
            self.least = min(self.least, float(values.min()))
            self.greatest = max(self.greatest, float(values.max()))
            with np.errstate(over="ignore", invalid="ignore"):
                mean, before = float(values.mean()), self.count
                self.count += values.size
                share, apart = values.size / self.count, mean - self.mean
                self.squares += float(((values - mean) ** 2).sum()) + apart * apart * before * share
                self.mean += apart * share


@dataclass(eq=False)
class _Clock:
    """Running sums of a clock's steps, about a typical one so that nothing cancels; in another unit where no log has such steps in that of
    the name, and in the likeliest where no name tells the unit."""

    unit: str
    is_named: bool = True
    first: np.ndarray | None = None
    last: np.ndarray | None = None
    typical: float = 0.0
    steps: int = 0
    total: float = 0.0
    squares: float = 0.0
    gap: float = 0.0
    repeated: int = 0
    backward: int = 0
    holes: int = 0
    lost: float = 0.0

    @property
    def scale(self) -> float:
        """Seconds in one unit."""
        return to_si(1.0, self.unit, "s", "clock")

    @property
    def rises(self) -> bool:
        """Whether every stamp so far is later than the one before."""
        return not (self.repeated or self.backward)

    @property
    def unevenness(self) -> tuple[bool, float]:
        """Return what is least of the most even clock: whether it counts rows one by one, and how much its steps differ, to a millionth."""
        spread = math.sqrt(max(self.squares / self.steps - (self.total / self.steps) ** 2, 0.0))
        counts_rows = spread == 0 and self.typical == self.scale
        return counts_rows, round(spread / abs(self.typical + self.total / self.steps), 6)

    def take(self, stamps: np.ndarray) -> None:
        stamps = stamps[np.isfinite(stamps)]
        if not stamps.size:
            return
        if self.first is None or self.last is None:
            self.first, joined = stamps[:1].copy(), stamps
            with np.errstate(over="ignore"):
                step = np.diff(stamps)
            usual = abs(float(np.median(step))) if step.size else 0.0
            self.unit = self.unit or (likelier_unit(usual, "s") if usual else None) or "s"
            if step.any() and not is_plausible(stamps * self.scale):
                self.unit = fitting_unit(usual)
            self.typical = (
                float(np.clip(np.median(step) * self.scale, -_LONGEST_STEP, _LONGEST_STEP)) if step.size else 0.0
            )
        else:
            joined = np.concatenate([self.last, stamps])
        self.last = stamps[-1:].copy()
        with np.errstate(over="ignore"):
            step = np.clip(np.diff(joined).astype(float) * self.scale, -_LONGEST_STEP, _LONGEST_STEP)
        if step.size:
            holes = lost_after(np.cumsum(np.append(0.0, step)))
            self.holes += holes.size
            self.lost += float(step[holes].sum())
            usual = np.delete(step, holes)
            self.steps += usual.size
            self.total += float((usual - self.typical).sum())
            self.squares += float(((usual - self.typical) ** 2).sum())
            self.gap = max(self.gap, float(step.max()))
            self.repeated += int((step == 0).sum())
            self.backward += int((step < 0).sum())

    def summary(self, name: str) -> ClockSummary:
        if self.first is None or self.last is None or not self.steps:
            return ClockSummary(name, self.unit, 0.0, math.nan, math.nan, 0.0, 0, 0, is_named=self.is_named)
        duration = float((self.last - self.first)[0]) * self.scale
        mean = self.total / self.steps
        jitter = math.sqrt(max(self.squares / self.steps - mean**2, 0.0))
        rate = self.steps / (duration - self.lost) if duration > self.lost else math.nan
        faults = (self.repeated, self.backward, self.holes, self.lost)
        return ClockSummary(name, self.unit, duration, rate, jitter, self.gap, *faults, self.is_named)


@dataclass(eq=False)
class Gathered:
    """What is kept of one table while it streams by; where no name tells the clock, every column is tried as one as long as it rises."""

    info: TableInfo
    rows: int = 0
    columns: dict[str, _Column] = field(default_factory=dict)
    clocks: dict[str, _Clock] = field(default_factory=dict)

    def __post_init__(self):
        self.columns = {column.name: _Column() for column in self.info.columns}
        for name in self.info.clocks:
            unit = self.info.unit(name)
            if unit in TIME_UNITS:
                self.clocks[name] = _Clock(unit)
        if not self.clocks:
            tried = [name for name in self.columns if _may_be_time(name, self.info.unit(name))]
            self.clocks = {name: _Clock(time_unit_at_end(name) or "", is_named=False) for name in tried}

    def take(self, block: Block) -> None:
        """Add some rows."""
        for name, values in block.columns.items():
            self.columns[name].take(values)
        for name, clock in self.clocks.items():
            clock.take(block.columns[name])
        self.clocks = {name: clock for name, clock in self.clocks.items() if clock.is_named or clock.rises}
        self.rows += len(next(iter(block.columns.values()), ()))

    def summary(self) -> TableSummary:
        """Sum up."""
        units = {column.name: column.unit for column in self.info.columns}
        columns = tuple(one.summary(name, units[name], self.rows) for name, one in self.columns.items())
        clocks = tuple(clock.summary(name) for name, clock in self._found(columns).items())
        return TableSummary(self.info, self.rows, clocks, columns)

    def _found(self, columns: Sequence[ColumnSummary]) -> dict[str, _Clock]:
        """Return the clocks that are named; without any, the most even of the columns that rise in every row, if one does."""
        if any(clock.is_named for clock in self.clocks.values()):
            return self.clocks
        whole = {one.name for one in columns if one.count == self.rows}
        rising = [name for name, clock in self.clocks.items() if name in whole and clock.steps >= MIN_CLOCK_STEPS]
        return {name: self.clocks[name] for name in sorted(rising, key=lambda name: self.clocks[name].unevenness)[:1]}


def clock_summary(name: str, unit: str, stamps: np.ndarray) -> ClockSummary:
    """Return a column as a clock.

    Args:
        name: of the column.
        unit: of its stamps.
        stamps: as logged, shape (n,).
    """
    clock = _Clock(unit)
    clock.take(stamps)
    return clock.summary(name)


def disagreement(clocks: Sequence[ClockSummary]) -> str:
    """Report that clocks of one table run over different times, and which of them may count rows; empty if none does.

    Times of arrival in bursts are left out: the first rows may have come late by seconds.
    """
    named = [
        one
        for one in clocks
        if one.is_named and one.moves and not one.backward and one.jitter <= MIN_BURST_SPREAD / one.rate
    ]
    if len(named) < 2:
        return ""
    short, long = (best(named, key=lambda one: one.duration) for best in (min, max))
    if long.duration - short.duration <= max(_CLOCK_DIFFERENCE, _CLOCK_DIFFERENCE_SHARE * short.duration):
        return ""
    spread = {one.name: one.jitter * one.rate for one in (short, long)}
    even = [name for name, share in spread.items() if share < _EVEN_SPREAD]
    counted = (
        f": {even[0]} has an even step, and may count rows by a nominal one"
        if len(even) == 1 and max(spread.values()) > _UNEVEN_SPREAD
        else ": the unit of one may be wrong, or one may jump"
    )
    return f"clocks disagree: {short.name} runs over {short.duration:.6g} s, {long.name} over {long.duration:.6g} s{counted}"


def _may_be_time(name: str, stated: str | None) -> bool:
    """Return whether neither the unit of a column nor that in its name, as in `depth_m` or `rpm`, is one of something else than time."""
    lower = name.lower().replace(" ", "_")
    units = (stated,) if stated else name_and_units(lower).units or ENDINGS.get(lower, ())
    return not units or any(unit in TIME_UNITS for unit in units)
