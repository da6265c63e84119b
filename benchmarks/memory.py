"""Peak memory of one gradient of the log-likelihood, beyond the data, as the compiler plans it."""

import jax
import jax.numpy as jnp
from joint_problem import joint_posterior
from timing import Ratio, Row

from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.nuts import forward_is_cheaper, log_density_for_gradients

GROUP, KIB = "memory of one gradient beyond the data, 4 parameters", 1024.0
STEPS = (6_000, 60_000)


def gradients(cores: int) -> list[Row | Ratio]:
    """Forward sensitivities, as the samplers take them, and plain reverse mode, which keeps every step."""
    ways = {
        "forward sensitivities": lambda target, z: jax.grad(log_density_for_gradients(target))(z),
        "plain reverse mode": lambda target, z: jax.grad(target.log_density)(z),
    }
    found: list[Row | Ratio] = []
    for way, gradient in ways.items():
        peaks = [_peak(gradient, joint_posterior(0, steps)) for steps in STEPS]
        found += [
            Row(GROUP, f"{way}, {steps:6} steps", cores, "KiB", peak, peak)
            for steps, peak in zip(STEPS, peaks, strict=True)
        ]
        bound = 1.1 if way == "forward sensitivities" else None
        found.append(Ratio(GROUP, f"{way}, 60 000 steps / 6 000", cores, peaks[1] / peaks[0], at_most=bound))
    return found


def _peak(gradient, posterior: Posterior) -> float:
    """Scratch memory of a compiled gradient, KiB: arguments and results are not in it."""
    assert forward_is_cheaper(posterior.dim)
    analysis = jax.jit(gradient).lower(posterior, jnp.zeros(posterior.dim)).compile().memory_analysis()
    assert analysis is not None
    return analysis.temp_size_in_bytes / KIB
