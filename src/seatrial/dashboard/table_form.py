"""A form of tables of a campaign file: a field for each value, with the meaning, the choices and the default that the schema has."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import groupby
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import write_file
from seatrial.cli.questions import CHANGING, Question, key_at
from seatrial.core.errors import InputError, SeatrialError
from seatrial.dashboard.app_context import AppContext, cautions_html, markup, say
from seatrial.dashboard.page_layout import button, section
from seatrial.dashboard.view_models import beside

LOOK = "outlined dense options-dense stack-label hide-bottom-space no-error-icon"
_TO_THE_FIRST = 'document.querySelector(".q-field--error")?.scrollIntoView({ block: "center" })'
"""Shows the first field that is wrong: the button may stand far below it."""

Answers = tuple[tuple[str, str], ...]  # As they are typed, by key


def field_of(question: Question, label: str) -> ui.input | ui.select:
    """Return a field for a value: a choice where only some values are possible."""
    if question.choices:
        options = {"": f"not stated: {question.default}" if question.default else "not stated"}
        options |= {one: one for one in question.choices}
        field = ui.select(options, value=question.value, label=label)
    else:
        field = ui.input(label, value=question.value, placeholder=question.default)
    return field.props(LOOK).tooltip(question.meaning)


class TableForm:
    """Fields for values of a campaign file; nothing is written before the whole file was checked.

    Args:
        context: what is served.
        text: of the file.
        questions: about its values.
        ask: for the questions that some answers leave; None if no answer changes them.
        notes: beside the names of tables.
        messages: element for what concerns the form as a whole; it may stay when the form is built again.
        first: label of each value that is asked for at first, by key; all others are folded. Without any nothing is folded.
        elsewhere: shows an error next to a field of another form, and returns whether there is one.
    """

    def __init__(
        self,
        context: AppContext,
        text: str,
        questions: Sequence[Question],
        messages: ui.element,
        ask: Callable[[Answers], Awaitable[Sequence[Question]]] | None = None,
        notes: Mapping[str, str] | None = None,
        first: Mapping[str, str] | None = None,
        elsewhere: Callable[[InputError], bool] = lambda error: False,
    ):
        self.context, self.text, self.messages, self.ask, self.notes = context, text, messages, ask, notes or {}
        self.first, self.elsewhere, self.is_open = first, elsewhere, False
        self.answers: dict[str, str] = {}
        self.fields: dict[str, ui.input | ui.select] = {}
        self.place = ui.element("div")
        self._build(questions)

    def _build(self, questions: Sequence[Question]) -> None:
        """Show a field for each value, a line for each table; tables without any value come last, folded."""
        self.place.clear()
        self.fields.clear()
        self.stated = {one.key: one.value for one in questions}
        with self.place:
            if self.first is None:
                self._tables(questions)
                return
            self._line([one for key in self.first for one in questions if one.key == key])
            self.more = ui.element("details").props("open" if self.is_open else "")
            with self.more:
                with ui.element("summary"):
                    markup("More")
                self._tables([one for one in questions if one.key not in self.first])

    def _tables(self, questions: Sequence[Question]) -> None:
        tables = {name: list(group) for name, group in groupby(questions, lambda one: one.key.rpartition(".")[0])}
        has_sections = len({name.partition(".")[0] for name in tables}) > 1
        for name, lines in groupby(tables.values(), lambda group: group[0].key.partition(".")[0]):
            lines = list(lines)
            is_empty = [not any(one.value for one in line) for line in lines]
            with section(f"[{name}]", self.notes.get(name, "")) if has_sections else nullcontext():
                for line in (line for line, empty in zip(lines, is_empty, strict=True) if not empty):
                    self._line(line)
                if any(is_empty):
                    with ui.element("details"):
                        with ui.element("summary"):
                            markup("Not stated")
                        for line in (line for line, empty in zip(lines, is_empty, strict=True) if empty):
                            self._line(line)

    def _line(self, questions: Sequence[Question]) -> None:
        with ui.element("div").classes("line"):
            for question in questions:
                *tables, name = question.key.split(".")
                label = (self.first or {}).get(question.key) or (f"{tables[-1]}: {name}" if len(tables) > 1 else name)
                field = self.fields[question.key] = field_of(question, label)
                left = partial(self._left, question.key)
                if question.choices:
                    field.on_value_change(left)
                else:
                    field.on("blur", left)

    async def _left(self, key: str) -> None:
        """Forget what was wrong with a value; one such as a list of terms adds questions and removes others."""
        if key not in self.fields:
            return
        self.fields[key].error = None
        value = str(self.fields[key].value or "")
        if self.ask is None or value == self.stated[key] or key.rpartition(".")[2] not in CHANGING:
            return
        self.is_open = True  # what changes questions is asked for there
        try:
            self._build(await self.ask(self.changes()))
        except (SeatrialError, OSError) as error:
            self.fields[key].error = beside(error)

    async def add(self, key: str, name: str, lists: Sequence[str]) -> bool:
        """Add a name to a list of names, and go to its prior; returns whether it was in none of some lists."""
        names = {
            one: [part.strip() for part in str(self.fields[one].value or "").split(",") if part.strip()]
            for one in lists
        }
        if any(name in one for one in names.values()):
            return False
        self.fields[key].value = ", ".join([*names[key], name])
        await self._left(key)
        of_prior = [field for one, field in self.fields.items() if one.startswith(f"prior.{name}.")]
        for field in of_prior[1:2] or [self.fields[key]]:  # the first is the distribution
            field.run_method("focus")
        return True

    @property
    def is_edited(self) -> bool:
        """Whether something was chosen or typed that is not saved."""
        return bool(self.changes())

    def changes(self) -> Answers:
        """Return all answers that differ from what the file says."""
        now = {key: str(field.value or "").strip() for key, field in self.fields.items()}
        self.answers |= {key: value for key, value in now.items() if key in self.answers or value != self.stated[key]}
        return tuple(self.answers.items())

    def complain(self, error: SeatrialError | OSError | str) -> None:
        """Show what is wrong beside the field that it is about, else with the form."""
        if isinstance(error, InputError):
            key = key_at(error.where, list(self.fields))
            if key is not None:
                self.fields[key].error = beside(error)
                if self.first is not None and key not in self.first:
                    self.more.props("open")
            if key is not None or self.elsewhere(error):
                error = "Some fields are wrong: see the messages next to them. Nothing was written."
        self.messages.clear()
        with self.messages:
            say(error)
            ui.run_javascript(_TO_THE_FIRST)

    async def checked(self, folder: Path, more: Answers = ()) -> tuple[str, tuple[str, ...]] | None:
        """Check the file with the answers; returns its text and what to know about it, or None if something is wrong, which is shown."""
        self.messages.clear()
        for field in self.fields.values():
            field.error = None
        try:
            return await self.context.worker_pool.think("edited", str(folder), self.text, (*self.changes(), *more))
        except (SeatrialError, OSError) as error:
            self.complain(error)
        return None

    def offer_save(self, folder: Path, saved: Markup) -> None:
        """Build the button that writes a campaign file that is there; `saved` says what comes next."""

        async def save() -> None:
            edited = await self.checked(folder)
            if edited is None:
                return
            text, cautions = edited
            try:
                if text != self.text:
                    write_file(folder, text, self.text)
            except (SeatrialError, OSError) as error:
                self.complain(error)
                return
            with self.messages:
                markup(saved if text != self.text else '<p class="note" role="status">Nothing was changed.</p>')
                markup(cautions_html(cautions))
            self.text, self.answers = text, {}
            self.stated |= {key: str(field.value or "").strip() for key, field in self.fields.items()}

        with ui.element("div").classes("line"):
            button("Check and save", save, main=True)
