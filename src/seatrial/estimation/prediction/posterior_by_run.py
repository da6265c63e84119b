"""A joint posterior of several runs, run by run: what each run says of the parameters, and what it says whatever its own are.

    log p(z | y) = log p(theta) + sum_r [log p(lambda_r) + l_r(theta, lambda_r)] + constant

theta is shared by all runs; lambda_r, such as `u_0[run]`, `bias_u[run]` or `dev_X_u[run]`, is a run's own. What a run says of theta
alone is its marginal likelihood, by Laplace's approximation about the best lambda_r at that theta:

    L_r(theta) = int exp(l_r + log p(lambda)) d lambda,  exact where l_r is quadratic in lambda

Each run has a posterior of its own: all are of one kind, so that one compiled program serves every run, and its derivatives are along
the parameters that it knows of and not along those of the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from seatrial.compiled.batching import lanes_at_once, map_lanes
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.mode import Mode, expand_prior
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior, check_posterior
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.prediction.pooled_coverage import RunResiduals, run_residuals
from seatrial.estimation.prediction.prediction import (
    noise_sd,
    of_any_trial,
    outputs_of_draws,
    slow_noise,
    values_of_draws,
)
from seatrial.estimation.prediction.prediction_scores import Score, score_channel
from seatrial.sampling.target import AT_ONCE, LANES

MIN_CURVATURE = 1e-2  # Least curvature of a run's own parameter that is believed; that of its prior is 1
# Largest gain, nats, that is believed of an expansion away from the best: far from it curvature says nothing of the
# height there.
MAX_BELIEVED_GAIN = 0.5
# Gain of a Newton step along a run's own parameters, nats, from which another is made, and how many at most.
MIN_STEP_GAIN, MAX_STEPS = 1e-3, 12


@dataclass(frozen=True, eq=False)
class RunPosteriors:
    """The parts of a joint posterior of R runs, with k shared parameters and m that each run has of its own.

    Attributes:
        joint: posterior of all runs.
        runs: posterior of each run alone, its parameters the shared ones, then its own.
        shared: places of the shared parameters in the joint z.
        own: places of each run's own, shape (R, m).
    """

    joint: Posterior
    runs: tuple[Posterior, ...]
    shared: Int[np.ndarray, " k"]
    own: Int[np.ndarray, "R m"]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the runs."""
        return self.joint.likelihood.labels

    def places(self, run: int) -> Int[np.ndarray, " km"]:
        """Places in the joint z of the parameters of one run."""
        return np.concatenate([self.shared, self.own[run]])


class RunExpansion(NamedTuple):
    """The log-likelihood of each of R runs at one joint z, and the log prior density, with their derivatives along z.

    Attributes:
        z: where, shape (d,).
        value: of each run, shape (R,).
        gradient: of each run, shape (R, d).
        hessian: of each run, shape (R, d, d).
        prior: log prior density of each parameter, shape (d,).
        prior_gradient: of these, each along its own z, shape (d,).
        prior_hessian: likewise, shape (d,).
        slope: derivative of each value along its own z, in its own unit, shape (d,).
        bend: its second derivative over the first, shape (d,).
    """

    z: Float[np.ndarray, " d"]
    value: Float[np.ndarray, " R"]
    gradient: Float[np.ndarray, "R d"]
    hessian: Float[np.ndarray, "R d d"]
    prior: Float[np.ndarray, " d"]
    prior_gradient: Float[np.ndarray, " d"]
    prior_hessian: Float[np.ndarray, " d"]
    slope: Float[np.ndarray, " d"]
    bend: Float[np.ndarray, " d"]

    @property
    def along_values(self) -> Float[np.ndarray, "R d d"]:
        """Hessians along values that grow by `slope` for each unit of z: without what is due to the bend of the map alone."""
        return self.hessian - np.stack([np.diag(self.bend * one) for one in self.gradient])


class Weighted(NamedTuple):
    """Log posterior density at one point where each run counts by a weight, with gradient, shape (d,), and Hessian, shape (d, d)."""

    value: float
    gradient: Float[np.ndarray, " d"]
    hessian: Float[np.ndarray, "d d"]


def split_runs(posterior: Posterior) -> RunPosteriors:
    """Return the posterior of each run of a joint posterior of records.

    Raises:
        InputError: a posterior of a log density of one's own, which has no runs.
    """
    check_posterior(posterior)
    likelihood = posterior.likelihood
    if not isinstance(likelihood, OutputError | FilterError):
        raise InputError(
            "posterior",
            found="a log density of one's own",
            expected="a posterior of records, of `make_posterior`",
            remedy="sum the log densities of the runs one by one yourself",
        )
    of = [name.partition("[")[2].removesuffix("]") for name in posterior.names]
    shared = np.array([i for i, label in enumerate(of) if not label], int)
    own = np.array([[i for i, other in enumerate(of) if other == label] for label in likelihood.labels], int)
    runs = tuple(
        of_any_trial(
            posterior,
            label,
            np.concatenate([shared, own[run]]).astype(int),
            jax.tree.map(lambda x, run=run: x[run : run + 1], posterior.data),
        )
        for run, label in enumerate(likelihood.labels)
    )
    return RunPosteriors(posterior, runs, shared, own.reshape(len(runs), -1))


def expand_runs(runs: RunPosteriors, z: Float[np.ndarray, " d"], weight: Sequence[float] | None = None) -> RunExpansion:
    """Return what each run says about one joint z, with minus its information for the Hessian, along its own parameters only.

    Args:
        runs: of `split_runs`.
        z: joint position, shape (d,).
        weight: of each run; those of weight 0 are left at 0. All where not given.
    """
    prior, values, slope, curvature = (np.asarray(one) for one in expand_prior(runs.joint, np.asarray(z)))
    count, d = len(runs.runs), z.size
    value, gradient, hessian = np.zeros(count), np.zeros((count, d)), np.zeros((count, d, d))
    for r, one in enumerate(runs.runs):
        if weight is not None and weight[r] == 0:
            continue
        at = runs.places(r)
        value[r], own, information = map(np.asarray, likelihood_slopes(one, values[at]))
        gradient[r, at] = slope[at] * own
        block = np.diag(curvature[at] * own) - np.outer(slope[at], slope[at]) * information
        hessian[r][np.ix_(at, at)] = block
    bend = curvature / np.where(slope == 0, 1.0, slope)
    return RunExpansion(np.asarray(z), value, gradient, hessian, prior[0], prior[1], prior[2], slope, bend)


def weigh_runs(there: RunExpansion, weight: Float[np.ndarray, " R"]) -> Weighted:
    """Return the log posterior density in which each run counts by its weight: 0 leaves it out."""
    return Weighted(
        float(weight @ there.value + there.prior.sum()),
        weight @ there.gradient + there.prior_gradient,
        np.tensordot(weight, there.hessian, 1) + np.diag(there.prior_hessian),
    )


def marginal_log_likelihoods(
    runs: RunPosteriors, mode: Mode, there: RunExpansion, shared: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n R"]:
    """Return what each run says of draws of the shared parameters, its own integrated out; -inf where it diverges.

    Args:
        runs: of `split_runs`.
        mode: joint mode, from which the best own parameters are followed along the ridge that it has there.
        there: expansion about it.
        shared: draws, unconstrained, shape (n, k).
    """
    columns, moved = [], shared - mode.z[runs.shared]
    for r, one in enumerate(runs.runs):
        own = runs.own[r]
        start = np.broadcast_to(mode.z[own], (len(shared), own.size))
        if own.size:
            curvature = np.diag(-there.prior_hessian[own]) - there.hessian[r][np.ix_(own, own)]
            # Inverse of a curvature none of which is below what is believed.
            values, vectors = np.linalg.eigh(curvature)
            start = start + moved @ (
                there.hessian[r][np.ix_(runs.shared, own)] @ ((vectors / np.maximum(values, MIN_CURVATURE)) @ vectors.T)
            )
        columns.append(_marginals(one, own.size, np.concatenate([shared, start], 1)))
    table = np.stack(columns, 1)
    return np.where(np.isnan(table), -np.inf, table)


def shared_log_prior(runs: RunPosteriors, shared: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
    """Return the log prior density of draws of the shared parameters, unconstrained."""
    own = np.zeros((len(shared), runs.own.shape[1]))
    priors = _at_draws(partial(_log_priors, runs.runs[0]), np.concatenate([shared, own], 1))
    return priors[:, : runs.shared.size].sum(1)


class PredictedChannel(NamedTuple):
    """How one channel of a run is predicted, and what a judgement of all runs together needs of it."""

    score: Score
    residuals: RunResiduals


def predict_run(
    runs: RunPosteriors, run: int, shared: Float[np.ndarray, "n k"], key: jax.Array
) -> dict[str, PredictedChannel]:
    """Return how well one run is predicted in free simulation from its inputs, each channel by name, as a run that was not fitted.

    Args:
        runs: of `split_runs`.
        run: which one.
        shared: draws of the shared parameters, unconstrained, from what the other runs say; its own are drawn from their priors.
        key: random key.
    """
    one, n = runs.runs[run], len(shared)
    k = runs.shared.size
    z = np.concatenate([shared, np.zeros((n, runs.own.shape[1]))], 1)
    table = np.asarray(one.constrain(z))
    known = {parameter.name: table[:, i] for i, parameter in enumerate(one.parameters[:k])}
    values = values_of_draws(one, known, key)
    shown = np.asarray(outputs_of_draws(one.likelihood)(values, one.data, key))
    sensors = one.likelihood.output.simulator.sensors
    step = np.asarray(one.data.step)[0]
    time = np.concatenate([[0.0], np.cumsum(step)[:-1]])
    result = {}
    for i, (sensor, channel) in enumerate(zip(sensors, one.data.channels, strict=True)):
        at = np.asarray(channel.present)[0] > 0
        motion = shown[:, at, i]
        columns = (time[at], np.asarray(channel.measured)[0][at], motion.mean(0), motion.std(0))
        noise = float(np.sqrt(np.mean(noise_sd(sensor, values) ** 2)))
        slow = slow_noise(sensor, values)
        result[sensor.channel] = PredictedChannel(
            score_channel(*columns, noise_sd=noise, slow=slow), run_residuals(*columns, noise_sd=noise)
        )
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


class _OwnFit(NamedTuple):
    """One run at draws of the shared parameters, n of them, as a normal density of its m own ones.

    Attributes:
        density: log density where it was expanded, shape (n,).
        integral: its integral over the own parameters, log, shape (n,).
        gain: how much higher the top of the normal density is, shape (n,).
        step: from there to the top, shape (n, m).
    """

    density: Array
    integral: Array
    gain: Array
    step: Array


@program
def _log_likelihoods(one: Posterior, z: Float[Array, "n d"]) -> Float[Array, " n"]:
    return map_lanes(one.log_likelihood, z, LANES)


@program(static_argnums=1)
def _expand_own(one: Posterior, m: int, z: Float[Array, "n d"]) -> _OwnFit:
    """Expand the log density of one run in its last m parameters, their prior included, by forward derivatives."""

    def of_draw(z: Array) -> _OwnFit:
        def density_twice(own: Array) -> tuple[Array, Array]:
            whole = jnp.concatenate([z[:-m], own])
            value = one.log_likelihood(whole) + one.log_priors(whole)[-m:].sum()
            return value, value

        def gradient_twice(own: Array) -> tuple[Array, tuple[Array, Array]]:
            gradient, value = jax.jacfwd(density_twice, has_aux=True)(own)
            return gradient, (gradient, value)

        hessian, (gradient, value) = jax.jacfwd(gradient_twice, has_aux=True)(z[-m:])
        curvatures, vectors = jnp.linalg.eigh(-0.5 * (hessian + hessian.T))
        curvatures = jnp.maximum(curvatures, MIN_CURVATURE)
        step = (vectors / curvatures) @ (vectors.T @ gradient)
        gain = 0.5 * gradient @ step
        volume = 0.5 * m * jnp.log(2 * jnp.pi) - 0.5 * jnp.log(curvatures).sum()
        return _OwnFit(value, value + jnp.minimum(gain, MAX_BELIEVED_GAIN) + volume, gain, step)

    return map_lanes(of_draw, z, LANES)


def _marginals(one: Posterior, m: int, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Log marginal likelihood of one run, its last m parameters integrated out; Newton steps go on where the last one gained much."""
    if not m:
        return _at_draws(partial(_log_likelihoods, one), z)
    z = z.copy()
    best = _OwnFit(*(np.array(part) for part in _at_draws(partial(_expand_own, one, m), z)))
    share = np.ones(len(z))
    for _ in range(MAX_STEPS):
        at = np.flatnonzero(np.isfinite(best.gain) & (best.gain > MIN_STEP_GAIN))
        if not at.size:
            break
        tried = z[at]
        tried[:, -m:] += share[at, None] * best.step[at]
        there = _at_draws(partial(_expand_own, one, m), tried)
        better = there[0] > best.density[at]
        share[at] = np.where(better, 1.0, 0.5 * share[at])
        z[at[better]] = tried[better]
        for kept, new in zip(best, there, strict=True):
            kept[at[better]] = new[better]
    return np.asarray(best.integral)
