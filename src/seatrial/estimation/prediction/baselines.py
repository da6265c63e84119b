"""Baselines: simple predictors that a model has to beat on runs that were not fitted.

    persistence    y(t) = y(0)
    mean           y(t) = the mean of the fitted runs
    lag            T y' = sum_j K_j c_j(t - d) - y + b            each velocity by itself, all controls that move
    nomoto         T r' = K delta(t - d) - r + b                  Nomoto et al., Int. Shipbuilding Progress 4, 1957, first order
    nomoto-2       two lags of delta in parallel                  the same, second order; the poles are real
    norrbin        T r' = K delta(t - d) - r - a r^3 + b          Norrbin, SSPA report B 104-3, 1963

Each is fitted by least squares of its open-loop simulation, never one step ahead, and states one standard deviation of noise for each
channel: the root mean square of what that simulation leaves. Every run is simulated from its first measurement and its controls alone.

    fitted = BASELINES["lag"].fit(records, ["u", "r"], ["n", "delta_r"])
    fitted.predict(record)             # shape (samples, channels of fitted.channels)
    fitted.score(record)["u"].crps
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, NumericalError, located
from seatrial.core.record import Record
from seatrial.core.signals import OVER_GROUND, RATES
from seatrial.estimation.prediction.lag_response import Lags, Run, fit_cubic, fit_lags
from seatrial.estimation.prediction.prediction_scores import PredictedRun, Score, score_channel

VELOCITIES = (*RATES, *OVER_GROUND)  # Channels that a lag predicts
# Controls that are taken to steer where a vehicle has them; otherwise the one that explains the yaw rate best.
RUDDERS = ("delta_r", "tau_N")
ROWS_EACH = 5  # Measured samples for each unknown, below which nothing is fitted
# Least standard deviation that is stated, in ranges of the channel: records without noise are fitted to rounding.
SMALLEST = 1e-9


class Law(Protocol):
    """What predicts one channel."""

    def simulate(self, run: Run, start: int = 0) -> Float[np.ndarray, " n"]:
        """Return the channel at every sample, from its first measurement at or after `start`."""
        ...


@dataclass(frozen=True, eq=False)
class FittedBaseline:
    """A baseline that was fitted; m channels.

    Attributes:
        name: of the baseline.
        channels: what it predicts, of those that were asked for.
        noise_sd: standard deviation of a measurement about the prediction, SI, shape (m,).
        parameters: value of each parameter, SI, by a name such as `T[r]` or `K[r, delta_r]`.
        simulate: means of a run from a sample on, SI, shape (n, m).
    """

    name: str
    channels: tuple[str, ...]
    noise_sd: Float[np.ndarray, " m"]
    parameters: Mapping[str, float]
    simulate: Callable[[Record, int], Float[np.ndarray, "n m"]] = field(repr=False)

    def predict(self, record: Record, start: int = 0) -> Float[np.ndarray, "n m"]:
        """Predict a run open loop, from its controls and the first measurement of each channel at or after a sample.

        Args:
            record: run, with the controls that were fitted.
            start: index of the sample that the simulation starts from; earlier controls are known, earlier measurements are not used.

        Returns:
            means in the order of `channels`, SI, NaN before `start`, and where a channel has no measurement to start from.

        Raises:
            InputError: a control that the record lacks, or a start beyond its end.
        """
        if not 0 <= start < record.time.size:
            raise InputError(
                f'record "{record.label}"',
                found=f"start {start}",
                expected=f"the index of one of its {record.time.size} samples",
                remedy="give a smaller start",
            )
        means = self.simulate(record, start)
        means[:start] = np.nan
        return means

    def score(self, record: Record, start: int = 0) -> dict[str, Score]:
        """Score the prediction of each channel of a run, as `score_channel` does."""
        means = self.predict(record, start)[start:]
        scores = {}
        for channel, mean, noise_sd in zip(self.channels, means.T, self.noise_sd, strict=True):
            columns = record.time[start:], _measured(record, channel)[start:], mean, np.zeros(mean.size)
            scores[channel] = score_channel([PredictedRun(*columns, float(noise_sd))])
        return scores


@dataclass(frozen=True)
class Baseline:
    """A way to predict.

    Attributes:
        name: short.
        words: what it is in a sentence, such as "a linear Nomoto model".
        fit_runs: fits it to records, channels and controls; errors as `fit`.
    """

    name: str
    words: str
    fit_runs: Callable[[Sequence[Record], Sequence[str], Sequence[str]], FittedBaseline] = field(repr=False)

    def fit(self, records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
        """Fit it to some runs.

        Args:
            records: runs, of any length and step; measurements may have gaps.
            channels: measured channels to predict; what it cannot predict is left out of the result's `channels`.
            controls: channels that drive the vehicle, with a value at every sample.

        Raises:
            InputError: it cannot be fitted to these.
            NumericalError: what was fitted cannot be used, which only `seatrial.estimation.prediction.acceleration_baseline` may find.
        """
        with located(f"baseline {self.name}"):
            return self.fit_runs(records, channels, controls)


def cannot_be_fitted(reason: str) -> InputError:
    """Return the refusal to fit a baseline to some runs."""
    return InputError("runs", found=reason, expected="runs that allow a fit", remedy="choose others, or another one")


def fit_baselines(
    records: Sequence[Record],
    channels: Sequence[str],
    controls: Sequence[str],
    baselines: Sequence[Baseline] | None = None,
) -> tuple[list[FittedBaseline], dict[str, str]]:
    """Fit every baseline that applies.

    Args:
        records: runs to fit.
        channels: measured channels to predict.
        controls: channels that drive the vehicle.
        baselines: those that are tried; all of `BASELINES` if None.

    Returns:
        those that were fitted, and by name why others were not, or could not be used.
    """
    fitted, refused = [], {}
    for baseline in BASELINES.values() if baselines is None else baselines:
        try:
            fitted.append(baseline.fit(records, channels, controls))
        except InputError as error:
            refused[baseline.name] = error.found
        except NumericalError as error:
            refused[baseline.name] = str(error)
    return fitted, refused


def noise_of(
    records: Sequence[Record], channels: Sequence[str], simulate: Callable[[Record, int], np.ndarray]
) -> Float[np.ndarray, " m"]:
    """Return the root mean square of what the simulation of the fitted runs leaves of each channel, SI, shape (m,)."""
    runs = [np.column_stack([_measured(record, channel) for channel in channels]) for record in records]
    left = np.concatenate([run - simulate(record, 0) for run, record in zip(runs, records, strict=True)])
    left, measured = np.where(np.isfinite(left), left, np.nan), np.concatenate(runs)
    extent = np.nanmax(measured, 0) - np.nanmin(measured, 0)
    return np.maximum(np.sqrt(np.nanmean(left**2, 0)), SMALLEST * extent)


# What each of them is.


def _hold(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    chosen = _fitted_channels(records, channels, lambda channel: True, 1, "channel")

    def simulate(record: Record, start: int) -> np.ndarray:
        return np.column_stack([np.full(record.time.size, _first(record, channel, start)) for channel in chosen])

    return FittedBaseline("persistence", chosen, noise_of(records, chosen, simulate), {}, simulate)


def _mean(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    chosen = _fitted_channels(records, channels, lambda channel: True, 1, "channel")
    means = [float(np.nanmean(np.concatenate([_measured(one, channel) for one in records]))) for channel in chosen]

    def simulate(record: Record, start: int) -> np.ndarray:
        return np.tile(means, (record.time.size, 1))

    parameters = {f"mean[{channel}]": value for channel, value in zip(chosen, means, strict=True)}
    return FittedBaseline("mean", chosen, noise_of(records, chosen, simulate), parameters, simulate)


def _lag(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    moving = _moving(records, controls)
    chosen = _fitted_channels(records, channels, _is_velocity, 3 + len(moving), "velocity")
    _check_driving(records, controls)
    laws = {channel: fit_lags(_runs(records, channel, moving)) for channel in chosen}
    parameters = {}
    for channel, law in laws.items():
        gains = {f"K[{channel}, {control}]": float(gain) for control, gain in zip(moving, law.gains[0], strict=True)}
        parameters |= {
            f"T[{channel}]": law.time_constants[0],
            **gains,
            f"d[{channel}]": law.delay,
            f"b[{channel}]": law.offset,
        }
    return _of_laws("lag", laws, moving, parameters, records)


def _nomoto(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    rudder, law = _steered(records, channels, controls, 4)
    parameters = {"T": law.time_constants[0], "K": float(law.gains[0, 0]), "d": law.delay, "b": law.offset}
    return _of_laws("nomoto", {"r": law}, (rudder,), parameters, records)


def _nomoto_second(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    rudder, _ = _steered(records, channels, controls, 6)
    law = fit_lags(_runs(records, "r", (rudder,)), order=2)
    (t1, t2), (k1, k2) = law.time_constants, law.gains[:, 0].tolist()
    parameters = {"T1": t1, "T2": t2, "K": k1 + k2, "K T3": k1 * t2 + k2 * t1, "d": law.delay, "b": law.offset}
    return _of_laws("nomoto-2", {"r": law}, (rudder,), parameters, records)


def _norrbin(records: Sequence[Record], channels: Sequence[str], controls: Sequence[str]) -> FittedBaseline:
    rudder, linear = _steered(records, channels, controls, 5)
    law = fit_cubic(_runs(records, "r", (rudder,)), linear)
    parameters = {
        "K/T": law.gain,
        "1/T": law.linear,
        "a/T": law.cubic,
        "d": law.delay,
        "b/T": law.offset,
    }
    return _of_laws("norrbin", {"r": law}, (rudder,), parameters, records)


# Baselines that need no vehicle, by name.
BASELINES = {
    one.name: one
    for one in (
        Baseline("persistence", "the first measurement, held", _hold),
        Baseline("mean", "the mean of the fitted runs", _mean),
        Baseline("lag", "a first-order lag of the controls", _lag),
        Baseline("nomoto", "a linear Nomoto model", _nomoto),
        Baseline("nomoto-2", "a second-order Nomoto model", _nomoto_second),
        Baseline("norrbin", "a cubic Nomoto model", _norrbin),
    )
}


def _is_velocity(channel: str) -> bool:
    return channel in VELOCITIES


def _steered(
    records: Sequence[Record], channels: Sequence[str], controls: Sequence[str], unknowns: int
) -> tuple[str, Lags]:
    """Return the control that steers, and the first-order lag of the yaw rate behind it."""
    _fitted_channels(records, channels, lambda channel: channel == "r", unknowns, "yaw rate r")
    _check_driving(records, controls)
    moving = _moving(records, controls)
    named = [name for name in RUDDERS if name in moving]
    tried = {name: fit_lags(_runs(records, "r", (name,))) for name in (named[:1] or moving)}

    def left(name: str) -> float:
        runs = _runs(records, "r", (name,))
        return sum(float(np.nansum((run.measured - tried[name].simulate(run)) ** 2)) for run in runs)

    best = min(tried, key=left)
    return best, tried[best]


def _of_laws(
    name: str,
    laws: Mapping[str, Law],
    controls: Sequence[str],
    parameters: Mapping[str, float],
    records: Sequence[Record],
) -> FittedBaseline:
    """Return what predicts each channel by its own law."""

    def simulate(record: Record, start: int) -> np.ndarray:
        runs = {channel: _run(record, channel, controls) for channel in laws}
        return np.column_stack(
            [
                law.simulate(runs[channel], start)
                if np.isfinite(runs[channel].measured[start:]).any()
                else np.full(record.time.size, np.nan)
                for channel, law in laws.items()
            ]
        )

    channels = tuple(laws)
    return FittedBaseline(name, channels, noise_of(records, channels, simulate), dict(parameters), simulate)


# What records hold.


def _measured(record: Record, channel: str) -> np.ndarray:
    """Return a measured channel, all NaN if the record lacks it."""
    return record.channel(channel) if channel in record.measured else np.full(record.time.size, np.nan)


def _run(record: Record, channel: str, controls: Sequence[str]) -> Run:
    control = np.column_stack([record.channel(name) for name in controls])
    return Run(record.time - record.time[0], control, _measured(record, channel))


def _runs(records: Sequence[Record], channel: str, controls: Sequence[str]) -> list[Run]:
    """Return the runs that measure a channel."""
    runs = [_run(record, channel, controls) for record in records]
    return [run for run in runs if run.there.size]


def _first(record: Record, channel: str, start: int) -> float:
    """Return the first measurement at or after a sample, NaN if there is none."""
    later = _measured(record, channel)[start:]
    known = later[np.isfinite(later)]
    return float(known[0]) if known.size else np.nan


def _fitted_channels(
    records: Sequence[Record], channels: Sequence[str], wanted: Callable[[str], bool], unknowns: int, what: str
) -> tuple[str, ...]:
    """Return the channels of a kind that are measured often enough for so many unknowns.

    Raises:
        InputError: no such channel.
    """
    if not records:
        raise cannot_be_fitted("there is no run to fit")
    count = {
        one: sum(int(np.isfinite(_measured(record, one)).sum()) for record in records)
        for one in channels
        if wanted(one)
    }
    if not count:
        raise cannot_be_fitted(f"no {what} is among the channels {', '.join(channels)}")
    most = max(count, key=lambda channel: count[channel])
    if count[most] < ROWS_EACH * unknowns:
        raise cannot_be_fitted(
            f"{most} has {count[most]} measured samples, fewer than {ROWS_EACH} for each of {unknowns} unknowns"
        )
    return tuple(one for one in count if count[one] >= ROWS_EACH * unknowns)


def _moving(records: Sequence[Record], controls: Sequence[str]) -> tuple[str, ...]:
    """Return the controls that are not the same in every sample of every run."""
    columns = {name: np.concatenate([one.channel(name) for one in records]) for name in controls} if records else {}
    return tuple(name for name, column in columns.items() if np.ptp(column) > 0)


def _check_driving(records: Sequence[Record], controls: Sequence[str]) -> None:
    """Refuse controls that cannot drive anything."""
    for name in controls:
        if any(not np.isfinite(one.channel(name)).all() for one in records):
            raise cannot_be_fitted(f"{name} has gaps, but an input must be known at every sample")
    if not _moving(records, controls):
        raise cannot_be_fitted("no control moves in the runs that are fitted")
