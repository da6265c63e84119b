"""Published vehicles, one TOML file each with its sources, and the vehicle in any reduction of it.

All but `remus100_fossen`, whose forces are no sum of named terms and are written out in a separate module.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import PurePath
from typing import Any, get_args

from seatrial.core.argument_checks import (
    check_choice,
    check_each_of,
    check_kind,
    check_known,
    check_mapping,
    check_names,
    check_numbers,
    check_text,
)
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import RATES, signal_unit
from seatrial.core.units import quantity
from seatrial.vehicles.active_dof import AddedCoriolis, acting_terms
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.attitude import Kind
from seatrial.vehicles.hull import GRAVITY, Hull, check_hull_numbers, whole_hull
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.remus100_fossen import ACTUATORS, NOTES, remus100_fossen, spheroid_hull
from seatrial.vehicles.thrusters import Thruster
from seatrial.vehicles.whole import whole_vehicle

_FOSSEN, _SURGE = "remus100_fossen", "_surge"
_OPTIONS = ("attitude", "positions", "angles", "current", "unknowns")
_OF_UNKNOWN = ("thrust_deduction", "wake", "trim")  # What may be said of a body whose mass is unknown
_BODY = (*_OF_UNKNOWN, "centre_of_gravity", "centre_of_buoyancy", "products", "weight", "buoyancy", "symmetric")


@dataclass(frozen=True)
class PublishedVehicle:
    """A vehicle of the catalogue.

    Attributes:
        hull: rigid body, weight, buoyancy, fixed coefficients and trim.
        coefficients: published values of the others, SI.
        moves: velocities the published model covers.
        added_coriolis: whether Coriolis forces of the added mass are among the coefficients.
        thrusters: those of an open frame; empty for one propeller on the axis.
        actuators: published lags and limits by control.
        notes: sources and errata, as the file has them.
        written: builder of a vehicle with forces that are no sum of named terms, without restrictions or free coefficients.
    """

    hull: Hull
    coefficients: Mapping[str, float]
    moves: tuple[str, ...]
    added_coriolis: AddedCoriolis = "named"
    thrusters: tuple[Thruster, ...] = ()
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    notes: str = ""
    written: Callable[..., VehicleModel] | None = None

    @property
    def controls(self) -> tuple[str, ...]:
        """Controls of the vehicle with everything it has moving."""
        return self.build().controls

    def terms(self, moves: Sequence[str] | None = None, given: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the names of the coefficients that have a part in a motion.

        Args:
            moves: velocities that are states; all published ones if None.
            given: velocities and angles that are measured.

        Raises:
            InputError: something that is no list of names.
        """
        _check_moves(moves, f'vehicle "{self.hull.name}"')
        check_names(given, f'vehicle "{self.hull.name}", given', "v")
        return acting_terms(tuple(self.coefficients), moves or self.moves, given, self.thrusters)

    def without(self, *names: str) -> "PublishedVehicle":
        """Return the vehicle without some of its coefficients, as a rival model of it.

        Args:
            names: coefficients that are left out, fixed ones among them.

        Raises:
            InputError: a coefficient that it does not have.
        """
        known = {**self.hull.fixed, **self.coefficients}
        for name in names:
            check_choice(name, known, f'vehicle "{self.hull.name}"')
        fixed, others = (
            {name: value for name, value in some.items() if name not in names}
            for some in (self.hull.fixed, self.coefficients)
        )
        return replace(self, hull=replace(self.hull, fixed=fixed), coefficients=others)

    def build(
        self,
        moves: Sequence[str] | None = None,
        given: Sequence[str] = (),
        actuators: bool = False,
        free: Sequence[str] | None = None,
        **options: Any,
    ) -> VehicleModel:
        """Build a model of the vehicle, with the published terms that have a part in a motion.

        Args:
            moves: velocities that are states; all published ones if None.
            given: velocities and angles that are measured.
            actuators: whether published lags and limits come before the controls.
            free: coefficients without a value, in this order; the others stay as published. Terms that are not published may
                be among them. All published ones if None.
            options: `attitude` ("quaternion" or "euler"), `positions` that are states (of x, y and z), `angles` that are wanted although
                no force depends on them (of phi, theta and psi), and `current`: "state", "given", or the water's velocity north, east
                and down, m/s. A vehicle with forces that are no sum of named terms takes only `attitude` and `positions`.

        Returns:
            a model with unknown free coefficients and its values of the others.

        Raises:
            InputError: a malformed name, a term without a part in the motion, a signal that the model lacks, two names of one regressor,
                an unphysical constant, or something left out of a vehicle that is no sum of terms.
        """
        place = f'vehicle "{self.hull.name}"'
        check_known(options, _OPTIONS if self.written is None else _OPTIONS[:2], f"{place}, arguments")
        _check_moves(moves, place)
        for what, names in {"given": given, "free": () if free is None else free, **options}.items():
            if what in ("given", "free", "positions", "angles"):
                check_names(names, f"{place}, {what}")
        check_kind(actuators, bool, f"{place}, actuators", "give True or False")
        check_choice(options.get("attitude", "quaternion"), get_args(Kind), f"{place}, attitude")
        chosen = tuple(moves or self.moves)
        if self.written is not None:
            if chosen != self.moves or given or free is not None:
                raise InputError(
                    f'vehicle "{self.hull.name}", moves',
                    found=", ".join(free or chosen),
                    expected="all six velocities, because its forces are no sum of terms",
                    remedy="leave moves, given and free out, or choose a vehicle of named coefficients",
                )
            model = self.written(**options)
        else:
            terms = self.terms(chosen, given) if free is None else tuple(free)
            model = whole_vehicle(
                self.hull if free is None else replace(self.hull, fixed=self._fixed_beside(terms)),
                terms,
                moves=chosen,
                given=given,
                added_coriolis=self.added_coriolis,
                thrusters=self.thrusters,
                **options,
            )
        acting = {name: actuator for name, actuator in self.actuators.items() if name in model.controls}
        return with_actuators(model, acting) if actuators and acting else model

    def _fixed_beside(self, terms: Sequence[str]) -> dict[str, float]:
        """Return every value that is not left open."""
        sought = {CoefficientName.parse(term) for term in terms}
        known = {**self.hull.fixed, **self.coefficients}
        return {name: value for name, value in known.items() if CoefficientName.parse(name) not in sought}


def make_vehicle(
    name: str,
    mass: float | None,
    coefficients: Mapping[str, float],
    *,
    inertia: Sequence[float | None] = (None, None, None),
    moves: Sequence[str] | None = None,
    actuators: Mapping[str, Actuator] | None = None,
    thrusters: Sequence[Thruster] = (),
    added_coriolis: AddedCoriolis = "named",
    **body: Any,
) -> PublishedVehicle:
    """Build your vehicle.

    Args:
        name: short name.
        mass: dry mass, kg; None if unknown: coefficients are then per unit of effective mass or inertia.
        coefficients: values by name, SI, added masses (`X_udot`, negative) among them; estimated ones may be left out.
        inertia: I_xx, I_yy, I_zz about the origin, kg m^2; None if unknown.
        moves: modelled velocities; if not given, those of axes with terms and a known inertia.
        actuators: lags and limits by control.
        thrusters: of an open frame; none for one propeller on the axis.
        added_coriolis: whether Coriolis forces of the added mass are among the coefficients or follow from it (`automatic`).
        body: of an unknown mass `thrust_deduction` (0 to 1), `wake` (below 1) and `trim` (signal to SI value); else also
            `centre_of_gravity` and `centre_of_buoyancy` (x, y, z, m), `products` of inertia (xy, xz, yz, kg m^2), `weight` and
            `buoyancy` (N), and `symmetric`, whether added mass has to be.

    Returns:
        the vehicle, of which `build` makes models.

    Raises:
        InputError: a name that is none, or numbers that no body has.
    """
    place = f'vehicle "{check_text(name, "vehicle, name", "give a short name")}"'
    given = check_numbers(coefficients, f"{place}, coefficients", remedy='write for example {"X_uabsu": -3.0}')
    values = {CoefficientName.parse(key).text: value for key, value in given.items()}
    check_kind(body.get("symmetric", True), bool, f"{place}, symmetric", "give True or False")
    check_known(body, _BODY if mass is not None else _OF_UNKNOWN, f"{place}, arguments")
    _check_parts(place, moves, actuators, thrusters, added_coriolis)
    fixed = {key: value for key, value in values.items() if CoefficientName.parse(key).is_added_mass}
    hull = (
        Hull(name, None, **{**body, "trim": check_numbers(body.get("trim"), f"{place}, trim")})
        if mass is None
        else whole_hull(name, mass, inertia, fixed=fixed, **body)
    )
    check_hull_numbers(hull)
    free = {key: value for key, value in values.items() if key not in fixed}
    return PublishedVehicle(
        hull,
        free,
        tuple(moves or _moving(hull, values)),
        added_coriolis,
        tuple(thrusters),
        dict(actuators or {}),
    )


def _check_parts(place: str, moves: Any, actuators: Any, thrusters: Any, added_coriolis: Any) -> None:
    """Check what a vehicle consists of beside its body."""
    _check_moves(moves, place)
    for control, one in check_mapping(
        {} if actuators is None else actuators, f"{place}, actuators", 'write {"n": Actuator(0.5)}'
    ).items():
        check_kind(one, Actuator, f"{place}, actuator {control}", "write for example Actuator(0.5)")
    check_each_of(thrusters, Thruster, f"{place}, thrusters", "write [Thruster(place, direction)]")
    check_choice(added_coriolis, ("named", "automatic"), f"{place}, added_coriolis")


def _check_moves(moves: Any, place: str) -> None:
    """Check velocities, which a text may give letter by letter."""
    for one in check_names(tuple(moves or ()) if isinstance(moves, str | None) else moves, f"{place}, moves"):
        check_choice(one, RATES, f"{place}, moves")


def vehicle_names() -> tuple[str, ...]:
    """Return the names of all vehicles of the catalogue, reduced ones included."""
    tables = (PurePath(item.name).stem for item in files(__name__).iterdir() if item.name.endswith(".toml"))
    return tuple(sorted((*tables, _FOSSEN)))


def load_vehicle(name: str) -> PublishedVehicle:
    """Load a vehicle by name.

    Args:
        name: one of `vehicle_names()`.

    Returns:
        the vehicle with its published coefficients, SI.

    Raises:
        InputError: no vehicle of that name.
    """
    return _load(check_text(name, "vehicle, name", "give a name of `vehicle_names()`"), vehicle_names())


def surge_names() -> tuple[str, ...]:
    """Return the names of the vehicles of surge alone."""
    return tuple(name for name in vehicle_names() if name.endswith(_SURGE))


@cache
def load_surge(name: str) -> PublishedVehicle:
    """Load a vehicle of surge alone; its trim speed is solved from its own coefficients and the trim control.

    Raises:
        InputError: no such vehicle.
    """
    vehicle = _load(name, surge_names())
    trim = vehicle.hull.trim
    model = vehicle.build()
    speed = trim_speed(model, vehicle.coefficients, [trim[control] for control in model.controls])
    return replace(vehicle, hull=replace(vehicle.hull, trim={"u": speed, **trim}))


# Coefficients without dimension and back: primes by density, length and speed (SNAME 1950; Prime I of Fossen, table
# 7.2).
#
#     c = c' rho/2 L^a U^b
#
# The powers follow from the dimension of the coefficient alone: forces are in rho/2 U^2 L^2, moments in rho/2 U^2 L^3,
# velocities in U, turning rates in U/L; angles stay as they are. A mass is in rho/2 L^3, an inertia in rho/2 L^5.
# Where tables of a ship are in primes of its own instantaneous speed, a coefficient of order k in the motion carries
# U^(2-k): constants of U are those here only at the speed given. Terms of a change of speed, `X_du2`, are handled
# alike.
#
# Tables of ships often count the rigid body's own Coriolis forces among the coefficients (m' in X_vr and Y_r, m' x_G'
# in N_r), which a whole vehicle makes itself: take them out first. Their rudder is positive to port or to starboard;
# the signs of Y and N by it tell.


def prime_scale(name: str, *, density: float, length: float, speed: float) -> float:
    """Return the SI value of a coefficient whose prime is 1.

    Args:
        name: coefficient; propeller speeds count as turning rates.
        density: rho, kg/m^3.
        length: L, m.
        speed: U, m/s.
    """
    dimension = CoefficientName.parse(name).dimension
    # rho/2 takes the kilogram with m^-3; what is left of seconds is U's, what is left of metres is L's.
    return (
        (0.5 * density) ** dimension.kg
        * speed ** (-dimension.s)
        * length ** (dimension.m + 3 * dimension.kg + dimension.s)
    )


def from_prime(name: str, value: float, *, density: float, length: float, speed: float) -> float:
    """Return the SI value of a coefficient without dimension; arguments as `prime_scale`."""
    return value * prime_scale(name, density=density, length=length, speed=speed)


@cache
def _load(name: str, names: tuple[str, ...]) -> PublishedVehicle:
    if name not in names:
        raise InputError(
            f'vehicle "{name}"',
            found="no such vehicle in the catalogue",
            expected=", ".join(names),
            remedy=nearest(name, names),
        )
    if name == _FOSSEN:
        return PublishedVehicle(spheroid_hull(), {}, RATES, actuators=ACTUATORS, notes=NOTES, written=remus100_fossen)
    text = files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return _vehicle(tomllib.loads(text), text, f"catalogue {name}")


def _vehicle(table: dict[str, Any], text: str, where: str) -> PublishedVehicle:
    fixed, coefficients = _values(table, "fixed", where), _values(table, "coefficients", where)
    hull = _hull(table, fixed, where)
    notes = "\n".join(line.removeprefix("#").removeprefix(" ") for line in text.split("\nname =")[0].splitlines())
    return PublishedVehicle(
        hull,
        coefficients,
        tuple(table.get("moves", _moving(hull, {**fixed, **coefficients}))),
        table.get("added_coriolis", "named"),
        tuple(
            Thruster(_lengths(row["place"], where), tuple(map(float, row["direction"])))
            for row in table.get("thrusters", [])
        ),
        _actuators(table, where),
        notes,
    )


def _values(table: dict[str, Any], part: str, where: str) -> dict[str, float]:
    """Return the coefficients in SI; those of a vehicle with `[primes]` are without dimension in the file."""
    values = {CoefficientName.parse(name).text: float(value) for name, value in table.get(part, {}).items()}
    if "primes" not in table:
        return values
    units = {"density": "kg/m^3", "length": "m", "speed": "m/s"}
    scale = {key: quantity(table["primes"][key], unit, where) for key, unit in units.items()}
    return {name: from_prime(name, value, **scale) for name, value in values.items()}


def _hull(table: dict[str, Any], fixed: dict[str, float], where: str) -> Hull:
    mass = quantity(table["mass"], "kg", where)
    weight = quantity(table["weight"], "N", where) if "weight" in table else mass * GRAVITY
    net = quantity(table.get("net_buoyancy", "0 N"), "N", where)
    return whole_hull(
        table["name"],
        mass,
        [quantity(text, "kg m^2", where) if text else None for text in table.get("inertia", [""] * 3)],
        products=[quantity(text, "kg m^2", where) for text in table.get("products", ["0 kg m^2"] * 3)],
        centre_of_gravity=_lengths(table.get("centre_of_gravity", ["0 m"] * 3), where),
        centre_of_buoyancy=_lengths(table.get("centre_of_buoyancy", ["0 m"] * 3), where),
        weight=weight,
        buoyancy=quantity(table["buoyancy"], "N", where) if "buoyancy" in table else weight + net,
        thrust_deduction=table.get("thrust_deduction", 0.0),
        wake=table.get("wake", 0.0),
        fixed=fixed,
        trim={name: quantity(text, signal_unit(name), where) for name, text in table.get("trim", {}).items()},
        symmetric=table.get("symmetric_added_mass", True),
    )


def _moving(hull: Hull, values: Mapping[str, float]) -> tuple[str, ...]:
    """Return the velocities whose axes have terms and known inertia."""
    names = [CoefficientName.parse(name) for name in values]
    axes = {"X" if name.axis == "T" else name.axis for name in names}
    known = (True, True, True, *(part is not None for part in hull.inertia))
    return tuple(rate for rate, axis, has in zip(RATES, "XYZKMN", known, strict=True) if axis in axes and has)


def _lengths(texts: Sequence[str], where: str) -> tuple[float, float, float]:
    x, y, z = (quantity(text, "m", where) for text in texts)
    return x, y, z


def _actuators(table: dict[str, Any], where: str) -> dict[str, Actuator]:
    results = {}
    for name in dict.fromkeys((*table.get("limits", {}), *table.get("lags", {}), *table.get("rates", {}))):
        unit = signal_unit(name)
        lower, upper = table.get("limits", {}).get(name, (None, None))
        lag, rate = table.get("lags", {}).get(name), table.get("rates", {}).get(name)
        limits = {} if lower is None else {"lower": quantity(lower, unit, where), "upper": quantity(upper, unit, where)}
        limits |= {} if rate is None else {"rate": quantity(rate, f"{unit}/s", where)}
        results[name] = Actuator(0.0 if lag is None else quantity(lag, "s", where), **limits)
    return results
