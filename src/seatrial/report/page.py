"""The page that a campaign ends with: one self-contained HTML file, the same bytes for the same results."""

from pathlib import Path

from seatrial.campaign.store.files import Store
from seatrial.campaign.workflow.run import Outcome
from seatrial.core.files import write_text
from seatrial.report.figures.style import own_settings
from seatrial.report.html import render_html
from seatrial.report.sections import (
    coefficients,
    designs,
    fits,
    known,
    method,
    models,
    posteriors,
    summary,
    terms,
    traces,
)

SECTIONS = {
    "summary": summary.section,
    "coefficients": coefficients.section,
    "models": models.section,
    "terms": terms.section,
    "trial": designs.trial_section,
    "fit": fits.section,
    "traces": traces.section,
    "posteriors": posteriors.section,
    "known": known.section,
    "next": designs.next_section,
    "method": method.section,
}
"""Sections by the name of their template, in reading order."""
CONTENTS = {
    "summary": "What the data say",
    "coefficients": "Coefficients",
    "models": "Models",
    "terms": "Which terms are real",
    "trial": "The trial",
    "fit": "Fit and residuals",
    "traces": "Filter traces",
    "posteriors": "Posteriors",
    "known": "What is known",
    "next": "The next trial",
    "method": "How this was computed",
}


def write_report(outcome: Outcome) -> Path:
    """Write `report.html` in the campaign's folder, atomically, and return its path."""
    path = Store(outcome.campaign.folder).report
    write_text(path, render(outcome))
    return path


def render(outcome: Outcome) -> str:
    """Return the page. Everything that is not markup made here is escaped: names come from users' files."""
    with own_settings():
        sections = {name: section(outcome) for name, section in SECTIONS.items()}
    script = "trimming.js" if sections["trial"].get("trimmed") else ""
    return render_html("page.html", script, contents=CONTENTS, **sections)
