"""First answers, before any chain: the posterior mode, or a regression of accelerations, of every candidate structure.

Neither samples: they take seconds on a short log, and up to minutes on a long one or with many structures. The mode's standard deviations
are those of a normal posterior (Laplace); the regression needs no simulation and no prior, and is drawn aside by noise in the speed:
`seatrial.estimation.regression.equation_error` says by how much.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, count
from math import inf

import jax
import numpy as np

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key, prior_curves
from seatrial.campaign.inference.identifiability import symmetry_of
from seatrial.campaign.inference.judge_predictions import (
    N_DRAWS,
    HeldBack,
    held_back_lines,
    predict_held_back,
    predictions_of,
)
from seatrial.campaign.inference.model_error import (
    causes_of,
    contradictions,
    describes_nothing,
    findings_of,
    left_out,
    stated_errors,
)
from seatrial.campaign.inference.modes import check_prior_of, long_steps, structure_modes
from seatrial.campaign.inference.posterior import is_whole
from seatrial.campaign.store.estimates import StoredMode
from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.coefficients import configuration_name
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.findings import Finding, Message
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter, run_side_by_side
from seatrial.estimation.diagnostics.error_budget import error_budget
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.estimation.diagnostics.prior_checks import prior_contradictions
from seatrial.estimation.posterior.configurations import ConfigurationDifference
from seatrial.estimation.posterior.mode import Mode, draw_about
from seatrial.estimation.posterior.posterior import Posterior, values_of
from seatrial.estimation.regression.equation_error import (
    Accelerations,
    fit_equation_error,
    measured_accelerations,
    smoothed_accelerations,
)
from seatrial.estimation.simulation.sensor_errors import noise_kinds, noise_name
from seatrial.messages.effects import contents_text, shares_text
from seatrial.messages.render import sentence
from seatrial.messages.values import change_text, value_lines
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel

WINDOW = 2.0  # Width of the window that smooths speeds where no acceleration is measured and none is given, s
BRIDGED = 0.25  # Distance from the nearest measured speed, in windows, up to which a smoothed one is used
DESIGNED_FROM = 800  # Draws about a mode from which the next trial is designed: half choose, half judge the limits
# Structures, the most probable, whose standard deviations hold more than the noise at first sight; those of more would
# take longer than the modes.
MOST_BUDGETS = 8
MODE = "first answers: the posterior mode, with a normal ± that is not checked; for checked intervals: `seatrial estimate` without --by"
REGRESSION = (
    "first answers: a regression of accelerations without priors (plain: on measured speeds; refined: on simulated speeds); "
    "for checked intervals: `seatrial estimate` without --by"
)


@dataclass(frozen=True)
class FirstAnswer:
    """What one structure's coefficients are at first sight.

    Attributes:
        structure: which terms.
        rows: name, SI unit, and pairs of value and standard deviation, as many as `heads`.
        heads: what the pairs are.
        note: what belongs to all of them, in a few words.
        alarm: why there is no answer; empty if there is one.
        cautions: what is wrong with it.
        held_back: how it predicts what was not fitted; None where nothing is predicted.
        log_evidence: of the structure, by Laplace; None where there is none.
        log_prior: of the structure, but for a constant.
        shares: what each standard deviation is made of, by name; none where it is the noise alone.
        causes: what adds most to those that are not mostly noise, in words.
        contains: what the standard deviations contain, and how to reduce what adds most.
        drawn: draws about the mode, of which the next trial is designed; None if there is no mode.
        symmetry: sentences that name sides of the vehicle without a difference in the data.
        shown: factor from SI to the unit of the table, and that unit, by name; SI of others.
        changes: differences between configurations of the vehicle; none if no errors are weighed.
    """

    structure: Structure
    rows: tuple[tuple[str, str, tuple[tuple[float, float], ...]], ...] = ()
    heads: tuple[str, ...] = ()
    note: str = ""
    alarm: str = ""
    cautions: tuple[Message, ...] = ()
    held_back: HeldBack | None = None
    log_evidence: float | None = None
    log_prior: float = 0.0
    shares: Mapping[str, ErrorShares] = field(default_factory=dict)
    causes: Mapping[str, str] = field(default_factory=dict)
    contains: tuple[str, ...] = ()
    drawn: "NormalPosterior | None" = None
    symmetry: tuple[str, ...] = ()
    shown: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    changes: tuple[ConfigurationDifference, ...] = ()

    @property
    def log_weight(self) -> float:
        """Log of prior times evidence of the structure, nats, but for a constant; -inf where there is no evidence."""
        return -inf if self.log_evidence is None else self.log_evidence + self.log_prior

    @property
    def state(self) -> str:
        """Whether it can be used, in a few words; alarms and cautions have their reasons elsewhere."""
        if self.alarm:
            return "no answer, see below"
        return "caution, see below" if self.cautions else "no caution"

    def lines(self) -> list[str]:
        """A table of the answer."""
        if self.alarm:
            return [f"{self.structure.label}  no answer"]
        head = "".join(f"{text:>24}" for text in self.heads) if len(self.heads) > 1 else ""
        messages = [f"{self.structure.label}  {self.note}", *([f"  {'':<16}{head}"] if head else [])]
        texts = {}
        for name, unit, pairs in self.rows:
            factor, shown = self.shown.get(name, (1.0, unit))
            numbers = " ".join(f"{factor * value:>12.5g} ± {factor * sd:<8.3g}" for value, sd in pairs)
            made_of = shares_text(self.shares[name], self.causes.get(name, "")) if name in self.shares else ""
            texts[name] = f"{numbers} {shown:<10} {made_of}".rstrip()
        messages += [f"  {text}" for text in (*value_lines(texts, self.structure.terms), *self.contains)]
        lines = [change_text(one, self.shown[configuration_name(one.name, one.second)]) for one in self.changes]
        lines += held_back_lines(self.held_back) if self.held_back else []
        return [*messages, *(f"  {line}" for line in (*lines, *self.symmetry))]


@dataclass(frozen=True, eq=False)
class NormalPosterior:
    """Draws of the normal approximation about a mode, bounded as the priors are."""

    structure: Structure
    names: tuple[str, ...]
    values: np.ndarray

    def draws(self, names: Sequence[str] | None = None) -> np.ndarray:
        """See `Drawn`."""
        return self.values[:, [self.names.index(name) for name in (self.names if names is None else names)]]


def posterior_modes(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> list[FirstAnswer]:
    """Posterior mode of every structure, with the standard deviations that its curvature gives.

    Raises:
        InputError: a prior against whose bound the data push.
    """
    study = Study(campaign, trials.fit)
    known = structure_modes(study, trials, reporter)
    modes = {one: known.highest(one) for one in campaign.structures}
    there = {one: mode.log_evidence + campaign.log_prior(one) for one, mode in modes.items() if isinstance(mode, Mode)}
    probable = sorted(there, key=lambda one: -there[one])[:MOST_BUDGETS]
    progress, ended = reporter.progress("errors of the models"), count(1)
    progress(0, len(campaign.structures))

    def answer(structure: Structure) -> FirstAnswer:
        made = _answer(study, structure, trials, modes[structure], structure in probable)
        progress(next(ended), len(campaign.structures))
        return made

    return run_side_by_side([partial(answer, one) for one in campaign.structures])


def best_mode(found: Sequence[FirstAnswer]) -> FirstAnswer:
    """Return the mode of the most probable structure, by Laplace.

    Raises:
        NumericalError: no structure has a mode.
    """
    best = max(found, key=lambda one: one.log_weight)
    if best.log_evidence is None:
        raise NumericalError("; ".join(one.alarm for one in found))
    return best


def keep_mode(campaign: Campaign, trials: Trials, best: FirstAnswer) -> None:
    """Keep the mode of the most probable structure for a later campaign (`priors_from`) or a page, and how it predicts held-back runs."""
    assert best.drawn is not None
    by_name = {name: pair for name, _, (pair,) in best.rows}
    matrix = np.corrcoef(best.drawn.draws(tuple(by_name)).T)
    pairs = [(a, b, float(matrix[i, j])) for (i, a), (j, b) in combinations(enumerate(by_name), 2)]
    units = {name: unit for name, unit, _ in best.rows}
    key = key_of("mode", estimate_key(campaign, best.structure, trials))
    kept = StoredResult(Store(campaign.folder).mode, key, StoredMode)
    kept.write(StoredMode(best.structure.terms, by_name, tuple(pairs), units, dict(best.causes)))
    if best.held_back is not None and trials.predict:
        held_back, channels, records = best.held_back, campaign.channels, trials.predict
        predictions = StoredResult(Store(campaign.folder).mode_predictions, key_of("held back", key), Predictions)
        predictions.read_or_make(lambda: predictions_of(channels, best.structure, records, records, held_back))


def regressions(campaign: Campaign, trials: Trials, window: float | None = None) -> list[FirstAnswer]:
    """Regression of the accelerations of every structure, plain and refined.

    Args:
        campaign: configuration.
        trials: records.
        window: smooth speeds over so many seconds; None for accelerations as measured, or `WINDOW` where none are.

    Raises:
        InputError: a model that is not linear in its coefficients, an uneven step, too few samples, or coefficients that differ between
            configurations.
    """
    if differing := campaign.by_configuration(campaign.model(campaign.full)):
        raise InputError(
            campaign.where("estimation.by_configuration"),
            found=f"{', '.join(differing)}, which a regression of accelerations takes as common to all records",
            expected="coefficients that all configurations share",
            remedy="use `seatrial estimate --by mode`, or set by_configuration = []",
        )
    measured = window is None and "udot" in campaign.channels
    width = WINDOW if window is None else window
    return [_regression(campaign, structure, trials, None if measured else width) for structure in campaign.structures]


def _answer(
    study: Study, structure: Structure, trials: Trials, whole: Mode | NumericalError, is_probable: bool
) -> FirstAnswer:
    """Return the answer of one structure, of its mode with what is absent; all errors are weighed if it is probable."""
    campaign, posterior = study.campaign, study.posterior(structure)
    if isinstance(whole, NumericalError):
        return FirstAnswer(structure, alarm=f"{structure.label}: {whole}")
    stated = stated_errors(campaign.estimation)
    budget = error_budget(posterior, whole, stated) if is_probable else None
    more = draw_about_mode(campaign.seed, structure, posterior, whole, max(N_DRAWS, DESIGNED_FROM))
    drawn = replace(more, values=more.values[:N_DRAWS])
    mode = whole.only(posterior.places)
    if is_whole(structure, campaign.structures):
        check_prior_of(study, posterior, mode)
    within = dict(zip(mode.names, map(float, mode.sd), strict=True))
    sds = {name: budget.sd(name, sd) for name, sd in within.items()} if budget else within
    rows = tuple(
        (parameter.name, parameter.unit, ((float(value), sds[parameter.name]),))
        for parameter, value in zip(posterior.present_parameters, mode.values, strict=True)
    )
    flat = "in one direction the posterior is flat, so its ± is that of the prior"
    missing = left_out(posterior, structure, budget) if budget else ()
    cautions = (
        [flat] * mode.flat
        + [*mode.at_bounds]
        + prior_contradictions(posterior, mode)
        + (long_steps(posterior, whole, study.records) if budget else [])
        + [*missing]
        + ([*contradictions(budget, stated), *describes_nothing(budget)] if budget else [])
    )
    note = f"log evidence by Laplace {mode.log_evidence:.2f}  {' '.join(structure.terms)}"
    held_back = predict_held_back(campaign, drawn, trials)
    only_noise = "± contains noise only, because other structures are more probable"
    return FirstAnswer(
        structure,
        rows,
        ("mode",),
        note,
        cautions=_of_structure(structure, cautions),
        held_back=held_back,
        log_evidence=float(mode.log_evidence),
        log_prior=campaign.log_prior(structure),
        shares={name: budget.shares_of(name) for name in mode.names} if budget else {},
        causes=causes_of(budget, within) if budget else {},
        contains=(contents_text(budget, stated), *map(sentence, findings_of(posterior, budget)))
        if budget
        else (only_noise,),
        drawn=more,
        symmetry=symmetry_of(campaign.vehicle, more, lambda: prior_curves(posterior)),
        shown={name: campaign.shown(name, unit) for name, unit, _ in rows},
        changes=budget.changes(mode.by_name, within) if budget else (),
    )


def draw_about_mode(
    seed: int, structure: Structure, posterior: Posterior, mode: Mode, count: int = N_DRAWS
) -> NormalPosterior:
    """Draw so often from the normal approximation about the mode of a posterior; both as they were found, before `Mode.only`."""
    key = random_key(seed, f"about the mode {structure.terms}")
    random = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    values = values_of(posterior, draw_about(posterior, mode, count, random))[:, posterior.places]
    return NormalPosterior(structure, posterior.present_names, values)


def _regression(campaign: Campaign, structure: Structure, trials: Trials, window: float | None) -> FirstAnswer:
    model = campaign.model(structure)
    pieces = [
        measured_accelerations(model, record) if window is None else _smoothed(model, record, window)
        for record in trials.fit
    ]
    try:
        result = fit_equation_error(model, pieces)
    except NumericalError as error:
        return FirstAnswer(structure, alarm=f"{structure.label}: {error}")
    units = [model.unit_of(term) for term in model.coefficients]
    columns = (result.plain, result.plain_sd, result.values, result.sd)
    source = "measured accelerations" if window is None else f"speeds smoothed by cubics over {window:g} s"
    rows = tuple(
        (name, unit, ((float(a), float(b)), (float(c), float(d))))
        for name, unit, a, b, c, d in zip(result.names, units, *columns, strict=True)
    )
    return FirstAnswer(
        structure,
        rows,
        ("plain", "refined"),
        f"{source}, residual {result.acceleration_sd:.3g} m/s^2  {' '.join(result.names)}",
        cautions=_of_structure(structure, filter(None, (result.status, ignored(campaign, structure)))),
        shown={name: campaign.shown(name, unit) for name, unit, _ in rows},
    )


def _of_structure(structure: Structure, messages: Iterable[Message]) -> tuple[Message, ...]:
    """Return messages that name the structure that they are about."""
    return tuple(
        one.among(structure=structure.label) if isinstance(one, Finding) else f"{structure.label}: {one}"
        for one in messages
    )


def _smoothed(model: VehicleModel, record: Record, window: float) -> Accelerations:
    """Smoothed accelerations; gaps in u are bridged by straight lines, and what lies far from any sample is left out."""
    speed = record.channel("u")
    there = np.isfinite(speed)
    if there.all():
        return smoothed_accelerations(model, record, window)
    at = record.time[there]
    measurement = record.measurement.copy()
    measurement[:, record.measured.index("u")] = np.interp(record.time, at, speed[there])
    result = smoothed_accelerations(model, replace(record, measurement=measurement), window)
    after = np.clip(np.searchsorted(at, record.time), 1, at.size - 1)
    away = np.minimum(np.abs(record.time - at[after - 1]), np.abs(record.time - at[after]))
    half = result.memory // 2
    kept = (away <= BRIDGED * window)[half : record.time.size - half]
    return replace(result, acceleration=np.where(kept, result.acceleration, np.nan))


def ignored(campaign: Campaign, structure: Structure) -> str:
    """Unknowns of the campaign that a regression takes as zero."""
    noise = {name for channel in campaign.channels for name in (noise_name(channel), *noise_kinds(channel))}
    names = [one.name for one, _ in campaign.other_unknowns(campaign.model(structure)) if one.name not in noise]
    return f"a regression of accelerations ignores {', '.join(names)}, which biases its values" if names else ""
