"""All campaigns of the folder: what each is, which of its steps are current, and what is at work."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.campaign_text import CAMPAIGN, read_file
from seatrial.apps.dashboard.app_context import PATIENCE, AppContext, fill, markup, say
from seatrial.apps.dashboard.page_layout import VIEWS, button, frame, link, section
from seatrial.apps.dashboard.view_models import Beginning, Stage
from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import SeatrialError

EVERY = 2.0
"""Seconds between looks at what is running."""
LEGEND = "✓ current: its results belong to the campaign file and logs as they are now. ↻ stale: something has changed since. ○ missing."

NEW = (
    "A new folder here with one file, campaign.toml; what is there already is never touched. Vehicle, priors and sensors are edited in "
    "that file; limits and logs on the pages."
)


async def build(context: AppContext) -> None:
    """Build the page."""
    with frame(context, ""):
        names = await asyncio.to_thread(context.campaign_paths.campaigns)
        if not names:
            words = "<section><p>No campaign in {} yet. Begin one below, or in a shell with <code>seatrial init</code>.</p></section>"
            markup(Markup(words).format(context.campaign_paths.root))
            await _begin_form(context)
            return
        markup(
            Markup('<p class="note">{} in {}. {}</p>').format(_count(len(names)), context.campaign_paths.root, LEGEND)
        )
        folders = {name: context.campaign_paths.folder(name) for name in names}
        standing = {name: asyncio.ensure_future(context.steps(folder)) for name, folder in folders.items()}
        await asyncio.wait(standing.values(), timeout=PATIENCE)
        looks = []
        with ui.element("div").classes("cards"):
            for name, folder in folders.items():
                looks.append(await _card(context, name, folder, standing[name]))
        ui.timer(EVERY, lambda: [look() for look in looks])
        if names != ["."]:
            await _begin_form(context)


async def _begin_form(context: AppContext) -> None:
    """Build the part where a campaign is begun."""
    with section("Begin a campaign", NEW):
        holder = ui.element("div")
        await fill(holder, context.worker_pool.think("beginnings"), lambda found: Begin(context, found))


class Begin:
    """The form of a new campaign: its name, the template, and of which published vehicle."""

    def __init__(self, context: AppContext, found: tuple[Beginning, ...]):
        self.context, self.found = context, {one.template: one for one in found}
        look, first = "outlined options-dense hide-bottom-space", found[0]
        with ui.element("div").classes("line"):
            self.name = ui.input("Name").props("outlined hide-bottom-space")
            self.template = ui.select(list(self.found), value=first.template, label="Begin from").props(look)
            self.vehicle = ui.select(list(first.vehicles), label="Published vehicle").props(look)
            button("Begin", self._begin, main=True)
        self.meaning = markup("").props('aria-live="polite"')
        self.said = ui.element("div")
        self.template.on_value_change(self._of_template)
        self._of_template()

    def _of_template(self) -> None:
        chosen = self.found[str(self.template.value)]
        vehicles = chosen.vehicles
        self.meaning.set_content(Markup('<p class="note">{}: {}.</p>').format(chosen.template, chosen.meaning))
        self.vehicle.set_options(list(vehicles), value=vehicles[0] if vehicles else None)
        self.vehicle.set_visibility(bool(vehicles))

    async def _begin(self) -> None:
        self.said.clear()
        with self.said:
            try:
                folder = self.context.campaign_paths.new_folder(self.name.value or "")
                about = str(folder), str(self.template.value), folder.name, self.vehicle.value or ""
                self.context.campaign_paths.begin(folder, await self.context.worker_pool.think("begun", *about))
            except (SeatrialError, OSError) as error:
                say(error)
                return
        ui.navigate.to(link("design", folder.name))


async def _card(
    context: AppContext, name: str, folder: Path, standing: Awaitable[tuple[Stage, ...]]
) -> Callable[[], None]:
    """Build the card of a campaign; returns what brings it up to date."""
    with ui.element("article").classes("card"):
        title = title_of(folder) or (folder.name if name == "." else name)
        place = folder.relative_to(context.campaign_paths.root.parent)
        head = Markup('<h2><a href="{}">{}</a></h2><p class="note">{}</p>')
        markup(head.format(link("results", name), title, place))
        holder = ui.element("div")
        await fill(
            holder, standing, lambda steps: markup(steps_html(steps)), "looking at what is current …", patience=0.001
        )
        at_work = markup("")
        links = Markup("").join(
            Markup('<a href="{}">{}</a>').format(link(key, name), words) for key, words in VIEWS.items()
        )
        markup(Markup('<div class="links">{}</div>').format(links))

    def look() -> None:
        job = context.look(folder)
        words = (
            job.occupant.words if job.running and job.occupant else "a command was just started" if job.running else ""
        )
        at_work.set_content(Markup('<p class="running"><span class="dot"></span>{}</p>').format(words) if words else "")

    look()
    return look


def steps_html(steps: tuple[Stage, ...]) -> Markup:
    """Steps as a list, state told by word and sign, not by colour alone."""
    rows = Markup("").join(
        Markup('<li class="{}">{}<span class="unseen"> is {}</span></li>').format(one.state, one.name, one.state)
        for one in steps
    )
    return Markup('<ul class="steps">{}</ul>').format(rows)


def title_of(folder: Path) -> str:
    """Name of a campaign as its file says, without reading more; empty where it cannot be read."""
    try:
        content = toml_content(folder / CAMPAIGN, read_file(folder))
        return str(content["campaign"]["name"])[:120]
    except (SeatrialError, OSError, KeyError, TypeError):
        return ""


def _count(number: int) -> str:
    return f"{number} campaign{'s' * (number != 1)}"
