"""Does a control change smoothly from sample to sample, as a measured one does, or does it jump and stay, as a command that is held?

Where a control is held, what lies before a sample predicts it as well as what lies on both sides: it jumps, or it scatters. Of white
noise the mean of the squared errors of the two predictions has the ratio 1.33, of jumps 2, of a random walk 2, and of a ramp over n
samples 2 n.
"""

import numpy as np
from jaxtyping import Float

FEWEST = 50
"""Samples that tell."""
BETTER = 2.5
"""Times by which both neighbours must predict a sample better than the one before (root mean square): a ramp over more than 6 samples."""
NEARLY_ALL = 0.8
"""Share of the samples that must differ from the one before: a command that is ramped now and then is held in between."""
APART = 5.0
"""Median steps beyond which samples are no neighbours."""


def changes_smoothly(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> bool:
    """Return whether a control changes smoothly at nearly every sample; False where too few samples tell.

    Args:
        time: of the samples, s, increasing.
        values: of the control in any unit, NaN where there is none.
    """
    known = np.isfinite(values)
    t, x = time[known], values[known]
    if t.size < FEWEST:
        return False
    step, change = np.diff(t), np.diff(x)
    most = APART * np.median(step)
    inside = (step[:-1] <= most) & (step[1:] <= most)
    if inside.sum() < FEWEST or np.mean(change[:-1][inside] != 0) < NEARLY_ALL:
        return False
    between = x[:-2] + (x[2:] - x[:-2]) * step[:-1] / (step[:-1] + step[1:])
    by_both = np.mean((x[1:-1] - between)[inside] ** 2)
    by_before = np.mean(change[:-1][inside] ** 2)
    return bool(by_before > BETTER**2 * by_both)
