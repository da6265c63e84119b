"""Whether a filter's covariances fit its data, what to change where not, and the measurement noise of raw data.

Where a filter is tuned, innovations e are white, e^T S^-1 e is chi-squared with as many degrees of freedom as channels
(Bar-Shalom, Li and Kirubarajan 2001, section 5.4), and the constants end at a distance d from where they began of which
d^T (P_0 - P_N + N Q)^-1 d is chi-squared.
"""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, chdtri

from seatrial.core.errors import InputError, NumericalError
from seatrial.filters.run import FilterTrace
from seatrial.numerics.state_space import StateSpace

LEVEL = 0.001
"""Probability of each false alarm."""
LAGS = 10
RELEVANT = 0.1
"""A correlation, or a departure of the mean NIS from 1, below this does no harm, however significant."""
ERRATIC = 2.0
SHRINKING, GROWING = 0.75, 1.1
"""A standard deviation that falls as one over the square root of time keeps 0.87 of its value over the last quarter."""


class TuningFinding(NamedTuple):
    """One thing that is wrong: what to change, the direction, and reason and remedy in words."""

    change: Literal["P", "Q", "R", "trial"]
    direction: Literal["up", "down", "longer"]
    words: str


@dataclass(frozen=True, eq=False)
class TuningReport:
    """Checks of a filter's tuning. Innovations are judged over the second half of the record, where P_0 is forgotten.

    Attributes:
        nis: mean of the normalised innovation squared for each measurement, 1 if consistent.
        nis_band: what it may be by chance.
        correlation: correlation of each channel's innovations with the ones before, shape (m,).
        whiteness: p-value of the Ljung-Box test with 10 lags, shape (m,).
        spread: variance of each channel's innovations over its R, at least 1 unless R is too large, shape (m,).
        moved: normalised distance squared that the constants moved, for each of them, 1 if consistent; NaN without any.
        moved_band: what it may be by chance.
        settling: sd of each constant at the end over that at three quarters of the record, shape (c,).
        erratic: total variation of each constant's estimate in the second half, over its net change plus the total variation of a
            random walk that spreads by its sd, which constants without Q stay below (the squares of a belief's steps add up to what its
            variance lost); the square says how often the data were forgotten, shape (c,).
        nees: normalised error squared at the end for each state, NaN where the truth is unknown.
        nees_band: what it may be by chance.
        findings: what to change; empty where the filter is tuned.
    """

    nis: float
    nis_band: tuple[float, float]
    correlation: Float[np.ndarray, " m"]
    whiteness: Float[np.ndarray, " m"]
    spread: Float[np.ndarray, " m"]
    moved: float
    moved_band: tuple[float, float]
    settling: Float[np.ndarray, " c"]
    erratic: Float[np.ndarray, " c"]
    nees: float
    nees_band: tuple[float, float]
    findings: tuple[TuningFinding, ...] = ()


def check_tuning(trace: FilterTrace, space: StateSpace, truth: Float[np.ndarray, " d"] | None = None) -> TuningReport:
    """Check the tuning of a filter by what it left behind.

    Args:
        trace: one run, not batched.
        space: the state space it ran on, with its P_0, Q and R.
        truth: true state at the last sample, where known.

    Raises:
        NumericalError: a trace with failures.
        InputError: fewer than 20 measurements of a channel in the second half.
    """
    if int(trace.failures) > 0:
        raise NumericalError(f"the filter failed at {int(trace.failures)} samples: a void trace cannot be judged")
    n, d = trace.means.shape
    half, final = n // 2, trace.final
    innovations = [column[np.isfinite(column)] for column in np.asarray(trace.innovations)[half:].T]
    fewest = min(column.size for column in innovations)
    if fewest < 2 * LAGS:
        raise InputError(
            "check of the tuning",
            found=f"{fewest} measurements of a channel in the second half of the record",
            expected=f"at least {2 * LAGS}",
            remedy="check a longer record, or leave the channel out",
        )
    count = sum(column.size for column in innovations)
    tests = np.array([_ljung_box(column) for column in innovations])
    estimates, sds = (np.asarray(x)[:, space.n_dynamic :] for x in (trace.means, trace.sds))
    walk = np.sqrt(2 * (n - half) / np.pi) * np.maximum(sds[half], sds[-1])
    travelled = np.abs(np.diff(estimates[half:], axis=0)).sum(0)
    moved, freedom = _moved(trace, space)
    error = None if truth is None else np.linalg.solve(np.asarray(final.chol_cov), np.asarray(truth - final.mean))
    report = TuningReport(
        nis=float(np.nansum(np.asarray(trace.nis)[half:])) / count,
        nis_band=_band(count),
        correlation=tests[:, 0],
        whiteness=tests[:, 1],
        spread=np.array([(e**2).mean() for e in innovations]) / np.asarray(space.measurement_sd) ** 2,
        moved=moved,
        moved_band=_band(freedom),
        settling=sds[-1] / sds[3 * n // 4],
        erratic=travelled / (np.abs(estimates[-1] - estimates[half]) + walk),
        nees=float("nan") if error is None else float(error @ error) / d,
        nees_band=_band(d),
    )
    return replace(report, findings=tuple(_findings(report, space, [column.size for column in innovations])))


def _findings(report: TuningReport, space: StateSpace, counts: list[int]) -> list[TuningFinding]:
    """Return what to change, the most telling check of each matrix first.

    A P that holds the constants fast hides all else, unless innovations are small: then it is noise that moves them.
    """
    constants = space.states[space.n_dynamic :]
    if report.moved > report.moved_band[1] and report.nis > min(report.nis_band[0], 1 - RELEVANT):
        words = (
            f"the constants moved {np.sqrt(report.moved):.0f} times as far from their first values as P_0 allows: raise P_0 of "
            f"{', '.join(constants)}, then check again"
        )
        return [TuningFinding("P", "up", words)]
    said = _innovation_findings(report, space, counts)
    if report.moved < report.moved_band[0]:
        words = (
            f"the constants moved {1 / np.sqrt(max(report.moved, 1e-30)):.3g} times less than P_0 expects, so that the first "
            f"estimates jump about: lower P_0 of {', '.join(constants)}"
        )
        said.append(TuningFinding("P", "down", words))
    noisy_r = any(finding[:2] == ("R", "up") for finding in said)
    for name, erratic, settling in zip(constants, report.erratic, report.settling, strict=True):
        if erratic > ERRATIC and not noisy_r:
            words = f"the estimate of {name} is erratic: it travels {erratic:.1f} times as far as it should; lower Q of {name}"
            said.append(TuningFinding("Q", "down", words))
        if settling > GROWING:
            words = (
                f"the standard deviation of {name} grew by {settling - 1:.0%} over the last quarter: lower Q of {name}"
            )
            said.append(TuningFinding("Q", "down", f"{words}, or end the trial before it goes quiet"))
        if settling < SHRINKING:
            words = f"the standard deviation of {name} still fell by {1 - settling:.0%} over the last quarter"
            said.append(TuningFinding("trial", "longer", f"{words}: it has not settled, run the trial longer"))
    if not said and report.nees > report.nees_band[1]:
        words = f"errors squared are {report.nees:.1f} times what the filter states: raise Q, or look for what the model lacks"
        said.append(TuningFinding("Q", "up", words))
    if not said and report.nees < report.nees_band[0]:
        said.append(
            TuningFinding("Q", "down", f"errors squared are {report.nees:.3g} times what the filter states: lower Q")
        )
    return said


def _innovation_findings(report: TuningReport, space: StateSpace, counts: list[int]) -> list[TuningFinding]:
    significant = np.where(report.whiteness < LEVEL, report.correlation, 0.0)
    worst = int(np.argmax(np.abs(significant)))
    follows = f"innovations of {space.outputs[worst]} are correlated in time ({report.correlation[worst]:+.2f})"
    sluggish, chasing = significant[worst] > RELEVANT, significant[worst] < -RELEVANT
    too_large = (
        f"innovations are smaller than the filter expects (NIS {report.nis:.2g} for each measurement, expected 1)"
    )
    too_small = (
        f"innovations are larger than the filter expects (NIS {report.nis:.3g} for each measurement, expected 1)"
    )
    dynamic = ", ".join(space.states[: space.n_dynamic])

    def sds(channels: list[int]) -> str:
        result = np.sqrt(report.spread) * np.asarray(space.measurement_sd)
        return ", ".join(f"{space.outputs[i]} to a standard deviation of {result[i]:.2g} or less" for i in channels)

    low = [i for i, count in enumerate(counts) if report.spread[i] < min(_band(count)[0], 1 - RELEVANT)]
    if low:
        return [TuningFinding("R", "down", f"{too_large}, and smaller than R alone: lower R of {sds(low)}")]
    if report.nis < min(report.nis_band[0], 1 - RELEVANT):
        chased = f", and {follows}: the filter chases the noise" if chasing else ""
        return [TuningFinding("Q", "down", f"{too_large}, though not smaller than R{chased}: lower Q of {dynamic}")]
    if report.nis > max(report.nis_band[1], 1 + RELEVANT) and not sluggish:
        high = [i for i, spread in enumerate(report.spread) if spread > 1 + RELEVANT]
        chased = f", and {follows}: the filter chases the noise" if chasing else ""
        return [TuningFinding("R", "up", f"{too_small}{chased}: raise R of {sds(high)}")]
    if sluggish:
        return [TuningFinding("Q", "up", f"{follows}: the filter trusts its model too much; raise Q of {dynamic}")]
    if chasing:
        return [TuningFinding("Q", "down", f"{follows}: the filter chases the noise; lower Q of {dynamic}")]
    return []


def _band(freedom: int) -> tuple[float, float]:
    """Return the band of a mean of `freedom` squared standard normals."""
    if freedom == 0:
        return 0.0, float("inf")
    low, high = chdtri(freedom, [1 - LEVEL / 2, LEVEL / 2]) / freedom
    return float(low), float(high)


def _ljung_box(e: np.ndarray) -> tuple[float, float]:
    """Return the correlation with the sample before, and the p-value of whiteness (Ljung and Box, Biometrika 65, 1978)."""
    n, e = e.size, e - e.mean()
    correlation = np.array([e[lag:] @ e[:-lag] for lag in range(1, LAGS + 1)]) / (e @ e)
    statistic = n * (n + 2) * np.sum(correlation**2 / (n - np.arange(1, LAGS + 1)))
    return float(correlation[0]), float(chdtrc(LAGS, statistic))


def _moved(trace: FilterTrace, space: StateSpace) -> tuple[float, int]:
    """Return the normalised distance squared of the constants for each degree of freedom, in the directions the data informed."""
    c = space.n_dynamic
    factor = np.linalg.cholesky(np.asarray(space.initial.cov)[c:, c:])
    gained = np.asarray(space.initial.cov - trace.final.cov)[c:, c:]
    drift = trace.means.shape[0] * np.diag(np.asarray(space.process_sd)[c:] ** 2)
    inverse = np.linalg.inv(factor)
    share, vectors = np.linalg.eigh(inverse @ (gained + drift) @ inverse.T)
    along = vectors.T @ inverse @ np.asarray(trace.final.mean - space.initial.mean)[c:]
    informed = share > 0.01
    freedom = int(informed.sum())
    return (float(np.mean(along[informed] ** 2 / share[informed])) if freedom else float("nan")), freedom
