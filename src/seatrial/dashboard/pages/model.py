"""The model: its terms and their priors, the noise of the residuals, and the size of the chains."""

from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.dashboard.app_context import AppContext, keep_form
from seatrial.dashboard.page_layout import link
from seatrial.dashboard.table_form import TableForm

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
    saved = Markup(html).format(link("run", campaign))

    def make(answer: Any) -> TableForm:
        text, questions = answer

        def ask(answers: Any) -> Any:
            return context.worker_pool.think("asked_of_model", text, answers)

        form = TableForm(context, text, questions, messages, ask, NOTES)
        form.offer_save(folder, saved)
        return form

    await keep_form(path, lambda: context.worker_pool.think("model_form", str(folder), files=[path]), make)
    messages.move(target_index=-1)
