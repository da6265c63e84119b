"""Records: what a log holds, which columns are which channels, where a record begins and ends, and whether it may be believed."""

from contextlib import suppress
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.templates import has_placeholders
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_text import CAMPAIGN, read_file
from seatrial.core.errors import SeatrialError
from seatrial.dashboard.app_context import AppContext, cautions_html, change_of, keep_filled, markup, saying
from seatrial.dashboard.page_layout import button, link, links_html, section, table
from seatrial.dashboard.pages.import_form import ImportForm
from seatrial.dashboard.pages.new_campaign import EXAMPLES
from seatrial.dashboard.pages.record_chart import RecordChart
from seatrial.dashboard.pages.work import Live, begin
from seatrial.dashboard.view_models import Checked, CheckRow, FormData
from seatrial.dashboard.worker_pool import stamp
from seatrial.report.labels import name_html

OF_RECORDS = ("check", "import", "simulate")
"""Commands that this page starts."""
SIGNS = {"pass": "pass", "note": "unjudged", "caution": "caution", "alarm": "fail"}
"""Class of the sign of each level of a finding."""
NEW_LOG = "new-log"
"""Identifier of the part of the page with the import form."""
FORMS = {"import": "the import form", "model": "the model page", "design": "the design page", "file": "campaign.toml"}
"""Where a remedy is done, by the view."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    if is_of_template(folder):
        words = '<ul class="cautions"><li>{} <a href="{}">Edit campaign.toml</a>, <a href="{}">change noise and terms</a>.</li></ul>'
        markup(Markup(words).format(EXAMPLES, link("file", campaign), link("model", campaign)))
    with section("Recorded signals", "Raw data, downsampled; spikes are kept."):

        def records() -> list[Path]:
            return sorted((Store(folder).results / "records").glob("*.nc"))

        async def draw(found: FormData) -> None:
            await RecordChart(context, folder, found, [path.stem for path in records()], start).build()

        def seen() -> Any:
            return tuple(map(stamp, records())) or stamp(folder / CAMPAIGN)

        async def start() -> None:
            await again(context, folder, messages, live)

        await keep_filled(seen, lambda: context.form_data(folder), draw)
    with section(
        "Checks",
        "Results of seatrial check: direction, size, delay, outliers, gaps, and the coefficients that each record can determine.",
    ):
        await keep_filled(
            lambda: change_of(folder),
            lambda: context.checked(folder),
            lambda found: markup(checks_html(found, campaign)),
            "reading …",
        )
        live, messages = Live(context, folder, OF_RECORDS), ui.element("div")

        def offer(words: str) -> None:
            if words:
                button(words, start)

        with ui.element("div").classes("line"):
            button(
                "Check the records",
                lambda: (begin(context, folder, messages, "check"), live.look()),
                main=bool(records()),
            )
            await keep_filled(lambda: stamp(folder / CAMPAIGN), lambda: _anew(context, folder), offer)
    with section(
        "A new log",
        "Put a log into the campaign's folder, or send it from here. Preview it, choose the column of each channel, and save.",
    ) as part:
        part.props(f"id={NEW_LOG}")
        ImportForm(context, campaign, folder, start).build()


def is_of_template(folder: Path) -> bool:
    """Whether the campaign file still has the places in capitals of a template."""
    try:
        return has_placeholders(read_file(folder))
    except SeatrialError:  # said by the forms
        return False


def checks_html(checked: Checked | None, campaign: str) -> Markup:
    """Return the checks of each record as a table, the gravest finding first, each remedy with a link to where it is done."""
    if checked is None:
        return Markup("<p>The records have not been checked yet.</p>")
    stale = "A file has changed since this check: check the records again"
    html = Markup("") if checked.is_current else cautions_html([stale])
    for one in checked.records:
        rows = [
            [_sign(row), Markup("<code>{}</code>").format(row.code), row.words, _remedy(row, campaign)]
            for row in one.rows
        ]
        title = f"Record {one.label}: {one.level}"
        html += table(["verdict", "check", "finding", "remedy"], rows, title, 4, stacks=True)
        html += links_html(
            [(link("download", campaign, file=one.picture, shown="1"), f"Raw plot of {one.label} (SVG)")]
        )
    return html + cautions_html(checked.cautions)


def _sign(row: CheckRow) -> Markup:
    return Markup('<span class="verdict {}">{}</span>').format(SIGNS[row.level], row.level)


def _remedy(row: CheckRow, campaign: str) -> Markup:
    words = name_html(row.remedy[:1].upper() + row.remedy[1:], {})
    if not row.view:
        return words
    address = f"#{NEW_LOG}" if row.view == "import" else link(row.view, campaign)
    return Markup('{}. <a href="{}">Open {}</a>').format(words, address, FORMS[row.view])


async def _anew(context: AppContext, folder: Path) -> str:
    """Return how records are made again; nothing if the campaign has none, or cannot be read, which is said where they are shown."""
    with suppress(SeatrialError):
        data = await context.form_data(folder)
        return "Simulate again" if data.simulated else "Re-import" if data.imported else ""
    return ""


async def again(context: AppContext, folder: Path, messages: ui.element, live: Any) -> None:
    """Import or simulate the records again, as the campaign says."""
    with saying(messages):
        data = await context.form_data(folder)
        begin(context, folder, messages, "simulate" if data.simulated else "import")
        live.look()
