"""The campaign's relay: its family on the state space of what is believed, closed on any vehicle and through a noisy sensor."""

from dataclasses import dataclass
from math import inf

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.belief import belief_space, believed, coefficient_priors
from seatrial.campaign.config import Campaign
from seatrial.campaign.problem import random_key
from seatrial.campaign.schema import RelayTable
from seatrial.campaign.weighing import check_whole_trials, plan_of
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import signal_unit
from seatrial.core.state_space import StateSpace
from seatrial.design.plan import TrialPlan
from seatrial.design.sweep import in_blocks
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.relay import RelayFamily, RelayRun, replay, run_relay


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
            found = _closed(self.family, self.space, amplitude, threshold, start, error)
            return found.control, found.outputs[..., at]

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
    table, model = check_relay(campaign), campaign.model(campaign.full)
    shared, plan, rate = campaign.family, plan_of(campaign, model), campaign.limits().rate
    priors, trim = coefficient_priors(campaign, model), campaign.control_trim(model)
    space, scales = belief_space(campaign, model, believed(priors))
    trimmed = dict(zip(model.states, campaign.state_trim(model), strict=True)).get(table.output, 0.0)
    family = RelayFamily(
        trim,
        shared.control,
        table.output,
        trimmed,
        shared.duration,
        shared.sample_time,
        shared.start,
        shared.active,
        _effect(campaign, plan, trim, trimmed, np.array([prior.mean for prior in priors])),
        inf if rate is None else rate,
    )
    thresholds = campaign.range(table.threshold, signal_unit(table.output), "design.relay.threshold")
    return RelayLoop(family, space, scales, plan, thresholds)


def check_relay(campaign: Campaign) -> RelayTable:
    """`[design.relay]`, found before any work to be there and to feed back what is measured.

    Raises:
        InputError: no such table, an output that is not measured, or designs that are counted by the second.
    """
    check_whole_trials(campaign, "--self-oscillation", joules=True)
    table = campaign.source.design.relay
    if table is None:
        raise InputError(
            campaign.where("design.relay"),
            found="nothing",
            expected="the output that is fed back, and its thresholds",
            remedy='add [design.relay] with output = "r" and threshold = { from = "2 deg/s", to = "10 deg/s", points = 8 }',
        )
    if table.output not in campaign.channels:
        raise InputError(
            campaign.where("design.relay.output"),
            found=f'"{table.output}"',
            expected="a measured channel: " + ", ".join(campaign.channels),
            remedy=nearest(table.output, campaign.channels),
        )
    return table


def sensor_noise(campaign: Campaign, output: str, count: int) -> Float[np.ndarray, "S n"]:
    """Noise of the output that is fed back in so many runs, SI, NaN where it is not measured."""
    time, at = campaign.family.time(), campaign.channels.index(output)
    drawn = jax.random.normal(random_key(campaign, "noise of the output fed back"), (count, time.size))
    return np.where(campaign.measured_mask(time)[:, at] > 0, campaign.noise(output) * np.asarray(drawn), np.nan)


def _effect(campaign: Campaign, plan: TrialPlan, trim: tuple, trimmed: float, values: np.ndarray) -> float:
    """Sign of the output's answer to a step of the control, where it first is half of what it comes to."""
    table, family = campaign.source.design.relay, campaign.family
    assert table is not None
    control = np.tile([value for _, value in trim], (plan.step.shape[0], 1))
    control[:, [name for name, _ in trim].index(family.control)] += campaign.grid()[0][0]
    at = plan.channels.index(table.output)
    measured = np.asarray(plan.weight)[:, at] > 0
    answer = np.asarray(plan.outputs(values, control))[measured, at] / np.asarray(plan.weight)[measured, at] - trimmed
    most = np.abs(answer).max()
    if not most > 1e-9:
        raise InputError(
            campaign.where("design.relay.output"),
            found=f"{table.output}, which {family.control} does not move at the prior means",
            expected="an output that answers the control",
            remedy="feed another output back, or drive another control",
        )
    return float(np.sign(answer[np.argmax(np.abs(answer) >= 0.5 * most)]))


def _closed(
    family: RelayFamily, space: StateSpace, amplitude: float, threshold: float, starts: Array, errors: Array
) -> RelayRun:
    settings = jnp.asarray(amplitude, float), jnp.asarray(threshold, float)
    return jax.vmap(lambda start, error: run_relay(space, family, *settings, start, error))(starts, errors)
