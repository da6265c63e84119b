"""Criteria of structures as results, without JAX, and how far each structure is behind the best by them; lower is better."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import computed_field

from seatrial.core.errors import InputError
from seatrial.core.serialise import AS_LIST
from seatrial.selection.structures import Structure

# Difference below which its error is itself unreliable: 4 nats (Sivula, Magnusson and Vehtari 2020).
SMALL_DIFFERENCE = 8.0
METHODS = ("DIC", "BPIC", "AIC", "BIC", "WAIC", "PSIS-LOO")


class MonteCarloValue(NamedTuple):
    """A number and its Monte Carlo standard error."""

    value: float
    error: float


class DevianceCriteria(NamedTuple):
    """Criteria from the posterior mean of the deviance; p_D counts the parameters the data determine."""

    mean_deviance: MonteCarloValue
    p_d: MonteCarloValue
    dic: MonteCarloValue
    bpic: MonteCarloValue


@dataclass(frozen=True, eq=False)
class PredictiveCriterion:
    """Estimate of how badly new data would be predicted.

    Attributes:
        method: which criterion.
        value: the criterion with its Monte Carlo error.
        std_error: its standard error over the measurements, as if they were a sample of possible ones.
        effective: number of parameters, an effective one for WAIC and PSIS-LOO.
        pointwise: contribution of each measurement, shape (n,).
        k_hat: tail index of the importance weights of each, shape (n,); empty if there are none.
        status: empty if sound, else the fault in words.
    """

    method: Literal["WAIC", "PSIS-LOO", "AIC", "BIC"]
    value: MonteCarloValue
    std_error: float
    effective: float
    pointwise: Annotated[Float[np.ndarray, " n"], AS_LIST]
    k_hat: Annotated[Float[np.ndarray, " k"], AS_LIST]
    status: str


class Comparison(NamedTuple):
    """Difference of a criterion between two models, first minus second, its standard error and what follows."""

    delta: float
    std_error: float
    verdict: str


@dataclass(frozen=True, eq=False)
class Criteria:
    """Criteria of one structure.

    Attributes:
        structure: which terms.
        deviance: DIC and BPIC with what they are made of.
        predictive: AIC, BIC, WAIC and PSIS-LOO by name, as far as they exist.
        refused: why others do not exist, in words.
    """

    structure: Structure
    deviance: DevianceCriteria
    predictive: dict[str, PredictiveCriterion]
    refused: tuple[str, ...] = ()

    def values(self) -> dict[str, tuple[MonteCarloValue, str]]:
        """Return each criterion with its Monte Carlo error, and what is wrong with it."""
        deviance = {"DIC": (self.deviance.dic, ""), "BPIC": (self.deviance.bpic, "")}
        return deviance | {name: (one.value, one.status) for name, one in self.predictive.items()}


def compare(one: PredictiveCriterion, other: PredictiveCriterion) -> Comparison:
    """Return the difference of two models on the same measurements, its error from the pointwise differences.

    Raises:
        InputError: different criteria or different numbers of measurements.
    """
    if one.method != other.method or one.pointwise.shape != other.pointwise.shape:
        raise InputError(
            "comparison of two models",
            found=f"{one.method} of {one.pointwise.size} measurements and {other.method} of {other.pointwise.size}",
            expected="the same criterion of the same measurements",
            remedy="compute both from the same records and channels",
        )
    difference = one.pointwise - other.pointwise
    delta = float(difference.sum())
    std_error = float(np.hypot(sum_error(difference), np.hypot(one.value.error, other.value.error)))
    if abs(delta) < max(SMALL_DIFFERENCE, 2 * std_error):
        verdict = "these data do not separate the predictions of the two models"
    else:
        verdict = f"the {'first' if delta < 0 else 'second'} model predicts better"
    return Comparison(delta, std_error, f"{verdict}: {one.method} differs by {delta:+.1f} ± {std_error:.1f}")


def sum_error(pointwise: Float[np.ndarray, " n"]) -> float:
    """Return the standard error of the sum of contributions, as if they were a sample of possible ones."""
    return float(np.sqrt(pointwise.size) * pointwise.std(ddof=1))


class Difference(NamedTuple):
    """How far a structure is behind the best by one criterion, and the standard error of that; NaN if there is none."""

    delta: float
    error: float

    @property
    def is_clear(self) -> bool:
        """Whether it is beyond what its error and the smallness of such differences leave open."""
        return bool(self.delta >= max(SMALL_DIFFERENCE, 2 * self.error))


def differences(found: Sequence[Criteria]) -> dict[str, list[Difference]]:
    """Of every criterion, how far each structure is behind the best one, which has (0, 0)."""
    table = {}
    for name in METHODS:
        if name in ("DIC", "BPIC"):
            values = [one.values()[name][0] for one in found]
            best = min(values, key=lambda pair: pair.value)
            table[name] = [
                Difference(0.0, 0.0)
                if one is best
                else Difference(one.value - best.value, float(np.hypot(one.error, best.error)))
                for one in values
            ]
            continue
        terms = [one.predictive.get(name) for one in found]
        best = min((one for one in terms if one is not None), key=lambda one: one.value.value, default=None)
        table[name] = [
            Difference(np.nan, np.nan)
            if one is None or best is None
            else Difference(0.0, 0.0)
            if one is best
            else Difference(*compare(one, best)[:2])
            for one in terms
        ]
    return table


@dataclass(frozen=True)
class NestedPair:
    """Log Bayes factor of a term between two nested structures by Savage-Dickey, and by their evidences if these are there.

    Attributes:
        term: the term.
        larger: label of the structure that has it.
        smaller: label of the one that has not.
        value: log Z(larger) - log Z(smaller), nats; NaN if there is none.
        error: its standard error.
        evidence: the same from evidences, with its error; None if these have not been computed.
        status: empty if healthy.
    """

    term: str
    larger: str
    smaller: str
    value: float
    error: float
    evidence: tuple[float, float] | None
    status: str

    @computed_field
    @property
    def agrees(self) -> bool:
        """Whether both ways give the same number within their errors; true if one is missing."""
        if self.evidence is None or self.status or not np.isfinite(self.value):
            return True
        return abs(self.value - self.evidence[0]) <= max(3 * float(np.hypot(self.error, self.evidence[1])), 0.2)
