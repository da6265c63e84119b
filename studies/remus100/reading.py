"""The paper's vehicle under one of two readings of its unprinted units.

The paper prints T = 6.28 and says neither of which unit nor at which propeller speed the vehicle is trimmed. Under reading A
it is 6.28e-2 N/(rev/s)^2 at 12.5 rev/s, under reading B 6.28e-4 N/(rad/s)^2 at 125 rad/s (Hall and Anstee 2011): the same
trim thrust, and amplitudes in rpm that differ in effect by 2 pi / 10. A gives standard deviations nearer to those printed; no
source has its propeller.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import ClassVar

from seatrial.core.coefficients import CoefficientName
from seatrial.core.units import quantity
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.whole import whole_vehicle

RPM = 2 * pi / 60
NAMES = ("X_u", "X_uabsu", "T_nabsn")  # Coefficients of eq. (3).
MASS, ADDED_MASS = 30.47, -0.93  # m and X_udot, kg


@dataclass(frozen=True)
class Reading:
    """The vehicle with its true coefficients, noise and limits, SI.

    Attributes:
        name: `A` or `B`.
        title: of the report.
        thrust: true coefficient of eq. (3) with its unit.
        turns: propeller speed at trim, rad/s.
        printed_thrust: unit in which T_nabsn is printed.
        filter_thrust: unit in which T_nabsn is a state of the filters, so that their Q and P make sense.
        doubted: name of the term of M-0 that M-1 lacks.
        doubted_values: its true values in Tables IV and V.
        wide: half width of its wide prior.
        filter_noise: standard deviation of the noise of u, m/s, in the filters' trials; udot has the same number in m/s^2.
        sigma: standard deviation of the noise of u in the trials of Section IV, m/s.
        steps: largest change of n in the random steps, rad/s.
        lowest: smallest amplitude of the doublets, rad/s.
        highest: largest amplitude of the doublets, rad/s.
    """

    name: str
    title: str
    thrust: str
    turns: float
    printed_thrust: str
    filter_thrust: str

    doubted: ClassVar = "X_du3"
    doubted_values: ClassVar = (0.1, 1.0)
    wide: ClassVar = 50.0
    filter_noise: ClassVar = 0.1
    sigma: ClassVar = 0.0757
    steps: ClassVar = 400 * RPM
    lowest: ClassVar = 100 * RPM
    highest: ClassVar = 200 * RPM

    @cached_property
    def truth(self) -> dict[str, float]:
        """True coefficients of eq. (3), SI."""
        return {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": _thrust(self.thrust)}

    @cached_property
    def hull(self) -> Hull:
        """What is known beforehand, trimmed."""
        hull = Hull(self.title, MASS, thrust_deduction=0.1, fixed={"X_udot": ADDED_MASS}, trim={"n": self.turns})
        speed = trim_speed(whole_vehicle(hull, NAMES, moves=("u",)), self.truth, (self.turns,))
        # Rounded where rounding errors begin: vehicles of one trim speed then have the same equations, and share compiled code.
        return replace(hull, trim={"u": round(speed, 12), "n": self.turns})

    @property
    def inertia(self) -> float:
        """Effective mass m - X_udot, kg."""
        return MASS - ADDED_MASS

    @cached_property
    def thrust_print(self) -> float:
        """SI value of the unit in which T_nabsn is printed."""
        return _thrust(self.printed_thrust)

    @cached_property
    def thrust_filter(self) -> float:
        """SI value of the unit in which T_nabsn is a state of the filters."""
        return _thrust(self.filter_thrust)

    @property
    def print_scales(self) -> dict[str, float]:
        """SI value of one printed unit of each coefficient."""
        return {"X_u": 1.0, "X_uabsu": 1.0, "T_nabsn": self.thrust_print, self.doubted: 1.0}

    @property
    def printed_truth(self) -> dict[str, float]:
        """True coefficients as the tables print them."""
        return {name: value / self.print_scales[name] for name, value in self.truth.items()}

    def model(self, *extra: str) -> VehicleModel:
        """Surge model of eq. (3), with extra terms."""
        return whole_vehicle(self.hull, (*NAMES, *extra), moves=("u",))


def _thrust(text: str) -> float:
    return quantity(text, CoefficientName.parse("T_nabsn").unit, "T_nabsn")


READINGS = {
    "A": Reading(
        "A",
        "REMUS 100, reading A (T in 1e-2 N/(rev/s)^2, trim 750 rpm)",
        "6.28e-2 N/(rev/s)^2",
        750 * RPM,
        "1e-2 N/(rev/s)^2",
        "1 N/(rev/s)^2",
    ),
    "B": Reading(
        "B",
        "REMUS 100, reading B (T in 1e-4 N/(rad/s)^2, trim 1194 rpm)",
        "6.28e-4 N/(rad/s)^2",
        125.0,
        "1e-4 N/(rad/s)^2",
        "1e-4 N/(rad/s)^2",
    ),
}
