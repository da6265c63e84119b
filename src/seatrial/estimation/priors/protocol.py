"""What every prior of a scalar parameter offers."""

from typing import Any, Protocol

import jax


class Prior(Protocol):
    """What every prior offers; implementations are frozen dataclasses of plain numbers, registered as pytrees."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Support in the parameter's own unit."""
        ...

    @property
    def mean(self) -> float:
        """Prior mean."""
        ...

    @property
    def sd(self) -> float:
        """Prior standard deviation."""
        ...

    def constrain(self, z: Any) -> Any:
        """Parameter value of an unconstrained z, elementwise."""
        ...

    def unconstrain(self, value: Any) -> Any:
        """The z of a parameter value inside the support, elementwise."""
        ...

    def log_density(self, z: Any) -> Any:
        """Log density of z, elementwise."""
        ...

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Draws of the parameter's value."""
        ...

    def sample(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Draws of z."""
        ...
