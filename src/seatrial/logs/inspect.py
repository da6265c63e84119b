"""A first look at a log of any format: what each column holds, how good its clocks are, and a map to begin with."""

import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from seatrial.core.argument_checks import check_kind, check_path, check_text
from seatrial.core.signals import POSITIONS
from seatrial.core.units import to_si
from seatrial.logs.clock_shift import ClocksApart, clocks_apart
from seatrial.logs.formats.protocol import LogFile, TextLayout
from seatrial.logs.formats.registry import catalogue, format_of, pick, stream
from seatrial.logs.guess import Guess, best, guesses, remarks
from seatrial.logs.measured_control import looks_measured
from seatrial.logs.summary import MIN_BURST_SPREAD, ClockSummary, ColumnSummary, Gathered, TableSummary, disagreement
from seatrial.logs.time_stamps import likelier_unit

_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
_MAX_ELEMENT_LINES = 16  # Elements of an array up to which each has a line where several tables are listed


# What is said where nothing could be guessed
NO_GUESS_LINES = (
    "no column could be guessed, of speeds, rates, angles, depth, position, propeller, rudder, forces and outputs to thrusters,",
    "by names such as u, yaw_rate, heading, depth, rpm, rudder, tau_x or out1, and by types of message. Write the map yourself: `--map`",
    'prints the [[import.files]] of a campaign file; add a line for each channel, such as channels.u = { column = "...", unit = "m/s" }',
)


@dataclass(frozen=True)
class LogSummary:
    """What a log holds.

    Attributes:
        log: file and layout.
        kind: of the log, for example "a ROS 1 bag".
        tables: in the order of the log.
        guesses: channels that columns may be, the strongest of each channel first.
        remarks: what needs more than a map.
    """

    log: LogFile
    kind: str
    tables: tuple[TableSummary, ...]
    guesses: tuple[Guess, ...]
    remarks: tuple[str, ...]

    def lines(self) -> list[str]:
        """Return what was found, for people."""
        count = len(self.tables)
        lines = [f"{self.log.path.name}: {self.kind}, {count} table{'s' if count != 1 else ''}"]
        for table in self.tables:
            lines += ["", *_table_lines(table, count == 1)]
        notes = dict.fromkeys(note for table in self.tables for note in table.info.notes)
        lines += ["", *notes] if notes else []
        chosen = best(self.guesses)
        lines += (
            ["", "guessed map (check each line; `--map` prints it for a campaign file):"]
            if chosen
            else ["", *NO_GUESS_LINES]
        )
        for guess in chosen:
            lines.append(f"  {guess.channel:<8} {_place(guess, count)} [{_unit(guess)}]: {guess.reason}")
        others = [guess for guess in self.guesses if guess.strength and guess not in chosen]
        lines += [
            f"  or {guess.channel:<5} {_place(guess, count)} [{_unit(guess)}]: {guess.reason}" for guess in others
        ]
        return lines + (["", *self.remarks] if self.remarks else [])

    def as_toml(self, only: Sequence[str] = (), named: str = "") -> str:
        """Return the guessed map as `[[import.files]]` of a campaign file, with a comment on each column that moves and that nothing uses.

        Args:
            only: channels to map, those of the campaign's model, without such comments; all that were guessed by default.
            named: path of the log from the campaign's folder; as it was given by default.
        """
        return self._map_of(best(self.guesses, only), named, names_unused=not only)

    def _map_of(
        self,
        chosen: Sequence[Guess],
        named: str = "",
        *,
        names_unused: bool = True,
        run: str | None = None,
        apart: ClocksApart | None = None,
    ) -> str:
        lines = ["# Guesses by names and types: check column, unit and sign of each line before you believe a result."]
        for table in self.tables:
            mine = [guess for guess in chosen if guess.table == table.info.name]
            if (mine or not chosen) and (table.clock is not None or len(self.tables) == 1):
                lines += [
                    "",
                    *self._block(table, table.clock, mine, named, run, apart, POSITIONS if names_unused else ()),
                ]
                lines += _unused_lines(table, {guess.column for guess in mine}) if names_unused else []
        if not chosen:
            lines.append(
                "# No column could be guessed; `seatrial inspect` without --map lists them. A line for each: "
                'channels.u = { column = "...", unit = "m/s" }'
            )
        return "\n".join([*lines, *(f"# {remark}" for remark in self.remarks)]) + "\n"

    def head_toml(self, table: TableSummary, named: str) -> str:
        """Return how a table is named in a campaign file: its `[[import.files]]` without channels; without a clock its column is empty.

        Args:
            table: of the log.
            named: path of the log from the campaign's folder.
        """
        mine = [guess for guess in best(self.guesses) if guess.table == table.info.name]
        lines = self._block(table, table.clock, mine, named)
        return "\n".join(line for line in lines if not line.startswith(("channels.", "#"))) + "\n"

    def _block(
        self,
        table: TableSummary,
        clock: ClockSummary | None,
        mine: Sequence[Guess],
        named: str,
        run: str | None = None,
        apart: ClocksApart | None = None,
        aside: Collection[str] = (),
    ) -> Iterator[str]:
        layout = self.log.layout
        yield "[[import.files]]"
        path = self.log.path
        beside = (
            ""
            if named or path.is_absolute()
            else "  # relative to the folder of the campaign file: correct it if that is another"
        )
        yield f"path = {_quoted(named or path.as_posix())}{beside}"
        if len(catalogue(self.log)) > 1:
            yield f"table = {_quoted(table.info.name)}"
        if run is not None:
            yield f"runs = [{_quoted(run)}]"
        name, unit = ("", "s") if clock is None else (clock.name, clock.unit)
        yield f"time = {{ column = {_quoted(name)}, unit = {_quoted(unit)} }}"
        if clock is None:
            yield "# time: no column is it by its name, and none rises in every row; give the column, and its unit"
        else:
            yield from _clock_keys(clock)
        if apart is not None and apart.shift is not None:
            yield f'shift = "{apart.shift.shift:.3f} s"  # guess: {apart.surety}'
        elif apart is not None:
            yield f"# shift: {apart.words}"
        if any(guess.axes == "ENU" for guess in mine):
            yield 'axes = "ENU"'
        for key, value, usual in (
            ("delimiter", layout.delimiter, None),
            ("encoding", layout.encoding, "utf-8"),
            ("skip_rows", layout.skip_rows, 0),
        ):
            if value != usual:
                yield f"{key} = {_quoted(value) if isinstance(value, str) else value}"
        for guess in mine:
            scale = f", scale = {guess.scale!r}" if guess.scale != 1.0 else ""
            between = f", between = {_quoted(guess.between)}" if guess.between else ""
            column = f"{{ column = {_quoted(guess.column)}, unit = {_quoted(guess.unit)}{scale}{between} }}"
            line = f"channels.{guess.channel} = {column}  # guess: {guess.reason}"
            yield f"# {line}; for a model or sensor that has {guess.channel}" if guess.channel in aside else line


def inspect_log(
    path: Path | str,
    table: str | None = None,
    layout: TextLayout = TextLayout(),  # noqa: B008 - it is frozen
    *,
    progress: Callable[[float], None] = lambda done: None,
) -> LogSummary:
    """Summarise a log in one pass, with sums only.

    Args:
        path: of the log.
        table: the only one to look at; all by default.
        layout: of its text.
        progress: receives the share of the log that was read.

    Returns:
        its tables with their columns, units and clocks, and the likely signal of each column; `lines()` has them in words.

    Raises:
        InputError: a log that cannot be read.
    """
    path = check_path(path, "log, path")
    check_kind(layout, TextLayout, "log, layout", "leave it out: seatrial finds the layout of text")
    if table is not None:
        check_text(table, "log, table", "name the table, or leave it out")
    log = LogFile(path, layout)
    infos = catalogue(log)
    chosen = infos if table is None else (pick(infos, table, str(path)),)
    gathered = {info.name: Gathered(info) for info in chosen}
    wanted = {info.name: [column.name for column in info.columns] for info in chosen if not info.trouble}
    for block in stream(log, wanted):
        gathered[block.table].take(block)
        progress(block.done)
    progress(1.0)
    tables = tuple(table.summary() for table in gathered.values())
    guessed = _with_lines(log, tables, guesses(tables))
    return LogSummary(log, format_of(path).name, tables, guessed, remarks(guessed, tables))


def _with_lines(log: LogFile, tables: Sequence[TableSummary], guessed: Sequence[Guess]) -> tuple[Guess, ...]:
    """Return guesses in which controls that look measured are lines between their samples; a second pass reads these columns alone."""
    controls: dict[str, set[str]] = {}
    for guess in (one for one in guessed if one.role == "control"):
        controls.setdefault(guess.table, set()).add(guess.column)
    clocks = {table.info.name: table.clock for table in tables if table.clock and table.info.name in controls}
    wanted = {name: [clock.name, *sorted(controls[name] - {clock.name})] for name, clock in clocks.items()}
    blocks = list(stream(log, wanted)) if wanted else []
    measured = set()
    for name, clock in clocks.items():
        columns = {
            column: np.concatenate([block.columns[column] for block in blocks if block.table == name])
            for column in wanted[name]
        }
        stamps = columns.pop(clock.name)
        time = (stamps - stamps[0]).astype(float) * to_si(1.0, clock.unit, "s", "clock")
        goes_on = np.diff(time, prepend=-np.inf) > 0
        measured |= {
            (name, column)
            for column, values in columns.items()
            if looks_measured(time[goes_on], values[goes_on].astype(float))
        }
    return tuple(
        replace(one, between="line", reason=f"{one.reason}; it changes at nearly every sample, like a measured control")
        if one.role == "control" and (one.table, one.column) in measured
        else one
        for one in guessed
    )


@dataclass(frozen=True)
class LogsTogether:
    """Several logs, and which of them are one run.

    Attributes:
        logs: as they were given.
        only: channels to map; all guessed ones if none is named.
    """

    logs: tuple[LogSummary, ...]
    only: tuple[str, ...] = ()

    def lines(self) -> list[list[str]]:
        """Return what each holds, and how far its clock is from that of the run's first log where they do not meet."""
        apart = self._apart()
        return [[*one.lines(), *(("", apart[at].words) if at in apart else ())] for at, one in enumerate(self.logs)]

    def maps(self) -> list[str]:
        """Return the guessed map of each, a channel of a run being mapped from the first log that has it.

        A log without a channel that the logs before it lack is another run: by the same map where its columns are those of one of them,
        else by a separate map, and `runs` says then whose each map is.
        """
        (runs, alike), apart = self._runs(), self._apart()
        # A name for the run of each log: that of its file, or a number where two files are called alike.
        paths = [self.logs[next(iter(one))].log.path for one in runs]
        stems = [re.sub(r"[^A-Za-z0-9_-]", "_", path.stem) or "run" for path in paths]
        labels = stems if len(set(stems)) == len(stems) else [str(at) for at in range(1, len(paths) + 1)]
        maps = {
            at: self.logs[at]._map_of(
                chosen, names_unused=not self.only, run=label if len(runs) > 1 else None, apart=apart.get(at)
            )
            for label, one in zip(labels, runs, strict=True)
            for at, chosen in one.items()
        }
        for label, one in zip(labels[1:], runs[1:], strict=True):
            at = next(iter(one))
            named = ", ".join(_quoted(label) for label in labels)
            maps[at] = (
                f"# {self.logs[at].log.path.name}: another run, {label}, with other columns. Name the runs under [import]: "
                f"fit = [{named}].\n# If it is another file of the run above, leave this map and `runs` out.\n{maps[at]}"
            )
        for at in alike:
            maps[at] = (
                f"# {self.logs[at].log.path.name}: the logs above have all its channels. If it is another run, not another file of theirs, "
                'write one\n# path with {run} for both, such as "log_{run}.csv", and name both runs under fit of [import].\n'
            )
        return [maps[at] for at in range(len(self.logs))]

    def _runs(self) -> tuple[list[dict[int, tuple[Guess, ...]]], set[int]]:
        """Return the channels of the logs of each run by their places, and the logs that are another run by the map of an earlier one."""
        guessed = [best(one.guesses, self.only) for one in self.logs]
        runs: list[dict[int, tuple[Guess, ...]]] = [{}]
        alike: set[int] = set()
        for at, mine in enumerate(guessed):
            mapped = {guess.channel for chosen in runs[-1].values() for guess in chosen}
            chosen = tuple(guess for guess in mine if guess.channel not in mapped)
            if chosen or not mine:
                runs[-1][at] = chosen
            elif any(_columns(mine) == _columns(before) for before in guessed[:at]):
                alike.add(at)
            else:
                runs.append({at: mine})
        return runs, alike

    def _apart(self) -> dict[int, ClocksApart]:
        """Return the logs whose clock does not meet that of the first log of their run."""
        shifts = {}
        for first, *others in self._runs()[0]:
            for at in others:
                one, other = self.logs[first], self.logs[at]
                tables, guessed = (one.tables, other.tables), (best(one.guesses), best(other.guesses))
                apart = clocks_apart(one.log, other.log, tables, guessed)
                if apart is not None:
                    shifts[at] = apart
        return shifts


def _columns(guessed: Sequence[Guess]) -> set[tuple[str, str, str]]:
    return {(guess.channel, guess.table, guess.column) for guess in guessed}


def _clock_keys(clock: ClockSummary) -> Iterator[str]:
    """Yield what a campaign file says of a clock beside its column and unit, and what is doubted."""
    if doubt := clock_doubt(clock):
        yield f"# time: {doubt}"
    if clock.repeated:
        yield f'clock = "drop_repeated"  # {clock.repeated} stamps repeat; "even" if rows left evenly and came in bursts'
    elif clock.jitter > MIN_BURST_SPREAD / clock.rate:
        yield f'# clock = "even"  # if rows left evenly: they arrived in bursts (sd of the step {clock.jitter:.2g} s)'


def _unused_lines(table: TableSummary, used: Collection[str]) -> Iterator[str]:
    """Yield a comment on each column that moves and that no channel uses."""
    others = {*used, *(clock.name for clock in table.clocks)}
    columns = [one for one in table.columns if one.name not in others and not one.trouble]
    if columns:
        yield "# No channel uses these columns; add a line for each that the model needs:"
    width = max((len(one.name) for one in columns[:_MAX_ELEMENT_LINES]), default=0)
    yield from (f"#   {one.name:<{width}}  {_column_text(one)}" for one in columns[:_MAX_ELEMENT_LINES])
    if len(columns) > _MAX_ELEMENT_LINES:
        yield f"#   and {len(columns) - _MAX_ELEMENT_LINES} more: `seatrial inspect` lists them"


def _table_lines(table: TableSummary, is_alone: bool) -> Iterator[str]:
    info, clock = table.info, table.clock
    kind = f" ({info.kind})" if info.kind else ""
    over = f" over {clock.duration:.6g} s" if clock else ""
    yield f"{info.name}{kind}: {table.rows} rows{over}"
    if info.trouble:
        yield f"  cannot be read: {info.trouble}"
        return
    for each in table.clocks:
        yield f"  {'clock' if each is clock else 'other clock'} {_clock_text(each)}"
    if doubt := disagreement(table.clocks):
        yield f"  {doubt}"
    if clock is None:
        yield "  no clock: no column is the time by its name and moves, and none rises in every row"
    stamps = {each.name for each in table.clocks}
    shown = [column for column in table.columns if column.name not in stamps]
    width = max((len(column.name) for column in shown), default=0)
    for base, group in groupby(shown, key=_array):
        columns = list(group)
        texts = [_column_text(column) for column in columns]
        if len(columns) > 2 and len(set(texts)) == 1:
            yield f"  {base}[…], {len(columns)} elements: each {texts[0]}"
        elif len(columns) > _MAX_ELEMENT_LINES and not is_alone:
            yield f"  {base}[…], {len(columns)} elements: {_range_text(columns)}; `--table {info.name}` lists each"
        else:
            yield from (f"  {column.name:<{width}}  {text}" for column, text in zip(columns, texts, strict=True))
    if info.words:
        more = f" and {len(info.words) - _MAX_ELEMENT_LINES} more" if len(info.words) > _MAX_ELEMENT_LINES else ""
        yield f"  words, for conditions of [[import.keep]]: {', '.join(info.words[:_MAX_ELEMENT_LINES])}{more}"


def _array(column: ColumnSummary) -> str:
    """Return the array that a column is an element of, or the column."""
    match = _ELEMENT.fullmatch(column.name)
    return match[1] if match else column.name


def _range_text(columns: Sequence[ColumnSummary]) -> str:
    """Say between what all elements of an array lie, and how many never change."""
    known = [column for column in columns if column.count]
    constant = sum(column.constant for column in known)
    text = f"{min(column.least for column in known):.6g} to {max(column.greatest for column in known):.6g}"
    return text + (f"; {constant} of them constant" if constant else "")


def _clock_text(clock: ClockSummary) -> str:
    if not clock.moves:
        return f"{clock.name} [{clock.unit}]: never moves"
    text = f"{clock.name} [{clock.unit}]: {clock.rate:.4g} Hz, sd of the step {clock.jitter:.2g} s, longest gap {clock.gap:.3g} s"
    faults = [
        f"{count} {what}" for count, what in ((clock.repeated, "repeated"), (clock.backward, "run back")) if count
    ]
    lost = (
        f"; rows are lost in {clock.holes} hole{'s' if clock.holes > 1 else ''}, {clock.lost:.3g} s in all"
        if clock.holes
        else ""
    )
    text += lost + (f"; stamps: {', '.join(faults)}" if faults else "")
    doubt = clock_doubt(clock)
    return f"{text}; {doubt}" if doubt else text


def clock_doubt(clock: ClockSummary) -> str:
    """Report that a clock was guessed, or which unit would make rows as frequent as usual; empty if nothing is doubted."""
    guessed = (
        "" if clock.is_named else "guessed, because it rises in every row, most evenly: check the column, and its unit"
    )
    step = 1.0 / clock.rate
    best = likelier_unit(step / to_si(1.0, clock.unit, "s", clock.name), clock.unit) if clock.rate > 0 else None
    unit = f'a row every {step:.3g} s: is its unit "{best}", not "{clock.unit}"?' if best else ""
    return "; ".join(filter(None, (guessed, unit)))


def _column_text(column: ColumnSummary) -> str:
    unit = f" {column.unit}" if column.unit else ""
    if not column.count:
        return "no number"
    if column.constant:
        text = f"{column.least:.6g}{unit}; constant"
    else:
        # How many digits tell the two ends of a range apart to a thousandth of it; six at least, and no more than a
        # number has.
        size, width = max(abs(column.least), abs(column.greatest)), column.greatest - column.least
        digits = min(max(6, math.ceil(math.log10(size / width)) + 3), 17) if 0 < width < math.inf else 6
        text = f"{column.least:.{digits}g} to {column.greatest:.{digits}g}{unit}; mean {column.mean:.4g}, sd {column.sd:.3g}"
    extra = [f"{column.missing:.1%} missing"] if column.missing else []
    extra += [column.trouble] if column.trouble not in ("", "constant") else []
    return "; ".join([text, *extra])


def _place(guess: Guess, tables: int) -> str:
    return f"{guess.table} {guess.column}" if tables > 1 else guess.column


def _unit(guess: Guess) -> str:
    return guess.unit if guess.scale == 1.0 else f"{guess.scale:g} {guess.unit}"


def _quoted(text: str) -> str:
    """Return a TOML string: JSON's escapes are among TOML's."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
