"""Edits of a campaign file: checked by the package as a whole before they are written, and written whole or not at all."""

import re
import tomllib
from pathlib import Path

from seatrial.apps.dashboard.places import CAMPAIGN
from seatrial.apps.dashboard.toml_edit import comment_out, set_key, written
from seatrial.core.errors import InputError
from seatrial.core.files import write_text

BOUNDS = ("lower", "upper", "rate")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,40}")


def read_file(folder: Path) -> str:
    """Text of a campaign file.

    Raises:
        InputError: not UTF-8.
    """
    path = folder / CAMPAIGN
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(
            str(path),
            found="bytes that are not UTF-8",
            expected="a TOML file in UTF-8",
            remedy="save the file as UTF-8",
        ) from cause


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


def with_trim(folder: Path, text: str, start: float | None, end: float | None) -> str:
    """Text of a campaign file with other ends of the imported records, s from the beginning of each; None for as it is recorded.

    Raises:
        InputError: a key that cannot be edited.
    """
    for key, value in (("start", start), ("end", end)):
        place = str(folder / CAMPAIGN)
        text = set_key(text, "import", key, None if value is None else f"{value:.6g} s", place)
    return text


def with_map(folder: Path, text: str, run: str, channel_map: str) -> str:
    """Text of a campaign file that imports one log by a channel map; a simulated vehicle and an earlier import become comments.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        channel_map: `[[import.files]]` tables.

    Raises:
        InputError: a map that holds anything else, or names a file outside the campaign's folder.
    """
    _check_map(folder, run, channel_map)
    for table in ("truth", "import"):
        text = comment_out(text, table)
    return f"{text.rstrip()}\n\n[import]\nfit = [{written(run)}]\n\n{channel_map.strip()}\n"


def _check_map(folder: Path, run: str, channel_map: str) -> None:
    where = "the channel map"
    try:
        content = tomllib.loads(channel_map)
        files = content["import"]["files"]
        paths = [str(one["path"]) for one in files]
        alone = set(content) == {"import"} and set(content["import"]) == {"files"}
    except (tomllib.TOMLDecodeError, KeyError, TypeError) as cause:
        raise InputError(
            where, found=f"{cause}", expected="[[import.files]] tables, each with a path", remedy="mend it"
        ) from cause
    if not alone:
        raise InputError(
            where, found="other tables", expected="[[import.files]] alone", remedy="edit those in the file"
        )
    for path in paths:
        try:
            inside = "$" not in path and (folder / path.replace("{run}", run)).resolve().is_relative_to(
                folder.resolve()
            )
        except (OSError, ValueError):
            inside = False
        if not inside or path.startswith("~"):
            raise InputError(
                f"{where}, path {path[:80]!r}",
                found="a file outside the campaign's folder",
                expected="one inside it",
                remedy="copy the log there, or name it in the file by hand",
            )


def write_file(folder: Path, text: str, seen: str) -> None:
    """Write a campaign file that was checked, unless somebody else changed it meanwhile.

    Raises:
        InputError: the file is no longer what the edit began from.
        OSError: it cannot be written.
    """
    if read_file(folder) != seen:
        raise InputError(
            str(folder / CAMPAIGN),
            found="a file that was changed since this page was opened",
            expected="the file as the page shows it",
            remedy="reload the page and edit again",
        )
    write_text(folder / CAMPAIGN, text)
