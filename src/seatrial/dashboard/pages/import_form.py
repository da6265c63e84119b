"""A new log: send it, look at what it holds, and say which column is which channel, with its unit, sign and offset."""

import asyncio
import re
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.config.toml_edit import written_tables
from seatrial.cli.campaign_text import write_file
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import SeatrialError
from seatrial.dashboard import channel_map
from seatrial.dashboard.app_context import AppContext, error_html, fill, markup, say, saying
from seatrial.dashboard.campaign_paths import logs_of
from seatrial.dashboard.channel_map import File, Mapped
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.page_layout import LOOK, button
from seatrial.dashboard.pages.map_rows import ChannelRow, ClockRow, columns_of
from seatrial.dashboard.pages.one_axis import OneAxis
from seatrial.dashboard.view_models import FormData, beside

_SEND = """async (e) => {
  const file = e.target.files[0];
  if (!file) return;
  emit(["sending", file.name]);
  try {
    const answer = await fetch("/upload/?" + %s + "&name=" + encodeURIComponent(file.name), { method: "POST", body: file });
    const words = await answer.text();
    emit(answer.ok ? JSON.parse(words) : ["refused", words]);
  } catch (error) { emit(["refused", "the connection ended: the file is too large, or the dashboard has stopped"]); }
  e.target.value = "";
}"""


def upload_field(campaign: str, sent: Callable[[str, str], Awaitable[None]]) -> None:
    """Build the field by which a log is sent.

    Args:
        campaign: to which; empty for one that is not begun.
        sent: is told that it is `sending` a file, has `kept` or `replaced` it at a path, or has `refused` it and why.
    """

    async def told(event: Any) -> None:
        await sent(*(str(part) for part in event.args))

    with ui.element("label").classes("upload"):
        markup("or send one from this machine")
        query = '"' + urlencode({"campaign": campaign}) + '"'
        ui.element("input").props("type=file").on("change", told, js_handler=_SEND % query)


class ImportForm:
    """Logs of the folder, and the map of their columns to channels; nothing is written before the whole file was checked.

    Args:
        context: what is served.
        campaign: its name below the root.
        folder: of the campaign.
        start: imports the records.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path, start: Callable[[], Awaitable[None]]):
        self.context, self.campaign, self.folder, self.start = context, campaign, folder, start
        self._forget()

    def _forget(self) -> None:
        self.is_shown = False
        self.draft = MapDraft(self.folder)
        self.rows: dict[str, ChannelRow] = {}
        self.clocks: dict[tuple[str, str | None], ClockRow] = {}

    def build(self) -> None:
        """Build the choice of a log."""
        with ui.element("div").classes("line"):
            self.form = ui.select(self._logs(), label="A log in the campaign's folder").props(LOOK).classes("wide")
            button("Preview log", self._look, main=True)
        upload_field(self.campaign, self._sent)
        self.state = markup("").props('aria-live="polite"')
        self.holder = ui.element("div")

    def _logs(self) -> list[str]:
        from seatrial.dashboard.logs import SUFFIXES

        return logs_of(self.folder, SUFFIXES)

    async def _sent(self, kind: str, words: str) -> None:
        if kind in ("kept", "replaced"):
            self.form.set_options(self._logs(), value=words)
            await self._look()
            text = "Kept as {}" if kind == "kept" else "Kept as {}, instead of the earlier log of that name"
            self.state.set_content(Markup(f'<p class="done">{text}</p>').format(words))
        elif kind == "sending":
            if not self.is_shown:  # what stands there says what was wrong with another log
                self.holder.clear()
            self.state.set_content(Markup('<p class="waiting">sending {} …</p>').format(words))
        else:
            self.state.set_content(error_html(words, "The file was not kept."))

    async def _look(self) -> None:
        self.state.set_content("")
        self.holder.clear()
        self.is_shown = False
        if not self.form.value:
            with self.holder:
                say("Choose a log first.")
            return
        name = str(self.form.value)
        await fill(self.holder, self._looked(name), lambda found: self._show(name, *found), "looking through it …")

    async def _looked(self, name: str) -> Any:
        from seatrial.dashboard.logs import look_into

        path = self.context.campaign_paths.inside(self.folder, name)
        data = await self.context.form_data(self.folder)
        clocks = self.draft.clocks_of(name, (*data.fit, *data.predict))
        return await asyncio.to_thread(look_into, str(path), name, data.channels, clocks), data

    def _show(self, name: str, log: Any, data: FormData, purpose: str | None = None) -> None:
        """Show what a log holds, and the form."""
        self.is_shown = True
        gone = self.draft.add(name, log, purpose)
        markup(Markup("<p><strong>{}</strong>: {}</p>").format(name, log.kind))
        lines = Markup("").join(Markup("<li>{}</li>").format(line) for line in (*log.tables, *log.remarks))
        markup(Markup('<ul class="findings">{}</ul>').format(lines))
        if dropped := ", ".join(self.draft.dropped):
            words = "The choice for {} is discarded: {} is not a log of the same run, so the form begins again with it."
            markup(Markup('<p class="note" role="status">' + words + "</p>").format(dropped, name))
        if gone:
            words = "In the map below {} replaces {}, because it has all mapped columns of that log."
            markup(Markup('<p class="note" role="status">' + words + "</p>").format(name, ", ".join(gone)))
        with ui.element("details"):
            with ui.element("summary"):
                markup(f"{len(log.columns)} columns")
            self.columns = name, markup(columns_of(self.draft, name))
        self._offer_run(name)
        self._offer_purposes(name, log, data)
        self._rows(data)
        self._ends(data)

    def _offer_purposes(self, name: str, log: Any, data: FormData) -> None:
        """Offer what the log may be to the campaign; a choice that asks for another map begins it again."""
        if len(self.draft.purposes) < 2:
            return

        def choose() -> None:
            purpose = str(chosen.value)
            if self.draft.choose(purpose):
                self._say_replaced()
                return
            self.holder.clear()
            with self.holder:
                self._show(name, log, data, purpose)

        chosen = ui.select(self.draft.purposes, value=self.draft.purpose, label="This log is").props(LOOK)
        chosen.classes("wide").on_value_change(choose)

    def _offer_run(self, name: str) -> None:
        """Offer to add the log as a further run where it has all columns of the map that is there."""
        self.offer = ui.element("div")
        run, saved = self.draft.further(name), self.draft.saved
        if run is None:
            return

        async def add(role: str) -> None:
            with saying(messages):
                text = channel_map.with_further_run(self.folder, saved, run, role)
                await self.context.worker_pool.think("check", str(self.folder), text)
                write_file(self.folder, text, saved)
                self._begin_anew()
                words = (
                    f"Saved in campaign.toml: {run.label} is under {role}, with the columns of the earlier map. "
                    "Next, import the records: the chart at the top of this page will show it."
                )
                self._offer_import(self.holder, words)

        with self.offer:
            markup(Markup("<h3>Another run, {}, with the columns of the map in campaign.toml</h3>").format(run.label))
            with ui.element("div").classes("line"):
                button("Add it, to fit", lambda: add("fit"))
                button("Add it, held back to predict", lambda: add("predict"))
        messages = ui.element("div")

    def _begin_anew(self) -> None:
        """Empty the form: what was previewed and chosen is saved."""
        self._forget()
        self.form.value = None
        self.state.set_content("")
        self.holder.clear()

    def _offer_import(self, place: ui.element, words: str) -> None:
        """Return what was saved, and offer what comes next; that empties the form, and leads to where the records will be."""

        async def go() -> None:
            self._begin_anew()
            ui.run_javascript('document.getElementById("main").focus()')
            await self.start()

        with place:
            markup(Markup('<p class="done" role="status">{}</p>').format(words))
            offered = button("Import the records", go, main=True)
            ui.run_javascript(f"getElement({offered.id}).$el.focus()")

    def _rows(self, data: FormData) -> None:
        draft, mapped = self.draft, self.draft.channels
        self.clocks, self.clock_rows = {}, ui.element("div")
        self._show_clocks()
        markup("<h3>Columns of the channels</h3>")
        self.rows = {
            channel: ChannelRow(draft, channel, mapped.get(channel), channel in data.controls, self._set_channel)
            for channel in dict.fromkeys((*data.channels, *mapped))
        }
        self.axis = OneAxis(self.context, draft, self._change, self._checked)
        self.axis.build()

    def _show_clocks(self) -> None:
        """Show the column of time of each table that the map names, and of each that has none by its name; what is shown stays."""
        mapped, shown = {channel_map.identity_of(one) for one in self.draft.files}, {}
        for log, looked in self.draft.logs.items():
            for name in looked.heads:
                entry = self.draft.file_of(log, name)
                row = log, entry.get("table")
                if channel_map.identity_of(entry) in mapped or not entry["time"]["column"] or row in self.clocks:
                    shown[row] = name, entry
        if list(shown) == list(self.clocks):
            return
        self.clock_rows.clear()
        with self.clock_rows:
            if shown:
                markup("<h3>Column of the time</h3>")
            self.clocks = {
                (log, table): ClockRow(self.draft, log, name, entry, partial(self._set_time, log, name, table))
                for (log, table), (name, entry) in shown.items()
            }

    def _ends(self, data: FormData) -> None:
        with ui.element("div").classes("line"):
            self.run = ui.input("Name of the run", value=self.draft.label).props(LOOK)
        self.replaced = markup("").props('role="status"')
        self.run.on_value_change(self._renamed)
        self._say_replaced()
        with ui.element("details"):
            with ui.element("summary"):
                markup("The same as TOML: further keys, such as sums of columns, are kept")
            self.text = ui.textarea(
                "Channel map for campaign.toml", value=written_tables("import.files", self.draft.files)
            )
            self.text.props("outlined autogrow").classes("mono wide").style("width: 100%")
            self.text.on("blur", self._typed)
        if data.simulated:
            words = "This campaign simulates its vehicle. With a log it does not: its [truth] becomes a comment."
            markup(Markup('<p class="note">{}</p>').format(words))
        button("Check and save this map", self._save, main=True)
        self.said = ui.element("div")

    def _renamed(self) -> None:
        self.draft.label = str(self.run.value)
        self._say_replaced()

    def _say_replaced(self) -> None:
        """Return what saving does to the runs and logs that the campaign file names."""
        words = self.draft.replaced()
        self.replaced.set_content(Markup('<p class="note">{}</p>').format(words) if words else Markup(""))

    def _typed(self) -> None:
        """Take the map as somebody typed it, or show what is wrong with it."""
        self.text.error = None
        try:
            files = channel_map.typed_map(str(self.text.value))
        except SeatrialError as error:
            self.text.error = str(error)
            return
        self._change(files)

    def _change(self, files: list[File]) -> None:
        if files != self.draft.files:
            self.said.clear()
            self.text.value, self.text.error = written_tables("import.files", files), None
        self.draft.files = files
        self._say_replaced()
        self._show_clocks()
        self.axis.refresh()

    def _set_channel(self, name: str, mapped: Mapped | None) -> None:
        """Change one channel of the map, and the text that shows it."""
        self._change(channel_map.with_channel(self.draft.files, name, mapped))

    async def _set_time(self, log: str, name: str, table: str | None, column: str, unit: str) -> None:
        """Change the column of time of one table of a log: in the map, for channels that are yet to be mapped, and under the pictures."""
        draft, before = self.draft, self.draft.file_of(log, name)["time"]["column"]
        try:
            heads = draft.logs[log].heads
            (head,) = channel_map.with_time([heads[name]], log, table, column, unit)
            draft.logs[log] = draft.logs[log]._replace(heads={**heads, name: head})
            self._change(channel_map.with_time(draft.files, draft.named(log), table, column, unit))
            if column != before:
                await self._redraw(log, name, column)
        except (SeatrialError, OSError) as error:
            if (log, table) in self.clocks:
                self.clocks[log, table].complain(beside(error))
        for row in self.rows.values():
            row.draw()
        previewed, shown = self.columns
        if previewed in self.draft.logs:
            shown.set_content(columns_of(self.draft, previewed))

    async def _redraw(self, log: str, name: str, column: str) -> None:
        """Draw the small pictures of one table over another column of time, unless that was changed meanwhile."""
        from seatrial.dashboard.logs import look_into

        path = self.context.campaign_paths.inside(self.folder, log)
        summary = await asyncio.to_thread(look_into, str(path), log, (), {name: column})
        there = self.draft.logs.get(log)
        if there is None or self.draft.file_of(log, name)["time"]["column"] != column:
            return
        drawn = {one.name: one.picture for one in summary.columns if one.table == name}
        columns = tuple(
            one._replace(picture=drawn.get(one.name, "")) if one.table == name else one for one in there.columns
        )
        self.draft.logs[log] = there._replace(columns=columns, axes={**there.axes, name: summary.axes[name]})

    async def _checked(self, messages: ui.element) -> str | None:
        """The campaign file with this map, checked; None if something is wrong, which is said beside its channel."""
        messages.clear()
        for row in (*self.rows.values(), *self.clocks.values()):
            row.complain("")
        without_unit = [row for row in self.rows.values() if row.lacks_unit]
        for row in without_unit:
            row.complain(f'Write the unit of {row.channel}, such as "{shown_unit(row.channel)[1]}".', "unit")
        identities: list[Any] = []
        text = ""
        if self.text.error:
            with messages:
                say("Nothing was written. See the error of the map as TOML above.")
            return None
        try:
            run = self.draft.reader or "{run}"
            identities = [(channel_map.path_of(one, run), one.get("table")) for one in self.draft.files]
            for one, identity in zip(self.draft.files, identities, strict=True):
                if not one.get("time", {}).get("column", "-") and identity in self.clocks:
                    self.clocks[identity].complain("Choose the column of the time stamps, and its unit.", "column")
                    return None
            if without_unit:
                units = ", ".join(row.channel for row in without_unit)
                with messages:
                    say(f"Nothing was written. These units are missing: {units}.")
                return None
            text = self.draft.text()
            await self.context.worker_pool.think("check", str(self.folder), text)
        except (SeatrialError, OSError) as error:
            file = re.search(r"files\[(\d+)\]\.time(?:\.(\w+))?", str(error))
            before = len(channel_map.files_of(text)) - len(identities)  # those of other runs
            at_clock = -1 if file is None else int(file[1]) - before
            clock = self.clocks.get(identities[at_clock]) if 0 <= at_clock < len(identities) else None
            at = re.search(r"channels\.([A-Za-z0-9_]+)(?:\.(\w+))?", str(error))
            if file is not None and clock is not None:
                clock.complain(beside(error), file[2])
            elif at is not None and at[1] in self.rows:
                self.rows[at[1]].complain(beside(error), at[2])
            else:
                with messages:
                    say(error)
            return None
        return text

    async def _save(self) -> None:
        text, draft = await self._checked(self.said), self.draft
        if text is None:
            return
        with saying(self.said):
            missing = await self.context.worker_pool.think("channels_without_column", str(self.folder), text)
            for channel, why in missing.items():
                if channel in self.rows:
                    self.rows[channel].complain(f"Choose a column: {channel} {why}.", "column")
            names = f"These channels need a column: {', '.join(missing)}."
            if refusal := names if missing else await self.axis.apart(text):
                say(f"Nothing was written. {refusal}")
                return
            write_file(self.folder, text, draft.saved)
            self._offer_saved(text)

    def _offer_saved(self, text: str) -> None:
        """Return what was saved, and offer what comes next."""
        draft = self.draft
        imports = channel_map.imports_of(text)
        held_back = f"; held back to predict: {', '.join(imports['predict'])}" if imports.get("predict") else ""
        words = (
            f"Saved in campaign.toml. To fit: {', '.join(imports['fit'])}{held_back}. "
            "Now import the records: they will be shown above."
        )
        if draft.is_own:  # the form holds the map of one run, and the file that of several
            self._begin_anew()
            self._offer_import(self.holder, words)
            return
        draft.saved = text
        draft.keep()
        self.offer.clear()
        self.replaced.set_content("")
        self.axis.tell()
        self._offer_import(self.said, words)
