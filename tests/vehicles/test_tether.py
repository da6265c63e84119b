"""A tether: its force against plain NumPy, what it does to energy, and what of it no motion tells from damping."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.core.errors import InputError
from seatrial.core.signals import RATES, thruster_controls
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.hull import added_mass_matrix, rigid_mass_matrix
from seatrial.vehicles.tether import LINEAR, QUADRATIC, Tether

ROV = load_vehicle("bluerov2_heavy")
POINT, K1, K2 = (-0.2, 0.05, -0.1), 4.0, 20.0
SPEEDS = np.array([0.3, -0.2, 0.1, 0.4, -0.3, 0.2])
FORCES = np.array([3.0, -2.0, 5.0, -8.0, 4.0, -1.0, 2.0, -6.0])


def pulled(point, k1, k2, nu):
    """The force and moment from their definition."""
    local = np.asarray(nu[:3]) + np.cross(nu[3:], point)
    force = -(k1 + k2 * np.linalg.norm(local)) * local
    return np.concatenate([force, np.cross(point, force)])


def towing(tether):
    return replace(ROV, hull=replace(ROV.hull, tether=tether))


def rates(vehicle, moves=RATES, values=(), unknowns=(), speeds=SPEEDS, **options):
    model = vehicle.build(moves, attitude="quaternion", unknowns=unknowns, **options)
    known = dict(zip(RATES, speeds, strict=True)) | {
        "q_w": 0.5,
        "q_x": -0.5,
        "q_y": 0.1,
        "q_z": 0.7,
        "phi": 0.2,
        "theta": -0.1,
    }
    state = tuple(known[name] for name in model.states)
    forces = dict(zip(thruster_controls(len(FORCES), commanded_force=True), FORCES, strict=True))
    control = tuple(forces[name] for name in model.controls)
    found = model.derivative({**vehicle.coefficients, **dict(values)}, state, control)
    return np.array(found, float)[: len(moves)]


@pytest.mark.parametrize("moves", [RATES, ("u", "v", "r"), ("w", "q"), ("p",)])
def test_the_vehicle_feels_the_force_and_moment_of_the_definition(moves):
    """M d(nu) is the force of the axes that move; velocities of the others are zero."""
    at = [RATES.index(rate) for rate in moves]
    speeds = np.where(np.isin(np.arange(6), at), SPEEDS, 0.0)
    difference = rates(towing(Tether(POINT, K1, K2)), moves, speeds=speeds) - rates(ROV, moves, speeds=speeds)
    mass = (rigid_mass_matrix(ROV.hull) + added_mass_matrix({**ROV.hull.fixed, **ROV.coefficients}))[np.ix_(at, at)]
    np.testing.assert_allclose(mass @ difference, pulled(POINT, K1, K2, speeds)[at], rtol=1e-9, atol=1e-12)


def test_what_is_sought_takes_the_place_of_what_is_stated():
    vehicle, both = towing(Tether(POINT, 1.0, 2.0)), (LINEAR, QUADRATIC)
    found = rates(vehicle, values={LINEAR: K1, QUADRATIC: K2}, unknowns=both)
    np.testing.assert_allclose(found, rates(towing(Tether(POINT, K1, K2))), atol=1e-12)
    np.testing.assert_allclose(rates(vehicle, unknowns=both), rates(vehicle), atol=1e-12)
    model = vehicle.build(unknowns=both)
    assert [(one.name, one.stated, one.signed) for one in model.unknowns] == [
        (LINEAR, 1.0, False),
        (QUADRATIC, 2.0, False),
    ]
    # Compiled programs are shared by models that are equal.
    assert towing(Tether(POINT, 1.0, 2.0)).build() == towing(Tether(POINT, 1.0, 2.0)).build()
    assert towing(Tether(POINT, 1.0, 2.0)).build() != towing(Tether(POINT, 1.0, 2.1)).build()


FINITE = st.floats(-10.0, 10.0)
DRAG = st.floats(0.0, 1e3)


@pytest.mark.proof
@given(st.tuples(*[FINITE] * 3), DRAG, DRAG, st.tuples(*[FINITE] * 6))
def test_it_only_takes_energy(point, k1, k2, nu):
    """Its power, by the force on the point as by force and moment on the body, is never above 0, and both are the same."""
    force = np.array(Tether(point, k1, k2).force(np.array(nu)), float)
    local = np.asarray(nu[:3]) + np.cross(nu[3:], point)
    power, terms = force[:3] @ local, np.abs(force * nu).sum() + np.abs(force[:3] * local).sum()
    assert power <= 1e-12 * terms
    assert force @ nu == pytest.approx(power, abs=1e-12 * (1.0 + terms))


def test_at_rest_its_slope_is_that_of_the_linear_drag():
    tether = Tether(POINT, K1, K2)
    pull = lambda nu: jnp.stack([jnp.asarray(part) for part in tether.force(tuple(nu))])  # noqa: E731
    expected = np.column_stack([pulled(POINT, K1, 0.0, nu) for nu in np.eye(6)])
    slopes = jax.jit(lambda nu: [of(pull)(nu) for of in (jax.jacfwd, jax.jacrev, jax.hessian)])
    *both, bend = slopes(jnp.zeros(6))
    for slope in both:
        np.testing.assert_allclose(slope, expected, atol=1e-12)
    assert np.isfinite(bend).all()
    np.testing.assert_allclose(-K1 * tether.damping, expected, atol=1e-12)


def test_what_is_refused_is_the_same_force_as_damping():
    """At the origin k_1 is X_u, Y_v and Z_w; where one axis turns, both drags are damping of that axis."""
    lower = {name: ROV.coefficients.get(name, 0.0) - K1 for name in ("X_u", "Y_v", "Z_w")}
    terms = tuple(dict.fromkeys((*ROV.coefficients, *lower)))
    found = rates(towing(Tether((0.0, 0.0, 0.0), K1)))
    np.testing.assert_allclose(found, rates(ROV, values=lower, free=terms), atol=1e-12)
    square = POINT[0] ** 2 + POINT[1] ** 2
    turned = {"N_r": ROV.coefficients.get("N_r", 0.0) - K1 * square}
    turned["N_rabsr"] = ROV.coefficients.get("N_rabsr", 0.0) - K2 * square**1.5
    own = [name for name in ROV.coefficients if name in ("N_r", "N_rabsr", "N_rdot")]
    free = tuple(dict.fromkeys((*own, *turned)))
    found = rates(towing(Tether(POINT, K1, K2)), ("r",), free=free, values=dict.fromkeys(set(turned) - set(own), 0.0))
    np.testing.assert_allclose(found, rates(ROV, ("r",), free=free, values=turned), atol=1e-12)


def refused(tether, moves=RATES, free=None, unknowns=(), **options):
    with pytest.raises(InputError) as caught:
        towing(tether).build(moves, free=free, unknowns=unknowns, **options)
    return caught.value


@pytest.mark.parametrize(
    ("tether", "place", "found"),
    [
        (Tether(POINT, -1.0), "tether, linear", "-1"),
        (Tether(POINT, 0.0, -2.0), "tether, quadratic", "-2"),
        (Tether(POINT, float("nan")), "tether, linear", "nan"),
        (Tether((0.1, 0.2)), "tether, point", "(0.1, 0.2)"),  # pyright: ignore[reportArgumentType]
        (Tether((0.1, 0.2, float("inf"))), "tether, point", "inf"),
    ],
)
def test_numbers_that_no_tether_has(tether, place, found):
    error = refused(tether)
    assert error.where.endswith(place)
    assert found in error.found


@pytest.mark.parametrize("name", [LINEAR, QUADRATIC])
def test_what_only_one_velocity_moves_is_refused_where_it_is_sought(name):
    assert "N_r instead" in refused(Tether(POINT), ("r",), unknowns=(name,)).remedy
    assert "X_u instead" in refused(Tether(), ("u", "r"), unknowns=(name,)).remedy
    assert "give the point" in refused(Tether(), ("q", "r"), unknowns=(name,)).remedy
    towing(Tether(POINT, K1, K2)).build(("r",))  # stated, it is a force that is known
    towing(Tether(POINT)).build(("u", "r"), unknowns=(name,))
    towing(Tether(POINT)).build(("r",), given=("u",), unknowns=(name,))


def test_linear_drag_beside_damping_of_every_entry_is_refused():
    every = ("X_u", "Y_v", "Z_w")
    error = refused(Tether(), free=every, unknowns=(LINEAR, QUADRATIC))
    assert "X_u, Y_v, Z_w, which is the same force" in error.found
    towing(Tether()).build(free=every[:2], unknowns=(LINEAR,))
    towing(Tether()).build(free=every, unknowns=(QUADRATIC,))
    towing(Tether(POINT)).build(free=every, unknowns=(LINEAR,))
    astern = Tether((-0.2, 0.0, 0.0))
    refused(astern, ("v", "r"), ("Y_v", "Y_r", "N_v", "N_r"), (LINEAR,))
    towing(astern).build(("v", "r"), free=("Y_v", "Y_r", "N_r"), unknowns=(LINEAR,))
