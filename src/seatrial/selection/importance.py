"""Evidence by importance sampling about the modes: Z = E_q[p(z) L(z) / q(z)] (Geweke, Econometrica 57, 1989).

About a mode q = 0.8 t_8(m, C) + 0.2 t_8(m, 4 C), which has heavier tails than a posterior that is nearly normal in z; of several modes
each has its share of the draws, and q is the mixture (Owen and Zhou, JASA 95, 2000). It starts from the Laplace approximations and is
refitted to the weighted draws until enough of them count; the draws of the answer are fresh. Whether the weights have a variance is
judged by the index of their tail (Vehtari et al., JMLR 25, 2024).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from seatrial.core.errors import NumericalError
from seatrial.core.random_keys import fold_in, split
from seatrial.estimation.mode import Mode, find_mode
from seatrial.estimation.noncentred import coupled, uncouple, uncoupled_mode
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.diagnostics import MIN_ESS
from seatrial.sampling.target import Target, evaluate
from seatrial.selection.evidence import Evidence, EvidenceSettings

FREEDOM = 8.0
WIDE_SHARE, WIDE_SCALE = 0.2, 2.0
"""Share of the widened component, and its standard deviations over those of the other."""
GOOD = 0.5
"""Efficiency at which the proposal is not refitted any more, unless the tail of the weights is too heavy."""
MAX_K_HAT = 0.7
"""Pareto shape of the weights above which their mean is not to be trusted (Vehtari et al., JMLR 25, 2024)."""


class ProposalComponent(NamedTuple):
    """What is drawn about one mode: centre, shape (d,), triangular factor of the scale matrix, shape (d, d), and share of the draws."""

    centre: Float[np.ndarray, " d"]
    factor: Float[np.ndarray, "d d"]
    share: float = 1.0


class Weights(NamedTuple):
    """Draws, log weights log(p L / q), the same with a smoothed tail that sum to 1, tail index, effective size, refits before, modes."""

    z: Float[np.ndarray, "n d"]
    log_weight: Float[np.ndarray, " n"]
    smoothed: Float[np.ndarray, " n"]
    k_hat: float
    ess: float
    refits: int = 0
    modes: int = 1


@dataclass(frozen=True)
class ImportanceSettings:
    """Size of a run.

    Attributes:
        draws: fresh draws of the final estimate.
        pilot: draws of each trial of a proposal.
        refits: how often the proposal may be refitted.
    """

    draws: int = EvidenceSettings.draws
    pilot: int = 4096
    refits: int = 2


def importance_evidence(
    posterior: Posterior,
    key: jax.Array,
    mode: Mode | None = None,
    settings: ImportanceSettings = ImportanceSettings(),
    further: Sequence[Mode] = (),
) -> Evidence:
    """Return the evidence by adaptive importance sampling; arguments and errors as `importance_sample`."""
    return evidence_of(importance_sample(posterior, key, mode, settings, further))


def importance_sample(
    posterior: Posterior,
    key: jax.Array,
    mode: Mode | None = None,
    settings: ImportanceSettings = ImportanceSettings(),
    further: Sequence[Mode] = (),
) -> Weights:
    """Return the weighted draws of the posterior.

    Args:
        posterior: density to integrate; another mode, far from those given, would be missed without a sign.
        key: random key.
        mode: posterior mode, found here if not given.
        settings: size of the run.
        further: other modes.

    Raises:
        NumericalError: no mode, or no draw of finite density.
    """
    mode_key, pilot_key, key = split(key, 3)
    target, there = uncouple(posterior, find_mode(posterior, mode_key) if mode is None else mode)
    modes = [there, *(uncoupled_mode(target, one) for one in further)]
    proposals = [laplace_proposal(one)._replace(share=1.0 / len(modes)) for one in modes]
    done = 0
    for done in range(settings.refits + 1):
        weights = weigh(target, proposals, fold_in(pilot_key, done), settings.pilot)
        shared = done > 0 or len(modes) == 1  # what each of several modes holds is known from the first refit on
        if done == settings.refits or (shared and weights.ess / settings.pilot > GOOD and weights.k_hat <= MAX_K_HAT):
            break
        proposals = refit(proposals, weights)
    weights = weigh(target, proposals, key, settings.draws)
    return weights._replace(z=np.asarray(coupled(target, weights.z)), refits=done, modes=len(modes))


def evidence_of(weights: Weights) -> Evidence:
    """Return the evidence from weighted draws, its error by the delta method from the variance of the weights."""
    draws = weights.log_weight.size
    diagnostics = {
        "k_hat": weights.k_hat,
        "ess": weights.ess,
        "efficiency": weights.ess / draws,
        "draws": draws,
        "refits": weights.refits,
        "modes": weights.modes,
    }
    return Evidence(
        _log_sum(weights.log_weight) - float(np.log(draws)),
        float(np.sqrt(1.0 / weights.ess - 1.0 / draws)),
        f"importance sampling about {'the mode' if weights.modes == 1 else f'{weights.modes} modes'}",
        diagnostics,
        "; ".join(_complaints(weights)),
    )


def weighted_sd(posterior: Posterior, weights: Weights) -> Float[np.ndarray, " d"]:
    """Return the posterior standard deviations of the parameters in their own units, shape (d,)."""
    share = np.exp(weights.smoothed - _log_sum(weights.smoothed))
    values = np.asarray(posterior.constrain(jnp.asarray(weights.z)))
    return np.sqrt(share @ (values - share @ values) ** 2)


def laplace_proposal(mode: Mode) -> ProposalComponent:
    """Return the proposal at the mode, nowhere wider than the prior, which has unit variance in z.

    A density that leans on the edge of its box has almost no curvature at the mode, and its Laplace covariance no meaning.
    """
    values, vectors = np.linalg.eigh(mode.precision)
    return ProposalComponent(mode.z, np.linalg.cholesky((vectors / np.maximum(values, 1.0)) @ vectors.T))


def distance(proposal: ProposalComponent, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the squared distance from the centre, in standard deviations."""
    return np.sum(solve_triangular(proposal.factor, (z - proposal.centre).T, lower=True) ** 2, 0)


def weigh(target: Target, proposals: Sequence[ProposalComponent], key: jax.Array, n: int) -> Weights:
    """Draw from the proposals, each its share, and weigh the draws.

    Args:
        target: density.
        proposals: components of the mixture.
        key: random key.
        n: number of draws.

    Raises:
        NumericalError: every draw has zero density.
    """
    from arviz_stats.base.array import array_stats

    z = draw_mixture(proposals, key, n)
    log_weight = evaluate(target, z) - log_mixture(proposals, z)
    top = log_weight.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {n} draws about the posterior mode has a finite density: start from another mode, or narrow the prior"
        )
    smoothed, k_hat = array_stats.psislw(-np.maximum(log_weight, top - 700.0))
    ess = 1.0 / float(np.sum(np.exp(2 * (log_weight - _log_sum(log_weight)))))
    return Weights(np.asarray(z), log_weight, np.asarray(smoothed), float(k_hat), ess)


def draw_mixture(proposals: Sequence[ProposalComponent], key: jax.Array, n: int) -> Float[np.ndarray, "n d"]:
    """Draw from the proposals, each its share."""
    random = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    ends = np.rint(n * np.cumsum([one.share for one in proposals])).astype(int)
    counts = np.diff(ends, prepend=0)
    return np.concatenate([_draw(one, random, count) for one, count in zip(proposals, counts, strict=True)])


def log_mixture(proposals: Sequence[ProposalComponent], z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the log density of the proposals, each with its share, at some positions."""
    return np.asarray(logsumexp(_log_shares(proposals, z), 0))


def refit(proposals: Sequence[ProposalComponent], weights: Weights) -> list[ProposalComponent]:
    """Return the proposals with the moments of the weighted draws, the old scale counting as much as d + 2 effective draws.

    Of several, a draw belongs to each as far as each is likely to have made it, and half of the draws are shared by what was found.
    """
    result = np.exp(weights.smoothed - _log_sum(weights.smoothed))
    log_shares = _log_shares(proposals, weights.z)
    belongs = result * np.exp(log_shares - logsumexp(log_shares, 0))
    return [_refitted(one, part, weights.z, len(proposals)) for one, part in zip(proposals, belongs, strict=True)]


def _refitted(
    proposal: ProposalComponent, part: Float[np.ndarray, " n"], z: Float[np.ndarray, "n d"], count: int
) -> ProposalComponent:
    """Return one of some proposals, fitted to its part of the weights, which sum to 1 over all of them."""
    total = float(part.sum())
    if total == 0.0:
        return proposal._replace(share=0.5 / count)
    share = part / total
    centre = share @ z
    spread = z - centre
    trust, doubt = 1.0 / float(share @ share), centre.size + 2.0
    old = proposal.factor @ proposal.factor.T
    factor = np.linalg.cholesky((trust * (spread.T * share) @ spread + doubt * old) / (trust + doubt))
    return ProposalComponent(centre, factor, 0.5 / count + 0.5 * total)


def _complaints(weights: Weights) -> list[str]:
    """Return what is wrong with the weights, in words."""
    said = []
    if not weights.k_hat <= MAX_K_HAT:
        said.append(
            f"the sum depends on a few draws (Pareto k {weights.k_hat:.2f}, at most {MAX_K_HAT}): the posterior is far from normal, "
            "use tempered SMC"
        )
    if weights.ess < MIN_ESS:
        said.append(f"only {weights.ess:.0f} effective draws, at least {MIN_ESS:.0f}: use more draws")
    return said


def _draw(proposal: ProposalComponent, random: np.random.Generator, n: int) -> Float[np.ndarray, "n d"]:
    """Independent draws about one mode."""
    stretch = np.sqrt(FREEDOM / random.chisquare(FREEDOM, n))
    stretch *= np.where(random.uniform(size=n) < WIDE_SHARE, WIDE_SCALE, 1.0)
    return proposal.centre + (stretch[:, None] * random.normal(size=(n, proposal.centre.size))) @ proposal.factor.T


def _log_shares(proposals: Sequence[ProposalComponent], z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "modes n"]:
    """Return the log density of each proposal, times its share."""
    return np.stack([np.log(one.share) + _log_proposal(one, z) for one in proposals])


def _log_proposal(proposal: ProposalComponent, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    d = proposal.centre.size
    square = distance(proposal, z)
    power = 0.5 * (FREEDOM + d)
    plain = np.log(1.0 - WIDE_SHARE) - power * np.log1p(square / FREEDOM)
    wide = np.log(WIDE_SHARE / WIDE_SCALE**d) - power * np.log1p(square / (FREEDOM * WIDE_SCALE**2))
    constant = gammaln(power) - gammaln(0.5 * FREEDOM)
    constant -= 0.5 * d * np.log(FREEDOM * np.pi) + np.sum(np.log(np.diag(proposal.factor)))
    return constant + np.logaddexp(plain, wide)


def _log_sum(x: np.ndarray) -> float:
    return float(logsumexp(x))
