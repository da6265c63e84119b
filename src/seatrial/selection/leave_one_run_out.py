"""Leave one run out: how well a model predicts each run from all the others; of one or two runs, each block of time.

    elpd = sum_r log p(y_r | y_-r),   p(y_r | y_-r) = E[L_r(theta)] over p(theta | y_-r)

L_r is the likelihood of run r whatever its own parameters are (`posterior_by_run`): a run that was left out has told nothing of its start,
bias or deviation. All R + 1 posteriors, that of all runs and those that each lack one, are weighted from one set of draws: of a mixture
of their normal approximations, which the derivatives of each run at the joint mode give without another fit (Owen and Zhou, JASA 95,
2000). The tails of the weights are smoothed and judged (Vehtari et al., JMLR 25, 2024); where Pareto k is above 0.7, draws of the moments
that the weighted draws have are added, then draws about the mode of the others, which is followed from that of all.

Runs, or blocks, are the units: the standard error is that of a sum over runs (Vehtari, Gelman and Gabry, Statistics and Computing 27,
2017), and two models are compared run by run. The density of a block is that of all measurements over that of all others.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.mode import ROUGH_GAIN, Mode, find_mode, maximise
from seatrial.estimation.posterior.posterior import Posterior, as_key
from seatrial.estimation.prediction.fit_verdict import judge_runs
from seatrial.estimation.prediction.posterior_by_run import (
    RunExpansion,
    RunPosteriors,
    expand_runs,
    marginal_log_likelihoods,
    predict_fold,
    shared_log_prior,
    split_runs,
    weigh_runs,
)
from seatrial.estimation.prediction.prediction_scores import score_channel
from seatrial.selection.cross_validation import LeaveOneRunOut, LeftOutRun
from seatrial.selection.importance import (
    MAX_K_HAT,
    ProposalComponent,
    Weights,
    draw_mixture,
    log_mixture,
    refit,
    smooth_weights,
)

# Draws of the shared parameters in each round, and most rounds; all that were drawn serve all posteriors.
ROUND_DRAWS, MAX_ROUNDS = 1024, 5
PREDICTION_DRAWS = 200  # Draws by which a run that was left out is predicted
# Newton steps from the mode of all runs to that of all but one: more are only taken about the kinks that a delay
# makes.
MAX_STEPS = 12
FAR = 1.0  # Tail index above which weights have not even a mean
MIN_PRECISION = 1.0  # Least precision of a proposal: that of the prior in the coordinates in which it is drawn


def leave_one_run_out(
    posterior: Posterior,
    *,
    key: jax.Array | int = 0,
    mode: Mode | None = None,
    draws: int = ROUND_DRAWS,
    max_k_hat: float = MAX_K_HAT,
    progress: Progress = no_progress,
) -> LeaveOneRunOut:
    """Predict each run from the others, or each block of time of fewer than three runs.

    Args:
        posterior: of records, of `make_posterior`.
        key: random key, or a seed.
        mode: of the posterior, found here if not given.
        draws: of the shared parameters, in each round.
        max_k_hat: tail index of the weights above which more is drawn, about the mode of the others; -inf always does.
        progress: called with the steps done and all: the mode, the draws, and each run.

    Raises:
        InputError: a posterior of no records, or of too few measurements.
        NumericalError: no mode, or a run that no draw gives a finite density.
    """
    key = as_key(key)
    runs = split_runs(posterior)
    count = len(runs.folds)
    progress(0, count + 2)
    mode = find_mode(posterior, key=jax.random.fold_in(key, 0)) if mode is None else mode
    progress(1, count + 2)
    known, (*without, (_, worst)), refitted = _draw(runs, mode, jax.random.fold_in(key, 1), draws, max_k_hat)
    progress(2, count + 2)
    left_out, predicted, poor = [], [], []
    for r, (fold, (weights, k_hat)) in enumerate(zip(runs.folds, without, strict=True)):
        label = fold.label
        with np.errstate(invalid="ignore"):
            gained = _log_likelihood(known, runs.sums[-1]) - _log_likelihood(known, runs.sums[r])
        joint = weights + np.where(np.isnan(gained), -np.inf, gained)
        elpd = float(scipy.special.logsumexp(joint))
        if not np.isfinite(elpd):
            raise NumericalError(
                f'leave one run out: no draw that the others allow gives "{label}" a finite density: the model diverges there'
            )
        k_hat = max(k_hat, worst)
        error = float(np.linalg.norm(np.exp(joint - elpd) - np.exp(weights)))
        predict_key = jax.random.fold_in(key, 2 + r)
        # Draws as often as their weights say, by systematic resampling.
        edges = np.cumsum(np.exp(weights))
        first = float(jax.random.uniform(predict_key))
        places = np.searchsorted(edges / edges[-1], (first + np.arange(PREDICTION_DRAWS)) / PREDICTION_DRAWS)
        predicted.append(predict_fold(runs, r, known.z[np.minimum(places, len(known.z) - 1)], predict_key))
        scores = {channel: score_channel([one]) for channel, one in predicted[-1].items()}
        left_out.append(LeftOutRun(label, elpd, error, k_hat, r in refitted, scores))
        poor += [f"{label} (k-hat {k_hat:.2f})"] * (not k_hat <= MAX_K_HAT)
        progress(3 + r, count + 2)
    status = f"the score of {', '.join(poor)} depends on a few draws: the posterior is far from normal" if poor else ""
    log_evidence = float(scipy.special.logsumexp(_log_weight(known, runs.sums[-1]))) - float(np.log(len(known.z)))
    bands = {name: judge_runs([one[name] for one in predicted], name) for name in predicted[0]}
    return LeaveOneRunOut(tuple(left_out), bands, log_evidence, status)


class _Drawn(NamedTuple):
    """Draws of the shared parameters, shape (n, k), and what is known at each.

    Attributes:
        z: unconstrained.
        proposals: what they were drawn from, each with its share.
        log_ratio: log prior density of each draw over that of the mixture of all proposals, shape (n,).
        table: what each part says, shape (n, P).
    """

    z: np.ndarray
    proposals: tuple[ProposalComponent, ...]
    log_ratio: np.ndarray
    table: np.ndarray


def _draw(
    runs: RunPosteriors, mode: Mode, key: jax.Array, n: int, max_k_hat: float
) -> tuple[_Drawn, list[tuple[np.ndarray, float]], set[int]]:
    """Return draws that serve all posteriors, their `_weights` for each, and for which folds the mode of the others was found.

    The posteriors are those that each lack one fold, in their order, and then that of all.
    """
    expanded = expand_runs(runs, mode.z)
    latest = [_approximation(runs, expanded, weight) for weight in runs.sums]
    known = _Drawn(np.empty((0, runs.shared.size)), (), np.empty(0), np.empty((0, len(runs.parts))))
    weighed, components, refitted = [], latest, set[int]()
    for again in range(MAX_ROUNDS):
        known = _more(known, runs, mode, expanded, components, jax.random.fold_in(key, again), n)
        weighed = [_weights(known, weight) for weight in runs.sums]
        bad = [t for t, (_, k_hat) in enumerate(weighed) if not k_hat <= max_k_hat]
        if not bad:
            break
        for t in bad:
            # Moments cost draws alone, and do where the draws overlap; else the mode is followed, once.
            far = again > 0 or not weighed[t][1] <= FAR
            follow = far and t < len(runs.folds) and t not in refitted
            latest[t] = _refitted(runs, expanded, t) if follow else _moved(latest[t], known, runs.sums[t])
            refitted.update([t] if follow else [])
        components = [latest[t] for t in bad]
    return known, weighed, refitted


def _more(
    known: _Drawn,
    runs: RunPosteriors,
    mode: Mode,
    expanded: RunExpansion,
    components: Sequence[ProposalComponent],
    key: jax.Array,
    n: int,
) -> _Drawn:
    """Add draws of more proposals; all that were drawn are of the mixture of all proposals (Cornuet et al., Scand. J. Stat. 39, 2012)."""
    total, equal = len(known.z) + n, 1.0 / len(components)
    random = np.random.default_rng(np.asarray(jax.random.key_data(jax.random.fold_in(key, 0))))
    z = draw_mixture([one._replace(share=equal) for one in components], key, n)
    kept = [one._replace(share=one.share * len(known.z) / total) for one in known.proposals]
    new = [one._replace(share=equal * n / total) for one in components]
    proposals, every = (*kept, *new), np.concatenate([known.z, z])
    return _Drawn(
        every,
        proposals,
        shared_log_prior(runs, every) - log_mixture(proposals, every),
        np.concatenate([known.table, marginal_log_likelihoods(runs, mode, expanded, z, random)]),
    )


def _moved(component: ProposalComponent, known: _Drawn, weight: np.ndarray) -> ProposalComponent:
    """Return a proposal with the moments of the draws as weighted for its posterior."""
    weights, k_hat = _weights(known, weight)
    ess = 1.0 / float(np.sum(np.exp(2 * weights)))
    return refit([component._replace(share=1.0)], Weights(known.z, weights, weights, k_hat, ess))[0]


def _log_weight(known: _Drawn, weight: np.ndarray) -> np.ndarray:
    """Log weights of draws for the posterior in which each part counts by its weight, 0 or 1."""
    return known.log_ratio + _log_likelihood(known, weight)


def _log_likelihood(known: _Drawn, weight: np.ndarray) -> np.ndarray:
    return known.table[:, weight > 0].sum(1)


def _weights(known: _Drawn, weight: np.ndarray) -> tuple[Float[np.ndarray, " n"], float]:
    """Return the log weights of draws for the posterior of some runs, smoothed, that sum to 1, and their tail index."""
    log_weight = _log_weight(known, weight)
    if not np.isfinite(log_weight.max()):
        raise NumericalError("leave one run out: no draw about the posterior mode has a finite density")
    return smooth_weights(log_weight)


def _approximation(runs: RunPosteriors, expanded: RunExpansion, weight: np.ndarray) -> ProposalComponent:
    """Return the normal approximation of the shared parameters where each part counts by its weight: one Newton step from a point."""
    known = weigh_runs(expanded, weight)
    values, vectors = np.linalg.eigh(-0.5 * (known.hessian + known.hessian.T))
    cov = (vectors / np.maximum(values, MIN_PRECISION)) @ vectors.T
    centre = (expanded.z + cov @ known.gradient)[runs.shared]
    return ProposalComponent(centre, np.linalg.cholesky(cov[np.ix_(runs.shared, runs.shared)]))


def _refitted(runs: RunPosteriors, expanded: RunExpansion, fold: int) -> ProposalComponent:
    """Return the normal approximation about the mode of the other runs, which is followed from that of all."""
    weight = runs.sums[fold]
    z, _ = maximise(
        lambda z: weigh_runs(expand_runs(runs, z), weight),
        expanded.z,
        lambda z: f"the shared parameters without {runs.folds[fold].label}",
        MAX_STEPS,
        least_gain=ROUGH_GAIN,
    )
    return _approximation(runs, expand_runs(runs, z), weight)
