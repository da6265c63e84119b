"""UUV Simulator's own plugins, compiled on ODE, run exported vehicles: `python release/simulators/uuv.py --source FOLDER`.

FOLDER holds a checkout of uuvsimulator/uuv_simulator; g++, ODE, Ignition Math 6, TinyXML 2, Eigen and Boost are needed (Debian:
libode-dev libignition-math-dev libtinyxml2-dev libeigen3-dev libboost-dev). Compiled unchanged are HydrodynamicModel, BuoyantObject,
UnderwaterObjectPlugin, ThrusterPlugin, ThrusterConversionFcn and Dynamics; `uuv/shim.hh` stands for Gazebo Classic's calls. Steps are 1 ms.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import laboratory
import numpy as np
from laboratory import SAMPLE, History, State, Twin

from seatrial.export.drives import drives_of
from seatrial.export.exact import SIGN, gravity_of
from seatrial.export.manoeuvre import Controls
from seatrial.export.published import of_catalogue
from seatrial.export.statement import state
from seatrial.export.targets.uuv import Uuv, plugin_of
from seatrial.export.vehicle import ExportedVehicle

OWN = Path(__file__).parent / "uuv"
STEP, DEPTH = 0.001, 50.0
SOURCES = (
    "HydrodynamicModel",
    "BuoyantObject",
    "UnderwaterObjectPlugin",
    "ThrusterPlugin",
    "ThrusterConversionFcn",
    "Dynamics",
)
HEADERS = (
    "gazebo/gazebo.hh",
    "gazebo/msgs/msgs.hh",
    "gazebo/physics/Base.hh",
    "gazebo/physics/Collision.hh",
    "gazebo/physics/Link.hh",
    "gazebo/physics/Model.hh",
    "gazebo/physics/PhysicsEngine.hh",
    "gazebo/physics/Shape.hh",
    "gazebo/physics/World.hh",
    "gazebo/transport/TransportTypes.hh",
    "gazebo/transport/transport.hh",
    "sdf/sdf.hh",
    "Double.pb.h",
)
"""Headers that the sources ask for, and `shim.hh` stands for."""


class UuvTwin:
    """A vehicle's files in UUV Simulator."""

    target = "UUV Simulator"

    def __init__(self, world: Path, version: str, vehicle: ExportedVehicle, folder: Path):
        self.world, self.version, self.vehicle, self.folder = world, version, vehicle, folder
        exporter = Uuv()
        _, provenance = of_catalogue("bluerov2_heavy")
        texts = exporter.write(vehicle, state(exporter, vehicle, provenance))
        (folder / "vehicle.urdf").write_text(texts["vehicle.urdf"], encoding="utf-8")

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        centre = plugin_of(self.vehicle).centre
        nu, angles = SIGN * _moved(start[:6], centre), SIGN[3:] * np.array([start[6], start[7], 0.0])
        names = [drive.control for drive in drives_of(self.vehicle)[0]]
        count = round(duration / SAMPLE)
        rows = [[controls(i * SAMPLE)[name] for name in names] for i in range(count)]
        head = [0.0, 0.0, -DEPTH, *angles, *nu, 0.0, 0.0, 0.0]
        lines = [str(count), *(" ".join(map(repr, map(float, row))) for row in [head, *rows])]
        commands, result = self.folder / "commands.txt", self.folder / "result.txt"
        commands.write_text("\n".join(lines) + "\n", encoding="utf-8")
        arguments = [self.folder / "vehicle.urdf", gravity_of(self.vehicle), STEP, SAMPLE, commands, result]
        subprocess.run([self.world, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)
        found = np.loadtxt(result)
        there = (SIGN * found[:, 6:12]).T
        back = _moved(there, -centre)
        angles = (SIGN[3:] * found[:, 3:6]).T
        return np.concatenate([back, angles[:2]]).T


def build(source: Path, folder: Path) -> Path:
    """Compile the plugins; returns the program."""
    plugins = source / "uuv_gazebo_plugins" / "uuv_gazebo_plugins"
    for name in HEADERS:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text('#include "shim.hh"\n', encoding="utf-8")
    includes = [f"-I{folder}", f"-I{OWN}", f"-I{plugins / 'include'}", "-I/usr/include/ignition/math6"]
    includes += ["-I/usr/include/eigen3"]
    files = [OWN / "world.cc", *(plugins / "src" / f"{name}.cc" for name in SOURCES)]
    libraries = ["-lode", "-ltinyxml2", "-lignition-math6"]
    program = folder / "world"
    options = ["-std=c++17", "-O2", "-w", "-DdDOUBLE"]
    subprocess.run(["g++", *options, *includes, *map(str, files), *libraries, "-o", str(program)], check=True)
    return program


def _moved(nu: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Velocities at another place of the body, forward, starboard, down."""
    found = np.array(nu, float)
    arm = place.reshape(3, *(1 for _ in found.shape[1:])) * np.ones_like(found[:3])
    found[:3] += np.cross(found[3:], arm, axis=0)
    return found


def main() -> int:
    """Build, run every vehicle, store the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of uuvsimulator/uuv_simulator")
    parser.add_argument("--version", default="bfb40cb", help="commit of the checkout, for the table")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build(options.source, folder)

        def twin(vehicle: ExportedVehicle) -> Twin:
            return UuvTwin(program, options.version, vehicle, folder)

        return laboratory.run("uuv", Uuv(), twin, "python release/simulators/uuv.py --source FOLDER")


if __name__ == "__main__":
    sys.exit(main())
