"""Two questions every estimate must answer: does the prior hold the data's answer, and do the data say more than the prior?"""

from collections.abc import Callable
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.coefficients import AXES
from seatrial.core.errors import InputError
from seatrial.estimation.mode import Mode
from seatrial.estimation.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform

EDGE = 0.02
GAIN = 10.0
CONTRACTION = 0.9
CORRELATION = 0.95
LEANING = 0.1
"""Share of the posterior that may lie within `EDGE` of a bound."""


def check_prior_contains_data(posterior: Posterior, mode: Mode, where: str) -> None:
    """Refuse a uniform prior against whose edge the data push.

    A mode within 2 % of a bound is suspect; if a step of a tenth of the width beyond the bound, the other parameters following
    along the ridge of the likelihood, makes the data more likely by over 10 nats, the prior excludes them.

    Args:
        posterior: posterior.
        mode: its mode.
        where: configuration file, for the error.

    Raises:
        InputError: naming the parameter, its bound and the gain beyond it.
    """
    for index, parameter in enumerate(posterior.parameters):
        for bound, beyond in _suspect_bounds(parameter, float(mode.values[index])):
            gain = _gain_beyond(posterior, mode.values, index, beyond)
            if gain > GAIN:
                raise InputError(
                    f"{where}, key prior.{parameter.name}",
                    found=f"the data push {parameter.name} against its bound {bound:.4g} {parameter.unit}; beyond it, "
                    f"at {beyond:.4g}, they are {gain:.0f} nats more likely",
                    expected="a prior that contains what the data say",
                    remedy=_remedy(parameter, bound),
                )


def information_complaints(posterior: Posterior, mode: Mode, draws: Float[np.ndarray, "n d"]) -> list[str]:
    """Say which parameters the data cannot inform, and which they inform only together.

    Args:
        posterior: posterior.
        mode: its mode.
        draws: posterior draws in the parameters' own units.
    """
    names = posterior.names
    sd = draws.std(axis=0)
    said = []
    for i, parameter in enumerate(posterior.parameters):
        ratio = sd[i] / parameter.prior.sd
        if ratio > CONTRACTION:
            said.append(
                f"the data cannot inform {parameter.name}: its standard deviation is {ratio:.0%} of the prior's, "
                "so the stated value is the prior's; run a trial that excites it, or fix it"
            )
    prior_precision = -np.asarray(_prior_hessian(posterior, jnp.asarray(mode.z)))
    eigenvalues, vectors = np.linalg.eigh(mode.precision - prior_precision)
    if eigenvalues[0] < 1e-10 * eigenvalues[-1]:
        direction = vectors[:, 0]
        involved = [f"{weight:+.2f} {name}" for name, weight in zip(names, direction, strict=True) if abs(weight) > 0.1]
        said.append(
            "one combination is invisible in these data whatever their length (structural): "
            + " ".join(involved)
            + " in units of the prior standard deviations; fix one of these, or measure something else"
        )
    said += [
        f"the posterior of {parameter.name} leans on the bound {bound:.4g} {parameter.unit} of its prior ({share:.0%} of it within "
        f"{EDGE:.0%} of the width): the prior decides as much as the data; widen it, or say why it ends there"
        for parameter, column in zip(posterior.parameters, draws.T, strict=True)
        for bound, share in _leaning(parameter, column)
    ]
    correlation = np.corrcoef(draws.T) if len(names) > 1 else np.ones((1, 1))
    for i, j in combinations(range(len(names)), 2):
        if abs(correlation[i, j]) > CORRELATION:
            said.append(
                f"{names[i]} and {names[j]} are known together rather than each (correlation {correlation[i, j]:+.3f}): "
                "use them as a pair"
                + (
                    "; a trial over a wider range of speeds would separate them"
                    if _are_forces(names[i], names[j])
                    else ""
                )
            )
    return said


def _are_forces(*names: str) -> bool:
    return all(name.split("_")[0] in AXES for name in names)


@jax.jit
def _prior_hessian(posterior: Posterior, z: Array) -> Array:
    return jax.hessian(posterior.log_prior)(z)


def _remedy(parameter: Parameter, bound: float) -> str:
    if parameter.unit == "s" and parameter.name.startswith("tau_") and bound == parameter.prior.bounds[0]:
        return 'set estimation.residuals = "white" and remove this prior: what is left over has no memory'
    return "widen the prior, or check units, signs and the channel map"


def _scaled_bounds(parameter: Parameter) -> tuple[Callable, Callable, np.ndarray]:
    """Map to the scale on which widths are measured, its inverse, and the bounds on it; scales are logarithmic."""
    there, back = (np.log, np.exp) if isinstance(parameter.prior, LogUniform) else (np.asarray, np.asarray)
    return there, back, there(np.asarray(parameter.prior.bounds, float))


def _suspect_bounds(parameter: Parameter, value: float) -> list[tuple[float, float]]:
    """Bounds near which the mode lies, each with a point a tenth of the width beyond it."""
    there, back, bounds = _scaled_bounds(parameter)
    width = bounds[1] - bounds[0]
    if not np.isfinite(width):
        return []
    near = [(at, sign) for at, sign in zip(bounds, (-1.0, 1.0), strict=True) if abs(there(value) - at) <= EDGE * width]
    pairs = [(float(back(at)), float(back(at + sign * 0.1 * width))) for at, sign in near]
    return [(bound, beyond) for bound, beyond in pairs if not (parameter.prior.bounds[0] >= 0 >= beyond)]


def _leaning(parameter: Parameter, draws: Float[np.ndarray, " n"]) -> list[tuple[float, float]]:
    """Bounds against which much of the posterior lies, each with that share."""
    there, back, bounds = _scaled_bounds(parameter)
    width = bounds[1] - bounds[0]
    if not np.isfinite(width):
        return []
    shares = [(float(back(at)), float(np.mean(np.abs(there(draws) - at) <= EDGE * width))) for at in bounds]
    return [(bound, share) for bound, share in shares if share > LEANING]


def _gain_beyond(posterior: Posterior, values: Float[np.ndarray, " d"], index: int, beyond: float) -> float:
    """Gain in log-likelihood of moving one parameter, the others following where the likelihood is quadratic."""
    move = np.zeros(values.size)
    move[index] = beyond - values[index]
    others = np.arange(values.size) != index
    hessian = np.asarray(_likelihood_hessian(posterior, jnp.asarray(values)))
    candidates = [values + move]
    if np.isfinite(hessian).all() and np.linalg.eigvalsh(-hessian[np.ix_(others, others)]).min(initial=1.0) > 0:
        follow = -np.linalg.solve(hessian[np.ix_(others, others)], hessian[others, index]) * move[index]
        candidates.append(candidates[0] + np.insert(follow, index, 0.0))
    here, *there = (float(_likelihood(posterior, jnp.asarray(point))) for point in (values, *candidates))
    return max(there) - here


@jax.jit
def _likelihood(posterior: Posterior, values: Array) -> Array:
    """Log-likelihood at parameter values, which need not lie inside the prior."""
    return posterior.likelihood(dict(zip(posterior.names, values, strict=True)), posterior.data)


@jax.jit
def _likelihood_hessian(posterior: Posterior, values: Array) -> Array:
    return jax.jacfwd(jax.jacfwd(lambda v: _likelihood(posterior, v)))(values)
