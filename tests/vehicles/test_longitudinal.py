"""The longitudinal REMUS 100 against the published numbers, forces and mass matrix written out by hand."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.vehicles.catalogue import load_surge, load_vehicle, surge_names
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import U0

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
SURGE = replace(ENTRY, hull=NEUTRAL).build(moves=("u",))
ADDED = {name: value for name, value in ENTRY.hull.fixed.items() if "dot" in name}
IDEAL = {"X_wq": -35.5, "X_qq": -1.93, "Z_uq": 0.93, "M_uw": 34.57, "M_uq": 1.93}
"""Coriolis forces of the added mass, by Kirchhoff's equations: Z_wdot, Z_qdot, -X_udot, X_udot - Z_wdot, -Z_qdot."""
LEVEL = (0.0, 0.0, 0.0, 0.0)


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


def test_free_added_mass_is_part_of_the_inertia():
    hull = replace(
        ENTRY.hull, fixed={name: x for name, x in ENTRY.hull.fixed.items() if name not in ("Z_wdot", "M_qdot")}
    )
    model = longitudinal_vehicle(hull, (*PARAMS, "Z_wdot", "M_qdot"))
    params, state = {**PARAMS, "Z_wdot": -35.5, "M_qdot": -4.88}, random_states()[0]
    assert model.derivative(params, state, (90.0, 0.1)) == pytest.approx(
        tuple(map(float, MODEL.derivative(PARAMS, state, (90.0, 0.1)))), rel=1e-13
    )
    assert [model.unit_of(term) for term in model.coefficients[-2:]] == ["kg", "kg m^2/rad"]


def energy(hull, state):
    """Kinetic energy of body and water, and potential energy of weight and buoyancy; z points down."""
    u, w, q, z, theta = state
    x_g, _, z_g = hull.centre_of_gravity
    nu, matrix = jnp.stack([u, w, q]), jnp.asarray(matrix_by_hand(x_g))
    depth = z - x_g * jnp.sin(theta) + z_g * jnp.cos(theta)
    return 0.5 * nu @ matrix @ nu - WEIGHT * depth + hull.buoyancy * z


def power(hull, terms, params, state, control=()):
    """Rate of change of the energy along the motion."""
    model = longitudinal_vehicle(hull, terms)
    rate = model.derivative(params, state, control)
    return jax.jvp(lambda *x: energy(hull, x), tuple(map(float, state)), tuple(map(float, rate)))[1]


@pytest.mark.parametrize("state", random_states(4, seed=1))
@pytest.mark.parametrize("x_g", [0.0, 0.03])
def test_ideal_fluid_neither_takes_nor_gives_energy(state, x_g):
    hull = replace(ENTRY.hull, **with_centre(x_g), fixed={**ADDED, **IDEAL})
    assert power(hull, (), {}, state) == pytest.approx(0.0, abs=1e-11)


@pytest.mark.proof
def test_energy_of_a_free_motion_stays():
    hull = replace(ENTRY.hull, fixed={**ADDED, **IDEAL})
    start, step = np.array([1.0, 0.3, 0.4, 0.0, 0.2]), 0.005
    drift = []
    for halving in (1, 2):
        n = 2000 * halving
        states = simulate(
            longitudinal_vehicle(hull, ()), {}, np.zeros((n + 1, 0)), np.full(n + 1, step / halving), start
        )
        drift.append(float(energy(hull, states[-1]) - energy(hull, start)))
    assert np.ptp(states[:, 0]) > 0.5
    assert abs(drift[0]) < 1e-8
    assert abs(drift[1]) < abs(drift[0]) / 14


@pytest.mark.parametrize("state", random_states(12, seed=2))
def test_work_of_the_water_by_hand_and_its_sign(state):
    """Cross-flow drag, axial drag and lift all take energy from a vehicle under way; thrust gives (1 - t_d) T u."""
    _, w, q, _, _ = state
    u = abs(state[0])
    work = u * (-1.21 * u - 2.93 * u * abs(u))
    work += w * (-1310 * w * abs(w) - 0.632 * q * abs(q)) + q * (3.18 * w * abs(w) - 188 * q * abs(q))
    lift = {"Z_uw": -28.6, "Z_uq": -6.15, "M_uw": -4.47 - 6.15, "M_uq": -3.93}
    work += u * (lift["Z_uw"] * w**2 + (lift["Z_uq"] + lift["M_uw"]) * w * q + lift["M_uq"] * q**2)
    total = {name: lift.get(name, 0.0) + IDEAL.get(name, 0.0) for name in {**lift, **IDEAL}}
    drag = {name: value for name, value in PARAMS.items() if name not in total and "delta" not in name}
    coasting, driven = ((u, *state[1:]), (0.0,)), ((u, *state[1:]), (125.0,))
    hull = replace(ENTRY.hull, fixed=ADDED)
    params = {**total, **drag}
    assert power(hull, tuple(params), params, *coasting) == pytest.approx(work, rel=1e-11)
    assert work < 0
    assert power(hull, tuple(params), params, *driven) == pytest.approx(work + 0.9 * 6.28e-4 * 125**2 * u, rel=1e-11)


def test_surge_vehicle_is_the_restriction():
    """In level motion the surge equation holds with m z_g dq/dt on its left; with z_g = 0 nothing else moves."""
    published = load_surge("remus100_surge")
    again = whole_vehicle(published.hull, tuple(published.coefficients), moves=("u",))
    model = longitudinal_vehicle(NEUTRAL, tuple(PARAMS))
    for u in (-1.0, 0.0, 0.4, U0, 2.6):
        for n in (-60.0, 90.0, 125.0, 150.0):
            alone = SURGE.derivative(PARAMS, (u,), (n,))[0]
            rate = model.derivative(PARAMS, (u, *LEVEL), (n, 0.0))
            assert alone == pytest.approx(again.derivative(published.coefficients, (u,), (n,))[0], abs=1e-12)
            assert (MASS + 0.93) * rate[0] + MASS * Z_G * rate[2] == pytest.approx((MASS + 0.93) * alone, abs=1e-12)
            assert abs(rate[1]) <= 0.05 * abs(alone)


def test_surge_motion_is_the_restricted_motion():
    control = 125.0 + np.repeat([0.0, 21.0, -21.0, 0.0], 200)[:, None]
    step = np.full(800, 0.02)
    upright = longitudinal_vehicle(replace(NEUTRAL, **with_centre(z_g=0.0)), tuple(PARAMS))
    whole = simulate(upright, PARAMS, np.hstack([control, 0 * control]), step, np.array([1.4, *LEVEL]))
    surge = simulate(SURGE, PARAMS, control, step, np.array([1.4]))
    assert np.abs(whole[:, 0] - surge[:, 0]).max() < 1e-12
    assert (np.asarray(whole[:, 1:]) == 0).all()


def test_low_centre_of_gravity_changes_surge_by_a_thousandth():
    """Heave and pitch free, the surge inertia is the inverse of an entry of the inverse mass matrix."""
    effective = 1 / np.linalg.inv(matrix_by_hand())[0, 0]
    rate = longitudinal_vehicle(NEUTRAL, tuple(PARAMS)).derivative(PARAMS, (1.0, *LEVEL), (125.0, 0.0))
    surge = SURGE.derivative(PARAMS, (1.0,), (125.0,))
    assert rate[0] / surge[0] == pytest.approx(31.41 / effective, rel=1e-12)
    assert 1e-3 < rate[0] / surge[0] - 1 < 2e-3


def test_batch_over_parameters_equals_loops():
    rng = np.random.default_rng(4)
    params = {name: value * rng.uniform(0.9, 1.1, 3) for name, value in PARAMS.items()}
    control, step = np.tile([125.0, -0.05], (50, 1)), np.full(50, 0.02)
    start = np.array([1.5, 0.0, 0.0, 0.0, 0.0])
    batch = jax.vmap(lambda p: simulate(MODEL, p, control, step, start))(params)
    for i in range(3):
        one = simulate(MODEL, {name: value[i] for name, value in params.items()}, control, step, start)
        assert np.allclose(batch[i], one, rtol=1e-11, atol=1e-13)


def test_models_of_equal_data_are_equal():
    assert longitudinal_vehicle(ENTRY.hull, tuple(PARAMS)) == MODEL
    assert hash(longitudinal_vehicle(ENTRY.hull, tuple(PARAMS))) == hash(MODEL)
    for change in (with_centre(z_g=0.02), {"buoyancy": WEIGHT}, {"inertia": (None, 3.5, None)}):
        assert longitudinal_vehicle(replace(ENTRY.hull, **change), tuple(PARAMS)) != MODEL


@pytest.mark.parametrize(
    ("changes", "terms", "message"),
    [
        ({"mass": 0.0}, ["X_u"], "mass"),
        ({"mass": float("nan")}, ["X_u"], "mass"),
        ({"inertia": (None, -1.0, None)}, ["X_u"], "inertia y"),
        ({"buoyancy": -1.0}, ["X_u"], "buoyancy"),
        ({"thrust_deduction": 1.0}, ["X_u"], "thrust_deduction"),
        ({"fixed": {"X_u": float("inf")}}, [], "X_u"),
        ({}, ["Y_v"], "axis Y does not move"),
        ({}, ["Z_v"], "v is zero"),
        ({}, ["X_du3"], 'no trim value of "u"'),
        ({}, ["X_u2", "X_absuabsu"], "the same regressor as X_u2"),
        ({}, ["Z_wdotu"], "acceleration"),
        ({}, ["Z_wdot2"], "acceleration"),
        ({}, ["T_udot"], "acceleration"),
        ({}, ["Z_vdot"], "v is zero"),
        ({"fixed": {"X_udot": 40.0}}, [], "positive definite"),
        ({"fixed": {"M_qdot": 4.0}}, [], "positive definite"),
        (with_centre(z_g=1.0), [], "positive definite"),
    ],
)
def test_impossible_vehicles(changes, terms, message):
    with pytest.raises(InputError, match=message):
        longitudinal_vehicle(replace(whole_hull("a", MASS, (None, INERTIA, None)), **changes), terms)


def test_every_channel_has_a_unit():
    units = longitudinal_vehicle(ENTRY.hull, tuple(ENTRY.coefficients)).channel_units()
    assert (units["z"], units["zdot"], units["thetadot"], units["qdot"]) == ("m", "m/s", "rad/s", "rad/s^2")
