"""Tables I and II and Figures 1 and 2: four filters on the same noisy surge trials of random steps, over many seeds.

The paper shows one run of unstated input. Here the input is random steps about trim, each held for 2 s, over 15 s at 0.01 s,
from trim; noise, covariances and initial estimates are the paper's.
"""

import time
from dataclasses import dataclass
from functools import partial
from math import inf, sqrt

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from seatrial.core.gaussian import independent
from seatrial.core.state_space import StateSpace
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import FilterTrace, run_filter
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.simulate import simulate
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES, Reading

STEP, N_STEPS, HOLD = 0.01, 1500, 2.0
FIRST_SEED = 1000
PROCESS_VARIANCE = (1e-6, 1e-7, 1e-7, 1e-10)
"""Q."""
INITIAL_VARIANCE = (1.0, 1e4, 1e4, 1e5)
"""P of the tables, T in printed units (316 squared); the text has 1e5 for the drag coefficients, which hardly changes the estimates."""
INITIAL_SHARE, BOUND_SHARE = 0.75, 0.5
MARKS = np.arange(1, 16) * 100
"""Samples, each second, at which the filters' errors are kept."""


@dataclass(frozen=True)
class Trials:
    """Trials of many seeds: control in rad/s, shape (seeds, n, 1), noisy u and udot and true ones, shape (seeds, n, 2)."""

    control: Float[np.ndarray, "seeds n 1"]
    measured: Float[np.ndarray, "seeds n 2"]
    true: Float[np.ndarray, "seeds n 2"]


def filters_part(study: Study) -> xr.Dataset:
    """Every filter over the same trials: estimates at the end and at each second, clipping, run times, one whole trace."""
    reading, seeds = study.reading, study.sizes.filter_seeds
    trials, space = make_trials(reading, seeds), filter_space(reading)
    report, runs = study.progress("four filters"), {}
    for done, (name, method) in enumerate(paper_filters(reading).items()):
        report(done, 4)
        runs[name] = _over_seeds(reading, method, space, trials)
    report(4, 4)
    first = xr.Dataset(
        {
            "n": ("time", trials.control[0, :, 0]),
            "measured": (("time", "channel"), trials.measured[0]),
            "true": (("time", "channel"), trials.true[0]),
        }
    )
    dataset = xr.concat(list(runs.values()), xr.IndexVariable("filter", list(runs)))
    coordinates = {
        "time": STEP * np.arange(N_STEPS),
        "coefficient": list(NAMES),
        "channel": ["u", "udot"],
        "mark": MARKS * STEP,
        "seed": FIRST_SEED + np.arange(seeds),
    }
    return dataset.merge(first).assign_coords(coordinates)


def make_trials(reading: Reading, seeds: int) -> Trials:
    """Simulate and measure trials of seeds 1000, 1001, ..."""
    model, stamps, steps = reading.model(), STEP * np.arange(N_STEPS), jnp.full(N_STEPS, STEP)
    span = N_STEPS * STEP
    control, noise = [], []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        family = Family("n", reading.trim, span, span, STEP, start=0.0, kind="random-steps", seed=seed)
        control.append(np.asarray(family.signal(reading.steps, HOLD, stamps))[:, None])
        noise.append(reading.filter_noise * np.random.default_rng([seed, 1]).normal(size=(N_STEPS, 2)))
    held, truth = np.stack(control), reading.truth
    start = jnp.array([reading.hull.trim["u"]])
    u = jax.vmap(lambda n: simulate(model, truth, n, steps, start))(jnp.asarray(held))[..., 0]
    udot = jax.vmap(jax.vmap(lambda x, n: model.output("udot", truth, (x,), (n[0],))))(u, jnp.asarray(held))
    true = np.asarray(jnp.stack([u, udot], -1))
    return Trials(held, true + np.stack(noise), true)


def filter_space(reading: Reading, p: float = 1.0, q: float = 1.0, r: float = 1.0) -> StateSpace:
    """Joint state space, eqs. (15) and (16), with the paper's P, Q and R times these factors, coefficients at 75 % of the truth.

    P and Q are factors of the coefficients' and of the whole state's variances.
    """
    scales = filter_scales(reading)
    mean = [reading.hull.trim["u"], *(INITIAL_SHARE * reading.truth[n] / s for n, s in zip(NAMES, scales, strict=True))]
    variance = np.array(INITIAL_VARIANCE) * [1.0, p, p, p * (reading.thrust_print / reading.thrust_filter) ** 2]
    initial = independent(np.array(mean), np.sqrt(variance))
    noise = reading.filter_noise * sqrt(r)
    return discretise(
        reading.model(), ("u", "udot"), initial, np.sqrt(q * np.array(PROCESS_VARIANCE)), np.full(2, noise), scales
    )


def filter_scales(reading: Reading) -> tuple[float, float, float]:
    """SI value of one filter unit of each coefficient."""
    return (1.0, 1.0, reading.thrust_filter)


def paper_filters(reading: Reading) -> dict[str, Filter]:
    """The four filters; the constrained one keeps each coefficient within 50 % of its true value."""
    centres = [reading.truth[name] / scale for name, scale in zip(NAMES, filter_scales(reading), strict=True)]
    bounds = [(c - BOUND_SHARE * abs(c), c + BOUND_SHARE * abs(c)) for c in centres]
    return {
        "EKF": ExtendedKalmanFilter(),
        "UKF": UnscentedKalmanFilter(),
        "SRUKF": SquareRootUnscentedKalmanFilter(),
        "SRUKF-C": SquareRootUnscentedKalmanFilter(bounds=((-inf, inf), *bounds)),
    }


def run_over_seeds(method: Filter, space: StateSpace, trials: Trials) -> FilterTrace:
    """Traces of one filter over all trials."""
    return _run_over_seeds(method, space, jnp.asarray(trials.control), jnp.asarray(trials.measured))


@partial(jax.jit, static_argnums=0)
def _run_over_seeds(method: Filter, space: StateSpace, control: Array, measured: Array) -> FilterTrace:
    steps = jnp.full(N_STEPS, STEP)
    return jax.vmap(lambda c, y: run_filter(method, space, c, y, steps))(control, measured)


def in_printed_units(reading: Reading, coefficients: Float[Array, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Coefficients, or their standard deviations, of a filter in the units of the tables."""
    return np.asarray(coefficients) * [1.0, 1.0, reading.thrust_filter / reading.thrust_print]


def rates(reading: Reading, means: Float[Array, "n 4"], control: Float[Array, "n 1"]) -> Float[Array, " n"]:
    """Acceleration as a filter's own state and coefficients have it, m/s^2."""
    model, scales = reading.model(), filter_scales(reading)

    def rate(mean: Array, n: Array) -> Array:
        params = {name: mean[i + 1] * scale for i, (name, scale) in enumerate(zip(NAMES, scales, strict=True))}
        return model.output("udot", params, (mean[0],), (n[0],))

    return jax.vmap(rate)(means, control)


def _over_seeds(reading: Reading, method: Filter, space: StateSpace, trials: Trials) -> xr.Dataset:
    trace = run_over_seeds(method, space, trials)
    means, sds = (in_printed_units(reading, x[..., 1:]) for x in (trace.means, trace.sds))
    truth = np.array([reading.printed_truth[name] for name in NAMES])
    udot = np.asarray(jax.vmap(partial(rates, reading))(trace.means, jnp.asarray(trials.control)))
    early = slice(0, round(1.0 / STEP))
    return xr.Dataset(
        {
            "final_mean": (("seed", "coefficient"), means[:, -1]),
            "final_sd": (("seed", "coefficient"), sds[:, -1]),
            "relative_error": (("seed", "mark", "coefficient"), np.abs(means[:, MARKS - 1] / truth - 1)),
            "clipped": ("time", np.asarray(trace.clipped).sum(0)),
            "early_udot_error": ("seed", np.sqrt(np.mean((udot - trials.true[..., 1])[:, early] ** 2, 1))),
            "failures": ((), int(np.asarray(trace.failures).sum())),
            "smallest_sd": ((), float(np.asarray(trace.sds).min())),
            "mean": (("time", "coefficient"), means[0]),
            "sd": (("time", "coefficient"), sds[0]),
            "u": ("time", np.asarray(trace.means)[0, :, 0]),
            "udot": ("time", udot[0]),
            "seconds": ((), _seconds(method, space, trials)),
        }
    )


def _seconds(method: Filter, space: StateSpace, trials: Trials) -> float:
    """Wall-clock time of one 15 s trial among the others, all run side by side, compiled beforehand: the smallest of five."""
    times = []
    for _ in range(5):
        begun = time.perf_counter()
        jax.block_until_ready(run_over_seeds(method, space, trials))
        times.append(time.perf_counter() - begun)
    return min(times) / trials.control.shape[0]
