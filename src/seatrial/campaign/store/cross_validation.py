"""Stored result of `seatrial crossvalidate`: how well each structure and each model of the error predicts runs that were left out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import computed_field

from seatrial.core.result_table import aligned

# Standard errors, and nats, beyond which a difference is one: below four nats the standard error itself is unreliable
# (Sivula, Magnusson and Vehtari 2020).
CLEAR, SMALL = 2.0, 4.0
OWN = "as stated"  # Name of the campaign's own model of the error


@dataclass(frozen=True)
class ChannelScores:
    """How one channel is predicted in free simulation, each run left out in turn.

    Attributes:
        channel: measured channel.
        crps: mean continuous ranked probability score of each run, SI; lower is better.
        explained: share of the variance explained, mean over runs.
        coverage_50: share of samples inside the 50 % band.
        coverage: share of samples inside the 90 % band.
        level: verdict on the 90 % bands of all runs together.
        reason: of that verdict, one sentence.
    """

    channel: str
    crps: tuple[float, ...]
    explained: float
    coverage_50: float
    coverage: float
    level: str
    reason: str

    @property
    def mean_crps(self) -> float:
        """Mean over runs."""
        return float(np.mean(self.crps))


@dataclass(frozen=True)
class Candidate:
    """One structure under one model of the error.

    Attributes:
        structure: label.
        terms: of the structure.
        error_model: name.
        words: what the model of the error says.
        lines: that make it in a campaign file; none for the campaign's own.
        elpd: log density of each run given the others, nats.
        errors: Monte Carlo standard error of each.
        k_hat: tail index of the weights of each.
        refitted: whether the others had to be fitted anew, of each.
        log_evidence: of all runs, nats.
        channels: scores of each channel.
        coefficients: value and standard deviation of each at the mode, SI.
        status: empty if healthy.
        refused: why there is no result; empty if there is one.
    """

    structure: str
    terms: tuple[str, ...]
    error_model: str
    words: str
    lines: tuple[str, ...]
    elpd: tuple[float, ...] = ()
    errors: tuple[float, ...] = ()
    k_hat: tuple[float, ...] = ()
    refitted: tuple[bool, ...] = ()
    log_evidence: float = 0.0
    channels: tuple[ChannelScores, ...] = ()
    coefficients: tuple[tuple[str, float, float], ...] = ()
    status: str = ""
    refused: str = ""

    @computed_field
    @property
    def total(self) -> float:
        """Sum over runs, nats; higher is better."""
        return float(np.sum(self.elpd))

    @property
    def name(self) -> str:
        """Structure and model of the error."""
        return self.structure if self.error_model == OWN else f"{self.structure}, {self.error_model}"


@dataclass(frozen=True)
class Gap:
    """How much better one candidate scores than another, and its standard error from the differences of each run."""

    delta: float
    std_error: float

    def is_clear(self, least: float = 0.0) -> bool:
        """Whether it is beyond two standard errors and a least size."""
        return self.delta > max(CLEAR * self.std_error, least)


@dataclass(frozen=True)
class CrossValidation:
    """All candidates, each run left out in turn.

    Attributes:
        runs: labels.
        candidates: structures under the campaign's own model of the error first.
        cautions: what a reader must know.
    """

    runs: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    cautions: tuple[str, ...]

    @property
    def found(self) -> list[Candidate]:
        """Candidates that have a result."""
        return [one for one in self.candidates if not one.refused]

    @property
    def own(self) -> list[Candidate]:
        """Those under the campaign's own model of the error."""
        return [one for one in self.found if one.error_model == OWN]

    @computed_field
    @property
    def best(self) -> Candidate:
        """The one that predicts runs left out best."""
        return max(self.found, key=lambda one: one.total)

    @computed_field
    @property
    def recommended(self) -> Candidate | None:
        """The best where it is clearly better than the best under the campaign's own model of the error, else None."""
        stated = max(self.own, key=lambda one: one.total)
        clear = self.best.error_model != OWN and gap(self.best, stated).is_clear(SMALL)
        return self.best if clear else None

    def probability(self, candidate: Candidate) -> float:
        """Return the probability by evidence of a structure among those under the same model of the error."""
        same = [one for one in self.found if one.error_model == candidate.error_model]
        values = np.array([one.log_evidence for one in same])
        weights = np.exp(values - values.max())
        return float(weights[same.index(candidate)] / weights.sum())

    def disagreement(self) -> str:
        """Say where the structure that the evidence prefers predicts runs left out clearly worse than another; empty where not."""
        if len(self.own) < 2:
            return ""
        chosen = max(self.own, key=lambda one: one.log_evidence)
        better = max(self.own, key=lambda one: one.total)
        reasons = []
        apart = gap(better, chosen)
        if better is not chosen and apart.is_clear(SMALL):
            reasons.append(
                f"{better.name} predicts runs left out better by {apart.delta:.1f} ± {apart.std_error:.1f} nats"
            )
        for i, channel in enumerate(chosen.channels):
            other = min(self.own, key=lambda one, i=i: one.channels[i].mean_crps)
            closer = _paired(channel.crps, other.channels[i].crps, mean=True)  # SI
            if other is not chosen and closer.is_clear():
                reasons.append(
                    f"{other.name} simulates {channel.channel} of runs left out more closely: the mean CRPS of {chosen.name}, "
                    f"{channel.mean_crps:.3g}, is larger by {closer.delta:.2g} ± {closer.std_error:.2g}"
                )
        if not reasons:
            return ""
        share = self.probability(chosen)
        return (
            f"evidence and held-back score disagree: {chosen.name} ({' '.join(chosen.terms)}) has probability "
            f"{share:.3f} by its evidence, but {'; and '.join(reasons)}: do not rely on that probability"
        )

    def headline(self) -> list[str]:
        """What matters most, first."""
        likely = max(self.own, key=lambda one: one.log_evidence)
        lines = [
            self.disagreement() or self._agreement(),
            *(f"{likely.name}, each run left out in turn: {one.level}; {one.reason}" for one in likely.channels),
        ]
        if self.recommended is not None:
            stated = max(self.own, key=lambda one: one.total)
            apart = gap(self.recommended, stated)
            lines.append(
                f'error model "{self.recommended.error_model}" ({self.recommended.words}) predicts runs left out better than the '
                f"campaign's own by {apart.delta:.1f} ± {apart.std_error:.1f} nats; put into campaign.toml:"
            )
        elif len(self.found) > len(self.own):
            lines.append("no other model of the error predicts runs left out clearly better than the campaign's own")
        return lines

    def lines(self) -> list[str]:
        """The headline, then the table."""
        note = (
            "differences to the best: log predictive density of the runs left out, nats, ± the standard error over runs"
        )
        added = [] if self.recommended is None else [f"    {line}" for line in self.recommended.lines]
        return [*self.headline(), *added, note, *aligned([self.heads(), *self.rows()], left=(0, 1, -1)), *self._added()]

    @property
    def alarms(self) -> list[str]:
        """What forbids to rely on the campaign's choice."""
        disagreement = self.disagreement()
        return [disagreement] if disagreement else []

    def complaints(self) -> list[str]:
        """What is not to be trusted."""
        lines = [f"{one.name}: {one.status}" for one in self.found if one.status]
        return [*self.cautions, *lines, *(f"{one.name}: {one.refused}" for one in self.candidates if one.refused)]

    def rows(self) -> list[tuple[str, ...]]:
        """The table: structure, error model, difference, CRPS, coverages and k-hat, best first, as text."""
        ordered = sorted(self.found, key=lambda one: -one.total)
        return [
            (
                one.structure,
                one.error_model,
                "best" if one is ordered[0] else _signed(gap(one, ordered[0])),
                *(
                    text
                    for channel in one.channels
                    for text in (f"{channel.mean_crps:.3g}", f"{channel.coverage_50:.0%}", f"{channel.coverage:.0%}")
                ),
                f"{max(one.k_hat):.2f}",
                f"{self.probability(one):.3f}",
                " ".join(one.terms),
            )
            for one in ordered
        ]

    def heads(self) -> tuple[str, ...]:
        """Heads of the table."""
        names = [one.channel for one in self.found[0].channels]
        columns = [text for name in names for text in (f"CRPS {name}", f"{name} in 50 %", "in 90 %")]
        return ("model", "error model", "elpd", *columns, "k-hat", "probability", "terms")

    def _agreement(self) -> str:
        if len(self.own) < 2:
            return "one structure: evidence and held-back score have nothing to disagree about"
        chosen = max(self.own, key=lambda one: one.log_evidence)
        better = max(self.own, key=lambda one: one.total)
        if chosen is better:
            return f"{chosen.name} has the highest evidence and predicts runs left out best"
        apart = gap(better, chosen)
        return (
            f"{chosen.name} has the highest evidence; {better.name} predicts runs left out better by {apart.delta:.1f} ± "
            f"{apart.std_error:.1f} nats; with {len(self.runs)} runs this may be chance"
        )

    def _added(self) -> list[str]:
        """Priors that were derived from the data, of each model of the error once."""
        by_name = {}
        for one in self.found:
            added = [line for line in one.lines[1:] if "= " in line or line.startswith("[prior")]
            if any(line.startswith("[prior") for line in added):
                by_name.setdefault(one.error_model, f"priors of {one.structure}, {one.error_model}: {'; '.join(added)}")
        return [f"not stated, so derived from the size of the data: {text}" for text in by_name.values()]


def gap(one: Candidate, other: Candidate) -> Gap:
    """Return how much better the first predicts runs left out, nats."""
    return _paired(one.elpd, other.elpd)


def _paired(one: Sequence[float], other: Sequence[float], mean: bool = False) -> Gap:
    apart = np.subtract(one, other)
    total = Gap(float(apart.sum()), float(np.sqrt(apart.size) * apart.std(ddof=1)))
    return Gap(total.delta / apart.size, total.std_error / apart.size) if mean else total


def _signed(apart: Gap) -> str:
    return f"{apart.delta:+.1f} ± {apart.std_error:.1f}"
