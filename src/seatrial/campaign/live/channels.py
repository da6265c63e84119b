"""What comes turned into channels in SI on the stream's clock, by the campaign's [import] table, as a log is when it is imported."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal, DecimalException
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.campaign.data.import_logs import log_source, signal_roles
from seatrial.campaign.live.sources import Piece
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLES, OVER_EARTH, QUATERNION, signal_unit
from seatrial.logs.axes import from_axes
from seatrial.logs.formats.protocol import LOG_TIME, ColumnInfo, clocks_among
from seatrial.logs.formats.text_layout import WHITESPACE, signs_of
from seatrial.logs.log_table import curved_cells, in_si
from seatrial.logs.source import ColumnMap, LogSource, check_source, log_file, time_scale
from seatrial.numerics.rotations import angles_of_quaternion, matrix_of_angles

EMPTY_CELLS = ("", "na", "nan", "null", "none")  # Cells of text that hold no value
CLOCK_NAMES = ("time", "t", "time_s")  # Names of the time where a campaign has no [import], s
MAX_STAMP = Decimal("1e11")  # Seconds on a stream's clock, three thousand years, from which a cell holds no time
Say = Callable[[str, str], None]
"""Takes the kind of a fault, which is told once, and the words."""


class Arrival(NamedTuple):
    """One sample.

    Attributes:
        stamp: on the stream's clock, s, exactly.
        part: of the stream that it belongs to, such as the type of its message.
        values: of channels, SI, NaN if a cell was empty.
    """

    stamp: Decimal
    part: int
    values: dict[str, float]


class Channels:
    """Turns pieces of a stream into samples.

    Args:
        campaign: whose [import] table says which column is which channel.
        name: of the stream, for errors.
        say: told what cannot be used.
    """

    def __init__(self, campaign: Campaign, name: str, say: Say):
        self.campaign, self.name, self.say = campaign, name, say
        self.model = campaign.model(campaign.full)
        self.roles = signal_roles(self.model)
        files = () if campaign.imports is None else campaign.imports.files
        self.sources = [log_source(campaign, file, Path(name), i, self.roles) for i, file in enumerate(files)]
        for source in self.sources:
            check_source(source)
        laws = campaign.vehicle.laws if isinstance(campaign.vehicle, WholeVehicle) else ()
        if any(law.voltage for law in laws):
            raise InputError(
                campaign.where("vehicle.thrust_laws"),
                found="a law of thrust with a voltage",
                expected="laws of one voltage: a live stream gives commands and voltage at different times",
                remedy="leave out its voltage, or import the log after the trial",
            )
        self.text = _Text(self)
        self.attitude: dict[str, float] = {}

    @property
    def tables(self) -> list[str]:
        """Types of messages, or topics, that hold channels."""
        return [source.table for source in self.sources if source.table]

    def check_messages(self) -> None:
        """Check that a stream of messages can give what is needed.

        Raises:
            InputError: no types of messages, or none with a control or a measured channel.
        """
        if not self.tables:
            raise InputError(
                self.name,
                found="no [[import.files]] with a `table`",
                expected="one for each type of message, or topic, with channels",
                remedy='name the type under `table`, for example table = "VFR_HUD", and its fields as columns',
            )
        self.needed([name for source in self.sources if source.table for name in source.channels], self.tables)

    def of(self, piece: Piece) -> list[Arrival]:
        """Return the samples of a piece; those that cannot be used are left out, and told once.

        Raises:
            InputError: a header or a map without what the campaign needs.
        """
        arrivals = self._of_messages(piece) if piece.text is None else self.text.of(piece.text, piece.begins)
        return [one._replace(values=self._to_body(one.values)) for one in arrivals]

    def needed(self, have: Sequence[str], columns: Sequence[str]) -> None:
        """Check that a stream has every control and one measured channel at least.

        Args:
            have: channels.
            columns: of the stream, for the error.

        Raises:
            InputError: saying what is missing.
        """
        given = {*have, *(("u", "v", "w") if set(OVER_EARTH[:2]) <= set(have) else ())}
        given |= set(ANGLES) if set(QUATERNION) <= set(have) else set()
        missing = [name for name in self.model.controls if name not in given]
        if not missing and set(self.campaign.channels) & given:
            for name in (name for name in self.campaign.channels if name not in given):
                self.say(f"without {name}", f"the stream has no {name}: the coefficients are estimated without it")
            return
        what = ", ".join(missing) or "none of " + ", ".join(self.campaign.channels)
        raise InputError(
            self.name,
            found=("no " if missing else "") + what + " among " + ", ".join(columns[:30]),
            expected=f"every control ({', '.join(self.model.controls)}) and measured channels ({', '.join(self.campaign.channels)})",
            remedy="name the columns under [[import.files]] of the campaign (`seatrial inspect LOG --map` writes it)"
            if not self.sources
            else "correct [[import.files]], or choose the stream that it is for",
        )

    def signals(self, source: LogSource, cells: Mapping[str, Sequence[float]]) -> dict[str, np.ndarray]:
        """Return the channels of some rows in seatrial's axes, SI; a number that a curve does not reach is none."""
        found = {}
        for name, column in source.channels.items():

            def cells_of(part: str, name: str = name) -> np.ndarray:
                values = np.asarray(cells[part], float)
                if np.isinf(values).any():
                    self.say(f"infinite {name}", f"{name}: infinite values are left out")
                    values = np.where(np.isinf(values), np.nan, values)
                return values

            for one in curved_cells(column, cells_of, self.name):
                known = one.cells[np.isfinite(one.cells)]
                reached = np.isfinite(one.curve(known))
                if not reached.all():
                    self.say(f"curve {name}", f"{name}: values beyond the ends of {one.curve.name} are left out")
                one.curve.check(known[reached], np.arange(known.size)[reached], one.where)
            found[name] = in_si(source, name, cells_of)
        return from_axes(found, source.axes, self.name)

    def _of_messages(self, piece: Piece) -> list[Arrival]:
        arrivals = []
        for table, sender, columns in piece.messages:
            for part, source in enumerate(self.sources):
                if source.table not in (table, f"{table} of {sender}"):
                    continue
                if missing := [part for part in columns_of(source) if part not in columns]:
                    raise InputError(
                        f"{self.name}, {table}",
                        found=f"no {', '.join(missing)}",
                        expected="one of " + ", ".join(columns),
                        remedy="correct the columns of this table under [[import.files]]",
                    )
                stamp, unit = source.time_column or LOG_TIME, source.time_unit or "us"
                if stamp == LOG_TIME:
                    unit = "us"
                values = self.signals(source, {part: [columns[part]] for part in columns_of(source)})
                seconds = _seconds(repr(columns[stamp]), time_scale(source, unit))
                if seconds is None:
                    self.say("stamps", f"messages without a time are left out, such as {table} at {columns[stamp]!r}")
                    continue
                arrivals.append(Arrival(seconds, part, {name: float(one[0]) for name, one in values.items()}))
        return arrivals

    def _to_body(self, values: dict[str, float]) -> dict[str, float]:
        """Make angles of a quaternion and velocities along the body of those over the earth, with the latest attitude."""
        if set(QUATERNION) <= set(values):
            values |= zip(
                ANGLES, map(float, angles_of_quaternion(tuple(values[one] for one in QUATERNION))), strict=True
            )
        self.attitude |= {name: values[name] for name in ANGLES if values.get(name) == values.get(name, np.nan)}
        if set(OVER_EARTH[:2]) <= set(values):
            if "psi" not in self.attitude:
                self.say("no heading", "velocities over the earth are left out before the first heading")
            else:
                rows = matrix_of_angles(*(self.attitude.get(angle, 0.0) for angle in ANGLES))
                over = [values.get(one, 0.0) for one in OVER_EARTH]
                values |= {
                    name: float(sum(row[i] * speed for row, speed in zip(rows, over, strict=True)))
                    for i, name in enumerate(("u", "v", "w"))
                }
        return {name: value for name, value in values.items() if name in self.roles}


def lined_controls(imports: ImportTable | None) -> set[str]:
    """Return the controls that change along a straight line from one sample to the next, by `between = "line"`."""
    files = () if imports is None else imports.files
    return {name for file in files for name, column in file.channels.items() if column.between == "line"}


def columns_of(source: LogSource) -> set[str]:
    """Return every column that a channel is made of."""
    return {part for column in source.channels.values() for _, part in column.columns}


def _seconds(text: str, scale: Decimal) -> Decimal | None:
    """Return a stamp in s, exactly; None if it is no time that a clock could show."""
    try:
        stamp = Decimal(text) * scale
    except DecimalException:
        return None
    return stamp if stamp.is_finite() and abs(stamp) < MAX_STAMP else None


class _Text:
    """Rows of a table of text, from its header on."""

    def __init__(self, channels: Channels):
        self.channels, self.above, self.header = channels, 0, None
        self.source: LogSource | None = None

    def of(self, lines: list[str], begins: bool) -> list[Arrival]:
        layout = self.channels.sources[0] if self.channels.sources else None
        if begins:
            self.header = None if layout is None or layout.names is None else list(layout.names)
            self.above = 0 if layout is None else layout.skip_rows
            if self.header is not None:
                self.source = self._bound(self.header)
        rows = []
        for line in lines:
            if self.above > 0:
                self.above -= 1
            elif not line.strip():
                continue
            elif self.header is None:
                self.header = self._cells(line)
                self.above = 0 if layout is None else layout.header_rows - 1
                self.source = self._bound(self.header)
            else:
                rows.append(line)
        return self._rows(rows) if rows and self.source is not None else []

    def _rows(self, lines: list[str]) -> list[Arrival]:
        assert self.header is not None
        assert self.source is not None
        say, source, header = self.channels.say, self.source, self.header
        place = {name: at for at, name in enumerate(header)}
        clock = place[str(source.time_column)]
        scale = time_scale(source, str(source.time_unit))
        stamps, kept = [], []
        for line in lines:
            cells = self._cells(line)
            if cells == header:
                continue
            if len(cells) != len(header):
                say("cells", f"rows of other than {len(header)} cells are left out, such as {line[:60]!r}")
                continue
            stamp = _seconds(cells[clock], scale)
            if stamp is None:
                say("stamps", f"rows without a time are left out, such as {line[:60]!r}")
                continue
            stamps.append(stamp)
            kept.append(cells)
        wanted = columns_of(source)
        values = self.channels.signals(
            source, {one: [self._number(row[place[one]], one) for row in kept] for one in wanted}
        )
        return [
            Arrival(stamp, 0, {name: float(column[i]) for name, column in values.items()})
            for i, stamp in enumerate(stamps)
        ]

    def _number(self, cell: str, column: str) -> float:
        try:
            return float(cell)
        except ValueError:
            if cell.lower() not in EMPTY_CELLS:
                self.channels.say(
                    f"cell {column}", f'column "{column}": cells that are no number are left out, such as {cell[:30]!r}'
                )
            return np.nan

    def _cells(self, line: str) -> list[str]:
        sources = self.channels.sources
        stated = sources[0].delimiter if sources else None
        imports = self.channels.campaign.imports
        path = Path(imports.files[0].path) if imports else Path()
        if stated is None and sources and path.suffix in (".csv", ".tsv"):
            stated = signs_of(log_file(replace(sources[0], path=path))).separator
        mark = stated or ","
        return [cell.strip().strip('"') for cell in (line.split() if mark == WHITESPACE else line.split(mark))]

    def _bound(self, header: list[str]) -> LogSource:
        """Return how rows under a header are read."""
        channels = self.channels
        if not channels.sources:
            return self._by_names(header)
        fitting = [one for one in channels.sources if columns_of(one) <= set(header)]
        merged = {name: column for one in fitting for name, column in one.channels.items()}
        channels.needed(tuple(merged), header)
        first = fitting[0]
        if first.time_column is not None and first.time_column not in header:
            raise InputError(
                channels.name,
                found=f'no column "{first.time_column}" for the time',
                expected="one of " + ", ".join(header),
                remedy="correct `time` under [[import.files]]",
            )
        clocks, columns = clocks_among([ColumnInfo(name) for name in header])
        clock = first.time_column or next(iter(clocks), None)
        if clock is None:
            raise self._no_clock(header)
        unit = first.time_unit or dict(columns).get(clock) or "s"
        return replace(first, channels=merged, time_column=clock, time_unit=unit)

    def _by_names(self, header: list[str]) -> LogSource:
        channels = self.channels
        clock = next((name for name in CLOCK_NAMES if name in header), None)
        if clock is None:
            raise self._no_clock(header)
        mapped = {
            name: ColumnMap(name, signal_unit(name), role) for name, role in channels.roles.items() if name in header
        }
        channels.needed(tuple(mapped), header)
        return LogSource(Path(channels.name), clock, "s", mapped)

    def _no_clock(self, header: list[str]) -> InputError:
        return InputError(
            self.channels.name,
            found="no column of time among " + ", ".join(header[:30]),
            expected="`time` or `t`, in s, or the column that [[import.files]] names",
            remedy="let the logger write one, or name it",
        )
