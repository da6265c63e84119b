"""Scores of one channel of one predicted trial, normal prediction and stated noise given.

How many independent samples they rest on: n' = n_eff / (1 + (n_eff - 1) m), where n_eff counts the residuals' autocorrelation
and m, the share of the predicted variance that is uncertainty of the motion, is common to the whole trial (Kish, Survey
Sampling, 1965, section 5.4).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.estimation.scores import (
    coverage,
    crps_normal,
    effective_samples,
    explained_share,
    nrmse_fit,
    pit_distance,
    pit_shares,
    whiteness,
)

DIVERGES = "the prediction diverges"


@dataclass(frozen=True)
class Score:
    """How one channel of one trial is predicted. Numbers that do not exist are 0, and `missing` says why.

    Attributes:
        samples: measured samples.
        effective: independent ones that they are worth, n'.
        explained: share of the measured variance explained, 1 - SSE / SST; negative is worse than the trial's own mean.
        nrmse: normalised fit, 1 - sqrt(SSE / SST), as MATLAB's `compare` gives it, over 100.
        rmse: root mean square error, in the channel's unit.
        crps: mean continuous ranked probability score, in the channel's unit.
        coverage_50: share of samples inside the 50 % band.
        coverage: share of samples inside the 90 % band.
        variance: mean square of the normalised residuals, 1 where errors are as large as stated.
        pit: histogram of the probability integral transform, shares that would all be 1 / 10.
        pit_distance: its largest distance from uniform.
        correlation: autocorrelation of what should be white, one interval apart.
        interval: median time between measured samples, s.
        white: p-value of the portmanteau test.
        noise_share: share of the measured variance that is noise of the size the fit found; 0 without a variance.
        missing: empty, or why some numbers do not exist.
    """

    samples: int
    effective: float
    explained: float
    nrmse: float
    rmse: float
    crps: float
    coverage_50: float
    coverage: float
    variance: float
    pit: tuple[float, ...]
    pit_distance: float
    correlation: float
    interval: float
    white: float
    noise_share: float
    missing: str = ""


def score_channel(
    time: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, " n"],
    mean: Float[np.ndarray, " n"],
    motion_sd: Float[np.ndarray, " n"],
    noise_sd: float,
    correlation_time: float | None = None,
) -> Score:
    """Score a normal prediction of one channel.

    Args:
        time: s, strictly increasing.
        measured: NaN where nothing was measured.
        mean: predicted.
        motion_sd: standard deviation of the prediction without noise.
        noise_sd: standard deviation of the noise.
        correlation_time: of the noise, s, where it is modelled as coloured; what should be white is then what is new in it.
    """
    present = np.isfinite(measured)
    time, measured, mean, motion_sd = (column[present] for column in (time, measured, mean, motion_sd))
    if not measured.size:
        return unscored(0, "nothing was measured")
    if not np.isfinite(mean).all():
        return unscored(int(measured.size), DIVERGES)
    sd = np.hypot(motion_sd, noise_sd)
    z, explained = (measured - mean) / sd, explained_share(measured, mean)
    independent = effective_samples(time, z)
    test = whiteness(time, z if correlation_time is None else _innovations(time, z, correlation_time))
    still = bool(np.isnan(explained))
    return Score(
        samples=int(measured.size),
        effective=independent / (1 + max(0.0, independent - 1) * float(np.mean((motion_sd / sd) ** 2))),
        explained=0.0 if still else explained,
        nrmse=0.0 if still else nrmse_fit(measured, mean),
        rmse=float(np.sqrt(np.mean((measured - mean) ** 2))),
        crps=float(crps_normal(measured, mean, sd).mean()),
        coverage_50=coverage(z, 0.5),
        coverage=coverage(z, 0.9),
        variance=float(np.mean(z**2)),
        pit=tuple(map(float, pit_shares(z))),
        pit_distance=pit_distance(z),
        correlation=test.neighbours,
        interval=test.interval,
        white=test.p_value,
        noise_share=0.0 if still else float(min(1.0, noise_sd**2 / measured.var())),
        missing="the measurement never changes" if still else "",
    )


def unscored(samples: int, why: str) -> Score:
    """A score without numbers."""
    return Score(samples, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (), 0.0, 0.0, 0.0, 0.0, 0.0, why)


def _innovations(time: np.ndarray, z: np.ndarray, correlation_time: float) -> np.ndarray:
    """What is new in each residual of an Ornstein-Uhlenbeck process given the one before, of unit variance."""
    memory = np.exp(-np.diff(time) / correlation_time)
    return np.concatenate([z[:1], (z[1:] - memory * z[:-1]) / np.sqrt(1 - memory**2)])
