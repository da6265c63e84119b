"""Evidence by bridge sampling from posterior draws (Meng and Wong, Statistica Sinica 6, 1996).

    Z = E_g[h p L] / E_post[h g],  h = 1 / (s1 p L / Z + s2 g),  s1 + s2 = 1,

solved for Z by iteration. The proposal g is fitted to the first half of each chain, the averages use the second, and the
error counts autocorrelation (Fruehwirth-Schnatter, Econometrics Journal 7, 2004).
"""

from typing import Any, Literal

import jax
import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import expit, logsumexp

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import MIN_ESS
from seatrial.sampling.target import evaluate
from seatrial.selection.verdict import Evidence

ProposalShape = Literal["normal", "t"]
FREEDOM = 5.0
MAX_ERROR = 0.2  # Standard error, nats, above which the error formula itself, an expansion, is not believed
TOLERANCE, MAX_ITERATIONS = 1e-10, 1000


def bridge_evidence(
    posterior: Posterior,
    draws: Float[np.ndarray, "chains draws d"],
    key: jax.Array,
    *,
    proposal: ProposalShape = "normal",
    evaluations: int = 10_000,
) -> Evidence:
    """Return the evidence from draws of the posterior.

    Args:
        posterior: density to integrate.
        draws: converged chains of its z, warm-up dropped.
        key: random key of the proposal's draws.
        proposal: shape fitted to the first half: normal, or Student's t of 5 degrees of freedom.
        evaluations: draws of the proposal, and at most about this many of the posterior, whose chains are thinned to it.

    Raises:
        InputError: too few draws to fit the proposal.
        NumericalError: chains that never moved, or no overlap between proposal and posterior.
    """
    chains, length, d = draws.shape
    half = length // 2
    if half < 4 or chains * half <= 2 * d:
        raise InputError(
            "bridge sampling, posterior draws",
            found=f"{chains} chains of {length} draws of {d} parameters",
            expected="at least 8 draws in each chain, and 4 for each parameter",
            remedy="ask the sampler for more draws",
        )
    thin = -(-chains * (length - half) // evaluations)
    rest = draws[:, half::thin]
    g = _fit(draws[:, :half].reshape(-1, d), proposal)
    seed = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    drawn = np.asarray(g.rvs(evaluations, random_state=seed)).reshape(evaluations, d)
    from_posterior = _log_ratio(posterior, g, rest.reshape(-1, d))
    from_proposal = _log_ratio(posterior, g, drawn)
    if not np.isfinite(from_posterior).all() or not np.isfinite(from_proposal).any():
        raise NumericalError(
            "bridge sampling: the normal approximation of the posterior and the posterior do not overlap; "
            "the chains have not converged, or they belong to another posterior"
        )
    ess = _ess(from_posterior.reshape(chains, -1))
    share = ess / (ess + evaluations)
    log_value, iterations = _iterate(from_posterior, from_proposal, share)
    error, bridge_ess = _relative_error(from_posterior.reshape(chains, -1), from_proposal, log_value, share)
    diagnostics = {
        "ess": bridge_ess,
        "iterations": iterations,
        "posterior_draws": from_posterior.size,
        "proposal_draws": evaluations,
        "proposal": proposal,
    }
    return Evidence(
        log_value, error, "bridge sampling", diagnostics, "; ".join(_complaints(error, bridge_ess, iterations))
    )


def _fit(z: np.ndarray, shape: ProposalShape) -> Any:
    """Return the multivariate normal or Student's t with the mean and covariance of the draws, as a frozen scipy distribution."""
    mean, cov = z.mean(0), np.atleast_2d(np.cov(z, rowvar=False))
    if not np.linalg.eigvalsh(cov).min() > 0:
        raise NumericalError("bridge sampling: the draws do not vary in every direction; the chains never moved")
    if shape == "normal":
        return scipy.stats.multivariate_normal(mean, cov)
    return scipy.stats.multivariate_t(mean, cov * (FREEDOM - 2) / FREEDOM, df=FREEDOM)


def _log_ratio(posterior: Posterior, g: Any, z: np.ndarray) -> Float[np.ndarray, " n"]:
    """log(p L / g) of each draw; the density is -inf where the model diverges."""
    return evaluate(posterior, z) - np.atleast_1d(g.logpdf(z))


def _iterate(from_posterior: np.ndarray, from_proposal: np.ndarray, share: float) -> tuple[float, int]:
    """Fixed point of log Z, from the median ratio, and the iterations it took.

    With x = log(p L / (g Z)) the averages are of p L / (s1 p L / Z + s2 g) = Z s(x) / s1 and g / (...) = s(-x) / s2 for the
    logistic function s shifted by log(s1 / s2), so nothing overflows.
    """
    shift = np.log(share) - np.log1p(-share)
    log_z = float(np.median(from_posterior))
    for iteration in range(1, MAX_ITERATIONS + 1):
        above = logsumexp(_log_expit(from_proposal - log_z + shift)) - np.log(from_proposal.size)
        below = logsumexp(_log_expit(log_z - from_posterior - shift)) - np.log(from_posterior.size)
        step = float(above - below - shift)
        log_z += step
        if abs(step) < TOLERANCE:
            return log_z, iteration
    return log_z, MAX_ITERATIONS


def _relative_error(chains: np.ndarray, from_proposal: np.ndarray, log_z: float, share: float) -> tuple[float, float]:
    """Return the standard error of log Z, the root of the relative mean-squared error of Z, and the effective draws of the chains' part."""
    shift = np.log(share) - np.log1p(-share)
    proposed = expit(from_proposal - log_z + shift)
    visited = expit(log_z - chains - shift)
    ess = _ess(visited)
    proposed_part = proposed.var() / (proposed.mean() ** 2 * proposed.size)
    visited_part = visited.var() / (visited.mean() ** 2 * ess)
    return float(np.sqrt(proposed_part + visited_part)), ess


def _ess(x: Float[np.ndarray, "chains n"]) -> float:
    """Return the effective sample size for the mean of a quantity along the chains, at most their number of draws."""
    from arviz_stats.base.array import array_stats

    if np.ptp(x) == 0:
        return float(x.size)
    return float(min(array_stats.ess(np.ascontiguousarray(x), method="mean"), x.size))


def _log_expit(x: np.ndarray) -> np.ndarray:
    return -np.logaddexp(0.0, -x)


def _complaints(error: float, ess: float, iterations: int) -> list[str]:
    """Return what is wrong, in words."""
    messages = []
    if iterations == MAX_ITERATIONS:
        messages.append("the bridge did not settle: proposal and posterior hardly overlap, use tempered SMC")
    if error > MAX_ERROR:
        messages.append(f"the error of {error:.2f} nats is too large for its own formula: use more draws")
    if ess < MIN_ESS:
        messages.append(f"the chains are worth only {ess:.0f} independent draws, at least {MIN_ESS:.0f}: sample longer")
    return messages
