"""A new campaign by form: a template or a published vehicle, its values to change, nothing written before all is checked."""

from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.templates import TEMPLATES
from seatrial.core.errors import InputError, SeatrialError
from seatrial.dashboard.app_context import AppContext, cautions_html, fill, markup, say
from seatrial.dashboard.page_layout import button, frame, link, section
from seatrial.dashboard.table_form import LOOK, TableForm
from seatrial.vehicles.catalogue import vehicle_names

OF_LOGS = ("log", "bollard")
"""Templates whose campaign goes on with a log."""
EXAMPLES = "The numbers in its campaign.toml (mass, trim, priors, noise) are examples: correct them to your vehicle."


async def build(context: AppContext) -> None:
    """Build the page."""
    with frame(context, "new"):
        await Start(context).show()


class Start:
    """Name and kind of a new campaign, and the values of its file."""

    def __init__(self, context: AppContext):
        self.context, self.form = context, None
        starts = TEMPLATES | dict.fromkeys(vehicle_names(), "a published vehicle before there are any data")
        with section("Begin", "A new folder with one file, campaign.toml. Nothing that is there already is changed."):
            with ui.element("div").classes("line"):
                self.name = ui.input("Name").props(LOOK)
                shown = {name: f"{name}: {meaning}" for name, meaning in starts.items()}
                self.start = ui.select(shown, value="design", label="Begin from").props(LOOK).classes("wide")
                self.start.on_value_change(self.show)
            markup(Markup('<p class="note">{}</p>').format(f"{EXAMPLES} An empty field removes its key."))
        self.place = ui.element("div")
        with section("Check and begin"):
            with ui.element("div").classes("line"):
                button("Begin", self._begin, main=True)
                button("Show the campaign file", self._preview)
            self.messages = ui.element("div")

    async def show(self) -> None:
        """Show a field for each value of the file."""
        await fill(self.place, self.context.worker_pool.think("beginning", "", str(self.start.value)), self._build)

    def _build(self, answer: Any) -> None:
        text, questions = answer

        def ask(answers: Any) -> Any:
            return self.context.worker_pool.think("asked", text, answers)

        self.form = TableForm(self.context, text, questions, self.messages, ask)

    async def _text(self) -> tuple[Path, str, tuple[str, ...]] | None:
        """Check everything; returns the new folder, the text of its file and what is worth correcting in it, or None where something is
        wrong, which is shown."""
        self.messages.clear()
        self.name.error = None
        if self.form is None:
            return None
        try:
            folder = self.context.campaign_paths.new_folder(self.name.value or "")
        except InputError as error:
            self.name.error = error.sentence(with_remedy=False)
            self.form.complain("Some fields are wrong: see the messages beside them. Nothing was written.")
            return None
        edited = await self.form.checked(folder, (("campaign.name", folder.name),))
        return None if edited is None else (folder, *edited)

    async def _preview(self) -> None:
        if (made := await self._text()) is not None:
            with self.messages:
                words = '<p class="done" role="status">It can be used.</p>{}<pre tabindex="0">{}</pre>'
                markup(Markup(words).format(cautions_html(made[2]), made[1]))

    async def _begin(self) -> None:
        if (made := await self._text()) is None:
            return
        folder, text, _ = made
        try:
            self.context.campaign_paths.begin(folder, text)
        except (SeatrialError, OSError) as error:
            with self.messages:
                say(error)
            return
        ui.navigate.to(link("import" if self.start.value in OF_LOGS else "design", folder.name))
