"""What drives a vehicle, as simulators have it: thrusters of thrust k n|n|, or of commanded force, each with a place and a direction."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.thrusters import PROPELLER

_SQUARE = CoefficientName.parse("T_nabsn")


class Drive(NamedTuple):
    """One thruster.

    Attributes:
        control: `n`, `n_1` or `f_1`.
        place: m, forward, starboard, down.
        direction: unit vector of positive thrust.
        factor: net thrust by n|n|, N/(rad/s)^2; None where the control is the force itself.
        share: net of commanded force.
        lower: least control, SI.
        upper: greatest control, SI.
    """

    control: str
    place: Float[np.ndarray, " 3"]
    direction: Float[np.ndarray, " 3"]
    factor: float | None
    share: float
    lower: float
    upper: float

    def thrust(self, control: float) -> float:
        """Net thrust, N."""
        return self.share * control if self.factor is None else self.factor * control * abs(control)


def drives_of(vehicle: ExportedVehicle) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
    """Thrusters, and the terms of thrust that are not n|n|."""
    share = 1.0 - vehicle.hull.thrust_deduction
    thrust = {name: value for name, value in vehicle.forces.items() if CoefficientName.parse(name).axis == "T"}
    square = next((value for name, value in thrust.items() if CoefficientName.parse(name).key == _SQUARE.key), None)
    others = tuple(name for name in thrust if CoefficientName.parse(name).key != _SQUARE.key)
    if not vehicle.thrusters and square is None:
        return (), others
    found = []
    for number, thruster in enumerate(vehicle.thrusters or (PROPELLER,), 1):
        control = ("f" if square is None else "n") + (f"_{number}" if vehicle.thrusters else "")
        actuator = vehicle.actuators.get(control)
        found.append(
            Drive(
                control,
                np.array(thruster.place, float),
                np.array(thruster.column[:3]),
                None if square is None else share * square,
                share,
                -np.inf if actuator is None else actuator.lower,
                np.inf if actuator is None else actuator.upper,
            )
        )
    return tuple(found), others


def drive_name(drive: Drive) -> str:
    """`propeller`, or `thruster_3`."""
    return f"thruster_{drive.control[2:]}" if "_" in drive.control else "propeller"
