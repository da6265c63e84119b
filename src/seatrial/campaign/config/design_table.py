"""Reads `[design]`, `[limits]` and `[power]`: which designs are tried, inside which limits, and what makes one the best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path, PurePath
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, ModelWrapValidatorHandler, model_validator

from seatrial.campaign.config.quantities import (
    OfControl,
    RangeOf,
    Seconds,
    Several,
    Table,
    Turnaround,
    Unit,
    noted,
    refused,
    without_effect,
)
from seatrial.campaign.config.toml import FileKeys
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import CONTROLS, is_thruster, signal_unit
from seatrial.design.design_problem import DesignFilter, Over, Per, Utility
from seatrial.design.integrals import motion_signals
from seatrial.design.motion_limits import MotionLimit
from seatrial.manoeuvres.family import Beside, Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule, read_rows
from seatrial.vehicles.model import VehicleModel

Watts = Annotated[float, Unit("W")]
OfLimited = Annotated[float, Unit("{limited}", "that of the quantity")]
RateOfLimited = Annotated[float, Unit("({limited})/s", "that of the control, per second")]
OfRange = Annotated[float, Unit("{range}", "that of the quantity")]

OfBeside = Annotated[
    float, Unit("{beside}", "that of the control", above=0.0, remedy="remove it if the control stays at trim")
]


class LimitsTable(Table):
    """`[limits.NAME]`: bounds of a control and of its rate of change, of a state of the motion such as `u`, or of the
    path. For the path there are the `distance` travelled, the `advance` along the keel, and `x` and `y`. These are
    metres ahead and to starboard of the start, by the heading there."""

    lower: OfLimited | None = Field(default=None, description="lower bound")
    upper: OfLimited | None = Field(default=None, description="upper bound")
    rate: RateOfLimited | None = Field(default=None, description="largest rate of change, for controls only")


class RangeTable(Table):
    """`design.amplitude`, `design.period`, `design.relay.threshold`: an evenly spaced range of a quantity."""

    start: OfRange = Field(alias="from", description="first value")
    stop: OfRange = Field(alias="to", description="last value")
    points: int = Field(ge=1, le=1000, description="number of values, evenly spaced")

    @model_validator(mode="wrap")
    @classmethod
    def _check_ends(cls, written: Any, validate: ModelWrapValidatorHandler[Self]) -> Self:
        table = validate(written)
        start, stop = (written.get(key) if isinstance(written, dict) else "" for key in ("from", "to"))
        if not 0 < table.start <= table.stop:
            raise refused(f"from {start} to {stop}", "0 < from <= to", "swap or correct them")
        if table.points == 1 and table.start != table.stop:
            raise refused(
                f"1 point from {start} to {stop}",
                "2 points or more, or `from` and `to` the same",
                "ask for more points",
            )
        return table

    def values(self) -> tuple[float, ...]:
        """Return the values, SI."""
        return tuple(np.linspace(self.start, self.stop, self.points).tolist())


class PowerTable(Table):
    """`[power]`: the power that the battery gives: the hotel load, and the propulsion, which grows with the cube of the control."""

    hotel: Watts = Field(description="power without propulsion")
    propulsion: Watts = Field(description="power drawn by the propeller at the operating point `at`")
    at: OfControl = Field(description="the control at which `propulsion` is drawn")


class RelayTable(Table):
    """`[design.relay]`: the self-oscillating test. The control changes to the other side of trim whenever the measured `output` is a
    `threshold` away from its trim. With the heading as output it is the zigzag of ships."""

    output: Annotated[str, noted("channel")] = Field(description="measured state that reverses the control")
    threshold: Annotated[RangeTable, RangeOf("{channel}")] = Field(description="distances from trim that are tried")


class PredictionTable(Table):
    """`[design.prediction]`: the prediction that the trial must make more certain. It is a state, the `distance`
    travelled or the `advance`, some time after the designed control is set to a value at trim. With the propeller
    stopped, `of = "distance"` is the stopping distance."""

    of: str = Field(description="predicted quantity: a state, `distance` or `advance`")
    control: OfControl = Field(description="value to which the control is set")
    after: Annotated[
        float,
        Unit("s", above=0.0, most=1e5, expected="a positive time of 100 000 s at most", remedy='for example "30 s"'),
    ] = Field(description="time after that")


def _as_beside(written: Any) -> Any:
    """Return a table of an amplitude alone, which may be written without one."""
    return {"amplitude": written} if isinstance(written, str | int | float) else written


class BesideTable(Table):
    """`[design.together.CONTROL]`: a control that moves with the designed one, with a period `period` times as long."""

    amplitude: OfBeside = Field(description="its amplitude at the largest amplitude of the designed control")
    period: float = Field(
        default=1.0, ge=0.1, le=10.0, description="its period divided by that of the designed control"
    )


class DesignTable(Table):
    """`[design]`: shapes of input that are compared on one grid of amplitudes and periods, and the utility that ranks them.

    | utility | the best design ... |
    |---|---|
    | `entropy` | lowers the entropy of the coefficients most, in nats, as the `filter` computes it |
    | `fisher-d` | the same, by the Fisher information |
    | `fisher-a` | leaves the smallest mean variance |
    | `fisher-e` | gives the most information about the combination that is least known |
    | `fisher-me` | gives similar information about all combinations |
    | `fisher-c` | makes the stated `prediction` most certain |
    | `discrimination` | best separates the full structure from the one most like it |

    With `per` a joule or a second, a trial ends when more of it would lower the information per cost.

    `schedule` is a CSV with columns `time_s` and one for each control that moves, with its unit, such as `n_rpm`. It is
    compared with the families, and is the first trial that is run. Controls named under `together` move at the same
    time. The amplitude of each, `{ n = "100 rpm" }`, is used with the largest amplitude of `control`; smaller designs shrink it in
    proportion. A control with slower motion may have a longer period: `{ n = { amplitude = "100 rpm", period = 2.0 } }`.

    Without this table a campaign with `[import]` is fitted and reported, and no next trial is proposed.
    """

    control: Annotated[str, noted("control")] = Field(description="the control that is driven")
    families: Several[str] = Field(
        default=("repeated-doublet",), min_length=1, description="shapes of input to compare, from the list below"
    )
    utility: Utility = Field(default="entropy", description="criterion of the best design; see above")
    filter: DesignFilter = Field(
        default="square-root-unscented", description="filter that computes the entropy reduction"
    )
    over: Over = Field(
        default="mean",
        description="the utility is the mean over draws of the coefficients, its value at their mean (`local`), or the worst value",
    )
    per: Per = Field(default="trial", description="whether the utility counts per trial, per joule or per second")
    turnaround: Turnaround = Field(default=0.0, description='time between trials, counted with `per = "second"`')
    probability: float = Field(
        default=0.95, gt=0.0, lt=0.99, description="required probability that the motion stays inside its limits"
    )
    trim: OfControl | None = Field(
        default=None, description="value about which the control is driven; if not given, that of `[vehicle]`"
    )
    together: dict[
        Annotated[str, noted("beside")],
        Annotated[BesideTable, BeforeValidator(_as_beside, json_schema_input_type=str | BesideTable)],
    ] = Field(
        default={}, description="other controls that move at the same time, by name, each with its largest amplitude"
    )
    duration: Seconds = Field(description="length of the trial")
    active: Seconds = Field(description="time in which the control may leave trim")
    start: Seconds = Field(default=1.0, description="time at trim before the control moves")
    ramp: Seconds = Field(default=0.0, description="time that each change of level takes")
    sample_time: Seconds = Field(description="time between samples")
    schedule: str | None = Field(
        default=None, description="CSV of your schedule; it is compared with the designs and run first"
    )
    amplitude: Annotated[RangeTable, RangeOf("{control}")] = Field(description="amplitudes that are compared")
    period: Annotated[RangeTable, RangeOf("s")] = Field(
        description="periods that are compared; the list of shapes gives the meaning for each"
    )
    relay: RelayTable | None = Field(default=None, description="the self-oscillating test, `[design.relay]`")
    prediction: PredictionTable | None = Field(
        default=None, description="prediction for `fisher-c`, `[design.prediction]`"
    )

    @model_validator(mode="after")
    def _check_average(self) -> Self:
        if self.over != "mean" and self.utility == "entropy" and self.per != "second":
            raise without_effect(
                "over",
                "the entropy reduction is that of the filter, at the mean",
                'remove it, or set utility = "fisher-d"',
            )
        return self

    def family(self, trims: Mapping[str, float]) -> Family:
        """Return control, trim and timing that all designs share; each shape is a copy of it.

        Args:
            trims: of the vehicle and of the set-points, SI.
        """
        trim = trims.get(self.control, 0.0) if self.trim is None else self.trim
        seconds = {key: getattr(self, key) for key in ("duration", "active", "sample_time", "start", "ramp")}
        beside = (
            Beside(name, trims.get(name, 0.0), other.amplitude / self.amplitude.stop, other.period)
            for name, other in self.together.items()
        )
        return Family(self.control, trim, **seconds, beside=tuple(beside))

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitudes, SI, and periods, s."""
        return np.array(self.amplitude.values()), np.array(self.period.values())


@dataclass(frozen=True, eq=False)
class OwnSchedule:
    """A schedule that somebody wrote or recorded.

    Attributes:
        source: its file.
        schedule: controls over time, sampled as designs are, SI.
        skipped: lines between two samples, of which these take nothing.
    """

    source: str
    schedule: Schedule
    skipped: tuple[int, ...] = ()

    @property
    def label(self) -> str:
        """Name of its record."""
        return PurePath(self.source).stem


def check_design(
    table: DesignTable, keys: FileKeys, commands: Sequence[str], trim: Mapping[str, float], channels: Sequence[str]
) -> None:
    """Check which designs are tried.

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
    if table.relay is not None and table.relay.output not in channels:
        output = table.relay.output
        raise InputError(
            keys.where("design.relay.output"),
            found=f'"{output}"',
            expected="a measured channel: " + ", ".join(channels),
            remedy=nearest(output, channels),
        )
    if table.control not in commands:
        raise InputError(
            keys.where("design.control"),
            found=f'"{table.control}"',
            expected="a control of the vehicle, or a set-point of its autopilot: "
            + (", ".join(commands) or "it has none"),
            remedy=_control_remedy(table.control, commands),
        )
    others = [name for name in commands if name != table.control]
    for name in table.together:
        if name not in others:
            raise InputError(
                keys.where(f"design.together.{name}"),
                found=f'"{name}"' + ", which is driven" * (name == table.control),
                expected="another control of the vehicle: " + (", ".join(others) or "it has none"),
                remedy=nearest(name, others) if others else "remove it",
            )
    try:
        table.family(trim)
    except InputError as error:
        key = keys.where(f"design.{error.where.rpartition(' ')[2]}")
        raise InputError(key, found=error.found, expected=error.expected, remedy=error.remedy) from None


def check_utility(design: DesignTable, keys: FileKeys, is_one_structure: bool, has_autopilot: bool) -> None:
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
            expected="optional terms, about which the data decide",
            remedy='add them to structure.optional, or set utility = "fisher-d"',
        )
    if design.turnaround > 0 and design.per != "second":
        raise InputError(
            keys.where("design.turnaround"),
            found=f'{design.turnaround:g} s with per = "{design.per}", which does not use it',
            expected='per = "second" with it',
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
    of_controls: dict[str, Limits] = {}
    for name, table in tables.items():
        if name in commands:
            _check_bounds(table, keys, name)
            with located(keys.where(f"limits.{name}.rate")):
                of_controls[name] = Limits(table.lower, table.upper, table.rate)
    return of_controls, tuple(_motion_limit(name, one, keys) for name, one in tables.items() if name not in commands)


def _control_remedy(name: str, controls: Sequence[str]) -> str:
    """Return how a vehicle gets a control that it does not have."""
    if is_thruster(name):
        return "describe the thrusters of your vehicle under [[vehicle.thrusters]], or name a published vehicle that has them"
    if controls and name not in CONTROLS:
        return nearest(name, controls)
    has = ", ".join(controls) or "none"
    return f"a vehicle has a control if a term contains it, such as T_nabsn, X_tau_X or N_uudelta_r; this vehicle has {has}"


def read_power(table: PowerTable | None, keys: FileKeys, control: str) -> PowerTable:
    """Return what a trial draws from the battery.

    Raises:
        InputError: no table, a control that is no propeller, or numbers that are not positive.
    """
    if control != "n":
        raise InputError(
            keys.where("design.per"),
            found=f'"joule" with the control {control}',
            expected="the propeller n, because its power grows with the cube",
            remedy='set per = "trial"',
        )
    if table is None:
        raise InputError(
            keys.where("design.per"),
            found='"joule" without [power]',
            expected="the power of the vehicle",
            remedy='add [power] with hotel = "20 W", propulsion = "40 W" and at = "1500 rpm"',
        )
    if not (table.propulsion > 0 and table.at != 0 and table.hotel >= 0):
        raise InputError(
            keys.where("power"),
            found=f"propulsion {table.propulsion:g} W at {table.at:g} rad/s, hotel {table.hotel:g} W",
            expected="positive power at a control that is not 0, and a hotel load of 0 W or more",
            remedy="read one operating point off the battery's telemetry",
        )
    return table


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
    _check_bounds(table, keys, name)
    return MotionLimit(name, -inf if table.lower is None else table.lower, inf if table.upper is None else table.upper)


def _check_bounds(table: LimitsTable, keys: FileKeys, name: str) -> None:
    if table.lower is not None and table.upper is not None and not table.lower < table.upper:
        unit = signal_unit(name)
        raise InputError(
            keys.where(f"limits.{name}"),
            found=f"lower {table.lower:g} {unit}, upper {table.upper:g} {unit}",
            expected="lower below upper",
            remedy="swap or correct them",
        )
