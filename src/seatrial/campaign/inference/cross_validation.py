"""Which structure, and which model of the error, predicts runs that were left out; kept on disk one by one.

All structures under the campaign's own model of the error first; then, for those in contention, the other models of the error that the
campaign can have (`error_models`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.error_models import ErrorModel, Scale, error_models, scale_of, with_error_model
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.modes import structure_modes
from seatrial.campaign.inference.posterior import widest
from seatrial.campaign.store.estimates import HasKey
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter
from seatrial.selection.cross_validation import OWN, SMALL, Candidate, CrossValidation, gap
from seatrial.selection.leave_one_run_out import MIN_RUNS, leave_one_run_out
from seatrial.selection.structures import Structure

MOST = 3  # Structures at most for which other models of the error are tried
STATED = ErrorModel(OWN, "the campaign's own")


def stored_cross_validation(campaign: Campaign, trials: HasKey) -> StoredResult[CrossValidation]:
    """Return where the result is kept, as far as it is there, and what it depends on."""
    keys = {one.label: estimate_key(campaign, one, trials) for one in campaign.structures}
    path, key = Store(campaign.folder).cross_validation, key_of("runs left out", keys)
    return StoredResult(path, key, CrossValidation, f"seatrial crossvalidate {campaign.folder}")


def cross_validate(campaign: Campaign, trials: Trials, reporter: Reporter = SILENT) -> CrossValidation:
    """Leave each fitted run out in turn, of every structure and model of the error; current results are read.

    Args:
        campaign: configuration.
        trials: records, of which the fitted ones are used.
        reporter: told how far the work has come.

    Raises:
        InputError: fewer than three fitted runs.
    """
    if (count := len(trials.fit)) < MIN_RUNS:
        more = "run more trials and import their logs"
        more = more if campaign.imports is None else "list more of them under import.fit"
        raise InputError(
            campaign.where("import.fit"),
            found=f"{count} fitted run{'s' * (count > 1)}: {', '.join(record.label for record in trials.fit)}",
            expected=f"at least {MIN_RUNS} fitted runs, each of which can be predicted from the others",
            remedy=f"{more}; with fewer, `seatrial run` scores the runs under import.predict, which were not fitted",
        )
    kept = stored_cross_validation(campaign, trials)
    result = list(kept.read().candidates) if kept.is_current() else []
    work = [(structure, STATED) for structure in campaign.structures]
    study = Study(campaign, trials.fit)
    labels = tuple(record.label for record in trials.fit)
    cautions = tuple(_cautions(trials))

    def keep(candidates: Sequence[Candidate]) -> None:
        kept.write(CrossValidation(labels, tuple(candidates), cautions))

    _compute(study, work, result, keep, reporter)
    contending = _contending(campaign.structures, result)
    if contending:
        others = error_models(campaign, widest(contending), _scale(study, contending, result))
        for error in others:
            changed = Study(_changed(campaign, contending, error), trials.fit)
            first, *rest = [(structure, error) for structure in contending]
            _compute(changed, [first], result, keep, reporter)
            one = next(one for one in reversed(result) if one.error_model == error.name)
            stated = next(other for other in result if (other.structure, other.error_model) == (one.structure, OWN))
            # One that is clearly worse where it is tried first, or cannot be had there, is not tried for the others.
            if not (one.refused or gap(stated, one).is_clear(SMALL)):
                _compute(changed, rest, result, keep, reporter)
    return CrossValidation(labels, tuple(result), cautions)


def best_campaign(campaign: Campaign, trials: Trials, found: CrossValidation) -> Campaign:
    """Return the campaign with the one structure, and the model of the error, that predict runs left out best.

    Another model of the error than the campaign's own is taken only where it is clearly better.

    Args:
        campaign: that was cross-validated.
        trials: by which it was.
        found: result of `cross_validate`.

    Raises:
        NumericalError: no candidate has a result.
    """
    if not found.own:
        raise NumericalError("; ".join(one.refused for one in found.candidates))
    best = found.recommended or found.own_best
    study, contending = Study(campaign, trials.fit), _contending(campaign.structures, found.candidates)
    others = error_models(campaign, widest(contending), _scale(study, contending, found.candidates))
    error = next(one for one in (STATED, *others) if one.name == best.error_model)
    return _changed(campaign, [one for one in contending if one.label == best.structure.label], error)


def current_cross_validation(campaign: Campaign, trials: HasKey) -> CrossValidation | None:
    """Return the result if it has been made and is current; nothing is computed."""
    kept = stored_cross_validation(campaign, trials)
    return kept.read() if kept.is_current() else None


def _cautions(trials: Trials) -> list[str]:
    pieces = [record.label for record in trials.fit if "piece" in record.provenance.options]
    return (
        [f"{', '.join(pieces)} are pieces of the same long runs, so that each piece knows what the others share"]
        if pieces
        else []
    )


def _compute(
    study: Study, work: Sequence[tuple[Structure, ErrorModel]], found: list[Candidate], keep: Any, reporter: Reporter
) -> None:
    """Compute what is missing, and keep all that is there after each."""
    there = {(one.structure.label, one.error_model) for one in found}
    missing = [(structure, error) for structure, error in work if (structure.label, error.name) not in there]
    for place, (structure, error) in enumerate(missing, 1):
        title = f"leave one run out, {error.name}, structure {place} of {len(missing)}: {structure.label}"
        found.append(_candidate(study, structure, error, reporter.progress(title)))
        keep(found)


def _candidate(study: Study, structure: Structure, error: ErrorModel, progress: Progress) -> Candidate:
    campaign = study.campaign
    named = Candidate(structure, error.name, error.words, tuple(error.lines()) if error.estimation else ())
    try:
        posterior = study.posterior(structure)
        mode = study.once("modes", lambda: structure_modes(study))[structure]
        if isinstance(mode, NumericalError):
            raise mode
        leave_key = random_key(campaign.seed, f"leave out {structure.terms}")
        left = leave_one_run_out(posterior, leave_key, mode, progress=progress)
    except NumericalError as failure:
        return replace(named, refused=str(failure))
    except InputError as failure:
        if error is STATED:
            raise
        return replace(named, refused=failure.sentence(with_remedy=False))
    own = mode.only(posterior.places)
    coefficients = [one for one in zip(own.names, own.values, own.sd, strict=True) if one[0] in structure.terms]
    return replace(
        named,
        left=left,
        coefficients=tuple((name, float(value), float(sd)) for name, value, sd in coefficients),
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
    close = [one for one in own if not gap(best, one).is_clear(SMALL)]
    labels = list(
        dict.fromkeys(one.structure.label for one in (best, likely, *sorted(close, key=lambda one: -one.total)))
    )
    by_label = {one.label: one for one in structures}
    return [by_label[label] for label in labels[:MOST]]


def _scale(study: Study, structures: Sequence[Structure], found: Sequence[Candidate]) -> Scale:
    """Return how large things are, each coefficient as the first structure has it that has it at all."""
    labels = [one.label for one in structures]
    own = [one for one in found if one.error_model == OWN and one.structure.label in labels]
    coefficients = {}
    for one in sorted(own, key=lambda one: labels.index(one.structure.label)):
        coefficients = {name: (value, sd) for name, value, sd in one.coefficients} | coefficients
    model = study.campaign.model(widest(structures))
    return scale_of(model, study.records, coefficients, {name: value for name, (value, _) in coefficients.items()})
