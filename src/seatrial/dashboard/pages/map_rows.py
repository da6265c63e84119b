"""Rows of the form of a channel map: the column of each channel and of each clock, with small pictures of what the columns hold."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.questions import question, read_answer
from seatrial.core.units import to_si
from seatrial.dashboard.app_context import markup, say
from seatrial.dashboard.channel_map import Mapped
from seatrial.dashboard.map_draft import MapDraft
from seatrial.dashboard.page_layout import table
from seatrial.dashboard.table_form import LOOK, field_of
from seatrial.dashboard.view_models import DATE
from seatrial.logs.formats.protocol import TIME_UNITS
from seatrial.logs.guess import unit_by_name

if TYPE_CHECKING:
    from seatrial.dashboard.logs import Column

OF_CHANNELS = ("import", "files", "0", "channels")
"""Where the schema has the keys of a channel."""
NONE, KEPT = "", "as in campaign.toml"
"""Choices of a row: no column, and what stands in the campaign file."""


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
        units_of = {one.name: one.unit for one in draft.logs[log].columns if one.table == name}
        column, unit = str(time.get("column", "")), str(time.get("unit", "s"))
        options = {one: one or "choose" for one in dict.fromkeys(("", *units_of, column))}
        units = {one: one for one in (*TIME_UNITS, unit)} | ({"ns": DATE} if units_of.get(column) == DATE else {})
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
    """One channel: its column with a small picture, and a field for each other key, as the schema has them.

    Args:
        draft: of the map.
        channel: its name.
        there: what the map says of the channel; None if nothing.
        is_control: whether it drives the vehicle.
        change: takes another column for the channel; None for none.
        keys: of the map that are asked for beside the column; all by default.
        words: what the channel is; its name by default.
    """

    def __init__(
        self,
        draft: MapDraft,
        channel: str,
        there: Mapping[str, Any] | None,
        is_control: bool,
        change: Callable[[str, Mapped | None], None],
        keys: Sequence[str] = (),
        words: str = "",
    ):
        self.draft, self.channel, self.change, self.choices = draft, channel, change, draft.columns
        entry = there or {}
        options = {NONE: "not in a log"}
        for key, (log, one) in self.choices.items():
            options[key] = f"{one.name} · {log if len(draft.logs) > 1 else one.table}"
        value = NONE if there is None else self._key(there)
        if value == KEPT:
            options[KEPT] = KEPT
        keys = keys or ("unit", "scale", "offset", *["between"] * is_control)  # only of a control it has a meaning
        label = f"{words} {channel}" if words else channel
        with ui.element("div").classes("line channel"):
            self.column = ui.select(options, value=value, label=f"{label}: column", on_change=self._chosen).props(LOOK)
            self.picture = markup("")
            asked = {key: question((*OF_CHANNELS, channel, key), entry.get(key)) for key in keys}
            self.fields = {key: field_of(one, f"{label}: {key}") for key, one in asked.items()}
            for key, field in self.fields.items():
                field.classes(key).on_value_change(self._changed)
            self.said = ui.element("div").classes("beside")
        self.parts = {"column": self.column, **self.fields}
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
        return str(self.column.value or "") not in (NONE, KEPT) and not (self.fields["unit"].value or "").strip()

    def draw(self) -> None:
        """Draw the small picture of the column that is chosen."""
        log, column = self.draft.columns.get(str(self.column.value), ("", None))
        self.picture.set_content(picture_of(self.draft, log, column) if column else Markup(""))

    def _chosen(self) -> None:
        self.draw()
        _, column = self.choices.get(str(self.column.value), ("", None))
        by_name = unit_by_name(column.name, self.channel) if column else None
        if column and column.unit:
            self.fields["unit"].value = column.unit
        elif by_name is not None:
            self.fields["unit"].value, scale = by_name
            if "scale" in self.fields:
                self.fields["scale"].value = "" if scale == 1.0 else f"{scale:g}"
        self._changed()

    def _changed(self) -> None:
        key = str(self.column.value or "")
        if key == NONE:
            self.change(self.channel, None)
            return
        self.complain("")
        typed = {name: str(field.value or "").strip() for name, field in self.fields.items()}
        values = {
            name: read_answer(text, None, (*OF_CHANNELS, self.channel, name)) if text else None
            for name, text in typed.items()
        }
        values["unit"] = typed["unit"]
        if key == KEPT:
            head, column = self.draft.head_of(self.channel), ""
        else:
            log, one = self.choices[key]
            head, column = self.draft.head(log, one.table), one.name
        self.change(self.channel, Mapped(head, column, values))


def axis_words(draft: MapDraft, log: str, table: str) -> str:
    """Return what the small pictures of a table are drawn over: its rows, or the seconds of its clock."""
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
