"""Raw plots of a record, whatever is wrong with it: every channel and every control as they are, a stand-alone SVG."""

from pathlib import Path

from seatrial.campaign.config import Campaign
from seatrial.core.files import write_text
from seatrial.core.record import Record
from seatrial.core.shown import shown_unit
from seatrial.report.drawing import signal_axis
from seatrial.report.figures.raw import raw_record
from seatrial.report.figures.style import own_settings
from seatrial.report.svg import draw_svg


def write_check_picture(campaign: Campaign, record: Record) -> Path:
    """Write `check-LABEL.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / f"check-{record.label}.svg"
    shown = [
        (signal_axis(name), record.channel(name) * shown_unit(name)[0]) for name in (*record.measured, *record.controls)
    ]
    with own_settings():
        write_text(path, draw_svg(raw_record(record.time, shown, len(record.measured)), f"raw-{record.label}"))
    return path
