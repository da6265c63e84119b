"""The report, the results as files, and the estimated vehicle out to simulators."""

from pathlib import Path

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, markup
from seatrial.apps.dashboard.campaign_paths import DOWNLOADS
from seatrial.apps.dashboard.page_layout import button, link, section
from seatrial.apps.dashboard.pages.work import begin, live_view
from seatrial.campaign.store.stored_result import Store

TARGETS = {
    "gz": "vehicle: Gazebo (gz-sim)",
    "uuv": "vehicle: UUV Simulator",
    "stonefish": "vehicle: Stonefish",
    "fossen": "vehicle: Fossen's Python simulator",
    "holoocean": "vehicle: HoloOcean",
    "json": "vehicle: JSON, documented",
    "csv": "vehicle: CSV",
    "trial csv": "next trial: CSV",
    "trial json": "next trial: JSON",
    "trial mavlink": "next trial: MAVLink script",
    "trial ros2": "next trial: ROS 2 bag",
    "trial mcap": "next trial: MCAP",
}
"""What `seatrial export` can write."""
NOWHERE = "nowhere: the campaign models all"


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    with section("Report", "One page with everything, for archive and print; it needs no server."):
        report = Store(folder).report
        if report.is_file():
            markup(
                Markup(
                    '<p class="links"><a href="{}" target="_blank" rel="noopener">Open report.html</a><a href="{}">Download it</a></p>'
                ).format(
                    link("download", campaign, file="report.html", shown="1"),
                    link("download", campaign, file="report.html"),
                )
            )
        else:
            markup("<p>No report yet.</p>")
        button(
            "Write the report anew",
            lambda: (begin(context, folder, said, "report"), live.look()),
            main=not report.is_file(),
        )
    with section(
        "Export",
        "Out to a simulator, under export/ in the campaign's folder. Unsupported terms are listed below and in the file.",
    ):
        names = await context.worker_pool.think("whole_vehicles")
        with ui.element("div").classes("line"):
            look = "outlined options-dense hide-bottom-space"
            target = ui.select(TARGETS, value="gz", label="Simulator or format").props(look).classes("wide")
            rest = ui.select(
                {"": NOWHERE} | {name: name for name in names}, value="", label="Motions not modelled, from"
            )
            rest.props(look).classes("wide")

            def export() -> None:
                begin(context, folder, said, "export", *options_of(str(target.value), str(rest.value)))
                live.look()

            button("Export", export, main=True)
        _exported(folder, campaign)
    with section("At work"):
        said = ui.element("div")
        live = live_view(context, folder)

        async def again() -> None:
            ui.navigate.reload()

        live.on_end.append(again)
    with section("Files", "The results themselves, as they lie in the campaign's folder."):
        there = [name for name in DOWNLOADS if (folder / name).is_file()]
        links = Markup("").join(
            Markup('<a href="{}">{}</a>').format(link("download", campaign, file=name), name) for name in there
        )
        markup(Markup('<p class="links">{}</p>').format(links))


def options_of(target: str, rest: str) -> list[str]:
    """Options of the command for one of the targets; a trial has no rest."""
    trial, _, name = target.rpartition(" ")
    if trial:
        return ["--trial", "--to", name]
    return ["--to", name, *(["--rest", rest] if rest else [])]


def _exported(folder: Path, campaign: str) -> None:
    place = folder / "export"
    found = (
        sorted(path.relative_to(folder).as_posix() for path in place.rglob("*") if path.is_file())
        if place.is_dir()
        else []
    )
    if found:
        rows = Markup("").join(
            Markup('<li><a href="{}">{}</a></li>').format(link("download", campaign, file=name), name)
            for name in found[:50]
        )
        markup(Markup('<h3>Exported so far</h3><ul class="findings">{}</ul>').format(rows))
