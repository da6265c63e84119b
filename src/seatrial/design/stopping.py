"""When to stop one trial: what it has taught by every possible end, over what it has cost by then.

Fisher information adds up along the trial, I(t) = sum_{k <= t} S_k^T R^-1 S_k, so that one simulation serves every end. Over many
trials like this one, gain for cost comes to the ratio of the two expected values (renewal reward), which is best where the gain
still to come no longer repays its cost at that rate (Charnov, Theor. Popul. Biol. 9, 1976). Without a fixed cost around each
trial that is often at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.cost import TrialCost, check_cost, cost_along, gain_per_cost
from seatrial.design.safety import check_runs
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan

Utility = Callable[[Float[np.ndarray, "E k k"]], Float[np.ndarray, " E"]]
"""Number of an information matrix, SI; higher is better."""
ENDS = 30
"""Ends of a trial that are weighed for each of many designs."""
LOSS = 1e-9
"""Loss of utility along the trial that is rounding, as a share of the largest gain."""


class BestStops(NamedTuple):
    """When to end each of D designs; S draws, k coefficients.

    Attributes:
        rate: most gain for a second, 1/s.
        samples: taken by the end that has it.
        length: time by then, s.
        information: Fisher information of these samples, SI; zero where it is no finite number.
    """

    rate: Float[np.ndarray, " D"]
    samples: Int[np.ndarray, " D"]
    length: Float[np.ndarray, " D"]
    information: Float[np.ndarray, "D S k k"]


@dataclass(frozen=True, eq=False)
class StopTimes:
    """Gain and cost of one trial at each of E ends, expected over draws.

    Attributes:
        samples: samples taken by then.
        time: length of the trial, s.
        gain: utility over that of no trial.
        cost: in `unit`.
        rate: gain over cost.
        rate_error: its standard error over the draws; NaN of a single draw.
        unit: of the cost.
    """

    samples: Int[np.ndarray, " E"]
    time: Float[np.ndarray, " E"]
    gain: Float[np.ndarray, " E"]
    cost: Float[np.ndarray, " E"]
    rate: Float[np.ndarray, " E"]
    rate_error: Float[np.ndarray, " E"]
    unit: str

    @property
    def best(self) -> int:
        """Index of the end with the most gain for its cost."""
        return int(np.argmax(self.rate))

    @property
    def worth_going_on(self) -> bool:
        """Whether the last end is the best, so that a longer trial may be better still."""
        return self.best == self.rate.size - 1


def information_until(
    plan: TrialPlan, values: Float[Array, " k"], control: Float[Array, "n c"], ends: Int[Array, " E"]
) -> Float[Array, "E k k"]:
    """Fisher information about the coefficients, SI, of the first so many samples; traced, may be batched over values and control.

    Args:
        plan: vehicle, start and sensors.
        values: coefficients about which it is linearised, SI.
        control: every control, SI.
        ends: numbers of samples, from 1 to n.
    """
    slopes = jax.jacfwd(plan.outputs)(values, control)
    return jnp.cumsum(jnp.einsum("nmi,nmj->nij", slopes, slopes), 0)[ends - 1]


def best_stops(
    plan: TrialPlan,
    controls: Float[np.ndarray, "D n c"],
    draws: Float[np.ndarray, "S k"],
    utility: Utility,
    overhead: float,
    ends: int = ENDS,
) -> BestStops:
    """End of each design that has most gain for a second; ends by which a motion diverges at a draw are no choice.

    Args:
        plan: vehicle, start and sensors.
        controls: designs, held from each sample to the next, SI.
        draws: coefficients drawn from what is believed, SI.
        utility: of information matrices, one for each draw along the axis before the last two.
        overhead: time around each trial, such as the way back, s.
        ends: evenly spaced ends to choose from.

    Raises:
        NumericalError: a motion diverges before the first end.
    """
    controls, draws = check_runs(plan, controls, draws)
    n, k, shape = plan.step.shape[0], len(plan.names), (len(controls), len(draws))
    at = jnp.asarray(np.unique(np.linspace(1, n, min(ends, n)).round().astype(int)))
    design, draw = (index.ravel() for index in np.indices(shape))
    held = jnp.asarray(controls)
    found = in_blocks(lambda which, values: (_until(plan, held, at, which, values),), design, draws[draw])[0]
    by_end = np.moveaxis(found.reshape(*shape, at.size, k, k), 2, 1)
    finite = np.isfinite(by_end).all(axis=(2, 3, 4))
    if not finite.any(1).all():
        raise NumericalError("a motion diverges at a draw of the coefficients: narrow the priors, or excite less")
    by_end = np.where(np.asarray(finite)[:, :, None, None, None], by_end, 0.0)
    gain = np.asarray(utility(by_end)).mean(-1) - np.asarray(utility(np.zeros((shape[1], k, k)))).mean()
    length = np.cumsum(np.asarray(plan.step))[np.asarray(at) - 1]
    rate = np.where(finite, gain / (overhead + length), -np.inf)
    best, each = rate.argmax(1), np.arange(shape[0])
    return BestStops(rate[each, best], np.asarray(at)[best], length[best], by_end[each, best])


@jax.jit
def _until(plan: TrialPlan, controls: Array, ends: Array, which: Array, values: Array) -> Array:
    return jax.vmap(lambda i, point: information_until(plan, point, controls[i], ends))(which, values)


def stop_times(
    plan: TrialPlan,
    control: Float[np.ndarray, "n c"],
    draws: Float[np.ndarray, "S k"],
    utility: Utility,
    cost: TrialCost,
    ends: Int[np.ndarray, " E"] | None = None,
) -> StopTimes:
    """Gain for cost of one design at many ends.

    Args:
        plan: vehicle, start and sensors.
        control: every control, held from each sample to the next, SI.
        draws: coefficients drawn from what is believed, SI; one row for a local answer.
        utility: of information matrices; one that no information can lower, such as the entropy reduction.
        cost: what is counted.
        ends: numbers of samples after which to stop, rising; None for every one.

    Raises:
        InputError: ends outside the trial, a cost that the vehicle cannot have, a utility that has no value without information.
        NumericalError: a motion diverges, or the utility falls below that of no information.
    """
    check_cost(plan, cost)
    control, draws = check_runs(plan, np.asarray(control)[None], draws)
    n = plan.step.shape[0]
    ends = np.arange(1, n + 1) if ends is None else np.asarray(ends)
    if not (ends.ndim == 1 and ends.size and ends[0] >= 1 and ends[-1] <= n and (np.diff(ends) > 0).all()):
        raise InputError(
            "ends of the trial",
            found=f"{ends}",
            expected=f"rising numbers of samples from 1 to {n}",
            remedy="give numbers of samples, or none for every end",
        )
    nothing = float(np.asarray(utility(np.zeros((1, len(plan.names), len(plan.names)))))[0])
    if not np.isfinite(nothing):
        raise InputError(
            "utility of a trial",
            found=f"{nothing:g} without information",
            expected="a number, over which the gain is counted",
            remedy="use a utility that counts what is known before, such as the entropy reduction",
        )
    gains, costs = np.empty((len(draws), ends.size)), np.empty((len(draws), ends.size))
    for i, values in enumerate(draws):
        information, spent = _along(plan, cost, jnp.asarray(values), jnp.asarray(control[0]), jnp.asarray(ends))
        information, costs[i] = np.asarray(information), np.asarray(spent)
        gains[i] = np.asarray(utility(information)) - nothing if np.isfinite(information).all() else np.nan
    lost = ~(np.isfinite(gains) & np.isfinite(costs)).all(1)
    if lost.any():
        raise NumericalError(
            f"the motion, or its utility, is no finite number for {lost.sum()} of {len(draws)} draws, first in row "
            f"{int(np.argmax(lost))}; judge the design's safety first, and narrow the priors"
        )
    if gains.min() < -LOSS * max(gains.max(), 1.0):
        raise NumericalError(
            f"the utility falls to {gains.min():.4g} below that of no information; use one that no information can lower"
        )
    gain, expected = np.maximum(gains.mean(0), 0.0), costs.mean(0)
    rate = gain_per_cost(gain, expected)
    spread = (gains - rate * costs).std(0, ddof=1) if len(draws) > 1 else np.full(ends.size, np.nan)
    time = np.cumsum(np.asarray(plan.step))[ends - 1]
    return StopTimes(ends, time, gain, expected, rate, spread / (expected * np.sqrt(len(draws))), cost.unit)


@jax.jit
def _along(plan: TrialPlan, cost: TrialCost, values: Array, control: Array, ends: Array) -> tuple[Array, Array]:
    return information_until(plan, values, control, ends), cost_along(plan, cost, values, control)[ends - 1]
