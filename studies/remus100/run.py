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
from studies.remus100.reading import READINGS, Reading
from studies.remus100.registry import ENTRIES, PARTS
from studies.remus100.study import Item, Sizes, Study

FILE_NAME = "paper.json"


def choose_reading(name: str) -> Reading:
    """Return the paper's vehicle under one reading.

    Raises:
        InputError: no such reading.
    """
    if name.upper() not in READINGS:
        raise InputError("--reading", found=f'"{name}"', expected="A or B", remedy="leave it out for A")
    return READINGS[name.upper()]


def check_folder(folder: Path, reading: Reading) -> None:
    """Refuse a folder that holds the study of something else.

    Raises:
        InputError: a file, or the study of another reading.
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
    if kept != asdict(reading):
        raise InputError(
            str(folder),
            found=f"the study of {kept.get('title', 'another vehicle')}" if isinstance(kept, dict) else "another study",
            expected=f"an empty folder, or the study of {reading.title}",
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
            "vehicle": asdict(reading),
            "reading": reading.name,
            "sizes": asdict(sizes),
            "seed": study.seed,
            "items": [item.as_json() for item in judged],
        },
    )
    reporter.say(f"{len(judged)} item{'s' * (len(judged) > 1)} judged in {time.monotonic() - begun:.0f} s")
    return study, judged
