"""The most informative free-form input inside hard limits: many starts, gradients through the simulator, rounding to the bounds.

    max  mean over points of 1/2 ln det(I + P0^-1) + 1/2 ln det P0   (nats)
    s.t. bounds of amplitude and rate, return to trim, limits of motion at every sample

Each start is followed by sequential quadratic programming (Kraft, 1988; SciPy's SLSQP) with exact derivatives. The optimum of an
input bounded in amplitude is mostly at its bounds, so that levels are then exchanged for bounds, one by one, while that helps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.reporter import Progress, Reporter, no_progress
from seatrial.design.design_problem import DesignProblem, check_whole_trials
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.free_form_optimise import ROUNDING, Climb, gentled
from seatrial.design.free_form_problem import FreeFormProblem, check_problem
from seatrial.design.prior_belief import prior_cov
from seatrial.design.results import FreeTrial
from seatrial.design.robust import utility_table
from seatrial.design.trial_design import Beside
from seatrial.manoeuvres.free_form import SteppedInput, nearest_levels
from seatrial.manoeuvres.manoeuvre import Manoeuvre

ACTIVE_SHARE = 1e-3  # A limit is active when less than this share of its room is left
UTILITY_POINTS = 4  # Draws of the priors over which the utility is averaged
SAFE_DRAWS = 64  # Draws for which limits of the motion hold during the search; judged on fresh ones afterwards
RISK_SHARE = 0.75  # Share of the risk allowed that the search takes: the rest is for what draws it has not seen
EQUAL_GAIN = 0.05  # Designs this close in nats are as good as each other: five per cent of one standard deviation


class ClimbOutcome(NamedTuple):
    """What became of one start; utilities in nats.

    Attributes:
        name: of the start.
        before: utility of the start, drawn towards trim where it broke a limit.
        utility: after rounding to the bounds.
        levels: final levels, SI, shape (m,).
        steps: of the gradient search.
        converged: whether that ended by itself.
    """

    name: str
    before: float
    utility: float
    levels: Float[np.ndarray, " m"]
    steps: int
    converged: bool


@dataclass(frozen=True, eq=False)
class FreeFormDesign:
    """The best design found.

    Attributes:
        manoeuvre: the input.
        levels: its levels, SI, shape (m,).
        utility: expected gain, nats.
        active: limits that hold it back.
        outcomes: of every start.
        at_bounds: share of the levels at a bound of the amplitude.
        status: in words.
    """

    manoeuvre: Manoeuvre
    levels: Float[np.ndarray, " m"]
    utility: float
    active: tuple[str, ...]
    outcomes: tuple[ClimbOutcome, ...]
    at_bounds: float
    status: str


def design_free_form(
    problem: FreeFormProblem,
    starts: Mapping[str, Float[np.ndarray, " m"]],
    steps: int = 150,
    progress: Progress = no_progress,
) -> FreeFormDesign:
    """Find the levels that teach most.

    Args:
        problem: what is to be learned, and the limits.
        starts: levels by name, SI.
        steps: most steps of the gradient search from each start.
        progress: called with the steps done and the steps in all.

    Raises:
        InputError: limits that admit nothing (the two that conflict are named, and by how much), or settings that do not fit.
        NumericalError: the vehicle diverges inside the limits.
    """
    rooms, setup = check_problem(problem), problem.setup()
    everyone = Climb(problem, setup, problem.watched(), rooms, np.ones(problem.safe_for.shape[0], bool))
    chosen = {name: gentled(problem, _change(problem, name, levels)) for name, levels in starts.items()}
    if not chosen:
        raise InputError("free-form design, starts", found="none", expected="at least one", remedy="give a start")
    results = []
    for i, (name, x) in enumerate(chosen.items()):
        climb = replace(everyone, kept=_kept(everyone, x))
        begin = climb.pulled_in(x)
        climbed, done, converged = climb.gradient_search(
            x, steps, lambda done, i=i: progress(i * steps + done, len(chosen) * steps)
        )
        before, after = climb.utilities(np.array([begin, climbed]))
        final, gain = climb.rounded(climbed if after >= before else begin)
        levels = problem.form.trim + problem.span * final
        results.append((ClimbOutcome(name, float(before), gain, levels, done, converged), climb, final))
        progress((i + 1) * steps, len(chosen) * steps)
    best, climb, x = max(results, key=lambda each: each[0].utility)
    outcomes = tuple(outcome for outcome, _, _ in results)
    low, high = problem.box
    return FreeFormDesign(
        problem.form.manoeuvre(best.levels),
        best.levels,
        best.utility,
        _active(climb, x),
        outcomes,
        float(((x <= low + ROUNDING) | (x >= high - ROUNDING)).mean()),
        _status(best, outcomes),
    )


def _change(problem: FreeFormProblem, name: str, levels: np.ndarray) -> np.ndarray:
    """Return the levels of a start as changes from trim over the span."""
    levels = np.asarray(levels, float)
    if levels.shape != (problem.form.size,) or not np.isfinite(levels).all():
        raise InputError(
            f"free-form design, start {name}",
            found=f"shape {levels.shape}, {int((~np.isfinite(levels)).sum())} not finite",
            expected=f"{problem.form.size} finite levels",
            remedy="`nearest_levels` finds those nearest to a sampled control",
        )
    return (levels - problem.form.trim) / problem.span


def _kept(everyone: Climb, x: np.ndarray) -> np.ndarray:
    """Return all draws but those that fare worst under a start, as many as may; one that trim itself endangers fares worst of all."""
    left_out = everyone.problem.left_out
    if not left_out:
        return everyone.kept
    worst = everyone.draw_excess(x) + np.where(everyone.draw_excess(np.zeros_like(x)) > 0, np.inf, 0.0)
    kept = np.ones(everyone.kept.size, bool)
    kept[np.argsort(-worst, kind="stable")[:left_out]] = False
    return kept


def _active(climb: Climb, x: np.ndarray) -> tuple[str, ...]:
    """Return the limits of which the worst value over all samples, and over all draws but those that may break them, leaves no room."""
    problem, limits, step = climb.problem, climb.problem.limits, float(np.median(climb.setup.plan.step))
    _, control = problem.form.manoeuvre(problem.form.trim + problem.span * x).sample(step)
    left = {
        f"upper limit of {problem.form.control}": (problem.ends[1] - float(control.max())) / problem.span,
        f"lower limit of {problem.form.control}": (float(control.min()) - problem.ends[0]) / problem.span,
    }
    if limits.rate is not None:
        left[f"rate limit of {problem.form.control}"] = 1.0 - float(np.abs(np.diff(control)).max()) / step / limits.rate
    course = climb.course(x)
    left |= {room.name: -float(room.shortfall(course).max()) for room in climb.rooms}
    return tuple(name for name, share in left.items() if share <= ACTIVE_SHARE)


def _status(best: ClimbOutcome, outcomes: tuple[ClimbOutcome, ...]) -> str:
    gains = np.array([outcome.utility for outcome in outcomes])
    messages = [f"{best.utility:.3f} nats from {best.name}"]
    if gains.size > 1:
        alike = int((gains > best.utility - EQUAL_GAIN).sum())
        messages.append(
            f"{alike} of {gains.size} starts end within {EQUAL_GAIN:g} nat of it, the worst {np.ptp(gains):.3f} below"
        )
    stopped = [outcome.name for outcome in outcomes if not outcome.converged]
    if stopped:
        messages.append(f"the gradient search has not converged from {', '.join(stopped)}: more steps may help")
    return "; ".join(messages)


@dataclass(frozen=True)
class FreeFormSearch:
    """A number of levels of equal length in the active time of the families; see `Search`."""

    levels: int

    def check(self, problem: DesignProblem) -> None:
        """Check that a problem allows a free form, before any work.

        Raises:
            InputError: several controls that move together, designs that are counted by the second or joule, a control without both bounds.
        """
        family, limits = problem.family, problem.driven
        if family.beside:
            raise InputError(
                problem.place("design.together"),
                found=f"{', '.join(one.control for one in family.beside)} beside {family.control}, with a free form",
                expected="one control or set-point, because only its levels are searched",
                remedy="leave out `together` or the free form",
            )
        check_whole_trials(problem.per, problem.place, "a free form")
        if None in (limits.lower, limits.upper) or inf in (abs(limits.lower or 0.0), abs(limits.upper or 0.0)):
            unit = shown_unit(family.control)[1]
            raise InputError(
                problem.place(f"limits.{family.control}"),
                found="a bound that is missing",
                expected="lower and upper, because a free form uses the whole range",
                remedy=f'for example lower = "800 {unit}"',
            )

    def find(self, problem: DesignProblem, beside: Beside, reporter: Reporter) -> FreeTrial:
        """See `Search`."""
        self.check(problem)
        form, plan, cov = self._form(problem), problem.plan(), prior_cov(problem.belief)
        draws = problem.draws_for("draws of the free form")
        best = beside().best
        family = best.best_manoeuvre()
        search = FreeFormProblem(
            plan,
            form,
            problem.driven,
            draws[:UTILITY_POINTS],
            cov,
            dict(problem.trim_of(problem.family)),
            motion=problem.motion,
            draws=draws[:SAFE_DRAWS],
            risk=RISK_SHARE * (1.0 - problem.probability),
        )
        random, bounds = np.random.default_rng(problem.seed), (problem.driven.lower, problem.driven.upper)
        near = nearest_levels(form, *family.sample(best.family.sample_time))
        starts = {f"the best {family.name}": near}
        starts |= {f"random levels {i + 1}": random.choice(np.array(bounds, float), form.size) for i in range(2)}
        progress = reporter.progress("free-form design")
        optimum = design_free_form(search, starts, progress=progress)
        controls = np.stack([_commands(problem, plan.commands, one) for one in (optimum.manoeuvre, family)])
        # Both by the same measure, on draws that had no part in the search.
        fresh = draws[SAFE_DRAWS : SAFE_DRAWS + 64]
        judged = utility_table(plan, controls, fresh, find_criterion("fisher-d", cov)).mean(1)
        return FreeTrial(
            tuple(map(float, optimum.levels)),
            float(judged[0]),
            float(judged[1]),
            family.name,
            float(optimum.at_bounds),
            optimum.active,
            problem.safety_lines(plan, controls[0], draws[len(draws) // 2 :]),
            tuple((one.name, float(one.before), float(one.utility)) for one in optimum.outcomes),
            optimum.status,
        )

    def manoeuvre(self, problem: DesignProblem, trial: FreeTrial) -> Manoeuvre:
        """Return the result as a trial to run."""
        return self._form(problem).manoeuvre(np.array(trial.levels))

    def edge(self, problem: DesignProblem) -> float:
        """Return the time that each change of level takes, s: the ramp of the families, or the whole interval if that is shorter."""
        return self._form(problem).edge

    def _form(self, problem: DesignProblem) -> SteppedInput:
        """Levels over the active time of the families, and the way back to trim after it, or before the end of the trial."""
        family = problem.family
        active = min(family.active, family.duration - family.start - family.ramp)
        times = family.duration, family.start, active
        edge = min(family.ramp, active / self.levels)
        return SteppedInput(family.control, family.trim, *times, self.levels, edge)


def _commands(problem: DesignProblem, names: tuple[str, ...], manoeuvre: Manoeuvre) -> Float[np.ndarray, "n c"]:
    """Return every command of a trial, SI: all but the one that is driven at trim."""
    _, driven = manoeuvre.sample(problem.family.sample_time)
    held = {**dict(problem.trim_of(problem.family)), problem.family.control: driven}
    return np.column_stack([np.broadcast_to(held[name], driven.shape) for name in names])
