"""A new campaign by form: a template or a published vehicle, its values to change, nothing written before all is checked."""

from itertools import groupby
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.templates import TEMPLATES
from seatrial.cli.questions import Question, key_at
from seatrial.core.errors import InputError, SeatrialError
from seatrial.dashboard.app_context import AppContext, cautions_html, markup, say
from seatrial.dashboard.page_layout import button, frame, link, section
from seatrial.dashboard.view_models import beside
from seatrial.vehicles.catalogue import vehicle_names

OF_LOGS = ("log", "bollard")
"""Templates whose campaign goes on with a log."""
EXAMPLES = "The numbers in its campaign.toml (mass, trim, priors, noise) are examples: correct them to your vehicle."
_TO_THE_FIRST = 'document.querySelector(".q-field--error")?.scrollIntoView({ block: "center" })'
"""Shows the first field that is wrong: the button stands far below it."""
LOOK = "outlined dense stack-label hide-bottom-space no-error-icon"
_OF_TERMS = ("structure.always", "structure.optional")
"""Answers that add questions and take others away."""


async def build(context: AppContext) -> None:
    """Build the page."""
    with frame(context, "new"):
        await Start(context).show()


class Start:
    """Name and kind of a new campaign, and the values of its file."""

    def __init__(self, context: AppContext):
        self.context = context
        self.fields: dict[str, ui.input] = {}
        self.answers: dict[str, str] = {}
        starts = TEMPLATES | dict.fromkeys(vehicle_names(), "a published vehicle before there are any data")
        with section("Begin", "A new folder with one file, campaign.toml. Nothing that is there already is changed."):
            with ui.element("div").classes("line"):
                self.name = ui.input("Name").props(LOOK)
                shown = {name: f"{name}: {meaning}" for name, meaning in starts.items()}
                self.start = ui.select(shown, value="design", label="Begin from").props(f"{LOOK} options-dense")
                self.start.classes("wide").on_value_change(self._begin_from)
            markup(Markup('<p class="note">{}</p>').format(f"{EXAMPLES} An empty field removes its key."))
        self.form = ui.element("div")
        with section("Check and begin"):
            with ui.element("div").classes("line"):
                button("Begin", self._begin, main=True)
                button("Show the campaign file", self._preview)
            self.said = ui.element("div")

    async def _begin_from(self) -> None:
        self.answers = {}
        await self.show()

    async def show(self) -> None:
        """Show a field for each value of the file; what was typed is kept."""
        try:
            questions = await self.context.worker_pool.think("asked", "", str(self.start.value), self._changed())
        except (SeatrialError, OSError) as error:
            with self.said:
                say(error)
            return
        self.form.clear()
        self.fields.clear()
        with self.form:
            for table, group in groupby(questions, lambda one: one.key.rpartition(".")[0]):
                with section(f"[{table}]") as part, ui.element("div").classes("line"):
                    part.props["aria-label"] = f"[{table}]"  # labels such as `noise` stand in several tables
                    for question in group:
                        self._add(question)

    def _add(self, question: Question) -> None:
        label = question.key.rpartition(".")[2]
        field = ui.input(label, value=question.value).props(LOOK).tooltip(question.meaning)
        self.fields[question.key] = field.on("blur", lambda: self._left(question))

    async def _left(self, question: Question) -> None:
        """Keep an answer; one about the terms asks for other priors."""
        value = str(self.fields[question.key].value or "")
        if value == self.answers.get(question.key, question.value):
            return
        self.answers[question.key] = value
        self.fields[question.key].error = None
        if question.key in _OF_TERMS:
            await self.show()

    def _changed(self) -> tuple[tuple[str, str], ...]:
        return tuple(self.answers.items())

    async def _text(self) -> tuple[Any, str, tuple[str, ...]] | None:
        """Check everything; returns the new folder, the text of its file and what is worth correcting in it, or None where something is
        wrong, which is said."""
        self.said.clear()
        self.name.error = None
        self.answers |= {key: str(field.value or "") for key, field in self.fields.items()}
        for field in self.fields.values():
            field.error = None
        try:
            folder = self.context.campaign_paths.new_folder(self.name.value or "")
        except InputError as error:
            self.name.error = error.sentence(with_remedy=False)
            return self._refuse()
        about = str(folder), folder.name, str(self.start.value), self._changed()
        try:
            return folder, *await self.context.worker_pool.think("begun", *about)
        except (SeatrialError, OSError) as error:
            key = key_at(error.where, list(self.fields)) if isinstance(error, InputError) else None
            if key is not None:
                self.fields[key].error = beside(error)
                return self._refuse()
            with self.said:
                say(error)
        return None

    def _refuse(self) -> None:
        """Say that fields are wrong, and show the first one."""
        with self.said:
            say("Some fields are wrong: see the messages beside them. Nothing was written.")
            ui.run_javascript(_TO_THE_FIRST)

    async def _preview(self) -> None:
        if (made := await self._text()) is not None:
            with self.said:
                words = '<p class="done" role="status">It can be used.</p>{}<pre tabindex="0">{}</pre>'
                markup(Markup(words).format(cautions_html(made[2]), made[1]))

    async def _begin(self) -> None:
        if (made := await self._text()) is None:
            return
        folder, text, _ = made
        try:
            self.context.campaign_paths.begin(folder, text)
        except (SeatrialError, OSError) as error:
            with self.said:
                say(error)
            return
        ui.navigate.to(link("import" if self.start.value in OF_LOGS else "design", folder.name))
