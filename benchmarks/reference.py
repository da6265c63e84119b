"""The C reference: compiled here with gcc for each number of lanes kept in registers, and called through ctypes."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np

WIDTHS = (8, 16, 32, 64)
FLAGS = ("-O3", "-march=native", "-ffast-math", "-Wno-psabi", "-shared", "-fPIC")
SOURCE = Path(__file__).with_name("reference.c")
OUTPUTS = SOURCE.parents[1] / "outputs"


@cache
def library(width: int) -> ctypes.CDLL:
    """Compile and load the loops for a number of lanes.

    Raises:
        SystemExit: gcc is missing or does not compile the source.
    """
    if shutil.which("gcc") is None:
        raise SystemExit(
            "benchmarks: the C reference needs gcc, which is not on the path; install it (apt install gcc)"
        )
    OUTPUTS.mkdir(exist_ok=True)
    target = OUTPUTS / f"reference_{width}.so"
    command = ["gcc", *FLAGS, f"-DWIDTH={width}", str(SOURCE), "-o", str(target), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"benchmarks: gcc could not compile the C reference\n{done.stderr}")
    return ctypes.CDLL(str(target))


def call(width: int, cores: int, name: str, n_lanes: int, *arguments: np.ndarray | float | int) -> None:
    """Call a loop on all lanes, cut into one range of whole blocks for each core."""
    function = getattr(library(width), name)
    converted = [_c(argument) for argument in (n_lanes, *arguments)]
    share = -(-n_lanes // (cores * width)) * width
    ranges = [(first, min(first + share, n_lanes)) for first in range(0, n_lanes, share)]
    on_cores(cores, lambda ends: function(ctypes.c_long(ends[0]), ctypes.c_long(ends[1]), *converted), ranges)


def on_cores(cores: int, function: Callable, items: list) -> list:
    """Map over items, on as many threads as cores."""
    if cores == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(cores) as pool:
        return list(pool.map(function, items))


def _c(value: np.ndarray | float | int):
    if isinstance(value, np.ndarray):
        assert value.dtype == float
        assert value.flags.c_contiguous
        return value.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    return ctypes.c_long(value) if isinstance(value, int) else ctypes.c_double(value)
