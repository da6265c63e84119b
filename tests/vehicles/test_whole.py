"""Six degrees of freedom against Prestero's equations written out in NumPy, and against motions known in closed form."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.numerics.integrate import rk4_looped, rk4_unrolled
from seatrial.numerics.rotations import angles_of_quaternion, quaternion_of_angles
from seatrial.vehicles.active_dof import acting_terms
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.linearise import linearise
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import stated_mass, whole_vehicle
from tests.vehicles import prestero_twin as twin

REMUS = load_vehicle("remus100_prestero")
ALL = ("x", "y", "z")
EULER = REMUS.build(attitude="euler", positions=ALL)
QUATERNION = REMUS.build(positions=ALL)
POINT = np.array([1.4, 0.12, -0.08, 0.3, -0.2, 0.25, 3.0, -1.0, 5.0, 0.3, -0.4, 1.1])
FINS = (0.1, -0.07)


def by_angles(state):
    """State with Euler angles, of one with a quaternion."""
    return np.concatenate(
        [state[..., :9], np.stack(angles_of_quaternion(tuple(np.moveaxis(state[..., 9:13], -1, 0))), -1)], -1
    )


def by_quaternion(state):
    return np.concatenate([state[:9], quaternion_of_angles(*state[9:12])])


def fins(n, step):
    """Steps of rudder and stern plane."""
    time = np.arange(n) * step
    rudder = np.where(time > 5, 0.08, 0.0) - np.where(time > 20, 0.14, 0.0) + np.where(time > 40, 0.1, 0.0)
    return rudder, np.where(time > 10, -0.05, 0.0) + np.where(time > 30, 0.08, 0.0)


def test_published_coefficients_are_those_of_the_equations():
    assert dict(REMUS.coefficients) == twin.PUBLISHED
    assert EULER.states == ("u", "v", "w", "p", "q", "r", "x", "y", "z", "phi", "theta", "psi")
    assert QUATERNION.states[9:] == ("q_w", "q_x", "q_y", "q_z")
    assert EULER.controls == QUATERNION.controls == ("delta_r", "delta_s")
    units = QUATERNION.channel_units()
    assert (units["q_w"], units["q_zdot"], units["pdot"], units["phi"], units["x"]) == (
        "1",
        "1/s",
        "rad/s^2",
        "rad",
        "m",
    )


def test_rates_anywhere():
    found = EULER.derivative(REMUS.coefficients, tuple(POINT), FINS)
    assert np.allclose(found, twin.rate(POINT, *FINS), rtol=1e-12, atol=1e-13)
    found = QUATERNION.derivative(REMUS.coefficients, tuple(by_quaternion(POINT)), FINS)
    assert np.allclose(found[:9], twin.rate(POINT, *FINS)[:9], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("moves", [("u", "v", "w", "p", "q", "r"), ("u", "w", "q"), ("u",)])
def test_another_mass_among_the_parameters_is_that_of_another_hull(moves):
    """Coriolis forces and the coupling by the centre of gravity included; weight, buoyancy and inertia stay as stated."""
    fixed = {name: value for name, value in REMUS.hull.fixed.items() if name != "X_udot"}
    body = replace(REMUS.hull, centre_of_gravity=(0.02, -0.01, 0.03), fixed=fixed)
    terms = acting_terms((*REMUS.coefficients, "X_udot"), moves)
    values = {name: {**REMUS.coefficients, "X_udot": -0.93}[name] for name in terms}
    states = dict(zip(("u", "v", "w", "p", "q", "r", *ALL, "phi", "theta", "psi"), POINT, strict=True))
    heavier = replace(body, mass=body.mass + 4.0)
    stated, other = (whole_vehicle(hull, terms, moves=moves, attitude="euler") for hull in (body, heavier))
    state, control = tuple(states[name] for name in stated.states), (0.1,) * len(stated.controls)
    moved = stated.derivative({**values, "mass": heavier.mass}, state, control)
    assert np.allclose(moved, other.derivative(values, state, control), rtol=1e-12, atol=1e-14)
    assert not np.allclose(moved, stated.derivative(values, state, control), rtol=1e-3)
    assert stated_mass(stated) == body.mass


def test_a_minute_with_steps_of_propeller_rudder_and_stern_plane():
    """Hall and Anstee's propeller; the same steps of the same integrator, so only rounding is left."""
    vehicle, step, n = load_vehicle("remus100_hall_anstee"), 0.05, 1201
    model = vehicle.build(attitude="euler", positions=ALL)
    rudder, plane = fins(n, step)
    turns = np.where(np.arange(n) * step > 15, 150.0, 110.0)
    drive = np.outer(turns**2, [0.9 * 6.279e-4, -1.121e-5])
    changed = {**twin.PUBLISHED, "X_uabsu": -2.9355}
    start = np.array([1.2, *np.zeros(11)])
    assert model.controls == ("n", "delta_r", "delta_s")
    found = simulate(model, vehicle.coefficients, np.column_stack([turns, rudder, plane]), np.full(n, step), start)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, "W", 30.48 * 9.81)
        patch.setattr(twin, "B", 30.48 * 9.81 + 3.336)
        expected = twin.trajectory(start, rudder, plane, step, drive, c=changed)
    assert np.abs(expected[:, 10]).max() < 1.4
    assert np.abs(expected[:, 5]).max() > 0.1
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_quaternion_moves_as_euler_angles_do():
    rudder, plane = fins(601, 0.02)
    control, step, start = np.column_stack([rudder, plane]), np.full(601, 0.02), np.array([1.5, *np.zeros(11)])
    euler = simulate(EULER, REMUS.coefficients, control, step, start)
    found = by_angles(np.asarray(simulate(QUATERNION, REMUS.coefficients, control, step, by_quaternion(start))))
    assert np.abs(found - euler).max() < 1e-6


@pytest.mark.proof
def test_both_forms_of_the_integrator_agree():
    control, step = np.tile(FINS, (50, 1)), np.full(50, 0.05)
    one, other = (
        simulate(QUATERNION, REMUS.coefficients, control, step, by_quaternion(POINT), integrator)
        for integrator in (rk4_looped, rk4_unrolled)
    )
    assert np.allclose(one, other, rtol=1e-12, atol=1e-13)


@pytest.mark.proof
@pytest.mark.parametrize("current", ["state", "given", (0.4, -0.3, 0.1)])
def test_a_uniform_current_carries_the_vehicle_along(current):
    """The twin has its velocities over ground and the current inside its forces; here they are through the water.

    They differ by the error of the integrator: 2e-7 at 0.02 s, of fourth order.
    """
    water, n, step = np.array([0.4, -0.3, 0.1]), 201, 0.02
    rudder, plane = fins(n, step)
    ground = POINT.copy()
    ground[:3] += twin.rotation(*POINT[9:]).T @ water
    expected = twin.trajectory(ground, rudder, plane, step, current=water)
    model = REMUS.build(attitude="euler", positions=ALL, current=current)
    control = np.column_stack([rudder, plane, *(np.tile(water, (n, 1)).T if current == "given" else ())])
    start = np.concatenate([POINT, water]) if current == "state" else POINT
    found = np.asarray(simulate(model, REMUS.coefficients, control, np.full(n, step), start))
    still = simulate(EULER, REMUS.coefficients, control[:, :2], np.full(n, step), POINT)
    assert np.allclose(found[:, [0, 1, 2, 3, 4, 5, 9, 10, 11]], still[:, [0, 1, 2, 3, 4, 5, 9, 10, 11]], atol=1e-12)
    assert np.allclose(found[:, 3:12], expected[:, 3:], atol=5e-7)
    shown = [
        model.output(name, REMUS.coefficients, tuple(found[-1]), tuple(control[-1])) for name in ("u_g", "v_g", "w_g")
    ]
    assert shown == pytest.approx(expected[-1, :3], abs=5e-7)
    units = {"u_g": "m/s", "xdot": "m/s"} | ({"current_x": "m/s"} if current == "state" else {})
    assert {name: model.channel_units()[name] for name in units} == units


RESTRICTIONS = [
    ("u",), ("w",), ("v", "r"), ("u", "w", "q"), ("u", "v", "r"), ("v", "p", "r"), ("p",), ("u", "v", "w", "r"), ("w", "q"),
]  # fmt: skip


@pytest.mark.parametrize("moves", RESTRICTIONS)
def test_every_restriction_is_the_whole_with_the_rest_held(moves):
    """Held velocities leave rows and columns of the mass matrix out, and their products from the forces."""
    model = REMUS.build(moves=moves, attitude="euler")
    index = ["uvwpqr".index(rate) for rate in moves]
    nu, angles = np.zeros(6), dict.fromkeys(("phi", "theta", "psi"), 0.0)
    nu[index] = POINT[index]
    angles |= {name: 0.3 for name in model.states if name in angles}
    state = tuple(nu[index]) + tuple(angles[name] for name in model.states[len(moves) :])
    control = tuple(dict(zip(("delta_r", "delta_s"), FINS, strict=True))[name] for name in model.controls)
    rudder = dict(zip(model.controls, control, strict=True))
    forces = twin.forces(nu, list(angles.values()), rudder.get("delta_r", 0.0), rudder.get("delta_s", 0.0))
    expected = np.linalg.solve(twin.MASS_MATRIX[np.ix_(index, index)], forces[index])
    values = {str(name): REMUS.coefficients[str(name)] for name in model.coefficients}
    found = model.derivative(values, state, control)
    assert np.allclose(found[: len(moves)], expected, rtol=1e-12, atol=1e-13)
    turning = sum(rate in "pqr" for rate in moves)
    assert len(model.states) == len(moves) + {0: 0, 1: int(moves[-1] in "pq"), 2: 2}[turning]


def test_angles_that_are_shown_are_kept():
    assert REMUS.build(("v", "r"), given=("u",)).states == ("v", "r")
    assert REMUS.build(("v", "r"), given=("u",), angles=("psi",)).states == ("v", "r", "psi")
    model = REMUS.build(("u", "v", "r"), positions=("x", "y"), angles=("psi",))
    assert model.states == ("u", "v", "r", "x", "y", "psi")
    assert REMUS.build(attitude="euler", angles=("psi",)).states[6:] == ("phi", "theta", "psi")


def test_axes_of_given_velocities_are_restrictions():
    """Sway and yaw with the surge speed measured: the rigid body's Coriolis forces are known terms of the axes."""
    hull = replace(REMUS.hull, fixed={}, centre_of_gravity=(0.0, 0.0, 0.0))
    terms = ("Y_uv", "Y_ur", "Y_uudelta_r", "Y_vabsv", "N_uv", "N_ur", "N_uudelta_r")
    values = {name: twin.PUBLISHED[name] for name in terms}
    model = whole_vehicle(hull, terms, moves=("v", "r"), given=("u",))
    assert (model.states, model.controls) == (("v", "r"), ("u", "delta_r"))
    sway = axis_equation("Y", ("Y_uv", "Y_uudelta_r", "Y_vabsv"), inertia=30.48, known={"Y_ur": values["Y_ur"] - 30.48})
    yaw = axis_equation("N", terms[4:], inertia=3.45)
    axes = axes_vehicle("hull", (sway, yaw), per_unit_inertia=False)
    assert axes.states == model.states
    control = (1.5, 0.2)
    at = {"u": 1.5, "delta_r": 0.2}
    expected = axes.derivative(values, (0.2, -0.1), tuple(at[name] for name in axes.controls))
    assert model.derivative(values, (0.2, -0.1), control) == pytest.approx(expected, rel=1e-12)


def test_estimated_added_mass_solves_the_same_equations():
    added = {name: value for name, value in REMUS.hull.fixed.items() if "dot" in name}
    hull = replace(REMUS.hull, fixed={name: value for name, value in REMUS.hull.fixed.items() if name not in added})
    model = whole_vehicle(hull, (*REMUS.coefficients, *added), attitude="euler", positions=ALL)
    found = model.derivative({**REMUS.coefficients, **added}, tuple(POINT), FINS)
    assert np.allclose(found, twin.rate(POINT, *FINS), rtol=1e-11, atol=1e-12)


def test_jacobian_is_that_of_the_equations():
    a, b = linearise(EULER, REMUS.coefficients, POINT, FINS)
    h = 1e-6

    def slope(i):
        moved = [POINT.copy() for _ in range(2)]
        moved[0][i] += h
        moved[1][i] -= h
        return (twin.rate(moved[0], *FINS) - twin.rate(moved[1], *FINS)) / (2 * h)

    assert np.allclose(np.asarray(a), np.column_stack([slope(i) for i in range(12)]), atol=2e-7)
    rudder = (twin.rate(POINT, FINS[0] + h, FINS[1]) - twin.rate(POINT, FINS[0] - h, FINS[1])) / (2 * h)
    assert np.allclose(np.asarray(b)[:, 0], rudder, atol=2e-7)


def test_batch_over_parameters_equals_loops():
    rng = np.random.default_rng(5)
    params = {name: value * rng.uniform(0.9, 1.1, 3) for name, value in REMUS.coefficients.items()}
    control, step = np.tile(FINS, (40, 1)), np.full(40, 0.02)
    batch = jax.vmap(lambda p: simulate(QUATERNION, p, control, step, by_quaternion(POINT)))(params)
    for i in range(3):
        own = {name: value[i] for name, value in params.items()}
        assert np.allclose(
            batch[i], simulate(QUATERNION, own, control, step, by_quaternion(POINT)), rtol=1e-11, atol=1e-12
        )


@pytest.mark.proof
def test_sensitivity_is_that_of_differences():
    control, step = np.tile(FINS, (40, 1)), np.full(40, 0.02)

    def end(drag):
        values = {**REMUS.coefficients, "N_uv": drag}
        return simulate(QUATERNION, values, control, step, by_quaternion(POINT))[-1, 5]

    difference = (end(-24.0 + 1e-4) - end(-24.0 - 1e-4)) / 2e-4
    assert float(jax.jacfwd(end)(jnp.asarray(-24.0))) == pytest.approx(float(difference), rel=1e-6)


def test_models_of_equal_data_are_equal():
    assert REMUS.build(positions=ALL) == QUATERNION
    assert hash(REMUS.build(positions=ALL)) == hash(QUATERNION)
    assert REMUS.build(positions=ALL, current=(0.1, 0.0, 0.0)) != REMUS.build(positions=ALL, current=(0.2, 0.0, 0.0))
    for change in ({"weight": 300.0}, {"wake": 0.1}, {"products": (0.01, 0.0, 0.0)}, {"inertia": (0.2, 3.5, 3.5)}):
        other = whole_vehicle(replace(REMUS.hull, **change), tuple(REMUS.coefficients), positions=ALL)
        assert other != QUATERNION
