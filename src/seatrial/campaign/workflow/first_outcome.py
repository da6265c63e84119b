"""What a report of the posterior mode draws: a first answer, without chains, evidences or a choice of terms."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.baselines import compare_with_baselines
from seatrial.campaign.inference.judge_predictions import N_DRAWS, held_back_curves, predictions_by
from seatrial.campaign.inference.posterior import build_parameters
from seatrial.campaign.inference.quick_estimates import FirstAnswer, best_mode
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.predictions import FittedBaselines
from seatrial.campaign.store.summary import Summary
from seatrial.campaign.workflow.loop import summarise
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding
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
        baselines: simple predictors, fitted to the same records; None if no record is held back.
        remedy: how to obtain the whole posterior, in words.

    Raises:
        NumericalError: no structure has a mode.
    """
    best = best_mode(answers)
    assert best.drawn is not None
    drawn = replace(best.drawn, values=best.drawn.values[:N_DRAWS])
    predictions = predictions_by(campaign, drawn, trials, drawn)
    estimate = _estimate(campaign, trials, best, [one.alarm for one in answers if one.alarm])
    evidence = Evidence(best.log_evidence or 0.0, 0.0, "laplace")
    outcome = Outcome(
        campaign=campaign,
        trials=trials,
        estimates=(estimate,),
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
    return replace(outcome, summary=summarise(outcome, _rows(best, estimate)))


def _estimate(campaign: Campaign, trials: Trials, best: FirstAnswer, others: Sequence[str]) -> Estimate:
    """Return the mode as an estimate without draws; `others` says which structures have no mode."""
    grave = [one for one in best.cautions if isinstance(one, Finding) and one.level == "alarm"]
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
        cautions=(*(one for one in best.cautions if one not in grave), *others),
        contains=" ".join(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in best.contains),
        causes=best.causes,
        configuration_differences=best.changes,
    )


def _rows(best: FirstAnswer, estimate: Estimate) -> tuple[StoredAverage, ...]:
    return tuple(
        StoredAverage(
            name=name,
            unit=unit,
            label=str(estimate.data.sel(parameter=name)["label"].values),
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
