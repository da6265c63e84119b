"""The picture of a rehearsal: a stand-alone SVG in the campaign's folder."""

from pathlib import Path

from seatrial.campaign.config import Campaign
from seatrial.campaign.rehearsal_result import Rehearsal
from seatrial.core.coefficients import CoefficientName
from seatrial.core.files import write_text
from seatrial.report.figures.rehearsal import Progressed, rehearsal_figure
from seatrial.report.figures.style import own_settings
from seatrial.report.labels import label_mathtext
from seatrial.report.svg import draw_svg


def write_rehearsal_picture(campaign: Campaign, found: Rehearsal) -> Path:
    """Write `rehearsal.svg`, atomically, and return its path; coefficients that the goal does not name are not drawn."""
    path, goal, model = campaign.folder / "rehearsal.svg", campaign.goal, campaign.model(campaign.full)
    assert goal is not None
    named = [i for i, name in enumerate(found.coefficients) if name in goal.shares or name in goal.sds]
    terms = [CoefficientName.parse(found.coefficients[i]) for i in named]
    strategies = [
        Progressed(name, *found.share_met(name), found.median_sd(name)[:, named]) for name in found.strategies
    ]
    words = (
        f"{campaign.source.campaign.name}: {found.vehicles} vehicles from the priors",
        "bars hold 90 %; below, what the goal names",
    )
    with own_settings():
        symbols, units = [label_mathtext(term.label) for term in terms], [model.unit_of(term) for term in terms]
        write_text(path, draw_svg(rehearsal_figure(strategies, symbols, units, words), "rehearsal"))
    return path
