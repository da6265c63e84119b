"""The standard manoeuvre in which a vehicle and what a target keeps of it are compared: ahead, a doublet, a turn and a dive.

    0 to 2 s steady ahead, 2 to 6 and 6 to 10 s 20 % above and below, 12 to 18 s rudder, 22 to 28 s stern plane, to 40 s

The vehicle of an open frame does the same with its forces: surge, yaw and heave.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from seatrial.core.signals import RATES, signal_unit
from seatrial.export.motion import Motion
from seatrial.export.target import Change
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.thrusters import allocation

DURATION, STEP = 40.0, 0.05
SPEED = 1.5
"""Speed ahead, m/s, where the vehicle has no trim speed of its own."""
_DOUBLET, _RUDDER, _PLANE = 0.2, np.radians(4.0), np.radians(2.0)
_PUSH, _TURN, _DIVE = 10.0, 2.0, 5.0
"""Forces of an open frame, N and N m."""
_ABSURD = 1e3
_SMALL = 1e-5
"""Step of a difference quotient, SI."""


class Plan(NamedTuple):
    """Where the manoeuvre starts, the controls at each time, and both in words."""

    speed: float
    controls: Callable[[float], dict[str, float]]
    words: str


def plan_for(vehicle: ExportedVehicle, motion: Motion) -> Plan:
    """The standard manoeuvre of a vehicle, with those controls that it has."""
    names = vehicle.model().controls
    if vehicle.thrusters and names[-1].startswith("f_"):
        return _frame_plan(vehicle, names)
    speed = vehicle.hull.trim.get("u", SPEED) if "u" in vehicle.moves else 0.0
    ahead = next((name for name in ("n", "tau_X", "n_1") if name in names), None)
    drives = [name for name in names if name == ahead or (ahead == "n_1" and name.startswith("n_"))]
    steady, speed = _steady(motion, names, drives, speed)
    parts = [f"{speed:.2f} m/s ahead"]
    parts += [f"a doublet of 20 % in {' '.join(drives)}"] if drives else []
    steps = [("delta_r", _RUDDER, 12.0, "rudder"), ("delta_s", _PLANE, 22.0, "stern plane")]
    steps = [step for step in steps if step[0] in names]
    parts += [f"a {what} step of {np.degrees(size):.0f} deg for 6 s" for _, size, _, what in steps]

    def controls(t: float) -> dict[str, float]:
        share = _doublet(t)
        found = {name: steady * (1.0 + _DOUBLET * share) if name in drives else 0.0 for name in names}
        for name, size, at, _ in steps:
            found[name] = size if at <= t < at + 6.0 else 0.0
        return found

    return Plan(speed, controls, ", ".join(parts))


def run_manoeuvre(vehicle: ExportedVehicle, motion: Motion, plan: Plan) -> Float[np.ndarray, "n 6"]:
    """Velocities of a motion through the manoeuvre, by RK4; NaN from where it runs away."""
    count = round(DURATION / STEP)
    state = np.zeros(8)
    state[0] = plan.speed
    found = np.full((count + 1, 6), np.nan)
    found[0] = state[:6]

    def rate(x: np.ndarray, controls: dict[str, float]) -> np.ndarray:
        return _rates(motion, x, controls)

    with np.errstate(all="ignore"):
        for i in range(count):
            held = plan.controls(i * STEP)
            k1 = rate(state, held)
            k2 = rate(state + 0.5 * STEP * k1, held)
            k3 = rate(state + 0.5 * STEP * k2, held)
            k4 = rate(state + STEP * k3, held)
            state = state + STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            if not np.abs(state).max() < _ABSURD:
                break
            found[i + 1] = state[:6]
    return found


def growth_rate(motion: Motion, plan: Plan) -> float:
    """Largest real part of the eigenvalues of small motions about straight ahead under the controls of the start, 1/s."""
    start = np.zeros(8)
    start[0] = plan.speed
    held = plan.controls(0.0)
    columns = [_rates(motion, start + h, held) - _rates(motion, start - h, held) for h in _SMALL * np.eye(8)]
    return float(np.linalg.eigvals(np.array(columns).T / (2 * _SMALL)).real.max())


def changes(
    vehicle: ExportedVehicle, own: Float[np.ndarray, "n 6"], other: Float[np.ndarray, "n 6"]
) -> tuple[Change, ...]:
    """Largest difference of each velocity, infinite where the other runs away, and the range of the vehicle's own."""
    found = []
    for i, rate in enumerate(RATES):
        if rate in vehicle.moves or np.nanmax(np.abs(other[:, i])) > 0:
            gone = np.isnan(other[:, i]) & ~np.isnan(own[:, i])
            largest = np.inf if gone.any() else float(np.nanmax(np.abs(own[:, i] - other[:, i])))
            found.append(Change(rate, signal_unit(rate), largest, float(np.nanmax(own[:, i]) - np.nanmin(own[:, i]))))
    return tuple(found)


def _rates(motion: Motion, x: Float[np.ndarray, " 8"], controls: dict[str, float]) -> Float[np.ndarray, " 8"]:
    """Rates of the velocities, roll and pitch."""
    phi, theta = float(x[6]), float(x[7])
    p, q, r = (float(part) for part in x[3:6])
    turn = q * np.sin(phi) + r * np.cos(phi)
    angles = (p + np.tan(theta) * turn, q * np.cos(phi) - r * np.sin(phi))
    return np.concatenate([motion(x[:6], phi, theta, controls), angles])


def _doublet(t: float) -> float:
    return 1.0 if 2.0 <= t < 6.0 else -1.0 if 6.0 <= t < 10.0 else 0.0


def _steady(motion: Motion, names: tuple[str, ...], drives: list[str], speed: float) -> tuple[float, float]:
    """Drive that holds a speed straight ahead; without a drive, or with none that holds it, the speed that is held."""

    def surge(u: float, drive: float) -> float:
        controls = {name: drive if name in drives else 0.0 for name in names}
        return float(motion(np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.0, 0.0, controls)[0])

    if drives and surge(speed, 0.0) < 0:
        top = next((top for top in 10.0 ** np.arange(0.0, 7.0) if surge(speed, top) > 0), None)
        if top is not None:
            return float(brentq(lambda drive: surge(speed, drive), 0.0, top)), speed
    speeds = np.linspace(0.05, 10.0, 200)
    held = [i for i in range(199) if surge(speeds[i], 0.0) > 0 >= surge(speeds[i + 1], 0.0)]
    return 0.0, float(brentq(lambda u: surge(u, 0.0), speeds[held[0]], speeds[held[0] + 1])) if held else speed


def _frame_plan(vehicle: ExportedVehicle, names: tuple[str, ...]) -> Plan:
    inverse = np.linalg.pinv(allocation(vehicle.thrusters))

    def controls(t: float) -> dict[str, float]:
        wanted = np.zeros(6)
        wanted[0] = _PUSH * _doublet(t)
        wanted[5] = _TURN if 12.0 <= t < 18.0 else 0.0
        wanted[2] = _DIVE if 22.0 <= t < 28.0 else 0.0
        forces = inverse @ wanted
        return {name: float(forces[int(name[2:]) - 1]) if name.startswith("f_") else 0.0 for name in names}

    return Plan(
        0.0,
        controls,
        f"from rest a doublet of {_PUSH:g} N in surge, a yaw moment of {_TURN:g} N m and a heave force of {_DIVE:g} N for 6 s each",
    )
