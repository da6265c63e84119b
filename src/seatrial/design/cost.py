"""What a trial costs in joules, and what it teaches for each of them.

    energy = integral of (hotel load + propulsion),  propeller P = P_0 |n / n_0|^3

The cube is that of a propeller at one advance ratio (Carlton, Marine Propellers and Propulsion, 2018): a fast change of speed takes
more than it says. Nothing is won back by braking.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.compiled.pytrees import compiled_tree
from seatrial.core.errors import InputError
from seatrial.design.integrals import follow_joint
from seatrial.design.safety import check_runs
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan


@compiled_tree("control")
@dataclass(frozen=True)
class ElectricPower:
    """What a vehicle draws: `hotel` W always, and its propeller `propulsion` W at the speed `at`, rad/s."""

    hotel: float
    propulsion: float
    at: float
    control: str

    def driven(self, now: Mapping[str, Any]) -> Any:
        """Power of the propeller, W, from the signals at one time: the cube of its speed; traced."""
        share = abs(now[self.control] / self.at)
        return self.propulsion * share * share * share

    def total(self, now: Mapping[str, Any]) -> Any:
        """All that is drawn, W, from the signals at one time; traced."""
        return self.hotel + self.driven(now)


def expected_joules(
    plan: TrialPlan, power: ElectricPower, controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> Float[np.ndarray, " D"]:
    """Energy of each design, expected over draws; simulated only under an autopilot, infinite if such a motion diverges.

    Args:
        plan: vehicle and start of the trial.
        power: what is drawn.
        controls: every control of each design, held from each sample to the next, SI.
        draws: coefficients drawn from what is believed, SI.

    Raises:
        InputError: arrays of other shapes or without a number.
    """
    controls, draws = check_runs(plan, controls, draws)
    if plan.autopilot is None:
        now = {name: controls[..., i] for i, name in enumerate(plan.model.controls)}
        return power.total(now) @ np.asarray(plan.step)
    (spent,) = in_blocks(lambda control: (_totals(plan, power, control, draws),), controls)
    finite = np.isfinite(spent)
    return np.where(finite.all(1), np.where(finite, spent, 0.0).mean(1), np.inf)


def gain_per_cost(gain: Float[np.ndarray, "*any"], cost: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """What each design teaches for each joule; an infinite cost gives 0.

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


@program
def _totals(plan: TrialPlan, power: ElectricPower, controls: Array, draws: Array) -> Array:
    def total(values: Array, control: Array) -> Array:
        end, _, _ = follow_joint(plan, {"spent": power.total}, values, control, lambda memory, now: (memory, None))
        return end["spent"]

    return jax.vmap(lambda control: jax.vmap(lambda values: total(values, control))(draws))(controls)
