"""Evidence as the plain average of likelihoods over draws from the prior: Listing 1 of the paper, with what it leaves out.

The paper is "Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle".

    Z = mean_i L(z_i),  z_i ~ p(z),  P(M_j) = Z_j / sum_k Z_k.

Unbiased, and useless where few draws come near the posterior: the effective sample size (sum L)^2 / sum L^2 says how many
did, and below 400 of them no verdict is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from zlib import crc32

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp, softmax

from seatrial.compiled.batching import map_lanes
from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_count
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import MIN_ESS
from seatrial.sampling.target import LANES
from seatrial.selection.verdict import Evidence


@program
def log_likelihoods(posterior: Posterior, values: Float[Array, "n d"]) -> Float[Array, " n"]:
    """Return the log-likelihood of each draw of the parameters' values, SI."""

    def of_one(draw: Array) -> Array:
        return posterior.likelihood(dict(zip(posterior.names, draw, strict=True)), posterior.data)

    return map_lanes(of_one, values, LANES)


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


def prior_evidence(posterior: Posterior, key: jax.Array, *, draws: int = 100_000, repeats: int = 1) -> Evidence:
    """Return the evidence of one model; see `listing_one`."""
    return listing_one([posterior], key, draws=draws, repeats=repeats).evidences[0]


def listing_one(
    posteriors: Sequence[Posterior],
    key: jax.Array,
    *,
    draws: int = 100_000,
    repeats: int = 1,
    shared: bool = False,
    progress: Progress = no_progress,
) -> ListingOne:
    """Return the posterior probabilities of several models, equal beforehand, from the same data, with their spread over repeats.

    Args:
        posteriors: models.
        key: random key.
        draws: prior draws of each model in each repeat.
        repeats: independent repeats.
        shared: whether parameters of the same name take the same draws in every model, as nodes shared between models do;
            their errors then cancel in part, which flatters the agreement of repeats and mends nothing.
        progress: called with the repeats done and in all.

    Raises:
        InputError: no draws.
        NumericalError: a repeat in which no draw of a model has a finite likelihood.
    """
    check_count(draws, "Listing 1, draws")
    check_count(repeats, "Listing 1, repeats")
    log_mean, ess = np.empty((repeats, len(posteriors))), np.empty((repeats, len(posteriors)))
    for repeat in range(repeats):
        for j, posterior in enumerate(posteriors):
            stream = jax.random.fold_in(jax.random.fold_in(key, repeat), 0 if shared else j)
            values = draw_by_name(posterior, stream, draws)
            log_mean[repeat, j], ess[repeat, j] = _average(np.asarray(log_likelihoods(posterior, values)))
        progress(repeat + 1, repeats)
    evidences = tuple(_pool(log_mean[:, j], ess[:, j], draws) for j in range(len(posteriors)))
    return ListingOne(evidences, np.asarray(softmax(log_mean, axis=1)), _refusal(ess, draws))


@program(static_argnums=2)
def draw_by_name(posterior: Posterior, key: jax.Array, n: int) -> Float[Array, "n d"]:
    """Prior draws of the parameters' values; a parameter's draws depend on the key and its name only, not on the other parameters.

    Args:
        posterior: whose priors are drawn from.
        key: random key.
        n: number of draws.
    """
    return jnp.stack(
        [p.prior.draw(jax.random.fold_in(key, crc32(p.name.encode())), (n,)) for p in posterior.parameters], -1
    )


def _average(log_likelihood: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the log of the mean likelihood, the largest taken out before exponentiating, and the effective sample size."""
    top = log_likelihood.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {log_likelihood.size} draws from the prior has a finite likelihood: under this prior the model diverges. "
            "Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    likelihood = np.exp(log_likelihood - top)
    return float(top + np.log(likelihood.mean())), float(likelihood.sum() ** 2 / (likelihood**2).sum())


def _pool(log_mean: Float[np.ndarray, " repeats"], ess: Float[np.ndarray, " repeats"], draws: int) -> Evidence:
    """Return the evidence of one model: the mean of its repeats, and the larger of the errors from weights and from spread."""
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
    """Return why no verdict is given; empty where it may be."""
    if ess.min() >= MIN_ESS:
        return ""
    return (
        f"no verdict: of {draws} prior draws only {ess.min():.1f} count (median over repeats {np.median(ess):.1f}, at least "
        f"{MIN_ESS:.0f} needed); use importance sampling or tempered SMC"
    )
