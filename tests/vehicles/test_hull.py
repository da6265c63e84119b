import numpy as np
import pytest

from seatrial.core.coefficients import CoefficientName
from seatrial.vehicles.catalogue import from_prime, prime_scale
from seatrial.vehicles.hull import rigid_mass_matrix, whole_hull
from seatrial.vehicles.whole import mass_solver


def test_mass_matrix_gives_the_energy_of_a_cloud_of_points():
    rng = np.random.default_rng(1)
    places, masses = rng.normal(size=(12, 3)), rng.uniform(0.5, 2.0, 12)
    mass = masses.sum()
    squares = np.einsum("k,ki,kj->ij", masses, places, places)
    inertia = np.trace(squares) * np.eye(3) - squares
    hull = whole_hull(
        "cloud",
        mass,
        np.diag(inertia),
        products=(squares[0, 1], squares[0, 2], squares[1, 2]),
        centre_of_gravity=masses @ places / mass,
    )
    for nu in rng.normal(size=(5, 6)):
        speeds = nu[:3] + np.cross(nu[3:], places)
        energy = 0.5 * masses @ (speeds**2).sum(1)
        assert 0.5 * nu @ rigid_mass_matrix(hull) @ nu == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("moving", [(0, 1, 2, 3, 4, 5), (1, 3, 5), (4,), (0, 2, 4)])
def test_solver_with_constant_and_free_entries(moving):
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6)) * (rng.uniform(size=(6, 6)) > 0.4)
    matrix, force = root @ root.T + 8 * np.eye(6), rng.normal(size=6)
    expected = np.linalg.solve(matrix[np.ix_(moving, moving)], force[list(moving)])
    assert np.allclose(mass_solver(matrix, (), moving)({}, force), expected, rtol=1e-12)
    free = [CoefficientName.parse(name) for name in ("X_udot", "N_vdot", "Y_rdot", "M_qdot")]
    values = {"X_udot": -1.0, "N_vdot": 0.3, "Y_rdot": 0.2, "M_qdot": -2.0}
    added = np.zeros((6, 6))
    added[0, 0], added[5, 1], added[1, 5], added[4, 4] = -1.0, 0.3, 0.2, -2.0
    acting = [
        name for name in free if "XYZKMN".index(name.axis) in moving and "uvwpqr".index(name.signals[0]) in moving
    ]
    assert np.allclose(mass_solver(matrix + added, acting, moving)(values, force), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "powers"),
    [
        ("X_u", (1, 2, 1)), ("X_uabsu", (1, 2, 0)), ("Y_v", (1, 2, 1)), ("Y_r", (1, 3, 1)), ("N_v", (1, 3, 1)),
        ("N_r", (1, 4, 1)), ("Y_vdot", (1, 3, 0)), ("Y_rdot", (1, 4, 0)), ("N_rdot", (1, 5, 0)), ("Y_delta_r", (1, 2, 2)),
        ("N_delta_r", (1, 3, 2)), ("Y_v3", (1, 2, -1)), ("N_vvr", (1, 4, -1)), ("X_0", (1, 2, 2)), ("Y_uudelta_r", (1, 2, 0)),
    ],
)  # fmt: skip
def test_primes_of_the_textbook(name, powers):
    """Powers of rho/2, L and U as in the table of Prime I."""
    rho, length, speed = 1025.0, 160.93, 7.7175
    expected = (0.5 * rho) ** powers[0] * length ** powers[1] * speed ** powers[2]
    assert prime_scale(name, density=rho, length=length, speed=speed) == pytest.approx(expected, rel=1e-12)
    assert from_prime(name, 3.0, density=rho, length=length, speed=speed) == pytest.approx(3.0 * expected)
