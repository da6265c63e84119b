"""Whether a filter's covariances fit its data, what to change where not, and the measurement noise of raw data.

Where a filter is tuned, innovations e are white, e^T S^-1 e is chi-squared with as many degrees of freedom as channels
(Bar-Shalom, Li and Kirubarajan 2001, section 5.4), and the constants end at a distance d from where they began of which
d^T (P_0 - P_N + N Q)^-1 d is chi-squared.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, chdtri

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.findings import Finding, Value
from seatrial.filters.run import FilterTrace
from seatrial.numerics.state_space import StateSpace

LEVEL = 0.001  # Probability of each false alarm
LAGS = 10
RELEVANT = 0.1  # A correlation, or a departure of the mean NIS from 1, below this does no harm, however significant
ERRATIC = 2.0
# A standard deviation that falls as one over the square root of time keeps 0.87 of its value over the last quarter.
SHRINKING_RATIO, GROWING_RATIO = 0.75, 1.1


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
        nees: normalised error squared at the end for each state, NaN if the truth is unknown.
        nees_band: what it may be by chance.
        findings: what to change; empty if the filter is tuned.
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
    findings: tuple[Finding, ...] = ()


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
        raise NumericalError(f"the filter failed at {int(trace.failures)} samples, so its trace cannot be judged")
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


def _findings(report: TuningReport, space: StateSpace, counts: list[int]) -> list[Finding]:
    """Return what to change, the most telling check of each matrix first.

    A P that holds the constants fast hides all else, unless innovations are small: then it is noise that moves them.
    """
    constants = tuple(space.states[space.n_dynamic :])
    if report.moved > report.moved_band[1] and report.nis > min(report.nis_band[0], 1 - RELEVANT):
        return [_finding("p-too-small", "P", "up", constants, ratio=float(np.sqrt(report.moved)))]
    findings = _innovation_findings(report, space, counts)
    if report.moved < report.moved_band[0]:
        ratio = float(1 / np.sqrt(max(report.moved, 1e-30)))
        findings.append(_finding("p-too-large", "P", "down", constants, ratio=ratio))
    noisy_r = any(one.code == "r-too-small" for one in findings)
    for name, erratic, settling in zip(constants, report.erratic, report.settling, strict=True):
        if erratic > ERRATIC and not noisy_r:
            findings.append(_finding("estimate-erratic", "Q", "down", (name,), ratio=float(erratic)))
        if settling > GROWING_RATIO:
            findings.append(_finding("sd-growing", "Q", "down", (name,), change=float(settling - 1)))
        if settling < SHRINKING_RATIO:
            findings.append(_finding("not-settled", "trial", "longer", (name,), change=float(1 - settling)))
    if not findings and report.nees > report.nees_band[1]:
        findings.append(_finding("states-beyond-stated", "Q", "up", (), ratio=report.nees))
    if not findings and report.nees < report.nees_band[0]:
        findings.append(_finding("states-below-stated", "Q", "down", (), ratio=report.nees))
    return findings


def _finding(code: str, what: str, direction: str, subject: tuple[str, ...], **values: Value) -> Finding:
    """Return what to change of P, Q, R or the trial, and in which direction."""
    return Finding(code, "caution", subject, {"what": what, "direction": direction, **values}, (code,))


def _innovation_findings(report: TuningReport, space: StateSpace, counts: list[int]) -> list[Finding]:
    significant = np.where(report.whiteness < LEVEL, report.correlation, 0.0)
    worst = int(np.argmax(np.abs(significant)))
    sluggish, chasing = significant[worst] > RELEVANT, significant[worst] < -RELEVANT
    channel, dynamic = space.outputs[worst], tuple(space.states[: space.n_dynamic])
    values: dict[str, Value] = {"nis": report.nis}
    if chasing:
        values |= {"chased": channel, "correlation": float(report.correlation[worst])}

    def sds(channels: list[int]) -> tuple[float, ...]:
        return tuple(float(x) for x in (np.sqrt(report.spread) * np.asarray(space.measurement_sd))[channels])

    low = [i for i, count in enumerate(counts) if report.spread[i] < min(_band(count)[0], 1 - RELEVANT)]
    if low:
        named = tuple(space.outputs[i] for i in low)
        return [_finding("r-too-large", "R", "down", named, nis=report.nis, sds=sds(low))]
    if report.nis < min(report.nis_band[0], 1 - RELEVANT):
        return [_finding("q-too-large", "Q", "down", dynamic, **values)]
    if report.nis > max(report.nis_band[1], 1 + RELEVANT) and not sluggish:
        high = [i for i, spread in enumerate(report.spread) if spread > 1 + RELEVANT]
        named = tuple(space.outputs[i] for i in high)
        return [_finding("r-too-small", "R", "up", named, **values, sds=sds(high))]
    correlation = float(report.correlation[worst])
    if sluggish:
        return [_finding("innovations-sluggish", "Q", "up", dynamic, channel=channel, correlation=correlation)]
    if chasing:
        return [_finding("innovations-chasing", "Q", "down", dynamic, channel=channel, correlation=correlation)]
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
