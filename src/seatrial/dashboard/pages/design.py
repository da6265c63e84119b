"""The design: what every trial of the grid would teach, the room the clicked one leaves, the limits, and the next run."""

import math
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_text import CAMPAIGN, written_units
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import Shown, listed, shown_as_written
from seatrial.dashboard.app_context import (
    AppContext,
    cautions_html,
    fill,
    keep_current,
    keep_filled,
    keep_form,
    markup,
    saying,
)
from seatrial.dashboard.page_layout import LOOK, button, section, table
from seatrial.dashboard.pages.work import Live, begin, made_part
from seatrial.dashboard.result_charts import mark_chosen, schedule_chart, surface_chart
from seatrial.dashboard.table_form import TableForm
from seatrial.dashboard.view_models import Clicked
from seatrial.dashboard.worker_pool import stamp
from seatrial.design.results import SweptDesigns, edge_words
from seatrial.report.numbers import percent, short, unit_html

UNTAUGHT = 0.999
"""Share of a standard deviation from which on a trial has left it as it was."""
WHICH = {"design": "the first trial, from the priors", "next": "the next trial, from the posterior"}


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    paths, file = {"design": Store(folder).design, "next": Store(folder).next_design}, folder / CAMPAIGN
    think = partial(context.worker_pool.think, files=[file])

    def show() -> None:
        there = [which for which, path in paths.items() if path.is_file()]
        if there:
            Surface(context, folder, paths, there[-1], there)
        else:
            words = "Run the design below: it computes every trial of the grid, in seconds to minutes."
            with section("No design yet", words):
                pass

    await keep_filled(
        lambda: stamp(file),
        lambda: think("cautions", str(folder)),
        lambda cautions: markup(cautions_html(cautions)),
        "checking the campaign file …",
    )
    await keep_current(lambda: tuple(map(stamp, paths.values())), show)
    with section("Run it", "Results that no longer belong to the campaign file are computed again."):
        with ui.element("div").classes("line"):
            for command, words in (
                ("prior", "Motion under the priors"),
                ("design", "Run the design"),
                ("next", "Design the next trial"),
            ):
                start = partial(lambda name: (begin(context, folder, messages, name), live.look()), command)
                button(words, start, main=command == "design")
        messages = ui.element("div")
        live = Live(context, folder)
        await made_part(context, campaign, folder)
    with section(
        "Limits",
        "Edits are checked, then written into campaign.toml; comments and order stay. An empty field is no limit.",
    ):
        messages_of_limits = ui.element("div")
        saved = (
            '<p class="done" role="status">Saved in campaign.toml. Earlier designs are stale now: run the design.</p>'
        )

        def make(answer: Any) -> TableForm:
            text, questions = answer
            form = TableForm(context, text, questions, messages_of_limits)
            form.offer_save(folder, Markup(saved))
            return form

        await keep_form(file, lambda: think("limits_form", str(folder)), make)


class Surface:
    """The picture of a sweep that can be clicked, forms that do the same by keyboard, and the design that is looked at."""

    def __init__(self, context: AppContext, folder: Path, paths: dict[str, Path], which: str, there: list[str]):
        self.context, self.folder, self.paths, self.which = context, folder, paths, which
        self.family, self.measure, self.at = 0, "gain", (0, 0)
        with section("Information of each design", "Click a design, or choose its amplitude and period below."):
            with ui.element("div").classes("line"):
                options = {one: WHICH[one] for one in there}
                ui.select(options, value=which, label="Sweep", on_change=self._other).props(LOOK)
                self.families = ui.element("div").classes("part")
            self.holder = ui.element("div")
            self.forms = ui.element("div").classes("line")
        with section("The design you chose"):
            self.details = ui.element("div")
        ui.timer(0.0, self.show, once=True)

    async def show(self) -> None:
        """Read the sweep and draw it, with its best design chosen."""
        path = self.paths[self.which]
        with saying(self.holder):
            self.sweep: SweptDesigns = await self.context.worker_pool.draw("swept", path, files=[path])
            self.family, self.at = self.sweep.best[0], self.sweep.best[1:]
            self._family_form()
            await self._draw()

    async def _other(self, event: Any) -> None:
        self.which = event.value
        await self.show()

    def _family_form(self) -> None:
        sweep = self.sweep
        self.families.clear()
        with self.families:
            if len(sweep.families) > 1:
                options = {i: name.replace("-", " ") for i, name in enumerate(sweep.families)}
                ui.select(options, value=self.family, label="Family", on_change=self._to_family).props(LOOK)
            if (sweep.worth != sweep.gain)[~(sweep.worth != sweep.worth)].any():
                options = {"gain": "entropy reduction", "worth": "utility"}
                ui.select(options, value=self.measure, label="Colour shows", on_change=self._to_measure).props(LOOK)

    async def _to_family(self, event: Any) -> None:
        self.family = event.value
        worth = self.sweep.worth[self.family]
        flat = max(range(worth.size), key=lambda i: -math.inf if math.isnan(worth.flat[i]) else worth.flat[i])
        self.at = divmod(flat, worth.shape[1])
        await self._draw()

    async def _to_measure(self, event: Any) -> None:
        self.measure = event.value
        await self._draw()

    async def _draw(self) -> None:
        sweep = self.sweep
        self._surface()
        self.forms.clear()
        with self.forms:
            values, unit = sweep.shown_amplitude
            amplitudes = {i: f"{value:.4g} {unit}" for i, value in enumerate(values)}
            periods = {i: f"{value:.4g} s" for i, value in enumerate(sweep.period)}
            self.amplitude = ui.select(amplitudes, value=self.at[0], label=f"Amplitude of {sweep.control}").props(LOOK)
            self.period = ui.select(periods, value=self.at[1], label="Period").props(LOOK)
            for form in (self.amplitude, self.period):
                form.on_value_change(self._chosen)
        await self._look()

    def _surface(self) -> None:
        self.holder.clear()
        with self.holder:
            self.surface = surface_chart(self.sweep, self.family, self.measure, self.at).classes("surface")
            self.surface.on(
                "chart:click", self._clicked, js_handler="(e) => emit([e.seriesType, e.dataIndex, e.value])"
            )
            markup(legend_html(self.sweep.gain[self.family]))

    async def _clicked(self, event: Any) -> None:
        kind, index, value = event.args
        if kind == "heatmap":
            self.at = int(value[1]), int(value[0])
        elif kind == "line":  # the setting that varies
            self.at = (0, int(index)) if len(self.sweep.amplitude) == 1 else (int(index), 0)
        self.amplitude.value, self.period.value = self.at
        await self._chosen_now()

    async def _chosen(self) -> None:
        chosen = int(self.amplitude.value), int(self.period.value)  # pyright: ignore[reportArgumentType]
        if chosen != self.at:
            self.at = chosen
            await self._chosen_now()

    async def _chosen_now(self) -> None:
        mark_chosen(self.surface, self.sweep, self.family, self.measure, self.at)
        await self._look()

    async def _look(self) -> None:
        self.details.clear()
        answer = self.context.worker_pool.think(
            "look_at",
            str(self.folder),
            self.which,
            self.family,
            *self.at,
            files=[self.paths[self.which], self.folder / CAMPAIGN],
        )
        with self.details:
            shown = shown_as_written(dict(written_units(self.folder)))
            markup(what_it_teaches(self.sweep, self.family, *self.at, shown))
            holder = ui.element("div")
        await fill(
            holder,
            answer,
            self._details,
            "simulating this design, to see its distance from the limits …",
        )

    def _details(self, clicked: Clicked) -> None:
        sweep, name = self.sweep, f"{self.which}_schedule.csv"
        markup(Markup("<p>{}</p>").format(clicked.words[:1].upper() + clicked.words[1:]))
        with ui.element("div").classes("figures"):
            schedule_chart(clicked.time, clicked.control, sweep.control, sweep.shown_amplitude[1])
        rows = [[one.what, _kept(one.kept), one.room, one.reached, one.bound] for one in clicked.margins]
        head = ["limit", "kept?", "room left", "reached", "bound"]
        markup(
            table(head, rows, "Room inside the limits", stacks=True)
            if rows
            else "<p>No limits are set: write some below.</p>"
        )
        button("Download its schedule", lambda: ui.download(clicked.schedule.encode(), name, "text/csv"))


def legend_html(gain: np.ndarray) -> Markup:
    """Return what the marks in the picture of designs mean, and its grey where designs break a limit, whose gain is NaN."""
    grey = Markup('; <span class="swatch" aria-hidden="true"></span> grey: a design that breaks a limit')
    return Markup('<p class="note">★ best design; □ the one you chose{}.</p>').format(
        grey if np.isnan(gain).any() else ""
    )


def what_it_teaches(sweep: SweptDesigns, family: int, row: int, column: int, shown: Shown) -> Markup:
    """What a design promises: entropy reduction, and each standard deviation before and after, in the unit in which it is `shown`."""
    gain = float(sweep.gain[family, row, column])
    if math.isnan(gain):
        return Markup('<p class="alarm">▲ This design breaks a limit; nothing else was computed for it.</p>')
    worth, length = float(sweep.worth[family, row, column]), float(sweep.length[family, row, column])
    lines = [f"entropy of the coefficients lowered by {short(gain)} nat"]
    lines += [f"utility {short(worth)}"] * (worth != gain)
    lines += [f"trial of {short(length)} s", f"from {sweep.basis}"]
    rows = [
        [
            name,
            short(factor * before),
            short(factor * float(after)),
            unit_html(unit),
            percent(float(after) / before),
        ]
        for name, before, after in zip(sweep.names, sweep.sd_before, sweep.final_sd[family, row, column], strict=True)
        for factor, unit in [shown(name, CoefficientName.parse(name).unit)]
    ]
    edge = edge_words(len(sweep.amplitude), len(sweep.period), (row, column))
    sentences = [*filter(None, [edge]), *sweep.safety, *sweep.prediction] if (family, row, column) == sweep.best else []
    more = Markup("").join(Markup("<li>{}</li>").format(line) for line in sentences)
    return Markup("<p>{}.</p>{}{}{}").format(
        "; ".join(lines)[:1].upper() + "; ".join(lines)[1:],
        cautions_html(_untaught(sweep, sweep.final_sd[family, row, column])),
        Markup('<ul class="findings">{}</ul>').format(more) if sentences else "",
        table(
            ["coefficient", "sd before", "sd after", "unit", "after / before"],
            rows,
            "Standard deviations",
            stacks=True,
        ),
    )


def _untaught(sweep: SweptDesigns, sd_after: np.ndarray) -> list[str]:
    """Say about which coefficients a design says nothing, and what would; nothing if there is none such."""
    names = [
        name
        for name, before, after in zip(sweep.names, sweep.sd_before, sd_after, strict=True)
        if after > UNTAUGHT * before
    ]
    if not names:
        return []
    of = {name: {*CoefficientName.parse(name).signals} for name in sweep.names}
    wanted, moved = ({*chain(*(of[one] for one in some))} for some in (names, of.keys() - {*names}))
    signals = sorted(wanted - moved or wanted)
    held = [name for name, _ in sweep.trim if name != sweep.control]  # unless `together` moves them
    also = f" (`together` of [design] moves {listed(held)} as well)" if held else ""
    them = "it" if len(names) == 1 else "them"
    words = f"the trial says nothing about {listed(names)}: no measurement changes with {them}"
    return [f"{words}. To learn about {them}, move {listed(signals)}{also}"]


def _kept(kept: bool) -> Markup:
    return Markup('<span class="verdict {}">{}</span>').format("pass" if kept else "fail", "kept" if kept else "broken")
