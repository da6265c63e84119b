"""The normal distribution of one variable, for those who draw stored results: nothing heavy is imported."""

from math import pi, sqrt

import numpy as np
from jaxtyping import Float

Z90 = 1.6448536269514722  # Standard deviations from the mean of a normal distribution to the ends of its 90 % interval
Z95 = 1.959963984540054  # Likewise of its 95 % interval


def normal_density(x: Float[np.ndarray, " n"], mean: float, sd: float) -> Float[np.ndarray, " n"]:
    """Return the density of a normal distribution.

    Args:
        x: where, shape (n,).
        mean: of the distribution.
        sd: its standard deviation.
    """
    return np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * sqrt(2 * pi))
