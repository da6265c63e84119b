"""The rigid body of a vehicle in six degrees of freedom, with the weight and buoyancy that act on it.

    M_RB = [ m I         -m S(r_g) ]     S(a) b = a x b,  nu = (u, v, w, p, q, r)
           [ m S(r_g)     I_o      ]

Body axes forward, starboard and down from an origin that may lie anywhere on the vehicle. Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control, 2nd ed., 2021, eq. (3.49).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.argument_checks import check_number, check_numbers, check_sequence
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.vehicles.model import Params, VehicleUnknown
from seatrial.vehicles.tether import Tether

GRAVITY = 9.81  # m/s^2, as most sources round it
AXES = ("X", "Y", "Z", "K", "M", "N")  # Axes of force and moment, in the order of the velocities u, v, w, p, q, r
_XYZ = ("x", "y", "z")
_SHARE = "give a share, such as 0.1"


@dataclass(frozen=True)
class Hull:
    """What is known about a vehicle beforehand. Build it with `whole_hull`, which checks it.

    Attributes:
        name: short name.
        mass: dry mass, kg; None if it is unknown: forces then are per unit of effective inertia, and nothing is known of the body.
        inertia: I_xx, I_yy, I_zz about the origin, kg m^2; None if unknown, which is refused for an axis that turns.
        products: I_xy, I_xz, I_yz = the integrals of xy, xz and yz over the mass, kg m^2.
        centre_of_gravity: x_g, y_g, z_g, m.
        centre_of_buoyancy: x_b, y_b, z_b, m.
        weight: W, N.
        buoyancy: B, N.
        thrust_deduction: t_d, the part of the thrust lost to the hull.
        wake: w, the part of the speed that the water behind the hull lacks; a propeller meets (1 - w) u.
        fixed: coefficients that are not estimated, SI.
        trim: equilibrium about which the vehicle works: signal name to SI value.
        tether: that it drags along; None without one.
    """

    name: str
    mass: float | None
    inertia: tuple[float | None, float | None, float | None] = (None, None, None)
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre_of_gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre_of_buoyancy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float = 0.0
    buoyancy: float = 0.0
    thrust_deduction: float = 0.0
    wake: float = 0.0
    fixed: Mapping[str, float] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)
    tether: Tether | None = None

    @property
    def righting(self) -> tuple[float, float, float]:
        """r_g W - r_b B, N m: the moment of weight and buoyancy is its vector product with the vertical."""
        pairs = zip(self.centre_of_gravity, self.centre_of_buoyancy, strict=True)
        x, y, z = (g * self.weight - b * self.buoyancy for g, b in pairs)
        return x, y, z


def whole_hull(
    name: str,
    mass: float,
    inertia: Sequence[float | None],
    *,
    products: Sequence[float] = (0.0, 0.0, 0.0),
    centre_of_gravity: Sequence[float] = (0.0, 0.0, 0.0),
    centre_of_buoyancy: Sequence[float] = (0.0, 0.0, 0.0),
    weight: float | None = None,
    buoyancy: float | None = None,
    thrust_deduction: float = 0.0,
    wake: float = 0.0,
    fixed: Mapping[str, float] | None = None,
    trim: Mapping[str, float] | None = None,
    symmetric: bool = True,
) -> Hull:
    """Build a hull from what is published of it.

    Args:
        name: short name.
        mass: dry mass, kg.
        inertia: I_xx, I_yy, I_zz about the origin, kg m^2; None if unknown.
        products: I_xy, I_xz, I_yz, kg m^2.
        centre_of_gravity: x_g, y_g, z_g, m.
        centre_of_buoyancy: x_b, y_b, z_b, m.
        weight: N; the mass times 9.81 m/s^2 if not given.
        buoyancy: N; the weight if not given.
        thrust_deduction: t_d, 0 <= t_d < 1.
        wake: w, below 1.
        fixed: coefficients that are not estimated, SI.
        trim: equilibrium of signals, SI.
        symmetric: whether added mass must be symmetric; in an ideal fluid it is, measured at a free surface it need not be.

    Raises:
        InputError: a number that is no physical one, an inertia that no body has, or an added mass that is not symmetric.
    """
    place = f'vehicle "{name}"'
    mass = check_number(mass, f"{place}, mass", above=0.0)
    weight = mass * GRAVITY if weight is None else check_number(weight, f"{place}, weight", above=0.0)
    hull = Hull(
        name,
        mass,
        _three(inertia, f"{place}, inertia", _XYZ, may_lack=True),
        _three(products, f"{place}, products", ("xy", "xz", "yz")),
        _three(centre_of_gravity, f"{place}, centre_of_gravity", _XYZ),
        _three(centre_of_buoyancy, f"{place}, centre_of_buoyancy", _XYZ),
        weight,
        weight if buoyancy is None else check_number(buoyancy, f"{place}, buoyancy", above=0.0),
        thrust_deduction,
        wake,
        check_numbers(fixed, f"{place}, fixed"),
        check_numbers(trim, f"{place}, trim"),
    )
    check_hull_numbers(hull)
    _check_body(hull)
    if symmetric:
        _check_symmetry(hull)
    return hull


def floating_unknowns(hull: Hull) -> tuple[VehicleUnknown, ...]:
    """Return what of weight and buoyancy may be sought: their difference, and the centre of buoyancy, x_b, y_b, z_b."""
    stated = zip(_XYZ, hull.centre_of_buoyancy, strict=True)
    return (
        VehicleUnknown("net_weight", "N", "W-B", hull.weight - hull.buoyancy),
        *(VehicleUnknown(f"{axis}_b", "m", f"{axis}_b", value) for axis, value in stated),
    )


def net_and_righting(hull: Hull, params: Params) -> tuple[Any, tuple[Any, Any, Any]]:
    """Return W - B, N, and r_g W - r_b B, N m, with those of `floating_unknowns` that are among the parameters."""
    if not any(one.name in params for one in floating_unknowns(hull)):
        return hull.weight - hull.buoyancy, hull.righting
    net = params.get("net_weight", hull.weight - hull.buoyancy)
    centres = zip(_XYZ, hull.centre_of_gravity, hull.centre_of_buoyancy, strict=True)
    x, y, z = (g * hull.weight - params.get(f"{axis}_b", b) * (hull.weight - net) for axis, g, b in centres)
    return net, (x, y, z)


def rigid_mass_matrix(hull: Hull) -> Float[np.ndarray, "6 6"]:
    """Return M_RB; the unit matrix if the mass is unknown, and 0 for unknown moments of inertia."""
    if hull.mass is None:
        return np.eye(6)
    x, y, z = (hull.mass * part for part in hull.centre_of_gravity)
    xx, yy, zz = (part or 0.0 for part in hull.inertia)
    xy, xz, yz = hull.products
    m = hull.mass
    return np.array(
        [
            [m, 0, 0, 0, z, -y],
            [0, m, 0, -z, 0, x],
            [0, 0, m, y, -x, 0],
            [0, -z, y, xx, -xy, -xz],
            [z, 0, -x, -xy, yy, -yz],
            [-y, x, 0, -xz, -yz, zz],
        ],
        dtype=float,
    )


def added_mass_entry(name: CoefficientName) -> tuple[int, int]:
    """Return the row and column of an added mass such as `Y_rdot`; the entry of M_A is its negative."""
    return AXES.index(name.axis), RATES.index(name.signals[0])


def added_mass_matrix(values: Mapping[str, float]) -> Float[np.ndarray, "6 6"]:
    """Return M_A of the coefficients that are added masses; the others are left out."""
    matrix = np.zeros((6, 6))
    for text, value in values.items():
        name = CoefficientName.parse(text)
        if name.is_added_mass:
            matrix[added_mass_entry(name)] -= value
    return matrix


def asymmetric_pairs(values: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return the pairs of added masses, both given, that should be equal and are not, such as Z_qdot and M_wdot."""
    entries = {}
    for text, value in values.items():
        name = CoefficientName.parse(text)
        if name.is_added_mass:
            entries[added_mass_entry(name)] = (text, value)
    pairs = [(entries[i, j], entries[j, i]) for i, j in entries if i < j and (j, i) in entries]
    return [(a, b) for (a, one), (b, other) in pairs if abs(one - other) > 1e-6 * max(abs(one), abs(other))]


def _three(values: Sequence, place: str, parts: tuple[str, str, str], *, may_lack: bool = False) -> tuple:
    remedy = "give three numbers in SI" + ", None for an unknown one" * may_lack
    given = check_sequence(values, place, remedy)
    if len(given) != 3:
        raise InputError(place, found=f"{len(given)} of them", expected="three: " + ", ".join(parts), remedy=remedy)
    first, second, third = (
        None if may_lack and value is None else check_number(value, f"{place} {part}", remedy=remedy)
        for value, part in zip(given, parts, strict=True)
    )
    return first, second, third


def check_hull_numbers(hull: Hull) -> None:
    """Check every number of a hull by itself.

    Raises:
        InputError: one that is none, or that no vehicle has.
    """
    place = f'vehicle "{hull.name}"'
    if hull.mass is not None:
        check_number(hull.mass, f"{place}, mass", above=0.0, remedy="give the dry mass in kg, or None if it is unknown")
        for axis, moment in zip(_XYZ, hull.inertia, strict=True):
            if moment is not None:
                check_number(moment, f"{place}, inertia {axis}", above=0.0)
        for key in ("weight", "buoyancy"):  # both 0 of a hull that only surges
            check_number(getattr(hull, key), f"{place}, {key}", least=0.0)
    check_number(hull.thrust_deduction, f"{place}, thrust_deduction", least=0.0, below=1.0, remedy=_SHARE)
    check_number(hull.wake, f"{place}, wake", below=1.0, remedy=_SHARE)
    for key, value in {**hull.fixed, **hull.trim}.items():
        check_number(value, f"{place}, {key}")


def _check_body(hull: Hull) -> None:
    """Check the moments of inertia about the centre of gravity: of no body one exceeds the sum of the two others."""
    inertia = rigid_mass_matrix(hull)[3:, 3:]
    r = np.array(hull.centre_of_gravity)
    steiner = (hull.mass or 0.0) * (r @ r * np.eye(3) - np.outer(r, r))
    known = [axis for axis in range(3) if hull.inertia[axis] is not None]
    about_centre = inertia - steiner
    slack = 1e-9 * np.abs(inertia).max(initial=0.0)
    least = min((about_centre[i, i] for i in known), default=0.0)
    principal = np.linalg.eigvalsh(about_centre) if len(known) == 3 else np.zeros(3)
    if least < -slack or principal[0] < -slack or principal[2] > principal[0] + principal[1] + slack:
        shown = ", ".join(f"{value:.4g}" for value in (principal if len(known) == 3 else np.diag(about_centre)[known]))
        raise InputError(
            f'vehicle "{hull.name}", inertia',
            found=f"moments of inertia about the centre of gravity of {shown} kg m^2",
            expected="positive ones, none above the sum of the two others",
            remedy="give inertia about the body's origin, and check the centre of gravity and the products of inertia",
        )


def _check_symmetry(hull: Hull) -> None:
    for one, other in asymmetric_pairs(hull.fixed):
        raise InputError(
            f'vehicle "{hull.name}", added mass',
            found=f"{one} = {hull.fixed[one]}, {other} = {hull.fixed[other]}",
            expected="equal values: the added mass of an ideal fluid is symmetric",
            remedy="correct one of them, or give symmetric=False for values measured at a free surface",
        )
