"""Are the sensors enough? What each is worth in one trial at other rates, with half its noise and without it, from one simulation.

Information adds up over samples and channels, F = sum_j sum_k s_jk s_jk^T / sigma_j^2, so that a sensor at a lower rate is a part
of the sum and one with other noise a multiple of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Reporter
from seatrial.core.signals import signal_unit
from seatrial.design.design_problem import UTILITY_DRAWS, DesignProblem, covariance
from seatrial.design.fisher_utilities import Criterion, find_criterion
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_design import Beside
from seatrial.design.trial_plan import TrialPlan

TRIED_RATES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # Hz; those up to the sample rate are tried


@dataclass(frozen=True)
class SensorChoice:
    """One set of sensors.

    Attributes:
        every: samples between two measurements of each channel, in the plan's order; 0 if it is left out.
        noise: factor on each channel's standard deviation.
    """

    every: tuple[int, ...]
    noise: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class SensorWorth:
    """Information of a choice; S draws, k coefficients.

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


@dataclass(frozen=True, eq=False)
class SensorComparison:
    """Information of the best design with other sensors.

    Attributes:
        names: coefficients.
        units: SI unit of each.
        rows: each choice in words, with its information; the first is that of the campaign.
        mean: of each before the trial, SI.
        meets: whether each row meets the standard deviations of a goal; empty without a goal.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, SensorWorth], ...]
    mean: tuple[float, ...]
    meets: tuple[bool, ...] = ()


@dataclass(frozen=True)
class SensorSearch:
    """Other sensors on the best design of the families, over draws of what is believed; see `Search`."""

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> SensorComparison:
        """See `Search`."""
        best = beside().best
        controls, step = best.best_controls(), best.family.sample_time
        plan = problem.plan_of(len(controls), step, every_sample=True)
        choices = _choices(problem.noise, problem.measured(problem.family.time().size, step), step)
        draws = problem.draws
        cov, few = covariance(draws), draws[:UTILITY_DRAWS]
        worths = sensor_worth(plan, controls, few, cov, find_criterion("fisher-d", cov), [one for _, one in choices])
        rows = tuple((words, worth) for (words, _), worth in zip(choices, worths, strict=True))
        units = tuple(problem.model.unit_of(term) for term in problem.model.coefficients)
        return SensorComparison(plan.names, units, rows, tuple(map(float, draws.mean(0))))


def _choices(noise: Mapping[str, float], mask: Float[np.ndarray, "n m"], step: float) -> list[tuple[str, SensorChoice]]:
    """The sensors as they are, and each changed by itself.

    Args:
        noise: of each channel, SI.
        mask: 1 if it is measured.
        step: s.
    """
    every = tuple(round(len(mask) / column.sum()) for column in mask.T)
    ones = (1.0,) * len(every)
    rates = (f"{channel} at {1.0 / (samples * step):.3g} Hz" for channel, samples in zip(noise, every, strict=True))
    choices = [(f"as they are: {', '.join(rates)}", SensorChoice(every, ones))]
    for i, channel in enumerate(noise):
        for rate in TRIED_RATES:
            samples = round(1.0 / (rate * step))
            if samples >= 1 and samples != every[i] and abs(samples * rate * step - 1.0) < 0.01:
                choices.append((f"{channel} at {rate:g} Hz", SensorChoice(_with(every, i, samples), ones)))
        better = noise[channel] / 2
        choices.append(
            (f"{channel} of noise {better:.3g} {signal_unit(channel)}", SensorChoice(every, _with(ones, i, 0.5)))
        )
        if len(every) > 1:
            choices.append((f"without {channel}", SensorChoice(_with(every, i, 0), ones)))
    return choices


def _with(values: tuple, place: int, value: float) -> tuple:
    return (*values[:place], value, *values[place + 1 :])
