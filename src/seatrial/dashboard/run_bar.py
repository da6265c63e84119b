"""The bar of what is at work on a campaign, on each of its pages: how far it has come, elapsed and remaining time, and Stop."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.workflow.whole_run import TITLE
from seatrial.core.reporter import duration_text, remaining
from seatrial.dashboard.app_context import AppContext, markup, saying
from seatrial.dashboard.jobs import LIVE, Job

EVERY = 1.0
"""Seconds between looks at what is running."""


class Standing(NamedTuple):
    """How far a command has come.

    Attributes:
        words: its name, elapsed and remaining time.
        share: of its work that is done; None if it does not say.
    """

    words: str
    share: float | None


def standing_of(job: Job, now: float) -> Standing:
    """Return how far a running command has come.

    Args:
        job: of the campaign.
        now: seconds since 1970.
    """
    there = job.occupant
    if there is None or not there.alive:
        return Standing("following the trial" if job.word == LIVE else "starting", None)
    words = [" ".join(there.command[:2])]
    whole = [piece for piece in there.work if piece["title"] == TITLE]
    running = [piece for piece in there.work if piece["done"] < piece["total"] and piece["title"] != TITLE]
    pieces = whole or running
    elapsed = f"{duration_text(max(0.0, now - there.started))} elapsed"
    if not pieces:
        return Standing(", ".join([*words, elapsed]), None)
    piece = pieces[-1]
    share = min(1.0, piece["done"] / piece["total"]) if piece["total"] else 0.0
    if len(whole) > 1:  # a simulated campaign with a goal goes through the loop once for every trial
        words.append(f"round {len(whole)}")
    if not whole:
        words.append(str(piece["title"]))
    words += [f"{share:.0%}", elapsed]
    slowest = max(running, key=lambda one: remaining_of(one) or 0.0, default=None) if whole else None
    known = [seconds for one in (piece, slowest) if one is not None and (seconds := remaining_of(one)) is not None]
    if known:
        said = f"about {duration_text(max(known))} remaining"
        words.append(said if len(whole) == 1 else f"{said} in this {'round' if whole else 'step'}")
    now_at = "" if slowest is None else f"; {slowest['title']}, {slowest['done'] / slowest['total']:.0%}"
    return Standing(", ".join(words) + now_at, share)


def remaining_of(piece: Mapping[str, Any]) -> float | None:
    """Return the time that a piece of work of an occupant still takes, s, as it says or at its pace; None if that is not known yet."""
    if piece.get("seconds") is not None:
        return piece["seconds"]
    return remaining(piece["elapsed"], piece["begun_at"], piece["done"], piece["total"], piece.get("silent", 0.0))


class RunBar:
    """The bar of one page; it is hidden while nothing is at work.

    Args:
        context: what is served.
        folder: of the campaign.
        address: of the page that shows what the command prints.
    """

    def __init__(self, context: AppContext, folder: Path, address: str):
        self.context, self.folder, self.address, self.shown = context, folder, address, ""
        with ui.element("div").classes("run-bar").props('role=region aria-label="At work"') as self.part:
            self.words = markup("")
            self.stop = (
                ui.button("Stop", on_click=self._stop)
                .props("no-caps unelevated color=primary text-color=paper")
                .classes("button")
            )
        self.said = ui.element("div")
        self._look()
        ui.timer(EVERY, self._look)

    def _look(self) -> None:
        job = self.context.look(self.folder)
        self.part.set_visibility(job.running)
        standing = standing_of(job, time.time()) if job.running else Standing("", None)
        value = "" if standing.share is None else Markup(' value="{:.3f}"').format(standing.share)
        html = Markup(
            '<a class="running" href="{}"><span class="dot"></span>{}</a><progress max="1"{} aria-label="{}"></progress>'
        ).format(self.address, standing.words, value, "progress of the command")
        if html != self.shown:
            self.shown = html
            self.words.set_content(html)

    def _stop(self) -> None:
        self.context.glances.pop(self.folder, None)
        with saying(self.said):
            if self.context.look(self.folder).running:  # it may have ended since the page was shown
                self.context.jobs.stop(self.folder)
        self.context.glances.pop(self.folder, None)
        self._look()
