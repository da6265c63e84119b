"""Types of message whose columns are known: of ROS, in east, north, up with body axes forward, left, up (REP 103), and of ArduPilot."""

import re
from typing import NamedTuple

from seatrial.core.signals import OVER_EARTH, QUATERNION
from seatrial.logs.axes import Axes


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
_IMU = _TURN | {f"angular_velocity.{axis}": rate for axis, rate in zip("xyz", "pqr", strict=True)}
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
        "pulse widths of the outputs: give the maker's table of thrust over pulse width as the `curve` of a channel",
    ),
)
"""Tables and columns that need more than a factor."""
