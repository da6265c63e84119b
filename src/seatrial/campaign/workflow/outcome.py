"""Everything that the loop found, as the report draws it."""

from dataclasses import dataclass
from html import escape

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.baselines import comparison_alarms
from seatrial.campaign.inference.judge_predictions import disowned, held_back_alarms
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.predictions import Fit, FittedBaselines
from seatrial.campaign.store.summary import Summary
from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding
from seatrial.design.trial_design import TrialDesign
from seatrial.estimation.diagnostics.known import Known
from seatrial.estimation.prediction.baseline_comparison import Comparison
from seatrial.estimation.prediction.fit_verdict import Pooled
from seatrial.messages.cross_validation import disagreement
from seatrial.messages.render import sentences
from seatrial.selection.contenders import Contenders
from seatrial.selection.cross_validation import CrossValidation
from seatrial.selection.screened import Screened
from seatrial.selection.verdict import DECIDED, Selection


@dataclass(frozen=True, eq=False)
class Outcome:
    """All results of the loop, for the report.

    Attributes:
        campaign: configuration.
        trials: records.
        estimates: posterior of each structure.
        selection: of the structure.
        chosen: estimate of the most probable structure.
        filter: traces of the full structure.
        fits: how well each record is predicted.
        predictions: the curves.
        pooled: how well each channel of all held-back records together is predicted.
        baselines: simple predictors, fitted to the same records; None if no record is held back.
        compared: the chosen structure and the baselines, channel by channel.
        known: precision of each parameter of the chosen structure.
        promised: expected precision of those of the full one after the best design; None without such designs.
        first: designs from the priors; None if trials were imported that nothing was designed for.
        next: designs from the posterior of the chosen structure; None if the campaign designs no trial, or none can be designed.
        screened: every structure in closed form; None if that cannot be done.
        screening_cautions: of that, or why it could not be done.
        contenders: the chosen structure beside the runner-up; None if there is one structure, or no trial is designed.
        disagreements: where structures that the data do not separate predict held-back records differently.
        summary: the machine-readable summary.
        seal: of the stored summary, which changes with all that the summary was made from; empty if it is not stored.
        undesigned: why no next trial can be designed; empty if one is, or none is wanted.
        cross_validation: how well each fitted run is predicted from the others; None if that was not asked, or is not current.
        first_answer: how to obtain the whole posterior, in words, where this is the posterior mode only; see `first_outcome`.
    """

    campaign: Campaign
    trials: Trials
    estimates: tuple[Estimate, ...]
    selection: Selection
    chosen: Estimate
    filter: Dataset
    fits: tuple[Fit, ...]
    predictions: Dataset
    pooled: tuple[Pooled, ...]
    baselines: FittedBaselines | None
    compared: tuple[Comparison, ...]
    known: Known
    promised: Known | None
    first: TrialDesign | None
    next: TrialDesign | None
    screened: Screened | None
    screening_cautions: tuple[str, ...]
    contenders: Contenders | None
    summary: Summary
    disagreements: tuple[Finding, ...] = ()
    seal: str = ""
    undesigned: str = ""
    cross_validation: CrossValidation | None = None
    first_answer: str = ""

    def __repr__(self) -> str:
        """Print the coefficients of the chosen structure, which terms the data support, and the next trial."""
        return "\n\n".join([repr(self.chosen), repr(self.selection), *self._next])

    def _repr_html_(self) -> str:
        tables = (one._repr_html_() for one in (self.chosen, self.selection))
        return "".join([*tables, *(f"<p>{escape(words)}</p>" for words in self._next)])

    @property
    def _next(self) -> list[str]:
        words = self.summary.next_trial.words
        return [f"Next: {words}"] if words else []

    @property
    def own_alarms(self) -> list[str]:
        """Why the numbers of the chosen structure are not to be used."""
        alarms = [f"{self.chosen.structure.label}: {text}" for text in self.chosen.alarms]
        return [*alarms, *self.held_back_alarms]

    @property
    def held_back_alarms(self) -> list[str]:
        """Those of them that held-back runs raise: simpler predictors are better, or the model fails there."""
        accepted = self.campaign.accepted
        failed = [one for one in held_back_alarms(self.fits, self.pooled) if one.code not in accepted]
        return [*comparison_alarms(self.compared), *sentences(failed)]

    @property
    def disowned(self) -> str:
        """Why the stated standard deviations do not hold, in the words of the caution; empty if they do."""
        return disowned(self.fits)

    @property
    def cause_findings(self) -> list[Finding]:
        """What adds most to the ±, but for the noise where a caution asks for another model of it already."""
        return [one for one in self.chosen.cause_findings if not (one.remedies == ("better-noise",) and self.disowned)]

    @property
    def other_alarms(self) -> list[str]:
        """What failed elsewhere: what the choice of the structure rests on, and chains of other structures that are in question."""
        return [*self.choice_alarms, *self._chains_of_others(in_question=True)]

    @property
    def idle_complaints(self) -> list[str]:
        """What failed in chains of structures that the data have excluded: nothing else depends on these."""
        return self._chains_of_others(in_question=False)

    @property
    def choice_alarms(self) -> list[str]:
        """Why the choice of the structure is not to be relied on: evidences, and predictions of runs that were left out."""
        left_out = "" if self.cross_validation is None else disagreement(self.cross_validation)
        return [*self.selection.alarms, *filter(None, [left_out])]

    def _chains_of_others(self, *, in_question: bool) -> list[str]:
        probability = dict(
            zip([one.label for one in self.selection.structures], self.selection.probability, strict=True)
        )
        return [
            f"{one.structure.label}: {text}"
            for one in self.estimates
            if one.structure.label != self.chosen.structure.label
            and (probability[one.structure.label] > 1 - DECIDED) == in_question
            for text in one.alarms
        ]
