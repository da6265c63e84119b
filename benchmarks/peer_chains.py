"""Effective samples per second on the paper's posterior: every sampler of ours against NumPyro's NUTS and PyMC's samplers.

All start at or about the posterior mode; everything counts but compilation. Runs that would take minutes are cut short with
their warm-up and draws in proportion, so that the rate is that of the whole run.
"""

import os
import time

import jax
import numpy as np
from our_chains import Timed, fitting, timed
from paper_problem import Problem, agree_in_moments, near, paper_problem, worst_ess
from timing import Ratio, Row, agree
from tools import ask

from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.sampling.names import DEFAULT
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import SAMPLERS

GROUP, RATE = "paper's posterior, worst of 4 parameters", "effective samples/s"
LONGEST = 15.0
"""Seconds of one run of ours, beyond which a smaller one is timed."""
METHODS = {"DEMetropolisZ": (1000, 4000), "Metropolis": (500, 2000)}
"""PyMC's samplers that take no gradient, their tuning steps and draws: a fifth is tuning."""
NUTS_SIZE = {"warmup": 200, "draws": 200}
"""NumPyro's four chains: a fifth of the 1000 + 1000 that its users begin with."""
FEWEST = 10.0
"""Effective samples below which a count means nothing: a run that has fewer is credited with these."""
ENOUGH = 100.0
"""Effective samples from which moments are compared."""


def effective(cores: int) -> list[Row | Ratio]:
    """Ours, tuning and our search for the mode included; then the peers.

    PyMC's Metropolis moves one parameter at a time along a narrow ridge, which leaves one effective sample of 2 000 draws.
    Its NUTS is NumPyro's, whose gradients were counted, at the time of a gradient of PyMC.
    """
    problem = paper_problem()
    mode = find_mode(problem.posterior, key=jax.random.key(0))
    rows, rates, reference = _ours(problem, mode, cores)
    nuts_rows, nuts_rates, cost = _numpyro(problem, mode, reference, cores)
    pymc_rows, pymc_rates = _pymc(problem, mode, reference, cost, cores)
    best = {"NumPyro NUTS": (max(nuts_rates), 100), "best PyMC": (max(pymc_rates), 500)}
    ratios = [
        Ratio(GROUP, f"{DEFAULT} / {peer}", cores, rates[DEFAULT] / rate, at_least=bound)
        for peer, (rate, bound) in best.items()
    ]
    each = [*nuts_rows[-1:], *pymc_rows]
    ratios += [Ratio(GROUP, f"{DEFAULT} / {r.what.split(', ESS')[0]}", cores, rates[DEFAULT] / r.median) for r in each]
    return [*rows, *nuts_rows, *pymc_rows, *ratios]


def _ours(problem: Problem, mode: Mode, cores: int) -> tuple[list[Row], dict[str, float], np.ndarray]:
    """Rows and lowest rates of all samplers, and draws of the default one, with which theirs agree."""
    rows, rates, reference = [], {}, np.empty(0)
    for name in sorted(SAMPLERS, key=lambda name: name != DEFAULT):
        settings, found = fitting(name, problem.posterior, mode, LONGEST), []
        for seed in range(1, 4 if settings == ChainSettings() else 2):
            run, seconds = _with_mode(name, problem, settings, seed)
            found.append(worst_ess(run.draws) / seconds)
        if name == DEFAULT:
            reference = run.draws
        elif worst_ess(run.draws) >= ENOUGH:
            agree_in_moments(f"posteriors of {DEFAULT} and {name}", reference, run.draws, mode)
        rows.append(Row(GROUP, f"seatrial {name}, {run.size}", cores, RATE, float(np.median(found)), min(found)))
        rates[name] = min(found)
    return rows, rates, reference


def _with_mode(name: str, problem: Problem, settings: ChainSettings, seed: int) -> tuple[Timed, float]:
    """A run from a mode that is searched anew, and the seconds of both."""
    start = time.perf_counter()
    mode = find_mode(problem.posterior, key=jax.random.key(seed))
    return timed(name, problem.posterior, mode, settings, seed), time.perf_counter() - start


def _numpyro(problem: Problem, mode: Mode, reference: np.ndarray, cores: int) -> tuple[list[Row], list[float], float]:
    """Rows, the rates as a user would have them, and gradients per effective sample."""
    question = _question(problem, mode) | NUTS_SIZE
    found = ask("peer_numpyro.py", question | {"task": "draws"}, {"XLA_FLAGS": os.environ["XLA_FLAGS"]})
    seconds = ask("peer_numpyro.py", question | {"task": "times"}, {})
    _agree_in_density("NumPyro", problem, mode, found["log_densities"])
    values = np.array(found["values"])
    agree_in_moments("posteriors of seatrial and NumPyro NUTS", reference, values, mode)
    ess, name = worst_ess(values), f"NumPyro {found['version']} NUTS"
    size = f"ESS {ess:.0f} of {values.shape[0]} x ({NUTS_SIZE['warmup']} + {NUTS_SIZE['draws']}), a fifth of a run"
    rates = {way: ess / (found["gradients"][way] * seconds[way]) for way in seconds}
    fast = ess / found["seconds"]
    rows = [Row(GROUP, f"{name}, chains {way}, {size}", cores, RATE, rate, rate) for way, rate in rates.items()]
    rows.append(Row(GROUP, f"{name}, forward mode and our XLA options, {size}", cores, RATE, fast, fast))
    return rows, list(rates.values()), found["gradients"]["in turn"] / ess


def _pymc(
    problem: Problem, mode: Mode, reference: np.ndarray, cost: float, cores: int
) -> tuple[list[Row], list[float]]:
    """Rows and rates; `cost` is what NUTS pays for an effective sample, in gradients."""
    found = ask("peer_pymc.py", _question(problem, mode) | {"methods": METHODS}, {})
    for compiler, densities in found["log_densities"].items():
        _agree_in_density(f"PyMC ({compiler})", problem, mode, densities)
    name, rates = f"PyMC {found['version']}", {}
    for compiler, seconds in found["gradient_seconds"].items():
        rates[f"{name} NUTS, {compiler}, from the time of a gradient"] = 1.0 / (cost * seconds)
    for method, (tune, kept) in METHODS.items():
        values = np.array(found["methods"][method]["values"])[None]
        ess = worst_ess(values)
        if ess >= ENOUGH:
            agree_in_moments(f"posteriors of seatrial and PyMC {method}", reference, values, mode)
        shown = f"{ess:.0f}" if ess >= FEWEST else f"under {FEWEST:.0f}"
        for compiler, seconds in found["methods"][method]["seconds"].items():
            rates[f"{name} {method}, {compiler}, ESS {shown} of {kept}"] = max(ess, FEWEST) / (seconds * (tune + kept))
    return [Row(GROUP, what, cores, RATE, rate, rate) for what, rate in rates.items()], list(rates.values())


def _agree_in_density(peer: str, problem: Problem, mode: Mode, densities: list[float]) -> None:
    expected = problem.log_likelihoods(near(mode)) - np.log(problem.upper - problem.lower).sum()
    agree(f"log densities of seatrial and {peer}", expected, np.array(densities), 1e-7)


def _question(problem: Problem, mode: Mode) -> dict:
    """The problem in plain numbers, where to start and points to compare densities at."""
    return problem.plain | {"start": mode.values.tolist(), "points": near(mode).tolist()}
