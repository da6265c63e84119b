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
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_kind, check_numbers
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.result_table import table_html, table_text
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.output_error import ANY_TRIAL, OutputError
from seatrial.estimation.posterior.posterior import Parameter, Posterior, check_posterior
from seatrial.estimation.posterior.replicate import motions
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.prediction.prediction import prior_of_unseen, record_alone
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
        words = ("log likelihood {:.4g} below that of the best values; of all fitted records {:.4g}", *lower)
        far = f"{self.distance:.3g} standard deviations from the best values; {self.probability:.2g} of the posterior is farther"
        return (words[0].format(*words[1:]), far)

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
        record: fitted or not. If not, what only its own trial would tell, such as its own bias, is at the mean of its prior.
        values: moved parameters, SI, by name; `mass`, kg, of a vehicle whose mass is stated and that moves along an axis. Weight, buoyancy
            and moments of inertia stay as stated.
        follow: whether the other parameters follow along the ridge of the posterior, no farther than their priors reach.
        sd: standard deviations by which the distance is judged, SI, by name, such as those with all errors; of the mode if not given.
        start: see `predict`; that of the posterior for a fitted record.

    Raises:
        InputError: a posterior of no records, a mode of another one, a name that is no parameter, or a control or channel that the record
            lacks.
    """
    check_posterior(posterior)
    check_kind(mode, Mode, "mode", "find it with `find_mode`")
    check_kind(record, Record, "record", "read it with `read_log`, or make it with `make_record` or `simulate`")
    likelihood = posterior.likelihood
    if not isinstance(likelihood, OutputError | FilterError) or mode.names != posterior.names:
        raise InputError(
            "mode" if mode.names != posterior.names else "posterior",
            found=", ".join(mode.names),
            expected="the parameters of a posterior of records: " + ", ".join(posterior.names),
            remedy="give a posterior of `make_posterior` and the mode that `find_mode` finds of it",
        )
    stated = stated_mass(likelihood.model)
    masses = {} if stated is None else {MASS: stated}
    moved = check_numbers(values, "values", known=(*posterior.present_names, *masses))
    for name in (MASS,) if MASS in moved and MASS not in posterior.names else ():
        check_numbers({name: moved[name]}, "values", above=0.0)
    sought = {name: value for name, value in moved.items() if name in posterior.names}
    best = {**mode.by_name, **masses}
    chosen = {**best, **moved}
    if follow and moved:
        chosen |= _followed(posterior, _with_mass(posterior, mode, stated, moved.get(MASS)), sought)
    both = [best, chosen]
    if start is None and record.label in likelihood.labels:
        start = np.asarray(posterior.data.initial)[likelihood.labels.index(record.label)].tolist()
    alone = record_alone(posterior, record, start)
    of_record = [_of_record(alone, record.label, one) for one in both]
    distance = _distance(mode, dict(zip(mode.names, mode.sd, strict=True)) | dict(sd or {}), sought, follow)
    shown, log_likelihoods = map(np.asarray, _outcomes(alone, *_points(alone, of_record, stated)))
    fitted = np.asarray(_log_likelihoods(posterior, *_points(posterior, both, stated)))
    measured = np.column_stack([record.channel(name) for name in likelihood.channels])
    means = shown[:, : record.time.size]
    outcomes = [
        Outcome(mean, _explained(measured, mean), float(own), float(of_fitted))
        for mean, own, of_fitted in zip(means, log_likelihoods, fitted, strict=True)
    ]
    probability = float(scipy.special.chdtrc(len(sought), distance**2)) if sought else 1.0
    return Tweak(record, likelihood.channels, chosen, tuple(moved), outcomes[1], outcomes[0], distance, probability)


def _followed(posterior: Posterior, mode: Mode, moved: Mapping[str, float]) -> dict[str, float]:
    """Return the other parameters as the normal approximation expects them, inside their priors."""
    priors = {one.name: one.prior for one in posterior.present_parameters}
    expected = mode.expected(moved) if moved else mode.by_name
    return {
        name: float(np.clip(value, *(np.nextafter(bound, value) for bound in priors[name].bounds)))
        for name, value in expected.items()
        if name in priors
    }


def _with_mass(posterior: Posterior, mode: Mode, stated: float | None, mass: float | None) -> Mode:
    """Return the mode as it moves, to first order, if the mass is not the stated one."""
    if stated is None or mass is None:
        return mode
    known = Parameter(MASS, "kg", "m", Normal(stated, stated))
    present = None if posterior.present is None else np.append(posterior.present, 1.0)
    wider = replace(posterior, parameters=(*posterior.parameters, known), present=present, guess=None)
    information = np.asarray(likelihood_slopes(wider, np.append(mode.values, stated)).information)
    slope = mode.sd / np.sqrt(np.diag(mode.cov))
    cov = mode.cov * np.outer(slope, slope)
    return mode._replace(values=mode.values - cov @ information[:-1, -1] * (mass - stated))


def _distance(mode: Mode, sd: Mapping[str, float], moved: Mapping[str, float], follow: bool) -> float:
    """Return how far moved values are from the best ones, in standard deviations; the correlations are those of the mode."""
    size = np.sqrt(np.diag(mode.cov))
    correlation = mode.cov / np.outer(size, size)
    at = np.array([mode.names.index(name) for name in moved], int)
    off = np.array([(value - mode.by_name[name]) / sd[name] for name, value in moved.items()])
    block = correlation[np.ix_(at, at)]
    if not follow:  # (S^-1)_aa is the inverse of what is left of S_aa once the others are known
        rest = np.delete(np.arange(len(size)), at)
        across = correlation[np.ix_(rest, at)]
        block = block - across.T @ np.linalg.lstsq(correlation[np.ix_(rest, rest)], across)[0]
    return float(np.sqrt(max(0.0, off @ np.linalg.lstsq(block, off)[0]))) if at.size else 0.0


def _of_record(alone: Posterior, label: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return the values of the parameters of one trial, named as those of `ANY_TRIAL`."""
    known = {name.replace(f"[{label}]", f"[{ANY_TRIAL}]"): value for name, value in values.items()}
    first = dict(zip(alone.likelihood.model.states, np.asarray(alone.data.initial)[0], strict=True))
    columns = {name: np.array([value]) for name, value in known.items()}
    unseen = [one for one in alone.present_parameters if one.name not in known]
    return known | {one.name: float(prior_of_unseen(one, first, columns, {}).mean) for one in unseen}


def _points(posterior: Posterior, values: Sequence[Mapping[str, float]], stated: float | None) -> tuple:
    points = np.array([[one.get(name, 0.0) for name in posterior.names] for one in values])
    return points, None if stated is None else np.array([one[MASS] for one in values])


@program
def _outcomes(
    alone: Posterior, points: Float[Array, "k d"], masses: Float[Array, " k"] | None
) -> tuple[Float[Array, "k n m"], Float[Array, " k"]]:
    """Return what the sensors show of one trial, but for their noise, and its log-likelihood, at several points."""

    def of_point(values: dict[str, Array]) -> tuple[Array, Array]:
        shown = motions(alone.likelihood.output, values, alone.data, jax.random.key(0))[
            0
        ]  # no process noise, no use of the key
        return shown, alone.likelihood(values, alone.data)

    return jax.vmap(of_point)(_named(alone, points, masses))


@program
def _log_likelihoods(
    posterior: Posterior, points: Float[Array, "k d"], masses: Float[Array, " k"] | None
) -> Float[Array, " k"]:
    return jax.vmap(lambda values: posterior.likelihood(values, posterior.data))(_named(posterior, points, masses))


def _named(posterior: Posterior, points: Array, masses: Array | None) -> dict[str, Array]:
    named = dict(zip(posterior.names, jnp.asarray(points).T, strict=True))
    return named if masses is None else {**named, MASS: masses}


def _explained(measured: Float[np.ndarray, "n m"], mean: Float[np.ndarray, "n m"]) -> Float[np.ndarray, " m"]:
    """Return the share of the variance of each channel that is explained."""
    there = np.isfinite(measured)
    count = np.maximum(there.sum(0), 1)
    about = np.where(there, measured - np.where(there, measured, 0.0).sum(0) / count, 0.0)
    total, left = (about**2).sum(0), np.where(there, measured - mean, 0.0)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where(total > 0.0, 1.0 - (left**2).sum(0) / np.where(total > 0.0, total, 1.0), np.nan)
