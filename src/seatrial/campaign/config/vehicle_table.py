"""Reads `[vehicle]`: by its axes or as a whole, a published one or one by hand, as the table says."""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from seatrial.campaign.config.quantities import (
    Metres,
    Name,
    OfControl,
    RateOfControl,
    Seconds,
    Several,
    Table,
    Unit,
    noted,
    without_effect,
)
from seatrial.campaign.config.thruster_table import (
    ThrusterTable,
    ThrustLawTable,
    read_thrust_laws,
    read_thrusters,
    thruster_lags,
)
from seatrial.campaign.config.toml import FileKeys
from seatrial.campaign.config.vehicle import AxesVehicle, CampaignVehicle, WholeVehicle, axes_of
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import listed
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import SIGNALS, SPEEDS, is_signal
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.axis_equation import RATE_OF
from seatrial.vehicles.catalogue import PublishedVehicle, load_surge, load_vehicle, surge_names
from seatrial.vehicles.hull import Hull, whole_hull
from seatrial.vehicles.tether import Tether
from seatrial.vehicles.thrusters import controls_of
from seatrial.vehicles.whole import whole_vehicle

Newtons = Annotated[float, Unit("N", above=0.0, expected="a number above zero")]
Kilograms = Annotated[float, Unit("kg", above=0.0, expected="a number above zero")]
Inertia = Annotated[float, Unit("kg m^2")]
Share = Annotated[float, Unit("1", "%")]
OfSignal = Annotated[float, Unit("{signal}", "that of the signal")]


class ActuatorTable(Table):
    """`[vehicle.actuators.CONTROL]`: lag and limits of an actuator."""

    lag: Seconds = Field(default=0.0, description="time constant between command and motion of the actuator")
    lower: OfControl | None = Field(default=None, description="smallest command")
    upper: OfControl | None = Field(default=None, description="largest command")
    rate: RateOfControl | None = Field(default=None, description="largest rate of change")


class TetherTable(Table):
    """`[vehicle.tether]`: drag of a tether at a point of the vehicle.

    The force is -(linear + quadratic |v|) v, v being the velocity of the point through the water. A drag is estimated if it has a prior,
    `[prior.tether_linear]` or `[prior.tether_quadratic]`.
    """

    point: Several[Metres] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="point of attachment, forward, starboard and down of the body's origin; the origin if not given",
    )
    linear: Annotated[float, Unit("kg/s", "N s/m")] = Field(
        default=0.0, description="drag per m/s; a guess if `[prior.tether_linear]` estimates it"
    )
    quadratic: Annotated[float, Unit("kg/m", "N s^2/m^2")] = Field(
        default=0.0, description="drag per square of the speed; a guess if `[prior.tether_quadratic]` estimates it"
    )


class VehicleTable(Table):
    """`[vehicle]`: a vehicle of the catalogue by name, or one described here.

    A surge vehicle needs a mass, a thrust deduction and its known coefficients. A whole vehicle is one of the catalogue
    in six degrees of freedom, or has `moves`, a list of some of u v w p q r. Lengths count from the body's origin. With
    `moves = []` the vehicle is clamped, as at a bollard, and gauges measure `force_X` to `moment_N`.

    The forces f_1, f_2, … drive the thrusters, or the speeds n_1, n_2, … if terms of T have n.
    """

    catalogue: str | None = Field(
        default=None, description="name of a published vehicle; `seatrial vehicle` lists them"
    )
    name: Name | None = Field(default=None, description="name of a vehicle that is described here")
    mass: Kilograms | Literal["unknown"] | None = Field(
        default=None,
        description='dry mass; with `"unknown"` coefficients are per unit of effective mass, and `moves` may list the axes '
        "that have terms",
    )
    inertia: Several[Inertia] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="moments of inertia I_xx, I_yy, I_zz about the body's origin",
    )
    products: Several[Inertia] | None = Field(
        default=None, min_length=3, max_length=3, description="products of inertia I_xy, I_xz, I_yz"
    )
    centre_of_gravity: Several[Metres] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="its place forward, starboard and down of the body's origin",
    )
    centre_of_buoyancy: Several[Metres] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="its place forward, starboard and down of the body's origin",
    )
    weight: Newtons | None = Field(default=None, description="weight, if it is not mass times gravity")
    buoyancy: Newtons | None = Field(default=None, description="buoyancy; equal to the weight if not given")
    moves: Several[Literal["u", "v", "w", "p", "q", "r"]] | None = Field(
        default=None,
        description='velocities that are simulated: `["u"]` makes a surge model, `["v", "r"]` a steering model, `[]` a clamped vehicle',
    )
    measured_inputs: Several[str] = Field(
        default=(), description="velocities and angles that are taken from the record instead of simulated"
    )
    positions: Several[Literal["x", "y", "z"]] = Field(default=(), description="positions that are simulated too")
    attitude: Literal["quaternion", "euler"] = Field(
        default="euler", description="form of the attitude; quaternions also work at a pitch of 90 degrees"
    )
    current: bool = Field(
        default=False,
        description="whether the velocity of the water over the earth is a state of each trial; sensors of `u_g`, `v_g`, `x` and `y` "
        "observe it",
    )
    actuators: Literal["published"] | dict[Annotated[str, noted("control")], ActuatorTable] | None = Field(
        default=None, description="`published` for those of the catalogue, or a table for each control"
    )
    thrusters: Several[ThrusterTable] = Field(
        default=(),
        max_length=64,
        description="place and direction of each thruster, instead of those of the catalogue",
    )
    thrust_laws: dict[str, ThrustLawTable] = Field(default={}, description="thrust of logged commands, by name")
    tether: TetherTable | None = Field(default=None, description="drag of a tether at a point of the vehicle")
    added_coriolis: Literal["named", "automatic"] = Field(
        default="named",
        description="whether Coriolis forces of the added mass are terms (`X_wq`, …), or follow from it",
    )
    published_prior_sd: Share | None = Field(
        default=None,
        description="standard deviation of the default prior of each catalogue coefficient: normal about the published value, cut to "
        "damping that dissipates",
    )
    priors_from: Several[str] = Field(
        default=(),
        description="folders of earlier campaigns, after `seatrial run` or `seatrial estimate --by mode`. Their coefficients become "
        "priors if they are estimated here, otherwise fixed values. Gains, dead zones and lags of thrusters, net weight, centre "
        "of buoyancy and drag of a tether become priors",
    )
    thrust_deduction: float = Field(
        default=0.0, ge=0.0, lt=1.0, description="thrust deduction t_d: share of the thrust that the hull cancels"
    )
    wake: float = Field(
        default=0.0, lt=1.0, description="wake fraction: share by which the water at the propeller is slower"
    )
    fixed: dict[str, float] = Field(default={}, description="known coefficients, by name")
    trim: dict[Annotated[str, noted("signal")], OfSignal] = Field(
        default={},
        description="steady values about which the vehicle moves, by signal, such as `n` and `u`. Thrusters, fins and side "
        "forces are 0 if not given",
    )

    @model_validator(mode="after")
    def _check_effects(self) -> Self:
        if "attitude" in self.model_fields_set and self.moves and not set(self.moves) & set("pqr"):
            raise without_effect(
                "attitude", "no velocity in `moves` turns the vehicle", "remove it, or add p, q or r to `moves`"
            )
        if self.actuators == "published" and self.catalogue is None:
            raise without_effect(
                "actuators", '"published" of a vehicle outside the catalogue', "give a table for each actuator"
            )
        return self


# Keys of a vehicle by its axes.
BY_AXES = ("catalogue", "name", "mass", "thrust_deduction", "fixed", "trim", "published_prior_sd", "priors_from")
# Keys of a body that a catalogue entry already says.
BODY = (
    *("name", "mass", "inertia", "products", "centre_of_gravity", "centre_of_buoyancy", "weight", "buoyancy"),
    *("thrust_deduction", "wake", "added_coriolis"),
)
# Names of priors that may be unknowns of a whole vehicle beside its coefficients.
UNKNOWN = re.compile(r"net_weight|[xyz]_b|(gain|reverse|dead)_[fn](_\d+)?|lag_.+|tether_(linear|quadratic)")
# Added masses that act against the acceleration which they are of; the others may have either sign.
OWN_ADDED_MASS = tuple(f"{axis}_{rate}dot" for axis, rate in SPEEDS.items())


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
                found=f"{value:g}, an added mass with the wrong sign",
                expected="a number below zero, because the water opposes the acceleration",
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
            expected="a whole vehicle: a body with a mass, and `moves` with its modelled velocities",
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
        _check_alone(table, keys, tuple(set(BY_AXES) - {"catalogue", "published_prior_sd", "priors_from"}))
        with located(keys.where("vehicle.catalogue")):
            entry = load_surge(table.catalogue)
        vehicle = AxesVehicle(entry.hull, axes, entry.coefficients, table.catalogue)
    elif table.mass is None:
        raise InputError(
            keys.where("vehicle.mass"),
            found="neither a mass nor a catalogue name",
            expected='for example "30.5 kg", or "unknown"',
            remedy='with "unknown" every coefficient is estimated per unit of effective mass',
        )
    else:
        mass = None if table.mass == "unknown" else table.mass
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
            trim=dict(table.trim),
        )
        vehicle = AxesVehicle(hull, axes)
    if vehicle.hull.mass is not None and not vehicle.is_surge:
        with located(keys.where("structure")):
            whole_vehicle(vehicle.hull, terms, moves=("u",))
    return vehicle


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
                found=f'"{table.catalogue}", with forces that are no sum of named coefficients',
                expected="a vehicle with coefficients to estimate",
                remedy="simulate it to make records, and estimate another vehicle from them",
            )
    body = replace(body, thrusters=read_thrusters(table.thrusters, keys, body.thrusters))
    laws = read_thrust_laws(table.thrust_laws, table.thrusters, keys, len(body.thrusters))
    sought = {CoefficientName.parse(term) for term in terms}
    known = {**body.hull.fixed, **body.coefficients, **table.fixed}
    fixed = {name: value for name, value in known.items() if CoefficientName.parse(name) not in sought}
    moves = tuple(body.moves if table.moves is None else table.moves)
    named = (*sought, *map(CoefficientName.parse, fixed))
    controls, acting = controls_of(body.thrusters, named), controls_of(body.thrusters, named, moves)
    actuators = _actuators(table, keys, body, thruster_lags(table.thrust_laws, table.thrusters, keys, controls))
    actuators = {name: one for name, one in actuators.items() if name in acting or name not in controls}
    tether = None
    if table.tether is not None:
        x, y, z = table.tether.point or (0.0, 0.0, 0.0)
        tether = Tether((x, y, z), table.tether.linear, table.tether.quadratic)
    return WholeVehicle(
        body,
        replace(body.hull, fixed=fixed, trim={**body.hull.trim, **dict(table.trim)}, tether=tether),
        moves,
        tuple(table.measured_inputs),
        tuple(table.positions),
        tuple(angles),
        table.attitude,
        actuators,
        table.catalogue or "",
        laws,
        tuple(name for name in stated if UNKNOWN.fullmatch(name)),
        table.current,
    )


def _by_hand(table: VehicleTable, keys: FileKeys) -> Hull:
    if table.mass is None:
        raise InputError(
            keys.where("vehicle.mass"),
            found="nothing",
            expected='for example "30.5 kg": a whole vehicle is a body with a mass',
            remedy='write mass = "unknown" to estimate axes one by one per unit of an unknown inertia',
        )

    given = {key: value for key in ("weight", "buoyancy") if (value := getattr(table, key)) is not None}
    with located(keys.where("vehicle")):
        return whole_hull(
            table.name or "vehicle",
            table.mass,
            table.inertia or (None, None, None),
            products=table.products or (0.0, 0.0, 0.0),
            centre_of_gravity=table.centre_of_gravity or (0.0, 0.0, 0.0),
            centre_of_buoyancy=table.centre_of_buoyancy or (0.0, 0.0, 0.0),
            thrust_deduction=table.thrust_deduction,
            wake=table.wake,
            fixed=table.fixed,
            **given,
        )


def _actuators(
    table: VehicleTable, keys: FileKeys, body: PublishedVehicle, lags: Mapping[str, float]
) -> dict[str, Actuator]:
    """Lags and limits by hand; the published ones of a catalogue entry where `actuators = "published"`; lags of thrusters beside them."""
    actuators = {control: Actuator(lag) for control, lag in lags.items()}
    if table.actuators == "published":
        return {**body.actuators, **actuators}
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
        with located(keys.where(key)):
            actuators[name] = Actuator(written.lag, **written.model_dump(exclude={"lag"}, exclude_none=True))
    return actuators


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
