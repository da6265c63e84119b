"""Chains on the paper's posterior: one against the same in scalar C, and four in step against one."""

import ctypes

import jax
import numpy as np
from paper_problem import Problem, agree_in_moments, near, paper_problem, worst_ess
from reference import as_c, load
from timing import Ratio, Row, agree, alternate, row

from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.sampling.run import ChainSettings

WARMUP, DRAWS = 50_000, 50_000
GROUP = "paper's posterior, 100 000 iterations x 6 000 steps"
ONE, FOUR, C = "seatrial, one chain", "seatrial, four chains in step", "C, scalar, one chain"


def speed(cores: int) -> list[Row | Ratio]:
    """Adaptive Metropolis at the paper's size, from the posterior mode, compiled beforehand."""
    problem = paper_problem()
    mode = find_mode(problem.posterior, key=jax.random.key(0))
    points, draws = near(mode), {}
    theirs = np.array([_c_log_likelihood(problem, point) for point in points])
    agree("log-likelihoods of seatrial and scalar C", problem.log_likelihoods(points), theirs, 1e-8)

    def ours(name: str, chains: int) -> None:
        draws[name] = problem.sample(mode, ChainSettings(chains, WARMUP, DRAWS))

    def reference() -> None:
        draws[C] = _c_chain(problem, mode)

    for chains in (1, 4):
        problem.sample(mode, ChainSettings(chains, 100, 100))
    runs = {ONE: lambda: ours(ONE, 1), FOUR: lambda: ours(FOUR, 4), C: reference}
    seconds = alternate(runs, 2, warm_up=False)
    for name in (FOUR, C):
        agree_in_moments(f"posteriors: {ONE} and {name}", draws[ONE], draws[name], mode)
    work = 1e-9 * (WARMUP + DRAWS) * problem.control.size
    best = {name: taken.min() for name, taken in seconds.items()}
    rates = {name: worst_ess(draws[name]) / taken for name, taken in seconds.items()}
    return [
        *(row(GROUP, name, cores, "s", taken, 1.0) for name, taken in seconds.items()),
        *(row(GROUP, name, cores, "ns per iteration and step", taken, work) for name, taken in seconds.items()),
        *(row(GROUP, name, cores, "effective samples/s", rate, 1.0) for name, rate in rates.items()),
        Ratio(GROUP, "one chain / scalar C", cores, best[ONE] / best[C], at_most=2),
        Ratio(GROUP, "four chains in step / one", cores, best[FOUR] / best[ONE]),
    ]


def _c_log_likelihood(problem: Problem, point: np.ndarray) -> float:
    function = load("reference_chain.c").chain_log_likelihood
    function.restype = ctypes.c_double
    return function(*map(as_c, (point, *problem.trial)))


def _c_chain(problem: Problem, mode: Mode) -> np.ndarray:
    """Draws, shape (1, draws, d), from the mode and covariance that our chains get."""
    draws = np.empty((1, DRAWS, mode.values.size))
    slope = mode.sd / np.sqrt(np.diag(mode.cov))
    start = WARMUP, DRAWS, 0, mode.values, mode.cov * np.outer(slope, slope)
    load("reference_chain.c").chain(*map(as_c, (*start, problem.lower, problem.upper, *problem.trial, draws)))
    return draws
