"""A free-form design problem: what is to be learned, by which input, inside which limits; and whether the limits admit any."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import floor, inf
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.free_form_objective import Course, Setup, Watched, courses
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.free_form import SteppedInput
from seatrial.manoeuvres.manoeuvre import Limits


@dataclass(frozen=True, eq=False)
class FreeFormProblem:
    """What a free-form search needs to know; P points, S draws, k coefficients.

    Attributes:
        plan: vehicle, its start, sensors and times.
        form: the input and its levels.
        limits: of the control or set-point; both bounds are needed.
        points: coefficients over which the utility is averaged, SI, shape (P, k): one for a local design, draws from the prior
            for an averaged one.
        prior_cov: covariance of the coefficients before the trial, SI, shape (k, k).
        held: value at trim of every command that is not driven.
        motion: limits of the motion.
        draws: coefficients for which these hold, shape (S, k); the points, if not given.
        risk: share of the draws that may break them; those that fare worst at the start of each climb are left out.
    """

    plan: TrialPlan
    form: SteppedInput
    limits: Limits
    points: Float[np.ndarray, "P k"]
    prior_cov: Float[np.ndarray, "k k"]
    held: Mapping[str, float] = field(default_factory=dict)
    motion: tuple[MotionLimit, ...] = ()
    draws: Float[np.ndarray, "S k"] | None = None
    risk: float = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """Bounds of the control, SI; not finite where a limit is missing."""
        lower, upper = self.limits.lower, self.limits.upper
        return -inf if lower is None else lower, inf if upper is None else upper

    @property
    def span(self) -> float:
        """Larger distance from trim to a bound of the control, SI: the unit of the search."""
        return max(self.ends[1] - self.form.trim, self.form.trim - self.ends[0])

    @property
    def box(self) -> tuple[float, float]:
        """Bounds of the control as changes from trim over the span."""
        return (self.ends[0] - self.form.trim) / self.span, (self.ends[1] - self.form.trim) / self.span

    @cached_property
    def block(self) -> int:
        """Samples in one interval of the input."""
        return max(1, round(self.form.active / self.form.size / float(np.median(self.plan.step))))

    @property
    def safe_for(self) -> np.ndarray:
        """Coefficients for which the course must be safe, shape (S, k)."""
        return np.asarray(self.points if self.draws is None else self.draws, float)

    @property
    def left_out(self) -> int:
        """Draws that may break the bounds."""
        return floor(self.risk * self.safe_for.shape[0] + 1e-9)

    def setup(self) -> Setup:
        """Return the numbers of the search."""
        names = self.plan.commands
        trim = np.array([self.form.trim if name == self.form.control else self.held[name] for name in names])
        span = np.array([self.span if name == self.form.control else 0.0 for name in names])
        basis, points = self.form.basis(self.plan.time), np.asarray(self.points, float)
        return jax.device_put(Setup(self.plan, trim, span, basis, points, np.linalg.cholesky(self.prior_cov)))

    def watched(self) -> Watched:
        """Return what the search looks at on the way."""
        return Watched(self.motion, jax.device_put(self.safe_for))

    def linear(self) -> tuple[Float[np.ndarray, "r m"], Float[np.ndarray, " r"]]:
        """Return the rows A and bounds b of the limits of the rate, A x <= b; bounds of the levels are those of the box."""
        if self.limits.rate is None:
            return np.zeros((0, self.form.size)), np.zeros(0)
        rates = self.form.rates() * self.span / self.limits.rate
        return np.concatenate([rates, -rates]), np.ones(2 * len(rates))


class Room(NamedTuple):
    """One bound of the course.

    Attributes:
        name: for tables.
        index: of the quantity among those of all limits of the motion.
        side: +1 for an upper bound and -1 for a lower.
        bound: SI.
        scale: its distance from the course at trim.
    """

    name: str
    index: int
    side: float
    bound: float
    scale: float

    def reached(self, course: Course) -> np.ndarray:
        """Return the extremes on the side of the bound; the axis of quantities is dropped."""
        return np.asarray(course.highest if self.side > 0 else course.lowest)[..., self.index]

    def shortfall(self, course: Course) -> np.ndarray:
        """Return how far the extremes are beyond the bound, as a share of its distance from trim; negative inside."""
        return self.side * (self.reached(course) - self.bound) / self.scale


def check_problem(problem: FreeFormProblem) -> tuple[Room, ...]:
    """Check that some input is inside the limits: trim is.

    Returns:
        The bounds of the motion, each with its distance from the course at trim.

    Raises:
        InputError: limits that admit nothing, naming the two that conflict and by how much.
        NumericalError: the vehicle diverges at trim.
    """
    _check_control(problem)
    still = np.zeros((1, problem.form.size))
    course = Course(
        *(np.asarray(each)[0] for each in courses(problem.setup(), problem.watched(), still, problem.block))
    )
    if not all(np.isfinite(each).all() for each in course):
        raise NumericalError("the vehicle diverges at trim for some of the given coefficients; narrow the prior")
    rooms, inside = [], []
    for index, limit in enumerate(problem.motion):
        for name, side, bound in (("upper", 1.0, limit.upper), ("lower", -1.0, limit.lower)):
            if abs(bound) < inf:
                factor, unit = limit.shown
                room = Room(f"{name} bound {bound * factor:g} {unit} of {limit.signal}", index, side, bound, 1.0)
                inside.append(-room.shortfall(course).max(-1))
                left = float(np.sort(inside[-1])[problem.left_out])
                rooms.append(room._replace(scale=max(left, 1e-3 * abs(bound), 1e-9)))
    _check_trim(problem, np.array(inside), [room.name for room in rooms])
    return tuple(rooms)


def _check_control(problem: FreeFormProblem) -> None:
    limits, form = problem.limits, problem.form
    where = f"free-form design, control {form.control}"
    if limits.lower is None or limits.upper is None:
        raise InputError(
            where,
            found=f"lower limit {limits.lower}, upper limit {limits.upper}",
            expected="both, because information grows with the amplitude",
            remedy="give the bounds of the actuator",
        )
    for low, low_name, high, high_name in (
        (limits.lower, "lower limit", form.trim, "trim"),
        (form.trim, "trim", limits.upper, "upper limit"),
    ):
        if not low <= high:
            raise InputError(
                where,
                found=f"{low_name} {low:g} above {high_name} {high:g} by {low - high:.6g} (SI)",
                expected="lower limit <= trim <= upper limit: the trial begins and ends at trim",
                remedy="correct the limits or the trim value",
            )
    if limits.rate is None:
        return
    swing = limits.upper - limits.lower
    if not form.rates().size:
        raise InputError(
            where,
            found=f"rate limit {limits.rate:g} per s against edges of 0 s: a step to trim has no finite rate",
            expected=f"edges of {swing / limits.rate:.4g} s for the full swing of {swing:g}, or shorter ones for less (SI)",
            remedy="set `edge`, or use a spline",
        )


def _check_trim(problem: FreeFormProblem, inside: np.ndarray, names: list[str]) -> None:
    """Check the distances to the bounds at trim, shape (bounds, S)."""
    broken = int((inside < 0).any(0).sum()) if names else 0
    if broken > problem.left_out:
        draws = inside.shape[1]
        share = "" if draws == 1 else f"; {broken} of {draws} draws break a bound, {problem.left_out} may"
        beyond = [f"{name} by {-row.min():.6g}" for name, row in zip(names, inside, strict=True) if row.min() < 0]
        raise InputError(
            "free-form design, limits",
            found=f"trim breaks the {' and the '.join(beyond)} (SI){share}",
            expected="bounds that the vehicle keeps at trim, the start and end of the trial",
            remedy="widen the bound, or choose another trim",
        )
