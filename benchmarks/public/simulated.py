"""A simulated vehicle with what no model of ours contains, for a set that needs no download.

Per unit of mass and inertia, added mass included, with x the place of eleven strips along the hull and w = v + x r the flow across each:

    u' = a - 0.10 u - 0.35 u|u| + 1.4 v r - 0.06 u^2 d^2 + waves
    v' = -0.45 u r - 0.50 u v - 0.60 mean(w^3 + w|w|) + 0.22 u^2 d + waves
    r' = -0.55 u v - 0.90 u r - 0.80 mean(x (w^3 + w|w|)) - 0.85 u^2 d + waves

The thrust a and the rudder angle d follow their commands late (0.8 s and 0.4 s), and not at all within a dead zone (0.03 m/s^2 and
2 deg); waves are nine sines about 1.1 rad/s. The numbers are of no vehicle.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.public.set_file import BenchmarkSet
from seatrial.core.errors import InputError
from seatrial.core.files import write_text
from seatrial.core.units import quantity

SAMPLE, INNER = 0.2, 4
"""Time between samples, s, and steps of the integration between them."""
STRIPS = np.linspace(-0.8, 0.8, 11)
LAGS = np.array([0.8, 0.4])
DEAD_ZONES = np.array([0.03, np.radians(2.0)])
WAVES = np.array([0.02, 0.02, 0.015])
"""Standard deviation of the waves' accelerations, m/s^2 and rad/s^2."""
NOISE = np.array([0.01, 0.01, 0.005])
"""Standard deviation of the sensors of u, v (m/s) and r (rad/s)."""
HELD = (3.0, 12.0)
"""Shortest and longest time for which a command is held, s."""
MASS = 40.0
"""Of the thrust that is written, kg."""
COLUMNS = ("t", "tau_X", "delta_r", "u", "v", "r")


def make_records(benchmark_set: BenchmarkSet, folder: Path) -> None:
    """Simulate the runs of a set and write each as `RUN.csv`; the same seed gives the same files.

    Raises:
        InputError: a run of the set that it does not make, or a duration, thrust or rudder that is none.
    """
    assert benchmark_set.made is not None
    for run in (*benchmark_set.fit, *benchmark_set.held_back):
        if run not in benchmark_set.made.runs:
            raise InputError(
                f"{benchmark_set.path}, made.runs.{run}",
                found="nothing",
                expected="how each run of [import] is made",
                remedy=f"add [made.runs.{run}] with duration, thrust and rudder",
            )
    for index, (run, table) in enumerate(benchmark_set.made.runs.items()):
        where = f"{benchmark_set.path}, made.runs.{run}"
        duration = quantity(table.duration, "s", f"{where}.duration")
        largest = np.array(
            [quantity(table.thrust, "N", f"{where}.thrust"), quantity(table.rudder, "rad", f"{where}.rudder")]
        )
        if not 10 * SAMPLE < duration <= 3600.0 or not (largest > 0).all():
            raise InputError(
                where,
                found=f"{duration:g} s, {largest[0]:g} N and {np.degrees(largest[1]):g} deg",
                expected="2 s to an hour, and positive sizes",
                remedy="correct them",
            )
        random = np.random.default_rng([benchmark_set.made.seed, index])
        columns = simulate(duration, largest, random)
        lines = [
            ",".join(COLUMNS),
            *(",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values(), strict=True)),
        ]
        text = "\n".join(lines) + "\n"
        path = folder / f"{run}.csv"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            write_text(path, text)


def simulate(duration: float, largest: np.ndarray, random: np.random.Generator) -> Mapping[str, np.ndarray]:
    """Return one run: `COLUMNS`, SI, with noise.

    Args:
        duration: s.
        largest: thrust, N, and rudder angle, rad, of the commands, shape (2,).
        random: of commands, waves and noise.
    """
    time = np.arange(0.0, duration, SAMPLE)
    command = np.column_stack([_steps(time, random, 0.2, 1.0), _steps(time, random, -1.0, 1.0)]) * largest
    frequency = 1.1 + 0.25 * random.standard_normal((9, 3))
    phase = random.uniform(0.0, 2 * np.pi, (9, 3))
    state, states = np.zeros(5), np.empty((time.size, 3))
    h = SAMPLE / INNER
    for k, begin in enumerate(time):
        states[k] = state[:3]
        asked = command[k] / (MASS, 1.0)
        for j in range(INNER):
            pushes = [
                WAVES * np.sqrt(2 / 9) * np.sin(frequency * t + phase).sum(0)
                for t in begin + h * (j + np.array([0, 0.5, 1]))
            ]
            one = _rates(state, asked, pushes[0])
            two = _rates(state + 0.5 * h * one, asked, pushes[1])
            three = _rates(state + 0.5 * h * two, asked, pushes[1])
            four = _rates(state + h * three, asked, pushes[2])
            state = state + h / 6 * (one + 2 * two + 2 * three + four)
    shown = states + NOISE * random.standard_normal(states.shape)
    return dict(zip(COLUMNS, (time, *command.T, *shown.T), strict=True))


def _rates(state: np.ndarray, asked: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """Rates of u, v, r and of the two actuators."""
    u, v, r = state[:3]
    acting = state[3:]
    a, d = np.sign(acting) * np.maximum(np.abs(acting) - DEAD_ZONES, 0.0)
    across = v + STRIPS * r
    drag = across**3 + across * np.abs(across)
    motion = (
        a - 0.10 * u - 0.35 * u * abs(u) + 1.4 * v * r - 0.06 * u * u * d * d,
        -0.45 * u * r - 0.50 * u * v - 0.60 * drag.mean() + 0.22 * u * u * d,
        -0.55 * u * v - 0.90 * u * r - 0.80 * (STRIPS * drag).mean() - 0.85 * u * u * d,
    )
    return np.concatenate([np.array(motion) + waves, (asked - acting) / LAGS])


def _steps(time: np.ndarray, random: np.random.Generator, low: float, high: float) -> np.ndarray:
    """Random steps of random lengths, between the two levels."""
    steps, at = np.empty(time.size), 0.0
    while at <= time[-1]:
        steps[time >= at] = random.uniform(low, high)
        at += random.uniform(*HELD)
    return steps
