"""The report, the results as files, and the estimated vehicle out to simulators."""

import asyncio
from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.stored_result import Store
from seatrial.dashboard.app_context import AppContext, evidence_of, fill, keep_current, markup
from seatrial.dashboard.page_layout import LOOK, button, link, links_html, section, table
from seatrial.dashboard.pages.work import Live, begin
from seatrial.dashboard.view_models import ExportTarget
from seatrial.dashboard.worker_pool import stamp

TARGETS = {
    "gz": "vehicle: Gazebo (gz-sim)",
    "stonefish": "vehicle: Stonefish",
    "fossen": "vehicle: Fossen's Python simulator",
    "casadi": "vehicle: CasADi",
    "fmu": "vehicle: FMU for co-simulation",
    "mjcf": "vehicle: MuJoCo",
    "holoocean": "vehicle: HoloOcean",
    "json": "vehicle: JSON, documented",
    "control": "vehicle: linear models for control",
    "draws": "vehicle: draws of the posterior",
    "csv": "vehicle: CSV",
    "trial csv": "next trial: CSV",
    "trial json": "next trial: JSON",
    "trial mavlink": "next trial: MAVLink script",
    "trial ros2": "next trial: ROS 2 bag",
    "trial mcap": "next trial: MCAP",
}
"""What `seatrial export` can write; targets of other packages are shown by their names."""
NOWHERE = "nowhere"


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("Report", "One page with all results, to archive or print; it needs no server."):
        report = Store(folder).report
        await keep_current(lambda: stamp(report), lambda: _report_links(campaign, report.is_file()))
        messages = ui.element("div")
        button("Write the report again", lambda: begin(context, folder, messages, "report"), main=not report.is_file())
    with section(
        "Export",
        "To a simulator or a vehicle: written to export/ in the folder of the campaign, listed under Files. Only possible targets are "
        "offered.",
    ):
        await keep_current(lambda: stamp(Store(folder).summary), lambda: ExportForm(context, folder).show())
    with section("At work"):
        Live(context, folder)
    with section("Files", "Results and exports in the folder of the campaign."):

        def files() -> None:
            there = context.campaign_paths.files(campaign)
            markup(links_html((link("download", campaign, file=name), name) for name in there))

        await keep_current(lambda: context.campaign_paths.files(campaign), files)


def _report_links(campaign: str, is_there: bool) -> None:
    if not is_there:
        markup("<p>No report yet.</p>")
        return
    words = '<a href="{}" target="_blank" rel="noopener">Open report.html</a><a href="{}">Download it</a>'
    addresses = (
        link("download", campaign, file="report.html", shown="1"),
        link("download", campaign, file="report.html"),
    )
    markup(Markup('<p class="links">' + words + "</p>").format(*addresses))


class ExportForm:
    """What this campaign can export, asked of every target itself."""

    def __init__(self, context: AppContext, folder: Path):
        self.context, self.folder = context, folder
        self.place = ui.element("div")

    async def show(self, rest: str = "") -> None:
        """Ask, and offer what is possible with what one published vehicle supplies; with none if empty."""
        self.place.clear()
        files = await asyncio.to_thread(evidence_of, self.folder)
        think = self.context.worker_pool.think

        async def asked() -> tuple[tuple[str, ...], tuple[ExportTarget, ...]]:
            rests = await think("export_rests", str(self.folder), files=files)
            return rests, await think("export_targets", str(self.folder), rest, files=files)

        await fill(
            self.place,
            asked(),
            lambda found: self._offer(rest, *found),
            "checking which targets can represent this campaign …",
        )

    def _offer(self, rest: str, rests: tuple[str, ...], targets: tuple[ExportTarget, ...]) -> None:
        possible = {option_of(one): one for one in targets if not one.refusal}
        with ui.element("div").classes("line"):
            if rests:
                names = {"": NOWHERE} | {name: name for name in rests}
                other = ui.select(names, value=rest, label="Motions not modelled, from").props(LOOK).classes("wide")
                other.on_value_change(lambda event: self.show(event.value))
            if possible:
                shown = {option: TARGETS.get(option, f"vehicle: {option}") for option in possible}
                target = (
                    ui.select(shown, value=next(iter(shown)), label="Simulator or format").props(LOOK).classes("wide")
                )

                def export() -> None:
                    begin(self.context, self.folder, messages, "export", *options_of(str(target.value), rest))

                def unsupported() -> None:
                    terms.set_content(unsupported_html(possible[str(target.value)]))

                button("Export", export, main=True)
                target.on_value_change(unsupported)
        messages, terms = ui.element("div"), markup("").props('aria-live="polite"')
        if possible:
            unsupported()
        refused = [[TARGETS.get(option_of(one), one.name), one.refusal] for one in targets if one.refusal]
        if refused:
            with ui.element("details").props("" if possible else "open"):
                with ui.element("summary"):
                    ui.label(f"Not possible for this campaign: {len(refused)}").style("display: inline")
                markup(table(["target", "reason and remedy"], refused, left=2))


def option_of(target: ExportTarget) -> str:
    """Key of `TARGETS`."""
    return f"trial {target.name}" if target.is_trial else target.name


def unsupported_html(target: ExportTarget) -> Markup:
    """Which terms a target does not support."""
    if target.is_trial:
        return Markup("")
    if not target.unsupported:
        return Markup('<p class="note">All known terms of the vehicle are supported.</p>')
    rows = Markup("").join(Markup("<li>{}</li>").format(one) for one in target.unsupported)
    return Markup('<h3>Unsupported terms</h3><ul class="findings">{}</ul>').format(rows)


def options_of(target: str, rest: str) -> list[str]:
    """Options of the command for one of the targets; a trial has no rest."""
    trial, _, name = target.rpartition(" ")
    if trial:
        return ["--trial", "--to", name]
    return ["--to", name, *(["--fill-from", rest] if rest else [])]
