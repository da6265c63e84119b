"""Covariance of regression rows by sensor noise and by a white force, and rows freed of it.

Noise eps_s in signal s moves the residuals of an equation by L_s eps_s, with

    L_s = inertia [s is the velocity] d/dt - sum_j c_j dphi_j/ds,   C = sum_s sigma_s^2 L_s L_s' + Q int psi psi'

weighted by the windows, so that C is banded; c is that of the fit before, as in the weak form of errors in variables
(Bortz, Messenger and Dukic, Bull. Math. Biol. 85, 2023). Q is the spectral density of a white force that no term gives: what
process noise is to a filter. Rows are multiplied by the inverse of the Cholesky factor of C.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.linalg import LinAlgError, cholesky_banded, solve_banded

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.estimation.weak_form import RawRows, TrialRows
from seatrial.filters.noise import noise_from_high_pass
from seatrial.vehicles.axis_equation import AxisEquation


class RowCovariance(NamedTuple):
    """Covariance of the m rows of an equation in lower banded storage: by the sensors, and by a white force of density 1."""

    sensors: Float[np.ndarray, "b m"]
    force: Float[np.ndarray, "b m"]


def sensor_noise(records: Sequence[Record], channels: Sequence[str]) -> dict[str, float]:
    """White noise of measured channels from the records themselves, by high-pass filtering: the root of the mean variance.

    Raises:
        InputError: too few samples, or a sensor whose steps are coarser than its noise.
    """
    found = {}
    for name in channels:
        sds = [noise_from_high_pass(record.time, record.channel(name)).sd for record in records]
        found[name] = float(np.sqrt(np.mean(np.square(sds))))
    return found


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
                expected="a standard deviation" + (" above zero: rows are weighed by it" if name in rates else ""),
                remedy="state it from the sensor's data sheet, or take it from the record with `sensor_noise`",
            )


def row_covariances(
    equations: Sequence[AxisEquation], trial: TrialRows, values: Mapping[str, float], noise: Mapping[str, float]
) -> tuple[RowCovariance, ...]:
    """Covariance of the rows of one trial, for each equation.

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
    """Cholesky factor of the covariance with a white force of spectral density `process`, in lower banded storage.

    Raises:
        NumericalError: windows of which one is a combination of others.
    """
    try:
        return cholesky_banded(covariance.sensors + process * covariance.force, lower=True)
    except LinAlgError as error:
        raise NumericalError(
            "the noise of some windows is a combination of that of others: take windows without overlap, or of another width"
        ) from error


def whiten(raw: RawRows, factors: Sequence[Float[np.ndarray, "b m"]]) -> RawRows:
    """Rows multiplied by the inverse of each equation's factor."""
    table = np.concatenate([raw.design, raw.target[:, :, None]], axis=2)
    free = np.stack([solve_banded((len(f) - 1, 0), f, part) for f, part in zip(factors, table, strict=True)])
    return RawRows(free[:, :, :-1], free[:, :, -1])


def force_slope(
    equation: AxisEquation,
    forces: Sequence[tuple[CoefficientName, float]],
    signals: Mapping[str, Float[np.ndarray, " n"]],
    name: str,
    sd: float,
) -> Float[np.ndarray, " n"]:
    """Derivative of the force with respect to one signal, over a step of the size of its noise, as moduli ask for."""
    above, below = ({**signals, name: signals[name] + shift} for shift in (sd, -sd))
    slope = np.zeros(signals[name].size)
    for term, value in forces:
        slope += value * (equation.regressor(term, above) - equation.regressor(term, below)) / (2 * sd)
    return slope


def _sensors(
    equation: AxisEquation, trial: TrialRows, values: Mapping[str, float], noise: Mapping[str, float]
) -> sparse.csr_array:
    windows = trial.windows
    total = sparse.csr_array((windows.centre.size, windows.centre.size))
    acting = [(term, values.get(term.text, 0.0)) for term in equation.terms] + list(equation.known)
    for name in trial.signals:
        if name in trial.held or noise[name] == 0.0:
            continue
        moved = sparse.csr_array(windows.rate.shape)
        inertia = equation.inertia * (name == equation.rate + windows.suffix)
        inertia -= sum(c for term, c in acting if term.is_added_mass and name == term.signals[0] + windows.suffix)
        if inertia:
            moved = moved + inertia * windows.rate
        forces = [(term, c) for term, c in acting if c != 0.0 and not term.is_added_mass and name in term.signals]
        if forces:
            for weight, signals in zip((windows.left, windows.right), trial.ends(), strict=True):
                slope = force_slope(equation, forces, signals, name, noise[name])
                moved = moved - weight @ sparse.diags_array(slope)
        total = total + noise[name] ** 2 * (moved @ moved.T)
    return total


def _depth(matrix: sparse.csr_array) -> int:
    """Number of diagonals from the main one to the farthest that is not zero."""
    row, column = map(np.asarray, matrix.nonzero())
    return int((row - column).max(initial=0)) + 1


def _band(matrix: sparse.csr_array, depth: int) -> Float[np.ndarray, "b m"]:
    """Lower band of a symmetric matrix."""
    diagonals = [matrix.diagonal(-offset) for offset in range(depth)]
    return np.array([np.pad(one, (0, offset)) for offset, one in enumerate(diagonals)])
