"""Everything about a finished campaign that an engineer copies out, as it is stored and printed; without JAX."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from seatrial import __version__
from seatrial.campaign.store.estimates import StoredCoefficient
from seatrial.campaign.store.predictions import Fit
from seatrial.core.findings import Message
from seatrial.design.results import BestDesign
from seatrial.estimation.diagnostics.known import Known
from seatrial.estimation.posterior.configurations import ConfigurationDifference
from seatrial.estimation.prediction.baseline_comparison import Comparison
from seatrial.estimation.prediction.fit_verdict import Pooled
from seatrial.selection.verdict import StoredAverage, StructureRow


@dataclass(frozen=True)
class NextTrial:
    """The next trial.

    Attributes:
        words: the trial and its reason, or the reason for none.
        stop: whether no trial is proposed.
        best: the design that gives most information; None if the campaign designs no trial.
    """

    words: str
    stop: bool
    best: BestDesign | None


@dataclass(frozen=True)
class Summary:
    """Everything about a finished campaign that an engineer copies out, SI.

    Attributes:
        name: of the campaign.
        chosen: label of the most probable structure.
        terms: its coefficients.
        coefficients: its parameters.
        structures: candidates.
        inclusion: probability of each optional term.
        inclusion_error: its Monte Carlo standard error.
        verdicts: which terms the data support, in words.
        cautions: limits of the numbers.
        findings: cautions and alarms that have codes, and accepted ones.
        alarms: health checks that failed.
        choice_alarms: alarms about the probabilities of models and terms.
        usable: whether none of these is about the chosen structure's numbers.
        known: state of knowledge of each parameter.
        fits: how each channel of each record is predicted.
        pooled: how each channel of all held-back records together is predicted.
        baselines: comparison of the model with simple predictors on the held-back records, channel by channel.
        next_trial: the next trial.
        averaged: each parameter averaged over the structures.
        quoted: whose values to quote, by `QUOTED`.
        quote: the one value to quote of each parameter.
        configuration_differences: changes between configurations of the vehicle.
        seatrial_version: that wrote it.
    """

    name: str
    chosen: str
    terms: tuple[str, ...]
    coefficients: tuple[StoredCoefficient, ...]
    structures: tuple[StructureRow, ...]
    inclusion: Mapping[str, float]
    inclusion_error: Mapping[str, float]
    verdicts: tuple[str, ...]
    cautions: tuple[str, ...]
    findings: tuple[Message, ...]
    alarms: tuple[str, ...]
    choice_alarms: tuple[str, ...]
    usable: bool
    known: Known
    fits: tuple[Fit, ...]
    pooled: tuple[Pooled, ...]
    baselines: tuple[Comparison, ...]
    next_trial: NextTrial
    averaged: tuple[StoredAverage, ...]
    quoted: Literal["chosen", "averaged"]
    quote: tuple[StoredAverage, ...]
    configuration_differences: tuple[ConfigurationDifference, ...] = ()
    seatrial_version: str = __version__
