"""Whether a model predicts held-back runs better than the baselines, judged by the CRPS of the same samples.

The difference of the two scores at each sample, d, is averaged over all samples of all runs. How far chance moves that mean follows from
the number of independent values that d is worth in each run, and, of three runs or more, from how the runs differ: the larger counts
(Diebold and Mariano, J. Bus. Econ. Stat. 13, 1995, with the variance by effective samples or by runs).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import stdtr

from seatrial.core.display_units import shown_unit
from seatrial.estimation.prediction.fit_verdict import FitLevel, explained_short
from seatrial.estimation.prediction.prediction_scores import LOG_2PI, crps_normal, diverges, effective_samples

CLEAR = 1.1  # Ratio of the CRPS from which a baseline is clearly better
CHANCE = 0.05  # Probability below which a difference is not put down to chance
MUCH = 0.9  # Share explained from which on tenths of a per cent are said
FAR = 2.0  # Ratio of the CRPS from which one prediction is better by far
FEWEST_RUNS = 3  # Runs from which their own spread says what chance does


class Run(NamedTuple):
    """One channel of one held-back run: time, s, and measurements, NaN where there is none, SI; both of shape (n,)."""

    time: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]


class Predicted(NamedTuple):
    """A normal prediction of each sample of a run: mean and standard deviation, noise included, SI; both of shape (n,)."""

    mean: Float[np.ndarray, " n"]
    sd: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class PooledScore:
    """How one channel of all held-back runs together is predicted.

    Attributes:
        words: what predicts, such as "a linear Nomoto model".
        explained: share of the variance about each run's own mean.
        crps: mean continuous ranked probability score, SI.
        log_score: mean log density of the measurements, one at a time, nats, SI.
        diverges: whether the prediction leaves the finite numbers; the scores are 0 then.
    """

    words: str
    explained: float
    crps: float
    log_score: float
    diverges: bool = False


@dataclass(frozen=True)
class Comparison:
    """A model beside the baselines, of one channel.

    Attributes:
        channel: measured channel.
        ours: scores of the model.
        baselines: scores of the baselines, the best first.
        p_value: probability that chance alone makes the better of the model and the best baseline so much better; where that is the
            baseline, times the number of baselines, of which it is the best (Bonferroni).
        level: pass where the model is best, caution where it is not, fail where a baseline is clearly better, by more than chance.
        sentence: what that means and what to do.
    """

    channel: str
    ours: PooledScore
    baselines: tuple[PooledScore, ...]
    p_value: float
    level: FitLevel
    sentence: str

    def lines(self) -> list[str]:
        """Return a line for the model and each baseline."""
        factor, unit = shown_unit(self.channel)
        said = []
        for score in (self.ours, *self.baselines):
            numbers = (
                "diverges"
                if score.diverges
                else f"{explained_short(score.explained, 2)}, CRPS {score.crps * factor:.3g} {unit}, log score {score.log_score:.2f}"
            )
            said.append(f"{self.channel:<8} {score.words:<36} {numbers}")
        return said


def compare(
    channel: str,
    runs: Sequence[Run],
    ours: Sequence[Predicted],
    baselines: Mapping[str, Sequence[Predicted]],
    same_equations: Collection[str] = (),
) -> Comparison:
    """Compare a model with baselines on one channel of held-back runs.

    Args:
        channel: measured channel.
        runs: held-back runs, of which one at least measures it.
        ours: the model's prediction of each run.
        baselines: those of each baseline, by the words that say what it is; one at least.
        same_equations: the baselines that have the model's own equations, so that they are no simpler.
    """
    own = _pooled("the model", runs, ours)
    scores = [_pooled(words, runs, predicted) for words, predicted in baselines.items()]
    best, *others = sorted(scores, key=lambda one: (one.diverges, one.crps))
    worse = own.diverges if own.diverges or best.diverges else best.crps < own.crps
    p_value = 0.0
    if not (own.diverges or best.diverges):
        theirs = baselines[best.words]
        p_value = min(1.0, len(scores) * _chance(runs, ours, theirs)) if worse else _chance(runs, theirs, ours)
    clear = own.diverges or own.crps > CLEAR * best.crps
    level: FitLevel = "pass" if not worse else "fail" if clear and p_value < CHANCE else "caution"
    simpler = best.words not in same_equations
    by_run = _by_run(runs, ours, baselines[best.words])
    sentence = _said(channel, own, best, p_value, len(scores), by_run, level, simpler)
    return Comparison(channel, own, (best, *others), p_value, level, sentence)


def _pooled(words: str, runs: Sequence[Run], predicted: Sequence[Predicted]) -> PooledScore:
    measured, mean, sd = (np.concatenate(column) for column in zip(*_present(runs, predicted), strict=True))
    if diverges(measured, mean, sd):
        return PooledScore(words, 0.0, 0.0, 0.0, diverges=True)
    total = sum(
        float(np.sum((one.measured - np.nanmean(one.measured)) ** 2, where=np.isfinite(one.measured)))
        for one in _measured(runs)
    )
    z = (measured - mean) / sd
    return PooledScore(
        words,
        1.0 - float(np.sum((measured - mean) ** 2)) / total if total > 0 else 0.0,
        float(np.mean(crps_normal(measured, mean, sd))),
        float(np.mean(-0.5 * z**2 - np.log(sd)) - 0.5 * LOG_2PI),
    )


def _measured(runs: Sequence[Run]) -> list[Run]:
    """Return the runs that measure the channel."""
    return [run for run in runs if np.isfinite(run.measured).any()]


def _present(runs: Sequence[Run], predicted: Sequence[Predicted]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return measurements, means and standard deviations of each run where there is a measurement."""
    found = []
    for run, one in zip(runs, predicted, strict=True):
        there = np.isfinite(run.measured)
        found.append((run.measured[there], one.mean[there], one.sd[there]))
    return found


def _chance(runs: Sequence[Run], first: Sequence[Predicted], second: Sequence[Predicted]) -> float:
    """Return the probability that chance alone makes the CRPS of the first so much larger than that of the second, of one side."""
    differences, worth = [], []
    for run, own, other in zip(runs, _present(runs, first), _present(runs, second), strict=True):
        if own[0].size:
            difference = crps_normal(*own) - crps_normal(*other)
            differences.append(difference)
            worth.append(max(1.0, effective_samples(run.time[np.isfinite(run.measured)], difference)))
    weights = np.array([one.size for one in differences]) / sum(one.size for one in differences)
    means = np.array([one.mean() for one in differences])
    total = float(weights @ means)
    count = len(differences)
    alone = zip(weights, differences, worth, strict=True)
    variance = sum(w**2 * float(one.var()) / max(n - 1.0, 1e-9) for w, one, n in alone)
    freedom = max(1.0, sum(worth) - count)
    if count >= FEWEST_RUNS:
        between = count / (count - 1) * float(np.sum(weights**2 * (means - total) ** 2))
        if between > variance:
            variance, freedom = between, count - 1.0
    return float(stdtr(freedom, -total / np.sqrt(variance))) if variance > 0 else 0.5


def _by_run(runs: Sequence[Run], ours: Sequence[Predicted], theirs: Sequence[Predicted]) -> Float[np.ndarray, "runs 2"]:
    """Return the mean CRPS of the model and of a baseline in each run that measures the channel."""
    pairs = zip(_present(runs, ours), _present(runs, theirs), strict=True)
    return np.array([[crps_normal(*own).mean(), crps_normal(*other).mean()] for own, other in pairs if own[0].size])


def _in_runs(by_run: Float[np.ndarray, "runs 2"]) -> str:
    """Say in how many runs the second of two predictions is better than the first, and whether by far."""
    first, second = by_run[by_run[:, 1] < by_run[:, 0]].sum(axis=0)
    better, count = int(np.sum(by_run[:, 1] < by_run[:, 0])), len(by_run)
    far = ", by far" if first > FAR * second else ""
    if count == 1:
        return f" in the only run{far}"
    worse = f"{',' if far else ''} and worse in {count - better}" if better < count else ""
    return f" in {better} of {count} runs{far}{worse}"


def _said(
    channel: str,
    own: PooledScore,
    best: PooledScore,
    p_value: float,
    count: int,
    by_run: Float[np.ndarray, "runs 2"],
    level: FitLevel,
    simpler: bool,
) -> str:
    """Return what the comparison with the best of so many baselines means; `by_run` has the CRPS of the model and of that one."""
    if own.diverges:
        other = (
            "as every baseline does"
            if best.diverges
            else f"where {best.words} does not ({explained_short(best.explained, 2)})"
        )
        return f"held-back runs: the model's {channel} diverges, {other}: correct the model"
    if best.diverges:
        return f"held-back runs: every baseline diverges in {channel}, and the model does not"
    factor, unit = shown_unit(channel)
    digits = 1 if min(best.explained, own.explained) >= MUCH else 0
    shares = f"{best.explained:.{digits}%} against {own.explained:.{digits}%} of the variance explained"
    if f"{best.explained:.{digits}%}" == f"{own.explained:.{digits}%}":
        shares = f"{own.explained:.{digits}%} of the variance explained by both"
    if min(best.explained, own.explained) < 0:
        shares = " against ".join(explained_short(one.explained, 2) for one in (best, own))
    scores = f"CRPS {best.crps * factor:.3g} against {own.crps * factor:.3g} {unit}"
    if level == "pass":
        chance = f", though chance may do as much (p = {p_value:.2g})" if p_value >= CHANCE else ""
        beaten = f"held-back runs: the model predicts {channel} better than every baseline"
        return f"{beaten}{chance}; the best of them is {best.words} ({shares}, {scores})"
    result = (
        f"held-back runs: {best.words} predicts {channel} better than the model{_in_runs(by_run)} ({shares}, {scores})"
    )
    if level == "caution":
        little = "though by little"
        if p_value >= CHANCE:
            of = f" for the best of {count} baselines" if count > 1 else ""
            number = f" (p = {p_value:.2g}{of})" if p_value < 1 else ""
            little = f"but so few independent samples do not exclude chance{number}"
        if own.crps > CLEAR * best.crps:
            return f"{result}, {little}: hold back more or longer runs, and look at the runs where the model is worse"
        if not simpler:
            return f"{result}, {little}: it predicts as well; it has the same equations, so it is no simpler model"
        return f"{result}, {little}: the model does not beat it; prefer the simpler model, or correct the model"
    if own.explained >= best.explained:
        return f"{result}: the model's motion is no worse, but its bands are too narrow or too wide; change its model of the residuals"
    return f"{result}: prefer it, or correct the model"
