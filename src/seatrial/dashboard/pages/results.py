"""What the data say: the sections of the report; before a model is chosen, the estimates."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.summary import NextTrial
from seatrial.cli.campaign_text import written_units
from seatrial.core.display_units import Shown, shown_as_written
from seatrial.dashboard.app_context import AppContext, change_of, fill, keep_current, keep_filled, markup, saying
from seatrial.dashboard.page_layout import button, link, links_html, section
from seatrial.dashboard.pages.work import Live, begin
from seatrial.dashboard.view_models import EstimatedStructure
from seatrial.dashboard.worker_pool import stamp
from seatrial.report.html import render_html
from seatrial.report.labels import label_html, name_html, sentence_html
from seatrial.report.numbers import Digits


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    store = Store(folder)

    def seen() -> Any:
        """What is shown: the report of the finished run, else the estimates that there are."""
        made = () if store.summary.exists() else (store.mode, *posteriors(store))
        return tuple(map(stamp, (store.summary, store.report, *made)))

    async def show() -> None:
        if not store.summary.exists():
            await _before_a_choice(context, campaign, folder)
            return
        await _currency(context, campaign, folder)
        await _report(context, campaign, folder)

    await keep_current(seen, show)


async def _report(context: AppContext, campaign: str, folder: Path) -> None:
    """Show the report section by section, whatever has changed since it was written."""
    store = Store(folder)
    asked = context.worker_pool.draw("report_sections", store.report, files=[store.report])
    await fill(ui.element("div"), asked, partial(_sections, campaign, folder), "reading the report …")


def _sections(campaign: str, folder: Path, sections: dict[str, str]) -> None:
    store = Store(folder)
    for name, html in sections.items():
        with ui.element("div").classes("report"):
            markup(html)
        if name == "summary":
            markup(links_html([(link("model", campaign), "Change the noise or the terms")]))
        elif name == "fit":
            markup(
                links_html([(link("import", campaign), "Zoom into the records, with the predictions of any structure")])
            )
        elif name == "next":
            with saying(ui.element("div")):
                markup(next_links(campaign, store, Results(folder).summary().next_trial))


def next_links(campaign: str, store: Store, trial: NextTrial) -> Markup:
    """Return links to the next trial; nothing if it is better not run."""
    if trial.stop or trial.best is None:
        return Markup("")
    links = [(link("design", campaign), "Look at it on the design surface")]
    if store.schedule(store.next_design).is_file():
        links.append((link("download", campaign, file="results/next_schedule.csv"), "Download its schedule (CSV)"))
    return links_html(links)


async def _before_a_choice(context: AppContext, campaign: str, folder: Path) -> None:
    """Show the report of the posterior mode, or what `estimate` has found, while no structure is chosen."""
    store, shown = Store(folder), shown_as_written(dict(written_units(folder)))
    chains, has_mode, run = posteriors(store), store.mode.is_file(), link("run", campaign)
    with section("No model is chosen yet" if chains or has_mode else "No results yet"):
        if not chains and not has_mode:
            markup(Markup('<p>Run the campaign first: <a href="{}">Run</a>.</p>').format(run))
            return
        words = "<p>The command run chooses among the structures and fills this page: "
        markup(Markup(words + '<a href="{}">Run</a>.</p>').format(run))
        await _currency(context, campaign, folder)
        if chains:
            asked = context.worker_pool.draw("estimated", chains, files=chains)
            await fill(ui.element("div"), asked, lambda found: markup(estimated_html(found, shown)), "reading …")
            return
        with ui.element("div").classes("line"):
            button("Write the report of the first answer", lambda: begin(context, folder, messages, "report"))
        messages = ui.element("div")
        Live(context, folder, ("report",))
    if stamp(store.report)[2] >= stamp(store.mode)[2]:
        await _report(context, campaign, folder)


def posteriors(store: Store) -> tuple[Path, ...]:
    """Return the stored posteriors, in the order of the structures' labels."""
    files = store.posterior("any").parent.glob("*.nc")
    return tuple(sorted(files, key=lambda path: (len(path.stem), path.stem)))


def estimated_html(structures: Sequence[EstimatedStructure], shown: Shown) -> Markup:
    """Return the parameters of each structure as they are before any is chosen, in the units in which they are `shown`: as in a report."""
    html = _findings(
        "Do not use these numbers yet", [f"{one.label}: {text}" for one in structures for text in one.alarms]
    )
    for one in structures:
        rows, labels = [], {name: label for name, label, *_ in one.rows if label}
        for name, label, si, mean, sd, cause in one.rows:
            factor, unit = shown(name, si)
            digits = Digits.of(factor * mean, factor * sd)
            value = {"value": digits.pair(factor * mean, factor * sd), "made_of": name_html(cause, labels)}
            rows.append({"name": name, "label": label_html(label), "unit": digits.unit_html(unit), **value})
        caption = f"Parameters of {one.label}: {' '.join(one.terms)}"
        html += Markup(render_html("values.html", rows=rows, caption=caption))
        html += _findings("What adds most to the ±", one.remarks, labels)
    return Markup('<div class="report">{}</div>').format(html)


def _findings(title: str, texts: Sequence[str], labels: Mapping[str, str] | None = None) -> Markup:
    rows = Markup("").join(Markup("<li>{}</li>").format(sentence_html(text, labels or {})) for text in texts)
    return Markup('<h3>{}</h3><ul class="findings">{}</ul>').format(title, rows) if texts else Markup("")


async def _currency(context: AppContext, campaign: str, folder: Path) -> None:
    """Say so where the results no longer belong to the campaign file, or where others are being made."""

    def build(steps: Any) -> None:
        # The design of the first trial is not made again once the trial was run, and no result depends on it.
        shown = [one for one in steps if one.name != "design"]
        old, missing = ([one.name for one in shown if one.state == state] for state in ("stale", "missing"))
        if context.jobs.look(folder).running:
            words = '<p class="note" role="status">A command is running. These are the earlier results; the page updates itself.</p>'
            markup(words)
        elif old:
            words = "These results do not belong to the campaign file and its logs as they are now: {} {} stale. "
            if "import" in old:
                words += "If nothing was changed, its logs lie where this dashboard may not read: start it with --allow-read FOLDER. "
            markup(
                Markup('<p class="alarm">▲ ' + words + '<a href="{}">Run it again</a>.</p>').format(
                    ", ".join(old), "is" if len(old) == 1 else "are", link("run", campaign)
                )
            )
        elif missing:
            words = '<p class="note">Not made yet: {}. <a href="{}">Run the rest</a>.</p>'
            markup(Markup(words).format(", ".join(missing), link("run", campaign)))

    def seen() -> Any:
        return change_of(folder), context.look(folder).running

    await keep_filled(seen, lambda: context.steps(folder), build, "looking whether these results are current …")
