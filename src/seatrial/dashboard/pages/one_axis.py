"""Logs on one time axis, before anything is saved: their clocks lined up by hand or by correlation, and every channel as a picture."""

import asyncio
import itertools
from collections.abc import Awaitable, Callable, Mapping
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from nicegui import ui

from seatrial.core.errors import SeatrialError
from seatrial.core.units import quantity
from seatrial.dashboard.app_context import AppContext, fill, markup, say
from seatrial.dashboard.channel_map import File, identity_of, path_of, with_shift
from seatrial.dashboard.charts import Curve, Panel, TimeChart
from seatrial.dashboard.downsample import Envelope
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.page_layout import LOOK, button
from seatrial.dashboard.view_models import COMPARED, AxisAbout
from seatrial.dashboard.worker_pool import stamp
from seatrial.logs.clock_shift import BEST_SHARE, ClockShift

if TYPE_CHECKING:
    from seatrial.dashboard.logs import StampedColumn

COLOURS = ("blue", "orange", "purple", "good")
"""Of the logs, in turn."""
HEIGHT = {"control": 70, "measurement": 110, COMPARED: 130}
"""Pixels of a panel."""
LONGEST = 1e11
"""Seconds of a shift, at most: some 3000 years."""


class OneAxis:
    """Shifts of the clocks of the logs of a map, and the picture of all channels.

    Args:
        context: what is served.
        draft: of the map.
        change: puts another map into the form.
        check: returns the whole campaign file with the map; None if something is wrong, which it says in an element that it empties
            first.
    """

    def __init__(
        self,
        context: AppContext,
        draft: MapDraft,
        change: Callable[[list[File]], None],
        check: Callable[[ui.element], Awaitable[str | None]],
    ):
        self.context, self.draft, self.change, self.check = context, draft, change, check
        self.shifts: dict[tuple[str, str | None], ui.number] = {}
        self.clocks: dict[tuple[str, str | None], tuple[Any, Any]] = {}
        self.is_shown = False
        self.note: ui.html | None = None
        self.drawn: list[File] = []
        self.spans = ""

    def build(self) -> None:
        """Build the form."""
        markup("<h3>One time axis</h3>")
        self.forms = ui.element("div")
        with ui.element("div").classes("line"):
            button("Show before saving", self.show)
        self.said, self.holder = ui.element("div"), ui.element("div")
        self.refresh()

    def refresh(self) -> None:
        """Show the clocks as the map has them; what was said of other clocks goes."""
        clocks = {identity_of(one): (one.get("time"), one.get("shift")) for one in self.draft.files}
        if clocks != self.clocks:
            self._say("")
        self.clocks = clocks
        shifts = {identity: _seconds(shift) for identity, (_, shift) in clocks.items()}
        if list(clocks) == list(self.shifts):
            for identity, form in self.shifts.items():
                form.value = shifts[identity]
            return
        self.shifts.clear()
        self.forms.clear()
        if len(clocks) < 2:
            return
        with self.forms:
            words = (
                "If the clocks of the logs differ, type the seconds to add to the stamps of a log, or choose one quantity in two logs, "
                "such as the yaw rate. The shift then contains any delay between the two columns."
            )
            markup(Markup('<p class="note">{}</p>').format(words))
            with ui.element("div").classes("line"):
                for (path, table), shift in shifts.items():
                    label = f"{path}{f', {table}' if table else ''}: shift [s]"
                    form = ui.number(label, value=shift, format="%.13g").props("outlined hide-bottom-space")
                    form.on("blur", lambda path=path, table=table: self._typed(path, table))
                    form.on("keydown.enter", lambda path=path, table=table: self._typed(path, table))
                    self.shifts[path, table] = form
            options = {key: f"{one.name} · {log}" for key, (log, one) in self.draft.columns.items()}
            with ui.element("div").classes("line"):
                self.kept = ui.select(options, label="Column of the reference log").props(LOOK)
                self.moved = ui.select(options, label="Same quantity in the shifted log").props(LOOK)
                button("Line up by correlation", self._line_up)

    async def _typed(self, path: str, table: str | None) -> None:
        form = self.shifts[path, table]
        form.error = shift_error(form.value)
        if form.value is None or form.error:
            return
        if self._shift(path, table, float(form.value)) and self.is_shown:
            await self.show()

    def _shift(self, path: str, table: str | None, shift: float) -> bool:
        """Put a shift into the map; returns whether that changed it."""
        before = self.draft.files
        after = with_shift(before, path, table, shift)
        if after != before:
            self.change(after)
        return after != before

    async def _line_up(self) -> None:
        from seatrial.dashboard.logs import line_up

        ends = self._chosen()
        if len(ends) < 2:
            self._say("Choose one column of each of two logs that have a channel above.")
            return
        (_, kept), (moves, moved) = ends
        differ = self._differ(str(self.kept.value), str(self.moved.value))
        self._say("")
        await fill(
            self.said,
            asyncio.to_thread(line_up, kept, moved),
            lambda found: self._lined_up(found, moves, differ),
            "comparing …",
        )

    async def _lined_up(self, shift: ClockShift, moves: tuple[str, str | None], differ: str) -> None:
        self._shift(*moves, round(shift.shift, 4))
        status = Markup('<p class="done" role="status">{}</p>').format(lined_up_words(shift, moves[0]))
        markup(status + (Markup('<ul class="cautions"><li>{}</li></ul>').format(differ) if differ else ""))
        await self.show()

    def _differ(self, *keys: str) -> str:
        """Report that two columns are not of one quantity; nothing if they are, by map, guess or name."""
        first, second = (self.draft.columns[key][1].name for key in keys)
        alike = first == second or self.draft.quantity_of(keys[0]) == self.draft.quantity_of(keys[1])
        return "" if alike else delay_words(first, second)

    def _chosen(self) -> "list[tuple[tuple[str, str | None], StampedColumn]]":
        """Return the columns that are chosen to be compared, each with its log in the map: two, or fewer where they are not of two logs."""
        from seatrial.dashboard.logs import column_of

        chosen = {}
        for form in (self.kept, self.moved) if self.shifts else ():
            if form.value in self.draft.columns:
                log, column = self.draft.columns[form.value]
                path, file = (
                    self.context.campaign_paths.inside(self.draft.folder, log),
                    self.draft.file_of(log, column.table),
                )
                identity = identity_of(file)
                if identity in self.shifts:
                    chosen[identity] = column_of(str(path), column.name, file, _seconds(file.get("shift")))
        return list(chosen.items())

    async def show(self) -> None:
        """Draw every channel of the map, by log."""
        text = await self.check(self.holder)
        if text is None:
            return
        self.is_shown = True
        asked = self._question(text)
        about = self.context.worker_pool.think("axis_about", *asked)
        files = self.draft.files
        await fill(self.holder, about, lambda found: self._draw(found, files, asked), "reading …")

    def _question(self, text: str) -> tuple:
        """Return what is asked of the logs of the map: by which campaign file, and which columns are compared."""
        folder, run = self.draft.folder, self.draft.label
        paths = [folder / path_of(one, run) for one in self.draft.files]
        compared = tuple(column for _, column in self._chosen())
        return str(folder), text, run, tuple(map(stamp, paths)), compared if len(compared) == 2 else ()

    async def apart(self, text: str) -> str:
        """Report that the logs have no common time by a campaign file, so that it can make no record of them; nothing if they have.

        Raises:
            SeatrialError: a log that cannot be read.
        """
        if len(self.clocks) < 2:
            return ""
        about = await self.context.worker_pool.think("axis_about", *self._question(text))
        return "" if about.overlaps else _apart_words(about)

    async def _draw(self, about: AxisAbout, files: list[File], asked: tuple) -> None:
        if not about.overlaps:
            markup(Markup('<p class="alarm">▲ {}</p>').format(_apart_words(about)))
            button("Let them begin together", lambda: self._begin_together(asked[2], about))
            return
        self.drawn, self.spans = files, span_words(about)
        self.note = markup("")
        self.tell()
        await TimeChart(
            panels_of(about),
            lambda a, b, columns: self._view(asked, a, b, columns),
            (min(a for a, _ in about.spans), max(b for _, b in about.spans)),
            "All channels over time",
        ).build()

    def tell(self) -> None:
        """Say beside the picture whether what it shows is saved."""
        if self.note is not None and not self.note.is_deleted:
            state = "Saved in campaign.toml" if self.draft.is_saved(self.drawn) else "Nothing is saved yet"
            html = Markup('<p class="note" role="status">{}. {}</p>').format(state, self.spans)
            self.note.set_content(html)

    async def _view(self, asked: tuple, start: float, end: float, columns: int) -> Mapping[str, Envelope]:
        return await self.context.worker_pool.think("axis_view", *asked, start, end, columns)

    async def _begin_together(self, run: str, about: AxisAbout) -> None:
        begins = {log: first for log, (first, _) in spans_of(about).items()}
        latest = max(begins.values())
        for (path, table), form in self.shifts.items():
            first = begins.get(Path(path.replace("{run}", run)).name, latest)
            if first < latest:
                self._shift(path, table, round(float(form.value or 0.0) + latest - first, 4))
        await self.show()

    def _say(self, words: Any) -> None:
        self.said.clear()
        if words:
            with self.said:
                say(words)


def shift_error(shift: float | None) -> str | None:
    """Return what is wrong with a shift, s, that was typed; None if nothing is."""
    if shift is None:
        return "a number of seconds; 0 for none"
    return None if abs(shift) <= LONGEST else f"at most {LONGEST:.0e} s either way"


def spans_of(about: AxisAbout) -> dict[str, tuple[float, float]]:
    """Return the first and last time of each log, s from the earliest."""
    spans: dict[str, tuple[float, float]] = {}
    for log, (first, last) in zip(about.logs, about.spans, strict=True):
        begin, end = spans.get(log, (first, last))
        spans[log] = min(begin, first), max(end, last)
    return spans


def span_words(about: AxisAbout) -> str:
    """Say when each log was recorded, and from when to when the record of them would be."""
    lines = [f"{log}: {_from_to(span)}" for log, span in spans_of(about).items()]
    words = f"{'; '.join(lines)}, counted from the earliest stamp."
    if about.overlaps:
        words += f" The record: {_from_to(about.interval)}, with all controls and a measurement."
    if COMPARED in about.roles:
        names = [name for name, role in zip(about.names, about.roles, strict=True) if role == COMPARED]
        words += f" On top {' and '.join(names)}, standardised (mean removed, divided by standard deviation)."
    return words


def _from_to(span: tuple[float, float]) -> str:
    first, last = (round(one, 3) for one in span)
    return f"{first:.13g} s to {last:.13g} s"


def _apart_words(about: AxisAbout) -> str:
    return f"The logs do not overlap: {span_words(about)} Align them, or let them begin together."


def panels_of(about: AxisAbout) -> list[Panel]:
    """Return a panel for each channel, in the colour of its log, below one for what is compared."""
    colours = dict(zip(dict.fromkeys(about.logs), itertools.cycle(COLOURS), strict=False))
    compared, panels = [], []
    for name, unit, role, log in zip(about.names, about.units, about.roles, about.logs, strict=True):
        curve = Curve(name, log, colours[log], "steps" if role == "control" else "line")
        if role == COMPARED:
            compared.append(curve)
        else:
            panels.append(Panel(name, unit, (curve,), HEIGHT[role]))
    if compared:
        panels.insert(0, Panel("mean 0, sd 1", "", tuple(compared), HEIGHT[COMPARED]))
    return panels


def lined_up_words(shift: ClockShift, moved: str) -> str:
    """Return which shift of a log correlates best, and how sharp that is.

    Args:
        shift: the shift of its clock, s.
        moved: name of the log.
    """
    words = f"Correlation {shift.correlation:.3f} with {moved} shifted by {round(shift.shift, 4):.13g} s."
    words += f" Between {_ends(shift.lower, shift.upper)} s it is at least {BEST_SHARE:.0%} of that."
    if shift.correlation < 0:
        words += " It is negative: one of the two columns is reversed."
    if shift.rival is not None:
        apart = shift.rival - shift.shift
        side = "later" if apart > 0 else "earlier"
        words += f" {float(f'{abs(apart):.3g}'):.13g} s {side} fits almost as well, because the motion repeats: look at the picture."
    return words


def _ends(lower: float, upper: float) -> str:
    """Return two ends with the digits in which they differ."""
    digits = max(0, 1 - floor(log10(max(upper - lower, 1e-9))))
    return f"{lower:.{digits}f} and {upper:.{digits}f}"


def delay_words(first: str, second: str) -> str:
    """Return what a shift between columns of two quantities means too."""
    return f"{first} and {second} are not the same quantity: this shift contains the delay between them."


def _seconds(shift: Any) -> float:
    """The shift of a log in seconds; 0 if the file says none, or none that can be read, which the check says."""
    try:
        return 0.0 if shift is None else quantity(shift, "s", "shift")
    except SeatrialError:
        return 0.0
