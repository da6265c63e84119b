"""Residuals are judged by the sum of their correlation: a small slow error beside white noise is found, white residuals are not."""

import numpy as np
import pytest

from seatrial.estimation.prediction.fit_verdict import LIKELY, UNDERSTATED, judge_fit
from seatrial.estimation.prediction.prediction_scores import integrated_correlation, score_channel, whiteness
from tests.estimation_cases import slow_noise


def even(seconds, step=0.1):
    return lambda rng: np.arange(0.0, seconds, step)


def with_gaps(rng):
    there = rng.random(600) < 0.5
    there[200:350] = False
    return 0.1 * np.flatnonzero(there)


def at_random(rng):
    return np.cumsum(rng.exponential(0.1, 600))


def in_bursts(rng):
    return np.concatenate([5.0 * burst + 0.05 * np.arange(20) for burst in range(20)])


def is_called_correlated(runs):
    found = integrated_correlation(runs)
    return found.p_value < LIKELY and found.sd_factor > UNDERSTATED


# Times of a run, how many runs, and the share of such records of white 0.1 m/s with a slow 0.03 m/s over 5 s that has to be found.
RECORDS = {
    "300 s": (even(300.0), 1, 0.95),
    "60 s": (even(60.0), 1, 0.6),
    "five of 60 s": (even(60.0), 5, 0.95),
    "20 s": (even(20.0), 1, 0.0),
    "seven of 20 s": (even(20.0), 7, 0.65),
    "forty samples": (even(4.0), 1, 0.0),
    "twelve samples": (even(1.2), 1, 0.0),
    "half missing, and a gap": (with_gaps, 4, 0.5),
    "at random": (at_random, 1, 0.5),
    "bursts": (in_bursts, 1, 0.35),
}


@pytest.mark.parametrize("record", RECORDS)
def test_white_residuals_are_rarely_called_correlated_and_small_slow_errors_often(record):
    """At most 1 % of 400 white records, plus three errors; the power is asked for less three errors of 60 records.

    Measured with 2000 white records (400 of the long ones): 0.0 to 0.5 %; with 400 (80) slow ones: 100, 74, 100, 23, 86, 1, 0, 75, 76
    and 57 %, in the order of the table.
    """
    times, count, power = RECORDS[record]
    rng = np.random.default_rng(43)
    runs = 400 if count == 1 and record != "300 s" else 100
    white = [[(time, rng.normal(size=time.size)) for time in (times(rng) for _ in range(count))] for _ in range(runs)]
    false = np.mean([is_called_correlated(one) for one in white])
    assert false <= 0.01 + 3 * np.sqrt(0.01 / runs)
    both = [
        [
            (time, 0.1 * rng.normal(size=time.size) + 0.03 * slow_noise(rng, time, 5.0))
            for time in (times(rng) for _ in range(count))
        ]
        for _ in range(60)
    ]
    assert np.mean([is_called_correlated(one) for one in both]) >= power - 3 * np.sqrt(power * (1 - power) / 60)


def test_a_small_slow_error_is_a_caution_with_its_factor():
    """Neighbours have r = 0.0826 exp(-0.02) = 0.081; the sum of 0.081 x 0.98^k over all lags makes the factor sqrt(1 + 2 x 4.1) = 3.0."""
    rng, time = np.random.default_rng(2), np.arange(0.0, 600.0, 0.1)
    motion = np.sin(0.4 * time)
    measured = motion + 0.1 * rng.normal(size=time.size) + 0.03 * slow_noise(rng, time, 5.0)
    score = score_channel(time, measured, motion, np.full(time.size, 0.002), float(np.hypot(0.1, 0.03)))
    assert abs(score.correlation) < 0.1
    assert whiteness(time, measured - motion).neighbours == pytest.approx(0.081, abs=0.03)
    found = judge_fit(score, "u", False, "white")
    assert (found.level, found.code) == ("caution", "residuals-correlated")
    assert (found.remedies, found.values["faint"]) == (("drifting-noise",), True)
    assert found.values["factor"] == pytest.approx(3.0, rel=0.3)
    assert judge_fit(score, "u", True, "white").level == "pass"


@pytest.mark.parametrize(("rho", "factor"), [(0.6, 2.0), (0.8, 3.0)])
def test_the_factor_of_an_autoregression(rho, factor):
    """sqrt((1 + rho) / (1 - rho))."""
    time = np.arange(20_000) * 0.05
    values, normal = np.zeros(time.size), np.random.default_rng(5).normal(size=time.size)
    for k in range(1, time.size):
        values[k] = rho * values[k - 1] + normal[k]
    found = integrated_correlation([(time, values)])
    assert found.p_value < 1e-6
    assert found.sd_factor == pytest.approx(factor, rel=0.1)
    assert integrated_correlation([(time[1:], np.diff(normal))]).sd_factor < 0.2


def test_variance_ratios_by_all_pairs():
    """Two runs with gaps: products of every pair of samples, weighed and summed one by one, less what white noise has on average."""
    rng, time = np.random.default_rng(6), [np.array([0, 1, 2, 4, 5, 6, 7, 9, 12, 13.0]), np.arange(14.0)]
    runs = [(t, rng.normal(size=t.size) * (1 + i)) for i, t in enumerate(time)]
    total = sum(np.sum((e - e.mean()) ** 2) for _, e in runs)
    best = []
    for q in (2, 4):
        ratio, whole, variance = 1.0, 1.0, 0.0
        for t, e in runs:
            c, n = e - e.mean(), e.size
            mean = -np.sum(c**2) / (n * (n - 1))
            for i in range(n):
                for j in range(i):
                    if (k := t[i] - t[j]) < q:
                        ratio += 2 * (1 - k / q) * (c[i] * c[j] - mean) / total
                        whole += 2 * (c[i] * c[j] - mean) / total
                        variance += 4 * (1 - k / q) ** 2 * (np.sum(c**2) / n / total) ** 2
        best.append(((ratio - 1) / np.sqrt(variance), np.sqrt(whole)))
    side = np.sign(max(best, key=lambda one: abs(one[0]))[0])
    assert integrated_correlation(runs).sd_factor == pytest.approx(max(best, key=lambda one: side * one[0])[1])
