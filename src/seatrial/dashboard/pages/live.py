"""What `seatrial live` says while the vehicle runs, for everybody on the boat: one sentence, and each coefficient against its goal."""

import asyncio
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.live.session_files import last_look
from seatrial.core.reporter import duration_text
from seatrial.dashboard.app_context import AppContext, markup, saying
from seatrial.dashboard.campaign_paths import logs_of
from seatrial.dashboard.jobs import LIVE, ROS, TEXTS
from seatrial.dashboard.page_layout import LOOK, button, section
from seatrial.dashboard.pages.work import Live

EVERY = 1.0
"""Seconds between looks."""
SILENT = 5.0
"""Seconds without a new look after which it is said that there is none."""
SIGNS = {"go on": "▶", "stop": "■", "switch": "⇄", "wrong": "▲", "check": "!"}
"""Sign before each kind of advice, so that colour alone says nothing."""


PORT = "14550"
"""Port to which MAVLink is sent by custom."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the page."""
    del campaign
    shown = markup("")
    last = ""

    async def look() -> None:
        nonlocal last
        latest = await asyncio.to_thread(last_look, folder)
        html = NONE if latest is None else look_html(latest, time.time())
        if html != last:
            last = html
            shown.set_content(html)

    await look()
    ui.timer(EVERY, look)
    words = "It never commands the vehicle. All who look at this page see what it says, once a second."
    with section("Follow a trial", words):
        await start_form(context, folder)
        Live(context, folder, (LIVE,))
        words = "A page cannot read the output of another program: pipe it in a shell, <code>your_logger | seatrial live {} -</code>."
        markup(Markup('<p class="note">' + words + "</p>").format(shlex.quote(str(folder))))


async def start_form(context: AppContext, folder: Path) -> None:
    """Build the choice of where the samples come from, and the button that starts to follow them; Stop is in the bar above."""
    files = await asyncio.to_thread(logs_of, folder, TEXTS)
    with ui.element("div").classes("line"):
        sources = {"file": "a text file that grows, in the campaign's folder", "udp": "MAVLink that arrives by UDP"}
        sources |= {ROS: "ROS 2 topics that [import] names, if the dashboard was started with rclpy"}
        kind = ui.select(sources, value="file", label="Samples come from").props(LOOK).classes("wide")
        file = ui.select(files, label="File").props(LOOK)
        port = ui.input("Port", value=PORT).props(LOOK)
    file.bind_visibility_from(kind, "value", value="file")
    port.bind_visibility_from(kind, "value", value="udp")

    def start() -> None:
        source = {"udp": port.value, "file": file.value}.get(str(kind.value), ROS)
        with saying(messages):
            context.jobs.follow(folder, str(source or "").strip())
        context.glances.pop(folder, None)

    with ui.element("div").classes("line"):
        button("Start", start, main=True)
    messages = ui.element("div")


def look_html(look: Mapping[str, Any], now: float) -> Markup:
    """Return one look as a part of a page.

    Args:
        look: of `last_look`.
        now: seconds since 1970.
    """
    kind, age = str(look["kind"]), max(0.0, now - float(look["at"]))
    stale = age > SILENT
    advice = Markup('<p class="advice {}" role="status"><span aria-hidden="true">{}</span> {}</p>').format(
        "silent" if stale else kind.replace(" ", "-"),
        "?" if stale else SIGNS.get(kind, ""),
        f"nothing new for {duration_text(age)}; the last advice was: {look['advice']}" if stale else look["advice"],
    )
    rows = Markup("").join(_coefficient(one) for one in look["coefficients"])
    innovations = ", ".join(f"{name} {value:.2f}" for name, value in look["innovations"].items() if value is not None)
    rate = f" at {look['samples'] / look['time_s']:.3g} Hz" if look["time_s"] > 0 else ""
    foot = [f"session {look['run']}: {look['samples']} samples over {duration_text(look['time_s'])}{rate}"]
    if innovations:
        foot.append(
            f"innovations over what is expected, last 20 s: {innovations}; 1 is right, above 2.2 the model is wrong"
        )
    notes = Markup("").join(Markup('<p class="note">{}</p>').format(words) for words in foot)
    return Markup('{}<section><h2>Coefficients</h2><div class="bars live">{}</div>{}</section>').format(
        advice, rows, notes
    )


def _coefficient(one: Mapping[str, Any]) -> Markup:
    """Return a row: its value, how far it is from its goal, and whether the input teaches it."""
    mean, sd, goal = one["mean"], one["sd"], one["goal"]
    share = f" ({abs(sd / mean):.1%})" if mean else ""
    notes = [] if goal is None else [f"goal ± {goal:.2g}" + (": met" if sd <= goal else "")]
    notes += {True: ["excited"], False: ["not excited"]}.get(one["excited"], [])
    bar = Markup("")
    if goal is not None:
        words = f"{one['name']}: {min(goal / sd, 1.0):.0%} of the way to its goal" if sd > 0 else one["name"]
        value = f"{min(goal / sd, 1.0) if sd > 0 else 1.0:.3f}"
        bar = Markup('<progress max="1" value="{}" aria-label="{}"></progress>').format(value, words)
    label = Markup("<label>{} <span>{:.4g} ± {:.2g} {}{}</span></label>").format(
        one["name"], mean, sd, one["unit"], share
    )
    return Markup("<div>{}{}<small>{}</small></div>").format(label, bar, "; ".join(notes))


NONE = Markup("<section><p>No trial has been followed yet.</p></section>")
