"""Rows of the form of a channel map: the column of each channel and of each clock, with small pictures of what the columns hold."""

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from nicegui import ui

from seatrial.core.units import to_si
from seatrial.dashboard.app_context import markup, say
from seatrial.dashboard.channel_map import Mapped
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.page_layout import LOOK, table
from seatrial.logs.formats.protocol import TIME_UNITS
from seatrial.logs.guess import unit_by_name

if TYPE_CHECKING:
    from seatrial.dashboard.logs import Column

NONE, KEPT = "", "as in campaign.toml"
"""Choices of a row: no column, and what stands in the campaign file."""
BETWEEN = {"held": "held", "line": "along a line"}
"""What a control does between its samples: a command is held, what was measured changes along a line."""


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
        draft: of the map.
        log: its path from the campaign's folder.
        name: of the table.
        said: table and time, as the map or the log's own `[[import.files]]` says them.
        change: takes another column and unit.
    """

    def __init__(
        self,
        draft: MapDraft,
        log: str,
        name: str,
        entry: Mapping[str, Any],
        change: Callable[[str, str], Awaitable[None]],
    ):
        self.change, time = change, entry.get("time", {})
        columns = [one.name for one in draft.logs[log].columns if one.table == name]
        column, unit = str(time.get("column", "")), str(time.get("unit", "s"))
        options = {one: one or "choose" for one in dict.fromkeys(("", *columns, column))}
        units = list(dict.fromkeys((*TIME_UNITS, unit)))
        place = " · ".join(filter(None, (Path(log).name, entry.get("table"))))
        with ui.element("div").classes("line channel"):
            self.column = ui.select(options, value=column, label=f"time of {place}: column", on_change=self._changed)
            self.unit = ui.select(units, value=unit, label=f"time of {place}: unit", on_change=self._changed)
            self.said = ui.element("div").classes("beside")
        self.parts = {"column": self.column.props(LOOK), "unit": self.unit.props(LOOK)}

    async def _changed(self) -> None:
        self.complain("")
        await self.change(str(self.column.value or ""), str(self.unit.value))


class ChannelRow(MapRow):
    """One channel: its column with a small picture, unit, sign and offset, and of a control what it does between its samples.

    Args:
        draft: of the map.
        channel: its name.
        there: what the map says of the channel; None if nothing.
        is_control: whether it drives the vehicle.
        change: takes another column for the channel; None for none.
    """

    def __init__(
        self,
        draft: MapDraft,
        channel: str,
        there: Mapping[str, Any] | None,
        is_control: bool,
        change: Callable[[str, Mapped | None], None],
    ):
        self.draft, self.channel, self.change, self.choices = draft, channel, change, draft.columns
        entry = there or {}
        options = {NONE: "not in a log"}
        for key, (log, one) in self.choices.items():
            options[key] = f"{one.name} · {log if len(draft.logs) > 1 else one.table}"
        value = NONE if there is None else self._key(there)
        if value == KEPT:
            options[KEPT] = KEPT
        scale = float(entry.get("scale", 1.0))
        with ui.element("div").classes("line channel"):
            self.column = ui.select(options, value=value, label=f"{channel}: column", on_change=self._chosen)
            self.picture = markup("")
            self.unit = ui.input("unit", value=str(entry.get("unit", "")), on_change=self._changed)
            self.factor = ui.number("factor", value=abs(scale), on_change=self._changed)
            self.sign = ui.select({1: "+", -1: "− reversed"}, value=-1 if scale < 0 else 1, label="sign")
            self.offset = ui.number(
                "offset, in the unit", value=float(entry.get("offset", 0.0)), on_change=self._changed
            )
            fields = [self.column, self.unit, self.factor, self.sign, self.offset]
            self.between = None
            if is_control:
                value = str(entry.get("between") or "held")
                self.between = ui.select(BETWEEN, value=value, label=f"{channel}: between samples").classes("between")
                self.between.on_value_change(self._changed)
                fields.append(self.between)
            self.said = ui.element("div").classes("beside")
        for field in fields:
            field.props(LOOK)
        self.unit.props(f'aria-label="{channel}: unit"')
        self.sign.on_value_change(self._changed)
        self.offset.classes("offset")
        self.parts = {"column": self.column, "unit": self.unit, "scale": self.factor, "offset": self.offset}
        self.draw()

    def _key(self, there: Mapping[str, Any]) -> str:
        for key, (log, one) in self.choices.items():
            at = self.draft.named(log), one.name
            if at == (there.get("path"), there.get("column")) and there.get("table") in (None, one.table):
                return key
        return KEPT

    @property
    def lacks_unit(self) -> bool:
        """Whether a column was chosen, and no unit."""
        return str(self.column.value or "") not in (NONE, KEPT) and not (self.unit.value or "").strip()

    def draw(self) -> None:
        """Draw the small picture of the column that is chosen."""
        log, column = self.draft.columns.get(str(self.column.value), ("", None))
        self.picture.set_content(picture_of(self.draft, log, column) if column else Markup(""))

    def _chosen(self) -> None:
        self.draw()
        _, column = self.choices.get(str(self.column.value), ("", None))
        by_name = unit_by_name(column.name, self.channel) if column else None
        if column and column.unit:
            self.unit.value = column.unit
        elif by_name is not None:
            self.unit.value, self.factor.value = by_name
        self._changed()

    def _changed(self) -> None:
        key = str(self.column.value or "")
        if key == NONE:
            self.change(self.channel, None)
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
            head, column = self.draft.head_of(self.channel), ""
        else:
            log, one = self.choices[key]
            head, column = self.draft.head(log, one.table), one.name
        self.change(self.channel, Mapped(head, column, str(self.unit.value), scale, float(offset), between))


def axis_words(draft: MapDraft, log: str, table: str) -> str:
    """Say what the small pictures of a table are drawn over: its rows, or the seconds of its clock."""
    axis = draft.logs[log].axes[table]
    if not axis.clock:
        return f"over rows 1 to {axis.rows}"
    unit = draft.file_of(log, table)["time"]["unit"]
    return f"over {to_si(axis.length, unit, 's', 'time'):.6g} s of {axis.clock}"


def picture_of(draft: MapDraft, log: str, column: "Column") -> Markup:
    """Small picture of a column: its least and greatest above, and below what it is drawn over."""
    if not column.picture:
        return Markup('<span class="small-picture"><small>{}</small></span>').format(column.spread)
    over = axis_words(draft, log, column.table)
    return Markup(
        '<span class="small-picture"><small>{}</small><svg viewBox="0 0 100 24" preserveAspectRatio="none" role="img" aria-label="{}">'
        '<path d="{}"/></svg><small class="axis">{}</small></span>'
    ).format(column.spread, f"{column.name} {over}", column.picture, over)


def columns_of(draft: MapDraft, log: str) -> Markup:
    """Table of the columns of a log, each with its picture."""
    columns = draft.logs[log].columns
    rows = [[one.name, one.table, one.unit, picture_of(draft, log, one), one.trouble] for one in columns]
    head = ["column", "table", "unit in the log", "least to greatest", "trouble"]
    return table(head, rows, "Columns", left=2, stacks=True)
