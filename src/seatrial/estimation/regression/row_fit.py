"""Least squares on whitened rows with every term, and whether its residuals are as independent as the rows claim."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.record import Record
from seatrial.estimation.regression.rows import WhitenedRows, solve, whitened_rows
from seatrial.estimation.regression.weak_form import raw_rows, weak_trials
from seatrial.numerics.integrate import held_mean
from seatrial.vehicles.axis_equation import AxisEquation

# What every result from regression rows has to say.
SCREENING = (
    "a screening in closed form treats noise in the regressors and the weights of the rows approximately. Confirm important terms with "
    "the output-error or filter-error likelihood"
)
MAX_LAGS = 10  # Lags at most that are looked at
RELEVANT = 0.1  # A correlation below this does no harm, however significant


@dataclass(frozen=True, eq=False)
class RowFit:
    """Fit of k coefficients to rows of e equations.

    Attributes:
        names: coefficients.
        values: estimates, SI, shape (k,).
        cov: their covariance, for rows of unit variance, shape (k, k).
        residual: of the whitened rows, shape (n,).
        correlation: of residuals of neighbouring rows, for each equation, shape (e,).
        effective: how many independent rows the n are worth, for each equation, shape (e,).
        status: empty if residuals are independent, else what is wrong in words.
        verdict: what this fit is good for.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    cov: Float[np.ndarray, "k k"]
    residual: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, " e"]
    effective: Float[np.ndarray, " e"]
    status: str
    verdict: str = SCREENING

    @property
    def sd(self) -> Float[np.ndarray, " k"]:
        """Standard errors."""
        return np.sqrt(np.diag(self.cov))


def fit_rows(rows: WhitenedRows) -> RowFit:
    """Fit every term.

    The residuals' correlations over successive windows are judged against what chance gives, 3 over the root of their number;
    n rows are worth n / (1 + 2 sum of correlations), summed up to the first that chance explains.
    """
    values, cov = solve(rows.design, rows.target)
    residual = rows.target - rows.design @ values
    first, worth, messages = [], [], []
    for number, equation in enumerate(rows.equations):
        own = rows.equation == number
        correlations = _correlations(residual[own], rows.trial[own], rows.index[own])
        chance = 3.0 / np.sqrt(own.sum())
        follow = np.abs(correlations) > chance
        memory = correlations[: int(np.argmin(follow)) if not follow.all() else MAX_LAGS].sum()
        first.append(correlations[0])
        worth.append(own.sum() / max(1.0 + 2.0 * memory, 1.0))
        if correlations[0] > max(chance, RELEVANT):
            messages.append(
                f"residuals of axis {equation.axis} are correlated ({correlations[0]:+.2f}): the {own.sum()} rows count as "
                f"{worth[-1]:.0f} independent ones, and errors are up to {np.sqrt(own.sum() / worth[-1]):.1f} times the stated ones. A "
                f"term is missing, or the noise is coloured: choose wider windows"
            )
    return RowFit(rows.names, values, cov, residual, np.array(first), np.array(worth), "; ".join(messages))


def independent_rows(
    equations: Sequence[AxisEquation], records: Sequence[Record], noise: Mapping[str, float], narrowest: float
) -> tuple[WhitenedRows, RowFit]:
    """Return the rows and fit at the first width, of `narrowest` s and its doubles, at which neighbouring residuals no longer correlate.

    The widest that leaves two rows for each term is taken where none does, and the fit's status then says what is wrong.

    Raises:
        InputError: as `weak_trials` and `whitened_rows` at the narrowest width.
    """
    needed = 2 * max(len(equation.terms) for equation in equations)
    width, result = narrowest, None
    while result is None or result[1].status:
        trials = weak_trials(records, equations, width)
        if result is not None and sum(trial.windows.centre.size for trial in trials) < needed:
            break
        rows = whitened_rows(equations, trials, noise)
        result, width = (rows, fit_rows(rows)), 2 * width
        if width > min(record.time[-1] - record.time[0] for record in records):
            break
    return result


def _correlations(residual: np.ndarray, trial: np.ndarray, index: np.ndarray) -> Float[np.ndarray, " lags"]:
    """Return the correlation over 1, 2, … windows of one trial; 0 if no two rows are that far apart."""
    power = np.mean(residual**2)
    place = trial * (index.max() + MAX_LAGS + 1) + index
    results = []
    for lag in range(1, MAX_LAGS + 1):
        earlier = np.isin(place, place - lag)
        later = np.isin(place, place + lag)
        results.append(float(np.sum(residual[earlier] * residual[later]) / power / place.size))
    return np.array(results)


# Regression rows of a vehicle that answers its commands late: the delay that explains the rows best, and records without it.

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
