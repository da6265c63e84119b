"""The campaign file of what is known before there are any data, with a comment on each table."""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import ceil, floor, log10

from seatrial.campaign.config.new_campaign import EXAMPLES, OWN, PUBLISHED, Control, NewCampaign, Sought
from seatrial.campaign.store.stored_result import FILE_NAME
from seatrial.core.errors import InputError
from seatrial.core.signals import POSITIONS, PROPULSION, signal_unit
from seatrial.core.units import quantity, to_si

SURGE = "_surge"
"""Ending of the published vehicles of surge alone, whose trim is published too."""


def campaign_text(new: NewCampaign) -> str:
    """Return the campaign file, commented.

    Raises:
        InputError: no control, or one without a range; no sensor; nothing that is sought.
    """
    for option, given in (("seek", new.sought + new.optional), ("control", new.controls), ("sensor", new.sensors)):
        if not given:
            raise InputError(f"--{option}", found="nothing", expected="one at least", remedy=_for_example(option))
    if not new.controls[0].lower:
        raise InputError(
            f"--control {new.controls[0].name}",
            found="a trim without a range",
            expected="what the control may do in a trial that is designed",
            remedy=f"{_for_example('control')}; name the control that is driven first",
        )
    parts: tuple[Callable[[NewCampaign], list[str]], ...] = (
        *(_head, _vehicle, _structure, _priors, _sensors, _limits, _design, _goal, _estimation, _import),
    )
    return "\n\n".join("\n".join(part(new)) for part in parts if part(new)) + "\n"


@contextmanager
def told_by_options(option_of: Callable[[str], str]) -> Iterator[None]:
    """Name options in the errors of a file that they make and that nobody has seen yet: in place of its keys, and of remedies for these.

    Args:
        option_of: the option that a key of the file is written from, such as `--sensor u` of `sensors.u.noise`.
    """
    try:
        yield
    except InputError as error:
        place = _OF_FILE.fullmatch(error.where)
        if place is None:
            raise
        argument = place["rest"].removeprefix(": ").rpartition(", ")[2]
        key = f"{place['key']}.{argument}" if argument in EXAMPLES else place["key"] or ""
        key = f"term.{argument.removeprefix('term ')}" if argument.startswith("term ") else key
        option = option_of(key)
        flag, _, name = option.removeprefix("--").partition(" ")
        example = _for_example(flag.replace("-", "_"), name)
        remedy = example if _TOML.search(error.remedy) and example else error.remedy
        raise InputError(option, found=error.found, expected=error.expected, remedy=remedy) from None


_OF_FILE = re.compile(rf".*?{re.escape(FILE_NAME)}(?::\d+)?(?:, key (?P<key>[^\s:,]+))?(?P<rest>.*)", re.DOTALL)
_TOML = re.compile(r"\[\w|\w = |`|\btable\b")
"""What a remedy for a file has in it."""


def _for_example(option: str, name: str = "") -> str:
    """Return an option as it may be given, of a coefficient with its name; empty of one that has no example."""
    if option not in EXAMPLES:
        return ""
    said = f"{name} -4.5 to -1.5" if name and option in ("seek", "optional") else EXAMPLES[option]
    return f'for example --{option.replace("_", "-")} "{said}"'


def option_of(new: NewCampaign, key: str) -> str:
    """Return the option from which a key of the file is written, with the name that it has there: `--sensor u` of `sensors.u.noise`."""
    table, _, inner = key.partition(".")
    name, _, last = inner.partition(".")
    controls = [one.name for one in new.controls]
    if table == "vehicle":
        if name == "trim" and last not in ("", "u"):
            return f"--control {last}"
        if name == "fixed" and last:
            return f"--known {last}"
        of_body = {"trim": "speed", "catalogue": "vehicle", "fixed": "known"} | {one: one for one in EXAMPLES}
        return f"--{of_body.get(name, 'vehicle' if new.vehicle else 'mass').replace('_', '-')}"
    if table in ("prior", "term"):
        optional, known = [one.name for one in new.optional], [one for one, _ in new.known]
        return f"--{'optional' if name in optional else 'known' if name in known else 'seek'} {name}"
    if table == "limits":
        return f"--control {name}" if name in controls else f"--limit {name}"
    if table == "design":
        return f"--control {controls[0]}" if name in ("control", "trim", "amplitude", "ramp") else "--duration"
    named = {"sensors": f"--sensor {name}", "goal": f"--goal {last}", "structure": "--seek, --optional"}
    return named.get(table, "the options together").strip()


def _head(new: NewCampaign) -> list[str]:
    said = (
        "The numbers are an example: replace them with those of your vehicle."
        if new in (OWN, PUBLISHED)
        else "The numbers are the ones that you gave: correct those that have changed."
    )
    return [
        "# A campaign before there are any data: the vehicle, the limits of a trial, and the goal. A trial is designed from it.",
        f"# Next: seatrial prior DIR, seatrial design DIR, seatrial rehearse DIR. {said}",
        "# Quantities with a dimension are strings with a unit; plain numbers are SI in the coefficient's own unit.",
        "",
        "[campaign]",
        f"name = {_text(new.name)}",
        "seed = 1",
    ]


def _vehicle(new: NewCampaign) -> list[str]:
    trim = [f"u = {_text(new.speed)}"] * bool(new.speed)
    trim += [f"{one.name} = {_text(one.trim)}" for one in new.controls]
    trim = [] if new.vehicle.endswith(SURGE) else [f"trim = {{ {', '.join(trim)} }}"]
    moves = [f"moves = {_list(new.moves)}"] * bool(new.moves and (new.vehicle or new.moves != ("u",)))
    places = [one.name for one in new.sensors if one.name in POSITIONS]
    is_whole = moves or (new.vehicle and not new.vehicle.endswith(SURGE))
    moves += [f"positions = {_list(places)}"] * bool(places and is_whole)
    if new.vehicle:
        return [
            "# Other coefficients keep their published values. Those that are estimated without a prior in this file get a prior about the",
            "# published value; published_prior_sd is its sd. `seatrial vehicle NAME` shows the published values.",
            "[vehicle]",
            f"catalogue = {_text(new.vehicle)}",
            *moves,
            *(
                [f"published_prior_sd = {_text(new.published_prior_sd)}"]
                if any(not one.lower for one in _all(new))
                else []
            ),
            *trim,
        ]
    fixed = ", ".join(f"{name} = {value}" for name, value in new.known)
    return [
        "# Known values: mass in air, added mass (X_udot, below zero), thrust deduction (the share of thrust lost at the stern), and trim:",
        "# the speed at which a trial begins, and the controls that hold it. `seatrial vehicle` lists published vehicles.",
        "[vehicle]",
        f"name = {_text(new.name.partition(',')[0])}",
        f"mass = {_text(new.mass)}",
        *([f"inertia = {_list(new.inertia)}"] if new.inertia else []),
        *moves,
        *([f"thrust_deduction = {new.thrust_deduction}"] if new.thrust_deduction else []),
        *([f"fixed = {{ {fixed} }}"] if fixed else []),
        *trim,
    ]


def _structure(new: NewCampaign) -> list[str]:
    optional = [f"optional = {_list([one.name for one in new.optional])}"] * bool(new.optional)
    return [
        "# Terms: a coefficient's name is its equation. X_u multiplies u, X_uabsu u|u|, T_nabsn n|n| (n in rad/s), N_uudelta_r u, u and",
        "# delta_r in the moment of yaw. `always` are in every model; the data decide on those of `optional`.",
        "[structure]",
        f"always = {_list([one.name for one in new.sought])}",
        *optional,
    ]


def _priors(new: NewCampaign) -> list[str]:
    lines = [
        "# The range of plausible values of each coefficient. `seatrial prior` shows the speeds and times that the ranges allow together.",
        "# `unit` converts: thrust of a propeller is easier to state per revolution.",
    ]
    for one in _all(new):
        if one.lower:
            lines += [f"[prior.{one.name}]", 'distribution = "uniform"', f"lower = {_plain(one.lower)}"]
            lines += [f"upper = {_plain(one.upper)}", *([f"unit = {_text(one.unit)}"] if one.unit else []), ""]
    return lines[:-1] if len(lines) > 2 else []


def _sensors(new: NewCampaign) -> list[str]:
    lines = [
        "# Sensors: standard deviation of one sample, and the rate. `seatrial design DIR --sensors` compares others."
    ]
    for one in new.sensors:
        rate = [f"rate = {_text(one.rate)}"] * bool(one.rate)
        lines += [f"[sensors.{one.name}]", f"noise = {_text(one.noise)}", *rate, ""]
    return lines[:-1]


def _limits(new: NewCampaign) -> list[str]:
    lines = [
        "# Limits of a trial: each control and its rate of change, the lowest speed at which the vehicle can dive, the space."
    ]
    for name, bounds in [
        *((one.name, {"lower": one.lower, "upper": one.upper, "rate": one.rate}) for one in new.controls if one.lower),
        *((one.name, {"lower": one.lower, "upper": one.upper}) for one in new.limits),
    ]:
        lines += [f"[limits.{name}]", *(f"{key} = {_text(text)}" for key, text in bounds.items() if text), ""]
    return lines[:-1]


def _design(new: NewCampaign) -> list[str]:
    driven, whole = new.controls[0], quantity(new.duration, "s", "--duration")
    ahead = driven.name in PROPULSION
    families = ["repeated-doublet", "multistep-3211", "step" if ahead else "doublet"]
    low, high, ramp = _amplitudes(driven)
    return [
        "# Trials to compare: shapes of the input about trim, each with every amplitude and period. After `active` the control rests.",
        "[design]",
        f"control = {_text(driven.name)}",
        f"families = {_list(families)}",
        *([] if set(new.moves) <= {"u"} and ahead else ['utility = "fisher-d"']),
        *(["probability = 0.9"] if new.limits else []),
        *([f"trim = {_text(driven.trim)}"] if new.vehicle.endswith(SURGE) else []),
        f"duration = {_text(new.duration)}",
        f'active = "{0.75 * whole:.4g} s"',
        *([f'ramp = "{ramp:g} s"'] if ramp else []),
        'sample_time = "0.1 s"',
        f'amplitude = {{ from = "{low}", to = "{high}", points = 5 }}',
        f'period = {{ from = "{whole / 15:.3g} s", to = "{_round(0.53 * whole):g} s", points = 8 }}',
    ]


def _amplitudes(driven: Control) -> tuple[str, str, float]:
    """Least and largest amplitude, a quarter and three quarters of the room on the narrower side of trim, and the ramp they need, s."""
    unit, place = signal_unit(driven.name), f"--control {driven.name}"
    written = driven.lower.partition(" ")[2]
    trim, lower, upper = (quantity(text, unit, place) for text in (driven.trim, driven.lower, driven.upper))
    room = min(trim - lower, upper - trim)
    factor = to_si(1.0, written, unit, place)
    needed = 0.0 if not driven.rate else 1.5 * room / quantity(driven.rate, f"({unit})/s", place)
    low, high = (f"{share * room / factor:.3g} {written}" for share in (0.25, 0.75))
    return low, high, _next_round(needed)


def _next_round(value: float) -> float:
    """Return the next of …, 0.1, 0.2, 0.5, 1, 2, 5, … that is not below a positive value; 0 for 0."""
    if value <= 0:
        return 0.0
    decade = 10.0 ** floor(log10(value))
    return next(step * decade for step in (1, 2, 5, 10) if step * decade >= value * (1 - 1e-9))


def _round(value: float) -> float:
    return float(ceil(value)) if value >= 10 else value


def _goal(new: NewCampaign) -> list[str]:
    if not new.goal:
        return []
    wanted = ", ".join(f"{name} = {_text(text)}" for name, text in new.goal)
    return [
        "# How well each coefficient must be known. `seatrial rehearse DIR` says how many trials this needs.",
        "[goal]",
        f"sd = {{ {wanted} }}",
        f"trials = {new.trials}",
    ]


def _estimation(new: NewCampaign) -> list[str]:
    return ["# The log determines the initial state.", "[estimation]", 'initial = "estimated"']


def _import(new: NewCampaign) -> list[str]:
    names = dict.fromkeys([*(one.name for one in new.sensors), *(one.name for one in new.controls)])
    units = {one.name: one.trim.partition(" ")[2] for one in new.controls}
    units = {one.name: one.noise.partition(" ")[2] for one in new.sensors} | units
    return [
        "# After the trial: put its log into this folder, look at it with `seatrial inspect LOG --map`, and write its map here.",
        "# [import]",
        '# fit = ["1"]',
        "#",
        "# [[import.files]]",
        '# path = "log_{run}.csv"',
        '# time = { column = "time_s", unit = "s" }',
        *(f'# channels.{name} = {{ column = "{name.upper()} COLUMN", unit = "{units[name]}" }}' for name in names),
    ]


def _all(new: NewCampaign) -> tuple[Sought, ...]:
    return new.sought + new.optional


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _plain(number: str) -> str:
    return str(float(number))


def _list(values: Sequence[str]) -> str:
    return f"[{', '.join(map(_text, values))}]"
