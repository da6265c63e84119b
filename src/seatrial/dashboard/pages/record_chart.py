"""One record as a chart: measured, predicted by the structures that are picked, and the range that is kept of it."""

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.stored_result import Store
from seatrial.cli.campaign_text import CAMPAIGN, read_file, with_trim, write_file
from seatrial.core.errors import SeatrialError
from seatrial.core.record import SIMULATED
from seatrial.dashboard.app_context import AppContext, fill, markup, say, saying
from seatrial.dashboard.campaign_paths import logs_of
from seatrial.dashboard.charts import Curve, Panel, TimeChart
from seatrial.dashboard.downsample import Envelope, rows_view
from seatrial.dashboard.page_layout import LOOK, button
from seatrial.dashboard.view_models import FormData, RecordAbout
from seatrial.dashboard.worker_pool import stamp
from seatrial.logs.cut_record import is_beyond

COLOURS = ("blue", "orange", "purple", "good", "caution", "alarm")
"""Of the structures that are picked, in turn."""
LOW = 70
"""Height of the panel of a control, pixels."""


class RecordChart:
    """The records of a campaign, one at a time.

    Args:
        context: what is served.
        folder: of the campaign.
        found: the campaign.
        stored: labels of the records that there are.
        start: imports the records again.
    """

    def __init__(
        self,
        context: AppContext,
        folder: Path,
        data: FormData,
        stored: list[str],
        start: Callable[[], Awaitable[None]],
    ):
        self.context, self.folder, self.found, self.stored, self.start_import = context, folder, data, stored, start
        self.run, self.seen, self.is_whole = "", "", False
        self.predicted: dict[str, Mapping[str, np.ndarray]] = {}

    async def build(self) -> None:
        """Build the choice of run and structures, and the chart."""
        runs = [run for run in (*self.found.fit, *self.found.predict) if run] or self.stored
        if not runs:
            words = "run the campaign, or import" if self.found.simulated else "run the designed trial, then send"
            markup(Markup("<p>No record yet: {} a log below.</p>").format(words))
            return
        self.run, self.seen = runs[0], read_file(self.folder)
        structures = sorted(path.stem for path in (Store(self.folder).results / "posterior").glob("*.nc"))
        with ui.element("div").classes("line"):
            if len(runs) > 1:
                ui.select(runs, value=self.run, label="Run", on_change=self._other).props(LOOK)
            if structures:
                picked = ui.select(structures, multiple=True, value=[], label="Predicted by", on_change=self._picked)
                picked.props(f"{LOOK} use-chips").classes("wide")
            if self.found.imported:
                button("Show the whole log", self._whole)
        self.said, self.holder = ui.element("div"), ui.element("div")
        await self._show()

    async def _other(self, event: Any) -> None:
        self.run, self.predicted, self.is_whole = event.value, {}, False
        await self._show()

    async def _whole(self) -> None:
        self.is_whole = True
        await self._show()

    async def _picked(self, event: Any) -> None:
        self.said.clear()
        with self.said:
            markup('<p class="waiting" role="status">predicting …</p>')
        labels, run, chosen = tuple(event.value), self.run, {}
        words: list[str] = []
        for label in labels:
            files = [self.folder / CAMPAIGN, Store(self.folder).posterior(label), Store(self.folder).record(run)]
            try:
                asked = self.context.worker_pool.think("candidate", str(self.folder), label, run, files=files)
                chosen[label] = await asked
            except (SeatrialError, OSError) as error:
                words.append(str(error))
        self.said.clear()
        with self.said:
            for one in words:
                say(one)
        self.predicted = chosen
        await self._show()

    async def _show(self) -> None:
        self.holder.clear()
        path = Store(self.folder).record(self.run)
        if not self.is_whole and not path.is_file():
            with self.holder:
                markup(Markup("<p>Run {} is not imported yet.</p>").format(self.run))
            return
        await fill(self.holder, self._about(path), self._draw, "reading …")

    async def _about(self, path: Path) -> tuple[RecordAbout, int]:
        """What is shown, and how many samples are kept of it."""
        pool, files = self.context.worker_pool, self._files()
        if not self.is_whole:
            about = await pool.view("about_record", path, files=[path])
            return about, about.samples
        about = await pool.think("whole_log", str(self.folder), self.run, tuple(map(stamp, files)))
        kept = (await pool.view("about_record", path, files=[path])).samples if path.is_file() else 0
        return about, kept

    def _files(self) -> list[Path]:
        return [self.folder / CAMPAIGN, *(self.folder / name for name in logs_of(self.folder, ("",)))]

    async def _draw(self, found: tuple[RecordAbout, int]) -> None:
        about, kept = found
        chart = TimeChart(
            [self._panel(*one) for one in zip(about.names, about.units, about.roles, strict=True)],
            self._view,
            (about.start, about.end),
            f"Record {self.run} over time",
            self._selected if self.found.imported else None,
        )
        await chart.build()
        self.chart = chart
        samples = f"{kept} of {about.samples} samples are kept" if self.is_whole else f"{about.samples} samples"
        origin = about.source if about.source == SIMULATED else f"from {about.source}"
        words = f"{samples}; {about.start:.6g} to {about.end:.6g} s of {about.available:.6g} s; {origin}."
        markup(Markup('<p class="note">{}</p>').format(words))
        if about.notes:
            notes = Markup("").join(Markup("<li>{}</li>").format(note) for note in about.notes)
            markup(Markup("<details><summary>How it was made</summary><ul>{}</ul></details>").format(notes))
        if self.found.imported:
            self._numbers(about)

    def _panel(self, name: str, unit: str, role: str) -> Panel:
        kind = "steps" if role == "control" else "dots"
        label = "measured" if role != "control" else "logged" if self.found.imported else "commanded"
        ground = Curve(name, label, "ink" if role == "control" else "dots", kind)
        above = []
        for colour, (label, curves) in zip(COLOURS * len(self.predicted), self.predicted.items(), strict=False):
            if name in curves:
                above += [Curve(f"{label}/{name}/band", label, colour, "band"), Curve(f"{label}/{name}", label, colour)]
        return Panel(name, unit, (ground, *above), LOW if role == "control" else 130)

    async def _view(self, start: float, end: float, columns: int) -> Mapping[str, Envelope]:
        pool, path = self.context.worker_pool, Store(self.folder).record(self.run)
        if self.is_whole:
            stamps = tuple(map(stamp, self._files()))
            answer = await pool.think("whole_log_view", str(self.folder), self.run, stamps, start, end, columns)
        else:
            answer = await pool.view("record_view", path, start, end, columns, files=[path])
        return {**answer, **predicted_view(self.predicted, start, end, columns)}

    def _selected(self, start: float, end: float) -> None:
        self.start.value, self.end.value = float(f"{start:.6g}"), float(f"{end:.6g}")

    def _numbers(self, about: RecordAbout) -> None:
        self.available = about.available
        with ui.element("div").classes("line"):
            look = {"format": "%.6g", "on_change": self._typed}
            props = "outlined hide-bottom-space"
            self.start = ui.number("Begin [s]", value=float(f"{about.start:.6g}"), **look).props(props)
            self.end = ui.number("End [s]", value=float(f"{about.end:.6g}"), **look).props(props)
            button("Check, save and re-import", self._save, main=True)
        self.saved = ui.element("div")
        words = (
            "Seconds from the beginning of the whole record, which has all controls and a measurement. "
            '"Select a range" sets both.'
        )
        markup(Markup('<p class="note">{}</p>').format(words))

    def _typed(self) -> None:
        start, end = self.start.value, self.end.value
        if start is not None and end is not None and start < end:
            self.chart.keep(float(start), float(end))

    async def _save(self) -> None:
        start, end = self.start.value, self.end.value
        self.start.error, self.end.error = ends_errors(start, end, self.available)
        with saying(self.saved):
            if start is None or end is None or self.start.error or self.end.error:
                return
            text = with_trim(self.folder, self.seen, self.run, f"{start:.6g} s", f"{end:.6g} s")
            await self.context.worker_pool.think("check", str(self.folder), text)
            write_file(self.folder, text, self.seen)
            self.seen = text
            markup('<p class="done" role="status">Saved in campaign.toml. The record is imported again.</p>')
            await self.start_import()


def ends_errors(start: float | None, end: float | None, available: float) -> tuple[str | None, str | None]:
    """Return what is wrong with the begin and the end of a run, each None if nothing is.

    Args:
        start: s from the beginning of the whole record; None if none is typed.
        end: likewise.
        available: length of the whole record, s.
    """
    length = f"the whole record is {available:.6g} s long"
    wrong_start = wrong_end = None
    if start is None or start < 0:
        wrong_start = "a number of seconds, 0 or more"
    if end is None:
        wrong_end = f"a number of seconds; {length}"
    elif is_beyond(end, available):
        wrong_end = f"at most {available:.6g} s: {length}"
    elif start is not None and not start < end:
        wrong_start = wrong_start or "has to be before the end"
    return wrong_start, wrong_end


def predicted_view(
    predicted: Mapping[str, Mapping[str, np.ndarray]], start: float, end: float, columns: int
) -> dict[str, Envelope]:
    """Means and bands between two times: `LABEL/CHANNEL`, and `LABEL/CHANNEL/band` from its lowest to its highest."""
    found: dict[str, Envelope] = {}
    for label, curves in predicted.items():
        drawn = rows_view(curves, start, end, columns)
        for name in (one for one in drawn if f"{one} lower" in drawn):
            found[f"{label}/{name}"] = drawn[name]
            low, high = drawn[f"{name} lower"], drawn[f"{name} upper"]
            found[f"{label}/{name}/band"] = Envelope(low.time, low.least, high.greatest)
    return found
