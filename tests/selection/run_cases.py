"""Runs of a surge vehicle whose motion is linear in what is unknown, and the density of each given the others in closed form."""

import numpy as np
from scipy import stats

from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.priors import LogUniform, Normal, half_normal
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import DEDUCTION, MASS, naive_rk4
from tests.estimation_cases import make_trial

NOISE, START_SD, STEP, N = 0.05, 0.1, 0.25, 48
DRAG = -6.0
PRIOR = {"T_nabsn": (1.6e-3, 3e-4), "X_0": (0.0, 0.5)}
TRUTH = {"T_nabsn": 1.5e-3, "X_0": 0.3}
HULL = Hull("linear", mass=MASS - 0.93, thrust_deduction=DEDUCTION, fixed={"X_udot": -0.93})
FIXED_DRAG = Hull("linear", mass=MASS - 0.93, thrust_deduction=DEDUCTION, fixed={"X_udot": -0.93, "X_u": DRAG})


def speed(rev, start, thrust, constant, drag=DRAG):
    """Surge speed by a plain loop; linear in start, thrust and constant force."""
    found = [start]
    for n in rev[:-1]:
        force = (1 - DEDUCTION) * thrust * (2 * np.pi * n) * abs(2 * np.pi * n) + constant
        found.append(naive_rk4(lambda u, f=force: (drag * u + f) / MASS, found[-1], STEP))
    return np.array(found)


def linear_runs(count, noise=NOISE, seed=0):
    """Propeller speeds, rev/s, starts as believed, and measured speeds of some runs."""
    rng = np.random.default_rng(seed)
    runs = []
    for _ in range(count):
        rev = np.repeat(rng.uniform(4, 14, 6), 8)
        start = rng.uniform(0.5, 2.0)
        truth = start + START_SD * rng.normal()
        measured = speed(rev, truth, TRUTH["T_nabsn"], TRUTH["X_0"]) + noise * rng.normal(size=N)
        runs.append((rev, start, measured))
    return runs


def posterior_of_runs(runs, varying=False, free_start=True):
    """Joint posterior; the noise is known, and each run has its own start, or its own drag where that varies."""
    labels = [f"run {i}" for i in range(len(runs))]
    records = [
        make_trial(STEP * np.arange(N), rev, label, u=measured)
        for label, (rev, _, measured) in zip(labels, runs, strict=True)
    ]
    known = {"sigma_u": Normal(NOISE, 1e-6 * NOISE)}
    known |= {name: Normal(*numbers) for name, numbers in PRIOR.items()}
    if varying:
        model = whole_vehicle(HULL, ("X_u", "T_nabsn", "X_0"), moves=("u",))
        known |= {"X_u": Normal(DRAG, 1.0), "spread_X_u": half_normal(2.0, lower=0.0)}
        return make_posterior(model, records, known, ["u"])
    model = whole_vehicle(FIXED_DRAG, ("T_nabsn", "X_0"), moves=("u",))
    if free_start:
        known |= {f"u_0[{label}]": Normal(start, START_SD) for label, (_, start, _) in zip(labels, runs, strict=True)}
    return make_posterior(model, records, known, ["u"])


def design_of_runs(runs):
    """Slope of all measurements along the unknowns in units of their priors' spread, the shared ones first, and what is expected."""
    columns, mean = [], []
    for i, (rev, start, _) in enumerate(runs):
        base = speed(rev, 0.0, 0.0, 0.0)
        own = np.zeros((N, len(runs)))
        own[:, i] = START_SD * (speed(rev, 1.0, 0.0, 0.0) - base)
        thrust = speed(rev, 0.0, 1.0, 0.0) - base
        constant = speed(rev, 0.0, 0.0, 1.0) - base
        shared = np.column_stack([thrust * PRIOR["T_nabsn"][1], constant * PRIOR["X_0"][1]])
        columns.append(np.column_stack([shared, own]))
        mean.append(speed(rev, start, PRIOR["T_nabsn"][0], PRIOR["X_0"][0]))
    return np.concatenate(columns), np.concatenate(mean)


def exact_left_out(runs, blocks=1):
    """Log density of each run, or of each of some blocks of each, given all else: all measurements are jointly normal."""
    design, middle = design_of_runs(runs)
    cov = design @ design.T + NOISE**2 * np.eye(len(design))
    measured = np.concatenate([run[2] for run in runs])
    whole = stats.multivariate_normal(middle, cov).logpdf(measured)
    left = []
    for i in range(len(runs) * blocks):
        kept = np.arange(len(design)) // (N // blocks) != i
        part = stats.multivariate_normal(middle[kept], cov[np.ix_(kept, kept)])
        left.append(whole - part.logpdf(measured[kept]))
    return np.array(left)


def drifting_posterior(without=()):
    """Posterior of one run with white noise over a slow error, some of its samples not measured."""
    rev, start, measured = linear_runs(1)[0]
    measured = measured.copy()
    measured[list(without)] = np.nan
    record = make_trial(STEP * np.arange(N), rev, "run 0", u=measured)
    model = whole_vehicle(FIXED_DRAG, ("T_nabsn", "X_0"), moves=("u",))
    known = {name: Normal(*numbers) for name, numbers in PRIOR.items()} | {"u_0[run 0]": Normal(start, START_SD)}
    known |= {"sigma_u": LogUniform(0.01, 0.2), "drift_u": LogUniform(0.01, 0.2), "drift_time_u": LogUniform(0.3, 9.0)}
    return make_posterior(model, [record], known, [Sensor("u", noise="drifting")])
