"""From one start to a local optimum: gradient steps inside the limits, then levels exchanged for bounds while that helps."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from jaxtyping import Bool, Float

from seatrial.core.errors import NumericalError
from seatrial.design.free_form_objective import (
    Course,
    Setup,
    Watched,
    courses,
    utilities,
    utility,
    utility_slope,
    worst_course,
    worst_course_slope,
)
from seatrial.design.free_form_problem import FreeFormProblem, Room
from seatrial.design.sweep import LANES, in_blocks

PROJECTION_ROUNDS = 30  # Of projections onto all limits


def gentled(problem: FreeFormProblem, x: Float[np.ndarray, "... m"]) -> Float[np.ndarray, "... m"]:
    """Inputs inside the limits of amplitude and rate and near the given ones, one of which may be given alone.

    Projections onto one limit after the other in turn (Hildreth, 1957) end at the nearest input inside; what a few rounds of
    them leave is removed by drawing the input towards trim.
    """
    low, high = problem.box
    rows, most = problem.linear()
    x = np.clip(x, low, high)
    if most.size:
        norms, held = (rows**2).sum(1), np.zeros((*x.shape[:-1], most.size))
        for i in np.tile(np.arange(most.size), PROJECTION_ROUNDS):
            moved = np.maximum(held[..., i] + (x @ rows[i] - most[i]) / norms[i], 0.0) - held[..., i]
            held[..., i] += moved
            x = x - moved[..., None] * rows[i]
    bounds = np.concatenate([most, np.full(x.shape[-1], high), np.full(x.shape[-1], -low)])
    reached = np.concatenate([x @ rows.T, x, -x], -1)
    over = np.max(reached / np.maximum(bounds, 1e-12), axis=-1, keepdims=True)
    return x / np.maximum(over, 1.0)


ROUNDING = 1e-9  # Shares of a limit's room, and nats, that are not told from zero
MIN_STEP_GAIN = 1e-5  # Nats by which a step of the gradient search must still gain


@dataclass(frozen=True, eq=False)
class Climb:
    """A problem for one set of draws; inputs x are changes of the levels from trim over the span, limits are g(x) <= 0.

    Attributes:
        problem: what is to be learned, and the limits.
        setup: its numbers.
        watched: what is looked at on the way.
        rooms: bounds of the motion.
        kept: draws for which bounds must hold, shape (S,).
    """

    problem: FreeFormProblem
    setup: Setup
    watched: Watched
    rooms: tuple[Room, ...]
    kept: Bool[np.ndarray, " S"]

    def utilities(self, x: Float[np.ndarray, "lanes m"]) -> Float[np.ndarray, " lanes"]:
        """Return the utilities of several inputs, nats.

        Raises:
            NumericalError: the vehicle diverges.
        """
        (gain,) = in_blocks(lambda lanes: utilities(self.setup, lanes, self.problem.block), x)
        return _finite(gain)

    def excess(self, x: Float[np.ndarray, "lanes m"]) -> Float[np.ndarray, " lanes"]:
        """Return how far several inputs are beyond the worst of all limits, as a share of its room; negative inside."""
        low, high = self.problem.box
        rows, most = self._linear
        worst = np.concatenate([x - high, low - x, x @ rows.T - most], 1).max(1)
        if self.rooms:
            course = self._course(x)
            worst = np.maximum(worst, np.where(self.kept, self._beyond(course).max(-1), -np.inf).max(-1))
        return worst

    def draw_excess(self, x: Float[np.ndarray, " m"]) -> Float[np.ndarray, " S"]:
        """Return how far one input takes every draw beyond the worst bound of motion, as a share of its room."""
        if not self.rooms:
            return np.full(self.kept.size, -np.inf)
        return self._beyond(self._course(x[None])).max(-1)[0]

    def course(self, x: Float[np.ndarray, " m"]) -> Course:
        """Return where one input takes the draws that are kept: they lead each shape."""
        result = courses(self.setup, self.watched, np.asarray(x)[None], self.problem.block)
        return Course(*(np.asarray(each)[0][self.kept] for each in result))

    def pulled_in(self, x: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the input drawn towards trim, which is inside, as little as the limits ask for.

        Raises:
            NumericalError: not even trim is inside, for the draws that are kept.
        """
        shrink = np.append(0.0, np.logspace(-12, 0, LANES - 1))
        tried = (1 - shrink)[:, None] * np.clip(x, *self.problem.box)
        inside = self.excess(tried) <= ROUNDING
        if not inside.any():
            raise NumericalError("trim breaks a limit by rounding: widen the limit slightly")
        return tried[int(np.argmax(inside))]

    def gradient_search(
        self, x: Float[np.ndarray, " m"], steps: int, notify: Callable[[int], None]
    ) -> tuple[Float[np.ndarray, " m"], int, bool]:
        """Sequential quadratic programming with exact derivatives; its end, drawn inside; its steps; whether it ended by itself."""
        rows, most = self._linear
        done = [0]

        def count(_: np.ndarray) -> None:
            done[0] += 1
            notify(min(done[0], steps))

        def gain(x: np.ndarray) -> float:
            return float(_finite(np.asarray(utility(self.setup, np.asarray(x), self.problem.block))))

        def slope(x: np.ndarray) -> np.ndarray:
            return np.asarray(utility_slope(self.setup, np.asarray(x), self.problem.block))

        constraints = []
        if most.size:
            constraints.append({"type": "ineq", "fun": lambda x: most - rows @ x, "jac": lambda x: -rows})
        if self.rooms:
            constraints.append(
                {"type": "ineq", "fun": lambda x: -self._worst(x), "jac": lambda x: -self._worst_slope(x)}
            )
        result = scipy.optimize.minimize(
            lambda x: -gain(x),
            x,
            jac=lambda x: -slope(x),
            method="SLSQP",
            bounds=[self.problem.box] * x.size,
            constraints=constraints,
            callback=count,
            options={"maxiter": steps, "ftol": MIN_STEP_GAIN},
        )
        return self.pulled_in(result.x), done[0], bool(result.success)

    def rounded(self, x: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, " m"], float]:
        """Exchange levels for bounds, all at once and then the best one at a time, while that raises the utility; and the utility."""
        low, high = self.problem.box
        best = float(self.utilities(x[None])[0])
        together = np.where(x > 0.5 * (low + high), high, low)[None]
        while True:
            alone = np.concatenate([np.where(np.eye(x.size, dtype=bool), bound, x) for bound in (low, high)])
            candidates = np.concatenate([together, alone])
            candidates = candidates[np.abs(candidates - x).max(1) > ROUNDING]
            gain = self.utilities(candidates)
            better = np.flatnonzero(gain > best + ROUNDING)
            inside = better[self.excess(candidates[better]) <= ROUNDING] if better.size else better
            if not inside.size:
                return x, best
            chosen = inside[int(np.argmax(gain[inside]))]
            x, best = candidates[chosen], float(gain[chosen])

    @cached_property
    def _linear(self) -> tuple[np.ndarray, np.ndarray]:
        return self.problem.linear()

    def _course(self, x: np.ndarray) -> Course:
        return Course(*in_blocks(lambda lanes: courses(self.setup, self.watched, lanes, self.problem.block), x))

    def _beyond(self, course: Course) -> np.ndarray:
        """Return the shares by which bounds of motion are exceeded, block by block, the last axis over all of them."""
        return np.concatenate([room.shortfall(course) for room in self.rooms], -1)

    def _worst(self, x: np.ndarray) -> np.ndarray:
        """Return the same of the worst draw that is kept."""
        result = worst_course(self.setup, self.watched, np.asarray(x), np.asarray(self.kept), self.problem.block)
        return self._beyond(Course(*map(np.asarray, result)))

    def _worst_slope(self, x: np.ndarray) -> np.ndarray:
        """Its Jacobian."""
        slope = worst_course_slope(self.setup, self.watched, np.asarray(x), np.asarray(self.kept), self.problem.block)
        results = [
            room.side * np.asarray(slope.highest if room.side > 0 else slope.lowest)[:, room.index] / room.scale
            for room in self.rooms
        ]
        return np.concatenate(results)


def _finite(gain: np.ndarray) -> np.ndarray:
    if not np.isfinite(gain).all():
        raise NumericalError(
            "the vehicle diverges under an input inside the limits, or its information is not finite; narrow the prior or the limits"
        )
    return gain
