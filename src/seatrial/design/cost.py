"""What a trial costs: seconds, joules or just itself, and what it teaches for each of them.

    energy = fixed + integral of (hotel load + propulsion),  propeller P = P_0 |n / n_0|^3,  force P = |tau u| / efficiency

The cube is that of a propeller at one advance ratio (Carlton, Marine Propellers and Propulsion, 2018): a fast change of speed takes
more than it says. A force at rest costs nothing here, though a thruster would. Nothing is won back by braking.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.programs import program
from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.errors import InputError, nearest
from seatrial.design.integrals import follow_joint
from seatrial.design.safety import check_runs
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan


class Consumer(Protocol):
    """What draws power besides the hotel load."""

    @property
    def signals(self) -> tuple[str, ...]:
        """Controls and states that its power depends on."""
        ...

    @property
    def numbers(self) -> tuple[float, ...]:
        """Its settings, all of which must be positive."""
        ...

    def watts(self, now: Mapping[str, Any]) -> Any:
        """Electric power, W, from the signals at one time; traced."""
        ...


@compiled_tree("control")
@dataclass(frozen=True)
class PropellerPower:
    """Power of a propeller through one known operating point: `power` W at the speed `at`, rad/s."""

    power: float
    at: float
    control: str = "n"

    @property
    def signals(self) -> tuple[str, ...]:
        """Its speed."""
        return (self.control,)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The operating point."""
        return (self.power, self.at)

    def watts(self, now: Mapping[str, Any]) -> Any:
        """Cube of the speed."""
        share = abs(now[self.control] / self.at)
        return self.power * share * share * share


@compiled_tree("force", "speed")
@dataclass(frozen=True)
class ForcePower:
    """Power of a commanded force along a velocity, over the efficiency of the drive, 0 < efficiency <= 1."""

    efficiency: float
    force: str = "tau_X"
    speed: str = "u"

    @property
    def signals(self) -> tuple[str, ...]:
        """Force and velocity."""
        return (self.force, self.speed)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The efficiency."""
        return (self.efficiency,)

    def watts(self, now: Mapping[str, Any]) -> Any:
        """Mechanical power over the efficiency."""
        return abs(now[self.force] * now[self.speed]) / self.efficiency


@compiled_tree("unit")
@dataclass(frozen=True)
class TrialCost:
    """Cost of a trial: fixed, plus a rate over its time. See `in_joules`.

    Attributes:
        unit: s, J, or trials.
        fixed: spent on every trial, whatever its length: the way there, the turn, the settling.
        rate: spent every second.
        consumers: spend on top of the rate, W.
    """

    unit: str
    fixed: float
    rate: float
    consumers: tuple[Consumer, ...] = ()

    def per_second(self, now: Mapping[str, Any]) -> Any:
        """Rate at which cost runs up, from the signals at one time; traced."""
        return sum((consumer.watts(now) for consumer in self.consumers), jnp.asarray(self.rate, float))


class ExpectedCost(NamedTuple):
    """Cost of D designs, expected over draws.

    Attributes:
        mean: infinite where a motion on which the cost depends diverges.
        error: standard error of the mean, 0 where the cost does not depend on the motion; NaN of a single draw.
        diverged: draws whose motion diverges; 0 where the cost does not depend on it.
        unit: s, J or trials.
    """

    mean: Float[np.ndarray, " D"]
    error: Float[np.ndarray, " D"]
    diverged: Int[np.ndarray, " D"]
    unit: str


def in_joules(hotel: float, *consumers: Consumer, fixed: float = 0.0) -> TrialCost:
    """Energy as the cost: hotel load, W, propulsion, and a fixed amount around every trial, J."""
    return TrialCost("J", fixed, hotel, consumers)


def expected_cost(
    plan: TrialPlan, cost: TrialCost, controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> ExpectedCost:
    """Expected cost of each design; simulated only if the cost depends on the motion.

    Args:
        plan: vehicle and start of the trial.
        cost: what is counted.
        controls: every control of each design, held from each sample to the next, SI.
        draws: coefficients drawn from what is believed, SI.

    Raises:
        InputError: a cost that the vehicle cannot have or that is nowhere positive, arrays of other shapes or without a number.
    """
    check_cost(plan, cost)
    controls, draws = check_runs(plan, controls, draws)
    names = plan.model.controls
    if plan.autopilot is None and all(name in names for consumer in cost.consumers for name in consumer.signals):
        now = {name: controls[..., i] for i, name in enumerate(names)}
        spent = np.broadcast_to(cost.per_second(now), controls.shape[:2]) @ np.asarray(plan.step)
        none = np.zeros(len(controls))
        return ExpectedCost(cost.fixed + spent, none, none.astype(int), cost.unit)
    (total,) = in_blocks(lambda control: (_totals(plan, cost, control, draws),), controls)
    finite = np.isfinite(total)
    whole, kept = finite.all(1), np.where(finite, total, 0.0)
    error = kept.std(1, ddof=1) / np.sqrt(len(draws)) if len(draws) > 1 else np.full(len(controls), np.nan)
    return ExpectedCost(
        np.where(whole, kept.mean(1), np.inf), np.where(whole, error, np.inf), (~finite).sum(1), cost.unit
    )


def gain_per_cost(gain: Float[np.ndarray, "*any"], cost: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """What each design teaches for each second, joule or trial; an infinite cost gives 0.

    Args:
        gain: utility less that of no trial at all, for example nats of entropy reduction.
        cost: of each design.

    Raises:
        InputError: a negative gain, for which the dearer of two equal designs would look the better, or a cost that is not positive.
    """
    gain, cost = np.asarray(gain, float), np.asarray(cost, float)
    if not (gain >= 0).all():
        raise InputError(
            "gain per cost",
            found=f"a least gain of {gain.min():.4g}",
            expected="gains from 0, the value of no trial",
            remedy="subtract the utility of no information, or use one that starts at 0, such as the entropy reduction",
        )
    if not (cost > 0).all():
        raise InputError(
            "gain per cost",
            found=f"a least cost of {cost.min():.4g}",
            expected="positive costs",
            remedy="count the time or the hotel load of the trial",
        )
    return gain / cost


def check_cost(plan: TrialPlan, cost: TrialCost) -> None:
    """Check a cost against a vehicle.

    Raises:
        InputError: numbers that are negative or not finite, no cost at all, or signals that the vehicle does not have.
    """
    model = plan.model
    for name, value in (("fixed cost", cost.fixed), ("hotel load or rate", cost.rate)):
        if not (isfinite(value) and value >= 0):
            raise InputError(
                f"trial cost, {name}", found=f"{value:g}", expected="0 or more", remedy="give it in s, W or J"
            )
    if not (cost.fixed or cost.rate or cost.consumers):
        raise InputError(
            "trial cost", found="nothing that costs", expected="a fixed cost, a load or a consumer", remedy="add one"
        )
    for consumer in cost.consumers:
        kind = type(consumer).__name__
        if not all(isfinite(number) and number > 0 for number in consumer.numbers):
            raise InputError(
                f"trial cost, {kind}",
                found=", ".join(f"{number:g}" for number in consumer.numbers),
                expected="positive numbers, SI",
                remedy="give the power in W and the speed in rad/s of one measured point, or an efficiency up to 1",
            )
        if isinstance(consumer, ForcePower) and consumer.efficiency > 1:
            raise InputError(
                f"trial cost, {kind}",
                found=f"an efficiency of {consumer.efficiency:g}",
                expected="above 0 and up to 1",
                remedy="write 60 % as 0.6",
            )
        for name in consumer.signals:
            if name not in (*model.controls, *model.states):
                raise InputError(
                    f"trial cost, {kind}",
                    found=f'"{name}", which the vehicle "{model.name}" does not have',
                    expected="one of its controls: "
                    + ", ".join(model.controls)
                    + "; or states: "
                    + ", ".join(model.states),
                    remedy=nearest(name, (*model.controls, *model.states)),
                )


@program
def _totals(plan: TrialPlan, cost: TrialCost, controls: Array, draws: Array) -> Array:
    def total(values: Array, control: Array) -> Array:
        end, _, _ = follow_joint(plan, {"spent": cost.per_second}, values, control, lambda memory, now: (memory, None))
        return cost.fixed + end["spent"]

    return jax.vmap(lambda control: jax.vmap(lambda values: total(values, control))(draws))(controls)
