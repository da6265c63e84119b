"""Which columns of a log may be which signals: guesses from types of message, names, units and ranges, each with its reason."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import pi

from seatrial.core.errors import InputError
from seatrial.core.record import Role
from seatrial.core.signals import (
    ANGLES,
    CONTROLS,
    OVER_EARTH,
    POSITIONS,
    QUATERNION,
    SIGNALS,
    SPECIFIC_FORCE,
    SPEED,
    signal_unit,
    thruster_controls,
)
from seatrial.core.units import to_si
from seatrial.logs.axes import Axes
from seatrial.logs.formats.protocol import MAX_ELEMENTS, TableInfo
from seatrial.logs.formats.text import TABLE
from seatrial.logs.formats.unit_in_name import name_and_units
from seatrial.logs.known_messages import (
    AUTOPILOT,
    RC_AXES,
    ROS,
    SIDES,
    message_and_field,
    output_number,
    rc_channel,
    thruster_number,
)
from seatrial.logs.source import Between
from seatrial.logs.summary import ColumnSummary, TableSummary

COMMAND = "command"  # Unit of a column that a law of thrust is for
_ASKED = "setpoint|reference|desired|target|manual|joy|teleop|cmd|command|path(?!finder)|waypoint|trajectory|goal"
# In the name of a table whose positions, angles and speeds are not those of the vehicle
_NOT_MEASURED = re.compile(f"{_ASKED}|innovation|variance|accel|gyro|mag|param|gain|pid", re.IGNORECASE)
_VELOCITIES = ("u", "v", "w", "p", "q", "r")
# In what stands above a z that may be a depth
_PLACE = re.compile(r"pos|nav|state|depth|odom|ned|local|point|rov|auv|vehicle|field|message")
_FIELD = re.compile(r"linear|angular")  # How the fields of a velocity begin in ROS
# In the last part of the name of a topic that has the type of a velocity, or holds its fields, and is something else
_NO_VELOCITY = re.compile(r"angle|euler|rpy|attitude|orientation|position|radian|degree", re.IGNORECASE)


@dataclass(frozen=True)
class Guess:
    """One line of a channel map that may be right.

    Attributes:
        channel: seatrial signal.
        table: of the log.
        column: of the table.
        unit: of the cells times `scale`.
        scale: factor on the cells.
        axes: of the message.
        role: whether the channel drives the vehicle or observes it.
        reason: why.
        strength: 3 by the type of message, 2 by a plain name, 1 by a name that may mean something else, 0 of an output that stands still
            after the last that moves: a thruster only of a vehicle that has as many.
        between: "line" of a control that looks measured; None for the usual.
    """

    channel: str
    table: str
    column: str
    unit: str
    scale: float
    axes: Axes
    role: Role
    reason: str
    strength: int
    between: Between | None = None


_ONLY_COLUMN_NAMES = ("value", "data")  # Names of the only column of a table
# Size of a full command in per cent, and the range of pulse widths, µs
_FULL_PER_CENT, _PULSE_RANGE = 100.0, (900.0, 2100.0)
# Size up to which numbers of a thruster in no stated unit may be newtons: beyond it they are as likely a speed of
# rotation
_LARGEST_FORCE = 500.0
_BODY = ("u", "v", "w")
MAX_SPEED = 25.0  # Speed beyond that of any vehicle, m/s
_MAX_UNIT_PART = 1.001  # Size up to which numbers may be parts of a unit quaternion
# What a name may have before the letter of a velocity
_VELOCITY_PREFIX = "(?:dvl|speed|vel|velocity|body|measured|meas|nu)_?"
_TWIST = "(?:(?:odom(?:etry)?|nav|state|body)[._])?(?:twist[._])*"  # What a flattened message has before its velocities
# What a velocity along x, y or z is called before that letter
_ALONG = f"(?:{_TWIST}linear[._](?:(?:velocity|vel)[._])?|velocity[._]?|vel_?|v_?)"
_AXES_UNKNOWN = re.compile(rf"(?:{_VELOCITY_PREFIX})?{_ALONG}[xyz]")
_SPEED = "(?:_?(?:speed|vel|velocity))?"
# What a rate of turn about x, y or z is called before that letter
_TURN = f"(?:imu_?)?(?:{_TWIST}angular[._](?:(?:velocity|vel|rate)[._])?|gyro?[_.]?|omega_?|[gw]_?)"
# What a flattened message has before its position and orientation
_POSE = "(?:(?:odom(?:etry)?|nav|state)[._])?(?:pose[._])*"
_COMMAND = "(?:cmd|command|commanded)"
_PROPELLER = "(?:prop|propeller|shaft|motor|thruster)(?:_?(?:rpm|speed|rate))?"
_NAMES = (
    ("v_north", 2, "v_?n(?:orth)?|vel(?:ocity)?[._]?n(?:orth)?|north_?(?:vel|velocity|speed)"),
    ("v_east", 2, "v_?e(?:ast)?|vel(?:ocity)?[._]?e(?:ast)?|east_?(?:vel|velocity|speed)"),
    ("v_down", 2, "v_?d(?:own)?|vel(?:ocity)?[._]?d(?:own)?|down_?(?:vel|velocity|speed)"),
    *((f"q_{part}", 2, rf"{_POSE}(?:orientation|quat(?:ernion)?)[._]?{part}|q_?{part}") for part in "wxyz"),
    ("u", 2, f"(?:{_VELOCITY_PREFIX})?(?:u|surge{_SPEED})"),
    (
        "u",
        1,
        f"speed|spd|(?:log|dvl)_?speed|speed_?(?:log|dvl)|(?:{_VELOCITY_PREFIX})?{_ALONG}x|speed_?over_?ground|sog",
    ),
    ("v", 2, f"(?:{_VELOCITY_PREFIX})?(?:v|sway{_SPEED})"),
    ("v", 1, f"(?:{_VELOCITY_PREFIX})?{_ALONG}y"),
    ("w", 2, f"(?:{_VELOCITY_PREFIX})?(?:w|heave{_SPEED})"),
    ("w", 1, f"(?:{_VELOCITY_PREFIX})?{_ALONG}z"),
    ("p", 2, f"p|roll_?rate|roll_?speed|{_TURN}x"),
    ("q", 2, f"q|pitch_?rate|pitch_?speed|{_TURN}y"),
    ("r", 2, f"r|yaw_?rate|yaw_?speed|turn_?rate|rate_?of_?turn|rot|{_TURN}z"),
    ("phi", 2, "phi|roll|roll_?angle"),
    ("theta", 2, "theta|pitch|pitch_?angle"),
    ("psi", 2, "psi|yaw|heading|hdg|yaw_?angle"),
    ("z", 2, "depth"),
    ("z", 1, f"z|{_POSE}position[._]z"),
    ("n", 2, f"n|(?:{_COMMAND}_)?(?:rpm|{_PROPELLER})(?:_{_COMMAND})?"),
    ("n", 1, "(?:main_?)?engine_?(?:rpm|speed)|(?:main_?)?engine"),
    ("delta_r", 2, "delta_?r|rudder|rudder_?angle|desired_rudder"),
    ("delta_r", 1, "delta"),
    ("delta_s", 2, "delta_?s|stern_?planes?|elevator|desired_elevator"),
    ("tau_X", 2, "tau_?x|surge_?force|force\\.x|fx"),
    ("tau_X", 1, "(?:(?:cmd|commanded)_?)?thrust(?:_?(?:cmd|command|commanded|force|x))?"),
    ("tau_Y", 2, "tau_?y|sway_?force|force\\.y|fy"),
    ("tau_Z", 2, "tau_?z|heave_?force|force\\.z|fz"),
    ("tau_K", 2, "tau_?k|roll_?moment|torque\\.x|mx"),
    ("tau_M", 2, "tau_?m|pitch_?moment|torque\\.y|my"),
    ("tau_N", 2, "tau_?n|yaw_?moment|torque\\.z|mz"),
)
_THRUSTER = re.compile(
    rf"(?:.*[./])?(?:(?:{_COMMAND}_)?(?:thruster|thr|motor)s?[_/.]?(?P<which>\d+|{SIDES})(?:[_/.]?(?:{_COMMAND}_)?(?P<what>thrust|force|speed))?"
    rf"(?:[_/.]?(?:{_COMMAND}|input))?|thrust_?(?P<of>\d+|{SIDES})(?:_?{_COMMAND})?)"
)
_SPELLING = {
    "RPM": "rpm",
    "knots": "kn",
    "degheading": "deg",
    "degrees": "deg",
    "radians": "rad",
    "Nm": "N*m",
    "knot": "kn",
}
# Units of a propeller's speed that count revolutions, not radians
_REVOLUTIONS = {
    **dict.fromkeys(("1/min", "min-1", "min^-1", "rev/min"), "rpm"),
    **dict.fromkeys(("1/s", "s-1", "s^-1"), "rev/s"),
}
_PATTERNS = tuple((channel, strength, re.compile(pattern)) for channel, strength, pattern in _NAMES)


def guesses(tables: Sequence[TableSummary]) -> tuple[Guess, ...]:
    """Guess the channel of every column whose type, name or unit says something, the strongest of each channel first."""
    names = frozenset(_full_name(table, column).lower() for table in tables for column in table.columns)
    guessed = [guess for table in tables if table.clock or len(tables) == 1 for guess in _of_table(table, names)]
    sizes = {table.info.name: table.rows for table in tables}
    order = [
        *SIGNALS,
        *POSITIONS,
        *OVER_EARTH,
        *QUATERNION,
        *SPECIFIC_FORCE,
        *thruster_controls(MAX_ELEMENTS, commanded_force=True),
        *thruster_controls(MAX_ELEMENTS, commanded_force=False),
    ]
    return tuple(sorted(guessed, key=lambda guess: (order.index(guess.channel), -guess.strength, -sizes[guess.table])))


def best(guessed: Sequence[Guess], only: Sequence[str] = ()) -> tuple[Guess, ...]:
    """Return one guess for each channel, or for each of some, which alone may be an output that stands still.

    Velocities over the earth, and quaternions, are there where what is made of them is wanted and nothing gives it itself.
    """
    wanted = set(only) or {guess.channel for guess in guessed if guess.strength} | {*_BODY, *ANGLES}
    if wanted & {*QUATERNION}:  # which is made of angles too
        wanted |= {*ANGLES}
    direct = {guess.channel for guess in guessed}
    for made_of, makes, needs in ((OVER_EARTH, _BODY, ANGLES), (QUATERNION, ANGLES, ())):
        wanted -= {*made_of}
        asked, given = wanted & {*makes}, direct & {*makes}
        if asked - given and (direct >= {*made_of} or (not given and direct & {*made_of})):
            wanted = wanted - given | {*made_of, *needs}
    outputs = Counter(map(_source, (guess for guess in guessed if guess.unit == COMMAND and guess.strength)))
    first: dict[str, Guess] = {}
    for guess in guessed:
        # The commands of all thrusters are in one message: that with most of them.
        if guess.channel in wanted and (guess.unit != COMMAND or _source(guess) == outputs.most_common(1)[0][0]):
            first.setdefault(guess.channel, guess)
    return tuple(first.values())


def _source(guess: Guess) -> tuple[str, str]:
    """Return the table that a guess is from, and the message, of which a table of text may have several."""
    if guess.column in _ONLY_COLUMN_NAMES:  # a topic for each thruster
        return re.sub(r"\d+", "", guess.table), ""
    return guess.table, message_and_field(guess.table, guess.column)[0]


def _named(table: TableInfo) -> str:
    """Return what tells the message of a table: its name, or of a text that holds one message its kind."""
    return table.kind if table.name == TABLE and table.kind else table.name


def remarks(guessed: Sequence[Guess], tables: Sequence[TableSummary]) -> tuple[str, ...]:
    """Return what needs more than a factor: the commands of thrusters, and those of axes."""
    commands, sticks = [guess for guess in best(guessed) if guess.unit == COMMAND], tuple(map(_sticks, tables))
    if not commands:
        return tuple(filter(None, sticks))
    first, last = commands[0], commands[-1]
    return (
        *filter(None, sticks),
        f"{first.table}: {first.column} to {last.column} may be pulse widths or outputs to the thrusters. Give the maker's table of thrust "
        f"over them under [vehicle.thrust_laws], for channels {first.channel} to {last.channel} in the unit "
        f'"{COMMAND}", or as the `curve` of a channel',
        *_still(guessed, first),
    )


def _sticks(table: TableSummary) -> str:
    """Name the columns that hold commands of axes, as a radio control sends them; empty if there are none."""
    numbers = {column.name: rc_channel(_named(table.info), table.info.kind, column.name) for column in table.columns}
    known = {name: number for name, number in numbers.items() if number is not None}
    first = 0 if 0 in known.values() else 1
    axes = ", ".join(
        f"{name} {RC_AXES[number - first]}" for name, number in known.items() if number - first < len(RC_AXES)
    )
    if not axes:
        return ""
    return (
        f"{table.info.name}: {axes} (the order of ArduSub) are commands of axes, not of thrusters. Give each thruster the sum that the "
        f'mixer of the autopilot gives, such as channels.f_1 = {{ sum = "…", unit = "{COMMAND}" }}, with an `offset` if pulse widths at '
        "rest differ from the neutral of its law"
    )


def _still(guessed: Sequence[Guess], first: Guess) -> Iterator[str]:
    """Name the outputs that stand still after the last that moves."""
    still = [guess for guess in guessed if _source(guess) == _source(first) and not guess.strength]
    if still:
        ends = ([guess.column for guess in still], [guess.channel for guess in still])
        names, channels = (" to ".join(dict.fromkeys((some[0], some[-1]))) for some in ends)
        yield f"{first.table}: {names} never change: map them too, as {channels}, if they are thrusters at rest"


def _full_name(table: TableSummary, column: ColumnSummary) -> str:
    """Return the name of a column, of the only one of a table that of the table."""
    return table.info.name if column.name in _ONLY_COLUMN_NAMES else column.name


def _of_table(table: TableSummary, names: Collection[str]) -> Iterator[Guess]:
    clocks = {clock.name for clock in table.clocks}
    candidates = []
    for column in table.columns:
        if column.name in clocks or column.name.endswith("log_time"):
            continue
        guess = (
            _by_type(table, column)
            or _by_output(table, column, names)
            or _by_thruster(table, column, names)
            or _of_quaternion(table, column)
        )
        message, _ = message_and_field(_named(table.info), column.name)
        if guess is None and not column.trouble and message not in AUTOPILOT:
            guess = _by_name(table, column)
        if guess is not None:
            candidates.append((guess, column))
    # Three parts of a quaternion may be constant where the vehicle only turns, all four where it is not known.
    turns = any(guess.channel in QUATERNION and not column.trouble for guess, column in candidates)
    # A thruster may stand still; outputs that do after the last that moves are mostly lights, cameras, or nothing.
    moving = {
        _source(guess): at
        for at, (guess, column) in enumerate(candidates)
        if guess.unit == COMMAND and not column.constant
    }
    for at, (guess, column) in enumerate(candidates):
        if guess.unit == COMMAND and moving:
            yield guess if at <= moving.get(_source(guess), -1) else replace(guess, strength=0)
        elif (guess.unit != COMMAND and not column.trouble) or (turns and guess.channel in QUATERNION):
            yield guess


def _by_type(table: TableSummary, column: ColumnSummary) -> Guess | None:
    info = table.info
    known = ROS.get(info.kind, {}).get(column.name)
    is_velocity = "Twist" in info.kind
    if (
        known is not None
        and is_velocity
        and (re.search(_ASKED, info.name, re.IGNORECASE) or _NO_VELOCITY.search(_last(info.name)))
    ):
        return None
    reason = f"{info.kind}: its axes are east, north, up and forward, left, up (REP 103)"
    if known is None:
        message, field = message_and_field(_named(info), column.name)
        known = AUTOPILOT.get(message, {}).get(field)
        reason = f"message {message} of an autopilot"
    if known is None:
        return None
    unit = known.unit or _text_unit(known.channel)
    role = _role(known.channel)
    return Guess(known.channel, info.name, column.name, unit, known.scale, known.axes, role, reason, known.strength)


def _last(name: str) -> str:
    """Return the last part of the name of a topic, or of what stands above a field."""
    return re.split(r"[ ./]", name.rstrip("/"))[-1]


def _by_output(table: TableSummary, column: ColumnSummary, names: Collection[str]) -> Guess | None:
    """Guess that outputs of an autopilot, or elements of an array of pulse widths, are the commands of thrusters, in their order."""
    if rc_channel(_named(table.info), table.info.kind, column.name) is not None or not column.count:
        return None
    number = output_number(_named(table.info), column.name, column.least, column.greatest)
    if number is not None and not _is_element(table, column):
        number = _from_one(number, column.name, names)
    if not number or number > MAX_ELEMENTS:
        return None
    reason = "pulse width or output; [vehicle.thrust_laws] converts it to thrust: check the order"
    return Guess(f"f_{number}", table.info.name, column.name, COMMAND, 1.0, "NED", "control", reason, 1)


def _from_one(number: int, name: str, names: Collection[str]) -> int:
    """Return the number of a thruster, from 1, by the number in its name; one of all names may have a 0 in its place."""
    first, zeros = re.subn(r"\d+(?=\D*$)", "0", name.lower())
    return number + (zeros > 0 and first in names)


def _by_thruster(table: TableSummary, column: ColumnSummary, names: Collection[str]) -> Guess | None:
    """Guess that a column that is called after one of several thrusters is its force, speed or command: by unit, name or range."""
    full = _full_name(table, column)
    bare, units = name_and_units(full.lower().replace(" ", "_"))
    match = _THRUSTER.fullmatch(bare)
    number = _from_one(thruster_number(match["which"] or match["of"]), full, names) if match else 0
    if match is None or not number or number > MAX_ELEMENTS or not column.count:
        return None
    what, is_stated = "thrust" if match["of"] else match["what"], bool(units or column.unit)
    for kind in "n" if what == "speed" else "fn" if what is None and is_stated else "f":
        if kind == "f" and not is_stated:
            known = _force_or_command(column, what is not None)
        else:
            known = _unit("n" if kind == "n" else f"f_{number}", column, units)
        if known is not None:
            reason = f'the name "{full}"; {known[2]}: check the order'
            return Guess(f"{kind}_{number}", table.info.name, column.name, *known[:2], "NED", "control", reason, 1)
    return None


def _force_or_command(column: ColumnSummary, is_force: bool) -> tuple[str, float, str] | None:
    """Return the unit, factor and reason for numbers of a thruster in no stated unit; None if they may be either."""
    ends = (column.least, column.greatest)
    size = max(map(abs, ends))
    if is_force:
        return "N", 1.0, "newtons by the name"
    if (
        size <= _MAX_UNIT_PART
        or size == _FULL_PER_CENT
        or _PULSE_RANGE[0] <= column.least <= column.greatest <= _PULSE_RANGE[1]
    ):
        return COMMAND, 1.0, "[vehicle.thrust_laws] makes thrust of it"
    if size > _LARGEST_FORCE or all(end.is_integer() for end in ends):
        return None
    return "N", 1.0, "newtons by its range: or per cent?"


def _by_name(table: TableSummary, column: ColumnSummary) -> Guess | None:
    """Guess by the last part of the column's name, or by the table's where the column is only `value`."""
    full = _full_name(table, column)
    if _is_element(table, column):  # what an array is called says nothing of one of its elements
        return None
    name = full.removesuffix("[0]").lower()
    name = re.sub(r"/(?![^\[(]*[\])])", ".", name).replace(" ", "_")
    head, dot, last = name.rpartition(".")
    name = f"{head}{dot}{last.removeprefix('nav_')}"
    bare, hinted = name_and_units(name)
    for candidate in dict.fromkeys((name, bare)):
        parts = candidate.split(".")
        for text in (".".join(parts[-2:]), parts[-1]):
            for channel, strength, pattern in _PATTERNS:
                within = " ".join((table.info.name, *parts[: -2 if text != parts[-1] else -1]))
                if pattern.fullmatch(text) and (_role(channel) == "control" or not _NOT_MEASURED.search(within)):
                    if channel in _VELOCITIES and _FIELD.match(text) and _NO_VELOCITY.search(_last(within)):
                        continue
                    if text == "z" and len(parts) > 1 and not _PLACE.search(parts[-2]):
                        continue
                    unit = _unit(channel, column, hinted if candidate == bare else ())
                    if unit is None or (len(text) == 1 and unit[0] == "cm/s" and not hinted and not column.unit):
                        continue  # one letter beyond any speed may be anything
                    if channel in QUATERNION and not _is_whole(table, column):
                        return _angle_of_three(table, column)
                    axes = "; its axes are not known: check its sign" if _AXES_UNKNOWN.fullmatch(text) else ""
                    reason = f'the name "{full}"; {unit[2]}{axes}'
                    return Guess(
                        channel, table.info.name, column.name, *unit[:2], "NED", _role(channel), reason, strength
                    )
    return None


def _is_whole(table: TableSummary, column: ColumnSummary, parts: str = "wxyz") -> bool:
    """Return whether a table has all parts of a quaternion, or of a vector, of which a column is one by the letter at its end."""
    names = {one.name.lower() for one in table.columns}
    return all(column.name.lower()[:-1] + part in names for part in parts)


def _angle_of_three(table: TableSummary, column: ColumnSummary) -> Guess | None:
    """Guess that x, y and z of an orientation without w are roll, pitch and yaw, where one of them is beyond a quaternion's numbers."""
    of = {column.name.lower()[:-1] + part: angle for part, angle in zip("xyz", ANGLES, strict=True)}
    three = [one for one in table.columns if one.name.lower() in of and one.count]
    size = max((max(abs(one.least), abs(one.greatest)) for one in three), default=0.0)
    channel = of.get(column.name.lower())
    if channel is None or not _is_whole(table, column, "xyz") or size <= _MAX_UNIT_PART:
        return None
    unit = "deg" if size > 2.1 * pi else "rad"
    reason = f'the name "{column.name}" of three; angles, since a number is beyond 1: check their order and their unit'
    return Guess(channel, table.info.name, column.name, unit, 1.0, "NED", "measurement", reason, 1)


def _is_element(table: TableSummary, column: ColumnSummary) -> bool:
    """Return whether a column is one of several elements of an array."""
    return len(table.info.elements(column.name)) > 1


def _of_quaternion(table: TableSummary, column: ColumnSummary) -> Guess | None:
    """Guess that four elements of an array that is called like one are a quaternion, the scalar part first."""
    elements = table.info.elements(column.name)
    array = column.name.rpartition("[")[0].lower()
    is_one = len(elements) == len(QUATERNION) and re.fullmatch(r"(?:.*[./_])?(?:q|quat(?:ernion)?|attitude)", array)
    if not is_one or _NOT_MEASURED.search(f"{_named(table.info)} {array}"):
        return None
    if not (column.count and -_MAX_UNIT_PART <= column.least <= column.greatest <= _MAX_UNIT_PART):
        return None
    channel = QUATERNION[elements.index(column.name)]
    reason = f'the name "{column.name}" of four; a quaternion, the scalar part first: check their order, and `axes`'
    return Guess(channel, table.info.name, column.name, "1", 1.0, "NED", "measurement", reason, 1)


def unit_by_name(column: str, channel: str) -> tuple[str, float] | None:
    """Return the unit that the name of a column ends with and the factor to it; None if it ends with none of the channel's kind."""
    units = name_and_units(column.lower().replace(" ", "_")).units
    return next(filter(None, (known_unit(unit, channel) for unit in units)), None)


def known_unit(unit: str, channel: str) -> tuple[str, float] | None:
    """Return the unit that seatrial knows and the factor to it, None if it has another dimension."""
    unit = _SPELLING.get(unit, unit)
    if channel == "n":
        unit = _REVOLUTIONS.get(unit.lower(), unit)
    for text, scale in (
        (unit, 1.0),
        *(((unit[1:], factor),) if (factor := {"c": 1e-2, "m": 1e-3, "d": 1e-1}.get(unit[:1])) else ()),
    ):
        try:
            to_si(1.0, text, signal_unit(channel), channel)
        except InputError:
            continue
        return text, scale
    return None


def _unit(channel: str, column: ColumnSummary, hinted: Sequence[str]) -> tuple[str, float, str] | None:
    """Return the unit, factor and where they are from; None if the stated unit is one of something else."""
    stated = () if column.unit is None else (column.unit,)
    for units, source in ((stated, "the log states its unit"), (hinted, "its unit by the name")):
        if units:
            fitting = next(filter(None, (known_unit(unit, channel) for unit in units)), None)
            return None if fitting is None else (*fitting, source)
    size = max(abs(column.least), abs(column.greatest))
    if channel in ("phi", "theta", "psi", "delta_r", "delta_s"):
        return ("deg", 1.0, "degrees by its range") if size > 2.1 * pi else ("rad", 1.0, "radians by its range")
    if channel in ("p", "q", "r"):
        return ("deg/s", 1.0, "degrees by its range") if size > 2 * pi else ("rad/s", 1.0, "radians by its range")
    if channel == "n":
        is_named = "rpm" in column.name.lower()
        unit = "rpm" if is_named or size > 60 else "rev/s"
        return unit, 1.0, "its unit by the name" if is_named else "its unit by its range"
    if signal_unit(channel) == str(SPEED) and size > MAX_SPEED:
        return "cm/s", 1.0, f"centimetres by its range, as {size:.3g} m/s is too fast for a vehicle: or mm/s, km/h, kn?"
    return _text_unit(channel), 1.0, "unknown unit: SI"


def _text_unit(channel: str) -> str:
    """Return the SI unit as a map spells it."""
    return {"kg m/s^2": "N", "kg m^2/s^2": "N*m"}.get(signal_unit(channel), signal_unit(channel))


def _role(channel: str) -> Role:
    return "control" if channel in CONTROLS else "measurement"
