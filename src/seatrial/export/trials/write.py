"""Writing a trial in the formats asked for."""

from collections.abc import Callable, Sequence
from pathlib import Path

from seatrial.core.errors import InputError, not_among
from seatrial.core.files import write_text
from seatrial.export.trials.bag import STORAGES, bag_libraries, write_bag
from seatrial.export.trials.mavlink import trial_script
from seatrial.export.trials.plain import trial_csv, trial_json
from seatrial.export.trials.trial import Trial

_TEXTS: dict[str, tuple[str, Callable[[Trial], str]]] = {
    "csv": ("trial.csv", trial_csv),
    "json": ("trial.json", trial_json),
    "mavlink": ("trial.py", trial_script),
}
FORMATS = (*_TEXTS, *STORAGES)  # Formats of a trial; the last two need the extra `ros`
PLAIN = tuple(_TEXTS)  # Those that need nothing


def write_plain(trial: Trial, folder: Path) -> tuple[list[Path], str]:
    """Write what needs no library; returns the paths, and why there is no script, empty where there is one."""
    try:
        trial.find_stick()
    except InputError as error:
        script, _ = _TEXTS["mavlink"]
        (folder / script).unlink(missing_ok=True)  # an earlier trial's would be taken for this one's
        return write_trial(trial, folder, tuple(name for name in PLAIN if name != "mavlink")), str(error)
    return write_trial(trial, folder, PLAIN), ""


def check_format(trial: Trial, name: str, folder: Path) -> None:
    """Refuse a format in which a trial could not be written into a folder.

    Raises:
        InputError: a script for a control that no stick stands for, or a library that is not installed.
    """
    if name == "mavlink":
        trial.find_stick()
    if name in STORAGES:
        bag_libraries(folder)


def write_trial(trial: Trial, folder: Path, formats: Sequence[str] = PLAIN) -> list[Path]:
    """Write a trial into a folder; returns the paths.

    Args:
        trial: with its controls over time.
        folder: which is made if missing.
        formats: names of what is written.

    Raises:
        InputError: an unknown format, one whose library is not installed, or a script for a control that no stick stands for.
    """
    for name in formats:
        if name not in FORMATS:
            raise not_among(f"--trial --to {name}", name, FORMATS)
    made = []
    for name in formats:
        if name in _TEXTS:
            file, text = _TEXTS[name]
            write_text(folder / file, text(trial))
            made.append(folder / file)
        else:
            made.append(write_bag(trial, folder / f"trial_{name}", name))
    return made
