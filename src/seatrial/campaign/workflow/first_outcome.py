"""What a report of the posterior mode draws: a first answer, without chains, evidences or a choice of terms."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.check import record_doubts
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.baselines import compare_with_baselines, comparison_cautions
from seatrial.campaign.inference.judge_predictions import (
    N_DRAWS,
    fit_complaints,
    held_back_alarms,
    held_back_cautions,
    held_back_curves,
    predictions_by,
)
from seatrial.campaign.inference.posterior import build_parameters
from seatrial.campaign.inference.quick_estimates import FirstAnswer, best_mode
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.predictions import FittedBaselines
from seatrial.campaign.store.summary import NextTrial, Summary
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding, Message, accept
from seatrial.core.normal import Z95
from seatrial.estimation.diagnostics.known import ErrorShares, Known
from seatrial.messages.render import sentences
from seatrial.selection.verdict import Evidence, Selection, StoredAverage


def first_outcome(
    campaign: Campaign,
    trials: Trials,
    answers: Sequence[FirstAnswer],
    baselines: FittedBaselines | None,
    remedy: str,
) -> Outcome:
    """Return the most probable structure at its posterior mode, with its predictions of every record.

    Args:
        campaign: with its candidates.
        trials: records.
        answers: of `posterior_modes`.
        baselines: simple predictors, fitted to the same records; None where no record is held back.
        remedy: how to obtain the whole posterior, in words.

    Raises:
        NumericalError: no structure has a mode.
    """
    best = best_mode(answers)
    assert best.drawn is not None
    drawn = replace(best.drawn, values=best.drawn.values[:N_DRAWS])
    predictions = predictions_by(campaign, drawn, trials, drawn)
    grave = [one for one in best.cautions if isinstance(one, Finding) and one.level == "alarm"]
    evidence = Evidence(best.log_evidence or 0.0, 0.0, "laplace")
    outcome = Outcome(
        campaign=campaign,
        trials=trials,
        estimates=(estimate := _estimate(campaign, trials, best, grave),),
        selection=Selection((best.structure,), (evidence,), np.ones(1), np.zeros(1), {}, {}, 0, (), ()),
        chosen=estimate,
        filter=Dataset({}),
        fits=predictions.fits,
        predictions=Dataset(predictions.data.variables, {"channel": list(predictions.channels)}),
        pooled=predictions.pooled,
        baselines=baselines,
        compared=compare_with_baselines(baselines, held_back_curves(predictions)),
        known=Known("after", best.structure.label, (), (), ()),
        promised=None,
        first=None,
        next=None,
        screened=None,
        screening_cautions=(),
        contenders=None,
        summary=cast(Summary, None),  # made below, of all the rest
        first_answer=remedy,
    )
    cautions = [one for one in best.cautions if one not in grave]
    return replace(outcome, summary=_summary(outcome, best, [*cautions, *(one.alarm for one in answers if one.alarm)]))


def _estimate(campaign: Campaign, trials: Trials, best: FirstAnswer, grave: Sequence[Finding]) -> Estimate:
    labels = {one.name: one.label for one in build_parameters(campaign, campaign.model(best.structure), trials.fit)}
    names, units, pairs = zip(*best.rows, strict=True)
    mean, sd = (("parameter", np.array(column)) for column in zip(*(pair for (pair,) in pairs), strict=True))
    coords = {
        "parameter": list(names),
        "unit": ("parameter", list(units)),
        "label": ("parameter", [labels[name] for name in names]),
    }
    return Estimate(
        best.structure,
        Dataset({"mean": mean, "sd": sd}, coords=coords),
        alarms=tuple(sentences(grave)),
        contains=" ".join(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in best.contains),
        causes=best.causes,
    )


def _summary(outcome: Outcome, best: FirstAnswer, own: Sequence[Message]) -> Summary:
    campaign, fits, pooled = outcome.campaign, outcome.fits, outcome.pooled
    cautions: list[Message] = [*fit_complaints(fits, pooled), *comparison_cautions(outcome.compared), *own]
    cautions += [
        text for one in (*outcome.trials.fit, *outcome.trials.predict) for text in record_doubts(campaign, one)
    ]
    cautions += held_back_cautions(campaign.imports, outcome.trials)
    failed = [*held_back_alarms(fits, pooled), *(one for one in cautions if isinstance(one, Finding))]
    left = [one for one in cautions if not (isinstance(one, Finding) and one.code in campaign.accepted)]
    rows = tuple(
        StoredAverage(
            name=name,
            unit=unit,
            label=str(outcome.chosen.data.sel(parameter=name)["label"].values),
            mean=mean,
            sd=sd,
            lower_95=mean - Z95 * sd,
            upper_95=mean + Z95 * sd,
            cause=best.causes.get(name, ""),
            inclusion=1.0,
            shares=best.shares.get(name, ErrorShares()),
        )
        for name, unit, ((mean, sd),) in best.rows
    )
    return Summary(
        name=campaign.name,
        chosen=best.structure.label,
        terms=best.structure.terms,
        coefficients=(),
        structures=outcome.selection.rows,
        inclusion={},
        inclusion_error={},
        verdicts=(),
        cautions=tuple(sentences(left)),
        findings=tuple(accept(failed, campaign.accepted)),
        alarms=tuple(outcome.own_alarms),
        choice_alarms=(),
        usable=not outcome.own_alarms,
        known=outcome.known,
        fits=fits,
        pooled=pooled,
        baselines=outcome.compared,
        next_trial=NextTrial("", False, None),
        averaged=(),
        quoted="chosen",
        quote=rows,
    )
