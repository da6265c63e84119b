"""How often calibration is wrong itself: `python docs/calibration_alarms.py`, about a minute.

Writes the numbers in docs/dev/calibration_alarms.json, and from these the two tables of alarms in docs/dev/calibration.md.
"""

import numpy as np
import study_numbers
from scipy import stats

from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration

COMMAND = "python docs/calibration_alarms.py"
REPLICATES = 400
QUANTITIES = (1, 5, 28, 100)
CAMPAIGNS, WRONG = 1000, 200
"""Campaigns for each number of false alarms, and for each number of wrong posteriors that are found."""
CORRELATIONS = (0.0, 0.5, 0.95)
SPOILT = {
    "1.15 times": (1.15, 0.0),
    "1.2 times": (1.2, 0.0),
    "1.3 times": (1.3, 0.0),
    "0.8 times": (0.8, 0.0),
    "biased by 0.2 of its standard deviations": (1.0, 0.2),
    "biased by 0.3": (1.0, 0.3),
}
"""Errors over what is stated, and bias in stated standard deviations."""


def main() -> None:
    """Find alarms of right campaigns by the correlation of their quantities, then alarms by one wrong quantity, and write both."""
    random = np.random.default_rng(0)
    numbers = {
        "false": {
            f"k = {k}": [false_alarms(random, k, correlation) for correlation in CORRELATIONS] for k in QUANTITIES
        },
        "found": {words: [found(random, k, *wrong) for k in QUANTITIES] for words, wrong in SPOILT.items()},
    }
    study_numbers.keep("calibration_alarms", numbers)
    study_numbers.show("calibration", tables(numbers), COMMAND)


def tables(numbers: dict) -> str:
    """Return the table of false alarms and that of detection."""
    heads = ["quantities", "alarm, independent", *(f"correlated {correlation:g}" for correlation in CORRELATIONS[1:])]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for words, shares in numbers["false"].items():
        lines.append(f"| {words.removeprefix('k = ')} | {' | '.join(f'{100 * share:.1f} %' for share in shares)} |")
    lines += [
        "",
        f"The next table gives the share of alarms if one of k quantities is wrong, with {REPLICATES} replicates. "
        f"Each share comes from {WRONG} simulated campaigns, so its standard error is at most 4 %.",
        "",
        f"| actual errors divided by stated ones | {' | '.join(f'k = {k}' for k in QUANTITIES)} |",
        f"|{'---|' * 5}",
    ]
    lines += [
        f"| {words} | {' | '.join(f'{100 * share:.0f} %' for share in shares)} |"
        for words, shares in numbers["found"].items()
    ]
    return "\n".join([*lines, ""])


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
