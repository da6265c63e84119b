"""Surge posteriors of 4 parameters and more: three coefficients and the noise, and what each of several trials adds.

One trial from trim has 4 parameters. Trials against a current, out and back in turn, each start at a speed of their own that
is not known, and the Doppler log measures over ground: every one adds a current and an initial speed.
"""

import jax.numpy as jnp
import numpy as np
from problems import ENTRY, RPM, SIGMA, TRIM, trial, vehicle

from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.estimation.posterior.output_error import initial_name, output_error, own_name
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.priors import Normal, Prior, Uniform
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.simulate import simulate

STEP = 0.04
CURRENT_SD, START_SD = 0.05, 0.1
"""Priors of a current and of an initial speed about trim, m/s."""


def joint_posterior(trials: int, steps: int) -> Posterior:
    """Posterior of `steps` samples at 0.04 s in all: one trial of 4 parameters where `trials` is 0, else 4 + 2 trials."""
    priors: dict[str, Prior] = {
        name: Uniform(min(0.0, 3 * x), max(0.0, 3 * x)) for name, x in ENTRY.coefficients.items()
    }
    priors["sigma_u"] = Uniform(0.0, 3 * SIGMA)
    records = [_against_current(i, steps // trials) for i in range(trials)] or [trial(steps, step=STEP)]
    for record in records[:trials]:
        priors[own_name(CURRENT, record.label)] = Normal(0.0, CURRENT_SD)
        priors[initial_name("u", record.label)] = Normal(TRIM["u"], START_SD)
    unknown = {"current": True, "free_initial": True, "own": [CURRENT]} if trials else {}
    likelihood, data = output_error(vehicle(), records, [Sensor("u")], [[TRIM["u"]]] * len(records), **unknown)
    return Posterior(tuple(Parameter(name, "", name, prior) for name, prior in priors.items()), likelihood, data)


def _against_current(i: int, n: int) -> Record:
    """Doublets of 10 s, of 150 to 300 rpm, with the current from astern and from ahead in turn."""
    rng, time = np.random.default_rng(i), np.arange(n) * STEP
    amplitude = (150 + 150 * rng.uniform()) * RPM
    control = TRIM["n"] + amplitude * np.where(np.arange(n) // 125 % 2, -1.0, 1.0)
    start = jnp.array([TRIM["u"] + START_SD * rng.normal()])
    states = simulate(vehicle(), ENTRY.coefficients, jnp.asarray(control[:, None]), jnp.full(n, STEP), start)
    current = (-1) ** i * abs(CURRENT_SD * rng.normal())
    shown = np.asarray(states)[:, 0] + current + SIGMA * rng.normal(size=n)
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    return make_record(time, {"n": control, "u": shown}, channels, Provenance("benchmark", "0" * 64), f"trial {i + 1}")
