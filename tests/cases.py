"""Cases shared by many tests: the published surge vehicle with its golden numbers, and naive formulas for its motion.

The numbers are those of the paper with the propeller speed in rev/s: m - X_udot = 31.4 kg, trim at 12.5 rev/s.
"""

from math import pi, sqrt

import numpy as np

from seatrial.core.record import Channel, Provenance
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.whole import whole_vehicle

RPM = 2 * pi / 60
TERMS = ("X_u", "X_uabsu", "T_nabsn")
MASS = 31.4
X_U, X_UU, THRUST, DEDUCTION = -1.21, -2.93, 6.28e-2, 0.1
TRUTH = {"X_u": X_U, "X_uabsu": X_UU, "T_nabsn": THRUST / (2 * pi) ** 2}
SCALES = (1.0, 1.0, 1 / (2 * pi) ** 2)
"""Filter units: thrust in N/(rev/s)^2, as printed."""
N0 = 12.5 * 2 * pi
U0 = 1.541861549917
"""Golden trim speed, m/s."""

CHANNELS = (
    Channel("n", "rad/s", "control"),
    Channel("u", "m/s", "measurement"),
    Channel("udot", "m/s^2", "measurement"),
)
PROVENANCE = Provenance("trial.csv", "0" * 64, {"clock": "even"})


def paper_hull(**trim: float) -> Hull:
    """Return the hull of the golden numbers."""
    return Hull("paper", mass=30.47, thrust_deduction=DEDUCTION, fixed={"X_udot": -0.93}, trim=trim)


def paper_model(*terms: str) -> VehicleModel:
    """Return the surge model of the golden numbers, with the paper's terms unless others are named."""
    return whole_vehicle(paper_hull(u=U0), terms or TERMS, moves=("u",))


def surge_rate(u, rev_per_s, x_u=X_U, x_uu=X_UU, thrust=THRUST, cubic=0.0):
    """du/dt written out by hand, thrust in N/(rev/s)^2; also right for u with a small imaginary part."""
    modulus = u * np.sign(np.real(u))
    force = x_u * u + x_uu * u * modulus + cubic * (u - U0) ** 3 + (1 - DEDUCTION) * thrust * rev_per_s * abs(rev_per_s)
    return force / MASS


def naive_rk4(rate, x, h):
    """One classical Runge-Kutta step, as in any textbook."""
    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    return x + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6


def riccati_speed(t, u_start, rev_per_s, x_u=X_U, x_uu=X_UU, thrust=THRUST):
    """Exact surge speed under constant propeller speed, for u > 0: du/dt = a (u - fast)(u - slow)."""
    constant = (1 - DEDUCTION) * thrust * rev_per_s * abs(rev_per_s)
    root = sqrt(x_u**2 - 4 * x_uu * constant)
    fast, slow = (-x_u - root) / (2 * x_uu), (-x_u + root) / (2 * x_uu)
    ratio = (u_start - fast) / (u_start - slow) * np.exp(x_uu / MASS * (fast - slow) * np.asarray(t))
    return (fast - slow * ratio) / (1 - ratio)
