"""The picture of a calibration: a stand-alone SVG in the campaign's folder."""

from pathlib import Path

from seatrial.campaign.calibrate import Calibrated
from seatrial.campaign.config import Campaign
from seatrial.core.files import write_text
from seatrial.report.figures.calibration import rank_figure
from seatrial.report.figures.style import own_settings
from seatrial.report.svg import draw_svg


def write_calibration_picture(campaign: Campaign, found: Calibrated) -> Path:
    """Write `calibration-METHOD.svg`, atomically, and return its path."""
    path = campaign.folder / f"calibration-{found.method}.svg"
    words = (
        f"{campaign.source.campaign.name}: {len(found.calibration.ranks)} truths from the priors, found again by {found.method}; "
        f"pale bands hold all {len(found.calibration.names)} in 99 % of cases"
    )
    with own_settings():
        write_text(path, draw_svg(rank_figure(found.calibration, words), "calibration"))
    return path
