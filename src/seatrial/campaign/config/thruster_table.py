"""Reads `[[vehicle.thrusters]]` and `[vehicle.thrust_laws]`: where thrust acts, and what command makes how much of it."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import ThrustLawTable, VehicleTable
from seatrial.core.errors import InputError, nearest
from seatrial.vehicles.thrusters import Thruster, ThrustLaw

_CLOSE = 1e-6
"""Distance, m, and sine of the angle, below which two thrusters are one."""


def read_thrusters(table: VehicleTable, keys: FileKeys, published: Sequence[Thruster]) -> tuple[Thruster, ...]:
    """Return the thrusters of a vehicle: those that are written, else those of the catalogue.

    Raises:
        InputError: a direction of no length, or two thrusters in one place that push along one line.
    """
    found = []
    for index, one in enumerate(table.thrusters):
        key = f"vehicle.thrusters[{index}]"
        x, y, z = (keys.si(text, "m", f"{key}.place") for text in one.place)
        if not (np.isfinite(one.direction).all() and np.linalg.norm(one.direction) > 0):
            raise InputError(
                keys.where(f"{key}.direction"),
                found=f"{one.direction}",
                expected="a direction of any length but none",
                remedy="write for example [1, 0, 0] for a thruster that pushes ahead",
            )
        forward, right, down = map(float, one.direction)
        found.append(Thruster((x, y, z), (forward, right, down)))
    for (i, one), (j, other) in combinations(enumerate(found), 2):
        apart = np.linalg.norm(np.subtract(one.place, other.place))
        if apart < _CLOSE and np.linalg.norm(np.cross(one.column[:3], other.column[:3])) < _CLOSE:
            raise InputError(
                keys.where(f"vehicle.thrusters[{j}].place"),
                found=f"thruster {j + 1} in the place of thruster {i + 1}, along the same line",
                expected="thrusters in different places, or in different directions",
                remedy="correct one of them; two propellers on one shaft are one thruster, whose command is their sum",
            )
    return tuple(found) or tuple(published)


def read_thrust_laws(table: VehicleTable, keys: FileKeys, count: int) -> tuple[ThrustLaw, ...]:
    """Return the law of every thruster; none where nothing is said of them.

    Args:
        table: as written.
        keys: of the file.
        count: thrusters of the vehicle.

    Raises:
        InputError: a law that is none, one of which nothing is known, or a thruster without one beside others that have one.
    """
    laws = {name: _law(law, keys, f"vehicle.thrust_laws.{name}") for name, law in table.thrust_laws.items()}
    if laws and not count:
        raise InputError(
            keys.where("vehicle.thrust_laws"),
            found="laws of thrust, and no thrusters",
            expected="[[vehicle.thrusters]], or a vehicle of the catalogue that has some",
            remedy="give place and direction of every thruster",
        )
    names = _names(table, keys, count)
    for name in laws:
        if name not in names:
            raise InputError(
                keys.where(f"vehicle.thrust_laws.{name}"),
                found="a law that no thruster names",
                expected="law = of one thruster at least",
                remedy=f'add law = "{name}" to those that follow it, or remove it',
            )
    return tuple(laws[name] for name in names)


def thruster_lags(table: VehicleTable, keys: FileKeys, controls: Sequence[str]) -> dict[str, float]:
    """Return the time constant of every control of a thruster whose law has one, s."""
    names = _names(table, keys, len(controls))
    written = {name: (law.lag, f"vehicle.thrust_laws.{name}.lag") for name, law in table.thrust_laws.items()}
    return {
        control: keys.si(lag, "s", key)
        for control, (lag, key) in zip(controls, map(written.__getitem__, names), strict=False)
        if lag is not None
    }


def _names(table: VehicleTable, keys: FileKeys, count: int) -> list[str]:
    """Return the name of every thruster's law; none where there is no law."""
    only = next(iter(table.thrust_laws)) if len(table.thrust_laws) == 1 else None
    names = [one.law or only for one in table.thrusters] or [only] * count
    for index, name in enumerate(names):
        if (name is None and table.thrust_laws) or (name is not None and name not in table.thrust_laws):
            written = index < len(table.thrusters)
            raise InputError(
                keys.where(f"vehicle.thrusters[{index}].law" if written else "vehicle.thrust_laws"),
                found=f"thruster {index + 1} without a law" if name is None else f'"{name}"',
                expected="one of [vehicle.thrust_laws]: " + (", ".join(table.thrust_laws) or "none is given"),
                remedy=nearest(name, table.thrust_laws) if name else "add law = to every [[vehicle.thrusters]]",
            )
    return [name for name in names if name is not None]


def _law(law: ThrustLawTable, keys: FileKeys, key: str) -> ThrustLaw:
    if (law.curve is None) == (law.polynomial is None):
        raise InputError(
            keys.where(key),
            found="both curve and polynomial" if law.curve else "neither curve nor polynomial",
            expected="one of them",
            remedy='write curve = "t200.csv", or polynomial = [0.0, 0.1] for 0.1 N of each unit of the command',
        )
    if law.curve is not None and "neutral" in law.model_fields_set:
        raise InputError(
            keys.where(f"{key}.neutral"),
            found="a key without effect: the curve says where there is no thrust",
            expected="neutral beside polynomial alone",
            remedy="remove it",
        )
    if law.dead_zone is not None and not law.dead_zone[0] < law.dead_zone[1]:
        raise InputError(
            keys.where(f"{key}.dead_zone"),
            found=f"{law.dead_zone}",
            expected="the lower command first",
            remedy="write for example [1475, 1525]",
        )
    zone = None if law.dead_zone is None else (law.dead_zone[0], law.dead_zone[1])
    return ThrustLaw(law.curve or "", tuple(law.polynomial or ()), law.neutral, zone, law.reverse)
