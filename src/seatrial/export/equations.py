"""The equations of motion as Python source: sums of named terms, thrusters, and the whole right side, from which targets print.

    (M_RB + M_A) d(nu)/dt = sum c phi + B T - C(nu) nu - g,  d(eta)/dt = J(eta) nu,  d(actual)/dt = clip((clip(command) - actual) / lag)

The source is arithmetic on scalars, with sin, cos, tan, fmin and fmax from the target: of a symbolic library it gives symbols, of
`math` numbers. `seatrial.vehicles.whole` is the reference, with which tests compare it. Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control, 2nd ed., 2021, eqs. (2.40), (3.56), (6.43) and (8.1) to (8.4).
"""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from textwrap import indent
from types import MappingProxyType

import numpy as np

from seatrial.core.coefficients import CoefficientName, Factor
from seatrial.core.signals import ACTUAL, ANGLES, POSITIONS, RATES, signal_unit
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.xml_text import number
from seatrial.vehicles.actuators import Actuator, lags_of
from seatrial.vehicles.hull import AXES, added_mass_entry

STATES = (*RATES, *POSITIONS, *ANGLES)  # Before those of lagging actuators
CONVENTIONS = (
    "SI and radians. Body axes forward, starboard and down; positions north, east and down; phi, theta, psi are roll, pitch and",
    "heading (Euler angles, singular at a pitch of 90 degrees). u v w p q r are velocities through the water.",
)


def python_module(
    template: str, vehicle: ExportedVehicle, lines: Iterable[str], notes: Iterable[str], **parts: str
) -> str:
    """Return a template with its docstring, the equations, and a text for each other of its @NAMES@.

    Args:
        template: source of a module.
        vehicle: whose equations these are.
        lines: of the docstring, above those of `state_lines`.
        notes: below them.
        parts: texts by name.
    """
    doc = "\n".join(map(docstring_line, [*lines, "", *state_lines(vehicle), *notes]))
    return _filled(template, {"DOC": doc, "SOURCE": source_of(vehicle), **parts})


def docstring_line(line: str) -> str:
    """Return text that can stand in a docstring: no quotes that end it, no backslashes, nothing that does not print."""
    kept = "".join(c if c.isprintable() else " " for c in line)
    return kept.replace("\\", "/").replace('"', "'")


def listed_numbers(values: Iterable[float]) -> str:
    """Return numbers as a list."""
    return _listed(map(number, values))


def states_of(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """Return the states of the source: velocities, position, attitude, and what lagging actuators do."""
    return (*STATES, *(f"{name}{ACTUAL}" for name in lagging(vehicle)))


def lagging(vehicle: ExportedVehicle) -> tuple[str, ...]:
    """Return the controls whose actuators lag."""
    return tuple(
        name for name in vehicle.controls if name in vehicle.actuators and vehicle.actuators[name].time_constant > 0
    )


def parameters_of(vehicle: ExportedVehicle) -> dict[str, tuple[float, str]]:
    """Return value and SI unit of everything that may be set: coefficients, and numbers that were estimated."""
    coefficients = {name: (float(value), vehicle.unit(name)) for name, value in vehicle.coefficients.items()}
    return coefficients | {name: (one.value, one.unit) for name, one in vehicle.numbers.items()}


def state_lines(vehicle: ExportedVehicle) -> list[str]:
    """Return states, controls and parameters with their units, as lines of a docstring."""
    states, controls = (
        ", ".join(f"{name} [{signal_unit(name)}]" for name in names) for names in (states_of(vehicle), vehicle.controls)
    )
    held = [rate for rate in RATES if rate not in vehicle.moves]
    return [
        *CONVENTIONS,
        f"state: {states}",
        f"control: {controls or 'none'}",
        *([f"{' '.join(held)} are not modelled and keep their values, which are to be 0"] if held else []),
    ]


def source_of(vehicle: ExportedVehicle) -> str:
    """Return functions of the right side: `accelerations`, `actuate` and `derivative`, with the tables that they need."""
    parameters, controls = parameters_of(vehicle), vehicle.controls
    sd = dict(zip(vehicle.estimated.names, vehicle.estimated.sd, strict=True))
    sd |= {name: one.sd for name, one in vehicle.numbers.items()}
    rows = [
        f'    "{name}": {number(value)},  # {unit}' + (f", estimated ± {sd[name]:.2g}" if name in sd else "")
        for name, (value, unit) in parameters.items()
    ]
    added = [["0.0"] * 6 for _ in RATES]
    for name in vehicle.coefficients:
        if name not in vehicle.forces:
            i, j = added_mass_entry(CoefficientName.parse(name))
            added[i][j] = f"-{name}" if added[i][j] == "0.0" else f"{added[i][j]} - {name}"
    hull, lags = vehicle.hull, [name for name in vehicle.numbers if name.startswith("lag_")]
    stated = {
        "net_weight": hull.weight - hull.buoyancy,
        **dict(zip(("x_b", "y_b", "z_b"), hull.centre_of_buoyancy, strict=True)),
    }
    parts = {
        "STATES": repr(states_of(vehicle)),
        "CONTROLS": repr(controls),
        "TABLE": "\n".join(rows),
        "MOVES": repr(tuple(RATES.index(rate) for rate in vehicle.moves)),
        "RIGID": _matrix([[number(x) for x in row] for row in vehicle.rigid_mass]),
        "ADDED": indent(_matrix(added), "    ").strip(),
        "CONTROL": _unpack(controls, "control"),
        "VALUES": _unpack(parameters, "parameters"),
        "STATED": "\n".join(f"    {name} = {number(x)}" for name, x in stated.items() if name not in parameters),
        "FORCES": indent("\n".join(_force_lines(vehicle)), "    "),
        "CORIOLIS": "mass" if vehicle.added_coriolis == "automatic" else "RIGID_MASS",
        "WEIGHT": number(hull.weight),
        "GRAVITY": listed_numbers(hull.centre_of_gravity),
        "NAMES": _listed(controls),
        "LAGGING": repr(tuple(controls.index(name) for name in lagging(vehicle))),
        "ACTUAL": _unpack([f"{name}{ACTUAL}" for name in lagging(vehicle)], "actual"),
        "LAGS": "\n".join(f"    {name} = parameters[{list(parameters).index(name)}]" for name in lags),
        "LIMITS": "\n".join(
            f"    {name} = {_limited(name, vehicle.actuators[name])}" for name in controls if name in vehicle.actuators
        ),
        "ACTING": _listed(name + ACTUAL * (name in lagging(vehicle)) for name in controls),
        "FOLLOWING": _listed(_following(vehicle, name) for name in lagging(vehicle)),
    }
    return _filled(_SOURCE, parts)


def _filled(template: str, parts: Mapping[str, str]) -> str:
    """Return a template with a text for each name; the line of one whose text is empty goes."""
    for key, value in parts.items():
        template = template.replace(f"@{key}@", value) if value else template.replace(f"@{key}@\n", "")
    return template


def _force_lines(vehicle: ExportedVehicle) -> Iterable[str]:
    """Yield the sum of each axis, and the thrusters."""
    hull, named = vehicle.hull, [CoefficientName.parse(name) for name in vehicle.forces]
    share, wake = number(1.0 - hull.thrust_deduction), number(1.0 - hull.wake)
    thrust = [one for one in named if one.axis == "T"]
    for axis in AXES:
        terms = [f"{one} * {_regressor(one, hull.trim)}" for one in named if one.axis == axis]
        if axis == "X" and not vehicle.thrusters:
            terms += [f"{share} * {one} * {_regressor(one, hull.trim, {'u': f'({wake} * u)'})}" for one in thrust]
        yield f"{axis} = (\n    0.0\n" + "".join(f"    + {term}\n" for term in terms) + ")"
    for place, thruster, control in vehicle.acting_thrusters:
        if thrust:
            inflow = [*thruster.column[:3], *np.cross(thruster.place, thruster.column[:3])]
            yield f"inflow = {wake} * ({_weighted(inflow, RATES)})"
        yield from _thrust_lines(vehicle, place, control, thrust)
        yield from (
            f"{axis} = {axis} + {number(x)} * thrust" for axis, x in zip(AXES, thruster.column, strict=True) if x
        )


def _thrust_lines(
    vehicle: ExportedVehicle, place: int, control: str, thrust: Sequence[CoefficientName]
) -> Iterable[str]:
    """Yield the statements that give the thrust of one of several thrusters, with the deduction, N; `inflow` is a variable."""
    law, letter, push = vehicle.thrust_law, control[0], control
    if f"dead_{letter}" in law:
        yield f"{control} = fmax({control} - dead_{letter}, 0.0) + fmin({control} + dead_{letter}, 0.0)"
    if thrust:
        names = {letter: control, "u": "inflow"}
        push = "(" + " + ".join(f"{one} * {_regressor(one, vehicle.hull.trim, names)}" for one in thrust) + ")"
    for gain in (f"gain_{control}", f"gain_{letter}"):
        push = f"{gain} * {push}" if gain in law else push
    if f"reverse_{letter}" in law:
        yield f"push = {push}"
        push = f"(fmax(push, 0.0) + reverse_{letter} * fmin(push, 0.0))"
    yield f"thrust = {number(1.0 - vehicle.hull.thrust_deduction)} * {push}"


def _weighted(factors: Iterable[float], names: Iterable[str]) -> str:
    return " + ".join(f"{number(x)} * {name}" for x, name in zip(factors, names, strict=True) if x) or "0.0"


def _regressor(
    name: CoefficientName, trim: Mapping[str, float], names: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return the product of signals that a coefficient multiplies; `names` has the source of signals with another name."""
    return " * ".join(_factor(factor, trim, names) for factor in name.factors) or "1.0"


def _factor(factor: Factor, trim: Mapping[str, float], names: Mapping[str, str]) -> str:
    text = names.get(factor.signal, factor.signal)
    if factor.change:
        text = f"({text} - {number(trim[factor.signal])})"
    text = f"abs({text})" if factor.modulus else text
    return text if factor.power == 1 else f"{text}**{factor.power}"


def _limited(name: str, actuator: Actuator) -> str:
    text = f"fmin({name}, {number(actuator.upper)})" if isfinite(actuator.upper) else name
    return f"fmax({text}, {number(actuator.lower)})" if isfinite(actuator.lower) else text


def _following(vehicle: ExportedVehicle, name: str) -> str:
    """Return the rate of an actuator that lags, by its estimated lag where there is one."""
    actuator = vehicle.actuators[name]
    lag = next((one for one in lags_of(name) if one in vehicle.numbers), number(actuator.time_constant))
    text = f"({name} - {name}{ACTUAL}) / {lag}"
    rate = number(actuator.rate) if isfinite(actuator.rate) else ""
    return f"fmin(fmax({text}, -{rate}), {rate})" if rate else text


def _listed(items: Iterable[str]) -> str:
    return f"[{', '.join(items)}]"


def _unpack(names: Iterable[str], source: str) -> str:
    return f"    {_listed(names)} = {source}"


def _matrix(rows: list[list[str]]) -> str:
    return "[\n" + "".join(f"    {_listed(row)},\n" for row in rows) + "]"


_SOURCE = '''STATES = @STATES@
CONTROLS = @CONTROLS@
PARAMETERS = {
@TABLE@
}
LAGGING = @LAGGING@
MOVES = @MOVES@
RIGID_MASS = @RIGID@


def accelerations(nu, angles, control, parameters, outside=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)):
    """Accelerations through the water, by what the actuators do and by forces and moments from outside; a list of six."""
    [u, v, w, p, q, r] = nu
    [phi, theta, psi] = angles
@CONTROL@
@VALUES@
@STATED@
@FORCES@
    added_mass = @ADDED@
    mass = [[a + b for a, b in zip(*rows)] for rows in zip(RIGID_MASS, added_mass)]
    momentum = [sum(m * x for m, x in zip(row, nu)) for row in @CORIOLIS@]
    forces = [a + b for a, b in zip([X, Y, Z], cross(momentum[:3], nu[3:]))]
    moments = [sum(parts) for parts in zip([K, M, N], cross(momentum[:3], nu[:3]), cross(momentum[3:], nu[3:]))]
    down = [-sin(theta), cos(theta) * sin(phi), cos(theta) * cos(phi)]
    buoyancy = @WEIGHT@ - net_weight
    righting = [@WEIGHT@ * g - buoyancy * b for g, b in zip(@GRAVITY@, [x_b, y_b, z_b])]
    total = [a + net_weight * b for a, b in zip(forces, down)]
    total += [a + b for a, b in zip(moments, cross(righting, down))]
    rates = solve([[mass[i][j] for j in MOVES] for i in MOVES], [total[i] + outside[i] for i in MOVES])
    return [rates[MOVES.index(i)] if i in MOVES else 0.0 for i in range(6)]


def limited(control):
    """Commands within the limits of their actuators."""
@CONTROL@
@LIMITS@
    return @NAMES@


def followed(control):
    """What lagging actuators do that have followed these commands: their part of the state where a simulation begins."""
    wanted = limited(control)
    return [wanted[i] for i in LAGGING]


def actuate(actual, control, parameters):
    """What the actuators do by their commands, and how fast those that lag follow."""
    @NAMES@ = limited(control)
@ACTUAL@
@LAGS@
    return @ACTING@, @FOLLOWING@


def derivative(state, control, parameters, current=(0.0, 0.0, 0.0)):
    """Rate of the state; current is the velocity of the water to the north, east and down."""
    [u, v, w, p, q, r] = nu = state[:6]
    [phi, theta, psi] = angles = state[9:12]
    acting, following = actuate(state[12:], control, parameters)
    ahead = cos(theta) * u + sin(theta) * (sin(phi) * v + cos(phi) * w)
    aside = cos(phi) * v - sin(phi) * w
    turn = sin(phi) * q + cos(phi) * r
    return [
        *accelerations(nu, angles, acting, parameters),
        cos(psi) * ahead - sin(psi) * aside + current[0],
        sin(psi) * ahead + cos(psi) * aside + current[1],
        -sin(theta) * u + cos(theta) * (sin(phi) * v + cos(phi) * w) + current[2],
        p + tan(theta) * turn,
        cos(phi) * q - sin(phi) * r,
        turn / cos(theta),
        *following,
    ]


def runge_kutta(state, control, parameters, step, current=(0.0, 0.0, 0.0)):
    """State one step later, by the classical Runge-Kutta method of fourth order; commands are held."""

    def moved(rate, share):
        return [x + share * step * dx for x, dx in zip(state, rate)]

    first = derivative(state, control, parameters, current)
    second = derivative(moved(first, 0.5), control, parameters, current)
    third = derivative(moved(second, 0.5), control, parameters, current)
    fourth = derivative(moved(third, 1.0), control, parameters, current)
    return moved([(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth)], 1.0)


def cross(a, b):
    """Vector product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def solve(rows, right):
    """Gaussian elimination; a mass matrix is positive definite and needs no exchange of rows."""
    rows, right = [list(row) for row in rows], list(right)
    for k in range(len(right)):
        for i in range(k + 1, len(right)):
            share = rows[i][k] / rows[k][k]
            rows[i] = [a - share * b for a, b in zip(rows[i], rows[k])]
            right[i] = right[i] - share * right[k]
    for k in reversed(range(len(right))):
        known = sum(rows[k][j] * right[j] for j in range(k + 1, len(right)))
        right[k] = (right[k] - known) / rows[k][k]
    return right
'''
