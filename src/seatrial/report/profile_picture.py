"""The picture of profile likelihoods: a stand-alone SVG in the campaign's folder."""

from pathlib import Path

from seatrial.campaign.config import Campaign
from seatrial.campaign.profiles import Profiled
from seatrial.core.files import write_text
from seatrial.report.figures.profile import Panel, profile_figure
from seatrial.report.figures.style import own_settings
from seatrial.report.labels import label_mathtext
from seatrial.report.svg import draw_svg


def write_profile_picture(campaign: Campaign, found: Profiled) -> Path:
    """Write `profile.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / "profile.svg"
    truth = {} if campaign.source.imported is not None else campaign.source.truth
    panels = [
        Panel(profile, label_mathtext(label), truth.get(profile.name))
        for profile, label in zip(found.profiles, found.labels, strict=True)
    ]
    words = [
        f"{campaign.source.campaign.name}: profile likelihoods of {found.structure.label}, the other parameters following",
        "shaded: 95 % interval, where the best fit falls by less than 1.92 (dashed)"
        + "; dotted: true value" * bool(truth),
        *(["orange: open, as far as the prior reaches the best fit does not fall so far"] if found.open else []),
    ]
    with own_settings():
        write_text(path, draw_svg(profile_figure(panels, words), "profile"))
    return path
