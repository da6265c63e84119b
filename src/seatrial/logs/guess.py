"""Which columns of a log may be which signals: guesses from types of message, names, units and ranges, each with its reason.

What needs more than a factor (pulse widths of thrusters) is named, not mapped.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

from seatrial.core.errors import InputError
from seatrial.core.record import Role
from seatrial.core.signals import (
    ANGLES,
    OVER_EARTH,
    POSITIONS,
    QUATERNION,
    SIGNALS,
    SPECIFIC_FORCE,
    signal_unit,
    thruster_controls,
)
from seatrial.core.units import to_si
from seatrial.logs.axes import Axes
from seatrial.logs.formats.protocol import MOST_ELEMENTS
from seatrial.logs.summary import ColumnSummary, TableSummary

# Types of message whose columns are known: of ROS, in east, north, up with body axes forward, left, up (REP 103), and
# of ArduPilot.


class Known(NamedTuple):
    """What a column of a known type holds: channel, its unit and the factor on its numbers, and the axes of the message."""

    channel: str
    unit: str | None
    axes: Axes
    scale: float = 1.0


def _ros(prefix: str, names: dict[str, str]) -> dict[str, Known]:
    return {prefix + name: Known(channel, None, "ENU") for name, channel in names.items()}


_TWIST = {"linear.x": "u", "linear.y": "v", "linear.z": "w", "angular.x": "p", "angular.y": "q", "angular.z": "r"}
_WRENCH = {
    "force.x": "tau_X",
    "force.y": "tau_Y",
    "force.z": "tau_Z",
    "torque.x": "tau_K",
    "torque.y": "tau_M",
    "torque.z": "tau_N",
}
_TURN = {f"orientation.{part}": name for part, name in zip("wxyz", QUATERNION, strict=True)}
_POSE = _TURN | {"position.x": "y", "position.y": "x", "position.z": "z"}
_IMU = (
    _TURN
    | {f"angular_velocity.{axis}": rate for axis, rate in zip("xyz", "pqr", strict=True)}
    | {f"linear_acceleration.{axis}": f"a_{axis}" for axis in "xyz"}
)
ROS: dict[str, dict[str, Known]] = {
    "nav_msgs/msg/Odometry": _ros("twist.twist.", _TWIST) | _ros("pose.pose.", _POSE),
    "geometry_msgs/msg/TwistWithCovarianceStamped": _ros("twist.twist.", _TWIST),
    "geometry_msgs/msg/TwistStamped": _ros("twist.", _TWIST),
    "geometry_msgs/msg/Twist": _ros("", _TWIST),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _ros("pose.pose.", _POSE),
    "geometry_msgs/msg/PoseStamped": _ros("pose.", _POSE),
    "geometry_msgs/msg/Pose": _ros("", _POSE),
    "sensor_msgs/msg/Imu": _ros("", _IMU),
    "geometry_msgs/msg/WrenchStamped": _ros("wrench.", _WRENCH),
    "geometry_msgs/msg/Wrench": _ros("", _WRENCH),
}
"""For each type of message its columns."""


def _autopilot(columns: dict[str, str], unit: str, scale: float = 1.0) -> dict[str, Known]:
    return {name: Known(channel, unit, "NED", scale) for name, channel in columns.items()}


_VELOCITIES = dict(zip(("VN", "VE", "VD"), OVER_EARTH, strict=True))
_SMALL = dict(zip(("vx", "vy", "vz"), OVER_EARTH, strict=True))
_QUATERNION = dict(zip(("q1", "q2", "q3", "q4"), QUATERNION, strict=True))
AUTOPILOT: dict[str, dict[str, Known]] = {
    "ATT": _autopilot({"Roll": "phi", "Pitch": "theta", "Yaw": "psi"}, "deg"),
    "IMU": _autopilot({"GyrX": "p", "GyrY": "q", "GyrZ": "r"}, "rad/s"),
    "XKF1": _autopilot(_VELOCITIES, "m/s"),
    "NKF1": _autopilot(_VELOCITIES, "m/s"),
    "ATTITUDE": _autopilot({"roll": "phi", "pitch": "theta", "yaw": "psi"}, "rad")
    | _autopilot({"rollspeed": "p", "pitchspeed": "q", "yawspeed": "r"}, "rad/s"),
    "ATTITUDE_QUATERNION": _autopilot(_QUATERNION, "1")
    | _autopilot({"rollspeed": "p", "pitchspeed": "q", "yawspeed": "r"}, "rad/s"),
    "LOCAL_POSITION_NED": _autopilot(_SMALL, "m/s") | _autopilot({"x": "x", "y": "y", "z": "z"}, "m"),
    "GLOBAL_POSITION_INT": _autopilot(_SMALL, "m/s", 0.01),
}
"""For each type of message of ArduPilot and MAVLink, whose axes are seatrial's, its columns."""

REMARKS = (
    (
        re.compile(r"(?:RCOU|SERVO_OUTPUT_RAW|RCO2)\b"),
        re.compile(r"C\d+|servo\d+_raw"),
        "pulse widths of the outputs: give the maker's table of thrust over pulse width as the `curve` of a channel, or under "
        '[vehicle.thrust_laws] for channels f_1, f_2, … in the unit "command"',
    ),
)
"""Tables and columns that need more than a factor."""
_PULSES = (900.0, 1500.0, 2100.0)


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
        strength: 3 by the type of message, 2 by a plain name, 1 by a name that may mean something else.
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


_BODY = ("u", "v", "w")
_OF = "(?:dvl|speed|vel|velocity|body|measured|meas|nu)_?"
"""What a name may have before the letter of a velocity."""
_NAMES = (
    ("v_north", 2, "v_?n(?:orth)?|vel(?:ocity)?[._]?n(?:orth)?|north_?(?:vel|velocity|speed)"),
    ("v_east", 2, "v_?e(?:ast)?|vel(?:ocity)?[._]?e(?:ast)?|east_?(?:vel|velocity|speed)"),
    ("v_down", 2, "v_?d(?:own)?|vel(?:ocity)?[._]?d(?:own)?|down_?(?:vel|velocity|speed)"),
    *((f"q_{part}", 2, rf"(?:orientation|quat(?:ernion)?)[._]?{part}|q_?{part}") for part in "wxyz"),
    ("u", 2, f"(?:{_OF})?u|surge|surge_?(?:speed|vel|velocity)"),
    ("u", 1, "speed|spd|velocity\\.x|vel_?x|vx|speed_?over_?ground|sog"),
    ("v", 2, f"(?:{_OF})?v|sway|sway_?(?:speed|vel|velocity)"),
    ("v", 1, "velocity\\.y|vel_?y|vy"),
    ("w", 2, f"(?:{_OF})?w|heave|heave_?(?:speed|vel|velocity)"),
    ("w", 1, "velocity\\.z|vel_?z|vz"),
    ("p", 2, "p|roll_?rate|roll_?speed|angular_velocity\\.x|gyro?_?x"),
    ("q", 2, "q|pitch_?rate|pitch_?speed|angular_velocity\\.y|gyro?_?y"),
    ("r", 2, "r|yaw_?rate|yaw_?speed|turn_?rate|rate_?of_?turn|rot|angular_velocity\\.z|gyro?_?z"),
    ("phi", 2, "phi|roll|roll_?angle"),
    ("theta", 2, "theta|pitch|pitch_?angle"),
    ("psi", 2, "psi|yaw|heading|hdg|yaw_?angle"),
    ("z", 2, "depth|depth_?m"),
    ("z", 1, "z|position\\.z"),
    ("n", 2, "n|rpm|(?:prop|propeller|shaft|motor|thruster)(?:_?(?:rpm|speed|rate))?"),
    ("delta_r", 2, "delta_?r|rudder|rudder_?angle|desired_rudder"),
    ("delta_r", 1, "delta"),
    ("delta_s", 2, "delta_?s|stern_?planes?|elevator|desired_elevator"),
    ("tau_X", 2, "tau_?x|surge_?force|force\\.x|fx"),
    ("tau_Y", 2, "tau_?y|sway_?force|force\\.y|fy"),
    ("tau_Z", 2, "tau_?z|heave_?force|force\\.z|fz"),
    ("tau_K", 2, "tau_?k|roll_?moment|torque\\.x|mx"),
    ("tau_M", 2, "tau_?m|pitch_?moment|torque\\.y|my"),
    ("tau_N", 2, "tau_?n|yaw_?moment|torque\\.z|mz"),
)
_SUFFIXES = {
    "deg_s": "deg/s",
    "degps": "deg/s",
    "dps": "deg/s",
    "rad_s": "rad/s",
    "radps": "rad/s",
    "deg": "deg",
    "rad": "rad",
    "rpm": "rpm",
    "rps": "rev/s",
    "mps": "m/s",
    "m_s": "m/s",
    "ms": "m/s",
    "kn": "kn",
    "knots": "kn",
    "kts": "kn",
    "newton": "N",
    "n": "N",
    "nm": "N*m",
}
_SPELLING = {
    "RPM": "rpm",
    "knots": "kn",
    "degheading": "deg",
    "degrees": "deg",
    "radians": "rad",
    "Nm": "N*m",
    "knot": "kn",
}
_PATTERNS = tuple((channel, strength, re.compile(pattern)) for channel, strength, pattern in _NAMES)


def guesses(tables: Sequence[TableSummary]) -> tuple[Guess, ...]:
    """Guess the channel of every column whose type, name or unit says something, the strongest of each channel first."""
    found = [guess for table in tables if table.clock for guess in _of_table(table)]
    sizes = {table.info.name: table.rows for table in tables}
    order = [
        *SIGNALS,
        *POSITIONS,
        *OVER_EARTH,
        *QUATERNION,
        *SPECIFIC_FORCE,
        *thruster_controls(MOST_ELEMENTS, commanded_force=True),
    ]
    return tuple(sorted(found, key=lambda guess: (order.index(guess.channel), -guess.strength, -sizes[guess.table])))


def best(found: Sequence[Guess], only: Sequence[str] = ()) -> tuple[Guess, ...]:
    """Return one guess for each channel, or for each of some.

    Velocities over the earth, and quaternions, are there where what is made of them is wanted and nothing gives it itself.
    """
    wanted = set(only) or {guess.channel for guess in found} | {*_BODY, *ANGLES}
    direct = {guess.channel for guess in found}
    for made_of, makes, needs in ((OVER_EARTH, _BODY, ANGLES), (QUATERNION, ANGLES, ())):
        wanted -= {*made_of}
        if wanted & {*makes} and not direct & {*makes} and direct & {*made_of}:
            wanted |= {*made_of, *needs}
    first: dict[str, Guess] = {}
    for guess in found:
        if guess.channel in wanted:
            first.setdefault(guess.channel, guess)
    return tuple(first.values())


def remarks(tables: Sequence[TableSummary]) -> tuple[str, ...]:
    """Say which tables hold what a factor cannot map."""
    found = {
        table.info.name: text
        for table in tables
        for kind, column, text in REMARKS
        if kind.match(table.info.name) and any(column.fullmatch(each.name) for each in table.columns)
    }
    for table in tables:
        if (pulses := [column.name for column in table.columns if _is_pulse(column)]) and table.info.name not in found:
            found[table.info.name] = f"{pulses[0]} to {pulses[-1]} may be {REMARKS[0][2]}"
    return tuple(f"{name}: {text}" for name, text in found.items())


def _is_pulse(column: ColumnSummary) -> bool:
    """Return whether an element of an array lies where the pulse widths of thrusters do, in microseconds, about the neutral 1500."""
    low, middle, high = _PULSES
    return column.name.endswith("]") and column.count > 0 and low <= column.least <= middle <= column.greatest <= high


def _of_table(table: TableSummary) -> Iterator[Guess]:
    clocks = {clock.name for clock in table.clocks}
    found = []
    for column in table.columns:
        if column.name in clocks or column.name.endswith("log_time"):
            continue
        guess = _by_type(table, column) or _by_pulse(table, column)
        guess = guess or (None if column.trouble else _by_name(table, column))
        if guess is not None:
            found.append((guess, column))
    # Three parts of a quaternion may be constant where the vehicle only turns, all four where it is not known.
    turns = any(guess.channel in QUATERNION and not column.trouble for guess, column in found)
    for guess, column in found:
        if not column.trouble or guess.unit == "command" or (turns and guess.channel in QUATERNION):
            yield guess


def _by_type(table: TableSummary, column: ColumnSummary) -> Guess | None:
    info = table.info
    known = ROS.get(info.kind, {}).get(column.name)
    if known is not None and "Twist" in info.kind and re.search(r"cmd|command|setpoint|desired", info.name):
        return None
    reason = f"{info.kind}: its axes are east, north, up and forward, left, up (REP 103)"
    if known is None:
        known = AUTOPILOT.get(info.name.split("[")[0].split(" of ")[0], {}).get(column.name)
        reason = "message of ArduPilot"
    if known is None:
        return None
    unit = known.unit or _text_unit(known.channel)
    return Guess(known.channel, info.name, column.name, unit, known.scale, known.axes, _role(known.channel), reason, 3)


def _by_pulse(table: TableSummary, column: ColumnSummary) -> Guess | None:
    """Guess that the elements of an array are the commands of thrusters, in their order; one may stand still."""
    if not _is_pulse(column):
        return None
    channel = f"f_{int(column.name.rpartition('[')[2][:-1]) + 1}"
    reason = "pulse widths by their range; [vehicle.thrust_laws] makes thrust of them: check their order"
    return Guess(channel, table.info.name, column.name, "command", 1.0, "NED", "control", reason, 1)


def _by_name(table: TableSummary, column: ColumnSummary) -> Guess | None:
    """Guess by the last part of the column's name, or by the table's where the column is only `value`."""
    full = table.info.name if column.name in ("value", "data") else column.name
    name = re.sub(r"\[\d+\]$", "", full).lower()
    name = re.sub(r"^.*/", "", name).replace(" ", "_").removeprefix("nav_")
    bare, hinted = _without_unit(name)
    for candidate in dict.fromkeys((name, bare)):
        parts = candidate.split(".")
        for text in (".".join(parts[-2:]), parts[-1]):
            for channel, strength, pattern in _PATTERNS:
                if pattern.fullmatch(text):
                    unit = _unit(channel, column, hinted if candidate == bare else None)
                    if unit is None:
                        continue
                    reason = f'the name "{full}"; {unit[2]}'
                    return Guess(
                        channel, table.info.name, column.name, *unit[:2], "NED", _role(channel), reason, strength
                    )
    return None


def _without_unit(name: str) -> tuple[str, str | None]:
    """Return a name without the unit at its end, and that unit."""
    match = re.fullmatch(r"(.+?)_?[\[(]([^\[\]()]+)[\])]", name)
    if match:
        return match[1], _SUFFIXES.get(match[2].replace("/", "_"), match[2])
    for suffix, unit in _SUFFIXES.items():
        if name.endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], unit
    return name, None


def _unit(channel: str, column: ColumnSummary, hinted: str | None) -> tuple[str, float, str] | None:
    """Return the unit, factor and where they are from; None where the stated unit is one of something else."""
    for unit, source in ((column.unit, "the log states its unit"), (hinted, "its unit by the name")):
        if unit is None:
            continue
        fitting = _fitting(unit, channel)
        return None if fitting is None else (*fitting, source)
    size = max(abs(column.least), abs(column.greatest))
    if channel in ("phi", "theta", "psi", "delta_r", "delta_s"):
        return ("deg", 1.0, "degrees by its range") if size > 2.1 * pi else ("rad", 1.0, "radians by its range")
    if channel in ("p", "q", "r"):
        return ("deg/s", 1.0, "degrees by its range") if size > 2 * pi else ("rad/s", 1.0, "radians by its range")
    if channel == "n":
        is_rpm = "rpm" in column.name.lower() or size > 60
        return (
            "rpm" if is_rpm else "rev/s",
            1.0,
            "its unit by the name" if "rpm" in column.name.lower() else "its unit by its range",
        )
    return _text_unit(channel), 1.0, "its unit is not known: SI"


def _fitting(unit: str, channel: str) -> tuple[str, float] | None:
    """Return the unit that seatrial knows and the factor to it, None where it has another dimension."""
    unit = _SPELLING.get(unit, unit)
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


def _text_unit(channel: str) -> str:
    """Return the SI unit as a map spells it."""
    return {"kg m/s^2": "N", "kg m^2/s^2": "N*m"}.get(signal_unit(channel), signal_unit(channel))


def _role(channel: str) -> Role:
    return "control" if channel in ("n", "delta_r", "delta_s") or channel.startswith("tau_") else "measurement"
