"""What every page shares: the folder that is served, who works on it, and parts of pages that come when they are ready."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from markupsafe import Markup, escape
from nicegui import ui

from seatrial.campaign.store.stored_result import StepState, Store
from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.core.errors import SeatrialError
from seatrial.core.visible import visible
from seatrial.dashboard.campaign_paths import CampaignPaths
from seatrial.dashboard.jobs import LOG, Job, Jobs
from seatrial.dashboard.view_models import Checked, FormData, words_of
from seatrial.dashboard.worker_pool import WorkerPool, stamp
from seatrial.report.labels import name_html, sentence_html
from seatrial.report.numbers import with_percent_signs_kept

PATIENCE = 0.35
"""Seconds that a page waits for a part before it is shown without it."""
CHANGES = 1.0
"""Seconds between looks whether something has changed."""
LONG, AHEAD = 16 << 20, 8
"""Bytes from which a file is read ahead, and records of which that is done, at most."""
_LAST: WeakKeyDictionary[Any, object] = WeakKeyDictionary()
"""What tells the last answer that was asked for a part of a page, by the part."""
GLANCE = 0.2
"""Seconds for which a look at a running command is good for all viewers."""


@dataclass(eq=False)
class AppContext:
    """What is served, and who works on it.

    Attributes:
        campaign_paths: campaigns.
        worker_pool: drawing and thinking.
        jobs: commands at work.
    """

    campaign_paths: CampaignPaths
    worker_pool: WorkerPool = field(default_factory=WorkerPool)
    jobs: Jobs = field(default_factory=Jobs)
    glances: dict[Path, tuple[float, Job]] = field(default_factory=dict)

    def look(self, folder: Path) -> Job:
        """The command at work on a campaign, as it was a moment ago."""
        seen = self.glances.get(folder)
        if seen is None or time.monotonic() - seen[0] > GLANCE:
            seen = time.monotonic(), self.jobs.look(folder)
            self.glances[folder] = seen
        return seen[1]

    async def steps(self, folder: Path) -> tuple[StepState, ...]:
        """Which steps of a campaign are current."""
        files = await asyncio.to_thread(evidence_of, folder)
        return await self.worker_pool.think("steps", str(folder), files=files)

    async def checked(self, folder: Path) -> Checked | None:
        """What the last check of the records said; None if there was none."""
        files = await asyncio.to_thread(evidence_of, folder)
        return await self.worker_pool.draw("checked", folder, files=files)

    async def read_ahead(self, folder: Path) -> None:
        """Have the long records of a campaign checked and indexed before anybody waits for them."""
        for path in sorted((Store(folder).results / "records").glob("*.nc"))[:AHEAD]:
            if stamp(path)[1] > LONG:
                with suppress(SeatrialError, OSError):  # said where it is shown
                    await self.worker_pool.view("read_ahead", path, files=[path])

    async def form_data(self, folder: Path) -> FormData:
        """A campaign, for the forms."""
        return await self.worker_pool.think("form_data", str(folder), files=[folder / CAMPAIGN])


async def keep_current(stamp_of: Callable[[], Any], build: Callable[[], Any]) -> None:
    """Build a part of a page, and build it again whenever what it shows has changed, whoever changed it.

    Args:
        stamp_of: what tells that something has changed; asked in a thread.
        build: of its content, at once or as a coroutine.
    """
    part, last = ui.element("div"), await asyncio.to_thread(stamp_of)
    shown = last
    with part:
        await _finished(build())

    async def look() -> None:
        nonlocal last, shown
        before, last = last, await asyncio.to_thread(stamp_of)
        if last != shown and last == before and not part.is_deleted:  # not in the middle of several changes
            shown = last
            part.clear()
            with part:
                await _finished(build())

    ui.timer(CHANGES, look)


async def _finished(made: Any) -> None:
    if asyncio.iscoroutine(made):
        await made


async def keep_form(path: Path, ask: Callable[[], Awaitable[Any]], make: Callable[[Any], Any]) -> None:
    """Build a form of what a file says, and build it again when the file changes, unless somebody has begun to fill it in.

    Args:
        path: of the file.
        ask: for what the form needs to know.
        make: builds the form of the answer; returns what tells by `is_edited` whether something in it is not saved.
    """
    forms: list[Any] = []
    read = stamp(path)

    def built(answer: Any) -> None:
        forms[:] = [make(answer)]

    async def show() -> None:
        nonlocal read
        read = stamp(path)
        await fill(ui.element("div"), ask(), built)

    await keep_current(lambda: read if forms and forms[0].is_edited else stamp(path), show)


async def keep_filled(
    stamp_of: Callable[[], Any],
    ask: Callable[[], Awaitable[Any]],
    build: Callable[[Any], Any],
    waiting: str = "one moment …",
) -> None:
    """Fill a part of a page with what is built of an answer, and again whenever that has changed; arguments as `keep_current`, `fill`."""

    await keep_current(stamp_of, lambda: fill(ui.element("div"), ask(), build, waiting))


async def fill(
    holder: Any,
    answer: Awaitable[Any],
    build: Callable[[Any], Any],
    waiting: str = "one moment …",
    patience: float = PATIENCE,
) -> None:
    """Put a part into a page: at once where its answer is there, else when it comes; what went wrong is said in its place.

    Of several answers for one holder only the one that was asked for last is shown, whichever comes first.
    """
    task = asyncio.ensure_future(answer)
    turn = _LAST[holder] = object()
    done, _ = await asyncio.wait({task}, timeout=patience)
    if not done:
        with holder:
            ui.html(f'<p class="waiting" role="status">{escape(waiting)}</p>', sanitize=False)

    async def put() -> None:
        try:
            answer, show = await task, build
        except (SeatrialError, OSError) as error:
            answer, show = error, say
        if is_wanted():
            holder.clear()
            with holder:
                await _finished(show(answer))

    def is_wanted() -> bool:  # the viewer may have gone on to something else
        return not holder.is_deleted and _LAST.get(holder) is turn

    if done:
        await put()
    else:
        # Beside the holder: clearing that would end what clears it. Whatever was clicked may be gone by now.
        with holder.parent_slot:
            ui.timer(0.0, put, once=True)


def say(error: BaseException | str) -> None:
    """Show an error, in words."""
    ui.html(visible(error_html(error if isinstance(error, str) else words_of(error))), sanitize=False)


@contextmanager
def saying(holder: Any) -> Iterator[None]:
    """Put the block into a part of a page, in place of what it holds; errors are shown there, and end the block."""
    holder.clear()
    with holder:
        try:
            yield
        except (SeatrialError, OSError) as error:
            say(error)


def error_html(words: str, title: str = "This did not work.") -> Markup:
    """Return an error in words, below a title."""
    html = '<div class="error" role="alert"><strong>{}</strong><pre>{}</pre></div>'
    return Markup(html).format(title, name_html(words, {}))


def markup(text: str) -> ui.html:
    """Show our own markup, whose foreign parts are escaped."""
    return ui.html(visible(with_percent_signs_kept(text)), sanitize=False).classes("plain")


def cautions_html(cautions: Sequence[str]) -> Markup:
    """Return cautions as a list of sentences; nothing where there are none."""
    rows = Markup("").join(Markup("<li>{}</li>").format(sentence_html(text, {})) for text in cautions)
    return Markup('<ul class="cautions">{}</ul>').format(rows) if cautions else Markup("")


def change_of(folder: Path) -> tuple:
    """Return what changes with the campaign file, any result and any file beside it: times of change of the folders."""
    results = Store(folder).results
    return tuple(stamp(one) for one in (folder, folder / CAMPAIGN, results, *sorted(results.glob("*/"))))


def evidence_of(folder: Path) -> list[Path]:
    """Files whose change may change what is current: the campaign file, its results, the logs beside it."""
    results = Store(folder).results
    files = [*_files(results), *(path for path in _files(folder, deep=False) if not path.name.startswith("."))]
    return [path for path in files if path.name != LOG and path.suffix not in (".npz", ".part")]


def _files(folder: Path, deep: bool = True) -> list[Path]:
    try:
        return sorted(path for path in (folder.rglob("*") if deep else folder.iterdir()) if path.is_file())
    except OSError:
        return []
