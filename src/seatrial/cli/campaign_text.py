"""The text of a campaign file: read, changed key by key, and written unless somebody else changed it meanwhile."""

from pathlib import Path

from seatrial.campaign.config.toml_edit import with_values
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.files import write_text

CAMPAIGN = "campaign.toml"


def read_file(folder: Path) -> str:
    """Text of a campaign file.

    Raises:
        InputError: too large, or not UTF-8.
    """
    from seatrial.campaign.config.toml import read_text

    return read_text(folder / CAMPAIGN)


def written_units(folder: Path) -> tuple[tuple[str, str], ...]:
    """Return the units in which the priors of a campaign file are written, by name; none if it cannot be read."""
    from seatrial.campaign.config.toml import toml_content

    try:
        priors = toml_content(folder / CAMPAIGN, read_file(folder)).get("prior", {})
        return tuple((str(name), str(table["unit"])) for name, table in priors.items() if "unit" in table)
    except (SeatrialError, OSError, TypeError, AttributeError):
        return ()


def with_trim(folder: Path, text: str, run: str | None, start: str | None, end: str | None) -> str:
    """Text of a campaign file with other ends of an imported run, or of all that have none of their own.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label; None for all runs.
        start: from the beginning of the record, such as "5 s"; None to leave it as it is.
        end: likewise.

    Raises:
        InputError: a key that cannot be edited.
    """
    table = ("import",) if run is None else ("import", "trim", run)
    ends = {(*table, key): value for key, value in (("start", start), ("end", end)) if value is not None}
    return with_values(text, ends, str(folder / CAMPAIGN))


def write_file(folder: Path, text: str, seen: str) -> None:
    """Write a campaign file that was checked, unless somebody else changed it meanwhile.

    Raises:
        InputError: the file is no longer what the edit began from.
        OSError: it cannot be written.
    """
    if read_file(folder) != seen:
        raise InputError(
            str(folder / CAMPAIGN),
            found="a file that was changed after it was read",
            expected="the file as it was read",
            remedy="read it again, then edit; in a browser, copy your text before you reload the page",
        )
    write_text(folder / CAMPAIGN, text)
