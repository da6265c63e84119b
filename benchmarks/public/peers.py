"""Methods of other packages, used where they are installed: sparse regression by PySINDy, and a subspace model by nfoursid."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy

from benchmarks.public.method import Fitted, Problem, with_spread
from benchmarks.public.tasks import SHORT, Stretch, stretches
from seatrial.core.errors import InputError
from seatrial.core.record import Record

DEGREES, THRESHOLDS = (1, 2, 3), (0.003, 0.03, 0.1)
"""Polynomials, and thresholds on standardised columns, of which the best on stretches of the fitted runs is taken."""
STRETCH = 10.0
"""Length of these stretches, s."""
ORDERS, BLOCK_ROWS = (1, 2, 3, 4, 6), 12
"""Orders of the subspace model, chosen alike, and its block rows."""
MOST_ROWS = 5000
"""Samples of all fitted runs together up to which nfoursid, whose memory grows with their square, is asked."""
LARGEST = 1e3
"""Size of a standardised state beyond which a prediction diverges."""


def fit_sindy(problem: Problem) -> Fitted:
    """Fit a sparse polynomial in channels and controls to their smoothed derivatives.

    Raises:
        InputError: PySINDy is not installed.
    """
    with _peer("pysindy"):
        import pysindy as sindy  # pyright: ignore[reportMissingImports]
    scales = _Scales.of(problem)
    runs = [scales.standard(record) for record in problem.records]
    best: tuple[float, Any] | None = None
    for degree in DEGREES:
        for threshold in THRESHOLDS:
            model = sindy.SINDy(
                optimizer=sindy.STLSQ(threshold=threshold, alpha=1e-6, normalize_columns=False),
                feature_library=sindy.PolynomialLibrary(degree=degree),
                differentiation_method=sindy.SmoothedFiniteDifference(),
            )
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                model.fit([x for _, x, _ in runs], t=[t for t, _, _ in runs], u=[u for _, _, u in runs])
            means = _sindy_means(model, scales)
            best = _better(best, _error(problem, means, scales), (means, degree, threshold, model))
    assert best is not None
    means, degree, threshold, model = best[1]
    count = int(np.count_nonzero(model.coefficients()))
    return with_spread(problem, means, {}, f"degree {degree}, threshold {threshold:g}, {count} terms")


def fit_n4sid(problem: Problem) -> Fitted:
    """Fit a linear state space by the subspace method, with the steady Kalman filter that its residuals give.

    Raises:
        InputError: nfoursid is not installed, or there are too many samples for it.
    """
    with _peer("nfoursid"):
        from nfoursid import nfoursid as module  # pyright: ignore[reportMissingImports]
    import pandas as pd

    scales = _Scales.of(problem)
    runs = [scales.standard(record) for record in problem.records]
    y, u = (np.concatenate([run[i] for run in runs]) for i in (1, 2))
    if len(y) > MOST_ROWS:
        raise InputError(
            "method n4sid",
            found=f"{len(y)} samples to fit",
            expected=f"at most {MOST_ROWS}, for the memory that nfoursid takes grows with their square",
            remedy="give [import] a coarser `step`, or leave the method out by --methods",
        )
    moves = np.ptp(u, 0) > 0
    names = [f"y{i}" for i in range(y.shape[1])], [f"u{i}" for i in range(int(moves.sum()))]
    table = pd.DataFrame(np.column_stack([y, u[:, moves]]), columns=[*names[0], *names[1]])
    fit = module.NFourSID(table, output_columns=names[0], input_columns=names[1], num_block_rows=BLOCK_ROWS)
    fit.subspace_identification()
    best: tuple[float, Any] | None = None
    for order in ORDERS:
        if order < BLOCK_ROWS * y.shape[1]:
            system, covariance = fit.system_identification(rank=order)
            means = _linear_means(system, np.asarray(covariance), moves, scales)
            best = _better(best, _error(problem, means, scales), (means, order))
    assert best is not None
    means, order = best[1]
    return with_spread(problem, means, {}, f"order {order}")


class _Scales:
    """Means and sizes by which channels and controls are standardised."""

    def __init__(self, problem: Problem):
        self.channels, self.controls = problem.channels, problem.controls
        y, u = (
            np.concatenate([_columns(record, names) for record in problem.records])
            for names in (self.channels, self.controls)
        )
        self.y_mean, self.u_mean = y.mean(0), u.mean(0)
        self.y_sd, self.u_sd = (np.where(one.std(0) > 0, one.std(0), 1.0) for one in (y, u))

    @classmethod
    def of(cls, problem: Problem) -> "_Scales":
        """Return those of the fitted runs."""
        return cls(problem)

    def standard(self, record: Record) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time, channels with gaps filled along straight lines, and controls, standardised."""
        y, u = _columns(record, self.channels), _columns(record, self.controls)
        return record.time, (y - self.y_mean) / self.y_sd, (u - self.u_mean) / self.u_sd

    def physical(self, y: np.ndarray) -> np.ndarray:
        """Channels in SI again."""
        return self.y_mean + self.y_sd * y


def _columns(record: Record, names: Sequence[str]) -> np.ndarray:
    """Columns of a record, gaps filled along straight lines, shape (n, k)."""
    filled = []
    for name in names:
        column = record.channel(name)
        there = np.isfinite(column)
        filled.append(column if there.all() else np.interp(record.time, record.time[there], column[there]))
    return np.column_stack(filled)


def _sindy_means(model: Any, scales: _Scales):
    """All stretches side by side, by Runge-Kutta steps under controls that are held from sample to sample."""

    used = np.abs(model.coefficients()).sum(0) > 0
    powers, gains = model.feature_library.powers_[used], model.coefficients()[:, used].T

    def rate(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The polynomial itself: PySINDy's own evaluation takes a thousand times as long."""
        factors = np.power(np.column_stack([np.clip(x, -LARGEST, LARGEST), u])[:, None, :], powers)
        return factors.prod(-1) @ gains

    def means(record: Record, stretches: Sequence[Stretch]) -> np.ndarray:
        _, x, u = scales.standard(record)
        begins, ends = (np.array([stretch[i] for stretch in stretches]) for i in (0, 1))
        state, predicted = x[begins], np.full(x.shape, np.nan)
        for ahead in range(int((ends - begins).max())):
            going = np.flatnonzero(begins + ahead < ends)
            at, y = begins[going] + ahead, state[going]
            h = record.step[at][:, None]
            one = rate(y, u[at])
            two = rate(y + 0.5 * h * one, u[at])
            three = rate(y + 0.5 * h * two, u[at])
            y = y + h / 6 * (one + 2 * two + 2 * three + rate(y + h * three, u[at]))
            state[going] = y
            predicted[at + 1] = np.where(np.abs(y) < LARGEST, y, np.inf)
        return scales.physical(predicted)

    return means


def _linear_means(system: Any, covariance: np.ndarray, moves: np.ndarray, scales: _Scales):
    """The filter runs up to the start of each stretch, and the model from there."""
    a, b, c, d = (np.asarray(getattr(system, name)) for name in "abcd")
    m = len(c)
    r, s, q = covariance[:m, :m], covariance[m:, :m], covariance[m:, m:]
    floor = 1e-9 * np.eye(m)
    try:
        p = scipy.linalg.solve_discrete_are(a.T, c.T, q + 1e-12 * np.eye(len(a)), r + floor, s=s)
        gain = np.linalg.solve(c @ p @ c.T + r + floor, (a @ p @ c.T + s).T).T
    except (np.linalg.LinAlgError, ValueError):
        gain = np.zeros((len(a), m))

    def means(record: Record, stretches: Sequence[Stretch]) -> np.ndarray:
        _, y, u = scales.standard(record)
        u = u[:, moves]
        predicted, x = np.full(y.shape, np.nan), np.linalg.pinv(c) @ (y[0] - d @ u[0])
        at = 0
        for begin, end in sorted(stretches):
            while at <= begin:
                x = a @ x + b @ u[at] + gain @ (y[at] - c @ x - d @ u[at])
                at += 1
            z = x
            for k in range(begin + 1, end + 1):
                predicted[k] = c @ z + d @ u[k]
                z = a @ z + b @ u[k]
        return scales.physical(
            np.where(np.abs(predicted) < LARGEST, predicted, np.where(np.isnan(predicted), np.nan, np.inf))
        )

    return means


def _error(problem: Problem, means: Any, scales: _Scales) -> float:
    """Mean square of what is left of short stretches of the fitted runs, standardised; infinite where something diverges."""
    total, count = 0.0, 0
    for record in problem.records:
        predicted = means(record, stretches(SHORT, record, problem.channels, STRETCH))
        measured = np.column_stack([record.channel(channel) for channel in problem.channels])
        left = ((measured - predicted) / scales.y_sd)[~np.isnan(predicted) & np.isfinite(measured)]
        total, count = total + float(np.sum(left**2)), count + left.size
    return total / count if np.isfinite(total) else np.inf


def _better(best: tuple[float, Any] | None, error: float, candidate: Any) -> tuple[float, Any]:
    return (error, candidate) if best is None or error < best[0] else best


@contextmanager
def _peer(package: str) -> Iterator[None]:
    """Import a peer in the block.

    Raises:
        InputError: it is not installed.
    """
    try:
        yield
    except ImportError as cause:
        raise InputError(
            f"method of {package}",
            found=f"{package} is not installed",
            expected="a package that seatrial does not need and this method does",
            remedy=f"pip install {package}, or leave the method out by --methods",
        ) from cause
