"""When to stop one trial: what it has taught by every possible end, over what it has cost by then.

Fisher information adds up along the trial, I(t) = sum_{k <= t} S_k^T R^-1 S_k, so that one simulation serves every end. Over many
trials like this one, gain for cost comes to the ratio of the two expected values (renewal reward), which is best where the gain
still to come no longer repays its cost at that rate (Charnov, Theor. Popul. Biol. 9, 1976). Without a fixed cost around each
trial that is often at once.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.design.fisher_utilities import Criterion
from seatrial.design.safety import check_runs
from seatrial.design.sweep import at_every_draw
from seatrial.design.trial_plan import TrialPlan

END_COUNT = 30  # Ends of a trial that are weighed for each of many designs


class BestStops(NamedTuple):
    """When to end each of D designs; S draws, k coefficients.

    Attributes:
        rate: most gain for a second, 1/s.
        samples: taken by the end that has it.
        length: time by then, s.
        information: Fisher information of these samples, SI; zero if it is no finite number.
    """

    rate: Float[np.ndarray, " D"]
    samples: Int[np.ndarray, " D"]
    length: Float[np.ndarray, " D"]
    information: Float[np.ndarray, "D S k k"]


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
    utility: Criterion,
    overhead: float,
    ends: int = END_COUNT,
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
    n, k = plan.step.shape[0], len(plan.names)
    at = np.unique(np.linspace(1, n, min(ends, n)).round().astype(int))
    by_end = np.moveaxis(at_every_draw(partial(_until, plan, at), controls, draws), 2, 1)
    finite = np.isfinite(by_end).all(axis=(2, 3, 4))
    if not finite.any(1).all():
        raise NumericalError("a motion diverges at a draw of the coefficients: narrow the priors, or excite less")
    by_end = np.where(np.asarray(finite)[:, :, None, None, None], by_end, 0.0)
    gain = np.asarray(utility(by_end)).mean(-1) - np.asarray(utility(np.zeros((len(draws), k, k)))).mean()
    length = np.cumsum(np.asarray(plan.step))[at - 1]
    rate = np.where(finite, gain / (overhead + length), -np.inf)
    best, each = rate.argmax(1), np.arange(len(controls))
    return BestStops(rate[each, best], at[best], length[best], by_end[each, best])


@program
def _until(plan: TrialPlan, ends: Array, controls: Array, which: Array, values: Array) -> Array:
    return jax.vmap(lambda i, point: information_until(plan, point, controls[i], ends))(which, values)
