"""Information criteria from posterior draws, on the deviance scale D = -2 log p(y | theta).

    DIC = Dbar + p_D,  BPIC = Dbar + 2 p_D,  p_D = Dbar - D(mean theta)   Spiegelhalter et al. 2002, Ando 2007
    WAIC = -2 sum_i [log mean_s p(y_i | theta_s) - var_s log p(y_i | theta_s)]   Watanabe 2010
    LOO = -2 sum_i log p(y_i | y_-i), by Pareto-smoothed importance sampling   Vehtari, Gelman and Gabry 2017

Lower is better. Their absolute values mean nothing: compare differences with their errors.
"""

from collections.abc import Iterator
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float
from scipy.special import logsumexp

from seatrial.compiled.batching import map_lanes
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import load_array_stats
from seatrial.sampling.target import LANES
from seatrial.selection.criterion import DevianceCriteria, MonteCarloValue, PredictiveCriterion, sum_error
from seatrial.selection.importance import MAX_K_HAT

# Variance of a point's log density above which its WAIC term is not to be trusted (Vehtari, Gelman and Gabry 2017).
MAX_POINT_VARIANCE = 0.4
_BATCHES = 20
_CHUNK_SIZE = 500  # Measurements handled at once: their temporary copies stay small


def deviance_criteria(posterior: Posterior, draws: Float[np.ndarray, "chains draws d"]) -> DevianceCriteria:
    """DIC and BPIC; the posterior mean is that of the parameters in their own units.

    Errors are those of batch means, D(mean theta) being taken as linear in the mean of the draws.

    Args:
        posterior: posterior; its likelihood is evaluated at every draw.
        draws: parameters in their own units.

    Raises:
        NumericalError: the likelihood is zero at a draw or at the posterior mean.
    """
    dim = draws.shape[2]
    deviance = np.asarray(deviances(posterior, jnp.asarray(draws.reshape(-1, dim)))).reshape(draws.shape[:2])
    mean = draws.mean((0, 1))
    at_mean, slope = map(np.asarray, _deviance_and_slope(posterior, jnp.asarray(mean)))
    if not (np.isfinite(deviance).all() and np.isfinite(at_mean)):
        raise NumericalError(
            "the deviance is infinite at a draw or at the posterior mean: the draws are not from this posterior, or it has several "
            "separate modes. Compare evidences instead"
        )
    moved = (draws - mean) @ slope
    centre, p_d = deviance.mean(), deviance.mean() - at_mean
    return DevianceCriteria(
        MonteCarloValue(float(centre), mean_error(deviance)),
        *(
            MonteCarloValue(float(share * centre + times * p_d), mean_error((share + times) * deviance - times * moved))
            for share, times in ((0, 1), (1, 1), (1, 2))
        ),
    )


def waic(log_likelihood: Float[np.ndarray, "chains draws n"]) -> PredictiveCriterion:
    """Widely applicable information criterion from the log density of each measurement under each draw."""
    density, variance, influence = [], [], np.zeros(log_likelihood.shape[:2]).ravel()
    for part in _columns(log_likelihood):
        density.append(_log_mean(part))
        variance.append(part.var(axis=1, ddof=1))
        influence += (np.exp(part - density[-1][:, None]) - (part - part.mean(1, keepdims=True)) ** 2).sum(0)
    effective = np.concatenate(variance)
    bad = int((effective > MAX_POINT_VARIANCE).sum())
    status = f"{bad} of {effective.size} measurements are too influential for WAIC: use PSIS-LOO" if bad else ""
    error = 2 * mean_error(influence.reshape(log_likelihood.shape[:2]))
    pointwise = -2 * (np.concatenate(density) - effective)
    return _summed("WAIC", pointwise, error, float(effective.sum()), np.empty(0), status)


def psis_loo(log_likelihood: Float[np.ndarray, "chains draws n"]) -> PredictiveCriterion:
    """Leave-one-out cross-validation from the log density of each measurement under each draw, smoothing by arviz-stats.

    The Monte Carlo error is that of the unsmoothed weights.
    """
    array_stats = load_array_stats()
    density, left_out, tails, influence = [], [], [], np.zeros(log_likelihood.shape[:2]).ravel()
    for part in _columns(log_likelihood):
        weights, tail = array_stats.psislw(part)
        tails.append(tail)
        density.append(_log_mean(part))
        left_out.append(logsumexp(weights + part, axis=1))
        influence += np.exp(-part - _log_mean(-part)[:, None]).sum(0)
    elpd, k_hat = np.concatenate(left_out), np.concatenate(tails)
    bad = int((~(k_hat <= MAX_K_HAT)).sum())
    status = (
        f"{bad} of {k_hat.size} measurements are too influential to be left out by reweighting (k-hat up to {k_hat.max():.2f}, "
        f"at most {MAX_K_HAT}). Look for outliers among them, or compare evidences"
        if bad
        else ""
    )
    error = 2 * mean_error(influence.reshape(log_likelihood.shape[:2]))
    return _summed("PSIS-LOO", -2 * elpd, error, float((np.concatenate(density) - elpd).sum()), k_hat, status)


def mean_error(series: Float[np.ndarray, "chains draws"]) -> float:
    """Standard error of the mean of correlated draws, by the spread of about 20 batch means, or one for each chain if these are more."""
    chains, n = series.shape
    pieces = max(1, min(-(-_BATCHES // chains), n // 4))
    means = series[:, n % pieces :].reshape(chains * pieces, -1).mean(1)
    return float(means.std(ddof=1) / np.sqrt(means.size))


@program
def deviances(posterior: Posterior, values: Float[Array, "n d"]) -> Float[Array, " n"]:
    """Deviance of parameters in their own units, shape (n, d), some of them simulated at once."""
    return map_lanes(partial(_deviance, posterior), values, LANES)


def _columns(log_likelihood: np.ndarray) -> Iterator[np.ndarray]:
    """Return the table a few measurements at a time, these first and all draws last."""
    table = log_likelihood.reshape(-1, log_likelihood.shape[2])
    for start in range(0, table.shape[1], _CHUNK_SIZE):
        yield np.ascontiguousarray(table[:, start : start + _CHUNK_SIZE].T)


def _log_mean(part: np.ndarray) -> np.ndarray:
    return logsumexp(part, axis=1) - np.log(part.shape[1])


def _summed(method, pointwise: np.ndarray, error: float, effective: float, k_hat: np.ndarray, status: str):
    total = MonteCarloValue(float(pointwise.sum()), error)
    return PredictiveCriterion(method, total, sum_error(pointwise), effective, pointwise, k_hat, status)


def _deviance(posterior: Posterior, values: Array) -> Array:
    return -2 * posterior.likelihood(dict(zip(posterior.names, values, strict=True)), posterior.data)


@program
def _deviance_and_slope(posterior: Posterior, values: Array) -> tuple[Array, Array]:
    return _deviance(posterior, values), jax.jacfwd(partial(_deviance, posterior))(values)


# Criteria from the maximum of the likelihood, on the deviance scale; k parameters, n measurements.
#
#     AIC = -2 log L + 2 k      Akaike, IEEE Transactions on Automatic Control 19, 1974
#     BIC = -2 log L + k ln n   Schwarz, Annals of Statistics 6, 1978
#
# Both know a model by its best parameters and their number alone: not by priors, nor by how well the data determine
# each parameter. At the posterior mode instead of the maximum they are too large by twice what the priors cost the
# likelihood.

_REFUSED_HEIGHT = 1e100  # Height of points where the likelihood is zero, which the line search then leaves


class Maximum(NamedTuple):
    """Parameters of greatest likelihood in their own units, shape (d,), and their log-likelihood."""

    values: Float[np.ndarray, " d"]
    log_likelihood: float


def maximise_likelihood(posterior: Posterior, mode: Mode) -> Maximum:
    """Climb from the posterior mode to the maximum of the likelihood inside the priors' support.

    Args:
        posterior: its priors give nothing but their support.
        mode: start, and by its covariance the scale of the search.

    Raises:
        NumericalError: the likelihood is zero at the mode.
    """
    scale = mode.scale

    def fall(x: np.ndarray) -> tuple[float, np.ndarray]:
        slope, value = map(np.asarray, _slope_and_value(posterior, jnp.asarray(mode.z + scale @ x)))
        if not (np.isfinite(value) and np.isfinite(slope).all()):
            return _REFUSED_HEIGHT, np.zeros_like(x)
        return -float(value), -scale.T @ slope

    start = fall(np.zeros(mode.z.size))[0]
    if start == _REFUSED_HEIGHT:
        raise NumericalError("the likelihood is zero or has no derivative at the mode: it is not of this posterior")
    result = scipy.optimize.minimize(
        fall, np.zeros(mode.z.size), method="BFGS", jac=True, options={"gtol": 1e-5, "maxiter": 200}
    )
    x = result.x if result.fun <= start else np.zeros(mode.z.size)
    values = np.asarray(posterior.constrain(jnp.asarray(mode.z + scale @ x)))
    return Maximum(values, -float(min(result.fun, start)))


def aic(log_likelihood: Float[np.ndarray, " n"], parameters: int) -> PredictiveCriterion:
    """Akaike's criterion.

    Args:
        log_likelihood: log density of each measurement at the maximum of the likelihood: `pointwise_log_likelihood` of that
            one draw. At the posterior mode the criterion is not Akaike's, unless all priors are uniform, which makes them one.
        parameters: all that were estimated, nuisances included.

    Raises:
        InputError: fewer than two measurements, or no parameter.
    """
    return _criterion("AIC", log_likelihood, parameters, 2.0)


def bic(log_likelihood: Float[np.ndarray, " n"], parameters: int) -> PredictiveCriterion:
    """Schwarz's criterion; arguments and errors as `aic`, its n the number of measurements: every channel of every sample.

    Where residuals are correlated the data are worth fewer, and the criterion asks too much of a term.
    """
    return _criterion("BIC", log_likelihood, parameters, float(np.log(max(1, len(log_likelihood)))))


def _criterion(
    method: Literal["AIC", "BIC"], log_likelihood: np.ndarray, parameters: int, price: float
) -> PredictiveCriterion:
    n = len(log_likelihood)
    if n < 2 or parameters < 1:
        raise InputError(
            method,
            found=f"{n} measurements and {parameters} parameters",
            expected="at least two measurements and a parameter",
            remedy="give the log density of each measurement, not their sum",
        )
    pointwise = -2 * np.asarray(log_likelihood, float) + price * parameters / n
    status = (
        f"{n} measurements for {parameters} parameters: the criterion is meant for many more"
        if n < 40 * parameters
        else ""
    )
    total = MonteCarloValue(float(pointwise.sum()), 0.0)
    return PredictiveCriterion(method, total, sum_error(pointwise), float(parameters), pointwise, np.empty(0), status)


@program
def _slope_and_value(posterior: Posterior, z: Array) -> tuple[Array, Array]:
    def value_twice(z: Array) -> tuple[Array, Array]:
        value = posterior.log_likelihood(z)
        return value, value

    return jax.jacfwd(value_twice, has_aux=True)(z)
