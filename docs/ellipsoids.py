"""Does the ellipsoid of `seatrial export --to draws` hold the truth? `python docs/ellipsoids.py [--vehicles N]`, or `--redraw`.

Vehicles draw their coefficients from the priors. A plain loop that shares no code with seatrial simulates three runs of each
(`plain_vehicles.py`). The ellipsoid of 90 % is that of the export: the mode, standard deviations with every error, and the correlations
of the posterior; beside it that without model error. A few minutes of processor time. Writes docs/dev/ellipsoids.json and from it the
table in docs/dev/exports.md.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
import study_numbers
from term_probabilities import ARMS, SURGE, surge_runs

import seatrial as st
from seatrial.export.ensemble import SET_PROBABILITY, ellipsoid_of
from seatrial.export.vehicle import CoefficientEstimates

NAMES = ("X_uabsu", "T_nabsn", "X_u")
TRIED = ("A", "C")
"""Arms of term_probabilities.py: nothing is wrong, and the stated mass is 5 % off."""
COMMAND = "python docs/ellipsoids.py"


def holds(seed: str, number: int) -> list[bool]:
    """Return whether the ellipsoids of one vehicle hold its coefficients: without and with model error."""
    st.configure()
    random = np.random.default_rng([ord(seed), number])
    priors = {name: {**SURGE.always, **SURGE.optional}[name] for name in NAMES}
    truth = {name: float(prior.mean + prior.sd * random.standard_normal()) for name, prior in priors.items()}
    records = surge_runs(ARMS[seed], truth, random)
    model = SURGE.vehicle().build(free=list(NAMES))
    posterior = st.make_posterior(model, records, priors | dict(SURGE.nuisances), [st.Sensor("u")])
    mode = st.find_mode(posterior, key=1, starts=64, tries=1)
    at = [mode.names.index(name) for name in NAMES]
    spread = np.sqrt(np.diag(mode.cov))[at]
    correlation = mode.cov[np.ix_(at, at)] / np.outer(spread, spread)
    mean, within = np.asarray(mode.values)[at], np.asarray(mode.sd)[at]
    budget = st.error_budget(posterior, mode, st.StatedErrors())
    wider = np.array([budget.sd(name, float(sd)) for name, sd in zip(NAMES, within, strict=True)])
    return [
        bool(
            ellipsoid_of(CoefficientEstimates(NAMES, mean, sd, correlation * np.outer(sd, sd))).holds(
                np.array([truth[name] for name in NAMES])
            )
        )
        for sd in (within, wider)
    ]


def table(found: dict) -> str:
    """Return the shares of vehicles whose coefficients lie inside."""
    lines = [
        "| wrong with the model | vehicles | inside, noise only | inside, with model error |",
        "|---|---|---|---|",
    ]
    for seed in TRIED:
        within, wider = np.mean(found[seed], 0)
        error = np.sqrt(SET_PROBABILITY * (1 - SET_PROBABILITY) / len(found[seed]))
        lines.append(
            f"| {ARMS[seed].words} | {len(found[seed])} | {100 * within:.1f} % | {100 * wider:.1f} % ± {100 * error:.1f} % |"
        )
    return "\n".join([*lines, ""])


def main() -> None:
    """Simulate and judge all vehicles, and write numbers and table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--redraw", action="store_true", help="only write the table again from the numbers")
    asked = parser.parse_args()
    if not asked.redraw:
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            found = {seed: list(pool.map(partial(holds, seed), range(asked.vehicles))) for seed in TRIED}
        study_numbers.keep("ellipsoids", {seed: np.array(rows).astype(int).tolist() for seed, rows in found.items()})
    study_numbers.show("exports", table(study_numbers.kept("ellipsoids")), COMMAND)


if __name__ == "__main__":
    main()
