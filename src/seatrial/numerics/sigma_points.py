"""The scaled unscented transform: sigma points of a Gaussian and their weights (Julier 2002; Wan and van der Merwe 2000)."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from seatrial.numerics.triangular import Scalar, Triangle, Vector, plus, times


@dataclass(frozen=True)
class UnscentedRule:
    """Spread and weights of the 2n + 1 sigma points.

    Attributes:
        alpha: spread about the mean.
        beta: knowledge of the distribution; 2 is best for a Gaussian.
        kappa: secondary spread.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def spread(self, n: int) -> float:
        """Return the distance of the points in standard deviations, sqrt(n + lambda) = alpha sqrt(n + kappa)."""
        return self.alpha * sqrt(n + self.kappa)

    def weights(self, n: int) -> tuple[float, float, float]:
        """Return the weight of the centre in means, of the centre in covariances, and of every other point."""
        scaled = self.alpha**2 * (n + self.kappa)
        centre = 1.0 - n / scaled
        return centre, centre + 1.0 - self.alpha**2 + self.beta, 0.5 / scaled


def sigma_pairs(mean: Sequence[Scalar], chol_cov: Triangle, spread: float) -> tuple[list[Vector], list[Vector]]:
    """Return the points on the positive and on the negative side of the mean, one pair for each column of the factor.

    Args:
        mean: of the state, a tuple of n scalars.
        chol_cov: lower factor of its covariance, rows of scalars.
        spread: distance of the points, in standard deviations.
    """
    n = len(mean)
    columns = [[chol_cov[i][j] if j <= i else 0.0 for i in range(n)] for j in range(n)]
    above = [tuple(plus(m, times(spread, c)) for m, c in zip(mean, column, strict=True)) for column in columns]
    below = [tuple(plus(m, times(-spread, c)) for m, c in zip(mean, column, strict=True)) for column in columns]
    return above, below
