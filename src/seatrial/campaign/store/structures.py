"""Stored results about structures: the selection, the summary, the screening, the two contenders, information criteria."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from seatrial import __version__
from seatrial.campaign.store.estimates import Known, StoredCoefficient
from seatrial.campaign.store.predictions import Fit
from seatrial.core.dataset import Dataset
from seatrial.core.display_units import shown_unit
from seatrial.core.findings import Message
from seatrial.design.results import BestDesign
from seatrial.estimation.prediction.baseline_comparison import Comparison
from seatrial.estimation.prediction.pooled_coverage import Pooled
from seatrial.selection.verdict import DECIDED, Selection, StructureRow


@dataclass(frozen=True)
class StoredAverage:
    """One parameter averaged over all structures by their probabilities, SI; a structure without it counts as zero.

    Attributes:
        name: of the parameter.
        unit: SI unit.
        label: in LaTeX.
        mean: of the mixture.
        sd: likewise, within the structures.
        lower_95: begin of its shortest 95 % interval.
        upper_95: its end.
        model_error_sd: standard deviation with model error; None where it is not larger by more than a half.
        model_error_cause: what makes most of that.
        inclusion: probability of the structures that have it.
    """

    name: str
    unit: str
    label: str
    mean: float
    sd: float
    lower_95: float
    upper_95: float
    model_error_sd: float | None
    model_error_cause: str
    inclusion: float


@dataclass(frozen=True)
class NextTrial:
    """What to run next.

    Attributes:
        words: what to run and why, or why not.
        stop: whether no trial is proposed.
        best: the design that gives most information; None where the campaign designs no trial.
    """

    words: str
    stop: bool
    best: BestDesign | None


# Which value of a coefficient to quote, by `Selection.quoted`: the same words on every surface.
QUOTED = {
    "chosen": "that of the chosen model, with the ± with model error if that is larger",
    "averaged": "the average over all models, because the data do not decide between them, with the ± with model error if that is larger",
}
RARE = 0.01  # Probability below which a term that the chosen model lacks is not worth a row
# What helps where an evidence is not reliable.
BETTER_EVIDENCE = "raise `particles`, `draws` or `repeats` in [selection], or narrow the priors"
IF_RELIABLE = ", if the evidences were reliable"  # What a probability needs that depends on one
IF_NOISE = ", if the residuals were the noise that is modelled"  # What a probability needs where they are not


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
        cautions: what to know before using the numbers.
        findings: those of them that have codes, and accepted ones.
        alarms: health checks that failed.
        choice_alarms: those of them that are about the probabilities of models and terms.
        usable: whether none of these is about the chosen structure's numbers.
        known: what the data tell about each parameter.
        fits: how each channel of each record is predicted.
        pooled: how each channel of all held-back records together is predicted.
        baselines: how the model stands beside simple predictors on the held-back records, channel by channel.
        next_trial: what to run next.
        averaged: each parameter averaged over the structures.
        quoted: whose values to quote, by `QUOTED`.
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
    seatrial_version: str = __version__


SHOWN = 5  # Structures of a screening that are listed


@dataclass(frozen=True, eq=False)
class Screened:
    """Outcome of a screening, as it is stored.

    Attributes:
        data: `inclusion`, `inclusion_by_unit_information`, `mean`, `within`, `between`, `bias`, `fit` and `fit_sd` by `term`, the
            optional ones first; `member`, `probability` and `log_evidence` by `model`; `inclusion_at`, `mean_at` and
            `log_bayes_factor` along `scale`, the factor on prior standard deviations.
    """

    data: Dataset

    @property
    def optional(self) -> list[str]:
        """Terms whose presence the data decide."""
        return [
            str(term)
            for term, kept in zip(self.data["term"].values, self.data["always"].values, strict=True)
            if not kept
        ]

    def terms(self, rank: int) -> tuple[str, ...]:
        """Terms of one of the best structures."""
        member = self.data["member"].values[rank]
        return tuple(str(term) for term, there in zip(self.data["term"].values, member, strict=True) if there)

    @property
    def cautions(self) -> list[str]:
        """What keeps the screening from being relied on."""
        return [text for text in (self.data.attrs[key] for key in ("rows", "noise", "sampling", "left_out")) if text]

    def lines(self) -> list[str]:
        """What was found, in words."""
        from seatrial.estimation.regression.row_fit import SCREENING

        data, optional = self.data, self.optional
        narrow, wide = (data["inclusion_at"].sel(scale=factor, term=optional).values for factor in (0.3, 3.0))
        settings = "".join(f", {data.attrs[key]}" for key in ("prior", "delay") if data.attrs[key])
        messages = [
            f"screening of {data.attrs['count']} structures in closed form{settings} "
            "(in brackets: prior three times narrower, three times wider, worth one row):"
        ]
        here = data["inclusion"].sel(term=optional).values
        unit = data["inclusion_by_unit_information"].sel(term=optional).values
        messages += [
            f"  {term:<16} {p:.2f}  ({low:.2f}, {high:.2f}, {other:.2f})"
            for term, p, low, high, other in zip(optional, here, narrow, wide, unit, strict=True)
        ]
        best = range(min(SHOWN, data.sizes["model"]))
        messages += [f"  {float(data['probability'][rank]):.3f}  {' '.join(self.terms(rank))}" for rank in best]
        return [*messages, *verdicts_by_axis(dict(zip(optional, here, strict=True))), SCREENING]


def verdicts_by_axis(inclusion: Mapping[str, float]) -> list[str]:
    """Return a line for each axis of several: which terms it needs, which not, and about which these data leave doubt.

    Args:
        inclusion: probability of each optional term.
    """
    from seatrial.core.coefficients import CoefficientName

    axes: dict[str, dict[str, list[str]]] = {}
    for term, p in inclusion.items():
        verdict = "needed" if p >= DECIDED else "not needed" if p <= 1 - DECIDED else "open"
        axes.setdefault(CoefficientName.parse(term).axis, {}).setdefault(verdict, []).append(term)
    if len(axes) < 2:
        return []
    order = ("needed", "not needed", "open")
    return [
        f"  axis {axis}: "
        + "; ".join(f"{verdict}: {', '.join(verdicts[verdict])}" for verdict in order if verdict in verdicts)
        for axis, verdicts in axes.items()
    ]


ENOUGH = 3.0  # Expected log Bayes factor, nats, that decides: odds of twenty to one


@dataclass(frozen=True, eq=False)
class Contenders:
    """The best structure and the runner-up, as stored.

    Attributes:
        data: `time`, `best`, `difference`, `lower` and `upper` on `sample`, one manoeuvre after another, `which` by its index: the
            velocity `channel` of the best, and by how much it exceeds the runner-up's, with its 90 % band; `largest`, `rms` and
            `excitation` by `manoeuvre`, the fitted records and then the next trial; `nats` by `amplitude` and `period`: the
            expected log Bayes factor, NaN where a limit is broken.
    """

    data: Dataset

    @property
    def labels(self) -> tuple[str, str]:
        """Best and runner-up."""
        return self.data.attrs["best"], self.data.attrs["runner_up"]

    @property
    def decisive(self) -> tuple[int, int]:
        """Indices of the amplitude and the period that would tell most."""
        return largest_of(self.data["nats"].values)

    @property
    def nats(self) -> float:
        """Expected log Bayes factor of that design."""
        return float(self.data["nats"].values[self.decisive])

    @property
    def shown(self) -> tuple[int, int]:
        """Manoeuvres worth a picture: the fitted record of most excitation, and the next trial."""
        return int(np.argmax(self.data["excitation"].values[:-1])), self.data.sizes["manoeuvre"] - 1

    def where(self, manoeuvre: int) -> str:
        """Name of a manoeuvre in a sentence."""
        name = str(self.data["manoeuvre"].values[manoeuvre])
        return name if manoeuvre == self.data.sizes["manoeuvre"] - 1 else f"run {name}"

    def curve(self, manoeuvre: int) -> Dataset:
        """Samples of one manoeuvre."""
        return self.data.isel(sample=np.flatnonzero(self.data["which"].values == manoeuvre))

    def cautions(self, selection: Selection) -> list[str]:
        """Return that no design would decide between the two, if these data have not; empty if one would, or nothing is open."""
        return [] if selection.is_settled or self.nats > ENOUGH else [self.trial_words(selection)]

    def lines(self, selection: Selection) -> list[str]:
        """What the runner-up would change, what is undecided, and which trial would decide, in words."""
        return [self.difference_words(), undecided_words(selection), self.trial_words(selection)]

    def difference_words(self) -> str:
        """What choosing the runner-up would change in motion, or in force."""
        data, channel = self.data, self.data.attrs["channel"]
        (factor, unit), name = shown_unit(channel), "the speed" if channel == "u" else channel
        parts = [
            f"{float(data['largest'][i]) * factor:.2g} {unit} (rms {float(data['rms'][i]) * factor:.2g}) in {self.where(i)}"
            for i in reversed(self.shown)
        ]
        noise = data.attrs["noise"]
        end = (
            f"the residuals of the fit are {noise * factor:.2g} {unit}"
            if np.isfinite(noise)
            else f"{name} is not measured"
        )
        change = f"{self.labels[1]}, {data.attrs['change']}"
        return f"the runner-up ({change}) would change {name} by at most {' and '.join(parts)}; {end}"

    def trial_words(self, selection: Selection) -> str:
        """Which design of the best family would decide between the two, or that none would."""
        best, runner = self.labels
        if selection.is_settled:
            return f"these data have decided between {best} and {runner}; no trial is needed for that"
        if selection.residuals:
            return f"whether these data decide between {best} and {runner} cannot be said before the noise is right"
        if not selection.is_reliable:
            what = f"whether these data decide between {best} and {runner}"
            return f"{what} cannot be said before the evidence is reliable: {BETTER_EVIDENCE}"
        trial = self.data.attrs["trial"]
        gain = f"{self.nats:.2g} nat of evidence expected, {ENOUGH:g} decide"
        if self.nats > ENOUGH:
            return f"to decide between {best} and {runner}, run a {trial}: {gain}"
        return (
            f"no design of this family would decide between {best} and {runner}; the best would be a {trial}: {gain}. "
            "Widen the limits, run for longer, or use a better sensor"
        )


def largest_of(values: np.ndarray) -> tuple[int, int]:
    """Return row and column of the largest value that is a number."""
    row, column = np.unravel_index(np.nanargmax(values), values.shape)
    return int(row), int(column)


def condition_of(selection: Selection) -> str:
    """Say under which condition the probabilities hold; empty where nothing speaks against them."""
    return IF_NOISE if selection.residuals else "" if selection.is_reliable else IF_RELIABLE


def undecided_words(selection: Selection) -> str:
    """Name the terms about which these data leave doubt."""
    doubtful = [f"{term} ({p:.2f})" for term, p in selection.undecided.items()]
    unless = condition_of(selection)
    if not doubtful:
        return f"these data decide about every optional term{unless}"
    return f"not decided: {', '.join(doubtful)}; in brackets the probability that it is needed{unless}"


@dataclass(frozen=True)
class StoredMode:
    """Posterior mode of the most probable structure as a later campaign takes it over, SI.

    Attributes:
        terms: its coefficients.
        found: value and standard deviation of each parameter, those of a normal approximation.
        correlations: each pair of parameters with its correlation.
        units: SI unit of each parameter; none where an older version stored the mode.
        wider: standard deviation that survives an error of the model, and what makes most of it, of those where it is much larger.
    """

    terms: tuple[str, ...]
    found: dict[str, tuple[float, float]]
    correlations: tuple[tuple[str, str, float], ...]
    units: dict[str, str]
    wider: dict[str, tuple[float, str]]
