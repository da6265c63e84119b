"""Reads `[autopilot]`: the loops through which trials run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated

from pydantic import Field

from seatrial.campaign.config.quantities import OfChannel, Seconds, Table, Unit, first_noted
from seatrial.campaign.config.toml import FileKeys
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import ANGLES, RATES, set_point
from seatrial.manoeuvres.autopilot import Loop
from seatrial.vehicles.model import VehicleModel

OfMoved = Annotated[
    float, Unit("{moved}", "that of the driven control", above=0.0, remedy="leave it out if there is none")
]

RateOfMoved = Annotated[
    float,
    Unit("({moved})/s", "that of the driven control, per second", above=0.0, remedy="leave it out if there is none"),
]

Gain = Annotated[float, Unit("({moved})/({channel})", "that of the driven control, divided by that of the channel")]
IntegralGain = Annotated[float, Unit("({moved})/({channel} s)", "the same, per second")]
DerivativeGain = Annotated[float, Unit("({moved}) s/({channel})", "the same, times seconds")]
Drives = Annotated[dict[str, float], first_noted("moved")]


class LoopTable(Table):
    """`[autopilot.CHANNEL]`: a loop of the vehicle's autopilot, which holds a measured channel such as `psi`, `z`, `u` or `theta`.

    The error e is the set-point minus the measured channel. The output is kp e + ki times the integral of e - kd times
    the channel's rate of change. It `drives` controls, each by its share. It may also drive the set-point of an inner
    loop, such as `theta_set` for depth through pitch. `[design]` then drives a set-point such as `psi_set`, or adds to
    a control.
    """

    drives: Drives = Field(
        min_length=1,
        description="controls, or set-points of inner loops, each with its share of the output",
    )
    kp: Gain = Field(description="proportional gain")
    ki: IntegralGain | None = Field(default=None, description="integral gain")
    kd: DerivativeGain | None = Field(
        default=None, description="derivative gain; it acts on the measurement, not on the set-point"
    )
    derivative: str | None = Field(
        default=None, description="channel that shows the rate of change, such as `r`; without it differences are taken"
    )
    set_point: OfChannel | None = Field(
        default=None, description="value if the trial does not move it; its trim if not given"
    )
    limit: OfMoved | None = Field(default=None, description="largest output, to either side")
    rate: RateOfMoved | None = Field(default=None, description="fastest change of the output")
    interval: Seconds | None = Field(
        default=None,
        description="time between decisions, a multiple of `design.sample_time`, which is the default",
    )


@dataclass(frozen=True)
class AutopilotSettings:
    """The loops of the autopilot, none if there is none, and the set-point of each while a trial leaves it alone, SI."""

    loops: tuple[Loop, ...] = ()
    set_points: tuple[float, ...] = ()

    @property
    def trim(self) -> dict[str, float]:
        """Set-points by name, SI."""
        return {loop.set_point: value for loop, value in zip(self.loops, self.set_points, strict=True)}

    @property
    def moved(self) -> dict[str, float]:
        """All that loops move, with 0: what is added where nothing else is said."""
        return {name: 0.0 for loop in self.loops for name, _ in loop.moves}


WHOLE = 1e-6  # Share of a sample by which an interval may differ from whole samples


def read_autopilot(
    tables: Mapping[str, LoopTable],
    keys: FileKeys,
    model: VehicleModel,
    channels: Sequence[str],
    trim: Mapping[str, float],
    sample_time: float,
) -> AutopilotSettings:
    """Read the loops of an autopilot, none if there are no tables.

    Args:
        tables: as written, by the channel that each holds.
        keys: of the file.
        model: of the full structure.
        channels: that are measured.
        trim: of the vehicle, SI.
        sample_time: of designs, s.

    Raises:
        InputError: a channel that is not measured, something that cannot be moved, gains of another unit, or times that are none.
    """
    loops, set_points = [], []
    for at, (name, table) in enumerate(tables.items()):
        _check_measured(name, channels, keys, f"autopilot.{name}")
        if table.derivative is not None:
            _check_measured(table.derivative, channels, keys, f"autopilot.{name}.derivative")
        later = [set_point(other) for other in list(tables)[at + 1 :]]
        loops.append(_loop(name, table, keys, model, later, sample_time))
        set_points.append(trim.get(name, 0.0) if table.set_point is None else table.set_point)
    return AutopilotSettings(tuple(loops), tuple(set_points))


def _loop(
    name: str, table: LoopTable, keys: FileKeys, model: VehicleModel, later: Sequence[str], sample_time: float
) -> Loop:
    key = f"autopilot.{name}"
    movable = [one for one in (*model.controls, *later) if one not in (*RATES, *ANGLES)]
    for driven in table.drives:
        if driven not in movable:
            raise InputError(
                keys.where(f"{key}.drives"),
                found=f'"{driven}"',
                expected="controls of the vehicle, or set-points of loops further down: " + ", ".join(movable),
                remedy="move the outer loop of a cascade above the inner one"
                if driven.endswith("_set")
                else nearest(driven, movable),
            )
    gains = (table.kp, table.ki or 0.0, table.kd or 0.0)
    limit, rate = (inf if bound is None else bound for bound in (table.limit, table.rate))
    interval = sample_time if table.interval is None else table.interval
    every = round(interval / sample_time)
    if every < 1 or abs(every * sample_time - interval) > WHOLE * sample_time:
        raise InputError(
            keys.where(f"{key}.interval"),
            found=f"{interval:g} s",
            expected=f"a whole multiple of design.sample_time, {sample_time:g} s",
            remedy=f"set design.sample_time to {interval:g} s or to a whole fraction of it",
        )
    return Loop(name, tuple(table.drives.items()), *gains, table.derivative, limit, rate, every, interval)


def _check_measured(name: str, channels: Sequence[str], keys: FileKeys, key: str) -> None:
    if name not in channels:
        raise InputError(
            keys.where(key),
            found=f'"{name}", which no sensor measures',
            expected="a measured channel: " + ", ".join(channels),
            remedy=f"add [sensors.{name}]: the autopilot uses the output of the sensor",
        )
