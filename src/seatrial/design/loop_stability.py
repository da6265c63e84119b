"""Whether an autopilot keeps vehicles stable: how fast small motions about a quiet trial grow, for every vehicle that is believed possible.

    z' = F(z),  growth = ln max |eigenvalue of dF/dz| / time,  z = (vehicle, what the autopilot remembers)

F is the motion over one cycle of all loops, sampled and held as it is; its derivative is exact. It is taken where the trial begins and
where a quiet trial ends. The state that takes the largest part in the fastest mode, by participation factors (Pérez-Arriaga, Verghese and
Schweppe, IEEE Trans. Power App. Syst. 101, 1982), names the axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.core.reporter import Reporter
from seatrial.core.signals import ACTUAL
from seatrial.design.design_problem import DesignProblem
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.posterior.information import fed_back
from seatrial.manoeuvres.autopilot import GAINS, Autopilot, AutopilotMemory, LoopMemory
from seatrial.manoeuvres.pilot import Moment, close_loop
from seatrial.numerics.integrate import rk4_for_slopes
from seatrial.vehicles.simulate import move_by

VEHICLES = 200  # Draws that are looked at
# Share of unstable vehicles from which the autopilot is at fault, and not what is believed of the vehicle
NEARLY_ALL = 0.9
# What moves, in words, by the state that takes the largest part
AXIS_WORDS = {
    **dict.fromkeys(("u", "x"), "surge (speed)"),
    **dict.fromkeys(("v", "r", "psi", "y"), "yaw (heading)"),
    **dict.fromkeys(("w", "z"), "heave (depth)"),
    **dict.fromkeys(("q", "theta"), "pitch"),
    **dict.fromkeys(("p", "phi"), "roll"),
}
FACTORS = (-1.0, 0.5, 2.0)  # By which gains are tried: turned round, halved, doubled


@dataclass(frozen=True, eq=False)
class LoopGrowth:
    """How fast small motions grow, S vehicles.

    Attributes:
        rate: 1/s, infinite if the quiet trial itself diverges, shape (S,).
        state: index of the state with the largest part in the fastest mode, shape (S,).
        duration: of the trial, s.
    """

    rate: Float[np.ndarray, " S"]
    state: np.ndarray
    duration: float

    @property
    def unstable(self) -> Bool[np.ndarray, " S"]:
        """Whether a small motion grows e-fold or more within the trial."""
        return self.rate > 1.0 / self.duration


class GainChange(NamedTuple):
    """A gain of a loop of an autopilot, or all of them, multiplied, and the share of vehicles that are unstable then."""

    holds: str
    gains: tuple[str, ...]
    factor: float
    unstable: float


def loop_growth(
    plan: TrialPlan, trim: Float[np.ndarray, " c"], draws: Float[np.ndarray, "S k"], autopilot: Autopilot | None = None
) -> LoopGrowth:
    """Return how fast small motions grow under the autopilot of a plan.

    Args:
        plan: vehicle, start and autopilot.
        trim: every command of a quiet trial, SI.
        draws: coefficients, SI.
        autopilot: instead of that of the plan.

    Raises:
        InputError: a plan without an autopilot.
    """
    pilot = _pilot_of(plan) if autopilot is None else autopilot
    samples, step = plan.step.shape[0], float(np.asarray(plan.step)[0])
    cycles = max(1, samples // pilot.cycle)
    parts = in_blocks(lambda values: _linearised(plan, pilot, cycles, np.asarray(trim, float), values), draws)
    finite = np.isfinite(parts[1]).all((1, 2))
    fastest = [_fastest(np.where(np.isfinite(part), part, 0.0), len(plan.model.states)) for part in parts]
    sizes = np.stack([size for size, _ in fastest])
    rate = np.log(np.maximum(sizes.max(0), 1e-300)) / (pilot.cycle * step)
    state = np.stack([state for _, state in fastest])[sizes.argmax(0), np.arange(len(draws))]
    return LoopGrowth(np.where(finite, rate, np.inf), state, samples * step)


def best_gain_change(
    plan: TrialPlan, trim: Float[np.ndarray, " c"], draws: Float[np.ndarray, "S k"]
) -> GainChange | None:
    """Return the gain that, turned round, halved or doubled, leaves the fewest vehicles unstable, or the loop that, turned round as a
    whole, does; None if no change helps.

    Arguments and errors as `loop_growth`.
    """
    autopilot = _pilot_of(plan)
    best, least = None, float(loop_growth(plan, trim, draws).unstable.mean())
    for loop in autopilot.loops:
        gains = [gain for gain in GAINS if getattr(loop, gain) != 0]
        tried = [((gain,), factor) for gain in gains for factor in FACTORS]
        tried += [(tuple(gains), -1.0)] if len(gains) > 1 else []
        for some, factor in tried:
            changed = autopilot
            for gain in some:
                changed = changed.with_gain(loop.holds, gain, factor)
            share = float(loop_growth(plan, trim, draws, changed).unstable.mean())
            if share < least:
                best, least = GainChange(loop.holds, some, factor, share), share
    return best


def _pilot_of(plan: TrialPlan) -> Autopilot:
    if plan.autopilot is None:
        raise InputError("plan, autopilot", found="none", expected="an autopilot", remedy="plan the trial with one")
    return plan.autopilot


def _fastest(jacobians: Float[np.ndarray, "S d d"], n_states: int) -> tuple[Float[np.ndarray, " S"], np.ndarray]:
    """Return the largest size of an eigenvalue, and the state with the largest part in its mode."""
    values, right = np.linalg.eig(jacobians)
    at = np.abs(values).argmax(1)
    each = np.arange(len(at))
    left = np.linalg.pinv(right)[each, at]
    part = np.abs(right[each, :, at] * left)[:, :n_states]
    return np.abs(values[each, at]), part.argmax(1)


@program(static_argnums=2)
def _linearised(plan: TrialPlan, pilot: Autopilot, cycles: int, trim: Array, draws: Array) -> tuple[Array, Array]:
    """Return dF/dz where the trial begins, and where a quiet one ends."""
    n, n_loops, commands = len(plan.model.states), len(pilot.loops), tuple(trim)
    quiet = Moment(0.0, commands, tuple(jnp.zeros(()) for _ in pilot.outputs))

    def apart(z: Array, count: Array) -> tuple[tuple, AutopilotMemory]:
        loops = tuple(LoopMemory(*(z[n + 4 * i + j] for j in range(4))) for i in range(n_loops))
        return tuple(z[i] for i in range(n)), AutopilotMemory(count, loops)

    def together(state: tuple, memory: AutopilotMemory) -> Array:
        return jnp.stack([jnp.asarray(x, float) for x in (*state, *(x for loop in memory.loops for x in loop))])

    def one(values: Array) -> tuple[Array, Array]:
        params = plan.named(values)
        law, move = close_loop(pilot, fed_back(plan.model, pilot, params)), move_by(plan.model, params, rk4_for_slopes)

        def over_cycle(z: Array, count: Array) -> Array:
            def advance(carry: tuple, _: None) -> tuple[tuple, None]:
                state, memory = apart(*carry)
                held, memory = law(state, memory, quiet)
                return (together(move(state, held, plan.step[0]), memory), memory.count), None

            (z, _), _ = jax.lax.scan(advance, (z, count), None, length=pilot.cycle)
            return z

        begin = pilot.begin()
        first = over_cycle(together(tuple(plan.start[i] for i in range(n)), begin), begin.count)
        later = jnp.asarray(pilot.cycle)  # any count but the first: from then on there is a measurement before
        last, _ = jax.lax.scan(lambda z, _: (over_cycle(z, later), None), first, None, length=cycles)
        slope = jax.jacfwd(over_cycle)
        return slope(first, later), slope(last, later)

    return jax.vmap(one)(draws)


# Before anything is designed: whether the autopilot holds what is believed possible, and if not, the change that helps.


def check_autopilot(problem: DesignProblem, reporter: Reporter) -> None:
    """Check that the autopilot keeps vehicles stable with the probability with which limits are kept; tells it if some are not.

    Raises:
        InputError: too many vehicles that are unstable under the autopilot.
    """
    if problem.autopilot is None:
        return
    few, plan = problem.draws[:VEHICLES], problem.plan()
    trim = np.array([value for _, value in problem.trim_of(problem.family)])
    growth = loop_growth(plan, trim, few)
    lost = growth.unstable
    if not lost.any():
        return
    share, probability = float(lost.mean()), problem.probability
    states, counts = np.unique(growth.state[lost], return_counts=True)
    state = problem.model.states[int(states[counts.argmax()])]
    axis = AXIS_WORDS.get(state, f"the actuator {state.removesuffix(ACTUAL)}")
    doubling = float(np.log(2) / np.median(growth.rate[lost]))
    finding = f"{share:.0%} of the vehicles that the priors allow are unstable under the autopilot, most in {axis}" + (
        f": a small motion there doubles in {doubling:.2g} s" if doubling > 0 else ": they run away"
    )
    remedy = _advice(best_gain_change(plan, trim, few), share)
    if share > 1.0 - probability:
        raise InputError(
            problem.place(f"autopilot.{problem.autopilot.loops[0].holds}"),
            found=finding,
            expected=f"an autopilot that holds {probability:.0%} of them",
            remedy=remedy,
        )
    reporter.say(f"caution: {finding}; {remedy}")


def _advice(change: GainChange | None, share: float) -> str:
    """Return what to do where a share of the vehicles is unstable."""
    if change is None or change.unstable > NEARLY_ALL:
        helps = "no single gain, if reversed, halved or doubled, helps"
        if share > NEARLY_ALL:
            return (
                "the autopilot is unstable for all values of the priors. Check the signs of its gains and controls, and tune it on calm "
                f"water first; {helps}"
            )
        return f"{helps}: narrow the priors, or tune the autopilot on calm water first"
    verb = "turn the sign of" if change.factor < 0 else "halve" if change.factor < 1 else "double"
    gains = " and ".join(f"{gain} ({GAINS[gain]} gain)" for gain in change.gains)
    return f"{verb} {gains} of [autopilot.{change.holds}]: {change.unstable:.0%} remain unstable then"
