"""What exporters to rigid-body engines share: the body in forward-port-up axes, its volumes, what drives it, and its fins.

From forward-starboard-down to forward-port-up: y and z of positions and forces change sign, s = (1, -1, -1, 1, -1, -1); an entry that
couples velocities i and j changes by s_i s_j. A fin is a lift across the local flow at one place, for terms u^2 delta of a force and
a moment:

    Y = c u^2 delta,  N = x Y      becomes      (X, Y) = c V delta (-v_l, u),  N = x Y,  v_l = v + x r,  V^2 = u^2 + v_l^2

Both agree where the fin meets the flow head on. Going astern such a fin gives nothing (gz-sim's LiftDrag, unless reversible, which it
is not here), and the term u^2 delta still pushes.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.export.motion import Motion, current_in
from seatrial.export.terms import Sorted, with_gains
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.hull import AXES, GRAVITY, Hull, rigid_mass_matrix
from seatrial.vehicles.thrusters import PROPELLER, real_thrust

SIGN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
# Of the water, kg/m^3, where the user says nothing: the catalogue does not know it, and only its product with the
# volume counts.
DENSITY = 1025.0
_SQUARE = CoefficientName.parse("T_nabsn")
_GAIN = CoefficientName.parse("T_f")
# Axis of the force, of the moment, and the sign by which moment = sign x place x force.
_PAIRS = {"delta_r": (1, 5, 1.0), "delta_s": (2, 4, -1.0)}


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


class Drive(NamedTuple):
    """One thruster.

    Attributes:
        control: `n`, `n_1` or `f_1`.
        place: m, forward, starboard, down.
        direction: unit vector of positive thrust.
        factor: net thrust by n|n|, N/(rad/s)^2; None if the control is the force itself.
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


class Fin(NamedTuple):
    """A fin that lifts across the hull.

    Attributes:
        control: `delta_r` or `delta_s`.
        axis: of the force, 1 for sway and 2 for heave.
        lift: force by u^2 and angle, kg/(m rad).
        place: ahead of the origin, m.
    """

    control: str
    axis: int
    lift: float
    place: float

    @property
    def turns(self) -> float:
        """1 if a positive angle turns the fin by the right hand about the axis down (rudder) or to starboard (plane), else -1.

        A fin so turned shows its leading edge to starboard, or up, and is lifted that way.
        """
        return 1.0 if (self.lift > 0) == (self.axis == 1) else -1.0


def flip(matrix: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Return a mass or damping matrix in the other axes."""
    return matrix * np.outer(SIGN, SIGN)


def body_of(rigid_mass: Float[np.ndarray, "6 6"]) -> Body:
    """Return the body of a rigid mass matrix about the origin, in the axes of the matrix."""
    mass = float(rigid_mass[0, 0])
    centre = np.array([rigid_mass[1, 5], rigid_mass[2, 3], rigid_mass[0, 4]]) / mass
    steiner = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return Body(mass, centre, rigid_mass[3:, 3:] - steiner)


def point_mass(mass: float, inertia: float, place: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 6"]:
    """Return the rigid mass matrix of a small part of equal moments of inertia, about the origin.

    Args:
        mass: kg.
        inertia: moment about each axis through its centre, kg m^2.
        place: of its centre, m, shape (3,).
    """
    steiner = mass * (place @ place * np.eye(3) - np.outer(place, place))
    moments = inertia * np.eye(3) + steiner
    products = (-moments[0, 1], -moments[0, 2], -moments[1, 2])
    return rigid_mass_matrix(
        Hull("part", mass, tuple(np.diag(moments)), products, tuple(place))  # pyright: ignore[reportArgumentType]
    )


def gravity_of(vehicle: ExportedVehicle) -> float:
    """Return the gravity by which weight and mass agree, m/s^2."""
    return vehicle.hull.weight / vehicle.hull.mass if vehicle.hull.mass else GRAVITY


def volume_of(vehicle: ExportedVehicle, density: float) -> float:
    """Return the displaced volume by which the buoyancy comes out, m^3."""
    return vehicle.hull.buoyancy / (density * gravity_of(vehicle))


def box_of(volume: float, places: Iterable[float]) -> Float[np.ndarray, " 3"]:
    """Return the lengths of a box of a volume, m^3, about the origin that reaches the places of fins and thrusters ahead of it, m."""
    length = max([2.0 * abs(place) for place in places] + [volume ** (1 / 3)])
    side = (volume / length) ** 0.5
    return np.array([length, side, side])


def flu(place: tuple[float, float, float] | Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Return a position in the other axes."""
    return np.asarray(place, float) * SIGN[:3]


def drives_of(vehicle: ExportedVehicle) -> tuple[tuple[Drive, ...], tuple[str, ...]]:
    """Return the thrusters, and the terms of thrust that are neither n|n| nor the gain of a commanded force."""
    thrust = {name: value for name, value in vehicle.forces.items() if CoefficientName.parse(name).axis == "T"}
    square = next((value for name, value in thrust.items() if CoefficientName.parse(name).key == _SQUARE.key), None)
    others = tuple(name for name in thrust if CoefficientName.parse(name).key not in (_SQUARE.key, _GAIN.key))
    share = (1.0 - vehicle.hull.thrust_deduction) * thrust.get("T_f", 1.0)
    if not vehicle.thrusters and square is None:
        return (), others
    gains = with_gains(vehicle).thrust_law
    results = []
    for number, thruster in enumerate(vehicle.thrusters or (PROPELLER,), 1):
        control = ("f" if square is None else "n") + (f"_{number}" if vehicle.thrusters else "")
        actuator = vehicle.actuators.get(control)
        gain = share * float(real_thrust(gains, control, 1.0))
        results.append(
            Drive(
                control,
                np.array(thruster.place, float),
                np.array(thruster.column[:3]),
                None if square is None else gain * square,
                gain,
                -np.inf if actuator is None else actuator.lower,
                np.inf if actuator is None else actuator.upper,
            )
        )
    return tuple(results), others


def drive_name(drive: Drive) -> str:
    """Return `propeller`, or `thruster_3`."""
    return f"thruster_{drive.control[2:]}" if "_" in drive.control else "propeller"


def fins_of(terms: Sorted) -> tuple[tuple[Fin, ...], tuple[str, ...]]:
    """Return the fins made of the terms u^2 delta, and the names of such terms that are no force and moment of one fin."""
    results, used = [], set()
    for control, (axis, moment, sign) in _PAIRS.items():
        lift = terms.fin.get((axis, control), 0.0)
        if lift:
            results.append(Fin(control, axis, lift, sign * terms.fin.get((moment, control), 0.0) / lift))
            used |= {(axis, control), (moment, control)}
    return tuple(results), tuple(
        f"{AXES[axis]}_uu{control}" for axis, control in terms.fin if (axis, control) not in used
    )


def fin_force(fins: tuple[Fin, ...]) -> Motion:
    """Return the forces of the fins, in our axes; they feel the velocity over ground, since LiftDrag knows no current."""

    def force(nu: Any, phi: Any, theta: Any, controls: Mapping[str, Any]) -> Any:
        u, v, w = (one + water for one, water in zip(nu[:3], current_in(controls), strict=True))
        q, r = nu[4:]
        result = np.zeros_like(np.asarray(nu, float))
        for fin in fins:
            across = v + r * fin.place if fin.axis == 1 else w - q * fin.place
            push = np.where(u > 0, fin.lift * np.hypot(u, across), 0.0) * controls.get(fin.control, 0.0)
            sign = 1.0 if fin.axis == 1 else -1.0
            result[0] -= push * across
            result[fin.axis] += push * u
            result[6 - fin.axis] += sign * fin.place * push * u
        return result

    return force


def fin_words(fins: tuple[Fin, ...]) -> str:
    """Return how fins are carried, in words."""
    names = " and ".join(f"{AXES[fin.axis]}_uu{fin.control} at x = {fin.place:.3f} m" for fin in fins)
    return f"{names}: lift across the local flow at the fin, equal to u^2 delta in axial flow; it also slows the vehicle; zero astern"
