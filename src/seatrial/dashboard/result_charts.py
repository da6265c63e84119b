"""Charts of designs: what each of a grid would teach, and the control of one over time."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np
from markupsafe import escape
from nicegui import ui

from seatrial.dashboard.charts import axis, chart, colour, faint, tooltip
from seatrial.design.results import SweptDesigns
from seatrial.report.figures.style import unit_label

CHOSEN = "chosen design"
VIRIDIS = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
"""Ends and stops of the map of colours of the design surface, the same in every theme."""
WHEEL = [{"type": "inside", "filterMode": "none"}]
_NUMBERS = "const digits = (value) => String(Number(Number(value).toPrecision(4)));"
_AT_POINT = f"""(one) => {{ {_NUMBERS} return one.value && one.value.length > 3 ? one.value[3] : one.name; }}"""
_HOVER = f"""(all) => {{ {_NUMBERS} const plain = (text) => text.replace(/[&<>"]/g, (c) => "&#" + c.charCodeAt(0) + ";");
  const rows = all.map((one) => one.marker + plain(one.seriesName) + ": " + digits(one.value[1]));
  return [digits(all[0].axisValue), ...rows].join("<br>"); }}"""


def surface_chart(sweep: SweptDesigns, family: int, measure: str, at: tuple[int, int]) -> ui.echart:
    """Draw what every design of a family is worth: cells of amplitude and period, a line where only one of them varies.

    Args:
        sweep: all designs that were swept.
        family: as its file counts them.
        measure: `gain` or `worth`.
        at: row and column that are chosen.
    """
    values = (sweep.gain if measure == "gain" else sweep.worth)[family]
    what = "entropy reduction [nat]" if measure == "gain" else "utility"
    amplitude, unit = sweep.shown_amplitude
    names = unit_label(f"amplitude of {sweep.control}", unit), "period [s]"
    title = f"Information of each design: {sweep.families[family].replace('-', ' ')}"
    best = np.unravel_index(int(np.nanargmax(sweep.worth[family])), values.shape)
    if min(values.shape) == 1:
        return _sweep_line(sweep, values.ravel(), at[0] + at[1], int(best[0] + best[1]), (*names, what), title)
    cells = [
        [j, i, _value(values[i, j]), _words_of_cell(sweep, family, i, j, values[i, j], what)]
        for i, j in np.ndindex(values.shape)
        if isfinite(values[i, j])
    ]
    rows, columns = ([f"{one:.4g}" for one in grid] for grid in (amplitude, sweep.period))
    top = float(np.nanmax(values))
    options = {
        "grid": {
            "left": 70,
            "right": 100,
            "top": 16,
            "bottom": 50,
            "show": True,
            "backgroundColor": faint("hatch", 60),
        },
        "xAxis": _categories(columns, names[1], nameLocation="middle", nameGap=28),
        "yAxis": _categories(rows, names[0], nameLocation="middle", nameGap=56),
        "tooltip": {**tooltip(_AT_POINT), "trigger": "item"},
        "visualMap": {
            "type": "continuous",
            "min": float(np.nanmin(values)),
            "max": top if top > float(np.nanmin(values)) else top + 1.0,
            "seriesIndex": 0,
            "dimension": 2,
            "calculable": True,
            "precision": 2,
            "text": ["nat" if measure == "gain" else what, ""],
            "right": 0,
            "top": "middle",
            "inRange": {"color": list(VIRIDIS)},
            "textStyle": {"color": colour("ink")},
        },
        "dataZoom": [{**WHEEL[0], "xAxisIndex": 0}, {**WHEEL[0], "yAxisIndex": 0}],
        "series": [
            {"type": "heatmap", "name": what, "data": cells, "emphasis": {"itemStyle": {"borderColor": colour("ink")}}},
            _mark("best design", [int(best[1]), int(best[0])], _STAR, 20),
            _mark(CHOSEN, [at[1], at[0]], "rect", 24, hollow=True),
        ],
    }
    return chart(options, title, 380)


def _sweep_line(
    sweep: SweptDesigns, values: np.ndarray, at: int, best: int, names: tuple[str, str, str], title: str
) -> ui.echart:
    over_period = sweep.amplitude.size == 1
    grid = sweep.period if over_period else sweep.shown_amplitude[0]
    points = [[x, _value(y)] for x, y in zip(grid, values, strict=True)]
    series = [
        {"type": "line", "name": names[2], "data": points, "color": colour("blue"), "symbolSize": 7},
        _mark("best design", points[best], _STAR, 20),
        _mark(CHOSEN, points[at], "rect", 16, hollow=True),
    ]
    along = axis(names[1] if over_period else names[0], nameLocation="middle", nameGap=26, scale=True)
    return _line_chart(along, names[2], series, title, 300)


def mark_chosen(element: ui.echart, sweep: SweptDesigns, family: int, measure: str, at: tuple[int, int]) -> None:
    """Move the mark of the chosen design; what is zoomed stays so."""
    values = (sweep.gain if measure == "gain" else sweep.worth)[family]
    if min(values.shape) == 1:
        grid = sweep.period if sweep.amplitude.size == 1 else sweep.shown_amplitude[0]
        place = [grid[at[0] + at[1]], _value(values.ravel()[at[0] + at[1]])]
    else:
        place = [at[1], at[0]]
    element.run_chart_method("setOption", {"series": [{"id": CHOSEN, "data": [place]}]})


def schedule_chart(time: np.ndarray, control: np.ndarray, name: str, unit: str) -> ui.echart:
    """Draw the control of a design over time, in its unit, as it is held from each sample to the next."""
    change = np.flatnonzero(np.diff(control, prepend=control[0] - 1.0))  # what is held needs one point
    keep = np.union1d(np.union1d(change, change - 1)[1:], [0, time.size - 1])
    points = [[float(time[i]), float(control[i])] for i in keep]
    line = {"type": "line", "name": name, "step": "end", "showSymbol": False, "color": colour("blue"), "data": points}
    along = axis("time [s]", nameLocation="middle", nameGap=26, min=0, max=float(time[-1]))
    return _line_chart(along, unit_label(name, unit), [line], f"Control {name} of the design over time", 240)


def _line_chart(along: dict[str, Any], name: str, series: list[dict[str, Any]], title: str, height: int) -> ui.echart:
    options = {
        "grid": {"left": 60, "right": 20, "top": 34, "bottom": 46},
        "xAxis": along,
        "yAxis": axis(name, scale=True, nameTextStyle={"color": colour("ink"), "align": "left"}),
        "tooltip": tooltip(_HOVER),
        "dataZoom": WHEEL,
        "series": series,
    }
    return chart(options, title, height)


_STAR = "path://M0,-10L2.4,-3.1L9.5,-3.1L3.8,1.2L5.9,8.1L0,4L-5.9,8.1L-3.8,1.2L-9.5,-3.1L-2.4,-3.1Z"


def _categories(names: Sequence[str], name: str, **more: Any) -> dict[str, Any]:
    labels, hidden = {"color": colour("ink"), "hideOverlap": True}, {"show": False}
    shown = {"axisLabel": labels, "axisTick": hidden, "splitLine": hidden}
    return axis(name, type="category", data=list(names), **shown, **more)


def _mark(name: str, at: Sequence[float | None], symbol: str, size: int, hollow: bool = False) -> dict[str, Any]:
    style = {
        "color": "transparent" if hollow else "#ffffff",
        "borderColor": "#000000",
        "borderWidth": 2.5 if hollow else 1,
    }
    if hollow:
        style |= {"borderColor": "#ffffff", "shadowColor": "#000000", "shadowBlur": 3}
    return {
        "type": "scatter",
        "id": name,
        "name": name,
        "silent": True,
        "data": [list(at)],
        "symbol": symbol,
        "symbolSize": size,
        "itemStyle": style,
        "z": 5,
    }


def _words_of_cell(sweep: SweptDesigns, family: int, row: int, column: int, value: float, what: str) -> str:
    after, (amplitude, unit) = sweep.final_sd[family, row, column], sweep.shown_amplitude
    lines = [
        f"{amplitude[row]:.4g} {unit}, {sweep.period[column]:.4g} s",
        f"{what}: <b>{value:.4g}</b>",
        *(f"sd of {escape(name)}: {sd:.3g}" for name, sd in list(zip(sweep.names, after, strict=True))[:6]),
    ]
    return "<br>".join(lines)


def _value(value: float) -> float | None:
    return float(f"{value:.6g}") if isfinite(value) else None
