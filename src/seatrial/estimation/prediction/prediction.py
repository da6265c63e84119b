"""What a record should show by draws of a posterior: its motion in free simulation, from its inputs alone, and the noise of its sensors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_count, check_kind
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.result_table import table_html, table_text
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.output_error import OutputError, is_deviation, of_deviation, spread_name
from seatrial.estimation.posterior.posterior import Parameter, Posterior, as_key, check_posterior
from seatrial.estimation.posterior.replicate import motions, replicate
from seatrial.estimation.prediction.prediction_scores import Score, SlowNoise, score_channel
from seatrial.estimation.priors import Normal, Prior
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    noise_name,
)
from seatrial.estimation.simulation.starts import start_of
from seatrial.estimation.simulation.trial_data import TrialData, stack_trials
from seatrial.sampling.run import Draws

if TYPE_CHECKING:
    from pandas import DataFrame

ANY = "any"  # Label that stands for every record's, so that records of one length share compiled code


@dataclass(frozen=True, eq=False)
class Prediction:
    """A record as draws of a posterior predict it; n samples, m channels.

    Attributes:
        record: what was predicted.
        channels: measured channels, in the order of the columns.
        mean: SI, shape (n, m).
        motion_sd: standard deviation of the motion, for the parameters are uncertain, SI, shape (n, m).
        noise_sd: of each sensor's noise, SI, shape (m,).
        slow: what is slow in each sensor's noise; None where it is white.
    """

    record: Record
    channels: tuple[str, ...]
    mean: Float[np.ndarray, "n m"]
    motion_sd: Float[np.ndarray, "n m"]
    noise_sd: Float[np.ndarray, " m"]
    slow: tuple[SlowNoise | None, ...]

    @property
    def sd(self) -> Float[np.ndarray, "n m"]:
        """Standard deviation of a measurement about the mean, SI, shape (n, m)."""
        return np.hypot(self.motion_sd, self.noise_sd)

    def summary(self) -> "DataFrame":
        """Return a table with a row for each channel: samples, share of the variance explained, root mean square error, SI, share
        of samples inside the 90 % band."""
        from pandas import DataFrame

        scores = [self.score(name) for name in self.channels]
        columns = {key: [getattr(one, key) for one in scores] for key in ("samples", "explained", "rmse", "coverage")}
        units = [signal_unit(name) for name in self.channels]
        return DataFrame({"unit": units, **columns}, index=list(self.channels))

    @property
    def _heading(self) -> str:
        return f'Prediction of record "{self.record.label}"'

    @property
    def _remarks(self) -> tuple[str, ...]:
        return ()

    __repr__ = table_text
    _repr_html_ = table_html

    def score(self, channel: str) -> Score:
        """Return how well a measured channel was predicted.

        Args:
            channel: one of `channels`.

        Raises:
            InputError: no such channel.
        """
        if channel not in self.channels:
            raise InputError(
                "prediction",
                found=f'channel "{channel}"',
                expected="one of " + ", ".join(self.channels),
                remedy="only channels of the posterior's sensors are predicted",
            )
        at = self.channels.index(channel)
        return score_channel(
            self.record.time,
            self.record.channel(channel),
            self.mean[:, at],
            self.motion_sd[:, at],
            noise_sd=float(self.noise_sd[at]),
            slow=self.slow[at],
        )


def predict(
    posterior: Posterior,
    draws: Draws,
    record: Record,
    *,
    start: Mapping[str, float] | None = None,
    n: int = 200,
    key: jax.Array | int = 0,
) -> Prediction:
    """Predict a record by free simulation with draws of a posterior of `make_posterior`.

    Args:
        posterior: of the records that were fitted.
        draws: of it.
        record: one of these, or another one. What only its own trial would tell, such as its own bias, is drawn from its prior.
        start: state at the first sample, as far as it is known better than by its first measurement; signal name to SI value.
        n: draws that are simulated, at most.
        key: random key, or a seed.

    Returns:
        the mean and the standard deviations of every measured channel at the n times of the record, SI.

    Raises:
        InputError: a posterior of no records, draws of another one, or a control, channel or start that the record lacks.
    """
    alone, data, values = _ready(posterior, draws, record, start, n, as_key(key))
    shown = np.asarray(outputs_of_draws(alone)(values, data, as_key(key)))[:, : record.time.size]
    sensors = _sensors(posterior)
    noise = np.column_stack([noise_sd(sensor, values) for sensor in sensors])
    return Prediction(
        record,
        posterior.likelihood.channels,
        shown.mean(axis=0),
        shown.std(axis=0),
        np.sqrt((noise**2).mean(axis=0)),
        tuple(slow_noise(sensor, values) for sensor in sensors),
    )


def replicate_record(
    posterior: Posterior,
    draws: Draws,
    record: Record,
    *,
    start: Mapping[str, float] | None = None,
    n: int = 200,
    key: jax.Array | int = 0,
) -> Float[np.ndarray, "draws n m"]:
    """Draw measurements of a record, the noise of the sensors included, one for each of n draws of the posterior.

    Arguments and errors as those of `predict`.

    Returns:
        measurements of every channel at the times of the record, SI; 0 where the record has none.
    """
    alone, data, values = _ready(posterior, draws, record, start, n, as_key(key))
    return np.asarray(replicates_of_draws(alone)(values, data, as_key(key)))[:, : record.time.size]


def spread_rows(draws: Float[np.ndarray, "draws d"], most: int) -> Float[np.ndarray, "kept d"]:
    """Return rows that are spread evenly over all, as many as `most` at most."""
    return draws[:: max(1, len(draws) // most)][:most]


def noise_sd(sensor: Sensor, values: Mapping[str, Any]) -> np.ndarray:
    """Return the standard deviation of a sensor's noise under each draw; Student's t of few degrees of freedom counts as of three."""
    sd = np.asarray(values[noise_name(sensor.channel)])
    match sensor.noise:
        case "white" | "coloured":
            return sd
        case "heavy":
            dof = np.maximum(np.asarray(values[dof_name(sensor.channel)]), 3.0)
            return sd * np.sqrt(dof / (dof - 2.0))
        case "drifting":
            return np.hypot(sd, np.asarray(values[drift_name(sensor.channel)]))


def slow_noise(sensor: Sensor, values: Mapping[str, Any]) -> SlowNoise | None:
    """Return what is slow in a sensor's noise, medians over draws; None where nothing is."""
    match sensor.noise:
        case "white" | "heavy":
            return None
        case "coloured":
            return SlowNoise(float(np.median(values[correlation_name(sensor.channel)])), 1.0)
        case "drifting":
            share = (np.asarray(values[drift_name(sensor.channel)]) / noise_sd(sensor, values)) ** 2
            return SlowNoise(float(np.median(values[drift_time_name(sensor.channel)])), float(np.median(share)))


@lru_cache(maxsize=16)
def outputs_of_draws(likelihood: OutputError | FilterError):
    """Return the compiled function of draws' values, the data of one trial and a key: outputs, shape (draws, n, m)."""

    @program
    def of_draws(values: Mapping[str, Any], data: TrialData, key: jax.Array) -> jax.Array:
        keys = jax.random.split(key, 1 + jax.tree.leaves(values)[0].shape[0])
        return jax.vmap(lambda one, key: motions(likelihood, one, data, key)[0])(values, keys[1:])

    return of_draws


@lru_cache(maxsize=16)
def replicates_of_draws(likelihood: OutputError | FilterError):
    """Return the compiled function of draws' values, the data of one trial and a key: measurements, shape (draws, n, m)."""

    @program
    def of_draws(values: Mapping[str, Any], data: TrialData, key: jax.Array) -> jax.Array:
        keys = jax.random.split(key, 1 + jax.tree.leaves(values)[0].shape[0])

        def of_draw(one: Mapping[str, Any], key: jax.Array) -> jax.Array:
            channels = replicate(likelihood, one, data, key).channels
            return jnp.stack([channel.measured[0] for channel in channels], -1)

        return jax.vmap(of_draw)(values, keys[1:])

    return of_draws


def key_of_values(key: jax.Array, draws: int) -> jax.Array:
    """Return the key of what a trial's own values are drawn with, beside those of `outputs_of_draws` for so many draws."""
    return jax.random.split(key, 1 + draws)[0]


def _sensors(posterior: Posterior) -> tuple[Sensor, ...]:
    likelihood = posterior.likelihood
    return (likelihood if isinstance(likelihood, OutputError) else likelihood.output).simulator.sensors


def _ready(
    posterior: Posterior, draws: Draws, record: Record, start: Mapping[str, float] | None, n: int, key: jax.Array
) -> tuple[OutputError | FilterError, TrialData, dict[str, jax.Array]]:
    """Return the likelihood of one record, its data, and the values of n draws of the posterior by name."""
    check_posterior(posterior)
    check_kind(draws, Draws, "draws", "draw them with `sample`")
    check_kind(record, Record, "record", "read it with `read_log`, or make it with `make_record` or `simulate`")
    check_count(n, "n", remedy="simulate a hundred draws or more")
    likelihood = posterior.likelihood
    if not isinstance(likelihood, OutputError | FilterError):
        raise InputError(
            "posterior",
            found="a log density of one's own",
            expected="a posterior of records, of `make_posterior`",
            remedy="simulate with the draws themselves",
        )
    if draws.names != posterior.names:
        raise InputError(
            "draws",
            found=", ".join(draws.names),
            expected="the parameters of the posterior: " + ", ".join(posterior.names),
            remedy="give the draws that were taken of this posterior",
        )
    output = likelihood if isinstance(likelihood, OutputError) else likelihood.output
    first = start_of(likelihood.model, record, start, output.free_initial)
    data = stack_trials([record], likelihood.model, likelihood.channels, [first])
    table = spread_rows(draws.array(), n)
    known = dict(zip(draws.names, table.T, strict=True))
    starts = dict(zip(likelihood.model.states, first, strict=True))
    values = _values_of(posterior, record.label, starts, known, key)
    anonymous = replace(output, labels=(ANY,))
    return anonymous if isinstance(likelihood, OutputError) else replace(likelihood, output=anonymous), data, values


def _values_of(
    posterior: Posterior, label: str, first: Mapping[str, float], known: Mapping[str, np.ndarray], key: jax.Array
) -> dict[str, jax.Array]:
    """Return the values of every parameter under each draw, those of one trial under the label `ANY`."""
    labels, count = posterior.likelihood.labels, len(next(iter(known.values())))
    own = label if label in labels else labels[0]
    values, priors = {}, {parameter.name: parameter.prior for parameter in posterior.parameters}
    for index, parameter in enumerate(posterior.parameters):
        name, is_own = _anonymous(parameter.name, own)
        if name is None:
            continue
        if is_own and own != label:
            prior, its = prior_of_unseen(parameter, first, known), jax.random.fold_in(key_of_values(key, count), index)
            values[name] = within_bounds(name, prior.draw(its, (count,)), known, priors, its)
        else:
            values[name] = known[parameter.name]
    return values


def _anonymous(name: str, label: str) -> tuple[str | None, bool]:
    """Return the name of a parameter under the label `ANY`, None if it is another trial's, and whether it is one trial's."""
    base, bracket, of = name.partition("[")
    if not bracket:
        return name, False
    return (f"{base}[{ANY}]" if of == f"{label}]" else None), True


def within_bounds(
    name: str, drawn: Any, known: Mapping[str, Any], priors: Mapping[str, Prior], key: jax.Array
) -> Float[np.ndarray, " draws"]:
    """Return draws of a parameter of a trial that was not fitted, those of a deviation cut where its coefficient has no prior density.

    A deviation that leads beyond a bound is drawn again from the normal between the bounds: all follow the normal that is cut there.

    Args:
        name: of the parameter, which ends in the label of the trial.
        drawn: from its prior, shape (draws,).
        known: draws of all trials' parameters by name.
        priors: of these.
        key: random key of the draws.
    """
    if not is_deviation(name):
        return np.asarray(drawn)
    varying, _ = of_deviation(name)
    spread = np.maximum(np.asarray(known[spread_name(varying)]), np.finfo(float).tiny)
    low, high = (ndtr((bound - np.asarray(known[varying])) / spread) for bound in priors[varying].bounds)
    share = np.asarray(jax.random.uniform(jax.random.fold_in(key, 1), spread.shape, minval=1e-12))
    probability = ndtr(np.asarray(drawn))
    inside = (low <= probability) & (probability <= high)
    return np.where(inside, drawn, ndtri(low + share * (high - low)))


def prior_of_unseen(parameter: Parameter, first: Mapping[str, float], known: Mapping[str, np.ndarray]) -> Any:
    """Return the prior of the own parameter of a trial that was not fitted; an initial state lies about its first measurement.

    Args:
        parameter: of that trial alone, by a name that ends in its label.
        first: its first measurement of each state, SI.
        known: draws of all trials' parameters by name, of which the noise says how near to it the state is.
    """
    state, _, _ = parameter.name.partition("_0[")
    if state in first and noise_name(state) in known:
        return Normal(first[state], float(np.mean(known[noise_name(state)])))
    return parameter.prior
