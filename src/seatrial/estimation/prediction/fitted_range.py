"""Where a run leaves the range of states and inputs that the fitted runs cover: there a model extrapolates."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.record import Record
from seatrial.core.signals import POSITIONS

MARGIN = 0.1  # Share of the fitted range by which a signal has to leave it; noise alone leaves it by less
MIN_SHARE = 0.01  # Share of a run's samples that have to lie outside; fewer may be outliers
MIN_WIDTH = 1e-9  # Width of the range of what never moved in the fit, SI
FREE_SIGNALS = (*POSITIONS, "psi")  # Signals on which no force depends but through what else is measured


class Outside(NamedTuple):
    """How far one signal of a run leaves the range of the fitted runs.

    Attributes:
        name: of the signal.
        is_above: whether it goes above the range, and not below it.
        furthest: its value most distant from the range, SI.
        edge: end of the range on that side, SI.
        width: of the range, SI.
    """

    name: str
    is_above: bool
    furthest: float
    edge: float
    width: float


def outside_fitted(fitted: Sequence[Record], record: Record) -> tuple[Outside, ...]:
    """Return which controls and measurements of a run leave the range of the fitted runs, the furthest first.

    Args:
        fitted: runs that were fitted.
        record: another run.
    """
    outside = []
    for name in (*record.controls, *record.measured):
        known = _samples(fitted, name)
        values = _samples([record], name)
        if name in FREE_SIGNALS or not known.size or not values.size:
            continue
        lower, upper = float(known.min()), float(known.max())
        width = upper - lower if upper > lower else MIN_WIDTH
        margin = MARGIN * width
        if (values > upper + margin).mean() >= MIN_SHARE:
            outside.append(Outside(name, True, float(values.max()), upper, width))
        if (values < lower - margin).mean() >= MIN_SHARE:
            outside.append(Outside(name, False, float(values.min()), lower, width))
    return tuple(sorted(outside, key=lambda one: -abs(one.furthest - one.edge) / one.width))


def _samples(records: Sequence[Record], name: str) -> Float[np.ndarray, " n"]:
    """All samples of a signal that are there; a roll without its full turns, which no force sees."""
    columns = [record.channel(name) for record in records if name in (*record.controls, *record.measured)]
    values = np.concatenate(columns) if columns else np.empty(0)
    values = values[np.isfinite(values)]
    return np.remainder(values + np.pi, 2 * np.pi) - np.pi if name == "phi" else values
