"""The picture of a campaign's priors: a stand-alone SVG in its folder."""

from pathlib import Path

from seatrial.campaign.config import Campaign
from seatrial.campaign.prior_predictive import PriorPredictive
from seatrial.campaign.prior_words import prior_summary
from seatrial.core.files import write_text
from seatrial.core.shown import shown_unit
from seatrial.report.drawing import signal_axis
from seatrial.report.figures.fit import Driven
from seatrial.report.figures.prior_predictive import prior_motions
from seatrial.report.figures.style import own_settings
from seatrial.report.numbers import typeset
from seatrial.report.svg import draw_svg


def write_prior_picture(campaign: Campaign, found: PriorPredictive) -> Path:
    """Write `prior.svg` in the campaign's folder, atomically, and return its path."""
    path = campaign.folder / "prior.svg"
    controls = [Driven(signal_axis(name), values * shown_unit(name)[0]) for name, values in found.control.items()]
    with own_settings():
        figure = prior_motions(
            found.time,
            found.bands,
            found.single,
            controls,
            measured=found.measured,
            steady=found.steady,
            settling=found.settling,
            words=[f"{campaign.source.campaign.name}: what the priors expect", *map(typeset, prior_summary(found))],
        )
        write_text(path, draw_svg(figure, "prior"))
    return path
