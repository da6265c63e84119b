"""Bayes factor of a term from draws of the model that has it: the Savage-Dickey ratio (Dickey, Ann. Math. Stat. 42, 1971).

    log Z(with) - log Z(without) = log p(c = 0) - log p(c = 0 | data)

where the model without the term is the one with c = 0 and the same independent priors of all else. Densities are of the
unconstrained z of c, whose prior has no edges. The posterior density at 0 is that of a fitted normal g, corrected by a kernel
average of its own error (Hjort and Glad, Annals of Statistics 23, 1995): g(z0) mean[K_h(z - z0) / g(z)].

What it cannot see: a mode the draws never visited, and the density at 0 if no draws are near, however good the fit looks.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, NumericalError, nearest
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import load_array_stats

MIN_NEAR_DRAWS = 100.0  # Effective draws about the value below which its density is an extrapolation
MIN_BLOCKS = 20  # Stretches of the chains, at least, whose scatter gives the error


@dataclass(frozen=True)
class BayesFactor:
    """Evidence for a term.

    Attributes:
        log_value: log Z with the term less log Z without it, nats; positive where the data want it.
        std_error: its Monte Carlo standard error, the bias of the kernel included.
        method: how it was computed.
        diagnostics: effective draws near the value, its distance from the posterior mean in standard deviations.
        status: empty if sound, else the fault in words.
    """

    log_value: float
    std_error: float
    method: str
    diagnostics: dict[str, Any]
    status: str = ""


def savage_dickey(
    posterior: Posterior,
    name: str,
    draws: Float[np.ndarray, "chains draws d"],
    *,
    at: float = 0.0,
) -> BayesFactor:
    """Bayes factor of a parameter being free over its being `at`.

    Args:
        posterior: the model with the term.
        name: its parameter.
        draws: converged chains of z, warm-up dropped.
        at: value that stands for the term's absence.

    Raises:
        InputError: no such parameter, a value not inside its prior, or fewer than 1000 draws.
        NumericalError: chains that never moved, or no draw near the value.
    """
    array_stats = load_array_stats()
    if name not in posterior.names:
        raise InputError(
            "Savage-Dickey ratio, name",
            found=name,
            expected="a parameter of the posterior",
            remedy=nearest(name, posterior.names),
        )
    index = posterior.names.index(name)
    prior = posterior.parameters[index].prior
    lower, upper = prior.bounds
    if not lower < at < upper:
        raise InputError(
            f"Savage-Dickey ratio, {name}",
            found=f"the value {at:g} under a prior from {float(lower):g} to {float(upper):g}",
            expected="a value inside the prior",
            remedy="widen the prior beyond it, or compare the evidences of the two models",
        )
    if draws.shape[0] * draws.shape[1] < 1000:
        raise InputError(
            "Savage-Dickey ratio, posterior draws",
            found=f"{draws.shape[0]} chains of {draws.shape[1]} draws",
            expected="at least 1000 draws in all",
            remedy="ask the sampler for more draws",
        )
    z, z0 = draws[:, :, index], float(prior.unconstrain(at))
    sd = float(z.std())
    ess = float(min(array_stats.ess(np.ascontiguousarray(z), method="mean"), z.size)) if np.ptp(z) > 0 else 1.0
    if not sd > 0:
        raise NumericalError(f"the draws of {name} do not vary; the chains never moved")
    away = (z0 - float(z.mean())) / sd
    width = 2.34 * sd * ess**-0.2
    near = float(np.mean(np.abs(z - z0) < width)) * ess
    status = _tail(name, at, away, near)
    if not near > 0:
        raise NumericalError(status)
    log_density, error = _kernel(z, z0, width)
    diagnostics = {"near": near, "ess": ess, "distance": away, "log_density": log_density}
    value = float(prior.log_density(z0)) - log_density
    return BayesFactor(value, error, "Savage-Dickey ratio, kernel", diagnostics, status)


def _kernel(z: np.ndarray, z0: float, width: float) -> tuple[float, float]:
    """Return the log density and its error; the bias falls with the square of the width, so a smaller width tells of it."""
    log_density, error = _jackknife(lambda x: _guided(x, z0, width), z)
    narrower = _guided(z.ravel(), z0, width / np.sqrt(2.0))
    bias = log_density - narrower if np.isfinite(narrower) else 0.0
    return log_density, float(np.hypot(error, bias))


def _guided(x: np.ndarray, z0: float, width: float) -> float:
    """Log of the normal density at z0 times the kernel average of the draws over it; an Epanechnikov kernel ends at its width."""
    mean, sd = x.mean(), x.std()
    close = x[np.abs(x - z0) < width]
    if close.size == 0:
        return -np.inf
    weight = 0.75 * (1.0 - ((close - z0) / width) ** 2) / width
    return float(np.log(np.sum(weight * np.exp(0.5 * (((close - mean) / sd) ** 2 - ((z0 - mean) / sd) ** 2))) / x.size))


def _jackknife(estimate: Callable[[np.ndarray], float], z: np.ndarray) -> tuple[float, float]:
    """Estimate from all draws, and its error from leaving out one stretch of a chain at a time."""
    chains = z.shape[0]
    stretches = [part for chain in z for part in np.array_split(chain, max(1, -(-MIN_BLOCKS // chains)))]
    n = len(stretches)
    without = np.array([estimate(np.concatenate(stretches[:i] + stretches[i + 1 :])) for i in range(n)])
    error = np.sqrt((n - 1) * np.var(without)) if np.isfinite(without).all() else np.inf
    return estimate(z.ravel()), float(error)


def _tail(name: str, at: float, away: float, near: float) -> str:
    """Return whether too few draws lie about the value, in words."""
    if near >= MIN_NEAR_DRAWS:
        return ""
    return (
        f"{name} = {at:g} lies {abs(away):.1f} standard deviations from the posterior mean, with only {near:.0f} effective draws there "
        f"(at least {MIN_NEAR_DRAWS:.0f} needed): compare the evidences of the two models instead"
    )
