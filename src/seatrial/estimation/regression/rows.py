"""Whitened rows of one or several equations of motion, ready for least squares and for the selection of terms.

The noise of sensors and of a white force is taken out first, the density of the force by restricted maximum
likelihood of the fit with every term (Patterson and Thompson 1971). Residuals of the e equations at the same window then correlate as
Sigma, and the rows of a window are multiplied by the inverse of its Cholesky factor: seemingly unrelated regressions
(Zellner, J. Am. Stat. Assoc. 57, 1962). Rows end independent and of unit variance, as far as that fit can tell.

Noise eps_s in signal s moves the residuals of an equation by L_s eps_s, with

    L_s = inertia [s is the velocity] d/dt - sum_j c_j dphi_j/ds,   C = sum_s sigma_s^2 L_s L_s' + Q int psi psi'

weighted by the windows, so that C is banded; c is that of the fit before, as in the weak form of errors in variables
(Bortz, Messenger and Dukic, Bull. Math. Biol. 85, 2023). Q is the spectral density of a white force that no term gives: what
process noise is to a filter. Rows are multiplied by the inverse of the Cholesky factor of C.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.regression.weak_form import RawRows, TrialRows, coefficient_names, raw_rows
from seatrial.vehicles.axis_equation import AxisEquation

ROUNDS = 10  # Most rounds of weighting; the third changes estimates by little
ROUND_TOLERANCE = 1e-3  # Standard deviations by which the last round may move a coefficient
LOG_SHARES = (-9.0, 9.0)  # Range of the logarithm of the force's share in the variance of a row over the sensors'
COLLINEAR = 1e-10  # Part of a regressor's sum of squares that others must not explain


class RowCovariance(NamedTuple):
    """Covariance of the m rows of an equation in lower banded storage: by the sensors, and by a white force of density 1."""

    sensors: Float[np.ndarray, "b m"]
    force: Float[np.ndarray, "b m"]


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """Whitened rows of all trials, equation after equation; n rows, k coefficients, e equations.

    Attributes:
        names: coefficients, the columns.
        design: regressors, shape (n, k).
        target: shape (n,).
        equation: number of the equation of each row; rows of one window mix those before it, shape (n,).
        trial: number of the trial, shape (n,).
        index: place in the trial's sequence of windows, shape (n,).
        force_sd: root of the spectral density of the white force that no term explains, N sqrt(s) or by inertia, shape (e,).
        correlation: of the equations' residuals, shape (e, e).
        r2: part of the raw rows' sum of squares that all terms explain, for each equation, shape (e,).
        equations: as given.
        trials: as given.
        noise: standard deviation of each channel, as given.
        factors: Cholesky factors of the noise for each trial and equation.
        mixing: Cholesky factor of Sigma, shape (e, e).
    """

    names: tuple[str, ...]
    design: Float[np.ndarray, "n k"]
    target: Float[np.ndarray, " n"]
    equation: Int[np.ndarray, " n"]
    trial: Int[np.ndarray, " n"]
    index: Int[np.ndarray, " n"]
    force_sd: Float[np.ndarray, " e"]
    correlation: Float[np.ndarray, "e e"]
    r2: Float[np.ndarray, " e"]
    equations: tuple[AxisEquation, ...]
    trials: tuple[TrialRows, ...]
    noise: Mapping[str, float]
    factors: tuple[tuple[Float[np.ndarray, "b m"], ...], ...]
    mixing: Float[np.ndarray, "e e"]


def check_noise(equations: Sequence[AxisEquation], trial: TrialRows, noise: Mapping[str, float]) -> None:
    """Check that the noise of every measured signal is known, and that of accelerations or their velocities not zero.

    Raises:
        InputError: naming the channel.
    """
    rates = {equation.rate + trial.windows.suffix for equation in equations}
    for name in trial.signals:
        if name not in trial.held and not noise.get(name, -1.0) >= 0.0 + (name in rates) * np.finfo(float).tiny:
            raise InputError(
                f'noise of channel "{name}"',
                found=f"{noise[name]}" if name in noise else "none given",
                expected="a standard deviation" + (" above zero, because it weights the rows" if name in rates else ""),
                remedy="state it from the data sheet of the sensor, or estimate it by `noise_from_high_pass`",
            )


def row_covariances(
    equations: Sequence[AxisEquation], trial: TrialRows, values: Mapping[str, float], noise: Mapping[str, float]
) -> tuple[RowCovariance, ...]:
    """Return the covariance of the rows of one trial, for each equation.

    Args:
        equations: all of them.
        trial: rows of one trial.
        values: coefficients by name; those not named count as zero.
        noise: standard deviation of each measured channel.
    """
    force = trial.windows.white @ trial.windows.white.T
    covariances = []
    for equation in equations:
        sensors = _sensors(equation, trial, values, noise)
        depth = max(_depth(sensors), _depth(force))
        covariances.append(RowCovariance(_band(sensors, depth), _band(force, depth)))
    return tuple(covariances)


def row_factor(covariance: RowCovariance, process: float) -> Float[np.ndarray, "b m"]:
    """Return the Cholesky factor of the covariance with a white force of spectral density `process`, in lower banded storage.

    Raises:
        NumericalError: windows of which one is a combination of others.
    """
    try:
        return scipy.linalg.cholesky_banded(covariance.sensors + process * covariance.force, lower=True)
    except scipy.linalg.LinAlgError as error:
        raise NumericalError(
            "the noise of some windows is a combination of that of others: take windows without overlap, or of another width"
        ) from error


def whiten(raw: RawRows, factors: Sequence[Float[np.ndarray, "b m"]]) -> RawRows:
    """Return the rows multiplied by the inverse of each equation's factor."""
    table = np.concatenate([raw.design, raw.target[:, :, None]], axis=2)
    free = np.stack(
        [scipy.linalg.solve_banded((len(f) - 1, 0), f, part) for f, part in zip(factors, table, strict=True)]
    )
    return RawRows(free[:, :, :-1], free[:, :, -1])


def force_slope(
    equation: AxisEquation,
    forces: Sequence[tuple[CoefficientName, float]],
    signals: Mapping[str, Float[np.ndarray, " n"]],
    name: str,
    sd: float,
) -> Float[np.ndarray, " n"]:
    """Return the derivative of the force with respect to one signal, over a step of the size of its noise, as moduli ask for."""
    above, below = ({**signals, name: signals[name] + shift} for shift in (sd, -sd))
    slope = np.zeros(signals[name].size)
    for term, value in forces:
        slope += value * (equation.regressor(term, above) - equation.regressor(term, below)) / (2 * sd)
    return slope


def whitened_rows(
    equations: Sequence[AxisEquation], trials: Sequence[TrialRows], noise: Mapping[str, float]
) -> WhitenedRows:
    """Return the rows of all trials, independent and of unit residual variance as far as the fit with every term can tell.

    Args:
        equations: of one or several axes, with every candidate term.
        trials: of `weak_trials` or `pointwise_trials` for the same equations.
        noise: standard deviation of every measured channel that the rows use, in the channel's unit.

    Raises:
        InputError: noise of a channel not given, fewer rows than needed, or regressors that
            cannot be separated.
    """
    equations, trials = tuple(equations), tuple(trials)
    names = coefficient_names(equations)
    for trial in trials:
        check_noise(equations, trial, noise)
    raw = [raw_rows(equations, trial) for trial in trials]
    check_regressors(equations, _joined(raw))
    freedom = np.array([_joined(raw).target.shape[1] - len(equation.terms) for equation in equations])
    values, sigma = np.zeros(len(names)), np.eye(len(equations))
    factors, density, rows = (), [], raw[0]
    for _ in range(ROUNDS):
        coefficients = dict(zip(names, values, strict=True))
        covariances = [row_covariances(equations, trial, coefficients, noise) for trial in trials]
        density = [_force_density(equations, i, raw, [one[i] for one in covariances]) for i in range(len(equations))]
        factors = tuple(tuple(map(row_factor, one, density)) for one in covariances)
        rows = _joined([whiten(one, factor) for one, factor in zip(raw, factors, strict=True)])
        mixed = mix(rows, np.linalg.cholesky(sigma))
        fitted, cov = solve(*flat(mixed))
        moved = np.abs(fitted - values) > ROUND_TOLERANCE * np.sqrt(np.diag(cov))
        values, left = fitted, rows.target - rows.design @ fitted
        sigma = left @ left.T / np.sqrt(np.outer(freedom, freedom))
        if not moved.any():
            break
    mixing, inflation = np.linalg.cholesky(sigma), np.sqrt(np.diag(sigma))
    design, target = flat(mix(rows, mixing))
    whole, count = _joined(raw), [trial.windows.centre.size for trial in trials]
    unexplained = ((whole.target - whole.design @ values) ** 2).sum(1)
    return WhitenedRows(
        names,
        design,
        target,
        np.repeat(np.arange(len(equations)), sum(count)),
        np.tile(np.repeat(np.arange(len(trials)), count), len(equations)),
        np.tile(np.concatenate([trial.windows.index for trial in trials]), len(equations)),
        inflation * np.sqrt(density),
        sigma / np.outer(inflation, inflation),
        1 - unexplained / (whole.target**2).sum(1),
        equations,
        trials,
        dict(noise),
        factors,
        mixing,
    )


def rewhitened(
    rows: WhitenedRows, trials: Sequence[TrialRows]
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Design and target of other signals in the same windows, freed of the same noise: for simulated repetitions."""
    parts = [
        whiten(raw_rows(rows.equations, trial), factor) for trial, factor in zip(trials, rows.factors, strict=True)
    ]
    return flat(mix(_joined(parts), rows.mixing))


def solve(
    design: Float[np.ndarray, "n k"], target: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Solve by least squares: return estimates, and their covariance for residuals of unit variance."""
    scale = np.linalg.norm(design, axis=0)
    _, factor = np.linalg.qr(np.column_stack([design / scale, target]))
    inverse = np.linalg.inv(factor[:-1, :-1])
    return inverse @ factor[:-1, -1] / scale, inverse @ inverse.T / np.outer(scale, scale)


def mix(rows: RawRows, mixing: Float[np.ndarray, "e e"]) -> RawRows:
    """Return the rows of each window multiplied across the equations by the inverse of a lower triangle."""
    inverse = np.linalg.inv(mixing)
    return RawRows(np.einsum("ef,fmk->emk", inverse, rows.design), inverse @ rows.target)


def flat(rows: RawRows) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Return the rows of all equations, one equation after the other."""
    return rows.design.reshape(-1, rows.design.shape[2]), rows.target.ravel()


def check_regressors(equations: Sequence[AxisEquation], rows: RawRows) -> None:
    """Check that the rows can tell the terms of each equation apart.

    Raises:
        InputError: fewer than two rows for each term, a regressor that is zero throughout, or one that others give.
    """
    start = 0
    for equation, block in zip(equations, rows.design, strict=True):
        names = [term.text for term in equation.terms]
        phi, start = block[:, start : start + len(names)], start + len(names)
        place = f"rows of axis {equation.axis}"
        if len(phi) < 2 * len(names):
            raise InputError(
                place,
                found=f"{len(phi)} rows for {len(names)} terms",
                expected=f"at least {2 * len(names)}",
                remedy="choose narrower windows or windows with overlap, give more records, or drop terms",
            )
        norm = np.linalg.norm(phi, axis=0)
        if not norm.all():
            raise InputError(
                f"{place}, term {names[int(np.argmin(norm))]}",
                found="a regressor that is zero in every row",
                expected="signals that move in the trial",
                remedy="leave the term out, or run a trial that excites it",
            )
        _check_collinear(phi / norm, names, place)


def _sensors(
    equation: AxisEquation, trial: TrialRows, values: Mapping[str, float], noise: Mapping[str, float]
) -> "scipy.sparse.csr_array":
    windows = trial.windows
    total = scipy.sparse.csr_array((windows.centre.size, windows.centre.size))
    acting = [(term, values.get(term.text, 0.0)) for term in equation.terms] + list(equation.known)
    for name in trial.signals:
        if name in trial.held or noise[name] == 0.0:
            continue
        moved = scipy.sparse.csr_array(windows.rate.shape)
        inertia = equation.inertia * (name == equation.rate + windows.suffix)
        inertia -= sum(c for term, c in acting if term.is_added_mass and name == term.signals[0] + windows.suffix)
        if inertia:
            moved = moved + inertia * windows.rate
        forces = [(term, c) for term, c in acting if c != 0.0 and not term.is_added_mass and name in term.signals]
        if forces:
            for weight, signals in zip((windows.left, windows.right), trial.ends(), strict=True):
                slope = force_slope(equation, forces, signals, name, noise[name])
                moved = moved - weight @ scipy.sparse.diags_array(slope)
        total = total + noise[name] ** 2 * (moved @ moved.T)
    return total


def _depth(matrix: "scipy.sparse.csr_array") -> int:
    """Return the number of diagonals from the main one to the most distant that is not zero."""
    row, column = map(np.asarray, matrix.nonzero())
    return int((row - column).max(initial=0)) + 1


def _band(matrix: "scipy.sparse.csr_array", depth: int) -> Float[np.ndarray, "b m"]:
    """Return the lower band of a symmetric matrix."""
    diagonals = [matrix.diagonal(-offset) for offset in range(depth)]
    return np.array([np.pad(one, (0, offset)) for offset, one in enumerate(diagonals)])


def _check_collinear(phi: Float[np.ndarray, "m j"], names: Sequence[str], place: str) -> None:
    """Refuse unit columns of which one is a combination of others, naming the pair where two suffice."""
    _, singular, right = np.linalg.svd(phi, full_matrices=False)
    if singular[-1] ** 2 > COLLINEAR * singular[0] ** 2:
        return
    cosine = np.triu(phi.T @ phi, 1)
    i, j = divmod(int(np.argmax(np.abs(cosine))), len(names))
    if 1 - abs(cosine[i, j]) < COLLINEAR * len(names):
        result = f"regressors of {names[i]} and {names[j]} with correlation {cosine[i, j]:+.10f}"
    else:
        involved = [name for name, weight in zip(names, right[-1], strict=True) if abs(weight) > 0.1]
        result = f"regressors of {', '.join(involved)} of which one is a combination of the others"
    raise InputError(
        place,
        found=result,
        expected="terms that the motion separates",
        remedy="drop one of them, or give a trial over more speeds or with other controls",
    )


def _force_density(
    equations: Sequence[AxisEquation], which: int, raw: Sequence[RawRows], covariances: Sequence[RowCovariance]
) -> float:
    """Spectral density of the white force, for sensor noise as given, by restricted maximum likelihood; 0 if none is needed.

    The overall scale of the noise is estimated along with it, so that a mistaken sensor noise is not taken for a force.
    """
    if not any(one.force.any() for one in covariances):
        return 0.0
    start = sum(len(equation.terms) for equation in equations[:which])
    own = slice(start, start + len(equations[which].terms))
    parts = [RawRows(rows.design[which : which + 1, :, own], rows.target[which : which + 1]) for rows in raw]
    equal = np.mean([one.sensors[0].mean() / one.force[0].mean() for one in covariances])

    def loss(log_share: float) -> float:
        factors = [row_factor(one, equal * np.exp(log_share)) for one in covariances]
        free = _joined([whiten(part, [factor]) for part, factor in zip(parts, factors, strict=True)])
        triangle = np.abs(np.diag(np.linalg.qr(np.column_stack([free.design[0], free.target[0]]), mode="r")))
        freedom = free.target.size - free.design.shape[2]
        return float(
            sum(np.log(factor[0]).sum() for factor in factors)
            + np.log(triangle[:-1]).sum()
            + freedom * np.log(triangle[-1])
        )

    best, least, *_ = scipy.optimize.fminbound(loss, *LOG_SHARES, xtol=0.05, full_output=True)
    return float(equal * np.exp(best)) if least < loss(-np.inf) else 0.0


def _joined(parts: Sequence[RawRows]) -> RawRows:
    return RawRows(*(np.concatenate(group, axis=1) for group in zip(*parts, strict=True)))
