"""Log densities of many parameter vectors on a GPU against this machine's processor, which must agree within rounding.

`python benchmarks/gpu.py`. Where JAX sees no GPU it says so, and measures nothing.
"""

import os
import sys
from functools import partial
from typing import Any

import jax
import numpy as np
from paper_problem import paper_problem
from timing import Ratio, Row, agree, alternate, row

GROUP = "log densities of the paper's posterior, 6 000 steps"
LANES, REPEATS = (64, 1024, 16384, 65536), 3
ROUNDING = 1e-9
"""Relative difference of sums over thousands of steps that orders of summation and another exp and log explain."""


def lanes(cores: int) -> list[Row | Ratio]:
    """Seconds for each number of lanes on both; nothing where there is no GPU."""
    try:
        accelerator = jax.devices("gpu")[0]
    except RuntimeError as error:
        print(
            f'gpu: skipped, for JAX sees no GPU here; pip install "seatrial[cuda]" where there is one ({error})',
            file=sys.stderr,
        )
        return []
    return between(jax.devices("cpu")[0], accelerator, cores)


def between(processor: Any, accelerator: Any, cores: int) -> list[Row | Ratio]:
    """The same posterior and the same vectors on both devices."""
    posterior = paper_problem().posterior
    drawn = np.asarray(posterior.sample_prior(jax.random.key(0), max(LANES)))
    run = jax.jit(lambda target, z: jax.vmap(target.log_density)(z))
    found: list[Row | Ratio] = []
    for count in LANES:
        placed = [
            (jax.device_put(posterior, device), jax.device_put(drawn[:count], device))
            for device in (processor, accelerator)
        ]
        values = [np.asarray(run(*one)) for one in placed]
        finite = np.isfinite(values[0])
        if not np.array_equal(finite, np.isfinite(values[1])):
            raise SystemExit("benchmarks: devices disagree about which vehicles run away: the times mean nothing")
        agree("densities on the two devices", values[0][finite], values[1][finite], ROUNDING, relative=True)
        names = (f"{count} lanes, processor", f"{count} lanes, GPU")
        seconds = alternate(
            {
                name: partial(lambda one: run(*one).block_until_ready(), one)
                for name, one in zip(names, placed, strict=True)
            },
            REPEATS,
        )
        found += [row(GROUP, name, cores, "ms", seconds[name], 1e-3) for name in names]
        found.append(
            Ratio(GROUP, f"processor over GPU, {count} lanes", cores, seconds[names[0]].min() / seconds[names[1]].min())
        )
    return found


if __name__ == "__main__":
    for line in lanes(len(os.sched_getaffinity(0))):
        print(*line)
