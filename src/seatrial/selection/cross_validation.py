"""Which structure, and which model of the error, predicts runs that were left out; results without JAX."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import computed_field

from seatrial.core.findings import Finding, Message
from seatrial.core.signals import SPEEDS
from seatrial.estimation.prediction.fit_verdict import Pooled
from seatrial.estimation.prediction.prediction_scores import DIVERGES, Score
from seatrial.selection.stack import SMALL, Gap, mixture_score, paired, simplest, stacking_weights
from seatrial.selection.structures import Structure

CLEAR = 2.0  # Standard errors beyond which a difference is one
OWN = "as stated"  # Name of the campaign's own model of the error
EXCLUDED = 0.05  # Probability below which the evidence excludes a structure
SMALL_CRPS = 0.05  # Relative difference of the CRPS below which it does not matter
MAX_RATIO = 1e3  # Relative CRPS that stands for that of a simulation without bounds
# Findings, by their codes or remedies, that another model of the error may answer.
ERROR_ADVICE = {"band-too-narrow", "drifting-noise", "add-error-model", "filter-error"}
# Chance that a run is predicted so much better by another structure, at most, from which the one that the evidence prefers is contradicted.
MAX_CHANCE = 0.01


@dataclass(frozen=True)
class LeftOutRun:
    """One run as the others predict it.

    Attributes:
        label: of the run.
        elpd: log p(y_r | y_-r), nats: of all its measurements together.
        error: its Monte Carlo standard error.
        k_hat: tail index of the weights; above 0.7 they are not to be trusted.
        refitted: whether the mode of the others had to be found.
        scores: of each channel in free simulation, by name.
    """

    label: str
    elpd: float
    error: float
    k_hat: float
    refitted: bool
    scores: dict[str, Score]


@dataclass(frozen=True)
class LeaveOneRunOut:
    """All runs, each predicted from the others.

    Attributes:
        runs: one for each.
        bands: whether the stated bands hold on all runs together, each left out in turn, by channel.
        log_evidence: of the joint posterior, by the same draws.
        status: empty if sound, else the fault in words.
    """

    runs: tuple[LeftOutRun, ...]
    bands: dict[str, Pooled]
    log_evidence: float
    status: str

    @property
    def elpd(self) -> float:
        """Sum over runs, nats; higher is better."""
        return sum(run.elpd for run in self.runs)

    @property
    def std_error(self) -> float:
        """Standard error of the sum, the runs being a sample of possible ones."""
        return float(np.sqrt(len(self.runs)) * np.std([run.elpd for run in self.runs], ddof=1))

    @property
    def k_hat(self) -> float:
        """Worst of all runs."""
        return max(run.k_hat for run in self.runs)

    def crps(self, channel: str) -> tuple[float, ...]:
        """Return the mean continuous ranked probability score of a channel in each run, SI; lower is better, inf where it diverges."""
        scores = [run.scores[channel] for run in self.runs]
        return tuple(np.inf if one.missing == DIVERGES else one.crps for one in scores)

    def mean_crps(self, channel: str) -> float:
        """Return the mean of that over runs."""
        return float(np.mean(self.crps(channel)))

    def mean_score(self, channel: str, name: str) -> float:
        """Return the mean of a score of one channel over all runs, each run by its number of samples.

        Args:
            channel: measured channel.
            name: of the score, an attribute of `Score`.
        """
        scores = [run.scores[channel] for run in self.runs]
        samples = np.array([one.samples for one in scores], float)
        return float(samples @ [getattr(one, name) for one in scores] / samples.sum())


@dataclass(frozen=True)
class Candidate:
    """One structure under one model of the error.

    Attributes:
        structure: which terms.
        error_model: name.
        lines: that make it in a campaign file; none for the campaign's own.
        left: each run as the others predict it; None if there is no result.
        parameters: value and standard deviation of each at the mode, SI.
        refused: why there is no result; empty if there is one.
    """

    structure: Structure
    error_model: str
    lines: tuple[str, ...]
    left: LeaveOneRunOut | None = None
    parameters: tuple[tuple[str, float, float], ...] = ()
    refused: str = ""

    @property
    def result(self) -> LeaveOneRunOut:
        """Each run as the others predict it, of a candidate that has a result."""
        assert self.left is not None
        return self.left

    @property
    def diverges(self) -> bool:
        """Whether its simulation of any run grows without bound."""
        return any(score.missing == DIVERGES for run in self.result.runs for score in run.scores.values())

    @computed_field
    @property
    def total(self) -> float:
        """Sum over runs, nats; higher is better."""
        return float(np.sum([run.elpd for run in self.left.runs])) if self.left else 0.0

    @property
    def name(self) -> str:
        """Structure and model of the error."""
        label = self.structure.label
        return label if self.error_model == OWN else f"{label}, {self.error_model}"


@dataclass(frozen=True)
class Member:
    """One candidate beside the others.

    Attributes:
        model: label of the structure.
        error_model: name of the model of the error.
        crps: of a free simulation of each run, divided by that of the campaign's setting, mean over channels and runs; lower is better.
        weight: in the mixture with the best predictions of left-out runs.
        delta: difference to the best in the sum of log densities, nats; 0 or less.
        std_error: of the difference, over runs.
        probability: by evidence, among the structures under the same model of the error.
    """

    model: str
    error_model: str
    crps: float
    weight: float
    delta: float
    std_error: float
    probability: float


@dataclass(frozen=True)
class Stack:
    """All candidates with a result, the best first.

    Attributes:
        members: candidates.
        chosen: place among them of the one for forecasts from now: with fewest terms within one standard error of the best (`simplest`).
        whole_run: place of the one for predictions of a whole run: the same, unless another one has a clearly smaller CRPS.
        gain: of the mixture over the best alone, nats.
        contradicts: whether the runs left out contradict the evidence (`CrossValidation.contradictions`).
    """

    members: tuple[Member, ...]
    chosen: int
    whole_run: int
    gain: float
    contradicts: bool


@dataclass(frozen=True)
class CrossValidation:
    """All candidates, each run left out in turn, or each block of time.

    Attributes:
        runs: labels of the runs or blocks that were left out.
        candidates: structures under the campaign's own model of the error first.
        cautions: remarks if the parts left out are not independent whole runs.
    """

    runs: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    cautions: tuple[Finding, ...]

    @property
    def found(self) -> list[Candidate]:
        """Candidates that have a result."""
        return [one for one in self.candidates if not one.refused]

    @property
    def own(self) -> list[Candidate]:
        """Those under the campaign's own model of the error."""
        return [one for one in self.found if one.error_model == OWN]

    @property
    def ordered(self) -> list[Candidate]:
        """Candidates that have a result, the best first."""
        return sorted(self.found, key=lambda one: -one.total)

    @computed_field
    @cached_property
    def stack(self) -> Stack | None:
        """Weights, and the chosen candidate; None if no candidate has a result."""
        ordered = self.ordered
        if not ordered:
            return None
        density = np.array([[run.elpd for run in one.result.runs] for one in ordered]).T
        crps = np.array([self.relative_crps(one) for one in ordered]).T / len(self.runs)
        weights = stacking_weights(density)
        gaps = [gap(one, ordered[0]) for one in ordered]
        members = zip(ordered, crps.sum(0), weights, gaps, strict=True)
        stated = ["" if one.error_model == OWN else one.error_model for one in ordered]
        terms = [len(one.structure.terms) for one in ordered]
        chosen = whole = simplest(density, stated, terms)
        # A model that diverges in one run predicts none, though that run alone makes the standard error as large as the difference.
        bounded = [k for k, one in enumerate(ordered) if not one.diverges] or [*range(len(ordered))]
        closest = min(bounded, key=lambda k: crps[:, k].sum())
        if chosen not in bounded or paired(crps[:, chosen], crps[:, closest]).is_clear(1.0, SMALL_CRPS):
            of_bounded = [stated[k] for k in bounded], [terms[k] for k in bounded]
            whole = bounded[simplest(-crps[:, bounded], *of_bounded, SMALL_CRPS)]
        return Stack(
            tuple(
                Member(
                    one.structure.label,
                    one.error_model,
                    float(c),
                    float(w),
                    apart.delta,
                    apart.std_error,
                    self.probability(one),
                )
                for one, c, w, apart in members
            ),
            chosen,
            whole,
            mixture_score(density, weights) - ordered[0].total,
            bool(self.contradictions),
        )

    @property
    def chosen(self) -> Candidate | None:
        """The one for forecasts from now; None if no candidate has a result."""
        return None if self.stack is None else self.ordered[self.stack.chosen]

    @property
    def whole_run(self) -> Candidate | None:
        """The one for predictions of a whole run; None if no candidate has a result."""
        return None if self.stack is None else self.ordered[self.stack.whole_run]

    def relative_crps(self, candidate: Candidate) -> tuple[float, ...]:
        """Return the CRPS of each run, over the mean of the campaign's own setting, mean over channels; large where it diverges."""
        bounded = [one for one in (self.own_best, *self.ordered) if one and not one.diverges]
        reference = (bounded or self.ordered)[0].result
        means = {name: reference.mean_crps(name) for name in reference.bands}
        scales = {name: mean if 0.0 < mean < np.inf else 1.0 for name, mean in means.items()}
        ratios = [np.divide(candidate.result.crps(name), scale) for name, scale in scales.items()]
        return tuple(map(float, np.minimum(ratios, MAX_RATIO).mean(0)))

    @property
    def findings(self) -> list[Finding]:
        """Return whether the runs left out contradict the evidence, and whether another model of the error is recommended."""
        chosen, whole, own = self.chosen, self.whole_run, self.own_best
        result = [*self.cautions, *self.contradictions[:1]]
        if chosen and whole and own and {chosen.error_model, whole.error_model} != {OWN}:
            better = whole if chosen.error_model == OWN else chosen
            beside = own if better is whole else better
            apart, closer = gap(better, own), self.closer(whole, beside)
            names = {name for name, *_ in better.parameters}
            values = {
                "error_model": better.error_model,
                "axes": tuple(axis for axis in SPEEDS if f"disturbance_{axis}" in names),
                "delta": apart.delta,
                "std_error": apart.std_error,
                "forecasts": better is chosen,
                "whole_run": "" if whole is chosen else f"{whole.structure.label} (error {whole.error_model})",
                "bounded": not beside.diverges,
                "closer": closer.delta,
                "closer_error": closer.std_error,
            }
            remedies = ("take-error-model",)
            result.append(Finding("error-model-better", "caution", (better.structure.label,), values, remedies))
        return result

    def closer(self, one: Candidate, other: Candidate) -> Gap:
        """Return how much smaller the relative CRPS of the first is."""
        return paired(*(self.relative_crps(each) for each in (other, one)), mean=True)

    @property
    def contradictions(self) -> list[Finding]:
        """Where what was left out contradicts that the structure is right which the evidence prefers, the strongest kind first.

        If it is, p_other / p_likely has the mean 1 over runs as it makes them, so that a run for which it is e^x has a chance of e^-x at
        most (Markov's inequality), however few runs there are.
        """
        likely, best = self.likely, self.own_best
        if likely is None or best is None:
            return []

        def contradiction(kind: str, other: Candidate, where: str, apart: Gap) -> Finding:
            values = {"probability": self.probability(likely), "other": other.name, "where": where, "kind": kind}
            values |= {"delta": apart.delta, "std_error": apart.std_error, "chance": float(np.exp(-apart.delta))}
            return Finding("evidence-contradicted", "alarm", (likely.name,), values)

        result = []
        if best is not likely and (apart := gap(best, likely)).is_clear(CLEAR, SMALL):
            result.append(contradiction("all", best, "", apart))
        for channel in likely.result.bands:
            other = min(self.own, key=lambda one, channel=channel: one.result.mean_crps(channel))
            if other is not likely and not likely.diverges:
                closer = paired(likely.result.crps(channel), other.result.crps(channel), mean=True)
                if closer.is_clear(CLEAR):
                    result.append(contradiction("channel", other, channel, closer))
        excluded = [one for one in self.own if self.probability(one) < EXCLUDED]
        looks = len(excluded) * len(self.runs)
        gains = [
            (run.elpd - before.elpd, one, run.label)
            for one in excluded
            for run, before in zip(one.result.runs, likely.result.runs, strict=True)
        ]
        surprising = [one for one in gains if one[0] > np.log(looks / MAX_CHANCE)]
        surprising.sort(key=lambda one: -one[0])
        return [*result, *(contradiction("run", one, label, Gap(gain, 0.0)) for gain, one, label in surprising)]

    def probability(self, candidate: Candidate) -> float:
        """Return the probability by evidence of a structure among those under the same model of the error."""
        same = [one for one in self.found if one.error_model == candidate.error_model]
        values = np.array([one.result.log_evidence for one in same])
        weights = np.exp(values - values.max())
        return float(weights[same.index(candidate)] / weights.sum())

    @property
    def likely(self) -> Candidate | None:
        """The one that the evidence prefers under the campaign's own model of the error."""
        return max(self.own, key=lambda one: one.result.log_evidence, default=None)

    @property
    def own_best(self) -> Candidate | None:
        """The one under the campaign's own model of the error that predicts runs left out best."""
        return max(self.own, key=lambda one: one.total, default=None)


def gap(one: Candidate, other: Candidate) -> Gap:
    """Return how much better the first predicts runs left out, nats."""
    return paired(*([run.elpd for run in each.result.runs] for each in (one, other)))


def advice_tried(advised: Iterable[Message], result: CrossValidation | None) -> list[Finding]:
    """Return whether runs left out confirm advice about the model of the error; nothing if none is given, or another one is recommended.

    Args:
        advised: findings about fits and predictions.
        result: current one, if there is any.
    """
    if not any(isinstance(one, Finding) and ERROR_ADVICE & {one.code, *one.remedies} for one in advised):
        return []
    if result is None or result.own_best is None:
        return [Finding("advice-not-tried", "note", (), {}, ("try-error-models",))]
    others = [one for one in result.ordered if one.error_model != OWN]
    if not others or any(one.code == "error-model-better" for one in result.findings):
        return []
    apart = gap(others[0], result.own_best)
    values = {"error_model": others[0].error_model, "delta": apart.delta, "std_error": apart.std_error}
    return [Finding("advice-tried", "note", (), values)]
