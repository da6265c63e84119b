"""The page that a campaign ends with: one self-contained HTML file, the same bytes for the same results."""

import re
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from seatrial.campaign.loop import Outcome
from seatrial.campaign.store import Store
from seatrial.core.files import write_text
from seatrial.report.figures.style import PALETTE, own_settings
from seatrial.report.sections import coefficients, designs, fits, method, models, posteriors, summary, traces

SECTIONS = {
    "summary": summary.section,
    "coefficients": coefficients.section,
    "models": models.section,
    "trial": designs.trial_section,
    "fit": fits.section,
    "traces": traces.section,
    "posteriors": posteriors.section,
    "next": designs.next_section,
    "method": method.section,
}
"""Sections by the name of their template, in reading order."""
CONTENTS = {
    "summary": "What the data say",
    "coefficients": "Coefficients",
    "models": "Which terms",
    "trial": "The trial",
    "fit": "Fit and residuals",
    "traces": "Filter traces",
    "posteriors": "Posteriors",
    "next": "The next trial",
    "method": "How this was computed",
}

_PERCENT = re.compile(r"(?<=\d) %")
"""A number and its percent sign stay on one line."""


def write_report(outcome: Outcome) -> Path:
    """Write `report.html` in the campaign's folder, atomically, and return its path."""
    path = Store(outcome.campaign.folder).report
    write_text(path, render(outcome))
    return path


def render(outcome: Outcome) -> str:
    """Return the page. Everything that is not markup made here is escaped: names come from users' files."""
    with own_settings():
        sections = {name: section(outcome) for name, section in SECTIONS.items()}
    html = _environment().get_template("page.html").render(contents=CONTENTS, palette=PALETTE, **sections)
    return _PERCENT.sub("\u202f%", html)


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("seatrial.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
