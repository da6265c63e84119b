"""Types of message whose columns are known: of ROS, in east, north, up with body axes forward, left, up (REP 103), of ArduPilot and
MAVLink, and of PX4; and which columns are commands of thrusters.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

from seatrial.core.signals import ANGLES, OVER_EARTH, POSITIONS, QUATERNION, SPECIFIC_FORCE
from seatrial.logs.axes import Axes


class Known(NamedTuple):
    """What a column of a known type holds: channel, unit, axes of the message, factor on its numbers, and how good a guess it is."""

    channel: str
    unit: str | None
    axes: Axes
    scale: float = 1.0
    strength: int = 3


def _ros(prefix: str, names: dict[str, str]) -> dict[str, Known]:
    return {prefix + name: Known(channel, None, "ENU") for name, channel in names.items()}


_TWIST = {"linear.x": "u", "linear.y": "v", "linear.z": "w", "angular.x": "p", "angular.y": "q", "angular.z": "r"}
_WRENCH = {f"force.{axis}": f"tau_{name}" for axis, name in zip("xyz", "XYZ", strict=True)} | {
    f"torque.{axis}": f"tau_{name}" for axis, name in zip("xyz", "KMN", strict=True)
}
_TURN = {f"orientation.{part}": name for part, name in zip("wxyz", QUATERNION, strict=True)}
_POSE = _TURN | {"position.x": "y", "position.y": "x", "position.z": "z"}
_IMU = (
    _TURN
    | {f"angular_velocity.{axis}": rate for axis, rate in zip("xyz", "pqr", strict=True)}
    | {f"linear_acceleration.{axis}": f"a_{axis}" for axis in "xyz"}
)
# For each type of message its columns
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


def _autopilot(columns: Mapping[str, str], unit: str, scale: float = 1.0, strength: int = 3) -> dict[str, Known]:
    return {name: Known(channel, unit, "NED", scale, strength) for name, channel in columns.items()}


def _paired(columns: str, channels: tuple[str, ...], unit: str, scale: float = 1.0) -> dict[str, Known]:
    return _autopilot(dict(zip(columns.split(), channels, strict=True)), unit, scale)


_RATES = ("p", "q", "r")
_KALMAN = _paired("VN VE VD", OVER_EARTH, "m/s") | _paired("PN PE PD", POSITIONS, "m")
_SPEEDS = _paired("rollspeed pitchspeed yawspeed", _RATES, "rad/s")
_SCALED = _paired("xgyro ygyro zgyro", _RATES, "rad/s", 1e-3) | _paired(
    "xacc yacc zacc", SPECIFIC_FORCE, "m/s^2", 9.80665e-3
)
# For each type of message of ArduPilot, MAVLink and PX4, whose axes are seatrial's, its columns
AUTOPILOT: dict[str, dict[str, Known]] = {
    "ATT": _paired("Roll Pitch Yaw", ANGLES, "deg"),
    "IMU": _paired("GyrX GyrY GyrZ", _RATES, "rad/s") | _paired("AccX AccY AccZ", SPECIFIC_FORCE, "m/s^2"),
    "XKF1": _KALMAN,
    "NKF1": _KALMAN,
    "ATTITUDE": _paired("roll pitch yaw", ANGLES, "rad") | _SPEEDS,
    "ATTITUDE_QUATERNION": _paired("q1 q2 q3 q4", QUATERNION, "1") | _SPEEDS,
    "SCALED_IMU": _SCALED,
    "SCALED_IMU2": _SCALED,
    "SCALED_IMU3": _SCALED,
    "LOCAL_POSITION_NED": _paired("vx vy vz", OVER_EARTH, "m/s") | _paired("x y z", POSITIONS, "m"),
    "GLOBAL_POSITION_INT": _paired("vx vy vz", OVER_EARTH, "m/s", 0.01),
    "VFR_HUD": _autopilot({"alt": "z"}, "m", -1.0, 2),
    "CTUN": _autopilot({"Alt": "z"}, "m", -1.0, 2),
    "vehicle_attitude": _paired("q[0] q[1] q[2] q[3]", QUATERNION, "1"),
    "vehicle_angular_velocity": _paired("xyz[0] xyz[1] xyz[2]", _RATES, "rad/s"),
    "vehicle_odometry": _paired("q[0] q[1] q[2] q[3]", QUATERNION, "1")
    | _paired("angular_velocity[0] angular_velocity[1] angular_velocity[2]", _RATES, "rad/s"),
    "vehicle_acceleration": _paired("xyz[0] xyz[1] xyz[2]", SPECIFIC_FORCE, "m/s^2"),
    "sensor_combined": _paired("gyro_rad[0] gyro_rad[1] gyro_rad[2]", _RATES, "rad/s")
    | _paired("accelerometer_m_s2[0] accelerometer_m_s2[1] accelerometer_m_s2[2]", SPECIFIC_FORCE, "m/s^2"),
    "vehicle_local_position": _paired("vx vy vz", OVER_EARTH, "m/s")
    | _paired("x y z", POSITIONS, "m")
    | _autopilot({"heading": "psi"}, "rad", strength=2),
}


# Number to name of ArduSub's modes. Source: ArduPilot, ArduSub/mode.h.
ARDUSUB_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    7: "CIRCLE",
    9: "SURFACE",
    16: "POSHOLD",
    19: "MANUAL",
    20: "MOTOR_DETECT",
    21: "SURFTRAK",
}
MODE_MESSAGES = ("MODE", "HEARTBEAT")  # Messages in which a column numbers the mode


def autopilot_message(table: str) -> str:
    """Return the type of an autopilot's message by the name of its table: `IMU` of `IMU[0]`, `ATTITUDE` of `mavlink/1/1/ATTITUDE`."""
    return table.split("[")[0].split(" of ")[0].rpartition("/")[2]


def message_and_field(table: str, column: str) -> tuple[str, str]:
    """Return the type of message that a column is of, and its field.

    A text of several messages has both in the names of its columns: `ATT.Roll`, `IMU[0].GyrX`, `vehicle_attitude_0.q[1]`, or
    `vehicle_attitude/q.01`.
    """
    match = _FIELD_OF_MESSAGE.fullmatch(column)
    if match and match["message"] in _MESSAGES:
        return match["message"], re.sub(r"\.(\d+)$", lambda index: f"[{int(index[1])}]", match["field"])
    return autopilot_message(table), column.removeprefix("message.")


def message_of_file(stem: str) -> str:
    """Return the type of message of which a text holds one table, by the name of its file as `ulog2csv` makes it; empty for none."""
    match = re.fullmatch(
        r"(?:.*?_)??(?P<message>" + "|".join(sorted(_MESSAGES, key=len, reverse=True)) + r")_\d+", stem
    )
    return match["message"] if match else ""


_OUTPUTS = (
    ("RCOU", re.compile(r"C(\d+)")),
    ("RCO2", re.compile(r"C(\d+)")),
    ("SERVO_OUTPUT_RAW", re.compile(r"(?:.*\.)?servo(\d+)_raw")),
)
_NORMALISED = "actuator_motors"  # Topic of PX4 whose outputs lie between -1 and 1
_MESSAGES = {*AUTOPILOT, *(kind for kind, _ in _OUTPUTS), _NORMALISED, "actuator_outputs"}
# Name of a column that begins with its message, of which there may be several
_FIELD_OF_MESSAGE = re.compile(
    r"(?:.*[/ ])?(?P<message>[A-Za-z]\w*?)(?:_\d+|\.\d+|\[\d+\])?[./](?P<field>[A-Za-z_]\w*(?:\[\d+\]|\.\d+)?)"
)
_PULSES = (900.0, 1500.0, 2100.0)
_ELEMENT = re.compile(r"(.*)\[(\d+)\]")
# Numbers of two thrusters that are called by their side
_NUMBERS = {"port": 1, "left": 1, "l": 1, "starboard": 2, "stbd": 2, "right": 2, "r": 2}
SIDES = "|".join(_NUMBERS)
# Names of columns that number outputs, or call two by their side
_NUMBERED = re.compile(
    rf"(?:.*[./])?(?:pwm|servo|thruster|motor|esc|(?:rc_?)?out(?:put)?)_?(?:pwm_?)?(\d+|{SIDES})(?:_?(?:pwm|us|raw))?"
    rf"|(?:.*[./])?({SIDES})_(?:pwm|us)",
    re.IGNORECASE,
)
_RC_INPUT = re.compile(
    r"(?:.*[/_. ])?(?:input_rc|rc[/_]?(?:in|override|i2|channels(?:_override|_raw|_scaled)?))", re.IGNORECASE
)
# Axes that the first channels of a radio control command. Source: ArduSub, RC input.
RC_AXES = ("pitch", "roll", "up", "yaw", "forward", "lateral")


def rc_channel(table: str, kind: str, column: str) -> int | None:
    """Return which channel of a radio control, from 1, a column is, as a pilot or a program sends it; None for none.

    Args:
        table: its name.
        kind: type of its messages, empty if it is not known.
        column: its name.
    """
    message, field = message_and_field(table, column)
    array = re.sub(r"[\W_]?\d+\W?$", "", column)
    if not kind.endswith(("/RCIn", "/OverrideRCIn")) and not any(map(_RC_INPUT.fullmatch, (table, message, array))):
        prefix = re.split(r"[./](?=[^./]*$)", column)[0]
        if prefix == column or not _RC_INPUT.fullmatch(prefix):
            return None
    match = re.fullmatch(r".*\[(\d+)\]", field)
    named = re.fullmatch(r"(?:.*[._])?(?:c|ch|chan|channel)?_?(\d+)(?:_raw)?", field, re.IGNORECASE)
    return int(match[1]) + 1 if match else int(named[1]) if named else None


def output_number(table: str, column: str, least: float, greatest: float) -> int | None:
    """Return which output of an autopilot a column may be, as it is numbered, an element of an array from 1; None for none.

    Args:
        table: its name.
        column: its name.
        least: number in it.
        greatest: number in it.
    """
    message, field = message_and_field(table, column)
    for kind, pattern in _OUTPUTS:
        if kind == message:
            match = pattern.fullmatch(field)
            return int(match[1]) if match and _is_pulse(least, greatest) else None
    if (match := _NUMBERED.fullmatch(column)) and _is_pulse(least, greatest, by_name="pwm" in column.lower()):
        return thruster_number(match[1] or match[2])
    match = _ELEMENT.fullmatch(field)
    if match is None or not (_is_pulse(least, greatest) or (message == _NORMALISED and match[1] == "control")):
        return None
    return int(match[2]) + 1


def thruster_number(which: str) -> int:
    """Return the number of a thruster that is called by it or by its side."""
    return _NUMBERS.get(which.lower()) or int(which)


def _is_pulse(least: float, greatest: float, by_name: bool = False) -> bool:
    """Return whether numbers lie where the pulse widths of thrusters do, µs, about the neutral 1500; of a name that says it anywhere."""
    low, middle, high = _PULSES
    return by_name or low <= least <= middle <= greatest <= high
