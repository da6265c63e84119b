"""A log that is sent to a campaign: counted while it arrives, and kept under `logs/` whole or not at all."""

from collections.abc import AsyncIterator
from pathlib import Path

from seatrial.apps.dashboard.places import upload_name
from seatrial.core.errors import InputError
from seatrial.core.files import atomic_path

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
