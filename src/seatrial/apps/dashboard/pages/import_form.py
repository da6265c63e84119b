"""A new log: send it, look at what it holds, and say which column is which channel, with its unit, sign and offset."""

import asyncio
import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.campaign_text import CAMPAIGN, read_file, write_file
from seatrial.apps.dashboard.app_context import AppContext, fill, markup, say
from seatrial.apps.dashboard.campaign_paths import logs_of
from seatrial.apps.dashboard.edits import (
    Mapped,
    channel_map_of,
    channels_of,
    files_of,
    further_run,
    has_columns,
    map_of_log,
    map_of_run,
    runs_of,
    runs_reading,
    with_channel,
    with_further_run,
    with_map,
    with_newer_log,
    with_own_map,
    with_time,
)
from seatrial.apps.dashboard.page_layout import button, table
from seatrial.apps.dashboard.pages.one_axis import OneAxis
from seatrial.apps.dashboard.view_models import FormData, beside
from seatrial.apps.toml_edit import written
from seatrial.campaign.config.toml import toml_content
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import SeatrialError
from seatrial.core.units import to_si
from seatrial.logs.formats.protocol import TIME_UNITS
from seatrial.logs.guess import unit_by_name

NONE, KEPT = "", "as in campaign.toml"
"""Choices of a row: no column, and what stands in the campaign file."""
BETWEEN = {"held": "held", "line": "along a line"}
"""What a control does between its samples: a command is held, what was measured changes along a line."""
CHANGE, OWN_FIT, OWN_PREDICT, FILE, INSTEAD = "change", "fit", "predict", "file", "instead"
"""What a log is: one that the map reads, a run with a map of its own, a further file of a run, or a run in the place of all."""
LOOK = "outlined options-dense hide-bottom-space"
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


class ImportForm:
    """Logs of the folder, and the map of their columns to channels; nothing is written before the whole file was checked.

    Args:
        context: what is served.
        campaign: its name below the root.
        folder: of the campaign.
        start: imports the records.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path, start: Callable[[], Awaitable[None]]):
        self.start = start
        self.context, self.campaign, self.folder = context, campaign, folder
        self.seen, self.map, self.others, self.logs = "", "", "", {}
        self.drawn: list[dict[str, Any]] | None = None
        self.purpose, self.purposes, self.label, self.reader = CHANGE, {}, "", ""
        self.rows: dict[str, Row] = {}
        self.clocks: dict[tuple[str, str | None], ClockRow] = {}
        self.drawn_over: dict[tuple[str, str], str] = {}

    def build(self) -> None:
        """Build the choice of a log."""
        with ui.element("div").classes("line"):
            self.form = ui.select(self._logs(), label="A log in the campaign's folder").props(LOOK).classes("wide")
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
        clocks = self._clocks_of(name, (*found.fit, *found.predict))
        return await asyncio.to_thread(look_into, str(path), name, found.channels, clocks), found

    def _clocks_of(self, name: str, runs: Sequence[str]) -> dict[str | None, str]:
        """Return the column of time that the map names for each table of a log."""
        try:
            files = files_of(self.map or channel_map_of(read_file(self.folder)))
        except SeatrialError:  # said where the map is edited
            return {}
        mine = [one for one in files if name in {str(one.get("path")).replace("{run}", run) for run in runs or ("",)}]
        clocks = {one.get("table"): str(one.get("time", {}).get("column") or "") for one in mine}
        return {table: column for table, column in clocks.items() if column}

    def _show(self, name: str, log: Any, found: FormData, purpose: str | None = None) -> None:
        """Show what a log holds, and the form; logs that were previewed before stay in the choices of columns."""
        if not self.logs:
            self.seen = read_file(self.folder)
            self.map = channel_map_of(self.seen)
        self.logs[name] = log
        self.drawn_over = {place: column for place, column in self.drawn_over.items() if place[0] != name}
        try:
            gone = self._begin_map(name, log, purpose)
        except SeatrialError:  # said where the map is edited
            gone = ()
        there = channels_of(self.map)
        for one in log.guesses:
            if one.channel not in there:
                self.map = with_channel(
                    self.map,
                    one.channel,
                    Mapped(one.channel, self.head(name, one.table), one.column, one.unit, one.scale, 0.0, one.between),
                )
        markup(Markup("<p><strong>{}</strong>: {}</p>").format(name, log.kind))
        lines = Markup("").join(Markup("<li>{}</li>").format(line) for line in (*log.tables, *log.remarks))
        markup(Markup('<ul class="findings">{}</ul>').format(lines))
        if gone:
            words = "In the map below {} takes the place of {}, because it has all that was mapped from there."
            markup(Markup('<p class="note" role="status">' + words + "</p>").format(name, ", ".join(gone)))
        with ui.element("details"):
            with ui.element("summary"):
                markup(f"{len(log.columns)} columns")
            self.columns = name, markup(columns_of(log))
        self._offer_run(name, log)
        self._offer_purposes(name, log, found)
        self._rows(found)
        self._ends(found)
        self.drawn = self._files()

    def _files(self) -> list[dict[str, Any]]:
        """The map of the form as it can be compared; empty where it is not TOML."""
        try:
            return files_of(self.map)
        except SeatrialError:  # said where the map is edited
            return []

    def _begin_map(self, name: str, log: Any, purpose: str | None) -> tuple[str, ...]:
        """Begin the map of a log by what the log is to the campaign, and return the logs whose place it takes in that map."""
        saved = channel_map_of(self.seen)
        runs, readers = runs_of(self.seen), runs_reading(self.seen, name)
        if self._is_example(saved, runs):
            self.label = self._run_of(name)
            self.map, gone = with_newer_log(self.map, name, log, runs)
            return gone
        is_begun = self.drawn is not None and self._files() != self.drawn
        if readers and purpose is None and is_begun and self.purpose in (CHANGE, FILE):
            return ()
        if readers:
            whose = readers[0]
            mine, others = map_of_run(saved, whose)
            has_all = all(has_columns(log, one) for one in files_of(mine) if self._path(one, whose) == name)
            sharers = [one for one in runs if map_of_run(saved, one)[0] == mine]
            self.purposes = {CHANGE: f"run {whose}, by the map of run {', '.join(sharers)}"}
            if len(sharers) > 1:
                self.purposes[OWN_FIT] = f"run {whose}, with a map of its own"
            usual = CHANGE if has_all or len(sharers) == 1 else OWN_FIT
        else:
            mine, others = map_of_run(saved, runs[0])
            mapped, guessed = channels_of(mine), {one.channel for one in log.guesses}
            self.purposes = {
                OWN_FIT: "another run, to fit, with a map of its own",
                OWN_PREDICT: "another run, held back to predict, with a map of its own",
                FILE: f"a further file of run {runs[0] if others.strip() else ', '.join(runs)}",
                INSTEAD: f"the only run, in the place of {', '.join(runs)}",
            }
            usual = FILE if guessed and guessed.isdisjoint(mapped) else OWN_FIT
            if purpose is None and is_begun:  # a further log of the map that is being written
                self.purpose = FILE if self.purpose == CHANGE else self.purpose
                return ()
        self.purpose, self.others, self.reader = purpose or usual, others, readers[0] if readers else ""
        self.label = self._run_of(name)
        if self.purpose in (CHANGE, FILE):
            self.map = mine
            return ()
        self.logs = {name: log}
        self.map = map_of_log(
            with_newer_log(mine.replace("{run}", readers[0]) if readers else mine, name, log, runs)[0], name
        )
        if not all(has_columns(log, one) for one in files_of(self.map)):
            self.map = ""
        return ()

    def named(self, log: str) -> str:
        """Return the path by which the map names a log, which may have `{run}`; that of the log where it does not name it."""
        paths = [str(one.get("path")) for one in self._files()]
        return next((one for one in paths if one.replace("{run}", self.reader or "{run}") == log), log)

    def head(self, log: str, table: str) -> str:
        """Return the `[[import.files]]` of a table of a log without channels, by the path by which the map names the log."""
        path = f"path = {written(self.named(log))}"
        return re.sub(r"^path = .*$", lambda _: path, self.logs[log].heads[table], count=1, flags=re.MULTILINE)

    @staticmethod
    def _path(file: Mapping[str, Any], run: str) -> str:
        return str(file.get("path")).replace("{run}", run)

    def _is_example(self, channel_map: str, runs: Sequence[str]) -> bool:
        """Whether a map names no log that may exist, as that of a template, or that of no run."""
        return not any(self._is_there(str(one.get("path")), run) for one in files_of(channel_map) for run in runs)

    def _offer_purposes(self, name: str, log: Any, found: FormData) -> None:
        """Offer what the log may be to the campaign; another choice begins the map anew."""
        if len(self.purposes) < 2:
            return

        def choose() -> None:
            purpose = str(chosen.value)
            self.holder.clear()
            with self.holder:
                self._show(name, log, found, purpose)

        chosen = ui.select(self.purposes, value=self.purpose, label="This log is").props(LOOK).classes("wide")
        chosen.on_value_change(choose)

    def _offer_run(self, name: str, log: Any) -> None:
        """Offer to add the log as a further run where it has all columns of the map that is there."""
        self.offer = ui.element("div")
        try:
            run = further_run(self.seen, name)
            has_all = all(has_columns(log, one) for one in files_of(channel_map_of(self.seen)))
        except SeatrialError:  # said where the map is edited
            return
        if run is None or not has_all:
            return
        with self.offer:
            markup(Markup("<h3>Another run, {}, with the columns of the map in campaign.toml</h3>").format(run.label))

        async def add(role: str) -> None:
            said.clear()
            try:
                text = with_further_run(self.folder, self.seen, run, role)
                await self.context.worker_pool.think("check", str(self.folder), text)
                write_file(self.folder, text, self.seen)
            except (SeatrialError, OSError) as error:
                with said:
                    say(error)
                return
            self._begin_anew()
            with self.holder:
                words = (
                    "Saved in campaign.toml: {} is under {}, with the columns of the map that was there. "
                    "Next, import the records: the chart at the top of this page will show it."
                )
                markup(Markup('<p class="done" role="status">' + words + "</p>").format(run.label, role))
                self._offer_import()

        with self.offer, ui.element("div").classes("line"):
            button("Add it, to fit", lambda: add("fit"))
            button("Add it, held back to predict", lambda: add("predict"))
        said = ui.element("div")

    def _begin_anew(self) -> None:
        """Empty the form: what was previewed and chosen is saved."""
        self.seen, self.map, self.others, self.drawn, self.logs = "", "", "", None, {}
        self.purpose, self.purposes, self.label, self.reader = CHANGE, {}, "", ""
        self.rows, self.clocks, self.drawn_over = {}, {}, {}
        self.form.value = None
        self.state.set_content("")
        self.holder.clear()

    def _offer_import(self) -> None:
        """Offer what comes after saving; it empties the form, and leads to the top of the page, where the records will be."""

        async def go() -> None:
            self._begin_anew()
            ui.run_javascript('document.getElementById("main").focus()')
            await self.start()

        offered = button("Import the records", go, main=True)
        ui.run_javascript(f"getElement({offered.id}).$el.focus()")

    def _settled(self) -> None:
        """Take away what was said of a map that was not saved yet."""
        self.offer.clear()
        self.replaced.set_content("")

    def _rows(self, found: FormData) -> None:
        mapped = channels_of(self.map)
        choices = {
            f"{log}|{one.table}|{one.name}": (log, one)
            for log, looked in self.logs.items()
            for one in looked.columns
            if one.table in looked.heads and one.spread
        }
        self.clocks, self.clock_rows = {}, ui.element("div")
        self._show_clocks()
        markup("<h3>Which column is which channel</h3>")
        channels = dict.fromkeys((*found.channels, *mapped))
        self.rows = {
            channel: Row(self, channel, choices, mapped.get(channel), channel in found.controls) for channel in channels
        }
        heads = {(log, name): head for log, looked in self.logs.items() for name, head in looked.heads.items()}
        self.axis = OneAxis(self.context, self.folder, lambda: self.map, self._change, self._draft, lambda: self.seen)
        guesses = {
            f"{log}|{one.table}|{one.column}": one.channel
            for log, looked in self.logs.items()
            for one in looked.guesses
        }
        self.axis.build(choices, heads, guesses)

    def _show_clocks(self) -> None:
        """Show the column of time of each table that the map names, and of each that has none by its name."""
        try:
            mapped = {(str(one.get("path")), one.get("table")) for one in files_of(self.map)}
        except SeatrialError:  # said where the map is edited
            return
        shown = {}
        for log, looked in self.logs.items():
            for name, head in looked.heads.items():
                (said,) = files_of(head)
                if not said["time"]["column"] or (self.named(log), said.get("table")) in mapped:
                    shown[log, said.get("table")] = name
        if list(shown) == list(self.clocks):
            return
        self.clock_rows.clear()
        with self.clock_rows:
            if shown:
                markup("<h3>Which column is the time</h3>")
            self.clocks = {(log, table): ClockRow(self, log, name, table) for (log, table), name in shown.items()}

    def _ends(self, found: FormData) -> None:
        with ui.element("div").classes("line"):
            self.run = ui.input("Name of the run", value=self.label).props(LOOK)
        self.replaced = markup("").props('role="status"')
        self.run.on_value_change(self._renamed)
        self._say_replaced()
        with ui.element("details"):
            with ui.element("summary"):
                markup("The same as TOML: comments and further keys, such as sums of columns, are kept")
            self.text = ui.textarea("Channel map, as it will stand in campaign.toml", value=self.map)
            self.text.props("outlined autogrow").classes("mono wide").style("width: 100%")
            self.text.on("blur", lambda: self._change(str(self.text.value)))
        if found.simulated:
            words = "This campaign simulates its vehicle; with a log it no longer does: its [truth] becomes a comment."
            markup(Markup('<p class="note">{}</p>').format(words))
        button("Check and save this map", self._save, main=True)
        self.said = ui.element("div")

    def _run_of(self, name: str) -> str:
        """Return the run that a log is, as the campaign names it or as the names of the logs tell it."""
        stem = re.sub(r"[^A-Za-z0-9_-]", "_", Path(name).stem)[:40] or "run"
        try:
            runs, readers = runs_of(self.seen), runs_reading(self.seen, name)
            if self.purpose == FILE:
                return runs[0]
            further = further_run(self.seen, name)
        except SeatrialError:  # said where the map is edited
            return stem
        return readers[0] if readers else stem if further is None else further.label

    def _renamed(self) -> None:
        self.label = str(self.run.value)
        self._say_replaced()

    def _say_replaced(self) -> None:
        """Say what saving does to the runs and logs that the campaign file names."""
        try:
            words = self._replaced(self.label)
        except SeatrialError:  # said where the map is edited
            words = ""
        self.replaced.set_content(Markup('<p class="note">{}</p>').format(words) if words else Markup(""))

    def _replaced(self, run: str) -> str:
        saved, runs = channel_map_of(self.seen), runs_of(self.seen)
        if self._is_example(saved, runs):
            return ""
        others = [one for one in runs if one != run]
        before = ", ".join(dict.fromkeys(self._path(one, run) for one in files_of(map_of_run(saved, run)[0])))
        if self.purpose in (OWN_FIT, OWN_PREDICT):
            if run in runs:
                return f"Saving gives run {run} this map in the place of that of {before}."
            where = "to fit" if self.purpose == OWN_FIT else "held back to predict"
            return f"Saving adds run {run}, {where}, with this map. Run {', '.join(others)} keeps the map that it has."
        if run in runs:
            named = {self._path(one, run) for one in files_of(self.map)}
            lost = [one for one in before.split(", ") if one not in named]
            return f"Saving takes {', '.join(lost)} out of the map of run {run}." if lost else ""
        logs = dict.fromkeys(self._path(one, label) for label in runs for one in files_of(map_of_run(saved, label)[0]))
        return (
            f"Saving removes run {', '.join(runs)} from the campaign file, with the map of {', '.join(logs)}. "
            f"Run {run} is then the only run, to fit."
        )

    def _is_there(self, path: str, run: str) -> bool:
        """Whether a log that the map names may exist; one that is named by a variable is not looked for."""
        return any(mark in path for mark in "$~") or (self.folder / path.replace("{run}", run)).exists()

    def _change(self, channel_map: str) -> None:
        self.map = self.text.value = channel_map
        self._say_replaced()
        self._show_clocks()
        self.axis.refresh()

    def set_channel(self, name: str, mapped: Mapped | None) -> None:
        """Change one channel of the map, and the text that shows it."""
        try:
            self._change(with_channel(self.map, name, mapped))
        except SeatrialError as error:
            self.rows[name].complain(beside(error))

    async def set_time(self, log: str, name: str, table: str | None, column: str, unit: str) -> None:
        """Change the column of time of one table of a log: in the map, for channels that are yet to be mapped, and under the pictures."""
        try:
            self._change(with_time(self.map, self.named(log), table, column, unit))
            head = with_time(self.logs[log].heads[name], log, table, column, unit)
            self.logs[log] = self.logs[log]._replace(heads={**self.logs[log].heads, name: head})
            if self.drawn_over.get((log, name), self.logs[log].axes[name].clock) != column:
                self.drawn_over[log, name] = column
                await self._redraw(log, name, column)
        except (SeatrialError, OSError) as error:
            if (log, table) in self.clocks:
                self.clocks[log, table].complain(beside(error))
        self._draw()

    def _draw(self) -> None:
        """Show the small pictures as they are now, in the rows and in the table of columns."""
        for row in self.rows.values():
            row.draw()
        name, shown = self.columns
        if name in self.logs:
            shown.set_content(columns_of(self.logs[name]))

    async def _redraw(self, log: str, name: str, column: str) -> None:
        """Draw the small pictures of one table over another column of time, unless that was changed meanwhile."""
        from seatrial.apps.dashboard.logs import look_into

        path = self.context.campaign_paths.inside(self.folder, log)
        found = await asyncio.to_thread(look_into, str(path), log, (), {name: column})
        there = self.logs.get(log)
        if there is None or files_of(there.heads[name])[0]["time"]["column"] != column:
            return
        drawn = {one.name: one.picture for one in found.columns if one.table == name}
        columns = tuple(
            one._replace(picture=drawn.get(one.name, "")) if one.table == name else one for one in there.columns
        )
        self.logs[log] = there._replace(columns=columns, axes={**there.axes, name: found.axes[name]})

    def picture(self, log: str, table: str, column: str) -> Markup:
        """Small picture of a column, over the time or the rows of its table."""
        looked = self.logs[log]
        one = next(one for one in looked.columns if (one.table, one.name) == (table, column))
        return picture_of(one, axis_words(looked, table))

    async def _draft(self, said: ui.element) -> tuple[str, str] | None:
        """The campaign file with this map, checked, and the run; None where something is wrong, which is said beside its channel."""
        said.clear()
        for row in (*self.rows.values(), *self.clocks.values()):
            row.complain("")
        without_unit = [row for row in self.rows.values() if row.lacks_unit]
        for row in without_unit:
            row.complain(f'Write the unit of {row.channel}, such as "{shown_unit(row.channel)[1]}".', "unit")
        identities: list[Any] = []
        text = ""
        try:
            files = files_of(self.map)
            identities = [(self._path(one, self.reader or "{run}"), one.get("table")) for one in files]
            for one, identity in zip(files, identities, strict=True):
                if not one.get("time", {}).get("column", "-") and identity in self.clocks:
                    self.clocks[identity].complain("Choose the column of the time stamps, and its unit.", "column")
                    return None
            if without_unit:
                with said:
                    say(
                        f"Nothing was written. See above which units are missing: {', '.join(row.channel for row in without_unit)}."
                    )
                return None
            text = self._with_map(self.label)
            await self.context.worker_pool.think("check", str(self.folder), text)
        except (SeatrialError, OSError) as error:
            file = re.search(r"files\[(\d+)\]\.time(?:\.(\w+))?", str(error))
            before = len(files_of(channel_map_of(text))) - len(identities)  # those of other runs
            at_clock = -1 if file is None else int(file[1]) - before
            clock = self.clocks.get(identities[at_clock]) if 0 <= at_clock < len(identities) else None
            at = re.search(r"channels\.([A-Za-z0-9_]+)(?:\.(\w+))?", str(error))
            if file is not None and clock is not None:
                clock.complain(beside(error), file[2])
            elif at is not None and at[1] in self.rows:
                self.rows[at[1]].complain(beside(error), at[2])
            else:
                with said:
                    say(error)
            return None
        return text, self.label

    def _with_map(self, run: str) -> str:
        """The campaign file with the map of the form, by what the log is to the campaign."""
        if self.purpose in (OWN_FIT, OWN_PREDICT):
            return with_own_map(self.folder, self.seen, run, self.purpose, self.map)
        has_others = self.purpose != INSTEAD and run in runs_of(self.seen)
        return with_map(self.folder, self.seen, run, f"{self.others}\n{self.map}" if has_others else self.map)

    async def _save(self) -> None:
        made = await self._draft(self.said)
        if made is None:
            return
        if not await self._is_whole(made[0]):
            return
        with self.said:
            try:
                write_file(self.folder, made[0], self.seen)
            except (SeatrialError, OSError) as error:
                say(error)
                return
        imports = toml_content(CAMPAIGN, made[0])["import"]
        held_back = f"; held back to predict: {', '.join(imports['predict'])}" if imports.get("predict") else ""
        words = (
            f"Saved in campaign.toml. To fit: {', '.join(imports['fit'])}{held_back}. "
            "Now import the records: they will be shown above."
        )
        if self.purpose in (OWN_FIT, OWN_PREDICT):  # the form holds the map of one run, and the file that of several
            self._begin_anew()
            place = self.holder
        else:
            self.seen, place, self.drawn = made[0], self.said, self._files()
            self._settled()
            self.axis.tell()
        with place:
            markup(Markup('<p class="done" role="status">{}</p>').format(words))
            self._offer_import()

    async def _is_whole(self, text: str) -> bool:
        """Return whether every channel that the campaign needs has a column; what is missing is said beside its row."""
        try:
            missing = await self.context.worker_pool.think("channels_without_column", str(self.folder), text)
        except (SeatrialError, OSError) as error:
            with self.said:
                say(error)
            return False
        for channel, why in missing.items():
            if channel in self.rows:
                self.rows[channel].complain(f"Choose a column: {channel} {why}.", "column")
        if missing:
            with self.said:
                say(f"Nothing was written. See above what needs a column: {', '.join(missing)}.")
        return not missing


class MapRow:
    """A row of the form, and what is wrong with it.

    Attributes:
        parts: fields by the key of the map that they say.
        said: element beside the row.
    """

    parts: Mapping[str, ui.element]
    said: ui.element

    def complain(self, words: str, part: str | None = None) -> None:
        """Say beside the row what is wrong, and outline the field that says a key of the map; nothing if empty."""
        for key, field in self.parts.items():
            field.props("error" if key == part else "", remove="" if key == part else "error")
        self.said.clear()
        if words:
            with self.said:
                say(words)


class ClockRow(MapRow):
    """The column of time of one table of a log, and its unit.

    Args:
        form: that the row belongs to.
        log: its path from the campaign's folder.
        name: of the table.
        table: the same as the map says it, None where the log has one.
    """

    def __init__(self, form: ImportForm, log: str, name: str, table: str | None):
        self.form, self.log, self.name, self.table = form, log, name, table
        identity = form.named(log), table
        there = next((one for one in files_of(form.map) if (one.get("path"), one.get("table")) == identity), None)
        (head,) = files_of(form.logs[log].heads[name])
        time = (head if there is None else there).get("time", {})
        columns = [one.name for one in form.logs[log].columns if one.table == name]
        column = str(time.get("column", ""))
        options = {one: one or "choose" for one in dict.fromkeys(("", *columns, column))}
        place = f"{Path(log).name} · {table}" if table else Path(log).name
        with ui.element("div").classes("line channel"):
            self.column = ui.select(options, value=column, label=f"time of {place}: column", on_change=self._changed)
            self.column.props(LOOK)
            unit = str(time.get("unit", "s"))
            units = list(dict.fromkeys((*TIME_UNITS, unit)))
            self.unit = ui.select(units, value=unit, label=f"time of {place}: unit", on_change=self._changed)
            self.unit.props(LOOK)
            self.said = ui.element("div").classes("beside")
        self.parts = {"column": self.column, "unit": self.unit}

    async def _changed(self) -> None:
        self.complain("")
        await self.form.set_time(self.log, self.name, self.table, str(self.column.value or ""), str(self.unit.value))


class Row(MapRow):
    """One channel: its column with a small picture, unit, sign and offset, and of a control what it does between its samples.

    Args:
        form: that the row belongs to.
        channel: its name.
        choices: columns by key, with the log of each.
        there: what the map says of the channel; None if nothing.
        is_control: whether it drives the vehicle.
    """

    def __init__(
        self,
        form: ImportForm,
        channel: str,
        choices: dict[str, Any],
        there: dict[str, Any] | None,
        is_control: bool,
    ):
        self.form, self.channel, self.choices = form, channel, choices
        options = {NONE: "not in a log", **{key: f"{one.name} · {one.table}" for key, (_, one) in choices.items()}}
        if len(form.logs) > 1:
            options |= {key: f"{one.name} · {log}" for key, (log, one) in choices.items()}
        value = NONE if there is None else self._key(there)
        if value == KEPT:
            options[KEPT] = KEPT
        scale = 1.0 if there is None else float(there.get("scale", 1.0))
        with ui.element("div").classes("line channel"):
            self.column = ui.select(options, value=value, label=f"{channel}: column", on_change=self._chosen).props(
                LOOK
            )
            self.picture = markup("")
            unit = "" if there is None else str(there.get("unit", ""))
            self.unit = ui.input("unit", value=unit, on_change=self._changed).props(
                f'{LOOK} aria-label="{channel}: unit"'
            )
            self.factor = ui.number("factor", value=abs(scale), on_change=self._changed).props(LOOK)
            self.sign = ui.select({1: "+", -1: "− reversed"}, value=-1 if scale < 0 else 1, label="sign")
            self.sign.props(LOOK).on_value_change(self._changed)
            offset = 0.0 if there is None else float(there.get("offset", 0.0))
            self.offset = ui.number("offset, in the unit", value=offset, on_change=self._changed).props(LOOK)
            self.offset.classes("offset")
            between = "held" if there is None else str(there.get("between") or "held")
            self.between = None
            if is_control:
                self.between = ui.select(BETWEEN, value=between, label=f"{channel}: between samples")
                self.between.props(LOOK).classes("between").on_value_change(self._changed)
            self.said = ui.element("div").classes("beside")
        self.parts = {"column": self.column, "unit": self.unit, "scale": self.factor, "offset": self.offset}
        self.draw()

    def _key(self, there: dict[str, Any]) -> str:
        for key in self.choices:
            log, name, column = key.split("|", 2)
            if (there.get("path"), there.get("column")) == (self.form.named(log), column) and there.get("table") in (
                None,
                name,
            ):
                return key
        return KEPT

    @property
    def lacks_unit(self) -> bool:
        """Whether a column was chosen, and no unit."""
        return str(self.column.value or "") not in (NONE, KEPT) and not (self.unit.value or "").strip()

    def draw(self) -> None:
        """Draw the small picture of the column that is chosen."""
        key = str(self.column.value)
        self.picture.set_content(self.form.picture(*key.split("|", 2)) if key in self.choices else Markup(""))

    def _chosen(self) -> None:
        self.draw()
        one = self.choices.get(str(self.column.value))
        by_name = None if one is None else unit_by_name(one[1].name, self.channel)
        if one is not None and one[1].unit:
            self.unit.value = one[1].unit
        elif by_name is not None:
            self.unit.value, self.factor.value = by_name
        self._changed()

    def _changed(self) -> None:
        key = str(self.column.value or "")
        if key == NONE:
            self.form.set_channel(self.channel, None)
            return
        factor, offset = self.factor.value, self.offset.value
        if not factor or offset is None:
            words = "factor: a number other than 0; offset: a number"
            self.complain(words, "offset" if offset is None else "scale")
            return
        self.complain("")
        scale = float(factor) * float(self.sign.value)
        between = "" if self.between is None else str(self.between.value)
        if key == KEPT:
            head, column = self._kept_head(), ""
        else:
            log, name, column = key.split("|", 2)
            head = self.form.head(log, name)
        self.form.set_channel(
            self.channel, Mapped(self.channel, head, column, str(self.unit.value), scale, float(offset), between)
        )

    def _kept_head(self) -> str:
        there = channels_of(self.form.map)[self.channel]
        named = {key: there[key] for key in ("path", "table") if there[key] is not None}
        return "\n".join(["[[import.files]]", *(f"{key} = '''{value}'''" for key, value in named.items())])


def axis_words(log: Any, table: str) -> str:
    """Say what the small pictures of a table are drawn over: its rows, or the seconds of its clock."""
    axis = log.axes[table]
    if not axis.clock:
        return f"over rows 1 to {axis.rows}"
    unit = files_of(log.heads[table])[0]["time"]["unit"]
    return f"over {to_si(axis.length, unit, 's', 'time'):.6g} s of {axis.clock}"


def picture_of(column: Any, over: str) -> Markup:
    """Small picture of a column: its least and greatest above, and below what it is drawn over."""
    if not column.picture:
        return Markup('<span class="small-picture"><small>{}</small></span>').format(column.spread)
    return Markup(
        '<span class="small-picture"><small>{}</small><svg viewBox="0 0 100 24" preserveAspectRatio="none" role="img" aria-label="{}">'
        '<path d="{}"/></svg><small class="axis">{}</small></span>'
    ).format(column.spread, f"{column.name} {over}", column.picture, over)


def columns_of(log: Any) -> Markup:
    """Table of the columns of a log, each with its picture."""
    rows = [
        [one.name, one.table, one.unit, picture_of(one, axis_words(log, one.table)), one.trouble] for one in log.columns
    ]
    head = ["column", "table", "unit in the log", "least to greatest", "trouble"]
    return table(head, rows, "Columns", left=2, stacks=True)
