"""Two questions every estimate must answer: does the prior hold the data's answer, and do the data say more than the prior?"""

import math
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError
from seatrial.estimation.mode import Mode
from seatrial.estimation.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform

EDGE = 0.02
GAIN = 10.0
CONTRACTION = 0.9
CORRELATION = 0.95


def check_prior_contains_data(posterior: Posterior, mode: Mode, where: str) -> None:
    """Refuse a uniform prior against whose edge the data push.

    A mode within 2 % of a bound is suspect; if a step of a tenth of the width beyond the bound makes the data more likely
    by over 10 nats, the prior excludes them.

    Args:
        posterior: posterior.
        mode: its mode.
        where: configuration file, for the error.

    Raises:
        InputError: naming the parameter, its bound and the gain beyond it.
    """
    values = dict(zip(posterior.names, map(float, mode.values), strict=True))
    for parameter in posterior.parameters:
        for bound, beyond in _suspect_bounds(parameter, values[parameter.name]):
            gain = _log_likelihood(posterior, {**values, parameter.name: beyond}) - _log_likelihood(posterior, values)
            if gain > GAIN:
                raise InputError(
                    f"{where}, key prior.{parameter.name}",
                    found=f"the data push {parameter.name} against its bound {bound:.4g} {parameter.unit}; beyond it, "
                    f"at {beyond:.4g}, they are {gain:.0f} nats more likely",
                    expected="a prior that contains what the data say",
                    remedy="widen the prior, or check units, signs and the channel map: "
                    "a prior this certain should not be wrong",
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
    correlation = np.corrcoef(draws.T) if len(names) > 1 else np.ones((1, 1))
    for i, j in combinations(range(len(names)), 2):
        if abs(correlation[i, j]) > CORRELATION:
            said.append(
                f"{names[i]} and {names[j]} are known together rather than each (correlation {correlation[i, j]:+.3f}): "
                "use them as a pair; a trial over a wider range of speeds would separate them"
            )
    return said


@jax.jit
def _prior_hessian(posterior: Posterior, z: Array) -> Array:
    return jax.hessian(posterior.log_prior)(z)


def _suspect_bounds(parameter: Parameter, value: float) -> list[tuple[float, float]]:
    """Bounds near which the mode lies, each with a point a tenth of the width beyond it; widths of scales are logarithmic."""
    scale = isinstance(parameter.prior, LogUniform)
    there, back = (math.log, math.exp) if scale else (float, float)
    if not np.isfinite(parameter.prior.bounds).all():
        return []
    lower, upper = map(there, parameter.prior.bounds)
    width = upper - lower
    near = [(bound, sign) for bound, sign in ((lower, -1.0), (upper, 1.0)) if abs(there(value) - bound) <= EDGE * width]
    pairs = [(back(bound), back(bound + sign * 0.1 * width)) for bound, sign in near]
    return [(bound, beyond) for bound, beyond in pairs if not (parameter.prior.bounds[0] >= 0 >= beyond)]


def _log_likelihood(posterior: Posterior, values: dict[str, float]) -> float:
    return float(
        jax.jit(lambda p, v: p.likelihood(v, p.data))(
            posterior, {name: jnp.asarray(value) for name, value in values.items()}
        )
    )
