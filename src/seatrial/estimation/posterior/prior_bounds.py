"""Which parameters lie at a bound of their prior, where the prior decides as much as the data."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import is_coefficient
from seatrial.core.findings import Finding
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.estimation.priors import LogUniform

# Distance from a bound, over the width of the prior, from which on a posterior that reaches the bound lies at it.
EDGE = 0.02
# Likewise of any posterior: of a uniform prior, one value in a hundred lies so near to one of its bounds.
MAX_BESIDE = 0.005
MAX_REACH_SDS = 3.0  # Standard deviations within which a posterior reaches a bound
MIN_LEANING_SHARE = 0.1  # Share of the posterior that may lie within `EDGE` of a bound


def scaled_bounds(parameter: Parameter) -> tuple[Callable, Callable, Float[np.ndarray, "2"], float]:
    """Return the scale on which widths are measured, its inverse, the bounds on it and the width; of scales, the logarithm.

    Where one side is open, the width is that of a uniform of the same standard deviation.
    """
    there, back = (np.log, np.exp) if isinstance(parameter.prior, LogUniform) else (np.asarray, np.asarray)
    bounds = there(np.asarray(parameter.prior.bounds, float))
    width = bounds[1] - bounds[0]
    return there, back, bounds, float(width if np.isfinite(width) else np.sqrt(12.0) * parameter.prior.sd)


def bound_finding(parameter: Parameter, value: float, sd: float) -> Finding | None:
    """Report the bound of its prior at which a parameter lies; None if it lies at none.

    A size has no values beyond 0, so that it cannot be cut off there, and a log-normal has no density at its bound.

    Args:
        parameter: with its prior.
        value: SI.
        sd: standard deviation, SI.
    """
    there, back, bounds, width = scaled_bounds(parameter)
    scale = abs(value) if isinstance(parameter.prior, LogUniform) else 1.0
    for at, edge in zip(bounds, parameter.prior.edges, strict=True):
        bound, off = float(back(at)), abs(float(there(value)) - float(at))
        if not np.isfinite(edge) or (bound == 0.0 and not is_coefficient(parameter.name.partition("@")[0])):
            continue
        if off <= (MAX_BESIDE if bound else 0.0) * width or off <= min(EDGE * width, MAX_REACH_SDS * sd / scale):
            return Finding(
                "at-prior-bound", "caution", (parameter.name,), parameter.shown_value(bound), ("widen-prior",)
            )
    return None


def leaning_bounds(parameter: Parameter, draws: Float[np.ndarray, " n"]) -> list[tuple[float, float]]:
    """Return the bounds of a box against which much of the posterior lies, nearer than its own spread, each with that share."""
    there, back, bounds, width = scaled_bounds(parameter)
    if not np.isfinite(bounds).all():
        return []
    off = [(float(back(at)), np.abs(there(draws) - at)) for at in bounds]
    near = min(EDGE * width, float(np.std(there(draws))))
    return [(bound, float(np.mean(x <= EDGE * width))) for bound, x in off if np.mean(x <= near) > MIN_LEANING_SHARE]
