"""Edits of a campaign file by the page: limits, and the map of a log that lies inside the folder."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from seatrial.apps.campaign_text import CAMPAIGN
from seatrial.apps.toml_edit import comment_out, set_key, written
from seatrial.campaign.config.named_files import place_of
from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import InputError

BOUNDS = ("lower", "upper", "rate")
OF_RUNS = ("fit", "predict", "trim", "files")
"""Keys of `[import]` that another log replaces; all others stay."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")
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
    """Text of a campaign file that imports one log by a channel map; a simulated vehicle and an earlier import become comments.

    What the earlier import says of every run, such as its `step`, is kept; of a run that it names, all but its files is.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        channel_map: `[[import.files]]` tables.

    Raises:
        InputError: a map that holds anything else, or names a file outside the campaign's folder.
    """
    _check_map(folder, run, channel_map)
    found = toml_content(str(folder / CAMPAIGN), text).get("import")
    earlier = found if isinstance(found, dict) else {}
    is_there = run in (*earlier.get("fit", ()), *earlier.get("predict", ()))
    dropped = ("files",) if is_there else OF_RUNS
    kept = {key: value for key, value in earlier.items() if key not in dropped}
    for table in ("truth", "import"):
        text = comment_out(text, table)
    runs = kept if is_there else {"fit": [run], **kept}
    lines = [f"{_key(key)} = {_inline(value)}" for key, value in runs.items()]
    return "\n".join([text.rstrip(), "", "[import]", *lines, "", channel_map.strip(), ""])


class Mapped(NamedTuple):
    """A channel as the form has it: its table's `[[import.files]]` without channels, its column, and what is done to its cells."""

    channel: str
    head: str
    column: str
    unit: str
    scale: float
    offset: float


def with_channel(channel_map: str, name: str, mapped: Mapped | None) -> str:
    """Channel map with another column for a channel, or without the channel; whatever else it says is kept.

    Args:
        channel_map: `[[import.files]]` tables.
        name: of the channel.
        mapped: its column; None for none.

    Raises:
        InputError: a map that is not TOML.
    """
    files = _files_of(channel_map)
    old: dict[str, Any] = {}
    for file in files:
        old = file.get("channels", {}).pop(name, old)
    if mapped is not None:
        head = _files_of(mapped.head)[0]
        same = (one for one in files if all(one.get(key) == head.get(key) for key in ("path", "table")))
        file = next(same, None)
        if file is None:
            files.append(file := head)
        if mapped.column:
            old = {
                "column": mapped.column,
                **{key: value for key, value in old.items() if key not in ("column", "sum")},
            }
        old["unit"] = mapped.unit
        for key, value, usual in (("scale", mapped.scale, 1.0), ("offset", mapped.offset, 0.0)):
            old.pop(key, None)
            old |= {key: value} if value != usual else {}
        file.setdefault("channels", {})[name] = old
    return "\n".join(_written_file(file) for file in files if file.get("channels"))


def channel_map_of(folder: Path, text: str) -> str:
    """The `[[import.files]]` of a campaign file as a channel map; empty where it has none.

    Raises:
        InputError: text that is not TOML.
    """
    table = toml_content(str(folder / CAMPAIGN), text).get("import")
    files = table.get("files", []) if isinstance(table, dict) else []
    return "\n".join(_written_file(file) for file in files)


def channels_of(channel_map: str) -> dict[str, dict[str, Any]]:
    """Channels of a map by name, each with the `path` and `table` of its file.

    Raises:
        InputError: a map that is not TOML.
    """
    return {
        name: {**column, "path": file.get("path"), "table": file.get("table")}
        for file in _files_of(channel_map)
        for name, column in file.get("channels", {}).items()
    }


def _files_of(channel_map: str) -> list[dict[str, Any]]:
    found = toml_content("the channel map", channel_map).get("import", {})
    return found.get("files", []) if isinstance(found, dict) else []


def _written_file(file: Mapping[str, Any]) -> str:
    lines = ["[[import.files]]"]
    lines += [f"{_key(key)} = {_inline(value)}" for key, value in file.items() if key != "channels"]
    lines += [f"channels.{_key(name)} = {_inline(column)}" for name, column in file.get("channels", {}).items()]
    return "\n".join([*lines, ""])


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {_inline(one)}" for key, one in value.items()) + " }"
    return "[" + ", ".join(map(_inline, value)) + "]" if isinstance(value, list) else written(value)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _check_map(folder: Path, run: str, channel_map: str) -> None:
    where = "the channel map"
    try:
        content = toml_content(where, channel_map)
        files = content["import"]["files"]
        paths = [str(one["path"]) for one in files]
        columns = [column for one in files for column in one.get("channels", {}).values()]
        paths += [str(column["curve"]) for column in columns if "curve" in column]
        alone = set(content) == {"import"} and set(content["import"]) == {"files"}
    except (KeyError, TypeError, AttributeError) as cause:
        raise InputError(
            where, found=f"{cause}", expected="[[import.files]] tables, each with a path", remedy="mend it"
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
