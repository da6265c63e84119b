"""The model: its terms and their priors, the noise of the residuals, and the size of the chains."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.core.coefficients import AXES
from seatrial.dashboard.app_context import AppContext, keep_form, markup
from seatrial.dashboard.page_layout import LOOK, button, link, section
from seatrial.dashboard.table_form import TableForm
from seatrial.dashboard.terms import term_html, words_of
from seatrial.dashboard.view_models import OfferedTerm
from seatrial.report.labels import sentence_html

NOTES = {
    "structure": "A coefficient's name is its equation: X_uabsu multiplies u|u|. Terms are always in the model, or optional: the data "
    "decide. A term that is in neither keeps its published value, or is zero. A new term gets a prior below: correct its range.",
    "prior": "Without a distribution the prior is removed.",
    "sensors": "If the report says that residuals are correlated, choose the noise that it names; drifting is white noise on a slow error. "
    "Priors that have to be stated appear above.",
    "estimation": "residuals are those of all sensors that state none. If an alarm asks for longer chains, type warm-up and draws twice as "
    "large: multiples of 100.",
}


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    path, messages = folder / CAMPAIGN, ui.element("div").classes("said")
    html = '<p class="done" role="status">Saved in campaign.toml. Results made before are stale now: <a href="{}">run it again</a>.</p>'
    saved, think = Markup(html).format(link("run", campaign)), context.worker_pool.think

    async def asked() -> Any:
        questions = ("model_form", "offered_terms")
        return await asyncio.gather(*(think(one, str(folder), files=[path]) for one in questions))

    def make(answer: Any) -> TableForm:
        (text, questions), offered = answer
        picker = ui.element("div")
        form = TableForm(
            context, text, questions, messages, lambda answers: think("asked_of_model", text, answers), NOTES
        )
        form.offer_save(folder, saved)
        if offered:
            with picker, section("Add a term", "Choose what acts along which axis. All terms can also be typed below."):
                TermPicker(form, offered)
        return form

    await keep_form(path, asked, make)
    messages.move(target_index=-1)


class TermPicker:
    """Axis and kind of a term, its equation, its drawing and its prior, and the buttons that put it into the form of the model.

    Args:
        form: of the model.
        offered: terms that the vehicle may have.
    """

    def __init__(self, form: TableForm, offered: Sequence[OfferedTerm]):
        self.form, self.offered = form, {one.name: one for one in offered}
        axes = {
            axis: f"{axis}: {words}" for axis, (_, words) in AXES.items() if any(one[0] == axis for one in self.offered)
        }
        with ui.element("div").classes("line"):
            self.axis = ui.select(axes, value=next(iter(axes)), label="Axis", on_change=self._turn).props(LOOK)
            self.kind = ui.select({}, label="Kind", on_change=self._show).props(LOOK).classes("wide")
        self.shown = markup("").props('aria-live="polite"')
        with ui.element("div").classes("line"):
            button("Add, optional", lambda: self._add("optional"))
            button("Add, always in the model", lambda: self._add("always"))
        self.said = markup("").props('role="status"')
        self._turn()

    def _turn(self) -> None:
        kinds = {name: f"{words_of(name)}: {name}" for name in self.offered if name[0] == self.axis.value}
        self.kind.set_options(kinds, value=next(iter(kinds)))

    def _show(self) -> None:
        self.said.set_content("")
        if one := self.offered.get(str(self.kind.value)):
            self.shown.set_content(
                term_html(one.name) + Markup('<p class="note">{}</p>').format(sentence_html(one.prior, {}))
            )

    async def _add(self, key: str) -> None:
        name = str(self.kind.value)
        is_new = await self.form.add(f"structure.{key}", name, ("structure.always", "structure.optional"))
        words = (
            f"{name} is under {key}. Correct its prior, then check and save."
            if is_new
            else f"{name} is in the model already."
        )
        self.said.set_content(Markup('<p class="note">{}</p>').format(words))
