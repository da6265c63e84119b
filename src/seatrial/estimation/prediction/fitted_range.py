"""Where a run leaves the range of states and inputs that the fitted runs cover: there a model extrapolates."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.core.signals import POSITIONS

MARGIN = 0.1  # Share of the fitted range by which a signal has to leave it; noise alone leaves it by less
OFTEN = 0.01  # Share of a run's samples that have to lie outside; fewer may be outliers
SMALLEST = 1e-9  # Width of the range of what never moved in the fit, SI
ROUNDING = 1e-6  # Share of the furthest value below which the edge of the fitted range is zero but for rounding
MATTERLESS = (*POSITIONS, "psi")  # Signals on which no force depends but through what else is measured


def outside_fitted(fitted: Sequence[Record], record: Record) -> tuple[str, ...]:
    """Say which controls and measurements of a run leave the range of the fitted runs, and how far, the furthest first.

    Args:
        fitted: runs that were fitted.
        record: another run.
    """
    found = []
    for name in (*record.controls, *record.measured):
        known = _samples(fitted, name)
        values = _samples([record], name)
        if name in MATTERLESS or not known.size or not values.size:
            continue
        lower, upper = float(known.min()), float(known.max())
        width = upper - lower if upper > lower else SMALLEST
        margin = MARGIN * width
        for beyond, edge, furthest, word in (
            (values > upper + margin, upper, float(values.max()), "up to"),
            (values < lower - margin, lower, float(values.min()), "down to"),
        ):
            if beyond.mean() >= OFTEN:
                factor, unit = shown_unit(name)
                shown = 0.0 if abs(edge) < ROUNDING * abs(furthest) else edge
                words = f"{name} {word} {furthest * factor:.3g} {unit} where the fit saw {shown * factor:.3g}"
                found.append((abs(furthest - edge) / width, words))
    return tuple(words for _, words in sorted(found, key=lambda one: -one[0]))


def _samples(records: Sequence[Record], name: str) -> Float[np.ndarray, " n"]:
    """All samples of a signal that are there; a roll without its full turns, which no force sees."""
    columns = [record.channel(name) for record in records if name in (*record.controls, *record.measured)]
    values = np.concatenate(columns) if columns else np.empty(0)
    values = values[np.isfinite(values)]
    return np.remainder(values + np.pi, 2 * np.pi) - np.pi if name == "phi" else values
