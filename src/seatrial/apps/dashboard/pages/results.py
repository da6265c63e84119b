"""What the data say: coefficients, fit and residuals, posteriors, probabilities of models, and the next trial."""

from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.apps.dashboard.app_context import AppContext, fill, markup, say
from seatrial.apps.dashboard.page_layout import figure, link, section, table
from seatrial.campaign.store.estimates import Predictions
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.structures import Summary, read_selection, read_summary
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import SeatrialError
from seatrial.estimation.fit_verdict import explained_share
from seatrial.report.labels import label_html, label_mathtext
from seatrial.report.numbers import percent, probability, short, unit_html, with_sd

MOST = 12


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    store = Store(folder)
    try:
        summary = read_summary(store.summary, f"seatrial run {folder}")
    except (SeatrialError, OSError) as error:
        if store.summary.exists():
            say(error)
        else:
            with section("No results yet"):
                markup(Markup('<p>Run the campaign first: <a href="{}">Run</a>.</p>').format(link("run", campaign)))
        return
    labels = {row.name: row.label for row in summary.coefficients}
    with section(summary.name):
        await _currency(context, campaign, folder)
        for kind in ("alarms", "verdicts", "cautions"):
            if getattr(summary, kind):
                marks = Markup("").join(
                    Markup('<li class="{}">{}</li>').format("alarm" if kind == "alarms" else "", text)
                    for text in getattr(summary, kind)
                )
                markup(Markup('<h3>{}</h3><ul class="findings">{}</ul>').format(_TITLE[kind], marks))
        markup(coefficients(summary))
    with section(
        "Fit and residuals",
        "Dots or strokes: measured, downsampled, spikes kept. Line and 90 % band: predicted from the inputs alone.",
    ):
        await _fits(context, store)
    with section(
        "Posteriors",
        "Histogram: draws. Dashed: prior. Thin line: normal approximation. Dotted: the truth of a simulated vehicle.",
    ):
        path = store.posterior(summary.chosen)
        holder = ui.element("div").classes("figures small")
        truth = _truth(context, folder)
        await fill(
            holder, _posteriors(context, path, await truth), lambda found: [markup(figure(svg)) for svg in found]
        )
    with section("Models and terms"):
        await _models(context, store, summary, labels)
    with section("The next trial"):
        words = summary.next_trial.words
        markup(
            Markup('<p>{}.</p><p class="links"><a href="{}">Look at it on the design surface</a>{}</p>').format(
                words[:1].upper() + words[1:],
                link("design", campaign),
                Markup('<a href="{}">Download its schedule (CSV)</a>').format(
                    link("download", campaign, file="results/next_schedule.csv")
                )
                if store.schedule(store.next_design).is_file()
                else "",
            )
        )


_TITLE = {
    "alarms": "Do not use these numbers yet",
    "verdicts": "What the data say",
    "cautions": "What to know before using them",
}


def coefficients(summary: Summary) -> Markup:
    """The table of coefficients of the chosen structure."""
    rows = [
        [
            label_html(row.label) + Markup(" <small>{}</small>").format(row.name),
            with_sd(row.mean, row.sd),
            unit_html(row.unit),
            f"{short(row.lower_95)} to {short(row.upper_95)}",
            short(row.prior_sd),
            percent(row.sd / row.prior_sd) if row.prior_sd else "",
        ]
        for row in summary.coefficients
    ]
    head = ["parameter", "mean ± sd", "unit", "95 % interval", "prior sd", "left of it"]
    return table(head, rows, f"Parameters of {summary.chosen}: {' '.join(summary.terms)}")


async def _currency(context: AppContext, campaign: str, folder: Path) -> None:
    """Say so where the results no longer belong to the campaign file."""
    holder = ui.element("div")

    def build(steps: Any) -> None:
        old = [one.name for one in steps if one.state != "current" and one.name != "report"]
        if old:
            words = "These results are from before the campaign file or its logs were changed: {} {} stale or missing. "
            markup(
                Markup('<p class="alarm">▲ ' + words + '<a href="{}">Run it again</a>.</p>').format(
                    ", ".join(old), "is" if len(old) == 1 else "are", link("run", campaign)
                )
            )

    await fill(holder, context.steps(folder), build, "looking whether these results are current …")


async def _fits(context: AppContext, store: Store) -> None:
    path = store.predictions
    if not path.is_file():
        markup("<p>No predictions yet.</p>")
        return
    holder = ui.element("div")

    def build(found: Predictions) -> Any:
        rows = [
            [
                fit.record + (" (held back)" if fit.held_back else ""),
                fit.channel,
                Markup('<span class="verdict {}">{}</span>').format(fit.level, fit.level),
                explained_share(fit.explained) if not fit.missing else "",
                percent(fit.coverage) if fit.samples else "",
                fit.words,
            ]
            for fit in found.fits
        ] + [
            [
                "held-back runs together",
                one.channel,
                Markup('<span class="verdict {}">{}</span>').format(one.level, one.level),
                explained_share(one.explained, one.runs),
                percent(one.coverage) if one.effective else "",
                one.reason,
            ]
            for one in found.pooled
        ]
        head = ["run", "channel", "verdict", "explained", "inside 90 % band", "why"]
        markup(table(head, rows, "How well each record is predicted"))
        pictures = ui.element("div").classes("figures")
        campaign_paths = {
            (i, j): f"run {record}, {channel}{' (held back)' if record in found.held_back else ''}"
            for i, record in enumerate(found.records)
            for j, channel in enumerate(found.channels)
        }

        async def show(at: tuple[int, int]) -> None:
            pictures.clear()
            drawn = context.worker_pool.draw("fit", path, *at, files=[path])
            await fill(pictures, drawn, lambda pair: [markup(figure(svg)) for svg in pair], "drawing …")

        if len(campaign_paths) > 1:
            names = {f"{i}/{j}": words for (i, j), words in campaign_paths.items()}
            form = (
                ui.select(names, value="0/0", label="Record and channel")
                .props("outlined options-dense hide-bottom-space")
                .classes("wide")
            )
            form.move(target_index=1)

            async def changed() -> None:
                i, _, j = str(form.value).partition("/")
                await show((int(i), int(j)))

            form.on_value_change(changed)
        return show((0, 0))

    await fill(holder, context.worker_pool.draw("predicted", path, files=[path]), build)


async def _posteriors(context: AppContext, path: Path, truth: tuple[tuple[str, float], ...]) -> list[str]:
    return await context.worker_pool.draw("posteriors", path, truth, files=[path])


async def _truth(context: AppContext, folder: Path) -> tuple[tuple[str, float], ...]:
    """True values of a simulated vehicle, as the campaign file has them."""
    from seatrial.apps.campaign_text import read_file
    from seatrial.campaign.config.toml import toml_content

    try:
        content = toml_content(folder, read_file(folder))
        return tuple((str(k), float(v)) for k, v in content.get("truth", {}).items()) if "import" not in content else ()
    except (SeatrialError, OSError, ValueError, TypeError, AttributeError):
        return ()


async def _models(context: AppContext, store: Store, summary: Summary, labels: dict[str, str]) -> None:
    ranked = sorted(summary.structures, key=lambda one: -one.probability)
    if len(ranked) > 1:
        holder = ui.element("div").classes("figures")
        shown = ranked[:MOST]
        drawn = context.worker_pool.draw(
            "bars",
            tuple(one.label for one in shown),
            tuple(one.probability for one in shown),
            tuple(one.probability_error for one in shown),
            "Models and their probability",
            True,
        )
        await fill(
            holder, drawn, lambda svg: markup(figure(svg, "Probability of each model, with one standard error."))
        )
        try:
            chosen = read_selection(store.selection, "seatrial select")
        except (SeatrialError, OSError):
            chosen = None
        if chosen is not None and chosen.inclusion:
            terms = sorted(chosen.inclusion, key=lambda term: -chosen.inclusion[term])
            drawn = context.worker_pool.draw(
                "bars",
                tuple(label_mathtext(labels.get(term) or CoefficientName.parse(term).label) for term in terms),
                tuple(chosen.inclusion[term] for term in terms),
                tuple(chosen.inclusion_error[term] for term in terms),
                "Terms and the probability that each is needed",
                False,
            )
            with holder:
                beside = ui.element("div").style("display: contents")
            await fill(
                beside, drawn, lambda svg: markup(figure(svg, "Probability that the vehicle needs each optional term."))
            )
    rows = [
        [
            one.label + (" (chosen)" if one.label == summary.chosen else ""),
            " ".join(one.terms),
            probability(one.probability, one.probability_error),
            f"{one.log_evidence:.2f} ± {one.evidence_error:.2f}",
            one.status,
        ]
        for one in ranked
    ]
    markup(table(["model", "terms", "probability", "log evidence", "note"], rows, "Models", left=2))
