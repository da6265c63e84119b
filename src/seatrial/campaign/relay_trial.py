"""The self-oscillating test: its amplitude and threshold chosen, and its loop closed on every vehicle that is believed possible."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array

from seatrial.campaign.belief import HALF, coefficient_priors
from seatrial.campaign.config import Campaign
from seatrial.campaign.designs import design_first, design_key
from seatrial.campaign.problem import random_key
from seatrial.campaign.relay_loop import RelayLoop, relay_loop, sensor_noise
from seatrial.campaign.schedules import write_schedule
from seatrial.campaign.store import Store, is_current, key_of, read_json, write_stamped_json
from seatrial.campaign.utilities import UTILITY_DRAWS
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.errors import InputError
from seatrial.core.shown import shown_unit
from seatrial.design.criteria import find_criterion
from seatrial.design.plan import TrialPlan
from seatrial.design.prior_belief import draw_values, prior_cov
from seatrial.design.relay_sweep import RelaySweep, sweep_relay
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_runs, probability_at_least
from seatrial.design.sweep import in_blocks
from seatrial.manoeuvres.oscillation import oscillation

CONFIDENCE = 0.95
"""Of the claim that a test oscillates inside the limits with the probability asked for."""
RANGE = (0.05, 0.5, 0.95)
"""Quantiles over the vehicles that are believed possible."""


@dataclass(frozen=True)
class RelayTrial:
    """The test found, and what it is worth beside the best of the open-loop families.

    Attributes:
        control: channel that is switched.
        output: channel that is fed back.
        amplitude: of the control about its trim, SI.
        threshold: of the output about its trim, SI.
        effect: +1 where more control raises the output, -1 where it lowers it.
        gain: entropy reduction by the filter at the prior means, nats.
        utility: expected entropy reduction by Fisher information over draws of the priors, nats.
        beside: the same of the best design of the families.
        family: name of that one.
        oscillates: share of the vehicles in which the control is reversed twice at least.
        reversals: 5, 50 and 95 % quantiles of their number over the vehicles.
        period: likewise, s; of those that oscillate.
        first_overshoot: likewise, SI.
        second_overshoot: likewise, SI.
        passed_over: more informative designs that may not oscillate or may break a limit.
        safety: how surely each limit of the motion is kept, on draws that had no part in choosing it.
    """

    control: str
    output: str
    amplitude: float
    threshold: float
    effect: float
    gain: float
    utility: float
    beside: float
    family: str
    oscillates: float
    reversals: tuple[float, ...]
    period: tuple[float, ...]
    first_overshoot: tuple[float, ...]
    second_overshoot: tuple[float, ...]
    passed_over: int
    safety: tuple[str, ...]

    @property
    def rule(self) -> str:
        """What the operator or the autopilot does."""
        (c, c_unit), (y, y_unit) = shown_unit(self.control), shown_unit(self.output)
        first, second = ("+", "-") if self.effect > 0 else ("-", "+")
        return (
            f"begin with {self.control} {self.amplitude * c:.4g} {c_unit} above trim; below trim once {self.output} is "
            f"{first}{self.threshold * y:.4g} {y_unit} from its trim, above again once it is {second}{self.threshold * y:.4g} {y_unit}"
        )

    def lines(self) -> list[str]:
        """In words."""
        (c, c_unit), (y, y_unit) = shown_unit(self.control), shown_unit(self.output)
        low, middle, high = (value * y for value in self.first_overshoot)
        after = [value * y for value in self.second_overshoot]
        return [
            f"self-oscillation of ±{self.amplitude * c:.4g} {c_unit} in {self.control}, reversed at ±{self.threshold * y:.4g} {y_unit} "
            f"of {self.output}: {self.gain:.2f} nat",
            f"over the priors {self.utility:.2f} nat, the best of the families ({self.family}) {self.beside:.2f} nat by the same measure",
            f"{self.reversals[1]:g} reversals (90 % of vehicles {self.reversals[0]:g} to {self.reversals[2]:g}), period "
            f"{self.period[1]:.3g} s ({self.period[0]:.3g} to {self.period[2]:.3g}), first overshoot {middle:.3g} {y_unit} "
            f"({low:.3g} to {high:.3g}), second {after[1]:.3g} {y_unit} ({after[0]:.3g} to {after[2]:.3g})",
            f"it oscillates in {self.oscillates:.0%} of the vehicles that are believed possible",
            *(
                (
                    f"{self.passed_over} more informative design{'s' * (self.passed_over != 1)} may not oscillate, or break a limit",
                )
                if self.passed_over
                else ()
            ),
            *self.safety,
            self.rule,
        ]


def design_relay_trial(campaign: Campaign, watch: Watch = SILENT) -> tuple[RelayTrial, Path]:
    """Choose the most informative test that oscillates and keeps the limits; a current result is read.

    Returns:
        what was found, and the schedule that is foreseen at the prior means.

    Raises:
        InputError: no `[design.relay]`, an output that is not measured or does not answer the control, or no design that oscillates
            inside the limits.
        NumericalError: the vehicle diverges at the prior means.
    """
    store, loop = Store(campaign.folder), relay_loop(campaign)
    key = key_of("self-oscillation", design_key(campaign))
    if not is_current(store.relay_design, key):
        write_stamped_json(store.relay_design, asdict(_search(campaign, loop, watch)), key)
    content: dict[str, Any] = read_json(store.relay_design, f"seatrial design {campaign.folder}")
    fields = {name: content[name] for name in RelayTrial.__dataclass_fields__}
    found = RelayTrial(**{name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()})
    path = store.schedule(store.relay_design)
    return found, write_schedule(
        path, loop.foreseen(found.amplitude, found.threshold)[0], campaign.family.sample_time, found.rule
    )


def _search(campaign: Campaign, loop: RelayLoop, watch: Watch) -> RelayTrial:
    priors = coefficient_priors(campaign, campaign.model(campaign.full))
    draws = draw_values(priors, random_key(campaign, "draws of the self-oscillation"), 2 * HALF)
    noise = sensor_noise(campaign, loop.family.output, len(draws))
    amplitudes = campaign.grid()[0]
    mask = campaign.measured_mask(loop.family.time())
    sweep = sweep_relay(
        loop.space, loop.family, amplitudes, loop.thresholds, campaign.limits(), measured=mask, noise=noise[0]
    )
    row, column, passed_over = _sure_best(campaign, loop, sweep, draws[:HALF], noise[:HALF], watch)
    chosen = float(amplitudes[row]), float(loop.thresholds[column])
    fresh, errors = draws[HALF:], noise[HALF:]
    controls, outputs = loop.runs(*chosen, fresh, errors)
    safety: tuple[str, ...] = ()
    if campaign.motion_limits:
        probability = campaign.source.design.probability
        safety = tuple(judge_runs(loop.plan, controls, fresh, campaign.motion_limits, probability).words(0))
    shown = oscillation(loop.family, outputs, outputs + errors, chosen[1])
    oscillates = shown.reversals >= 2
    best = design_first(campaign, watch).best
    utility, beside = _judged(loop, prior_cov(priors), fresh, controls, best.best_controls())
    return RelayTrial(
        loop.family.control,
        loop.family.output,
        *chosen,
        loop.family.effect,
        float(sweep.gain[row, column]),
        utility,
        beside,
        best.family.words,
        float(oscillates.mean()),
        _quantiles(shown.reversals[oscillates].astype(float)),
        _quantiles(shown.period[oscillates]),
        _quantiles(shown.first_overshoot[oscillates]),
        _quantiles(shown.second_overshoot[oscillates]),
        passed_over,
        safety,
    )


def _sure_best(
    campaign: Campaign, loop: RelayLoop, sweep: RelaySweep, draws: np.ndarray, noise: np.ndarray, watch: Watch
) -> tuple[int, int, int]:
    """The most informative design that surely oscillates and keeps the limits, each vehicle's loop closed by itself.

    Returns:
        row, column, and how many more informative designs were passed over.
    """
    gain, probability = np.where(sweep.oscillates, sweep.gain, np.nan), campaign.source.design.probability
    order = [int(i) for i in np.argsort(-gain, axis=None) if np.isfinite(gain.ravel()[i])]
    report, most = watch.progress("self-oscillation"), (-1.0, "")
    for tried, place in enumerate(order):
        row, column = divmod(place, gain.shape[1])
        report(tried, len(order))
        threshold = float(sweep.threshold[column])
        controls, outputs = loop.runs(float(sweep.amplitude[row]), threshold, draws, noise)
        turns = oscillation(loop.family, outputs, outputs + noise, threshold).reversals >= 2
        kept, words = turns, f"oscillates in {turns.mean():.0%} of the vehicles"
        if campaign.motion_limits:
            safety = judge_runs(loop.plan, controls, draws, campaign.motion_limits, probability)
            kept, words = turns & safety.held[0].all(1), "; ".join((words, *safety.words(0)))
        if probability_at_least(kept.sum(), len(draws), CONFIDENCE) >= probability:
            report(len(order), len(order))
            return row, column, tried
        (c, c_unit), (y, y_unit) = shown_unit(loop.family.control), shown_unit(loop.family.output)
        design = f"±{sweep.amplitude[row] * c:.4g} {c_unit} reversed at ±{threshold * y:.4g} {y_unit}"
        most = max(most, (float(kept.mean()), f"{design}, {words}"))
    raise InputError(
        campaign.where("design.relay"),
        found=f"{len(order)} of {sweep.gain.size} designs of the grid oscillate at the prior means"
        f", none of them surely enough; the surest, {most[1]}",
        expected=f"one at least that oscillates inside every limit with probability {probability:g}",
        remedy="lower the thresholds, lengthen the trial, narrow priors that let a vehicle hardly answer the control, or widen the limits",
    )


def _judged(
    loop: RelayLoop, cov: np.ndarray, draws: np.ndarray, controls: np.ndarray, family: np.ndarray
) -> tuple[float, float]:
    """Both by the same measure: the test with each draw's own control, the family with one for all."""
    criterion, few = find_criterion("fisher-d", cov), slice(UTILITY_DRAWS)
    (information,) = in_blocks(
        lambda control, values: (_information(loop.plan, control, values),), controls[few], draws[few]
    )
    beside = utility_table(loop.plan, family[None], draws[few], criterion).mean[0]
    return float(np.mean(np.asarray(criterion(information)))), float(beside)


def _quantiles(values: np.ndarray) -> tuple[float, ...]:
    there = values[np.isfinite(values)]
    return tuple(map(float, np.quantile(there, RANGE))) if there.size else (float("nan"),) * len(RANGE)


@jax.jit
def _information(plan: TrialPlan, controls: Array, values: Array) -> Array:
    return jax.vmap(lambda control, point: plan.information(point, control))(controls, values)
