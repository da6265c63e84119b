"""A record under values of one's choice: their prediction, how well it fits, and how improbable the posterior finds them.

The other parameters stay at their best values m, or follow the moved ones a along the ridge of the posterior, where its normal
approximation N(m, S) expects them:

    x_r = m_r + S_ra S_aa^-1 (x_a - m_a)

The squared distance d^2 = (x_a - m_a)^T Q (x_a - m_a) has a chi-square law with as many degrees of freedom as there are moved
parameters. Q is S_aa^-1 if the others follow, and (S^-1)_aa if they stay. A mass that is taken as exact has no place in S; with another one
the best values themselves move, to first order by -S I_m, I_m being the information about each parameter and the mass together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
import scipy
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_kind, check_numbers
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.result_table import table_html, table_text
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.output_error import ANY_TRIAL
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.prediction.prediction import (
    outputs_of_draws,
    prior_of_unseen,
    record_alone,
    records_likelihood,
)
from seatrial.estimation.priors import Normal
from seatrial.vehicles.whole import MASS, stated_mass

if TYPE_CHECKING:
    from pandas import DataFrame


class Outcome(NamedTuple):
    """What some values predict of a record of n samples and m channels.

    Attributes:
        mean: of each measured channel, SI, not finite if the motion diverges, shape (n, m).
        explained: share of the variance of each channel, 1 - SSE / SST; NaN if it never changes or is not measured, shape (m,).
        log_likelihood: of the record.
        fitted_log_likelihood: of all fitted records together.
    """

    mean: Float[np.ndarray, "n m"]
    explained: Float[np.ndarray, " m"]
    log_likelihood: float
    fitted_log_likelihood: float


@dataclass(frozen=True, eq=False)
class Tweak:
    """A record under chosen values beside the best ones.

    Attributes:
        record: the predicted one.
        channels: measured channels, in the order of the columns.
        values: of every parameter, SI, the mass among them if it can be moved.
        moved: names of the parameters that were moved.
        tweaked: what these values predict.
        best: what the best values predict.
        distance: of the moved coefficients from the best values, in standard deviations of the posterior, d.
        probability: share of the posterior that is farther out.
    """

    record: Record
    channels: tuple[str, ...]
    values: Mapping[str, float]
    moved: tuple[str, ...]
    tweaked: Outcome
    best: Outcome
    distance: float
    probability: float

    @property
    def measured(self) -> Float[np.ndarray, "n m"]:
        """Measurements of the record, SI, NaN if there is none."""
        return np.column_stack([self.record.channel(name) for name in self.channels])

    @property
    def residual(self) -> Float[np.ndarray, "n m"]:
        """What the chosen values leave of the measurements, SI."""
        return self.measured - self.tweaked.mean

    def summary(self) -> "DataFrame":
        """Return a table with a row for each channel: share of the variance explained by the chosen and by the best values."""
        from pandas import DataFrame

        columns = {"explained": self.tweaked.explained, "explained by the best": self.best.explained}
        units = [signal_unit(name) for name in self.channels]
        return DataFrame({"unit": units, **columns}, index=list(self.channels))

    @property
    def _heading(self) -> str:
        return f'Record "{self.record.label}" with {", ".join(self.moved) or "nothing"} moved'

    @property
    def _remarks(self) -> tuple[str, ...]:
        lower = (self.best[i] - self.tweaked[i] for i in (2, 3))
        words = "log likelihood {:.4g} below that of the best values; of all fitted records {:.4g}"
        far = f"{self.distance:.3g} standard deviations from the best values; {self.probability:.2g} of the posterior is farther"
        return words.format(*lower), far

    __repr__ = table_text
    _repr_html_ = table_html


def tweak(
    posterior: Posterior,
    mode: Mode,
    record: Record,
    values: Mapping[str, float],
    *,
    follow: bool = False,
    sd: Mapping[str, float] | None = None,
    start: Mapping[str, float] | Sequence[float] | None = None,
) -> Tweak:
    """Predict a record with some parameters moved from their best values.

    Args:
        posterior: of `make_posterior`.
        mode: its mode, of `find_mode`: the best values.
        record: fitted or not. If not, parameters of its own trial, such as its bias, are at the means of their priors.
        values: moved parameters, SI, by name; `mass`, kg, of a vehicle whose mass is stated and that moves along an axis. Weight, buoyancy
            and moments of inertia stay as stated.
        follow: whether the other parameters follow along the ridge of the posterior, no farther than their priors reach.
        sd: standard deviations by which the distance is judged, SI, by name, such as those with all errors; of the mode if not given.
        start: see `predict`; that of the posterior for a fitted record.

    Raises:
        InputError: a posterior of no records, a mode of another one, a name that is no parameter, or a control or channel that the record
            lacks.
    """
    likelihood = records_likelihood(posterior, "give a posterior of `make_posterior`")
    check_kind(mode, Mode, "mode", "find it with `find_mode`")
    check_kind(record, Record, "record", "read it with `read_log`, or make it with `make_record` or `simulate`")
    if mode.names != posterior.names:
        raise InputError(
            "mode",
            found=", ".join(mode.names),
            expected="the parameters of the posterior: " + ", ".join(posterior.names),
            remedy="give the mode that `find_mode` finds of this posterior",
        )
    stated = stated_mass(likelihood.model)
    best = mode.by_name if stated is None else {**mode.by_name, MASS: stated}
    moved = check_numbers(values, "values", known=(*posterior.present_names, *best.keys() - mode.names))
    if MASS in moved and stated is not None:
        check_numbers({MASS: moved[MASS]}, "values", above=0.0)
    judged = {name: value for name, value in moved.items() if name in posterior.names}
    chosen = {**best, **moved}
    fitted = posterior if stated is None else _with_mass(posterior, stated)
    if follow and moved:
        shift = moved.get(MASS, stated or 0.0) - (stated or 0.0)
        chosen |= _followed(posterior, _shifted(fitted, mode, shift) if shift else mode, judged)
    if start is None and record.label in likelihood.labels:
        start = np.asarray(posterior.data.initial)[likelihood.labels.index(record.label)].tolist()
    alone = record_alone(fitted, record, start)
    rows = [_of_record(alone, record.label, one) for one in (best, chosen)]
    of_record, of_fitted = _points(alone, rows), _points(fitted, (best, chosen))
    # Without process noise the key has no use.
    simulated = outputs_of_draws(alone.likelihood.output)
    shown = np.asarray(simulated(dict(zip(alone.names, of_record.T, strict=True)), alone.data, jax.random.key(0)))
    log_likelihoods = (_log_likelihoods(*one).tolist() for one in ((alone, of_record), (fitted, of_fitted)))
    measured = np.column_stack([record.channel(name) for name in likelihood.channels])
    means = shown[:, : record.time.size]
    outcomes = [
        Outcome(mean, _explained(measured, mean), *both) for mean, *both in zip(means, *log_likelihoods, strict=True)
    ]
    distance = _distance(mode, dict(zip(mode.names, mode.sd, strict=True)) | dict(sd or {}), judged, follow)
    probability = float(scipy.special.chdtrc(len(judged), distance**2)) if judged else 1.0
    return Tweak(record, likelihood.channels, chosen, tuple(moved), outcomes[1], outcomes[0], distance, probability)


def _followed(posterior: Posterior, mode: Mode, moved: Mapping[str, float]) -> dict[str, float]:
    """Return the other parameters as the normal approximation expects them, inside their priors."""
    expected = mode.expected(moved) if moved else mode.by_name
    others = [one for one in posterior.present_parameters if one.name in expected]
    return {one.name: _inside(expected[one.name], one.prior.bounds) for one in others}


def _inside(value: float, bounds: tuple[float, float]) -> float:
    return float(np.clip(value, *(np.nextafter(bound, value) for bound in bounds)))


def _with_mass(posterior: Posterior, stated: float) -> Posterior:
    """Return a posterior with the mass as its last parameter."""
    mass = Parameter(MASS, "kg", "m", Normal(stated, stated))
    present = None if posterior.present is None else np.append(posterior.present, 1.0)
    return replace(posterior, parameters=(*posterior.parameters, mass), present=present, guess=None)


def _shifted(with_mass: Posterior, mode: Mode, shift: float) -> Mode:
    """Return the mode as it moves, to first order, if the mass differs by so much from the stated one, the mean of its prior."""
    stated = with_mass.parameters[-1].prior.mean
    information = np.asarray(likelihood_slopes(with_mass, np.append(mode.values, stated)).information)
    return mode._replace(values=mode.values - mode.covariance @ information[:-1, -1] * shift)


def _distance(mode: Mode, sd: Mapping[str, float], moved: Mapping[str, float], follow: bool) -> float:
    """Return how far moved values are from the best ones, in standard deviations; the correlations are those of the mode."""
    size = np.sqrt(np.diag(mode.cov))
    off = np.zeros(size.size)
    for name, value in moved.items():
        off[mode.names.index(name)] = (value - mode.by_name[name]) / sd[name]
    # Where the others stay, they count with no distance: Q is then a block of the inverse of all.
    at = np.array([i for i, name in enumerate(mode.names) if name in moved or not follow], int)
    correlation = (mode.cov / np.outer(size, size))[np.ix_(at, at)]
    return float(np.sqrt(max(0.0, off[at] @ np.linalg.lstsq(correlation, off[at])[0]))) if moved else 0.0


def _of_record(alone: Posterior, label: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return the values of the parameters of one trial, named as those of `ANY_TRIAL`."""
    known = {name.replace(f"[{label}]", f"[{ANY_TRIAL}]"): value for name, value in values.items()}
    first = dict(zip(alone.likelihood.model.states, np.asarray(alone.data.initial)[0], strict=True))
    unseen = [one for one in alone.present_parameters if one.name not in known]
    return known | {one.name: float(prior_of_unseen(one, first, known, {}).mean) for one in unseen}


def _points(posterior: Posterior, rows: Sequence[Mapping[str, float]]) -> Float[np.ndarray, "k d"]:
    """Return the values of all parameters at several points; 0 of what is absent."""
    return np.array([[row.get(name, 0.0) for name in posterior.names] for row in rows])


@program
def _log_likelihoods(posterior: Posterior, points: Float[Array, "k d"]) -> Float[Array, " k"]:
    def of_point(point: Array) -> Array:
        return posterior.likelihood(dict(zip(posterior.names, point, strict=True)), posterior.data)

    return jax.vmap(of_point)(points)


def _explained(measured: Float[np.ndarray, "n m"], mean: Float[np.ndarray, "n m"]) -> Float[np.ndarray, " m"]:
    """Return the share of the variance of each channel that is explained."""
    seen = np.ma.masked_invalid(measured)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.ma.filled(1.0 - ((seen - mean) ** 2).mean(0) / seen.var(0), np.nan)
