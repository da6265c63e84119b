"""The commands that make the thrusts of a schedule: laws of thrust read backwards, in the unit of each law, such as microseconds."""

from collections.abc import Callable
from functools import partial

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.core.signals import thruster_controls
from seatrial.logs.curve import read_curve

Command = Callable[[float], float]
"""Gives the command of a thrust, N; NaN where no command makes it."""


def commands_of(campaign: Campaign) -> dict[str, Command]:
    """Return the command of each control that has a law of thrust.

    Raises:
        InputError: the table of a law that cannot be read.
    """
    laws = campaign.vehicle.laws if isinstance(campaign.vehicle, WholeVehicle) else ()
    commands: dict[str, Command] = {}
    for control, law in zip(thruster_controls(len(laws), commanded_force=True), laws, strict=True):
        where = campaign.where("vehicle.thrust_laws")
        table = read_curve(find(campaign.folder, law.table, where), where) if law.table else None
        commands[control] = partial(law.command, points=None if table is None else (table.logged, table.value))
    return commands
