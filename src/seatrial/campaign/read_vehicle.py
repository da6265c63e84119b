"""Reads `[vehicle]`: by its axes or as a whole, as the table says."""

from typing import TYPE_CHECKING

from seatrial.campaign.vehicle import AxesVehicle, CampaignVehicle, check_alone
from seatrial.campaign.whole_vehicle import read_whole_vehicle
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import RATES, SIGNALS, signal_unit
from seatrial.vehicles.catalogue import catalogue_names, catalogue_vehicle
from seatrial.vehicles.surge import SurgeHull

if TYPE_CHECKING:
    from seatrial.campaign.config import Campaign

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
    if table.moves is not None or (table.catalogue is not None and table.catalogue not in catalogue_names()):
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
            entry = catalogue_vehicle(table.catalogue)
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
