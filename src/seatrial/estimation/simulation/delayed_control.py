"""The delay between a command and its action: commands are held between samples, and what acts is their mean over a step."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.numerics.array_module import array_module

DELAY = "delay"  # Parameter name of the time between a command and its action, s


def delay_control(control: Float[Array, " n"], samples: Float[Array, ""]) -> Float[Array, " n"]:
    """One control as it was a number of samples ago, the first value held before the start.

    The mean over each step of a command that is held between samples: exact, and continuous in the delay.
    """
    n, xp = control.shape[0], array_module(control, samples)
    whole = xp.floor(samples)
    share, first = samples - whole, n - whole.astype(int)
    held = xp.concatenate([xp.full(n, control[0]), control])

    def from_on(start: Any) -> Any:
        return held[start : start + n] if xp is np else jax.lax.dynamic_slice(held, (start,), (n,))

    here, before = (from_on(xp.maximum(start, 0)) for start in (first, first - 1))
    return (1.0 - share) * here + share * before
