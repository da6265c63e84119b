"""Eqs. (4) and (5) of the paper, divided by m - X_udot as its filter needs them, against automatic differentiation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.numerics.gaussian import independent
from seatrial.vehicles.catalogue import load_surge
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.whole import whole_vehicle

ENTRY = load_surge("remus100_surge")
MODEL, PARAMS = whole_vehicle(ENTRY.hull, tuple(ENTRY.coefficients), moves=("u",)), ENTRY.coefficients
INERTIA, DEDUCTION = 30.48 + 0.93, 0.1


def by_speed(u):
    """Eq. (4)."""
    return (PARAMS["X_u"] + 2 * PARAMS["X_uabsu"] * np.sqrt(u**2)) / INERTIA


def by_params(u, n):
    """Eq. (5), first column."""
    return np.array([u, u * abs(u), (1 - DEDUCTION) * n * abs(n)]) / INERTIA


@pytest.mark.parametrize(
    ("u", "n"), [(1.5418, 125.0), (0.3, 160.0), (-0.8, 125.0), (-1.7, -90.0), (2.4, 0.0), (0.0, 125.0)]
)
def test_observation_of_the_filter_in_its_own_units(u, n):
    """H of the joint state (15) and the outputs (16), thrust in 1e-4 kg m/rad^2; |u| has no derivative at 0, u|u| has."""
    scales = (1.0, 1.0, 1e-4)
    initial = independent(np.zeros(4), np.ones(4))
    space = discretise(MODEL, ("u", "udot"), initial, np.zeros(4), np.ones(2), scales)
    state = jnp.array([u, -1.21, -2.93, 6.28])
    jacobian = jax.jacfwd(lambda x: jnp.stack(space.observe(tuple(x), (n,))))(state)
    expected = [[1, 0, 0, 0], [by_speed(u), *by_params(u, n) * scales]]
    assert np.allclose(jacobian, expected, rtol=1e-13, atol=0)
