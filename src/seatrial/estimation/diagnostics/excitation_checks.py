"""What the input of a record can tell of the coefficients, and which terms are one in it."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import RATES, SPEEDS
from seatrial.estimation.diagnostics.record_checks import RecordFinding

SIGN = 4.0
"""Standard deviations of one sample beyond zero from which a signal has changed its sign."""


def check_excitation(
    names: Sequence[str],
    before: Float[np.ndarray, " k"],
    after: Float[np.ndarray, " k"],
    about: str = "",
    measured: Sequence[str] = RATES,
) -> list[RecordFinding]:
    """Return what the record's input can tell of each coefficient at most, as the share of the prior's deviation that is left.

    Args:
        names: coefficients.
        before: standard deviations of the priors, SI.
        after: of what would be left, SI.
        about: where that was linearised, in words; empty for the prior means.
        measured: channels that have a sensor.
    """
    results = []
    unseen: dict[str, list[str]] = {}
    check = f"excitation ({about})" if about else "excitation"
    for name, prior, left in zip(names, before, after, strict=True):
        share = float(left / prior)
        value, limit = f"{share:.0%} of the prior's sd would be left", "below 70 % it is excited"
        if share < 0.7:
            results.append(RecordFinding(name, check, "pass", value, limit))
        elif (rate := SPEEDS.get(CoefficientName.parse(name).axis)) is not None and rate not in measured:
            unseen.setdefault(rate, []).append(name)
        else:
            remedy = "this record cannot determine it: excite it more, fix it, or design a trial (`seatrial design`)"
            results.append(RecordFinding(name, check, "caution", value, limit, remedy))
    return results + [
        RecordFinding(
            ", ".join(some),
            check,
            "caution",
            f"this record cannot determine them: no sensor measures {rate}, in which they show",
            f"{rate} is used if it has a sensor",
            f"add [sensors.{rate}] with its noise, and map its column; or take them out of the model",
        )
        for rate, some in unseen.items()
    ]


def check_signs(
    names: Sequence[str], columns: Mapping[str, Float[np.ndarray, " n"]], noise: Mapping[str, float]
) -> list[RecordFinding]:
    """Return a caution for every two terms that are one in a record, because no signal that tells them apart changes its sign.

    Args:
        names: coefficients.
        columns: signals of the record by name, SI; of what is in none, nothing is said.
        noise: standard deviation of one sample of those that are measured, SI.
    """
    results = []
    for first, second in combinations(map(CoefficientName.parse, names), 2):
        signals = first.parted_by_sign(second)
        if signals and all(name in columns and _keeps_sign(columns[name], noise.get(name, 0.0)) for name in signals):
            value = f"one and the same in this record, in which {' and '.join(signals)} never changes its sign"
            remedy = "leave one of them out, or run a trial in which it does"
            pair = f"{first.text}, {second.text}"
            results.append(RecordFinding(pair, "told apart", "caution", value, "only that tells them apart", remedy))
    return results


def _keeps_sign(column: Float[np.ndarray, " n"], noise: float) -> bool:
    """Whether a signal stays on one side of zero, as far as its noise shows."""
    known = column[np.isfinite(column)]
    return bool((known > -SIGN * noise).all() or (known < SIGN * noise).all())
