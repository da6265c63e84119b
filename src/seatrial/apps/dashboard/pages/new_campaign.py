"""A new campaign by form: what `seatrial init` asks, what is wrong beside each field, nothing written before all is checked."""

import re
from collections.abc import Callable, Collection
from contextlib import suppress
from math import isfinite
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, cautions_html, fill, markup, say
from seatrial.apps.dashboard.new_campaign_rows import Kind, field_of, kinds
from seatrial.apps.dashboard.page_layout import button, frame, link, section
from seatrial.apps.dashboard.view_models import PublishedTerms, beside, input_error_of
from seatrial.campaign.config.new_campaign import OWN, PUBLISHED, SCALARS, NewCampaign, read_inertia
from seatrial.campaign.config.new_campaign_file import SURGE
from seatrial.campaign.config.templates import TEMPLATES, WRITTEN
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.term_checks import terms_that_may_be_one
from seatrial.core.units import quantity

STARTS = {
    "own": "a vehicle of your own: asks for its mass, coefficients and controls",
    "published": "a published vehicle",
} | {name: meaning for name, meaning in TEMPLATES.items() if name not in WRITTEN}
"""What a campaign may begin from: the form, filled in with an example, or a file."""
OF_LOGS = ("log", "bollard")
"""Files whose campaign goes on with a log."""
EXAMPLES = "The numbers in its campaign.toml (mass, trim, priors, noise) are examples: correct them to your vehicle."
_TO_THE_FIRST = 'document.querySelector(".q-field--error, p.wrong")?.scrollIntoView({ block: "center" })'
"""Shows the first field that is wrong: the button stands far below it."""
LOOK = "outlined dense stack-label hide-bottom-space no-error-icon"
TEXTS = {
    "mass": ("Mass in air", "30 kg"),
    "inertia": ("Inertia, three axes", "0.2, 3.4, 3.4 kg m^2"),
    "thrust_deduction": ("Thrust deduction", "0.1"),
    "speed": ("Speed at the start", "1.5 m/s"),
    "duration": ("Duration of a trial", "60 s"),
}
"""Label and example of the options that are one text."""


async def build(context: AppContext) -> None:
    """Build the page."""
    with frame(context, "new"):
        await Start(context).show()


class Start:
    """Name and kind of a new campaign, and the form below them."""

    def __init__(self, context: AppContext):
        self.context = context
        with section("Begin", "A new folder with one file, campaign.toml. Nothing that is there already is changed."):
            with ui.element("div").classes("line"):
                self.name = ui.input("Name").props(LOOK)
                self.start = ui.select(STARTS, value="own", label="Begin from").props(f"{LOOK} options-dense")
                self.start.classes("wide").on_value_change(self.show)
            self.meaning = markup("").props('aria-live="polite"')
        self.forms: dict[str, Form] = {}
        self.places = {"own": ui.element("div"), "published": ui.element("div")}
        with section("Check and begin"):
            with ui.element("div").classes("line"):
                button("Begin", self._begin, main=True)
                button("Show the campaign file", self._preview)
            self.said = ui.element("div")

    async def show(self) -> None:
        """Show the form of what was chosen to begin from; what was typed in another is kept."""
        start = str(self.start.value)
        for name, place in self.places.items():
            place.set_visibility(name == start)
        is_form = start in self.places
        words = "The fields below hold an example: put your vehicle in its place." if is_form else STARTS[start]
        if start in OF_LOGS:
            words = f"{words[:1].upper()}{words[1:]}. {EXAMPLES} "
            words += "To be asked for them, begin from a vehicle of your own; its log is added on the page Records too."
        self.meaning.set_content(Markup('<p class="note">{}</p>').format(words))
        if start == "own" and start not in self.forms:
            with self.places[start]:
                self.forms[start] = Form(OWN)
        if start == "published" and start not in self.forms:

            def made(found: tuple[PublishedTerms, ...]) -> None:
                self.forms[start] = Form(PUBLISHED, found)

            await fill(self.places[start], self.context.worker_pool.think("published_terms"), made)

    async def _text(self) -> tuple[Any, str, tuple[str, ...]] | None:
        """Check everything; returns the new folder, the text of its file and what is worth correcting in it, or None where something is
        wrong, which is said."""
        self.said.clear()
        start, folder = str(self.start.value), None
        self.name.error = None
        try:
            folder = self.context.campaign_paths.new_folder(self.name.value or "")
        except InputError as error:
            self.name.error = error.sentence(with_remedy=False)
        said = self.forms[start].read() if start in self.forms else {}
        with self.said:
            if folder is None or said is None:
                return _refuse()
            try:
                template = "" if start in self.places else start
                about = str(folder), folder.name, template, tuple(said.items())
                return folder, *await self.context.worker_pool.think("begun", *about)
            except (SeatrialError, OSError) as error:
                read = input_error_of(error)
                if read is not None and start in self.forms and self.forms[start].complain(read):
                    return _refuse()
                say(error)
        return None

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


class Form:
    """What is known of a vehicle, sought, driven, measured and allowed.

    Args:
        new: what stands in the fields at first.
        published: vehicles to choose from; none for one of one's own.
    """

    def __init__(self, new: NewCampaign, published: tuple[PublishedTerms, ...] = ()):
        self.published = {one.name: one for one in published}
        self.texts: dict[str, ui.input] = {}
        self.refused: dict[str, str] = {}
        with section("Vehicle"):
            with ui.element("div").classes("line"):
                if published:
                    self.vehicle = ui.select(list(self.published), value=new.vehicle, label="Published vehicle")
                    self.vehicle.props(f"{LOOK} options-dense").on_value_change(self._of_vehicle)
                else:
                    self._text("mass", new.mass)
                    self._text("inertia", ", ".join(new.inertia))
                    self._text("thrust_deduction", new.thrust_deduction)
                self.moves = ui.select(list("uvwpqr"), value=list(new.moves or "u"), multiple=True)
                self.moves.props(f'{LOOK} options-dense label="Velocities that are modelled" use-chips')
                self._text("speed", new.speed)
            self.terms = markup("").props('aria-live="polite"')
        self.rows: list[Rows] = []
        for kind in kinds(bool(published)):
            self.rows.append(Rows(kind, kind.rows(new), self._compare))
            if kind.option == "optional":
                self.cautions = markup("").props('aria-live="polite"')
        with section("Trial"), ui.element("div").classes("line"):
            self._text("duration", new.duration)
        if published:
            self._of_vehicle()

    def _text(self, option: str, value: str) -> None:
        label, example = TEXTS[option]
        self.texts[option] = ui.input(label, value=value, placeholder=_example(example)).props(LOOK)
        self.texts[option].on("blur", lambda: self._left_text(option))

    def _of_vehicle(self) -> None:
        chosen = self.published[str(self.vehicle.value)]
        is_surge = chosen.name.endswith(SURGE)
        self.moves.set_visibility(not is_surge)
        self.texts["speed"].set_visibility(not is_surge)
        self.terms.set_content(
            Markup('<p class="note">Published: {}.</p>').format(", ".join(chosen.terms) or "no terms")
        )

    def _compare(self) -> None:
        """Say which of the coefficients a record may not tell apart."""
        terms = []
        for rows in self.rows:
            if rows.kind.option in ("seek", "optional"):
                for row in rows.rows:
                    with suppress(InputError):  # said beside the row
                        terms.append(CoefficientName.parse((row.fields["name"].value or "").strip()))
        self.cautions.set_content(cautions_html(terms_that_may_be_one(terms)))

    def _left_text(self, option: str) -> None:
        """Check a field that was left, unless it still says what the whole campaign refused."""
        if self.texts[option].value != self.refused.get(option):
            self._check_text(option)

    def _check_text(self, option: str) -> bool:
        form, value = self.texts[option], (self.texts[option].value or "").strip()
        form.error = None
        try:
            if option == "inertia":
                _ = read_inertia(value, option) if value else ()
            elif value or option in ("mass", "duration"):
                quantity(value, SCALARS[option], option)
        except InputError as error:
            form.error = error.sentence()
        return form.error is None

    def complain(self, error: InputError) -> bool:
        """Say beside its field what is wrong with the campaign that the form makes; returns whether a field says what is wrong."""
        option, name = field_of(error.where)
        if option in self.texts and self.texts[option].visible:
            self.refused[option] = self.texts[option].value
            self.texts[option].error = _remedied(error, "empty this field")
            return True
        if option == "moves" and self.moves.visible:
            self.moves.error = _remedied(error, "choose others")
            return True
        rows = [row for rows in self.rows if rows.kind.option == option for row in rows.rows if row.name == name]
        if rows:
            rows[-1].refused = rows[-1].line()
            rows[-1].complain(_remedied(error, "remove this row"))
        return bool(rows)

    def read(self) -> dict[str, Any] | None:
        """Return what the form says, as the options of `seatrial init` have it; None where something is wrong."""
        self.moves.error = None
        self.refused.clear()
        is_right = [self._check_text(option) for option in self.texts] + [rows.check() for rows in self.rows]
        if not all(is_right):
            return None
        said: dict[str, Any] = {
            option: (form.value or "").strip() for option, form in self.texts.items() if form.visible
        }
        if self.published:
            said["vehicle"] = str(self.vehicle.value)
        if self.moves.visible:
            said["moves"] = ",".join(one for one in "uvwpqr" if one in self.moves.value)
        said |= {rows.kind.option: rows.lines() for rows in self.rows}
        return {option: value for option, value in said.items() if value}


class Rows:
    """The rows of one kind, to which others can be added."""

    def __init__(self, kind: Kind, first: list[dict[str, str]], changed: Callable[[], None]):
        self.kind, self.rows, self.changed = kind, [], changed
        with section(kind.title, kind.note):
            self.place = ui.element("div")
            for row in first or [{}] * kind.least:
                self._add(row)
            self.wrong = _wrong()
            button(f"Add a {kind.one}" if kind.one[0] not in "aeiou" else f"Add an {kind.one}", lambda: self._add({}))

    def _add(self, values: dict[str, str]) -> None:
        with self.place:
            self.rows.append(OneRow(self.kind, values, self._remove, self.changed))

    def _remove(self, row: "OneRow") -> None:
        self.rows.remove(row)
        row.part.delete()
        self.changed()

    def check(self) -> bool:
        """Say beside every row what is wrong with it, and whether any are missing; returns whether all is right."""
        is_right = [row.check() for row in self.rows]
        few = len(self.lines()) < self.kind.least
        self.wrong.set_content(_wrong_html("One at least is needed.") if few else "")
        return all(is_right) and not few

    def lines(self) -> tuple[str, ...]:
        """Return what the rows say; rows that are empty say nothing."""
        return tuple(row.line() for row in self.rows if row.line())


class OneRow:
    """One row of fields, and what is wrong with it."""

    def __init__(
        self, kind: Kind, values: dict[str, str], remove: Callable[["OneRow"], None], changed: Callable[[], None]
    ):
        self.kind, self.changed, self.refused = kind, changed, ""
        with ui.element("div").props(f'role=group aria-label="{kind.one}"') as self.part:
            with ui.element("div").classes("line fields"):
                self.fields = {}
                for key, (label, example) in kind.fields.items():
                    offered = list(kind.offered) if key == "name" else None
                    form = ui.input(
                        label, value=values.get(key, ""), placeholder=_example(example), autocomplete=offered
                    )
                    self.fields[key] = form.props(LOOK).on("blur", self._left)
                button("✕", lambda: remove(self)).props(f'aria-label="Remove this {kind.one}"').classes("remove")
            self.wrong = _wrong()

    def _left(self) -> None:
        if self.wrong.content and self.line() != self.refused:  # what was wrong may be right now
            self.check()
        self.changed()

    @property
    def name(self) -> str:
        """What the row is about, such as a coefficient."""
        return (self.fields["name"].value or "").strip()

    def line(self) -> str:
        """Return what the row says, as a line of the option; empty where nothing is written in it."""
        row = {key: (form.value or "").strip() for key, form in self.fields.items()}
        return self.kind.line(row) if any(value for key, value in row.items() if key != "unit") else ""

    def check(self) -> bool:
        """Say what is wrong; returns whether nothing is."""
        words, line, at_fault = "", self.line(), []
        if line:
            try:
                self.kind.read(line, self.kind.one)
            except InputError as error:
                words, at_fault = error.sentence(), list(self.fields)
                if wrong := [key for key in self.kind.numbers if not _is_number(self.fields[key].value)]:
                    said = [f'"{self.fields[key].value}" under "{self.kind.fields[key][0]}"' for key in wrong]
                    words, at_fault = (
                        f"{', '.join(said)}: expected a number, such as {self.kind.fields[wrong[0]][1] or 1}",
                        wrong,
                    )
        self.complain(words, at_fault)
        return not words

    def complain(self, words: str, at_fault: Collection[str] = ("name",)) -> None:
        """Say what is wrong with the row, and outline the fields that are at fault; nothing if empty."""
        self.wrong.set_content(_wrong_html(words) if words else "")
        for key, form in self.fields.items():
            is_wrong = bool(words) and key in at_fault
            form.props("error" if is_wrong else "", remove="" if is_wrong else "error")


def _remedied(error: InputError, instead: str) -> str:
    """Return what is wrong beside its field; what is removed from a file is not typed into a form."""
    return re.sub(r"\bremove it\b(?! here)", instead, beside(error))


def _refuse() -> None:
    """Say that fields are wrong, and show the first one."""
    say("Some fields are wrong: see the messages beside them. Nothing was written.")
    ui.run_javascript(_TO_THE_FIRST)


def _example(text: str) -> str:
    """What stands grey in an empty field, so that nobody takes it for an entry."""
    return f"e.g. {text}" if text else ""


def _is_number(text: str | None) -> bool:
    """Whether a field holds a number; an empty one is not wrong by itself."""
    try:
        return not (text or "").strip() or isfinite(float(text or ""))
    except ValueError:
        return False


def _wrong() -> ui.html:
    return markup("").props('role="alert"')


def _wrong_html(words: str) -> Markup:
    return Markup('<p class="wrong">{}</p>').format(words)
