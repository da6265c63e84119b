"""A trial as a ROS 2 bag of commands, in MCAP or SQLite: std_msgs/Float64 in SI on one topic, and what it is on another.

`/seatrial/command/n` holds a message every 50 ms, those of the last second neutral, and `/seatrial/about` one std_msgs/String of JSON with
unit, limits and schedule.
"""

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.core.errors import InputError, install_extra
from seatrial.export.trials.plain import trial_json
from seatrial.export.trials.trial import NEUTRAL, Trial, value_at

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
    try:
        import rosbags.rosbag2 as rosbag2
        import rosbags.typesys as typesys
    except ModuleNotFoundError as cause:
        raise InputError(
            str(folder),
            found="rosbags, which writes ROS 2 bags, is not installed",
            expected="the extra `ros`",
            remedy=install_extra("ros"),
        ) from cause
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
