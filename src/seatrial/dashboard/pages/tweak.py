"""Values moved by hand: sliders and numbers, a record as they predict it, and their distance from the best; nothing is written unasked."""

import asyncio
import json
from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite, isnan
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.cli.campaign_text import CAMPAIGN, read_file, write_file
from seatrial.core.display_units import percent
from seatrial.core.errors import SeatrialError
from seatrial.dashboard.app_context import AppContext, evidence_of, fill, markup, say
from seatrial.dashboard.charts import Curve, Panel, TimeChart
from seatrial.dashboard.downsample import Envelope
from seatrial.dashboard.page_layout import LOOK, button, link, section, table
from seatrial.dashboard.view_models import Movable, Tweaked, TweakForm
from seatrial.dashboard.worker_pool import stamp
from seatrial.report.glossary import with_meanings
from seatrial.report.labels import label_html
from seatrial.report.numbers import Digits, unit_html

STEPS = 200  # Of a slider
QUIET = 0.7  # Seconds without a change after which a screen reader is told the answer
THROTTLE = 0.05  # Seconds between two values of a slider that are asked for
SAME = 0.005  # Nats that are no difference
ODD, EXCLUDED = (
    0.05,
    0.001,
)  # Shares of the posterior farther out, below which values are improbable, and nearly excluded
HEIGHTS = (130, 80)  # Pixels of a channel, and of its residual
_MOVED = """(e) => {
  const t = e.target;
  if (t.type !== "range") return;
  const row = t.closest(".movable"), number = row.querySelector("input[type=number]");
  number.value = Number(Number(t.value).toPrecision(5));
  t.setAttribute("aria-valuetext", number.value + " " + t.dataset.unit);
  emit([t.name, number.value]);
}"""
"""Shows the value of a slider beside it at once, and sends it."""
_TYPED = '(e) => { if (e.target.type === "number" && e.target.value !== "") emit([e.target.name, e.target.value]); }'
_RELEASED = '(e) => { const b = e.target.closest("button[name]"); if (b) emit([b.name, ""]); }'
_SHOW = """(() => {
  const all = %s;
  document.querySelectorAll(".movable").forEach((row) => {
    const [slider, number] = row.querySelectorAll("input"), [value, state, far] = all[slider.name];
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
    await TweakPage(context, campaign, folder).build()


class TweakPage:
    """The sliders, the chart and the numbers of one structure and one record.

    Args:
        context: what is served.
        campaign: its name below the root.
        folder: of it.
    """

    def __init__(self, context: AppContext, campaign: str, folder: Path):
        self.context, self.campaign, self.folder = context, campaign, folder
        self.moved: dict[str, float] = {}
        self.turn, self.is_drawn, self.is_busy, self.is_due = 0, False, False, False
        self.label = self.run = ""

    async def build(self) -> None:
        """Build all that needs no answer, then the rest."""
        words = "Move a value and see what it does to a record. Nothing is written, and no result changes."
        with section("Values", words):
            self.choice, self.holder = ui.element("div").classes("line"), ui.element("div")
        self.below = ui.element("div")
        self.files = tuple(map(stamp, await asyncio.to_thread(evidence_of, self.folder)))
        asked = self.context.worker_pool.think("tweak_form", str(self.folder), self.files)
        await fill(self.holder, asked, self._begin, "reading the records and the best values …")

    async def _begin(self, form: TweakForm) -> None:
        self.label, self.run = form.structures[0], form.records[0]
        with self.choice:
            if len(form.structures) > 1:
                ui.select(list(form.structures), value=self.label, label="Structure", on_change=self._other).props(LOOK)
            if len(form.records) > 1:
                ui.select(list(form.records), value=self.run, label="Record", on_change=self._record).props(LOOK)
            self.follow = ui.checkbox("The others follow", on_change=self._changed)
            button("Back to the best values", self._back)
        words = (
            "If the others follow, the values that you do not move go along the ridge of the posterior: "
            "linear and quadratic drag trade off."
        )
        markup(with_meanings(Markup('<p class="note">{}</p>').format(words)))
        self.sliders = ui.element("div").classes("movables")
        self.sliders.on("input", self._moved, js_handler=_MOVED, throttle=THROTTLE)
        self.sliders.on("change", self._moved, js_handler=_TYPED)
        self.sliders.on("click", self._moved, js_handler=_RELEASED)
        with self.below:
            with section("Record"):
                self.chart, self.numbers = ui.element("div"), markup("")
                self.told = ui.html("", sanitize=False).props('role="status"').classes("unseen")  # as the tables
            with section(
                "Start estimation here",
                "The search for the best values then begins here too, and keeps the highest mode that it finds. Priors stay as they "
                "are. A moved mass is no start: it belongs under [vehicle].",
            ):
                with ui.element("div").classes("line"):
                    button("Show the lines", self._show_lines)
                self.lines = ui.element("div")
        await self._numbers(form.numbers)

    async def _numbers(self, numbers: Sequence[Movable]) -> None:
        self.by_name = {one.name: one for one in numbers}
        self.moved.clear()
        self.sliders.clear()
        with self.sliders:
            markup(Markup("").join(map(movable_html, numbers)))
        await self._draw()

    async def _other(self, event: Any) -> None:
        self.label = event.value
        asked = self.context.worker_pool.think("tweak_form", str(self.folder), self.files, self.label)
        await fill(self.sliders, asked, lambda form: self._numbers(form.numbers), "reading …")

    async def _record(self, event: Any) -> None:
        self.run = event.value
        await self._draw()

    async def _back(self) -> None:
        self.moved.clear()
        await self._changed()

    async def _moved(self, event: Any) -> None:
        name, typed = event.args
        value = None if typed == "" else float(typed)
        if name not in self.by_name or (value is not None and not isfinite(value)):
            return
        if value is None:
            self.moved.pop(name, None)
        else:
            self.moved[name] = value
        await self._changed()

    async def _changed(self) -> None:
        """Show what has changed; of several changes while one is computed only the last is computed next."""
        self.is_due = True
        if self.is_busy or not self.is_drawn:
            return
        self.is_busy = True
        changing = [f"{name}{part}" for name, *_ in self.answer.channels for part in ("", " residual")]
        try:
            while self.is_due:
                self.is_due = False
                await self.time_chart.draw_again(changing)
                self._show()
        finally:
            self.is_busy = False
        self.turn += 1
        turn = self.turn
        await asyncio.sleep(QUIET)
        if turn == self.turn and not self.told.is_deleted:
            self.told.set_content(Markup("<p>{}</p>").format(summary_words(self.answer, self.moved, self.by_name)))

    async def _ask(self, view: tuple[float, float, int] | None) -> Tweaked:
        moved = tuple(self.moved.items())
        asked = (str(self.folder), self.files, self.label, self.run, moved, bool(self.follow.value), view)
        return await self.context.worker_pool.try_out("tweaked", *asked)

    async def _view(self, start: float, end: float, columns: int) -> Mapping[str, Envelope]:
        self.answer = await self._ask((start, end, columns))
        return self.answer.curves

    async def _draw(self) -> None:
        self.is_drawn = False
        self.chart.clear()
        await fill(self.chart, self._ask(None), self._drawn, "predicting …")

    async def _drawn(self, answer: Tweaked) -> None:
        self.answer = answer
        panels = [panel for name, unit, *_ in answer.channels for panel in panels_of(name, unit)]
        self.time_chart = TimeChart(panels, self._view, answer.span, f"Record {self.run} as measured and predicted")
        await self.time_chart.build()
        self.is_drawn = True
        await self._changed()

    def _show(self) -> None:
        """Show the numbers, and the values that are not moved by hand."""
        if self.numbers.is_deleted:
            return
        self.numbers.set_content(numbers_html(self.answer, self.moved, self.by_name))
        follows = bool(self.follow.value) and bool(self.moved)
        rows = {}
        for name, one in self.by_name.items():
            is_moved, value = name in self.moved, self.answer.values[name]
            state = "moved" if is_moved else "follows" if follows and value != one.best else ""
            far = f"{state}, {off_words(value, one)}" if state else ""
            rows[name] = (None if is_moved else float(f"{value:.5g}"), state, far)
        ui.run_javascript(_SHOW % json.dumps(rows))

    async def _show_lines(self) -> None:
        """Show the lines that would be written, and the button that writes them."""
        self.lines.clear()
        values = tuple((name, self.answer.values[name]) for name in self.by_name)
        with self.lines:
            try:
                seen = await asyncio.to_thread(read_file, self.folder)
                asked = (str(self.folder), self.files, self.label, seen, values)
                lines, text = await self.context.worker_pool.try_out("start_text", *asked)
            except (SeatrialError, OSError) as error:
                say(error)
                return
            markup(Markup('<pre tabindex="0">{}</pre>').format(lines))
            with ui.element("div").classes("line"):
                button(f"Write them into {CAMPAIGN}", partial(self._write, text, seen), main=True)

    def _write(self, text: str, seen: str) -> None:
        self.lines.clear()
        with self.lines:
            try:
                write_file(self.folder, text, seen)
            except (SeatrialError, OSError) as error:
                say(error)
                return
            words = '<p class="done" role="status">Saved in campaign.toml. <a href="{}">Run it again</a>, then come back.</p>'
            markup(Markup(words).format(link("run", self.campaign)))


def movable_html(one: Movable) -> Markup:
    """Return the row of a number: its name, a slider, a field, and the button that takes it back."""
    digits = Digits.of(one.best, one.sd)
    stated = Markup("stated {:.5g} {}, taken as exact").format(one.best, unit_html(one.unit))
    known = digits.pair(one.best, one.sd), digits.unit_html(one.unit)
    known = Markup("{} {} {}").format("stated" if one.name == "mass" else "best", *known) if one.sd else stated
    unit = "" if one.unit == "1" else one.unit
    return Markup(
        '<div class="movable"><span class="name">{symbol} <code>{name}</code></span>'
        '<input type="range" name="{name}" aria-label="{name}, slider" aria-valuetext="{best} {unit}" data-unit="{unit}" min="{lower}" '
        'max="{upper}" step="{step}" value="{best}"><input type="number" name="{name}" aria-label="{name} [{si}]" step="any" '
        'value="{best}"><span class="unit">{unit_html}</span><button type="button" name="{name}" aria-label='
        '"{name} back to the best value">↺</button><small class="note">{known}<span class="state"></span></small></div>'
    ).format(
        symbol=label_html(one.label),
        name=one.name,
        best=f"{one.best:.5g}",
        unit=unit,
        si=one.unit,
        unit_html=unit_html(unit),
        lower=f"{one.lower:.6g}",
        upper=f"{one.upper:.6g}",
        step=f"{(one.upper - one.lower) / STEPS:.2g}",
        known=known,
    )


def panels_of(name: str, unit: str) -> tuple[Panel, Panel]:
    """Return the panels of a channel and of its residual."""
    high, low = HEIGHTS
    curves = (
        Curve(f"{name} measured", "measured", "dots", "dots"),
        Curve(f"{name} best", "best values", "orange"),
        Curve(name, "your values", "blue"),
    )
    return Panel(name, unit, curves, high), Panel(
        f"{name} residual", unit, (Curve(f"{name} residual", "residual", "purple"),), low
    )


def off_words(value: float, one: Movable) -> str:
    """Return how far a value is from the best one."""
    if not one.sd:
        return f"{100 * (value / one.best - 1.0):+.0f} %"
    return f"{abs(value - one.best) / one.sd:.1f} standard deviations {'above' if value > one.best else 'below'}"


def numbers_html(answer: Tweaked, moved: Mapping[str, float], numbers: Mapping[str, Movable]) -> Markup:
    """Return what is explained, the log likelihoods, and how improbable the values are, as tables."""
    rows: list[list[str | Markup]] = [[name, _share(now), _share(best)] for name, _, now, best in answer.channels]
    shares = table(["channel", "your values", "best values"], rows, "Share of the variance explained")
    record, fitted = map(below_words, answer.below)
    more: list[list[str | Markup]] = [
        ["log likelihood of this record", record],
        ["log likelihood of all fitted records", fitted],
        ["how improbable by the posterior", improbable_words(answer, moved, numbers)],
    ]
    return shares + table(["measure", "value"], more, "Your values beside the best", 2, stacks=True)


def _share(share: float) -> str:
    return "–" if isnan(share) else f"{100 * share:.2f} %" if share > -10 else "worse than the mean"


def below_words(below: float) -> str:
    """Return how far a log likelihood is below that of the best values, nats."""
    if not isfinite(below):
        return "the motion diverges"
    return f"{abs(below):.3g} nats {'below' if below > 0 else 'above'}" if abs(below) >= SAME else "the same"


def improbable_words(answer: Tweaked, moved: Mapping[str, float], numbers: Mapping[str, Movable]) -> str:
    """Return how improbable the posterior finds the moved values."""
    words = []
    if any(name != "mass" for name in moved):
        share, far = answer.probability, f"{answer.distance:.1f} standard deviations from the best values"
        verdict = "nearly excluded" if share < EXCLUDED else "improbable" if share < ODD else "plausible"
        farther = percent(share) if share >= 1e-6 else "less than one millionth"
        words.append(f"{verdict}: {far}; {farther} of the posterior is farther")
    if "mass" in moved:
        one = numbers["mass"]
        off = (
            f"{abs(moved['mass'] - one.best) / one.sd:.1f} of its stated standard deviations from the stated mass"
            if one.sd
            else ""
        )
        words.append(off or "the mass is taken as exact: the posterior does not judge another one")
    return "; ".join(words) or "nothing is moved"


def summary_words(answer: Tweaked, moved: Mapping[str, float], numbers: Mapping[str, Movable]) -> str:
    """Return the answer as a sentence, for those who hear the page."""
    if not isfinite(answer.below[0]):
        return "With these values the motion diverges: the simulation leaves all bounds."
    shares = ", ".join(f"{name} {_share(now)} explained" for name, _, now, _ in answer.channels)
    record, fitted = map(below_words, answer.below)
    return f"{shares}. Log likelihood against the best: {record}; all fitted records: {fitted}. {improbable_words(answer, moved, numbers)}."
