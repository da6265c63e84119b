"""How long a user waits on the paper's posterior: for the mode with its normal approximation, and for chains that can be trusted."""

import time

import jax
import numpy as np
from our_chains import fitting, timed
from paper_problem import paper_problem
from timing import Ratio, Row, alternate, row

from seatrial.estimation.posterior.mode import find_mode
from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS, diagnose
from seatrial.sampling.names import DEFAULT

GROUP = "first answer, paper's posterior, 6 000 steps"
REPEATS = 5


def seconds(cores: int) -> list[Row | Ratio]:
    """Mode and Laplace covariance; then the default run and its diagnostics after them; compiled beforehand, new seeds each time."""
    posterior = paper_problem().posterior
    seeds = iter(range(100))
    first = alternate({"": lambda: find_mode(posterior, key=jax.random.key(next(seeds)))}, REPEATS)[""]
    settings = fitting(DEFAULT, posterior, find_mode(posterior, key=jax.random.key(0)), np.inf)
    waits, health = [], []
    for seed in range(REPEATS + 1):
        start = time.perf_counter()
        found = timed(DEFAULT, posterior, find_mode(posterior, key=jax.random.key(seed)), settings, seed)
        drawn = time.perf_counter()
        health.append(diagnose(found.draws))
        end = time.perf_counter()
        waits.append((end - start, found.seconds, end - drawn))
    (waits, chains, diagnostics), health = np.array(waits[1:]).T, health[1:]
    r_hat = max(float(one.r_hat.max()) for one in health)
    ess = min(float(min(one.ess_bulk.min(), one.ess_tail.min())) for one in health)
    return [
        row(GROUP, "mode and Laplace covariance", cores, "s", first, 1.0),
        row(GROUP, f"mode, {DEFAULT} ({found.size}), diagnostics", cores, "s", waits, 1.0),
        row(GROUP, "of these, chains", cores, "s", chains, 1.0),
        row(GROUP, "of these, diagnostics", cores, "s", diagnostics, 1.0),
        Ratio(GROUP, "mode and Laplace covariance, s", cores, first.min(), at_most=1),
        Ratio(GROUP, "converged posterior, s", cores, waits.min(), at_most=5),
        Ratio(GROUP, f"R-hat, worst of {REPEATS} runs", cores, r_hat, at_most=MAX_R_HAT),
        Ratio(GROUP, f"bulk and tail ESS, worst of {REPEATS} runs", cores, ess, at_least=MIN_ESS),
    ]
