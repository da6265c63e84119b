"""gz-sim's own systems, compiled on DART, run exported vehicles: `python release/simulators/gz.py --source FOLDER`.

FOLDER holds a checkout of gazebosim/gz-sim; g++, DART, Ignition Math 6, TinyXML 2 and Eigen are needed (Debian: libdart-dev
libignition-math-dev libtinyxml2-dev libeigen3-dev). Compiled unchanged are the systems Hydrodynamics, LiftDrag and Thruster; `gz/shim.hh`
stands for gz-sim's calls, and `gz/world.cc` sets inertia, added mass, buoyancy, fins and steps as gz-physics and gz-sim do. Steps are
the exported world's.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import laboratory
import numpy as np
from laboratory import History, State, Twin
from worlds import compile_world, run_world

from seatrial.export.manoeuvre import STILL, Controls, Current
from seatrial.export.rigid_body import drives_of, fins_of
from seatrial.export.target import Carried, Statement
from seatrial.export.targets.gz import Gz
from seatrial.export.terms import sorted_terms
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance

OWN = Path(__file__).parent / "gz"
SOURCES = ("hydrodynamics/Hydrodynamics", "lift_drag/LiftDrag", "thruster/Thruster")


class GzTwin:
    """A vehicle's files in Gazebo; `current` is the water's, m/s north, east, down."""

    target = "gz-sim"

    def __init__(self, world: Path, version: str, vehicle: ExportedVehicle, folder: Path, current: Current):
        self.world, self.version, self.vehicle, self.folder = world, version, vehicle, folder
        self.current = current
        statement = Statement(self.target, ExportProvenance("", ""), Carried(Gz().carries(vehicle).motion), (), "", ())
        (folder / "world.sdf").write_text(Gz().write(vehicle, statement)["world.sdf"], encoding="utf-8")

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        names = [drive.control for drive in drives_of(self.vehicle)[0]]
        names += [fin.control for fin in fins_of(sorted_terms(self.vehicle.forces))[0]]
        command = [self.world, self.folder / "world.sdf"]
        return run_world(command, self.folder, start, controls, duration, names, np.zeros(3), self.current)


def build(source: Path, folder: Path) -> Path:
    """Compile the systems; returns the program."""
    systems = source / "src" / "systems"
    files = [systems / f"{name}.cc" for name in SOURCES]
    includes = [path.parent for path in files]
    return compile_world(folder, OWN, files, includes, ["dart", "tinyxml2", "ignition-math6"])


def main() -> int:
    """Build, run every vehicle, store the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of gazebosim/gz-sim")
    parser.add_argument("--version", default="93bbf3e on DART 6.12", help="commit of the checkout, for the table")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build(options.source, folder)

        def twin(vehicle: ExportedVehicle, current: Current = STILL) -> Twin:
            return GzTwin(program, options.version, vehicle, folder, current)

        return laboratory.run("gz", Gz(), twin, "python release/simulators/gz.py --source FOLDER", in_current=twin)


if __name__ == "__main__":
    sys.exit(main())
