"""Where a sensor of several channels sits in the body, how it is turned there, its scale, and how late its clock is: stated, or sought.

    velocity   s R^T (v + omega x r)        of u, v, w by a Doppler log at r, whose axes R takes to those of the body; likewise over ground
    rotation   s R^T omega                  of p, q, r by a gyro
    force      s R^T (a + domega/dt x r + omega x (omega x r))    of a_x, a_y, a_z by an accelerometer
    position   s (x + R_body r)             of x, y, z by motion capture or a pressure cell

Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, section 14.2.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from seatrial.core.signals import ANGLES, OVER_GROUND, POSITIONS, RATES, SPECIFIC_FORCE
from seatrial.numerics.rotations import cross, dot, matrix_of_angles, times, total

# Parts of a mount, of which each may be an unknown: `x_dvl`, m, `yaw_dvl`, rad, `scale_dvl`, `delay_dvl`, s.
PLACE, TURN, SCALE, LATE = ("x", "y", "z"), ("roll", "pitch", "yaw"), "scale", "delay"
MAX_LATENESS = 1.0  # Seconds by which a sensor may show the past, at most
MOUNTED_CHANNELS = (*RATES, *OVER_GROUND, *POSITIONS, *SPECIFIC_FORCE)  # Channels that a mount knows


@dataclass(frozen=True)
class Mount:
    """One sensor in the body.

    Attributes:
        name: `dvl`.
        place: from the body's origin, forward, starboard and down, m.
        turn: roll, pitch and yaw of its axes in those of the body, rad.
        scale: what it shows of what is there.
        late: seconds before the stamp of a sample of which it shows the motion.
        unknown: names of its parameters to estimate, see `mount_names`.
    """

    name: str
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0
    late: float = 0.0
    unknown: tuple[str, ...] = ()

    @property
    def stated(self) -> dict[str, float]:
        """Value of each parameter where nothing else is said, SI."""
        return dict(zip(mount_names(self.name), (*self.place, *self.turn, self.scale, self.late), strict=True))

    @property
    def is_late(self) -> bool:
        """Whether it shows the past."""
        return self.late > 0 or f"{LATE}_{self.name}" in self.unknown

    def show(self, channel: str, values: Mapping[str, Any], known: Callable[[str], Any]) -> Any:
        """Return what it shows of a channel, SI, without noise.

        Args:
            channel: one of `MOUNTED`.
            values: parameters by name.
            known: value of a velocity, angle or position of the body; 0.0 for one that it does not have.
        """
        x, y, z, *turn, scale, _ = (values.get(name, value) for name, value in self.stated.items())
        place, omega = (x, y, z), tuple(map(known, RATES[3:]))
        if channel in POSITIONS:
            row = matrix_of_angles(*map(known, ANGLES))[POSITIONS.index(channel)]
            return times(scale, total((known(channel), dot(row, place))))
        vector = omega
        for velocity in (RATES[:3], OVER_GROUND):
            if channel in velocity:
                vector = tuple(total(parts) for parts in zip(map(known, velocity), cross(omega, place), strict=True))
        if channel in SPECIFIC_FORCE:
            faster = cross(tuple(known(f"{rate}dot") for rate in RATES[3:]), place)
            inward = cross(omega, cross(omega, place))
            vector = tuple(total(parts) for parts in zip(map(known, SPECIFIC_FORCE), faster, inward, strict=True))
        axis = (*RATES, *OVER_GROUND, *SPECIFIC_FORCE).index(channel) % 3
        column = [row[axis] for row in matrix_of_angles(*turn)]
        return times(scale, dot(column, vector))


def mount_names(name: str) -> tuple[str, ...]:
    """Return the names of the parameters of a mount: `x_dvl`, `y_dvl`, `z_dvl`, `roll_dvl`, `pitch_dvl`, `yaw_dvl`, `scale_dvl`,
    `delay_dvl`."""
    return tuple(f"{part}_{name}" for part in (*PLACE, *TURN, SCALE, LATE))


def mount_unit(name: str) -> str:
    """Return the SI unit of a parameter of a mount."""
    part = name.partition("_")[0]
    return {LATE: "s", SCALE: "1"}.get(part, "m" if part in PLACE else "rad")
