"""Reads `[sensors]`: what is measured, how noisy, and what is unknown about it."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import inf

from seatrial.campaign.config.file_keys import FileKeys
from seatrial.campaign.config.schema import MountTable, SensorTable, VehicleTable
from seatrial.campaign.config.settings import SensorSettings
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import ANGLES, POSITIONS, QUATERNION, SPECIFIC_FORCE, signal_unit
from seatrial.estimation.simulation.mounts import MOST_LATE, MOUNTED, TURN, Mount, mount_names
from seatrial.vehicles.model import VehicleModel

ATTITUDE = "attitude"
"""Sensor of the whole attitude, compared as a quaternion: by a distance on the sphere, which knows no turn at which it jumps."""


def measured_angles(tables: Mapping[str, SensorTable], mounts: Mapping[str, MountTable]) -> tuple[str, ...]:
    """Return the Euler angles on which sensors depend: their own, all of them for the whole attitude or a position off the origin."""
    channels = {channel for mount in mounts.values() for channel in mount.channels}
    needs_all = ATTITUDE in tables or channels & {*POSITIONS[:2]}
    tilted = ANGLES[:2] if "z" in channels or set(SPECIFIC_FORCE) & set(tables) else ()
    return tuple(angle for angle in ANGLES if angle in tables or needs_all or angle in tilted)


def with_attitude(table: VehicleTable, tables: Mapping[str, SensorTable], keys: FileKeys) -> VehicleTable:
    """Return `[vehicle]` with its attitude as a quaternion where a sensor shows the whole of it.

    Raises:
        InputError: Euler angles were asked for.
    """
    if ATTITUDE not in tables:
        return table
    if "attitude" in table.model_fields_set and table.attitude != "quaternion":
        raise InputError(
            keys.where("vehicle.attitude"),
            found='"euler" with [sensors.attitude]',
            expected='"quaternion", in which the attitude is compared',
            remedy="leave it out, or give [sensors.phi], [sensors.theta] and [sensors.psi] in place of [sensors.attitude]",
        )
    return table.model_copy(update={"attitude": "quaternion"})


def read_sensors(tables: Mapping[str, SensorTable], keys: FileKeys, model: VehicleModel) -> dict[str, SensorSettings]:
    """Read all sensors.

    Args:
        tables: by channel, as written.
        keys: of the file.
        model: vehicle of all terms.

    Raises:
        InputError: a channel that the vehicle does not have, or a noise or rate that is not positive.
    """
    found, known = {}, model.channel_units()
    for channel, table in tables.items():
        if channel == ATTITUDE:
            found |= _attitude(table, keys, model)
        elif channel in known:
            found[channel] = _sensor(table, signal_unit(channel), keys, f"sensors.{channel}")
        else:
            raise InputError(
                keys.where(f"sensors.{channel}"),
                found=f'channel "{channel}"',
                expected="one of " + ", ".join(known),
                remedy=nearest(channel, known),
            )
    return found


def with_mounts(
    sensors: Mapping[str, SensorSettings], tables: Mapping[str, MountTable], stated: Collection[str], keys: FileKeys
) -> dict[str, SensorSettings]:
    """Return the sensors, each with its mount where it has one.

    Args:
        sensors: by channel.
        tables: of mounts, by name.
        stated: names that have a prior, among which may be parts of mounts.
        keys: of the file.

    Raises:
        InputError: a channel that no sensor measures, that no mount knows, or that two mounts have.
    """
    found = dict(sensors)
    for name, table in tables.items():
        key = f"mounts.{name}"
        for channel in table.channels:
            if channel not in sensors or channel not in MOUNTED or found[channel].mount is not None:
                raise InputError(
                    keys.where(f"{key}.channels"),
                    found=f'"{channel}"'
                    + (", which another mount has" if channel in sensors and found[channel].mount else ""),
                    expected="channels of [sensors], of " + ", ".join(MOUNTED) + ", each in one mount",
                    remedy="add its sensor, or leave it out here",
                )
            x, y, z = (keys.si(text, "m", f"{key}.place") for text in table.place or ("0 m",) * 3)
            roll, pitch, yaw = (keys.si(getattr(table, part), "rad", f"{key}.{part}") for part in TURN)
            late = keys.si(table.late, "s", f"{key}.late")
            if not 0 <= late <= MOST_LATE:
                raise InputError(
                    keys.where(f"{key}.late"),
                    found=f"{late:g} s",
                    expected=f"0 s to {MOST_LATE:g} s by which the sensor shows the past",
                    remedy="a clock that is ahead, or far behind: shift its stamps with the log, or split the run",
                )
            unknown = tuple(one for one in mount_names(name) if one in stated)
            mount = Mount(name, (x, y, z), (roll, pitch, yaw), table.scale, late, unknown)
            found[channel] = replace(found[channel], mount=mount)
    return found


def _sensor(table: SensorTable, unit: str, keys: FileKeys, key: str) -> SensorSettings:
    noise = keys.si(table.noise, unit, f"{key}.noise")
    if not noise > 0:
        raise InputError(
            keys.where(f"{key}.noise"),
            found=f"{noise:g}",
            expected="more than 0",
            remedy="estimate it from a quiet stretch of the record",
        )
    rate = inf if table.rate is None else keys.si(table.rate, "1/s", f"{key}.rate")
    if not rate > 0:
        raise InputError(
            keys.where(f"{key}.rate"),
            found=f'"{table.rate}"',
            expected="more than 0",
            remedy='for example "5 Hz", or leave the key out for a sample in each step',
        )
    return SensorSettings(noise, rate, table.residuals, table.bias, table.lag, table.over)


def _attitude(table: SensorTable, keys: FileKeys, model: VehicleModel) -> dict[str, SensorSettings]:
    """Return the four parts of a quaternion as sensors: half of a small angle about any axis is how far they move together."""
    key = f"sensors.{ATTITUDE}"
    if not set(QUATERNION) <= set(model.states):
        shown = ", ".join(name for name in ANGLES if name in model.states) or "nothing"
        raise InputError(
            keys.where(key),
            found=f"a vehicle whose attitude is {shown}",
            expected="one that turns about two axes or three",
            remedy="give a sensor of the angle itself, such as [sensors.psi]",
        )
    if extra := sorted({"bias", "lag", "over"} & table.model_fields_set):
        raise InputError(
            keys.where(f"{key}.{extra[0]}"),
            found=", ".join(extra),
            expected="noise, rate and residuals of the attitude",
            remedy="remove it; angles with sensors of their own, [sensors.phi] and so on, may have a bias",
        )
    one = _sensor(table, signal_unit("phi"), keys, key)
    return {part: SensorSettings(0.5 * one.noise, one.rate, one.residuals) for part in QUATERNION}
