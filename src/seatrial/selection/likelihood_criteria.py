"""Criteria from the maximum of the likelihood, on the deviance scale; k parameters, n measurements.

    AIC = -2 log L + 2 k      Akaike, IEEE Transactions on Automatic Control 19, 1974
    BIC = -2 log L + k ln n   Schwarz, Annals of Statistics 6, 1978

Both know a model by its best parameters and their number alone: not by priors, nor by how well the data determine each
parameter. At the posterior mode instead of the maximum they are too large by twice what the priors cost the likelihood.
"""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.mode import Mode
from seatrial.estimation.posterior import Posterior
from seatrial.selection.criteria import Estimated, PredictiveCriterion, sum_error

_REFUSED = 1e100
"""Height of points where the likelihood is zero, which the line search then leaves."""


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
    scale = np.linalg.cholesky(mode.cov)

    def fall(x: np.ndarray) -> tuple[float, np.ndarray]:
        slope, value = map(np.asarray, _slope_and_value(posterior, jnp.asarray(mode.z + scale @ x)))
        if not (np.isfinite(value) and np.isfinite(slope).all()):
            return _REFUSED, np.zeros_like(x)
        return -float(value), -scale.T @ slope

    start = fall(np.zeros(mode.z.size))[0]
    if start == _REFUSED:
        raise NumericalError("the likelihood is zero or has no derivative at the mode: it is not of this posterior")
    found = minimize(fall, np.zeros(mode.z.size), method="BFGS", jac=True, options={"gtol": 1e-5, "maxiter": 200})
    x = found.x if found.fun <= start else np.zeros(mode.z.size)
    values = np.asarray(posterior.constrain(jnp.asarray(mode.z + scale @ x)))
    return Maximum(values, -float(min(found.fun, start)))


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
    total = Estimated(float(pointwise.sum()), 0.0)
    return PredictiveCriterion(method, total, sum_error(pointwise), float(parameters), pointwise, np.empty(0), status)


@jax.jit
def _slope_and_value(posterior: Posterior, z: Array) -> tuple[Array, Array]:
    def value_twice(z: Array) -> tuple[Array, Array]:
        value = posterior.log_likelihood(z)
        return value, value

    return jax.jacfwd(value_twice, has_aux=True)(z)
