"""The vehicle in six degrees of freedom, and every reduced model as a restriction of it.

    (M_RB + M_A) d(nu_r)/dt = sum c_j phi_j(nu_r, attitude, controls) + B T - C(nu_r) nu_r - g(attitude)

Of a vehicle that is held, gauges show the right side: the thrust of a bollard pull, and what the water adds where it is towed.
The velocity nu_r = (u, v, w, p, q, r) is that through the water: in a uniform current the vehicle moves as in still water, and the
current shows in its path and in its velocity over ground alone. Coefficients are on the left as added mass (`Y_rdot`), on the right
by their names. A velocity that does not move is zero, or given as a measured signal and then taken for steady.
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., 2021, eqs. (8.1) to (8.4), section 10.3.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import (
    ANGLES,
    CURRENT_COMPONENTS,
    GAUGE_CHANNELS,
    OVER_GROUND,
    POSITIONS,
    RATES,
    SIGNALS,
    SPECIFIC_FORCE,
)
from seatrial.numerics.rotations import cross, dot, times, total
from seatrial.vehicles.active_dof import AddedCoriolis, Current, Freedom, acts
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.attitude import Attitude, Kind, attitude_states, position_angles, position_rates
from seatrial.vehicles.coriolis import entry_products, matrix_products, summed
from seatrial.vehicles.hull import (
    AXES,
    GRAVITY,
    Hull,
    added_mass_entry,
    added_mass_matrix,
    floating_unknowns,
    net_and_righting,
    rigid_mass_matrix,
)
from seatrial.vehicles.model import Params, VehicleModel, cached_model, outside_force
from seatrial.vehicles.thrusters import (
    Thruster,
    acting_thrusters,
    beyond_dead_zone,
    controls_of,
    real_thrust,
    thrust_unknowns,
)
from seatrial.vehicles.whole_checks import check_has_state, check_whole

# Forces on the six axes but weight and buoyancy: one coefficient for each regressor, made of all that multiplies it.
#
# Named terms, the propeller's share of the thrust, and Coriolis forces of the rigid body and of the added mass that
# are products of the same velocities come together before anything is compiled.

MASS = "mass"  # Name among the parameters of another mass than the stated one, kg

Forces = Callable[[Mapping[str, Any], Mapping[str, Any], tuple], list[Any]]


def forces_of(
    hull: Hull,
    named: Sequence[CoefficientName],
    fixed: Mapping[str, float],
    freedom: Freedom,
    added_coriolis: AddedCoriolis,
    thrusters: Sequence[Thruster],
    inertial: Sequence[CoefficientName],
) -> Callable[[Mapping[str, Any], Mapping[str, Any], tuple], list[Any]]:
    """Return the forces on the six axes but weight and buoyancy: one coefficient for each regressor, made of all that multiply it.

    Args:
        hull: with thrust deduction, wake, trim and tether.
        named: all coefficients that act.
        fixed: values of those that are known, SI.
        freedom: what moves.
        added_coriolis: whether Coriolis forces of the added mass are named or follow from it.
        thrusters: of an open frame; none for one propeller on the axis.
        inertial: added masses that are free.
    """
    share, inflow = 1.0 - hull.thrust_deduction, 1.0 - hull.wake
    sums: dict[CoefficientName, list[tuple[float, str]]] = {}
    thrust = [name for name in named if name.axis == "T"]
    for name in named:
        if name.is_added_mass or (name.axis == "T" and thrusters):
            continue
        if name.axis == "T":
            factor = share * inflow ** sum(f.power for f in name.factors if f.signal == "u" and not f.change)
            sums.setdefault(CoefficientName("", "X", name.factors, name.key), []).append((factor, name.text))
        else:
            sums.setdefault(name, []).append((1.0, name.text))
    # Of a body of which nothing is known there are no products of the rigid body.
    rigid = [] if hull.mass is None else matrix_products(rigid_mass_matrix(hull))
    added = matrix_products(added_mass_matrix(fixed)) if added_coriolis == "automatic" else []
    constant = {p.name: p.factor for p in summed((*rigid, *added)) if acts(p.name, freedom, ())}
    if added_coriolis == "automatic":
        for entry in inertial:
            for product in entry_products(*added_mass_entry(entry)):
                if acts(product.name, freedom, ()):
                    sums.setdefault(product.name, []).append((-product.factor, entry.text))
    for product in constant:
        sums.setdefault(product, [])
    acting = acting_thrusters(thrusters, named, freedom.moves)
    columns = {control: tuple(share * x for x in thruster.column) for _, thruster, control in acting}

    def forces(values: Mapping[str, Any], known: Mapping[str, Any], velocity: tuple) -> list[Any]:
        results: list[Any] = [0.0] * 6
        made: dict[tuple, Any] = {}
        for name, parts in sums.items():
            if name.key not in made:
                made[name.key] = name.regressor(known, hull.trim)
            axis = AXES.index(name.axis)
            scale = total((constant.get(name, 0.0), *(times(factor, values[text]) for factor, text in parts)))
            results[axis] = total((results[axis], times(scale, made[name.key])))
        for _, thruster, control in acting:
            push = beyond_dead_zone(values, control, known[control])
            if thrust:
                local = {**known, control[0]: push, "u": times(inflow, thruster.inflow(velocity))}
                push = total(times(values[term.text], term.regressor(local, hull.trim)) for term in thrust)
            push = real_thrust(values, control, push)
            results = [total((force, times(x, push))) for force, x in zip(results, columns[control], strict=True)]
        if hull.tether is not None:
            results = [total(parts) for parts in zip(results, hull.tether.force(velocity, values), strict=True)]
        return results

    return forces


# Accelerations from forces, M nudot = tau, with everything exploited that is known before compilation.
#
# Axes that no entry couples are solved apart. A constant matrix is inverted once; one with estimated entries is
# eliminated on scalars, without pivoting: a mass matrix is positive definite.

Solve = Callable[..., list[Any]]


def mass_solver(
    constant: Float[np.ndarray, "6 6"],
    free: Sequence[CoefficientName],
    moving: Sequence[int],
    per_mass: Float[np.ndarray, "6 6"] | None = None,
) -> Solve:
    """Return `solve(values, forces, further)`: accelerations of the moving axes for the forces on all six.

    Args:
        constant: rigid body and fixed added mass.
        free: added masses among the values.
        moving: indices of the axes that move; the others stay at rest.
        per_mass: what a kilogram adds to `constant`; `further` is how many there are beyond the stated mass, None for none.
    """
    named: dict[tuple[int, int], list[str]] = {}
    for name in free:
        named.setdefault(added_mass_entry(name), []).append(name.text)
    groups = _coupled_groups(lambda i, j: constant[i, j] != 0 or (i, j) in named, moving)
    inverses = {
        group: np.linalg.inv(constant[np.ix_(group, group)])
        for group in groups
        if len(group) > 1 and not any((i, j) in named for i in group for j in group)
    }

    def solve(values: Mapping[str, Any], forces: Sequence[Any], further: Any = None) -> list[Any]:
        results: dict[int, Any] = {}
        for group in groups:
            right = [forces[i] if len(group) == 1 else _computed_once(forces[i]) for i in group]
            if group in inverses and (further is None or per_mass is None):
                rates = [dot((float(entry) for entry in row), right) for row in inverses[group]]
            else:
                rows = [[_entry(float(constant[i, j]), named.get((i, j), ()), values) for j in group] for i in group]
                if further is not None and per_mass is not None:
                    own = [[times(float(per_mass[i, j]), further) for j in group] for i in group]
                    rows = [[total(pair) for pair in zip(*both, strict=True)] for both in zip(rows, own, strict=True)]
                rates = _eliminate(rows, right)
            results.update(zip(group, rates, strict=True))
        return [results[i] for i in moving]

    return solve


def _computed_once(force: Any) -> Any:
    """Return the same number, which the compiler keeps although several accelerations need it.

    Cheap expressions are computed anew wherever they are used, a quotient never is (decision 2); that this divisor is 1 it cannot know.
    Batched steps of six degrees of freedom take half the time.
    """
    if not isinstance(force, Tracer):
        return force
    return force / jax.lax.stop_gradient(jnp.minimum(jnp.abs(force) + 1.0, 1.0))


def _entry(constant: float, names: Sequence[str], values: Mapping[str, Any]) -> Any:
    result: Any = constant
    for name in names:
        result = result - values[name]
    return result


def _coupled_groups(coupled: Callable[[int, int], bool], moving: Sequence[int]) -> list[tuple[int, ...]]:
    """Return the connected groups of axes, each in ascending order."""
    left, groups = list(moving), []
    while left:
        group = [left.pop(0)]
        for i in group:
            joined = [j for j in left if coupled(i, j) or coupled(j, i)]
            group += joined
            left = [j for j in left if j not in joined]
        groups.append(tuple(sorted(group)))
    return groups


def _eliminate(rows: list[list[Any]], right: list[Any]) -> list[Any]:
    """Solve by Gaussian elimination on scalars; zeros that are Python numbers cost nothing."""
    n = len(right)
    rows, right = [list(row) for row in rows], list(right)
    for k in range(n):
        for i in range(k + 1, n):
            if isinstance(rows[i][k], float) and rows[i][k] == 0.0:
                continue
            share = rows[i][k] / rows[k][k]
            for j in range(k + 1, n):
                rows[i][j] = total((rows[i][j], -times(share, rows[k][j])))
            right[i] = total((right[i], -times(share, right[k])))
    result: list[Any] = [0.0] * n
    for i in reversed(range(n)):
        known = (-times(rows[i][j], result[j]) for j in range(i + 1, n))
        result[i] = total((right[i], *known)) / rows[i][i]
    return result


def whole_vehicle(
    hull: Hull,
    terms: Sequence[str],
    *,
    moves: Sequence[str] = RATES,
    given: Sequence[str] = (),
    attitude: Kind = "quaternion",
    positions: Sequence[str] = (),
    angles: Sequence[str] = (),
    current: Current = None,
    added_coriolis: AddedCoriolis = "named",
    thrusters: Sequence[Thruster] = (),
    actuators: Mapping[str, Actuator] | None = None,
    unknowns: Sequence[str] = (),
) -> VehicleModel:
    """Build a vehicle whose free coefficients are `terms`.

    Its states are the velocities that move, positions, attitude, current and actuators, those that are needed. Fixed coefficients
    without a part in the motion are left out; free ones are refused, see `freedom.acting_terms`.

    Args:
        hull: rigid body, weight, buoyancy, tether, fixed coefficients and trim.
        terms: coefficient names on any axis but Q; those fixed by the hull are left out of `params`.
        moves: velocities that are states, of u v w p q r; the others are zero. None of them for a vehicle that is held by gauges.
        given: velocities and angles that are measured, and enter as controls.
        attitude: quaternion or Euler angles, where the vehicle turns about more than one axis.
        positions: those of x, y and z (north, east, down) that are states.
        angles: Euler angles that are wanted although no force depends on them, such as the heading of a zigzag.
        current: the water's velocity, see `Freedom`.
        added_coriolis: "named" where Coriolis forces of the added mass are among the coefficients (X_wq, Z_uq, M_uw, …), as published
            sets have it; "automatic" where they follow from the added mass, and named ones of the same products are refused.
        thrusters: those of an open frame, driven by n_1, n_2, …, by the terms of T; or, without such terms, by forces f_1, f_2, ….
        actuators: lags and limits by control, see `with_actuators`.
        unknowns: numbers that are parameters beside the coefficients, where this vehicle has them: `net_weight`, `x_b`, `y_b`, `z_b`,
            `gain_f_3` of one thruster, `gain_f` of all, `reverse_f`, their share of thrust astern, `dead_f`, their dead zone, lags of
            actuators, and `tether_linear` and `tether_quadratic` of a tether.

    Raises:
        InputError: malformed name, a signal the model lacks, two names of one regressor, an unphysical constant, or Coriolis forces twice.
    """
    freedom = Freedom(
        tuple(rate for rate in RATES if rate in moves),
        tuple(name for name in SIGNALS if name in given),
        attitude,
        tuple(name for name in POSITIONS if name in positions),
        tuple(name for name in ANGLES if name in angles),
        tuple(current) if isinstance(current, list) else current,
    )
    check_whole(hull, terms, (moves, given, positions, angles, current), added_coriolis, thrusters, unknowns)
    free = tuple(CoefficientName.parse(term) for term in terms if term not in hull.fixed)
    model = assemble(hull, free, freedom, added_coriolis, tuple(thrusters), tuple(unknowns))
    model = with_actuators(model, actuators, unknowns) if actuators else model
    check_has_state(model)
    return model


def assemble(
    hull: Hull,
    free: tuple[CoefficientName, ...],
    freedom: Freedom,
    added_coriolis: AddedCoriolis = "named",
    thrusters: tuple[Thruster, ...] = (),
    unknowns: tuple[str, ...] = (),
) -> VehicleModel:
    """Build the model from parts that have been checked; equal equations are the same functions, whatever else differs in the hull.

    Args:
        hull: rigid body, weight, buoyancy, fixed coefficients and trim.
        free: coefficients that are parameters.
        freedom: what moves.
        added_coriolis: see `whole_vehicle`.
        thrusters: of an open frame; none for one propeller on the axis.
        unknowns: see `whole_vehicle`.
    """
    fixed = {name: value for name, value in hull.fixed.items() if acts(CoefficientName.parse(name), freedom, thrusters)}
    trimmed = {signal for name in (*free, *map(CoefficientName.parse, fixed)) for signal in name.trim_signals}
    trim = {name: value for name, value in hull.trim.items() if name in trimmed}
    bare = replace(hull, name="", fixed=fixed, trim=trim)
    return replace(_assembled(bare, free, freedom, added_coriolis, thrusters, unknowns), name=hull.name)


@cached_model
def _assembled(
    hull: Hull,
    free: tuple[CoefficientName, ...],
    freedom: Freedom,
    added_coriolis: AddedCoriolis,
    thrusters: tuple[Thruster, ...],
    unknowns: tuple[str, ...],
) -> VehicleModel:
    """Build the model of a hull that has nothing without a part in the motion; arguments as `assemble`."""
    fixed, named = hull.fixed, free + tuple(CoefficientName.parse(name) for name in hull.fixed)
    inertial = [name for name in free if name.is_added_mass]
    moving = [RATES.index(rate) for rate in freedom.moves]
    mass = rigid_mass_matrix(hull) + added_mass_matrix(fixed)
    # A kilogram more at the centre of gravity; moments of inertia about the origin, weight and buoyancy stay as stated.
    per_mass = 0.0 * mass if hull.mass is None else rigid_mass_matrix(_point_mass(hull))
    turning = [product for product in matrix_products(per_mass) if acts(product.name, freedom, ())]
    solve = mass_solver(mass, inertial, moving, per_mass)
    floating = tuple(one for one in floating_unknowns(hull) if one.name in unknowns)
    attitude = _attitude(hull, named, freedom, {one.name for one in floating})
    drift = _current_components(freedom)
    states = (*freedom.moves, *freedom.positions, *attitude.states, *(drift if freedom.current == "state" else ()))
    used = {signal for name in named for signal in name.signals} | set(freedom.given)
    used -= {"n", "f"} if thrusters else set()
    plain = (name for name in SIGNALS if name in used and name not in (*states, *RATES, *ANGLES))
    given = (name for name in SIGNALS if name in freedom.given)
    currents = drift if freedom.current == "given" else ()
    controls = (*given, *plain, *controls_of(thrusters, named, freedom.moves), *currents)
    forces = forces_of(hull, named, fixed, freedom, added_coriolis, thrusters, inertial)
    angles = {angle for name in named for angle in name.signals if angle in ANGLES and angle not in controls}

    def known_at(state: tuple, control: tuple) -> dict[str, Any]:
        still = (
            {}
            if isinstance(freedom.current, str)
            else dict(zip(CURRENT_COMPONENTS, freedom.current or (), strict=False))
        )
        return {**still, **dict(zip(states, state, strict=True)), **dict(zip(controls, control, strict=True))}

    def derivative(params: Params, state: tuple, control: tuple) -> tuple:
        known = known_at(state, control)
        velocity = tuple(known.get(rate, 0.0) for rate in RATES)
        pose = attitude.at(known)
        if angles:
            known |= dict(zip(ANGLES, pose.euler(), strict=True))
        vertical = pose.rows[2]
        net, righting = net_and_righting(hull, params if floating else {})
        weight = (*(times(net, part) for part in vertical), *cross(righting, vertical))
        values = {**fixed, **params}
        acting = forces(values, known, velocity)
        outside = [params.get(outside_force(axis), 0.0) for axis in AXES]
        further = params[MASS] - hull.mass if MASS in params and hull.mass is not None else None
        if further is not None:
            for name, factor in turning:
                at = AXES.index(name.axis)
                outside[at] = total((outside[at], times(factor, further * name.regressor(known, hull.trim))))
        resulting = [total((weight[i], acting[i], outside[i])) if i in moving else 0.0 for i in range(6)]
        rates = solve(values, resulting, further)
        water = {name: known[f"current_{name}"] for name in freedom.positions if f"current_{name}" in known}
        return (
            *rates,
            *position_rates(freedom.positions, pose, velocity[:3], water),
            *attitude.rates(pose, velocity[3:]),
            *(0.0 for _ in drift if freedom.current == "state"),
        )

    def shown(name: str) -> Callable[[Params, tuple, tuple], Any]:
        """Return a channel that is no state: an Euler angle, a velocity over ground, a specific force, or the force on a gauge."""

        def value(params: Params, state: tuple, control: tuple) -> Any:
            known = known_at(state, control)
            pose = attitude.at(known)
            if name in SPECIFIC_FORCE:
                axis = SPECIFIC_FORCE.index(name)
                rates = dict(zip(states, derivative(params, state, control), strict=True))
                u, v, w, p, q, r = (known.get(rate, 0.0) for rate in RATES)
                turning = cross((p, q, r), (u, v, w))[axis]
                return total((rates.get(RATES[axis], 0.0), turning, times(-GRAVITY, pose.rows[2][axis])))
            if name in GAUGE_CHANNELS:
                velocity = tuple(known.get(rate, 0.0) for rate in RATES)
                angled = known | (dict(zip(ANGLES, pose.euler(), strict=True)) if angles else {})
                return forces({**fixed, **params}, angled, velocity)[GAUGE_CHANNELS.index(name)]
            if name in ANGLES:
                return pose.euler()[ANGLES.index(name)]
            axis = OVER_GROUND.index(name)
            column = [row[axis] for row in pose.rows]
            return total(
                (known.get(RATES[axis], 0.0), dot(column, (known.get(part, 0.0) for part in CURRENT_COMPONENTS)))
            )

        return value

    outputs = (
        *(ANGLES if attitude.by_quaternion else ()),
        *(OVER_GROUND if freedom.current is not None else ()),
        *(SPECIFIC_FORCE if hull.mass is not None and len(moving) > 1 else ()),
        *(() if moving else GAUGE_CHANNELS),
    )
    constants = _constants(hull, freedom, added_coriolis, thrusters)
    pulled = () if hull.tether is None else hull.tether.unknowns
    return VehicleModel(
        hull.name,
        states,
        controls,
        free,
        constants,
        hull.mass is None,
        derivative,
        {name: shown(name) for name in outputs},
        tuple(AXES[i] for i in moving),
        (*floating, *(one for one in (*pulled, *thrust_unknowns(controls, thrusters)) if one.name in unknowns)),
    )


def stated_mass(model: VehicleModel) -> float | None:
    """Return the mass that moves along in a model, kg, instead of which `params` may have another as `mass`; None if there is none."""
    moves_along = {"X", "Y", "Z"} & {*model.disturbance_axes}
    return dict(model.constants).get("mass 00") if moves_along and not model.per_unit_mass else None


def _point_mass(hull: Hull) -> Hull:
    return replace(hull, mass=1.0, inertia=(None, None, None), products=(0.0, 0.0, 0.0))


def _attitude(hull: Hull, named: Sequence[CoefficientName], freedom: Freedom, sought: Collection[str] = ()) -> Attitude:
    net, (x, y, z) = hull.weight - hull.buoyancy, hull.righting
    net, x, y, z = (
        value or float(name in sought)
        for name, value in zip(("net_weight", "x_b", "y_b", "z_b"), (net, x, y, z), strict=True)
    )
    tilting = {"u": net, "v": net, "w": net, "p": y or z, "q": x or z, "r": x or y}
    needed = {signal for name in named for signal in name.signals if signal in ANGLES}
    needed |= (
        set(freedom.angles)
        | position_angles(freedom.positions)
        | (set(ANGLES) if freedom.current is not None else set())
    )
    if hull.mass is not None and any(tilting[rate] for rate in freedom.moves):
        needed |= {"phi", "theta"}
    angles = tuple(name for name in ANGLES if name in freedom.given)
    return Attitude(attitude_states(freedom.attitude, freedom.moves, freedom.given, needed), angles)


def _current_components(freedom: Freedom) -> tuple[str, ...]:
    """Return the components of the current; its vertical velocity counts only for a vehicle that may leave its depth."""
    if freedom.current is None:
        return ()
    return CURRENT_COMPONENTS if any(rate in freedom.moves for rate in ("w", "p", "q")) else CURRENT_COMPONENTS[:2]


def _constants(
    hull: Hull, freedom: Freedom, added_coriolis: AddedCoriolis, thrusters: Sequence[Thruster]
) -> tuple[tuple[str, float], ...]:
    """Return everything else that enters the equations."""
    current = freedom.current if isinstance(freedom.current, tuple) else ()
    matrix = rigid_mass_matrix(hull)
    tether = () if hull.tether is None else (*hull.tether.point, hull.tether.linear, hull.tether.quadratic)
    vectors = (("righting", hull.righting), *(((f"thruster {i}", t.column)) for i, t in enumerate(thrusters, 1)))
    return (
        *((f"mass {i}{j}", float(matrix[i, j])) for i in range(6) for j in range(6) if matrix[i, j]),
        ("net weight", hull.weight - hull.buoyancy),
        *((f"{name} {i}", x) for name, vector in vectors for i, x in enumerate(vector) if x),
        ("thrust_deduction", hull.thrust_deduction),
        ("wake", hull.wake),
        ("automatic coriolis", float(added_coriolis == "automatic")),
        *((f"current {i}", x) for i, x in enumerate(current)),
        *((f"tether {i}", x) for i, x in enumerate(tether)),
        *hull.fixed.items(),
        *((f"trim {name}", value) for name, value in hull.trim.items()),
    )
