"""Do the clocks of several logs of one run meet? If not, by how much they differ, found where both logs hold one quantity."""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from seatrial.core.errors import InputError
from seatrial.core.units import to_si
from seatrial.logs.clock_shift import ClockShift, Samples, shift_between
from seatrial.logs.formats.protocol import LogFile
from seatrial.logs.formats.registry import format_of
from seatrial.logs.guess import Guess
from seatrial.logs.log_table import read_stamped
from seatrial.logs.source import LogSource
from seatrial.logs.summary import ClockSummary, TableSummary

MIN_CORRELATION = 0.5
"""Correlation from which a shift is offered."""


@dataclass(frozen=True)
class ClocksApart:
    """Two logs whose stamps do not overlap.

    Attributes:
        first: name of the log whose clock is kept.
        later: from its first stamp to that of the second log, s.
        channel: that both logs hold and that tells the shift; empty where none does.
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
                f"{apart}, and no quantity that both logs hold tells the shift. Find something that both recorded, such as a "
                'start or a turn, and add to this log shift = "… s", the seconds to add to its stamps'
            )
        return f'{apart}; shift = "{self.shift.shift:.3f} s" adds what is missing: {self.surety}'

    @property
    def surety(self) -> str:
        """How sure the shift is; empty where there is none."""
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
    """Return by how much the clocks of two logs differ; None where their stamps overlap, or a log has no clock.

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


def _clock(tables: Sequence[TableSummary], guess: Guess) -> tuple[TableSummary, ClockSummary] | None:
    table = next(one for one in tables if one.info.name == guess.table)
    return None if table.clock is None else (table, table.clock)


def _span(tables: Sequence[TableSummary], guessed: Sequence[Guess]) -> tuple[float, float] | None:
    """First and last stamp of the table of the first guess, s."""
    known = _clock(tables, guessed[0]) if guessed else None
    if known is None:
        return None
    table, clock = known
    column = next((one for one in table.columns if one.name == clock.name and one.count), None)
    scale = to_si(1.0, clock.unit, "s", "clock")
    return None if column is None else (column.least * scale, column.greatest * scale)


def _samples(log: LogFile, tables: Sequence[TableSummary], guess: Guess) -> tuple[Decimal, Samples]:
    known = _clock(tables, guess)
    if known is None:
        raise InputError(log.path.name, found="no clock", expected="a clock", remedy="name the column of time")
    layout = log.layout
    of_text = {"delimiter": layout.delimiter, "skip_rows": layout.skip_rows, "encoding": layout.encoding}
    text = of_text if format_of(log.path).is_text else {}
    read = read_stamped(
        LogSource(log.path, known[1].name, known[1].unit, {}, table=guess.table if len(tables) > 1 else None, **text),
        [guess.column],
    )
    return read.epoch, Samples(read.time, read.numbers(guess.column))
