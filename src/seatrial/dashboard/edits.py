"""Edits of a campaign file by the page: limits, and the map of a log that lies inside the folder."""

import re
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.campaign.config.named_files import place_of
from seatrial.campaign.config.toml import toml_content
from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.cli.toml_edit import comment_out, dotted, sections_of, set_key, written
from seatrial.core.errors import InputError
from seatrial.logs.linear_sum import parse_sum

BOUNDS = ("lower", "upper", "rate")
MAP = "import.files"
OF_RUNS = ("predict", "trim")
"""What `[import]` says of other runs alone."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,40}")


def with_limit(folder: Path, text: str, name: str, bound: str, value: str) -> str:
    """Text of a campaign file with a bound of a limit changed; an empty value removes it.

    Raises:
        InputError: a name or bound that is none, or a key that cannot be edited.
    """
    if not _NAME.fullmatch(name) or bound not in BOUNDS:
        raise InputError(
            f"limit {name[:40]!r}, {bound[:40]!r}",
            found="no such limit",
            expected=f"a signal, and {', '.join(BOUNDS)}",
            remedy="choose one of the form",
        )
    return set_key(text, f"limits.{name}", bound, value.strip() or None, str(folder / CAMPAIGN))


def with_map(folder: Path, text: str, run: str, channel_map: str) -> str:
    """Text of a campaign file that imports a run by a channel map; a simulated vehicle becomes a comment.

    The map takes the place of the one that is there. If the campaign names the run, nothing else changes. If not, it is the run to fit,
    and what was said of other runs alone becomes comments.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        channel_map: `[[import.files]]` tables.

    Raises:
        InputError: a map that holds anything else, names a file outside the campaign's folder, or an `[import]` that cannot be edited.
    """
    _check_map(folder, run, channel_map)
    where = str(folder / CAMPAIGN)
    table = toml_content(where, text).get("import")
    earlier = table if isinstance(table, dict) else {}
    new, others = {**earlier, "files": files_of(channel_map)}, False
    if run not in (*earlier.get("fit", ()), *earlier.get("predict", ())):
        new = {"fit": [run]} | {key: value for key, value in new.items() if key not in ("fit", *OF_RUNS)}
        text, others = set_key(text, "import", "fit", [run], where), True
    sections = sections_of(text)
    at = next((i for i, one in enumerate(sections) if one.name.startswith(MAP)), len(sections))
    before, after = (
        "".join(one.text for one in some if not one.name.startswith(MAP)) for some in (sections[:at], sections[at:])
    )
    text = f"{before.rstrip()}\n\n{channel_map.strip()}\n" + (f"\n{after.lstrip()}" if after else "")
    if others:
        text = comment_out(text, "import.trim")
        for key in OF_RUNS:
            text = set_key(text, "import", key, None, where)
    text = comment_out(text, "truth")
    try:
        is_right = toml_content(where, text).get("import") == new
    except InputError:
        is_right = False
    if not is_right:
        raise InputError(
            f"{where}, table [import]",
            found="an [import] that cannot be edited where it stands",
            expected="[import] and [[import.files]], each on a line of its own",
            remedy="edit the file in a text editor",
        )
    return text


class FurtherRun(NamedTuple):
    """A log that is another run of the one log of the map: its label, and the path of both with `{run}` in the place of their labels."""

    label: str
    path: str


def further_run(text: str, log: str) -> FurtherRun | None:
    """Return how a campaign would name a log as a further run by the map that is there; None where the names of the logs do not tell it.

    Args:
        text: of the file.
        log: path from the campaign's folder.
    """
    runs, files = list(runs_of(text)), files_of(channel_map_of(text))
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
    """Text of a campaign file with a further run of the same map.

    Args:
        folder: of the campaign.
        text: of the file.
        run: as `further_run` gives it.
        role: `fit` or `predict`.

    Raises:
        InputError: an `[import]` that cannot be edited.
    """
    where = str(folder / CAMPAIGN)
    earlier = toml_content(where, text)["import"]
    files = [{**one, "path": run.path} for one in files_of(channel_map_of(text))]
    text = with_map(folder, text, runs_of(text)[0], written_map(files))
    return set_key(text, "import", role, [*earlier.get(role, ()), run.label], where)


def runs_of(text: str) -> tuple[str, ...]:
    """Runs that a campaign file names, those that are fitted first.

    Raises:
        InputError: a file that is not TOML.
    """
    table = toml_content(CAMPAIGN, text).get("import", {})
    return (*table.get("fit", ()), *table.get("predict", ())) if isinstance(table, dict) else ()


def runs_reading(text: str, log: str) -> tuple[str, ...]:
    """Runs of a campaign file that read a log.

    Args:
        text: of the file.
        log: path from the campaign's folder.

    Raises:
        InputError: a file that is not TOML.
    """
    files = files_of(channel_map_of(text))
    return tuple(run for run in runs_of(text) if any(_is_of(one, run) and path_of(one, run) == log for one in files))


def is_named(text: str, file: str) -> bool:
    """Return whether a campaign file names a file, as a log or in any other key.

    Args:
        text: of the campaign file.
        file: path from the campaign's folder.

    Raises:
        InputError: a campaign file that is not TOML.
    """
    runs = runs_of(text) or ("",)
    strings = list(_strings_in(toml_content(CAMPAIGN, text)))
    return any(Path(one.replace("{run}", run)) == Path(file) for one in strings for run in runs)


def map_of_run(channel_map: str, run: str) -> tuple[str, str]:
    """Return the part of a channel map that one run reads, and the part that only others read.

    Raises:
        InputError: a map that is not TOML.
    """
    files = files_of(channel_map)
    own, others = ([one for one in files if _is_of(one, run) is wanted] for wanted in (True, False))
    return written_map(own), written_map(others)


def map_of_log(channel_map: str, log: str) -> str:
    """Return the part of a channel map that names a log.

    Raises:
        InputError: a map that is not TOML.
    """
    return written_map([one for one in files_of(channel_map) if one.get("path") == log])


def with_own_map(folder: Path, text: str, run: str, role: str, channel_map: str) -> str:
    """Text of a campaign file in which one run has a map of its own; all other runs keep theirs.

    Each log gets `runs`, which says whose it is. A log that only this run read goes.

    Args:
        folder: of the campaign.
        text: of the file, which names a run or more.
        run: label of the record.
        role: `fit` or `predict`, for a run that the campaign does not name.
        channel_map: `[[import.files]]` tables of the run.

    Raises:
        InputError: a map that `with_map` refuses, or an `[import]` that cannot be edited.
    """
    _check_map(folder, run, channel_map)
    runs = runs_of(text)
    others = [
        {**one, "runs": labels}
        for one in files_of(channel_map_of(text))
        if (labels := [label for label in one.get("runs") or runs if label != run])
    ]
    own = [{**one, "runs": [run]} for one in files_of(channel_map)]
    text = with_map(folder, text, runs[0], written_map([*others, *own]))
    if run in runs:
        return text
    where = str(folder / CAMPAIGN)
    return set_key(text, "import", role, [*toml_content(where, text)["import"].get(role, ()), run], where)


def _strings_in(content: Any) -> Iterator[str]:
    """Yield every text of a TOML file."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping | list):
        for one in content.values() if isinstance(content, Mapping) else content:
            yield from _strings_in(one)


def _is_of(file: Mapping[str, Any], run: str) -> bool:
    """Return whether a run reads the log of one `[[import.files]]`."""
    return not file.get("runs") or run in file["runs"]


class Mapped(NamedTuple):
    """The column of a channel as the form has it: its table's `[[import.files]]` without channels, its name, what is done to its cells,
    and what a control does between its samples: "line" or "held"; empty for what the map says of it.
    """

    head: str
    column: str
    unit: str
    scale: float
    offset: float
    between: str = ""


def with_channel(channel_map: str, name: str, mapped: Mapped | None) -> str:
    """Channel map with another column for a channel, or without the channel; the map is written as a whole, without comments.

    Args:
        channel_map: `[[import.files]]` tables.
        name: of the channel.
        mapped: its column; None for none.

    Raises:
        InputError: a map that is not TOML.
    """
    files = files_of(channel_map)
    head = {} if mapped is None else files_of(mapped.head)[0]
    target = None if mapped is None else _find(files, identity_of(head))
    if mapped is not None and target is None:
        target = len(files)
        files.append(head)
    earlier: dict[str, Any] = {}
    for at, file in enumerate(files):
        if at != target and name in file.get("channels", {}):
            earlier = file["channels"].pop(name)
    if mapped is not None and target is not None:
        columns = files[target].setdefault("channels", {})
        _fill(columns.setdefault(name, {"column": "", "unit": "", **earlier}), mapped)
    return written_map(one for one in files if one.get("channels") != {})


def with_newer_log(channel_map: str, name: str, log: Any, runs: Sequence[str]) -> tuple[str, tuple[str, ...]]:
    """Channel map with a log in the place of those that it makes needless, and the paths of these.

    A log that is new to the map takes the place of one of which it has every column, with units and signs; and of one whose
    channels it all has by other names, which are then without a column.

    Args:
        channel_map: `[[import.files]]` tables.
        name: path of the log from the campaign's folder.
        log: what a look into it found: `heads`, `columns` and `guesses`, as `seatrial.dashboard.logs.Looked`.
        runs: of the campaign, for paths with `{run}`.

    Raises:
        InputError: a map that is not TOML.
    """
    mapped: dict[str, list[dict[str, Any]]] = {}
    for file in files_of(channel_map):
        mapped.setdefault(str(file.get("path")), []).append(file)
    gone: list[str] = []
    if any(name in (path, path.replace("{run}", run)) for path in mapped for run in runs or ("",)):
        return channel_map, ()
    guessed = {one.channel for one in log.guesses}
    for path, files in mapped.items():
        channels = [channel for file in files for channel in file.get("channels", {})]
        if not gone and all(has_columns(log, file) for file in files):
            channel_map = written_map(
                [{**one, "path": name} if one.get("path") == path else one for one in files_of(channel_map)]
            )
        elif channels and guessed >= {*channels}:
            for channel in channels:
                channel_map = with_channel(channel_map, channel, None)
        else:
            continue
        gone.append(path)
    return channel_map, tuple(gone)


def has_columns(log: Any, file: Mapping[str, Any]) -> bool:
    """Return whether a log has every column that one `[[import.files]]` names, laid out as that says."""
    name = file.get("table") or (next(iter(log.heads)) if len(log.heads) == 1 else None)
    if name not in log.heads:
        return False
    head = files_of(log.heads[name])[0]
    alike = all(file.get(key) == head.get(key) for key in ("table", "delimiter", "encoding", "skip_rows"))
    columns = [file.get("time", {}), *file.get("channels", {}).values()]
    try:
        sums = [part for one in columns if "sum" in one for _, part in parse_sum(str(one["sum"]), "the channel map")]
    except InputError:  # said when the map is checked
        return False
    needed = {*sums, *(str(one["column"]) for one in columns if one.get("column"))}
    return alike and needed <= {one.name for one in log.columns if one.table == name}


def with_shift(channel_map: str, path: str, table: str | None, shift: float) -> str:
    """Channel map with another shift of the clock of one log, s; 0 removes it.

    Raises:
        InputError: no such log in the map, or a map that cannot be edited.
    """
    files = files_of(channel_map)
    at = _find(files, (path, table))
    if at is None:
        raise InputError("the channel map", found=f"no file {path!r}", expected="one of the map", remedy="map it first")
    if shift:
        files[at]["shift"] = f"{np.format_float_positional(shift, trim='-')} s"
    else:
        files[at].pop("shift", None)
    return written_map(files)


def with_time(channel_map: str, path: str, table: str | None, column: str, unit: str) -> str:
    """Channel map with another column of time for one log; as it is where it does not name the log.

    Raises:
        InputError: a map that is not TOML.
    """
    files = files_of(channel_map)
    at = _find(files, (path, table))
    if at is None:
        return channel_map
    files[at]["time"] = {**files[at].get("time", {}), "column": column, "unit": unit}
    return written_map(files)


def channel_map_of(text: str) -> str:
    """The `[[import.files]]` of a campaign file as they stand there, comments too; empty where it has none."""
    return "".join(one.text for one in sections_of(text) if one.name.startswith(MAP)).strip() + "\n"


def files_of(channel_map: str) -> list[dict[str, Any]]:
    """Logs of a map, each as its `[[import.files]]` says.

    Raises:
        InputError: a map that is not TOML.
    """
    table = toml_content("the channel map", channel_map).get("import", {})
    return table.get("files", []) if isinstance(table, dict) else []


def channels_of(channel_map: str) -> dict[str, dict[str, Any]]:
    """Channels of a map by name, each with the `path` and `table` of its file.

    Raises:
        InputError: a map that is not TOML.
    """
    return {
        name: {**column, "path": file.get("path"), "table": file.get("table")}
        for file in files_of(channel_map)
        for name, column in file.get("channels", {}).items()
    }


def identity_of(file: Mapping[str, Any]) -> tuple[str, Any]:
    """Return path and table of one `[[import.files]]`, which tell it from the others of a map."""
    return str(file.get("path")), file.get("table")


def path_of(file: Mapping[str, Any], run: str) -> str:
    """Return the path of the log of one `[[import.files]]` for a run."""
    return str(file.get("path")).replace("{run}", run)


def written_map(files: Iterable[Mapping[str, Any]]) -> str:
    """Return a channel map as TOML, its channels last, a line for each."""
    return "\n".join(
        f"[[{MAP}]]\n"
        + "".join(f"{dotted(key)} = {_inline(value)}\n" for key, value in one.items() if key != "channels")
        + "".join(f"channels.{dotted(key)} = {_inline(value)}\n" for key, value in one.get("channels", {}).items())
        for one in files
    )


def _find(files: Sequence[Mapping[str, Any]], identity: tuple[Any, Any]) -> int | None:
    return next((i for i, file in enumerate(files) if identity_of(file) == identity), None)


def _fill(column: MutableMapping[str, Any], mapped: Mapped) -> None:
    if mapped.column:
        column.pop("sum", None)
        column["column"] = mapped.column
    column["unit"] = mapped.unit
    for key, value, usual in (("scale", mapped.scale, 1.0), ("offset", mapped.offset, 0.0)):
        if value != usual:
            column[key] = value
        else:
            column.pop(key, None)
    if mapped.between == "line" or (mapped.between and "between" in column):
        column["between"] = mapped.between


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{dotted(key)} = {_inline(one)}" for key, one in value.items()) + " }"
    return "[" + ", ".join(map(_inline, value)) + "]" if isinstance(value, list) else written(value)


def _check_map(folder: Path, run: str, channel_map: str) -> None:
    where = "the channel map"
    if not files_of(channel_map):
        raise InputError(
            where,
            found="no column of a log",
            expected="a column for each channel that was logged",
            remedy="choose them in the form, or write [[import.files]]",
        )
    try:
        content = toml_content(where, channel_map)
        files = content["import"]["files"]
        paths = [str(one["path"]) for one in files]
        columns = [column for one in files for column in one.get("channels", {}).values()]
        paths += [str(column["curve"]) for column in columns if "curve" in column]
        alone = set(content) == {"import"} and set(content["import"]) == {"files"}
    except (KeyError, TypeError, AttributeError) as cause:
        raise InputError(
            where, found=f"{cause}", expected="[[import.files]] tables, each with a path", remedy="correct it"
        ) from cause
    if not alone:
        raise InputError(
            where, found="other tables", expected="[[import.files]] alone", remedy="edit those in the file"
        )
    for path in paths:
        try:
            plain = "$" not in path and not path.startswith("~") and not Path(path).is_absolute()
            inside = plain and place_of(folder, path, where, run, [folder.resolve()]).name != ""
        except InputError:
            inside = False
        if not inside:
            raise InputError(
                f"{where}, path {path[:80]!r}",
                found="a file outside the campaign's folder",
                expected="one inside it",
                remedy="copy it there, or name it in the file by hand",
            )
