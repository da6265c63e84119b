"""Keys of a campaign file that nothing reads beside the others that stand there: refused, for their author expects something of them."""

from collections.abc import Iterator
from typing import NamedTuple

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import CampaignFile
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.selection.structures import MAX_STRUCTURES
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.tether import LINEAR, TETHER


class Idle(NamedTuple):
    """A key, why it has no effect, and what to do about it."""

    key: str
    because: str
    remedy: str = "remove it"


def check_idle_keys(file: CampaignFile, campaign: Campaign) -> None:
    """Check that every key that is written has an effect; what stands in two places at once is refused where it is read.

    Args:
        file: as written.
        campaign: what was read from it.

    Raises:
        InputError: the first key that has none.
    """
    for idle in (
        *_vehicle(file, campaign),
        *_fixed(file, campaign),
        *_structure(file),
        *_current(file),
        *_design(file, campaign),
    ):
        raise InputError(
            campaign.where(idle.key),
            found=f"a key without effect: {idle.because}",
            expected="keys that have an effect",
            remedy=idle.remedy,
        )


def _vehicle(file: CampaignFile, campaign: Campaign) -> Iterator[Idle]:
    table = file.vehicle
    thrusts = {CoefficientName.parse(name).axis for name in (*campaign.full.terms, *campaign.hull.fixed)}
    for key in sorted({"thrust_deduction", "wake"} & table.model_fields_set):
        if "T" not in thrusts:
            yield Idle(f"vehicle.{key}", "no thrust T_… is sought or fixed", "remove it, or add thrust such as T_nabsn")
    if "attitude" in table.model_fields_set and table.moves and not set(table.moves) & set("pqr"):
        yield Idle("vehicle.attitude", "nothing that moves turns the vehicle", "remove it, or add p, q or r to `moves`")
    if table.actuators == "published" and table.catalogue is None:
        yield Idle("vehicle.actuators", "nothing is published of a vehicle by hand", "give a table for each actuator")
    tether = campaign.hull.tether if isinstance(campaign.hull, Hull) else None
    if tether is not None and not (tether.linear or tether.quadratic or set(TETHER) & set(campaign.priors)):
        yield Idle("vehicle.tether", "it has no drag", f"give linear or quadratic, or [prior.{LINEAR}], or remove it")


def _fixed(file: CampaignFile, campaign: Campaign) -> Iterator[Idle]:
    sought, vehicle = {CoefficientName.parse(name) for name in campaign.full.terms}, campaign.vehicle
    axes = set() if vehicle.is_surge else {one.axis for one in vehicle.equations(campaign.full)}
    for name in file.vehicle.fixed:
        term = CoefficientName.parse(name)
        if term in sought and file.vehicle.published_prior_sd is None:
            yield Idle(f"vehicle.fixed.{name}", f"[structure] has {name} sought", "remove it here, or there")
        elif axes and ("X" if term.axis == "T" else term.axis) not in axes:
            yield Idle(f"vehicle.fixed.{name}", f"no term of [structure] is on the axis {term.axis}")


def _structure(file: CampaignFile) -> Iterator[Idle]:
    for key in sorted({"shortlist", "g"} & file.structure.model_fields_set):
        if 2 ** len(file.structure.optional) <= MAX_STRUCTURES:
            yield Idle(
                f"structure.{key}", f"all of {MAX_STRUCTURES} structures or fewer are simulated, and none screened"
            )
    for channel, table in file.sensors.items():
        if "reference" in table.model_fields_set and channel != "u":
            yield Idle(f"sensors.{channel}.reference", "only the speed u is measured over ground or through the water")


def _current(file: CampaignFile) -> Iterator[Idle]:
    """A current along the course adds to the speed over the ground, and to nothing else that is measured."""
    sensor, because = file.sensors.get("u"), "no sensor measures the speed u over ground"
    if sensor is None or sensor.reference == "water":
        if file.estimation.current != "none":
            yield Idle("estimation.current", because)
        if CURRENT in file.truth:
            yield Idle(f"truth.{CURRENT}", because)


def _design(file: CampaignFile, campaign: Campaign) -> Iterator[Idle]:
    table = file.design
    if table is None:
        return
    if "probability" in table.model_fields_set and not campaign.motion_limits:
        yield Idle(
            "design.probability", "[limits] bounds no motion", "remove it, or limit the motion: [limits.distance]"
        )
    if table.over != "mean" and table.utility == "entropy" and table.per != "second":
        yield Idle(
            "design.over",
            "the entropy reduction is that of the filter, at the mean",
            'remove it, or set utility = "fisher-d"',
        )
