"""A posterior: named parameters with priors, and a log-likelihood of the data; densities act on the unconstrained vector."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.pytrees import compiled_tree
from seatrial.estimation.priors import Prior

LogLikelihood = Callable[[dict[str, Any], Any], Any]


@compiled_tree("name", "unit", "label")
@dataclass(frozen=True)
class Parameter:
    """One unknown: its name, SI unit, printed label (LaTeX) and prior."""

    name: str
    unit: str
    label: str
    prior: Prior


@compiled_tree("likelihood")
@dataclass(frozen=True)
class Posterior:
    """Prior and likelihood, kept apart because tempering needs both. A pytree: the priors' numbers and the data are its leaves.

    Attributes:
        parameters: the unknowns, in the order of the vector z.
        likelihood: `likelihood(values, data)`, values by name in SI; -inf where the model diverges, never NaN.
        data: arrays the likelihood needs.
        guess: parameters near which there may be a mode, SI, NaN where nothing is guessed, shape (d,); None for no guess at all.
    """

    parameters: tuple[Parameter, ...]
    likelihood: LogLikelihood
    data: Any
    guess: Float[np.ndarray, " d"] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def dim(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @jax.jit
    def constrain(self, z: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Parameter values, SI, of unconstrained vectors."""
        return jnp.stack([parameter.prior.constrain(z[..., i]) for i, parameter in enumerate(self.parameters)], -1)

    @jax.jit
    def unconstrain(self, values: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Unconstrained vectors of parameter values inside the support."""
        return jnp.stack(
            [parameter.prior.unconstrain(values[..., i]) for i, parameter in enumerate(self.parameters)], -1
        )

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log prior density of z, the log-Jacobian included."""
        return sum((parameter.prior.log_density(z[i]) for i, parameter in enumerate(self.parameters)), jnp.zeros(()))

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log-likelihood of the data."""
        values = {parameter.name: parameter.prior.constrain(z[i]) for i, parameter in enumerate(self.parameters)}
        return self.likelihood(values, self.data)

    def log_density(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Unnormalised log posterior density of z."""
        return self.log_prior(z) + self.log_likelihood(z)

    @partial(jax.jit, static_argnames="n")
    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Unconstrained draws from the prior."""
        keys = jax.random.split(key, self.dim)
        return jnp.stack(
            [parameter.prior.sample(k, (n,)) for parameter, k in zip(self.parameters, keys, strict=True)], -1
        )
