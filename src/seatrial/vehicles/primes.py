"""Coefficients without dimension and back: primes by density, length and speed (SNAME 1950; Prime I of Fossen, table 7.2).

    c = c' rho/2 L^a U^b

The powers follow from the dimension of the coefficient alone: forces are in rho/2 U^2 L^2, moments in rho/2 U^2 L^3, velocities
in U, turning rates in U/L; angles stay as they are. A mass is in rho/2 L^3, an inertia in rho/2 L^5. Where tables of a ship are in
primes of its own instantaneous speed, a coefficient of order k in the motion carries U^(2-k): constants of U are those here only at
the speed given. Terms of a change of speed, `X_du2`, are handled alike.

Tables of ships often count the rigid body's own Coriolis forces among the coefficients (m' in X_vr and Y_r, m' x_G' in N_r), which a
whole vehicle makes itself: take them out first. Their rudder is positive to port or to starboard; the signs of Y and N by it tell.
"""

from seatrial.core.coefficients import CoefficientName


def prime_scale(name: str, *, density: float, length: float, speed: float) -> float:
    """SI value of a coefficient whose prime is 1.

    Args:
        name: coefficient; propeller speeds count as turning rates.
        density: rho, kg/m^3.
        length: L, m.
        speed: U, m/s.
    """
    dimension = CoefficientName.parse(name).dimension
    # rho/2 takes the kilogram with m^-3; what is left of seconds is U's, what is left of metres is L's.
    return (
        (0.5 * density) ** dimension.kg
        * speed ** (-dimension.s)
        * length ** (dimension.m + 3 * dimension.kg + dimension.s)
    )


def to_prime(name: str, value: float, *, density: float, length: float, speed: float) -> float:
    """Value without dimension of a coefficient in SI; arguments as `prime_scale`."""
    return value / prime_scale(name, density=density, length=length, speed=speed)


def from_prime(name: str, value: float, *, density: float, length: float, speed: float) -> float:
    """SI value of a coefficient without dimension; arguments as `prime_scale`."""
    return value * prime_scale(name, density=density, length=length, speed=speed)
