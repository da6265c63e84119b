"""The channel map of a campaign file: its `[[import.files]]`, which say what column of what log each channel is."""

import copy
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.campaign.config.named_files import place_of
from seatrial.campaign.config.toml import toml_content
from seatrial.campaign.config.toml_edit import Key, with_values
from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.core.errors import InputError
from seatrial.logs.linear_sum import parse_sum

File = dict[str, Any]  # A log as one `[[import.files]]` says how it is read


def imports_of(text: str) -> dict[str, Any]:
    """Return `[import]` of a campaign file; empty if it has none.

    Raises:
        InputError: a file that is not TOML.
    """
    table = toml_content(CAMPAIGN, text).get("import", {})
    return table if isinstance(table, dict) else {}


def files_of(text: str) -> list[File]:
    """Return the channel map of a campaign file; errors as `imports_of`."""
    return imports_of(text).get("files", [])


def runs_of(text: str) -> tuple[str, ...]:
    """Return the runs that a campaign file names, those that are fitted first; errors as `imports_of`."""
    table = imports_of(text)
    return *table.get("fit", ()), *table.get("predict", ())


def typed_map(text: str) -> list[File]:
    """Read a channel map as somebody typed it.

    Raises:
        InputError: something else than `[[import.files]]` tables.
    """
    content = toml_content("the channel map", text)
    files = content["import"].get("files") if isinstance(content.get("import"), dict) else None
    is_map = isinstance(files, list) and all(
        isinstance(one, dict)
        and isinstance(one.get("path"), str)
        and all(isinstance(one.get(key, {}), dict) for key in ("channels", "time"))
        and all(isinstance(column, dict) for column in one.get("channels", {}).values())
        for one in files
    )
    if content and not (is_map and set(content) == {"import"} and set(content["import"]) == {"files"}):
        raise InputError(
            "the channel map",
            found="other tables, or a log without a path",
            expected="only [[import.files]], each with a path",
            remedy="correct it, and edit other tables in the file",
        )
    return files or []


def with_map(folder: Path, text: str, run: str, files: list[File]) -> str:
    """Return the text of a campaign file that imports a run by a channel map; a simulated vehicle becomes a comment.

    If the campaign names the run, only the map is replaced. If not, it is the run to fit, and keys of other runs alone are removed.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        files: the map.

    Raises:
        InputError: no map, one that names a file outside the campaign's folder, or an `[import]` that cannot be edited.
    """
    values: dict[Key, Any] = {}
    if run not in runs_of(text):
        values = {("import", "fit"): [run], ("import", "predict"): None, ("import", "trim"): None}
    return _with_files(folder, text, run, files, {**values, ("truth",): None})


def _with_files(folder: Path, text: str, run: str, files: list[File], values: Mapping[Key, Any]) -> str:
    if not files:
        raise InputError(
            "the channel map",
            found="no column of a log",
            expected="a column for each logged channel",
            remedy="choose them in the form, or write [[import.files]]",
        )
    curves = [column["curve"] for one in files for column in one.get("channels", {}).values() if "curve" in column]
    for path in map(str, [*(one["path"] for one in files), *curves]):
        try:
            is_plain = "$" not in path and not path.startswith("~") and not Path(path).is_absolute()
            is_inside = is_plain and place_of(folder, path, "", run, [folder.resolve()]).name != ""
        except InputError:
            is_inside = False
        if not is_inside:
            raise InputError(
                f"the channel map, path {path[:80]!r}",
                found="a file outside the campaign's folder",
                expected="one inside it",
                remedy="copy it there, or name it in the file by hand",
            )
    return with_values(text, {**values, ("import", "files"): files}, str(folder / CAMPAIGN))


class FurtherRun(NamedTuple):
    """A log that is another run of the one log of the map: its label, and the path of both with `{run}` in the place of their labels."""

    label: str
    path: str


def further_run(text: str, log: str) -> FurtherRun | None:
    """Return how a campaign would name a log as a further run by the map that is there; None if the names of the logs do not show it.

    Args:
        text: of the file.
        log: path from the campaign's folder.
    """
    runs, files = list(runs_of(text)), files_of(text)
    if not runs or len({one.get("path") for one in files}) != 1:
        return None
    folder, slash, name = str(files[0]["path"]).rpartition("/")
    if "{run}" not in name:
        if len(runs) > 1 or name.count(runs[0]) != 1:
            return None
        name = name.replace(runs[0], "{run}")
    path = folder + slash + name
    match = re.fullmatch(r"([A-Za-z0-9_-]+)".join(map(re.escape, path.split("{run}", 1))), log)
    return None if match is None or match[1] in runs else FurtherRun(match[1], path)


def with_further_run(folder: Path, text: str, run: FurtherRun, role: str) -> str:
    """Return the text of a campaign file with a further run of the same map, to `fit` or to `predict`; errors as `with_map`."""
    files = [{**one, "path": run.path} for one in files_of(text)]
    labels = [*imports_of(text).get(role, ()), run.label]
    return _with_files(folder, text, run.label, files, {("import", role): labels})


def with_own_map(folder: Path, text: str, run: str, role: str, files: list[File]) -> str:
    """Return the text of a campaign file in which one run has a separate map; all other runs keep theirs.

    Each log gets `runs`, which says whose it is. A log that only this run read is removed.

    Args:
        folder: of the campaign.
        text: of the file, which names a run or more.
        run: label of the record.
        role: `fit` or `predict`, for a run that the campaign does not name.
        files: the map of the run.

    Raises:
        InputError: as `with_map`.
    """
    runs = runs_of(text)
    others = [
        {**one, "runs": labels}
        for one in files_of(text)
        if (labels := [label for label in one.get("runs") or runs if label != run])
    ]
    own = [{**one, "runs": [run]} for one in files]
    labels = {} if run in runs else {("import", role): [*imports_of(text).get(role, ()), run]}
    return _with_files(folder, text, run, [*others, *own] if own else [], labels)


def runs_reading(text: str, log: str) -> tuple[str, ...]:
    """Return the runs of a campaign file that read a log, by its path from the campaign's folder; errors as `imports_of`."""
    return tuple(
        run for run in runs_of(text) if log in {path_of(one, run) for one in map_of_run(files_of(text), run)[0]}
    )


def is_named(text: str, file: str) -> bool:
    """Return whether a campaign file names a file, by its path from the campaign's folder, as a log or in any other key."""
    strings = list(_strings_in(toml_content(CAMPAIGN, text)))
    return any(Path(one.replace("{run}", run)) == Path(file) for one in strings for run in runs_of(text) or ("",))


def _strings_in(content: Any) -> Iterator[str]:
    """Yield every text of a TOML file."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping | list):
        for one in content.values() if isinstance(content, Mapping) else content:
            yield from _strings_in(one)


def map_of_run(files: list[File], run: str) -> tuple[list[File], list[File]]:
    """Return the part of a channel map that one run reads, and the part that only others read."""
    own = [one for one in files if not one.get("runs") or run in one["runs"]]
    return own, [one for one in files if one not in own]


class Mapped(NamedTuple):
    """The column of a channel as the form has it: its table's `[[import.files]]` without channels, its name, empty for what the map says,
    and other keys of `[import.files.channels.CHANNEL]`; None removes one.
    """

    head: File
    column: str
    values: Mapping[str, Any]


def with_channel(files: list[File], name: str, mapped: Mapped | None) -> list[File]:
    """Return a channel map with another column for a channel, or without the channel where that is None."""
    files = copy.deepcopy(files)
    target = None if mapped is None else _find(files, identity_of(mapped.head))
    if mapped is not None and target is None:
        target = copy.deepcopy(mapped.head)
        files.append(target)
    earlier: dict[str, Any] = {}
    for file in files:
        if file is not target and name in file.get("channels", {}):
            earlier = file["channels"].pop(name)
    if mapped is not None and target is not None:
        column = target.setdefault("channels", {}).setdefault(name, {"column": "", "unit": "", **earlier})
        if mapped.column:
            column.pop("sum", None)
            column["column"] = mapped.column
        column |= mapped.values
        for key in [key for key, value in column.items() if value is None]:
            del column[key]
    return [one for one in files if one.get("channels") != {}]


def with_newer_log(files: list[File], name: str, log: Any, runs: Sequence[str]) -> tuple[list[File], tuple[str, ...]]:
    """Return a channel map with a log in the place of those that it makes needless, and the paths of these.

    A log that is new to the map takes the place of one of which it has every column, with units and signs; and of one whose
    channels it all has by other names, which are then without a column.

    Args:
        files: the map.
        name: path of the log from the campaign's folder.
        log: what a look into it found: `heads`, `columns` and `guesses`, as `seatrial.dashboard.logs.Looked`.
        runs: of the campaign, for paths with `{run}`.
    """
    mapped: dict[str, list[File]] = {}
    for file in files:
        mapped.setdefault(str(file.get("path")), []).append(file)
    gone: list[str] = []
    if any(name in (path, path.replace("{run}", run)) for path in mapped for run in runs or ("",)):
        return files, ()
    guessed = {one.channel for one in log.guesses}
    for path, tables in mapped.items():
        channels = [channel for file in tables for channel in file.get("channels", {})]
        if not gone and all(has_columns(log, file) for file in tables):
            files = [{**one, "path": name} if one.get("path") == path else one for one in files]
        elif channels and guessed >= {*channels}:
            for channel in channels:
                files = with_channel(files, channel, None)
        else:
            continue
        gone.append(path)
    return files, tuple(gone)


def has_columns(log: Any, file: File) -> bool:
    """Return whether a log has every column that one `[[import.files]]` names, laid out as that says."""
    name = file.get("table") or (next(iter(log.heads)) if len(log.heads) == 1 else None)
    if name not in log.heads:
        return False
    head = log.heads[name]
    alike = all(file.get(key) == head.get(key) for key in ("table", "delimiter", "encoding", "skip_rows"))
    columns = [file.get("time", {}), *file.get("channels", {}).values()]
    try:
        sums = [part for one in columns if "sum" in one for _, part in parse_sum(str(one["sum"]), "the channel map")]
    except InputError:  # shown when the map is checked
        return False
    needed = {*sums, *(str(one["column"]) for one in columns if one.get("column"))}
    return alike and needed <= {one.name for one in log.columns if one.table == name}


def with_shift(files: list[File], path: str, table: str | None, shift: float) -> list[File]:
    """Return a channel map with another shift of the clock of one of its logs, s; 0 removes it."""
    files = copy.deepcopy(files)
    file = _find(files, (path, table))
    if file is not None:
        file.pop("shift", None)
        if shift:
            file["shift"] = f"{np.format_float_positional(shift, trim='-')} s"
    return files


def with_time(files: list[File], path: str, table: str | None, column: str, unit: str) -> list[File]:
    """Return a channel map with another column of time for one log; as it is where it does not name the log."""
    files = copy.deepcopy(files)
    file = _find(files, (path, table))
    if file is not None:
        file["time"] = {**file.get("time", {}), "column": column, "unit": unit}
    return files


def channels_of(files: list[File]) -> dict[str, dict[str, Any]]:
    """Return the channels of a map by name, each with the `path` and `table` of its file."""
    return {
        name: {**column, "path": file.get("path"), "table": file.get("table")}
        for file in files
        for name, column in file.get("channels", {}).items()
    }


def identity_of(file: File) -> tuple[str, Any]:
    """Return path and table of one `[[import.files]]`, which distinguish it from the others of a map."""
    return str(file.get("path")), file.get("table")


def path_of(file: File, run: str) -> str:
    """Return the path of the log of one `[[import.files]]` for a run."""
    return str(file.get("path")).replace("{run}", run)


def _find(files: list[File], identity: tuple[Any, Any]) -> File | None:
    return next((file for file in files if identity_of(file) == identity), None)
