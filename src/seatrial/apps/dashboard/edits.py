"""Edits of a campaign file by the page: limits, and the map of a log that lies inside the folder."""

import re
from pathlib import Path

from seatrial.apps.campaign_text import CAMPAIGN
from seatrial.apps.toml_edit import comment_out, set_key, written
from seatrial.campaign.config.named_files import place_of
from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import InputError

BOUNDS = ("lower", "upper", "rate")
OF_RUNS = ("fit", "predict", "trim", "files")
"""Keys of `[import]` that another log replaces; all others stay."""
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

    What the earlier import says of every run, such as its `step`, is kept.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        channel_map: `[[import.files]]` tables.

    Raises:
        InputError: a map that holds anything else, or names a file outside the campaign's folder.
    """
    _check_map(folder, run, channel_map)
    earlier = toml_content(str(folder / CAMPAIGN), text).get("import")
    kept = {key: value for key, value in earlier.items() if key not in OF_RUNS} if isinstance(earlier, dict) else {}
    for table in ("truth", "import"):
        text = comment_out(text, table)
    lines = [f"fit = [{written(run)}]", *(f"{key} = {written(value)}" for key, value in kept.items())]
    return "\n".join([text.rstrip(), "", "[import]", *lines, "", channel_map.strip(), ""])


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
