"""Evidence by the Laplace approximation, with a cheap check of whether it may be used.

    log Z = log p(z*) L(z*) + d/2 log 2 pi - 1/2 log det H      Tierney and Kadane, J. Am. Stat. Assoc. 81, 1986

H is the negative Hessian at the mode z*. The value has no Monte Carlo error and its own error is unknown, so the standard error
is NaN. A few hundred importance draws about the mode say how far off it is, and a parameter at its bound is named.

What it cannot see: any mode but the one found. The check draws about the same mode and is as blind.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.core.errors import NumericalError
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.posterior import Posterior
from seatrial.selection.evidence import Evidence
from seatrial.selection.importance import MAX_K_HAT, Weights, evidence_of, laplace_proposal, weigh

MAX_CORRECTION = 0.2
"""Correction, nats, above which the approximation is not to be used."""
MIN_CHECK_ESS = 20.0
"""Effective draws below which the correction is not known."""
AT_BOUND = 0.1
"""Share of the distance from mode to bound that is left after two standard deviations towards it."""


class _Check(NamedTuple):
    """Correction of the log evidence by importance draws and its error, nats, their effective number and tail index."""

    correction: float
    error: float
    ess: float
    k_hat: float


def laplace_evidence(posterior: Posterior, key: jax.Array, mode: Mode | None = None, draws: int = 512) -> Evidence:
    """Laplace approximation of the log evidence; its status says when not to trust it.

    Args:
        posterior: density to integrate.
        key: random key.
        mode: posterior mode, found here if not given.
        draws: importance draws of the check.

    Raises:
        NumericalError: no mode.
    """
    mode_key, key = jax.random.split(key)
    mode = find_mode(posterior, mode_key) if mode is None else mode
    check = _check(posterior, mode, key, draws)
    bounded = active_bounds(posterior, mode)
    diagnostics = {
        "correction": check.correction,
        "correction_error": check.error,
        "ess": check.ess,
        "k_hat": check.k_hat,
        "at_bound": list(bounded),
        "flat": mode.flat,
    }
    status = "; ".join(_complaints(mode, check, bounded))
    return Evidence(float(mode.log_evidence), float("nan"), "Laplace approximation", diagnostics, status)


def active_bounds(posterior: Posterior, mode: Mode) -> tuple[str, ...]:
    """Return the parameters whose posterior runs into an end of its prior: two standard deviations take them nearly all the way."""
    reach = 2.0 * np.sqrt(np.diag(mode.cov))
    low, high = (np.asarray(posterior.constrain(jnp.asarray(mode.z + sign * reach))) for sign in (-1.0, 1.0))
    named = []
    for i, parameter in enumerate(posterior.parameters):
        lower, upper = parameter.prior.bounds
        ends = [(float(lower), low[i]), (float(upper), high[i])]
        if any(np.isfinite(end) and abs(x - end) <= AT_BOUND * abs(mode.values[i] - end) for end, x in ends):
            named.append(parameter.name)
    return tuple(named)


def _check(posterior: Posterior, mode: Mode, key: jax.Array, draws: int) -> _Check:
    try:
        weights: Weights = weigh(posterior, [laplace_proposal(mode)], key, draws)
    except NumericalError:
        return _Check(float("nan"), float("nan"), 0.0, float("nan"))
    result = evidence_of(weights)
    return _Check(float(result.log_value - mode.log_evidence), result.std_error, weights.ess, weights.k_hat)


def _complaints(mode: Mode, check: _Check, bounded: tuple[str, ...]) -> list[str]:
    """Return what is wrong with the approximation, in words."""
    said = []
    if mode.flat:
        said.append("the posterior has no curvature in some direction: the data say nothing there, use tempered SMC")
    if bounded:
        said.append(f"the posterior of {', '.join(bounded)} runs into the end of the prior: use importance sampling")
    if not (check.ess >= MIN_CHECK_ESS and check.k_hat <= MAX_K_HAT):
        said.append(
            f"the posterior is far from normal (of the draws of the check {check.ess:.0f} count, Pareto k {check.k_hat:.2f}): "
            "use importance sampling or tempered SMC"
        )
    elif abs(check.correction) > MAX_CORRECTION + 2.0 * check.error:
        said.append(f"importance draws correct it by {check.correction:+.2f} nats: use importance sampling")
    return said
