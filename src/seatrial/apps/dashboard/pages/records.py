"""Records: what a log holds, which columns are which channels, where a record begins and ends, and whether it may be believed."""

from pathlib import Path
from typing import Any

from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, fill, keep_current, say
from seatrial.apps.dashboard.jobs import CHECK
from seatrial.apps.dashboard.page_layout import button, section
from seatrial.apps.dashboard.pages.import_form import ImportForm
from seatrial.apps.dashboard.pages.record_chart import RecordChart
from seatrial.apps.dashboard.pages.work import Live, begin
from seatrial.apps.dashboard.worker_pool import stamp
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import SeatrialError

OF_RECORDS = (CHECK, "import", "simulate")
"""Commands that this page starts."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("What was recorded", "Raw data, downsampled, spikes kept."):

        def records() -> list[Path]:
            return sorted((Store(folder).results / "records").glob("*.nc"))

        async def draw() -> None:
            stored = [path.stem for path in records()]
            await fill(
                ui.element("div"),
                context.form_data(folder),
                lambda found: RecordChart(context, folder, found, stored).build(),
            )

        await keep_current(ui.element("div"), lambda: tuple(map(stamp, records())), draw)
    with section(
        "Checks",
        "What seatrial check says: direction, size, delay, outliers, gaps, and which coefficients each record can determine.",
    ):
        live, said = Live(context, folder, OF_RECORDS), ui.element("div")
        with ui.element("div").classes("line"):
            button(
                "Check the records", lambda: (begin(context, folder, said, "check"), live.look()), main=bool(records())
            )
            button("Re-import or simulate again", lambda: again(context, folder, said, live))
    with section(
        "A new log",
        "Put a log into the campaign's folder, or send it from here. Preview it, say which column is which channel, and save.",
    ):
        ImportForm(context, campaign, folder, lambda: again(context, folder, said, live)).build()


async def again(context: AppContext, folder: Path, said: ui.element, live: Any) -> None:
    """Import or simulate the records again, as the campaign says."""
    said.clear()
    try:
        found = await context.form_data(folder)
    except SeatrialError as error:
        with said:
            say(error)
        return
    begin(context, folder, said, "simulate" if found.simulated else "import")
    live.look()
