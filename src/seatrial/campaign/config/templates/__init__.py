"""Campaigns to begin from, as `seatrial init` writes them."""

import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from seatrial.campaign.store.stored_result import FILE_NAME
from seatrial.core.argument_checks import check_kind, check_path
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import write_text

# What each template is, by name.
TEMPLATES = {
    "remus100": "a simulated REMUS 100: the whole loop at once",
    "design": "your vehicle without data: design a first trial",
    "steering": "a published vehicle without data: design a first trial of the rudder",
    "log": "a CSV log of a trial in surge with one propeller",
    "bollard": "a CSV log of a vehicle tied to a force gauge: its thrust",
}
EXAMPLE_VEHICLE = "YOUR VEHICLE"  # Name of the vehicle in the template of a log
_PLACEHOLDER = re.compile(rf"^[^#\n]*\"({EXAMPLE_VEHICLE}|[A-Z]+ COLUMN)\b", re.MULTILINE)


def has_placeholders(text: str) -> bool:
    """Return whether a campaign file, or a part of one, still has names in capitals that a template leaves to be filled in."""
    return _PLACEHOLDER.search(text) is not None


def init_campaign(folder: Path | str, template: str) -> Path:
    """Write a campaign file into a folder; make the folder if missing.

    Args:
        folder: of the new campaign.
        template: `remus100` (simulated), `design` or `steering` (no data yet), `log` (a CSV log) or `bollard` (a CSV log of a
            force gauge).

    Returns:
        the path of the file.

    Raises:
        InputError: no such template, a file that cannot be written, or a folder that holds a campaign already.
    """
    return write_campaign(folder, template_text(template))


def write_campaign(folder: Path | str, text: str) -> Path:
    """Write a campaign file into a folder, which is made if missing, and return its path.

    Raises:
        InputError: something that cannot be written, or a folder that holds a campaign already.
    """
    path = check_path(folder, "campaign, folder") / FILE_NAME
    if path.exists():
        raise InputError(
            str(path),
            found="a campaign already",
            expected="a folder without one",
            remedy="choose another folder, or delete the file",
        )
    write_text(path, text)
    return path


def template_text(template: str) -> str:
    """Return the text of a template.

    Raises:
        InputError: no such template.
    """
    check_kind(template, str, "template", "use one of: " + ", ".join(TEMPLATES))
    if template not in TEMPLATES:
        raise InputError(
            f'template "{template}"',
            found="no such template",
            expected="; ".join(f"{name}, {meaning}" for name, meaning in TEMPLATES.items()),
            remedy=nearest(template, TEMPLATES),
        )
    return files(__name__).joinpath(f"{template}.toml").read_text(encoding="utf-8")


def example_of(key: Sequence[str | int]) -> str:
    """Return how a key or table of a campaign file that is missing may be written, as the template `design` writes it."""
    table, keys = str(key[0]), [str(part) for part in key[1:]]
    blocks = [block.splitlines() for block in template_text("design").split("\n\n")]
    written = [[line for line in block if not line.startswith("#")] for block in blocks]
    block = next((lines for lines in written if lines and lines[0].strip("[]").split(".")[0] == table), [])
    line = next((line for name in reversed(keys) for line in block if line.startswith(f"{name} = ")), "")
    if not block or (keys and not line):
        return "`seatrial init` writes examples: " + ", ".join(TEMPLATES)
    return f"for example {line}" if keys else "for example\n" + "\n".join(f"    {one}" for one in block)
