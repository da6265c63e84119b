"""HoloOcean's own dynamics run exported agents: `python release/simulators/holoocean.py --source FOLDER`.

FOLDER holds a checkout of byu-holoocean/HoloOcean, whose `client/src/holoocean/fossen_dynamics` computes the accelerations that the engine
integrates; neither the engine nor the client's other modules are needed. The agent is read by its `configure_torpedo_from_scenario`;
steps are 2 ms, velocities first and angles with the new ones, as engines do.
"""

import argparse
import contextlib
import io
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import laboratory
import numpy as np
from laboratory import SAMPLE, History, State, Twin

from seatrial.export.manoeuvre import Controls
from seatrial.export.targets.holoocean import HoloOcean
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance
from seatrial.export.write import state

STEP = 0.002


class HoloOceanTwin:
    """A vehicle's agent; commands are turned as the export states it."""

    target = "HoloOcean"

    def __init__(self, torpedo: Any, version: str, vehicle: ExportedVehicle):
        exporter, provenance = HoloOcean(), ExportProvenance("laboratory", vehicle.name)
        self.version, self.torpedo = version, torpedo
        self.scenario = json.loads(exporter.write(vehicle, state(exporter, vehicle, provenance))["agent.json"])
        self.turned = exporter.carries(vehicle).reversed

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`; actuators start at rest in the first commands."""
        with contextlib.redirect_stdout(io.StringIO()):  # some versions print in every step
            return self._run(start, controls, duration)

    def _run(self, start: State, controls: Controls, duration: float) -> History:
        vehicle = self.torpedo.Torpedo()
        self.torpedo.configure_torpedo_from_scenario(self.scenario, "auv0", vehicle)
        for actuator, command in zip(vehicle.controls, self._commands(controls(0.0)), strict=True):
            actuator.u_actual = command
        nu, angles, found = np.array(start[:6]), np.array([start[6], start[7], 0.0]), [start]
        each = round(SAMPLE / STEP)
        for i in range(round(duration / STEP)):
            eta = np.concatenate([np.zeros(3), angles])
            rates, _ = vehicle.dynamics(eta, nu, None, self._commands(controls(i * STEP)), STEP)
            nu = nu + STEP * rates
            angles = angles + STEP * _angle_rates(angles, nu)
            if (i + 1) % each == 0:
                found.append(np.array([*nu, *angles[:2]]))
        return np.array(found)

    def _commands(self, ours: Any) -> np.ndarray:
        """Starboard, lower, port and upper fin, rad, and rpm, as the file tells it."""
        rudder, plane = (
            ours.get(name, 0.0) * (-1.0 if name in self.turned else 1.0) for name in ("delta_r", "delta_s")
        )
        return np.array([plane, -rudder, -plane, rudder, ours.get("n", 0.0) * 30 / np.pi])


def _angle_rates(angles: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """Rates of roll, pitch and heading."""
    phi, theta, _ = angles
    p, q, r = nu[3:]
    turn = q * np.sin(phi) + r * np.cos(phi)
    return np.array([p + turn * np.tan(theta), q * np.cos(phi) - r * np.sin(phi), turn / np.cos(theta)])


def torpedo_of(source: Path) -> Any:
    """The module of the torpedo, without what the packages above it import."""
    for name in ("holoocean", "holoocean.fossen_dynamics"):
        package = ModuleType(name)
        package.__path__ = [str(source / "client" / "src" / name.replace(".", "/"))]
        sys.modules[name] = package
    from holoocean.fossen_dynamics import torpedo  # pyright: ignore[reportMissingImports]

    return torpedo


def main() -> int:
    """Run every vehicle, store the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of byu-holoocean/HoloOcean")
    parser.add_argument("--version", default="2", help="release or commit of the checkout, for the table")
    options = parser.parse_args()
    torpedo = torpedo_of(options.source)

    def twin(vehicle: ExportedVehicle) -> Twin:
        return HoloOceanTwin(torpedo, options.version, vehicle)

    return laboratory.run("holoocean", HoloOcean(), twin, "python release/simulators/holoocean.py --source FOLDER")


if __name__ == "__main__":
    sys.exit(main())
