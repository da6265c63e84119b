"""Campaigns to begin from, as `seatrial init` writes them."""

from importlib.resources import files
from pathlib import Path, PurePath

from seatrial.campaign.config import FILE_NAME
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import write_text


def template_names() -> tuple[str, ...]:
    """Names of the templates."""
    return tuple(sorted(PurePath(item.name).stem for item in files(__name__).iterdir() if item.name.endswith(".toml")))


def init_campaign(folder: Path | str, template: str) -> Path:
    """Write a template's campaign file into a folder, which is made if missing; returns the file.

    Raises:
        InputError: no such template, or a folder that holds a campaign already.
    """
    if template not in template_names():
        raise InputError(
            f'template "{template}"',
            found="no such template",
            expected=", ".join(template_names()),
            remedy=nearest(template, template_names()),
        )
    path = Path(folder) / FILE_NAME
    if path.exists():
        raise InputError(
            str(path),
            found="a campaign already",
            expected="a folder without one",
            remedy="choose another folder, or delete the file",
        )
    write_text(path, files(__name__).joinpath(f"{template}.toml").read_text(encoding="utf-8"))
    return path
