"""Regression rows of the equations of motion in weak form, which needs no acceleration.

For each window k and term j

    y_k = -inertia int psi_k' x dt,   Phi_kj = int psi_k phi_j dt,   y = Phi c + e

with smooth bumps psi_k over short windows, as weights on the samples of a record (Messenger and Bortz 2021, section 2). Noise in a
regressor is averaged over the window, and its product with the noise in y vanishes on average, since psi psi' integrates to zero;
what remains of its bias falls as one over the width (regressor_noise.py estimates it). Where the acceleration was measured, rows
can be samples instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.numerics.integrate import held_mean
from seatrial.vehicles.axis_equation import AxisEquation

MIN_WINDOW_STEPS = 10  # Steps a window must have
GAP_STEPS = 1.5  # A step this many times as long as a window of the fewest steps can have is a gap


class Windows(NamedTuple):
    """Weights that turn n samples into m rows.

    Attributes:
        centre: time of each row, s, shape (m,).
        index: place of each row in a sequence without gaps, shape (m,).
        left: on regressors with the control that begins at each sample, shape (m, n).
        right: on regressors with the control that ends at each sample, shape (m, n).
        rate: on the signal whose rate is sought, shape (m, n).
        white: on independent numbers of unit variance, for a white force of unit spectral density; zero if that cannot be told
            from noise of the sensors, for samples and for windows without overlap, shape (m, n).
        suffix: what to append to a velocity for the channel that `rate` acts on: nothing, or `dot` where that is measured.
    """

    centre: Float[np.ndarray, " m"]
    index: Int[np.ndarray, " m"]
    left: "scipy.sparse.csr_array"
    right: "scipy.sparse.csr_array"
    rate: "scipy.sparse.csr_array"
    white: "scipy.sparse.csr_array"
    suffix: str


@dataclass(frozen=True, eq=False)
class TrialRows:
    """One trial as the regression sees it: n samples, m rows for each equation.

    Attributes:
        label: of the record.
        signals: by name, shape (n,) each; 0 if not measured, which no row touches.
        held: names of those that are controls, held over each step and exactly known.
        step: time to the next sample, s, shape (n,).
        windows: weights of the rows.
    """

    label: str
    signals: Mapping[str, Float[np.ndarray, " n"]]
    held: frozenset[str]
    step: Float[np.ndarray, " n"]
    windows: Windows

    def ends(self) -> tuple[dict[str, Float[np.ndarray, " n"]], dict[str, Float[np.ndarray, " n"]]]:
        """Signals at each sample with the control that begins there, and with the one that ends there."""
        ending = {
            name: np.append(values[:1], values[:-1]) if name in self.held else values
            for name, values in self.signals.items()
        }
        return dict(self.signals), ending


class RawRows(NamedTuple):
    """Rows of one trial before whitening, for e equations and all k coefficients; m rows for each equation."""

    design: Float[np.ndarray, "e m k"]
    target: Float[np.ndarray, "e m"]


def bump_windows(
    time: Float[np.ndarray, " n"], present: Bool[np.ndarray, " n"], width: float, overlap: bool, label: str
) -> Windows:
    """Return the windows of a given width, each beginning where the one before is at its middle, or at its end without overlap.

    Args:
        time: s, shape (n,).
        present: where every signal was measured; windows that touch a gap are dropped, shape (n,).
        width: s.
        overlap: whether neighbouring windows overlap by half.
        label: of the record, for errors.

    Raises:
        InputError: windows wider than the record or of too few samples, or gaps in all of them.
    """
    place = f'record "{label}", windows of {width:g} s'
    length, step = float(time[-1] - time[0]), np.diff(time)
    usual = float(np.median(step))
    if not usual * MIN_WINDOW_STEPS * (1 - 1e-9) <= width <= length:
        raise InputError(
            place,
            found=f"a record of {length:g} s in steps of {usual:g} s",
            expected=f"at least {MIN_WINDOW_STEPS} steps in a window, and a window in the record",
            remedy=f"choose a width from {usual * MIN_WINDOW_STEPS:g} to about {length / 10:g} s",
        )
    spacing = width / 2 if overlap else width
    centres = time[0] + width / 2 + spacing * np.arange(int((length - width) / spacing + 1e-9) + 1)
    share = np.convolve(step, [0.5, 0.5])
    kept, rows, columns, weights = [], [], [], ([], [], [], [])
    for index, centre in enumerate(centres):
        edges = [centre - width / 2 * (1 - 1e-9), centre + width / 2 * (1 - 1e-9)]
        inside = np.arange(np.searchsorted(time, edges[0], "right") - 1, np.searchsorted(time, edges[1]) + 1)
        if not present[inside].all() or step[inside[:-1]].max() > GAP_STEPS * width / MIN_WINDOW_STEPS:
            continue
        rows.append(np.full(inside.size, len(kept)))
        columns.append(inside)
        kept.append(index)
        for store, part in zip(weights, _integrals(time[inside] - centre, width), strict=False):
            store.append(part)
        bump = np.cos(np.clip(np.pi * (time[inside] - centre) / width, -np.pi / 2, np.pi / 2)) ** 2
        weights[3].append(overlap * bump * np.sqrt(share[inside]))
    if not kept:
        raise InputError(
            place,
            found=f"gaps in every one of {centres.size} windows",
            expected="stretches with all signals at every sample",
            remedy="import the record at the step of its slowest sensor, or choose narrower windows",
        )
    at = (np.concatenate(rows), np.concatenate(columns))
    left, right, rate, white = (
        scipy.sparse.csr_array((np.concatenate(weight), at), shape=(len(kept), time.size)) for weight in weights
    )
    return Windows(centres[kept], np.array(kept), left, right, rate, white, "")


def samples(time: Float[np.ndarray, " n"], present: Bool[np.ndarray, " n"], label: str) -> Windows:
    """Return each sample a separate row, for accelerations that were measured.

    Raises:
        InputError: no sample with all signals.
    """
    kept = np.flatnonzero(present)
    if not kept.size:
        raise InputError(
            f'record "{label}"',
            found="no sample with all signals",
            expected="velocities and accelerations at the same instants",
            remedy="import the record at the step of its slowest sensor, or use windows, which need no acceleration",
        )
    one = scipy.sparse.csr_array((np.ones(kept.size), (np.arange(kept.size), kept)), shape=(kept.size, time.size))
    nothing = scipy.sparse.csr_array(one.shape)
    return Windows(time[kept], kept, one, nothing, one, nothing, "dot")


def weak_trials(
    records: Sequence[Record], equations: Sequence[AxisEquation], width: float, overlap: bool = True
) -> tuple[TrialRows, ...]:
    """Return the trials in weak form. Windows that touch a gap in any signal of any equation are dropped.

    Args:
        records: trials with the velocities that the equations name, as measured or smoothed.
        equations: of one or several axes.
        width: of the windows, s: about the time in which the motion changes. Wider ones average more noise and leave fewer rows.
        overlap: whether neighbouring windows share half their width; without, rows are fewer and nearer to independent.

    Raises:
        InputError: a signal that was not measured, or no window without gaps.
    """

    def windows_of(time: np.ndarray, present: np.ndarray, label: str) -> Windows:
        return bump_windows(time, present, width, overlap, label)

    return tuple(_trial(record, equations, "", windows_of) for record in records)


def where_measured(record: Record, channels: Sequence[str]) -> Record:
    """Return the record at the samples where all of these channels were measured, controls averaged from each to the next.

    For sensors slower than the record. A gap becomes one long step, which no window spans.

    Raises:
        InputError: fewer than two such samples, or a channel that the record lacks.
    """
    complete = np.flatnonzero(np.isfinite(np.column_stack([record.channel(name) for name in channels])).all(1))
    if complete.size < 2:
        raise InputError(
            f'record "{record.label}"',
            found=f"{complete.size} samples at which {', '.join(channels)} were all measured",
            expected="two at least",
            remedy="import the record at the step of its slowest sensor, or leave a channel out",
        )
    edges = np.append(record.time[complete], record.time[-1] + record.step[-1])
    control = np.column_stack(
        [np.empty((complete.size, 0)), *(held_mean(record.time, one, edges) for one in record.control.T)]
    )
    return replace(record, time=record.time[complete], control=control, measurement=record.measurement[complete])


def pointwise_trials(records: Sequence[Record], equations: Sequence[AxisEquation]) -> tuple[TrialRows, ...]:
    """Return the trials with a row at each sample where the accelerations (udot, …) and all signals were measured.

    Raises:
        InputError: a signal or acceleration that was not measured, or never together with the others.
    """
    return tuple(_trial(record, equations, "dot", samples) for record in records)


def coefficient_names(equations: Sequence[AxisEquation]) -> tuple[str, ...]:
    """Return the names of all coefficients, the columns of the design."""
    return tuple(term.text for equation in equations for term in equation.terms)


def raw_rows(equations: Sequence[AxisEquation], trial: TrialRows) -> RawRows:
    """Return the rows of one trial, in the units of force or acceleration times seconds; each equation has its own block of columns."""
    windows, (beginning, ending) = trial.windows, trial.ends()

    def row(equation: AxisEquation, term) -> Float[np.ndarray, " m"]:
        if term.is_added_mass:
            return windows.rate @ trial.signals[term.factors[0].signal + windows.suffix]
        return windows.left @ equation.regressor(term, beginning) + windows.right @ equation.regressor(term, ending)

    names = coefficient_names(equations)
    design = np.zeros((len(equations), windows.centre.size, len(names)))
    target = np.empty(design.shape[:2])
    for i, equation in enumerate(equations):
        target[i] = equation.inertia * (windows.rate @ trial.signals[equation.rate + windows.suffix])
        for term in equation.terms:
            design[i, :, names.index(term.text)] = row(equation, term)
        for term, value in equation.known:
            target[i] -= value * row(equation, term)
    return RawRows(design, target)


def _integrals(t: Float[np.ndarray, " s"], width: float) -> tuple[Float[np.ndarray, " s"], ...]:
    """Weights of samples at times t from a window's centre: left, right and rate, each step's part of the bump integrated exactly."""
    inside, turn = np.clip(t, -width / 2, width / 2), 2 * np.pi / width
    area = np.diff(inside / 2 + np.sin(turn * inside) / (2 * turn))
    moment = np.diff(
        inside**2 / 4 + inside * np.sin(turn * inside) / (2 * turn) + np.cos(turn * inside) / (2 * turn**2)
    )
    step = np.diff(t)
    left, right = (t[1:] * area - moment) / step, (moment - t[:-1] * area) / step
    return np.append(left, 0.0), np.append(0.0, right), np.append(0.0, area / step) - np.append(area / step, 0.0)


def _trial(record: Record, equations: Sequence[AxisEquation], suffix: str, windows_of) -> TrialRows:
    needed: dict[str, str] = {}
    for equation in equations:
        needed.setdefault(equation.rate + suffix, f"the rate of {equation.rate}, axis {equation.axis}")
        for term in [*equation.terms, *(term for term, _ in equation.known)]:
            dot = suffix if term.is_added_mass else ""
            for signal in term.signals:
                needed.setdefault(signal + dot, f"the term {term}")
    for signal, why in needed.items():
        if signal not in (*record.controls, *record.measured):
            raise InputError(
                f'record "{record.label}"',
                found=f'no channel "{signal}", which {why} needs',
                expected="one of " + ", ".join(record.controls + record.measured),
                remedy="leave the term out, or map the channel when importing"
                + (", or use windows, which need no acceleration" if signal.endswith("dot") else ""),
            )
    columns = {signal: np.asarray(record.channel(signal), float) for signal in needed}
    present = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    windows = windows_of(record.time, present, record.label)
    signals = {name: np.where(np.isfinite(column), column, 0.0) for name, column in columns.items()}
    return TrialRows(record.label, signals, frozenset(record.controls) & set(needed), record.step, windows)
