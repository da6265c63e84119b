"""The C references: compiled here with gcc, and called through ctypes, on one range of lanes for each core."""

import ctypes
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

WIDTHS = (8, 16, 32, 64)
FLAGS = ("-O3", "-march=native", "-ffast-math", "-Wno-psabi", "-shared", "-fPIC")
FOLDER = Path(__file__).parent
OUTPUTS = FOLDER.parent / "outputs"


@cache
def load(source: str, *options: str) -> ctypes.CDLL:
    """Load a file of loops that lies beside this one, compiled the first time this processor meets it.

    Raises:
        SystemExit: gcc does not compile it.
    """
    path, flags = FOLDER / source, [*FLAGS, *options]
    processor = subprocess.run(["gcc", "-march=native", "-Q", "--help=target"], capture_output=True).stdout
    digest = sha256(path.read_bytes() + repr(flags).encode() + processor).hexdigest()[:12]
    target = OUTPUTS / f"{path.stem}_{digest}.so"
    if not target.exists():
        OUTPUTS.mkdir(exist_ok=True)
        done = subprocess.run(["gcc", *flags, str(path), "-o", str(target), "-lm"], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"benchmarks: gcc could not compile {source}\n{done.stderr}")
    return ctypes.CDLL(str(target))


def call(width: int, cores: int, name: str, n_lanes: int, *arguments: np.ndarray | float | int) -> None:
    """Call a loop on all lanes, cut into one range of whole blocks for each core."""
    function = getattr(load("reference.c", f"-DWIDTH={width}"), name)
    converted = [as_c(argument) for argument in (n_lanes, *arguments)]
    share = -(-n_lanes // (cores * width)) * width
    ranges = [(first, min(first + share, n_lanes)) for first in range(0, n_lanes, share)]
    on_cores(cores, lambda ends: function(ctypes.c_long(ends[0]), ctypes.c_long(ends[1]), *converted), ranges)


def on_cores(cores: int, function: Callable, items: list) -> list:
    """Map over items, on as many threads as cores."""
    if cores == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(cores) as pool:
        return list(pool.map(function, items))


def as_c(value: np.ndarray | float | int):
    """Argument of a C function that takes pointers to double, doubles and longs."""
    if isinstance(value, np.ndarray):
        assert value.dtype == float
        assert value.flags.c_contiguous
        return value.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    return ctypes.c_long(value) if isinstance(value, int) else ctypes.c_double(value)
