"""Reading a campaign's TOML file: whatever is wrong with it is found before any work is done."""

from collections.abc import Mapping
from pathlib import Path

from seatrial.campaign.config import FILE_NAME, Campaign
from seatrial.campaign.earlier import with_earlier
from seatrial.campaign.idle_keys import check_idle_keys
from seatrial.campaign.nuisances import nuisances
from seatrial.campaign.schema import CampaignFile
from seatrial.campaign.simulated import actuator_lag, beyond_structures
from seatrial.campaign.templates import example_of
from seatrial.campaign.toml_file import parse_toml, read_text
from seatrial.campaign.trials import check_import
from seatrial.campaign.utilities import check_utility
from seatrial.core.errors import InputError, nearest
from seatrial.estimation.priors import Uniform
from seatrial.estimation.sensors import correlation_name

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
    lag = actuator_lag(source.design.control)
    if source.truth.get(lag, 0.0) < 0:
        raise InputError(
            campaign.where(f"truth.{lag}"),
            found=f"{source.truth[lag]:g} s",
            expected="0 s or more",
            remedy="give the time constant of the actuator; 0 s is none",
        )
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
