"""Stack of structures and models of the error, by runs that were left out; each candidate is kept on disk when it is there.

All structures under the campaign's own model of the error first; then, for those in contention, the other models of the error that the
campaign can have (`error_models`). The mode of each is followed from that of the same structure under the campaign's own.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.error_models import ErrorModel, error_models, with_error_model
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import widest
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.coefficients import base_name
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.findings import Finding
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.prediction.posterior_by_run import MIN_RUNS
from seatrial.selection.cross_validation import CLEAR, OWN, Candidate, CrossValidation, gap
from seatrial.selection.leave_one_run_out import leave_one_run_out
from seatrial.selection.stack import SMALL
from seatrial.selection.structures import Structure

MOST = 3  # Structures at most for which other models of the error are tried
STATED = ErrorModel(OWN)


def stored_cross_validation(campaign: Campaign, trials: HasKey) -> StoredResult[CrossValidation]:
    """Return where the result is kept, as far as it is there, and what it depends on."""
    keys = {one.label: estimate_key(campaign, one, trials) for one in campaign.structures}
    path, key = Store(campaign.folder).cross_validation, key_of("runs left out", keys)
    return StoredResult(path, key, CrossValidation, f"seatrial crossvalidate {campaign.folder}")


def cross_validate(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> CrossValidation:
    """Leave each fitted run out in turn, or blocks of fewer than three, by each candidate; current results are read.

    Args:
        campaign: configuration.
        trials: records, of which the fitted ones are used.
        reporter: receives the progress.

    Raises:
        InputError: too few measurements.
    """
    kept = stored_cross_validation(campaign, trials)
    result = list(kept.read().candidates) if kept.is_current() else []
    # The largest first: the modes of the others are looked for near its own.
    largest = sorted(campaign.structures, key=lambda one: -len(one.terms))
    work = [(structure, STATED) for structure in largest]
    study = Study(campaign, trials.fit)
    cautions = _cautions(trials)

    def made(candidates: Sequence[Candidate]) -> CrossValidation:
        labels = next((tuple(run.label for run in one.left.runs) for one in candidates if one.left), ())
        return CrossValidation(labels, tuple(candidates), cautions)

    def keep(candidates: Sequence[Candidate]) -> None:
        kept.write(made(candidates))

    _compute(study, work, result, keep, reporter)
    contending = _contending(campaign.structures, result)
    for error in _others(study, contending, result):
        changed = Study(_changed(campaign, contending, error), trials.fit)
        first, *rest = [(structure, error) for structure in contending]
        _compute(changed, [first], result, keep, reporter)
        one = next(one for one in reversed(result) if one.error_model == error.name)
        stated = next(other for other in result if (other.structure, other.error_model) == (one.structure, OWN))
        # One that is clearly worse where it is tried first, or cannot be had there, is not tried for the others.
        if not (one.refused or gap(stated, one).is_clear(CLEAR, SMALL)):
            _compute(changed, rest, result, keep, reporter)
    return made(result)


def best_campaign(campaign: Campaign, trials: Trials, found: CrossValidation) -> Campaign:
    """Return the campaign with the one structure, and the model of the error, that are recommended.

    Args:
        campaign: that was cross-validated.
        trials: by which it was.
        found: result of `cross_validate`.

    Raises:
        NumericalError: no candidate has a result.
    """
    best = found.chosen
    if best is None:
        raise NumericalError("; ".join(one.refused for one in found.candidates))
    contending = _contending(campaign.structures, found.candidates)
    others = _others(Study(campaign, trials.fit), contending, found.candidates)
    error = next(one for one in (STATED, *others) if one.name == best.error_model)
    return _changed(campaign, [one for one in contending if one.label == best.structure.label], error)


def current_cross_validation(campaign: Campaign, trials: HasKey) -> CrossValidation | None:
    """Return the result if it has been made and is current; nothing is computed."""
    kept = stored_cross_validation(campaign, trials)
    return kept.read() if kept.is_current() else None


def _cautions(trials: Trials) -> tuple[Finding, ...]:
    pieces = tuple(record.label for record in trials.fit if "piece" in record.provenance.options)
    cautions = [Finding("runs-in-pieces", "caution", pieces)] if pieces else []
    if (runs := len(trials.fit)) < MIN_RUNS:
        cautions.append(
            Finding("blocks-left-out", "caution", (), {"runs": runs, "needed": MIN_RUNS}, ("fit-more-runs",))
        )
    return tuple(cautions)


def _compute(
    study: Study,
    work: Sequence[tuple[Structure, ErrorModel]],
    found: list[Candidate],
    keep: Callable[[Sequence[Candidate]], None],
    reporter: Reporter,
) -> None:
    """Compute what is missing, and keep all that is there after each."""
    there = {(one.structure.label, one.error_model) for one in found}
    missing = [(structure, error) for structure, error in work if (structure.label, error.name) not in there]
    for place, (structure, error) in enumerate(missing, 1):
        title = f"leave one run out, {error.name}, structure {place} of {len(missing)}: {structure.label}"
        near = _nearest(structure, found)
        found.append(_candidate(study, structure, error, near, reporter.progress(title)))
        keep(found)


def _nearest(structure: Structure, found: Sequence[Candidate]) -> Sequence[tuple[str, float, float]]:
    """Return the parameters of the same structure as it was fitted first, else of the largest one; none if nothing was."""
    by_size = sorted((one for one in found if not one.refused), key=lambda one: -len(one.structure.terms))
    same = [one for one in found if not one.refused and one.structure.label == structure.label]
    return next((one.parameters for one in (*same, *by_size)), ())


def _candidate(
    study: Study,
    structure: Structure,
    error: ErrorModel,
    near: Sequence[tuple[str, float, float]],
    progress: Progress,
) -> Candidate:
    campaign = study.campaign
    named = Candidate(structure, error.name, tuple(error.lines()) if error.estimation else ())
    try:
        posterior = study.posterior(structure)
        noise = posterior.likelihood.output.noise_parameters if near else ()
        told = {name: value for name, value, _ in near if name in posterior.names and name not in noise}
        options = {"tries": 1, "near": told} if near else {}
        mode = find_mode(posterior, key=random_key(campaign.seed, f"mode {structure.terms}"), **options, rough=True)
        leave_key = random_key(campaign.seed, f"leave out {structure.terms}")
        left = leave_one_run_out(posterior, key=leave_key, mode=mode, progress=progress)
    except NumericalError as failure:
        return replace(named, refused=str(failure))
    except InputError as failure:
        if error is STATED:
            raise
        return replace(named, refused=failure.sentence(with_remedy=False))
    own = mode.only(posterior.places)
    return replace(
        named,
        left=left,
        parameters=tuple(
            (n, float(value), float(sd)) for n, value, sd in zip(own.names, own.values, own.sd, strict=True)
        ),
    )


def _changed(campaign: Campaign, structures: Sequence[Structure], error: ErrorModel) -> Campaign:
    """Return the campaign with a model of the error and no other structures, which then share all that is compiled."""
    return replace(with_error_model(campaign, widest(structures), error), shortlist=tuple(structures))


def _contending(structures: Sequence[Structure], found: Sequence[Candidate]) -> list[Structure]:
    """Return the structures for which other models of the error are tried: the best by score and by evidence, and what is not apart."""
    own = [one for one in found if one.error_model == OWN and not one.refused]
    if not own:
        return []
    best = max(own, key=lambda one: one.total)
    likely = max(own, key=lambda one: one.result.log_evidence)
    close = [one for one in own if not gap(best, one).is_clear(CLEAR, SMALL)]
    labels = list(
        dict.fromkeys(one.structure.label for one in (best, likely, *sorted(close, key=lambda one: -one.total)))
    )
    by_label = {one.label: one for one in structures}
    return [by_label[label] for label in labels[:MOST]]


def _others(study: Study, structures: Sequence[Structure], found: Sequence[Candidate]) -> list[ErrorModel]:
    """Return the other models of the error, by the coefficients of the first structure that has each."""
    if not structures:
        return []
    by_label = {
        one.structure.label: {name: value for name, value, _ in one.parameters}
        for one in found
        if one.error_model == OWN
    }
    values = {}
    for structure in reversed(structures):
        values |= {
            name: value for name, value in by_label[structure.label].items() if base_name(name) in structure.terms
        }
    return error_models(study.campaign, widest(structures), study.records, values)
