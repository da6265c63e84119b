"""Input signals as functions of time and their settings, on NumPy or JAX arrays alike, in SI."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.core.errors import InputError
from seatrial.manoeuvres.manoeuvre import Manoeuvre


@jax.jit
def repeated_doublet_signal(
    time: Any, trim: Any, amplitude: Any, period: Any, *, start: Any, active: Any, ramp: Any = 0.0
) -> Any:
    """Whole doublets about trim: +amplitude for half a period, -amplitude for the other half, then trim.

    Only doublets that end within `active` seconds of `start` are run: their number is floor(active / period), which jumps
    as the period grows, and the information with it.

    Args:
        time: s, any shape; the settings broadcast against it.
        trim: control at trim.
        amplitude: change from trim.
        period: of one doublet, s.
        start: first edge, s.
        active: time available for whole doublets, s.
        ramp: time every edge takes, from one level to the next, s; 0 for a step.
    """
    # Times that should be equal differ by rounding (k * 0.01 s against 1 + j * period); a nanosecond decides.
    elapsed = jnp.asarray(time) - start + 1e-9
    count = jnp.floor(active / period + 1e-9)
    half = jnp.floor(elapsed / (0.5 * period))
    running = (elapsed >= 0) & (half < 2 * count)
    level = jnp.where(running, jnp.where(half % 2 == 0, 1.0, -1.0), 0.0)
    before = jnp.where(half <= 0, 0.0, jnp.where(half % 2 == 0, -1.0, 1.0))
    before = jnp.where(half == 2 * count, -1.0, jnp.where(half > 2 * count, 0.0, before))
    since_edge = elapsed - half * 0.5 * period
    share = jnp.where(ramp > 0, jnp.clip(since_edge / jnp.where(ramp > 0, ramp, 1.0), 0.0, 1.0), 1.0)
    shape = jnp.where(elapsed >= 0, before + (level - before) * share, 0.0)
    return trim + amplitude * jnp.where(count > 0, shape, 0.0)


def repeated_doublet(
    control: str,
    *,
    trim: float,
    amplitude: float,
    period: float,
    duration: float,
    active: float,
    start: float = 1.0,
    ramp: float = 0.0,
) -> Manoeuvre:
    """Repeated doublet from trim, followed by a settle time of `duration - start - active` at least.

    Raises:
        InputError: not one whole doublet fits, edges longer than half a period, or the active time beyond the end.
    """
    settings = {"trim": trim, "amplitude": amplitude, "period": period, "start": start, "active": active, "ramp": ramp}
    where = "manoeuvre repeated_doublet"
    if not 0 < period <= active * (1 + 1e-9):
        raise InputError(
            where,
            found=f"period {period:g} s",
            expected=f"more than 0 and at most the active time, {active:g} s",
            remedy="shorten the period or lengthen the active time, so that one whole doublet fits",
        )
    if start < 0 or start + active > duration * (1 + 1e-9):
        raise InputError(
            where,
            found=f"start {start:g} s + active {active:g} s",
            expected=f"an end within the duration, {duration:g} s",
            remedy="lengthen the duration: the quiet tail after the doublets is informative too",
        )
    if not 0 <= ramp <= 0.5 * period:
        raise InputError(
            where,
            found=f"edges of {ramp:g} s",
            expected=f"at most half a period, {0.5 * period:g} s",
            remedy="lengthen the period or shorten the ramp",
        )

    def signal(time: np.ndarray) -> np.ndarray:
        return np.asarray(repeated_doublet_signal(time, **settings))

    return Manoeuvre("repeated doublet", control, duration, settings, signal)


def random_steps(
    control: str, *, trim: float, amplitude: float, hold: float, duration: float, seed: int, start: float = 0.0
) -> Manoeuvre:
    """Random steps: levels uniform in trim ± amplitude, each held for `hold` seconds, from `start` on.

    Raises:
        InputError: a hold that is not positive, or longer than the trial.
    """
    if not 0 < hold <= duration:
        raise InputError(
            "manoeuvre random_steps",
            found=f"hold {hold:g} s",
            expected=f"more than 0 and at most the duration, {duration:g} s",
            remedy="two to three seconds excite a vehicle of 3 s time constant well",
        )
    if not start < duration:
        raise InputError(
            "manoeuvre random_steps",
            found=f"start {start:g} s",
            expected=f"before the end, {duration:g} s",
            remedy="start earlier or lengthen the trial",
        )
    n_levels = int(np.ceil((duration - start) / hold + 1e-9))
    levels = trim + amplitude * np.random.default_rng(seed).uniform(-1.0, 1.0, n_levels)

    def signal(time: np.ndarray) -> np.ndarray:
        index = np.floor((np.asarray(time) - start) / hold + 1e-9).astype(int)
        return np.where(index < 0, trim, levels[np.clip(index, 0, n_levels - 1)])

    settings = {"trim": trim, "amplitude": amplitude, "hold": hold, "start": start, "seed": float(seed)}
    return Manoeuvre("random steps", control, duration, settings, signal)
