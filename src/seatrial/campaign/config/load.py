"""Reading a campaign's TOML file: whatever is wrong with it is found before any work is done."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from seatrial.campaign.config.campaign import FILE_NAME, Campaign
from seatrial.campaign.config.earlier_campaigns import with_earlier
from seatrial.campaign.config.nuisance_parameters import nuisances
from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.config.templates import example_of
from seatrial.campaign.config.toml import parse_toml, read_text
from seatrial.campaign.data.import_logs import check_import
from seatrial.campaign.data.true_vehicle import beyond_structures, check_truth
from seatrial.campaign.design.utility import check_utility
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, nearest
from seatrial.estimation.priors import Uniform
from seatrial.estimation.sensors import correlation_name
from seatrial.estimation.simulation import CURRENT
from seatrial.selection.structures import MAX_STRUCTURES

# Keys of a campaign file that nothing reads beside the others that stand there: refused, for their author expects
# something of them.


class Idle(NamedTuple):
    """A key, why it has no effect, and what to do about it."""

    key: str
    because: str
    remedy: str = "remove it"


def check_idle_keys(campaign: Campaign, fixed: Iterable[str]) -> None:
    """Check that every key that is written has an effect; what stands in two places at once is refused where it is read.

    Args:
        campaign: with what earlier campaigns found.
        fixed: coefficients that its file fixes.

    Raises:
        InputError: the first key that has none.
    """
    for idle in (
        *_vehicle(campaign),
        *_fixed(campaign, fixed),
        *_structure(campaign),
        *_current(campaign),
        *_design(campaign),
    ):
        raise InputError(
            campaign.where(idle.key),
            found=f"a key without effect: {idle.because}",
            expected="keys that something reads",
            remedy=idle.remedy,
        )


def _vehicle(campaign: Campaign) -> Iterator[Idle]:
    table = campaign.source.vehicle
    thrusts = {CoefficientName.parse(name).axis for name in (*campaign.full.terms, *campaign.hull.fixed)}
    for key in sorted({"thrust_deduction", "wake"} & table.model_fields_set):
        if "T" not in thrusts:
            yield Idle(f"vehicle.{key}", "no thrust T_… is sought or fixed", "remove it, or add thrust such as T_nabsn")
    if "attitude" in table.model_fields_set and table.moves and not set(table.moves) & set("pqr"):
        yield Idle("vehicle.attitude", "nothing that moves turns the vehicle", "remove it, or add p, q or r to `moves`")
    if table.actuators == "published" and table.catalogue is None:
        yield Idle("vehicle.actuators", "nothing is published of a vehicle by hand", "give a table for each actuator")


def _fixed(campaign: Campaign, fixed: Iterable[str]) -> Iterator[Idle]:
    table = campaign.source.vehicle
    sought = {CoefficientName.parse(name) for name in campaign.full.terms}
    vehicle = campaign.vehicle
    axes = set() if vehicle.is_surge else {one.axis for one in vehicle.equations(campaign.full)}
    for name in fixed:
        term = CoefficientName.parse(name)
        if term in sought and table.published_to is None:
            yield Idle(f"vehicle.fixed.{name}", f"[structure] has {name} sought", "remove it here, or there")
        elif axes and ("X" if term.axis == "T" else term.axis) not in axes:
            yield Idle(f"vehicle.fixed.{name}", f"no term of [structure] is on the axis {term.axis}")


def _structure(campaign: Campaign) -> Iterator[Idle]:
    for key in sorted({"shortlist", "g"} & campaign.source.structure.model_fields_set):
        if 2 ** len(campaign.source.structure.optional) <= MAX_STRUCTURES:
            yield Idle(
                f"structure.{key}", f"all of {MAX_STRUCTURES} structures or fewer are simulated, and none screened"
            )
    for channel, table in campaign.source.sensors.items():
        if "over" in table.model_fields_set and channel != "u":
            yield Idle(f"sensors.{channel}.over", "only the speed u is measured over ground or through the water")


def _current(campaign: Campaign) -> Iterator[Idle]:
    """A current along the course adds to the speed over the ground, and to nothing else that is measured."""
    sensor, because = campaign.source.sensors.get("u"), "no sensor measures the speed u over ground"
    if sensor is None or sensor.over == "water":
        if campaign.source.estimation.current != "none":
            yield Idle("estimation.current", because)
        if CURRENT in campaign.source.truth:
            yield Idle(f"truth.{CURRENT}", because)


def _design(campaign: Campaign) -> Iterator[Idle]:
    table = campaign.source.design
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


PROPULSION = {"n": "1200 rpm", "tau_X": "20 N"}
"""Controls that hold a speed, each with an example of a value."""


def load_campaign(folder: Path | str) -> Campaign:
    """Read and check the campaign of a folder, or of the campaign file itself.

    Raises:
        InputError: no such file, one that is too large or not UTF-8, malformed TOML, unknown or missing key, wrong type, unit or name.
    """
    folder = Path(folder)
    folder = folder.parent if folder.name == FILE_NAME and folder.is_file() else folder
    path = folder / FILE_NAME
    if not path.is_file():
        raise InputError(
            str(path),
            found="no such file",
            expected=f"a campaign folder with {FILE_NAME}",
            remedy=f"create one with `seatrial init {folder}`",
        )
    return check_text(folder, read_text(path))


def check_text(folder: Path, text: str) -> Campaign:
    """Check a campaign file by its text, which may be what is to be written there.

    Raises:
        InputError: as `load_campaign`.
    """
    written = Campaign(folder, parse_toml(folder / FILE_NAME, text, CampaignFile, example_of), text=text)
    campaign = with_earlier(written)
    _check(campaign)
    check_idle_keys(campaign, written.source.vehicle.fixed)
    return campaign


def _check(campaign: Campaign) -> None:
    """Resolve everything once, so that mistakes are found before any work is done."""
    full = campaign.full
    model = campaign.model(full)
    names = {term.text for term in model.coefficients}
    for term in model.coefficients:
        campaign.prior(term.text, model.unit_of(term))
    unknown = nuisances(campaign, model)
    allowed = names | set(campaign.rules.never) | {nuisance.name for nuisance in unknown} | {"delay"}
    for name in campaign.source.prior:
        if name not in allowed:
            raise InputError(
                campaign.where(f"prior.{name}"),
                found=f'"{name}", which nothing uses',
                expected="one of " + ", ".join(sorted(allowed)),
                remedy="remove it: white residuals have no correlation time"
                if name in map(correlation_name, campaign.channels)
                else nearest(name, allowed),
            )
    if campaign.has_delay and not isinstance(campaign.prior("delay", "s"), Uniform):
        raise InputError(
            campaign.where("prior.delay"),
            found=f"a {type(campaign.prior('delay', 's')).__name__} prior",
            expected="a uniform prior from 0 s",
            remedy="give lower and upper",
        )
    for channel in campaign.channels:
        _ = campaign.noise(channel), campaign.rate(channel)
    _ = campaign.process_noise()
    for nuisance in unknown:
        if not nuisance.signed and nuisance.prior.bounds[0] < 0:
            raise InputError(
                campaign.where(f"prior.{nuisance.name}"),
                found="a support that reaches below 0",
                expected="a prior from 0 up",
                remedy="give lower = 0 and upper, or a half-normal or log-uniform prior",
            )
    _ = campaign.families, campaign.grid(), campaign.limits(), campaign.motion_limits, campaign.goal
    if campaign.source.design.per == "joule":
        campaign.power()
    check_utility(campaign)
    _check_ranges(campaign)
    _check_late_quantities(campaign)
    _check_source(campaign, names | beyond_structures(campaign))


def _check_ranges(campaign: Campaign) -> None:
    """A range of one point has one end."""
    table = campaign.source.design
    ranges = {"amplitude": table.amplitude, "period": table.period}
    if table.relay is not None:
        ranges["relay.threshold"] = table.relay.threshold
    for name, one in ranges.items():
        if one.points == 1 and one.start != one.stop:
            raise InputError(
                campaign.where(f"design.{name}"),
                found=f"1 point from {one.start} to {one.stop}",
                expected="2 points or more, or `from` and `to` the same",
                remedy="ask for more points",
            )


def _check_late_quantities(campaign: Campaign) -> None:
    """Quantities that are first needed when much has been done."""
    campaign.process_noise()
    if campaign.source.power is not None:
        campaign.power()
    for channel, sensor in campaign.source.sensors.items():
        if sensor.rate is not None and not campaign.si(sensor.rate, "1/s", f"sensors.{channel}.rate") > 0:
            raise InputError(
                campaign.where(f"sensors.{channel}.rate"),
                found=f"{sensor.rate}",
                expected="more than 0 Hz",
                remedy="leave it out where the sensor gives every sample",
            )


def _check_source(campaign: Campaign, names: set[str]) -> None:
    source = campaign.source
    if campaign.is_simulated and source.imported is not None:
        raise InputError(
            str(campaign.path),
            found="both [truth] and [import]",
            expected="one of them: a simulated vehicle or a real log",
            remedy="remove one of the two; without both a trial is designed before there are any data",
        )
    check_import(campaign)
    if source.imported is not None:
        runs = (*source.imported.fit, *source.imported.predict)
        for run in source.imported.trim:
            if run not in runs:
                raise InputError(
                    campaign.where(f"import.trim.{run}"),
                    found=f'run "{run}"',
                    expected="one of " + ", ".join(runs),
                    remedy=nearest(run, runs),
                )
    for name in source.truth:
        if name not in names:
            raise InputError(
                campaign.where(f"truth.{name}"),
                found=f'"{name}"',
                expected="one of " + ", ".join(sorted(names)),
                remedy="the rules of [structure] leave it out of every structure: drop it here, or the rule that does"
                if name in campaign.rules.never
                else nearest(name, names),
            )
    check_truth(campaign)
    _check_start(campaign)


def _check_start(campaign: Campaign) -> None:
    """Where trials begin, as far as no record shows it."""
    trim, moves_ahead = campaign.hull.trim, "u" in campaign.model(campaign.full).states
    if not campaign.has_records:
        _check_stated_start(campaign, trim, moves_ahead)
    elif campaign.source.estimation.initial == "trim" and moves_ahead and "u" not in trim:
        raise InputError(
            campaign.where("estimation.initial"),
            found='"trim"',
            expected="a vehicle whose trim speed is known",
            remedy='give vehicle.trim.u, or set initial = "measured" or "estimated"',
        )


def _check_stated_start(campaign: Campaign, trim: Mapping[str, float], moves_ahead: bool) -> None:
    """Without a record the speed at which a trial begins is stated, and where every control is held."""
    if moves_ahead and "u" not in trim:
        raise InputError(
            campaign.where("vehicle.trim.u"),
            found="nothing",
            expected="the speed at which a trial begins, which no record shows yet",
            remedy='add trim = { u = "1.5 m/s" } to [vehicle]; "0 m/s" begins at rest',
        )
    control = campaign.source.design.control
    if control in PROPULSION and trim.get("u") and campaign.source.design.trim is None and control not in trim:
        raise InputError(
            campaign.where(f"vehicle.trim.{control}"),
            found="nothing",
            expected=f"the value of {control} that holds the {trim['u']:g} m/s at which a trial begins",
            remedy=f'add {control} = "{PROPULSION[control]}" to the trim of [vehicle]; `seatrial prior` shows what the priors make of it',
        )
    campaign.control_trim(campaign.model(campaign.full))
