"""What a record should show by draws of a posterior: its motion in free simulation, from its inputs alone, and the noise of its sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float, Int

from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import fold_in
from seatrial.core.argument_checks import check_count, check_kind
from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.result_table import table_html, table_text
from seatrial.core.signals import signal_unit
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.output_error import ANY_TRIAL, OutputError, is_deviation, of_deviation, spread_name
from seatrial.estimation.posterior.posterior import Parameter, Posterior, as_key, check_posterior
from seatrial.estimation.posterior.record_posterior import starts_of
from seatrial.estimation.posterior.replicate import motions, replicate
from seatrial.estimation.prediction.prediction_scores import PredictedRun, Score, SlowNoise, score_channel
from seatrial.estimation.priors import Normal, Prior
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    dof_name,
    drift_name,
    drift_time_name,
    noise_name,
    share_name,
)
from seatrial.estimation.simulation.trial_data import TrialData, stack_trials
from seatrial.sampling.run import Draws

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Prediction:
    """A record as draws of a posterior predict it; n samples, m channels.

    Attributes:
        record: the predicted one.
        channels: measured channels, in the order of the columns.
        mean: SI, shape (n, m).
        motion_sd: standard deviation of the motion from uncertain parameters, SI, shape (n, m).
        noise_sd: of each sensor's noise, SI, shape (n, m).
        slow: the slow part of the noise of each sensor; None if it is white.
        coefficient_sd: the part of `motion_sd` that is not process noise, SI, shape (n, m).
        likelihood: that simulated.
        values: mean of each parameter, SI; those of only this trial have the label `ANY_TRIAL`.
    """

    record: Record
    channels: tuple[str, ...]
    mean: Float[np.ndarray, "n m"]
    motion_sd: Float[np.ndarray, "n m"]
    noise_sd: Float[np.ndarray, "n m"]
    slow: tuple[SlowNoise | None, ...]
    coefficient_sd: Float[np.ndarray, "n m"]
    likelihood: OutputError | FilterError
    values: Mapping[str, float]

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """Times of the record, s."""
        return self.record.time

    @property
    def measured(self) -> Float[np.ndarray, "n m"]:
        """Measurements of the record, SI, NaN if there is none."""
        return np.column_stack([self.record.channel(name) for name in self.channels])

    @property
    def is_filtered(self) -> bool:
        """Whether process noise was drawn."""
        return isinstance(self.likelihood, FilterError)

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
        """Return how well a measured channel was predicted; argument and errors as `run`."""
        score = score_channel([self.run(channel)])
        # Process noise correlates the residuals of a free simulation, also where it is right; the innovations of the filter test it.
        return replace(score, white=1.0, sd_factor=1.0) if self.is_filtered else score

    def run(self, channel: str) -> PredictedRun:
        """Return a measured channel and its prediction, as scores of several runs together need them.

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
        columns = (self.record.channel(channel), self.mean[:, at], self.motion_sd[:, at])
        return PredictedRun(self.time, *columns, self.noise_sd[:, at], self.slow[at], self.coefficient_sd[:, at])


def predict(
    posterior: Posterior,
    draws: Draws | Mapping[str, Float[np.ndarray, " draws"]],
    record: Record,
    *,
    start: Mapping[str, float] | Sequence[float] | None = None,
    first_sd: Mapping[str, float] | None = None,
    n: int = 200,
    key: jax.Array | int = 0,
) -> Prediction:
    """Predict a record by free simulation with draws of a posterior of `make_posterior`.

    Args:
        posterior: of the records that were fitted.
        draws: of it; or those of each parameter by name, SI.
        record: one of these, or another one. What only its own trial would tell, such as its own bias, is drawn from its prior.
        start: state at the first sample, if it is known better than by its first measurement; signal name to SI value. Or the
            whole state, SI, in the order of the states of the vehicle.
        first_sd: how well each state is known at the start of a record that was not fitted, where starts are unknown, SI; if not
            given, as well as its sensor measures it.
        n: draws that are simulated, at most.
        key: random key, or a seed.

    Returns:
        the mean and the standard deviations of every measured channel at the n times of the record, SI.

    Raises:
        InputError: a posterior of no records, draws of another one, or a control, channel or start that the record lacks.
    """
    key = as_key(key)
    alone, values = posterior_of_record(posterior, draws, record, start, first_sd, n, key)

    def simulated(likelihood: OutputError | FilterError) -> np.ndarray:
        return np.asarray(outputs_of_draws(likelihood)(values, alone.data, key))[:, : record.time.size]

    likelihood = alone.likelihood
    outputs = simulated(likelihood)
    motion_sd = outputs.std(axis=0)
    sensors = likelihood.output.simulator.sensors
    noise = np.stack([mean_noise_sd(sensor, values, one) for sensor, one in zip(sensors, outputs.T, strict=True)], -1)
    return Prediction(
        record,
        likelihood.channels,
        outputs.mean(axis=0),
        motion_sd,
        noise,
        tuple(slow_noise(sensor, values) for sensor in sensors),
        motion_sd if likelihood is likelihood.output else simulated(likelihood.output).std(axis=0),
        likelihood,
        {name: float(np.mean(column)) for name, column in values.items()},
    )


def offsets_at_zero(draws: Mapping[str, Float[np.ndarray, " draws"]]) -> dict[str, Float[np.ndarray, " draws"]]:
    """Return draws for a run of another day: a constant force whose 90 % interval contains zero is zero, with the spread it had.

    Trim, a tether or a slope of the current differ from day to day, and one that is hardly seen says nothing of the next. Other parameters
    follow as the draws say that they do where that force is zero.

    Args:
        draws: of each parameter by name, SI.
    """
    terms = {name: name.partition("@")[0] for name in draws}
    constant = [
        name for name, term in terms.items() if is_coefficient(term) and not CoefficientName.parse(term).factors
    ]
    near = [name for name in constant if np.prod(np.quantile(draws[name], (0.05, 0.95))) < 0]
    if not near:
        return dict(draws)
    offsets = np.array([draws[name] for name in near])
    mean = offsets.mean(1)
    cov = np.atleast_2d(np.cov(offsets))

    def moved(column: np.ndarray) -> np.ndarray:
        with_offsets = (offsets - mean[:, None]) @ (column - column.mean()) / (column.size - 1)
        return column - np.linalg.lstsq(cov, with_offsets)[0] @ mean

    return {name: moved(np.asarray(column)) for name, column in draws.items()}


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
        measurements of every channel at the times of the record, SI; 0 if the record has none.
    """
    key = as_key(key)
    alone, values = posterior_of_record(posterior, draws, record, start, None, n, key)
    return np.asarray(replicates_of_draws(alone.likelihood)(values, alone.data, key))[:, : record.time.size]


def spread_rows(draws: Float[np.ndarray, "draws d"], most: int) -> Float[np.ndarray, "kept d"]:
    """Return rows that are spread evenly over all, as many as `most` at most."""
    return draws[:: max(1, len(draws) // most)][:most]


def mean_noise_sd(sensor: Sensor, values: Mapping[str, Any], shown: Float[np.ndarray, "n draws"]) -> np.ndarray:
    """Return the root mean square over draws of the standard deviation of a sensor's noise about what it shows, shape (n,)."""
    sd = np.broadcast_to(noise_sd(sensor, values, shown), shown.shape)
    return np.sqrt(np.mean(sd**2, -1))


def noise_sd(sensor: Sensor, values: Mapping[str, Any], shown: Float[np.ndarray, "*n draws"] | float) -> np.ndarray:
    """Return the standard deviation of a sensor's noise under each draw; Student's t of few degrees of freedom counts as of three.

    Args:
        sensor: whose noise it is.
        values: its parameters by name, SI, each of shape (draws,).
        shown: by it without noise, SI, on which noise in proportion to the signal depends.
    """
    sd = np.asarray(values[noise_name(sensor.channel)])
    match sensor.noise:
        case "white" | "coloured":
            return sd
        case "heavy":
            dof = np.maximum(np.asarray(values[dof_name(sensor.channel)]), 3.0)
            return sd * np.sqrt(dof / (dof - 2.0))
        case "proportional":
            return np.hypot(sd, np.asarray(values[share_name(sensor.channel)]) * shown)
        case "drifting":
            return np.hypot(sd, np.asarray(values[drift_name(sensor.channel)]))


def slow_noise(sensor: Sensor, values: Mapping[str, Any]) -> SlowNoise | None:
    """Return what is slow in a sensor's noise, medians over draws; None if nothing is."""
    match sensor.noise:
        case "white" | "heavy" | "proportional":
            return None
        case "coloured":
            return SlowNoise(float(np.median(values[correlation_name(sensor.channel)])), 1.0)
        case "drifting":
            share = (np.asarray(values[drift_name(sensor.channel)]) / noise_sd(sensor, values, 0.0)) ** 2
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


def records_likelihood(posterior: Posterior, remedy: str) -> OutputError | FilterError:
    """Return the likelihood of a posterior of records.

    Raises:
        InputError: no posterior, or one of a log density of one's own.
    """
    check_posterior(posterior)
    if not isinstance(posterior.likelihood, OutputError | FilterError):
        expected = "a posterior of records, of `make_posterior`"
        raise InputError("posterior", found="your log density", expected=expected, remedy=remedy)
    return posterior.likelihood


def posterior_of_record(
    posterior: Posterior,
    draws: Draws | Mapping[str, np.ndarray],
    record: Record,
    start: Mapping[str, float] | Sequence[float] | None,
    first_sd: Mapping[str, float] | None,
    n: int,
    key: jax.Array,
) -> tuple[Posterior, dict[str, np.ndarray]]:
    """Return the posterior of one record, labelled `ANY_TRIAL`, and the values of n draws of it by name; arguments as `predict`."""
    records_likelihood(posterior, "simulate with the draws by your function")
    if not isinstance(draws, Mapping):
        check_kind(draws, Draws, "draws", "draw them with `sample`")
    check_kind(record, Record, "record", "read it with `read_log`, or make it with `make_record` or `simulate`")
    check_count(n, "n", remedy="simulate a hundred draws or more")
    table = draws if isinstance(draws, Mapping) else dict(zip(draws.names, draws.array().T, strict=True))
    shared = [name for name in posterior.present_names if "[" not in name]
    if (not isinstance(draws, Mapping) and draws.names != posterior.names) or not set(shared) <= set(table):
        raise InputError(
            "draws",
            found=", ".join(table),
            expected="the parameters of the posterior: " + ", ".join(posterior.names),
            remedy="give the draws that were taken of this posterior",
        )
    known = {
        name.replace(f"[{record.label}]", f"[{ANY_TRIAL}]"): spread_rows(column, n)
        for name, column in table.items()
        if "[" not in name or name.endswith(f"[{record.label}]")
    }
    alone = record_alone(posterior, record, start)
    # Beside the keys of `outputs_of_draws`: the first of `split`, without a program compiled for it.
    return alone, values_of_draws(alone, known, fold_in(key, 0), first_sd)


def record_alone(
    posterior: Posterior, record: Record, start: Mapping[str, float] | Sequence[float] | None = None
) -> Posterior:
    """Return the posterior of one record, fitted or not, labelled `ANY_TRIAL`; arguments as `predict`."""
    likelihood, output = posterior.likelihood, posterior.likelihood.output
    if output.configurations and record.configuration not in output.configurations:
        raise InputError(
            f'record "{record.label}"',
            found=f'configuration "{record.configuration}"' if record.configuration else "no configuration",
            expected="one of those that were fitted: " + ", ".join(dict.fromkeys(output.configurations)),
            remedy=f'name it: record.in_configuration("{output.configurations[0]}"); or fit a record of it',
        )
    own = record.label if record.label in likelihood.labels else likelihood.labels[0]
    places = np.array([i for i, name in enumerate(posterior.names) if "[" not in name or name.endswith(f"[{own}]")])
    stated = start if start is None or isinstance(start, Mapping) else [start]
    starts = starts_of(likelihood.model, [record], stated, output.free_initial)
    data = stack_trials([record], likelihood.model, likelihood.channels, starts)
    return of_any_trial(posterior, own, places, data, record.configuration)


def of_any_trial(
    posterior: Posterior, label: str, places: Int[np.ndarray, " k"], data: TrialData, configuration: str
) -> Posterior:
    """Return a posterior of one trial alone, labelled `ANY_TRIAL`.

    Args:
        posterior: of several.
        label: of the trial.
        places: of its k parameters among all.
        data: its own.
        configuration: of the vehicle in the trial; of no effect if nothing differs between configurations.
    """

    def renamed(parameter: Parameter) -> Parameter:
        name, shown = (text.replace(f"[{label}]", f"[{ANY_TRIAL}]") for text in (parameter.name, parameter.label))
        return replace(parameter, name=name, label=shown)

    present = None if posterior.present is None else posterior.present[places]
    parameters = tuple(renamed(posterior.parameters[i]) for i in places)
    configurations = (configuration,) if posterior.likelihood.output.configurations else ()
    return Posterior(parameters, posterior.likelihood.labelled((ANY_TRIAL,), configurations), data, present=present)


def values_of_draws(
    alone: Posterior,
    known: Mapping[str, Float[np.ndarray, " draws"]],
    key: jax.Array,
    first_sd: Mapping[str, float] | None = None,
) -> dict[str, Float[np.ndarray, " draws"]]:
    """Return the values of every parameter of one trial under each draw: as known, else from its prior; 0 of what is absent.

    Args:
        alone: of `of_any_trial`.
        known: draws by name, of all parameters at least that are not the trial's own.
        key: random key.
        first_sd: see `predict`.
    """
    count, values = len(next(iter(known.values()))), {}
    first = dict(zip(alone.likelihood.model.states, np.asarray(alone.data.initial)[0], strict=True))
    priors = {parameter.name: parameter.prior for parameter in alone.present_parameters}
    for index, parameter in enumerate(alone.parameters):
        name = parameter.name
        if name in known or name not in priors:
            values[name] = known.get(name, np.zeros(count))
            continue
        prior, own = prior_of_unseen(parameter, first, known, first_sd or {}), jax.random.fold_in(key, index)
        values[name] = within_bounds(name, prior.draw(own, (count,)), known, priors, own)
    return values


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
    low, high = (scipy.special.ndtr((bound - np.asarray(known[varying])) / spread) for bound in priors[varying].bounds)
    share = np.asarray(jax.random.uniform(jax.random.fold_in(key, 1), spread.shape, minval=1e-12))
    probability = scipy.special.ndtr(np.asarray(drawn))
    inside = (low <= probability) & (probability <= high)
    return np.where(inside, drawn, scipy.special.ndtri(low + share * (high - low)))


def prior_of_unseen(
    parameter: Parameter, first: Mapping[str, float], known: Mapping[str, np.ndarray], first_sd: Mapping[str, float]
) -> Prior:
    """Return the prior of the own parameter of a trial that was not fitted; an initial state lies about its first measurement."""
    state, _, _ = parameter.name.partition("_0[")
    if state in first and state in first_sd:
        return Normal(float(first[state]), first_sd[state])
    if state in first and noise_name(state) in known:
        share = np.mean(known.get(share_name(state), 0.0)) * first[state]
        return Normal(float(first[state]), float(np.hypot(np.mean(known[noise_name(state)]), share)))
    return parameter.prior
