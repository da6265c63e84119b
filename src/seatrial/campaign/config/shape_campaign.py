"""The campaign file of a vehicle of which only the shape is known: priors of its coefficients, and a simulated vehicle at their medians."""

import json
from typing import Any

from seatrial.campaign.config.vehicle_campaign import file_head, sensor_lines
from seatrial.core.errors import InputError, nearest
from seatrial.core.units import quantity
from seatrial.estimation.priors.from_shape import ShapePriors, priors_from_shape
from seatrial.vehicles.shape import FORMS, QUALITIES

UNITS = dict.fromkeys(("length", "diameter", "beam", "height", "nose", "tail"), "m") | {"mass": "kg"}
EXAMPLES = (
    '"torpedo, length 1.6 m, diameter 0.19 m, mass 31 kg", "box, length 0.46 m, beam 0.34 m, height 0.25 m, mass 11.5 kg" '
    'or "hull.stl, mass 31 kg"'
)
_SPEED, _RATE = 1.0, 1.0  # Steady motion of the largest forces of the trial, m/s and rad/s
_PERIODS = {"tau_Y": 1.3, "tau_Z": 1.7, "tau_N": 0.7}  # Over that of tau_X, so that motions do not follow each other


def shape_of_text(text: str) -> ShapePriors:
    """Return the priors of a shape in words, such as `box, length 0.46 m, beam 0.34 m, height 0.25 m, mass 11.5 kg`.

    Args:
        text: form of `FORMS` or path of an STL file, then names and quantities, separated by commas. `box` after a path makes an open
            frame of it.

    Raises:
        InputError: words that are none of these, or a shape that no vehicle has.
    """
    first, *others = (part.strip() for part in text.split(","))
    given: dict[str, Any] = {}
    form, mesh = (first, None) if first in FORMS else ("ellipsoid", first)
    if mesh is not None and not mesh.lower().endswith(".stl"):
        raise InputError(
            "--shape",
            found=first or "nothing",
            expected=f"{', '.join(FORMS)} or an STL file",
            remedy=f"for example {EXAMPLES}",
        )
    for part in others:
        name, _, value = part.partition(" ")
        if mesh is not None and part == "box":
            form = part
        elif name in given:
            raise InputError(f"--shape, {name}", found="two values", expected="one", remedy="remove one of them")
        elif name not in UNITS:
            raise InputError("--shape", found=part, expected=", ".join(UNITS), remedy=nearest(name, UNITS))
        else:
            given[name] = quantity(value.strip(), UNITS[name], f"--shape, {name}")
    if "mass" not in given:
        raise InputError(
            "--shape", found="no mass", expected="the mass of the vehicle", remedy=f"for example {EXAMPLES}"
        )
    return priors_from_shape(form, mesh=mesh, **given)


def shape_campaign_text(text: str) -> str:
    """Return the campaign file of a shape in words, commented; arguments and errors as `shape_of_text`.

    Surge, sway, yaw and the heave of a frame are moved by forces, which the user replaces by propellers, fins or thrusters.
    """
    found = shape_of_text(text)
    shape, priors = found.shape, found.priors
    axes = "XYZN" if shape.form == "box" else "XYN"
    moves = [{"X": "u", "Y": "v", "Z": "w", "N": "r"}[axis] for axis in axes]
    terms = [name for name in priors if name[0] in axes]
    quality = QUALITIES[f"{shape.body} inertia"]
    inertia = ", ".join(f'"{one:.3g} kg m^2"' for one in shape.inertia)
    trim = ", ".join(f'tau_{axis} = "0 {_unit(axis)}"' for axis in axes)
    largest = {axis: _largest(found, axis, move) for axis, move in zip(axes, moves, strict=True)}
    parts = [
        file_head(
            f"{shape.form} of {shape.mass:g} kg",
            f"from a shape: {text}",
            "seatrial prior DIR; seatrial run DIR rehearses a trial with a simulated vehicle. Then write your log under [import]",
        ),
        f"# Moments of inertia of uniform density, within a factor of {quality.factor:g}. Forces are commands in newtons: replace them by\n"
        "# your thrusters ([[vehicle.thrusters]]), or name terms such as T_nabsn and N_uudelta_r, with their priors.\n"
        "[vehicle]\n"
        f"name = {json.dumps(shape.form)}\n"
        f'mass = "{shape.mass:g} kg"\n'
        f"inertia = [{inertia}]\n"
        f"moves = {json.dumps(moves)}\n"
        'added_coriolis = "automatic"\n'
        f"fixed = {{ {', '.join(f'{axis}_tau_{axis} = 1.0' for axis in axes)} }}\n"
        f'trim = {{ u = "0 m/s", {trim} }}',
        f"[structure]\nalways = {json.dumps(terms)}",
        "# Medians from the shape. 68 % lie within the factor, 95 % within its square. docs/dev/shapes.md compares them with vehicles.",
        *(
            f'[prior.{name}]  # {found.sources[name]}\ndistribution = "log-normal"\n'
            f"median = {priors[name].median:.3g}\nfactor = {priors[name].factor:g}"
            for name in terms
        ),
        sensor_lines(moves),
        '# The log determines the initial state.\n[estimation]\ninitial = "estimated"',
        "# A trial whose largest forces hold about 1 m/s or 1 rad/s: correct them to those that your vehicle has.\n"
        '[design]\ncontrol = "tau_X"\nduration = "60 s"\nactive = "50 s"\nsample_time = "0.2 s"\n'
        f'amplitude = {{ from = "{largest["X"] / 2:g} N", to = "{largest["X"]:g} N", points = 2 }}\n'
        'period = { from = "8 s", to = "16 s", points = 3 }',
        *(
            f'[design.together.tau_{axis}]\namplitude = "{largest[axis]:g} {_unit(axis)}"\nperiod = {_PERIODS[f"tau_{axis}"]}'
            for axis in axes[1:]
        ),
        "# A simulated vehicle, the medians above. Replace this table by [import] to use real logs.\n[truth]\n"
        + "\n".join(f"{name} = {priors[name].median:.3g}" for name in terms),
    ]
    return "\n\n".join(parts) + "\n"


def _unit(axis: str) -> str:
    return "N m" if axis == "N" else "N"


def _largest(found: ShapePriors, axis: str, move: str) -> float:
    """Return the force that holds the steady motion, with one digit."""
    motion = _RATE if axis == "N" else _SPEED
    linear, quadratic = (-found.priors[f"{axis}_{name}"].median for name in (move, f"{move}abs{move}"))
    return float(f"{linear * motion + quadratic * motion**2:.1g}")
