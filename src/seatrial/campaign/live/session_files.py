"""What a live session keeps: everything as it came, the samples in SI as a table that the same campaign imports, and its last look."""

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.toml_edit import Key, with_values
from seatrial.campaign.live.channels import lined_controls
from seatrial.core.errors import InputError
from seatrial.core.files import begin_file, read_bytes, write_json
from seatrial.core.signals import signal_unit
from seatrial.vehicles.model import VehicleModel

SYNC_SECONDS = 1.0  # Seconds after which everything is on the disk
SESSION_FOLDER = Path("results") / "live"  # Of the sessions, in a campaign's folder
_PATH = f"{SESSION_FOLDER.as_posix()}/{{run}}.csv"
# What the session that runs, or ran last, said last; in a folder of its own, so that the others do not change with it
LAST_LOOK = SESSION_FOLDER / "now" / "look.json"
LOOK = {"run", "at", "time_s", "samples", "coefficients", "innovations", "kind", "advice"}  # Keys of a look
SHOWN_SECONDS = 0.5  # Seconds between two looks that are shown


class Kept:
    """Two files of one session, to which is only ever added.

    Args:
        campaign: whose folder they are in.
        suffix: of the file of everything as it came.
        channels: controls and measured channels.
    """

    def __init__(self, campaign: Campaign, suffix: str, channels: Sequence[str]):
        self.folder, self.channels = campaign.folder / SESSION_FOLDER, tuple(channels)
        self.folder.mkdir(parents=True, exist_ok=True)
        name, number = time.strftime("%Y-%m-%dT%H%M%SZ", time.gmtime()), 1
        while any(self.folder.glob(f"{name if number == 1 else f'{name}-{number}'}.*")):
            number += 1
        self.run = name if number == 1 else f"{name}-{number}"
        self.raw, self.table = (begin_file(self.folder / f"{self.run}{end}") for end in (suffix, ".csv"))
        self.table.write((",".join(["time_s", *self.channels]) + "\n").encode())
        self.rows: list[str] = []
        self.last = -1.0
        self.synced = time.monotonic()
        self.shown = -SHOWN_SECONDS

    @property
    def path(self) -> Path:
        """The table of samples in SI."""
        return self.folder / f"{self.run}.csv"

    def add_raw(self, data: bytes) -> None:
        """Keep what came, before anything is made of it."""
        if data:
            self.raw.write(data)

    def add(self, seconds: float, values: Mapping[str, float]) -> None:
        """Keep one sample; it is written by `flush`. Of two at one time the second is put a microsecond later."""
        self.last = seconds = max(seconds, self.last + 1e-6)
        cells = (values.get(name) for name in self.channels)
        self.rows.append(f"{seconds:.9f}," + ",".join("" if one is None or one != one else repr(one) for one in cells))

    def flush(self, force: bool = False) -> None:
        """Hand the samples to the system, and see to it that they are on the disk once a second."""
        if self.rows:
            self.table.write(("\n".join(self.rows) + "\n").encode())
            self.rows = []
        if force or time.monotonic() - self.synced >= SYNC_SECONDS:
            for stream in (self.raw, self.table):
                os.fsync(stream.fileno())
            self.synced = time.monotonic()

    def show(self, look: Mapping[str, Any], force: bool = False) -> None:
        """Put a look where the dashboard finds it, unless another one was put there just now."""
        now = time.monotonic()
        if force or now - self.shown >= SHOWN_SECONDS:
            self.shown = now
            (self.folder / "now").mkdir(exist_ok=True)
            write_json(self.folder / "now" / LAST_LOOK.name, {"run": self.run, "at": time.time(), **look})

    def close(self) -> None:
        """Write what is left."""
        self.flush(force=True)
        self.raw.close()
        self.table.close()


def sessions(folder: Path) -> list[str]:
    """Return the sessions of a campaign's folder by name, the oldest first."""
    tables = sorted((folder / SESSION_FOLDER).glob("*.csv"))
    return [path.stem for path in tables if not path.name.endswith(".received.csv")]


def last_look(folder: Path) -> dict[str, Any] | None:
    """Return what the last session of a campaign's folder said last, with `run` and the time `at`; None if there is none."""
    try:
        content = json.loads(read_bytes(folder / LAST_LOOK))
    except (OSError, InputError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) and content.keys() >= LOOK else None


def import_lines(imports: ImportTable | None, model: VehicleModel, channels: tuple[str, ...], run: str) -> str:
    """Return the lines of a campaign file that import a session."""
    return with_values("", _import_of(imports, model, channels, run)).strip()


def _import_of(imports: ImportTable | None, model: VehicleModel, channels: tuple[str, ...], run: str) -> dict[Key, Any]:
    lined, columns = lined_controls(imports), {}
    for name in (*model.controls, *channels):
        columns[name] = {"column": name, "unit": signal_unit(name)} | ({"between": "line"} if name in lined else {})
    file = {"path": _PATH, "time": {"column": "time_s", "unit": "s"}, "channels": columns}
    return {("import", "fit"): [run], ("import", "files"): [file]}


def with_session(campaign: Campaign, run: str) -> str:
    """Return the campaign file with a session among the runs that are fitted.

    Raises:
        InputError: a campaign whose trials are simulated, or whose runs are of other files.
    """
    if campaign.is_simulated:
        raise InputError(
            campaign.where("truth"),
            found="[truth]: its trials are simulated",
            expected="a campaign that imports",
            remedy="copy its file without [truth] and [import] to another folder, or leave --import out",
        )
    imports = campaign.imports
    whole = _import_of(imports, campaign.model(campaign.full), campaign.channels, run)
    if imports is None:
        return with_values(campaign.text, whole, str(campaign.path))
    if [file.path for file in imports.files] != [_PATH]:
        raise InputError(
            campaign.where("import"),
            found="runs of other files",
            expected="an [import] of live sessions, or none",
            remedy="copy the session to the path of [[import.files]], or put these lines into a separate campaign:\n"
            + with_values("", whole).strip(),
        )
    fit = list(dict.fromkeys((*imports.fit, run)))
    return with_values(campaign.text, {("import", "fit"): fit}, str(campaign.path))
