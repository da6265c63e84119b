"""The longitudinal REMUS 100 against the published numbers, forces and mass matrix written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.vehicles.catalogue import load_vehicle, surge_names
from seatrial.vehicles.whole import whole_vehicle

MASS, INERTIA, Z_G, GRAVITY, NET_BUOYANCY, DEDUCTION = 30.48, 3.45, 0.0196, 9.81, 3.336, 0.1
PUBLISHED = {
    "X_udot": -0.93, "Z_wdot": -35.5, "Z_qdot": -1.93, "M_wdot": -1.93, "M_qdot": -4.88, "X_wq": -35.5, "X_qq": -1.93,
    "X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "Z_wabsw": -1310.0, "Z_qabsq": -0.632, "Z_uw": -28.6,
    "Z_uq": -5.22, "Z_uudelta_s": -9.64, "M_wabsw": 3.18, "M_qabsq": -188.0, "M_uw": 24.0, "M_uq": -2.0,
    "M_uudelta_s": -6.15,
}  # fmt: skip
WEIGHT = MASS * GRAVITY


def matrix_by_hand(x_g=0.0):
    """Rigid body plus added mass; surge, heave, pitch."""
    return np.array(
        [
            [MASS + 0.93, 0.0, MASS * Z_G],
            [0.0, MASS + 35.5, -MASS * x_g + 1.93],
            [MASS * Z_G, -MASS * x_g + 1.93, INERTIA + 4.88],
        ]
    )


def forces(u, w, q, theta, n, delta, x_g=0.0, net_buoyancy=NET_BUOYANCY):
    """Everything on the right-hand side of the three equations of motion."""
    s, c, net = np.sin(theta), np.cos(theta), -net_buoyancy
    x = -net * s - 1.21 * u - 2.93 * u * abs(u) + 0.9 * 6.28e-4 * n * abs(n)
    x += (-35.5 - MASS) * w * q + (-1.93 + MASS * x_g) * q**2
    z = net * c - 1310 * w * abs(w) - 0.632 * q * abs(q) - 28.6 * u * w + (MASS - 5.22) * u * q - 9.64 * u**2 * delta
    z += MASS * Z_G * q**2
    m = -WEIGHT * (Z_G * s + x_g * c) + 3.18 * w * abs(w) - 188 * q * abs(q) - MASS * Z_G * w * q
    m += 24.0 * u * w + (-2.0 - MASS * x_g) * u * q - 6.15 * u**2 * delta
    return np.array([x, z, m])


ENTRY = load_vehicle("remus100_longitudinal")
NEUTRAL = replace(ENTRY.hull, buoyancy=ENTRY.hull.weight)


def longitudinal_vehicle(hull, terms):
    return whole_vehicle(hull, terms, moves=("u", "w", "q"), positions=("z",))


def with_centre(x_g=0.0, z_g=Z_G):
    return {"centre_of_gravity": (x_g, 0.0, z_g)}


MODEL, PARAMS = longitudinal_vehicle(ENTRY.hull, tuple(ENTRY.coefficients)), ENTRY.coefficients


def random_states(n=6, seed=0):
    rng = np.random.default_rng(seed)
    return [tuple(rng.normal(size=5) * [2.0, 0.5, 0.7, 3.0, 0.6]) for _ in range(n)]


def test_remus100_as_published():
    hull = ENTRY.hull
    assert {**hull.fixed, **ENTRY.coefficients} == PUBLISHED
    assert (hull.mass, hull.inertia[1], hull.centre_of_gravity) == (MASS, INERTIA, (0.0, 0.0, Z_G))
    assert hull.weight == MASS * GRAVITY
    assert hull.thrust_deduction == DEDUCTION
    assert hull.buoyancy - WEIGHT == pytest.approx(NET_BUOYANCY, abs=1e-12)
    assert "remus100_longitudinal" not in surge_names()


@pytest.mark.parametrize("state", random_states())
@pytest.mark.parametrize("x_g", [0.0, 0.05])
def test_equations_of_the_thesis(state, x_g):
    u, w, q, _, theta = state
    n, delta = 80.0, -0.15
    model = longitudinal_vehicle(replace(ENTRY.hull, **with_centre(x_g)), tuple(PARAMS))
    expected = np.linalg.solve(matrix_by_hand(x_g), forces(u, w, q, theta, n, delta, x_g))
    rate = model.derivative(PARAMS, state, (n, delta))
    assert rate[:3] == pytest.approx(tuple(expected), rel=1e-12, abs=1e-13)
    assert rate[3:] == pytest.approx((w * np.cos(theta) - u * np.sin(theta), q), rel=1e-13)


def test_every_channel_has_a_unit():
    units = longitudinal_vehicle(ENTRY.hull, tuple(ENTRY.coefficients)).channel_units()
    assert (units["z"], units["zdot"], units["thetadot"], units["qdot"]) == ("m", "m/s", "rad/s", "rad/s^2")
