"""T. I. Fossen's Python Vehicle Simulator: a subclass of its REMUS 100, whose dynamics are replaced by the vehicle's own, term by term.

The simulator has no file of parameters, builds its damping from time constants and leaves the Munk moments out, so that `dynamics` is
overridden as a whole: M, C, every named term, weight and buoyancy, the lags and limits of the actuators. Its autopilots stay.
Source: github.com/cybergalactic/PythonVehicleSimulator, `vehicles/remus100.py` and `lib/mainLoop.py` (MIT licence).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite, pi
from textwrap import indent

import numpy as np

from seatrial.core.signals import signal_unit
from seatrial.export.equations import axis_sum, docstring_line, inflow_row, needs_inflow, parameters_of, thrust_of
from seatrial.export.manoeuvre import contrary_to
from seatrial.export.motion import motion_of
from seatrial.export.stability import check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.vehicle import ExportedVehicle, require_whole
from seatrial.export.xml_text import identifier, number
from seatrial.vehicles.hull import AXES

_TORPEDO = ("delta_r", "delta_s", "n")  # The simulator's own controls, in its order
# Its autopilots take a positive rudder to turn to starboard, and a positive stern plane to put the nose down.
_CONVENTION = {"delta_r": {"r": 1}, "delta_s": {"q": -1}}


@dataclass(frozen=True)
class Fossen:
    """See the module."""

    name: str = "fossen"
    target: str = "Python Vehicle Simulator (commit c717e07, May 2025)"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        require_whole(vehicle, self.name)
        check_stable(vehicle, self.name)

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: everything, since its code is written out."""
        return Carried(motion_of(vehicle), actuators=vehicle.actuators, reversed=contrary_to(vehicle, _CONVENTION))

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name = identifier(vehicle.name)
        controls, scales = controls_of(vehicle), scales_of(vehicle)
        parts = {
            "DOC": "\n".join(docstring_line(line) for line in [*statement.lines, *_notes(vehicle, scales)]),
            "CLASS": name,
            "TITLE": repr(docstring_line(vehicle.name)),
            "MRB": _matrix(vehicle.rigid_mass),
            "MA": _matrix(vehicle.added_mass),
            "CORIOLIS": "self.MRB + self.MA" if vehicle.added_coriolis == "automatic" else "self.MRB",
            "W": number(vehicle.hull.weight),
            "B": number(vehicle.hull.buoyancy),
            "RG": _row(vehicle.hull.centre_of_gravity),
            "RB": _row(vehicle.hull.centre_of_buoyancy),
            "LABELS": repr([_label(control) for control in controls]),
            "SCALE": _row(scales.values()),
            **{
                key: _row([_limit(vehicle, control, scale, attribute) for control, scale in scales.items()])
                for key, attribute in (
                    ("LOWER", "lower"),
                    ("UPPER", "upper"),
                    ("RATE", "rate"),
                    ("LAG", "time_constant"),
                )
            },
            "UNPACK": "\n".join(f"        {control} = control[{i}]" for i, control in enumerate(controls)),
            "FORCES": _forces(vehicle),
            "SINGLE": _steps(controls),
        }
        text = _TEMPLATE
        for key, value in parts.items():
            text = text.replace(f"@{key}@", value)
        return {f"{name}.py": text}


def controls_of(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """Return the controls in the order of the simulator's vector: its own three for a vehicle that has no others."""
    own = vehicle.controls
    return _TORPEDO if set(own) <= set(_TORPEDO) else own


def scales_of(vehicle: ExportedVehicle) -> dict[str, float]:
    """Factor from the simulator's command to ours, SI, by control in the simulator's order; negative where its convention is contrary."""
    contrary = contrary_to(vehicle, _CONVENTION)
    return {
        control: pi / 30 if control == "n" else -1.0 if control in contrary else 1.0 for control in controls_of(vehicle)
    }


def _notes(vehicle: ExportedVehicle, scales: dict[str, float]) -> list[str]:
    order = ", ".join(f"{control} ({_label(control).split('(')[1]}" for control in scales)
    lines = ["", f"Axes: forward, starboard, down; north, east, down. u_control and u_actual: {order}."]
    if set(scales) & set(_CONVENTION):
        lines.append(
            "The simulator's autopilot has a positive rudder turn to starboard, a positive stern plane put the nose down."
        )
    lines += [f"So has this file: its {control} is minus seatrial's." for control, scale in scales.items() if scale < 0]
    missing = [control for control in scales if control not in vehicle.controls]
    if missing:
        lines.append(f"This vehicle has no {', '.join(missing)}: the simulator's control of that name has no effect.")
    return [*lines, "Length and diameter are unknown, and not used."]


def _limit(vehicle: ExportedVehicle, control: str, scale: float, attribute: str) -> float:
    """Return a limit in the simulator's units."""
    actuator = vehicle.actuators.get(control)
    unbounded = {"lower": -np.inf, "upper": np.inf, "rate": np.inf, "time_constant": 0.0}
    if actuator is None:
        return unbounded[attribute]
    if attribute == "time_constant":
        return actuator.time_constant
    if attribute == "rate":
        return actuator.rate / abs(scale)
    ends = sorted((actuator.lower / scale, actuator.upper / scale))
    return ends[0 if attribute == "lower" else 1]


def _label(control: str) -> str:
    known = {"delta_r": "Tail rudder (rad)", "delta_s": "Stern plane (rad)", "n": "Propeller revolution (rpm)"}
    return known.get(control, f"{control} ({signal_unit(control)})")


def _forces(vehicle: ExportedVehicle) -> str:
    """Return one sum for each axis, and the thrusters."""
    hull, lines = vehicle.hull, []
    values = {name: number(value) for name, (value, _) in parameters_of(vehicle).items()}
    lines += [axis_sum(vehicle, axis, values) for axis in AXES]
    lines.append(f"tau = np.array([{', '.join(AXES)}])")
    for place, thruster in enumerate(vehicle.thrusters, 1):
        if needs_inflow(vehicle):
            lines.append(f"inflow = {number(1.0 - hull.wake)} * np.dot({_row(inflow_row(vehicle, place))}, nu_r)")
        before, push = thrust_of(vehicle, place, values, "np.")
        net = [(1.0 - hull.thrust_deduction) * x for x in thruster.column]
        lines += [*before, f"tau = tau + {_row(net)} * {push}"]
    return indent("\n".join(lines), " " * 8)


def _row(values: Iterable[float]) -> str:
    texts = (number(value) if isfinite(value) else "np.inf" if value > 0 else "-np.inf" for value in values)
    return f"np.array([{', '.join(texts)}])"


def _matrix(matrix: np.ndarray) -> str:
    rows = ",\n            ".join("[" + ", ".join(number(x) for x in row) + "]" for row in matrix)
    return f"np.array([\n            {rows},\n        ])"


def _steps(controls: tuple[str, ...]) -> str:
    """Return the simulator's own steps for a torpedo; nothing for other vehicles."""
    if controls == _TORPEDO:
        return ""
    return (
        "\n    def stepInput(self, t):\n"
        '        """No control; change it to try the vehicle."""\n'
        "        return np.zeros(self.dimU)\n"
    )


_TEMPLATE = '''"""
@DOC@
"""

import math

import numpy as np
from python_vehicle_simulator.vehicles.remus100 import remus100


class @CLASS@(remus100):
    """See the top of the file."""

    def __init__(self, controlSystem="stepInput", r_z=0, r_psi=0, r_rpm=0, V_current=0, beta_current=0):
        super().__init__(controlSystem, r_z, r_psi, r_rpm, V_current, beta_current)
        self.name = @TITLE@
        self.L = float("nan")
        self.diam = float("nan")
        self.MRB = @MRB@
        self.MA = @MA@
        self.M = self.MRB + self.MA
        self.Minv = np.linalg.inv(self.M)
        self.M_coriolis = @CORIOLIS@
        self.W = @W@
        self.B = @B@
        self.r_bg = @RG@
        self.r_bb = @RB@
        self.controls = @LABELS@
        self.dimU = len(self.controls)
        self.u_actual = np.zeros(self.dimU)
        self.to_SI = @SCALE@
        self.lower = @LOWER@
        self.upper = @UPPER@
        self.rate = @RATE@
        self.lag = @LAG@

    def acceleration(self, eta, nu_r, u_actual):
        """Acceleration through the water, from pose, velocity through the water and actual controls."""
        u, v, w, p, q, r = nu_r
        phi, theta, psi = eta[3:6]
        control = np.asarray(u_actual, float) * self.to_SI
@UNPACK@
@FORCES@
        momentum = self.M_coriolis @ nu_r
        coriolis = np.concatenate([
            np.cross(nu_r[3:], momentum[:3]),
            np.cross(nu_r[:3], momentum[:3]) + np.cross(nu_r[3:], momentum[3:]),
        ])
        down = np.array([-math.sin(theta), math.cos(theta) * math.sin(phi), math.cos(theta) * math.cos(phi)])
        restoring = np.concatenate([
            (self.W - self.B) * down,
            np.cross(self.W * self.r_bg - self.B * self.r_bb, down),
        ])
        return self.Minv @ (tau - coriolis + restoring)

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        """Velocity and actual controls one sample later, by Euler's method as in the simulator."""
        u_c = self.V_c * math.cos(self.beta_c - eta[5])
        v_c = self.V_c * math.sin(self.beta_c - eta[5])
        nu_c = np.array([u_c, v_c, 0.0, 0.0, 0.0, 0.0])
        Dnu_c = np.array([nu[5] * v_c, -nu[5] * u_c, 0.0, 0.0, 0.0, 0.0])
        wanted = np.clip(np.asarray(u_control, float), self.lower, self.upper)
        actual = np.where(self.lag > 0, u_actual, wanted)
        nu_dot = Dnu_c + self.acceleration(eta, nu - nu_c, actual)
        speed = np.clip((wanted - actual) / np.where(self.lag > 0, self.lag, 1.0), -self.rate, self.rate)
        return nu + sampleTime * nu_dot, actual + sampleTime * speed
@SINGLE@'''
