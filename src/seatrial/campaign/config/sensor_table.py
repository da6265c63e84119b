"""Reads `[sensors]`: what is measured, how noisy, and what is unknown about it."""

from collections.abc import Collection, Mapping
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from seatrial.campaign.config.quantities import Metres, Residuals, Scope, Several, Table, Unit
from seatrial.campaign.config.toml import FileKeys
from seatrial.campaign.config.vehicle_table import VehicleTable
from seatrial.core.errors import InputError, not_among
from seatrial.core.signals import ANGLES, POSITIONS, QUATERNION, SPECIFIC_FORCE
from seatrial.estimation.simulation.mounts import MAX_LATENESS, MOUNTED_CHANNELS, Mount, mount_names
from seatrial.vehicles.model import VehicleModel

Hertz = Annotated[
    float, Unit("1/s", "Hz", above=0.0, remedy='for example "5 Hz", or leave the key out for a sample in each step')
]

Radians = Annotated[float, Unit("rad", "deg")]


class SensorTable(Table):
    """`[sensors.CHANNEL]`: the noise of a sensor, its rate, and its unknown errors.

    An unknown `bias` (a constant error) or `lag` (a time constant) needs a prior, `[prior.bias_u]` or `[prior.lag_u]`.

    `[sensors.attitude]` is the whole attitude, by a quaternion or three angles of the log, with its noise as an angle about any axis.
    """

    noise: Annotated[
        float,
        Unit("{channel}", "that of the channel", above=0.0, remedy="estimate it from a steady stretch of the record"),
    ] = Field(description="standard deviation of one sample")
    rate: Hertz = Field(
        default=inf, description="rate of measurement, if it is lower than that of the samples of the record"
    )
    residuals: Residuals | None = Field(
        default=None, description="noise model of this channel, instead of `residuals` of `[estimation]`"
    )
    bias: Scope = Field(default="none", description="an unknown constant error: one for all trials, or one for each")
    lag: bool = Field(
        default=False, description="whether the sensor has an unknown time constant; needs `[prior.lag_CHANNEL]`"
    )
    reference: Literal["ground", "water"] = Field(
        default="ground", description="whether a speed is measured over ground or through the water"
    )


Delay = Annotated[
    float,
    Unit(
        "s",
        least=0.0,
        most=MAX_LATENESS,
        expected=f"0 s to {MAX_LATENESS:g} s of delay of the sensor",
        remedy="a clock that is ahead, or far behind: shift its stamps with the log, or split the run",
    ),
]


class MountTable(Table):
    """`[mounts.NAME]`: a sensor of several `channels`, such as the u, v and w of a Doppler log or the z of a pressure cell.

    Each number is estimated if it has a prior: `[prior.x_NAME]`, `[prior.yaw_NAME]`, `[prior.scale_NAME]`, `[prior.delay_NAME]`.
    """

    channels: Several[str] = Field(
        min_length=1, description="channels of the sensor, such as u, v and w of a Doppler log"
    )
    place: Several[Metres] | None = Field(
        default=None,
        min_length=3,
        max_length=3,
        description="its place forward, starboard and down of the body's origin",
    )
    roll: Radians = Field(default=0.0, description="turn of the sensor about the body's x axis")
    pitch: Radians = Field(default=0.0, description="turn about the y axis")
    yaw: Radians = Field(default=0.0, description="turn about the z axis")
    scale: float = Field(default=1.0, gt=0.0, description="shown value divided by true value")
    delay: Delay = Field(
        default=0.0,
        description="time by which the sensor is late, 1 s at most",
    )


# Sensor of the whole attitude, compared as a quaternion: by a distance on the sphere, which knows no turn at which it
# jumps.
ATTITUDE = "attitude"


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
            remedy="leave it out, or give [sensors.phi], [sensors.theta] and [sensors.psi] instead of [sensors.attitude]",
        )
    return table.model_copy(update={"attitude": "quaternion"})


def read_sensors(tables: Mapping[str, SensorTable], keys: FileKeys, model: VehicleModel) -> dict[str, SensorTable]:
    """Read all sensors.

    Args:
        tables: by channel, as written.
        keys: of the file.
        model: vehicle of all terms.

    Raises:
        InputError: a channel that the vehicle does not have, or errors of its own that an attitude does not have.
    """
    sensors, known = {}, model.channel_units()
    for channel, table in tables.items():
        if channel == ATTITUDE:
            sensors |= _attitude(table, keys, model)
        elif channel in known:
            if "reference" in table.model_fields_set and channel != "u":
                raise keys.without_effect(
                    f"sensors.{channel}.reference", "only the speed u is measured over ground or through the water"
                )
            sensors[channel] = table
        else:
            raise not_among(keys.where(f"sensors.{channel}"), channel, known, found=f'channel "{channel}"')
    return sensors


def read_mounts(
    tables: Mapping[str, MountTable], sensors: Mapping[str, SensorTable], stated: Collection[str], keys: FileKeys
) -> dict[str, Mount]:
    """Return the mount of each channel that has one.

    Args:
        tables: of mounts, by name.
        sensors: by channel.
        stated: names that have a prior, among which may be parts of mounts.
        keys: of the file.

    Raises:
        InputError: a channel that no sensor measures, that no mount knows, or that two mounts have.
    """
    mounts: dict[str, Mount] = {}
    for name, table in tables.items():
        x, y, z = table.place or (0.0, 0.0, 0.0)
        unknown = tuple(one for one in mount_names(name) if one in stated)
        mount = Mount(name, (x, y, z), (table.roll, table.pitch, table.yaw), table.scale, table.delay, unknown)
        for channel in table.channels:
            if channel not in sensors or channel not in MOUNTED_CHANNELS or channel in mounts:
                raise InputError(
                    keys.where(f"mounts.{name}.channels"),
                    found=f'"{channel}"' + ", which is in another mount" * (channel in mounts),
                    expected="channels of [sensors], of " + ", ".join(MOUNTED_CHANNELS) + ", each in one mount",
                    remedy="add its sensor, or leave it out here",
                )
            mounts[channel] = mount
    return mounts


def _attitude(table: SensorTable, keys: FileKeys, model: VehicleModel) -> dict[str, SensorTable]:
    """Return the four parts of a quaternion as sensors: half of a small angle about any axis is how far they move together."""
    key = f"sensors.{ATTITUDE}"
    if not set(QUATERNION) <= set(model.states):
        shown = ", ".join(name for name in ANGLES if name in model.states) or "nothing"
        raise InputError(
            keys.where(key),
            found=f"a vehicle with attitude = {shown}",
            expected="one that turns about two axes or three",
            remedy="give a sensor of the angle itself, such as [sensors.psi]",
        )
    if extra := sorted({"bias", "lag", "reference"} & table.model_fields_set):
        raise InputError(
            keys.where(f"{key}.{extra[0]}"),
            found=", ".join(extra),
            expected="noise, rate and residuals of the attitude",
            remedy="remove it; angles with separate sensors, [sensors.phi] and so on, may have a bias",
        )
    return {part: table.model_copy(update={"noise": 0.5 * table.noise}) for part in QUATERNION}
