"""How well cheap utilities agree with an expensive one over the same designs: by rank, and by what choosing with them loses.

Spearman's rank correlation with a bootstrap interval over the designs (Efron and Tibshirani, 1993), the Monte Carlo errors drawn anew
in every resample, and the regret max(expensive) - expensive[argmax(cheap)]. Where no resample has any other order than the designs,
the interval reaches to the correlation of normal variables that would show as much in one sample of forty.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.errors import InputError

MIN_DESIGNS = 5  # Designs below which a rank correlation says nothing
RESAMPLES = 2000
LEVEL = 0.95
EXPECTED = "expected information gain"


@dataclass(frozen=True)
class Agreement:
    """Agreement of a cheap utility with the expensive one.

    Attributes:
        name: of the cheap utility.
        correlation: Spearman's, NaN if one of the two is the same for all designs.
        interval: of the correlation at `LEVEL`.
        chosen: index of the design that the cheap utility chooses.
        best: index of the design that the expensive one chooses.
        regret: loss by the choice, in units of the expensive utility, 0 or more.
        regret_error: Monte Carlo standard error of the regret.
        words: all of it in a sentence.
    """

    name: str
    correlation: float
    interval: tuple[float, float]
    chosen: int
    best: int
    regret: float
    regret_error: float
    words: str


def compare_utilities(
    cheap: Mapping[str, Float[np.ndarray, " D"]],
    expensive: Float[np.ndarray, " D"],
    std_error: Float[np.ndarray, " D"],
) -> tuple[Agreement, ...]:
    """Compare cheap utilities with the expected information gain; higher is better in all.

    Args:
        cheap: each utility by name, one number for each of D designs.
        expensive: the expected information gain, nats.
        std_error: Monte Carlo standard error of each of its values; its error is taken as independent between designs, so that
            common random numbers make the stated error of the regret too large, never too small.

    Raises:
        InputError: fewer than five designs, lengths that differ, or values that are not finite.
    """
    expensive = np.asarray(expensive, float)
    error = np.asarray(std_error, float)
    for label, values in {EXPECTED: expensive, **cheap}.items():
        _check(label, np.asarray(values, float), expensive.size)
    random = np.random.default_rng(0)
    resampled = random.integers(expensive.size, size=(RESAMPLES, expensive.size))
    # The designs' own draws are common to all resamples of a design, so that one design drawn twice stays tied with itself.
    again = (expensive + error * random.normal(size=resampled.shape))[np.arange(RESAMPLES)[:, None], resampled]
    best = int(np.argmax(expensive))
    compared = []
    for label, values in cheap.items():
        values = np.asarray(values, float)
        correlation = float(_spearman(values[None], expensive[None])[0])
        spread = _spearman(values[resampled], again)
        interval = _interval(spread[np.isfinite(spread)], correlation, expensive.size)
        chosen = int(np.argmax(values))
        regret = float(expensive[best] - expensive[chosen])
        doubt = 0.0 if chosen == best else float(np.hypot(error[best], error[chosen]))
        words = f"{label} beside {EXPECTED}: {_of_ranks(correlation, interval)}; {_of_choice(regret, doubt, expensive)}"
        compared.append(Agreement(label, correlation, interval, chosen, best, regret, doubt, words))
    return tuple(compared)


def _spearman(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the correlation of the ranks in every row, ties sharing their mean rank; NaN if a row has no spread."""
    a, b = (scipy.stats.rankdata(values, axis=1) for values in (x, y))
    a, b = a - a.mean(1, keepdims=True), b - b.mean(1, keepdims=True)
    scale = np.sqrt((a * a).sum(1) * (b * b).sum(1))
    return np.divide((a * b).sum(1), scale, out=np.full(len(a), np.nan), where=scale > 0)


def _interval(spread: np.ndarray, correlation: float, designs: int) -> tuple[float, float]:
    if spread.size < RESAMPLES / 2:
        return float("nan"), float("nan")
    low, high = map(float, np.quantile(spread, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]))
    if high - low > 1e-9:
        return min(low, correlation), max(high, correlation)
    least = _least(designs)
    return (least, 1.0) if correlation > 0 else (-1.0, -least)


@lru_cache(maxsize=16)
def _least(designs: int) -> float:
    """Rank correlation of normal variables that still put so many designs into one order with the probability beside `LEVEL`."""
    x, e = np.random.default_rng(0).normal(size=(2, RESAMPLES, designs))

    def beyond(r: float) -> float:
        return float(np.mean(_spearman(x, r * x + np.sqrt(1.0 - r * r) * e) > 1.0 - 1e-9)) - (0.5 - LEVEL / 2)

    r: Any = scipy.optimize.brentq(beyond, -0.99, 1.0 - 1e-9, xtol=1e-4)
    return float(6.0 / np.pi * np.arcsin(r / 2.0))


def _of_ranks(correlation: float, interval: tuple[float, float]) -> str:
    if not np.isfinite(correlation):
        return "no rank correlation, because one of them is the same for all designs"
    return f"rank correlation {correlation:.2f} ({LEVEL:.0%} interval {interval[0]:.2f} to {interval[1]:.2f})"


def _of_choice(regret: float, error: float, expensive: np.ndarray) -> str:
    if regret == 0.0:
        return "it chooses a design that is best"
    span = float(np.ptp(expensive))
    lost = f"{regret:.3g} nat ({regret / span:.1%} of the range over these designs)"
    if regret <= 2.0 * error:
        return f"its choice seems to lose {lost}, within two Monte Carlo standard errors of the difference, {2 * error:.2g} nat"
    return f"its choice loses {lost}" + (f", Monte Carlo error {error:.2g}" if error else "")


def _check(label: str, values: np.ndarray, designs: int) -> None:
    if values.shape != (designs,) or designs < MIN_DESIGNS or not np.isfinite(values).all():
        raise InputError(
            f"agreement of utilities, {label}",
            found=f"shape {values.shape} with {np.sum(~np.isfinite(values))} values that are not finite",
            expected=f"one finite number for each of {max(designs, MIN_DESIGNS)} designs",
            remedy=f"compare over {MIN_DESIGNS} designs or more, and leave out those that break a limit, in all utilities alike",
        )
