"""Evidence as the plain average of likelihoods over draws from the prior: Listing 1 of the paper, with what it leaves out.

    Z = mean_i L(z_i),  z_i ~ p(z),  P(M_j) = p_j Z_j / sum_k p_k Z_k.

Unbiased, and useless where few draws come near the posterior: the effective sample size (sum L)^2 / sum L^2 says how many
did, and below 400 of them no verdict is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from zlib import crc32

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp, softmax

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.target import Progress, no_progress
from seatrial.selection.early_stop import log_likelihoods
from seatrial.selection.evidence import Evidence

MIN_ESS = 400.0


@dataclass(frozen=True)
class ListingOne:
    """Models compared as in the paper.

    Attributes:
        evidences: one for each model, all repeats pooled.
        probability: posterior probability of each model in each repeat.
        status: empty where the probabilities may be used, else why no verdict is given.
    """

    evidences: tuple[Evidence, ...]
    probability: Float[np.ndarray, "repeats m"]
    status: str


def prior_evidence(
    posterior: Posterior, key: jax.Array, *, draws: int = 100_000, repeats: int = 1, early_stop: bool = True
) -> Evidence:
    """Evidence of one model; see `listing_one`."""
    return listing_one([posterior], key, draws=draws, repeats=repeats, early_stop=early_stop).evidences[0]


def listing_one(
    posteriors: Sequence[Posterior],
    key: jax.Array,
    *,
    draws: int = 100_000,
    repeats: int = 1,
    shared: bool = False,
    early_stop: bool = True,
    prior_probability: Sequence[float] | None = None,
    progress: Progress = no_progress,
) -> ListingOne:
    """Posterior probabilities of several models from the same data, with their spread over repeats.

    Args:
        posteriors: models.
        key: random key.
        draws: prior draws of each model in each repeat.
        repeats: independent repeats.
        shared: whether parameters of the same name take the same draws in every model, as nodes shared between models do;
            their errors then cancel in part, which flatters the agreement of repeats and mends nothing.
        early_stop: leave draws that cannot matter before their simulation ends, where the likelihood allows it.
        prior_probability: prior probability of each model, up to a factor; equal if not given.
        progress: called with the repeats done and in all.

    Raises:
        InputError: no draws, or prior probabilities that are not one positive number for each model.
        NumericalError: a repeat in which no draw of a model has a finite likelihood.
    """
    weight = np.ones(len(posteriors)) if prior_probability is None else np.asarray(prior_probability, float)
    if weight.shape != (len(posteriors),) or not (weight > 0).all():
        raise InputError(
            "Listing 1, prior_probability",
            found=str(prior_probability),
            expected=f"{len(posteriors)} positive numbers, one for each model",
            remedy="leave it out for equal probabilities",
        )
    if draws < 1 or repeats < 1:
        raise InputError(
            "Listing 1",
            found=f"{draws} draws, {repeats} repeats",
            expected="at least 1 of each",
            remedy="the paper has 100 000 draws and one repeat",
        )
    log_mean, ess = np.empty((repeats, len(posteriors))), np.empty((repeats, len(posteriors)))
    for repeat in range(repeats):
        for j, posterior in enumerate(posteriors):
            stream = jax.random.fold_in(jax.random.fold_in(key, repeat), 0 if shared else j)
            values = draw_by_name(posterior, stream, draws)
            log_mean[repeat, j], ess[repeat, j] = _average(log_likelihoods(posterior, values, early_stop=early_stop))
        progress(repeat + 1, repeats)
    log_odds = log_mean + np.log(weight)
    evidences = tuple(_pool(log_mean[:, j], ess[:, j], draws) for j in range(len(posteriors)))
    return ListingOne(evidences, np.asarray(softmax(log_odds, axis=1)), _refusal(ess, draws))


@partial(jax.jit, static_argnums=2)
def draw_by_name(posterior: Posterior, key: jax.Array, n: int) -> Float[Array, "n d"]:
    """Prior draws of the parameters' values; a parameter's draws depend on the key and its name only, not on the other parameters."""
    return jnp.stack(
        [p.prior.draw(jax.random.fold_in(key, crc32(p.name.encode())), (n,)) for p in posterior.parameters], -1
    )


def _average(log_likelihood: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Log of the mean likelihood, the largest taken out before exponentiating, and the effective sample size."""
    top = log_likelihood.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {log_likelihood.size} draws from the prior has a finite likelihood: under this prior the model diverges. "
            "Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    likelihood = np.exp(log_likelihood - top)
    return float(top + np.log(likelihood.mean())), float(likelihood.sum() ** 2 / (likelihood**2).sum())


def _pool(log_mean: Float[np.ndarray, " repeats"], ess: Float[np.ndarray, " repeats"], draws: int) -> Evidence:
    """Evidence of one model: the mean of its repeats, and the larger of the errors from weights and from spread."""
    repeats = log_mean.size
    within = float(np.sqrt(np.mean(1.0 / ess - 1.0 / draws) / repeats))
    spread = float(log_mean.std(ddof=1)) if repeats > 1 else 0.0
    diagnostics = {"log_values": log_mean.tolist(), "spread": spread, "ess": ess.tolist(), "draws": draws}
    return Evidence(
        float(logsumexp(log_mean) - np.log(repeats)),
        max(within, spread / float(np.sqrt(repeats))),
        "average over the prior (Listing 1)",
        diagnostics,
        _refusal(ess, draws),
    )


def _refusal(ess: Float[np.ndarray, "..."], draws: int) -> str:
    """Why no verdict is given; empty where it may be."""
    if ess.min() >= MIN_ESS:
        return ""
    return (
        f"no verdict: of {draws} prior draws only {ess.min():.1f} count (median over repeats {np.median(ess):.1f}, at least "
        f"{MIN_ESS:.0f} needed); use importance sampling or tempered SMC"
    )
