"""Profile likelihood: how far the best fit falls when one parameter is held and the others follow.

    l_p(c_i) = max over the others of log p(y | c),    95 % interval: where l_p >= max l_p - 1.92

1.92 is half the 95 % point of chi-square with one degree of freedom (Wilks, 1938). Along the way r = sign(c_i - c^_i)
sqrt(2 (max l_p - l_p)) is nearly a straight line, so that the points and the ends of the interval are found by following it.
Where l_p does not fall by 1.92 inside the prior's bounds, the interval is open on that side.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seatrial.core.argument_checks import check_kind, check_known, check_names
from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior.information import slopes_of_present
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior, check_posterior
from seatrial.estimation.posterior.profile_result import DROP, Profile

# Climb the log-likelihood from many starts at once, inside the prior's bounds, with a parameter held in each.
#
# Newton's method with exact derivatives in scaled parameters: (|H| + damping) step = gradient, the damping raised
# where a step does not climb (Levenberg, 1944); parameters pushed against a bound stay there.

UNBOUNDED_SDS = 6.0  # Prior standard deviations taken for a bound where a prior has none
MAX_ITERATIONS = 60
MIN_GAIN = 1e-7  # Promised gain in log-likelihood below which a climb has arrived


class Slope(NamedTuple):
    """Posterior with the scale of each parameter and its bounds, a hair inside the prior's."""

    posterior: Posterior
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Maxima(NamedTuple):
    """Maxima found: parameter values, shape (n, d), and log-likelihoods, shape (n,)."""

    values: np.ndarray
    height: np.ndarray


def bounded_slope(posterior: Posterior, mode: Mode) -> Slope:
    """Return a posterior's likelihood to climb inside its prior's bounds."""
    ends = []
    for parameter in posterior.present_parameters:
        low, high = (float(bound) for bound in parameter.prior.bounds)
        mean, far = float(parameter.prior.mean), UNBOUNDED_SDS * float(parameter.prior.sd)
        low, high = (low if np.isfinite(low) else mean - far), (high if np.isfinite(high) else mean + far)
        hair = 1e-6 * (high - low)
        ends.append((low + hair, high - hair))
    lower, upper = np.array(ends).T
    scale = np.minimum(np.maximum(mode.sd, 1e-9 * (upper - lower)), (upper - lower) / 4)
    return Slope(posterior, scale, lower, upper)


def maximise_rows(problem: Slope, starts: np.ndarray, held: Sequence[int | None]) -> Maxima:
    """Maximise over all parameters but the held one of each row; a row whose likelihood is zero at its start stays there."""
    points = np.clip(starts, problem.lower, problem.upper)
    height, gradient, information = _slopes_at(problem.posterior, points)
    height = np.where(np.isfinite(height), height, -np.inf)
    damping, active = np.full(len(points), 1e-6), np.isfinite(height)
    for _ in range(MAX_ITERATIONS):
        rows = np.flatnonzero(active).tolist()
        moved, promised = points.copy(), np.zeros(len(points))
        for row in rows:
            step, promised[row] = _newton(
                problem, points[row], gradient[row], information[row], held[row], damping[row]
            )
            moved[row] = np.clip(points[row] + step, problem.lower, problem.upper)
        active[rows] = promised[rows] > MIN_GAIN
        rows = np.flatnonzero(active).tolist()
        if not rows:
            break
        tried = _slopes_at(problem.posterior, moved[rows])
        for row, value, slope, bend in zip(rows, *tried, strict=True):
            if np.isfinite(value) and value >= height[row] and np.isfinite(bend).all():
                points[row], height[row], gradient[row], information[row] = moved[row], value, slope, bend
                damping[row] = max(damping[row] / 10, 1e-6)
            else:
                damping[row] = max(10 * damping[row], 1e-2)
                active[row] = damping[row] < 1e12
    return Maxima(points, height)


def _slopes_at(posterior: Posterior, points: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(
        np.stack(part) for part in zip(*(slopes_of_present(posterior, point) for point in points), strict=True)
    )


def _newton(
    problem: Slope, point: np.ndarray, gradient: np.ndarray, information: np.ndarray, held: int | None, damping: float
) -> tuple[np.ndarray, float]:
    """Step uphill in scaled parameters, those left out that are held or pushed against a bound, and the gain it promises."""
    scale = problem.scale
    slope, bend = gradient * scale, information * np.outer(scale, scale)
    stuck = ((point <= problem.lower) & (slope < 0)) | ((point >= problem.upper) & (slope > 0))
    if held is not None:
        stuck[held] = True
    free = np.flatnonzero(~stuck)
    if free.size == 0:
        return np.zeros(point.size), 0.0
    eigenvalues, vectors = np.linalg.eigh(bend[np.ix_(free, free)])
    stiff = np.maximum(np.abs(eigenvalues), 1e-4) + damping * max(1.0, np.abs(eigenvalues).max())
    along = (vectors.T @ slope[free]) / stiff
    step = np.zeros(point.size)
    step[free] = vectors @ along
    return step * scale, float(0.5 * along @ (vectors.T @ slope[free]))


CROSSING = float(np.sqrt(2 * DROP))  # Value of r at the ends of the interval
ROOT_STEP = 0.5  # Distance of neighbouring points in r
ROOT_TOLERANCE = 1e-3  # Accuracy of r at the ends of an interval
MAX_POINTS = 40


def profile_likelihood(posterior: Posterior, mode: Mode, names: Sequence[str] | None = None) -> tuple[Profile, ...]:
    """Return profile likelihoods, all parameters and both sides followed at once, each point started from the one before.

    Args:
        posterior: posterior; of its prior only the bounds matter.
        mode: its mode, where the search begins.
        names: parameters to profile; None for all.

    Returns:
        one profile for each parameter, in the order of the names: values in its SI unit, and the fall of the log-likelihood there.

    Raises:
        InputError: no posterior, no mode, or no such parameter.
        NumericalError: the likelihood at the mode is not finite, or a better fit keeps turning up along the profiles.
    """
    check_posterior(posterior)
    check_kind(mode, Mode, "mode", "find it with `find_mode`")
    if names is not None:
        check_known(check_names(names, "names", posterior.present_names[0]), posterior.present_names, "names")
    chosen = [posterior.present_names.index(name) for name in (posterior.present_names if names is None else names)]
    problem = bounded_slope(posterior, mode)
    start = np.asarray(mode.values, float)
    for _ in range(4):
        best = maximise_rows(problem, start[None], [None])
        if not np.isfinite(best.height[0]):
            raise NumericalError(
                "profile likelihood: the likelihood at the posterior mode is not finite; narrow the priors"
            )
        paths = _follow(problem, best, chosen)
        highest = max((point for path in paths for point in path.points), key=lambda point: point.height, default=None)
        if highest is None or highest.height <= best.height[0] + 0.01:
            return tuple(_profile(problem, best, i, paths[2 * k : 2 * k + 2]) for k, i in enumerate(chosen))
        start = highest.values
    raise NumericalError(
        "profile likelihood: a better fit was found along a profile four times; the likelihood has several maxima, "
        "narrow the priors to one of them"
    )


class _Point(NamedTuple):
    """One point of a path: parameter values, log-likelihood and signed root r."""

    values: np.ndarray
    height: float
    root: float


@dataclass
class _Path:
    """One side of one profile on its way outwards."""

    index: int
    sign: float
    points: list[_Point]
    done: bool = False


def _follow(problem: Slope, best: Maxima, chosen: Sequence[int]) -> list[_Path]:
    """Walk outwards until each profile has fallen by 1.92 or met its bound, then pin down where it crosses."""
    peak = _Point(best.values[0], float(best.height[0]), 0.0)
    paths = [_Path(i, sign, [peak]) for i in chosen for sign in (-1.0, 1.0)]
    for _ in range(MAX_POINTS):
        walking = [path for path in paths if not path.done]
        if not walking:
            return paths
        starts = np.array([_next_start(problem, path) for path in walking])
        result = maximise_rows(problem, starts, [path.index for path in walking])
        for path, values, height in zip(walking, result.values, result.height, strict=True):
            root = float(np.sqrt(2 * max(peak.height - height, 0.0)))
            path.points.append(_Point(values, float(height), root))
            path.points.sort(key=lambda point: path.sign * point.values[path.index])
            path.done = _is_done(problem, path)
    return paths


def _bracket(path: _Path) -> tuple[_Point, _Point | None]:
    """Return the last point before the crossing and the first beyond it, None if there is none yet."""
    beyond = next((k for k, point in enumerate(path.points) if point.root > CROSSING), None)
    return (path.points[-1], None) if beyond is None else (path.points[beyond - 1], path.points[beyond])


def _is_done(problem: Slope, path: _Path) -> bool:
    inside, outside = _bracket(path)
    at = path.index
    if outside is None:
        end = (problem.upper if path.sign > 0 else problem.lower)[at]
        return abs(end - inside.values[at]) <= 1e-9 * problem.scale[at]
    close = min(abs(inside.root - CROSSING), abs(outside.root - CROSSING)) < ROOT_TOLERANCE
    return close or abs(outside.values[at] - inside.values[at]) < 1e-6 * problem.scale[at]


def _next_start(problem: Slope, path: _Path) -> np.ndarray:
    """Return where to go next: outwards by a step in r, or between the two points that hold the crossing; the others on a line."""
    i = path.index
    inside, outside = _bracket(path)
    if outside is not None:
        if not np.isfinite(outside.root) or len(path.points) % 3 == 0:
            share = 0.5
        else:
            share = np.clip((CROSSING - inside.root) / (outside.root - inside.root), 0.02, 0.98)
        if np.isfinite(outside.root):
            return inside.values + share * (outside.values - inside.values)
        moved = inside.values.copy()
        moved[i] += share * (outside.values[i] - inside.values[i])
        return moved
    last = path.points[-1]
    if len(path.points) == 1:
        moved = last.values.copy()
        moved[i] += path.sign * ROOT_STEP * problem.scale[i]
    else:
        before = path.points[-2]
        stride = min(2.0, (min(ROOT_STEP, max(CROSSING - last.root, 0.1)) + 0.01) / max(last.root - before.root, 1e-9))
        moved = last.values + stride * (last.values - before.values)
    moved[i] = np.clip(moved[i], problem.lower[i], problem.upper[i])
    return moved


def _profile(problem: Slope, best: Maxima, index: int, paths: Sequence[_Path]) -> Profile:
    below, above = paths
    points = [*reversed(below.points[1:]), below.points[0], *above.points[1:]]
    parameter = problem.posterior.present_parameters[index]

    def end(path: _Path) -> float:
        inside, outside = _bracket(path)
        if outside is None:
            return path.sign * float("inf")
        share = (CROSSING - inside.root) / (outside.root - inside.root)
        return float(inside.values[index] + share * (outside.values[index] - inside.values[index]))

    return Profile(
        parameter.name,
        parameter.unit,
        parameter.label,
        float(best.values[0, index]),
        np.array([point.values[index] for point in points]),
        np.array([0.5 * point.root**2 for point in points]),
        np.array([point.values for point in points]),
        end(below),
        end(above),
        (float(problem.lower[index]), float(problem.upper[index])),
    )
