"""From evidences to probabilities with their Monte Carlo error, and to words an engineer can act on; without JAX."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, combinations
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from jaxtyping import Float

from seatrial.core.display_units import listed
from seatrial.core.findings import Finding
from seatrial.core.result_table import table_html, table_text
from seatrial.core.serialise import AS_LIST, from_plain
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.selection.structure_prior import StructurePrior, log_priors
from seatrial.selection.structures import Structure

if TYPE_CHECKING:
    from pandas import DataFrame

DECIDED, LIKELY = 0.95, 0.75
EDGES = (1 - DECIDED, 1 - LIKELY, LIKELY, DECIDED)
DECISIONS = (1 - DECIDED, DECIDED)
# Nats by which an evidence may be wrong before a decision asks for a second method: what that resolves at least.
MAX_UNCHECKED = 1.5
MAX_PROBABILITY_ERROR = 0.05  # Monte Carlo error of a probability above which a verdict near an edge is withheld


@dataclass(frozen=True)
class Evidence:
    """Log marginal likelihood of the data under one structure.

    Attributes:
        log_value: estimate, nats.
        std_error: its Monte Carlo standard error.
        method: how it was computed.
        diagnostics: numbers that say whether to trust it.
        status: empty if healthy, else the fault in words.
        with_errors: the log marginal likelihood with every error of sensors, stated inputs and model, nats; None if it is not known.
    """

    log_value: float
    std_error: float
    method: str
    diagnostics: dict[str, Any] = field(default_factory=dict)
    status: str = ""
    with_errors: float | None = None

    @property
    def weighed(self) -> float:
        """The value for probabilities, nats: that with every error if it is known."""
        return self.log_value if self.with_errors is None else self.with_errors

    @property
    def resolution(self) -> float | None:
        """Smallest difference, nats, that the confirming methods resolve; None if no method confirms the value."""
        return self.diagnostics.get("resolution")

    def summary(self) -> "DataFrame":
        """Return a table of one row: log evidence within the model and its standard error, and with every error, nats, the difference
        that its check resolves, method, and what is wrong with it."""
        from pandas import DataFrame

        row = {"log_value": self.log_value, "std_error": self.std_error, "with_errors": self.with_errors}
        row |= {"resolution": self.resolution}
        row |= {"method": self.method, "status": self.status}
        return DataFrame([row], index=["evidence"])

    @property
    def _heading(self) -> str:
        return "Log evidence, nats"

    @property
    def _remarks(self) -> list[str]:
        return [*([self.status] if self.status else []), *([self.check_words] if self.resolution else [])]

    @property
    def check_words(self) -> str:
        """The resolution of the check in words: methods that both miss a smaller part of the posterior, or the same part, agree."""
        return f"the check resolves {self.resolution:.2g} nat"

    __repr__ = table_text
    _repr_html_ = table_html


@dataclass(frozen=True)
class StructureRow:
    """One candidate with its evidence within the model, nats, and its probability; each with its Monte Carlo standard error.

    The probability follows from the evidence with every error, if that is known. The resolution is the smallest difference, nats, that the
    check of the evidence would have noticed; none without a check. Needed is the smallest that would change a decision; none if no
    difference would.
    """

    label: str
    terms: tuple[str, ...]
    log_evidence: float
    log_evidence_error: float
    log_evidence_with_errors: float | None
    log_evidence_resolution: float | None
    log_evidence_needed: float | None
    probability: float
    probability_error: float
    method: str
    status: str


@dataclass(frozen=True)
class StoredAverage:
    """One parameter averaged over all structures by their probabilities, SI; a structure without it counts as zero.

    Attributes:
        name: of the parameter.
        unit: SI unit.
        label: in LaTeX.
        mean: of the mixture.
        sd: likewise.
        lower_95: begin of its shortest 95 % interval.
        upper_95: its end.
        cause: the largest part of the standard deviation, if that is not the noise.
        inclusion: probability of the structures that have it.
        shares: parts of the variance.
    """

    name: str
    unit: str
    label: str
    mean: float
    sd: float
    lower_95: float
    upper_95: float
    cause: str
    inclusion: float
    shares: ErrorShares = ErrorShares()

    def in_unit(self, factor: float, unit: str) -> "StoredAverage":
        """Return it in another unit, of which there are `factor` in an SI unit."""
        scaled = {name: factor * getattr(self, name) for name in ("mean", "sd", "lower_95", "upper_95")}
        return replace(self, **scaled, unit=unit)


@dataclass(frozen=True)
class Selection:
    """Which terms the data support.

    Attributes:
        structures: candidates.
        evidences: one for each.
        probability: posterior probability of each structure; their sum is less than 1 by `outside`.
        probability_error: its Monte Carlo standard error.
        inclusion: posterior probability of each optional term, over all structures.
        inclusion_error: its Monte Carlo standard error.
        chosen: index of the most probable structure.
        verdicts: one sentence for each question.
        alarms: unreliable evidences on which a verdict depends.
        outside: probability of all structures that a screening left out and that were not simulated.
        structure_prior: how probable structures are before the data, `equal` or `multiplicity`.
    """

    structures: tuple[Structure, ...]
    evidences: tuple[Evidence, ...]
    probability: Annotated[Float[np.ndarray, " m"], AS_LIST]
    probability_error: Annotated[Float[np.ndarray, " m"], AS_LIST]
    inclusion: Mapping[str, float]
    inclusion_error: Mapping[str, float]
    chosen: int
    verdicts: tuple[str, ...]
    alarms: tuple[str, ...]
    outside: float = 0.0
    structure_prior: StructurePrior = "equal"

    @property
    def rows(self) -> tuple[StructureRow, ...]:
        """Each structure with its evidence and its probability."""
        columns = (self.structures, self.evidences, self.probability, self.probability_error, self.needed)
        return tuple(
            StructureRow(
                structure.label,
                structure.terms,
                evidence.log_value,
                evidence.std_error,
                evidence.with_errors,
                evidence.resolution,
                needed if np.isfinite(needed) else None,
                float(probability),
                float(error),
                evidence.method,
                evidence.status,
            )
            for structure, evidence, probability, error, needed in zip(*columns, strict=True)
        )

    @property
    def needed(self) -> list[float]:
        """By how much each evidence has to be wrong for a decision to change, nats; infinite where none would."""
        return _least(_needed(self.structures, self.evidences, [*self.inclusion], self.structure_prior))

    @property
    def undecided(self) -> dict[str, float]:
        """Terms that the data leave open, or whose probability is noisy or depends on an evidence that is not reliable, with that
        probability."""
        return {
            term: p
            for term, p in self.inclusion.items()
            if _is_noisy(p, self.inclusion_error[term]) or not _is_decided(p, self.reached(term))
        }

    @property
    def cautions(self) -> list[Finding]:
        """Which decisions change within what a check does not resolve, and which parameters lie at a bound of their prior."""
        blunt = blunt_deciders(self.structures, self.evidences, [*self.inclusion], self.structure_prior)
        findings = [
            Finding(
                "evidence-check-blunt",
                "caution",
                tuple(terms),
                {
                    "label": self.structures[index].label,
                    "resolution": self.evidences[index].resolution or 0.0,
                    "needed": min(terms.values()),
                },
                ("sharpen-evidence",),
            )
            for index, terms in blunt.items()
        ]
        at_bounds = [
            (from_plain(Finding, one), structure.label)
            for structure, evidence in zip(self.structures, self.evidences, strict=True)
            for one in evidence.diagnostics.get("at_bounds", ())
        ]
        within = [one for one in self.evidences if one.diagnostics.get("within_model")]
        findings += [Finding("evidence-within-model", "caution")] if within and len(self.structures) > 1 else []
        labels = {one: ", ".join(label for other, label in at_bounds if other == one) for one, _ in at_bounds}
        return findings + [one.among(structure=of) for one, of in labels.items()]

    @property
    def is_reliable(self) -> bool:
        """Whether the evidences are good enough for the probability of the chosen structure."""
        return not self.alarms and not _is_noisy(
            float(self.probability[self.chosen]), float(self.probability_error[self.chosen])
        )

    @property
    def is_settled(self) -> bool:
        """Whether the chosen structure stays far above every other, also if one evidence that is in doubt or noisy is wrong."""
        if not self.alarms and not self.is_reliable:
            return False
        rest = np.arange(self.probability.size) != self.chosen
        shifted = [one for i, doubt in enumerate(self._doubts) for one in _shifted(self._logs, i, doubt)]
        return all(one[self.chosen] >= DECIDED * (one[self.chosen] + one[rest].max(initial=0.0)) for one in shifted)

    @property
    def is_decided(self) -> bool:
        """Whether one structure has enough probability to quote its values."""
        return len(self.structures) == 1 or (self.is_settled and float(self.probability[self.chosen]) >= DECIDED)

    @property
    def quoted(self) -> Literal["chosen", "averaged"]:
        """Values to quote: averaged ones if the structure is not decided and the probabilities are reliable."""
        return "averaged" if self.is_reliable and not self.is_decided else "chosen"

    def reached(self, term: str) -> tuple[float, float]:
        """Return between which the probability of a term may lie if any one evidence in doubt is wrong."""
        member = np.array([term in structure.terms for structure in self.structures], float)
        if not any(self._doubts):
            return self.inclusion[term], self.inclusion[term]
        rest = self.inclusion[term] - float(member @ self.probability)  # of structures that were not simulated
        shifted = [one for index, doubt in enumerate(self._doubts) for one in _shifted(self._logs, index, doubt)]
        each = [rest + (1.0 - self.outside) * float(member @ one) for one in shifted]
        return min(each), max(each)

    @property
    def _logs(self) -> Float[np.ndarray, " m"]:
        return np.log(np.maximum(self.probability, np.finfo(float).tiny))

    @property
    def _doubts(self) -> list[float]:
        return [_doubt(evidence) for evidence in self.evidences]

    def summary(self) -> "DataFrame":
        """Return a table with a row for each structure, the most probable first: probability and log evidence within
        the model, each with its Monte Carlo standard error, log evidence with every error, that less the best, and the terms."""
        from pandas import DataFrame

        logs = np.array([evidence.weighed for evidence in self.evidences])
        columns = {
            "probability": self.probability,
            "probability_error": self.probability_error,
            "log_evidence": [evidence.log_value for evidence in self.evidences],
            "log_evidence_error": [evidence.std_error for evidence in self.evidences],
            "with_errors": [evidence.with_errors for evidence in self.evidences],
            "difference": logs - logs[self.chosen],
            "terms": [" ".join(structure.terms) for structure in self.structures],
        }
        table = DataFrame(columns, index=[structure.label for structure in self.structures])
        return table.sort_values("probability", ascending=False, kind="stable")

    @property
    def _heading(self) -> str:
        return "Which terms the data support"

    @property
    def _remarks(self) -> list[str]:
        return [*self.verdicts, *self.alarms, *(f"{one.code}: {listed(one.subject)}" for one in self.cautions)]

    __repr__ = table_text
    _repr_html_ = table_html


@dataclass(frozen=True)
class Shortlist:
    """What a screening of all structures says where only some of them are simulated.

    Attributes:
        inclusion: probability of each optional term by the screening.
        probability: that of each structure that is simulated, by the screening.
    """

    inclusion: Mapping[str, float]
    probability: Sequence[float]


def select(
    structures: Sequence[Structure],
    evidences: Sequence[Evidence],
    optional: Sequence[str],
    shortlist: Shortlist | None = None,
    structure_prior: StructurePrior = "equal",
) -> Selection:
    """Compare structures by their evidences and their prior, which is normalised over the structures that are compared.

    Monte Carlo errors are propagated to first order: d P_i = P_i (d log Z_i - sum_j P_j d log Z_j). Structures that a screening left out
    keep the probability that it gives them; those that are simulated share the rest.

    Args:
        structures: candidates.
        evidences: one for each.
        optional: terms that are in question.
        shortlist: where the candidates are what a screening left: its probabilities, under the same prior.
        structure_prior: how probable structures are before the data: `equal`, or by `multiplicity` every number of terms alike.
    """
    logs = _log_weights(structures, evidences, optional, structure_prior)
    errors = np.array([evidence.std_error for evidence in evidences])
    weights = np.exp(logs - logs.max())
    share = min(1.0, float(np.sum(shortlist.probability))) if shortlist else 1.0
    probability = weights / weights.sum()
    jacobian = share * (np.diag(probability) - np.outer(probability, probability))
    has = {term: np.array([term in structure.terms for structure in structures], float) for term in optional}
    inclusion = {term: min(1.0, share * float(member @ probability)) for term, member in has.items()}
    inclusion_error = {term: float(np.linalg.norm(member @ jacobian * errors)) for term, member in has.items()}
    if shortlist:
        inclusion = {
            term: float(np.clip(p + shortlist.inclusion[term] - has[term] @ shortlist.probability, 0.0, 1.0))
            for term, p in inclusion.items()
        }
    doubts = [_doubt(evidence) for evidence in evidences]
    selection = Selection(
        tuple(structures),
        tuple(evidences),
        share * probability,
        np.linalg.norm(jacobian * errors, axis=1),
        inclusion,
        inclusion_error,
        int(np.argmax(probability)),
        (),
        (),
        1.0 - share,
        structure_prior,
    )
    verdicts = [
        term_verdict(term, inclusion[term], inclusion_error[term], selection.reached(term)) for term in optional
    ]
    verdicts += pair_verdicts(has, probability)
    if shortlist:
        verdicts.append(
            f"{len(structures)} structures were simulated. The others have a probability of {1.0 - share:.2f} by the screening, which "
            "the probabilities of the terms include. Raise structure.shortlist to simulate more"
        )
    verdicts_need = _least(_needed(structures, evidences, optional, structure_prior, EDGES))
    alarms = tuple(
        f"the evidence of {structure.label} is not reliable: {evidence.status}; a verdict changes if it is wrong by {needed:.2g} nat"
        for structure, evidence, doubt, needed in zip(structures, evidences, doubts, verdicts_need, strict=True)
        if doubt and doubt >= needed
    )
    return replace(selection, verdicts=tuple(verdicts), alarms=alarms)


def unchecked_deciders(
    structures: Sequence[Structure],
    evidences: Sequence[Evidence],
    optional: Sequence[str],
    structure_prior: StructurePrior,
) -> list[int]:
    """Return the structures on whose evidence a decision depends, and which no second method has checked; arguments as `blunt_deciders`."""
    needed = _least(_needed(structures, evidences, optional, structure_prior))
    return [i for i, one in enumerate(evidences) if needed[i] <= MAX_UNCHECKED and len(one.diagnostics["methods"]) < 2]


def blunt_deciders(
    structures: Sequence[Structure],
    evidences: Sequence[Evidence],
    optional: Sequence[str],
    structure_prior: StructurePrior,
) -> dict[int, dict[str, float]]:
    """Return the structures on which a decision depends within what the check of their evidence does not resolve.

    Args:
        structures: candidates.
        evidences: one for each.
        optional: terms that are in question.
        structure_prior: as of `select`.

    Returns:
        of each such structure, by place, the terms and by how much the evidence has to be wrong for them, nats.
    """
    needed = _needed(structures, evidences, optional, structure_prior)
    blunt = {
        index: {term: nats for term, nats in own.items() if term and nats <= (evidence.resolution or 0.0)}
        for index, (own, evidence) in enumerate(zip(needed, evidences, strict=True))
    }
    return {index: terms for index, terms in blunt.items() if terms}


def _least(needed: Sequence[Mapping[str, float]]) -> list[float]:
    return [min(own.values(), default=np.inf) for own in needed]


def _needed(
    structures: Sequence[Structure],
    evidences: Sequence[Evidence],
    optional: Sequence[str],
    structure_prior: StructurePrior,
    edges_of_term: Sequence[float] = DECISIONS,
) -> list[dict[str, float]]:
    """Return by how much each evidence has to be wrong for the verdict on a term to change, nats, by the terms where one would; and
    under "" for the most probable structure to be settled, or no longer.

    With x = P_i exp(shift), the probability of a term of members m is (a + m_i x) / (1 - P_i + x), a that of its other members: an edge
    is reached at x = (edge (1 - P_i) - a) / (m_i - edge).
    """
    logs = _log_weights(structures, evidences, optional, structure_prior)
    probability = np.exp(logs - np.logaddexp.reduce(logs))
    has = {term: np.array([term in one.terms for one in structures], float) for term in optional}
    has |= {"": np.eye(logs.size)[int(np.argmax(logs))]}
    result: list[dict[str, float]] = []
    for i, p in enumerate(probability):
        own = {}
        for term, member in has.items():
            others = float(member @ probability) - member[i] * p
            edges = np.array(edges_of_term if term else (DECIDED,))
            x = (edges * (1.0 - p) - others) / (member[i] - edges)
            if p > 0.0 and (x > 0.0).any():
                own[term] = float(np.abs(np.log(x[x > 0.0] / p)).min())
        result.append(own)
    return result


def _log_weights(
    structures: Sequence[Structure],
    evidences: Sequence[Evidence],
    optional: Sequence[str],
    structure_prior: StructurePrior,
) -> Float[np.ndarray, " m"]:
    """Return the log of prior times evidence of each structure, nats, but for a constant."""
    return np.array([one.weighed for one in evidences]) + log_priors(structures, optional, structure_prior)


def averaged(
    moments: Sequence[Mapping[str, tuple[float, float]]], probability: Float[np.ndarray, " m"]
) -> dict[str, tuple[float, float]]:
    """Average coefficients over structures: mean and standard deviation of the mixture, zero if a structure lacks the coefficient.

    Args:
        moments: posterior mean and standard deviation of each coefficient, of each structure.
        probability: of each structure.
    """
    results = {}
    for name in dict.fromkeys(chain(*moments)):
        mean, sd = np.array([one.get(name, (0.0, 0.0)) for one in moments]).T
        centre = float(probability @ mean)
        results[name] = centre, float(np.sqrt(probability @ (sd**2 + (mean - centre) ** 2)))
    return results


def _is_noisy(probability: float, error: float) -> bool:
    """Return whether the Monte Carlo error of a probability leaves open on which side of an edge it is."""
    return error > MAX_PROBABILITY_ERROR and any(abs(probability - edge) < 2.0 * error for edge in EDGES)


def _is_decided(probability: float, reached: tuple[float, float]) -> bool:
    """Return whether a term is in or out with the probability of `DECIDED`, all over the range that its probability may have."""
    low, high = min(probability, *reached), max(probability, *reached)
    return low >= DECIDED or high <= 1 - DECIDED


def _doubt(evidence: Evidence) -> float:
    """By how much an evidence whose run is in doubt may be wrong, nats: ten of its errors, the difference of another method, and three
    joint errors with one that is sound; 3 at least if there is none."""
    if not evidence.status:
        return 0.0
    table = evidence.diagnostics.get("methods", {})
    apart = [abs(one["difference"]) for one in table.values() if np.isfinite(one["difference"])]
    sound = [one["std_error"] for one in table.values() if not one["status"] and np.isfinite(one["difference"])]
    blunt = 3.0 * float(np.linalg.norm(np.nan_to_num(sound))) if len(sound) > 1 else 3.0
    return max(10.0 * np.nan_to_num(evidence.std_error), *apart, blunt)


def _shifted(logs: np.ndarray, index: int, doubt: float) -> list[Float[np.ndarray, " m"]]:
    """Return the probabilities if one evidence is too high by so much, and if it is too low."""
    step = doubt * (np.arange(logs.size) == index)
    return [np.exp(x - x.max()) / np.exp(x - x.max()).sum() for x in (logs - step, logs + step)]


def term_verdict(term: str, inclusion: float, error: float, reached: tuple[float, float] | None = None) -> str:
    """Return whether the data support a term, with the probability of the side that is favoured.

    Args:
        term: which.
        inclusion: its probability.
        error: Monte Carlo error of that.
        reached: between which the probability may lie if an evidence that is not to be trusted is wrong.
    """
    without = 1.0 - inclusion
    if reached and np.searchsorted(EDGES, reached[0]) != np.searchsorted(EDGES, reached[1]):
        return (
            f"no verdict about {term} yet: its probability of {inclusion:.2f} depends on an evidence that is not "
            f"reliable, and may be from {reached[0]:.2f} to {reached[1]:.2f}"
        )
    margin = f" (± {error:.2f} Monte Carlo)" if error >= 0.005 else " (Monte Carlo error below 0.005)"
    if _is_noisy(inclusion, error):
        return (
            f"the evidence is too noisy to decide about {term}: "
            f"probability {inclusion:.2f} with it{margin}; use more particles or repeats"
        )
    if inclusion >= DECIDED:
        return f"the data support {term}: probability {inclusion:.2f} with it{margin}"
    if inclusion >= LIKELY:
        return f"the data favour {term}, but do not settle it: probability {inclusion:.2f} with it{margin}"
    if without >= LIKELY:
        return f"the data do not support {term}: probability {without:.2f} without it{margin}"
    return f"the data cannot decide about {term}: probability {inclusion:.2f} with it, {without:.2f} without{margin}"


def pair_verdicts(has: Mapping[str, np.ndarray], probability: np.ndarray) -> list[str]:
    """Name the pairs of terms of which the data demand one but cannot tell which."""
    verdicts = []
    for a, b in combinations(has, 2):
        only_a = float((has[a] * (1 - has[b])) @ probability)
        only_b = float((has[b] * (1 - has[a])) @ probability)
        both = float((has[a] * has[b]) @ probability)
        if only_a + only_b + both >= DECIDED and min(only_a, only_b) > 1 - DECIDED:
            verdicts.append(
                f"these records cannot separate {a} from {b}: at least one is needed (probability {only_a + only_b + both:.2f}), "
                f"{a} alone {only_a:.2f}, {b} alone {only_b:.2f}, both {both:.2f}"
            )
    return verdicts
