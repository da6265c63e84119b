"""A trial in the formats asked for: CSV and JSON with its limits at the head, a script for MAVLink, a ROS 2 bag."""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.core.errors import InputError, needing_extra, not_among
from seatrial.core.files import write_text
from seatrial.export.equations import docstring_line
from seatrial.export.trials.trial import NEUTRAL, Trial, value_at

FORMAT = 1


def trial_csv(trial: Trial) -> str:
    """Return time and control at every bend and neutral at the end, in the operator's unit; lines with # repeat the limits."""
    factor, unit = trial.shown
    rows = (f"{t:.10g},{x * factor:.10g}\n" for t, x in zip(*trial.ending_neutral, strict=True))
    return "".join(f"# {line}\n" for line in trial.lines) + f"time_s,{trial.control}_{unit}\n" + "".join(rows)


def trial_json(trial: Trial) -> str:
    """Return the same with SI values beside, format 1."""
    factor, unit = trial.shown
    time, value = trial.ending_neutral
    content = {
        "format": FORMAT,
        "about": list(trial.lines),
        "control": trial.control,
        "interpolation": "straight lines between rows",
        "time_s": [float(t) for t in time],
        "value": [float(x * factor) for x in value],
        "unit": unit,
        "value_si": [float(x) for x in value],
        "unit_si": trial.unit,
        "limits_si": {"lower": trial.lower, "upper": trial.upper, "rate": trial.rate},
        "limits_of_motion": list(trial.motion),
        "rule": trial.rule,
    }
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


# A trial as a ROS 2 bag of commands, in MCAP or SQLite: std_msgs/Float64 in SI on one topic, and what it is on
# another.
#
# `/seatrial/command/n` holds a message every 50 ms, those of the last second neutral, and `/seatrial/about` one
# std_msgs/String of JSON with unit, limits and schedule.

STEP = 0.05  # Time between messages, s
REST = 20  # Messages of neutral at the end
STORAGES = {"mcap": "MCAP", "ros2": "SQLITE3"}  # The library's name of each storage


def write_bag(trial: Trial, folder: Path, storage: str) -> Path:
    """Write the folder of a bag, whole or not at all; an earlier one is replaced.

    Args:
        trial: with its controls over time.
        folder: of the trial, in which the bag is made.
        storage: of the bag: `mcap` or `ros2`.

    Raises:
        InputError: the library is not installed.
    """
    writing, types = bag_libraries(folder)
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as inside:
        # The files inside a bag are named after its folder.
        made = Path(inside) / folder.name
        with writing.Writer(made, version=9, storage_plugin=getattr(writing.StoragePlugin, STORAGES[storage])) as bag:
            _fill(bag, store, trial)
        if folder.is_dir() and not folder.is_symlink():
            shutil.rmtree(folder)
        else:
            folder.unlink(missing_ok=True)
        os.replace(made, folder)
    return folder


def bag_libraries(folder: Path) -> tuple[Any, Any]:
    """Return what writes a bag and knows its types.

    Raises:
        InputError: the library is not installed.
    """
    with needing_extra("ros", str(folder), "{}, which writes ROS 2 bags, is not installed"):
        import rosbags.rosbag2 as rosbag2
        import rosbags.typesys as typesys

    return rosbag2, typesys


def _fill(bag: Any, store: Any, trial: Trial) -> None:
    text, number = store.types["std_msgs/msg/String"], store.types["std_msgs/msg/Float64"]
    about = bag.add_connection("/seatrial/about", text.__msgtype__, typestore=store)
    command = bag.add_connection(f"/seatrial/command/{trial.control}", number.__msgtype__, typestore=store)
    bag.write(about, 0, store.serialize_cdr(text(data=trial_json(trial)), text.__msgtype__))
    time = np.arange(0.0, trial.time[-1] + 0.5 * STEP, STEP)
    values = np.append(value_at(trial, time), np.full(REST, NEUTRAL))
    for t, value in zip(STEP * np.arange(values.size), values, strict=True):
        bag.write(command, round(t * 1e9), store.serialize_cdr(number(data=float(value)), number.__msgtype__))


# A trial as a Python script that sends it over MAVLink: by MANUAL_CONTROL to ArduSub, or by MAV_CMD_DO_SET_ACTUATOR.
#
# It prints what it would send until it is told `--send`. Limits are in it and clip every value; it moves only an
# armed vehicle in the right mode, and the end, Ctrl-C, a refusal and a silent autopilot lead to neutral. Its code is
# `mavlink_script`; the head is the trial's.

_BEGIN, _END = "# The trial\n", "# Every trial\n"
_DOC = '''#!/usr/bin/env python3
"""
@DOC@

Dry run, which is the default:   python trial.py
Send:                            python trial.py --send udpin:0.0.0.0:14550
Set the mode, arm, send, disarm: python trial.py --send udpin:0.0.0.0:14550 --arm

Needs pymavlink to send. Without --arm the operator arms the vehicle, in MANUAL. MANUAL_CONTROL has no unit: its 1000 stands for --full,
here @FULL@ in the unit of the table. Measure what full stick makes of the control at the pilot's gain of the trial, and give that. Let no
joystick of a ground station send at the same time.
"""

'''


def trial_script(trial: Trial) -> str:
    """Return the script.

    Raises:
        InputError: no stick stands for the control, or the campaign does not say which way it moves the vehicle.
    """
    stick = trial.find_stick()
    factor, unit = trial.shown
    bounds = [None if bound is None else _shown(bound * factor) for bound in (trial.lower, trial.upper)]
    full = max(abs(float(trial.value.max())), abs(float(trial.value.min()))) * factor
    full = _shown(max([full] + [abs(bound) for bound in bounds if bound is not None]))
    rate = None if trial.rate is None else _shown(trial.rate * factor)
    rows = "".join(
        f"    ({float(t)!r}, {_shown(x * factor)!r}),\n" for t, x in zip(trial.time, trial.value, strict=True)
    )
    code = files("seatrial.export.trials").joinpath("mavlink_script.py").read_text(encoding="utf-8")
    imports, _, rest = code[code.index("from __future__") :].partition(_BEGIN)
    head = _DOC.replace("@FULL@", repr(full)).replace("@DOC@", "\n".join(map(docstring_line, trial.lines)))
    own = f"""CONTROL, UNIT = {trial.control!r}, {unit!r}
AXIS, SIGN = {stick.axis!r}, {stick.sign}
LOWER, UPPER, RATE = {bounds[0]!r}, {bounds[1]!r}, {rate!r}
FULL = {full!r}
ROWS = [
{rows}]
"""
    return head + imports + _BEGIN + own + _END + rest.partition(_END)[2]


def _shown(value: float) -> float:
    """Return a number without the rounding of its unit."""
    return float(f"{value:.12g}")


_TEXTS: dict[str, tuple[str, Callable[[Trial], str]]] = {
    "csv": ("trial.csv", trial_csv),
    "json": ("trial.json", trial_json),
    "mavlink": ("trial.py", trial_script),
}
FORMATS = (*_TEXTS, *STORAGES)  # Formats of a trial; the last two need the extra `ros`
PLAIN = tuple(_TEXTS)  # Those that need nothing


def write_plain(trial: Trial, folder: Path) -> tuple[list[Path], str]:
    """Write what needs no library; returns the paths, and why there is no script, empty if there is one."""
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
