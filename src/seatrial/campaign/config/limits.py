"""Limits and power of a campaign file in SI: of the designed control, of the motion, of the battery."""

from math import inf
from typing import TYPE_CHECKING

from seatrial.campaign.config.schema import LimitsTable
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import signal_unit
from seatrial.design.motion_limits import Advance, Distance, MotionLimit, StateBound
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits

if TYPE_CHECKING:
    from seatrial.campaign.config.campaign import Campaign


# Reads what all designs of a campaign share: the control they drive, its trim, and their timing.

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


TRACKS = ("distance", "advance")
"""Limits of the way travelled, m."""


def read_control_limits(campaign: "Campaign") -> Limits:
    """Limits of the designed control.

    Raises:
        InputError: a name that is neither the control nor a quantity of the motion, units that do not fit, or lower above upper.
    """
    control = campaign.source.design.control
    states = campaign.model(campaign.full).states
    known = [control, *states, *TRACKS]
    for name in campaign.source.limits:
        if name not in known:
            raise InputError(
                campaign.where(f"limits.{name}"),
                found=f'"{name}"',
                expected="the designed control, a state or a track: " + ", ".join(known),
                remedy=nearest(name, known),
            )
    table = campaign.source.limits.get(control)
    if table is None:
        return Limits()
    lower, upper = _bounds(campaign, control, table, signal_unit(control))
    rate = None if table.rate is None else campaign.si(table.rate, f"{_text(control)}/s", f"limits.{control}.rate")
    return Limits(None if lower == -inf else lower, None if upper == inf else upper, rate)


def read_motion_limits(campaign: "Campaign") -> tuple[MotionLimit, ...]:
    """Limits of the motion, in the order of the file.

    Raises:
        InputError: a rate, a lower bound of the distance, no bound at all, units that do not fit, or lower above upper.
    """
    found: list[MotionLimit] = []
    for name, table in campaign.source.limits.items():
        if name == campaign.source.design.control:
            continue
        if (
            table.rate is not None
            or (table.lower is None and table.upper is None)
            or (name == "distance" and (table.upper is None or table.lower is not None))
        ):
            raise InputError(
                campaign.where(f"limits.{name}"),
                found=", ".join(key for key in ("lower", "upper", "rate") if getattr(table, key) is not None)
                or "no bound",
                expected="upper" if name == "distance" else "lower, upper or both",
                remedy="rates are limited of controls only",
            )
        lower, upper = _bounds(campaign, name, table, "m" if name in TRACKS else signal_unit(name))
        if name == "distance":
            found.append(Distance(upper))
        else:
            found.append(Advance(lower, upper) if name == "advance" else StateBound(name, lower, upper))
    return tuple(found)


def read_power(campaign: "Campaign") -> tuple[float, float, float]:
    """Propulsion, W, the control at which it is drawn, SI, and the hotel load, W.

    Raises:
        InputError: no table, a control that is no propeller, or numbers that are not positive.
    """
    table = campaign.source.power
    if campaign.source.design.control != "n":
        raise InputError(
            campaign.where("design.per"),
            found=f'"joule" with the control {campaign.source.design.control}',
            expected="the propeller n, whose power grows with its cube",
            remedy='set per = "trial"',
        )
    if table is None:
        raise InputError(
            campaign.where("design.per"),
            found='"joule" without [power]',
            expected="what the vehicle draws",
            remedy='add [power] with hotel = "20 W", propulsion = "40 W" and at = "1500 rpm"',
        )
    unit = signal_unit(campaign.source.design.control)
    power = campaign.si(table.propulsion, "W", "power.propulsion")
    at, hotel = campaign.si(table.at, unit, "power.at"), campaign.si(table.hotel, "W", "power.hotel")
    if not (power > 0 and at != 0 and hotel >= 0):
        raise InputError(
            campaign.where("power"),
            found=f"propulsion {table.propulsion} at {table.at}, hotel {table.hotel}",
            expected="positive power at a control that is not 0, and a hotel load of 0 W or more",
            remedy="read one operating point off the battery's telemetry",
        )
    return power, at, hotel


def _bounds(campaign: "Campaign", name: str, table: LimitsTable, unit: str) -> tuple[float, float]:
    lower = -inf if table.lower is None else campaign.si(table.lower, unit, f"limits.{name}.lower")
    upper = inf if table.upper is None else campaign.si(table.upper, unit, f"limits.{name}.upper")
    if not lower < upper:
        raise InputError(
            campaign.where(f"limits.{name}"),
            found=f"lower {table.lower}, upper {table.upper}",
            expected="lower below upper",
            remedy="swap or correct them",
        )
    return lower, upper


def _text(control: str) -> str:
    return f"({signal_unit(control)})"
