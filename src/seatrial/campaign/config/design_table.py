"""Reads `[design]`, `[limits]` and `[power]`: which designs are tried, inside which limits, and what makes one the best."""

from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path

import numpy as np

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import (
    BesideTable,
    DesignTable,
    LimitsTable,
    PowerTable,
    PredictionTable,
    RelayTable,
)
from seatrial.campaign.config.settings import DesignSettings, OwnSchedule, Power, RelaySettings, StatedPrediction
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import CONTROLS, is_thruster, signal_unit
from seatrial.design.integrals import motion_signals
from seatrial.design.motion_limits import MotionLimit
from seatrial.manoeuvres.family import Beside, Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import read_rows
from seatrial.vehicles.model import VehicleModel

LONGEST = 1e5
"""Of a prediction, s."""


def read_design(
    table: DesignTable, keys: FileKeys, commands: Sequence[str], trim: Mapping[str, float], channels: Sequence[str]
) -> DesignSettings:
    """Read what designs are tried.

    Args:
        table: as written.
        keys: of the file.
        commands: what a schedule may move: controls of the full structure's model, and set-points of the autopilot.
        trim: of the vehicle and of the set-points, SI.
        channels: that are measured.

    Raises:
        InputError: a control the vehicle lacks, times that do not fit each other, or settings that contradict each other.
    """
    if len(set(table.families)) < len(table.families):
        raise InputError(
            keys.where("design.families"),
            found=", ".join(table.families),
            expected="each family once",
            remedy="remove the repetition",
        )
    family, unit = _family(table, keys, commands, trim), signal_unit(table.control)
    return DesignSettings(
        family,
        tuple(table.families),
        keys.positive_range(table.amplitude, unit, "design.amplitude"),
        keys.positive_range(table.period, "s", "design.period"),
        table.utility,
        table.filter,
        table.over,
        table.per,
        keys.si(table.turnaround, "s", "design.turnaround"),
        table.probability,
        None if table.relay is None else _relay(table.relay, keys, channels),
        None if table.prediction is None else _prediction(table.prediction, keys, unit),
    )


def check_utility(design: DesignSettings, keys: FileKeys, is_one_structure: bool, has_autopilot: bool) -> None:
    """Check what makes a design the best: what the utility needs, and what is counted.

    Raises:
        InputError: naming the key at fault.
    """
    if design.per == "second" and has_autopilot:
        raise InputError(
            keys.where("design.per"),
            found='"second" with trials that run through an autopilot',
            expected='"trial" or "joule"',
            remedy='set per = "trial"',
        )
    if design.utility == "fisher-c" and design.prediction is None:
        raise InputError(
            keys.where("design.utility"),
            found='"fisher-c" without [design.prediction]',
            expected="the prediction to improve",
            remedy='add [design.prediction] with of = "distance", control = "0 rpm" and after = "30 s"',
        )
    if design.utility == "discrimination" and is_one_structure:
        raise InputError(
            keys.where("design.utility"),
            found='"discrimination" of a single structure',
            expected="terms whose presence the data decide",
            remedy='add them to structure.optional, or set utility = "fisher-d"',
        )
    if not 0 <= design.turnaround < inf:
        raise InputError(
            keys.where("design.turnaround"),
            found=f"{design.turnaround:g} s",
            expected="0 s or more",
            remedy='for example "2 min"',
        )
    if design.turnaround > 0 and design.per != "second":
        raise InputError(
            keys.where("design.turnaround"),
            found=f'{design.turnaround:g} s with per = "{design.per}", which does not count it',
            expected='per = "second" beside it',
            remedy='set per = "second", or remove turnaround',
        )
    if design.over == "worst" and design.per == "second":
        raise InputError(
            keys.where("design.over"),
            found='"worst" with per = "second"',
            expected="mean or local",
            remedy='set over = "mean"',
        )


def read_own(path: Path, controls: Sequence[str], limits: Mapping[str, Limits], sample_time: float) -> OwnSchedule:
    """Read a schedule that somebody wrote or recorded.

    Args:
        path: of the table.
        controls: of the vehicle.
        limits: of some of them.
        sample_time: of designs, s.

    Raises:
        InputError: a table that is none of this vehicle, that breaks a limit of a control, or in which nothing moves.
    """
    rows = read_rows(path, controls)
    schedule = rows.schedule(sample_time)
    for control, bounds in limits.items():
        rows.check_limits(control, bounds, schedule)
    if all(np.ptp(values) == 0 for values in schedule.controls.values()):
        raise InputError(
            str(path),
            found=f"{', '.join(schedule.controls)} held at one value",
            expected="a control that moves: a constant control gives little information",
            remedy="add the rows at which it changes",
        )
    return OwnSchedule(str(path), schedule, rows.skipped(schedule))


def read_limits(
    tables: Mapping[str, LimitsTable], keys: FileKeys, model: VehicleModel, commands: Sequence[str]
) -> tuple[dict[str, Limits], tuple[MotionLimit, ...]]:
    """Read the limits of what is commanded by name, and those of the motion, in the order of the file.

    Raises:
        InputError: a name that is neither a control nor a signal of the motion, a rate of the motion, a lower bound of the distance, no
            bound at all, units that do not fit, or lower above upper.
    """
    known = [*commands, *motion_signals(model)]
    for name in tables:
        if name not in known:
            raise InputError(
                keys.where(f"limits.{name}"),
                found=f'"{name}"',
                expected="a control, a state or a track: " + ", ".join(known),
                remedy=_control_remedy(name, commands)
                if name in CONTROLS or is_thruster(name)
                else nearest(name, known),
            )
    of_controls = {name: _control_limits(one, keys, name) for name, one in tables.items() if name in commands}
    return of_controls, tuple(_motion_limit(name, one, keys) for name, one in tables.items() if name not in commands)


def _control_remedy(name: str, controls: Sequence[str]) -> str:
    """Say how a vehicle gets a control that it does not have."""
    if is_thruster(name):
        return "describe the thrusters of your own vehicle under [[vehicle.thrusters]], or name a published vehicle that has them"
    if controls and name not in CONTROLS:
        return nearest(name, controls)
    has = ", ".join(controls) or "none"
    return f"a vehicle has a control where a term names it, such as T_nabsn, X_tau_X or N_uudelta_r; this one has {has}"


def read_power(table: PowerTable | None, keys: FileKeys, control: str) -> Power:
    """Read what a trial draws from the battery.

    Raises:
        InputError: no table, a control that is no propeller, or numbers that are not positive.
    """
    if control != "n":
        raise InputError(
            keys.where("design.per"),
            found=f'"joule" with the control {control}',
            expected="the propeller n, whose power grows with its cube",
            remedy='set per = "trial"',
        )
    if table is None:
        raise InputError(
            keys.where("design.per"),
            found='"joule" without [power]',
            expected="what the vehicle draws",
            remedy='add [power] with hotel = "20 W", propulsion = "40 W" and at = "1500 rpm"',
        )
    power = Power(
        keys.si(table.propulsion, "W", "power.propulsion"),
        keys.si(table.at, signal_unit(control), "power.at"),
        keys.si(table.hotel, "W", "power.hotel"),
    )
    if not (power.propulsion > 0 and power.at != 0 and power.hotel >= 0):
        raise InputError(
            keys.where("power"),
            found=f"propulsion {table.propulsion} at {table.at}, hotel {table.hotel}",
            expected="positive power at a control that is not 0, and a hotel load of 0 W or more",
            remedy="read one operating point off the battery's telemetry",
        )
    return power


def _family(table: DesignTable, keys: FileKeys, controls: Sequence[str], trims: Mapping[str, float]) -> Family:
    """Control, trim and timing; each shape is a copy of it."""
    if table.control not in controls:
        raise InputError(
            keys.where("design.control"),
            found=f'"{table.control}"',
            expected="a control of the vehicle, or a set-point of its autopilot: "
            + (", ".join(controls) or "it has none"),
            remedy=_control_remedy(table.control, controls),
        )
    unit = signal_unit(table.control)
    trim = trims.get(table.control, 0.0) if table.trim is None else keys.si(table.trim, unit, "design.trim")
    seconds = {
        key: keys.si(getattr(table, key), "s", f"design.{key}")
        for key in ("duration", "active", "sample_time", "start", "ramp")
    }
    largest = keys.si(table.amplitude.stop, unit, "design.amplitude.to")
    beside = tuple(
        _beside(
            name,
            one if isinstance(one, BesideTable) else BesideTable(amplitude=one),
            keys,
            controls,
            trims,
            table.control,
            largest,
        )
        for name, one in table.together.items()
    )
    try:
        return Family(table.control, trim, **seconds, beside=beside)
    except InputError as error:
        key = keys.where(f"design.{error.where.rpartition(' ')[2]}")
        raise InputError(key, found=error.found, expected=error.expected, remedy=error.remedy) from None


def _beside(
    name: str,
    table: BesideTable,
    keys: FileKeys,
    controls: Sequence[str],
    trims: Mapping[str, float],
    driven: str,
    largest: float,
) -> Beside:
    """Read a control that moves with the driven one, whose largest amplitude is given."""
    key = f"design.together.{name}"
    others = [one for one in controls if one != driven]
    if name not in others:
        raise InputError(
            keys.where(key),
            found=f'"{name}"' + ", which is driven" * (name == driven),
            expected="another control of the vehicle: " + (", ".join(others) or "it has none"),
            remedy=nearest(name, others) if others else "remove it",
        )
    amplitude = keys.si(table.amplitude, signal_unit(name), key)
    if not amplitude > 0:
        raise InputError(
            keys.where(key),
            found=f"{table.amplitude}",
            expected="more than 0",
            remedy="remove it where the control is to stay at trim",
        )
    return Beside(name, trims.get(name, 0.0), amplitude / largest, table.period)


def _relay(table: RelayTable, keys: FileKeys, channels: Sequence[str]) -> RelaySettings:
    if table.output not in channels:
        raise InputError(
            keys.where("design.relay.output"),
            found=f'"{table.output}"',
            expected="a measured channel: " + ", ".join(channels),
            remedy=nearest(table.output, channels),
        )
    unit = signal_unit(table.output)
    return RelaySettings(table.output, keys.positive_range(table.threshold, unit, "design.relay.threshold"))


def _prediction(table: PredictionTable, keys: FileKeys, unit: str) -> StatedPrediction:
    after = keys.si(table.after, "s", "design.prediction.after")
    if not 0 < after < LONGEST:
        raise InputError(
            keys.where("design.prediction.after"),
            found=f"{after:g} s",
            expected="a positive time of 100 000 s at most",
            remedy='for example "30 s"',
        )
    return StatedPrediction(table.of, keys.si(table.control, unit, "design.prediction.control"), after)


def _control_limits(table: LimitsTable, keys: FileKeys, control: str) -> Limits:
    unit = signal_unit(control)
    lower, upper = _bounds(table, keys, control, unit)
    rate = None if table.rate is None else keys.si(table.rate, f"({unit})/s", f"limits.{control}.rate")
    with located(keys.where(f"limits.{control}.rate")):
        return Limits(None if lower == -inf else lower, None if upper == inf else upper, rate)


def _motion_limit(name: str, table: LimitsTable, keys: FileKeys) -> MotionLimit:
    if (
        table.rate is not None
        or (table.lower is None and table.upper is None)
        or (name == "distance" and (table.upper is None or table.lower is not None))
    ):
        raise InputError(
            keys.where(f"limits.{name}"),
            found=", ".join(key for key in ("lower", "upper", "rate") if getattr(table, key) is not None) or "no bound",
            expected="upper" if name == "distance" else "lower, upper or both",
            remedy="rates are limited of controls only",
        )
    lower, upper = _bounds(table, keys, name, signal_unit(name))
    return MotionLimit(name, lower, upper)


def _bounds(table: LimitsTable, keys: FileKeys, name: str, unit: str) -> tuple[float, float]:
    lower = -inf if table.lower is None else keys.si(table.lower, unit, f"limits.{name}.lower")
    upper = inf if table.upper is None else keys.si(table.upper, unit, f"limits.{name}.upper")
    if not lower < upper:
        raise InputError(
            keys.where(f"limits.{name}"),
            found=f"lower {table.lower}, upper {table.upper}",
            expected="lower below upper",
            remedy="swap or correct them",
        )
    return lower, upper
