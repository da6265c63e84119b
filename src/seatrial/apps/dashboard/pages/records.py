"""Records: what a log holds, which columns are which channels, where a record begins and ends, and whether it may be believed."""

import asyncio
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.campaign_text import read_file, with_trim, write_file
from seatrial.apps.dashboard.app_context import AppContext, fill, markup, say
from seatrial.apps.dashboard.campaign_paths import CAMPAIGN, logs_of
from seatrial.apps.dashboard.edits import with_map
from seatrial.apps.dashboard.page_layout import button, section, table
from seatrial.apps.dashboard.pages.work import begin, live_view
from seatrial.apps.dashboard.view_models import FormData, Recorded
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import SeatrialError

FEW = 20
"""Columns of a log that are shown at once."""
_SEND = """async (e) => {
  const file = e.target.files[0];
  if (!file) return;
  emit(["sending", file.name]);
  try {
    const answer = await fetch("/upload/?" + %s + "&name=" + encodeURIComponent(file.name), { method: "POST", body: file });
    emit([answer.ok ? "kept" : "refused", await answer.text()]);
  } catch (error) { emit(["refused", "the connection ended: the file is too large, or the dashboard has stopped"]); }
  e.target.value = "";
}"""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("What was recorded", "Raw data, downsampled, spikes kept."):
        holder = ui.element("div")

        async def draw() -> None:
            holder.clear()
            with holder:
                await fill(
                    holder, context.form_data(folder), lambda found: Trimming(context, folder, found, stored()).build()
                )

        def stored() -> list[str]:
            return sorted(path.stem for path in (Store(folder).results / "records").glob("*.nc"))

        await draw()
    with section(
        "Checks",
        "The words of `seatrial check`: direction, size, delay, outliers, holes, and what each record can tell.",
    ):
        live, said = live_view(context, folder), ui.element("div")
        live.on_end.append(draw)
        with ui.element("div").classes("line"):
            button(
                "Check the records", lambda: (begin(context, folder, said, "check"), live.look()), main=bool(stored())
            )
            button("Re-import or simulate again", lambda: again(context, folder, said, live))
    with section(
        "A new log",
        "Put a log into the campaign's folder, or send it from here; look at what it holds; then write its channel map into campaign.toml.",
    ):
        NewLog(context, campaign, folder).build()


async def again(context: AppContext, folder: Path, said: ui.element, live: Any) -> None:
    """Import or simulate the records again, as the campaign says."""
    said.clear()
    try:
        found = await context.form_data(folder)
    except SeatrialError as error:
        with said:
            say(error)
        return
    begin(context, folder, said, "simulate" if found.simulated else "import")
    live.look()


class Trimming:
    """The picture of a record, with handles for where it begins and ends, and the same as numbers."""

    def __init__(self, context: AppContext, folder: Path, found: FormData, stored: list[str]):
        self.context, self.folder, self.found, self.stored = context, folder, found, stored
        self.run = ""

    async def build(self) -> None:
        """Build it."""
        runs = [run for run in (*self.found.fit, *self.found.predict) if run] or self.stored
        if not runs:
            words = "run the campaign, or import" if self.found.simulated else "run the designed trial, then send"
            markup(Markup("<p>No record yet: {} a log below.</p>").format(words))
            return
        self.run = runs[0]
        with ui.element("div").classes("line"):
            if len(runs) > 1:
                form = ui.select(runs, value=self.run, label="Run").props("outlined options-dense hide-bottom-space")
                form.on_value_change(self._other)
            if self.found.imported:
                button("Show the whole log", self._whole)
        self.holder = ui.element("div")
        await self._stored()

    async def _other(self, event: Any) -> None:
        self.run = event.value
        await self._stored()

    async def _stored(self) -> None:
        path = Store(self.folder).record(self.run)
        self.holder.clear()
        if not path.is_file():
            with self.holder:
                markup(Markup("<p>Run {} is not imported yet.</p>").format(self.run))
            return
        await fill(self.holder, self.context.worker_pool.draw("record", path, files=[path]), self._show, "drawing …")

    async def _whole(self) -> None:
        self.holder.clear()
        logs = [self.folder / name for name in logs_of(self.folder, ("",))]
        answer = self.context.worker_pool.think(
            "whole_log", str(self.folder), self.run, files=[self.folder / CAMPAIGN, *logs]
        )
        await fill(self.holder, answer, self._show, "reading the whole log …")

    def _show(self, record: Recorded) -> None:
        left, top, right, bottom = record.plot.box
        with ui.element("div").classes("plot"):
            markup(record.plot.svg)
            if self.found.imported:
                sides = {"left": left, "width": right - left, "top": top, "height": bottom - top}
                place = "; ".join(f"{name}: {100 * share:.3f}%" for name, share in sides.items())
                with ui.element("div").classes("trim").style(place):
                    self._handles(record)
        markup(
            Markup('<p class="note">{} samples from {}; {:.6g} to {:.6g} s of {:.6g} s.</p>').format(
                record.samples, record.source, record.start, record.end, record.available
            )
        )
        if record.notes:
            notes = Markup("").join(Markup("<li>{}</li>").format(note) for note in record.notes)
            markup(
                Markup("<details><summary>What was done to it</summary><ul class='findings'>{}</ul></details>").format(
                    notes
                )
            )
        if self.found.imported:
            self._numbers(record)

    def _handles(self, record: Recorded) -> None:
        (first, last), veils = record.plot.x, [ui.element("div").classes("veil") for _ in range(2)]
        wide = (last - first) or 1.0

        def chosen() -> dict[str, float]:
            return {end: float(at) for end, at in (handles.value or {}).items()}

        def shade() -> None:
            low, high = (100 * (chosen()[end] - first) / wide for end in ("min", "max"))
            veils[0].style(f"left: 0; width: {max(low, 0):.2f}%")
            veils[1].style(f"right: 0; width: {max(100 - high, 0):.2f}%")

        def moved() -> None:
            shade()
            if hasattr(self, "start"):
                self.start.value, self.end.value = (round(chosen()[end], 6) for end in ("min", "max"))

        step = float(f"{wide / 1000:.1g}")
        value = {"min": max(first, record.start), "max": min(last, record.end)}
        handles = ui.range(min=first, max=last, step=step, value=value, on_change=moved)
        handles.props('aria-label="Begin and end of the record, seconds"')
        self.handles = handles
        shade()

    def _numbers(self, record: Recorded) -> None:
        self.said = ui.element("div")
        with ui.element("div").classes("line"):
            limits = {"min": 0.0, "max": record.available, "format": "%.6g"}
            self.start = ui.number("Begin [s]", value=round(record.start, 6), **limits).props(
                "outlined hide-bottom-space"
            )
            self.end = ui.number("End [s]", value=round(record.end, 6), **limits).props("outlined hide-bottom-space")
            button("Check and save", lambda: self._save(record), main=True)
        markup('<p class="note">Seconds from where the files of this run overlap. Arrow keys move a handle.</p>')

    async def _save(self, record: Recorded) -> None:
        self.said.clear()
        with self.said:
            try:
                start, end = float(self.start.value or 0.0), float(self.end.value or record.available)
                if not start < end:
                    raise ValueError
                seen = read_file(self.folder)
                text = with_trim(self.folder, seen, self.run, f"{start:.6g} s", f"{end:.6g} s")
                await self.context.worker_pool.think("check", str(self.folder), text)
                write_file(self.folder, text, seen)
            except ValueError:
                say("The begin has to be before the end.")
            except (SeatrialError, OSError) as error:
                say(error)
            else:
                markup('<p class="done" role="status">Saved in campaign.toml. Import anew to cut the record.</p>')


class NewLog:
    """A log of the folder: what it holds, the map that is guessed, and the map in the campaign file."""

    def __init__(self, context: AppContext, campaign: str, folder: Path):
        self.context, self.campaign, self.folder = context, campaign, folder

    def build(self) -> None:
        """Build it."""
        with ui.element("div").classes("line"):
            self.form = (
                ui.select(self._logs(), label="A log in the campaign's folder")
                .props("outlined options-dense hide-bottom-space")
                .classes("wide")
            )
            button("Preview log", self._look, main=True)
        with ui.element("label").classes("upload"):
            markup("or send one from this machine")
            query = '"' + urlencode({"campaign": self.campaign}) + '"'
            ui.element("input").props("type=file").on("change", self._sent, js_handler=_SEND % query)
        self.state = markup("").props('aria-live="polite"')
        self.holder = ui.element("div")

    def _logs(self) -> list[str]:
        from seatrial.apps.dashboard.logs import SUFFIXES

        return logs_of(self.folder, SUFFIXES)

    async def _sent(self, event: Any) -> None:
        kind, words = (str(part) for part in event.args)
        if kind == "kept":
            self.form.set_options(self._logs(), value=words)
            self.state.set_content(Markup('<p class="done">Kept as {}</p>').format(words))
            await self._look()
        elif kind == "sending":
            self.state.set_content(Markup('<p class="waiting">sending {} …</p>').format(words))
        else:
            self.state.set_content(Markup('<div class="error" role="alert"><pre>{}</pre></div>').format(words))

    async def _look(self) -> None:
        self.holder.clear()
        if not self.form.value:
            with self.holder:
                say("Choose a log first.")
            return
        name = str(self.form.value)
        await fill(self.holder, self._looked(name), lambda found: self._show(name, *found), "looking through it …")

    async def _looked(self, name: str) -> Any:
        from seatrial.apps.dashboard.logs import look_into

        path = self.context.campaign_paths.inside(self.folder, name)
        found = await self.context.form_data(self.folder)
        return await asyncio.to_thread(look_into, str(path), name, found.channels), found

    def _show(self, name: str, log: Any, found: FormData) -> None:
        markup(Markup("<p><strong>{}</strong>: {}</p>").format(name, log.kind))
        lines = Markup("").join(Markup("<li>{}</li>").format(line) for line in (*log.tables, *log.remarks))
        markup(Markup('<ul class="findings">{}</ul>').format(lines))
        rows = [[one.name, one.table, one.unit, one.spread, one.trouble] for one in log.columns]
        head = ["column", "table", "unit in the log", "least to greatest", "trouble"]
        markup(
            Markup("<details{}><summary>{} columns</summary>{}</details>").format(
                Markup(" open") if len(rows) <= FEW else "", len(rows), table(head, rows, "Columns", left=2)
            )
        )
        markup(
            table(
                ["channel", "column", "why"],
                [list(one) for one in log.guesses],
                "Guessed channels: check unit and sign of each",
                left=3,
            )
        )
        missing = [channel for channel in found.channels if f"channels.{channel} " not in log.map]
        if missing:
            words = "No column was guessed for {}: add a line for each to the map below, such as <code>{}</code>"
            example = f'channels.{missing[0]} = {{ column = "NAME", unit = "UNIT" }}'
            markup(Markup(f'<p class="alarm">▲ {words}</p>').format(", ".join(missing), example))
        run = re.sub(r"[^A-Za-z0-9_-]", "_", Path(name).stem)[:40] or "run"
        label = ui.input("Name of the run", value=run).props("outlined hide-bottom-space")
        edited = (
            ui.textarea("Channel map, as it will stand in campaign.toml", value=log.map)
            .props("outlined autogrow")
            .classes("mono wide")
            .style("width: 100%")
        )
        said = ui.element("div")

        async def save() -> None:
            said.clear()
            with said:
                try:
                    seen = read_file(self.folder)
                    text = with_map(self.folder, seen, str(label.value), str(edited.value))
                    await self.context.worker_pool.think("check", str(self.folder), text)
                    write_file(self.folder, text, seen)
                except (SeatrialError, OSError) as error:
                    say(error)
                else:
                    markup('<p class="done" role="status">Saved in campaign.toml. Now import the records above.</p>')

        if found.simulated:
            markup(
                '<p class="note">This campaign simulates its vehicle; with a log it no longer does: its [truth] becomes a comment.</p>'
            )
        button("Check and save this map", save, main=True)
