"""Values moved by hand: sliders and numbers, a record as they predict it, and their distance from the best; nothing is written unasked."""

import asyncio
import json
from collections.abc import Mapping
from functools import partial
from math import isfinite, isnan
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from markupsafe import Markup
from nicegui import background_tasks, ui

from seatrial.cli.campaign_text import CAMPAIGN, read_file, write_file
from seatrial.core.display_units import percent
from seatrial.core.errors import InputError, SeatrialError
from seatrial.dashboard.app_context import AppContext, error_html, evidence_of, fill, markup, saying
from seatrial.dashboard.charts import Curve, Panel, TimeChart
from seatrial.dashboard.downsample import Envelope
from seatrial.dashboard.page_layout import LOOK, button, link, section, table
from seatrial.dashboard.view_models import Movable, Tweaked, Tweaking, words_of
from seatrial.dashboard.worker_pool import stamp
from seatrial.report.labels import label_html
from seatrial.report.numbers import Digits, unit_html

MASS = "mass"
FAR = 1000.0  # Standard deviations beyond which their number says nothing more
QUIET = 0.7  # Seconds without a change after which a screen reader reads the answer
THROTTLE = 0.05  # Seconds between two values of a slider that are asked for
SAME = 0.005  # Nats that are no difference
ODD, EXCLUDED = 0.05, 0.001  # Probabilities below which values are improbable, and nearly excluded
HEIGHTS = (130, 80)  # Pixels of a channel, and of its residual
NOTHING = Envelope(*np.empty((3, 0)))
VALUES = (
    "Move a value and see what it does to a record. Nothing is written, and no result changes. If the others follow, the values "
    "that you do not move go along the ridge of the posterior: linear and quadratic drag trade off."
)
START = (
    "The search for the best values then begins here too, and keeps the highest mode that it finds. Priors stay as they "
    "are. A moved mass is no start: it belongs under [vehicle]."
)
_MOVED = """(e) => {
  const row = e.target.closest(".movable"), button = e.target.closest("button");
  if (!row || (e.type === "click" && !button)) return;
  const [slider, number] = row.querySelectorAll("input");
  if (e.target === (e.type === "input" ? number : slider)) return;
  if (e.type === "input") number.value = Number(Number(slider.value).toPrecision(12));
  else if (number.value !== "") slider.value = number.value;
  slider.setAttribute("aria-valuetext", number.value + " " + slider.dataset.unit);
  emit([slider.name, button ? null : number.value]);
}"""
"""Shows a value that is moved on the slider and in the field at once, and sends it."""
_SHOW = """(() => {
  const all = %s;
  document.querySelectorAll(".movable").forEach((row) => {
    const [slider, number] = row.querySelectorAll("input"), [value, state, far] = all[slider.name] ?? [null, "", ""];
    row.dataset.state = state;
    row.querySelector(".state").textContent = far;
    if (value === null) return;
    slider.value = number.value = value;
    slider.setAttribute("aria-valuetext", number.value + " " + slider.dataset.unit);
  });
})()"""
"""Shows values that are not the viewer's, and which are; the slider that is being dragged is left alone."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    files = tuple(map(stamp, await asyncio.to_thread(evidence_of, folder)))
    page = TweakPage(context, campaign, folder, files)
    await fill(ui.element("div"), page.ask(), page.build, "reading the records and the best values …")


class TweakPage:
    """The sliders, the chart and the numbers of one structure and one record.

    Args:
        context: what is served.
        campaign: its name below the root.
        folder: of it.
        files: stamps of what its answers rest on.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path, files: tuple):
        self.context, self.campaign, self.folder, self.files = context, campaign, folder, files
        self.asked = Tweaking()
        self.moved: dict[str, float] = {}
        self.turn, self.is_busy, self.is_due = 0, False, False

    async def build(self, answer: Tweaked) -> None:
        """Build the page from its first answer."""
        self.asked = Tweaking(answer.structures[0], answer.records[0])
        with section("Values", VALUES):
            with ui.element("div").classes("line"):
                for name, labels in (("structure", answer.structures), ("record", answer.records)):
                    if len(labels) > 1:
                        choose = partial(self._choose, name)
                        ui.select(list(labels), value=labels[0], label=name.title(), on_change=choose).props(LOOK)
                ui.checkbox("The others follow", on_change=self._follow)
                button("Back to the best values", self._back)
            self.sliders = ui.element("div").classes("movables")
            for event in ("input", "change", "click"):
                self.sliders.on(event, self._move, js_handler=_MOVED, throttle=THROTTLE)
        with section("Record"):
            self.chart, self.numbers = ui.element("div"), markup("")
            self.summary = markup("").props('role="status"').classes("unseen", remove="plain")  # As the tables
        with section("Start estimation here", START):
            with ui.element("div").classes("line"):
                button("Show the lines", self._show_lines)
            self.lines = ui.element("div")
        with self.chart:
            await self._draw(answer)

    async def ask(
        self, view: tuple[float, float, int] | None = None, moved: Mapping[str, float] = MappingProxyType({})
    ) -> Tweaked:
        """Ask for what values predict, of which some are moved.

        Raises:
            InputError: a value that cannot be.
        """
        if wrong := [name for name, value in moved.items() if not isfinite(value) or (name == MASS and value <= 0)]:
            found, expected = "no number that it can have", "a number, above 0 for a mass"
            raise InputError(", ".join(wrong), found=found, expected=expected, remedy="type one, or press ↺ beside it")
        asked = self.asked._replace(moved=tuple(moved.items()))
        return await self.context.worker_pool.try_out("tweaked", str(self.folder), self.files, asked, view)

    async def _draw(self, answer: Tweaked) -> None:
        self.answer: Tweaked | Exception = answer
        self.names = {one.name for one in answer.numbers}
        self.moved = {name: value for name, value in self.moved.items() if name in self.names}
        self.sliders.clear()
        with self.sliders:
            numbers = (one._replace(value=self.moved.get(one.name, one.value)) for one in answer.numbers)
            markup(Markup("").join(map(movable_html, numbers)))
        panels = [panel for name, unit, *_ in answer.channels for panel in panels_of(name, unit)]
        self.changing = [f"{name}{part}" for name, *_ in answer.channels for part in ("", " residual")]
        title = f"Record {self.asked.record} as measured and predicted"
        self.time_chart = TimeChart(panels, self._view, answer.span, title)
        await self.time_chart.build()
        self._show()

    async def _choose(self, name: str, event: Any) -> None:
        self.asked = self.asked._replace(**{name: event.value})
        self.numbers.set_content("")
        await fill(self.chart, self.ask(), self._draw, "predicting …")

    async def _follow(self, event: Any) -> None:
        self.asked = self.asked._replace(follow=event.value)
        await self._change()

    async def _back(self) -> None:
        self.moved.clear()
        await self._change()

    async def _move(self, event: Any) -> None:
        name, typed = event.args
        if typed is None:
            self.moved.pop(name, None)
        elif name in self.names:
            self.moved[name] = float(typed or "nan")
        await self._change()

    async def _change(self) -> None:
        """Show what has changed; of several changes while one is computed only the last is computed next."""
        self.is_due = True
        if self.is_busy:
            return
        self.is_busy = True
        try:
            while self.is_due:
                self.is_due = False
                await self.time_chart.draw_again(self.changing)
                self._show()
        finally:
            self.is_busy = False

    async def _view(self, start: float, end: float, columns: int) -> Mapping[str, Envelope]:
        """Return the curves between two times, without prediction and residual for values that cannot be."""
        view = start, end, columns
        try:
            self.answer = await self.ask(view, self.moved)
        except (SeatrialError, OSError) as error:
            self.answer = error
            return (await self.ask(view)).curves | dict.fromkeys(self.changing, NOTHING)
        return self.answer.curves

    def _show(self) -> None:
        """Show the numbers, and the values that are not moved by hand; or why there are none."""
        if self.numbers.is_deleted:
            return
        answer, rows, words = self.answer, {}, ""
        if isinstance(answer, Tweaked):
            found = answer_rows(answer, self.moved)
            self.numbers.set_content(
                table(["measure", "your values"], found, "Your values beside the best", 2, stacks=True)
            )
            words = "; ".join(map(": ".join, found))
            rows = {one.name: self._row(one) for one in answer.numbers}
        else:
            self.numbers.set_content(error_html(words_of(answer), "Nothing can be predicted with these values."))
        ui.run_javascript(_SHOW % json.dumps(rows))
        self.turn += 1
        background_tasks.create(self._read_out(self.turn, words))

    def _row(self, one: Movable) -> tuple[float | None, str, str]:
        """Return the value that a slider has to show, None for that of the viewer, and why it is not the best one."""
        if one.name in self.moved:
            return None, "moved", f"moved, {off_words(one)}"
        state = "follows" if self.moved and one.value != one.best else ""
        return one.shown(one.value), state, state and f"{state}, {off_words(one)}"

    async def _read_out(self, turn: int, words: str) -> None:
        await asyncio.sleep(QUIET)
        if turn == self.turn and not self.summary.is_deleted:
            self.summary.set_content(Markup("<p>{}</p>").format(words))

    async def _show_lines(self) -> None:
        """Show the lines that would be written, and the button that writes them."""
        with saying(self.lines):
            answer = await self.ask(None, self.moved)
            values = tuple((one.name, one.value) for one in answer.numbers)
            seen = await asyncio.to_thread(read_file, self.folder)
            asked = (str(self.folder), self.files, self.asked, seen, values)
            lines, text = await self.context.worker_pool.try_out("start_text", *asked)
            markup(Markup('<pre tabindex="0">{}</pre>').format(lines))
            with ui.element("div").classes("line"):
                button(f"Write them into {CAMPAIGN}", partial(self._write, text, seen), main=True)

    def _write(self, text: str, seen: str) -> None:
        with saying(self.lines):
            write_file(self.folder, text, seen)
            words = '<p class="done" role="status">Saved in campaign.toml. <a href="{}">Run it again</a>, then come back.</p>'
            markup(Markup(words).format(link("run", self.campaign)))


def movable_html(one: Movable) -> Markup:
    """Return the row of a number: its name, a slider, a field, and the button that takes it back."""
    digits = Digits.of(one.best, one.sd)
    known = Markup("stated {:.5g} {}, taken as exact").format(one.best, unit_html(one.unit))
    if one.sd:
        pair = digits.pair(one.best, one.sd), digits.unit_html(one.unit)
        known = Markup("{} {} {}").format("stated" if one.name == MASS else "best", *pair)
    unit = "" if one.unit == "1" else one.unit
    drawn = one._replace(value=one.shown(one.value), lower=one.shown(one.lower), upper=one.shown(one.upper))
    return Markup(
        '<div class="movable"><span class="name">{symbol} <code>{one.name}</code></span>'
        '<input type="range" name="{one.name}" aria-label="{one.name}, slider" aria-valuetext="{one.value} {unit}" data-unit="{unit}" '
        'min="{one.lower}" max="{one.upper}" step="{one.step}" value="{one.value}">'
        '<input type="number" name="{one.name}" aria-label="{one.name} [{one.unit}]" step="any" value="{one.value}">'
        '<span class="unit">{unit_html}</span>'
        '<button type="button" name="{one.name}" aria-label="{one.name} back to the best value">↺</button>'
        '<small class="note">{known}<span class="state"></span></small></div>'
    ).format(one=drawn, symbol=label_html(one.label), unit=unit, unit_html=unit_html(unit), known=known)


def panels_of(name: str, unit: str) -> tuple[Panel, Panel]:
    """Return the panels of a channel and of its residual."""
    curves = (
        Curve(f"{name} measured", "measured", "dots", "dots"),
        Curve(f"{name} best", "best values", "orange"),
        Curve(name, "your values", "blue"),
    )
    left = Curve(f"{name} residual", "residual", "purple")
    return Panel(name, unit, curves, HEIGHTS[0]), Panel(left.name, unit, (left,), HEIGHTS[1])


def off_words(one: Movable) -> str:
    """Return how far a value is from the best one."""
    if not one.sd:
        return f"{100 * (one.value / one.best - 1.0):+.3g} %"
    return f"{sds_words((one.value - one.best) / one.sd)} {'above' if one.value > one.best else 'below'}"


def sds_words(distance: float) -> str:
    """Return a distance in standard deviations."""
    return f"{f'{abs(distance):.1f}' if abs(distance) <= FAR else f'more than {FAR:.0f}'} standard deviations"


def answer_rows(answer: Tweaked, moved: Mapping[str, float]) -> list[list[str | Markup]]:
    """Return what is explained, the log likelihoods, and how improbable the values are, each measure with its words."""
    record, fitted = map(below_words, answer.below)
    return [
        *([f"variance of {name} explained", _share(now, best)] for name, _, now, best in answer.channels),
        ["log likelihood of this record", record],
        ["log likelihood of all fitted records", fitted],
        ["how improbable by the posterior", improbable_words(answer, moved)],
    ]


def _share(*shares: float) -> str:
    words = ("–" if isnan(one) else f"{100 * one:.2f} %" if one > -10 else "worse than the mean" for one in shares)
    return "{}, by the best values {}".format(*words)


def below_words(below: float) -> str:
    """Return how far a log likelihood is below that of the best values, nats."""
    if not isfinite(below):
        return "the motion diverges"
    side = "below" if below > 0 else "above"
    return f"{abs(below):.3g} nats {side} the best" if abs(below) >= SAME else "the same as the best"


def improbable_words(answer: Tweaked, moved: Mapping[str, float]) -> str:
    """Return how improbable the posterior finds the moved values."""
    words = []
    if any(name != MASS for name in moved):
        share, far = answer.probability, f"{sds_words(answer.distance)} from the best values"
        verdict = "nearly excluded" if share < EXCLUDED else "improbable" if share < ODD else "plausible"
        farther = percent(share) if share >= 1e-6 else "less than one millionth"
        words.append(f"{verdict}: {far}; {farther} of the posterior is farther")
    for one in answer.numbers:
        if one.name == MASS and MASS in moved:
            off = f"{sds_words((one.value - one.best) / (one.sd or 1.0))} from the stated mass"
            words.append(off if one.sd else "the mass is taken as exact: the posterior does not judge another one")
    return "; ".join(words) or "nothing is moved"
