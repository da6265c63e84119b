"""Logs inside a campaign's folder: what they hold, asked in a process of its own, and what an upload may be called."""

from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from seatrial.apps.dashboard.campaign_paths import upload_name
from seatrial.apps.dashboard.view_models import PlainError, words_of
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.files import atomic_path
from seatrial.core.processes import apart
from seatrial.logs.formats.registry import FORMATS
from seatrial.logs.inspect import inspect_log
from seatrial.logs.summary import TableSummary

# A look at a file that somebody sent, in a process of its own: what takes too much memory or time ends there and
# nowhere else.

MEMORY = 6 << 30
"""Bytes of address space."""
SECONDS = 300.0
"""Of waiting."""


def isolated(
    what: str, question: Callable[..., Any], *about: Any, memory: int = MEMORY, seconds: float = SECONDS
) -> Any:
    """Answer a question in a process that ends with it.

    Args:
        what: the file, for errors.
        question: function of a module.
        about: its arguments.
        memory: bytes it may use.
        seconds: it may take.

    Raises:
        PlainError: an error of the question, in its words.
        InputError: it took too much.
    """
    (answer,) = apart(what, _worded, question, about, memory=memory, seconds=seconds)
    return answer


def _worded(question: Callable[..., Any], about: tuple) -> Iterator[Any]:
    try:
        yield question(*about)
    except (SeatrialError, OSError) as error:
        raise PlainError(words_of(error)) from None


# A log that is sent to a campaign: counted while it arrives, and kept under `logs/` whole or not at all.

FOLDER = "logs"


async def receive(body: AsyncIterator[bytes], folder: Path, given: str, suffixes: tuple[str, ...], most: int) -> str:
    """Keep an uploaded log.

    Args:
        body: its bytes, as they arrive.
        folder: of the campaign.
        given: its name, as the sender says.
        suffixes: that a log may have.
        most: bytes, at most.

    Returns:
        its path from the campaign's folder.

    Raises:
        InputError: a name that cannot be used or is taken, nothing sent, or too much.
        OSError: it cannot be written.
    """
    name = upload_name(given, suffixes)
    place = folder / FOLDER
    place.mkdir(exist_ok=True)
    if place.resolve() != folder.resolve() / FOLDER:
        raise InputError(str(place), found="a link", expected="a folder of the campaign", remedy="make it a folder")
    path = place / name
    if path.exists() or path.is_symlink():
        raise InputError(
            f'file "{FOLDER}/{name}"',
            found="a log of that name",
            expected="a new name",
            remedy="rename the file, or use the one there",
        )
    size = 0
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        async for chunk in body:
            size += len(chunk)
            if size > most:
                raise InputError(
                    f'file "{name}"',
                    found=f"more than {most >> 20:,} MiB",
                    expected="less",
                    remedy="copy it into the campaign's folder instead",
                )
            stream.write(chunk)
        if not size:
            raise InputError(f'file "{name}"', found="nothing", expected="a log", remedy="choose another file")
    return f"{FOLDER}/{name}"


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
