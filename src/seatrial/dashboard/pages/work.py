"""What runs: start, watch and resume the commands of the shell with their options, in processes that outlive this page."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from markupsafe import Markup, escape
from nicegui import ui

from seatrial.campaign.workflow.whole_run import TITLE
from seatrial.cli.main import COMMANDS
from seatrial.core.errors import InputError
from seatrial.core.reporter import duration_text
from seatrial.dashboard.app_context import AppContext, change_of, keep_current, keep_filled, markup, say, saying
from seatrial.dashboard.campaign_paths import MADE
from seatrial.dashboard.command_options import STARTED, CommandOption, Value, options_of, words_of_options
from seatrial.dashboard.jobs import LIVE, Job
from seatrial.dashboard.page_layout import LOOK, button, link, links_html, section
from seatrial.dashboard.pages.overview import LEGEND, steps_html
from seatrial.dashboard.run_bar import remaining_of
from seatrial.report.labels import name_html

FOLDED = ("check", "report")
"""Commands whose results pages show: what they print is folded."""
EVERY = 0.25
"""Seconds between looks at a command at work."""
OFFERED = {name: f"{name}: {makes}" for name, makes in STARTED.items() if name != "export"}
"""Commands in words; that which exports has a form of its own, beside the report."""
_GROUPS = [COMMANDS[name].group for name in OFFERED]
HEADINGS = {_GROUPS.index(group): group for group in _GROUPS}
"""Groups of commands, by the place of their first command."""
OPTION = """
<q-item-label header role="presentation" v-if="(HEADINGS)[props.opt.value]">{{ (HEADINGS)[props.opt.value] }}</q-item-label>
<q-item v-bind="props.itemProps"><q-item-section><q-item-label>{{ props.opt.label }}</q-item-label></q-item-section></q-item>
""".replace("HEADINGS", str(HEADINGS))
"""An option of the list, below the heading of its group if it is the first of it."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("State of this campaign", LEGEND):
        await keep_filled(
            lambda: change_of(folder),
            lambda: context.steps(folder),
            lambda steps: markup(steps_html(steps)),
            "checking which results are current …",
        )
    with section("Run a command", "The same commands as in a shell. A command that is started again resumes."):
        CommandForm(context, folder)
    with section("At work", "A command continues if this page or the dashboard is closed."):
        Live(context, folder)
        await made_part(context, campaign, folder)


async def made_part(context: AppContext, campaign: str, folder: Path) -> None:
    """Show what the last command wrote, and keep that up to date."""
    await keep_current(lambda: change_of(folder), lambda: _made(folder, campaign, context.jobs.look(folder)))


class CommandForm:
    """One form for all commands: which, and its options as the command itself declares them."""

    def __init__(self, context: AppContext, folder: Path):
        self.context, self.folder = context, folder
        self.fields: dict[str, ui.input | ui.select | ui.checkbox] = {}
        self.command = ui.select(OFFERED, value="run", label="Command").props(LOOK).classes("wide")
        self.command.add_slot("option", OPTION)
        self.command.on_value_change(self._show)
        self.place, self.said = ui.element("div"), ui.element("div")
        with ui.element("div").classes("line"):
            button("Start or resume", self._start, main=True)

    def _show(self) -> None:
        self.place.clear()
        self.fields.clear()
        with self.place:
            for option in options_of(str(self.command.value)):
                self.fields[option.name] = _field(option)

    def _start(self) -> None:
        self.said.clear()
        command = str(self.command.value)
        values: dict[str, Value] = {name: form.value for name, form in self.fields.items()}
        for form in self.fields.values():
            if isinstance(form, ui.input):
                form.error = None
        try:
            words = words_of_options(command, values)
        except InputError as error:
            form = self.fields.get(error.where)
            if isinstance(form, ui.input):
                form.error = error.sentence(with_remedy=False)
            with self.said:
                say(error)
            return
        begin(self.context, self.folder, self.said, command, *words)


def _field(option: CommandOption) -> ui.input | ui.select | ui.checkbox:
    label = option.name.removeprefix("--").replace("-", " ")
    with ui.element("div").classes("option"):
        if option.kind == "flag":
            form = ui.checkbox(label)
        elif option.kind == "choice":
            form = ui.select(list(map(str, option.choices)), value=option.default, label=label).props(LOOK)
        else:
            form = ui.input(label, value=option.default).props("outlined dense hide-bottom-space")
        more = " Separate several by commas." if option.is_list else ""
        markup(Markup('<p class="note">{}{}</p>').format(option.meaning, more))
    return form


def _made(folder: Path, campaign: str, job: Job) -> None:
    """Show the pictures that the last command wrote, and offer its other files."""
    there = [name for name in named_in(job.output, folder) if MADE.fullmatch(name) and (folder / name).is_file()]
    if not there:
        return
    for name in there:
        if name.endswith(".svg"):
            changed = str((folder / name).stat().st_mtime_ns)
            address = link("download", campaign, file=name, shown="1", changed=changed)
            markup(Markup('<figure class="picture"><img src="{}" alt="{}"></figure>').format(address, name))
    markup(links_html((link("download", campaign, file=name), f"Download {name}") for name in there))


def named_in(output: str, folder: Path) -> list[str]:
    """Pictures and tables of a folder that a command names, as paths from there; the folder's own name may have spaces."""
    return sorted(set(re.findall(re.escape(folder.as_posix()) + r"/([^\s;,]+\.(?:svg|csv|json))", output)))


def begin(context: AppContext, folder: Path, messages: ui.element, command: str, *options: str) -> None:
    """Start a command, or say in its place why that cannot be."""
    with saying(messages):
        context.jobs.start(folder, command, *options)
        context.glances.pop(folder, None)


class Live:
    """What is at work, kept up to date.

    Args:
        context: what is served.
        folder: of the campaign.
        words: commands whose output is shown, and of others only that they run; none for whatever was started last.
    """

    def __init__(self, context: AppContext, folder: Path, words: Sequence[str] = ()):
        self.context, self.folder, self.words = context, folder, words
        self.part = markup("").props('aria-live="polite"').classes("live")
        self.shown = ""
        ui.timer(EVERY, self.look)
        self.look()

    def look(self) -> None:
        """Show what is at work."""
        job = self.context.look(self.folder)
        if self.words and job.word not in self.words:
            job = replace(job, command="", output="")
        html = str(live_html(job, folded=job.word in FOLDED))
        if html != self.shown:
            self.shown = html
            self.part.set_content(html)


def live_html(job: Job, folded: bool = False) -> Markup:
    """What a campaign's command does, or how the last one ended; what it printed is `folded` unless it ended with an error."""
    parts = [_state(job)]
    if job.occupant is not None and job.occupant.alive:
        parts.append(
            Markup('<div class="bars">{}</div>').format(
                Markup("").join(_bar(piece) for piece in job.occupant.work if piece["title"] != TITLE)
            )
        )
    if job.command or job.output:
        shown = Markup("<pre class='output' tabindex='0'>$ {}\n{}</pre>").format(job.command, job.output)
        parts.append(
            Markup("<details><summary>Output</summary>{}</details>").format(shown)
            if job.running or (folded and not _failed(job))
            else shown
        )
    return Markup("").join(parts)


def _state(job: Job) -> Markup:
    if job.occupant is not None and job.occupant.alive:
        words = name_html(job.occupant.words, {})
        return Markup('<p class="running"><span class="dot"></span>{} is running</p>').format(words)
    if job.starting:
        words = "following the trial" if job.word == LIVE else "starting"
        return Markup('<p class="running"><span class="dot"></span>{} …</p>').format(words)
    if job.killed:
        words = "was killed. Finished work is kept: start it again to resume."
        return Markup('<p class="alarm">▲ {} {}</p>').format(job.occupant.words if job.occupant else "", words)
    if _failed(job):
        return Markup('<p class="alarm">▲ The last command ended with an error. Its output has the remedy.</p>')
    return Markup("<p>Nothing is running.{}</p>").format(" The last command started here:" if job.command else "")


def _failed(job: Job) -> bool:
    return any(line.startswith("error: ") for line in job.output.splitlines())


def _bar(piece: dict) -> Markup:
    done, total, elapsed = (
        int(piece["done"]),
        int(piece["total"]),
        float(piece["elapsed"]) + float(piece.get("silent", 0.0)),
    )
    share = min(1.0, done / total) if total else 0.0
    if total and done >= total:
        words = f"done in {duration_text(elapsed)}"
    elif share > 0:
        seconds = remaining_of(piece)
        words = f"{share:.0%}, {duration_text(elapsed)} elapsed"
        words += "" if seconds is None else f", about {duration_text(seconds)} remaining"
    else:
        words = "begun"
    title = escape(piece["title"])
    return Markup('<div><label>{}<progress max="1" value="{}"></progress></label><small>{}</small></div>').format(
        title, f"{share:.4f}", words
    )
