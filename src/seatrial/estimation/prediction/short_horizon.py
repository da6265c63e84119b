"""How well a record is forecast over short horizons, where the whole of it is not, and whether the model leaves its course by itself.

Beside each share explained stands that of holding the value measured where a forecast begins, since one sample ahead nearly any model is
right. About a steady motion an error of the model grows or fades as e^(s t), with s the eigenvalues of its derivative there (Routh).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from seatrial.compiled.programs import program
from seatrial.core.record import Record
from seatrial.core.signals import QUATERNION
from seatrial.estimation.prediction.forecast import Forecast, Forecaster
from seatrial.estimation.simulation.starts import level_start
from seatrial.vehicles.model import Params, VehicleModel

HORIZON, MAX_RECORD_SHARE = 10.0, 0.1  # Longest horizon, s, and the share of a record that it is at most
MIN_STEPS = 3  # Samples of a horizon, at least
# Share of variance explained over short horizons from which on the model is right for as long as these
MIN_EXPLAINED = 0.8
MIN_GROWTH = 3.0  # Growth of a small error along a record from which on a vehicle leaves its course by itself
# States of motions that are coupled in a steady one; angles keep a vehicle upright, and are left out with their motions where they are no
# states.
GROUPS = (("u",), ("v", "r"), ("v", "p", "phi", "r"), ("w", "q", "theta"))
DRAWS, MAX_BEGINS = 8, 500  # Draws, and samples from which one sample ahead is forecast


@dataclass(frozen=True)
class ShortHorizon:
    """How one channel is forecast by what was measured before.

    Attributes:
        horizon: s.
        explained: share of the channel's variance explained over horizons of that length, one after another.
        held: the same of holding the value measured at each beginning.
        one_step: share explained one sample ahead.
        one_step_held: the same of holding the value.
    """

    horizon: float
    explained: float
    held: float
    one_step: float
    one_step_held: float

    @property
    def is_good(self) -> bool:
        """Whether nearly all of the motion is explained over the horizon, and more than by holding the measured value."""
        return self.explained >= MIN_EXPLAINED and self.explained > self.held


def short_horizons(
    forecaster: Forecaster, record: Record, horizon: float, start: Sequence[float] | None = None
) -> dict[str, ShortHorizon]:
    """Forecast a record over a short horizon and one sample ahead, again and again.

    Args:
        forecaster: of the fitted records.
        record: fitted or not.
        horizon: s.
        start: state at the first sample, SI.

    Returns:
        the scores of each sensor's channel that moves; empty if the horizon has too few samples.
    """
    channels = forecaster.posterior.likelihood.channels
    measured = np.column_stack([record.channel(channel) for channel in channels])
    steps = round(horizon / float(np.median(record.step)))
    known = np.flatnonzero(np.isfinite(measured).all(axis=1))
    if steps < MIN_STEPS or known.size < 2:
        return {}
    chosen = []
    for index in known:
        if not chosen or index - chosen[-1] >= steps:
            chosen.append(int(index))
    some = known[:: max(1, known.size // MAX_BEGINS)]
    over, next_ = (forecaster.forecast(record, *one, start=start, n=DRAWS) for one in ((chosen, steps), (some, 1)))
    result = {}
    for column, channel in enumerate(channels):
        variance = float(np.nanvar(measured[:, column]))
        shares = (
            [1.0 - square / variance for one in (over, next_) for square in _squares(one, measured, column)]
            if variance
            else []
        )
        if shares and np.isfinite(shares).all():
            result[channel] = ShortHorizon(horizon, *shares)
    return result


def steady_eigenvalues(
    model: VehicleModel, values: Params, record: Record
) -> dict[tuple[str, ...], Complex[np.ndarray, " states"]]:
    """Return the eigenvalues of the model about the medians of a record's states and controls, 1/s, by the states that are coupled.

    Args:
        model: vehicle.
        values: of all its parameters, SI.
        record: with the controls of the vehicle, and what was measured of its states.
    """
    middle = {
        name: float(np.nanmedian(record.channel(name)))
        for name in (*record.controls, *record.measured)
        if np.isfinite(record.channel(name)).any()
    }
    state = level_start(model, {**middle, "p": 0.0, "q": 0.0})
    control = np.array([middle[name] for name in model.controls])
    numbers = {name: np.asarray(value, float) for name, value in values.items()}
    slopes, result = np.asarray(_rate_slopes(model, numbers, np.asarray(state, float), control)), {}
    for group in GROUPS:
        places = [model.states.index(name) for name in group if name in model.states]
        upright = len(places) == len(group) or not set(QUATERNION) & set(model.states)
        if places and upright:
            eigenvalues = np.linalg.eigvals(slopes[np.ix_(places, places)])
            result[tuple(model.states[i] for i in places)] = np.asarray(eigenvalues, complex)
    return result


@program(static_argnums=0)
def _rate_slopes(model: VehicleModel, values: Params, state: Array, control: Array) -> Array:
    """Return the derivatives of the rates of all states by these states."""

    def rates(x: Array) -> Array:
        return jnp.stack([jnp.asarray(one, float) for one in model.derivative(values, tuple(x), tuple(control))])

    return jax.jacfwd(rates)(state)


def growth_rate(model: VehicleModel, values: Params, record: Record) -> float:
    """Return the largest real part of `steady_eigenvalues`, 1/s: above 0, a small error grows by e in its inverse."""
    return max(
        (float(np.real(one).max()) for one in steady_eigenvalues(model, values, record).values()), default=-np.inf
    )


def _squares(one: Forecast, measured: Float[np.ndarray, "n m"], column: int) -> tuple[float, float]:
    """Return the mean squares of the errors of a forecast, infinite if it runs away, and of holding the measured value."""
    later, ahead = one.measured[..., column], one.mean[..., column]
    there = np.isfinite(later)
    left = np.where(np.isfinite(ahead), later - ahead, np.inf)[there]
    with np.errstate(over="ignore"):
        return float(np.mean(left**2)), float(np.mean((later - measured[one.begins, column][:, None])[there] ** 2))
