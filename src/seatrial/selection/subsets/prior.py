"""Conjugate priors of a linear regression: c_S | s^2 ~ N(m_S, s^2 L0_S^-1), s^2 ~ inverse gamma(shape, rate).

Independent coefficients of a physical scale have a diagonal L0. Zellner's g-prior (1986) has L0_S = Phi_S^T Phi_S / g, and
with g = n it carries the information of one measurement (Kass and Wasserman, JASA 90, 1995).
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.selection.subsets.gram import Gram

SHAPE = 2.0
"""Shape of the inverse gamma whose mean exists and whose variance does not: one guess of the noise, held loosely."""


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
        """The same with the standard deviations of the coefficients times `factor`."""
        return replace(self, precision=np.asarray(self.precision) / factor**2)

    def posterior(self, stats: Gram) -> Precision:
        """Posterior precision.

        Raises:
            InputError: numbers of the wrong sign, or not one for each term.
        """
        precision = np.asarray(self.precision, float)
        mean = np.zeros_like(precision) if self.mean is None else np.asarray(self.mean, float)
        _check_noise(self.shape, self.rate)
        if precision.shape != stats.moment.shape or not ((precision > 0) & np.isfinite(precision)).all():
            raise _bad("precision of the coefficients", precision, f"{stats.moment.size} positive numbers")
        if mean.shape != precision.shape or not np.isfinite(mean).all():
            raise _bad("prior mean of the coefficients", mean, f"{stats.moment.size} numbers")
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
        """The same with the standard deviations of the coefficients times `factor`."""
        return replace(self, g=self.g * factor**2)

    def posterior(self, stats: Gram) -> Precision:
        """Posterior precision.

        Raises:
            InputError: numbers of the wrong sign.
        """
        _check_noise(self.shape, self.rate)
        if not (self.g > 0 and np.isfinite(self.g)):
            raise _bad("g", self.g, "a positive number")
        nothing = np.zeros_like(stats.moment)
        ratio = np.full_like(nothing, -np.log1p(self.g))
        return Precision(stats.matrix * (1 + 1 / self.g), stats.moment, nothing, ratio, determinant=False)


Prior = IndependentPrior | GPrior


def physical_prior(
    sd: Float[np.ndarray, " k"],
    noise_sd: float,
    *,
    shape: float = SHAPE,
    mean: Float[np.ndarray, " k"] | None = None,
) -> IndependentPrior:
    """Independent coefficients of given standard deviations.

    Args:
        sd: prior standard deviations of the coefficients at the expected noise variance, in their units, shape (k,).
        noise_sd: root of the expected noise variance, unit of y.
        shape: shape of the inverse gamma, above 1.
        mean: prior means, zero if not given, shape (k,).

    Raises:
        InputError: numbers of the wrong sign.
    """
    sd = np.asarray(sd, float)
    if not ((sd > 0) & np.isfinite(sd)).all():
        raise _bad("prior sd of the coefficients", sd, "positive numbers")
    if not (shape > 1 and noise_sd > 0):
        raise _bad("prior of the noise", (noise_sd, shape), "a positive noise_sd and a shape above 1")
    return IndependentPrior(noise_sd**2 / sd**2, shape, (shape - 1) * noise_sd**2, mean)


def unit_information(stats: Gram, noise_sd: float, *, shape: float = SHAPE) -> GPrior:
    """The g-prior of g = n, for noise of an expected variance noise_sd^2."""
    return GPrior(float(stats.n), shape, (shape - 1) * noise_sd**2)


def _check_noise(shape: float, rate: float) -> None:
    if not (0 < shape < np.inf and 0 < rate < np.inf):
        raise _bad("prior of the noise", (shape, rate), "a positive shape and rate")


def _bad(what: str, found: object, expected: str) -> InputError:
    return InputError(what, found=str(found), expected=expected, remedy="take the order of magnitude from physics")
