"""Equation error: regression of the acceleration on the regressors, term by term, at states as measured or smoothed.

    udot_k = sum_j c_j phi_j(u_k, n_k) / (m - X_udot) + e_k,  c = (Phi^T Phi)^-1 Phi^T udot

It needs no simulation and is the first thing that anyone tries. Noise in u enters the regressors, whose coefficients it draws
together: with 5 % noise X_u comes out at twice its value, with an error bar a twentieth of that mistake. The refined fit

    c = (Z^T Phi)^-1 Z^T udot

takes as instruments Z the regressors along the motion that the fitted vehicle itself would make, which the sensor's noise
does not touch (refined instrumental variables: Young and Jakeman, Int. J. Control 29, 1979), and says how far it moved.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate

MAX_ROUNDS = 50
# Standard errors of the plain fit by which the refined one may differ before the plain one is called biased.
MAX_SHIFT_ERRORS = 2.0
ROUND_TOLERANCE = 1e-6
DEGREE = 3


@dataclass(frozen=True, eq=False)
class Regression:
    """A fit of the coefficients to accelerations; k coefficients.

    Attributes:
        names: coefficients.
        values: estimates, SI, shape (k,).
        cov: their covariance, the memory of smoothed accelerations counted (Newey and West 1987), shape (k, k).
        plain: estimates with the states as measured or smoothed in the regressors, shape (k,).
        plain_sd: their standard errors, as a script without this module would print them, shape (k,).
        acceleration_sd: standard deviation of what is left over, m/s^2.
        status: empty if the two agree, else what is wrong with the plain fit, in words.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    cov: Float[np.ndarray, "k k"]
    plain: Float[np.ndarray, " k"]
    plain_sd: Float[np.ndarray, " k"]
    acceleration_sd: float
    status: str

    @property
    def sd(self) -> Float[np.ndarray, " k"]:
        """Standard errors."""
        return np.sqrt(np.diag(self.cov))


@dataclass(frozen=True, eq=False)
class Accelerations:
    """One trial for regression; n samples.

    Attributes:
        label: of the record.
        speed: u at each sample, m/s, shape (n,).
        acceleration: du/dt at each sample, m/s^2, NaN if there is none, shape (n,).
        control: controls, shape (n, n_controls).
        step: time to the next sample, s, shape (n,).
        memory: samples over which errors of the acceleration are correlated, by smoothing; 0 as measured.
    """

    label: str
    speed: Float[np.ndarray, " n"]
    acceleration: Float[np.ndarray, " n"]
    control: Float[np.ndarray, "n c"]
    step: Float[np.ndarray, " n"]
    memory: int = 0


def measured_accelerations(model: VehicleModel, record: Record) -> Accelerations:
    """Return the speed and acceleration as the sensors gave them, udot among them.

    Raises:
        InputError: a channel that the record lacks.
    """
    control = np.column_stack([record.channel(name) for name in model.controls])
    return Accelerations(record.label, record.channel("u"), record.channel("udot"), control, record.step)


def smoothed_accelerations(model: VehicleModel, record: Record, window: float) -> Accelerations:
    """Return the speed and its rate from a cubic through the speeds of a sliding window (Savitzky and Golay 1964).

    Args:
        model: vehicle.
        record: trial of even step whose u has no gaps.
        window: width, s: wide enough for noise, narrow enough for the motion.

    Raises:
        InputError: an uneven step, gaps in u, or a window of too few samples.
    """
    step, speed = np.asarray(record.step), record.channel("u")
    half = round(0.5 * window / step[0])
    if np.ptp(step) > 1e-6 * step[0] or not np.isfinite(speed).all():
        raise InputError(
            f'record "{record.label}"',
            found="an uneven time step" if np.isfinite(speed).all() else "gaps in u",
            expected="an even step and every sample, for the sliding window",
            remedy="import the record with a fixed `step`, or use the output-error likelihood, which needs neither",
        )
    if not DEGREE < 2 * half + 1 <= speed.size:
        raise InputError(
            f'record "{record.label}"',
            found=f"a window of {2 * half + 1} samples, of {speed.size}",
            expected=f"more than {DEGREE}, and no more than the record has",
            remedy="choose another window",
        )
    weights = [
        scipy.signal.savgol_coeffs(2 * half + 1, DEGREE, deriv=order, delta=step[0], use="dot") for order in (0, 1)
    ]
    views = np.lib.stride_tricks.sliding_window_view(speed, 2 * half + 1)
    inside = slice(half, speed.size - half)
    control = np.column_stack([record.channel(name) for name in model.controls])
    return Accelerations(record.label, views @ weights[0], views @ weights[1], control[inside], step[inside], 2 * half)


def fit_equation_error(model: VehicleModel, trials: Sequence[Accelerations], refine: bool = True) -> Regression:
    """Fit the coefficients of a surge model by least squares.

    Args:
        model: vehicle of one state, u, linear in its coefficients.
        trials: accelerations.
        refine: take the regressors along the fitted vehicle's own motion, until that no longer changes the fit.

    Raises:
        InputError: a model that is not linear in its coefficients, or too few accelerations.
        NumericalError: regressors of which one is a combination of others, or a refinement that diverges.
    """
    if model.states != ("u",) or any(term.is_added_mass for term in model.coefficients):
        raise InputError(
            "equation error",
            found="an unknown added mass" if model.states == ("u",) else f"states {', '.join(model.states)}",
            expected="a surge model with only coefficients of forces",
            remedy="fix X_udot in the vehicle, or use the output-error likelihood",
        )
    names = tuple(term.text for term in model.coefficients)
    plain, cov, sd = _regress(model, trials, [trial.speed for trial in trials])
    values, status = plain, ""
    plain_sd = np.sqrt(np.diag(cov))
    if refine:
        scale = np.maximum(np.abs(plain), plain_sd)
        for _ in range(MAX_ROUNDS):
            before = values
            values, cov, sd = _regress(model, trials, [_motion(model, names, before, trial) for trial in trials])
            if (np.abs(values - before) <= ROUND_TOLERANCE * scale).all():
                break
        else:
            status = f"the refinement still moves after {MAX_ROUNDS} rounds; "
        status += _complaint(names, plain, plain_sd, values)
    return Regression(names, values, cov, plain, plain_sd, sd, status)


def _regress(
    model: VehicleModel, trials: Sequence[Accelerations], instruments: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the estimates, covariance and residual standard deviation; instruments are the regressors at the speeds given."""
    kept: list[tuple[np.ndarray, ...]] = []
    for trial, speed in zip(trials, instruments, strict=True):
        control = np.asarray(trial.control)
        constant, phi = (np.asarray(x) for x in _regressors(model, np.asarray(trial.speed), control))
        z = phi if speed is trial.speed else np.asarray(_regressors(model, np.asarray(speed), control)[1])
        is_complete = np.isfinite(trial.acceleration) & np.isfinite(phi).all(1)
        kept.append((phi[is_complete], z[is_complete], (trial.acceleration - constant)[is_complete]))
    phi, z, y = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    n, k = phi.shape
    if n < 2 * k:
        raise InputError(
            "equation error",
            found=f"{n} accelerations for {k} coefficients",
            expected=f"at least {2 * k}",
            remedy="give a longer record, or map the channel udot",
        )
    scale = np.where((norm := np.linalg.norm(phi, axis=0)) > 0, norm, 1.0)
    phi, z = phi / scale, z / scale
    _, singular, right = np.linalg.svd(phi, full_matrices=False)
    if singular[-1] < 1e-10:  # columns of norm 1, or of zeros
        involved = [name.text for name, w in zip(model.coefficients, right[-1], strict=True) if abs(w) > 0.1]
        raise NumericalError(
            f"the regressors of {', '.join(involved)} are proportional in these records, so only a combination can be estimated. Leave "
            f"one out, or run a trial over more speeds"
        )
    inverse = np.linalg.inv(z.T @ phi)
    values = inverse @ (z.T @ y)
    residual = y - phi @ values
    memory, variance = max(trial.memory for trial in trials), float(residual @ residual / (n - k))
    spread = _long_run(z * residual[:, None], memory) if memory else variance * z.T @ z
    return values / scale, inverse @ spread @ inverse.T / np.outer(scale, scale), variance**0.5


def _long_run(scores: Float[np.ndarray, "n k"], memory: int) -> Float[np.ndarray, "k k"]:
    """Return the covariance of the sum of correlated scores, lags weighted by Bartlett's triangle."""
    total = scores.T @ scores
    for lag in range(1, memory + 1):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1 - lag / (memory + 1)) * (cross + cross.T)
    return total


@program(static_argnums=0)
def _regressors(model: VehicleModel, speed: Array, controls: Array) -> tuple[Array, Array]:
    """Acceleration without any free coefficient, and by a unit of each, at many samples."""
    names = [term.text for term in model.coefficients]

    def one(u: Array, control: Array) -> tuple[Array, Array]:
        def rate(values: Array) -> Array:
            return model.derivative(dict(zip(names, values, strict=True)), (u,), tuple(control))[0]

        zero = jnp.zeros(len(names))
        return rate(zero), jax.jacfwd(rate)(zero)

    return jax.vmap(one)(speed, controls)


def _motion(model: VehicleModel, names: tuple[str, ...], values: np.ndarray, trial: Accelerations) -> np.ndarray:
    """Return the speeds of the fitted vehicle from the trial's first speed."""
    start = np.array([trial.speed[np.flatnonzero(np.isfinite(trial.speed))[0]]])
    params = dict(zip(names, map(float, values), strict=True))
    speed = np.asarray(simulate(model, params, np.asarray(trial.control), np.asarray(trial.step), start))[:, 0]
    if not np.isfinite(speed).all():
        raise NumericalError(
            f"the vehicle that fits the accelerations of {trial.label} diverges when simulated: its estimated damping adds energy. "
            "Noise in u does this to equation error; use the output-error likelihood"
        )
    return speed


def _complaint(names: tuple[str, ...], plain: np.ndarray, plain_sd: np.ndarray, refined: np.ndarray) -> str:
    """Return what noise in the regressors did to the plain fit."""
    moved = np.abs(plain - refined) / plain_sd
    worst = int(np.argmax(moved))
    if not moved[worst] > MAX_SHIFT_ERRORS:
        return ""
    return (
        f"noise in the speed biases the plain regression: {names[worst]} comes out as {plain[worst]:.4g} ± {plain_sd[worst]:.2g}. "
        f"With the simulated speeds of the fitted vehicle it is {refined[worst]:.4g}, {moved[worst]:.0f} of those errors away. Use the "
        f"refined values as a first answer, then the output-error likelihood"
    )
