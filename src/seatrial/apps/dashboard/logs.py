"""Logs inside a campaign's folder: what they hold, asked in a process of its own, and what an upload may be called."""

from pathlib import Path
from typing import NamedTuple

from seatrial.apps.dashboard.isolated import isolated
from seatrial.logs.formats.registry import FORMATS
from seatrial.logs.inspect import inspect_log
from seatrial.logs.summary import TableSummary

SUFFIXES = tuple(sorted({suffix for form in FORMATS for suffix in form.suffixes if suffix.startswith(".")}))
"""Suffixes that a log may have."""


class Column(NamedTuple):
    """A column of a table, in words."""

    table: str
    name: str
    unit: str
    spread: str
    trouble: str


class Looked(NamedTuple):
    """A log: its kind, what it holds, the guessed channel map as TOML, and what needs more than a map."""

    kind: str
    tables: tuple[str, ...]
    columns: tuple[Column, ...]
    guesses: tuple[tuple[str, str, str], ...]
    map: str
    remarks: tuple[str, ...]
    lines: tuple[str, ...]


def look_into(path: str, relative: str, only: tuple[str, ...]) -> Looked:
    """Look through a log without letting it do harm.

    Args:
        path: of the log.
        relative: the same from the campaign's folder, for the map.
        only: channels of the campaign, which the map is limited to; all that were guessed where none are named.
    """
    return isolated(relative, _look, path, relative, only)


def _look(path: str, relative: str, only: tuple[str, ...]) -> Looked:
    found = inspect_log(Path(path))
    written = f'path = "{Path(path).resolve().as_posix()}"'
    text = found.as_toml(only).replace(written, f'path = "{relative}"')
    guesses = tuple((one.channel, f"{one.column} [{one.unit}]", one.reason) for one in found.guesses)
    tables = tuple(_table_words(table) for table in found.tables)
    columns = tuple(column for table in found.tables for column in _columns(table))
    return Looked(found.kind, tables, columns[:400], guesses, text, tuple(found.remarks), tuple(found.lines()))


def _table_words(table: TableSummary) -> str:
    clock = table.clock
    if clock is None:
        return f"{table.info.name}: {table.rows} rows, no clock"
    faults = [f"{clock.repeated} stamps repeat"] * bool(clock.repeated) + [f"{clock.backward} run back"] * bool(
        clock.backward
    )
    about = f"{clock.rate:.4g} Hz, longest gap {clock.gap:.3g} s"
    return "; ".join([f"{table.info.name}: {table.rows} rows over {clock.duration:.6g} s, {about}", *faults])


def _columns(table: TableSummary) -> list[Column]:
    return [
        Column(
            table.info.name,
            one.name,
            one.unit or "",
            f"{one.least:.6g} to {one.greatest:.6g}" if one.count else "",
            one.trouble or (f"{one.missing:.1%} missing" if one.missing else ""),
        )
        for one in table.columns
    ]
