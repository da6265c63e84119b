"""A new campaign by case: a log, a trial to plan, or the bag of an ROV; nothing is written before all is checked."""

import asyncio
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.toml import toml_content
from seatrial.campaign.config.toml_edit import with_values
from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.cli.questions import Question
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.signals import PROPULSION, SIGNALS, is_thruster
from seatrial.dashboard import channel_map
from seatrial.dashboard.app_context import AppContext, cautions_html, fill, markup, say, saying
from seatrial.dashboard.campaign_paths import logs_of
from seatrial.dashboard.channel_map import Mapped
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.next_step import find_next_step
from seatrial.dashboard.page_layout import button, frame, link, section
from seatrial.dashboard.pages.import_form import upload_field
from seatrial.dashboard.pages.map_rows import ChannelRow
from seatrial.dashboard.table_form import LOOK, Answers, TableForm
from seatrial.dashboard.terms import words_of
from seatrial.dashboard.view_models import beside
from seatrial.report.labels import name_html
from seatrial.vehicles.catalogue import vehicle_names

EXAMPLES = "The numbers in its campaign.toml (mass, trim, priors, noise) are examples: correct them to your vehicle."
OWN = {"": "your own vehicle"}
"""What stands for no published vehicle."""


class Case(NamedTuple):
    """How a campaign begins: its title, what is done in it, the vehicle at first, and whether there is a log."""

    title: str
    words: str
    vehicle: str = ""
    has_log: bool = True


CASES = {
    "log": Case(
        "I have a log",
        "Of a published vehicle, or of your own in surge. Columns, units and ranges are guessed from it.",
    ),
    "plan": Case("I plan a trial", "A first trial is designed within the limits that you state.", has_log=False),
    "bag": Case(
        "I have an ROV bag",
        "ROS bag, ArduSub or PX4 log of a BlueROV2 Heavy. In a shell: `seatrial init DIR --vehicle bluerov2_heavy --log dive_bag`",
        "bluerov2_heavy",
    ),
}
"""Cases by the word that stands for them in the address."""


async def build(context: AppContext, case: str) -> None:
    """Build the page."""
    with frame(context, "new"):
        markup(doors_html(case))
        if case in CASES:
            await Start(context, CASES[case]).build()


def doors_html(case: str) -> Markup:
    """Return the cases as links; one may be chosen."""
    html = '<li><a class="card" href="/new?case={}"{}><strong>{}</strong><span>{}</span></a></li>'
    here = Markup(' aria-current="page"')
    doors = (
        Markup(html).format(key, here if key == case else "", one.title, name_html(one.words, {}))
        for key, one in CASES.items()
    )
    return Markup('<ul class="cards doors">{}</ul>').format(Markup("").join(doors))


class Start:
    """Name, log and vehicle of a new campaign, and the values of its file."""

    def __init__(self, context: AppContext, case: Case):
        self.context, self.case, self.root = context, case, context.campaign_paths.root
        self.form: TableForm | None = None
        self.rows: dict[str, ChannelRow] = {}
        self.learnt: ui.select | None = None
        self.path: Path | None = None

    async def build(self) -> None:
        """Build the form."""
        with section(self.case.title):
            with ui.element("div").classes("line"):
                self.name = ui.input("Name").props(LOOK)
                if self.case.has_log:
                    self.log = ui.input("Log, below the folder that is served").props(f"{LOOK} list=logs")
                    self.log.classes("wide").on("change", self.show)
                    there = await asyncio.to_thread(self._logs)
                    options = Markup("").join(Markup('<option value="{}"></option>').format(one) for one in there)
                    markup(Markup('<datalist id="logs">{}</datalist>').format(options))
                names = OWN | {name: name for name in vehicle_names()}
                self.vehicle = ui.select(names, value=self.case.vehicle, label="Vehicle").props(LOOK)
                self.vehicle.on_value_change(self.show)
            if self.case.has_log:
                upload_field("", self._sent)
            self.state = markup("").props('aria-live="polite"')
            self.place = ui.element("div")
            with ui.element("div").classes("line"):
                button("Begin", self._begin, main=True)
                button("Show the campaign file", self._preview)
            self.messages = ui.element("div")
        await self.show()

    def _logs(self) -> list[str]:
        from seatrial.dashboard.logs import SUFFIXES

        return [one for one in logs_of(self.root, SUFFIXES) if not {"results", "export"} & {*Path(one).parts}]

    async def _sent(self, kind: str, words: str) -> None:
        waiting = Markup('<p class="waiting">sending {} …</p>').format(words)
        self.state.set_content(waiting if kind == "sending" else "")
        self.log.error = words if kind == "refused" else None
        if kind == "kept":
            self.log.value = words
            await self.show()

    async def show(self) -> None:
        """Show a field for each value of the file."""
        self.form, self.rows, self.learnt = None, {}, None
        self.vehicle.error = None
        self.place.clear()
        if self.case.has_log:
            self.log.error = None
            if not str(self.log.value or "").strip():
                return
        await fill(self.place, self._asked(), self._build)

    async def _asked(self) -> Any:
        """Return the campaign file, the questions about it, and what a log of one's own vehicle holds; None if that cannot be."""
        vehicle, ask = str(self.vehicle.value or ""), self.context.worker_pool.think
        try:
            if not self.case.has_log:
                self.path = None
                return *await ask("beginning", str(self.root / "new"), vehicle), None
            from seatrial.dashboard.logs import look_into

            self.path = self.context.campaign_paths.log(str(self.log.value).strip())
            self.named = f"logs/{self.path.name}"
            about = str(self.root / "new"), vehicle, str(self.path), self.named
            begun = await ask("beginning", *about, files=[self.path])
            if vehicle:
                return *begun, None
            return *begun, await asyncio.to_thread(look_into, str(self.path), self.named, ("u", *PROPULSION))
        except (SeatrialError, OSError) as error:
            of_vehicle = isinstance(error, InputError) and error.where.startswith("--vehicle")
            (self.vehicle if of_vehicle or not self.case.has_log else self.log).error = beside(error)
            return None

    def _build(self, answer: Any) -> None:
        if answer is None:
            return
        text, questions, log = answer
        content = toml_content(CAMPAIGN, text)
        control, first = content["design"]["control"], {}
        if not self.vehicle.value:
            first["vehicle.mass"] = "Mass, such as 30 kg"
        if not self.case.has_log:
            self._ask_terms(content["structure"])
            of_control = SIGNALS[control.partition("_")[0] if is_thruster(control) else control].meaning
            words = {"lower": f"Least {of_control}, {control}", "upper": f"Greatest {of_control}, {control}"}
            first |= {f"limits.{control}.{end}": label for end, label in words.items()}
            first |= {"design.duration": "Duration"}
        elif log is not None:
            self.draft = MapDraft(self.root / "new", files=channel_map.files_of(text), logs={self.named: log})
            mapped = self.draft.channels
            for channel, words in ((control, "Control"), ("u", "Measured speed")):
                self.rows[channel] = ChannelRow(
                    self.draft, channel, mapped.get(channel), channel == control, self._map, ("unit",), words
                )
        else:
            mapped = channel_map.channels_of(channel_map.files_of(text))
            words = "; ".join(f"{channel} from {one.get('column', '')}" for channel, one in mapped.items())
            note = '<p class="note">Channels and their columns: {}. You can correct them on the next page.</p>'
            markup(Markup(note).format(words))

        async def ask(answers: Any) -> Any:
            return self._without_terms(await self.context.worker_pool.think("asked", text, answers))

        about = text, self._without_terms(questions), self.messages, ask
        self.form = TableForm(self.context, *about, first=first, elsewhere=self._complain)

    def _without_terms(self, questions: Sequence[Question]) -> list[Question]:
        """Leave out the terms if there is a field for them already."""
        return [one for one in questions if self.learnt is None or not one.key.startswith("structure.")]

    def _ask_terms(self, structure: Mapping[str, Any]) -> None:
        terms = [*structure.get("always", ()), *structure.get("optional", ())]
        options = {name: f"{name}: {words}" if (words := words_of(name)) else name for name in terms}
        self.structure = structure
        with ui.element("div").classes("line"):
            self.learnt = ui.select(options, value=terms, label="What to learn", multiple=True).props(LOOK)
            self.learnt.classes("wide")

    def _map(self, channel: str, mapped: Mapped | None) -> None:
        """Take another column for a channel; the limits of a control are then those that the column shows."""
        before = self.draft.channels.get(channel, {}).get("column")
        self.draft.files = channel_map.with_channel(self.draft.files, channel, mapped)
        row, form = self.rows[channel], self.form
        if form is None or mapped is None or mapped.column == before:
            return
        _, column = self.draft.columns.get(str(row.column.value), ("", None))
        for end, value in zip(("lower", "upper"), column.spread.split(" to ") if column else (), strict=False):
            if field := form.fields.get(f"limits.{channel}.{end}"):
                field.value = f"{value} {mapped.values['unit'] or shown_unit(channel)[1]}"

    def _complain(self, error: InputError) -> bool:
        """Show an error next to the field of a column or of the terms; return whether there is such a field."""
        at = re.search(r"channels\.([A-Za-z0-9_]+)(?:\.(\w+))?", error.where)
        if at is not None and at[1] in self.rows:
            self.rows[at[1]].complain(beside(error), at[2])
            return True
        if self.learnt is not None and "structure" in error.where:
            self.learnt.error = beside(error)
            return True
        return False

    async def _text(self) -> tuple[Path, str, tuple[str, ...]] | None:
        """Check all fields; return the new folder, the text of its file and the cautions about it, or None after errors were shown."""
        self.messages.clear()
        self.name.error = None
        for row in self.rows.values():
            row.complain("")
        try:
            folder = self.context.campaign_paths.new_folder(self.name.value or "")
        except InputError as error:
            self.name.error = error.sentence(with_remedy=False)
            folder = None
        form = self.form
        if form is None and self.case.has_log and not self.log.error:
            self.log.error = "Choose a log, or send one."
        unmapped = [row for row in self.rows.values() if row.channel not in self.draft.channels]
        for row in unmapped:
            row.complain("Choose a column.", "column")
        without_unit = [row for row in self.rows.values() if row.lacks_unit]
        for row in without_unit:
            row.complain(f'Write the unit, such as "{shown_unit(row.channel)[1]}".', "unit")
        if folder is None or form is None or unmapped or without_unit:
            with self.messages:
                say("Some fields are wrong: see the messages next to them. Nothing was written.")
            return None
        more: Answers = (("campaign.name", folder.name),)
        if self.learnt is not None:
            self.learnt.error = None
            chosen = {*(self.learnt.value or ())}
            kept = {key: [one for one in self.structure.get(key, ()) if one in chosen] for key in self.structure}
            more += tuple((f"structure.{key}", ", ".join(names)) for key, names in kept.items() if key != "rules")
        if self.rows:
            form.text = with_values(form.text, {("import", "files"): self.draft.files})
        edited = await form.checked(folder, more)
        return None if edited is None else (folder, *edited)

    async def _preview(self) -> None:
        if (made := await self._text()) is not None:
            with self.messages:
                words = '<p class="done" role="status">The campaign file can be used.</p>{}<pre tabindex="0">{}</pre>'
                markup(Markup(words).format(cautions_html(made[2]), made[1]))

    async def _begin(self) -> None:
        if (made := await self._text()) is None:
            return
        folder, text, _ = made
        with saying(self.messages):
            await asyncio.to_thread(self.context.campaign_paths.begin, folder, text, self.path)
            step = await find_next_step(self.context, folder)
            ui.navigate.to(link(step.view, folder.name))
