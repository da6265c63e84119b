"""T. I. Fossen's Python Vehicle Simulator: a subclass of its REMUS 100, whose dynamics are replaced by the vehicle's own, term by term.

The simulator has no file of parameters, builds its damping from time constants and leaves the Munk moments out, so that `dynamics` is
overridden as a whole, by the equations that other targets have too. Its autopilots stay.
Source: github.com/cybergalactic/PythonVehicleSimulator, `vehicles/remus100.py` and `lib/mainLoop.py` (MIT licence).
"""

from dataclasses import dataclass
from math import pi

from seatrial.core.signals import signal_unit
from seatrial.export.equations import docstring_line, listed_numbers, python_module
from seatrial.export.manoeuvre import USUAL_FINS, contrary_to
from seatrial.export.motion import motion_of
from seatrial.export.target import Carried, Exporter, Statement
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import identifier

_TORPEDO = ("delta_r", "delta_s", "n")  # The simulator's own controls, in its order


@dataclass(frozen=True)
class Fossen(Exporter):
    """See the module."""

    name: str = "fossen"
    target: str = "Python Vehicle Simulator (commit c717e07, May 2025)"
    simulates = "all"

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: everything, since its code is written out."""
        return Carried(motion_of(vehicle), actuators=vehicle.actuators, reversed=contrary_to(vehicle, USUAL_FINS))

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        name, scales = identifier(vehicle.name), scales_of(vehicle)
        order = [list(scales).index(control) for control in vehicle.controls]
        text = python_module(
            _TEMPLATE,
            vehicle,
            statement.lines,
            _notes(vehicle, scales),
            CLASS=name,
            TITLE=repr(docstring_line(vehicle.name)),
            LABELS=repr([_label(control) for control in scales]),
            SCALE=listed_numbers(scales.values()),
            ORDER=repr(order),
            STEPS="" if tuple(scales) == _TORPEDO else _NO_STEPS,
        )
        return {f"{name}.py": text}


def controls_of(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """Return the controls in the order of the simulator's vector: its own three for a vehicle that has no others."""
    own = vehicle.controls
    return _TORPEDO if set(own) <= set(_TORPEDO) else own


def scales_of(vehicle: ExportedVehicle) -> dict[str, float]:
    """Factor from the simulator's command to ours, SI, by control in the simulator's order; negative where its convention is contrary."""
    contrary = contrary_to(vehicle, USUAL_FINS)
    return {
        control: pi / 30 if control == "n" else -1.0 if control in contrary else 1.0 for control in controls_of(vehicle)
    }


def _notes(vehicle: ExportedVehicle, scales: dict[str, float]) -> list[str]:
    order = ", ".join(f"{control} ({_label(control).split('(')[1]}" for control in scales)
    lines = [f"u_control and u_actual: {order}. u_actual, what lagging actuators do, begins at 0."]
    if set(scales) & set(USUAL_FINS):
        lines.append(
            "The simulator's autopilot has a positive rudder turn to starboard, a positive stern plane put the nose down."
        )
    lines += [f"So has this file: its {control} is minus seatrial's." for control, scale in scales.items() if scale < 0]
    missing = [control for control in scales if control not in vehicle.controls]
    if missing:
        lines.append(f"This vehicle has no {', '.join(missing)}: the simulator's control of that name has no effect.")
    return [*lines, "Length and diameter are unknown, and not used."]


def _label(control: str) -> str:
    known = {"delta_r": "Tail rudder (rad)", "delta_s": "Stern plane (rad)", "n": "Propeller revolution (rpm)"}
    return known.get(control, f"{control} ({signal_unit(control)})")


# Instead of the simulator's own steps, which are those of a torpedo.
_NO_STEPS = '''
    def stepInput(self, t):
        """No control; change it to try the vehicle."""
        return np.zeros(self.dimU)'''
_TEMPLATE = '''"""
@DOC@
"""

from math import cos, sin, tan

import numpy as np
from python_vehicle_simulator.vehicles.remus100 import remus100

fmin, fmax = min, max
@SOURCE@


class @CLASS@(remus100):
    """See the top of the file."""

    def __init__(self, controlSystem="stepInput", r_z=0, r_psi=0, r_rpm=0, V_current=0, beta_current=0):
        super().__init__(controlSystem, r_z, r_psi, r_rpm, V_current, beta_current)
        self.name = @TITLE@
        self.L = float("nan")
        self.diam = float("nan")
        self.controls = @LABELS@
        self.dimU = len(self.controls)
        self.u_actual = np.zeros(self.dimU)
        self.to_SI = np.array(@SCALE@)
        self.order = @ORDER@  # of CONTROLS among the simulator's
        self.parameters = list(PARAMETERS.values())

    def acceleration(self, eta, nu_r, u_actual):
        """Acceleration through the water, from pose, velocity through the water and actual controls."""
        return np.array(accelerations(nu_r, eta[3:6], self.in_SI(u_actual), self.parameters))

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        """Velocity and actual controls one sample later, by Euler's method as in the simulator."""
        u_c = self.V_c * cos(self.beta_c - eta[5])
        v_c = self.V_c * sin(self.beta_c - eta[5])
        nu_c = np.array([u_c, v_c, 0.0, 0.0, 0.0, 0.0])
        Dnu_c = np.array([nu[5] * v_c, -nu[5] * u_c, 0.0, 0.0, 0.0, 0.0])
        actual = self.in_SI(u_actual)
        acting, following = actuate([actual[i] for i in LAGGING], self.in_SI(u_control), self.parameters)
        nu_dot = Dnu_c + accelerations(nu - nu_c, eta[3:6], acting, self.parameters)
        for i, rate in zip(LAGGING, following):
            acting[i] += sampleTime * rate
        after = np.array(u_control, float)
        after[self.order] = acting / self.to_SI[self.order]
        return nu + sampleTime * nu_dot, after
@STEPS@

    def in_SI(self, controls):
        """Values of CONTROLS, from the simulator's controls."""
        return (np.asarray(controls, float) * self.to_SI)[self.order].tolist()
'''
