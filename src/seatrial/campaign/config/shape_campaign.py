"""The campaign file of a vehicle of which only the shape is known: priors of its coefficients, and a simulated vehicle at their middle."""

import json

from seatrial.campaign.config.vehicle_campaign import file_head, sensor_lines
from seatrial.core.argument_checks import check_choice
from seatrial.core.errors import InputError
from seatrial.core.units import quantity
from seatrial.estimation.priors.from_shape import ShapePriors, priors_from_shape, typical
from seatrial.estimation.priors.normal import LogNormal
from seatrial.estimation.priors.truncated import TruncatedNormal
from seatrial.vehicles.shape import FORMS, QUALITIES

UNITS = dict.fromkeys(("length", "diameter", "beam", "height", "nose", "tail"), "m") | {"mass": "kg"}
_EXAMPLE = "for example box, length 0.46 m, beam 0.34 m, height 0.25 m, mass 11.5 kg"
_MOTIONS = {"X": "u", "Y": "v", "Z": "w", "N": "r"}
_PERIODS = {"Y": 1.3, "Z": 1.7, "N": 0.7}  # Over that of surge, so that motions do not follow each other


def shape_of_text(text: str) -> ShapePriors:
    """Return the priors of a shape in words.

    Args:
        text: a form of `FORMS`, or an STL file, then names and quantities, separated by commas; `box` after a file makes a frame of it.

    Raises:
        InputError: words that are none of these, or a shape that no vehicle has.
    """
    first, *others = (part.strip() for part in text.split(","))
    mesh = first if first.lower().endswith(".stl") else None
    form = "ellipsoid" if mesh else check_choice(first, FORMS, "--shape, form")
    given: dict[str, float] = {}
    for part in others:
        name, _, value = part.partition(" ")
        if mesh and part == "box":
            form = part
        elif name in given:
            raise InputError(f"--shape, {name}", found="two values", expected="one", remedy="remove one of them")
        else:
            unit = UNITS[check_choice(name, UNITS, "--shape, quantity")]
            given[name] = quantity(value.strip(), unit, f"--shape, {name}")
    if "mass" not in given:
        raise InputError("--shape", found="no mass", expected="the mass of the vehicle", remedy=_EXAMPLE)
    return priors_from_shape(form, mesh=mesh, **given)


def shape_campaign_text(text: str, found: ShapePriors) -> str:
    """Return the campaign file of a shape, commented. Surge, sway, yaw and the heave of a frame are moved by forces.

    Args:
        text: the shape in words.
        found: of `shape_of_text`.
    """
    shape = found.shape
    axes = [axis for axis in _MOTIONS if axis != "Z" or shape.body == "box"]
    moves = [_MOTIONS[axis] for axis in axes]
    priors = {name: prior for name, prior in found.priors.items() if name[0] in axes}
    units = {axis: "N m" if axis == "N" else "N" for axis in axes}
    # With one digit, what holds 1 m/s or 1 rad/s.
    largest = {
        axis: float(f"{-typical(priors[f'{axis}_{one}']) - typical(priors[f'{axis}_{one}abs{one}']):.1g}")
        for axis, one in zip(axes, moves, strict=True)
    }
    following = "seatrial prior DIR; seatrial run DIR rehearses a trial with a simulated vehicle. Then write your log under [import]"
    parts = [
        file_head(f"{shape.body} of {shape.mass:g} kg", f"from a shape: {text}", following),
        "# Moments of inertia are those of uniform density, within a factor of "
        f"{QUALITIES[f'{shape.body} inertia'].factor:g}.\n# Forces are commands in newtons. Replace them by your thrusters, "
        "[[vehicle.thrusters]].\n# Or name the terms of propeller and fins, such as T_nabsn and N_uudelta_r, and give their priors.\n"
        f'[vehicle]\nname = "{shape.body}"\nmass = "{shape.mass:g} kg"\ninertia = '
        + json.dumps([f"{one:.3g} kg m^2" for one in shape.inertia])
        + f'\nmoves = {json.dumps(moves)}\nadded_coriolis = "automatic"\nfixed = {{ '
        + ", ".join(f"{axis}_tau_{axis} = 1.0" for axis in axes)
        + ' }\ntrim = { u = "0 m/s", '
        + ", ".join(f'tau_{axis} = "0 {units[axis]}"' for axis in axes)
        + " }",
        f"[structure]\nalways = {json.dumps(list(priors))}",
        "# 68 % lie within the factor of the median, 95 % within its square; of a half-normal within once and twice the scale.",
        *(f"[prior.{name}]  # {found.sources[name]}\n{_keys(prior)}" for name, prior in priors.items()),
        sensor_lines(moves),
        '# The log determines the initial state.\n[estimation]\ninitial = "estimated"',
        "# The largest forces hold about 1 m/s or 1 rad/s. Correct them to those of your vehicle.\n"
        '[design]\ncontrol = "tau_X"\nfamilies = ["random-steps"]\nduration = "60 s"\nactive = "50 s"\nsample_time = "0.2 s"\n'
        f'amplitude = {{ from = "{largest["X"] / 2:g} N", to = "{largest["X"]:g} N", points = 2 }}\n'
        'period = { from = "8 s", to = "16 s", points = 3 }',
        *(
            f'[design.together.tau_{axis}]\namplitude = "{largest[axis]:g} {units[axis]}"\nperiod = {_PERIODS[axis]}'
            for axis in axes[1:]
        ),
        "# The simulated vehicle is in the middle of the priors. Replace this table by [import] to use real logs.\n"
        "[truth]\n" + "\n".join(f"{name} = {typical(prior):.3g}" for name, prior in priors.items()),
    ]
    return "\n\n".join(parts) + "\n"


def _keys(prior: LogNormal | TruncatedNormal) -> str:
    """Return the keys of the table of a prior."""
    if isinstance(prior, LogNormal):
        return f'distribution = "log-normal"\nmedian = {prior.median:.3g}\nfactor = {prior.factor:g}'
    return f'distribution = "half-normal"\nscale = {prior.scale:.3g}\nupper = 0.0'
