"""Fossen's Python Vehicle Simulator runs exported vehicles: `python release/simulators/fossen.py --source FOLDER`.

FOLDER holds a checkout of cybergalactic/PythonVehicleSimulator. The exported file is imported as its user does it, and its `dynamics` and
the simulator's `attitudeEuler` are called as `mainLoop.simulate` calls them; that function itself starts from no angle but zero. Steps
are 5 ms, by Euler's method as there.
"""

import argparse
import importlib.util
import sys
import tempfile
from pathlib import Path
from typing import Any

import laboratory
import numpy as np
from laboratory import SAMPLE, History, State, Twin

from seatrial.export.manoeuvre import Controls
from seatrial.export.targets.fossen import Fossen, controls_of
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance
from seatrial.export.write import state

STEP, DEPTH = 0.005, 10.0
UNITS = {"n": 30 / np.pi}
"""Of the simulator's commands by ours, SI; the others are alike."""


class FossenTwin:
    """A vehicle's file in the simulator; commands are turned as the export states it, not as the file has it."""

    target = "Python Vehicle Simulator"

    def __init__(self, kind: type, attitude: Any, version: str, vehicle: ExportedVehicle):
        self.kind, self.attitude, self.version = kind, attitude, version
        turned = Fossen().carries(vehicle).reversed
        self.order = controls_of(vehicle)
        self.factors = [UNITS.get(name, 1.0) * (-1.0 if name in turned else 1.0) for name in self.order]

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        vehicle, each = self.kind(), round(SAMPLE / STEP)
        eta, nu = np.array([0.0, 0.0, DEPTH, start[6], start[7], 0.0]), np.array(start[:6])
        actual = self._commands(controls, 0.0)
        found = [start]
        for i in range(round(duration / STEP)):
            nu, actual = vehicle.dynamics(eta, nu, actual, self._commands(controls, i * STEP), STEP)
            eta = self.attitude(eta, nu, STEP)
            if (i + 1) % each == 0:
                found.append(np.array([*nu, *eta[3:5]]))
        return np.array(found)

    def _commands(self, controls: Controls, t: float) -> np.ndarray:
        ours = controls(t)
        return np.array([factor * ours.get(name, 0.0) for name, factor in zip(self.order, self.factors, strict=True)])


def exported(vehicle: ExportedVehicle, folder: Path) -> type:
    """The class in a vehicle's exported file."""
    exporter = Fossen()
    ((name, text),) = exporter.write(
        vehicle, state(exporter, vehicle, ExportProvenance("laboratory", vehicle.name))
    ).items()
    path = folder / name
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return getattr(made, path.stem)


def main() -> int:
    """Run every vehicle, store the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of cybergalactic/PythonVehicleSimulator")
    parser.add_argument("--version", default="c717e07", help="commit of the checkout, for the table")
    options = parser.parse_args()
    sys.path.insert(0, str(options.source / "src"))
    from python_vehicle_simulator.lib.gnc import attitudeEuler  # pyright: ignore[reportMissingImports]

    with tempfile.TemporaryDirectory() as name:

        def twin(vehicle: ExportedVehicle) -> Twin:
            return FossenTwin(exported(vehicle, Path(name)), attitudeEuler, options.version, vehicle)

        return laboratory.run("fossen", Fossen(), twin, "python release/simulators/fossen.py --source FOLDER")


if __name__ == "__main__":
    sys.exit(main())
