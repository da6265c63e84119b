"""A posterior: named parameters with priors, and a log-likelihood of the data; densities act on the unconstrained vector."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.argument_checks import check_kind, check_mapping, shown
from seatrial.core.engine import check_precision
from seatrial.core.errors import InputError
from seatrial.core.pytrees import compiled_tree
from seatrial.estimation.priors import Prior
from seatrial.sampling.run import Draws

LogLikelihood = Callable[[dict[str, Any], Any], Any]
_A_POSTERIOR = "build it with `make_posterior` or `posterior_of_density`"


@compiled_tree("name", "unit", "label")
@dataclass(frozen=True)
class Parameter:
    """One unknown.

    Attributes:
        name: by which the likelihood asks for its value.
        unit: SI.
        label: as printed, LaTeX.
        prior: what is known of it before the data.
    """

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
        """Return the parameter values, SI, of unconstrained vectors."""
        return jnp.stack([parameter.prior.constrain(z[..., i]) for i, parameter in enumerate(self.parameters)], -1)

    @jax.jit
    def unconstrain(self, values: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Return the unconstrained vectors of parameter values inside the support."""
        return jnp.stack(
            [parameter.prior.unconstrain(values[..., i]) for i, parameter in enumerate(self.parameters)], -1
        )

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log prior density of z, the log-Jacobian included."""
        return sum((parameter.prior.log_density(z[i]) for i, parameter in enumerate(self.parameters)), jnp.zeros(()))

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log-likelihood of the data."""
        values = {parameter.name: parameter.prior.constrain(z[i]) for i, parameter in enumerate(self.parameters)}
        return self.likelihood(values, self.data)

    def log_density(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the unnormalised log posterior density of z."""
        return self.log_prior(z) + self.log_likelihood(z)

    @partial(jax.jit, static_argnames="n")
    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return unconstrained draws from the prior."""
        keys = jax.random.split(key, self.dim)
        return jnp.stack(
            [parameter.prior.sample(k, (n,)) for parameter, k in zip(self.parameters, keys, strict=True)], -1
        )


@dataclass(frozen=True)
class _OfValues:
    """A log-likelihood of the parameters' values alone; NaN counts as a density of zero."""

    function: Callable[[dict[str, Any]], Any]

    def __call__(self, values: dict[str, Any], data: Any) -> Any:
        value = jnp.asarray(self.function(values), float)
        return jnp.where(jnp.isnan(value), -jnp.inf, value)


def check_priors(priors: Mapping[str, Prior], place: str = "priors") -> None:
    """Refuse what is no prior, or has no spread.

    Args:
        priors: by parameter.
        place: of them, for the error.

    Raises:
        InputError: no mapping, or the first of what it holds that is none.
    """
    for name, prior in check_mapping(priors, place, 'write for example {"X_u": Uniform(-20.0, 0.0)}').items():
        here, remedy = f'{place}["{name}"]', "for example Uniform(lower, upper) or Normal(mean, sd)"
        if isinstance(prior, type) or not (hasattr(prior, "bounds") and hasattr(prior, "log_density")):
            raise InputError(here, found=shown(prior), expected="a prior", remedy=remedy)
        try:
            (low, high), sd = map(float, prior.bounds), float(prior.sd)
            sound = low < high and 0 < sd < np.inf and bool(np.isfinite(float(prior.mean)))
        except (ArithmeticError, TypeError, ValueError):
            sound = False
        if not sound:
            raise InputError(
                here,
                found=shown(prior),
                expected="a lower bound below the upper one, a finite mean, and a finite standard deviation above 0",
                remedy=remedy,
            )


def posterior_of_density(
    log_density: Callable[[dict[str, Any]], Any], priors: Mapping[str, Prior], units: Mapping[str, str] | None = None
) -> Posterior:
    """Build a posterior from one's own log-likelihood.

    Args:
        log_density: log density of the data for parameter values by name, in the priors' units; a scalar, written with `jax.numpy` so
            that it can be compiled and differentiated. The priors are added here.
        priors: one for each parameter, in the order of the report.
        units: of the parameters, for tables; "1" where not given.

    Returns:
        a posterior whose parameters have the names of the priors.

    Raises:
        InputError: no prior, or a function that cannot be compiled or returns no scalar.
    """
    check_precision()
    if not callable(log_density):
        raise InputError(
            "log_density", found=shown(log_density), expected="a function of a mapping", remedy="put the priors second"
        )
    check_priors(priors)
    if not priors:
        raise InputError(
            "priors", found="none", expected="one parameter at least", remedy='for example {"a": Normal(0, 1)}'
        )
    _check_density(log_density, tuple(priors))
    known = check_mapping({} if units is None else units, "units", 'write for example {"X_u": "kg/s"}')
    parameters = tuple(Parameter(name, known.get(name, "1"), name, prior) for name, prior in priors.items())
    return Posterior(parameters, _OfValues(log_density), ())


def check_posterior(posterior: Any, place: str = "posterior") -> None:
    """Check what something is computed of, before anything is: that it is a posterior, and that JAX is in double precision.

    Raises:
        InputError: it is none, or something has switched JAX to float32.
    """
    check_precision()
    check_kind(posterior, Posterior, place, _A_POSTERIOR)


def named_draws(posterior: Posterior, draws: Draws) -> Draws:
    """Return draws of a posterior's z by its names and in its units."""
    values = np.asarray(posterior.constrain(jnp.asarray(draws.z)))
    units = tuple(parameter.unit for parameter in posterior.parameters)
    return replace(draws, names=posterior.names, units=units, values=values)


def as_key(key: jax.Array | int) -> jax.Array:
    """Return a random key, from a seed where an integer is given.

    Raises:
        InputError: neither.
    """
    if isinstance(key, Integral) and not isinstance(key, bool):
        return jax.random.key(int(key))
    return check_kind(key, jax.Array, "key", "give a whole number as a seed, or a key of jax.random")


def _check_density(log_density: Callable[[dict[str, Any]], Any], names: tuple[str, ...]) -> None:
    where = f"log density {getattr(log_density, '__name__', '')}".rstrip()
    try:
        shape = jax.eval_shape(log_density, dict.fromkeys(names, jax.ShapeDtypeStruct((), float)))
    except KeyError as cause:
        raise InputError(
            where,
            found=f"a parameter {cause} without a prior",
            expected="parameters among " + ", ".join(names),
            remedy="add its prior, or correct the name",
        ) from cause
    except jax.errors.JAXTypeError as cause:
        raise InputError(
            where,
            found=f"code that cannot be compiled: {str(cause).splitlines()[0]}",
            expected="a function of traced numbers",
            remedy="use jax.numpy in place of numpy, and jnp.where in place of if",
        ) from cause
    if getattr(shape, "shape", None) != ():
        raise InputError(
            where,
            found=f"a result of shape {getattr(shape, 'shape', None)}",
            expected="one number",
            remedy="sum the log densities of the data",
        )
