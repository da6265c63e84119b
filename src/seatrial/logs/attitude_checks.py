"""Doubts about an attitude: a heading that turns otherwise than the yaw rate says, or too far from sample to sample."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seatrial.logs.source import LogTable

_MUCH = np.radians(15.0)
"""Change of an angle from sample to sample from which it is too slow to turn velocities by."""
_ALIKE = 1.5
"""Ratio of the heading's turns to those of the yaw rate from which one of them is doubted, or its inverse."""
_TURNED = np.radians(20.0)
"""Turn from which they are compared."""
_FEWEST = 10


def with_doubts(table: LogTable, tables: Sequence[LogTable]) -> LogTable:
    """The log with a caution where its heading turns otherwise than the yaw rate of the same run.

    Args:
        table: a log.
        tables: all of its run.
    """
    rates = next((one for one in tables if "r" in one.columns), None)
    if "psi" not in table.columns or rates is None:
        return table
    there, known = np.isfinite(table.columns["psi"]), np.isfinite(rates.columns["r"])
    psi, at = np.unwrap(table.columns["psi"][there]), table.time[there]
    clock = rates.time[known] + float(rates.epoch - table.epoch)
    inside = (at >= clock[:1].sum()) & (at <= clock[-1:].sum())
    if inside.sum() < _FEWEST:
        return table
    turned = np.concatenate([[0.0], np.cumsum(np.diff(clock) * rates.columns["r"][known][:-1])])
    foretold, found = np.diff(np.interp(at[inside], clock, turned)), np.diff(psi[inside])
    if np.ptp(np.cumsum(foretold)) < _TURNED:
        return table
    ratio = float(found @ foretold / (foretold @ foretold))
    if 1 / _ALIKE < ratio < _ALIKE:
        return table
    caution = (
        f'channel "psi" of {table.source}: it turns {ratio:.3g} times as fast as r of {rates.source} says: check its unit, its sign and '
        "`axes`, the order of a quaternion, and the clocks"
    )
    return replace(table, cautions=(*table.cautions, caution))


def doubts_of_speed(source: LogTable, angle: str) -> list[str]:
    """Say where an angle changes much from one of its samples to the next, so that what lies between is doubtful."""
    change = np.abs(np.diff(np.unwrap(source.columns[angle][np.isfinite(source.columns[angle])])))
    most = float(np.quantile(change, 0.99)) if change.size else 0.0
    if most < _MUCH:
        return []
    return [
        f'channel "{angle}" of {source.source}: it changes by {np.degrees(most):.0f} deg from one sample to the next, and velocities over '
        "the earth are turned by what lies between: use a faster log of the attitude"
    ]
