"""CasADi, FMPy and MuJoCo run exported vehicles: `python release/simulators/programs.py --write`.

Each vehicle does its standard manoeuvre in the exported file, with steps of 20 ms, and beside it in our simulation with the same steps.
All three are installed with the extra `export` and fmpy. With `--write`, the largest differences go to docs/dev/export_programs.json and
docs/dev/exports.md; `--only NAME` prints those of one target.
"""

import argparse
import importlib.metadata
import importlib.util
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from laboratory import CHANNELS, History, study_numbers

from seatrial.core.signals import RATES, signal_unit
from seatrial.export.manoeuvre import ManoeuvrePlan, plan_for, simulate
from seatrial.export.motion import motion_of
from seatrial.export.target import Exporter
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance
from seatrial.export.write import export_vehicle, make_exporter, of_catalogue

VEHICLES = ("bluerov2_heavy", "mariner", "remus100_surge")
DURATION, STEP = 40.0, 0.02
COMMAND = "python release/simulators/programs.py --write"
PROGRAMS = {"casadi": "casadi", "fmu": "fmpy", "mjcf": "mujoco"}  # Program that runs each target

Run = Callable[[Path, ExportedVehicle, ManoeuvrePlan], History]


def module_at(path: Path) -> Any:
    """An exported module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def by_casadi(folder: Path, vehicle: ExportedVehicle, plan: ManoeuvrePlan) -> History:
    """Steps of its function F."""
    (path,) = folder.glob("*.py")
    module = module_at(path)
    controls = [[plan.controls(t)[name] for name in module.CONTROLS] for t in times()[:-1]]
    first = module.limited(controls[0])
    state = [plan.speed, *[0.0] * 11, *(first[i] for i in module.LAGGING)]
    steps = module.F.mapaccum(len(controls))
    found = np.array(steps(state, np.array(controls).T, module.P, [0.0] * 3, STEP)).T
    return np.vstack([state, found])[:, [0, 1, 2, 3, 4, 5, 9, 10]]


def by_fmpy(folder: Path, vehicle: ExportedVehicle, plan: ManoeuvrePlan) -> History:
    """A simulation by FMPy, with inner steps as long as the outer ones."""
    import fmpy  # pyright: ignore[reportMissingImports]

    (path,) = folder.glob("*.fmu")
    order = vehicle.controls
    # FMPy interpolates between rows: each stands at its step, with the command that is held from there.
    rows = [(STEP * i, *(plan.controls(t)[name] for name in order)) for i, t in enumerate(times())]
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=DURATION,
        step_size=STEP,
        output_interval=STEP,
        start_values={"u_0": plan.speed, "step": STEP},
        input=np.array(rows, [("time", float), *((name, float) for name in order)]),
        output=CHANNELS,
    )
    return np.array([found[name] for name in CHANNELS]).T


def by_mujoco(folder: Path, vehicle: ExportedVehicle, plan: ManoeuvrePlan) -> History:
    """Steps of MuJoCo's Runge-Kutta integrator."""
    import mujoco as bindings  # pyright: ignore[reportMissingImports]

    mujoco: Any = bindings  # which have no types
    (path,) = folder.glob("*.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    module, data = module_at(path.with_suffix(".py")), mujoco.MjData(model)
    model.opt.timestep, found = STEP, []
    module.install()
    data.qvel[0] = plan.speed
    for i, t in enumerate(times()):
        data.ctrl[:] = [plan.controls(t)[name] for name in module.CONTROLS]
        if i == 0:
            module.begin(model, data)
            mujoco.mj_forward(model, data)
        turn = (module.FLIP[:, None] * module.turn_of(model, data)) * module.FLIP
        angles = np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0])
        found.append([*module.nu_of(model, data), *angles])
        mujoco.mj_step(model, data)
    mujoco.set_mjcb_passive(None)
    mujoco.set_mjcb_act_dyn(None)
    return np.array(found)


RUNS: Mapping[str, Run] = {"casadi": by_casadi, "fmu": by_fmpy, "mjcf": by_mujoco}


def times() -> np.ndarray:
    """Starts of the steps, and the end, s; a hair late, so that a change at a step is in it."""
    return STEP * np.arange(round(DURATION / STEP) + 1) + 1e-9


def compared(target: str, label: str) -> dict[str, Any]:
    """Largest difference and range of each channel that moves."""
    exporter: Exporter = make_exporter(target)
    vehicle, provenance = of_catalogue(label)
    assert isinstance(provenance, ExportProvenance)
    with tempfile.TemporaryDirectory() as name:
        export_vehicle(exporter, vehicle, provenance, Path(name))
        plan = plan_for(vehicle, motion_of(vehicle))
        theirs = RUNS[target](Path(name), vehicle, plan)
    start = np.array([plan.speed, *[0.0] * 7])
    controls = lambda t: plan.controls(t + 1e-9)  # noqa: E731
    ours = simulate(motion_of(vehicle), vehicle.actuators, controls, start, DURATION, STEP)
    moving = [i for i in range(len(CHANNELS)) if np.ptp(ours[:, i]) > 0]
    return {
        "target": target,
        "program": f"{PROGRAMS[target]} {importlib.metadata.version(PROGRAMS[target])}",
        "vehicle": label,
        "largest": {
            CHANNELS[i]: [float(f"{np.abs(theirs - ours)[:, i].max():.2g}"), float(f"{np.ptp(ours[:, i]):.2g}")]
            for i in moving
        },
    }


def tables(numbers: Mapping[str, Any]) -> str:
    """The table of docs/dev/exports.md: of each vehicle the velocity that differs most by its range."""
    lines = ["| target | run by | vehicle | largest difference in 40 s |", "| --- | --- | --- | --- |"]
    for row in numbers["rows"]:
        name, (gap, reach) = max(
            ((key, pair) for key, pair in row["largest"].items() if key in RATES), key=lambda one: one[1][0] / one[1][1]
        )
        worst = f"{name} {gap:.1e} of {reach:.2g} {signal_unit(name)}"
        lines.append(f"| `{row['target']}` | {row['program']} | {row['vehicle']} | {worst} |")
    return "\n".join([*lines, ""])


def main() -> None:
    """Run every vehicle in every program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", choices=tuple(RUNS), help="one target")
    parser.add_argument("--write", action="store_true", help="keep the numbers and write the table")
    options = parser.parse_args()
    study_numbers.commit()
    rows = []
    for target in [options.only] if options.only else RUNS:
        for label in VEHICLES:
            rows.append(compared(target, label))
            print(rows[-1], flush=True)
    if options.write:
        study_numbers.keep("export_programs", {"rows": rows})
        study_numbers.show("exports", tables({"rows": rows}), COMMAND)


if __name__ == "__main__":
    main()
