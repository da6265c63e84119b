"""The self-oscillating test: a sweep over amplitude and threshold, and its loop closed on every vehicle that is believed possible."""

from dataclasses import dataclass
from math import inf

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import Reporter
from seatrial.core.signals import QUATERNION
from seatrial.design.design_problem import UTILITY_DRAWS, DesignProblem, check_whole_trials
from seatrial.design.entropy import entropy_reduction
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.prior_belief import prior_cov
from seatrial.design.results import RelayTrial
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_runs, probability_at_least
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_design import Beside
from seatrial.design.trial_plan import TrialPlan
from seatrial.filters.belief import Filter
from seatrial.filters.run import filter_within
from seatrial.filters.square_root import unscented_filter
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre
from seatrial.manoeuvres.relay import RelayFamily, oscillation, replay, run_relay
from seatrial.numerics.state_space import StateSpace


@dataclass(frozen=True, eq=False)
class RelaySweep:
    """Entropy reduction over a grid; A amplitudes, T thresholds.

    Attributes:
        family: timing and shape of the designs.
        amplitude: change of control from trim, SI, shape (A,).
        threshold: change of output from trim at which the control is reversed, SI, shape (T,).
        gain: entropy reduction, nats, NaN if the design breaks a limit, shape (A, T).
        peak_speed: largest |u| of the predicted motion, m/s, shape (A, T).
        final_sd: predicted standard deviation of each coefficient in filter units, shape (A, T, k).
        switches: reversals of the control, shape (A, T).
        reached: largest change of the output from trim, SI, shape (A, T).
    """

    family: RelayFamily
    amplitude: Float[np.ndarray, " A"]
    threshold: Float[np.ndarray, " T"]
    gain: Float[np.ndarray, "A T"]
    peak_speed: Float[np.ndarray, "A T"]
    final_sd: Float[np.ndarray, "A T k"]
    switches: Float[np.ndarray, "A T"]
    reached: Float[np.ndarray, "A T"]

    @property
    def oscillates(self) -> np.ndarray:
        """Whether both thresholds are reached, so that the test is more than a step, shape (A, T)."""
        return self.switches >= 2

    @property
    def best(self) -> tuple[int, int]:
        """Indices of the most informative design inside the limits that oscillates."""
        row, column = np.unravel_index(np.nanargmax(np.where(self.oscillates, self.gain, np.nan)), self.gain.shape)
        return int(row), int(column)


def sweep_relay(
    space: StateSpace,
    family: RelayFamily,
    amplitude: Float[np.ndarray, " A"],
    threshold: Float[np.ndarray, " T"],
    limits: Limits = Limits(),
    method: Filter | None = None,
    measured: Float[np.ndarray, "n m"] | None = None,
    truth: Float[np.ndarray, " d"] | None = None,
    noise: Float[np.ndarray, " n"] | None = None,
) -> RelaySweep:
    """Predict every design's entropy reduction by running the filter over the closed loop the current belief expects.

    Args:
        space: state space; its initial belief is what is known before the trial.
        family: control, output, trim and timing.
        amplitude: changes of control from trim, SI.
        threshold: changes of output from trim, SI.
        limits: bounds of the control.
        method: filter; the square-root unscented one, if not given.
        measured: 1 if a channel is measured, 0 elsewhere; None for every sample.
        truth: state and coefficients that generate the noise-free measurements; None for the mean of the initial belief.
        noise: error of the output as the relay sees it, the same for all designs; None for a perfect sensor.

    Raises:
        InputError: no design inside the limits, or none that oscillates.
        NumericalError: the expected motion diverges or the filter fails for a design that is inside the limits.
    """
    amplitudes, thresholds = (grid.ravel() for grid in np.meshgrid(amplitude, threshold, indexing="ij"))
    allowed = _allowed(family, amplitudes, limits)
    n = family.time().size
    mask = np.ones((n, len(space.outputs))) if measured is None else measured
    start = space.initial.mean if truth is None else np.asarray(truth, float)
    gaps = np.where(mask > 0, 0.0, np.nan)
    error = np.zeros(n) if noise is None else np.asarray(noise, float)
    method = method or unscented_filter(len(space.states))
    gain, peak, sd, switches, reached, failures = in_blocks(
        lambda a, y: _predict(method, family, space, start, a, y, gaps, error), amplitudes, thresholds
    )
    broken = allowed & ((failures > 0) | ~np.isfinite(gain))
    if broken.any():
        worst = int(np.argmax(broken))
        raise NumericalError(
            f"the filter failed for {broken.sum()} of {allowed.sum()} designs, first at amplitude {amplitudes[worst]:.4g} "
            f"and threshold {thresholds[worst]:.4g} (SI). The expected motion diverges or the prior is too wide: narrow the priors"
        )
    if not (switches[allowed] >= 2).any():
        raise InputError(
            f"design grid, output {family.output}",
            found=f"a largest change from trim of {reached[allowed].max():.4g} (SI), and never on both sides",
            expected=f"at least one design that goes {thresholds.min():.4g} either way and so oscillates",
            remedy="raise the amplitudes, lower the thresholds, lengthen the trial, or change the sign of `effect`",
        )
    shape = (len(amplitude), len(threshold))
    return RelaySweep(
        family,
        np.asarray(amplitude, float),
        np.asarray(threshold, float),
        np.where(allowed, gain, np.nan).reshape(shape),
        peak.reshape(shape),
        sd.reshape(*shape, -1),
        switches.reshape(shape),
        reached.reshape(shape),
    )


def _allowed(family: RelayFamily, amplitudes: np.ndarray, limits: Limits) -> np.ndarray:
    excesses = []
    for amplitude in amplitudes:
        # The steepest edge goes from one side to the other: a relay never does more.
        step = min(2 * amplitude, family.rate * family.sample_time)
        edge = family.control_trim + np.append(np.arange(-amplitude, amplitude, step), amplitude)
        excesses.append(limits.excess(edge, family.sample_time))
    allowed = np.array([not excess for excess in excesses])
    if not allowed.any():
        gentlest = excesses[int(np.argmin(amplitudes))]
        raise InputError(
            f"design grid, control {family.control}",
            found="; ".join(
                f"{name} limit {bound:.6g}, but the gentlest design reaches {value:.6g}"
                for name, (value, bound) in gentlest.items()
            )
            + " (SI)",
            expected="at least one design inside the limits",
            remedy="lower the amplitudes, set `rate` if that is the broken limit, or widen the limits if the vehicle allows it",
        )
    return allowed


@program(static_argnums=(0, 1))
def _predict(
    method: Filter,
    family: RelayFamily,
    space: StateSpace,
    start: Array,
    amplitudes: Array,
    thresholds: Array,
    gaps: Array,
    error: Array,
):
    def one(amplitude: Array, threshold: Array):
        run = run_relay(space, family, amplitude, threshold, start, error)
        step = jnp.full(run.control.shape[0], family.sample_time)
        summary = filter_within(method, space, run.control, run.outputs + gaps, step)
        gain = entropy_reduction(space.initial, summary.final, space.n_dynamic)
        peak = jnp.max(jnp.abs(run.state[:, 0]))
        return gain, peak, summary.final.sd[space.n_dynamic :], run.switches, run.reached, summary.failures

    return jax.vmap(one)(amplitudes, thresholds)


# The search: the most informative of these tests that surely oscillates and keeps the limits, each vehicle's loop closed by itself.

# Thresholds that are proposed, as shares of what a step of the control by its least amplitude comes to
PROPOSED_SHARES = (0.2, 0.8)
RANGE_QUANTILES = (0.05, 0.5, 0.95)  # Quantiles over the vehicles that the priors allow


@dataclass(frozen=True, eq=False)
class RelayLoop:
    """A relay and the vehicle that is believed in.

    Attributes:
        family: what is switched and fed back.
        space: state space of the belief; coefficients in units of `scales`.
        scales: SI, shape (k,).
        plan: of the trials.
    """

    family: RelayFamily
    space: StateSpace
    scales: np.ndarray
    plan: TrialPlan

    def runs(self, amplitude: float, threshold: float, draws: np.ndarray, noise: np.ndarray) -> list[np.ndarray]:
        """Controls and outputs fed back of one design with every draw, shapes (S, n, c) and (S, n)."""
        d = self.space.n_dynamic
        starts = np.hstack([np.tile(self.space.initial.mean[:d], (len(draws), 1)), draws / self.scales])
        at = self.space.outputs.index(self.family.output)

        design = np.asarray(amplitude, float), np.asarray(threshold, float)

        def run(start: Array, error: Array) -> tuple[Array, Array]:
            made = run_relay(self.space, self.family, *design, start, error)
            return made.control, made.outputs[..., at]

        return in_blocks(jax.vmap(run), starts, noise)

    def foreseen(self, amplitude: float, threshold: float) -> tuple[Manoeuvre, Float[np.ndarray, " n"]]:
        """One design at the mean of the belief with a perfect sensor, and its output, SI."""
        run = run_relay(self.space, self.family, amplitude, threshold, self.space.initial.mean)
        at = self.space.outputs.index(self.family.output)
        return replay(self.family, amplitude, threshold, run), np.asarray(run.outputs)[:, at]


@dataclass(frozen=True)
class RelaySearch:
    """The amplitude of the grid and the threshold of a self-oscillating test; see `Search`.

    Attributes:
        output: measured channel that is fed back.
        thresholds: distances from its trim at which the control is reversed, SI.
    """

    output: str
    thresholds: tuple[float, ...]

    def check(self, problem: DesignProblem) -> None:
        """Check that a problem has trials in which a relay may act, before any work.

        Raises:
            InputError: designs that are counted by the second, or trials through an autopilot.
        """
        check_whole_trials(problem.per, problem.place, "a self-oscillating test", joules=True)
        if problem.autopilot is not None:
            raise InputError(
                problem.place(f"autopilot.{problem.autopilot.loops[0].holds}"),
                found="trials through an autopilot, with a self-oscillating test, which needs the same actuators",
                expected="trials that act directly on the controls",
                remedy="leave out the self-oscillating test; families, free forms and global searches run through the autopilot",
            )

    def loop(self, problem: DesignProblem) -> RelayLoop:
        """Return the loop under the priors.

        Raises:
            InputError: as `check`, or an output that does not answer the control.
        """
        self.check(problem)
        shared, plan, trim = problem.family, problem.plan(), problem.trim_of(problem.family)
        space, scales = problem.space(shared)
        trimmed = dict(zip(problem.model.states, problem.start, strict=True)).get(self.output, 0.0)
        rate = problem.driven.rate
        family = RelayFamily(
            trim,
            shared.control,
            self.output,
            trimmed,
            shared.duration,
            shared.sample_time,
            shared.start,
            shared.active,
            self._effect(problem, plan, trimmed),
            inf if rate is None else rate,
        )
        return RelayLoop(family, space, scales, plan)

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> RelayTrial:
        """See `Search`."""
        loop, thresholds = self.loop(problem), np.array(self.thresholds)
        draws = problem.draws_for("draws of the self-oscillation")
        noise, half = self._noise(problem, len(draws)), len(draws) // 2
        mask = problem.measured(len(noise[0]), problem.family.sample_time)
        sweep = sweep_relay(
            loop.space, loop.family, problem.amplitudes, thresholds, problem.driven, measured=mask, noise=noise[0]
        )
        row, column, passed_over = _sure_best(problem, loop, sweep, draws[:half], noise[:half], reporter)
        chosen = float(problem.amplitudes[row]), float(thresholds[column])
        fresh, errors = draws[half:], noise[half:]
        controls, outputs = loop.runs(*chosen, fresh, errors)
        safety: tuple[str, ...] = ()
        if problem.motion:
            safety = tuple(judge_runs(loop.plan, controls, fresh, problem.motion, problem.probability).words(0))
        shown = oscillation(loop.family, outputs, outputs + errors, chosen[1])
        oscillates = shown.reversals >= 2
        best = beside().best
        utility, of_best = _judged(loop, prior_cov(problem.belief), fresh, controls, best.best_controls())
        return RelayTrial(
            loop.family.control,
            loop.family.output,
            *chosen,
            loop.family.effect,
            float(sweep.gain[row, column]),
            utility,
            of_best,
            best.family.words,
            float(oscillates.mean()),
            _quantiles(shown.reversals[oscillates].astype(float)),
            _quantiles(shown.period[oscillates]),
            _quantiles(shown.first_overshoot[oscillates]),
            _quantiles(shown.second_overshoot[oscillates]),
            passed_over,
            safety,
        )

    def _noise(self, problem: DesignProblem, count: int) -> Float[np.ndarray, "S n"]:
        """Noise of the output that is fed back in so many runs, SI, NaN if it is not measured."""
        time, at = problem.family.time(), list(problem.noise).index(self.output)
        mask = problem.measured(time.size, problem.family.sample_time)
        drawn = jax.random.normal(random_key(problem.seed, "noise of the output fed back"), (count, len(mask)))
        return np.where(mask[:, at] > 0, problem.noise[self.output] * np.asarray(drawn), np.nan)

    def _effect(self, problem: DesignProblem, plan: TrialPlan, trimmed: float) -> float:
        """Sign of the output's answer to a step of the control, where it first is half of what it comes to."""
        at = plan.channels.index(self.output)
        weight = np.asarray(plan.weight)[:, at]
        answer = _outputs(problem, plan)[weight > 0, at] / weight[weight > 0] - trimmed
        most = np.abs(answer).max()
        if not most > 1e-9:
            raise InputError(
                problem.place("design.relay.output"),
                found=f"{self.output}, which {problem.family.control} does not move at the prior means",
                expected="an output that answers the control",
                remedy="feed another output back, or drive another control",
            )
        return float(np.sign(answer[np.argmax(np.abs(answer) >= 0.5 * most)]))


def proposed_output(problem: DesignProblem) -> tuple[str, float] | None:
    """Return the channel that answers the control most beside its noise, and by how much, SI; None if no channel may be fed back."""
    plan = problem.plan()
    names = [name for name in plan.channels if name not in QUATERNION]
    if not names:
        return None
    answer = np.abs(_outputs(problem, plan) - _outputs(problem, plan, 0.0)).max(0)
    answer = np.where(np.isfinite(answer), answer, 0.0)
    name = max(names, key=lambda one: answer[plan.channels.index(one)])
    return name, max(float(answer[plan.channels.index(name)]), 10.0) * problem.noise[name]


def _outputs(problem: DesignProblem, plan: TrialPlan, share: float = 1.0) -> Float[np.ndarray, "n m"]:
    """Every output over its noise, 0 if it is not measured, after a step of the control by a share of the least amplitude."""
    trim = problem.trim_of(problem.family)
    control = np.tile([value for _, value in trim], (plan.step.shape[0], 1))
    control[:, [name for name, _ in trim].index(problem.family.control)] += share * problem.amplitudes[0]
    return np.asarray(plan.outputs(np.asarray(problem.normal.mean), control))


def _sure_best(
    problem: DesignProblem, loop: RelayLoop, sweep: RelaySweep, draws: np.ndarray, noise: np.ndarray, reporter: Reporter
) -> tuple[int, int, int]:
    """The most informative design that surely oscillates and keeps the limits, each vehicle's loop closed by itself.

    Returns:
        row, column, and how many more informative designs were passed over.
    """
    gain, probability = np.where(sweep.oscillates, sweep.gain, np.nan), problem.probability
    order = [int(i) for i in np.argsort(-gain, axis=None) if np.isfinite(gain.ravel()[i])]
    report, most = reporter.progress("self-oscillation"), (-1.0, "")
    for tried, place in enumerate(order):
        row, column = divmod(place, gain.shape[1])
        report(tried, len(order))
        threshold = float(sweep.threshold[column])
        controls, outputs = loop.runs(float(sweep.amplitude[row]), threshold, draws, noise)
        turns = oscillation(loop.family, outputs, outputs + noise, threshold).reversals >= 2
        kept, words = turns, f"oscillates in {turns.mean():.0%} of the vehicles"
        if problem.motion:
            safety = judge_runs(loop.plan, controls, draws, problem.motion, probability)
            kept, words = turns & safety.held[0].all(1), "; ".join((words, *safety.words(0)))
        if probability_at_least(kept.sum(), len(draws)) >= probability:
            report(len(order), len(order))
            return row, column, tried
        (c, c_unit), (y, y_unit) = shown_unit(loop.family.control), shown_unit(loop.family.output)
        design = f"±{sweep.amplitude[row] * c:.4g} {c_unit} reversed at ±{threshold * y:.4g} {y_unit}"
        most = max(most, (float(kept.mean()), f"{design}, {words}"))
    raise InputError(
        problem.place("design.relay"),
        found=f"{len(order)} of {sweep.gain.size} designs of the grid oscillate at the prior means"
        f", none of them with the required probability; the best, {most[1]}",
        expected=f"one at least that oscillates inside every limit with probability {probability:g}",
        remedy="lower the thresholds, lengthen the trial, narrow priors with a weak response to the control, or widen the limits",
    )


def _judged(
    loop: RelayLoop, cov: np.ndarray, draws: np.ndarray, controls: np.ndarray, family: np.ndarray
) -> tuple[float, float]:
    """Both by the same measure: the test with each draw's own control, the family with one for all."""
    criterion, few = find_criterion("fisher-d", cov), slice(UTILITY_DRAWS)
    (information,) = in_blocks(
        lambda control, values: (_information(loop.plan, control, values),), controls[few], draws[few]
    )
    beside = utility_table(loop.plan, family[None], draws[few], criterion).mean(1)[0]
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
