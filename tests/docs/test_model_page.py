"""The equation of docs/explanation/model.md, with matrices as the page has it, against the right side in the code."""

import numpy as np

from seatrial.vehicles.catalogue import load_vehicle, make_vehicle

MASS, WEIGHT, BUOYANCY = 13.5, 132.0, 131.0
GRAVITY_AT, BUOYANCY_AT = np.array([0.02, -0.01, 0.03]), np.array([0.01, 0.0, -0.01])
INERTIA = np.array([[0.26, -0.01, -0.02], [-0.01, 0.23, -0.03], [-0.02, -0.03, 0.37]])
DEDUCTION = 0.1


def skew(a):
    x, y, z = a
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def coriolis(mass, nu):
    """C(nu) of a symmetric mass matrix (Fossen 2021, eq. 3.46)."""
    momentum, angular = np.split(mass @ nu, 2)
    return np.block([[np.zeros((3, 3)), -skew(momentum)], [-skew(momentum), -skew(angular)]])


def test_the_equation_of_the_page_is_that_of_the_code():
    """A BlueROV2 with weight off the origin and products of inertia, at 100 random motions, attitudes and thrusts."""
    published = load_vehicle("bluerov2_heavy")
    vehicle = make_vehicle(
        "page",
        MASS,
        {**published.coefficients, **published.hull.fixed},
        inertia=np.diag(INERTIA),
        products=(0.01, 0.02, 0.03),
        centre_of_gravity=GRAVITY_AT,
        centre_of_buoyancy=BUOYANCY_AT,
        weight=WEIGHT,
        buoyancy=BUOYANCY,
        thrust_deduction=DEDUCTION,
        thrusters=published.thrusters,
        added_coriolis="automatic",
    )
    model, axes = vehicle.build(), list(zip("XYZKMN", "uvwpqr", strict=True))
    lever = MASS * skew(GRAVITY_AT)
    added = -np.diag([published.hull.fixed[f"{axis}_{rate}dot"] for axis, rate in axes])
    mass = np.block([[MASS * np.eye(3), -lever], [lever, INERTIA]]) + added
    places = [(np.array(t.place), np.array(t.direction) / np.linalg.norm(t.direction)) for t in vehicle.thrusters]
    allocation = np.array([[*d, *np.cross(r, d)] for r, d in places]).T
    known, rng = published.coefficients, np.random.default_rng(47)
    linear = np.array([known.get(f"{axis}_{rate}", 0.0) for axis, rate in axes])
    quadratic = np.array([known.get(f"{axis}_{rate}abs{rate}", 0.0) for axis, rate in axes])
    for _ in range(100):
        nu, thrust, q = rng.normal(size=6), rng.normal(size=8) * 20, rng.normal(size=4)
        w, v = (q := q / np.linalg.norm(q))[0], q[1:]
        down = (np.eye(3) + 2 * w * skew(v) + 2 * skew(v) @ skew(v))[2]
        turning = np.cross(GRAVITY_AT * WEIGHT - BUOYANCY_AT * BUOYANCY, down)
        force = linear * nu + quadratic * nu * abs(nu) + (1 - DEDUCTION) * allocation @ thrust - coriolis(mass, nu) @ nu
        expected = np.linalg.solve(mass, force + np.append((WEIGHT - BUOYANCY) * down, turning))
        found = model.derivative(known, (*nu, *q), tuple(thrust))
        np.testing.assert_allclose(np.array(found[:6], float), expected, rtol=1e-10, atol=1e-12)
