"""The picture of smoothed channels and their rates: a stand-alone SVG in the campaign's folder."""

from collections.abc import Sequence
from pathlib import Path

from seatrial.campaign.accelerations import RATE, SmoothedChannel
from seatrial.campaign.config import Campaign
from seatrial.core.files import write_text
from seatrial.core.record import Record
from seatrial.core.shown import shown_unit
from seatrial.report.drawing import signal_axis, signal_symbol
from seatrial.report.figures.accelerations import Curve, smoothed_record
from seatrial.report.figures.style import own_settings, unit_label
from seatrial.report.svg import draw_svg


def write_accelerations_picture(campaign: Campaign, record: Record, channels: Sequence[SmoothedChannel]) -> Path:
    """Write `accelerations-LABEL.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / f"accelerations-{record.label}.svg"
    curves = []
    for channel in channels:
        name, found, (factor, unit) = channel.name, channel.smoothed, shown_unit(channel.name)
        curves += [
            Curve(signal_axis(name), factor * found.value, factor * found.value_sd, factor * record.channel(name)),
            Curve(_rate_axis(name, unit), factor * found.rate, factor * found.rate_sd),
        ]
    with own_settings():
        write_text(path, draw_svg(smoothed_record(record.time, curves), f"accelerations-{record.label}"))
    return path


def _rate_axis(name: str, unit: str) -> str:
    """Axis label of a rate in the unit of its signal over s."""
    return unit_label(
        signal_symbol(name + RATE), f"{unit.removesuffix('/s')}/s^2" if unit.endswith("/s") else f"{unit}/s"
    )
