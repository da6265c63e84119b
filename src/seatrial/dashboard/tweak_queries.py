"""Questions of the page on which values are moved by hand; answered in the thinking process, where records and programs stay warm."""

from functools import lru_cache
from typing import NamedTuple

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.toml_edit import with_values
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import stored_estimates
from seatrial.campaign.inference.modes import kept_modes
from seatrial.campaign.inference.posterior import initial_state
from seatrial.campaign.store.results import Results
from seatrial.campaign.workflow.steps import Workflow
from seatrial.core.coefficients import base_name, configuration_name, is_coefficient
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.dashboard.downsample import rows_view
from seatrial.dashboard.record_views import origin_of
from seatrial.dashboard.view_models import Movable, Tweaked, Tweaking
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.prediction.tweak import tweak
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.whole import MASS, stated_mass

REACH, MASS_SHARE = 5.0, 0.3  # Standard deviations, and share of the stated mass, on either side that a slider offers
DIGITS = 6  # Significant digits of a start that is written


class _Known(NamedTuple):
    """A campaign with its records, fitted ones first, and the mode of each structure, the chosen one first."""

    campaign: Campaign
    trials: Trials
    study: Study
    records: dict[str, Record]
    modes: dict[str, Mode]

    def posterior(self, label: str) -> Posterior:
        """Return the posterior of a structure."""
        return self.study.posterior(next(one for one in self.campaign.structures if one.label == label))


def tweaked(folder: str, files: tuple, asked: Tweaking, view: tuple[float, float, int] | None) -> Tweaked:
    """Predict a record by a structure with some values moved, as they are shown.

    Args:
        folder: of the campaign.
        files: stamps of what the answer rests on: read again when they change.
        asked: structure and record, the first ones if none are named, and moved values.
        view: first and last time, s, and columns of pixels; None for no curves.

    Raises:
        InputError: records that are not current, modes that were not found yet, or a value that cannot be.
    """
    known = _known(folder, files)
    label, run = asked.structure or next(iter(known.modes)), asked.record or next(iter(known.records))
    record, posterior = known.records[run], known.posterior(label)
    numbers = movable(folder, files, label, record.configuration)
    held_back = run not in posterior.likelihood.labels
    start = initial_state(known.campaign, posterior.likelihood.model, record) if held_back else None
    moved = dict(asked.moved)
    values = {one.name: moved[one.name] / one.factor for one in numbers if one.name in moved}
    sds = {one.name: one.sd / one.factor for one in numbers}
    result = tweak(posterior, known.modes[label], record, values, follow=asked.follow, sd=sds, start=start)
    columns = {"time": record.time + origin_of(record.provenance.options, record.provenance.source)}
    best, measured = result.best.mean, result.measured
    parts = {"": result.tweaked.mean, " residual": result.residual, " best": best, " measured": measured}
    for at, name in enumerate(result.channels):
        columns |= {name + part: of_all[:, at] * shown_unit(name)[0] for part, of_all in parts.items()}
    shares = zip(result.channels, result.tweaked.explained.tolist(), result.best.explained.tolist(), strict=True)
    return Tweaked(
        tuple(known.modes),
        tuple(known.records),
        tuple(one._replace(value=one.factor * result.values[one.name]) for one in numbers),
        {} if view is None else rows_view(columns, *view),
        (float(columns["time"][0]), float(columns["time"][-1])),
        tuple((name, shown_unit(name)[1], *both) for name, *both in shares),
        tuple(best - now for best, now in zip(result.best[2:], result.tweaked[2:], strict=True)),
        result.distance,
        result.probability,
    )


def start_text(
    folder: str, files: tuple, asked: Tweaking, text: str, values: tuple[tuple[str, float], ...]
) -> tuple[str, str]:
    """Return the lines by which the search begins at some values of a structure too, and the whole campaign file with them, checked.

    Raises:
        InputError: a value outside its prior, or a file that cannot be edited.
    """
    known, chosen = _known(folder, files), dict(values)
    priors, start = {one.name: one.prior for one in known.posterior(asked.structure).present_parameters}, {}
    for one in movable(folder, files, asked.structure, known.records[asked.record].configuration):
        if one.name in priors:
            start[one.name] = float(f"{chosen[one.name] / one.factor:.{DIGITS}g}")
            low, high = (one.factor * float(bound) for bound in priors[one.name].bounds)
            if not low <= one.factor * start[one.name] <= high:
                raise InputError(
                    one.name,
                    found=f"{chosen[one.name]:.5g} {one.unit}, outside its prior",
                    expected=f"a start from {low:.5g} to {high:.5g} {one.unit}",
                    remedy="move it back, or widen its prior under Model",
                )
    lines, edited = (with_values(one, {("estimation", "start_values"): start}, folder) for one in ("", text))
    check_text(known.campaign.folder, edited)
    return lines, edited


@lru_cache(maxsize=2)
def _known(folder: str, files: tuple) -> _Known:
    del files  # part of the key only
    flow = Workflow(load_campaign(folder))
    # Otherwise they would be made, and written.
    is_there = flow.state("trials") == flow.state("candidates") == "current"
    modes = kept_modes(flow.get("candidates"), flow.get("trials")) if is_there else None
    if modes is None:
        raise InputError(
            folder,
            found="records or best values that are missing, or older than the campaign file or its logs",
            expected="the mode of each structure given the records as they are now",
            remedy="run estimate; `--by mode` takes seconds",
        )
    campaign, trials = flow.get("candidates"), flow.get("trials")
    chosen = Results(campaign.folder).summary().chosen if flow.state("estimates") == "current" else ""
    labels = sorted((one.label for one in campaign.structures if modes.of(one)), key=lambda one: one != chosen)
    records = {one.label: one for one in (*trials.fit, *trials.predict)}
    return _Known(campaign, trials, Study(campaign, trials.fit), records, {one: modes.modes[one][0] for one in labels})


@lru_cache(maxsize=8)
def movable(folder: str, files: tuple, label: str, configuration: str) -> tuple[Movable, ...]:
    """Return the coefficients and numbers of a vehicle in a configuration that a structure estimates, then the mass, at the best values.

    The ± is that of the posterior, with all errors, if that is current.
    """
    known = _known(folder, files)
    campaign, posterior, mode = known.campaign, known.posterior(label), known.modes[label]
    sds = dict(zip(mode.names, map(float, mode.sd), strict=True))
    stored = next(kept for one, kept in stored_estimates(campaign, known.trials).items() if one.label == label)
    if stored.state() == "current":
        estimate = stored.read()
        sds |= {name: estimate.sd(name) for name in estimate.names}
    model, shown = posterior.likelihood.model, []

    def add(name: str, label: str, si: str, best: float, sd: float, lower: float, upper: float) -> None:
        factor, unit = campaign.shown(name, si)
        values = (factor * value for value in (best, sd, lower, upper, best))
        shown.append(Movable(name, label, unit, factor, *values))

    of_vehicle = {DELAY, CURRENT, *(one.name for one in model.unknowns)}
    for one in posterior.present_parameters:
        base = base_name(one.name)
        is_here = one.name in (base, configuration_name(base, configuration))
        if is_here and (is_coefficient(base) or base in of_vehicle):
            best, sd, (low, high) = mode.by_name[one.name], sds[one.name], one.prior.bounds
            ends = max(float(low), best - REACH * sd), min(float(high), best + REACH * sd)
            add(one.name, one.label, one.unit, best, sd, *ends)
    mass, error = stated_mass(model), campaign.estimation.inertia_error
    if mass is not None:
        sd = 0.0 if error == "exact" else error * mass
        add(MASS, "m", "kg", mass, sd, (1 - MASS_SHARE) * mass, (1 + MASS_SHARE) * mass)
    return tuple(shown)
