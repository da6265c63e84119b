"""Are the sensors enough? The best design weighed with each sensor at other rates, with half its noise, and without it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.prior_state_space import prior_draws
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.design.utility import UTILITY_DRAWS
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import signal_unit
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.sensor_choice import SensorChoice, SensorWorth, sensor_worth
from seatrial.design.trial_plan import plan_trial

TRIED_RATES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # Hz; those up to the sample rate are tried


@dataclass(frozen=True, eq=False)
class SensorComparison:
    """What the best design would teach with other sensors.

    Attributes:
        names: coefficients.
        units: SI unit of each.
        rows: each choice in words, and what it is worth; the first is as the campaign says.
        meets: whether each row meets the standard deviations of the goal; empty where it asks for none.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, SensorWorth], ...]
    meets: tuple[bool, ...] = ()


def sensor_table(campaign: Campaign, reporter: Reporter = SILENT) -> SensorComparison:
    """Weigh other sensors on the best design, over draws of the priors.

    Raises:
        NumericalError: the motion diverges at a draw of the priors.
    """
    best, model, family = design_first(campaign, reporter).best, campaign.model(campaign.full), campaign.family
    noise = campaign.noise
    controls = best.best_controls()
    through = campaign.pilot(model.controls), campaign.expected_process(model)
    plan = plan_trial(model, campaign.state_trim(model), noise, len(controls), family.sample_time, None, *through)
    words, choices = zip(
        *_choices(campaign.noise, campaign.measured_mask(family.time()), family.sample_time), strict=True
    )
    draws = prior_draws(campaign, model)
    cov = np.atleast_2d(np.cov(draws, rowvar=False))
    worths = sensor_worth(plan, controls, draws[:UTILITY_DRAWS], cov, find_criterion("fisher-d", cov), choices)
    units = tuple(model.unit_of(term) for term in model.coefficients)
    goal, mean, meets = campaign.goal, draws.mean(0), ()
    if goal is not None and (goal.shares or goal.sds):
        meets = tuple(
            not goal.unmet({name: (mean[i], worth.sd[i]) for i, name in enumerate(plan.names)}) for worth in worths
        )
    return SensorComparison(plan.names, units, tuple(zip(words, worths, strict=True)), meets)


def _choices(noise: Mapping[str, float], mask: Float[np.ndarray, "n m"], step: float) -> list[tuple[str, SensorChoice]]:
    """The sensors as they are, and each changed by itself.

    Args:
        noise: of each channel, SI.
        mask: 1 where it is measured.
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
