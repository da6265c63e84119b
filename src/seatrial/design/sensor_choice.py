"""What sensors are worth in one trial: the information with each at other rates or without it, from one simulation.

Information adds up over samples and channels, F = sum_j sum_k s_jk s_jk^T / sigma_j^2, so that a sensor at a lower rate is a part
of the sum and one with other noise a multiple of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.design.fisher_utilities import Criterion
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan


@dataclass(frozen=True)
class SensorChoice:
    """One set of sensors.

    Attributes:
        every: samples between two measurements of each channel, in the plan's order; 0 where it is left out.
        noise: factor on each channel's standard deviation.
    """

    every: tuple[int, ...]
    noise: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class SensorWorth:
    """What a choice is worth; S draws, k coefficients.

    Attributes:
        utility: mean over the draws.
        sd: standard deviation of each coefficient after the trial, root mean square over the draws, SI, shape (k,).
    """

    utility: float
    sd: Float[np.ndarray, " k"]


def sensor_worth(
    plan: TrialPlan,
    control: Float[np.ndarray, "n c"],
    draws: Float[np.ndarray, "S k"],
    cov: Float[np.ndarray, "k k"],
    criterion: Criterion,
    choices: Sequence[SensorChoice],
) -> list[SensorWorth]:
    """Weigh choices of sensors for one design.

    Args:
        plan: vehicle and start, with every channel measured at every sample.
        control: every control, SI.
        draws: coefficients drawn from what is believed, SI.
        cov: their covariance before the trial.
        criterion: utility of the information.
        choices: what to weigh.

    Raises:
        NumericalError: the motion diverges at a draw.
    """
    held = jax.device_put(np.asarray(control, float))
    slopes = in_blocks(lambda values: (_slopes(plan, held, values),), np.asarray(draws, float))[0]
    if not np.isfinite(slopes).all():
        raise NumericalError("the motion diverges at a draw of the coefficients: narrow the priors")
    results = []
    for choice in choices:
        information = sum(
            np.einsum("snk,snl->skl", part, part) / factor**2
            for channel, (every, factor) in enumerate(zip(choice.every, choice.noise, strict=True))
            if every
            for part in (slopes[:, ::every, channel],)
        )
        information = np.zeros((len(draws), *cov.shape)) + information
        after = np.linalg.inv(information + np.linalg.inv(cov))
        sd = np.sqrt(np.diagonal(after, axis1=1, axis2=2).mean(0))
        results.append(SensorWorth(float(np.mean(np.asarray(criterion(information)))), sd))
    return results


@program
def _slopes(plan: TrialPlan, control: Array, values: Array) -> Array:
    return jax.vmap(lambda point: jax.jacfwd(plan.outputs)(point, control))(values)
