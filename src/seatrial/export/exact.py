"""The rigid body and the parts of it that exporters to rigid-body engines share: FLU axes, volumes, small parts taken out of the hull.

From forward-starboard-down to forward-port-up: y and z of positions and forces change sign, s = (1, -1, -1, 1, -1, -1); an entry that
couples velocities i and j changes by s_i s_j.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.hull import GRAVITY, Hull, rigid_mass_matrix

SIGN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
DENSITY = 1025.0
"""Of the water, kg/m^3, where the user says nothing: the catalogue does not know it, and only its product with the volume counts."""


class Body(NamedTuple):
    """A rigid body in forward-port-up axes, SI.

    Attributes:
        mass: kg.
        centre: of gravity, m.
        inertia: about the centre of gravity, 3 x 3, kg m^2.
    """

    mass: float
    centre: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, "3 3"]


def flip(matrix: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """A mass or damping matrix in the other axes."""
    return matrix * np.outer(SIGN, SIGN)


def body_of(rigid_mass: Float[np.ndarray, "6 6"]) -> Body:
    """The body of a rigid mass matrix about the origin, in the axes of the matrix."""
    mass = float(rigid_mass[0, 0])
    centre = np.array([rigid_mass[1, 5], rigid_mass[2, 3], rigid_mass[0, 4]]) / mass
    steiner = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return Body(mass, centre, rigid_mass[3:, 3:] - steiner)


def point_mass(mass: float, inertia: float, place: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 6"]:
    """Rigid mass matrix of a small part of equal moments of inertia, about the origin."""
    steiner = mass * (place @ place * np.eye(3) - np.outer(place, place))
    moments = inertia * np.eye(3) + steiner
    products = (-moments[0, 1], -moments[0, 2], -moments[1, 2])
    return rigid_mass_matrix(
        Hull("part", mass, tuple(np.diag(moments)), products, tuple(place))  # pyright: ignore[reportArgumentType]
    )


def gravity_of(vehicle: ExportedVehicle) -> float:
    """The gravity by which weight and mass agree, m/s^2."""
    return vehicle.hull.weight / vehicle.hull.mass if vehicle.hull.mass else GRAVITY


def volume_of(vehicle: ExportedVehicle, density: float) -> float:
    """Displaced volume by which the buoyancy comes out, m^3."""
    return vehicle.hull.buoyancy / (density * gravity_of(vehicle))


def flu(place: tuple[float, float, float] | Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """A position in the other axes."""
    return np.asarray(place, float) * SIGN[:3]
