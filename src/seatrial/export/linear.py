"""Small motions about steady motion ahead, for a controller's author: d(dx)/dt = A dx + B dc, dy = C dx, for the mean and each draw.

Derivatives are exact, by forward differentiation; a lag is d(act)/dt = (c - act) / T. Sway and yaw by the rudder are Nomoto's model

    r / delta = K (1 + T3 s) / ((1 + T1 s) (1 + T2 s)),    T = T1 + T2 - T3

K. Nomoto et al., On the steering qualities of ships, International Shipbuilding Progress 4 (1957).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import permutations
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import ACTUAL, RATES, signal_unit
from seatrial.export.ensemble import Ensemble
from seatrial.export.equations import lagging
from seatrial.export.manoeuvre import DEFAULT_SPEED
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.linearise import slopes_and_rates
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import allocation

# Subsystems: their velocities and angles, the output, the controls of a vehicle without thrusters, the first it has, and the axes of
# the coefficients that make its motion.
PARTS = {
    "surge": (("u",), "u", ("n", "tau_X"), "XT"),
    "yaw": (("v", "r"), "r", ("delta_r", "tau_N"), "YN"),
    "pitch": (("w", "q", "theta"), "theta", ("delta_s", "tau_M"), "ZM"),
    "roll": (("p", "phi"), "phi", ("tau_K",), "K"),
}
_AXIS = {"u": 0, "r": 5, "theta": 4, "phi": 3}  # Of the force of thrusters that moves an output
# Unknowns of a trim beside the controls, the fewest first.
_FREE = ((), ("phi", "theta"), ("phi", "theta", "v", "w"))
_STEPS, _SETTLED, _STEEPEST = 40, 1e-9, 1.0
_NO_TURNS = 1e-2  # rad/s, below which a propeller stands still: thrust by n|n| leaves what the search does not see
_FIRST_TURNS = 100.0  # rad/s, where the search for a propeller's speed starts: at 0 thrust has no slope
UNDETERMINED = 0.5  # Share of a pole above which its ± says that the data do not determine it
_ROUNDING = 1e-9  # Share of a complex number below which a part of it is rounding
_NO_ERROR = 1e-6  # Share of a pole below which no estimated coefficient moves it


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A vehicle about one trim, SI; row 0 of each array is the mean, the others are the draws. NaN if a draw has no trim.

    Attributes:
        speed: ahead, m/s.
        states: d names, those of the actuators last.
        inputs: c names.
        outputs: states that are no actuators.
        state: trim, shape (1 + n, d).
        control: trim, shape (1 + n, c).
        a: shape (1 + n, d, d).
        b: shape (1 + n, d, c).
        direct: b as if actuators had no lags.
        balance: surge acceleration that holds the speed although no control can, m/s^2; 0 if a control does.
    """

    speed: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state: Float[np.ndarray, "m d"]
    control: Float[np.ndarray, "m c"]
    a: Float[np.ndarray, "m d d"]
    b: Float[np.ndarray, "m d c"]
    direct: Float[np.ndarray, "m d c"]
    balance: float


class Part(NamedTuple):
    """A subsystem without the lags of the actuators, driven along one direction of the controls."""

    name: str
    states: tuple[str, ...]
    output: str
    input: str
    direction: Float[np.ndarray, " c"]
    a: Float[np.ndarray, "m s s"]
    b: Float[np.ndarray, "m s"]
    is_estimated: bool  # Whether a coefficient of its axes was; others move it only through the trim


class Known(NamedTuple):
    """A number of the mean vehicle, half the width of the central 68 % of the draws, its unit, and what the draws say of it.

    There is no ± without draws. The verdict is `published` for a number that follows from published values only, whose ± is 0, and
    `undetermined` where ± is above half of the number, or of a pole from which it follows.
    """

    name: str
    value: complex
    sd: float | None
    unit: str
    verdict: str


@lru_cache(maxsize=4)
def linearise(vehicle: ExportedVehicle, speeds: tuple[float, ...], ensemble: Ensemble | None) -> list[LinearModel]:
    """Return the linear models of a vehicle, one for each speed.

    Args:
        vehicle: with its actuators.
        speeds: ahead, m/s.
        ensemble: draws of its estimated coefficients; None for a vehicle without.

    Raises:
        InputError: a speed at which the vehicle has no steady motion.
    """
    law = _thrust_law(vehicle)
    free = [*(name for name in vehicle.coefficients if name in vehicle.estimated.names), *law]
    depth, heading = ("z",) if "w" in vehicle.moves else (), ("psi",) if "r" in vehicle.moves else ()
    model = vehicle.model(free, positions=depth, angles=heading)
    names = tuple(name.text for name in model.coefficients)
    mean = np.array([[vehicle.coefficients[name] for name in names]])
    values = (
        mean
        if ensemble is None
        else np.concatenate([mean, ensemble.values[:, [ensemble.names.index(n) for n in names]]])
    )
    params = dict(zip(names, values.T, strict=True))
    params |= {name: np.full(len(values), value) for name, value in law.items()}
    return [_at_speed(vehicle, model, params, len(values), speed) for speed in speeds]


def usual_speeds(vehicle: ExportedVehicle) -> tuple[float, ...]:
    """Return half, the whole and one and a half of the trim speed; rest too for an open frame, which hovers; only rest without surge."""
    if "u" not in (*vehicle.moves, *vehicle.given):
        return (0.0,)
    trim = vehicle.hull.trim.get("u") or (1.0 if vehicle.thrusters else DEFAULT_SPEED)
    return (0.0, 0.5 * trim, trim) if vehicle.thrusters else (0.5 * trim, trim, 1.5 * trim)


def parts_of(vehicle: ExportedVehicle, linear: LinearModel) -> list[Part]:
    """Return the subsystems that a vehicle has, each by its drive."""
    parts = []
    for name, (members, output, drives, axes) in PARTS.items():
        states = tuple(state for state in members if state in linear.outputs)
        if not states:
            continue
        at = [linear.states.index(state) for state in states]
        label, direction = _drive(vehicle, linear, output, drives) or ("", np.zeros(len(linear.inputs)))
        output = output if output in states else states[-1]
        through = linear.direct @ direction
        is_estimated = any(CoefficientName.parse(one).axis in axes for one in vehicle.estimated.names)
        slopes = linear.a[:, at][:, :, at], through[:, at]
        parts.append(Part(name, states, output, label, direction, *slopes, is_estimated))
    return parts


def poles_of(a: Float[np.ndarray, "m s s"]) -> Complex[np.ndarray, "m s"]:
    """Return the poles of each matrix, 1/s, in the order of those of the first, slow ones first."""
    good = np.isfinite(a).all((1, 2))
    values = np.full(a.shape[:2], np.nan, complex)
    values[good] = np.linalg.eigvals(a[good])
    first = values[0][np.lexsort((values[0].imag, np.abs(values[0])))]
    orders = np.array(list(permutations(range(a.shape[1]))))
    distance = np.abs(values[:, orders] - first).sum(-1)
    return np.take_along_axis(values, orders[np.argmin(np.nan_to_num(distance, nan=np.inf), 1)], 1)


def pole_names(a: Float[np.ndarray, "s s"], states: Sequence[str]) -> list[str]:
    """Return the state with the largest part in each pole, in the order of `poles_of`."""
    values, right = np.linalg.eig(a)
    order = np.lexsort((np.imag(values), np.abs(values)))
    try:
        part = np.abs(right * np.linalg.inv(right).T)
    except np.linalg.LinAlgError:  # two equal poles with one direction
        part = np.abs(right)
    return [states[int(np.argmax(part[:, i]))] for i in order]


def numbers_of(part: Part, ensemble_size: int) -> list[Known]:
    """Return poles, time constants and gain of a subsystem, and Nomoto's K and T of yaw by a rudder."""
    rows, modes, unit = [], [], f"{signal_unit(part.output)} per {input_unit(part.input)}"
    known = partial(_known, ensemble_size, part.is_estimated)
    names, poles = pole_names(part.a[0], part.states), poles_of(part.a)
    upper = [i for i, pole in enumerate(poles[0]) if pole.imag >= 0]  # of two conjugate poles one
    for i in upper:
        label = names[i] + (f" {i + 1}" if [names[j] for j in upper].count(names[i]) > 1 else "")
        modes.append(known(f"pole of {label}", poles[:, i], "1/s"))
        rows.append(modes[-1])
        size = poles[0, i].real
        if abs(size) > _ROUNDING * max(abs(poles[0, i]), 1e-6):
            time, sign = ("time constant", -1.0) if size < 0 else ("growth time", 1.0)
            rows.append(known(f"{time} of {label}", sign / np.real(poles[:, i]), "s", modes[-1]))
    with np.errstate(invalid="ignore"):  # of draws without a trim
        determinant = np.linalg.det(part.a)
    if not part.input or abs(determinant[0]) < _SETTLED ** len(part.states):
        return rows
    gain = gains_of(part)
    if part.input != "delta_r" or not gain[0]:
        return [*rows, known(f"gain {part.output} by {part.input}", gain, unit, *modes)]
    at = part.states.index("r")
    # numerator b_r s + K det of the transfer function, with one state b_r
    lead = part.b[:, at] / (gain * determinant) if len(part.states) == 2 else np.zeros(len(gain))
    total = -np.trace(part.a, axis1=1, axis2=2) / determinant if len(part.states) == 2 else -1.0 / part.a[:, 0, 0]
    return [*rows, known("Nomoto K", gain, unit, *modes), known("Nomoto T", total - lead, "s", *modes)]


def gains_of(part: Part) -> Float[np.ndarray, " m"]:
    """Return the steady output by a unit of the input, SI."""
    result = -np.linalg.solve(part.a, part.b[..., None])[:, part.states.index(part.output), 0]
    return np.where(np.abs(result) < _ROUNDING * np.abs(part.b).max(), 0.0, result)


def responses(linear: LinearModel, part: Part, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "m f"]:
    """Return the frequency response of the whole model, with its lags, from the input of a subsystem to its output.

    Args:
        linear: whole model.
        part: subsystem.
        frequency: rad/s, above 0.
    """
    good = np.isfinite(linear.a).all((1, 2))
    result = np.full((len(linear.a), frequency.size), np.nan, complex)
    driven = (linear.b @ part.direction)[good][:, :, None]
    for i, omega in enumerate(frequency):
        solved = np.linalg.solve(1j * omega * np.eye(len(linear.states)) - linear.a[good], driven)
        result[good, i] = solved[:, linear.states.index(part.output), 0]
    return result


def input_unit(name: str) -> str:
    """Return the SI unit of a drive; of thrusters together that of one."""
    unit = signal_unit(name.split(" ")[0]) if name else "1"
    return {"kg m/s^2": "N", "kg m^2/s^2": "N m"}.get(unit, unit)


def _thrust_law(vehicle: ExportedVehicle) -> dict[str, float]:
    """Return the estimated gains of thrusters. Within a dead zone no control acts, so the models hold beyond it."""
    return {name: value for name, value in vehicle.thrust_law.items() if not name.startswith("dead_")}


def _at_speed(
    vehicle: ExportedVehicle, model: VehicleModel, params: dict[str, np.ndarray], count: int, speed: float
) -> LinearModel:
    d, names = len(model.states), (*model.states, *model.controls)
    balanced = [model.states.index(name) for name in (*RATES, "z") if name in model.states]
    start = np.zeros((count, len(names)))
    for i, name in enumerate(names[d:], d):
        start[:, i] = _FIRST_TURNS if name.split("_")[0] == "n" else 0.0
    if "u" in names:  # a state, or given
        start[:, names.index("u")] = speed

    for equations in (balanced, balanced[1:] if model.states[0] == "u" else balanced):
        for more in _FREE:
            free = [i for i, name in enumerate(names) if (i >= d and name not in vehicle.given) or name in more]
            points, slopes, rates = _settle(model, params, start, equations, free)
            good = np.abs(rates[:, equations]).max(1, initial=0.0) < _SETTLED
            if good[0] and np.abs(points[0, :d] - start[0, :d]).max() < _STEEPEST:
                slopes[~good], points[~good] = np.nan, np.nan
                balance = -float(rates[0, 0]) if equations is not balanced else 0.0
                return _with_lags(vehicle, model, speed, points, slopes, balance)
    raise InputError(
        f'vehicle "{vehicle.name}", linear model at {speed:g} m/s',
        found="no steady motion ahead at this speed with its controls",
        expected="a speed that the vehicle can keep at level flight",
        remedy="name other speeds, for example those of the trials",
    )


def _settle(
    model: VehicleModel, params: dict, start: np.ndarray, equations: list[int], free: list[int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points at which rates vanish, by Newton steps of least length, with the slopes and rates there."""
    points = start.copy()
    for _ in range(_STEPS):
        slopes, rates = map(np.array, slopes_and_rates(model, params, points))
        if not free or np.abs(rates[:, equations]).max(initial=0.0) < 0.01 * _SETTLED:
            still = [i for i, name in enumerate(model.controls, len(model.states)) if name[0] == "n" and i in free]
            rest = points.copy()
            rest[:, still] = np.where(np.abs(rest[:, still]) < _NO_TURNS, 0.0, rest[:, still])
            if (rest != points).any():
                points = rest
                slopes, rates = map(np.array, slopes_and_rates(model, params, points))
            break
        step = np.linalg.pinv(np.nan_to_num(slopes[:, equations][:, :, free])) @ np.nan_to_num(
            rates[:, equations, None]
        )
        points[:, free] -= step[..., 0]
    return points, slopes, rates


def _with_lags(
    vehicle: ExportedVehicle,
    model: VehicleModel,
    speed: float,
    points: np.ndarray,
    slopes: np.ndarray,
    balance: float,
) -> LinearModel:
    """Return the linear model with a state for each actuator that has a lag."""
    d, late, inputs = len(model.states), lagging(vehicle), vehicle.controls
    control = points[:, [d + model.controls.index(name) for name in inputs]]
    direct = np.zeros((len(points), d + len(late), len(inputs)))
    direct[:, :d] = slopes[:, :, [d + model.controls.index(name) for name in inputs]]
    a, b = np.zeros((len(points), d + len(late), d + len(late))), direct.copy()
    a[:, :d, :d] = slopes[:, :, :d]
    for i, name in enumerate(late, d):
        place, rate = inputs.index(name), 1.0 / vehicle.actuators[name].time_constant
        a[:, :, i], b[:, :, place] = direct[:, :, place], 0.0
        a[:, i, i], b[:, i, place] = -rate, rate
    state = np.concatenate([points[:, :d], control[:, [inputs.index(name) for name in late]]], 1)
    states = (*model.states, *(name + ACTUAL for name in late))
    return LinearModel(speed, states, inputs, model.states, state, control, a, b, direct, balance)


def _drive(
    vehicle: ExportedVehicle, linear: LinearModel, output: str, drives: Sequence[str]
) -> tuple[str, Float[np.ndarray, " c"]] | None:
    """Return the name and direction of what drives an output: a control, or thrusters that push along or about one axis."""
    if vehicle.thrusters:
        kind = vehicle.acting_thrusters[0][2][0]
        together = np.linalg.pinv(allocation(vehicle.thrusters))[:, _AXIS[output]]
        if not np.abs(allocation(vehicle.thrusters) @ together)[_AXIS[output]] > 0.5:
            return None
        together = together if kind == "f" else together / np.abs(together).max()
        direction = np.zeros(len(linear.inputs))
        for place, _, control in vehicle.acting_thrusters:
            direction[linear.inputs.index(control)] = together[place - 1]
        axis = "XYZKMN"[_AXIS[output]]
        return (f"tau_{axis} of the thrusters" if kind == "f" else f"n of the thrusters along {axis}"), direction
    name = next((name for name in drives if name in linear.inputs), None)
    return None if name is None else (name, np.eye(len(linear.inputs))[linear.inputs.index(name)])


def _known(ensemble_size: int, is_estimated: bool, name: str, values: np.ndarray, unit: str, *modes: Known) -> Known:
    """Return a number with its ±, which is as undetermined as the modes from which the number follows."""
    finite = values[1:][np.isfinite(values[1:])]
    value, spread, verdict = complex(values[0]), None, ""
    if ensemble_size:
        low, high = np.quantile(np.real(finite), (0.16, 0.84)) if finite.size else (np.nan, np.nan)
        spread = float(high - low) / 2
        if not is_estimated or spread < _NO_ERROR * abs(value):
            spread, verdict = 0.0, "published"
        elif spread > UNDETERMINED * abs(value) or any(mode.verdict == "undetermined" for mode in modes):
            verdict = "undetermined"
    real, imag = (part if abs(part) > _ROUNDING * abs(value) else 0.0 for part in (value.real, value.imag))
    return Known(name, complex(real, imag), spread, unit, verdict)
