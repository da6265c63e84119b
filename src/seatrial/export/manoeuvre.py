"""The standard manoeuvre in which a vehicle and what a target keeps of it are compared: ahead, a doublet, a turn and a dive.

    0 to 2 s steady ahead, 2 to 6 and 6 to 10 s 20 % above and below, 12 to 18 s rudder, 22 to 28 s stern plane, to 40 s

The vehicle of an open frame does the same with its forces: surge, yaw and heave.

What a positive command means in a target is found by pushing it: a target's convention for fins need not be the vehicle's.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from seatrial.core.signals import RATES, signal_unit
from seatrial.export.motion import CURRENT_IN_BODY, Motion, motion_of
from seatrial.export.target import Carried, MotionChange
from seatrial.export.vehicle import ExportedVehicle
from seatrial.numerics.integrate import rk4_unrolled
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.control_signs import DURATION as PUSH_DURATION
from seatrial.vehicles.control_signs import STEP as PUSH_STEP
from seatrial.vehicles.control_signs import Sense, push_of, sense_of, sense_words
from seatrial.vehicles.thrusters import allocation

Controls = Callable[[float], Mapping[str, float]]  # Commands by time, SI
Current = tuple[float, float, float]
STILL: Current = (0.0, 0.0, 0.0)
DURATION, STEP = 40.0, 0.05
DEFAULT_SPEED = 1.5  # Speed ahead, m/s, where the vehicle has no trim speed of its own
_DOUBLET, _RUDDER, _PLANE = 0.2, np.radians(4.0), np.radians(2.0)
# What a positive rudder and a positive stern plane do by the usual convention: turn to starboard, put the nose down.
USUAL_FINS = {"delta_r": {"r": 1}, "delta_s": {"q": -1}}
_PUSH, _TURN, _DIVE = 10.0, 2.0, 5.0  # Forces of an open frame, N and N m
_ABSURD = 1e3
_DIFFERENCE_STEP = 1e-5  # Step of a difference quotient, SI


class ManoeuvrePlan(NamedTuple):
    """Where the manoeuvre starts, the controls at each time, and both in words."""

    speed: float
    controls: Controls
    words: str


def plan_for(vehicle: ExportedVehicle, motion: Motion) -> ManoeuvrePlan:
    """Return the standard manoeuvre of a vehicle, with those controls that it has."""
    names = vehicle.controls
    if vehicle.thrusters and names[-1].startswith("f_"):
        return _frame_plan(vehicle, names)
    speed = vehicle.hull.trim.get("u", DEFAULT_SPEED) if "u" in (*vehicle.moves, *vehicle.given) else 0.0
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
        results = {name: steady * (1.0 + _DOUBLET * share) if name in drives else 0.0 for name in names}
        for name, size, at, _ in steps:
            results[name] = size if at <= t < at + 6.0 else 0.0
        return results

    return ManoeuvrePlan(speed, controls, ", ".join(parts))


def run_manoeuvre(
    motion: Motion, actuators: Mapping[str, Actuator], plan: ManoeuvrePlan, current: Current = STILL
) -> Float[np.ndarray, "n 6"]:
    """Return the velocities through the water of a motion through the manoeuvre, begun to the north; NaN from where it runs away.

    Args:
        motion: accelerations of the target or of the vehicle.
        actuators: lags and limits by control.
        plan: commands over n samples, and the start.
        current: the water's velocity, m/s.
    """
    start = np.zeros(8)
    start[0] = plan.speed
    return simulate(motion, actuators, plan.controls, start, DURATION, STEP, current)[:, :6]


def simulate(
    motion: Motion,
    actuators: Mapping[str, Actuator],
    controls: Controls,
    start: Float[np.ndarray, " 8"],
    duration: float,
    step: float,
    current: Current = STILL,
) -> Float[np.ndarray, "n 8"]:
    """Return the velocities through the water, roll and pitch at each step, by RK4; NaN from where the motion runs away.

    Actuators begin at rest in the first commands; controls without one act at once. Commands are held over a step.

    Args:
        motion: which finds the current in body axes among its controls.
        actuators: by control.
        controls: commands by time.
        start: velocities, roll and pitch; the heading is north.
        duration: s.
        step: s.
        current: of the water, m/s north, east and down.
    """
    count = round(duration / step)
    lagging = [name for name, actuator in actuators.items() if actuator.time_constant > 0]
    first = _within(controls(0.0), actuators)
    state = np.concatenate([start, [0.0], [first[name] for name in lagging]])
    result = np.full((count + 1, 8), np.nan)
    result[0] = start

    def rate(x: np.ndarray, wanted: dict[str, float]) -> np.ndarray:
        actual = dict(zip(lagging, x[9:], strict=True))
        speeds = [_follow(actuators[name], wanted[name], actual[name]) for name in lagging]
        water = _in_body(current, x[6:9]) if any(current) else {}
        return np.concatenate([_rates(motion, x, {**wanted, **actual, **water}), speeds])

    with np.errstate(all="ignore"):
        for i in range(count):
            held = _within(controls(i * step), actuators)
            (state,) = rk4_unrolled(lambda at, held=held: (rate(at[0], held),), (state,), step)
            if not np.abs(state[:8]).max() < _ABSURD:
                break
            result[i + 1] = state[:8]
    return result


def growth_rate(motion: Motion, plan: ManoeuvrePlan) -> float:
    """Return the largest real part of the eigenvalues of small motions about straight ahead under the controls of the start, 1/s."""
    start = np.zeros(9)
    start[0] = plan.speed
    held = dict(plan.controls(0.0))
    columns = [
        _rates(motion, start + h, held)[:8] - _rates(motion, start - h, held)[:8]
        for h in _DIFFERENCE_STEP * np.eye(9)[:8]
    ]
    return float(np.linalg.eigvals(np.array(columns).T / (2 * _DIFFERENCE_STEP)).real.max())


def changes(
    vehicle: ExportedVehicle, own: Float[np.ndarray, "n 6"], other: Float[np.ndarray, "n 6"]
) -> tuple[MotionChange, ...]:
    """Return the largest difference of each velocity, infinite if the other runs away, and the range of the vehicle's own.

    Args:
        vehicle: whose velocities these are.
        own: its own, m/s and rad/s, n samples.
        other: what the target makes of them.
    """
    results = []
    for i, rate in enumerate(RATES):
        if rate in vehicle.moves or np.nanmax(np.abs(other[:, i])) > 0:
            gone = np.isnan(other[:, i]) & ~np.isnan(own[:, i])
            largest = np.inf if gone.any() else float(np.nanmax(np.abs(own[:, i] - other[:, i])))
            results.append(
                MotionChange(rate, signal_unit(rate), largest, float(np.nanmax(own[:, i]) - np.nanmin(own[:, i])))
            )
    return tuple(results)


def motion_senses(
    vehicle: ExportedVehicle, motion: Motion, plan: ManoeuvrePlan, controls: Iterable[str] | None = None
) -> dict[str, Sense]:
    """Return the sense of each control in a motion, from the start of a plan; empty if it moves nothing.

    Args:
        vehicle: whose controls they are.
        motion: its own, or a target's.
        plan: manoeuvre, whose start is taken.
        controls: those that are asked for; all if None.
    """
    held = plan.controls(0.0)
    start = np.zeros(8)
    start[0] = plan.speed

    def end(control: str, push: float) -> np.ndarray:
        pushed = {**held, control: held[control] + push}
        return simulate(motion, {}, lambda t: pushed, start, PUSH_DURATION, PUSH_STEP)[-1]

    results = {}
    for control in vehicle.controls if controls is None else controls:
        push = push_of(control)
        answer = end(control, push) - end(control, -push)
        results[control] = sense_of(control, dict(zip(RATES, answer.tolist(), strict=False)))
    return results


def contrary_to(vehicle: ExportedVehicle, convention: Mapping[str, Sense]) -> tuple[str, ...]:
    """Return the controls whose positive values do the contrary of what a target's convention has them do."""
    asked = [control for control in convention if control in vehicle.controls]
    if not asked:
        return ()
    own = motion_of(vehicle)
    senses = motion_senses(vehicle, own, plan_for(vehicle, own), asked)
    return tuple(
        control
        for control, sense in senses.items()
        if any(sense.get(rate) == -sign for rate, sign in convention[control].items())
    )


def command_line(vehicle: ExportedVehicle, carried: Carried, plan: ManoeuvrePlan) -> str:
    """Return what positive commands do in the target, in words; nothing for a vehicle without controls.

    Args:
        vehicle: with its controls.
        carried: what the target carries of it.
        plan: by which the signs are found.
    """
    parts = []
    for control, sense in motion_senses(vehicle, carried.motion, plan).items():
        turned = control in carried.reversed
        words = sense_words({rate: -sign if turned else sign for rate, sign in sense.items()})
        parts.append(f"{control} {words}" + (f" (minus seatrial's {control})" if turned else ""))
    return "; ".join(parts)


def _rates(motion: Motion, x: Float[np.ndarray, " n"], controls: dict[str, float]) -> Float[np.ndarray, " 9"]:
    """Return the rates of the velocities, roll, pitch and heading, with which a state begins."""
    phi, theta = float(x[6]), float(x[7])
    p, q, r = (float(part) for part in x[3:6])
    turn = q * np.sin(phi) + r * np.cos(phi)
    angles = (p + np.tan(theta) * turn, q * np.cos(phi) - r * np.sin(phi), turn / np.cos(theta))
    return np.concatenate([motion(x[:6], phi, theta, controls), angles])


def _in_body(current: Current, angles: Float[np.ndarray, " 3"]) -> dict[str, float]:
    """Return the current in body axes, by name."""
    result = Rotation.from_euler("ZYX", angles[::-1]).inv().apply(np.array(current))
    return dict(zip(CURRENT_IN_BODY, map(float, result), strict=True))


def _within(wanted: Mapping[str, float], actuators: Mapping[str, Actuator]) -> dict[str, float]:
    """Return the commands within the limits of their actuators."""
    return {
        name: min(max(value, actuators[name].lower), actuators[name].upper) if name in actuators else value
        for name, value in wanted.items()
    }


def _follow(actuator: Actuator, wanted: float, actual: float) -> float:
    """Return the speed at which an actuator follows its command."""
    return min(max((wanted - actual) / actuator.time_constant, -actuator.rate), actuator.rate)


def _doublet(t: float) -> float:
    return 1.0 if 2.0 <= t < 6.0 else -1.0 if 6.0 <= t < 10.0 else 0.0


def _steady(motion: Motion, names: tuple[str, ...], drives: list[str], speed: float) -> tuple[float, float]:
    """Return the drive that holds a speed straight ahead; without a drive, or with none that holds it, the speed that is held."""

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


def _frame_plan(vehicle: ExportedVehicle, names: tuple[str, ...]) -> ManoeuvrePlan:
    inverse = np.linalg.pinv(allocation(vehicle.thrusters))

    def controls(t: float) -> dict[str, float]:
        wanted = np.zeros(6)
        wanted[0] = _PUSH * _doublet(t)
        wanted[5] = _TURN if 12.0 <= t < 18.0 else 0.0
        wanted[2] = _DIVE if 22.0 <= t < 28.0 else 0.0
        forces = inverse @ wanted
        return {name: float(forces[int(name[2:]) - 1]) if name.startswith("f_") else 0.0 for name in names}

    return ManoeuvrePlan(
        0.0,
        controls,
        f"from rest a doublet of {_PUSH:g} N in surge, a yaw moment of {_TURN:g} N m and a heave force of {_DIVE:g} N for 6 s each",
    )
