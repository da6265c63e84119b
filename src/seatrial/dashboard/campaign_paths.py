"""Campaigns under the folder that is served, and their files: nothing outside it can be named, whatever a request says."""

import os
import re
import shutil
import unicodedata
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from seatrial.campaign.config.named_files import find
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import write_text

DEEPEST = 3
"""Folders below the served one in which campaigns are looked for."""
MOST = 500
"""Campaigns that are listed."""
DOWNLOADS = {
    "report.html": "text/html; charset=utf-8",
    "campaign.toml": "text/plain; charset=utf-8",
    "results/summary.json": "application/json",
    "results/selection.json": "application/json",
}
"""Files of a campaign that may be fetched, and their types."""
MADE = re.compile(r"[\w-][\w.-]*\.svg|results/[a-z0-9_]+_schedule\.(csv|json)|results/(coefficients|averaged)\.csv")
"""Pictures, schedules and tables that commands wrote, by their place in the campaign's folder."""
_TYPES = {".svg": "image/svg+xml", ".csv": "text/csv; charset=utf-8", ".json": "application/json"}
_EXPORTED = re.compile(r"export/(?:[A-Za-z0-9_-]+/){1,2}[A-Za-z0-9_][A-Za-z0-9_.-]*")
"""Files that `seatrial export` wrote, those of a bag in a separate folder; they are only ever saved, never shown."""
LONGEST = 200
"""Bytes of a name; file systems take 255, and a name beside it is longer while it is written."""
MOST_LETTERS = 120
_PLAIN = re.compile(rf"\w[\w. +()-]{{0,{MOST_LETTERS - 1}}}")
"""Letters of any script, digits and little else."""
_ALLOWED = f"letters, digits, spaces and . _ - + ( ), {MOST_LETTERS} characters and {LONGEST} bytes at most"


@dataclass(frozen=True)
class CampaignPaths:
    """The folder that is served.

    Attributes:
        root: without symbolic links.
    """

    root: Path

    @classmethod
    def of(cls, folder: Path) -> "CampaignPaths":
        """Of a folder, or of the campaign file itself.

        Raises:
            InputError: no such folder.
        """
        folder = folder.parent if folder.name == CAMPAIGN and folder.is_file() else folder
        if not folder.is_dir():
            raise InputError(
                str(folder),
                found="no such folder",
                expected="a campaign, or a folder of campaigns",
                remedy="correct the path, or begin one with `seatrial init`",
            )
        return cls(folder.resolve())

    def campaigns(self) -> list[str]:
        """Names of all campaigns, by their place below the root; `.` is the root itself."""
        names, waiting = [], [(self.root, 0)]
        while waiting and len(names) < MOST:
            folder, depth = waiting.pop()
            if (folder / CAMPAIGN).is_file():
                names.append(folder.relative_to(self.root).as_posix())
                continue
            if depth < DEEPEST:
                waiting += [(one, depth + 1) for one in _folders(folder)]
        return sorted(names)

    def folder(self, name: str) -> Path:
        """Folder of a campaign.

        Raises:
            InputError: no campaign of that name below the root.
        """
        with suppress(OSError, ValueError):  # a name that no file system would take
            folder = (self.root / name).resolve()
            if not Path(name).is_absolute() and folder.is_relative_to(self.root) and (folder / CAMPAIGN).is_file():
                return folder
        names = self.campaigns()
        raise InputError(
            f'campaign "{name[:80]}"',
            found="no such campaign here",
            expected="one of " + ", ".join(names[:20]) if names else "a folder with campaign.toml",
            remedy=nearest(name[:80], names) if names else "begin one with `seatrial init`",
        )

    def new_folder(self, name: str) -> Path:
        """Folder that a new campaign of a name would have: directly in the served one, and not there yet.

        Raises:
            InputError: a name that no folder should have, one that is taken, or a served folder that is a campaign itself.
        """
        if (self.root / CAMPAIGN).is_file():
            raise InputError(
                str(self.root),
                found="a campaign, which contains no other",
                expected="a folder of campaigns",
                remedy=f"serve the folder above it: seatrial serve {self.root.parent}",
            )
        plain = unicodedata.normalize("NFC", name.strip())
        if not _is_plain(plain) or plain.endswith("."):
            raise InputError(
                f"name {name[:80]!r}",
                found=_fault_of(plain, "names of folders"),
                expected=f"{_ALLOWED}, a letter or digit first",
                remedy="choose another",
            )
        folder = self.root / plain
        if os.path.lexists(folder):
            raise _taken(folder)
        return folder

    def log(self, written: str) -> Path:
        """Return a log that a new campaign is of, by its path from the served folder, links followed.

        Raises:
            InputError: no such file, or one in a folder that may not be read.
        """
        try:
            return find(self.root, written, f'log "{written[:80]}"').resolve()
        except InputError as error:
            remedy = "choose one of the list, or send it; for others start the dashboard with --allow-read FOLDER"
            raise InputError(error.where, found=error.found, expected=error.expected, remedy=remedy) from None

    def begin(self, folder: Path, text: str, log: Path | None = None) -> None:
        """Make the folder of a new campaign, and write its file; a log is kept under `logs/` of it, by a link that shares its bytes if
        there can be one.

        Raises:
            InputError: somebody else has made it meanwhile.
            OSError: it cannot be made or written.
        """
        try:
            folder.mkdir()
        except FileExistsError as cause:
            raise _taken(folder) from cause
        try:
            if log is not None:
                _keep(log, folder / "logs" / log.name)
            write_text(folder / CAMPAIGN, text)
        except OSError:
            shutil.rmtree(folder)
            raise

    def inside(self, folder: Path, relative: str) -> Path:
        """A file of a campaign, named relative to it.

        Raises:
            InputError: no such file, or one outside, also by a symbolic link.
        """
        with suppress(OSError, ValueError):
            path, allowed = (folder / relative).resolve(), folder.resolve()
            plain = not Path(relative).is_absolute()
            if plain and path.is_relative_to(allowed) and path.is_relative_to(self.root) and path.is_file():
                return path
        raise InputError(
            f'file "{relative[:80]}"',
            found="no such file in this campaign",
            expected="a file inside its folder",
            remedy="choose another, or copy it there",
        )

    def files(self, name: str) -> list[str]:
        """Files of a campaign that may be fetched, relative to its folder."""
        folder = self.folder(name)
        paths = [*folder.glob("*"), *Store(folder).results.glob("*"), *(folder / "export").rglob("*")]
        there = [path.relative_to(folder).as_posix() for path in paths if path.is_file()]
        return sorted(one for one in there if one in DOWNLOADS or MADE.fullmatch(one) or _EXPORTED.fullmatch(one))

    def download(self, name: str, relative: str) -> tuple[Path, str]:
        """A file that may be fetched, and its type.

        Raises:
            InputError: not one of those, or not there.
        """
        kind = DOWNLOADS.get(relative)
        if _EXPORTED.fullmatch(relative):
            kind = "application/octet-stream"
        elif MADE.fullmatch(relative):
            kind = _TYPES[Path(relative).suffix]
        if kind is None:
            raise InputError(
                f'file "{relative[:80]}"',
                found="a file that is not served",
                expected="one of " + ", ".join(DOWNLOADS),
                remedy="copy it from the campaign's folder",
            )
        return self.inside(self.folder(name), relative), kind


def _keep(log: Path, place: Path) -> None:
    """Link a log, which may be a folder such as a bag, into another place; copy it if it cannot be linked."""
    place.parent.mkdir()
    try:
        shutil.copytree(log, place, copy_function=os.link) if log.is_dir() else os.link(log, place)
    except OSError:
        shutil.copytree(log, place, dirs_exist_ok=True) if log.is_dir() else shutil.copy2(log, place)


def logs_of(folder: Path, suffixes: tuple[str, ...]) -> list[str]:
    """Logs inside a campaign's folder, results aside, relative to it; links that lead outside are left out."""
    results, logs = Store(folder).results, []
    for base, folders, files in os.walk(folder):
        folders[:] = sorted(
            one for one in folders if not one.startswith(".") and Path(base, one) != results and _is_text(one)
        )
        for name in sorted(files):
            path = Path(base, name)
            if _is_text(name) and name.lower().endswith(suffixes) and path.resolve().is_relative_to(folder.resolve()):
                logs.append(path.relative_to(folder).as_posix())
    return logs[:200]


def upload_name(given: str, suffixes: tuple[str, ...]) -> str:
    """Name under which an uploaded log is kept: as given, accents composed with their letters.

    Raises:
        InputError: a path, a hidden file, odd characters, or a suffix no log has.
    """
    name = unicodedata.normalize("NFC", given)
    if not _is_plain(name):
        raise InputError(
            f"file name {given[:80]!r}",
            found=_fault_of(name, "file names of logs"),
            expected=_ALLOWED,
            remedy="rename the file",
        )
    if not name.lower().endswith(suffixes):
        raise InputError(
            f'file "{name}"',
            found="a suffix that is not of a log",
            expected="one of " + ", ".join(sorted(suffixes)),
            remedy="unpack archives first; upload the log itself",
        )
    return name


def _is_text(name: str) -> bool:
    """Return whether the name of a file or folder is UTF-8, as an address of a page has to be."""
    return name.isascii() or os.fsencode(name).decode(errors="ignore") == name


def _is_plain(name: str) -> bool:
    return _PLAIN.fullmatch(name) is not None and len(name.encode()) <= LONGEST


def _fault_of(name: str, kind: str) -> str:
    """Return what is wrong with a name that is not plain, or ends with a dot."""
    if not name:
        return "nothing"
    if _PLAIN.fullmatch(name[:MOST_LETTERS]) and not _is_plain(name):
        return f"{len(name)} characters, {len(name.encode())} bytes"
    return f"a path, or characters that {kind} do not need"


def _taken(folder: Path) -> InputError:
    return InputError(
        str(folder),
        found="a file or folder of that name",
        expected="a new name",
        remedy="choose another; nothing was changed",
    )


def _folders(folder: Path) -> list[Path]:
    try:
        return [
            one
            for one in folder.iterdir()
            if one.is_dir() and not one.is_symlink() and not one.name.startswith(".") and _is_text(one.name)
        ]
    except OSError:
        return []
