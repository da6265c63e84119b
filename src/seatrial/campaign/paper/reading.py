"""Two readings of the paper's unprinted units, and the surge vehicle and covariances it uses under each.

The paper prints T = 6.28 and says neither of which unit nor at which propeller speed the vehicle is trimmed. Under reading A
it is 6.28e-2 N/(rev/s)^2 at 12.5 rev/s, under reading B 6.28e-4 N/(rad/s)^2 at 125 rad/s (Hall and Anstee 2011): the same
trim thrust, and amplitudes in rpm that differ in effect by 2 pi / 10.
"""

from dataclasses import dataclass, replace
from math import pi

from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle, trim_speed

RPM = 2 * pi / 60
NAMES = ("X_u", "X_uabsu", "T_nabsn")
PRINTED = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28}
"""True coefficients as the tables print them."""


@dataclass(frozen=True)
class Reading:
    """One reading.

    Attributes:
        name: A or B.
        thrust_print: SI value of the unit in which the tables print T_nabsn.
        thrust_filter: SI value of the unit in which the filters' covariances make sense.
        trim: propeller speed at trim, rad/s.
    """

    name: str
    thrust_print: float
    thrust_filter: float
    trim: float

    @property
    def print_scales(self) -> dict[str, float]:
        """SI value of one printed unit of each coefficient."""
        return {"X_u": 1.0, "X_uabsu": 1.0, "T_nabsn": self.thrust_print, "X_du3": 1.0}

    @property
    def truth(self) -> dict[str, float]:
        """True coefficients, SI."""
        return {name: value * self.print_scales[name] for name, value in PRINTED.items()}

    @property
    def hull(self) -> SurgeHull:
        """REMUS 100 with m - X_udot = 31.4 kg, trimmed."""
        hull = SurgeHull(f"REMUS 100, reading {self.name}", 30.47, 0.1, {"X_udot": -0.93}, {"n": self.trim})
        speed = trim_speed(surge_vehicle(hull, NAMES), self.truth, (self.trim,))
        return replace(hull, trim={"u": speed, "n": self.trim})

    def model(self, *extra: str) -> VehicleModel:
        """Surge model of the paper, eq. (3), with extra terms."""
        return surge_vehicle(self.hull, (*NAMES, *extra))


READINGS = {
    "A": Reading("A", 1e-2 / (2 * pi) ** 2, 1.0 / (2 * pi) ** 2, 12.5 * 2 * pi),
    "B": Reading("B", 1e-4, 1e-4, 125.0),
}
