"""The page that a campaign ends with: one self-contained HTML file, the same bytes for the same results."""

from pathlib import Path

from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.argument_checks import check_kind
from seatrial.core.files import write_text
from seatrial.report.figures.style import own_settings
from seatrial.report.html import render_html
from seatrial.report.sections.designs import next_section, trial_section
from seatrial.report.sections.fits import fits_section
from seatrial.report.sections.method import method_section
from seatrial.report.sections.models import models_section
from seatrial.report.sections.parameters import parameters_section
from seatrial.report.sections.summary import summary_section

# What the templates print, by name.
SECTIONS = {
    "summary": summary_section,
    "models": models_section,
    "fit": fits_section,
    "next": next_section,
    "trial": trial_section,
    "parameters": parameters_section,
    "method": method_section,
}
# Headings by the name of their template, in reading order.
CONTENTS = {
    "summary": "The answer",
    "models": "Models compared",
    "fit": "Does it predict?",
    "next": "The next trial",
    "parameters": "Parameters in detail",
    "method": "Data and method",
}


# Those of which a posterior mode has something.
OF_FIRST_ANSWER = ("summary", "fit")


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
        names = OF_FIRST_ANSWER if outcome.first_answer else tuple(SECTIONS)
        sections = {name: SECTIONS[name](outcome) for name in names}
    contents = {name: title for name, title in CONTENTS.items() if sections.get(name)}
    return render_html("page.html", "folds.js", contents=contents, seal=outcome.seal, **sections)
