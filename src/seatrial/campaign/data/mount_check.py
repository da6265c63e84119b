"""Judges how the sensors of velocities and rates are mounted: along the body, as a mount states, or turned by an angle that shows."""

from dataclasses import replace

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.campaign.data.thruster_check import model_with_gains
from seatrial.campaign.inference.posterior import initial_state
from seatrial.core.findings import Finding
from seatrial.core.record import Record
from seatrial.core.signals import RATES
from seatrial.estimation.diagnostics.record_checks import ALARM_TURN_SDS, MIN_TURN, MIN_TURN_SDS
from seatrial.estimation.posterior.first_guess import Turn, turn_of_sensor
from seatrial.estimation.priors import nominal
from seatrial.estimation.simulation.mounts import TURN, Mount
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.numerics.rotations import matrix_of_angles

SENSORS = (RATES[:3], RATES[3:])  # Channels that one sensor has: a Doppler log, a gyro
_NAMES = ("dvl", "imu")
# What a fit may leave of the change of a velocity, as a share of it, for its turn to be believed: more is a unit or a
# sign
MAX_MISSED_SHARE = 2.0


def along_body(campaign: Campaign, record: Record) -> Record:
    """Return a record with velocities and rates along the body, by the turns of their mounts, sought ones at their nominal values."""
    columns = {name: record.channel(name) for name in record.measured}
    for group, mount in ((group, _mount(campaign.sensor_models, group)) for group in SENSORS):
        measured = [name for name in group if name in columns]
        if mount is None or not measured:
            continue
        angles = [
            nominal(campaign.prior(name)) if name in mount.unknown else stated
            for name, stated in zip((f"{part}_{mount.name}" for part in TURN), mount.turn, strict=True)
        ]
        shown = np.stack([columns.get(name, np.zeros(record.time.size)) for name in group], axis=1)
        turned = shown @ np.array(matrix_of_angles(*angles), float).T / mount.scale
        columns |= {name: turned[:, group.index(name)] for name in measured}
    return replace(record, measurement=np.column_stack([columns[name] for name in record.measured]))


def _mount(sensor_models: tuple[Sensor, ...], group: tuple[str, ...]) -> Mount | None:
    """Return the mount of a sensor of several channels."""
    return next((one.mount for one in sensor_models if one.channel in group and one.mount is not None), None)


def check_mounts(campaign: Campaign, record: Record) -> list[Finding]:
    """Report which sensor shows the motion turned about an axis; nothing if the file seeks its turn, or where no motion can be fitted.

    Args:
        campaign: that the record is of.
        record: with velocities along the body, see `along_body`.
    """
    vehicle = campaign.vehicle
    if not isinstance(vehicle, WholeVehicle):
        return []
    model, priors = model_with_gains(campaign, vehicle, record)
    findings = []
    for group, usual in zip(SENSORS, _NAMES, strict=True):
        mount = _mount(campaign.sensor_models, group)
        measured = [name for name in group if name in campaign.channels and name in model.states]
        if len(measured) < 2 or (mount is not None and {*mount.unknown} & {f"{part}_{mount.name}" for part in TURN}):
            continue
        turn = turn_of_sensor(model, record, initial_state(campaign, model, record), priors, measured)
        if turn is None or turn.missed > MAX_MISSED_SHARE:
            continue
        if abs(turn.angle) >= MIN_TURN and turn.gain >= 0.5 * MIN_TURN_SDS**2:
            findings.append(_finding(measured, usual if mount is None else mount.name, turn, mount))
    return findings


def _finding(signals: list[str], name: str, turn: Turn, mount: Mount | None) -> Finding:
    degrees, sd, sds = float(np.degrees(turn.angle)), float(np.degrees(turn.sd)), float(np.sqrt(2.0 * turn.gain))
    values = {
        "degrees": degrees,
        "sd": sd,
        "sds": sds,
        "axis": turn.axis,
        "has_mount": mount is not None,
        "part": TURN[turn.axis],
        "mount": name,
        "prior_sd": max(2.0 * sd, 1.0),
    }
    remedy = "state-mount" if mount is None else "correct-mount"
    level = "alarm" if sds >= ALARM_TURN_SDS else "caution"
    return Finding("sensor-turned", level, tuple(signals), values, (remedy,))
