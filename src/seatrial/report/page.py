"""The page that a campaign ends with: one self-contained HTML file, the same bytes for the same results."""

from pathlib import Path

from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.argument_checks import check_kind
from seatrial.core.files import write_text
from seatrial.report.figures.style import own_settings
from seatrial.report.html import render_html
from seatrial.report.sections.baselines import baselines_section
from seatrial.report.sections.cross_validation import cross_validation_section
from seatrial.report.sections.designs import known_section, next_section, trial_section
from seatrial.report.sections.fits import fits_section, traces_section
from seatrial.report.sections.models import models_section, terms_section
from seatrial.report.sections.posteriors import coefficients_section, posteriors_section
from seatrial.report.sections.summary import method_section, summary_section

SECTIONS = {
    "summary": summary_section,
    "coefficients": coefficients_section,
    "models": models_section,
    "terms": terms_section,
    "leftout": cross_validation_section,
    "trial": trial_section,
    "fit": fits_section,
    "baselines": baselines_section,
    "traces": traces_section,
    "posteriors": posteriors_section,
    "known": known_section,
    "next": next_section,
    "method": method_section,
}
"""Sections by the name of their template, in reading order."""
CONTENTS = {
    "summary": "What the data say",
    "coefficients": "Coefficients",
    "models": "Models",
    "terms": "Which terms are real",
    "leftout": "Runs left out",
    "trial": "The trial",
    "fit": "Fit and residuals",
    "baselines": "Beside simpler models",
    "traces": "Filter traces",
    "posteriors": "Posteriors",
    "known": "What is known",
    "next": "The next trial",
    "method": "How this was computed",
}


def write_report(outcome: Outcome) -> Path:
    """Write `report.html` in the campaign's folder, atomically.

    Args:
        outcome: of `run_loop`.

    Returns:
        the path of the page.

    Raises:
        InputError: something else than an outcome.
    """
    check_kind(outcome, Outcome, "outcome", "make it with `run_loop`")
    path = Store(outcome.campaign.folder).report
    write_text(path, render(outcome))
    return path


def render(outcome: Outcome) -> str:
    """Return the page, without sections of which there is nothing. What is not markup made here is escaped: names are from users' files."""
    with own_settings():
        sections = {name: section(outcome) for name, section in SECTIONS.items()}
    contents = {name: title for name, title in CONTENTS.items() if sections[name]}
    script = "trimming.js" if sections["trial"].get("trimmed") else ""
    return render_html("page.html", script, contents=contents, **sections)
