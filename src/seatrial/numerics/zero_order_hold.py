"""Signals that are held from one sample to the next, as commands are."""

import numpy as np
from jaxtyping import Float


def held_mean(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], edges: Float[np.ndarray, " m1"]
) -> Float[np.ndarray, " m"]:
    """Mean of a held signal over each interval between neighbouring edges: exact, and without aliases of what is faster.

    Args:
        time: stamps, strictly increasing, s.
        values: from each stamp to the next; the first also before, the last for ever after.
        edges: increasing, s.
    """
    change = values - values[0]  # so that what never changes comes back as it was
    total = np.concatenate([[0.0], np.cumsum(change[:-1] * np.diff(time))])
    after = change[-1] * np.maximum(edges - time[-1], 0.0)
    return values[0] + np.diff(np.interp(edges, time, total) + after) / np.diff(edges)
