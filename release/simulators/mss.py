"""Fossen's Marine Systems Simulator, in Octave, beside our vehicles of the same source: `python release/simulators/mss.py --source FOLDER`.

FOLDER holds a checkout of cybergalactic/MSS; `octave-cli` is needed. No export goes there: compared are `mariner.m` with our Mariner, and
`remus100.m` with our REMUS of Fossen. Copies of the functions are run in which the differences that are known are substituted, line by
line: `MARINER` and `REMUS` below list all of them. REMUS runs as it stands as well, which shows what they amount to.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import laboratory
import numpy as np
from laboratory import CHANNELS, DURATION, SAMPLE, STEP, History, Results, Scenario, SignRow, State, Subject
from study_numbers import commit  # pyright: ignore[reportMissingImports]

from seatrial.export.manoeuvre import Controls
from seatrial.export.motion import motion_of
from seatrial.export.target import Carried
from seatrial.export.write import of_catalogue
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.control_signs import push_of, sense_of
from seatrial.vehicles.simulate import simulate

FOLDERS = ("CRAFT", "GNC", "HYDRO", "INS", "LIBRARY")
SPEED = 7.7175
MARINER = {"mariner.m": (("U = sqrt((U0 + x(1))^2 + x(2)^2);", "U = U0;"),)}
"""The moment's speed in place of the nominal one, by which the table was made without dimension."""
REMUS = {
    "remus100.m": (
        ("1.0096 * L_auv/2", "L_auv/2"),
        ("1.0096 * D_auv/2", "D_auv/2"),
        ("g_mu = gravity(mu);", "g_mu = 9.81;"),
        ("deg2rad(20)", "deg2rad(15)"),
        ("D(1,1) = D(1,1) * exp(-3 * U_g);", "D(1,1) = D(1,1) * exp(-3 * U_r); D(2,2) = D(2,2) * exp(-3 * U_r);"),
        (",nu_r,'cylinder')", ",nu_r)"),
    ),
    "coeffLiftDrag.m": (("e = 0.3;", "e = 0.7;"),),
    "spheroid.m": (("rho = 1025;", "rho = 1026;"),),
    "crossFlowDrag.m": (
        ("rho = 1025;", "rho = 1026;"),
        ("tau_crossflow = [0 Yh Zh 0 Mh Nh]'", "tau_crossflow = [0 Yh 0 0 0 Nh]'"),
    ),
    "Hoerner.m": (("0.493252 1.21082", "0.4933 1.2108"), ("0.558473 1.08356", "0.5585 1.0836")),
}
"""Size and density of the spheroid, gravity, fins' limit, the speeds by which damping fades, a cylinder's drag, Oswald's factor of induced
drag, cross-flow in heave and pitch, and digits of Hoerner's curve: all in which it differs from the Python Vehicle Simulator."""
LOOP = """
commands = dlmread('commands.txt'); x = dlmread('start.txt'); x = x(:); h = {step}; each = {each};
rate = {rate};
found = zeros(rows(commands) / each + 1, numel(x)); found(1, :) = x';
for i = 1:rows(commands)
  c = commands(i, :)';
  k1 = rate(x, c); k2 = rate(x + h / 2 * k1, c); k3 = rate(x + h / 2 * k2, c); k4 = rate(x + h * k3, c);
  x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  if mod(i, each) == 0, found(i / each + 1, :) = x'; end
end
dlmwrite('result.txt', found, 'precision', '%.17g', 'delimiter', ' ');
"""


@dataclass(frozen=True)
class Mss:
    """Functions of the simulator in a folder of their own, and the commit of the checkout."""

    folder: Path
    version: str
    target: str = "MSS (Octave)"

    def integrate(self, rate: str, start: list[float], commands: np.ndarray) -> np.ndarray:
        """States every SAMPLE s of a function of state and command, by RK4 with steps of STEP."""
        each = round(SAMPLE / STEP)
        np.savetxt(self.folder / "commands.txt", commands, fmt="%.17g")
        np.savetxt(self.folder / "start.txt", start, fmt="%.17g")
        paths = "".join(f"addpath(genpath('{self.folder / name}'));" for name in FOLDERS)
        (self.folder / "loop.m").write_text(paths + LOOP.format(step=STEP, each=each, rate=rate), encoding="utf-8")
        subprocess.run(["octave-cli", "--no-gui", "--quiet", "loop.m"], cwd=self.folder, check=True)
        return np.loadtxt(self.folder / "result.txt")


class MarinerTwin:
    """`mariner.m`; its command is minus our rudder, and its speed counts from the nominal one."""

    def __init__(self, mss: Mss):
        self.mss, self.target, self.version = mss, mss.target, mss.version

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`; the rudder starts at rest in the first command."""
        rudder = np.array([controls(i * STEP)["delta_r"] for i in range(round(duration / STEP))])
        state = [start[0] - SPEED, start[1], start[5], 0.0, 0.0, 0.0, rudder[0]]
        x = self.mss.integrate("@(x, c) mariner(x, c)", state, -rudder[:, None])
        found = np.zeros((len(x), len(CHANNELS)))
        found[:, [0, 1, 5]] = x[:, :3] + [SPEED, 0.0, 0.0]
        return found


class RemusTwin:
    """`remus100.m`; its commands are ours, the propeller's in rpm."""

    def __init__(self, mss: Mss):
        self.mss, self.target, self.version = mss, mss.target, mss.version

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        ours = [controls(i * STEP) for i in range(round(duration / STEP))]
        commands = np.array([[one["delta_r"], one["delta_s"], one["n"] * 30 / np.pi] for one in ours])
        state = [*start[:6], 0.0, 0.0, 10.0, start[6], start[7], 0.0]
        return self.mss.integrate("@(x, c) remus100(x, c)", state, commands)[:, [0, 1, 2, 3, 4, 5, 9, 10]]


class Ours:
    """Our REMUS of Fossen, whose actuators are left out: `remus100.m` has none."""

    def __init__(self) -> None:
        self.model = load_vehicle("remus100_fossen").build(attitude="euler")

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """See `Twin`."""
        count = round(duration / STEP) + 1
        ours = jnp.array([[controls(i * STEP)[name] for name in self.model.controls] for i in range(count)])
        named = dict(zip(CHANNELS, start, strict=True))
        initial = jnp.array([named[name] for name in self.model.states])
        found = np.asarray(simulate(self.model, {}, ours, jnp.full(count, STEP), initial))
        order = [self.model.states.index(name) for name in CHANNELS]
        return found[:: round(SAMPLE / STEP), order]


def scenarios() -> list[Scenario]:
    """Thrust step, turn, heave and roll release of the REMUS."""
    hold = {"n": 120.0, "delta_r": 0.0, "delta_s": 0.0}
    start, tilted = np.zeros(8), np.zeros(8)
    start[0] = tilted[0] = 1.9
    tilted[6] = np.radians(10.0)
    changes = {"thrust step": {"n": 144.0}, "turn": {"delta_r": 0.07}, "heave": {"delta_s": 0.035}}

    def pulse(change: dict[str, float]) -> Controls:
        return lambda t: {**hold, **change} if 5.0 <= t < 25.0 else hold

    found = [Scenario(name, start, pulse(change), f"{change}") for name, change in changes.items()]
    return [*found, Scenario("roll release", tilted, lambda t: hold, "released at 10 deg of roll")]


def add_remus(found: Results, twin: RemusTwin, label: str) -> None:
    """Run all scenarios and the sign test of the REMUS, add them to the results and print them."""
    ours = Ours()
    for scenario in scenarios():
        theirs, kept = (one.run(scenario.start, scenario.controls, DURATION) for one in (twin, ours))
        rows = laboratory.rows_of(twin.target, twin.version, label, scenario.name, (theirs, kept, kept), DURATION)
        found.rows += rows
        laboratory.print_rows(rows)
    signs = remus_signs(twin, ours, label)
    found.signs += signs
    laboratory.print_signs(signs)


def remus_signs(twin: RemusTwin, ours: Ours, label: str) -> list[SignRow]:
    """Push every control either way in both; the motions that it is for have one sign."""
    scenario, rows = scenarios()[0], []
    held = dict(scenario.controls(0.0))
    for control in held:

        def response(one: RemusTwin | Ours, control: str = control) -> dict[str, float]:
            ends = [
                one.run(scenario.start, lambda t, p=push: {**held, control: held[control] + p}, 1.0)[-1]
                for push in (push_of(control), -push_of(control))
            ]
            return dict(zip(CHANNELS[:6], (ends[0] - ends[1]).tolist(), strict=False))

        here, there = response(ours), response(twin)
        rows += [
            SignRow(twin.target, label, control, rate, here[rate], there[rate]) for rate in sense_of(control, here)
        ]
    return rows


def prepared(source: Path, folder: Path, substitutions: dict[str, tuple[tuple[str, str], ...]]) -> Path:
    """A copy of the simulator's functions with lines substituted; each has to be found."""
    for name in FOLDERS:
        shutil.copytree(
            source / name,
            folder / name,
            ignore=lambda _, names: {n for n in names if "." in n[1:] and not n.endswith(".m")},
        )
    for name, pairs in substitutions.items():
        (path,) = (path for part in FOLDERS for path in (folder / part).rglob(name))
        text = path.read_text(encoding="utf-8")
        for old, new in pairs:
            if old not in text:
                raise SystemExit(f"{path}: no line with {old}: another version than the one that was read")
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
    return folder


def main() -> int:
    """Run both vehicles, store the results; returns the number of failures but of the REMUS that runs as it stands."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--source", type=Path, required=True, help="checkout of cybergalactic/MSS")
    parser.add_argument("--version", default="736a3d1", help="commit of the checkout, for the table")
    options = parser.parse_args()
    found = Results("python release/simulators/mss.py --source FOLDER", commit())
    with tempfile.TemporaryDirectory() as name:

        def mss(label: str, substitutions: dict[str, tuple[tuple[str, str], ...]]) -> Mss:
            return Mss(prepared(options.source, Path(name) / label, substitutions), options.version)

        vehicle, _ = of_catalogue("mariner")
        subject = Subject("mariner", vehicle, Carried(motion_of(vehicle), actuators=vehicle.actuators))
        laboratory.add_vehicle(found, subject, MarinerTwin(mss("mariner", MARINER)))
        add_remus(found, RemusTwin(mss("remus", REMUS)), "remus100_fossen")
        failures = found.failures
        add_remus(found, RemusTwin(mss("as it stands", {})), "remus100_fossen, MSS's own variant")
    laboratory.store("mss", found)
    return failures


if __name__ == "__main__":
    sys.exit(main())
