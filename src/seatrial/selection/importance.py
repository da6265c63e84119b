"""Evidence by importance sampling about the mode: Z = E_q[p(z) L(z) / q(z)] (Geweke, Econometrica 57, 1989).

The proposal q = 0.8 t_8(m, C) + 0.2 t_8(m, 4 C) has heavier tails than a posterior that is nearly normal in z. It starts from
the Laplace approximation and is refitted to the weighted draws until enough of them count; the draws of the answer are fresh.
Whether the weights have a variance is judged by the index of their tail (Vehtari et al., JMLR 25, 2024).
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import gammaln, logsumexp

from seatrial.core.errors import NumericalError
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.uncoupled import coupled, uncouple
from seatrial.sampling.target import Target, evaluate
from seatrial.selection.evidence import Evidence

FREEDOM = 8.0
WIDE_SHARE, WIDE_SCALE = 0.2, 2.0
"""Share of the widened component, and its standard deviations over those of the other."""
GOOD = 0.5
"""Efficiency at which the proposal is not refitted any more, unless the tail of the weights is too heavy."""
MAX_K_HAT = 0.7
MIN_ESS = 400.0


class Proposal(NamedTuple):
    """Centre, shape (d,), and triangular factor of the scale matrix, shape (d, d), of the mixture."""

    centre: Float[np.ndarray, " d"]
    factor: Float[np.ndarray, "d d"]


class Weights(NamedTuple):
    """Draws, log weights log(p L / q), the same with a smoothed tail that sum to 1, tail index, effective size, refits before."""

    z: Float[np.ndarray, "n d"]
    log_weight: Float[np.ndarray, " n"]
    smoothed: Float[np.ndarray, " n"]
    k_hat: float
    ess: float
    refits: int = 0


@dataclass(frozen=True)
class ImportanceSettings:
    """Size of a run.

    Attributes:
        draws: fresh draws of the final estimate.
        pilot: draws of each trial of a proposal.
        refits: how often the proposal may be refitted.
    """

    draws: int = 20480
    pilot: int = 4096
    refits: int = 2


def importance_evidence(
    posterior: Posterior, key: jax.Array, mode: Mode | None = None, settings: ImportanceSettings = ImportanceSettings()
) -> Evidence:
    """Evidence by adaptive importance sampling; arguments and errors as `importance_sample`."""
    return evidence_of(importance_sample(posterior, key, mode, settings))


def importance_sample(
    posterior: Posterior, key: jax.Array, mode: Mode | None = None, settings: ImportanceSettings = ImportanceSettings()
) -> Weights:
    """Weighted draws of the posterior.

    Args:
        posterior: density to integrate; of one mode, since another far from it would be missed without a sign.
        key: random key.
        mode: posterior mode, found here if not given.
        settings: size of the run.

    Raises:
        NumericalError: no mode, or no draw of finite density.
    """
    mode_key, pilot_key, key = jax.random.split(key, 3)
    target, there = uncouple(posterior, find_mode(posterior, mode_key) if mode is None else mode)
    proposal = laplace_proposal(there)
    done = 0
    for done in range(settings.refits + 1):
        weights = weigh(target, proposal, jax.random.fold_in(pilot_key, done), settings.pilot)
        if done == settings.refits or (weights.ess / settings.pilot > GOOD and weights.k_hat <= MAX_K_HAT):
            break
        proposal = refit(proposal, weights)
    weights = weigh(target, proposal, key, settings.draws)
    return weights._replace(z=np.asarray(coupled(target, weights.z)), refits=done)


def evidence_of(weights: Weights) -> Evidence:
    """Evidence from weighted draws, its error by the delta method from the variance of the weights."""
    draws = weights.log_weight.size
    diagnostics = {
        "k_hat": weights.k_hat,
        "ess": weights.ess,
        "efficiency": weights.ess / draws,
        "draws": draws,
        "refits": weights.refits,
    }
    return Evidence(
        _log_sum(weights.log_weight) - float(np.log(draws)),
        float(np.sqrt(1.0 / weights.ess - 1.0 / draws)),
        "importance sampling about the mode",
        diagnostics,
        "; ".join(_complaints(weights)),
    )


def weighted_sd(posterior: Posterior, weights: Weights) -> Float[np.ndarray, " d"]:
    """Posterior standard deviations of the parameters in their own units, shape (d,)."""
    share = np.exp(weights.smoothed - _log_sum(weights.smoothed))
    values = np.asarray(posterior.constrain(jnp.asarray(weights.z)))
    return np.sqrt(share @ (values - share @ values) ** 2)


def laplace_proposal(mode: Mode) -> Proposal:
    """Proposal at the mode, nowhere wider than the prior, which has unit variance in z.

    A density that leans on the edge of its box has almost no curvature at the mode, and its Laplace covariance no meaning.
    """
    values, vectors = np.linalg.eigh(mode.precision)
    return Proposal(mode.z, np.linalg.cholesky((vectors / np.maximum(values, 1.0)) @ vectors.T))


def weigh(target: Target, proposal: Proposal, key: jax.Array, n: int) -> Weights:
    """Draw from the proposal and weigh the draws.

    Raises:
        NumericalError: every draw has zero density.
    """
    from arviz_stats.base.array import array_stats

    z, log_q = _draw(proposal, np.random.default_rng(np.asarray(jax.random.key_data(key))), n)
    log_weight = evaluate(target, z) - log_q
    top = log_weight.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {n} draws about the posterior mode has a finite density: start from another mode, or narrow the prior"
        )
    smoothed, k_hat = array_stats.psislw(-np.maximum(log_weight, top - 700.0))
    ess = 1.0 / float(np.sum(np.exp(2 * (log_weight - _log_sum(log_weight)))))
    return Weights(np.asarray(z), log_weight, np.asarray(smoothed), float(k_hat), ess)


def refit(proposal: Proposal, weights: Weights) -> Proposal:
    """Proposal with the moments of the weighted draws, the old scale counting as much as d + 2 effective draws."""
    share = np.exp(weights.smoothed - _log_sum(weights.smoothed))
    centre = share @ weights.z
    spread = weights.z - centre
    trust, doubt = 1.0 / float(share @ share), centre.size + 2.0
    old = proposal.factor @ proposal.factor.T
    return Proposal(centre, np.linalg.cholesky((trust * (spread.T * share) @ spread + doubt * old) / (trust + doubt)))


def _complaints(weights: Weights) -> list[str]:
    """What is wrong with the weights, in words."""
    said = []
    if not weights.k_hat <= MAX_K_HAT:
        said.append(
            f"a few draws carry the sum (Pareto k {weights.k_hat:.2f}, at most {MAX_K_HAT}): the posterior is far from normal, "
            "use tempered SMC"
        )
    if weights.ess < MIN_ESS:
        said.append(f"only {weights.ess:.0f} effective draws, at least {MIN_ESS:.0f}: use more draws")
    return said


def _draw(
    proposal: Proposal, random: np.random.Generator, n: int
) -> tuple[Float[np.ndarray, "n d"], Float[np.ndarray, " n"]]:
    """Independent draws of the mixture, and its log density at them."""
    d = proposal.centre.size
    stretch = np.sqrt(FREEDOM / random.chisquare(FREEDOM, n))
    stretch *= np.where(random.uniform(size=n) < WIDE_SHARE, WIDE_SCALE, 1.0)
    e = stretch[:, None] * random.normal(size=(n, d))
    square = np.sum(e * e, -1)
    power = 0.5 * (FREEDOM + d)
    plain = np.log(1.0 - WIDE_SHARE) - power * np.log1p(square / FREEDOM)
    wide = np.log(WIDE_SHARE / WIDE_SCALE**d) - power * np.log1p(square / (FREEDOM * WIDE_SCALE**2))
    constant = gammaln(power) - gammaln(0.5 * FREEDOM)
    constant -= 0.5 * d * np.log(FREEDOM * np.pi) + np.sum(np.log(np.diag(proposal.factor)))
    return proposal.centre + e @ proposal.factor.T, constant + np.logaddexp(plain, wide)


def _log_sum(x: np.ndarray) -> float:
    return float(logsumexp(x))
