"""Exports in Stonefish's own code, beside what they say they keep: `python release/simulators/stonefish.py --source FOLDER`.

FOLDER is a checkout of Stonefish 1.6 or later (https://github.com/patrykcieslak/stonefish). Its own CMake builds the library in a folder
beside it, or in --build; the driver beside this file loads the exported scenario with Stonefish's parser, and steps Stonefish's world
without graphics. Needs cmake, a C++ compiler, and the headers of GLM, SDL2, FreeType and OpenGL (Debian: libglm-dev libsdl2-dev
libfreetype6-dev libgl-dev).
"""

import argparse
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

sys.path.insert(0, str(Path(__file__).parent))
import laboratory
from laboratory import SAMPLE, History, State

from seatrial.export.manoeuvre import Controls
from seatrial.export.rigid_body import drive_name, drives_of
from seatrial.export.targets.stonefish import Stonefish, solid_of
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance
from seatrial.export.write import state

RATE = 500.0
"""Steps of Stonefish's world a second."""
Current = tuple[float, float, float]
STILL: Current = (0.0, 0.0, 0.0)
_DRIVER = Path(__file__).parent / "stonefish_driver"


@dataclass(frozen=True)
class StonefishTwin:
    """One exported vehicle in Stonefish; see `laboratory.Twin`.

    Attributes:
        version: of the library, with the commit where the source is a checkout.
        driver: the built driver.
        folder: of the exported files.
        actuators: name in the scenario by our control.
        current: of the water, m/s north, east and down.
    """

    version: str
    driver: Path
    folder: Path
    actuators: dict[str, str]
    current: Current = STILL
    target: str = "Stonefish"

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `laboratory.Twin`."""
        rows = self._output(start, controls, round(duration / SAMPLE) + 1)["state"]
        return np.array(rows, float)

    def added_mass(self) -> Float[np.ndarray, " 4"]:
        """Added mass, kg, and added moments of inertia, kg m^2, that the library gives the vehicle."""
        return np.array(self._output(np.zeros(8), lambda t: {}, 1)["mass"][0], float)

    def _output(self, start: State, controls: Controls, samples: int) -> dict[str, list[list[str]]]:
        """Numbers that the driver prints, by the first word of their line."""
        every = round(SAMPLE * RATE)
        steps = [controls(k / RATE) for k in range((samples - 1) * every)]
        lines = [f"{1 / RATE!r} {samples} {every}", " ".join(repr(float(part)) for part in start)]
        lines.append(" ".join(repr(float(part)) for part in self.current))
        lines.append(" ".join([str(len(self.actuators)), *self.actuators.values()]))
        lines += [" ".join(repr(float(wanted[name])) for name in self.actuators) for wanted in steps]
        plan = self.folder / "plan.txt"
        plan.write_text("\n".join(lines) + "\n", encoding="utf-8")
        done = subprocess.run([self.driver, self.folder, plan], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{self.driver} {self.folder} {plan}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
        found: dict[str, list[list[str]]] = {"state": [], "mass": []}
        for line in done.stdout.splitlines():
            word, *numbers = line.split() or [""]
            if word in found:
                found[word].append(numbers)
        return found


def main() -> int:
    """Build the library and the driver, compare all vehicles, and return 1 where one of them differs from its statement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", type=Path, required=True, help="checkout of patrykcieslak/stonefish")
    parser.add_argument("--build", type=Path, help="folder in which it is built; FOLDER-build if not given")
    parser.add_argument("--jobs", type=int, default=2, help="processes that compile")
    given = parser.parse_args()
    source = given.source.resolve()
    build = (given.build or source.with_name(source.name + "-build")).resolve()
    driver, version = build_driver(source, build, given.jobs), version_of(source, build)
    with tempfile.TemporaryDirectory() as folder:

        def twin(vehicle: ExportedVehicle, current: Current = STILL) -> StonefishTwin:
            return replace(twin_of(vehicle, driver, version, Path(folder)), current=current)

        command = "python release/simulators/stonefish.py --source FOLDER"
        failures = laboratory.run("stonefish", Stonefish(), twin, command, in_current=twin)
    print(f"{failures} rows differ from what the export states, or have the wrong sign")
    return int(failures > 0)


def build_driver(source: Path, build: Path, jobs: int) -> Path:
    """Build the library with its own CMake, and the driver beside it."""
    subprocess.run(["cmake", "-S", source, "-B", build, "-DCMAKE_BUILD_TYPE=Release"], check=True)
    subprocess.run(["cmake", "--build", build, "--parallel", str(jobs)], check=True)
    folder = build / "seatrial-driver"
    options = [f"-DSOURCE={source}", f"-DBUILD={build}", "-DCMAKE_BUILD_TYPE=Release"]
    subprocess.run(["cmake", "-S", _DRIVER, "-B", folder, *options], check=True)
    subprocess.run(["cmake", "--build", folder], check=True)
    return folder / "driver"


def version_of(source: Path, build: Path) -> str:
    """Version of the library that was built, and the commit of its checkout."""
    written = re.search(r'STONEFISH_VER\s+"([^"]+)"', (build / "version.h").read_text(encoding="utf-8"))
    commit = subprocess.run(
        ["git", "-C", source, "rev-parse", "--short=7", "HEAD"], capture_output=True, text=True, check=False
    )
    known = (source / ".git").exists() and commit.returncode == 0
    return (written[1] if written else "of unknown version") + (f" {commit.stdout.strip()}" if known else "")


def twin_of(vehicle: ExportedVehicle, driver: Path, version: str, folder: Path) -> StonefishTwin:
    """Return the twin of a vehicle, from the files of its export; prints the library's added mass beside the one that is stated."""
    exporter = Stonefish()
    place = folder / f"{len(list(folder.iterdir()))}"
    place.mkdir()
    statement = state(exporter, vehicle, ExportProvenance(vehicle.name, vehicle.name))
    for name, text in exporter.write(vehicle, statement).items():
        (place / name).write_text(text, encoding="utf-8")
    names = {drive.control: drive_name(drive) for drive in drives_of(vehicle)[0]}
    names |= {name: name for name in vehicle.controls if name.startswith("delta")}
    twin = StonefishTwin(version, driver, place, {name: names[name] for name in vehicle.controls if name in names})
    solid = solid_of(vehicle, exporter.density)
    for what, found, stated in zip(
        ("kg", "kg m^2 in roll", "in pitch", "in yaw"), twin.added_mass(), (solid.added, *solid.turned), strict=True
    ):
        print(f"{vehicle.name}: added {found:.6g}, stated {stated:.6g} {what}", flush=True)
    return twin


if __name__ == "__main__":
    sys.exit(main())
