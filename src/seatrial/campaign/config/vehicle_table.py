"""Reads `[vehicle]`: by its axes or as a whole, a published one or one by hand, as the table says."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import Quantity, VehicleTable
from seatrial.campaign.config.thruster_table import read_thrust_laws, read_thrusters, thruster_lags
from seatrial.campaign.config.vehicle import AxesVehicle, CampaignVehicle, WholeVehicle, axes_of
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import SIGNALS, SPEEDS, is_signal, signal_unit
from seatrial.estimation.prediction.remedies import listed
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.axis_equation import RATE_OF
from seatrial.vehicles.catalogue import PublishedVehicle, load_surge, load_vehicle, surge_names
from seatrial.vehicles.hull import Hull, whole_hull
from seatrial.vehicles.tether import Tether
from seatrial.vehicles.thrusters import controls_of
from seatrial.vehicles.whole import whole_vehicle

BY_AXES = ("catalogue", "name", "mass", "thrust_deduction", "fixed", "trim", "published_to", "known_from")
"""Keys of a vehicle by its axes."""
BODY = (
    *("name", "mass", "inertia", "products", "centre_of_gravity", "centre_of_buoyancy", "weight", "buoyancy"),
    *("thrust_deduction", "wake", "added_coriolis"),
)
"""Keys of a body that a catalogue entry already says."""
UNKNOWN = re.compile(r"net_weight|[xyz]_b|(gain|reverse|dead)_[fn](_\d+)?|lag_.+|tether_(linear|quadratic)")
"""Names of priors that may be unknowns of a whole vehicle beside its coefficients."""
OWN_ADDED_MASS = tuple(f"{axis}_{rate}dot" for axis, rate in SPEEDS.items())
"""Added masses that act against the acceleration which they are of; the others may have either sign."""


def read_vehicle(
    table: VehicleTable, keys: FileKeys, terms: Sequence[str], angles: Sequence[str] = (), stated: Collection[str] = ()
) -> CampaignVehicle:
    """Read the vehicle of a campaign.

    Args:
        table: as written, with what earlier campaigns fix.
        keys: of the file.
        terms: that any structure may have.
        angles: that a sensor measures or a limit bounds.
        stated: names that have a prior in the file, among which may be unknowns of a whole vehicle beside its coefficients.

    Raises:
        InputError: keys that contradict each other, or numbers that no vehicle has.
    """
    for name, value in table.fixed.items():
        with located(keys.where(f"vehicle.fixed.{name}")):
            CoefficientName.parse(name)
        if name in OWN_ADDED_MASS and value > 0:
            raise InputError(
                keys.where(f"vehicle.fixed.{name}"),
                found=f"{value:g}, an added mass that makes the vehicle lighter",
                expected="a number below zero: the water that is set in motion opposes the acceleration",
                remedy=f"write {-value:g}, if {value:g} is the mass of that water",
            )
    for name in table.trim:
        if not is_signal(name):
            raise InputError(
                keys.where(f"vehicle.trim.{name}"),
                found=f'signal "{name}"',
                expected="a signal",
                remedy=nearest(name, SIGNALS),
            )
    is_by_axes = table.moves is None and (table.catalogue is None or table.catalogue in surge_names())
    if not is_by_axes and (table.catalogue is not None or table.mass != "unknown"):
        return _whole_vehicle(table, keys, terms, angles, stated)
    moves = [RATE_OF[axis] for axis in axes_of(terms)]
    others = sorted(table.model_fields_set - {*BY_AXES, "moves"})
    if others:
        is_body = table.catalogue is None and table.mass not in (None, "unknown")
        raise InputError(
            keys.where(f"vehicle.{others[0]}"),
            found=", ".join(others),
            expected="a whole vehicle: a body with a mass, of which `moves` says what is modelled",
            remedy=(f"add moves = {json.dumps(moves)}, or " if is_body else "") + f"remove {listed(others)}",
        )
    if table.moves is not None and {*table.moves} != {*moves}:
        raise InputError(
            keys.where("vehicle.moves"),
            found=f'{json.dumps(table.moves)} with mass = "unknown"',
            expected=f"{json.dumps(moves)}, the axes that have terms: each is estimated per unit of its inertia",
            remedy=f"write moves = {json.dumps(moves)}, or name terms of the other axes under [structure]",
        )
    return _axes_vehicle(table, keys, terms)


def _axes_vehicle(table: VehicleTable, keys: FileKeys, terms: Sequence[str]) -> AxesVehicle:
    axes = axes_of(terms)
    if table.catalogue is not None:
        _check_alone(table, keys, tuple(set(BY_AXES) - {"catalogue", "published_to", "known_from"}))
        with located(keys.where("vehicle.catalogue")):
            entry = load_surge(table.catalogue)
        found = AxesVehicle(entry.hull, axes, entry.coefficients, table.catalogue)
    elif table.mass is None:
        raise InputError(
            keys.where("vehicle.mass"),
            found="neither a mass nor a catalogue name",
            expected='for example "30.5 kg", or "unknown"',
            remedy='with "unknown" every coefficient is estimated per unit of effective mass',
        )
    else:
        mass = None if table.mass == "unknown" else _positive(keys, table.mass, "kg", "vehicle.mass")
        added = [name for name in table.fixed if CoefficientName.parse(name).is_added_mass]
        if mass is None and added:
            raise InputError(
                keys.where(f"vehicle.fixed.{added[0]}"),
                found=f'{table.fixed[added[0]]:g} kg with mass = "unknown"',
                expected="no added mass: coefficients are estimated per unit of the effective mass, which contains it",
                remedy=f"remove {added[0]} from `fixed`, or state the mass",
            )
        hull = Hull(
            table.name or "vehicle",
            mass,
            thrust_deduction=table.thrust_deduction,
            fixed=table.fixed,
            trim=_trim(table, keys),
        )
        found = AxesVehicle(hull, axes)
    if found.hull.mass is not None and not found.is_surge:
        with located(keys.where("structure")):
            whole_vehicle(found.hull, terms, moves=("u",))
    return found


def _whole_vehicle(
    table: VehicleTable, keys: FileKeys, terms: Sequence[str], angles: Sequence[str], stated: Collection[str]
) -> WholeVehicle:
    """Read the vehicle of a campaign that says what moves, or names one of the catalogue that is whole."""
    if table.catalogue is None:
        body = PublishedVehicle(_by_hand(table, keys), {}, tuple(table.moves or ()), table.added_coriolis)
    else:
        with located(keys.where("vehicle.catalogue")):
            body = load_vehicle(table.catalogue)
        _check_alone(table, keys, BODY)
        if body.written is not None:
            raise InputError(
                keys.where("vehicle.catalogue"),
                found=f'"{table.catalogue}", whose forces are no sum of named coefficients',
                expected="a vehicle with coefficients to estimate",
                remedy="simulate it to make records, and estimate another one from them",
            )
    body = replace(body, thrusters=read_thrusters(table, keys, body.thrusters))
    laws = read_thrust_laws(table, keys, len(body.thrusters))
    sought = {CoefficientName.parse(term) for term in terms}
    known = {**body.hull.fixed, **body.coefficients, **table.fixed}
    fixed = {name: value for name, value in known.items() if CoefficientName.parse(name) not in sought}
    moves = tuple(body.moves if table.moves is None else table.moves)
    named = (*sought, *map(CoefficientName.parse, fixed))
    controls, acting = controls_of(body.thrusters, named), controls_of(body.thrusters, named, moves)
    actuators = _actuators(table, keys, body, thruster_lags(table, keys, controls))
    actuators = {name: one for name, one in actuators.items() if name in acting or name not in controls}
    return WholeVehicle(
        body,
        replace(body.hull, fixed=fixed, trim={**body.hull.trim, **_trim(table, keys)}, tether=_tether(table, keys)),
        moves,
        tuple(table.given),
        tuple(table.positions),
        tuple(angles),
        table.attitude,
        actuators,
        table.catalogue or "",
        laws,
        tuple(name for name in stated if UNKNOWN.fullmatch(name)),
        table.current,
    )


def _positive(keys: FileKeys, written: Quantity, unit: str, key: str) -> float:
    """Read a quantity of the body that is above zero.

    Raises:
        InputError: as `FileKeys.si`, or a number that is zero or less.
    """
    value = keys.si(written, unit, key)
    if value > 0:
        return value
    raise InputError(keys.where(key), found=f"{written}", expected="a number above zero", remedy="correct the number")


def _trim(table: VehicleTable, keys: FileKeys) -> dict[str, float]:
    return {name: keys.si(text, signal_unit(name), f"vehicle.trim.{name}") for name, text in table.trim.items()}


def _tether(table: VehicleTable, keys: FileKeys) -> Tether | None:
    if table.tether is None:
        return None
    x, y, z = (keys.si(text, "m", "vehicle.tether.point") for text in table.tether.point or ["0 m"] * 3)
    linear = keys.si(table.tether.linear, "kg/s", "vehicle.tether.linear")
    return Tether((x, y, z), linear, keys.si(table.tether.quadratic, "kg/m", "vehicle.tether.quadratic"))


def _by_hand(table: VehicleTable, keys: FileKeys) -> Hull:
    if table.mass is None:
        raise InputError(
            keys.where("vehicle.mass"),
            found="nothing",
            expected='for example "30.5 kg": a whole vehicle is a body with a mass',
            remedy='write mass = "unknown" to estimate axes one by one per unit of an unknown inertia',
        )

    def three(key: str, unit: str) -> list[float] | None:
        written: Sequence[str] | None = getattr(table, key)
        return None if written is None else [keys.si(text, unit, f"vehicle.{key}") for text in written]

    sizes = {"weight": "N", "buoyancy": "N"}
    given = {
        key: _positive(keys, text, unit, f"vehicle.{key}")
        for key, unit in sizes.items()
        if (text := getattr(table, key)) is not None
    }
    mass = _positive(keys, table.mass, "kg", "vehicle.mass")
    with located(keys.where("vehicle")):
        return whole_hull(
            table.name or "vehicle",
            mass,
            three("inertia", "kg m^2") or (None, None, None),
            products=three("products", "kg m^2") or (0.0, 0.0, 0.0),
            centre_of_gravity=three("centre_of_gravity", "m") or (0.0, 0.0, 0.0),
            centre_of_buoyancy=three("centre_of_buoyancy", "m") or (0.0, 0.0, 0.0),
            thrust_deduction=table.thrust_deduction,
            wake=table.wake,
            fixed=table.fixed,
            **given,
        )


def _actuators(
    table: VehicleTable, keys: FileKeys, body: PublishedVehicle, lags: Mapping[str, float]
) -> dict[str, Actuator]:
    """Lags and limits by hand; the published ones of a catalogue entry where `actuators = "published"`; lags of thrusters beside them."""
    found = {control: Actuator(lag) for control, lag in lags.items()}
    if table.actuators == "published":
        return {**body.actuators, **found}
    for name, written in (table.actuators or {}).items():
        key = f"vehicle.actuators.{name}"
        if not is_signal(name) or not written.model_fields_set:
            raise InputError(
                keys.where(key),
                found="a table without keys" if is_signal(name) else f'"{name}"',
                expected="a control of the vehicle, with a lag or limits",
                remedy="remove the table, or give lag, lower, upper or rate"
                if is_signal(name)
                else nearest(name, SIGNALS),
            )
        unit = signal_unit(name)
        limits = {
            bound: keys.si(text, unit, f"{key}.{bound}")
            for bound in ("lower", "upper")
            if (text := getattr(written, bound)) is not None
        }
        if written.rate is not None:
            limits["rate"] = keys.si(written.rate, f"({unit})/s", f"{key}.rate")
        lag = keys.si(written.lag, "s", f"{key}.lag")
        with located(keys.where(key)):
            found[name] = Actuator(lag, **limits)
    return found


def _check_alone(table: VehicleTable, keys: FileKeys, others: Sequence[str]) -> None:
    """Check that a vehicle of the catalogue is given nothing that the catalogue says.

    Args:
        table: of a vehicle that has a catalogue name.
        keys: of the file.
        others: keys of `[vehicle]` that must not stand beside it.

    Raises:
        InputError: one that does.
    """
    twice = sorted(table.model_fields_set & set(others))
    if twice:
        raise InputError(
            keys.where(f"vehicle.{twice[0]}"),
            found=f"catalogue together with {', '.join(twice)}",
            expected="a vehicle of the catalogue, or one by hand",
            remedy=f"remove {', '.join(twice)}, or remove catalogue and give all of it",
        )
