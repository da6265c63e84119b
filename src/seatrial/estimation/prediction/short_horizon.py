"""How well a record is predicted over short horizons, from its measured state again and again, where the whole of it is not.

Beside each share explained stands that of holding the value measured at the restart, since one sample ahead nearly any model is right.
Whether the vehicle leaves its course by itself is asked of the model: how a small error of the start grows along the record.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.core.record import Record
from seatrial.core.signals import RATES
from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.estimation.simulation.simulator import CURRENT, Simulator

HORIZON, MAX_RECORD_SHARE = 10.0, 0.1  # Longest horizon, s, and the share of a record that it is at most
MIN_STEPS = 3  # Samples of a horizon, at least
# Share of variance explained over short horizons from which on the model is right for as long as these
MIN_EXPLAINED = 0.8
MIN_GROWTH = 3.0  # Growth of a small error along a record from which on a vehicle leaves its course by itself


@dataclass(frozen=True)
class ShortHorizon:
    """How one channel is predicted from states measured along the way.

    Attributes:
        horizon: s.
        explained: share of the channel's variance explained over horizons of that length, one after another.
        held: the same of holding the value measured at each restart.
        one_step: share explained one sample ahead.
        one_step_held: the same of holding the value.
        growth: by how much a small error of the start grows along the record in the model; infinite where it runs away.
    """

    horizon: float
    explained: float
    held: float
    one_step: float
    one_step_held: float
    growth: float

    @property
    def leaves(self) -> bool:
        """Whether the vehicle leaves its course by itself, and is well predicted until it has."""
        return self.growth >= MIN_GROWTH and self.is_good

    @property
    def is_good(self) -> bool:
        """Whether nearly all of the motion is explained over the horizon, and more than by holding the measured value."""
        return self.explained >= MIN_EXPLAINED and self.explained > self.held


def short_horizons(
    simulator: Simulator, values: Mapping[str, float], record: Record, starts_over_ground: bool = False
) -> dict[str, ShortHorizon] | None:
    """Predict a record from its measured states over a short horizon and one sample ahead.

    Args:
        simulator: vehicle and sensors.
        values: of all parameters by name, SI.
        record: with channels for the sensors.
        starts_over_ground: whether measured speeds are over ground, so that the current is taken off them.

    Returns:
        the scores of each sensor's channel that moves; None where a state is not measured, or the record is too short.
    """
    states = simulator.model.states
    if not set(states) <= set(record.measured) or record.time.size < 2:
        return None
    start = np.column_stack([record.channel(state) for state in states])
    if simulator.current and starts_over_ground:
        start[:, states.index("u")] -= values[CURRENT]
    control = [record.channel(name) for name in simulator.model.controls]
    if simulator.delay:
        samples = np.asarray(values["delay"] / record.step[0])
        control = [np.asarray(delay_control(column, samples)) for column in control]
    direct = replace(simulator, delay=False)
    horizon = min(HORIZON, MAX_RECORD_SHARE * float(record.time[-1] - record.time[0]))
    steps = round(horizon / float(np.median(record.step)))
    known = np.flatnonzero(np.isfinite(start).all(axis=1))
    if steps < MIN_STEPS or not known.size:
        return None
    measured = np.column_stack([record.channel(sensor.channel) for sensor in simulator.sensors])
    # Restarts at least so many steps apart.
    chosen = []
    for index in known:
        if not chosen or index - chosen[-1] >= steps:
            chosen.append(int(index))
    over, over_held = _errors(direct, values, start, control, record.step, measured, np.array(chosen), steps)
    next_, next_held = _errors(direct, values, start, control, record.step, measured, known, 1)
    growth = _growth(
        direct, values, start[known[0]], [column[known[0] :] for column in control], record.step[known[0] :]
    )
    result = {}
    for column, sensor in enumerate(simulator.sensors):
        y = measured[:, column]
        variance = float(np.nanvar(y))
        shares: list[float] = (
            [1.0 - _mean_square(errors[:, column]) / variance for errors in (over, over_held, next_, next_held)]
            if variance
            else []
        )
        if shares and np.isfinite(shares).all():
            result[sensor.channel] = ShortHorizon(horizon, shares[0], shares[1], shares[2], shares[3], growth)
    return result or None


def _errors(
    simulator: Simulator,
    values: Mapping[str, float],
    start: Float[np.ndarray, "n states"],
    control: list[np.ndarray],
    step: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, "n m"],
    restarts: np.ndarray,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of the prediction and of holding the value, `steps` samples after each restart, shape (k, m), NaN where unmeasured."""
    rows = restarts[:, None] + np.arange(steps + 1)
    inside = rows < len(step)
    rows = np.minimum(rows, len(step) - 1)
    padded = filled(rows, bucket_length(len(rows)))
    steps_taken = np.where(filled(inside, len(padded)), step[padded], 0.0)
    shown = _pieces(
        simulator, dict(values), start[padded[:, 0]], tuple(column[padded] for column in control), steps_taken
    )
    shown = np.asarray(shown)[: len(rows), 1:]
    later = np.where(inside[:, 1:, None], measured[rows[:, 1:]], np.nan)
    held = later - measured[rows[:, :1]]
    return (later - shown).reshape(-1, measured.shape[1]), held.reshape(-1, measured.shape[1])


def _growth(
    simulator: Simulator,
    values: Mapping[str, float],
    start: Float[np.ndarray, " states"],
    control: list[np.ndarray],
    step: Float[np.ndarray, " n"],
) -> float:
    """Return the largest growth of a small error of one state, seen in the rates: over the last tenth beside the first."""
    rates = [index for index, sensor in enumerate(simulator.sensors) if sensor.channel in RATES]
    if not rates:
        return 1.0
    n, size = len(step), bucket_length(len(step))
    starts = np.vstack([start, start + 1e-4 * np.diag(np.maximum(np.abs(start), 1e-2))])
    columns = tuple(np.broadcast_to(filled(column, size), (len(starts), size)) for column in control)
    shown = np.asarray(
        _pieces(simulator, dict(values), starts, columns, np.broadcast_to(filled(step, size, 0.0), (len(starts), size)))
    )[:, :n, rates]
    if not np.isfinite(shown).all():
        return float("inf")
    moved = np.sqrt(np.sum((shown[1:] - shown[0]) ** 2, axis=2))
    tenth = max(1, n // 10)
    early, late = moved[:, :tenth].max(axis=1), moved[:, -tenth:].max(axis=1)
    return float(np.max(late / np.maximum(early, 1e-300)))


def _mean_square(errors: Float[np.ndarray, " k"]) -> float:
    """Mean square of what is there; infinite where a prediction runs away, NaN where nothing is there."""
    there = errors[~np.isnan(errors)]
    with np.errstate(over="ignore"):
        return float(np.mean(there**2)) if there.size else float("nan")


@program(static_argnums=0)
def _pieces(
    simulator: Simulator,
    values: Mapping[str, Array],
    starts: Float[Array, "k states"],
    control: tuple[Float[Array, "k n"], ...],
    step: Float[Array, "k n"],
) -> Float[Array, "k n m"]:
    """Outputs of many short simulations."""
    return jax.vmap(lambda start, columns, h: simulator.outputs(values, start, columns, h))(
        jnp.asarray(starts), control, step
    )
