"""A posterior: named parameters with priors, and a log-likelihood of the data; densities act on the unconstrained vector.

Structures of one vehicle share a posterior, and so all that is compiled of it: an absent term is a parameter of value 0 whose z is
standard normal. It is independent of everything else, so that the posterior of the others and the evidence are what they are without
it (Carlin and Chib, Journal of the Royal Statistical Society B 57, 1995), and the normal approximation is exact in it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.engine import check_precision
from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_kind, check_known, check_mapping, check_text, shown
from seatrial.core.errors import InputError
from seatrial.core.findings import Value
from seatrial.core.result_table import text_html
from seatrial.estimation.priors import Prior, by_kind
from seatrial.sampling.run import Draws
from seatrial.sampling.target import AT_ONCE

LogLikelihood = Callable[[dict[str, Any], Any], Any]
_A_POSTERIOR = "build it with `make_posterior` or `posterior_of_density`"


@dataclass(frozen=True)
class Parameter:
    """One unknown.

    Attributes:
        name: by which the likelihood asks for its value.
        unit: SI.
        label: as printed, LaTeX.
        prior: what is known of it before the data.
        shown: factor from SI to the unit in which sentences say it, and that unit; None for SI.
    """

    name: str
    unit: str
    label: str
    prior: Prior
    shown: tuple[float, str] | None = field(default=None, compare=False)

    def shown_value(self, value: float) -> dict[str, Value]:
        """Return an SI value in the unit in which it is shown, and that unit, as values of a finding."""
        factor, unit = self.shown or (1.0, self.unit)
        return {"value": float(value) * factor, "unit": unit}


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Posterior:
    """Prior and likelihood, kept apart because tempering needs both. A pytree: the priors' numbers and the data are its leaves.

    Posteriors that differ only in units, printed names and labels of trials share all compiled code.

    Attributes:
        parameters: the unknowns, in the order of the vector z.
        likelihood: `likelihood(values, data)`, values by name in SI; -inf where the model diverges, never NaN.
        data: arrays for the likelihood.
        guess: parameters of a possible mode, SI, NaN without a guess, shape (d,); None for no guess at all.
        present: 1 for each parameter that the structure has, 0 for one that is absent, shape (d,); None if all are present.
    """

    parameters: tuple[Parameter, ...]
    likelihood: LogLikelihood
    data: Any
    guess: Float[np.ndarray, " d"] | None = None
    present: Float[np.ndarray, " d"] | None = None

    def __repr__(self) -> str:
        """Print the parameters, and of which measurements it is."""
        named = ", ".join(f"{one.name} [{one.unit}]" for one in self.present_parameters)
        labels = getattr(self.likelihood, "labels", ())
        of = ", ".join(f'"{label}"' for label in labels)
        records = (
            f"record{'s' * (len(labels) > 1)} {of}, measured {', '.join(self.likelihood.channels)}" if labels else ""
        )
        return f"Posterior of {named}; " + (records or "log density of the user")

    _repr_html_ = text_html

    def tree_flatten(self) -> tuple[tuple[Any, ...], tuple[LogLikelihood, tuple[str, ...]]]:
        """Return the numbers, and the parts that are fixed in compiled code."""
        priors = tuple(parameter.prior for parameter in self.parameters)
        return (priors, self.data, self.guess, self.present), self._fixed

    @classmethod
    def tree_unflatten(cls, fixed: tuple[LogLikelihood, tuple[str, ...]], numbers: tuple[Any, ...]) -> "Posterior":
        """Build one inside compiled code, with numbered trials and parameters without texts."""
        (likelihood, names), (priors, *rest) = fixed, numbers
        parameters = tuple(Parameter(name, "", "", prior) for name, prior in zip(names, priors, strict=True))
        return cls(parameters, likelihood, *rest)

    @cached_property
    def _fixed(self) -> tuple[LogLikelihood, tuple[str, ...]]:
        """Likelihood and names of the parameters, with the numbers of the trials for their labels wherever they have labels."""
        likelihood: Any = self.likelihood
        labels = likelihood.labels if hasattr(likelihood, "labelled") else ()
        numbers = {f"[{label}]": f"[{number}]" for number, label in enumerate(labels)}
        parts = [name.partition("[") for name in self.names]
        if not labels or any(bracket and bracket + end not in numbers for _, bracket, end in parts):
            return likelihood, self.names
        names = tuple(start + numbers.get(bracket + end, "") for start, bracket, end in parts)
        return likelihood.labelled(tuple(map(str, range(len(labels))))), names

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def dim(self) -> int:
        """Number of parameters, those that are absent among them."""
        return len(self.parameters)

    @property
    def places(self) -> Int[np.ndarray, " k"]:
        """Places among all parameters of those that the structure has."""
        return np.arange(self.dim) if self.present is None else np.flatnonzero(self.present)

    @property
    def present_parameters(self) -> tuple[Parameter, ...]:
        """Parameters that the structure has, in their order."""
        return tuple(self.parameters[i] for i in self.places)

    @property
    def present_names(self) -> tuple[str, ...]:
        """Names of the parameters that the structure has."""
        return tuple(self.names[i] for i in self.places)

    @program
    def constrain(self, z: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Return the parameter values, SI, of unconstrained vectors; 0 for absent ones."""
        return self._where_present(self._by_kind(lambda prior, x: prior.constrain(x), z), 0.0)

    @program
    def unconstrain(self, values: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """Return the unconstrained vectors of parameter values inside the support; 0 for absent ones."""
        return self._where_present(self._by_kind(lambda prior, x: prior.unconstrain(x), values), 0.0)

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log prior density of z, including the log-Jacobian; standard normal in absent parameters."""
        return self.log_priors(z).sum()

    def log_priors(self, z: Float[Array, " d"]) -> Float[Array, " d"]:
        """Return the log prior density of each component of z, which are independent."""
        known = self._where_present(z, 0.0)
        densities = self._by_kind(lambda prior, x: prior.log_density(x), known)
        return densities if self.present is None else self._where_present(densities, -0.5 * z * z - _HALF_LOG_TWO_PI)

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log-likelihood of the data."""
        known = self._where_present(z, 0.0)
        values = [parameter.prior.constrain(known[i]) for i, parameter in enumerate(self.parameters)]
        if self.present is not None:
            values = [here * value for here, value in zip(self.present, values, strict=True)]
        return self.likelihood(dict(zip(self.names, values, strict=True)), self.data)

    def log_density(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the unnormalised log posterior density of z."""
        return self.log_prior(z) + self.log_likelihood(z)

    @program(static_argnames="n")
    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return unconstrained draws from the prior."""
        draws = self._by_kind(lambda prior, key: prior.sample(key, (n,)), jax.random.split(key, self.dim))
        if self.present is None:
            return draws
        return self._where_present(draws, jax.random.normal(jax.random.fold_in(key, self.dim), (n, self.dim)))

    def _by_kind(self, function: Callable[[Prior, Any], Any], columns: Array) -> Array:
        return by_kind([parameter.prior for parameter in self.parameters], function, columns)

    def _where_present(self, values: Any, absent: Any) -> Any:
        """Return values of all parameters, the last axis, where these are present, and others where they are not."""
        return values if self.present is None else jnp.where(self.present > 0, values, absent)


_HALF_LOG_TWO_PI = 0.5 * float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class _OfValues:
    """A log-likelihood of the parameters' values alone; NaN counts as a density of zero."""

    function: Callable[[dict[str, Any]], Any]

    def __call__(self, values: dict[str, Any], data: Any) -> Any:
        value = jnp.asarray(self.function(values), float)
        return jnp.where(jnp.isnan(value), -jnp.inf, value)


def check_priors(priors: Mapping[str, Prior], place: str = "priors") -> None:
    """Refuse values that are no prior, or have no spread.

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
        units: of the parameters, for tables; "1" if not given.

    Returns:
        a posterior whose parameters have the names of the priors.

    Raises:
        InputError: no prior, a unit of no parameter, or a function that cannot be compiled or returns no scalar.
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
    check_known(known, tuple(priors), "units")
    for name, unit in known.items():
        check_text(unit, f'units["{name}"]', 'write for example "kg/s"')
    parameters = tuple(Parameter(name, known.get(name, "1"), name, prior) for name, prior in priors.items())
    return Posterior(parameters, _OfValues(log_density), ())


def values_of(posterior: Posterior, z: Float[np.ndarray, "*batch d"]) -> Float[np.ndarray, "*batch d"]:
    """Return the parameters' values, SI, at any number of places; one program to compile, whatever their number."""
    flat = np.reshape(z, (-1, posterior.dim))
    blocks = np.minimum(np.arange(-(-len(flat) // AT_ONCE) * AT_ONCE), len(flat) - 1).reshape(-1, AT_ONCE)
    values = np.concatenate([np.asarray(posterior.constrain(flat[block])) for block in blocks])
    return values[: len(flat)].reshape(np.shape(z))


def check_posterior(posterior: Any, place: str = "posterior") -> None:
    """Check what something is computed of, before anything is: that it is a posterior, and that JAX is in double precision.

    Raises:
        InputError: it is none, or something has switched JAX to float32.
    """
    check_precision()
    check_kind(posterior, Posterior, place, _A_POSTERIOR)


def named_draws(posterior: Posterior, draws: Draws) -> Draws:
    """Return draws of a posterior's z by its names and in its units, without what is absent."""
    values = values_of(posterior, draws.z)
    at, units = posterior.places, tuple(parameter.unit for parameter in posterior.present_parameters)
    absent = np.delete(draws.z, at, axis=-1)
    log_density = draws.log_density + np.sum(0.5 * absent * absent + _HALF_LOG_TWO_PI, axis=-1)
    return replace(
        draws,
        z=draws.z[..., at],
        log_density=log_density,
        names=posterior.present_names,
        units=units,
        values=values[..., at],
    )


def as_key(key: jax.Array | int) -> jax.Array:
    """Return a random key, from a seed where an integer is given.

    Raises:
        InputError: neither.
    """
    if isinstance(key, Integral) and not isinstance(key, bool):
        return jax.random.key(int(key))
    if not isinstance(key, jax.Array):
        raise InputError(
            "key",
            found=shown(key),
            expected="a seed, or a key of jax.random.key",
            remedy="give a whole number, for example 0",
        )
    return key


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
            remedy="use jax.numpy instead of numpy, and jnp.where instead of if",
        ) from cause
    if getattr(shape, "shape", None) != ():
        raise InputError(
            where,
            found=f"a result of shape {getattr(shape, 'shape', None)}",
            expected="one number",
            remedy="sum the log densities of the data",
        )
