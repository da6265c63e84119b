"""Reads `[[vehicle.thrusters]]` and `[vehicle.thrust_laws]`: where thrust acts, and what command makes how much of it."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from seatrial.campaign.config.quantities import Metres, Seconds, Several, Table, Unit, refused, without_effect
from seatrial.campaign.config.toml import FileKeys
from seatrial.core.errors import InputError, nearest
from seatrial.vehicles.thrusters import Thruster, ThrustLaw, VoltageEffect

Volts = Annotated[float, Unit("V", above=0.0, remedy='write for example stated = "16 V"')]


class VoltageTable(Table):
    """`[vehicle.thrust_laws.NAME.voltage]`: the change of a law with the battery voltage, which channel `V` of the log gives.

    The law holds at the voltage `stated`. At another voltage V each end of the dead zone lies `widening` times (stated / V - 1)
    farther out. The thrust is that of the command as far beyond the dead zone, times (V / stated) to the power k. The exponent k is a
    polynomial in this distance, the constant first: `exponent` up to the stated voltage, and `exponent_above` above it.
    """

    stated: Volts = Field(description="voltage at which the curve or polynomial, and the dead zone, hold")
    exponent: Several[float] = Field(
        min_length=1, max_length=4, description="k by powers of the distance beyond the dead zone, the constant first"
    )
    exponent_above: Several[float] | None = Field(
        default=None, min_length=1, max_length=4, description="k above the stated voltage; `exponent` if not given"
    )
    widening: float = Field(
        default=0.0,
        ge=0.0,
        description="distance by which each end of the dead zone lies farther out at half the voltage",
    )


class ThrustLawTable(Table):
    """`[vehicle.thrust_laws.NAME]`: the thrust of a logged command, such as a pulse width in microseconds.

    `curve` is a CSV of two columns with a header, the command and the thrust in N. Instead, `polynomial` gives the
    thrust in N by powers of the command minus `neutral`, the constant first. Between the two commands of `dead_zone`,
    ends included, there is no thrust. Negative thrust is multiplied by `reverse`. Both also act on a `curve`: leave
    them out if it contains them. `lag` is the time constant of the thrust. A channel f_1 in the unit "command" is
    converted by the law of thruster 1. Commands beyond the curve are refused. So are those below 500 or above 2500 if
    a polynomial has a `neutral` between 1000 and 2000, as one of pulse widths has.
    """

    curve: str | None = Field(
        default=None, description="CSV with a header and two columns: the command, and the thrust in N"
    )
    polynomial: Several[float] | None = Field(
        default=None,
        min_length=2,
        max_length=12,
        description="instead of a curve: coefficients of the thrust in N, the constant first",
    )
    neutral: float = Field(default=0.0, description="command of no thrust, subtracted before the polynomial")
    dead_zone: Several[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="the two commands between which there is no thrust, ends included",
    )
    reverse: float = Field(default=1.0, gt=0.0, description="factor on negative thrust")
    lag: Seconds | None = Field(
        default=None,
        description="time constant by which the thrust follows the command; `[prior.lag_f]` makes it an unknown of all "
        "thrusters",
    )

    voltage: VoltageTable | None = Field(
        default=None, description="change with the battery voltage, `[vehicle.thrust_laws.NAME.voltage]`"
    )

    @model_validator(mode="after")
    def _check_law(self) -> Self:
        if (self.curve is None) == (self.polynomial is None):
            raise refused(
                "both curve and polynomial" if self.curve else "neither curve nor polynomial",
                "one of them",
                'write curve = "t200.csv", or polynomial = [0.0, 0.1] for 0.1 N of each unit of the command',
            )
        if self.curve is not None and "neutral" in self.model_fields_set:
            raise without_effect("neutral", "the curve contains the dead zone")
        if self.dead_zone is not None and not self.dead_zone[0] < self.dead_zone[1]:
            raise refused(
                f"{list(self.dead_zone)}", "the lower command first", "write for example [1475, 1525]", "dead_zone"
            )
        if self.voltage is not None and self.voltage.widening and self.polynomial and self.dead_zone is None:
            raise without_effect("voltage.widening", "the polynomial has no dead_zone")
        return self

    @property
    def law(self) -> ThrustLaw:
        """The law, whose curve is yet to be read."""
        zone = None if self.dead_zone is None else (self.dead_zone[0], self.dead_zone[1])
        effect, one = None, self.voltage
        if one is not None:
            above = one.exponent_above or one.exponent
            effect = VoltageEffect(one.stated, tuple(one.exponent), tuple(above), one.widening)
        return ThrustLaw(self.curve or "", tuple(self.polynomial or ()), self.neutral, zone, self.reverse, effect)


class ThrusterTable(Table):
    """`[[vehicle.thrusters]]`: place from the body's origin and direction of positive thrust, forward, starboard and down.

    `law` names its law of thrust; if there is only one law, all thrusters use it.
    """

    place: Several[Metres] = Field(
        min_length=3, max_length=3, description="its place forward, starboard and down of the body's origin"
    )
    direction: Several[float] = Field(
        min_length=3, max_length=3, description="direction of positive thrust: forward, starboard, down, of any length"
    )
    law: str | None = Field(default=None, description="name of its law of thrust; not needed if there is only one")

    @model_validator(mode="after")
    def _check_direction(self) -> Self:
        if not (np.isfinite(self.direction).all() and np.linalg.norm(self.direction) > 0):
            raise refused(
                f"{list(self.direction)}",
                "a direction of any length above 0",
                "write for example [1, 0, 0] for a thruster that pushes ahead",
                "direction",
            )
        return self


_CLOSE = 1e-6  # Distance, m, and sine of the angle, below which two thrusters are one


def read_thrusters(
    tables: Sequence[ThrusterTable], keys: FileKeys, published: Sequence[Thruster]
) -> tuple[Thruster, ...]:
    """Return the thrusters of a vehicle: those that are written, else those of the catalogue.

    Raises:
        InputError: two thrusters in one place that push along one line.
    """
    placed = []
    for one in tables:
        (x, y, z), (forward, right, down) = one.place, one.direction
        placed.append(Thruster((x, y, z), (float(forward), float(right), float(down))))
    for (i, one), (j, other) in combinations(enumerate(placed), 2):
        apart = np.linalg.norm(np.subtract(one.place, other.place))
        if apart < _CLOSE and np.linalg.norm(np.cross(one.column[:3], other.column[:3])) < _CLOSE:
            raise InputError(
                keys.where(f"vehicle.thrusters[{j}].place"),
                found=f"thruster {j + 1} in the place of thruster {i + 1}, along the same line",
                expected="thrusters in different places, or in different directions",
                remedy="correct one of them; two propellers on one shaft are one thruster, with the sum of their commands",
            )
    return tuple(placed) or tuple(published)


def read_thrust_laws(
    tables: Mapping[str, ThrustLawTable], thrusters: Sequence[ThrusterTable], keys: FileKeys, count: int
) -> tuple[ThrustLaw, ...]:
    """Return the law of every thruster; none if nothing is said of them.

    Args:
        tables: by name.
        thrusters: that are written.
        keys: of the file.
        count: thrusters of the vehicle.

    Raises:
        InputError: a law of which nothing is known, or a thruster without one beside others that have one.
    """
    if tables and not count:
        raise InputError(
            keys.where("vehicle.thrust_laws"),
            found="laws of thrust, and no thrusters",
            expected="[[vehicle.thrusters]], or a vehicle of the catalogue that has some",
            remedy="give place and direction of every thruster",
        )
    names = _names(tables, thrusters, keys, count)
    for name in tables:
        if name not in names:
            raise InputError(
                keys.where(f"vehicle.thrust_laws.{name}"),
                found="a law that no thruster names",
                expected="at least one thruster with this law",
                remedy=f'add law = "{name}" to those that follow it, or remove it',
            )
    return tuple(tables[name].law for name in names)


def thruster_lags(
    tables: Mapping[str, ThrustLawTable], thrusters: Sequence[ThrusterTable], keys: FileKeys, controls: Sequence[str]
) -> dict[str, float]:
    """Return the time constant of every control of a thruster whose law has one, s."""
    names = _names(tables, thrusters, keys, len(controls))
    lags = {control: tables[name].lag for control, name in zip(controls, names, strict=False)}
    return {control: lag for control, lag in lags.items() if lag is not None}


def _names(
    laws: Mapping[str, ThrustLawTable], thrusters: Sequence[ThrusterTable], keys: FileKeys, count: int
) -> list[str]:
    """Return the name of every thruster's law; none if there is no law."""
    only = next(iter(laws)) if len(laws) == 1 else None
    names = [one.law or only for one in thrusters] or [only] * count
    for index, name in enumerate(names):
        if (name is None and laws) or (name is not None and name not in laws):
            written = index < len(thrusters)
            raise InputError(
                keys.where(f"vehicle.thrusters[{index}].law" if written else "vehicle.thrust_laws"),
                found=f"thruster {index + 1} without a law" if name is None else f'"{name}"',
                expected="one of [vehicle.thrust_laws]: " + (", ".join(laws) or "none is given"),
                remedy=nearest(name, laws) if name else "add law = to every [[vehicle.thrusters]]",
            )
    return [name for name in names if name is not None]
