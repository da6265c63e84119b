"""Six degrees of freedom against C and against a NumPy simulator as users write it, and how long the first call takes to compile."""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from reference import as_c, load, on_cores
from timing import Ratio, Row, agree, alternate, row

from seatrial.compiled.batching import map_lanes
from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.hull import added_mass_matrix, rigid_mass_matrix
from seatrial.vehicles.simulate import simulate

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.vehicles import prestero_twin

VEHICLE = load_vehicle("remus100_prestero")
MODEL = VEHICLE.build(positions=("x", "y", "z"))
NAMES = tuple(VEHICLE.coefficients)
START = np.array([1.5, *np.zeros(8), 1.0, *np.zeros(3)])
STEP = 0.01
WIDTHS = (4, 8, 16, 32)
NS = "ns per lane and step"
GROUP = "six degrees of freedom, 1 000 lanes x 500 steps"


def speed(cores: int) -> list[Row | Ratio]:
    """RK4 steps for 1 000 parameter vectors: the states at the end, from the same coefficients and fins."""
    lanes, n = 1_000, 500
    rudder, plane = fins(n)
    values = np.stack([VEHICLE.coefficients[name] * factor for name, factor in zip(NAMES, _spread(lanes), strict=True)])
    parts = [dict(zip(NAMES, map(jnp.asarray, part), strict=True)) for part in np.array_split(values, cores, axis=1)]
    batch = jax.jit(
        lambda part: map_lanes(lambda own: final(own, jnp.asarray(rudder), jnp.asarray(plane)), part, cpu=64)
    )
    blocks, out = _inverse_blocks(), np.empty((13, lanes))

    def ours() -> np.ndarray:
        return np.concatenate(on_cores(cores, lambda part: np.asarray(batch(part)), parts))

    def reference(width: int) -> np.ndarray:
        function = load("reference_whole.c", f"-DWIDTH={width}").whole_final
        arguments = [as_c(item) for item in (lanes, n, values, rudder, plane, START, STEP, blocks, out)]
        share = -(-lanes // (cores * width)) * width
        ranges = [(first, min(first + share, lanes)) for first in range(0, lanes, share)]
        on_cores(cores, lambda ends: function(ctypes.c_long(ends[0]), ctypes.c_long(ends[1]), *arguments), ranges)
        return out.T

    for width in WIDTHS:
        agree(f"final states of seatrial and C ({width} lanes)", ours(), reference(width), 1e-9)
    seconds = alternate({"ours": ours, **{f"C {width}": lambda w=width: reference(w) for width in WIDTHS}}, 9)
    best = min(WIDTHS, key=lambda width: seconds[f"C {width}"].min())
    per = 1e-9 * lanes * n
    found: list[Row | Ratio] = [
        row(GROUP, "seatrial", cores, NS, seconds["ours"], per),
        row(GROUP, f"C, vectorised over lanes, {best} in registers", cores, NS, seconds[f"C {best}"], per),
        Ratio(GROUP, "seatrial / C", cores, seconds["ours"].min() / seconds[f"C {best}"].min(), at_most=4.0),
    ]
    if cores == 1:
        found += _against_numpy(seconds["ours"].min() / lanes / n)
    return found


def trajectory(cores: int) -> list[Row | Ratio]:
    """One trajectory of 60 s at 100 Hz, all states kept."""
    n = 6_001
    control, step = np.column_stack(fins(n)), np.full(n, STEP)
    seconds = alternate(
        {"": lambda: simulate(MODEL, VEHICLE.coefficients, control, step, START).block_until_ready()}, 9
    )[""]
    group = "six degrees of freedom, one trajectory of 60 s at 100 Hz"
    return [
        row(group, "seatrial, all states kept", cores, "ms", seconds, 1e-3),
        Ratio(group, "ms for the trajectory", cores, float(seconds.min()) * 1e3, at_most=10.0),
    ]


def compilation(cores: int) -> list[Row | Ratio]:
    """Seconds to trace and compile a simulation and its gradient, in fresh processes, without and with a filled cache."""
    group = "six degrees of freedom, tracing and compiling"
    bounds = {"model": (5.0, 1.0), "gradient": (20.0, 3.0)}
    found: list[Row | Ratio] = []
    for what, limits in bounds.items():
        with tempfile.TemporaryDirectory() as cache:
            cold, cached = (_compile_in_process(what, cache) for _ in range(2))
        for state, seconds, limit in (("cold", cold, limits[0]), ("cached", cached, limits[1])):
            found.append(Row(group, f"{what}, {state}", cores, "s", seconds, seconds))
            found.append(Ratio(group, f"{what}, {state}, s", cores, seconds, at_most=limit))
    return found


def fins(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps of rudder and stern plane, rad."""
    time_s = np.arange(n) * STEP
    return np.where(time_s > 1.0, 0.05, 0.0), np.where(time_s > 2.0, 0.03, 0.0)


def final(values: dict, rudder: jax.Array, plane: jax.Array) -> jax.Array:
    """State after all samples."""

    def advance(state: tuple, held: tuple) -> tuple:
        return rk4_step(lambda x: MODEL.derivative(values, x, held), state, STEP), None

    end, _ = jax.lax.scan(advance, tuple(map(jnp.asarray, START)), (rudder, plane))
    return jnp.stack(end)


def squares(values: jax.Array, rudder: jax.Array, plane: jax.Array, depth: jax.Array) -> jax.Array:
    """Sum of squares of depth and speed, as a fit would have it; steps are recomputed on the way back."""
    named = dict(zip(NAMES, values, strict=True))

    @jax.checkpoint
    def advance(carry: tuple, sample: tuple) -> tuple:
        (state, total), (held, seen) = carry, sample
        total = total + (state[8] - seen) ** 2 + (state[0] - 1.5) ** 2
        return (rk4_step(lambda x: MODEL.derivative(named, x, held), state, STEP), total), None

    start = tuple(map(jnp.asarray, START)), jnp.zeros(())
    return jax.lax.scan(advance, start, ((rudder, plane), depth))[0][1]


def _against_numpy(ours: float) -> list[Row | Ratio]:
    """The test's own NumPy twin, of the kind that users run: one step of one vehicle at a time."""
    n = 200
    start = np.concatenate([START[:9], np.zeros(3)])
    seconds = alternate({"": lambda: prestero_twin.trajectory(start, *fins(n), STEP)}, 5)[""] / (n - 1)
    group = "six degrees of freedom, NumPy"
    return [
        row(group, "the same equations in NumPy, a vehicle at a time", 1, "ns per step", seconds, 1e-9),
        Ratio(group, "NumPy / seatrial", 1, float(seconds.min()) / ours, at_least=500.0),
    ]


def _inverse_blocks() -> np.ndarray:
    """Inverse mass matrix of surge, heave, pitch and of sway, roll, yaw, which nothing couples."""
    inverse = np.linalg.inv(rigid_mass_matrix(VEHICLE.hull) + added_mass_matrix(VEHICLE.hull.fixed))
    return np.concatenate([inverse[np.ix_(axes, axes)].ravel() for axes in ((0, 2, 4), (1, 3, 5))])


def _spread(lanes: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(0.95, 1.05, (len(NAMES), lanes))


def _compile_in_process(what: str, cache: str) -> float:
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": cache, "JAX_ENABLE_COMPILATION_CACHE": "true"}
    done = subprocess.run(
        [sys.executable, __file__, what],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=Path(__file__).parent,
        check=True,
    )
    return json.loads(done.stdout)


def _compile(what: str) -> float:
    """Seconds to trace and compile, the backend being up."""
    jnp.zeros(3).block_until_ready()
    rudder, plane = fins(1_000)
    values = jnp.asarray(list(VEHICLE.coefficients.values()))
    begin = time.perf_counter()
    if what == "model":
        function = jax.jit(lambda v, r, s: final(dict(zip(NAMES, v, strict=True)), r, s))
        function.lower(values, rudder, plane).compile()
    else:
        jax.jit(jax.grad(squares)).lower(values, rudder, plane, plane).compile()
    return time.perf_counter() - begin


if __name__ == "__main__":
    print(json.dumps(_compile(sys.argv[1])))
