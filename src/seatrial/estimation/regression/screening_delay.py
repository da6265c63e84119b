"""Regression rows of a vehicle that answers its commands late: the delay that explains the rows best, and records without it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from seatrial.core.record import Record
from seatrial.estimation.regression.rows import solve
from seatrial.estimation.regression.weak_form import raw_rows, weak_trials
from seatrial.numerics.integrate import held_mean
from seatrial.vehicles.axis_equation import AxisEquation

POINTS = 17  # Delays tried, evenly, before the best is refined


def likely_delay(
    records: Sequence[Record], equations: Sequence[AxisEquation], width: float, lower: float, upper: float
) -> float:
    """Delay of the commands at which least squares with every term leaves the least, s.

    Independent errors of the e equations have the profile likelihood  -1/2 sum_e n_e log RSS_e  of a regression.

    Args:
        records: trials.
        equations: with every candidate term.
        width: of the windows, s.
        lower: least delay, s.
        upper: greatest delay, s.

    Raises:
        InputError: as `weak_trials`.
    """

    def loss(delay: float | np.ndarray) -> float:
        trials = weak_trials([delayed(record, float(delay)) for record in records], equations, width)
        raw, total, start = [raw_rows(equations, trial) for trial in trials], 0.0, 0
        for number, equation in enumerate(equations):
            columns = slice(start, start + len(equation.terms))
            start = columns.stop
            design = np.concatenate([rows.design[number, :, columns] for rows in raw])
            target = np.concatenate([rows.target[number] for rows in raw])
            left = target - design @ solve(design, target)[0]
            total += 0.5 * target.size * float(np.log(left @ left))
        return total

    tried = np.linspace(lower, upper, POINTS)
    best = int(np.argmin([loss(delay) for delay in tried]))
    around = tried[[max(best - 1, 0), min(best + 1, POINTS - 1)]]
    return float(scipy.optimize.fminbound(loss, *around, xtol=1e-3 * (upper - lower)))


def delayed(record: Record, delay: float) -> Record:
    """The record with the controls that act: those of `delay` seconds ago, averaged over each step; the first ones before the start."""
    edges = np.append(record.time, record.time[-1] + record.step[-1])
    acting = [held_mean(record.time, column, edges - delay) for column in record.control.T]
    return replace(record, control=np.column_stack(acting))
