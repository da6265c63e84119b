"""Our two time loops against C that does the same, and how they grow with the size of the problem."""

import time

import jax.numpy as jnp
import numpy as np
from problems import (
    MASS,
    SCALES,
    SHARE,
    STEP,
    TRIM,
    cloud,
    family,
    grid,
    likelihood,
    state_space,
)
from reference import WIDTHS, call, on_cores
from timing import Ratio, Row, agree, alternate, row

from seatrial.design.entropy import entropy_reduction
from seatrial.design.sweep import sweep_family
from seatrial.numerics.gaussian import Gaussian

NS = "ns per lane and step"
C = "C, vectorised over lanes"
LIKELIHOOD, SWEEP = "surge likelihood, 10 000 lanes x 1 500 steps", "square-root UKF sweep, 400 designs x 6 000 steps"


def surge(cores: int) -> list[Row | Ratio]:
    """Batched surge simulation with its log-likelihood."""
    lanes, n = 10_000, 1_500
    problem = likelihood(n)
    values = cloud(problem.values, lanes)
    parts = [jnp.asarray(part) for part in np.array_split(values, cores, axis=1)]

    def ours() -> np.ndarray:
        return np.concatenate(on_cores(cores, lambda part: np.asarray(problem.batch(part)), parts))

    def reference(width: int) -> np.ndarray:
        out = np.empty(lanes)
        control, measured = problem.record.control[:, 0].copy(), problem.record.measurement[:, 0].copy()
        call(
            width, cores, "surge_log_likelihood", lanes, n, values, control, measured, TRIM["u"], STEP, MASS, SHARE, out
        )
        return out

    for width in WIDTHS:
        agree(f"log-likelihoods of seatrial and C ({width} lanes)", ours(), reference(width), 1e-9, relative=True)
    return _compare(LIKELIHOOD, cores, ours, reference, lanes * n, at_most=1.5)


def sweep(cores: int) -> list[Row | Ratio]:
    """Square-root UKF over a grid of designs, control signals and limits included for us, given to C."""
    n, space, amplitude_period = 6_000, state_space(), grid(20, 20, 20.0)
    doublets = family(n)
    start = time.perf_counter()
    result = sweep_family(space, doublets, *amplitude_period)
    first = time.perf_counter() - start
    amplitude, period = (x.ravel()[:, None] for x in jnp.meshgrid(*map(jnp.asarray, amplitude_period), indexing="ij"))
    control = np.ascontiguousarray(np.asarray(doublets.signal(amplitude, period, jnp.asarray(doublets.time()))).T)
    mean, factor = np.array(space.initial.mean), np.array(space.initial.chol_cov)
    noise = np.array(space.process_sd), np.array(space.measurement_sd)

    def reference(width: int) -> np.ndarray:
        out = np.zeros((4, 4, 400))
        share = SHARE * SCALES["T_nabsn"]
        call(width, cores, "filter_factors", 400, n, control, mean, factor, *noise, STEP, MASS, share, out)
        return np.moveaxis(out, 2, 0)

    for width in WIDTHS:
        final = Gaussian(jnp.zeros((400, 4)), jnp.asarray(reference(width)))
        gain = np.asarray(entropy_reduction(space.initial, final, 1))
        agree(f"entropy reductions of seatrial and C ({width} lanes)", result.gain.ravel(), gain, 1e-8)
    compared = _compare(SWEEP, cores, lambda: sweep_family(space, doublets, *amplitude_period), reference, 400 * n, 5.0)
    return [*compared, Row(SWEEP, "first call, compiled without cache", cores, "s", first, first)]


def growth(cores: int) -> list[Row | Ratio]:
    """Time per lane and step over lanes, steps and coefficients, one of them at a time."""
    lanes, steps, coefficients = (64, 400, 2_000, 10_000), (500, 1_500, 3_000, 6_000), (1, 2, 3, 4, 5)
    sizes = [*((x, 500, 3) for x in lanes), *((400, x, 3) for x in steps), *((400, 1_500, x) for x in coefficients)]
    sizes = list(dict.fromkeys(sizes))
    return [*(_likelihood_row(cores, *size) for size in sizes), *(_sweep_row(cores, *size) for size in sizes)]


def _compare(group: str, cores: int, ours, reference, work: float, at_most: float) -> list[Row | Ratio]:
    """Rows of ours and of C at its best width, all widths measured in turn, and their ratio."""
    seconds = alternate({"ours": ours, **{f"C {width}": lambda w=width: reference(w) for width in WIDTHS}}, 15)
    best = min(WIDTHS, key=lambda width: seconds[f"C {width}"].min())
    ratio = seconds["ours"].min() / seconds[f"C {best}"].min()
    return [
        row(group, "seatrial", cores, NS, seconds["ours"], 1e-9 * work),
        row(group, f"{C}, {best} in registers", cores, NS, seconds[f"C {best}"], 1e-9 * work),
        Ratio(group, "seatrial / C", cores, ratio, at_most=at_most),
    ]


def _likelihood_row(cores: int, lanes: int, n: int, k: int) -> Row:
    problem = likelihood(n, k)
    values = jnp.asarray(cloud(problem.values, lanes))
    seconds = alternate({"": lambda: problem.batch(values).block_until_ready()}, 7)[""]
    return row("growth: surge likelihood", _size(lanes, n, k), cores, NS, seconds, 1e-9 * lanes * n)


def _sweep_row(cores: int, lanes: int, n: int, k: int) -> Row:
    doublets, space, columns = family(n), state_space(k), 8 if lanes == 64 else 20
    designs = grid(lanes // columns, columns, n * STEP / 3)
    seconds = alternate({"": lambda: sweep_family(space, doublets, *designs)}, 5)[""]
    return row("growth: square-root UKF sweep", _size(lanes, n, k), cores, NS, seconds, 1e-9 * lanes * n)


def _size(lanes: int, n: int, k: int) -> str:
    return f"{lanes:6} lanes {n:6} steps {k:3} coefficients"
