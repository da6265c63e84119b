"""Conjugate priors of a linear regression, and posterior and evidence of one structure in closed form.

The normal-inverse-gamma model (O'Hagan and Forster 2004, chapter 11): c_S | s^2 ~ N(m_S, s^2 L0_S^-1), s^2 ~ inverse gamma(a0, b0)

A = G_S + L0_S,  m = A^-1 (h_S + L0_S m_S),  a = a0 + n/2,  2 b = 2 b0 + y^T y + m_S^T L0_S m_S - m^T A m
log p(y | S) = -n/2 log(2 pi) + 1/2 log(|L0_S| / |A|) + a0 log b0 - a log b + log Gamma(a) - log Gamma(a0)

Independent coefficients of a physical scale have a diagonal L0. Zellner's g-prior (1986) has L0_S = Phi_S^T Phi_S / g, and
with g = n it carries the information of one measurement (Kass and Wasserman, JASA 90, 1995).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.errors import InputError, NumericalError
from seatrial.selection.subsets.gram import Gram

ROUNDING = 1e-12  # Share of y^T y below which what is left over is not known to half its digits
# Shape of the inverse gamma whose mean exists and whose variance does not: one guess of the noise, held loosely.
NOISE_SHAPE = 2.0


class SubsetFit(NamedTuple):
    """Posterior of one structure of p terms.

    Attributes:
        log_evidence: log p(y | S), nats.
        mean: posterior means of its coefficients, shape (p,).
        cov: their covariance, noise variance integrated out, shape (p, p).
    """

    log_evidence: float
    mean: Float[np.ndarray, " p"]
    cov: Float[np.ndarray, "p p"]


class Precision(NamedTuple):
    """Posterior precision over s^2 and what goes with it, all k terms present; those of a subset are its rows and columns.

    Attributes:
        matrix: A = G + L0, shape (k, k).
        moment: h + L0 m, shape (k,).
        square: added to y^T y by the presence of each term, L0_jj m_j^2, shape (k,).
        log_ratio: log of |L0_S|/|A_S| is the sum of these over S, less log |A_S| if `determinant`, shape (k,).
        determinant: whether log |A_S| counts.
    """

    matrix: Float[np.ndarray, "k k"]
    moment: Float[np.ndarray, " k"]
    square: Float[np.ndarray, " k"]
    log_ratio: Float[np.ndarray, " k"]
    determinant: bool


@dataclass(frozen=True, eq=False)
class IndependentPrior:
    """Independent coefficients.

    Attributes:
        precision: diagonal of L0, shape (k,).
        shape: shape of the noise variance's inverse gamma.
        rate: its rate, squared unit of y.
        mean: prior means of the coefficients where present, shape (k,); zero if not given.
    """

    precision: Float[np.ndarray, " k"]
    shape: float
    rate: float
    mean: Float[np.ndarray, " k"] | None = None

    def scaled(self, factor: float) -> "IndependentPrior":
        """Return the same with the standard deviations of the coefficients times `factor`."""
        return replace(self, precision=np.asarray(self.precision) / factor**2)

    def posterior(self, stats: Gram) -> Precision:
        """Return the posterior precision."""
        precision = np.asarray(self.precision, float)
        mean = np.zeros_like(precision) if self.mean is None else np.asarray(self.mean, float)
        matrix = stats.matrix + np.diag(precision)
        return Precision(
            matrix, stats.moment + precision * mean, precision * mean**2, np.log(precision), determinant=True
        )


@dataclass(frozen=True)
class GPrior:
    """Zellner's g-prior with mean zero.

    Attributes:
        g: prior variance over that of least squares.
        shape: shape of the noise variance's inverse gamma.
        rate: its rate, squared unit of y.
    """

    g: float
    shape: float
    rate: float

    def scaled(self, factor: float) -> "GPrior":
        """Return the same with the standard deviations of the coefficients times `factor`."""
        return replace(self, g=self.g * factor**2)

    def posterior(self, stats: Gram) -> Precision:
        """Return the posterior precision."""
        nothing = np.zeros_like(stats.moment)
        ratio = np.full_like(nothing, -np.log1p(self.g))
        return Precision(stats.matrix * (1 + 1 / self.g), stats.moment, nothing, ratio, determinant=False)


Prior = IndependentPrior | GPrior


def evidence_of(stats: Gram, prior: Prior, terms: Sequence[int]) -> SubsetFit:
    """Return posterior and evidence of the structure of the terms numbered `terms`, in that order.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        terms: numbers of the terms of the structure.

    Raises:
        NumericalError: a structure that leaves no noise.
    """
    posterior, chosen = prior.posterior(stats), np.asarray(terms, int)
    ratio = posterior.log_ratio[chosen].sum()
    inverse, mean = np.zeros((0, 0)), np.zeros(0)
    explained = 0.0
    if chosen.size:
        factor = scipy.linalg.cho_factor(posterior.matrix[np.ix_(chosen, chosen)], lower=True)
        inverse, mean = (
            scipy.linalg.cho_solve(factor, np.eye(chosen.size)),
            scipy.linalg.cho_solve(factor, posterior.moment[chosen]),
        )
        explained = float(mean @ posterior.moment[chosen])
        ratio -= 2 * np.log(np.diag(factor[0])).sum() * posterior.determinant
    rate = 0.5 * (2 * prior.rate + stats.square + posterior.square[chosen].sum() - explained)
    if not rate > ROUNDING * stats.square:
        raise NumericalError(
            "a structure fits the response exactly, so there is no noise: is the response computed from the regressors? Give measured "
            "data, or a prior of larger noise"
        )
    shape = prior.shape + 0.5 * stats.n
    log_value = evidence_constant(stats, prior) + 0.5 * ratio - shape * np.log(2 * rate)
    return SubsetFit(float(log_value), mean, rate / (shape - 1) * inverse)


def evidence_constant(stats: Gram, prior: Prior) -> float:
    """Return what all structures have in common: log p(y | S) less 1/2 log(|L0|/|A|) and plus a log(2 b)."""
    shape = prior.shape + 0.5 * stats.n
    noise = prior.shape * np.log(prior.rate) + scipy.special.gammaln(shape) - scipy.special.gammaln(prior.shape)
    return float(noise + shape * np.log(2) - 0.5 * stats.n * np.log(2 * np.pi))


def physical_prior(
    sd: Float[np.ndarray, " k"],
    noise_sd: float,
    *,
    shape: float = NOISE_SHAPE,
    mean: Float[np.ndarray, " k"] | None = None,
) -> IndependentPrior:
    """Return the prior of independent coefficients of given standard deviations.

    Args:
        sd: prior standard deviations of the coefficients at the expected noise variance, in their units, shape (k,).
        noise_sd: root of the expected noise variance, unit of y.
        shape: shape of the inverse gamma, above 1.
        mean: prior means, zero if not given, shape (k,).

    Raises:
        InputError: a standard deviation that is no positive number.
    """
    sd = np.asarray(sd, float)
    if not ((sd > 0) & np.isfinite(sd)).all():
        raise InputError(
            "prior sd of the coefficients",
            found=str(sd),
            expected="positive numbers",
            remedy="use an order of magnitude from physics",
        )
    return IndependentPrior(noise_sd**2 / sd**2, shape, (shape - 1) * noise_sd**2, mean)


def unit_information(stats: Gram, noise_sd: float, *, shape: float = NOISE_SHAPE) -> GPrior:
    """Return the g-prior of g = n, for noise of an expected variance noise_sd^2.

    Args:
        stats: of the regression; g is its number of measurements.
        noise_sd: root of the expected noise variance, unit of y.
        shape: shape of the inverse gamma, above 1.
    """
    return GPrior(float(stats.n), shape, (shape - 1) * noise_sd**2)
