"""A joint posterior of several runs in parts: what each part says of the parameters, and what it says whatever a run's own are.

    log p(z | y) = log p(theta) + sum_r [log p(lambda_r) + l_r(theta, lambda_r)] + constant

theta is shared by all runs; lambda_r, such as `u_0[run]`, `bias_u[run]` or `dev_X_u[run]`, is a run's own. What a run says of theta
alone is its marginal likelihood, for which an estimate without bias will do (Andrieu and Roberts, Annals of Statistics 37, 2009): draws of
lambda_r about the ridge that the curvature at the mode gives,

    L_r(theta) = E_q[exp(l_r + log p(lambda)) / q(lambda)],  without error where l_r is quadratic

Each run has a posterior of its own: all are of one kind, so that one compiled program serves every run.

Of one or two runs each fold is a block of time. Its samples depend on those before and after it, so that the parts are then all
measurements, and all but those of each block.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float, Int

from seatrial.compiled.batching import lanes_at_once, map_lanes
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.mode import Mode, expand_prior
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.slopes import slopes_by_trial
from seatrial.estimation.prediction.prediction import (
    mean_noise_sd,
    of_any_trial,
    outputs_of_draws,
    records_likelihood,
    slow_noise,
    values_of_draws,
)
from seatrial.estimation.prediction.prediction_scores import PredictedRun
from seatrial.estimation.simulation.trial_data import only_measured
from seatrial.sampling.target import AT_ONCE, LANES

MIN_RUNS = 3  # Runs below which what is left after one is taken out says too little: of two, a single other run
BLOCKS = 6  # Of one run, or of two together: enough for a standard error, and each longer than most memories
MIN_CURVATURE = 1e-2  # Least curvature of a run's own parameter that is believed; that of its prior is 1
VARYING_PAIRS = 4  # Pairs of draws about a ridge that bends


class Fold(NamedTuple):
    """What is left out at once: a run, or a block of one.

    Attributes:
        label: of it.
        alone: posterior of its run alone.
        known: places among the shared parameters of those that are the first of `alone`; the others are drawn from their priors.
        inside: which samples of the run belong to it, shape (n,).
    """

    label: str
    alone: Posterior
    known: Int[np.ndarray, " k"]
    inside: Bool[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class RunPosteriors:
    """The parts of a joint posterior, P of them, with k shared parameters and m that each has of its own.

    Attributes:
        joint: posterior of all runs.
        parts: posterior of each part alone, its parameters the shared ones, then its own.
        shared: places of the shared parameters in the joint z.
        own: places of each part's own, shape (P, m).
        folds: what is left out in turn, F of them.
        sums: how often each part counts in the likelihood of all but each fold, and of all, shape (F + 1, P).
    """

    joint: Posterior
    parts: tuple[Posterior, ...]
    shared: Int[np.ndarray, " k"]
    own: Int[np.ndarray, "P m"]
    folds: tuple[Fold, ...]
    sums: Float[np.ndarray, "F1 P"]

    @property
    def is_by_block(self) -> bool:
        """Whether blocks of time are left out instead of runs."""
        return len(self.folds) != len(self.joint.likelihood.labels)


class RunExpansion(NamedTuple):
    """The log-likelihood of each of P parts at one joint z, and the log prior density, with their derivatives along z.

    Attributes:
        z: where, shape (d,).
        value: of each part, shape (P,).
        gradient: of each part, shape (P, d).
        hessian: of each part, shape (P, d, d).
        prior: log prior density of each parameter, shape (d,).
        prior_gradient: of these, each along its own z, shape (d,).
        prior_hessian: likewise, shape (d,).
    """

    z: Float[np.ndarray, " d"]
    value: Float[np.ndarray, " P"]
    gradient: Float[np.ndarray, "P d"]
    hessian: Float[np.ndarray, "P d d"]
    prior: Float[np.ndarray, " d"]
    prior_gradient: Float[np.ndarray, " d"]
    prior_hessian: Float[np.ndarray, " d"]


class Weighted(NamedTuple):
    """Log posterior density at one point where each part counts by a weight, with gradient, shape (d,), and Hessian, shape (d, d)."""

    value: float
    gradient: Float[np.ndarray, " d"]
    hessian: Float[np.ndarray, "d d"]


def split_runs(posterior: Posterior) -> RunPosteriors:
    """Return the parts of a joint posterior of records: its runs, or of fewer than `MIN_RUNS` blocks of time.

    Raises:
        InputError: a posterior of a log density of one's own, which has no runs, or too few measurements for blocks.
    """
    likelihood = records_likelihood(posterior, "compute the log density of each run by your function")
    configurations = likelihood.output.configurations or ("",) * len(likelihood.labels)
    of = [name.partition("[")[2].removesuffix("]") for name in posterior.names]
    shared = np.array([i for i, label in enumerate(of) if not label], int)
    own = np.array([[i for i, other in enumerate(of) if other == label] for label in likelihood.labels], int)
    own = own.reshape(len(likelihood.labels), -1)
    runs = [
        of_any_trial(
            posterior,
            label,
            np.concatenate([shared, own[run]]),
            jax.tree.map(lambda x, run=run: x[run : run + 1], posterior.data),
            configurations[run],
        )
        for run, label in enumerate(likelihood.labels)
    ]
    if len(runs) < MIN_RUNS:
        return _split_blocks(posterior, runs, [np.concatenate([shared, one]) for one in own])
    everything = np.ones(posterior.data.step.shape[1], bool)
    folds = tuple(
        Fold(label, run, np.arange(shared.size), everything) for label, run in zip(likelihood.labels, runs, strict=True)
    )
    sums = np.concatenate([1.0 - np.eye(len(runs)), np.ones((1, len(runs)))])
    return RunPosteriors(posterior, tuple(runs), shared, own, folds, sums)


def _split_blocks(posterior: Posterior, runs: Sequence[Posterior], places: Sequence[np.ndarray]) -> RunPosteriors:
    """Return all measurements, and all but those of each block, as parts; blocks in which nothing was measured are left out."""
    data, folds, kept = posterior.data, [], []
    measured = np.any([np.asarray(one.present) > 0 for one in data.channels], 0)
    for run, (label, alone) in enumerate(zip(posterior.likelihood.labels, runs, strict=True)):
        at = np.flatnonzero(measured[run])
        for number, block in enumerate(np.array_split(at, BLOCKS // len(runs)), 1):
            if block.size:
                inside = np.zeros(measured.shape[1], bool)
                inside[block] = True
                folds.append(Fold(f"{label}, block {number}", alone, places[run], inside))
                kept.append(np.ones(measured.shape, bool))
                kept[-1][run, block] = False
    if len(folds) < MIN_RUNS:
        raise InputError(
            "leave one out",
            found=f"{int(measured.sum())} samples with a measurement",
            expected=f"at least {MIN_RUNS} runs, or as many blocks of measurements",
            remedy="fit more runs, or longer ones",
        )
    parts = tuple(replace(posterior, data=one) for one in only_measured(data, [*kept, np.ones(measured.shape, bool)]))
    own = np.empty((len(parts), 0), int)
    return RunPosteriors(posterior, parts, np.arange(posterior.dim), own, tuple(folds), np.eye(len(parts)))


def expand_runs(runs: RunPosteriors, z: Float[np.ndarray, " d"]) -> RunExpansion:
    """Return what each part says about one joint z, with minus its information for the Hessian.

    Args:
        runs: of `split_runs`.
        z: joint position, shape (d,).
    """
    prior, values, slope, curvature = (np.asarray(one) for one in expand_prior(runs.joint, np.asarray(z)))
    each = [slopes_by_trial(one, values) for one in (runs.parts if runs.is_by_block else [runs.joint])]
    parts = [[np.asarray(array) for array in one] for one in each]
    if runs.is_by_block:
        parts = [[array.sum(0, keepdims=True) for array in one] for one in parts]
    value, along, information = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    hessian = (curvature * along)[:, :, None] * np.eye(z.size) - np.outer(slope, slope) * information
    return RunExpansion(np.asarray(z), value, slope * along, hessian, prior[0], prior[1], prior[2])


def weigh_runs(there: RunExpansion, weight: Float[np.ndarray, " P"]) -> Weighted:
    """Return the log posterior density in which each part counts by its weight: 0 leaves it out."""
    return Weighted(
        float(weight @ there.value + there.prior.sum()),
        weight @ there.gradient + there.prior_gradient,
        np.tensordot(weight, there.hessian, 1) + np.diag(there.prior_hessian),
    )


def marginal_log_likelihoods(
    runs: RunPosteriors,
    mode: Mode,
    there: RunExpansion,
    shared: Float[np.ndarray, "n k"],
    random: np.random.Generator,
) -> Float[np.ndarray, "n P"]:
    """Return what each part says of draws of the shared parameters, its own integrated out; -inf where it diverges.

    A run's own are drawn in pairs on either side of the ridge, so that what is odd about it cancels. Where coefficients vary between runs
    the ridge bends, and as many more are drawn from their prior.

    Args:
        runs: of `split_runs`.
        mode: joint mode, from which the best own parameters are followed along the ridge that it has there.
        there: expansion about it.
        shared: draws, unconstrained, shape (n, k).
        random: source of the draws of a run's own.
    """
    pairs, wide = (VARYING_PAIRS, 2 * VARYING_PAIRS) if runs.joint.likelihood.varying else (1, 0)
    columns, moved, n = [], shared - mode.z[runs.shared], len(shared)
    for r, one in enumerate(runs.parts):
        own = runs.own[r]
        if not own.size:
            columns.append(_at_draws(partial(_own_log_densities, one, 0), shared))
            continue
        values, vectors = np.linalg.eigh(np.diag(-there.prior_hessian[own]) - there.hessian[r][np.ix_(own, own)])
        values = np.maximum(values, MIN_CURVATURE)
        centre = mode.z[own] + moved @ there.hessian[r][np.ix_(runs.shared, own)] @ ((vectors / values) @ vectors.T)
        half = random.standard_normal((pairs, n, own.size)) @ (vectors / np.sqrt(values)).T
        z = np.concatenate([centre + half, centre - half, random.standard_normal((wide, n, own.size))])
        whole = np.concatenate([np.broadcast_to(shared, (len(z), *shared.shape)), z], -1).reshape(len(z) * n, -1)
        density = _at_draws(partial(_own_log_densities, one, own.size), whole).reshape(len(z), n)
        along = (z - centre) @ vectors
        narrow = 0.5 * np.log(values).sum() - 0.5 * (values * along**2).sum(-1) + np.log(2 * pairs)
        broad = -0.5 * (z**2).sum(-1) + (np.log(wide) if wide else -np.inf)
        proposed = np.logaddexp(narrow, broad) - 0.5 * own.size * np.log(2 * np.pi)
        columns.append(scipy.special.logsumexp(np.where(np.isnan(density), -np.inf, density) - proposed, 0))
    table = np.stack(columns, 1)
    return np.where(np.isnan(table), -np.inf, table)


def shared_log_prior(runs: RunPosteriors, shared: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
    """Return the log prior density of draws of the shared parameters, unconstrained."""
    own = np.zeros((len(shared), runs.own.shape[1]))
    priors = _at_draws(partial(_log_priors, runs.parts[0]), np.concatenate([shared, own], 1))
    return priors[:, : runs.shared.size].sum(1)


def predict_fold(
    runs: RunPosteriors, fold: int, shared: Float[np.ndarray, "n k"], key: jax.Array
) -> dict[str, PredictedRun]:
    """Return how one fold is predicted in free simulation of its run from its inputs, each channel by name.

    Args:
        runs: of `split_runs`.
        fold: which one.
        shared: draws of the shared parameters, unconstrained, from what the others say; a run's own that are not shared are drawn from
            their priors.
        key: random key.
    """
    _, one, places, inside = runs.folds[fold]
    n, k = len(shared), places.size
    z = np.concatenate([shared[:, places], np.zeros((n, one.dim - k))], 1)
    table = np.asarray(one.constrain(z))
    known = {parameter.name: table[:, i] for i, parameter in enumerate(one.parameters[:k])}
    values = values_of_draws(one, known, key)
    shown = np.asarray(outputs_of_draws(one.likelihood)(values, one.data, key))
    sensors = one.likelihood.output.simulator.sensors
    step = np.asarray(one.data.step)[0]
    time = np.concatenate([[0.0], np.cumsum(step)[:-1]])
    result = {}
    for i, (sensor, channel) in enumerate(zip(sensors, one.data.channels, strict=True)):
        at = (np.asarray(channel.present)[0] > 0) & inside
        motion = shown[:, at, i]
        columns = (time[at], np.asarray(channel.measured)[0][at], motion.mean(0), motion.std(0))
        noise = mean_noise_sd(sensor, values, motion.T)
        result[sensor.channel] = PredictedRun(*columns, noise, slow_noise(sensor, values))
    return result


def _at_draws(function: Any, z: Float[np.ndarray, "n d"]) -> Any:
    """Return what a function of any number of draws does, so many at once that there are few programs to compile."""
    n = len(z)
    size = max(AT_ONCE, lanes_at_once(function, z, cpu=LANES))
    blocks = np.minimum(np.arange(-(-n // size) * size), n - 1).reshape(-1, size)
    parts = [function(z[block]) for block in blocks]
    return jax.tree.map(lambda *arrays: np.concatenate([np.asarray(one) for one in arrays])[:n], *parts)


@program
def _log_priors(one: Posterior, z: Float[Array, "n d"]) -> Float[Array, "n d"]:
    return jax.vmap(one.log_priors)(z)


@program(static_argnums=1)
def _own_log_densities(one: Posterior, m: int, z: Float[Array, "n d"]) -> Float[Array, " n"]:
    """Log-likelihoods of one part, with the log prior density of its last m parameters."""

    def of_draw(z: Array) -> Array:
        return one.log_likelihood(z) + one.log_priors(z)[one.dim - m :].sum()

    return map_lanes(of_draw, z, LANES)
