"""Worlds of ours in C++ around a target's own sources: compiling them with a shim for the target's headers, and running a scenario."""

import re
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from laboratory import SAMPLE, History, State
from scipy.spatial.transform import Rotation

from seatrial.export.manoeuvre import Controls
from seatrial.export.rigid_body import SIGN

DEPTH = 50.0
"""Of the start, m."""
_FOREIGN = re.compile(r'#include\s*[<"]((?:gz|sdf|gazebo)/[^>"]+|[^>"]+\.pb\.h)[>"]')


def compile_world(
    folder: Path, own: Path, sources: Sequence[Path], includes: Sequence[Path], libraries: Iterable[str]
) -> Path:
    """Compile `world.cc` with a target's sources; returns the program.

    Args:
        folder: for what is made.
        own: folder of `world.cc` and of `shim.hh`, which stands for every header of the target's framework.
        sources: the target's, unchanged.
        includes: folders of the target's own headers.
        libraries: names of libraries.
    """
    texts = [*sources, *(path for one in includes for path in one.rglob("*.hh"))]
    wanted = {name for path in texts for name in _FOREIGN.findall(path.read_text(encoding="utf-8"))}
    for name in wanted:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text('#include "shim.hh"\n', encoding="utf-8")
    program = folder / "world"
    paths = [f"-I{path}" for path in (folder, own, *includes, "/usr/include/eigen3", "/usr/include/ignition/math6")]
    files = [str(path) for path in (own / "world.cc", *sources)]
    options = ["-std=c++17", "-O1", "-w", "-DdDOUBLE", "-DBOOST_BIND_GLOBAL_PLACEHOLDERS", "-o", str(program)]
    subprocess.run(["g++", *options, *paths, *files, *(f"-l{name}" for name in libraries)], check=True)
    return program


def run_world(
    command: Sequence[object],
    folder: Path,
    start: State,
    controls: Controls,
    duration: float,
    names: Sequence[str],
    place: np.ndarray,
    current: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> History:
    """Run a world from a state of ours.

    Args:
        command: program and its first arguments; sample, commands and result follow.
        folder: for commands and result.
        start: see `laboratory.CHANNELS`.
        controls: by time.
        duration: s.
        names: controls in the order of the world's.
        place: of the target's link, m forward, starboard, down of our origin.
        current: of the water, m/s north, east, down; the velocities are through it.
    """
    count = round(duration / SAMPLE)
    angles = SIGN[3:] * np.array([start[6], start[7], 0.0])
    over_ground = start[:6] + np.array([*_in_body(current, start[6], start[7], 0.0), 0.0, 0.0, 0.0])
    head = [0.0, 0.0, -DEPTH, *angles, *(SIGN * moved(over_ground, place)), *(SIGN[:3] * np.array(current))]
    rows = [[controls(i * SAMPLE)[name] for name in names] for i in range(count)]
    lines = [str(count), *(" ".join(repr(float(x)) for x in row) for row in [head, *rows])]
    commands, result = folder / "commands.txt", folder / "result.txt"
    commands.write_text("\n".join(lines) + "\n", encoding="utf-8")
    arguments = [str(part) for part in (*command, SAMPLE, commands, result)]
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)
    found = np.loadtxt(result)
    velocities, (phi, theta, psi) = moved((SIGN * found[:, 6:12]).T, -place), (SIGN[3:] * found[:, 3:6]).T
    velocities[:3] -= _in_body(current, phi, theta, psi)
    return np.concatenate([velocities, [phi, theta]]).T


def _in_body(current: tuple[float, float, float], phi: Any, theta: Any, psi: Any) -> np.ndarray:
    """The current in body axes, (3,) or (3, n)."""
    angles = np.stack(np.broadcast_arrays(psi, theta, phi), axis=-1)
    return Rotation.from_euler("ZYX", angles).inv().apply(np.array(current)).T


def moved(nu: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Velocities, (6,) or (6, n), at another place of the body, forward, starboard, down."""
    found = np.array(nu, float)
    arm = place.reshape(3, *(1 for _ in found.shape[1:])) * np.ones_like(found[:3])
    found[:3] += np.cross(found[3:], arm, axis=0)
    return found
