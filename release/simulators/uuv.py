"""UUV Simulator's own plugins, compiled on ODE, run exported vehicles: `python release/simulators/uuv.py --source FOLDER`.

FOLDER holds a checkout of uuvsimulator/uuv_simulator; g++, ODE, Ignition Math 6, TinyXML 2, Eigen and Boost are needed (Debian:
libode-dev libignition-math-dev libtinyxml2-dev libeigen3-dev libboost-dev). Compiled unchanged are HydrodynamicModel, BuoyantObject,
UnderwaterObjectPlugin, ThrusterPlugin, ThrusterConversionFcn and Dynamics; `uuv/shim.hh` stands for Gazebo Classic's calls. Steps are 1 ms.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import laboratory
from laboratory import History, State, Twin
from worlds import compile_world, run_world

from seatrial.export.manoeuvre import STILL, Controls, Current
from seatrial.export.rigid_body import drives_of, gravity_of
from seatrial.export.target import Carried, Statement
from seatrial.export.targets.uuv import Uuv, plugin_of
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance

OWN = Path(__file__).parent / "uuv"
STEP = 0.001
SOURCES = (
    "HydrodynamicModel",
    "BuoyantObject",
    "UnderwaterObjectPlugin",
    "ThrusterPlugin",
    "ThrusterConversionFcn",
    "Dynamics",
)


class UuvTwin:
    """A vehicle's files in UUV Simulator."""

    target = "UUV Simulator"

    def __init__(self, world: Path, version: str, vehicle: ExportedVehicle, folder: Path, current: Current):
        self.world, self.version, self.vehicle, self.folder, self.current = world, version, vehicle, folder, current
        statement = Statement(self.target, ExportProvenance("", ""), Carried(Uuv().carries(vehicle).motion), (), "", ())
        (folder / "vehicle.urdf").write_text(Uuv().write(vehicle, statement)["vehicle.urdf"], encoding="utf-8")

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        names = [drive.control for drive in drives_of(self.vehicle)[0]]
        command = [self.world, self.folder / "vehicle.urdf", gravity_of(self.vehicle), STEP]
        centre = plugin_of(self.vehicle).centre
        return run_world(command, self.folder, start, controls, duration, names, centre, self.current)


def build(source: Path, folder: Path) -> Path:
    """Compile the plugins; returns the program."""
    plugins = source / "uuv_gazebo_plugins" / "uuv_gazebo_plugins"
    files = [plugins / "src" / f"{name}.cc" for name in SOURCES]
    return compile_world(folder, OWN, files, [plugins / "include"], ["ode", "tinyxml2", "ignition-math6"])


def main() -> int:
    """Build, run every vehicle, store the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of uuvsimulator/uuv_simulator")
    parser.add_argument("--version", default="bfb40cb", help="commit of the checkout, for the table")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build(options.source, folder)

        def twin(vehicle: ExportedVehicle, current: Current = STILL) -> Twin:
            return UuvTwin(program, options.version, vehicle, folder, current)

        return laboratory.run("uuv", Uuv(), twin, "python release/simulators/uuv.py --source FOLDER", in_current=twin)


if __name__ == "__main__":
    sys.exit(main())
