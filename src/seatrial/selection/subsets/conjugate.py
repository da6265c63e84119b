"""Closed-form posterior and evidence of one structure, the normal-inverse-gamma model (O'Hagan and Forster 2004, chapter 11).

A = G_S + L0_S,  m = A^-1 (h_S + L0_S m_S),  a = a0 + n/2,  2 b = 2 b0 + y^T y + m_S^T L0_S m_S - m^T A m
log p(y | S) = -n/2 log(2 pi) + 1/2 log(|L0_S| / |A|) + a0 log b0 - a log b + log Gamma(a) - log Gamma(a0)
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.special import gammaln

from seatrial.core.errors import NumericalError
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.prior import Prior

ROUNDING = 1e-12
"""Share of y^T y below which what is left over is not known to half its digits."""


class SubsetFit(NamedTuple):
    """Posterior of one structure of p terms.

    Attributes:
        log_evidence: log p(y | S), nats.
        mean: posterior means of its coefficients, shape (p,).
        cov: their covariance, noise variance integrated out, shape (p, p).
        noise_variance: posterior mean of s^2.
    """

    log_evidence: float
    mean: Float[np.ndarray, " p"]
    cov: Float[np.ndarray, "p p"]
    noise_variance: float


def evidence_of(stats: Gram, prior: Prior, terms: Sequence[int]) -> SubsetFit:
    """Posterior and evidence of the structure of the terms numbered `terms`, in that order.

    Raises:
        InputError: prior of the wrong sign or size.
        NumericalError: as `noise_rate`.
    """
    posterior, chosen = prior.posterior(stats), np.asarray(terms, int)
    ratio = posterior.log_ratio[chosen].sum()
    inverse, mean = np.zeros((0, 0)), np.zeros(0)
    explained = 0.0
    if chosen.size:
        factor = cho_factor(posterior.matrix[np.ix_(chosen, chosen)], lower=True)
        inverse, mean = cho_solve(factor, np.eye(chosen.size)), cho_solve(factor, posterior.moment[chosen])
        explained = float(mean @ posterior.moment[chosen])
        ratio -= 2 * np.log(np.diag(factor[0])).sum() * posterior.determinant
    rate = 0.5 * (2 * prior.rate + stats.square + posterior.square[chosen].sum() - explained)
    if not rate > ROUNDING * stats.square:
        raise NumericalError(
            "a structure fits the response to rounding, so that no noise is left to judge by: is the response made from the "
            "regressors? Give measured data, or a prior of the noise that is not tiny"
        )
    shape = prior.shape + 0.5 * stats.n
    log_value = evidence_constant(stats, prior) + 0.5 * ratio - shape * np.log(2 * rate)
    return SubsetFit(float(log_value), mean, rate / (shape - 1) * inverse, rate / (shape - 1))


def evidence_constant(stats: Gram, prior: Prior) -> float:
    """What all structures have in common: log p(y | S) less 1/2 log(|L0|/|A|) and plus a log(2 b)."""
    shape = prior.shape + 0.5 * stats.n
    noise = prior.shape * np.log(prior.rate) + gammaln(shape) - gammaln(prior.shape)
    return float(noise + shape * np.log(2) - 0.5 * stats.n * np.log(2 * np.pi))
