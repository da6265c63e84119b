"""Logs on one time axis, before anything is saved: their clocks lined up by hand or by correlation, and every channel as a picture."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from math import floor, log10
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, fill, markup, say
from seatrial.apps.dashboard.charts import Curve, Panel, TimeChart
from seatrial.apps.dashboard.downsample import Envelope
from seatrial.apps.dashboard.edits import files_of, identity_of, path_of, with_shift
from seatrial.apps.dashboard.map_draft import MapDraft
from seatrial.apps.dashboard.page_layout import LOOK, button
from seatrial.apps.dashboard.view_models import AxisAbout
from seatrial.apps.dashboard.worker_pool import stamp
from seatrial.core.errors import SeatrialError
from seatrial.core.units import quantity
from seatrial.logs.clock_shift import NEARLY, ClockShift

COLOURS = ("blue", "orange", "purple", "good")
"""Of the logs, in turn."""
HEIGHT = {"control": 70, "measurement": 110}
"""Pixels of a panel."""


class OneAxis:
    """Shifts of the clocks of the logs of a map, and the picture of all channels.

    Args:
        context: what is served.
        draft: of the map.
        change: puts another map into the form.
        check: returns the whole campaign file with the map; None where something is wrong, which it says in an element that it empties
            first.
    """

    def __init__(
        self,
        context: AppContext,
        draft: MapDraft,
        change: Callable[[str], None],
        check: Callable[[ui.element], Awaitable[str | None]],
    ):
        self.context, self.draft, self.change, self.check = context, draft, change, check
        self.shifts: dict[tuple[str, str | None], ui.number] = {}
        self.is_shown = False
        self.note: ui.html | None = None
        self.drawn, self.spans = "", ""

    def build(self) -> None:
        """Build the form."""
        markup("<h3>One time axis</h3>")
        self.clocks = ui.element("div")
        self.refresh()
        with ui.element("div").classes("line"):
            button("Show before saving", self.show)
        self.said, self.holder = ui.element("div"), ui.element("div")

    def refresh(self) -> None:
        """Build the shifts again when the map names other logs."""
        if (found := self.draft.files) is None:
            return
        files = {identity_of(one): one for one in found}
        if list(files) == list(self.shifts):
            return
        self.shifts.clear()
        self.clocks.clear()
        if len(files) < 2:
            return
        with self.clocks:
            words = (
                "Do the clocks of the logs differ? Type what is to be added to the stamps of a log, or choose one quantity that two of the "
                "logs hold, such as the yaw rate. A delay between the two columns would become part of the shift."
            )
            markup(Markup('<p class="note">{}</p>').format(words))
            with ui.element("div").classes("line"):
                for (path, table), file in files.items():
                    label = f"{path}{f', {table}' if table else ''}: shift [s]"
                    form = ui.number(label, value=_seconds(file.get("shift")), format="%.13g").props(
                        "outlined hide-bottom-space"
                    )
                    form.on("blur", lambda path=path, table=table: self._typed(path, table))
                    form.on("keydown.enter", lambda path=path, table=table: self._typed(path, table))
                    self.shifts[path, table] = form
            options = {key: f"{one.name} · {log}" for key, (log, one) in self.draft.columns.items()}
            with ui.element("div").classes("line"):
                self.kept = ui.select(options, label="Column of the log that stays").props(LOOK)
                self.moved = ui.select(options, label="Same quantity in the log that moves").props(LOOK)
                button("Line up by correlation", self._line_up)

    async def _typed(self, path: str, table: str | None) -> None:
        form = self.shifts[path, table]
        if form.value is None:
            form.props('error error-message="a number of seconds; 0 for none"')
            return
        form.props(remove="error error-message")
        if self._shift(path, table, float(form.value)) and self.is_shown:
            await self.show()

    def _shift(self, path: str, table: str | None, shift: float) -> bool:
        """Put a shift into the map; returns whether that changed it."""
        before = self.draft.channel_map
        try:
            after = with_shift(before, path, table, shift)
        except SeatrialError as error:
            self._say(error)
            return False
        if after != before:
            self.change(after)
        return after != before

    async def _line_up(self) -> None:
        from seatrial.apps.dashboard.logs import line_up

        asked = [str(form.value or "") for form in (self.kept, self.moved)]
        if not all(asked) or asked[0].partition("|")[0] == asked[1].partition("|")[0]:
            self._say("Choose one column of each of two logs.")
            return
        ends = [self._column(key) for key in asked]
        stays, moved = (next((one for one in self.shifts if one[0] == key.split("|")[0]), None) for key in asked)
        if moved is None or stays is None:
            self._say("Both logs have to give a channel: choose its column above.")
            return
        self._say("")
        await fill(
            self.said,
            asyncio.to_thread(line_up, *ends),
            lambda found: self._lined_up(found, stays, moved, self._differ(*asked)),
            "comparing …",
        )

    async def _lined_up(
        self, found: ClockShift, stays: tuple[str, str | None], moved: tuple[str, str | None], differ: str
    ) -> None:
        found = found.later(float(self.shifts[stays].value or 0.0))
        shift = round(found.shift, 4)
        said = Markup('<p class="done" role="status">{}</p>').format(lined_up_words(found, moved[0]))
        markup(said + (Markup('<ul class="cautions"><li>{}</li></ul>').format(differ) if differ else ""))
        self.shifts[moved].value = shift
        self._shift(*moved, shift)
        await self.show()

    def _differ(self, *keys: str) -> str:
        """Say that two columns are not of one quantity; nothing where they are, by map, guess or name."""
        first, second = (self.draft.columns[key][1].name for key in keys)
        alike = first == second or self.draft.quantity_of(keys[0]) == self.draft.quantity_of(keys[1])
        return "" if alike else delay_words(first, second)

    def _column(self, key: str) -> tuple[str, str, str]:
        log, column = self.draft.columns[key]
        path = self.context.campaign_paths.inside(self.draft.folder, log)
        return str(path), self.draft.logs[log].heads[column.table], column.name

    async def show(self) -> None:
        """Draw every channel of the map, by log."""
        text = await self.check(self.holder)
        if text is None:
            return
        self.is_shown = True
        folder, run = self.draft.folder, self.draft.label
        paths = [folder / path_of(one, run) for one in files_of(self.draft.channel_map)]
        asked = str(folder), text, run, tuple(map(stamp, paths))
        about = self.context.worker_pool.think("axis_about", *asked)
        await fill(self.holder, about, lambda found: self._draw(found, asked), "reading …")

    async def _draw(self, about: AxisAbout, asked: tuple) -> None:
        logs = list(dict.fromkeys(about.logs))
        ends = {log: [span for one, span in zip(about.logs, about.spans, strict=True) if one == log] for log in logs}
        spans = {log: (min(a for a, _ in some), max(b for _, b in some)) for log, some in ends.items()}
        lines = [f"{log}: {first:.9g} s to {last:.9g} s" for log, (first, last) in spans.items()]
        first, last = max(a for a, _ in spans.values()), min(b for _, b in spans.values())
        if not first < last:
            words = f"The logs do not overlap ({'; '.join(lines)}). Line them up, or let them begin together."
            markup(Markup('<p class="alarm">▲ {}</p>').format(words))
            button("Let them begin together", lambda: self._begin_together(asked[2], spans))
            return
        self.drawn, self.spans = asked[1], f"{'; '.join(lines)}, counted from the earliest stamp."
        self.note = markup("")
        self.tell()
        colours = dict(zip(logs, COLOURS * len(logs), strict=False))
        panels = [
            Panel(name, unit, (Curve(name, log, colours[log], "steps" if role == "control" else "dots"),), HEIGHT[role])
            for name, unit, role, log in zip(about.names, about.units, about.roles, about.logs, strict=True)
        ]
        whole = min(a for a, _ in spans.values()), max(b for _, b in spans.values())
        await TimeChart(
            panels, lambda a, b, columns: self._view(asked, a, b, columns), whole, "All channels over time"
        ).build()

    def tell(self) -> None:
        """Say beside the picture whether what it shows is saved."""
        if self.note is not None and not self.note.is_deleted:
            state = "Saved in campaign.toml" if self.drawn == self.draft.saved else "Nothing is saved yet"
            html = Markup('<p class="note" role="status">{}. {}</p>').format(state, self.spans)
            self.note.set_content(html)

    async def _view(self, asked: tuple, start: float, end: float, columns: int) -> Mapping[str, Envelope]:
        return await self.context.worker_pool.think("axis_view", *asked, start, end, columns)

    async def _begin_together(self, run: str, spans: Mapping[str, tuple[float, float]]) -> None:
        latest = max(first for first, _ in spans.values())
        for (path, table), form in self.shifts.items():
            first, _ = spans.get(Path(path.replace("{run}", run)).name, (latest, latest))
            if first < latest:
                form.value = float(form.value or 0.0) + latest - first
                self._shift(path, table, float(form.value))
        await self.show()

    def _say(self, words: Any) -> None:
        self.said.clear()
        if words:
            with self.said:
                say(words)


def lined_up_words(found: ClockShift, moved: str) -> str:
    """Say which shift of a log correlates best, and how sharp that is.

    Args:
        found: the shift of its clock, s.
        moved: name of the log.
    """
    words = f"Correlation {found.correlation:.3f} with {moved} shifted by {round(found.shift, 4):.13g} s."
    words += f" Between {_ends(found.lower, found.upper)} s it is at least {NEARLY:.0%} of that."
    if found.correlation < 0:
        words += " It is negative: one of the two columns is reversed."
    if found.rival is not None:
        words += (
            f" A shift of {found.rival:.6g} s fits almost as well, because the motion repeats: look at the picture."
        )
    return words


def _ends(lower: float, upper: float) -> str:
    """Return two ends with the digits in which they differ."""
    digits = max(0, 1 - floor(log10(max(upper - lower, 1e-9))))
    return f"{lower:.{digits}f} and {upper:.{digits}f}"


def delay_words(first: str, second: str) -> str:
    """Say what a shift between columns of two quantities means too."""
    return f"{first} and {second} are not the same quantity: the delay from one to the other is part of this shift."


def _seconds(shift: Any) -> float:
    """The shift of a log in seconds; 0 where the file says none, or none that can be read, which the check says."""
    try:
        return 0.0 if shift is None else quantity(shift, "s", "shift")
    except SeatrialError:
        return 0.0
