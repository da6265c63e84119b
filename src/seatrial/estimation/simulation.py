"""What the sensors would show, without noise, for given parameters: the forward model of the output-error likelihood."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.model import VehicleModel


def simulate_outputs(
    model: VehicleModel,
    channels: tuple[str, ...],
    delayed: bool,
    values: Mapping[str, Any],
    initial: Float[Array, " n_states"],
    control: Float[Array, "n n_controls"],
    step: Float[Array, " n"],
) -> Float[Array, "n m"]:
    """Outputs at every sample, SI.

    Args:
        model: vehicle.
        channels: outputs.
        delayed: whether `values["delay"]` shifts the controls; needs a uniform step.
        values: coefficients (and delay) by name, SI.
        initial: state at the first sample.
        control: control held from each sample to the next.
        step: time to the next sample, s.
    """
    params = {term.text: values[term.text] for term in model.coefficients}
    if delayed:
        control = jax.vmap(delay_control, in_axes=(1, None), out_axes=1)(control, values["delay"] / step[0])

    def advance(state: tuple, sample: tuple):
        held, h = sample
        shown = tuple(model.output(name, params, state, held) for name in channels)
        return rk4_step(lambda x: model.derivative(params, x, held), state, h), shown

    columns = tuple(control[:, i] for i in range(control.shape[1]))
    _, shown = jax.lax.scan(advance, tuple(initial[i] for i in range(initial.shape[0])), (columns, step))
    return jnp.stack(shown, -1)


def delay_control(control: Float[Array, " n"], samples: Float[Array, ""]) -> Float[Array, " n"]:
    """One control as it was a number of samples ago, the first value held before the start.

    The mean over each step of a command that is held between samples: exact, and continuous in the delay.
    """
    n = control.shape[0]
    whole = jnp.floor(samples)
    share, first = samples - whole, n - whole.astype(int)
    held = jnp.concatenate([jnp.full(n, control[0]), control])
    here, before = (jax.lax.dynamic_slice(held, (jnp.maximum(start, 0),), (n,)) for start in (first, first - 1))
    return (1.0 - share) * here + share * before
