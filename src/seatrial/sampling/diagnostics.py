"""Whether chains can be trusted: rank R-hat and effective sample sizes (arviz-stats), and Geweke's score.

z = (mean_a - mean_b) / sqrt(V_a + V_b),  a an early segment, b the end of the chain (Geweke, Bayesian Statistics 4, 1992)
"""

import sys
import threading
from functools import lru_cache
from importlib.util import find_spec, module_from_spec
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from seatrial.core.findings import Finding

MAX_R_HAT = 1.01  # Rank R-hat above which chains disagree (Vehtari et al., Bayesian Analysis 16, 2021)
MIN_ESS = 400.0  # Fewest effective draws, of chains or of weights, on which an answer may rest (the same)
_loading = threading.Lock()


class ChainHealth(NamedTuple):
    """Diagnostics of each parameter, shape (d,).

    Attributes:
        r_hat: rank-normalised split R-hat (Vehtari et al. 2021).
        ess_bulk: effective sample size for the centre.
        ess_tail: effective sample size for the 5 % and 95 % quantiles.
        geweke: root mean square of the scores of the chains, 1 if all have converged.
        mcse: Monte Carlo standard error of the mean.
    """

    r_hat: Float[np.ndarray, " d"]
    ess_bulk: Float[np.ndarray, " d"]
    ess_tail: Float[np.ndarray, " d"]
    geweke: Float[np.ndarray, " d"]
    mcse: Float[np.ndarray, " d"]


def load_array_stats() -> Any:
    """Return arviz-stats' functions of arrays without its others, whose libraries (xarray, pandas) take half a second to load."""
    with _loading:
        return _load_array_stats()


@lru_cache(maxsize=1)
def _load_array_stats() -> Any:
    is_loaded = "arviz_stats" in sys.modules
    for name in () if is_loaded else ("arviz_stats", "arviz_stats.base"):  # packages whose own files are not run
        spec = find_spec(name)
        assert spec is not None
        sys.modules[name] = module_from_spec(spec)
    from arviz_stats.base.array import array_stats

    if not is_loaded:  # whoever imports the package gets all of it
        for name in [name for name in sys.modules if name.startswith("arviz_stats")]:
            del sys.modules[name]
    return array_stats


def diagnose(draws: Float[np.ndarray, "chains draws d"]) -> ChainHealth:
    """Compute the diagnostics of draws in the parameters' own units."""
    array_stats = load_array_stats()
    per_parameter = [np.ascontiguousarray(draws[:, :, i]) for i in range(draws.shape[2])]
    return ChainHealth(
        r_hat=np.array([array_stats.rhat(x) for x in per_parameter], float),
        ess_bulk=np.array([array_stats.ess(x, method="bulk") for x in per_parameter], float),
        ess_tail=np.array([array_stats.ess(x, method="tail", prob=(0.05, 0.95)) for x in per_parameter], float),
        geweke=np.array([float(np.sqrt(np.mean([geweke_score(chain) ** 2 for chain in x]))) for x in per_parameter]),
        mcse=np.array([array_stats.mcse(x) for x in per_parameter], float),
    )


def mixing(draws: Float[np.ndarray, "chains draws d"]) -> tuple[float, float]:
    """Return the largest R-hat and the smallest effective sample size of all parameters; NaN if a chain never moved."""
    array_stats = load_array_stats()
    each = [np.ascontiguousarray(draws[:, :, i]) for i in range(draws.shape[2])]
    r_hat, ess = [array_stats.rhat(x) for x in each], [array_stats.ess(x, method="bulk") for x in each]
    return float(np.max(r_hat)), float(np.min(ess))


def asks_for_more(health: ChainHealth) -> bool:
    """Return whether chains disagree, or have too few effective draws, in a way that more draws may mend: all have moved."""
    effective = np.minimum(health.ess_bulk, health.ess_tail)
    return bool(((health.r_hat > MAX_R_HAT) | (effective < MIN_ESS)).any() and np.isfinite(health.r_hat).all())


def geweke_score(chain: Float[np.ndarray, " n"], first: float = 0.1, last: float = 0.5) -> float:
    """Geweke's convergence score of one chain (Bayesian Statistics 4, 1992).

    The difference of the means of the first 10 % and the last 50 % over its standard error, from the spectral density at
    zero: with the plain variance of the draws, as sometimes printed, the score cannot fail.
    """
    early, late = chain[: int(first * chain.size)], chain[chain.size - int(last * chain.size) :]
    variance = variance_of_mean(early) + variance_of_mean(late)
    return float((early.mean() - late.mean()) / np.sqrt(variance)) if variance > 0 else float("inf")


def chain_findings(names: tuple[str, ...], health: ChainHealth) -> list[Finding]:
    """Report what is wrong, one finding for each kind of fault with the parameters that have it; none if chains are healthy."""
    effective = np.minimum(health.ess_bulk, health.ess_tail)
    still = ~np.isfinite(health.r_hat)
    apart = ~still & (health.r_hat > MAX_R_HAT)
    few = ~still & ~apart & (effective < MIN_ESS)

    def of(which: Bool[np.ndarray, " d"]) -> tuple[str, ...]:
        return tuple(name for name, yes in zip(names, which, strict=True) if yes)

    findings = []
    if still.any():
        findings.append(Finding("chains-still", "alarm", of(still), {}, ("check-prior-and-data",)))
    if apart.any():
        values = {"r_hat": float(health.r_hat[apart].max()), "limit": MAX_R_HAT}
        findings.append(Finding("chains-disagree", "alarm", of(apart), values, ("longer-chains",)))
    if few.any():
        least = float(effective[few].min())
        values = {"effective": least, "limit": MIN_ESS, "more": MIN_ESS / max(least, 1.0)}
        findings.append(Finding("draws-too-few", "alarm", of(few), values, ("more-draws",)))
    return findings


def variance_of_mean(x: np.ndarray) -> float:
    """Return the variance of a mean of correlated draws: autoregression of order chosen by AIC, spectral density at zero over n."""
    n = x.size
    centred = x - x.mean()
    if not centred.any():
        return 0.0
    max_order = min(n - 1, max(1, int(10 * np.log10(n))))
    covariances = np.array([centred[: n - lag] @ centred[lag:] / n for lag in range(max_order + 1)])
    variance, coefficients, best = covariances[0], np.empty(0), (n * np.log(covariances[0]), covariances[0])
    for order in range(1, max_order + 1):
        reflection = (covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]) / variance
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance = variance * (1 - reflection**2)
        if variance <= 1e-14 * covariances[0]:
            break
        criterion = n * np.log(variance) + 2 * order
        if criterion < best[0]:
            best = (criterion, variance / (1 - coefficients.sum()) ** 2)
    return float(best[1]) / n
