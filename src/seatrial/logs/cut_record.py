"""Long records cut into pieces, each a trial with a start of its own (multiple shooting: Bock 1983)."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import ANGLES

MIN_PIECE_SAMPLES = 10  # Samples in a piece, at least


def cut(record: Record, length: float) -> tuple[Record, ...]:
    """Cut a record into pieces of about equal length, labelled 1.1, 1.2, … of record 1; one not half as long again stays whole.

    Args:
        record: one trial.
        length: of a piece, s.

    Raises:
        InputError: a length that is not positive, or that leaves pieces of a few samples.
    """
    whole = float(record.time[-1])
    count = max(round(whole / length), 1) if length > 0 else 0
    if not 1 <= count <= record.time.size // MIN_PIECE_SAMPLES:
        raise InputError(
            f'record "{record.label}", split',
            found=f"{length:g} s",
            expected=f"more than 0 s, and pieces of at least {MIN_PIECE_SAMPLES} samples of this record of {whole:g} s",
            remedy="give the time over which the vehicle can be simulated, such as 20 s",
        )
    if count == 1:
        return (record,)
    edges = np.searchsorted(record.time, np.linspace(0.0, whole, count + 1)[1:-1] - 1e-9)
    bounds = [0, *edges.tolist(), record.time.size]
    return tuple(_piece(record, number, slice(*bounds[number : number + 2])) for number in range(count))


def _piece(record: Record, number: int, rows: slice) -> Record:
    time, options = record.time[rows], dict(record.provenance.options)
    if number:  # what is said of the whole record is said once
        options["cautions"] = []
    return replace(
        record,
        time=time - time[0],
        control=_near_zero(record.control[rows], record.controls),
        measurement=_near_zero(record.measurement[rows], record.measured),
        provenance=replace(record.provenance, options={**options, "piece": [float(time[0]), float(time[-1])]}),
        label=f"{record.label}.{number + 1}",
    )


def _near_zero(columns: Float[np.ndarray, "n k"], names: tuple[str, ...]) -> Float[np.ndarray, "n k"]:
    """Return the columns in which angles begin within half a turn of zero."""
    turns = np.zeros(len(names))
    for index, name in enumerate(names):
        known = columns[np.isfinite(columns[:, index]), index]
        if name in ANGLES and known.size:
            turns[index] = np.round(known[0] / (2 * np.pi))
    return columns - 2 * np.pi * turns


# Where a run may end.

ROUNDED = 1e-5  # Share of a length by which it may be rounded up where it is printed


def is_beyond(end: float, available: float) -> bool:
    """Return whether an end lies after what the files of a run have in common, not by rounding alone.

    Args:
        end: s from where they overlap.
        available: how long they overlap, s.
    """
    return end > available * (1 + ROUNDED)
