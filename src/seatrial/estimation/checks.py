"""Two questions every estimate must answer: does the prior hold the data's answer, and do the data say more than the prior?"""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.estimation.identifiability import identifiability_of_fit
from seatrial.estimation.information import expand_likelihood
from seatrial.estimation.mode import Mode
from seatrial.estimation.posterior import Parameter, Posterior
from seatrial.estimation.priors import LogUniform

EDGE = 0.02
GAIN = 10.0
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


def information_complaints(
    posterior: Posterior, mode: Mode, draws: Float[np.ndarray, "n d"], at: Mapping[str, float] | None = None
) -> list[str]:
    """Say which parameters the data cannot inform, which they inform only together, and which lean on their priors.

    Args:
        posterior: posterior.
        mode: its mode.
        draws: posterior draws in the parameters' own units.
        at: operating point, signal name to SI value, at which sums of force coefficients have a meaning.
    """
    return identifiability_of_fit(posterior, mode, draws, at).cautions() + [
        f"the posterior of {parameter.name} leans on the bound {bound:.4g} {parameter.unit} of its prior ({share:.0%} of it within "
        f"{EDGE:.0%} of the width): the prior decides as much as the data; widen it, or say why it ends there"
        for parameter, column in zip(posterior.parameters, draws.T, strict=True)
        for bound, share in _leaning(parameter, column)
    ]


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
    hessian = expand_likelihood(posterior, values[None]).hessian[0]
    candidates = [values + move]
    if np.isfinite(hessian).all() and np.linalg.eigvalsh(-hessian[np.ix_(others, others)]).min(initial=1.0) > 0:
        follow = -np.linalg.solve(hessian[np.ix_(others, others)], hessian[others, index]) * move[index]
        candidates.append(candidates[0] + np.insert(follow, index, 0.0))
    here, *there = expand_likelihood(posterior, np.stack([values, *candidates])).value
    return float(max(there) - here)
