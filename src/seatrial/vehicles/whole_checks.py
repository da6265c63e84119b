"""What is refused before a whole vehicle is built, in words that say what to change."""

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any

import numpy as np

from seatrial.core.argument_checks import as_number, check_number
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLES, POSITIONS, RATES, motion_name
from seatrial.core.term_checks import check_each_once, check_trim
from seatrial.vehicles.coriolis import entry_products
from seatrial.vehicles.hull import (
    AXES,
    Hull,
    added_mass_entry,
    added_mass_matrix,
    asymmetric_pairs,
    check_hull_numbers,
    rigid_mass_matrix,
)
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.tether import LINEAR, Tether
from seatrial.vehicles.thrusters import Thruster


def check_whole(
    hull: Hull,
    terms: Sequence[str],
    freedom: tuple,
    added_coriolis: str,
    thrusters: Sequence[Thruster],
    unknowns: Sequence[str] = (),
) -> None:
    """Check a vehicle's parts; `freedom` is (moves, given, positions, angles, current).

    Args:
        hull: rigid body, fixed coefficients and trim.
        terms: names of the free coefficients.
        freedom: what moves, as above.
        added_coriolis: see `whole_vehicle`.
        thrusters: of an open frame.
        unknowns: sought beside the terms.

    Raises:
        InputError: see `whole_vehicle`.
    """
    place = f'vehicle "{hull.name}"'
    moves, given, positions, angles, current = freedom
    check_hull_numbers(hull)
    _check_freedom(place, moves, given, positions, angles, current)
    free = [CoefficientName.parse(term) for term in terms if term not in hull.fixed]
    named = [*free, *(CoefficientName.parse(name) for name in hull.fixed)]
    check_each_once(named, place)
    for name in named:
        _check_term(place, hull, name)
    for name in free:
        _check_part(place, name, moves, given, thrusters)
    _check_thrusters(place, named, thrusters)
    if added_coriolis == "automatic":
        _check_automatic(place, hull, named)
    elif added_coriolis != "named":
        raise InputError(
            f"{place}, added_coriolis",
            found=repr(added_coriolis),
            expected='"named" or "automatic"',
            remedy='"named" if terms such as X_wq are among the coefficients',
        )
    _check_mass(place, hull, moves)
    if hull.tether is not None:
        _check_tether(f"{place}, tether", hull, hull.tether, free, (moves, given), unknowns)


def _check_freedom(
    place: str,
    moves: Sequence[str],
    given: Sequence[str],
    positions: Sequence[str],
    angles: Sequence[str],
    current: Any,
) -> None:
    for what, names, allowed in (
        ("moves", moves, RATES),
        ("given", given, (*RATES, *ANGLES)),
        ("positions", positions, POSITIONS),
        ("angles", angles, ANGLES),
    ):
        wrong = [name for name in names if name not in allowed]
        if wrong or len(set(names)) < len(names):
            raise InputError(
                f"{place}, {what}",
                found=", ".join(wrong or names),
                expected="each once, of " + " ".join(allowed),
                remedy="name signals of the motion of this vehicle",
            )
    if set(moves) & set(given):
        raise InputError(
            f"{place}, moves",
            found=", ".join(moves) + " moves, given " + ", ".join(given),
            expected="velocities that are not in `given`",
            remedy="a velocity is a state, a given signal, or zero",
        )
    numbers = isinstance(current, tuple | list) and len(current) == 3 and all(isfinite(as_number(x)) for x in current)
    stated = current is None or (isinstance(current, str) and current in ("state", "given"))
    if not (stated or numbers):
        raise InputError(
            f"{place}, current",
            found=repr(current),
            expected='"state", "given" or three velocities north, east and down in m/s',
            remedy="leave it out for still water",
        )


def _check_term(place: str, hull: Hull, name: CoefficientName) -> None:
    alone = len(name.factors) == 1 and name.factors[0].power == 1 and not name.factors[0].modulus
    if name.axis == "Q":
        raise InputError(
            f"{place}, term {name}",
            found='axis "Q", the torque on the propeller',
            expected="the moment on the hull",
            remedy=f"write K_{name.text.partition('_')[2]}, with the sign of the reaction",
        )
    if name.is_added_mass and (name.axis == "T" or not alone):
        raise InputError(
            f"{place}, term {name}",
            found="an acceleration in another product, or of the thrust",
            expected="an added mass such as Y_rdot: a force or moment of only one acceleration",
            remedy="leave the term out",
        )
    check_trim(name, hull.trim, place)


def _check_part(
    place: str, name: CoefficientName, moves: Sequence[str], given: Sequence[str], thrusters: Sequence[Thruster]
) -> None:
    present = {*moves, *given}
    axis_moves = not moves or (name.axis == "T" and bool(thrusters)) or _rate_of(name.axis) in moves
    held = [
        factor.signal
        for factor in name.factors
        if factor.signal in RATES and factor.signal not in present and not factor.change
    ]
    if held and name.axis == "T" and thrusters and moves:
        held = []
    if axis_moves and not held and not (name.is_added_mass and name.signals[0] not in moves):
        return
    why = f"the model has no {motion_name(_rate_of(name.axis))}, axis {name.axis} does not move"
    if axis_moves:
        why = f"{', '.join(held) or name.signals[0]} is zero"
    raise InputError(
        f"{place}, term {name}",
        found=f"{name}, which has no part in the motion: {why}",
        expected=f"terms of {', '.join(present)}" if present else "terms of thrust, because the vehicle does not move",
        remedy="leave it out, or let the vehicle move there, by `moves` or with an unknown mass; "
        "vehicle.terms(moves) gives the terms that act",
    )


def _rate_of(axis: str) -> str:
    return "u" if axis == "T" else RATES[AXES.index(axis)]


def _check_thrusters(place: str, named: Iterable[CoefficientName], thrusters: Sequence[Thruster]) -> None:
    for number, thruster in enumerate(thrusters, 1):
        if not (np.isfinite((*thruster.place, *thruster.direction)).all() and np.linalg.norm(thruster.direction) > 0):
            raise InputError(
                f"{place}, thruster {number}",
                found=f"place {thruster.place}, direction {thruster.direction}",
                expected="finite numbers, and a direction that is not zero",
                remedy="give both in body axes, in m",
            )
    thrust = [name for name in named if name.axis == "T"]
    driven = {signal for name in thrust for signal in ("n", "f") if signal in name.signals}
    wrong = [
        name
        for name in named
        if ("f" in name.signals and not (thrusters and name.axis == "T"))
        or (thrusters and name.axis == "T" and set(name.signals) - {"n", "f", "u", "V"})
        or (thrusters and name.axis != "T" and "n" in name.signals)
        or ("f" in name.signals and "n" in driven)
    ]
    if wrong:
        raise InputError(
            f"{place}, term {wrong[0]}",
            found=f"signals {', '.join(wrong[0].signals)}, of a vehicle with {len(thrusters)} thrusters",
            expected="the thrusters' speed n, or their commanded force f, only on the axis T, in products with V and with u, the "
            "velocity along the thruster",
            remedy="leave the term out",
        )
    if thrusters and thrust and "n" not in driven and CoefficientName.parse("T_f") not in thrust:
        raise InputError(
            f"{place}, term {thrust[0]}",
            found="terms of thrust without T_f",
            expected="T_f, the thrust of a commanded newton",
            remedy="add T_f to `always` of [structure], or fixed = { T_f = 1.0 } to [vehicle] if thrust equals its command",
        )


def _check_automatic(place: str, hull: Hull, named: Sequence[CoefficientName]) -> None:
    """Check that automatic Coriolis forces have a symmetric added mass, and none of their products among the terms."""
    entries = {added_mass_entry(name): name for name in named if name.is_added_mass}
    lone = [name for (i, j), name in entries.items() if (j, i) not in entries]
    unequal = asymmetric_pairs(hull.fixed)
    if lone or unequal:
        pairs = [f"{lone[0]} alone"] if lone else [f"{one} and {other} unequal" for one, other in unequal]
        i, j = added_mass_entry(lone[0]) if lone else (0, 0)
        raise InputError(
            f"{place}, added mass",
            found=pairs[0],
            expected="a symmetric added mass, so that its Coriolis forces do no work",
            remedy=f"give {AXES[j]}_{RATES[i]}dot too" if lone else "make them equal, or name the Coriolis terms",
        )
    made = {product.name: entries[entry] for entry in entries for product in entry_products(*entry)}
    for name in named:
        if name in made:
            raise InputError(
                f"{place}, term {name}",
                found=f"a Coriolis force that already follows from {made[name]}",
                expected='added_coriolis="named" with such terms, or "automatic" without them',
                remedy="leave the term out; a lift in the same product may be written with a modulus, as in Y_absur",
            )


def _check_mass(place: str, hull: Hull, moves: Sequence[str]) -> None:
    moving = [RATES.index(rate) for rate in RATES if rate in moves]
    if not moving:
        return
    unknown = [i for i in moving if i >= 3 and hull.mass is not None and hull.inertia[i - 3] is None]
    if unknown:
        axis = "xyz"[unknown[0] - 3]
        raise InputError(
            f"{place}, inertia",
            found=f"no I_{axis}{axis}, and {RATES[unknown[0]]} moves",
            expected="the moment of inertia of every axis that turns",
            remedy="give it, or take the axis from `moves`",
        )
    matrix = (rigid_mass_matrix(hull) + added_mass_matrix(hull.fixed))[np.ix_(moving, moving)]
    if not np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0:
        raise InputError(
            f"{place}, mass matrix",
            found=f"rows {matrix.tolist()}",
            expected="a positive definite matrix of rigid body and added mass",
            remedy="added masses on the diagonal are negative in SNAME notation: check their signs, and the centre of gravity",
        )


def check_has_state(model: VehicleModel) -> None:
    """Check that something of a vehicle changes in time.

    Raises:
        InputError: it is held, and its thrusters have no lag.
    """
    if not model.states:
        raise InputError(
            f'vehicle "{model.name}", moves',
            found="a vehicle tied in place, with thrusters without a lag",
            expected="the time constant with which the thrust follows its command",
            remedy='add lag = "0.1 s" to [vehicle.thrust_laws.NAME] or [vehicle.actuators.CONTROL]; [prior.lag_f] estimates it',
        )


def _check_tether(
    place: str,
    hull: Hull,
    tether: Tether,
    free: Iterable[CoefficientName],
    motion: tuple[Sequence[str], Sequence[str]],
    unknowns: Sequence[str],
) -> None:
    """Check a tether's numbers, and that what is sought of it is no damping by another name; `motion` is (moves, given)."""
    if hull.mass is None:
        raise InputError(
            place, found="an unknown mass", expected="a mass: the drag is in newtons", remedy="give the mass"
        )
    if len(tether.point) != 3 or not np.isfinite(tether.point).all():
        raise InputError(
            f"{place}, point",
            found=f"{tether.point}",
            expected="three finite numbers",
            remedy="give them forward, starboard and down of the body's origin, in m",
        )
    for key in ("linear", "quadratic"):
        remedy = "a drag against the motion is positive"
        check_number(getattr(tether, key), f"{place}, {key}", least=0.0, remedy=remedy)
    sought = [one.name for one in tether.unknowns if one.name in unknowns]
    if not sought:
        return
    moves, given = motion
    moving = [i for i, rate in enumerate(RATES) if rate in moves]
    felt = [j for j, rate in enumerate(RATES) if rate in (*moves, *given) and tether.damping[j, j] > 0]
    if len(felt) < 2:
        rate = RATES[felt[0]] if felt else "none"
        raise InputError(
            place,
            found=f"{sought[0]} estimated, but {rate} of {', '.join((*moves, *given))} moves its point",
            expected="at least two velocities that move its point: their coupling separates its drag from damping",
            remedy=f"seek damping such as {AXES[felt[0]]}_{rate} instead, or let the vehicle move in more axes"
            if felt
            else "give the point, or let the vehicle move in more axes",
        )
    same = {f"{AXES[i]}_{RATES[j]}" for i in moving for j in felt if tether.damping[i, j]}
    if LINEAR in sought and same <= {name.text for name in free}:
        raise InputError(
            place,
            found=f"{LINEAR} sought beside {', '.join(sorted(same))}, which is the same force",
            expected="known damping on at least one of these axes",
            remedy=f"leave out one of these terms, or state the drag instead of [prior.{LINEAR}]",
        )
