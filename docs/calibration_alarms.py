"""How often calibration is wrong itself: `python docs/calibration_alarms.py` prints the two tables of docs/dev/calibration.md."""

import numpy as np
from scipy import stats

from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration

REPLICATES = 400
QUANTITIES = (1, 5, 28, 100)
CAMPAIGNS, WRONG = 1000, 200
"""Campaigns for each number of false alarms, and for each number of wrong posteriors that are found."""
SPOILT = ((1.15, 0.0), (1.2, 0.0), (1.3, 0.0), (0.8, 0.0), (1.0, 0.2), (1.0, 0.3))
"""Errors over what is stated, and bias in stated standard deviations."""


def main() -> None:
    """Print alarms of right campaigns by the correlation of their quantities, then alarms by one wrong quantity."""
    random = np.random.default_rng(0)
    for k in QUANTITIES:
        print(k, *(f"{false_alarms(random, k, correlation):.1%}" for correlation in (0.0, 0.5, 0.95)), flush=True)
    for scale, shift in SPOILT:
        print(scale, shift, *(f"{found(random, k, scale, shift):.0%}" for k in QUANTITIES), flush=True)


def false_alarms(random: np.random.Generator, k: int, correlation: float) -> float:
    """Share of right campaigns of k quantities that are called not calibrated."""
    alarms = 0
    for _ in range(CAMPAIGNS):
        common, own = random.normal(size=(REPLICATES, 1)), random.normal(size=(REPLICATES, k))
        alarms += bool(ranked(np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own).outside())
    return alarms / CAMPAIGNS


def found(random: np.random.Generator, k: int, scale: float, shift: float) -> float:
    """Share of campaigns in which one wrong quantity among k is found; the others are left even."""
    even = stats.norm.ppf((np.arange(REPLICATES) % (DRAWS + 1) + 0.5) / (DRAWS + 1))[:, None] * np.ones(k)
    alarms = 0
    for _ in range(WRONG):
        even[:, 0] = shift + scale * random.normal(size=REPLICATES)
        alarms += bool(ranked(even).outside())
    return alarms / WRONG


def ranked(scores: np.ndarray) -> Calibration:
    """Ranks of truths that the posterior sees at these normal scores."""
    ranks = np.minimum((DRAWS + 1) * stats.norm.cdf(scores), DRAWS).astype(int)
    return Calibration(tuple(map(str, range(scores.shape[1]))), ranks)


if __name__ == "__main__":
    main()
