"""How far the steps of a simulation move a fit: by steps half as long about the mode, with one linear step of the posterior.

What the sensors would show in steps half as long, y', differs from what the fit simulates, y. A fit with y' to the measurements is to first
order one with y to the measurements less y' - y, so with the gradient g of the log-likelihood and the covariance C at the mode

    shift = C (g(data - (y' - y)) - g(data))

Where m samples were averaged to one of the record, so is y': over a step the mean of m samples has the variance h^2 (1 - 1/m^2) / 12
about the instant, as weights a, 1 - 2 a, a half a step before, at and after it have for a = (1 - 1/m^2) / 6; for many samples these are
Simpson's.
"""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.findings import Finding
from seatrial.estimation.posterior.information import is_noise
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.slopes import likelihood_slopes

MIN_SHIFT, MAX_NAMED = 1.0, 4  # Standard deviations from which a shift is reported, and parameters that are named


def step_shift(
    posterior: Posterior, mode: Mode, averaged: Float[np.ndarray, "trials m"]
) -> Float[np.ndarray, " k"] | None:
    """Return by how many of its standard deviations the steps move each parameter that is present.

    Args:
        posterior: of simulated motion.
        mode: its mode, with the parameters that are absent.
        averaged: how many samples were averaged to one, of each channel of each trial.

    Returns:
        what the fit has less what steps half as long would give; None of another likelihood, or where these run away.
    """
    if not isinstance(posterior.likelihood, OutputError):
        return None
    is_there = np.isin(np.arange(mode.z.size), posterior.places)
    point = np.where(is_there, mode.values, 0.0)
    weight = (1.0 - np.maximum(averaged, 1.0) ** -2.0) / 6.0
    moved = [channel.measured - off for channel, off in zip(*_differences(posterior, point, weight), strict=True)]
    if not all(np.isfinite(one).all() for one in moved):
        return None
    channels = tuple(
        channel._replace(measured=one) for channel, one in zip(posterior.data.channels, moved, strict=True)
    )
    other = replace(posterior, data=posterior.data._replace(channels=channels))
    gradient, without = (np.asarray(likelihood_slopes(one, point).gradient) for one in (posterior, other))
    sd = np.sqrt(np.diag(mode.cov))
    slope = np.where(is_there, mode.sd / sd, 0.0)
    return (mode.cov @ (slope * (gradient - without)) / sd)[posterior.places]


def check_step(posterior: Posterior, shift: Float[np.ndarray, " k"], step: float, shorter: float) -> list[Finding]:
    """Report the parameters that the steps move by more than their standard deviation, the noise left out.

    Args:
        posterior: whose parameters they are.
        shift: of `step_shift`.
        step: of the records, s.
        shorter: one that helps, s.
    """
    moved = [i for i in np.argsort(-np.abs(shift)) if abs(shift[i]) >= MIN_SHIFT and not is_noise(posterior)[i]]
    if not moved:
        return []
    named = moved[:MAX_NAMED]
    values = {"shifts": tuple(float(shift[i]) for i in named), "more": len(moved) - len(named)}
    subject = tuple(posterior.present_names[i] for i in named)
    lengths = {"step": step, "shorter": shorter}
    return [Finding("steps-too-long", "caution", subject, {**values, **lengths}, ("shorter-step",))]


def shorter_step(step: float, averaged: Float[np.ndarray, "trials m"]) -> float:
    """Return a step that helps: that of the fastest channel, or a quarter if nothing was averaged, s."""
    most = float(averaged.max())
    return step / (most if most > 1 else 4.0)


@program
def _differences(posterior: Posterior, values: Array, weight: Array) -> tuple[tuple, Sequence[Array]]:
    """Return the data's channels, and of each what it would show in steps half as long less what it shows, shape (trials, n)."""
    likelihood, data = posterior.likelihood, posterior.data
    named = dict(zip(posterior.names, values, strict=True))

    def of_one_trial(apart: dict, trial, start: Array, weight: Array) -> Array:
        def shown(times: int) -> Array:
            control = tuple(jnp.repeat(one, times) for one in trial.control)
            return likelihood.simulator.outputs(
                {**named, **apart}, start, control, jnp.repeat(trial.step, times) / times
            )

        halved = shown(2)
        at, after = halved[0::2], halved[1::2]
        before = jnp.concatenate([2.0 * at[:1] - after[:1], after[:-1]])
        return at + weight * (before - 2.0 * at + after) - shown(1)

    starts = likelihood.starts(named, data)
    off = jax.vmap(of_one_trial)(likelihood.apart(named), data, starts, weight)
    return data.channels, [off[..., i] for i in range(len(data.channels))]
