"""Duty of an actuator in a trial: how long it works away from trim, and how often it is sent to the other side.

Motors heat up and gears wear by these two, whatever the amplitude and the rate of change, which `Limits` bound.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Duty:
    """Bounds of an actuator's duty; None where there is no bound.

    Attributes:
        trim: control at trim, SI.
        band: change from trim up to which the actuator counts as idle, SI; for example a tenth of the largest change.
        share: largest share of the trial away from trim, from 0 to 1.
        reversals: most changes from one side of trim to the other, per minute.
    """

    trim: float
    band: float
    share: float | None = None
    reversals: float | None = None


def away_share(control: Float[np.ndarray, "*any n"], trim: float, band: float) -> Float[np.ndarray, "*any"]:
    """Share of the samples whose change from trim exceeds the band, along the last axis."""
    return (np.abs(np.asarray(control) - trim) > band).mean(-1)


def reversals_per_minute(
    control: Float[np.ndarray, "*any n"], trim: float, band: float, sample_time: float
) -> Float[np.ndarray, "*any"]:
    """How often a minute the control leaves one side of the band and next leaves the other, along the last axis.

    Chatter inside the band is none, and a stay there between the two sides does not hide a reversal.
    """
    control = np.asarray(control)
    side = np.where(np.abs(control - trim) > band, np.sign(control - trim), 0.0)
    # Index of the last sample outside the band, so far; sample 0 stands for none.
    last = np.maximum.accumulate(np.where(side != 0, np.arange(control.shape[-1]), 0), axis=-1)
    lasting = np.take_along_axis(side, last, -1)
    count = (lasting[..., 1:] * lasting[..., :-1] < 0).sum(-1)
    return count * 60.0 / (control.shape[-1] * sample_time)


def duty_excess(duty: Duty, control: Float[np.ndarray, " n"], sample_time: float) -> dict[str, tuple[float, float]]:
    """Bounds that a control breaks: name to (value found, bound), as `Limits.excess` tells them. Empty where all hold.

    Args:
        duty: bounds.
        control: sampled control, SI.
        sample_time: s.
    """
    found = {
        "share away from trim": (float(away_share(control, duty.trim, duty.band)), duty.share),
        "reversals per minute": (
            float(reversals_per_minute(control, duty.trim, duty.band, sample_time)),
            duty.reversals,
        ),
    }
    return {
        name: (value, bound)
        for name, (value, bound) in found.items()
        if bound is not None and value > bound * (1 + 1e-9)
    }
