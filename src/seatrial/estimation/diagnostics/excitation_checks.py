"""What the input of a record can tell of the coefficients, and which terms are one in it."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.findings import Finding
from seatrial.core.signals import RATES, SPEEDS

MAX_REMAINING = 0.7  # Share of the prior's standard deviation from which a coefficient is not excited
SIGN = 4.0  # Standard deviations of one sample beyond zero from which a signal has changed its sign


def check_excitation(
    names: Sequence[str],
    before: Float[np.ndarray, " k"],
    after: Float[np.ndarray, " k"],
    about: str = "",
    measured: Sequence[str] = RATES,
) -> list[Finding]:
    """Return what the record's input can tell of each coefficient at most, as the share of the prior's deviation that is left.

    Args:
        names: coefficients.
        before: standard deviations of the priors, SI.
        after: of what would be left, SI.
        about: where that was linearised: empty for the prior means, `fit` for a fit of the measured motion.
        measured: channels that have a sensor.
    """
    results = []
    unseen: dict[str, list[str]] = {}
    for name, prior, left in zip(names, before, after, strict=True):
        share = float(left / prior)
        values = {"remaining": share, "about": about}
        if share < MAX_REMAINING:
            results.append(Finding("not-excited", "pass", (name,), values))
        elif (rate := SPEEDS.get(CoefficientName.parse(name).axis)) is not None and rate not in measured:
            unseen.setdefault(rate, []).append(name)
        else:
            results.append(Finding("not-excited", "caution", (name,), values, ("excite-or-fix",)))
    return results + [
        Finding("rate-not-measured", "caution", tuple(some), {"rate": rate}, ("measure-rate",))
        for rate, some in unseen.items()
    ]


def check_signs(
    names: Sequence[str], columns: Mapping[str, Float[np.ndarray, " n"]], noise: Mapping[str, float]
) -> list[Finding]:
    """Return a caution for every two terms that are one in a record, because no signal that separates them changes its sign.

    Args:
        names: coefficients.
        columns: signals of the record by name, SI; of what is in none, nothing is said.
        noise: standard deviation of one sample of those that are measured, SI.
    """
    results = []
    for first, second in combinations(map(CoefficientName.parse, names), 2):
        signals = first.parted_by_sign(second)
        if signals and all(name in columns and _keeps_sign(columns[name], noise.get(name, 0.0)) for name in signals):
            pair = (first.text, second.text)
            values = {"signals": tuple(signals)}
            results.append(Finding("terms-alike", "caution", pair, values, ("drop-or-change-sign",)))
    return results


def _keeps_sign(column: Float[np.ndarray, " n"], noise: float) -> bool:
    """Whether a signal stays on one side of zero, as far as its noise shows."""
    known = column[np.isfinite(column)]
    return bool((known > -SIGN * noise).all() or (known < SIGN * noise).all())
