"""Small logs written on the spot, and the maps to read them."""

import re
from pathlib import Path

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.core.signals import signal_unit
from seatrial.logs.source import ColumnMap, LogSource

SPEED = ColumnMap("speed", "m/s", "measurement")
PROPELLER = ColumnMap("rpm", "rpm", "control")
GOOD = "t,rpm,speed,remark\n" + "".join(f"{0.1 * k:.1f},{600 + k},{1 + 0.01 * k:.2f},ok\n" for k in range(20))


def source(path: Path, **changes) -> LogSource:
    """Return the source of a log like `GOOD`."""
    settings = {"time_column": "t", "time_unit": "s", "channels": {"n": PROPELLER, "u": SPEED}} | changes
    return LogSource(path, **settings)


def written(folder: Path, text: str | bytes, name: str = "run.csv") -> Path:
    """Write a log and return its path."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def column(folder: Path, name: str, time, channel: str, values: np.ndarray, role, unit="s") -> LogSource:
    """Write a log of one channel in SI, time as text with enough digits, and return its source."""
    rows = zip(time, values.tolist(), strict=True)
    text = f"t,{channel}\n" + "".join(f"{stamp},{value!r}\n" for stamp, value in rows)
    return LogSource(written(folder, text, name), "t", unit, {channel: ColumnMap(channel, signal_unit(channel), role)})


def refusal(*parts: str):
    """Expect an InputError whose text holds the parts, in order."""
    return pytest.raises(InputError, match="(?s)" + ".*".join(re.escape(part) for part in parts))
