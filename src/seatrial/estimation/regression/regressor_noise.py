"""How much noise in the regressors still biases a fit of rows, by adding more of it: simulation and extrapolation (SIMEX).

Noise of variance lambda sigma^2 is added to every measured signal at several levels lambda, and the fit extrapolated to lambda = -1,
where there would be none (Cook and Stefanski, J. Am. Stat. Assoc. 89, 1994). Coefficients bend with lambda in a way that no
polynomial follows far; the sums of products they come from do not, being polynomials of sigma^2 (Nakamura, Biometrika 77, 1990).
So these are extrapolated, by a quadratic in lambda,

    c(-1) = G(-1)^-1 g(-1),  G = Phi' Phi,  g = Phi' y,  averaged over simulations

A white force that no term explains biases too: it moves the vehicle, and that motion, smoothed by a symmetric window, does not go with
its own rate, so that damping comes out too small. The response to it, d delta/dt = J delta + force / inertia with the fit's J along the
trial, is added likewise. Velocities without an equation among the rows, and controls that answer to the motion, count as given: where
they follow it, as sway and a zigzag's rudder follow yaw, this part comes out too large. The bias of few data is not in it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import too_few
from seatrial.estimation.regression.row_fit import SCREENING
from seatrial.estimation.regression.rows import WhitenedRows, force_slope, rewhitened, solve
from seatrial.estimation.regression.weak_form import TrialRows

LEVELS = (0.5, 1.0, 1.5, 2.0)
NO_RESPONSE = np.zeros((1, 1))
LARGE_BIAS = 1.0  # Bias in standard errors above which it is named


@dataclass(frozen=True, eq=False)
class RegressorBias:
    """Bias of a fit with every term by noise in its regressors; k coefficients.

    Attributes:
        names: coefficients.
        values: estimates from the rows as they are, SI, shape (k,).
        sd: their standard errors, shape (k,).
        corrected: estimates extrapolated to no noise; NaN if that cannot be told, shape (k,).
        bias: values less corrected, SI, shape (k,).
        error: Monte Carlo standard error of the bias, shape (k,).
        status: empty if no bias exceeds a standard error, else which does, in words.
        verdict: what fits of rows are good for.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    sd: Float[np.ndarray, " k"]
    corrected: Float[np.ndarray, " k"]
    bias: Float[np.ndarray, " k"]
    error: Float[np.ndarray, " k"]
    status: str
    verdict: str = SCREENING


def regressor_noise_bias(rows: WhitenedRows, key: Array, pairs: int = 16, forces: bool = True) -> RegressorBias:
    """Estimate the bias of each coefficient.

    Args:
        rows: whitened rows.
        key: random key.
        pairs: simulations come in pairs of opposite noise; at least 2.
        forces: count the motion that unexplained forces make, too; without, the bias is that by noise of the sensors alone.

    Raises:
        InputError: fewer than 2 pairs.
    """
    if pairs < 2:
        raise too_few("bias by noise in regressors", f"{pairs} pairs", 2, "16 usually suffice")
    random = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    values, cov = solve(rows.design, rows.target)
    scale = np.linalg.norm(rows.design, axis=0)
    plain = _moments(rows.design / scale, rows.target)
    quadratic = _extrapolation()
    each = np.empty((pairs, *plain.shape))
    coefficients = dict(zip(rows.names, values, strict=True))
    driven = [_driven(rows, trial, coefficients, pairs, random) if forces else {} for trial in rows.trials]
    for pair in range(pairs):
        drawn = [
            {
                name: response[pair % len(response)] + e
                for name, response, e in _noisy(trial, rows.noise, responses, random)
            }
            for trial, responses in zip(rows.trials, driven, strict=True)
        ]
        change = [
            0.5 * sum(_at(rows, drawn, sign * np.sqrt(level), scale) for sign in (1, -1)) - plain for level in LEVELS
        ]
        each[pair] = plain + np.tensordot(quadratic, np.array(change), 1)
    corrected, error = _solved(each, scale)
    bias, sd = values - corrected, np.sqrt(np.diag(cov))
    return RegressorBias(rows.names, values, sd, corrected, bias, error, _words(rows.names, values, sd, bias, error))


def _extrapolation() -> Float[np.ndarray, " levels"]:
    """Return the weights on the changes at each level that give the change at -1 of the quadratic through no change at 0."""
    level = np.array(LEVELS)
    return np.array([-1.0, 1.0]) @ np.linalg.pinv(np.column_stack([level, level**2]))


def _noisy(
    trial: TrialRows, noise: Mapping[str, float], driven: Mapping[str, np.ndarray], random: np.random.Generator
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Return each measured signal with its responses to the force and fresh noise of its sensor."""
    for name, column in trial.signals.items():
        if name not in trial.held:
            yield name, driven.get(name, NO_RESPONSE), noise[name] * random.normal(size=column.size)


def _driven(
    rows: WhitenedRows, trial: TrialRows, values: Mapping[str, float], pairs: int, random: np.random.Generator
) -> dict[str, Float[np.ndarray, "pairs n"]]:
    """Return the responses of the velocities to white forces of the density that the rows show; none if they show none."""
    if not rows.force_sd.any():
        return {}
    velocities = [equation.rate for equation in rows.equations]
    jacobian = np.zeros((trial.step.size, len(velocities), len(velocities)))
    for i, equation in enumerate(rows.equations):
        acting = [(term, values[term.text]) for term in equation.terms] + list(equation.known)
        for j, name in enumerate(velocities):
            forces = [(term, c) for term, c in acting if name in term.signals and not term.is_added_mass]
            if forces:
                small = 1e-3 * float(np.std(trial.signals[name]))
                jacobian[:, i, j] = force_slope(equation, forces, trial.signals, name, small) / equation.inertia
    inertia = np.array([equation.inertia for equation in rows.equations])
    spread = (rows.force_sd / inertia)[:, None] * np.linalg.cholesky(rows.correlation)
    kicks = np.sqrt(trial.step)[:, None, None] * (random.normal(size=(trial.step.size, pairs, inertia.size)) @ spread.T)
    response = np.zeros((trial.step.size, pairs, inertia.size))
    with np.errstate(over="ignore", invalid="ignore"):  # a fit that drives instead of damping has no finite response
        for k, h in enumerate(trial.step[:-1]):
            response[k + 1] = response[k] + h * response[k] @ jacobian[k].T + kicks[k]
    return {name: response[:, :, i].T for i, name in enumerate(velocities)}


def _at(
    rows: WhitenedRows, drawn: list[dict[str, np.ndarray]], times: float, scale: np.ndarray
) -> Float[np.ndarray, "k k1"]:
    """Return the moments with so many times the drawn noise added."""
    trials = [
        replace(
            trial, signals={**trial.signals, **{name: trial.signals[name] + times * e for name, e in noise.items()}}
        )
        for trial, noise in zip(rows.trials, drawn, strict=True)
    ]
    design, target = rewhitened(rows, trials)
    return _moments(design / scale, target)


def _moments(design: np.ndarray, target: np.ndarray) -> Float[np.ndarray, "k k1"]:
    """G and g side by side."""
    return np.column_stack([design.T @ design, design.T @ target])


def _solved(each: Float[np.ndarray, "pairs k k1"], scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients from the mean moments, and their standard error by the jackknife."""
    pairs, total = len(each), each.sum(0)
    mean = total / pairs
    nothing = np.full(scale.size, np.nan)
    if not np.isfinite(mean).all() or np.linalg.eigvalsh(mean[:, :-1])[0] <= 0:
        return nothing, nothing
    without = np.array([np.linalg.solve(m[:, :-1], m[:, -1]) for m in (total - each) / (pairs - 1)])
    error = np.sqrt((pairs - 1) / pairs * ((without - without.mean(0)) ** 2).sum(0))
    return np.linalg.solve(mean[:, :-1], mean[:, -1]) / scale, error / scale


def _words(names: tuple[str, ...], values: np.ndarray, sd: np.ndarray, bias: np.ndarray, error: np.ndarray) -> str:
    if not np.isfinite(bias).all():
        return (
            "some combination of the regressors varies only by noise and unexplained forces, so the bias cannot be estimated. Drop "
            "terms, or run a trial with larger controls"
        )
    worst = int(np.argmax(np.abs(bias) / sd))
    if not abs(bias[worst]) > LARGE_BIAS * sd[worst]:
        return ""
    count = int((np.abs(bias) > LARGE_BIAS * sd).sum())
    others = f", and {count - 1} more by over one" if count > 1 else ""
    return (
        f"noise or unexplained motion in the regressors biases {names[worst]} = {values[worst]:.3g} ± {sd[worst]:.2g} by about "
        f"{bias[worst]:+.2g} ± {error[worst]:.1g}, {abs(bias[worst]) / sd[worst]:.1f} of its standard errors{others}. Use windows "
        f"instead of samples, smoothed states, or a trial with larger controls"
    )
