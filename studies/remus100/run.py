"""The whole study: parts computed on every core, items judged, `paper.json` written."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from seatrial import __version__
from seatrial.core.errors import InputError
from seatrial.core.files import remove_orphans, write_json
from seatrial.core.reporter import SILENT, Reporter, run_side_by_side
from studies.remus100.registry import ENTRIES, PARTS
from studies.remus100.study import Item, Sizes, Study
from studies.remus100.vehicle_file import READINGS, Reading, read_vehicle

FILE_NAME = "paper.json"


def choose_vehicle(reading: str, vehicle: Path | None) -> Reading:
    """Return the paper's vehicle under one reading, or a user's.

    Raises:
        InputError: no such reading, both given, or a file that cannot be used.
    """
    if reading.upper() not in READINGS or (vehicle is not None and reading != "A"):
        raise InputError(
            "--reading",
            found=f'"{reading}"' + (" together with --vehicle" if vehicle else ""),
            expected="A or B, of the paper's own vehicle",
            remedy="leave it out for A; a vehicle file names its units",
        )
    return READINGS[reading.upper()] if vehicle is None else read_vehicle(vehicle)


def check_folder(folder: Path, reading: Reading) -> None:
    """Refuse a folder that holds the study of something else.

    Raises:
        InputError: a file, or the study of another vehicle or reading.
    """
    if folder.is_file():
        raise InputError(
            str(folder),
            found="a file",
            expected="a folder, made if need be",
            remedy="leave it out for one named after the options",
        )
    try:
        kept = json.loads((folder / FILE_NAME).read_text(encoding="utf-8"))["vehicle"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return
    if kept != reading.source.model_dump():
        raise InputError(
            str(folder),
            found=f"the study of {kept.get('name', 'another vehicle')}" if isinstance(kept, dict) else "another study",
            expected=f"an empty folder, or the study of {reading.source.name}",
            remedy="name another folder, or delete this one",
        )


def run_paper(
    folder: Path, reading: Reading, sizes: Sizes, items: Sequence[str], reporter: Reporter = SILENT
) -> tuple[Study, list[Item]]:
    """Compute what the items need, resuming from what the folder holds, judge them, and write `paper.json`.

    Args:
        folder: results, report and figures.
        reading: vehicle.
        sizes: sample sizes.
        items: keys, see `studies.remus100.registry`.
        reporter: receives what happens.
    """
    remove_orphans(folder)
    study = Study(folder, reading, sizes, PARTS, reporter)
    needed = {part for key in items for part in ENTRIES[key].parts}
    begun = time.monotonic()
    run_side_by_side([lambda name=name: study.part(name) for name in PARTS if name in needed])
    judged = [ENTRIES[key].judge(study) for key in items]
    write_json(
        folder / FILE_NAME,
        {
            "seatrial_version": __version__,
            "vehicle": reading.source.model_dump(),
            "reading": reading.name,
            "sizes": asdict(sizes),
            "seed": study.seed,
            "items": [item.as_json() for item in judged],
        },
    )
    reporter.say(f"{len(judged)} item{'s' * (len(judged) > 1)} judged in {time.monotonic() - begun:.0f} s")
    return study, judged
