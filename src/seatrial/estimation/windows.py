r"""Test functions of the weak form: smooth bumps over short windows, as weights on the samples of a record.

    psi(t) = cos^2(pi (t - centre) / width) in the window, zero outside
    int psi (dx/dt) dt = -int psi' x dt,   int psi phi dt

(Messenger and Bortz, Weak SINDy, Multiscale Model. Simul. 19, 2021). Where windows overlap by half, these bumps add up to one: no
part of the record counts less than another, and slow motion, which tells most about drag, is not lost; without overlap
coefficients come out several times less certain. Integrals take velocities and regressors as straight lines over each step, at both of
whose ends a regressor has the control that is held over it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from seatrial.core.errors import InputError

FEWEST = 10
"""Steps a window must have."""
LONGEST = 1.5
"""A step this many times as long as a window of the fewest steps can have is a gap."""


class Windows(NamedTuple):
    """Weights that turn n samples into m rows.

    Attributes:
        centre: time of each row, s, shape (m,).
        index: place of each row in a sequence without gaps, shape (m,).
        left: on regressors with the control that begins at each sample, shape (m, n).
        right: on regressors with the control that ends at each sample, shape (m, n).
        rate: on the signal whose rate is sought, shape (m, n).
        white: on independent numbers of unit variance, for a white force of unit spectral density; zero where that cannot be told
            from noise of the sensors, for samples and for windows without overlap, shape (m, n).
        suffix: what to append to a velocity for the channel that `rate` acts on: nothing, or `dot` where that is measured.
    """

    centre: Float[np.ndarray, " m"]
    index: Int[np.ndarray, " m"]
    left: sparse.csr_array
    right: sparse.csr_array
    rate: sparse.csr_array
    white: sparse.csr_array
    suffix: str


def bump_windows(
    time: Float[np.ndarray, " n"], present: Bool[np.ndarray, " n"], width: float, overlap: bool, label: str
) -> Windows:
    """Windows of a given width, each beginning where the one before is at its middle, or at its end without overlap.

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
    if not usual * FEWEST * (1 - 1e-9) <= width <= length:
        raise InputError(
            place,
            found=f"a record of {length:g} s in steps of {usual:g} s",
            expected=f"at least {FEWEST} steps in a window, and a window in the record",
            remedy=f"choose a width from {usual * FEWEST:g} to about {length / 10:g} s",
        )
    spacing = width / 2 if overlap else width
    centres = time[0] + width / 2 + spacing * np.arange(int((length - width) / spacing + 1e-9) + 1)
    share = np.convolve(step, [0.5, 0.5])
    kept, rows, columns, weights = [], [], [], ([], [], [], [])
    for index, centre in enumerate(centres):
        edges = [centre - width / 2 * (1 - 1e-9), centre + width / 2 * (1 - 1e-9)]
        inside = np.arange(np.searchsorted(time, edges[0], "right") - 1, np.searchsorted(time, edges[1]) + 1)
        if not present[inside].all() or step[inside[:-1]].max() > LONGEST * width / FEWEST:
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
            expected="stretches in which every signal was measured at every sample",
            remedy="import the record at the step of its slowest sensor, or choose narrower windows",
        )
    at = (np.concatenate(rows), np.concatenate(columns))
    left, right, rate, white = (
        sparse.csr_array((np.concatenate(weight), at), shape=(len(kept), time.size)) for weight in weights
    )
    return Windows(centres[kept], np.array(kept), left, right, rate, white, "")


def samples(time: Float[np.ndarray, " n"], present: Bool[np.ndarray, " n"], label: str) -> Windows:
    """Each sample a row of its own, for accelerations that were measured.

    Raises:
        InputError: no sample at which every signal was measured.
    """
    kept = np.flatnonzero(present)
    if not kept.size:
        raise InputError(
            f'record "{label}"',
            found="no sample at which every signal was measured",
            expected="velocities and accelerations at the same instants",
            remedy="import the record at the step of its slowest sensor, or use windows, which need no acceleration",
        )
    one = sparse.csr_array((np.ones(kept.size), (np.arange(kept.size), kept)), shape=(kept.size, time.size))
    nothing = sparse.csr_array(one.shape)
    return Windows(time[kept], kept, one, nothing, one, nothing, "dot")


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
