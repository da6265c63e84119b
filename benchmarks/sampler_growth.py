"""How the default sampler and NUTS grow with parameters, steps and chains, on surge trials fitted jointly."""

import jax
import numpy as np
from joint_problem import joint_posterior
from our_chains import fitting, timed
from paper_problem import worst_ess
from timing import Row, alternate, row

from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.names import DEFAULT

STEPS = 6_000
CHAINS = {"nuts": 8, DEFAULT: 32}
"""Samplers, and their chains where these do not grow: trees of many chains in step wait for the deepest."""
TRIALS = (0, 2, 8)
"""Trials with a current and an initial speed of their own: 4, 8 and 20 parameters."""
OTHER_STEPS, OTHER_CHAINS = (1_500, 24_000), (4, 16, 64)
LONGEST = 10.0
"""Seconds of one run, beyond which a part of the default run is taken."""


def parameters(cores: int) -> list[Row]:
    """4, 8 and 20 parameters over the same number of steps."""
    found = []
    for trials in TRIALS:
        posterior = joint_posterior(trials, STEPS)
        found += _rows(
            f"growth with parameters, {STEPS} steps", f"{posterior.dim:3} parameters,", posterior, None, cores
        )
    return found


def steps(cores: int) -> list[Row]:
    """4 parameters, shorter and longer trials."""
    found = []
    for n in OTHER_STEPS:
        found += _rows("growth with steps, 4 parameters", f"{n:6} steps,", joint_posterior(0, n), None, cores)
    return found


def chains(cores: int) -> list[Row]:
    """4 parameters, fewer and more chains in step."""
    return _rows(f"growth with chains, 4 parameters, {STEPS} steps", "", joint_posterior(0, STEPS), OTHER_CHAINS, cores)


def _rows(group: str, what: str, posterior: Posterior, chains: tuple[int, ...] | None, cores: int) -> list[Row]:
    """Seconds of the mode, and effective samples per second of each sampler with everything counted but compilation."""
    modes: list[Mode] = []
    seconds = alternate({"": lambda: modes.append(find_mode(posterior, key=jax.random.key(len(modes))))}, 2)[""]
    found = [row(group, f"{what} mode and Laplace covariance".strip(), cores, "s", seconds, 1.0)]
    for name, usual in CHAINS.items():
        for count in chains or (usual,):
            settings = fitting(name, posterior, modes[0], LONGEST, count)
            run = timed(name, posterior, modes[0], settings, 1)
            taken = run.seconds + float(np.median(seconds))
            rate = worst_ess(run.draws) / taken
            found.append(Row(group, f"{what} {name}, {run.size}".strip(), cores, "effective samples/s", rate, rate))
    return found
