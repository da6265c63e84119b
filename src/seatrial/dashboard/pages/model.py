"""The model: the noise of the residuals, and which terms are always in it, may be in it, or are out of it."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import CAMPAIGN, read_file, write_file
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.term_checks import terms_that_may_be_one
from seatrial.dashboard.app_context import AppContext, cautions_html, keep_form, markup, say
from seatrial.dashboard.model_edits import Range, number, with_noise, with_priors, with_sizes, with_terms
from seatrial.dashboard.page_layout import button, link, section
from seatrial.dashboard.view_models import ModelData, NoisePrior, beside

KINDS = {
    "white": "white: independent errors",
    "coloured": "coloured: errors correlated in time",
    "heavy": "heavy: outliers among the errors",
    "drifting": "drifting: a slow error beside white",
}
ROLES = {"always": "always in", "optional": "may be in: the data decide", "out": "out"}
LOOK = "outlined options-dense hide-bottom-space no-error-icon"
FIELD = "outlined dense stack-label hide-bottom-space no-error-icon"
SIZES = {"warmup": "Warm-up, steps of each chain", "draws": "Draws, steps of each chain"}
OF_ALL = ""
"""Name of the noise of all sensors that state none."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    path, messages = folder / CAMPAIGN, ui.element("div").classes("said")
    await keep_form(
        path,
        lambda: context.worker_pool.think("model_data", str(folder), files=[path]),
        lambda found: ModelForm(context, campaign, folder, found, messages),
    )
    messages.move(target_index=-1)


class ModelForm:
    """The form; nothing is written before the whole file was checked.

    Args:
        context: what is served.
        campaign: its name below the root.
        folder: of the campaign.
        found: what the file says.
        said: element for what is said of the form as a whole; it stays when the form is built again.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path, data: ModelData, messages: ui.element):
        self.context, self.campaign, self.folder, self.found, self.said = context, campaign, folder, data, messages
        self.seen = read_file(folder)
        words = "If the report says that residuals are correlated, choose the noise that it names; drifting is white noise on a slow error."
        with section("Noise of the residuals", words):
            self.noise: dict[str, ui.select] = {}
            self.needs: dict[str, RangeFields] = {}
            self.stated: dict[str, ui.html] = {}
            with ui.element("div").classes("line"):
                self._noise(OF_ALL, "all sensors", data.residuals, KINDS)
            if len(data.sensors) > 1 or any(one.residuals for one in data.sensors):
                with ui.element("div").classes("line"):
                    for one in data.sensors:
                        self._noise(one.name, one.name, one.residuals, {"": "as all sensors", **KINDS})
            self.needed = ui.element("div")
        words = "A coefficient's name is its equation: X_uabsu multiplies u|u|. What is out keeps its published value, or is zero."
        with section("Terms", words):
            self.rows: dict[str, TermRow] = {}
            self.terms = ui.element("div")
            for role, names in (("always", data.always), ("optional", data.optional)):
                for name in names:
                    self._row(name, role, data.priors.get(name, "from what is known of the vehicle"))
            with ui.element("div").classes("line"):
                self.more = ui.input("Another term", placeholder="e.g. X_u", autocomplete=list(data.offered)).props(
                    FIELD
                )
                self.more.on("keydown.enter", self._add)
                button("Add the term", self._add)
            self.cautions = markup("").props('aria-live="polite"')
        words = "If an alarm asks for longer chains, such as warm-up and draws twice as many: multiples of 100."
        with section("Size of the chains", words), ui.element("div").classes("line"):
            self.sizes = {
                key: ui.input(SIZES[key], value=str(number)).props(FIELD) for key, number in data.sizes.items()
            }
        with ui.element("div").classes("line"):
            button("Check and save", self._save, main=True)
        self._show_needs()
        self._changed()
        self.first = self._state()

    @property
    def is_edited(self) -> bool:
        """Whether something was chosen or typed that is not saved."""
        return self._state() != self.first

    def _state(self) -> Any:
        ranges = [*self.needs.values(), *(row.range for row in self.rows.values())]
        return (
            {name: form.value for name, form in self.noise.items()},
            {name: row.role.value for name, row in self.rows.items()},
            [one.values for one in ranges if one.is_shown],
            [form.value for form in self.sizes.values()],
        )

    def _noise(self, name: str, words: str, value: str, kinds: dict[str, str]) -> None:
        form = ui.select(kinds, value=value, label=f"Noise of {words}", on_change=self._show_needs)
        self.noise[name] = form.props(LOOK).classes("wide")

    def _kind(self, sensor: str) -> str:
        chosen = self.noise.get(sensor)
        return str((chosen.value if chosen is not None else "") or self.noise[OF_ALL].value)

    def _wanted(self) -> dict[str, NoisePrior]:
        """Priors that the chosen kinds of noise have, by name."""
        return {prior.name: prior for one in self.found.sensors for prior in one.priors[self._kind(one.name)]}

    def _show_needs(self) -> None:
        wanted = self._wanted()
        for form in self.noise.values():
            form.error = None
        with self.needed:
            for name, prior in wanted.items():
                if prior.is_needed and name not in self.needs and name not in self.found.priors:
                    self.needs[name] = RangeFields(name, prior.words, prior.unit, prior.lower, prior.upper)
                if prior.is_needed and name in self.found.priors and name not in self.stated:
                    words = Markup('<p class="note">{}: {}; prior in campaign.toml: {}</p>')
                    self.stated[name] = markup(words.format(name, prior.words, self.found.priors[name]))
        for name, fields in self.needs.items():
            fields.show(name in wanted)
        for name, line in self.stated.items():
            line.set_visibility(name in wanted)

    def _row(self, name: str, role: str, prior: str, *, is_new: bool = False) -> None:
        with self.terms:
            remove = partial(self._remove, name) if is_new else None
            self.rows[name] = TermRow(name, role, prior, name in self.found.published, self._changed, remove)

    async def _add(self) -> None:
        name, self.more.error = (self.more.value or "").strip(), None
        try:
            term = CoefficientName.parse(name)
        except InputError as error:
            self.more.error = f"{name or 'Nothing'} is not a term: {error.remedy}"
            return
        same = next((one for one in self.rows if CoefficientName.parse(one) == term), None)
        if same is not None:
            self.more.error = f"{same} stands above: choose there whether it is in"
            return
        try:
            await self.context.worker_pool.think("check_term", str(self.folder), self.seen, name)
        except (SeatrialError, OSError) as error:
            self.more.error = beside(error)
            return
        if name not in self.rows and not self.more.is_deleted:
            self._row(name, "optional", self.found.priors.get(name, ""), is_new=True)
            self.more.value = ""
            self._changed()

    def _remove(self, name: str) -> None:
        self.rows.pop(name).part.delete()
        self._changed()

    def _changed(self) -> None:
        terms = [CoefficientName.parse(name) for name, row in self.rows.items() if row.role.value != "out"]
        self.cautions.set_content(cautions_html(terms_that_may_be_one(terms)))

    def _edited(self) -> str:
        """The campaign file as the form says it.

        Raises:
            InputError: a key that cannot be edited.
        """
        data, wanted = self.found, self._wanted()
        of_role = {
            role: [name for name, row in self.rows.items() if row.role.value == role] for role in ("always", "optional")
        }
        stated = {OF_ALL: data.residuals, **{one.name: one.residuals for one in data.sensors}}
        changed = {name: str(form.value) for name, form in self.noise.items() if form.value != stated[name]}
        text = with_noise(self.folder, self.seen, changed)
        sizes = {key: (form.value or "").strip() for key, form in self.sizes.items()}
        text = with_sizes(self.folder, text, {key: size for key, size in sizes.items() if size != str(data.sizes[key])})
        text = with_terms(self.folder, text, of_role["always"], of_role["optional"])
        of_noise = [prior.name for one in data.sensors for some in one.priors.values() for prior in some]
        idle = [name for name in of_noise if name not in wanted]
        idle += [name for name, row in self.rows.items() if row.role.value == "out"]
        new = [one.said("log-uniform") for one in self.needs.values() if one.is_shown]
        new += [row.range.said() for row in self.rows.values() if row.range.is_shown and any(row.range.values)]
        return with_priors(self.folder, text, new, [name for name in idle if name in data.priors])

    async def _save(self) -> None:
        self.said.clear()
        for form in (*self.noise.values(), *self.sizes.values(), *(row.role for row in self.rows.values())):
            form.error = None
        ranges = [*self.needs.values(), *(row.range for row in self.rows.values() if not row.may_be_published)]
        ranges += [row.range for row in self.rows.values() if row.may_be_published and any(row.range.values)]
        if [one for one in ranges if one.is_shown and not one.check()]:
            self._say("Some numbers are missing: see the messages beside them. Nothing was written.")
            return
        try:
            text = self._edited()
            cautions = await self.context.worker_pool.think("check", str(self.folder), text)
            if text != self.seen:
                write_file(self.folder, text, self.seen)
        except (SeatrialError, OSError) as error:
            if self._complain(error):
                error = "One of your choices cannot be: see the message beside it. Nothing was written."
            self._say(error)
            return
        words = (
            "Saved in campaign.toml. Results made before are stale now" if text != self.seen else "Nothing was changed"
        )
        self.seen, self.first = text, self._state()
        with self.said:
            html = '<p class="done" role="status">{}: <a href="{}">run it again</a>.</p>'
            if words.startswith("Saved"):
                markup(Markup(html).format(words, link("run", self.campaign)))
            else:
                markup(Markup('<p class="note" role="status">{}.</p>').format(words))
            markup(cautions_html(cautions))

    def _say(self, words: Any) -> None:
        with self.said:
            say(words)

    def _complain(self, error: BaseException) -> bool:
        """Say what is wrong beside the choice that it is about; returns whether there is one."""
        key = re.search(r"key ([A-Za-z0-9_.]+)", str(error))
        parts = key[1].split(".") if key else []
        if parts[:2] == ["estimation", "residuals"]:
            form = self.noise[OF_ALL]
        elif parts[:1] == ["estimation"] and parts[-1] in self.sizes:
            form = self.sizes[parts[-1]]
        elif parts[:1] == ["sensors"] and parts[-1] == "residuals":
            form = self.noise.get(parts[1], self.noise[OF_ALL])
        elif parts[:1] == ["prior"] and parts[1] in self.needs:
            form = self.needs[parts[1]].fields["lower"]
        else:
            place, _, text = str(error).partition("\n")
            names = re.findall(r"\b[A-Z]_\w+", f"{' '.join(parts[1:])} {place.partition(', term ')[2]} {text}")
            row = next((self.rows[name] for name in names if name in self.rows), None)
            if row is None:
                return False
            form = row.range.fields["lower"] if row.range.is_shown and parts[:1] == ["prior"] else row.role
        form.error = beside(error)
        return True


class RangeFields:
    """Ends of a prior that the file lacks.

    Args:
        name: of the parameter.
        words: what it is.
        unit: SI.
        lower: least value at first.
        upper: largest value at first.
    """

    def __init__(self, name: str, words: str, unit: str, lower: str = "", upper: str = ""):
        self.name = name
        with ui.element("div").props(f'role=group aria-label="prior of {name}"').classes("line fields") as self.part:
            markup(Markup('<p class="note">{}</p>').format(words))
            self.fields = {
                "lower": ui.input(f"{name}: least", value=lower, placeholder="e.g. -3.0").props(FIELD),
                "upper": ui.input(f"{name}: largest", value=upper, placeholder="e.g. 0.0").props(FIELD),
                "unit": ui.input(f"{name}: unit", placeholder=unit).props(FIELD),
            }
        self.is_shown = True

    def show(self, is_shown: bool) -> None:
        """Show or hide the fields; what was typed is kept."""
        self.is_shown = is_shown
        self.part.set_visibility(is_shown)

    @property
    def values(self) -> tuple[str, ...]:
        """Least, largest and unit, as typed."""
        return tuple((form.value or "").strip() for form in self.fields.values())

    def said(self, distribution: str = "uniform") -> Range:
        """Return the prior that the fields say."""
        lower, upper, unit = self.values
        return Range(self.name, lower, upper, unit, distribution)

    def check(self) -> bool:
        """Say beside each field what is wrong with it; returns whether nothing is."""
        for key in ("lower", "upper"):
            form = self.fields[key]
            try:
                number(form.value or "", key)
                form.error = None
            except InputError as error:
                form.error = f"{error.found}: expected {error.expected}"
        self.fields["unit"].error = None
        return not any(form.error for form in self.fields.values())


class TermRow:
    """One term.

    Args:
        name: of the coefficient.
        role: one of `ROLES`.
        prior: as the file has it; fields for one where that is empty.
        is_published: whether it has a published value.
        changed: told when the role was changed.
        remove: takes the row away; None of a term that the file has, which is put out of the model instead.
    """

    def __init__(
        self,
        name: str,
        role: str,
        prior: str,
        is_published: bool,
        changed: Callable[[], None],
        remove: Callable[[], None] | None,
    ):
        self.may_be_published, self.changed, self.has_prior = is_published, changed, bool(prior)
        unit = CoefficientName.parse(name).unit
        with ui.element("div").props(f'role=group aria-label="term {name}"').classes("line channel") as self.part:
            self.role = ui.select(ROLES, value=role, label=name, on_change=self._changed).props(LOOK)
            if prior:
                markup(Markup('<p class="note">prior: {}</p>').format(prior))
            words = f"plausible values [{unit}]" + (", or the published value" if is_published else "")
            self.range = RangeFields(name, words, unit)
            if remove is not None:
                button("✕", remove).props(f'aria-label="Remove {name}"').classes("remove")
        self._show()

    def _changed(self) -> None:
        self.role.error = None
        self._show()
        self.changed()

    def _show(self) -> None:
        self.range.show(not self.has_prior and self.role.value != "out")
