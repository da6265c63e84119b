"""Figures 3 and 4: entropy reduction over repeated doublets and self-oscillating tests, eqs. (6) to (14) with their signs made right.

Gain = H(prior) - H(posterior) = 1/2 ln(|P_0| / |P_N|) of the three coefficients, by a Kalman filter along the noise-free
motion, which an Euler step makes, as in the paper's time.
"""

import time

import jax.numpy as jnp
import numpy as np
import xarray as xr

from seatrial.core.gaussian import independent
from seatrial.core.state_space import StateSpace
from seatrial.design.relay_sweep import sweep_relay
from seatrial.design.sweep import sweep_family
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.relay import RelayFamily, run_relay
from seatrial.numerics.integrate import Integrator, euler_step, rk4_step
from seatrial.vehicles.discretise import discretise
from studies.remus100.compute.filters import (
    INITIAL_SHARE,
    PROCESS_VARIANCE,
    filter_scales,
    in_printed_units,
    rates,
)
from studies.remus100.compute.trial import DURATION, STEP, doublets, simulated_speed, stamps
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES, Reading

POINTS = 20
PERIODS = np.linspace(1.0, 20.0, POINTS)
ACTIVE = {"short": 20.0, "medium": 40.0, "long": 58.0}
"""Manoeuvre windows, s: the paper does not print its own; 20 s gives its ridge at 10 s."""
INITIAL_VARIANCE = (1.0, 1e5, 1e5, 1e5)
"""P of the text, T in printed units."""
NOISE_SEED = 4
"""Of the noise in the chosen doublet's trial."""
THRESHOLDS = np.linspace(0.03, 0.36, 12)
"""Of the self-oscillating test, over trim speed; the largest are out of reach, and said to be."""


def sweep_part(study: Study, window: str, method: Filter = SquareRootUnscentedKalmanFilter()) -> xr.Dataset:
    """Sweep of Figure 3 for one manoeuvre window; the time is of a second sweep, compiled beforehand."""
    reading, report = study.reading, study.progress(f"designs, {ACTIVE[window]:g} s window, {type(method).__name__}")
    family = Family("n", reading.trim, duration=DURATION, active=ACTIVE[window], sample_time=STEP)
    report(0, 2)
    for done in (1, 2):
        begun = time.perf_counter()
        sweep = sweep_family(
            design_space(reading, euler_step),
            family,
            np.linspace(reading.lowest, reading.highest, POINTS),
            PERIODS,
            truth=true_state(reading),
            method=method,
        )
        report(done, 2)
    return xr.Dataset(
        {"gain": (("amplitude", "period"), sweep.gain), "seconds": ((), time.perf_counter() - begun)},
        {"amplitude": sweep.amplitude, "period": PERIODS},
    )


def ekf_sweep_part(study: Study) -> xr.Dataset:
    """The 40 s window by the extended Kalman filter."""
    return sweep_part(study, "medium", ExtendedKalmanFilter())


def chosen_doublet_part(study: Study) -> xr.Dataset:
    """Figure 4: the square-root UKF along the largest doublet of 10 s, with measurement noise."""
    reading, space = study.reading, design_space(study.reading, rk4_step)
    control, model = doublets(reading), study.reading.model()
    u = simulated_speed(reading, reading.truth, control)
    udot = np.asarray(model.output("udot", reading.truth, (u,), (control,)))
    true = np.column_stack([u, udot])
    measured = true + reading.filter_noise * np.random.default_rng(NOISE_SEED).normal(size=true.shape)
    trace = run_filter(
        SquareRootUnscentedKalmanFilter(), space, jnp.asarray(control[:, None]), measured, jnp.full(u.size, STEP)
    )
    udot = rates(reading, trace.means, jnp.asarray(control[:, None]))
    return xr.Dataset(
        {
            "n": ("time", control),
            "measured": (("time", "channel"), measured),
            "true": (("time", "channel"), true),
            "u": ("time", np.asarray(trace.means)[:, 0]),
            "udot": ("time", np.asarray(udot)),
            "mean": (("time", "coefficient"), in_printed_units(reading, trace.means[:, 1:])),
            "sd": (("time", "coefficient"), in_printed_units(reading, trace.sds[:, 1:])),
        },
        {"time": stamps(), "coefficient": list(NAMES), "channel": ["u", "udot"]},
    )


def relay_part(study: Study) -> xr.Dataset:
    """Self-oscillating tests over control amplitude and oscillation amplitude, for the same 40 s, and the best one's motion."""
    reading, space = study.reading, design_space(study.reading, rk4_step)
    speed, report = reading.hull.trim["u"], study.progress("self-oscillating tests")
    family = RelayFamily(
        (("n", reading.trim),), "n", "u", speed, duration=DURATION, sample_time=STEP, start=1.0, active=ACTIVE["medium"]
    )
    report(0, 1)
    truth = true_state(reading)
    sweep = sweep_relay(
        space,
        family,
        np.linspace(reading.lowest, reading.highest, POINTS),
        THRESHOLDS * abs(speed),
        truth=truth,
    )
    row, column = sweep.best
    best = (sweep.amplitude[row], sweep.threshold[column])
    run = run_relay(space, family, *best, jnp.asarray(truth), jnp.zeros(family.time().size))
    report(1, 1)
    grid = ("amplitude", "threshold")
    return xr.Dataset(
        {
            "gain": (grid, sweep.gain),
            "switches": (grid, sweep.switches),
            "reached": (grid, sweep.reached),
            "n": ("time", np.asarray(run.control)[:, 0]),
            "u": ("time", np.asarray(run.state)[:, 0]),
        },
        {"amplitude": sweep.amplitude, "threshold": sweep.threshold, "time": family.time()},
        {"best_amplitude": best[0], "best_threshold": best[1]},
    )


def design_space(reading: Reading, integrator: Integrator) -> StateSpace:
    """Joint state space with the text's Q, R and P, coefficients believed at 75 % of the truth."""
    believed = true_state(reading) * [1.0, *[INITIAL_SHARE] * 3]
    variance = np.array(INITIAL_VARIANCE) * [1.0, 1.0, 1.0, (reading.thrust_print / reading.thrust_filter) ** 2]
    return discretise(
        reading.model(),
        ("u", "udot"),
        independent(believed, np.sqrt(variance)),
        np.sqrt(PROCESS_VARIANCE),
        np.full(2, reading.filter_noise),
        filter_scales(reading),
        integrator,
    )


def true_state(reading: Reading) -> np.ndarray:
    """Trim speed and true coefficients in filter units."""
    scaled = (reading.truth[n] / s for n, s in zip(NAMES, filter_scales(reading), strict=True))
    return np.array([reading.hull.trim["u"], *scaled])
