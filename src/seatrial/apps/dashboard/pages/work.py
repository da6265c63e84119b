"""What runs: start, watch, stop and resume the commands of the shell, in processes that outlive this page."""

from pathlib import Path

from markupsafe import Markup, escape
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, fill, markup, say
from seatrial.apps.dashboard.jobs import STARTED, Job
from seatrial.apps.dashboard.page_layout import button, section
from seatrial.apps.dashboard.pages.overview import LEGEND, steps_html
from seatrial.core.errors import SeatrialError

EVERY = 0.25
"""Seconds between looks at a command at work."""
OFFERED = {name: f"{name}: {makes}" for name, makes in STARTED.items() if name != "export"}
"""Commands in words; that which exports has a form of its own, beside the report."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("Where this campaign stands", LEGEND):
        holder = ui.element("div")
        await fill(
            holder, context.steps(folder), lambda steps: markup(steps_html(steps)), "looking at what is current …"
        )
    with section(
        "At work",
        "The same commands as in a shell. They go on when this page or the dashboard is closed; started again, they resume.",
    ):
        live = live_view(context, folder)

        async def again() -> None:
            with holder:
                holder.clear()
                await fill(holder, context.steps(folder), lambda steps: markup(steps_html(steps)))

        live.on_end.append(again)
        said = ui.element("div")
        with ui.element("div").classes("line"):
            command = (
                ui.select(OFFERED, value="run", label="Command")
                .props("outlined options-dense hide-bottom-space")
                .classes("wide")
            )

            def start() -> None:
                begin(context, folder, said, str(command.value))
                live.look()

            def stop() -> None:
                said.clear()
                with said:
                    if not context.look(folder).running:
                        markup('<p class="note">Nothing is running.</p>')
                        return
                    try:
                        context.jobs.stop(folder)
                    except (SeatrialError, OSError) as error:
                        say(error)
                live.look()

            button("Start or resume", start, main=True)
            button("Stop", stop)


def begin(context: AppContext, folder: Path, said: ui.element, command: str, *options: str) -> bool:
    """Start a command, or say in its place why that cannot be."""
    said.clear()
    with said:
        try:
            context.jobs.start(folder, command, *options)
        except (SeatrialError, OSError) as error:
            say(error)
            return False
    context.glances.pop(folder, None)
    return True


class Live:
    """What is at work, kept up to date; `on_end` is called when it ends."""

    def __init__(self, context: AppContext, folder: Path, with_output: bool):
        self.context, self.folder, self.with_output = context, folder, with_output
        self.part = markup("").props('aria-live="polite"').classes("live")
        self.was_running = False
        self.on_end: list = []
        self.shown = ""
        self.timer = ui.timer(EVERY, self.step)
        self.look()

    def look(self) -> Job:
        """Show what is at work."""
        job = self.context.look(self.folder)
        self.was_running = self.was_running or job.running  # also of one that ends before the next look
        html = str(live_html(job, self.with_output))
        if html != self.shown:
            self.shown = html
            self.part.set_content(html)
        return job

    async def step(self) -> None:
        """Look, and tell whoever waits that a command has ended."""
        job = self.look()
        if self.was_running and not job.running:
            self.was_running = False
            for call in self.on_end:
                await call()


def live_view(context: AppContext, folder: Path, with_output: bool = True) -> Live:
    """Show what is at work on a campaign."""
    return Live(context, folder, with_output)


def live_html(job: Job, with_output: bool) -> Markup:
    """What a campaign's command does, or how the last one ended."""
    parts = [_state(job)]
    if job.occupant is not None and job.occupant.alive:
        parts.append(Markup('<div class="bars">{}</div>').format(Markup("").join(map(_bar, job.occupant.work))))
    if with_output and (job.command or job.output):
        shown = Markup("<pre class='output' tabindex='0'>$ {}\n{}</pre>").format(job.command, job.output)
        parts.append(
            shown if not job.running else Markup("<details><summary>What it prints</summary>{}</details>").format(shown)
        )
    return Markup("").join(parts)


def _state(job: Job) -> Markup:
    if job.occupant is not None and job.occupant.alive:
        return Markup('<p class="running"><span class="dot"></span>{} is running</p>').format(job.occupant.words)
    if job.starting:
        return Markup('<p class="running"><span class="dot"></span>starting …</p>')
    if job.killed:
        words = "was killed. What it had finished is kept: start it again to resume."
        return Markup('<p class="alarm">▲ {} {}</p>').format(job.occupant.words if job.occupant else "", words)
    if any(line.startswith("error: ") for line in job.output.splitlines()):
        return Markup('<p class="alarm">▲ The last command ended with an error, and says what to do about it.</p>')
    return Markup("<p>Nothing is running.{}</p>").format(
        " The last command that was started here:" if job.command else ""
    )


def _bar(piece: dict) -> Markup:
    done, total, elapsed = int(piece["done"]), int(piece["total"]), float(piece["elapsed"])
    share = min(1.0, done / total) if total else 0.0
    if total and done >= total:
        words = f"done in {_time(elapsed)}"
    elif share > 0:
        words = f"{share:.0%}, {_time(elapsed)} elapsed, about {_time(elapsed * (1 - share) / share)} remaining"
    else:
        words = "begun"
    title = escape(piece["title"])
    return Markup('<div><label>{}<progress max="1" value="{}"></progress></label><small>{}</small></div>').format(
        title, f"{share:.4f}", words
    )


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
