"""Log density of every single measurement under every draw, log p(y_k | h(x_k)): what cross-validation of the fit is made of."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.batching import lanes_at_once
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.sampling.target import LANES

MAX_ENTRIES = 60_000_000  # Largest table, 0.5 GB


def thin_draws(draws: Float[np.ndarray, "chains draws d"], most: int = 2000) -> Float[np.ndarray, "chains kept d"]:
    """Return every so-many-th draw of each chain, at most `most` over all chains."""
    chains, n, _ = draws.shape
    every = -(-n // max(1, most // chains))
    return draws[:, every - 1 :: every]


def pointwise_log_likelihood(
    posterior: Posterior, draws: Float[np.ndarray, "chains draws d"]
) -> Float[np.ndarray, "chains draws n"]:
    """Return the log density of each measurement, n in all, ordered by trial, then channel, then time; their sum is the log-likelihood.

    Args:
        posterior: posterior with an output-error likelihood of white residuals.
        draws: parameters in their own units, thinned to a thousand or two: see `thin_draws`.

    Raises:
        InputError: another likelihood, coloured residuals, whose measurements are not independent, or a table beyond 0.5 GB.
    """
    likelihood = posterior.likelihood
    if not isinstance(likelihood, OutputError) or not likelihood.independent:
        raise InputError(
            "pointwise log-likelihood",
            found="coloured residuals" if isinstance(likelihood, OutputError) else "another likelihood",
            expected="an output-error likelihood under which measurements are independent: white, proportional or heavy-tailed residuals",
            remedy="compare evidences instead, or estimate with white residuals",
        )
    data: TrialData = posterior.data
    present = np.stack([np.asarray(channel.present) for channel in data.channels], 1) > 0
    chains, n, dim = draws.shape
    count = int(present.sum())
    if chains * n * count > MAX_ENTRIES:
        raise InputError(
            "pointwise log-likelihood",
            found=f"{chains * n} draws of {count} measurements",
            expected=f"at most {MAX_ENTRIES} numbers",
            remedy=f"thin the draws to {MAX_ENTRIES // count} first",
        )
    flat = draws.reshape(-1, dim)
    table = np.empty((flat.shape[0], count))
    columns = dict(zip(posterior.names, flat.T, strict=True))
    size = lanes_at_once(lambda values: _densities(likelihood, values, data), columns, cpu=LANES)
    for start in range(0, flat.shape[0], size):
        lanes = np.minimum(np.arange(start, start + size), flat.shape[0] - 1)
        values = dict(zip(posterior.names, jnp.asarray(flat[lanes].T), strict=True))
        table[start : start + size] = np.asarray(_densities(likelihood, values, data))[
            lanes == start + np.arange(size)
        ][:, present]
    return table.reshape(chains, n, count)


@program(static_argnums=0)
def _densities(likelihood: OutputError, values: dict[str, Array], data: TrialData) -> Float[Array, "draws trials m n"]:
    """Return the log density of every sample, measured or not, under several draws."""
    return jax.vmap(lambda one: _of_one_draw(likelihood, one, data))(values)


def _of_one_draw(likelihood: OutputError, values: Mapping[str, Any], data: TrialData) -> Float[Array, "trials m n"]:
    def of_one_trial(apart: dict[str, Array], trial: TrialData, start: Array) -> Array:
        here, sensors = {**values, **apart}, likelihood.simulator.sensors
        shown = likelihood.simulator.outputs(here, start, trial.control, trial.step)
        one = jnp.ones(1)
        columns = []
        for sensor, channel, x in zip(sensors, trial.channels, shown.T, strict=True):
            noise = likelihood.noise(here, sensor, channel._replace(counts=one))
            columns.append(
                jax.vmap(lambda e, x, noise=noise: noise.log_likelihood(noise.absorb(noise.empty(), e, x, 1, 0)))(
                    channel.measured - x, x
                )
            )
        density = jnp.stack(columns)
        return jnp.where(jnp.isfinite(density), density, -jnp.inf)

    return jax.vmap(of_one_trial)(likelihood.apart(values), data, likelihood.starts(dict(values), data))
