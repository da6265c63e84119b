"""Questions of the page on which values are moved by hand; answered in the thinking process, where records and programs stay warm."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

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
from seatrial.core.coefficients import is_coefficient
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.dashboard.record_views import index_of, origin_of, view_of
from seatrial.dashboard.view_models import Movable, Tweaked, TweakForm
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.prediction.tweak import tweak
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.whole import MASS, stated_mass

REACH, MASS_SHARE = 5.0, 0.3  # Standard deviations, and share of the stated mass, on either side that a slider offers
DIGITS = 6  # Significant digits of a start that is written


class _Known(NamedTuple):
    """A campaign with its records and the mode of each structure, the chosen one first."""

    campaign: Campaign
    trials: Trials
    study: Study
    modes: dict[str, Mode]


def tweak_form(folder: str, files: tuple, label: str = "") -> TweakForm:
    """Return what may be moved in a structure, the chosen one if none is named; read again when `files` changes.

    Raises:
        InputError: records that are not current, or modes that were not found yet.
    """
    known = _known(folder, files)
    records = tuple(one.label for one in (*known.trials.fit, *known.trials.predict))
    return TweakForm(tuple(known.modes), records, _movable(known, label or next(iter(known.modes)))[0])


def tweaked(
    folder: str,
    files: tuple,
    label: str,
    run: str,
    moved: tuple[tuple[str, float], ...],
    follow: bool,
    view: tuple[float, float, int] | None,
) -> Tweaked:
    """Predict a record by a structure with some values moved, as they are shown; of no `view`, two times and columns, without curves.

    Raises:
        InputError: see `tweak_form`, or a value that cannot be.
    """
    known = _known(folder, files)
    numbers, sds = _movable(known, label)
    factors = {one.name: one.factor for one in numbers}
    record = next(one for one in (*known.trials.fit, *known.trials.predict) if one.label == run)
    posterior = _posterior(known, label)
    held_back = run not in posterior.likelihood.labels
    start = initial_state(known.campaign, posterior.likelihood.model, record) if held_back else None
    values = {name: value / factors[name] for name, value in moved}
    result = tweak(posterior, known.modes[label], record, values, follow=follow, sd=sds, start=start)
    columns = {"time": record.time + origin_of(record.provenance.options, record.provenance.source)}
    parts = (result.tweaked.mean, result.residual, result.best.mean, result.measured)
    for at, name in enumerate(result.channels):
        for part, of_all in zip(("", " residual", " best", " measured"), parts, strict=True):
            columns[name + part] = of_all[:, at] * shown_unit(name)[0]

    def load(first: int, last: int) -> dict[str, np.ndarray]:
        return {name: column[first:last] for name, column in columns.items()}

    shares = zip(result.channels, result.tweaked.explained.tolist(), result.best.explained.tolist(), strict=True)
    return Tweaked(
        {} if view is None else view_of(index_of(record.time.size, load), load, *view),
        (float(columns["time"][0]), float(columns["time"][-1])),
        tuple((name, shown_unit(name)[1], *both) for name, *both in shares),
        {name: factor * result.values[name] for name, factor in factors.items()},
        tuple(best - now for best, now in zip(result.best[2:], result.tweaked[2:], strict=True)),
        result.distance,
        result.probability,
    )


def start_text(
    folder: str, files: tuple, label: str, text: str, values: tuple[tuple[str, float], ...]
) -> tuple[str, str]:
    """Return the lines by which the search begins at some values of a structure too, and the whole campaign file with them, checked.

    Raises:
        InputError: a file that cannot be edited.
    """
    known = _known(folder, files)
    factors = {one.name: one.factor for one in _movable(known, label)[0]}
    start = {name: float(f"{value / factors[name]:.{DIGITS}g}") for name, value in values if name != MASS}
    lines, edited = (with_values(one, {("estimation", "start_values"): start}, folder) for one in ("", text))
    check_text(known.campaign.folder, edited)
    return lines, edited


@lru_cache(maxsize=2)
def _known(folder: str, files: tuple) -> _Known:
    del files  # part of the key only
    flow = Workflow(load_campaign(folder))
    is_there = (
        flow.state("trials") == flow.state("candidates") == "current"
    )  # otherwise they would be made, and written
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
    return _Known(campaign, trials, Study(campaign, trials.fit), {one: modes.modes[one][0] for one in labels})


def _posterior(known: _Known, label: str):
    return known.study.posterior(next(one for one in known.campaign.structures if one.label == label))


def _movable(known: _Known, label: str) -> tuple[tuple[Movable, ...], dict[str, float]]:
    """Return the coefficients and numbers of the vehicle that a structure estimates, then the mass; and the ± of all parameters, SI.

    The ± is that of the posterior, with all errors, if that is current.
    """

    def build() -> tuple[tuple[Movable, ...], dict[str, float]]:
        campaign, posterior, mode = known.campaign, _posterior(known, label), known.modes[label]
        sds = dict(zip(mode.names, map(float, mode.sd), strict=True))
        stored = next(kept for one, kept in stored_estimates(campaign, known.trials).items() if one.label == label)
        if stored.state() == "current":
            estimate = stored.read()
            sds |= {name: estimate.sd(name) for name in estimate.names}
        model, numbers = posterior.likelihood.model, []
        of_vehicle = {DELAY, CURRENT, *(one.name for one in model.unknowns)}
        for one in posterior.present_parameters:
            if is_coefficient(one.name) or one.name in of_vehicle:
                best, reach, (low, high) = mode.by_name[one.name], REACH * sds[one.name], one.prior.bounds
                ends = max(float(low), best - reach), min(float(high), best + reach)
                numbers.append((one.name, one.label, one.unit, best, sds[one.name], *ends))
        mass, error = stated_mass(model), campaign.estimation.inertia_error
        if mass is not None:
            ends = (1 - MASS_SHARE) * mass, (1 + MASS_SHARE) * mass
            numbers.append((MASS, "m", "kg", mass, 0.0 if error == "exact" else error * mass, *ends))
        shown = []
        for name, symbol, si, *values in numbers:
            factor, unit = campaign.shown(name, si)
            shown.append(Movable(name, symbol, unit, factor, *(factor * value for value in values)))
        return tuple(shown), sds

    return known.study.once(("movable", label), build)
