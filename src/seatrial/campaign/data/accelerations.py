"""Measured channels of a campaign's records smoothed, with their rates: as a table beside the campaign, and in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seatrial.core.errors import InputError, nearest
from seatrial.core.files import write_text
from seatrial.core.record import Record
from seatrial.core.signals import RATES, is_signal, signal_unit
from seatrial.estimation.regression.accelerations import Smoothed, smooth

RATE = "dot"  # Ending of a channel's rate: `udot` is that of `u`


@dataclass(frozen=True, eq=False)
class SmoothedChannel:
    """One channel of a record.

    Attributes:
        name: of the channel.
        smoothed: it and its rate, SI.
        stated: standard deviation of its sensor's noise as the campaign states it, SI; None if it does not.
        used: whether that was used, the noise being hidden by the motion.
    """

    name: str
    smoothed: Smoothed
    stated: float | None
    used: bool

    @property
    def line(self) -> str:
        """What was found, in one line, SI."""
        smoothed, unit = self.smoothed, signal_unit(self.name)
        source = "as stated, hidden by the motion" if self.used else "found"
        if self.stated is not None and not self.used:
            source += f", {self.stated:.3g} stated"
        end = "; ".join(smoothed.complaints) or "white innovations"
        return (
            f"{self.name}: noise {smoothed.noise:.3g} {unit} ({source}), {self.name}{RATE} +- {np.median(smoothed.rate_sd):.3g} "
            f"{rate_unit(self.name)}, motion up to {smoothed.bandwidth:.3g} Hz; {end}"
        )


def smooth_channels(noise: Mapping[str, float], record: Record, names: Sequence[str]) -> list[SmoothedChannel]:
    """Smooth some channels of a record; where a channel's noise cannot be found, with that of its sensor, SI.

    Raises:
        InputError: no such measured channel, or one with too few samples.
    """
    return [_smooth_channel(record, name, noise.get(name)) for name in names]


def check_names(record: Record, names: Sequence[str], where: str) -> None:
    """Check that channels are measured, if only to be given to the equations of others.

    Raises:
        InputError: naming the first that is not.
    """
    measured = [*record.measured, *(name for name in record.controls if name in RATES)]
    for name in names:
        if name not in measured:
            raise InputError(
                where,
                found=f'"{name}", which is no measured channel of record "{record.label}"',
                expected=f"one or several of {', '.join(measured)}, with commas between",
                remedy=nearest(name, measured),
            )


def write_accelerations(folder: Path, record: Record, channels: Sequence[SmoothedChannel]) -> Path:
    """Write `accelerations-LABEL.csv` in a campaign's folder, atomically, and return its path.

    A row for each sample of the record, SI: time, and for each channel its value and rate, each followed by its standard deviation.
    """
    head, columns = ["time_s"], [record.time]
    for channel in channels:
        name, smoothed = channel.name, channel.smoothed
        for text, unit in ((name, signal_unit(name)), (name + RATE, rate_unit(name))):
            head += [f"{text} [{unit}]", f"{text}_sd [{unit}]"]
        columns += [smoothed.value, smoothed.value_sd, smoothed.rate, smoothed.rate_sd]
    rows = [",".join([f"{row[0]:.6f}", *(f"{value:.8g}" for value in row[1:])]) for row in np.column_stack(columns)]
    path = folder / f"accelerations-{record.label}.csv"
    write_text(path, "\n".join([",".join(head), *rows]) + "\n")
    return path


def rate_unit(name: str) -> str:
    """SI unit of a channel's rate."""
    return signal_unit(name + RATE) if is_signal(name + RATE) else f"({signal_unit(name)})/s"


def _smooth_channel(record: Record, name: str, stated: float | None) -> SmoothedChannel:
    where, values = f'record "{record.label}", channel "{name}"', record.channel(name)
    smoothed = smooth(record.time, values, where=where)
    used = smoothed.hidden and stated is not None
    if used:
        smoothed = smooth(record.time, values, stated, where=where)
    return SmoothedChannel(name, smoothed, stated, used)
