"""Inputs from which a free-form search may start: the best doublet, random binary levels, and the best of many multisines."""

import numpy as np
from jaxtyping import Float

from seatrial.design.free_form_course import Setup, utilities
from seatrial.design.free_form_problem import FreeFormProblem
from seatrial.design.sweep import LANES, in_blocks

ROUNDS = 30
"""Of projections onto all limits."""


def ready_starts(
    problem: FreeFormProblem, setup: Setup, rng: np.random.Generator, random: int
) -> dict[str, Float[np.ndarray, " m"]]:
    """Starts by name, as changes from trim over the span, inside the limits of amplitude and rate.

    Args:
        problem: limits and input.
        setup: its numbers.
        rng: of the random levels and phases.
        random: number of random binary starts.
    """
    low, high = problem.box
    m = problem.form.size
    starts = {
        "best doublet": best_of(problem, setup, doublets(m, low, high)),
        "best multisine": best_of(problem, setup, _multisines(m, rng) * min(-low, high) if low < 0 < high else None),
    }
    starts |= {f"random binary {i + 1}": np.where(rng.random(m) < 0.5, low, high) for i in range(random)}
    return {name: gentled(problem, x) for name, x in starts.items() if x is not None}


def doublets(m: int, low: float, high: float) -> Float[np.ndarray, "designs m"]:
    """Whole doublets of every period and number that fit, either side first, from the first level on."""
    found = []
    for half in range(1, max(m // 2, 1) + 1):
        for count in range(1, max(m // (2 * half), 1) + 1):
            side = np.zeros(m)
            side[: 2 * half * count] = np.tile(np.repeat([1.0, -1.0], half), count)[:m]
            found += [side, -side]
    sides = np.array(found)
    return np.where(sides > 0, high, np.where(sides < 0, low, 0.0))


def best_of(problem: FreeFormProblem, setup: Setup, x: np.ndarray | None) -> np.ndarray | None:
    """The most informative of several inputs once each is inside the limits of amplitude and rate."""
    if x is None:
        return None
    inside = gentled(problem, x)
    (gain,) = in_blocks(lambda lanes: utilities(setup, lanes, problem.block), inside)
    return inside[int(np.argmax(np.where(np.isfinite(gain), gain, -np.inf)))]


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
        for i in np.tile(np.arange(most.size), ROUNDS):
            moved = np.maximum(held[..., i] + (x @ rows[i] - most[i]) / norms[i], 0.0) - held[..., i]
            held[..., i] += moved
            x = x - moved[..., None] * rows[i]
    bounds = np.concatenate([most, np.full(x.shape[-1], high), np.full(x.shape[-1], -low)])
    reached = np.concatenate([x @ rows.T, x, -x], -1)
    over = np.max(reached / np.maximum(bounds, 1e-12), axis=-1, keepdims=True)
    return x / np.maximum(over, 1.0)


def _multisines(m: int, rng: np.random.Generator) -> Float[np.ndarray, "designs m"]:
    """Sums of the lowest harmonics with random phases, their largest value one, as many as are computed at once."""
    time = (np.arange(m) + 0.5) / m
    found = []
    for _ in range(LANES):
        harmonics = np.arange(1, rng.integers(1, max(m // 6, 2) + 1) + 1)
        sums = np.sin(2 * np.pi * (harmonics * time[:, None] + rng.random(harmonics.size))).sum(1)
        found.append(sums / np.abs(sums).max())
    return np.array(found)
