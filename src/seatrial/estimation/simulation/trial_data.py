"""Trials as arrays: several of them stacked, all padded to one length with samples that take no time and measure nothing.

There are eight such lengths between a power of two and the next, so that trials of about one length share compiled code.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from seatrial.compiled.batching import bucket_length, filled
from seatrial.core.record import Record
from seatrial.vehicles.model import VehicleModel

FOREVER = 1e12  # Time since a measurement that was never made, s: its memory is zero, and so are its derivatives


class ChannelData(NamedTuple):
    """Measurements of one channel in a trial of n samples, of whose gaps between measurements k are distinct.

    Attributes:
        measured: what the sensor showed, 0 if missing, shape (n,).
        present: 1 if measured, 0 if missing, shape (n,).
        gaps: distinct times since the measurement before, s, `FOREVER` for the first, shape (k,).
        counts: how many measurements follow each gap, shape (k,).
        kind: which of the gaps precedes each sample, 0 if missing, shape (n,).
    """

    measured: Float[Array, " n"]
    present: Float[Array, " n"]
    gaps: Float[Array, " k"]
    counts: Float[Array, " k"]
    kind: Int[Array, " n"]


class TrialData(NamedTuple):
    """Arrays of one trial of n samples; stacked, every array has the trials as its first axis.

    Attributes:
        control: one array of shape (n,) for each control.
        channels: measurements of each channel.
        step: time to the next sample, s, shape (n,).
        initial: states at the first sample where they are not estimated, shape (n_states,).
    """

    control: tuple[Float[Array, " n"], ...]
    channels: tuple[ChannelData, ...]
    step: Float[Array, " n"]
    initial: Float[Array, " n_states"]

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """Time of each sample, s from the first."""
        step = np.asarray(self.step)
        return np.cumsum(step, -1) - step


def stack_trials(
    records: Sequence[Record], model: VehicleModel, channels: Sequence[str], initial: Sequence[Sequence[float]]
) -> TrialData:
    """Return the arrays of several trials, of one bucket's samples each, so that compiled code does not grow with their number.

    Args:
        records: trials, of any lengths.
        model: vehicle whose controls the records have.
        channels: measured channels, in order.
        initial: state at the start of each trial, shape (trials, states).

    Raises:
        InputError: a control or channel a record does not have.
    """
    samples = bucket_length(max(record.time.size for record in records))
    trials = [_trial(record, model, channels, start, samples) for record, start in zip(records, initial, strict=True)]

    def stack(*arrays: np.ndarray) -> np.ndarray:
        return np.stack([filled(array, max(array.size for array in arrays), 0.0) for array in arrays])

    stacked = jax.tree.map(stack, *trials)
    channels_of_all = tuple(one._replace(gaps=np.where(one.counts > 0, one.gaps, FOREVER)) for one in stacked.channels)
    return jax.device_put(stacked._replace(channels=channels_of_all))


def first_samples(data: TrialData, samples: int) -> TrialData:
    """Return so many samples of the beginning of every trial."""

    def cut(array: Array) -> np.ndarray:
        return np.asarray(array)[:, :samples]

    def cut_channel(whole: ChannelData) -> ChannelData:
        present, kind = cut(whole.present), cut(whole.kind)
        size = whole.gaps.shape[1]
        counts = [np.bincount(k[p > 0], minlength=size) for k, p in zip(kind, present, strict=True)]
        return whole._replace(measured=cut(whole.measured), present=present, kind=kind, counts=np.array(counts, float))

    control, channels = tuple(map(cut, data.control)), tuple(map(cut_channel, data.channels))
    return jax.device_put(data._replace(control=control, channels=channels, step=cut(data.step)))


def only_measured(data: TrialData, kept: Sequence[Bool[np.ndarray, "trials n"]]) -> list[TrialData]:
    """Return the same trials several times, each with the measurements of some of its samples only, as arrays of one shape."""
    time = data.time

    def masked(whole: ChannelData, keep: np.ndarray) -> list[ChannelData]:
        columns = np.where(keep & (np.asarray(whole.present) > 0), np.asarray(whole.measured), np.nan)
        return [channel_data(*one) for one in zip(time, columns, strict=True)]

    made = [[masked(whole, keep) for whole in data.channels] for keep in kept]
    sizes = [max(one.gaps.size for of_mask in made for one in of_mask[c]) for c in range(len(data.channels))]

    def stacked(trials: Sequence[ChannelData], size: int) -> ChannelData:
        even = [
            one._replace(gaps=filled(one.gaps, size, FOREVER), counts=filled(one.counts, size, 0.0)) for one in trials
        ]
        return ChannelData(*(np.stack(arrays) for arrays in zip(*even, strict=True)))

    return [jax.device_put(data._replace(channels=tuple(map(stacked, of_mask, sizes)))) for of_mask in made]


def _trial(
    record: Record, model: VehicleModel, channels: Sequence[str], initial: Sequence[float], samples: int
) -> TrialData:
    shown = [channel_data(record.time, np.asarray(record.channel(name))) for name in channels]
    return TrialData(
        control=tuple(filled(np.asarray(record.channel(name)), samples, 0.0) for name in model.controls),
        channels=tuple(
            one._replace(
                measured=filled(one.measured, samples, 0.0),
                present=filled(one.present, samples, 0.0),
                kind=filled(one.kind, samples, 0.0),
            )
            for one in shown
        ),
        step=filled(np.asarray(record.step), samples, 0.0),
        initial=np.asarray(initial, float),
    )


def channel_data(time: Float[np.ndarray, " n"], column: Float[np.ndarray, " n"]) -> ChannelData:
    """Return the arrays of one channel, NaN if it was not measured; gaps equal to the nanosecond are one, their mean."""
    present = np.isfinite(column)
    between = np.concatenate([[FOREVER], np.diff(time[present])])[: present.sum()]
    _, which, counts = np.unique(np.round(between, 9), return_inverse=True, return_counts=True)
    kind = np.zeros(column.size, int)
    kind[present] = which
    return ChannelData(
        np.where(present, column, 0.0),
        present.astype(float),
        np.bincount(which, between) / counts,
        counts.astype(float),
        kind,
    )
