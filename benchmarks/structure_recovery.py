"""Which terms are found again: our screening against PySINDy and SysIdentPy, on time and on the recovered structure.

Surge trials of 120 s at 10 Hz with noise of 0.02 m/s on the speed; each optional term is there half of the time. A row counts
the trials whose whole structure is right, and the terms missed and invented per trial.
"""

import time

import jax
import numpy as np
from timing import Ratio, Row
from tools import ask

from seatrial.core.coefficients import CoefficientName
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.manoeuvres.family import Family
from seatrial.selection.rules import TermLibrary, compile_rules, parse_rules
from seatrial.selection.screening import TermPrior, screen
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.simulate import simulate

GROUP = "structure, 40 surge trials, 7 candidate terms"
TRIALS, STEP, SAMPLES, NOISE = 40, 0.1, 1200, 0.02
TRIM_U, TRIM_N, MASS = 1.54, 125.0, 31.0
TRUTH = {"X_0": -0.5, "X_u": -1.2, "X_uabsu": -2.9, "X_u3": -0.6, "T_n": 0.02, "T_nabsn": 6.3e-4, "T_un": -0.012}
"""Coefficients where they are there, SI; the thrust always is."""
ALWAYS = "T_nabsn"
CHANNELS = (Channel("u", "m/s", "measurement"), Channel("n", "rad/s", "control"))


def recovered(cores: int) -> list[Row | Ratio]:
    """Return the rows of ours and of the peers, and how many more trials ours has right than each."""
    random = np.random.default_rng(1)
    truths = [structure(random) for _ in range(TRIALS)]
    records = [trial(terms, random, str(i)) for i, terms in enumerate(truths)]
    screened(records[0])
    found: dict[str, tuple[list[list[str]], float]] = {}
    start = time.perf_counter()
    ours = [screened(record) for record in records]
    found["seatrial, screening, median-probability"] = ours, (time.perf_counter() - start) / TRIALS
    series = [{"u": record.channel("u").tolist(), "n": record.channel("n").tolist()} for record in records]
    for name, peer in ask("peer_structures.py", {"trials": series, "step": STEP, "u": TRIM_U, "n": TRIM_N}, {}).items():
        found[name] = peer["terms"], peer["seconds"]
    rows, shares = [], {}
    for name, (terms, seconds) in found.items():
        # a discrete model always has the last speed: X_u is not counted where it cannot be told
        counted = set(TRUTH) - ({"X_u"} if "FROLS" in name else set())
        missed = [len(set(true) & counted - set(some)) for true, some in zip(truths, terms, strict=True)]
        invented = [
            len((set(some) & (counted | {"other"})) - set(true)) for true, some in zip(truths, terms, strict=True)
        ]
        shares[name] = right = float(np.mean([not a and not b for a, b in zip(missed, invented, strict=True)]))
        what = f"{name}: {np.mean(missed):.2f} missed, {np.mean(invented):.2f} invented"
        what += f", {1e3 * seconds:.0f} ms a trial"
        rows.append(Row(GROUP, what, cores, "share wholly right", right, right))
    own, *peers = shares
    return [
        *rows,
        *(Ratio(GROUP, f"share right, ours - {p}", cores, shares[own] - shares[p], at_least=0) for p in peers),
    ]


def structure(random: np.random.Generator) -> list[str]:
    """Thrust, a drag that dissipates, and others by chance."""
    while True:
        chosen = [name for name in TRUTH if name == ALWAYS or random.random() < 0.5]
        if any(name in chosen for name in ("X_uabsu", "X_u3")):
            return chosen


def trial(terms: list[str], random: np.random.Generator, label: str) -> Record:
    """Doublets of two sizes, one after the other, and a noisy speed."""
    time_ = STEP * np.arange(SAMPLES)
    first = Family("n", TRIM_N, time_[-1], 48.0, STEP, start=5.0).signal(40.0, 12.0, time_)
    second = Family("n", 0.0, time_[-1], 50.0, STEP, start=60.0).signal(70.0, 25.0, time_)
    control = np.asarray(first + second)
    model = axes_vehicle("truth", (axis_equation("X", terms, MASS),), per_unit_inertia=False)
    values = {name: TRUTH[name] for name in terms}
    motion = simulate(model, values, control[:, None], np.full(SAMPLES, STEP), np.array([TRIM_U]))[:, 0]
    measured = np.asarray(motion) + NOISE * random.normal(size=SAMPLES)
    return make_record(time_, {"u": measured, "n": control}, CHANNELS, Provenance("simulated", "0" * 64), label)


def screened(record: Record) -> list[str]:
    """Return the terms of more than even probability."""
    library = TermLibrary(tuple(map(CoefficientName.parse, TRUTH)), ("u", "n"))
    rules = compile_rules(library, parse_rules([f"always {ALWAYS}"], library))
    prior = {name: TermPrior(0.0, 2 * abs(value)) for name, value in TRUTH.items()}
    found = screen([axis_equation("X", tuple(TRUTH), MASS)], rules, [record], {"u": NOISE}, prior, jax.random.key(0))
    return [name for name in TRUTH if found.inclusion.get(name, 1.0) > 0.5]
