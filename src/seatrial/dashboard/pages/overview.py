"""All campaigns of the folder: what each is, which of its steps are current, and what is at work."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.toml import toml_content
from seatrial.campaign.store.stored_result import StepState
from seatrial.cli.campaign_text import CAMPAIGN, read_file
from seatrial.core.errors import SeatrialError
from seatrial.dashboard.app_context import PATIENCE, AppContext, change_of, fill, keep_current, markup
from seatrial.dashboard.page_layout import VIEWS, button, frame, link, links_html
from seatrial.dashboard.run_bar import standing_of

EVERY = 2.0
"""Seconds between looks at what is running."""
LEGEND = (
    "✓\N{NO-BREAK SPACE}current: its results belong to the present campaign file and logs. "
    "↻\N{NO-BREAK SPACE}stale: a file has changed since. ○\N{NO-BREAK SPACE}missing. "
    "▲\N{NO-BREAK SPACE}failed a check: do not use its numbers yet."
)


async def build(context: AppContext) -> None:
    """Build the page."""
    with frame(context, ""):

        async def show() -> None:
            await _campaigns(context, await asyncio.to_thread(context.campaign_paths.campaigns))

        await keep_current(lambda: tuple(context.campaign_paths.campaigns()), show)


async def _campaigns(context: AppContext, names: list[str]) -> None:
    """Build the card of every campaign."""
    root = context.campaign_paths.root
    if not names:
        words = "<section><p>No campaign in {} yet. Begin one here, or in a shell with <code>seatrial init</code>.</p></section>"
        markup(Markup(words).format(root))
        _new_button()
        return
    if names != ["."]:
        _new_button()
    count = f"{len(names)} campaign{'s' * (len(names) != 1)}"
    markup(Markup('<p class="note">{} in {}. {}</p>').format(count, root, LEGEND))
    folders = {name: context.campaign_paths.folder(name) for name in names}
    standing = {name: asyncio.ensure_future(context.steps(folder)) for name, folder in folders.items()}
    await asyncio.wait(standing.values(), timeout=PATIENCE)
    looks = []
    with ui.element("div").classes("cards"):
        for name, folder in folders.items():
            looks.append(await _card(context, name, folder, standing[name]))
    ui.timer(EVERY, lambda: [look() for look in looks])


def _new_button() -> None:
    with ui.element("div").classes("line"):
        button("New campaign", lambda: ui.navigate.to("/new"), main=True)


async def _card(
    context: AppContext, name: str, folder: Path, standing: Awaitable[tuple[StepState, ...]]
) -> Callable[[], None]:
    """Build the card of a campaign; returns what brings it up to date."""
    with ui.element("article").classes("card"):
        title = title_of(folder) or (folder.name if name == "." else name)
        place = folder.relative_to(context.campaign_paths.root.parent)
        head = Markup('<h2><a href="{}">{}</a></h2><p class="note">{}</p>')
        markup(head.format(link("results", name), title, place))
        first = [standing]

        async def show() -> None:
            part, steps = ui.element("div"), first.pop() if first else context.steps(folder)
            waiting = "checking which results are current …"
            await fill(part, steps, lambda found: markup(steps_html(found)), waiting, patience=0.001)

        await keep_current(lambda: change_of(folder), show)
        at_work = markup("")
        markup(links_html((link(key, name), words) for key, words in VIEWS.items()))

    def look() -> None:
        job = context.look(folder)
        words = standing_of(job, time.time()).words if job.running else ""
        at_work.set_content(Markup('<p class="running"><span class="dot"></span>{}</p>').format(words) if words else "")

    look()
    return look


def steps_html(steps: tuple[StepState, ...]) -> Markup:
    """Steps as a list, state told by word and sign, not by colour alone; those that failed a check are marked, and the alarms follow."""
    rows = Markup("").join(
        Markup('<li class="{}">{}<span class="unseen"> is {}</span></li>').format(
            "failed" if one.alarms else one.state, one.name, f"{one.state}, but failed" if one.alarms else one.state
        )
        for one in steps
    )
    alarms = Markup("").join(
        Markup("<li class='alarm'>{}.</li>").format(text[:1].upper() + text[1:])
        for text in dict.fromkeys(text for one in steps for text in one.alarms)
    )
    listed = Markup('<ul class="findings">{}</ul>').format(alarms) if alarms else ""
    return Markup('<ul class="steps">{}</ul>{}').format(rows, listed)


def title_of(folder: Path) -> str:
    """Name of a campaign as its file says, without reading more; empty if it cannot be read."""
    try:
        content = toml_content(folder / CAMPAIGN, read_file(folder))
        return str(content["campaign"]["name"])[:120]
    except (SeatrialError, OSError, KeyError, TypeError):
        return ""
