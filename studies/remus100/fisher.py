"""Fisher information of the output-error fit: what a trial teaches about each coefficient if its noise is white.

I = sum_k (dy_k/dc)^T R^-1 (dy_k/dc),  sensitivities along the noise-free motion by forward differentiation.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.estimation.posterior.information import coefficient_information
from seatrial.vehicles.model import VehicleModel


def fisher_information(
    model: VehicleModel,
    params: Mapping[str, float],
    control: Float[np.ndarray, "designs n n_controls"],
    sample_time: float,
    start: Sequence[float],
    noise: Mapping[str, float],
) -> Float[np.ndarray, "designs k k"]:
    """Information about the model's coefficients, SI and in its order, of several designs.

    Args:
        model: vehicle.
        params: coefficients about which it is linearised.
        control: control held from each sample to the next.
        sample_time: s.
        start: state at the first sample.
        noise: standard deviation of each measured channel, SI.
    """
    values = {coefficient.text: params[coefficient.text] for coefficient in model.coefficients}
    sds = jnp.array(list(noise.values()))
    at = values, np.asarray(control), sample_time, np.asarray(start, float), sds
    return np.asarray(_information(model, tuple(noise), *at))


@program(static_argnums=(0, 1))
def _information(
    model: VehicleModel,
    channels: tuple[str, ...],
    values: dict,
    controls: Array,
    sample_time: Array,
    start: Array,
    sds: Array,
) -> Array:
    def one(control: Array) -> Array:
        step = jnp.full(control.shape[0], sample_time)
        weight = jnp.broadcast_to(1.0 / sds, (control.shape[0], len(channels)))
        return coefficient_information(model, channels, values, control, step, start, weight)

    return jax.vmap(one)(controls)
