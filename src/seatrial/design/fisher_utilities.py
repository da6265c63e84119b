"""Utilities of a trial from its Fisher information F and what is known before, a covariance P0: one number, higher is better.

All look at G = L^T F L with P0 = L L^T: the information about the combinations of coefficients that the prior holds for
independent and of unit variance. After the trial their covariance is (I + G)^-1, which exists whatever F is. Criteria:
Atkinson, Donev and Tobias, Optimum Experimental Designs, 2007, ch. 10; with a prior: Chaloner and Verdinelli, Stat. Sci. 10, 1995.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.core.errors import InputError, nearest
from seatrial.numerics.array_module import array_module

# Telling structures apart: how much evidence a trial brings that terms are there which a rival structure leaves out.
#
# With terms A present at theta_A and the rival's own terms K free to make up for them within what is believed, P_K,
# the difference of the log likelihoods is expected to be, to first order in theta_A,
#
#     0.5 theta_A^T [F_AA - F_AK (F_KK + P_K^-1)^-1 F_KA] theta_A
#
# It is the criterion T of Atkinson and Fedorov (Biometrika 62, 1975) for nested structures and Gaussian noise.


@dataclass(frozen=True, eq=False)
class Discrimination:
    """Evidence, nats, against the rival that is hardest to tell from the structure that is believed in; from 0.

    Attributes:
        draws: coefficients of that structure, SI, shape (S, k).
        absent: terms that each rival lacks, shape (R, k).
        cov: covariance of the coefficients before the trial, SI, shape (k, k).
    """

    draws: Float[np.ndarray, "S k"]
    absent: Bool[np.ndarray, "R k"]
    cov: Float[np.ndarray, "k k"]

    def __call__(self, information: Float[Array, "*batch S k k"]) -> Float[Array, "*batch S"]:
        """Return the utility of information matrices, one for each draw along the axis before the last two."""
        xp = array_module(information)
        return xp.stack([self._against(information, absent) for absent in self.absent]).min(0)

    def _against(self, information: Array, absent: np.ndarray) -> Array:
        xp = array_module(information)
        a, kept = np.flatnonzero(absent), np.flatnonzero(~absent)
        theta = self.draws[:, a]
        force = (information[..., a, :] * theta[..., :, None]).sum(-2)
        alone = (force[..., a] * theta).sum(-1)
        if not kept.size:
            return 0.5 * alone
        free = information[..., kept[:, None], kept[None, :]] + np.linalg.inv(self.cov[np.ix_(kept, kept)])
        made_up = xp.linalg.solve(free, force[..., kept][..., None])[..., 0]
        return 0.5 * (alone - (force[..., kept] * made_up).sum(-1))


# Ratio of least to largest information from which on a combination counts as not seen at all: rounding is not far
# below
SINGULAR = 1e-10


Criterion = Callable[[Float[Array, "*batch k k"]], Float[Array, "*batch"]]
"""Utility of Fisher information matrices, SI.

JAX arrays, traced ones too, give JAX arrays that can be differentiated; NumPy arrays give NumPy arrays.
"""


def entropy(factor: Float[np.ndarray, "k k"], information: Float[Array, "*batch k k"]) -> Float[Array, "*batch"]:
    """D: 0.5 ln det(F + P0^-1) + 0.5 ln det P0 = 0.5 ln det(I + G), nats, from 0; the same for any choice of coefficients."""
    xp = array_module(information)
    return 0.5 * xp.linalg.slogdet(_gained(factor, information) + np.eye(len(factor)))[1]


def mean_variance(factor: Float[np.ndarray, "k k"], information: Float[Array, "*batch k k"]) -> Float[Array, "*batch"]:
    """A: minus the mean over the coefficients of variance after over variance before; from -1, nothing learned, to 0."""
    before = (factor**2).sum(1)
    return -_left(factor / np.sqrt(before)[:, None], factor, information).mean(-1)


def least_known(factor: Float[np.ndarray, "k k"], information: Float[Array, "*batch k k"]) -> Float[Array, "*batch"]:
    """E: smallest eigenvalue of I + G, from 1, nothing learned in some direction."""
    return 1.0 + _eigenvalues(factor, information)[..., 0]


def balance(factor: Float[np.ndarray, "k k"], information: Float[Array, "*batch k k"]) -> Float[Array, "*batch"]:
    """Modified E: minus ln(largest / smallest eigenvalue of G), nats, at most 0, all combinations seen alike.

    It is of the data alone: with the prior added, a trial that teaches nothing would look best of all. Nor does it say how much
    is learned, only how evenly. Where some combination is not seen at all it is ln SINGULAR, -23, and no less.
    """
    xp = array_module(information)
    values = _eigenvalues(factor, information)
    least, largest = values[..., 0], values[..., -1]
    ratio = least / xp.where(largest > 0.0, largest, 1.0)
    return xp.log(xp.maximum(ratio, SINGULAR))


def prediction_gain(
    factor: Float[np.ndarray, "k k"], information: Float[Array, "*batch k k"], gradient: Float[np.ndarray, " k"]
) -> Float[Array, "*batch"]:
    """c: ln of standard deviation before over after of g.c, a prediction with gradient g in the coefficients; nats, from 0."""
    seen = gradient @ factor
    direction = (seen / np.linalg.norm(seen))[None]
    return -0.5 * array_module(information).log(_left(direction, factor, information)[..., 0])


# Every utility from Fisher information, by the name a campaign gives it: a function of the Cholesky factor L and F
CRITERIA: dict[str, Callable[..., Array]] = {
    "fisher-d": entropy,
    "fisher-a": mean_variance,
    "fisher-e": least_known,
    "fisher-me": balance,
    "fisher-c": prediction_gain,
}


def find_criterion(
    name: str, prior_cov: Float[np.ndarray, "k k"], gradient: Float[np.ndarray, " k"] | None = None
) -> Criterion:
    """Return the criterion by name.

    Args:
        name: one of `CRITERIA`.
        prior_cov: covariance of the coefficients before the trial, SI: of their priors or of draws of a posterior.
        gradient: of the prediction in the coefficients, for `fisher-c` alone.

    Raises:
        InputError: no such criterion, a covariance that is not positive definite, or a gradient missing, of the wrong length or 0.
    """
    if name not in CRITERIA:
        raise InputError("utility", found=f'"{name}"', expected=", ".join(CRITERIA), remedy=nearest(name, CRITERIA))
    factor = _factor(np.asarray(prior_cov, float))
    of_prediction = {"gradient": _checked(gradient, len(factor))} if name == "fisher-c" else {}
    return partial(CRITERIA[name], factor, **of_prediction)


def _factor(cov: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor, taken of the correlations so that coefficients of any size are treated alike."""
    sd = np.sqrt(np.maximum(np.diag(cov), 0.0))
    place, remedy = (
        "covariance before the trial",
        "leave out known and repeated coefficients; use more posterior draws",
    )
    if not (np.isfinite(cov).all() and (sd > 0).all()):
        raise InputError(place, found=f"variances {np.diag(cov)}", expected="finite, positive variances", remedy=remedy)
    correlation = cov / np.outer(sd, sd)
    least = float(np.linalg.eigvalsh(correlation)[0])
    if least < SINGULAR:
        raise InputError(
            place,
            found=f"smallest eigenvalue {least:.2g} of the correlations",
            expected="a positive definite matrix",
            remedy=remedy,
        )
    return sd[:, None] * np.linalg.cholesky(correlation)


def _checked(gradient: np.ndarray | None, k: int) -> np.ndarray:
    result = None if gradient is None else np.asarray(gradient, float)
    if result is None or result.shape != (k,) or not np.isfinite(result).all() or not result.any():
        raise InputError(
            "utility fisher-c, gradient",
            found="none" if result is None else f"{result}",
            expected=f"{k} finite numbers, not all 0: the change of the prediction with each coefficient",
            remedy="state the prediction to improve",
        )
    return result


def _gained(factor: np.ndarray, information: Array) -> Any:
    """G, symmetric to the last bit."""
    gained = factor.T @ information @ factor
    return 0.5 * (gained + gained.swapaxes(-1, -2))


def _eigenvalues(factor: np.ndarray, information: Array) -> Array:
    """Eigenvalues of G, rising; below 0 there is only rounding."""
    xp = array_module(information)
    return xp.maximum(xp.linalg.eigvalsh(_gained(factor, information)), 0.0)


def _left(rows: np.ndarray, factor: np.ndarray, information: Array) -> Array:
    """Return the variance after the trial, r (I + G)^-1 r^T, of every row r."""
    total = _gained(factor, information) + np.eye(len(factor))
    solved = array_module(information).linalg.solve(total, np.broadcast_to(rows.T, (*total.shape[:-2], *rows.T.shape)))
    return (rows * solved.swapaxes(-1, -2)).sum(-1)
