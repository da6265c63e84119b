"""Charts that can be zoomed and hovered: options of ECharts, drawn as SVG, whose colours are those of the page's theme.

A chart over time never holds more than the screen can show: each zoom asks for the least and greatest of every column of pixels.
"""

import itertools
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from markupsafe import Markup
from nicegui import ui

from seatrial.dashboard.app_context import saying
from seatrial.dashboard.downsample import COLUMNS, Envelope

Kind = Literal["line", "dots", "steps", "band"]
Range = tuple[float, float]
View = Callable[[float, float, int], Awaitable[Mapping[str, Envelope]]]
"""Curves by name between two times, s, in so many columns of pixels."""

FONT = "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', Arial, sans-serif"
"""That of the page, by name: the widths of texts are measured before they are drawn."""
DIGITS = 7
"""Significant digits that a screen can show of a value, zoomed in or not."""
MARGIN = 0.25
"""Share of the view that is fetched beyond each of its ends, so that it can be moved at once."""
THROTTLE = 0.08
"""Seconds between two views that are asked for while somebody zooms."""
_LEFT, _RIGHT, _TOP, _GAP, _BOTTOM = 62, 14, 34, 38, 74
_MOUSE = """(e) => {
  e.currentTarget.mouse = e.type === "mouseleave" || e.zrX == null ? null : { x: e.zrX, y: e.zrY };
}"""
"""Keeps where the mouse stands over a chart, as ECharts measures it."""
_GOES = "({ component }) => { component.proxy.chart ??= { dispose() {} }; }"
"""Lets a chart be taken away that the browser has not made yet: of itself the component would fail, having nothing to dispose of."""
_TELL_AGAIN = """(one) => {
  if (one && one.chart && one.$el.mouse) one.chart.dispatchAction({ type: "showTip", ...one.$el.mouse });
}"""
"""Reads the hovered values again: of itself ECharts goes on to tell, by their places in the data, those that stood there before a zoom."""
_ZOOMED = (
    f"(e) => {{ const zoom = (e.batch || [e])[0]; emit([zoom.start, zoom.end]); ({_TELL_AGAIN})(getElement(%d)); }}"
)
_BRUSHED = "(e) => { if (e.areas.length) emit(e.areas[0].coordRange); }"
DASHES = {"orange": "dashed", "purple": "dotted", "good": [12, 3, 3, 3], "caution": [6, 2], "alarm": [2, 6]}
"""Dashes of a line beside its colour, which sunlight takes away; other colours are solid."""
SYMBOLS = {"orange": "rect", "purple": "triangle", "good": "diamond"}
"""Marks of dots, likewise; other colours have circles."""
_NUMBER = "(value) => String(Number(value.toPrecision(6)))"
_HOVER = """(all) => {
  const digits = (value) => value == null || isNaN(value) ? "–" : String(Number(Number(value).toPrecision(5)));
  const plain = (text) => text.replace(/[&<>"]/g, (c) => "&#" + c.charCodeAt(0) + ";");
  const once = all.filter((one, at) => all.findIndex((other) => other.seriesId === one.seriesId) === at);
  const rows = once.map((one) => {
    const [unit, value, other] = [one.seriesId.split("|")[1], one.value[1], one.value[2]];
    const range = other == null || other === value ? digits(value)
      : digits(Math.min(value, other)) + " to " + digits(Math.max(value, other));
    return one.marker + plain(one.seriesName + (one.seriesType === "custom" ? ", band" : "")) + ": <b>" + range + "</b> " + plain(unit);
  });
  return digits(all[0].axisValue) + " s<br>" + rows.join("<br>");
}"""
_BAND = """(params, api) => {
  if (params.dataIndexInside !== 0) return;
  const upper = [], lower = [];
  for (let i = 0; i < params.dataInsideLength; i++) {
    const [time, low, high] = [0, 1, 2].map((part) => api.value(part, i));
    if (isNaN(low) || isNaN(high)) continue;
    lower.unshift(api.coord([time, low]));
    upper.push(api.coord([time, high]));
  }
  const place = params.coordSys;
  return { type: "polygon", shape: { points: upper.concat(lower) }, style: { fill: api.visual("color"), opacity: 0.22 }, silent: true,
    clipPath: { type: "rect", shape: { x: place.x, y: place.y, width: place.width, height: place.height } } };
}"""


WIDTHS = (1100, 900, 740, 620, 520, 440, 380, 330, 280)
"""Widths of a chart, pixels, at which its layout may change; each is laid out for the next narrower one."""
_ICON, _ITEM_GAP, _LETTER, _LINE, _NARROW_LEFT = 26, 10, 6.8, 20, 8
"""Pixels of a legend: an icon, the gap between two items, a letter, a line, and what is free at the left of its own lines."""


def legend_lines(labels: Sequence[str], width: float) -> int:
    """Return how many lines a legend needs in a width, pixels."""
    lines, left = 1, width
    for label in labels:
        wide = _ICON + 5 + _LETTER * len(label)
        if wide > left and left < width:
            lines, left = lines + 1, width
        left -= wide + _ITEM_GAP
    return lines


class Curve(NamedTuple):
    """One curve of a panel.

    Attributes:
        name: by which its view is asked.
        label: in the legend; curves of one label are shown and hidden together.
        colour: name in the palette: `blue`, `orange`, `purple`, `dots`, `ink`, `muted`.
        kind: a line, dots, steps held from each sample to the next, or a band from its least to its greatest.
    """

    name: str
    label: str
    colour: str = "blue"
    kind: Kind = "line"


class Panel(NamedTuple):
    """Axes of a chart: curves over the same time, of one unit.

    Attributes:
        label: of the vertical axis, without unit.
        unit: as it is printed; none if empty.
        curves: drawn in this order.
        height: pixels.
    """

    label: str
    unit: str
    curves: tuple[Curve, ...]
    height: int = 130


def colour(name: str) -> str:
    """Colour of the palette, by its name, in whatever theme the page has."""
    return f"var(--{name})"


def faint(name: str, percent: int) -> str:
    """Colour of the palette, so much of it and the rest transparent."""
    return f"color-mix(in srgb, {colour(name)} {percent}%, transparent)"


def chart(options: dict[str, Any], title: str, height: int) -> ui.echart:
    """Draw a chart of ECharts in the page's colours.

    Args:
        options: of ECharts; colours by `colour`.
        title: read out instead of the picture.
        height: pixels.
    """
    text = {"color": colour("ink"), "fontFamily": FONT}
    made = ui.echart({"animation": False, "textStyle": text, **options}, renderer="svg")
    made.on("vnodeBeforeUnmount", js_handler=_GOES)
    return made.props(f'role=img aria-label="{Markup.escape(title)}"').classes("chart").style(f"height: {height}px")


def axis(name: str = "", **more: Any) -> dict[str, Any]:
    """An axis of numbers in the page's colours; `more` are options of ECharts."""
    line = {"lineStyle": {"color": colour("muted")}}
    return {
        "type": "value",
        "name": name,
        "nameTextStyle": {"color": colour("ink")},
        "axisLine": {"show": True, "onZero": False, **line},
        "axisTick": {"show": True, **line},
        "axisLabel": {"color": colour("ink"), "hideOverlap": True, ":formatter": _NUMBER},
        "splitLine": {"lineStyle": {"color": faint("rule", 60)}},
        **more,
    }


def tooltip(formatter: str) -> dict[str, Any]:
    """Hovered values in the page's colours; `formatter` is a function in JavaScript."""
    return {
        "trigger": "axis",
        "confine": True,
        "backgroundColor": colour("paper"),
        "borderColor": colour("muted"),
        "textStyle": {"color": colour("ink")},
        "axisPointer": {"type": "line", "lineStyle": {"color": colour("muted")}},
        ":formatter": formatter,
    }


class TimeChart:
    """Panels one above another over the same time; wheel, drag, pinch and buttons zoom, and each zoom asks for the finer view.

    Args:
        panels: from top to bottom.
        view: gives the curves between two times.
        span: first and last time, s.
        title: read out instead of the picture.
        on_select: told the range that was selected, s; None if nothing can be selected.
    """

    def __init__(
        self,
        panels: Sequence[Panel],
        view: View,
        span: Range,
        title: str,
        on_select: Callable[[float, float], Any] | None = None,
    ):
        self.panels, self.view, self.span, self.title, self.on_select = tuple(panels), view, span, title, on_select
        self.shown, self.asked, self.kept = span, 0, None

    async def build(self) -> None:
        """Draw the whole of it, and the buttons.

        Raises:
            SeatrialError: the curves cannot be read.
            OSError: likewise.
        """
        curves = await self.view(*self.span, COLUMNS)
        height = _TOP + sum(panel.height + _GAP for panel in self.panels) - _GAP + _BOTTOM
        with ui.element("div").classes("chart-tools").props('role=group aria-label="Zoom"'):
            for words, meaning, low, high in _MOVES:
                self._tool(words, meaning, lambda low=low, high=high: self._move(low, high))
            self._tool("whole", "Show the whole time", self._whole)
            if self.on_select is not None:
                self._tool("select a range", "Select a range: then drag over the chart", self._start_selecting)
        self.element = chart(self._options(curves), self.title, height)
        self.element.on("chart:datazoom", self._zoomed, js_handler=_ZOOMED % self.element.id, throttle=THROTTLE)
        for event in ("mousemove", "mouseleave"):
            self.element.on(event, js_handler=_MOUSE)
        if self.on_select is not None:
            self.element.on("chart:brushEnd", self._brushed, js_handler=_BRUSHED)
        self.said = ui.element("div")

    async def draw_again(self, names: Collection[str]) -> None:
        """Draw the present view of some curves, which have changed."""
        await self._draw(*self.shown, names=names)

    def keep(self, start: float, end: float) -> None:
        """Shade all that is outside a range, s."""
        self.kept = (start, end)
        self.element.options["series"] = self._shaded(self.element.options["series"])
        self.element.run_chart_method("setOption", {"series": self._shaded([{} for _ in self._curves()])})

    def _tool(self, words: str, meaning: str, action: Callable[[], Any]) -> None:
        ui.button(words, on_click=action).props(f'flat dense no-caps aria-label="{meaning}"').classes("chart-tool")

    async def _move(self, low: float, high: float) -> None:
        """Show from one share of the present view to another: axes and curves at once, so that the browser draws once."""
        (first, last), (start, end) = self.span, self.shown
        width = end - start
        await self._draw(max(first, start + low * width), min(last, start + high * width), moves=True)

    async def _whole(self) -> None:
        await self._draw(*self.span, moves=True)

    def _start_selecting(self) -> None:
        self._take_cursor({"brushType": "lineX", "brushMode": "single"})

    def _take_cursor(self, brush: dict[str, Any]) -> None:
        cursor = {"type": "takeGlobalCursor", "key": "brush", "brushOption": brush}
        self.element.run_chart_method("dispatchAction", cursor)

    def _brushed(self, event: Any) -> None:
        start, end = sorted(float(at) for at in event.args)
        self.element.run_chart_method("dispatchAction", {"type": "brush", "areas": []})
        self._take_cursor({"brushType": False})
        start, end = max(start, self.span[0]), min(end, self.span[1])
        if start < end and self.on_select is not None:
            self.keep(start, end)
            self.on_select(start, end)

    async def _zoomed(self, event: Any) -> None:
        first, last = self.span
        low, high = (float(share) / 100 for share in event.args)
        await self._draw(first + low * (last - first), first + high * (last - first))

    async def _draw(self, start: float, end: float, moves: bool = False, names: Collection[str] | None = None) -> None:
        """Show another view, which the browser shows already unless this `moves` it; of several that are asked for while the first is
        read, only the last is drawn. Curves that are not among `names` stay as they are drawn.
        """
        self.shown, self.asked = (start, end), self.asked + 1
        turn, more = self.asked, MARGIN * (end - start)
        low, high = max(self.span[0], start - more), min(self.span[1], end + more)
        columns = max(1, round(COLUMNS * (high - low) / ((end - start) or 1.0)))
        with saying(self.said):
            curves = await self.view(low, high, columns)
            if turn != self.asked or self.element.is_deleted:
                return
            (first, last), options = self.span, {"series": self._series(curves, names)}
            if moves:
                ends = [100 * (at - first) / ((last - first) or 1.0) for at in (start, end)]
                options["dataZoom"] = [{"start": ends[0], "end": ends[1]}] * 2
            self.element.run_chart_method("setOption", options)
            self.element.client.run_javascript(f"({_TELL_AGAIN})(getElement({self.element.id}))")

    def _curves(self) -> list[tuple[int, Curve]]:
        return [(at, curve) for at, panel in enumerate(self.panels) for curve in panel.curves]

    def _labels(self) -> list[str]:
        return list(dict.fromkeys(curve.label for _, curve in self._curves()))

    def _layouts(self) -> list[dict[str, Any]]:
        """Layouts of the legend and the panels by the width of the chart: the narrower, the more lines the legend has."""
        layouts: list[dict[str, Any]] = [{"option": self._layout(WIDTHS[0])}]
        narrower = (*WIDTHS[1:], WIDTHS[-1])
        return layouts + [
            {"query": {"maxWidth": most}, "option": self._layout(least)}
            for most, least in zip(WIDTHS, narrower, strict=True)
        ]

    def _layout(self, width: float) -> dict[str, Any]:
        """Lay out a chart of a width, pixels: the legend beside the name of the first axis if it fits there, else in lines above it."""
        labels = self._labels()
        is_beside = legend_lines(labels, 0.7 * width - _RIGHT) <= 1
        lines = 0 if is_beside else legend_lines(labels, width - _RIGHT - _NARROW_LEFT)
        cut = lines * _LINE / len(self.panels)
        grids, top = [], _TOP + lines * _LINE
        for panel in self.panels:
            grids.append({"top": top, "height": panel.height - cut})
            top += panel.height - cut + _GAP
        return {"legend": {"left": "30%" if is_beside else _NARROW_LEFT}, "grid": grids}

    def _legend_item(self, label: str) -> dict[str, Any]:
        """Return a label with the shape of its curves: a line with its dashes before a band, which has a pale patch."""
        mine = [curve for _, curve in self._curves() if curve.label == label]
        curve = next((one for one in mine if one.kind != "band"), mine[0])
        pale = {"itemStyle": {"opacity": 0.3}} if curve.kind == "band" else {}
        return {"name": label, "icon": _icon(curve), **pale}

    def _series(self, curves: Mapping[str, Envelope], names: Collection[str] | None = None) -> list[dict[str, Any]]:
        return [
            {
                **_series(curve, curves[curve.name]),
                "id": f"{at}/{curve.name}/{curve.kind}|{self.panels[at].unit}",
                "xAxisIndex": at,
                "yAxisIndex": at,
            }
            for at, curve in self._curves()
            if names is None or curve.name in names
        ]

    def _shaded(self, series: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Series with what is outside the kept range shaded, once in every panel."""
        if self.kept is None:
            return series
        (first, last), (start, end) = self.span, self.kept
        veil = {
            "silent": True,
            "itemStyle": {"color": colour("muted"), "opacity": 0.3},
            "data": [[{"xAxis": first}, {"xAxis": start}], [{"xAxis": end}, {"xAxis": last}]],
        }
        tops = {at: index for index, (at, _) in reversed(list(enumerate(self._curves())))}
        return [{**one, "markArea": veil} if index in tops.values() else one for index, one in enumerate(series)]

    def _options(self, curves: Mapping[str, Envelope]) -> dict[str, Any]:
        every, place = list(range(len(self.panels))), {"left": _LEFT, "right": _RIGHT, "outerBoundsMode": "none"}
        first, last = self.span
        below = {"nameLocation": "middle", "nameGap": 26}
        times = [
            axis("time [s]" if at == every[-1] else "", gridIndex=at, min=first, max=last, **below) for at in every
        ]
        values = [
            axis(
                f"{panel.label} [{panel.unit}]" if panel.unit else panel.label,
                gridIndex=at,
                scale=True,
                splitNumber=3,
                nameTextStyle={"color": colour("ink"), "align": "left", "padding": [0, 0, 0, 8 - _LEFT]},
            )
            for at, panel in enumerate(self.panels)
        ]
        for at, time in enumerate(times):
            time["axisLabel"] |= {"show": at == every[-1], "showMinLabel": False, "showMaxLabel": False}
        labels = self._labels()
        zoom = {"xAxisIndex": every, "filterMode": "none", "throttle": 30}
        return {
            "grid": [{**place, **grid} for grid in self._layout(WIDTHS[0])["grid"]],
            "xAxis": times,
            "yAxis": values,
            "series": self._shaded(self._series(curves)),
            "tooltip": tooltip(_HOVER),
            "axisPointer": {"link": [{"xAxisIndex": "all"}]},
            "media": self._layouts() if len(labels) > 1 else [],
            "legend": {
                "show": len(labels) > 1,
                "top": 0,
                "right": _RIGHT,
                "left": "30%",
                "itemGap": _ITEM_GAP,
                "data": [self._legend_item(label) for label in labels],
                "itemWidth": _ICON,
                "itemHeight": 9,
                "textStyle": {"color": colour("ink")},
                "inactiveColor": colour("hatch"),
            },
            "dataZoom": [
                {"type": "inside", "preventDefaultMouseMove": False, **zoom},
                {"type": "slider", "bottom": 6, "height": 18, "showDetail": False, **_SLIDER, **zoom},
            ],
            "toolbox": {"show": False},
            "brush": {"xAxisIndex": "all", "toolbox": []},
        }


_MOVES = (
    ("+", "Zoom in", 0.25, 0.75),
    ("−", "Zoom out", -0.5, 1.5),
    ("◂", "Earlier", -0.5, 0.5),
    ("▸", "Later", 0.5, 1.5),
)
_SLIDER = {
    "showDataShadow": False,
    "borderColor": colour("muted"),
    "fillerColor": faint("blue", 20),
    "handleStyle": {"color": colour("paper"), "borderColor": colour("ink")},
    "moveHandleSize": 0,
    "brushSelect": False,
}


def _icon(curve: Curve) -> str:
    """Return what a curve looks like, as an icon of the legend."""
    match curve.kind:
        case "band":
            return "rect"
        case "dots":
            return SYMBOLS.get(curve.colour, "circle")
        case "steps":
            return "path://M0,7h13v-7h13v2h-11v7h-15z"
    dash = DASHES.get(curve.colour, [26])
    pieces = itertools.cycle({"dashed": [7, 3], "dotted": [2, 2]}[dash] if isinstance(dash, str) else dash)
    path, at, is_drawn = "", 0, True
    while at < 26:
        length = min(next(pieces), 26 - at)
        path += f"M{at},3h{length}v3h-{length}z" * is_drawn
        at, is_drawn = at + length, not is_drawn
    return f"path://{path}"


def _series(curve: Curve, values: Envelope) -> dict[str, Any]:
    """Options of one curve: dots or steps where each column holds one sample, else a stroke from the least to the greatest."""
    common = {"name": curve.label, "color": colour(curve.colour), "silent": True, "emphasis": {"disabled": True}}
    if curve.kind == "band":
        data = _rows(values.time, values.least, values.greatest)
        encode = {"x": 0, "y": [1, 2]}
        return {**common, "type": "custom", ":renderItem": _BAND, "data": data, "encode": encode, "progressive": 0}
    there, step = np.isfinite(values.least), "end" if curve.kind == "steps" else False
    if np.array_equal(values.least[there], values.greatest[there]):
        data = _rows(values.time, values.least)
        if curve.kind == "dots":
            return {
                **common,
                "type": "scatter",
                "large": True,
                "largeThreshold": 1,
                "symbolSize": 4,
                "symbol": _icon(curve),
                "data": data,
            }
        dash = DASHES.get(curve.colour, "solid")
        style = {"width": 1.5, "type": dash if curve.kind == "line" else "solid"}
        return {**common, "type": "line", "showSymbol": False, "step": step, "data": data, "lineStyle": style}
    ends = np.stack([values.least, values.greatest], 1)
    if curve.kind == "steps":  # a jump within a column goes on to where the next column is
        middle = ends.mean(axis=1)
        falls = np.append(middle[1:] < middle[:-1], False)
        ends[falls] = ends[falls, ::-1]
    else:
        ends[1::2] = ends[1::2, ::-1]
    data = _rows(np.repeat(values.time, 2), ends.ravel(), ends[:, ::-1].ravel())
    return {**common, "type": "line", "showSymbol": False, "step": step, "data": data, "lineStyle": {"width": 1.5}}


def _rows(*columns: np.ndarray) -> list[list[float | None]]:
    """Rows of columns for JSON, with no more digits than can be seen; gaps as null."""
    return [
        [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in row]
        for row in zip(*(column.tolist() for column in columns), strict=True)
    ]
