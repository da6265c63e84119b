"""The self-oscillating test: its amplitude and threshold chosen, and its loop closed on every vehicle that is believed possible."""

from dataclasses import dataclass
from math import inf
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import RelayTable
from seatrial.campaign.design.evaluate import check_whole_trials, plan_of
from seatrial.campaign.design.prior_state_space import HALF, belief_space, believed
from seatrial.campaign.design.sweep import design_first, design_key, write_design
from seatrial.campaign.design.utility import UTILITY_DRAWS
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.designs import RelayTrial
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.programs import program
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.signals import QUATERNION
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.prior_belief import draw_values, prior_cov
from seatrial.design.relay_sweep import RelaySweep, sweep_relay
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_runs, probability_at_least
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.relay import RelayFamily, RelayRun, oscillation, replay, run_relay
from seatrial.numerics.state_space import StateSpace

# The campaign's relay: its family on the state space of what is believed, closed on any vehicle and through a noisy
# sensor.


@dataclass(frozen=True, eq=False)
class RelayLoop:
    """A relay and the vehicle that is believed in.

    Attributes:
        family: what is switched and fed back.
        space: state space of the belief; coefficients in units of `scales`.
        scales: SI, shape (k,).
        plan: of the trials.
        thresholds: of the grid, SI, shape (T,).
    """

    family: RelayFamily
    space: StateSpace
    scales: np.ndarray
    plan: TrialPlan
    thresholds: np.ndarray

    def runs(self, amplitude: float, threshold: float, draws: np.ndarray, noise: np.ndarray) -> list[np.ndarray]:
        """Controls and outputs fed back of one design with every draw, shapes (S, n, c) and (S, n)."""
        d = self.space.n_dynamic
        starts = np.hstack([np.tile(self.space.initial.mean[:d], (len(draws), 1)), draws / self.scales])
        at = self.space.outputs.index(self.family.output)

        def run(start: Array, error: Array) -> tuple[Array, Array]:
            runs = _closed(self.family, self.space, amplitude, threshold, start, error)
            return runs.control, runs.outputs[..., at]

        return in_blocks(run, starts, noise)

    def foreseen(self, amplitude: float, threshold: float) -> tuple[Manoeuvre, Float[np.ndarray, " n"]]:
        """One design at the mean of the belief with a perfect sensor, and its output, SI."""
        run = run_relay(self.space, self.family, amplitude, threshold, self.space.initial.mean)
        at = self.space.outputs.index(self.family.output)
        return replay(self.family, amplitude, threshold, run), np.asarray(run.outputs)[:, at]


def relay_loop(campaign: Campaign) -> RelayLoop:
    """The relay of `[design.relay]`.

    Raises:
        InputError: no such table, or an output that is not measured or does not answer the control.
    """
    relay, model = check_relay(campaign), campaign.model(campaign.full)
    shared, plan, rate = campaign.family, plan_of(campaign, model), campaign.limits.rate
    priors, trim = campaign.coefficient_priors(model), campaign.control_trim(model)
    space, scales = belief_space(campaign, model, believed(priors))
    trimmed = dict(zip(model.states, campaign.state_trim(model), strict=True)).get(relay.output, 0.0)
    family = RelayFamily(
        trim,
        shared.control,
        relay.output,
        trimmed,
        shared.duration,
        shared.sample_time,
        shared.start,
        shared.active,
        _effect(campaign, relay.output, plan, trim, trimmed, np.array([prior.mean for prior in priors])),
        inf if rate is None else rate,
    )
    return RelayLoop(family, space, scales, plan, np.array(relay.threshold.values()))


def check_relay(campaign: Campaign) -> RelayTable:
    """Return the self-oscillating test that is asked for, found before any work to be there.

    Raises:
        InputError: none is, or designs that are counted by the second.
    """
    check_whole_trials(campaign.design, campaign.where, "--self-oscillation", joules=True)
    campaign.check_no_autopilot("--self-oscillation", "a loop that would fight the autopilot over the same actuators")
    relay = campaign.design.relay
    if relay is None:
        raise InputError(
            campaign.where("design.relay"),
            found="nothing",
            expected="the output that is fed back, and its thresholds",
            remedy=f"add [design.relay] with {_proposal(campaign)}",
        )
    return relay


def _proposal(campaign: Campaign) -> str:
    """Return the keys of a test of this campaign: the channel that answers the control most beside its noise, a fifth to four of it."""
    model = campaign.model(campaign.full)
    plan = plan_of(campaign, model)
    names = [name for name in plan.channels if name not in QUATERNION]
    if not names:
        return "output, a channel that answers the control and is measured, and its threshold"
    values = np.array([prior.mean for prior in campaign.coefficient_priors(model)])
    step, none = (_outputs(campaign, plan, campaign.control_trim(model), values, share) for share in (1.0, 0.0))
    answer = np.abs(step - none).max(0)
    answer = np.where(np.isfinite(answer), answer, 0.0)
    name = max(names, key=lambda one: answer[plan.channels.index(one)])
    size = max(float(answer[plan.channels.index(name)]), 10.0) * campaign.noise[name]
    factor, unit = shown_unit(name)
    low, high = (f"{share * size * factor:.1g} {unit}" for share in PROPOSED_SHARES)
    return f'output = "{name}" and threshold = {{ from = "{low}", to = "{high}", points = 8 }}'


def sensor_noise(campaign: Campaign, output: str, count: int) -> Float[np.ndarray, "S n"]:
    """Noise of the output that is fed back in so many runs, SI, NaN where it is not measured."""
    time, at = campaign.family.time(), campaign.channels.index(output)
    drawn = jax.random.normal(random_key(campaign.seed, "noise of the output fed back"), (count, time.size))
    return np.where(campaign.measured_mask(time)[:, at] > 0, campaign.noise[output] * np.asarray(drawn), np.nan)


def _effect(campaign: Campaign, output: str, plan: TrialPlan, trim: tuple, trimmed: float, values: np.ndarray) -> float:
    """Sign of the output's answer to a step of the control, where it first is half of what it comes to."""
    at = plan.channels.index(output)
    weight = np.asarray(plan.weight)[:, at]
    answer = _outputs(campaign, plan, trim, values)[weight > 0, at] / weight[weight > 0] - trimmed
    most = np.abs(answer).max()
    if not most > 1e-9:
        raise InputError(
            campaign.where("design.relay.output"),
            found=f"{output}, which {campaign.family.control} does not move at the prior means",
            expected="an output that answers the control",
            remedy="feed another output back, or drive another control",
        )
    return float(np.sign(answer[np.argmax(np.abs(answer) >= 0.5 * most)]))


def _outputs(
    campaign: Campaign, plan: TrialPlan, trim: tuple, values: np.ndarray, share: float = 1.0
) -> Float[np.ndarray, "n m"]:
    """Every output over its noise, 0 where it is not measured, after a step of the control by a share of the least amplitude."""
    control = np.tile([value for _, value in trim], (plan.step.shape[0], 1))
    control[:, [name for name, _ in trim].index(campaign.family.control)] += share * campaign.design.amplitudes[0]
    return np.asarray(plan.outputs(values, control))


def _closed(
    family: RelayFamily, space: StateSpace, amplitude: float, threshold: float, starts: Array, errors: Array
) -> RelayRun:
    settings = np.asarray(amplitude, float), np.asarray(threshold, float)
    return jax.vmap(lambda start, error: run_relay(space, family, *settings, start, error))(starts, errors)


# Thresholds that are proposed, as shares of what a step of the control by its least amplitude comes to
PROPOSED_SHARES = (0.2, 0.8)
CONFIDENCE = 0.95  # Of the claim that a test oscillates inside the limits with the probability asked for
RANGE_QUANTILES = (0.05, 0.5, 0.95)  # Quantiles over the vehicles that the priors allow


def stored_relay(campaign: Campaign) -> StoredResult[RelayTrial]:
    """Return where the self-oscillating test is kept, and what it depends on."""
    return StoredResult(
        Store(campaign.folder).relay_design,
        key_of("self-oscillation", design_key(campaign)),
        RelayTrial,
        f"seatrial design {campaign.folder}",
    )


def design_relay_trial(campaign: Campaign, reporter: Reporter = SILENT) -> tuple[RelayTrial, Path]:
    """Choose the most informative test that oscillates and keeps the limits; a current result is read.

    Returns:
        what was found, and the schedule that is foreseen at the prior means.

    Raises:
        InputError: no `[design.relay]`, an output that is not measured or does not answer the control, or no design that oscillates
            inside the limits.
        NumericalError: the vehicle diverges at the prior means.
    """
    loop, kept = relay_loop(campaign), stored_relay(campaign)
    trial = kept.read_or_make(lambda: _search(campaign, loop, reporter))
    path = Store(campaign.folder).schedule(kept.path)
    foreseen, _ = loop.foreseen(trial.amplitude, trial.threshold)
    law = {"family": loop.family.as_plain(), "amplitude": trial.amplitude, "threshold": trial.threshold}
    return trial, write_design(campaign, path, foreseen, trial.rule, relay=law)


def _search(campaign: Campaign, loop: RelayLoop, reporter: Reporter) -> RelayTrial:
    priors = campaign.coefficient_priors(campaign.model(campaign.full))
    draws = draw_values(priors, random_key(campaign.seed, "draws of the self-oscillation"), 2 * HALF)
    noise = sensor_noise(campaign, loop.family.output, len(draws))
    amplitudes = campaign.design.grid()[0]
    mask = campaign.measured_mask(loop.family.time())
    sweep = sweep_relay(
        loop.space, loop.family, amplitudes, loop.thresholds, campaign.limits, measured=mask, noise=noise[0]
    )
    row, column, passed_over = _sure_best(campaign, loop, sweep, draws[:HALF], noise[:HALF], reporter)
    chosen = float(amplitudes[row]), float(loop.thresholds[column])
    fresh, errors = draws[HALF:], noise[HALF:]
    controls, outputs = loop.runs(*chosen, fresh, errors)
    safety: tuple[str, ...] = ()
    if campaign.motion_limits:
        probability = campaign.design.probability
        safety = tuple(judge_runs(loop.plan, controls, fresh, campaign.motion_limits, probability).words(0))
    shown = oscillation(loop.family, outputs, outputs + errors, chosen[1])
    oscillates = shown.reversals >= 2
    best = design_first(campaign, reporter).best
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
    campaign: Campaign, loop: RelayLoop, sweep: RelaySweep, draws: np.ndarray, noise: np.ndarray, reporter: Reporter
) -> tuple[int, int, int]:
    """The most informative design that surely oscillates and keeps the limits, each vehicle's loop closed by itself.

    Returns:
        row, column, and how many more informative designs were passed over.
    """
    gain, probability = np.where(sweep.oscillates, sweep.gain, np.nan), campaign.design.probability
    order = [int(i) for i in np.argsort(-gain, axis=None) if np.isfinite(gain.ravel()[i])]
    report, most = reporter.progress("self-oscillation"), (-1.0, "")
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
        f", none of them with the required probability; the best, {most[1]}",
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
    finite = values[np.isfinite(values)]
    return (
        tuple(map(float, np.quantile(finite, RANGE_QUANTILES)))
        if finite.size
        else (float("nan"),) * len(RANGE_QUANTILES)
    )


@program
def _information(plan: TrialPlan, controls: Array, values: Array) -> Array:
    return jax.vmap(lambda control, point: plan.information(point, control))(controls, values)
