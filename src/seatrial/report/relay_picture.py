"""The picture of a self-oscillating test: a stand-alone SVG in the campaign's folder."""

from pathlib import Path

from seatrial.campaign.config import Campaign
from seatrial.campaign.relay_loop import relay_loop
from seatrial.campaign.relay_trial import RelayTrial
from seatrial.core.files import write_text
from seatrial.core.shown import shown_unit
from seatrial.report.drawing import signal_axis
from seatrial.report.figures.relay import relay_figure
from seatrial.report.figures.style import own_settings
from seatrial.report.svg import draw_svg


def write_relay_picture(campaign: Campaign, found: RelayTrial) -> Path:
    """Write `self_oscillation.svg`, atomically, and return its path: the test as it is expected at the prior means."""
    path, loop = campaign.folder / "self_oscillation.svg", relay_loop(campaign)
    manoeuvre, output = loop.foreseen(found.amplitude, found.threshold)
    time, control = manoeuvre.sample(campaign.family.sample_time)
    of_output, of_control = shown_unit(found.output)[0], shown_unit(found.control)[0]
    trim = loop.family.output_trim
    thresholds = ((trim - found.threshold) * of_output, (trim + found.threshold) * of_output)
    axes = signal_axis(found.output), signal_axis(found.control)
    with own_settings():
        figure = relay_figure(time, output * of_output, control * of_control, thresholds, axes)
        write_text(path, draw_svg(figure, "self-oscillation"))
    return path
