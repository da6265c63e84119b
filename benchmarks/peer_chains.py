"""Effective samples per second on the paper's posterior: our default run against PyMC's Metropolis samplers."""

import json
import subprocess
import time
from pathlib import Path

import jax
import numpy as np
from paper_problem import Problem, agree_in_moments, near, paper_problem, worst_ess
from timing import Ratio, Row, agree
from tools import PEERS

from seatrial.estimation.mode import Mode, find_mode
from seatrial.sampling.run import ChainSettings

GROUP, RATE = "paper's posterior, worst of 4 parameters", "effective samples/s"
METHODS = {"DEMetropolisZ": (1000, 4000), "Metropolis": (500, 2000)}
"""PyMC's samplers, their tuning steps and draws: a fifth is tuning, as in our default run."""
FEWEST = 10.0
"""Effective samples below which a count means nothing: a run that has fewer is credited with these."""


def effective(cores: int) -> list[Row | Ratio]:
    """All start at the posterior mode; everything counts but compilation, tuning and our search for the mode included.

    PyMC's Metropolis moves one parameter at a time along a narrow ridge, which leaves one effective sample of 2 000 draws:
    only DEMetropolisZ has enough of them for its posterior to be compared with ours.
    """
    problem, settings = paper_problem(), ChainSettings()
    mode, rates = find_mode(problem.posterior, jax.random.key(0)), []
    draws = problem.sample(mode, settings)
    for seed in range(1, 4):
        start = time.perf_counter()
        again = problem.sample(find_mode(problem.posterior, jax.random.key(seed)), settings, seed)
        seconds = time.perf_counter() - start
        rates.append(worst_ess(again) / seconds)
    what = f"seatrial, {settings.chains} chains in step, {settings.warmup} + {settings.draws}"
    rows, ratios = [Row(GROUP, what, cores, RATE, float(np.median(rates)), min(rates))], []
    peer = _ask_pymc(problem, mode)
    expected = problem.log_likelihoods(near(mode)) - np.log(problem.upper - problem.lower).sum()
    for compiler, densities in peer["log_densities"].items():
        agree(f"log densities of seatrial and PyMC ({compiler})", expected, np.array(densities), 1e-7)
    for method, (tune, kept) in METHODS.items():
        found = peer["methods"][method]
        values = np.array(found["values"])[None]
        if method == "DEMetropolisZ":
            agree_in_moments(f"posteriors of seatrial and PyMC {method}", draws, values, mode)
        ess = worst_ess(values)
        shown = f"{ess:.0f}" if ess >= FEWEST else f"under {FEWEST:.0f}"
        for compiler, seconds in found["seconds"].items():
            rate = max(ess, FEWEST) / (seconds * (tune + kept))
            what = f"PyMC {peer['version']} {method}, {compiler}, ESS {shown} of {kept}"
            rows.append(Row(GROUP, what, cores, RATE, rate, rate))
            ratios.append(Ratio(GROUP, f"seatrial / {method}, {compiler}", cores, min(rates) / rate, at_least=100))
    return [*rows, *ratios]


def _ask_pymc(problem: Problem, mode: Mode) -> dict:
    """What PyMC finds, in a process of its own on the same cores.

    Raises:
        SystemExit: it failed; says why.
    """
    arrays = {"lower": problem.lower, "upper": problem.upper, "control": problem.control, "measured": problem.measured}
    arrays |= {"start": mode.values, "points": near(mode)}
    numbers = {"initial": problem.initial, "step": problem.step, "mass": problem.mass, "share": problem.share}
    question = {name: values.tolist() for name, values in arrays.items()} | numbers
    question |= {"names": problem.posterior.names, "methods": METHODS}
    command = [str(PEERS), str(Path(__file__).with_name("peer_pymc.py"))]
    done = subprocess.run(command, input=json.dumps(question), capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(
            f"benchmarks: PyMC failed; `rm -r {PEERS.parents[1].name}` and `make bench` set it up anew\n{done.stderr}"
        )
    return json.loads(done.stdout)
