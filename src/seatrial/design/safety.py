"""Which designs keep a vehicle inside its limits with a stated probability, over draws of what is believed about it.

A limit that holds in k of S draws holds with probability p at least, where P(Binomial(S, p) >= k) = 0.05, at 95 % confidence (Clopper and
Pearson, 1934). A design is allowed where all limits hold together with the probability asked for. The margin of a limit is the
room that the same share of vehicles has at least, at the same confidence: an order statistic of the draws (Wilks, 1941), 0 or more
exactly where the limit alone would be kept. Between samples nothing is looked at. The confidence is that of each design by itself:
one picked as the best of many should be judged once more on fresh draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, log
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float, Int

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.design.integrals import follow_joint
from seatrial.design.motion_limits import MotionLimit, limit_integrals, room
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan

CONFIDENCE = 0.95  # Of each claim that something holds with a probability at least


@dataclass(frozen=True, eq=False)
class Safety:
    """How D designs keep m limits over S draws.

    Attributes:
        limits: limits, in the order of every axis m.
        probability: with which all limits together must hold.
        room: least distance to the bounds over the whole trial, in the unit of each limit, below 0 if broken; -inf where the
            motion diverges, which breaks every limit, shape (D, S, m).
        diverged: draws whose motion diverges, shape (D,).
        names: of the designs, for errors; none if they have only numbers.
    """

    limits: tuple[MotionLimit, ...]
    probability: float
    room: Float[np.ndarray, "D S m"]
    diverged: Int[np.ndarray, " D"]
    names: tuple[str, ...] = ()

    def name(self, design: int) -> str:
        """Of one design, for a sentence."""
        return f"the {self.names[design]}" if self.names else f"design {design}"

    @property
    def draws(self) -> int:
        """S."""
        return self.room.shape[1]

    @property
    def needed(self) -> int:
        """Draws in which something must hold for the claim."""
        return int(np.argmax(probability_at_least(np.arange(self.draws + 1), self.draws) >= self.probability))

    @property
    def held(self) -> Bool[np.ndarray, "D S m"]:
        """Whether each limit holds throughout."""
        return self.room >= 0

    @property
    def share(self) -> Float[np.ndarray, "D m"]:
        """Share of draws in which each limit holds."""
        return self.held.mean(1)

    @property
    def at_least(self) -> Float[np.ndarray, "D m"]:
        """Probability with which each limit holds at least."""
        return probability_at_least(self.held.sum(1), self.draws)

    @property
    def joint_share(self) -> Float[np.ndarray, " D"]:
        """Share of draws in which all limits hold."""
        return self.held.all(2).mean(1)

    @property
    def joint_at_least(self) -> Float[np.ndarray, " D"]:
        """Probability with which all limits hold together at least."""
        return probability_at_least(self.held.all(2).sum(1), self.draws)

    @property
    def margin(self) -> Float[np.ndarray, "D m"]:
        """Room left at least, with the probability and confidence asked for, in the unit of each limit."""
        return self.room_left(np.ones(self.room.shape[:2], bool))

    @property
    def allowed(self) -> Bool[np.ndarray, " D"]:
        """Whether all limits together hold with the probability and confidence asked for."""
        return self.held.all(2).sum(1) >= self.needed

    def room_left(self, among: Bool[np.ndarray, "D S"]) -> Float[np.ndarray, "D m"]:
        """Margins where draws not `among` those given count as broken."""
        counted = np.where(among[..., None], self.room, -np.inf)
        return np.partition(counted, self.draws - self.needed, axis=1)[:, self.draws - self.needed]

    def words(self, design: int) -> tuple[str, ...]:
        """One line for each limit, and one for all together."""
        held, margin, at_least = self.held[design].sum(0), self.margin[design], self.at_least[design]
        lines = [
            f"{limit.words}: holds in {held[i]} of {self.draws} draws, probability at least {at_least[i]:.3f}, "
            f"margin {margin[i] * limit.shown[0]:.3g} {limit.shown[1]}"
            for i, limit in enumerate(self.limits)
        ]
        together = self.held[design].all(1).sum()
        return (
            *lines,
            f"all together: in {together} of {self.draws} draws, probability at least {self.joint_at_least[design]:.3f} "
            f"at {CONFIDENCE:g} confidence, {self.probability:g} asked for"
            + (f"; the motion diverges in {self.diverged[design]}" if self.diverged[design] else ""),
        )


def judge_safety(
    plan: TrialPlan,
    controls: Float[np.ndarray, "D n c"],
    draws: Float[np.ndarray, "S k"],
    limits: Sequence[MotionLimit],
    probability: float = 0.95,
    samples: Int[np.ndarray, " D"] | None = None,
) -> Safety:
    """Simulate every design with every draw and count which limits hold from the first sample to the end of the last step.

    Args:
        plan: vehicle and start of the trial; each vehicle's autopilot, if there is one, sees noise of its own.
        controls: every command of each design, held from each sample to the next, SI.
        draws: coefficients drawn from what is believed, SI.
        limits: limits of the motion.
        probability: with which all must hold together.
        samples: after which each design is ended; None if all run to the end of the plan.

    Raises:
        InputError: limits that the vehicle cannot have, arrays of other shapes or without a number, or so few draws that not even
            limits that always hold could be claimed to hold.
    """
    controls, draws = _checked(plan, controls, draws, probability)
    ends = np.full(len(controls), plan.step.shape[0]) if samples is None else np.asarray(samples)
    # The same noise of the sensors for all designs and in every call, so that they differ by themselves alone.
    size = len(draws), *plan.weight.shape
    noise = None if plan.autopilot is None else np.random.default_rng(0).standard_normal(size)
    run = partial(_rooms, plan, tuple(limits), np.asarray(draws, float), noise)
    least, finite = in_blocks(run, controls, ends)
    rooms = np.where(finite[..., None], least, -np.inf)
    return Safety(tuple(limits), probability, rooms, (~finite).sum(1))


def judge_runs(
    plan: TrialPlan,
    controls: Float[np.ndarray, "S n c"],
    draws: Float[np.ndarray, "S k"],
    limits: Sequence[MotionLimit],
    probability: float = 0.95,
) -> Safety:
    """Judge one closed-loop design; arguments and errors as `judge_safety`, but the controls are those that each draw led to."""
    controls, draws = _checked(plan, controls, draws, probability)
    least, finite = in_blocks(partial(_paired_rooms, plan, tuple(limits)), controls, draws)
    rooms = np.where(finite[:, None], least, -np.inf)[None]
    return Safety(tuple(limits), probability, rooms, (~finite).sum(keepdims=True))


def least_rooms(
    plan: TrialPlan,
    limits: tuple[MotionLimit, ...],
    values: Float[Array, " k"],
    control: Float[Array, "n c"],
    noise: Float[Array, "n m"] | None = None,
) -> tuple[Float[Array, " m"], Bool[Array, ""]]:
    """Least room of each limit over one trial, and whether the motion stays finite; traced, may be batched and differentiated.

    Only the least room so far travels with the state, so that memory does not grow with the number of samples.

    Args:
        plan: vehicle and start.
        limits: checked limits.
        values: coefficients, SI.
        control: every command, SI.
        noise: of each channel over its standard deviation, as an autopilot sees it; None for perfect sensors.
    """
    integrals = limit_integrals(plan.model, limits)

    def narrowed(rooms: tuple, now: Mapping[str, Any]) -> tuple[tuple, None]:
        return tuple(jnp.minimum(least, room(limit, now)) for limit, least in zip(limits, rooms, strict=True)), None

    widest = tuple(jnp.asarray(jnp.inf) for _ in limits)
    end, rooms, _ = follow_joint(plan, integrals, values, control, narrowed, widest, noise)
    rooms, _ = narrowed(rooms, end)
    moved = jnp.stack([end[name] for name in (*plan.model.states, *integrals)])
    return jnp.stack(rooms), jnp.isfinite(moved).all()


def probability_at_least(held: Int[np.ndarray, "*any"], draws: int) -> Float[np.ndarray, "*any"]:
    """Lower bound of the probability of what held in so many of the draws (Clopper and Pearson, one-sided)."""
    return np.where(held > 0, scipy.special.betaincinv(np.maximum(held, 1), draws - held + 1, 1 - CONFIDENCE), 0.0)


def check_runs(
    plan: TrialPlan, controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> tuple[np.ndarray, np.ndarray]:
    """Designs and draws as arrays that fit the plan.

    Raises:
        InputError: another shape, or entries that are no finite numbers.
    """
    n, commands = plan.step.shape[0], plan.commands
    expected = {
        "controls": (controls, (n, len(commands)), f"designs of {n} samples of {', '.join(commands)}"),
        "draws": (draws, (len(plan.names),), "rows of " + ", ".join(plan.names)),
    }
    for name, (given, shape, words) in expected.items():
        array = np.asarray(given, float)
        if array.ndim != len(shape) + 1 or array.shape[1:] != shape or not array.size:
            raise InputError(
                name, found=f"an array of shape {array.shape}", expected=words, remedy="put one design or draw in a row"
            )
        if not np.isfinite(array).all():
            row = int(np.argmax(~np.isfinite(array.reshape(len(array), -1)).all(1)))
            raise InputError(
                name,
                found=f"an entry that is no finite number in row {row}",
                expected="finite numbers, SI",
                remedy="check how the designs are made and whether the draws come from a proper prior",
            )
    return np.asarray(controls, float), np.asarray(draws, float)


@program
def _rooms(
    plan: TrialPlan, limits: tuple, draws: Array, noise: Array | None, controls: Array, ends: Array
) -> tuple[Array, Array]:
    of_draws = jax.vmap(least_rooms, in_axes=(None, None, 0, None, None if noise is None else 0))
    return jax.vmap(lambda control, end: of_draws(plan.until(end), limits, draws, control, noise))(controls, ends)


@program
def _paired_rooms(plan: TrialPlan, limits: tuple, controls: Array, draws: Array) -> tuple[Array, Array]:
    return jax.vmap(lambda control, values: least_rooms(plan, limits, values, control))(controls, draws)


def _checked(
    plan: TrialPlan, controls: np.ndarray, draws: np.ndarray, probability: float
) -> tuple[np.ndarray, np.ndarray]:
    if not 0 < probability < 1:
        raise InputError(
            "safety, probability",
            found=f"{probability:g}",
            expected="between 0 and 1",
            remedy="0.95 is a common choice",
        )
    size = len(draws)
    most = float(probability_at_least(np.array(size), size)) if size else 1.0
    if most < probability:
        raise InputError(
            "safety, draws",
            found=f"{size} draws, which show at most a probability of {most:.4g}",
            expected=f"enough draws to show {probability:g} with confidence {CONFIDENCE:g}",
            remedy=f"take at least {ceil(log(1 - CONFIDENCE) / log(probability))} draws, or ask for less",
        )
    return check_runs(plan, controls, draws)
