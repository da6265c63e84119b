"""Reads what all designs of a campaign share: the control they drive, its trim, and their timing."""

from typing import TYPE_CHECKING

from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import signal_unit
from seatrial.manoeuvres.family import Family

if TYPE_CHECKING:
    from seatrial.campaign.config import Campaign

MOST_SAMPLES = 200_000
"""Samples of a designed trial: beyond, a sweep no longer fits the memory of a laptop."""


def read_family(campaign: "Campaign") -> Family:
    """Control, trim and timing of `[design]`; each shape is a copy of it.

    Raises:
        InputError: a control the vehicle lacks, or times that do not fit each other.
    """
    table = campaign.source.design
    controls = campaign.model(campaign.full).controls
    if table.control not in controls:
        raise InputError(
            campaign.where("design.control"),
            found=f'"{table.control}"',
            expected="a control of the vehicle: " + ", ".join(controls),
            remedy=nearest(table.control, controls),
        )
    unit = signal_unit(table.control)
    trim = (
        campaign.hull.trim.get(table.control, 0.0)
        if table.trim is None
        else campaign.si(table.trim, unit, "design.trim")
    )
    seconds = {
        key: campaign.si(getattr(table, key), "s", f"design.{key}")
        for key in ("duration", "active", "sample_time", "start", "ramp")
    }
    for key in ("active", "start", "ramp"):
        if seconds[key] < 0 or (key == "active" and seconds[key] == 0):
            raise InputError(
                campaign.where(f"design.{key}"),
                found=getattr(table, key),
                expected="more than 0 s" if key == "active" else "0 s or more",
                remedy='for example "40 s"' if key == "active" else "correct it, or leave the key out",
            )
    family = Family(table.control, trim, **seconds)
    if not family.duration > 0:
        raise InputError(
            campaign.where("design.duration"),
            found=f"{family.duration:g} s",
            expected="more than 0",
            remedy='for example "60 s"',
        )
    if not 0 < family.sample_time <= family.duration / 10:
        raise InputError(
            campaign.where("design.sample_time"),
            found=f"{family.sample_time:g} s",
            expected="more than 0 and a tenth of the duration at most",
            remedy='for example "0.02 s"',
        )
    samples = round(family.duration / family.sample_time)
    if samples > MOST_SAMPLES:
        raise InputError(
            campaign.where("design.sample_time"),
            found=f"{samples} samples in a trial of {family.duration:g} s",
            expected=f"at most {MOST_SAMPLES}",
            remedy="use a longer sample time: a hundredth of the fastest time constant is enough",
        )
    if family.start + family.active > family.duration * (1 + 1e-9):
        raise InputError(
            campaign.where("design.active"),
            found=f"start {family.start:g} s + active {family.active:g} s",
            expected=f"an end within the duration, {family.duration:g} s",
            remedy="lengthen the duration or shorten `active`",
        )
    return family
