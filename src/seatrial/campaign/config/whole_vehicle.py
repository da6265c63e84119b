"""A campaign's vehicle in up to six degrees of freedom: a published one or one by hand, restricted to what moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from seatrial.campaign.config.vehicle import AxesVehicle, CampaignVehicle, check_alone
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import ANGLES, RATES, SIGNALS, is_signal, signal_unit
from seatrial.selection.structures import Structure
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.axis_equation import AxisEquation
from seatrial.vehicles.catalogue import PublishedVehicle, load_surge, load_vehicle, surge_names
from seatrial.vehicles.hull import Hull, whole_hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull
from seatrial.vehicles.whole import whole_vehicle

if TYPE_CHECKING:
    from seatrial.campaign.config.campaign import Campaign
    from seatrial.campaign.config.schema import VehicleTable


# Reads `[vehicle]`: by its axes or as a whole, as the table says.

BY_AXES = ("catalogue", "name", "mass", "thrust_deduction", "fixed", "trim", "published_to", "known_from")
"""Keys of a vehicle by its axes."""
OWN_ADDED_MASS = tuple(f"{axis}_{rate}dot" for axis, rate in zip("XYZKMN", RATES, strict=True))
"""Added masses that act against the acceleration which they are of; the others may have either sign."""


def read_vehicle(campaign: "Campaign") -> CampaignVehicle:
    """The vehicle of a campaign.

    Raises:
        InputError: keys that contradict each other, or numbers that no vehicle has.
    """
    table = campaign.source.vehicle
    for name, value in table.fixed.items():
        with located(campaign.where(f"vehicle.fixed.{name}")):
            CoefficientName.parse(name)
        if name in OWN_ADDED_MASS and value > 0:
            raise InputError(
                campaign.where(f"vehicle.fixed.{name}"),
                found=f"{value:g}, an added mass that makes the vehicle lighter",
                expected="a number below zero: the water that is set in motion opposes the acceleration",
                remedy=f"write {-value:g}, if {value:g} is the mass of that water",
            )
    for name in table.trim:
        if name not in SIGNALS:
            raise InputError(
                campaign.where(f"vehicle.trim.{name}"),
                found=f'signal "{name}"',
                expected="a signal",
                remedy=nearest(name, SIGNALS),
            )
    if table.moves is not None or (table.catalogue is not None and table.catalogue not in surge_names()):
        return read_whole_vehicle(campaign)
    others = sorted(table.model_fields_set - set(BY_AXES))
    if others:
        raise InputError(
            campaign.where(f"vehicle.{others[0]}"),
            found=", ".join(others),
            expected="`moves` beside it: what of a whole vehicle is modelled",
            remedy='add moves = ["u", "w", "q"], or remove it',
        )
    if table.catalogue is not None:
        check_alone(campaign, tuple(set(BY_AXES) - {"catalogue", "published_to", "known_from"}))
        with located(campaign.where("vehicle.catalogue")):
            entry = load_surge(table.catalogue)
        return AxesVehicle(campaign, entry.hull, entry.coefficients)
    if table.mass is None:
        raise InputError(
            campaign.where("vehicle.mass"),
            found="neither a mass nor a catalogue name",
            expected='for example "30.5 kg", or "unknown"',
            remedy='with "unknown" every coefficient is estimated per unit of effective mass',
        )
    mass = None if table.mass == "unknown" else campaign.si(table.mass, "kg", "vehicle.mass")
    trim = {name: campaign.si(text, signal_unit(name), f"vehicle.trim.{name}") for name, text in table.trim.items()}
    hull = SurgeHull(table.name or "vehicle", mass, table.thrust_deduction, table.fixed, trim)
    return AxesVehicle(campaign, hull, {})


BODY = (
    *("name", "mass", "inertia", "products", "centre_of_gravity", "centre_of_buoyancy", "weight", "buoyancy"),
    *("thrust_deduction", "wake"),
)
"""Keys of a body that a catalogue entry already says."""


@dataclass(frozen=True, eq=False)
class WholeVehicle:
    """See `CampaignVehicle`; coefficients that no structure names are fixed at their published values."""

    campaign: "Campaign"
    body: PublishedVehicle
    hull: Hull

    @property
    def published(self) -> Mapping[str, float]:
        """See `CampaignVehicle`."""
        return {**self.body.hull.fixed, **self.body.coefficients}

    @property
    def is_surge(self) -> bool:
        """See `CampaignVehicle`."""
        return self._moves == ("u",)

    def model(self, structure: Structure) -> VehicleModel:
        """See `CampaignVehicle`."""
        table, actuators = self.campaign.source.vehicle, _actuators(self.campaign, self.body)
        with located(self.campaign.where("vehicle")):
            return whole_vehicle(
                self.hull,
                structure.terms,
                moves=self._moves,
                given=table.given,
                attitude=table.attitude,
                positions=table.positions,
                angles=_angles_shown(self.campaign),
                added_coriolis=self.body.added_coriolis,
                thrusters=self.body.thrusters,
                actuators=actuators,
            )

    def equations(self, structure: Structure) -> tuple[AxisEquation, ...]:
        """None: its axes are coupled by inertia, weight and buoyancy."""
        return ()

    @property
    def _moves(self) -> tuple[str, ...]:
        return tuple(self.campaign.source.vehicle.moves or self.body.moves)


def read_whole_vehicle(campaign: "Campaign") -> WholeVehicle:
    """Vehicle of a campaign that says what moves, or names one of the catalogue that is whole.

    Raises:
        InputError: a body both of the catalogue and by hand, or numbers that no body has.
    """
    table = campaign.source.vehicle
    if table.catalogue is None:
        body = PublishedVehicle(_by_hand(campaign, table), {}, tuple(table.moves or ()))
    else:
        with located(campaign.where("vehicle.catalogue")):
            body = load_vehicle(table.catalogue)
        check_alone(campaign, BODY)
        if body.written is not None:
            raise InputError(
                campaign.where("vehicle.catalogue"),
                found=f'"{table.catalogue}", whose forces are no sum of named coefficients',
                expected="a vehicle with coefficients to estimate",
                remedy="simulate it to make records, and estimate another one from them",
            )
    sought = {CoefficientName.parse(term) for term in campaign.full.terms}
    known = {**body.hull.fixed, **body.coefficients, **table.fixed}
    fixed = {name: value for name, value in known.items() if CoefficientName.parse(name) not in sought}
    trim = {name: campaign.si(text, signal_unit(name), f"vehicle.trim.{name}") for name, text in table.trim.items()}
    return WholeVehicle(campaign, body, replace(body.hull, fixed=fixed, trim={**body.hull.trim, **trim}))


def _by_hand(campaign: "Campaign", table: "VehicleTable") -> Hull:
    if table.mass is None or table.mass == "unknown":
        raise InputError(
            campaign.where("vehicle.mass"),
            found="nothing" if table.mass is None else '"unknown" together with `moves`',
            expected='for example "30.5 kg": a whole vehicle is a body with a mass',
            remedy="without `moves`, axes are estimated one by one per unit of an unknown inertia",
        )

    def three(key: str, unit: str) -> list[float] | None:
        written: Sequence[str] | None = getattr(table, key)
        return None if written is None else [campaign.si(text, unit, f"vehicle.{key}") for text in written]

    sizes = {"weight": "N", "buoyancy": "N"}
    given = {
        key: campaign.si(text, unit, f"vehicle.{key}")
        for key, unit in sizes.items()
        if (text := getattr(table, key)) is not None
    }
    with located(campaign.where("vehicle")):
        return whole_hull(
            table.name or "vehicle",
            campaign.si(table.mass, "kg", "vehicle.mass"),
            three("inertia", "kg m^2") or (None, None, None),
            products=three("products", "kg m^2") or (0.0, 0.0, 0.0),
            centre_of_gravity=three("centre_of_gravity", "m") or (0.0, 0.0, 0.0),
            centre_of_buoyancy=three("centre_of_buoyancy", "m") or (0.0, 0.0, 0.0),
            thrust_deduction=table.thrust_deduction,
            wake=table.wake,
            fixed=table.fixed,
            **given,
        )


def _angles_shown(campaign: "Campaign") -> tuple[str, ...]:
    """Angles that a sensor measures or a limit bounds: they travel with the state also where no force depends on them."""
    source = campaign.source
    return tuple(angle for angle in ANGLES if angle in (*source.sensors, *source.limits))


def _actuators(campaign: "Campaign", body: PublishedVehicle) -> dict[str, Actuator]:
    """Lags and limits by hand; the published ones of a catalogue entry where `actuators = "published"`."""
    written = campaign.source.vehicle.actuators
    if written == "published":
        return dict(body.actuators)
    found = {}
    for name, table in (written or {}).items():
        key = f"vehicle.actuators.{name}"
        if not is_signal(name) or not table.model_fields_set:
            raise InputError(
                campaign.where(key),
                found="a table without keys" if is_signal(name) else f'"{name}"',
                expected="a control of the vehicle, with a lag or limits",
                remedy="remove the table, or give lag, lower, upper or rate"
                if is_signal(name)
                else nearest(name, SIGNALS),
            )
        unit = signal_unit(name)
        limits = {
            bound: campaign.si(text, unit, f"{key}.{bound}")
            for bound in ("lower", "upper")
            if (text := getattr(table, bound)) is not None
        }
        if table.rate is not None:
            limits["rate"] = campaign.si(table.rate, f"({unit})/s", f"{key}.rate")
        found[name] = Actuator(campaign.si(table.lag, "s", f"{key}.lag"), **limits)
    return found
