"""The campaign file of a vehicle of which only the shape is known: priors of its coefficients, and a simulated vehicle at their middle."""

import json
from pathlib import Path

from seatrial.campaign.config.vehicle_campaign import file_head, sensor_lines
from seatrial.core.argument_checks import check_choice
from seatrial.core.errors import InputError
from seatrial.core.units import quantity
from seatrial.estimation.priors.from_shape import ShapePriors, priors_from_shape
from seatrial.vehicles.shape import FORMS, QUALITIES

UNITS = dict.fromkeys(("length", "diameter", "beam", "height", "nose", "tail"), "m") | {"mass": "kg"}
_EXAMPLE = "for example box, length 0.46 m, beam 0.34 m, height 0.25 m, mass 11.5 kg"


def shape_of_text(text: str) -> ShapePriors:
    """Return the priors of a shape in words.

    Args:
        text: a form of `FORMS`, or an STL file, then names and quantities, separated by commas; `box` after a file makes a frame of it.

    Raises:
        InputError: words that are none of these, or a shape that no vehicle has.
    """
    first, *others = (part.strip() for part in text.split(","))
    mesh = first if Path(first).suffix else None
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
    """Return the campaign file of a shape, commented. Forces move surge, sway and yaw.

    Args:
        text: the shape in words.
        found: of `shape_of_text`.
    """
    shape = found.shape
    priors = {name: prior for name, prior in found.priors.items() if name[0] in "XYN"}
    # With one digit, what holds 1 m/s or 1 rad/s.
    surge, sway, yaw = (
        float(f"{-priors[linear].median - priors[quadratic].median:.1g}")
        for linear, quadratic in (("X_u", "X_uabsu"), ("Y_v", "Y_vabsv"), ("N_r", "N_rabsr"))
    )
    tables = "\n\n".join(
        f"[prior.{name}]  # {found.sources[name]}\n"
        f'distribution = "log-normal"\nmedian = {prior.median:.3g}\nfactor = {prior.factor:g}'
        for name, prior in priors.items()
    )
    following = "seatrial prior DIR; seatrial design DIR. Then write your log under [import]"
    return f"""{file_head(f"{shape.body} of {shape.mass:g} kg", f"from a shape: {text}", following)}

# Moments of inertia are those of uniform density, within a factor of {QUALITIES[f"{shape.body} inertia"].factor:g}.
# Forces are commands in newtons. Replace them by your thrusters, [[vehicle.thrusters]].
# Or name the terms of propeller and fins, such as T_nabsn and N_uudelta_r, and give their priors.
[vehicle]
name = "{shape.body}"
mass = "{shape.mass:g} kg"
inertia = {json.dumps([f"{one:.3g} kg m^2" for one in shape.inertia])}
moves = ["u", "v", "r"]
added_coriolis = "automatic"
fixed = {{ X_tau_X = 1.0, Y_tau_Y = 1.0, N_tau_N = 1.0 }}
trim = {{ u = "0 m/s", tau_X = "0 N", tau_Y = "0 N", tau_N = "0 N m" }}

[structure]
always = {json.dumps(list(priors))}

# 68 % lie within the factor of the median, 95 % within its square.
{tables}

{sensor_lines(["u", "v", "r"])}

# The log determines the initial state.
[estimation]
initial = "estimated"

# The largest forces hold about 1 m/s or 1 rad/s. Correct them to those of your vehicle.
[design]
control = "tau_X"
duration = "60 s"
active = "50 s"
sample_time = "0.1 s"
amplitude = {{ from = "{surge / 2:g} N", to = "{surge:g} N", points = 2 }}
period = {{ from = "8 s", to = "16 s", points = 3 }}
together.tau_Y = {{ amplitude = "{sway:g} N", period = 1.3 }}
together.tau_N = {{ amplitude = "{yaw:g} N m", period = 0.7 }}

# After the trial, map its log under [import]. This table instead simulates a vehicle in the middle of the priors.
# [truth]
{chr(10).join(f"# {name} = {prior.median:.3g}" for name, prior in priors.items())}
"""
