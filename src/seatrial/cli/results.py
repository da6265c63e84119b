"""Results of campaigns as `--json` prints them: from what a step found to the types of `result_shapes`.

Where a result has an attribute by the name of a key, `picked` takes it; what is named or made otherwise is written out.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from seatrial.cli import result_shapes as shapes
from seatrial.core.signals import signal_unit
from seatrial.messages.render import row_of, sentence

QUANTILES = (0.05, 0.5, 0.95)


def picked(found: Any, shape: type, **others: Any) -> dict[str, Any]:
    """Return the attributes of a result that a type names, and others that are given."""
    return {key: others[key] if key in others else getattr(found, key) for key in shape.__annotations__}


def estimated(estimate: Any, held_back: Any, known_after: Any) -> dict[str, Any]:
    """Return one structure by chains."""
    return {
        "label": estimate.structure.label,
        "terms": estimate.structure.terms,
        "parameters": estimate.parameters,
        "model_error": [estimate.model_error, *map(sentence, estimate.model_error_findings)],
        "log_evidence_laplace": float(estimate.data.attrs["laplace_log_evidence"]),
        "known": known_after.parameters,
        "symmetry": known_after.symmetry,
        "held_back": held_back.fits,
    }


def first_answer(one: Any) -> dict[str, Any]:
    """Return one structure at first sight."""
    by = one.heads or ("mode",)
    values = [
        {
            "name": name,
            "unit": unit,
            "by": way,
            "value": value,
            "sd": sd,
            "model_error_sd": one.wider.get(name),
            "model_error_cause": one.wider_causes.get(name, ""),
        }
        for name, unit, pairs in one.rows
        for way, (value, sd) in zip(by, pairs, strict=False)
    ]
    answer = {
        "values": values,
        "model_error": one.wider_words,
        "log_evidence_laplace": one.log_evidence,
        "held_back": () if one.held_back is None else one.held_back.fits,
    }
    return {"label": one.structure.label, "terms": one.structure.terms, "symmetry": one.symmetry, **answer}


def selected(selection: Any) -> dict[str, Any]:
    """Return which terms the data support."""
    inclusion = [
        {"term": term, "probability": value, "error": selection.inclusion_error.get(term)}
        for term, value in selection.inclusion.items()
    ]
    chosen = selection.structures[selection.chosen].label
    return {"chosen": chosen, "structures": selection.rows, "inclusion": inclusion, "verdicts": selection.verdicts}


def criteria(found: Sequence[Any], pairs: Sequence[Any]) -> dict[str, Any]:
    """Return every criterion of every structure, and Savage-Dickey ratios."""
    rows = []
    for one in found:
        of = {"DIC": (one.deviance.dic, ""), "BPIC": (one.deviance.bpic, "")}
        of |= {name: (criterion.value, criterion.status) for name, criterion in one.predictive.items()}
        rows += [
            picked(value, shapes.Criterion, structure=one.structure.label, criterion=name, status=status)
            for name, (value, status) in of.items()
        ]
    return {"criteria": rows, "savage_dickey": pairs}


def cross_validated(found: Any) -> dict[str, Any]:
    """Return how every structure predicts runs that were left out."""
    recommended = found.recommended
    return {
        "runs": found.runs,
        "best": found.best.name,
        "recommended": None if recommended is None else recommended.name,
        "candidates": found.candidates,
    }


def design(sweep: Any, at: tuple[int, int] | None = None) -> dict[str, Any]:
    """Return a design of one family by its place on the grid; the best if none is given."""
    (row, column), family = at or sweep.best, sweep.family
    return picked(
        family,
        shapes.Design,
        family=family.kind,
        unit=signal_unit(family.control),
        amplitude=sweep.amplitude[row],
        period=sweep.period[column],
        gain_nat=sweep.gain[row, column],
        worth=sweep.worth[row, column],
    )


def designs(found: Any, promised: Any) -> dict[str, Any]:
    """Return the best design of each family, and what the best of all promises."""
    return {"designs": list(map(design, found.sweeps)), "refused": found.refused, "coefficients": promised.parameters}


def batch(found: Any) -> dict[str, Any]:
    """Return trials planned together."""
    return picked(found, shapes.Batch, trials=found.words, utility=found.found.utility)


def sensor_rows(found: Any) -> list[dict[str, Any]]:
    """Return the best design with other sensors."""
    return [
        {"sensors": words, "utility": worth.utility, "sd": dict(zip(found.names, worth.sd, strict=True))}
        for words, worth in found.rows
    ]


def plan(found: Any) -> dict[str, Any]:
    """Return the plan of a campaign."""
    stages = [picked(one, shapes.Stage, needs=[number + 1 for number in one.before]) for one in found.stages]
    trials = [picked(one, shapes.PlannedTrial, stage=one.stage + 1) for one in found.steps]
    further = dict(zip(shapes.Further.__annotations__, found.further, strict=True)) if found.further else None
    return picked(found, shapes.Plan, stages=stages, trials=trials, further=further)


def prior(found: Any) -> dict[str, Any]:
    """Return what the priors expect."""
    return {
        "over": found.over,
        "steady_speed": None if found.settled is None else _quantiles(found.settled.speed),
        "time_constant": None if found.settled is None else _quantiles(found.settled.time_constant),
        "diverging": float(found.diverged.mean()),
        "channels": [
            picked(
                one,
                shapes.ExpectedChannel,
                unit=signal_unit(one.channel),
                lowest=float(one.bands[0].min()),
                highest=float(one.bands[-1].max()),
                measured_inside=one.held,
            )
            for one in found.channels
        ],
        "priors": [
            picked(one, shapes.Believed, alone=None if one.alone is None else one.alone._asdict())
            for one in found.believed
        ],
    }


def rehearsal(found: Any) -> dict[str, Any]:
    """Return what trials a goal takes by each strategy."""
    rows = [
        {
            "name": name,
            "trials": found.trials_of(name).value,
            "trials_error": found.trials_of(name).error,
            "share_met": found.share_met(name)[0],
            "median_sd": found.median_sd(name),
        }
        for name in found.strategies
    ]
    return picked(found, shapes.Rehearsal, strategies=rows)


def records(trials: Any) -> dict[str, Any]:
    """Return the records of a campaign."""
    return {
        "records": [
            picked(record, shapes.RecordRow, held_back=held_back, samples=record.time.size, duration=record.time[-1])
            for held_back, of in ((False, trials.fit), (True, trials.predict))
            for record in of
        ]
    }


def checked(judged: Iterable[Any]) -> dict[str, Any]:
    """Return what was found about each record."""

    def row(one: Any) -> dict[str, Any]:
        findings = list(map(row_of, one.findings))
        return picked(one, shapes.Checked, label=one.record.label, findings=findings)

    return {"records": list(map(row, judged))}


def tuning(found: Iterable[Any]) -> dict[str, Any]:
    """Return how a filter is tuned along each record."""

    def row(one: Any) -> dict[str, Any]:
        changes = list(map(row_of, one.report.findings))
        return picked(one.report, shapes.Tuned, record=one.record.label, changes=changes)

    return {"records": list(map(row, found))}


def calibration(found: Any) -> dict[str, Any]:
    """Return which quantities are not calibrated."""
    return {
        "structure": found.structure,
        "method": found.method,
        "replicates": found.ranks.shape[0],
        "outside": found.outside(),
        "p_values": dict(zip(found.names, found.p_values(), strict=True)),
    }


def next_trial(designs: Any, proposal: Any) -> dict[str, Any]:
    """Return the trial to run next, or none, and why."""
    trial = proposal.trial
    if trial is None:
        return {"trial": None, "advice": proposal.words}
    sweep = next(one for one in designs.sweeps if one.family.kind == trial.kind)
    at = abs(sweep.amplitude - trial.amplitude).argmin(), abs(sweep.period - trial.period).argmin()
    return {"trial": design(sweep, (int(at[0]), int(at[1]))), "advice": proposal.words}


def compared_rows(compared: Sequence[Any]) -> list[Any]:
    """Return comparisons with baselines and their sentences."""
    from seatrial.cli.result_schema import ComparisonRow

    return [ComparisonRow(**vars(one)) for one in compared]


def run(outcome: Any, proposal: Any) -> dict[str, Any]:
    """Return what the whole loop found."""
    chosen = outcome.chosen
    return {
        "chosen": chosen.structure.label,
        "terms": chosen.structure.terms,
        "parameters": chosen.parameters,
        "averaged": outcome.summary.averaged,
        "quoted": outcome.selection.quoted,
        **{key: value for key, value in selected(outcome.selection).items() if key != "chosen"},
        "fits": outcome.fits,
        "baselines": compared_rows(outcome.compared),
        "next": next_trial(outcome.next, proposal),
    }


def log(found: Any, guessed: str) -> dict[str, Any]:
    """Return what a log holds, and its guessed map as TOML."""

    tables = [
        {"name": one.info.name, "rows": one.rows, "clocks": one.clocks, "columns": one.columns} for one in found.tables
    ]
    return {"kind": found.kind, "tables": tables, "guesses": found.guesses, "map": guessed}


def vehicle(name: str, found: Any) -> dict[str, Any]:
    """Return a published vehicle."""
    from seatrial.core.coefficients import CoefficientName

    model = found.build()
    values = {**found.coefficients, **found.hull.fixed}
    rows = [
        {"name": term, "unit": model.unit_of(CoefficientName.parse(term)), "value": value}
        for term, value in values.items()
    ]
    hull = found.hull
    return picked(found, shapes.VehiclePage, name=name, title=hull.name, mass=hull.mass, coefficients=rows)


def exported(statement: Any) -> dict[str, Any]:
    """Return what a target keeps of a vehicle."""
    from seatrial.core.coefficients import CoefficientName

    loss = [{"velocity": one.rate, "unit": one.unit, "largest": one.largest} for one in statement.loss]
    result = statement.estimated

    def unit(name: str) -> str:
        return CoefficientName.parse(name).unit

    coefficients = [
        {"name": name, "unit": unit(name), "mean": mean, "sd": sd, "model_error_sd": result.model_error_sd.get(name)}
        for name, mean, sd in zip(result.names, result.mean, result.sd, strict=True)
    ]
    averaged = [picked(one, shapes.ExportedAverage, unit=unit(one.name)) for one in result.averaged]
    values = {"coefficients": coefficients, "averaged": averaged, "quoted": result.quoted}
    return {"target": statement.target, **values, "loss": loss}


def scores(result: Any) -> dict[str, Any]:
    """Return a benchmark's scores of each method on each channel."""
    rows = [
        picked(
            score,
            shapes.Scored,
            method=entry.method,
            task=task,
            unit=result.channels[score.channel],
            diverging=score.failed,
        )
        for entry in result.entries
        for task, channel_scores in entry.pooled.items()
        for score in channel_scores
    ]
    return {"set": result.set.name, "scores": rows, "not_beaten": result.beaten()}


def _quantiles(values: Any) -> list[float | None]:
    import numpy as np

    there = values[np.isfinite(values)]
    return [float(value) for value in np.quantile(there, QUANTILES)] if there.size else [None] * len(QUANTILES)
