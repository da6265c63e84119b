"""Does a control look measured, or does it jump and stay, as a command that is held?

What is measured moves at nearly every sample, by the noise of its sensor, also if it stays level. What is measured without noise changes
smoothly: both neighbours of a sample then predict it better than the one before. Of jumps the mean of the squared errors of the two
predictions has the ratio 2, and of a ramp over n samples 2 n. A command that jumps between few levels at nearly every sample, as a random
telegraph does, is often at the first or the last of them; noise that is rounded seldom is.
"""

import numpy as np
from jaxtyping import Bool, Float

MIN_SAMPLES = 50  # Samples that tell
# Times by which both neighbours must predict a sample better than the one before (root mean square): a ramp over more
# than 6 samples
MIN_PREDICTION_RATIO = 2.5
# Share of the samples that must differ from the one before: a command that is ramped now and then is held in between
MIN_CHANGING_SHARE = 0.8
# Samples in a stretch, share of them that must differ from the one before, as noise that is rounded may not at each,
# and share of the stretches in which they do: a ramp that is rounded to few steps stays at most samples as it was
WINDOW_SAMPLES, MIN_WINDOW_SHARE, MIN_SHARE_OF_WINDOWS = 20, 0.5, 0.9
# Change of a control from sample to sample, over its standard deviation, below which half a sample of delay moves
# nothing
SLOW_CHANGE = 0.02
# Levels that a command may jump between, and the share of the samples at the least or the greatest from which it is
# one
MAX_LEVELS, MIN_END_SHARE = 8, 0.3
MAX_NEIGHBOUR_STEPS = 5.0  # Median steps beyond which samples are no neighbours


def looks_measured(time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> bool:
    """Return whether a control changes at nearly every sample, smoothly or by noise; False if too few samples tell.

    Args:
        time: of the samples, s, increasing.
        values: of the control in any unit, NaN if there is none.
    """
    known = np.isfinite(values)
    t, x = time[known], values[known]
    jumps = np.unique(x).size <= MAX_LEVELS and np.mean((x == x.min()) | (x == x.max())) >= MIN_END_SHARE
    if t.size < MIN_SAMPLES or jumps:
        return False
    step = np.diff(t)
    near = step <= MAX_NEIGHBOUR_STEPS * np.median(step)
    return _moves_everywhere(np.diff(x)[near]) or _changes_smoothly(step, x, near[:-1] & near[1:])


def taken_as_measured(name: str, function: str) -> str:
    """Report that a control of which nothing is stated is taken as measured, and which argument of a function of Python states it."""
    return (
        f"control {name}: it looks measured, not commanded (it changes at nearly every sample), so it is a line between "
        f'samples. State between={{"{name}": "line"}} in {function}, or between={{"{name}": "held"}} if it is a command'
    )


def half_a_step_matters(values: Float[np.ndarray, " n"]) -> bool:
    """Return whether a control changes so much from sample to sample that half a sample of delay may move a result.

    Args:
        values: of the control in any unit, NaN if there is none.
    """
    known = values[np.isfinite(values)]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers that are none are refused elsewhere
        return bool(known.size > 1 and np.sqrt(np.mean(np.diff(known) ** 2)) > SLOW_CHANGE * np.std(known))


def mean_to_next(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the mean of each sample and the next one that is there: of a straight line, held over that time, it does the same."""
    known, means = np.isfinite(values), values.copy()
    present = values[known]
    means[known] = np.append(0.5 * (present[:-1] + present[1:]), present[-1:])
    return means


def _moves_everywhere(change: Float[np.ndarray, " m"]) -> bool:
    count = change.size // WINDOW_SAMPLES
    stretches = (change[: count * WINDOW_SAMPLES] != 0).reshape(count, WINDOW_SAMPLES)
    return count > 1 and float(np.mean(stretches.mean(axis=1) > MIN_WINDOW_SHARE)) >= MIN_SHARE_OF_WINDOWS


def _changes_smoothly(
    step: Float[np.ndarray, " m"], x: Float[np.ndarray, " n"], inside: Bool[np.ndarray, " k"]
) -> bool:
    change = np.diff(x)[:-1][inside]
    if inside.sum() < MIN_SAMPLES or np.mean(change != 0) < MIN_CHANGING_SHARE:
        return False
    between = x[:-2] + (x[2:] - x[:-2]) * step[:-1] / (step[:-1] + step[1:])
    by_both = np.mean((x[1:-1] - between)[inside] ** 2)
    return bool(np.mean(change**2) > MIN_PREDICTION_RATIO**2 * by_both)
