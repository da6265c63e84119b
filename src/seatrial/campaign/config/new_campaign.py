"""A campaign before there are any data: what is known, sought, measured and allowed, each said in one line.

`n 1200 rpm, 700 to 1600 rpm, 800 rpm/s` is a control with its trim, range and rate,
`X_u -3 to 0 kg/s` a coefficient with the least and the largest value that would not surprise, `u 0.05 m/s, 5 Hz` a sensor.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import ANGLES, CONTROLS, RATES, TRACKS, is_signal, is_thruster, signal_unit
from seatrial.core.units import quantity, to_si

Part = TypeVar("Part")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER})\s+to\s+({_NUMBER})\s*(.*)")


@dataclass(frozen=True)
class Sought:
    """A coefficient that is sought.

    Attributes:
        name: of it.
        lower: least value that would not surprise, as written; empty where a published value is believed.
        upper: largest such value.
        unit: of both; empty for SI.
    """

    name: str
    lower: str = ""
    upper: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Control:
    """A control, by quantities as written: its trim, and its range and rate of change, empty where nothing is said."""

    name: str
    trim: str
    lower: str = ""
    upper: str = ""
    rate: str = ""


@dataclass(frozen=True)
class Bound:
    """A limit of the motion, by quantities as written."""

    name: str
    lower: str = ""
    upper: str = ""


@dataclass(frozen=True)
class Measured:
    """A sensor, by quantities as written: standard deviation of one sample, and rate, empty for one in each step."""

    name: str
    noise: str
    rate: str = ""


@dataclass(frozen=True)
class NewCampaign:
    """What a campaign without data begins from; quantities as written, such as "30 kg".

    Attributes:
        name: in headings.
        sought: coefficients that any model has.
        controls: the first is the one whose trial is designed, the others are held at trim.
        sensors: what will be measured.
        optional: coefficients whose presence the data are to decide.
        vehicle: name in the catalogue; empty for one by hand.
        mass: of one by hand.
        inertia: about its three axes, where it turns.
        moves: velocities that are modelled; none for surge alone, or for all that is published.
        known: coefficients that are not in doubt, SI, as written.
        thrust_deduction: share of the thrust that the stern takes back, as written.
        published_prior_sd: how well published coefficients are believed, as a share of each.
        speed: at which a trial begins; empty for that of the catalogue.
        limits: of the motion.
        duration: of a trial.
        goal: standard deviation wanted of some coefficients.
        trials: most of them.
    """

    name: str
    sought: tuple[Sought, ...]
    controls: tuple[Control, ...]
    sensors: tuple[Measured, ...]
    optional: tuple[Sought, ...] = ()
    vehicle: str = ""
    mass: str = ""
    inertia: tuple[str, ...] = ()
    moves: tuple[str, ...] = ()
    known: tuple[tuple[str, str], ...] = ()
    thrust_deduction: str = ""
    published_prior_sd: str = "30 %"
    speed: str = ""
    limits: tuple[Bound, ...] = ()
    duration: str = "60 s"
    goal: tuple[tuple[str, str], ...] = ()
    trials: int = 4


OWN = NewCampaign(
    "my vehicle, first trial",
    (Sought("X_uabsu", "-4.5", "-1.5"), Sought("T_nabsn", "0.018", "0.034", "N/(rev/s)^2")),
    (Control("n", "1200 rpm", "700 rpm", "1600 rpm", "800 rpm/s"),),
    (Measured("u", "0.05 m/s", "5 Hz"),),
    optional=(Sought("X_u", "-3.0", "0.0"),),
    mass="30 kg",
    known=(("X_udot", "-1.0"),),
    thrust_deduction="0.1",
    speed="1.5 m/s",
    limits=(Bound("u", lower="0.5 m/s"), Bound("distance", upper="150 m")),
    goal=(("X_uabsu", "3 %"),),
)
"""A small torpedo by hand, in surge."""
PUBLISHED = NewCampaign(
    "REMUS 100, sway and yaw, first trial",
    tuple(map(Sought, ("Y_uv", "Y_uudelta_r", "N_uv", "N_ur", "N_uudelta_r"))),
    (Control("delta_r", "0 deg", "-15 deg", "15 deg", "30 deg/s"), Control("n", "1194 rpm")),
    (Measured("r", "0.3 deg/s", "10 Hz"), Measured("v", "0.02 m/s", "2 Hz")),
    vehicle="remus100_hall_anstee",
    moves=("u", "v", "r"),
    speed="1.54 m/s",
    limits=(Bound("u", lower="0.8 m/s"),),
)
"""A published vehicle in sway and yaw."""


def new_campaign(said: Mapping[str, Any]) -> NewCampaign:
    """Read a campaign from what was said by options, by answers or in a form.

    Args:
        said: by option of `seatrial init`, with `_` for `-`: a text, or the lines of an option that may be given again.

    Raises:
        InputError: an option that cannot be read, both or neither of a published vehicle and one's own, a thruster of one's own, or
            a name that is given twice.
    """
    if ("vehicle" in said) == ("mass" in said):
        raise InputError(
            "--vehicle, --mass",
            found="both" if "vehicle" in said else "neither",
            expected="a published vehicle, or the mass of your own",
            remedy='for example --mass "30 kg"; `seatrial vehicle` lists what is published',
        )

    def each(option: str, read: Callable[[str, str], Part]) -> tuple[Part, ...]:
        return tuple(read(text, f"--{option}") for text in said.get(option, ()))

    for option, unit in SCALARS.items():
        if option in said:
            quantity(said[option], unit, f"--{option.replace('_', '-')}")
    controls = each("control", read_control)
    if "vehicle" not in said:
        _check_no_thruster(controls)
    deduction, sought = said.get("thrust_deduction", ""), partial(read_sought, is_published="vehicle" in said)
    share = quantity(deduction, "1", "--thrust-deduction") if deduction else 0.0
    new = NewCampaign(
        said.get("name") or f"{said.get('vehicle') or 'my vehicle'}, first trial",
        each("seek", sought),
        controls,
        each("sensor", read_sensor),
        each("optional", sought),
        vehicle=said.get("vehicle", ""),
        mass=said.get("mass", ""),
        inertia=read_inertia(said["inertia"], "--inertia") if "inertia" in said else (),
        moves=read_moves(said["moves"], "--moves") if "moves" in said else (),
        known=each("known", read_known),
        thrust_deduction=f"{share:g}" if share else "",
        speed=said.get("speed", ""),
        limits=each("limit", read_limit),
        duration=said.get("duration", NewCampaign.duration),
        goal=each("goal", read_goal),
    )
    _check_once(new)
    if not new.vehicle:
        _check_driven(new)
    return new


def _check_once(new: NewCampaign) -> None:
    """Refuse a name that is said twice."""
    controls = [("control", one.name) for one in new.controls]
    terms = [("seek", one.name) for one in new.sought] + [("optional", one.name) for one in new.optional]
    limits = [("control", one.name) for one in new.controls if one.lower] + [("limit", one.name) for one in new.limits]
    sensors, goals = [("sensor", one.name) for one in new.sensors], [("goal", name) for name, _ in new.goal]
    groups = [*terms, *(("known", name) for name, _ in new.known)], controls, limits, sensors, goals
    for group in groups:
        first: dict[str, str] = {}
        for option, name in group:
            if name in first:
                raise InputError(
                    f"--{option} {name}",
                    found=f"{name} again, beside --{first[name]} {name}",
                    expected="each once",
                    remedy="leave one of them out",
                )
            first[name] = option


def _check_driven(new: NewCampaign) -> None:
    """Refuse a control of one's own vehicle that no term has: it would move nothing."""
    terms = [one.name for one in new.sought + new.optional] + [name for name, _ in new.known]
    driving = {signal for term in terms for signal in CoefficientName.parse(term).signals}
    for one in new.controls:
        if one.name not in driving:
            force = f'--known "{one.name[-1]}_{one.name} 1"'
            raise InputError(
                f"--control {one.name}",
                found=f"a control that no term has: {', '.join(terms) or 'there is none'}",
                expected=f"a term with {one.name}, which says how it moves the vehicle",
                remedy=f"for example {_DRIVING.get(one.name, force)}",
            )


_DRIVING = {
    "n": '--seek "T_nabsn 0.02 to 0.06 N/(rev/s)^2"',
    "delta_r": '--seek "N_uudelta_r -10 to 0"',
    "delta_s": '--seek "M_uudelta_s -10 to 0"',
}
"""An example of the option that lets each control move the vehicle; the forces and moments are known to be what they are."""


def _check_no_thruster(controls: tuple[Control, ...]) -> None:
    """Refuse thrusters of one's own vehicle, whose places the options do not say."""
    for one in controls:
        if is_thruster(one.name):
            raise InputError(
                f"--control {one.name}",
                found="a thruster of a vehicle of your own",
                expected="one of " + ", ".join(CONTROLS),
                remedy="describe each thruster, its place and direction, under [[vehicle.thrusters]] of a campaign file "
                "(docs/how-to/ros2_bag.md has an example); or name a published vehicle that has thrusters",
            )


EXAMPLES = {
    "vehicle": "remus100_hall_anstee",
    "mass": "30 kg",
    "inertia": "0.2, 3.4, 3.4 kg m^2",
    "moves": "u,v,r",
    "thrust_deduction": "0.1",
    "speed": "1.5 m/s",
    "duration": "60 s",
    "seek": "X_uabsu -4.5 to -1.5 kg/m",
    "optional": "X_u -3 to 0 kg/s",
    "known": "X_udot -1.0",
    "control": "n 1200 rpm, 700 to 1600 rpm, 800 rpm/s",
    "sensor": "u 0.05 m/s, 5 Hz",
    "limit": "u above 0.5 m/s",
    "goal": "X_uabsu 3 %",
}
"""Options, each with what may be said by it."""
SCALARS = {"mass": "kg", "thrust_deduction": "1", "speed": "m/s", "duration": "s"}
"""Options that are one quantity, and their units."""


# One part of a campaign from a line.


def read_sought(text: str, place: str, is_published: bool = True) -> Sought:
    """Read a coefficient: `X_u -3 to 0 kg/s`, or `X_u` alone of a published vehicle; a unit that is left out is SI.

    Raises:
        InputError: no name of a coefficient, no range, or a unit of another kind.
    """
    name, rest = _parted(text, place, "X_uabsu -4.5 to -1.5 kg/m")
    unit = CoefficientName.parse(name).unit
    if not rest and is_published:
        return Sought(name)
    lower, upper, written = _range(rest, place, f"{name} -4.5 to -1.5 {unit}")
    if written:
        to_si(1.0, written, unit, place)
    _check_rising(float(lower), float(upper), rest, place)
    return Sought(name, lower, upper, written)


def read_known(text: str, place: str) -> tuple[str, str]:
    """Read a coefficient that is not in doubt: `X_udot -1.0`, SI.

    Raises:
        InputError: no name of a coefficient, or no number.
    """
    name, rest = _parted(text, place, "X_udot -1.0")
    unit = CoefficientName.parse(name).unit
    if not re.fullmatch(_NUMBER, rest):
        raise InputError(
            place, found=f'"{text}"', expected=f"a name and a number in {unit}", remedy=f'for example "{name} -1.0"'
        )
    return name, str(float(rest))


def read_control(text: str, place: str) -> Control:
    """Read a control: `n 1200 rpm`, its trim, or `n 1200 rpm, 700 to 1600 rpm, 800 rpm/s`, with its range and rate of change.

    Raises:
        InputError: no control, units that are not its, or a trim outside the range.
    """
    example = "n 1200 rpm, 700 to 1600 rpm, 800 rpm/s"
    name, rest = _parted(text, place, example)
    if name not in CONTROLS and not is_thruster(name):
        raise InputError(
            place,
            found=f'"{name}"',
            expected=f"a control: {', '.join(CONTROLS)}, or a thruster of a published vehicle, f_1, f_2, …",
            remedy=nearest(name, CONTROLS),
        )
    unit = signal_unit(name)
    trim, *more = _pieces(rest, place, example, most=3)
    value = quantity(trim, unit, place)
    if not more:
        return Control(name, trim)
    lower, upper, written = _range(more[0], place, example)
    low, high = quantity(f"{lower} {written}", unit, place), quantity(f"{upper} {written}", unit, place)
    _check_rising(low, high, more[0], place)
    if not low < value < high:
        raise InputError(
            place,
            found=f"trim {trim} with a range of {more[0]}",
            expected="a trim inside the range, with room on both sides",
            remedy="the trim is where the control stands before the trial, at the speed at which it begins",
        )
    if len(more) > 1 and not quantity(more[1], f"({unit})/s", place) > 0:
        raise InputError(place, found=more[1], expected="a rate above 0", remedy="leave it out where it is not known")
    return Control(name, trim, f"{lower} {written}", f"{upper} {written}", *more[1:])


def read_sensor(text: str, place: str) -> Measured:
    """Read a sensor: `u 0.05 m/s`, the standard deviation of one sample, or `u 0.05 m/s, 5 Hz`, with its rate.

    Raises:
        InputError: no signal, units that are not its, or numbers that are not positive.
    """
    example = "u 0.05 m/s, 5 Hz"
    name, rest = _parted(text, place, example)
    unit = _unit_of(name, place)
    pieces = _pieces(rest, place, example, most=2)
    for piece, its in zip(pieces, (unit, "1/s"), strict=False):
        if not quantity(piece, its, place) > 0:
            raise InputError(place, found=piece, expected="more than 0", remedy=f'for example "{example}"')
    return Measured(name, *pieces)


def read_limit(text: str, place: str) -> Bound:
    """Read a limit of the motion: `u above 0.5 m/s`, `distance below 150 m`, or `q -5 to 5 deg/s`.

    Raises:
        InputError: nothing that can be limited, or units that are not its.
    """
    example = "u above 0.5 m/s"
    name, rest = _parted(text, place, example)
    unit = _unit_of(name, place)
    word, _, amount = rest.partition(" ")
    if word in ("above", "below"):
        quantity(amount.strip(), unit, place)
        return Bound(name, **{"lower" if word == "above" else "upper": amount.strip()})
    lower, upper, written = _range(rest, place, "u above 0.5 m/s, distance below 150 m or q -5 to 5 deg/s")
    low, high = quantity(f"{lower} {written}", unit, place), quantity(f"{upper} {written}", unit, place)
    _check_rising(low, high, rest, place)
    return Bound(name, f"{lower} {written}", f"{upper} {written}")


def read_moves(text: str, place: str) -> tuple[str, ...]:
    """Read the velocities of a model: `u` or `u,v,r`.

    Raises:
        InputError: none, or something else than a velocity.
    """
    names = tuple(listed_names(text))
    for name in names or ("",):
        if name not in RATES:
            raise InputError(
                place,
                found=f'"{name or text}"',
                expected=f"velocities of the model, parted by commas: some of {', '.join(RATES)}",
                remedy='for example "u", or "u,v,r"',
            )
    return names


def read_inertia(text: str, place: str) -> tuple[str, ...]:
    """Read three moments of inertia, parted by commas: `0.2, 3.4, 3.4 kg m^2`; a unit at the end alone is that of all.

    Raises:
        InputError: not three, or units that are not theirs.
    """
    parts = listed_names(text)
    if len(parts) != len(RATES[3:]):
        raise InputError(
            place,
            found=f'"{text}"',
            expected="three moments of inertia, about the axes forward, to starboard and down",
            remedy='for example "0.2, 3.4, 3.4 kg m^2"',
        )
    unit = parts[-1].partition(" ")[2]
    found = tuple(part if " " in part else f"{part} {unit}".strip() for part in parts)
    for one in found:
        quantity(one, "kg m^2", place)
    return found


def read_goal(text: str, place: str, among: Sequence[str] = ()) -> tuple[str, str]:
    """Read how well a coefficient is to be known: `X_uabsu 3 %`, or a standard deviation in its unit.

    Args:
        text: that says it.
        place: for the error.
        among: coefficients that are sought; any where none is named.

    Raises:
        InputError: no name of a coefficient, none that is sought, or no positive amount.
    """
    name, rest = _parted(text, place, "X_uabsu 3 %")
    unit = CoefficientName.parse(name).unit
    if among and name not in among:
        raise InputError(
            place,
            found=f"{name}, which is not sought",
            expected="one of " + ", ".join(among),
            remedy=nearest(name, among),
        )
    if not quantity(rest, "1" if rest.endswith("%") else unit, place) > 0:
        raise InputError(place, found=f'"{text}"', expected="more than 0", remedy='for example "X_uabsu 3 %"')
    return name, rest


def listed_names(text: str) -> list[str]:
    """Return names parted by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _parted(text: str, place: str, example: str) -> tuple[str, str]:
    name, _, rest = text.strip().partition(" ")
    if not name:
        raise InputError(place, found="nothing", expected="a name and what is known of it", remedy=f'write "{example}"')
    return name, rest.strip()


def _unit_of(name: str, place: str) -> str:
    if not is_signal(name):
        raise InputError(
            place, found=f'"{name}"', expected="a signal or control", remedy=nearest(name, (*RATES, *ANGLES, *TRACKS))
        )
    return signal_unit(name)


def _pieces(rest: str, place: str, example: str, most: int) -> list[str]:
    pieces = [piece.strip() for piece in rest.split(",")]
    if not all(pieces) or len(pieces) > most:
        raise InputError(
            place,
            found=f'"{rest}"',
            expected=f"one to {most} quantities, parted by commas",
            remedy=f'for example "{example}", with decimal points',
        )
    return pieces


def _range(text: str, place: str, example: str) -> tuple[str, str, str]:
    if (match := _RANGE.fullmatch(text.strip())) is None:
        raise InputError(
            place, found=f'"{text}"', expected="a range such as 700 to 1600 rpm", remedy=f'for example "{example}"'
        )
    return match[1], match[2], match[3].strip()


def _check_rising(low: float, high: float, found: str, place: str) -> None:
    if not low < high:
        raise InputError(
            place, found=f'"{found}"', expected="the lower number first, below the other", remedy="change them round"
        )
