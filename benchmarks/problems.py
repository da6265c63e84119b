"""The problems that are timed: the catalogue's surge vehicle, its likelihood, its filter and its design sweep."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.estimation.posterior.output_error import output_error
from seatrial.manoeuvres.family import Family
from seatrial.numerics.gaussian import independent
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.catalogue import load_surge
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle

ENTRY = load_surge("remus100_surge")
VALUES = {**ENTRY.coefficients, "X_du3": -0.1, "X_0": -0.05}
"""Coefficients by rank: of k coefficients the first k are estimated, and of the first three the others held."""
SCALES = {"T_nabsn": 1e-4}
SIGMA, STEP, RPM = 0.0757, 0.01, 2 * np.pi / 60
TRIM = ENTRY.hull.trim
MASS = float(ENTRY.hull.mass or 1.0) - ENTRY.hull.fixed["X_udot"]
SHARE = 1.0 - ENTRY.hull.thrust_deduction
SWEEP_PRIOR_SD, PROCESS_SD, MEASUREMENT_SD = 1.0, 1e-4, 0.1


class Likelihood(NamedTuple):
    """Compiled log-likelihood of a batch of parameter vectors, and the trial behind it."""

    batch: Callable[[Any], jax.Array]
    record: Record
    values: dict[str, float]


def vehicle(k: int = 3) -> VehicleModel:
    """Surge vehicle of k free coefficients."""
    free = list(VALUES)[:k]
    held = {name: value for name, value in ENTRY.coefficients.items() if name not in free}
    hull = Hull(
        ENTRY.hull.name,
        ENTRY.hull.mass,
        thrust_deduction=ENTRY.hull.thrust_deduction,
        fixed={**ENTRY.hull.fixed, **held},
        trim=TRIM,
    )
    return whole_vehicle(hull, [*free, *held], moves=("u",))


def trial(n: int, step: float = STEP) -> Record:
    """Noisy speed under doublets of 200 rpm and 500 samples."""
    time = np.arange(n) * step
    control = TRIM["n"] + 200 * RPM * np.where(np.arange(n) // 250 % 2, -1.0, 1.0)
    states = simulate(
        vehicle(), ENTRY.coefficients, jnp.asarray(control[:, None]), jnp.full(n, step), jnp.array([TRIM["u"]])
    )
    speed = np.asarray(states)[:, 0] + SIGMA * np.random.default_rng(1).normal(size=n)
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    return make_record(time, {"n": control, "u": speed}, channels, Provenance("benchmark", "0" * 64))


def likelihood(n: int, k: int = 3) -> Likelihood:
    """White output-error likelihood of n samples and k coefficients; `batch(values)` takes shape (k + 1, lanes)."""
    model, record = vehicle(k), trial(n)
    function, data = output_error(model, [record], ["u"], [[TRIM["u"]]])
    values = {name.text: VALUES[name.text] for name in model.coefficients} | {"sigma_u": SIGMA}
    run = jax.jit(jax.vmap(lambda z, d: function(dict(zip(values, z, strict=True)), d), in_axes=(1, None)))
    return Likelihood(lambda z: run(z, data), record, values)


def cloud(values: dict[str, float], lanes: int) -> np.ndarray:
    """Parameter vectors within 10 % of the values, shape (parameters, lanes)."""
    centre = np.array(list(values.values()))[:, None]
    return centre * (1 + 0.1 * np.random.default_rng(0).uniform(-1, 1, (centre.size, lanes)))


def state_space(k: int = 3) -> StateSpace:
    """Speed and k coefficients, u and udot measured, in the filter's units."""
    model = vehicle(k)
    scales = [SCALES.get(name.text, 1.0) for name in model.coefficients]
    mean = [TRIM["u"], *(VALUES[name.text] / scale for name, scale in zip(model.coefficients, scales, strict=True))]
    prior = independent(jnp.array(mean), jnp.full(k + 1, SWEEP_PRIOR_SD))
    return discretise(model, ("u", "udot"), prior, jnp.full(k + 1, PROCESS_SD), jnp.full(2, MEASUREMENT_SD), scales)


def family(n: int) -> Family:
    """Doublets in trials of n samples, a third of them left for settling."""
    return Family("n", TRIM["n"], duration=n * STEP, active=n * STEP * 2 / 3, sample_time=STEP)


def grid(rows: int, columns: int, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes from 100 to 200 rpm, rad/s, and periods from 1 s."""
    return np.linspace(100, 200, rows) * RPM, np.linspace(1.0, longest, columns)
