"""Stored results about parameters: posteriors, what is known of each parameter, what a model lacks, profiles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import numpy as np
from pydantic import Field, computed_field

from seatrial.core.dataset import Dataset
from seatrial.core.findings import Finding, Message
from seatrial.core.result_table import table_html, table_text
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.estimation.posterior.configurations import ConfigurationDifference, names_in
from seatrial.messages.render import sentences
from seatrial.selection.structures import Structure

if TYPE_CHECKING:
    from pandas import DataFrame


TINY = float(np.finfo(float).tiny)


class HasKey(Protocol):
    """What a later result depends on: the records, or a stand-in of which only the key is known."""

    @property
    def key(self) -> str:
        """Key of everything that it depends on."""
        ...


class OfStructure(HasKey, Protocol):
    """Likewise of one structure: its posterior, or a stand-in."""

    @property
    def structure(self) -> Structure:
        """Which terms."""
        ...


class Drawn(Protocol):
    """Draws of the parameters of one structure, of a posterior or of what stands for it."""

    @property
    def structure(self) -> Structure:
        """Which terms."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        ...

    def draws(self, names: Sequence[str] | None = None) -> np.ndarray:
        """Draws of the named parameters, SI, shape (n, k)."""
        ...


@dataclass(frozen=True)
class StoredCoefficient:
    """One parameter of the chosen structure, SI: its value with its ±, its prior, and the health of its draws.

    `sd` and the interval contain more than the noise: `shares` gives the parts of the variance, and `cause` names the largest.
    """

    name: str
    unit: str
    label: str
    mean: float
    sd: float
    mcse: float
    mode: float
    prior_mean: float
    prior_sd: float
    r_hat: float
    ess_bulk: float
    ess_tail: float
    geweke: float
    lower_95: float
    upper_95: float
    shares: ErrorShares = ErrorShares()
    cause: str = ""

    def in_unit(self, factor: float, unit: str) -> "StoredCoefficient":
        """Return it in another unit, of which there are `factor` in an SI unit."""
        scaled = {
            name: factor * getattr(self, name) for name in ("mean", "sd", "mcse", "mode", "prior_mean", "prior_sd")
        }
        ends = {name: factor * getattr(self, name) for name in ("lower_95", "upper_95")}
        return replace(self, **scaled, **ends, unit=unit)


def shortest_interval(draws: np.ndarray) -> tuple[float, float]:
    """Return the shortest interval that holds 95 % of some draws, as arviz-stats, which takes a second to load."""
    values = np.sort(draws)
    held = int(0.95 * values.size)
    first = int(np.argmin(values[held:] - values[: values.size - held]))
    return float(values[first]), float(values[first + held])


@dataclass(frozen=True, eq=False)
class Estimate:
    """Posterior of one structure as stored: parameters on `parameter`, draws on `chain` and `draw`.

    Attributes:
        structure: which terms.
        data: the stored dataset.
        alarms: reasons why the draws cannot be used.
        cautions: limits of the result.
        at_bounds: which parameters have their mode at a bound of their prior.
        left_out: effects that the structure lacks and its coefficients hide, the most harmful first.
        contains: contents of the standard deviations, in words.
        causes: the largest part of each that is not mostly noise, in words, by parameter.
        cause_findings: the causes, their coefficients and the remedies.
        tried_effects: effects that the structure may lack and that were tried, in words.
        configuration_differences: changes between configurations of the vehicle, with all errors.
    """

    structure: Structure
    data: Annotated[Dataset, Field(exclude=True)]
    alarms: tuple[str, ...] = ()
    cautions: tuple[Message, ...] = ()
    at_bounds: tuple[str, ...] = ()
    left_out: tuple[Finding, ...] = ()
    contains: str = ""
    causes: Mapping[str, str] = field(default_factory=dict)
    cause_findings: tuple[Finding, ...] = ()
    tried_effects: tuple[str, ...] = ()
    configuration_differences: tuple[ConfigurationDifference, ...] = ()

    @property
    def key(self) -> str:
        """Stamp of the result."""
        return self.data.attrs["key"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(str(name) for name in self.data["parameter"].values)

    def draws(self, names: Sequence[str] | None = None) -> np.ndarray:
        """Draws of the named parameters, SI, all chains together, shape (n, k)."""
        chosen = self.data["draws"].sel(parameter=list(self.names if names is None else names))
        return chosen.values.reshape(-1, chosen.sizes["parameter"])

    def in_configuration(self, configuration: str | None, place: str = "configuration") -> "Estimate":
        """Return the posterior of the vehicle in one configuration; arguments and errors as `names_in`."""
        chosen = names_in(self.names, configuration, place)
        parts = self.data.sel(parameter=list(chosen)).variables
        data = {name: tuple(one) for name, one in parts.items() if name not in self.data.coordinates}
        coords = {name: tuple(one) for name, one in parts.items() if name in self.data.coordinates}
        coords["parameter"] = ("parameter", np.array(list(chosen.values())))
        return replace(self, data=Dataset(data, coords, self.data.attrs))

    def interval(self, name: str) -> tuple[float, float]:
        """Shortest interval that holds 95 % of the draws of a parameter, its ends as much farther from the mean as its ± is wider, SI."""
        return shortest_interval(self.widened_draws(name))

    def widened_draws(self, name: str) -> np.ndarray:
        """Return draws of a parameter whose standard deviation is its ±, no farther than its prior reaches, SI, shape (n,)."""
        row, draws = self.data.sel(parameter=name), self.draws([name])[:, 0]
        mean, wider = float(row["mean"]), float(row["sd"]) / max(float(row["draws_sd"]), TINY)
        return np.clip(mean + wider * (draws - mean), float(row["prior_lower"]), float(row["prior_upper"]))

    def sd(self, name: str) -> float:
        """Standard deviation of a parameter with all errors, SI."""
        return float(self.data["sd"].sel(parameter=name))

    def shares(self, name: str) -> ErrorShares:
        """Return what the variance of a parameter is made of."""
        return ErrorShares(*map(float, self.data["shares"].sel(parameter=name).values))

    @computed_field
    @property
    def log_evidence_laplace(self) -> float:
        """Log evidence by the Laplace approximation, nats."""
        return float(self.data.attrs["laplace_log_evidence"])

    @computed_field
    @property
    def parameters(self) -> tuple[StoredCoefficient, ...]:
        """Each parameter with its posterior and its prior, SI."""
        return tuple(map(self._parameter, self.names))

    def _parameter(self, name: str) -> StoredCoefficient:
        row, (lower, upper) = self.data.sel(parameter=name), self.interval(name)
        stored = ("mean", "sd", "mcse", "mode", "prior_mean", "prior_sd", "r_hat", "ess_bulk", "ess_tail", "geweke")
        numbers = {key: float(row[key]) for key in stored}
        return StoredCoefficient(
            name=name,
            unit=str(row["unit"].values),
            label=str(row["label"].values),
            **numbers,
            lower_95=lower,
            upper_95=upper,
            shares=self.shares(name),
            cause=self.causes.get(name, ""),
        )

    def prior_curves(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Prior density of each parameter: values that increase, and the density per unit there, SI."""
        curves = (self.data[name].values for name in ("prior_value", "prior_density"))
        return dict(zip(self.names, zip(*curves, strict=True), strict=True))

    def summary(self) -> "DataFrame":
        """Return a table with a row for each parameter, SI: mean, sd and 95 % interval, what share of the variance is from what and what
        adds most to it, mode, and the health of its draws."""
        from pandas import DataFrame

        return DataFrame(self.summary_columns(), index=list(self.names))

    def summary_columns(self) -> dict[str, Any]:
        """Return the columns of `summary`, which programs need without a table."""
        lower, upper = np.transpose([self.interval(name) for name in self.names])
        stored = ("mode", "mcse", "r_hat", "ess_bulk", "ess_tail")
        columns = {name: self.data[name].values for name in ("unit", "mean", "sd")}
        columns |= {"lower_95": lower, "upper_95": upper}
        origins = fields(ErrorShares)[:-1]  # the last is of averages
        columns |= {one.name: self.data["shares"].values[:, at] for at, one in enumerate(origins)}
        columns |= {"cause": [self.causes.get(name, "") for name in self.names]}
        return columns | {name: self.data[name].values for name in stored}

    @property
    def _heading(self) -> str:
        return f"Posterior of the structure {', '.join(self.structure.terms)}, SI"

    @property
    def _remarks(self) -> list[str]:
        return [*self.alarms, *sentences(self.cautions)]

    __repr__ = table_text
    _repr_html_ = table_html

    def own_values(self) -> list[tuple[str, str, float, float, str]]:
        """Of each value that varies between trials: its name, the trial, its mean, standard deviation and SI unit."""
        values = []
        from seatrial.estimation.posterior.output_error import deviation_name, is_deviation, of_deviation, spread_name

        for name, label in map(of_deviation, filter(is_deviation, self.names)):
            common, spread, deviation = self.draws([name, spread_name(name), deviation_name(name, label)]).T
            own, unit = common + spread * deviation, str(self.data.sel(parameter=name)["unit"].values)
            values.append((name, label, float(own.mean()), float(own.std()), unit))
        return values


@dataclass(frozen=True)
class StoredMode:
    """Posterior mode of the most probable structure as a later campaign takes it over, SI.

    Attributes:
        terms: its coefficients.
        found: value and standard deviation of each parameter.
        correlations: each pair of parameters with its correlation.
        units: SI unit of each parameter; none if an older version stored the mode.
        causes: what adds most to the standard deviations that are not mostly noise, in words.
    """

    terms: tuple[str, ...]
    found: dict[str, tuple[float, float]]
    correlations: tuple[tuple[str, str, float], ...]
    units: dict[str, str]
    causes: dict[str, str]
