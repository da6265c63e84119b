"""What the data say: coefficients, fit and residuals, posteriors, probabilities of models, and the next trial."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup
from nicegui import ui

from seatrial.campaign.store.estimates import StoredCoefficient
from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.structures import (
    QUOTED,
    RARE,
    StoredAverage,
    StoredMode,
    Summary,
)
from seatrial.cli.campaign_text import written_units
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import Shown, listed, shown_as_written
from seatrial.core.errors import InputError, SeatrialError
from seatrial.core.findings import Finding
from seatrial.dashboard.app_context import AppContext, change_of, fill, keep_current, markup, say
from seatrial.dashboard.page_layout import LOOK, link, links_html, section, table
from seatrial.dashboard.result_charts import Probability, fit_charts, marginal_chart, probability_chart
from seatrial.dashboard.view_models import EstimatedStructure, EstimatedValue, Marginal
from seatrial.dashboard.worker_pool import stamp
from seatrial.messages.predictions import explained_text
from seatrial.messages.render import sentence, statement
from seatrial.report.labels import label_html, name_html, sentence_about
from seatrial.report.numbers import Digits, percent, probability, short, times_ten, typeset, unit_html, with_sd
from seatrial.selection.structures import Structure, structure_names
from seatrial.selection.verdict import Selection

MOST = 12
CANDIDATES = 4
"""Structures over one plot, at most: the chosen one and the most probable others."""


async def build(context: AppContext, campaign: str, folder: Path) -> None:
    """Build the view."""
    store = Store(folder)

    def seen() -> Any:
        """What is shown: the finished run, else the estimates that there are."""
        others = () if store.summary.exists() else (store.mode, *posteriors(store))
        return tuple(map(stamp, (store.summary, *others)))

    await keep_current(ui.element("div"), seen, partial(_results, context, campaign, folder))


async def _results(context: AppContext, campaign: str, folder: Path) -> None:
    store = Store(folder)
    try:
        summary = Results(folder).summary()
    except (SeatrialError, OSError) as error:
        if store.summary.exists():
            say(error)
        else:
            await _before_a_choice(context, campaign, folder)
        return
    names, labels = names_and_labels(summary)
    shown = shown_as_written(dict(written_units(folder)))
    with section(summary.name):
        await _currency(context, campaign, folder)
        for kind in ("alarms", "verdicts", "cautions"):
            if getattr(summary, kind):
                marks = Markup("").join(
                    Markup('<li class="{}">{}</li>').format(
                        "alarm" if kind == "alarms" else "", sentence_about(text, names, labels)
                    )
                    for text in getattr(summary, kind)
                )
                title = _USABLE if kind == "alarms" and summary.usable else _TITLE[kind]
                markup(Markup('<h3>{}</h3><ul class="findings">{}</ul>').format(title, marks))
        if summary.alarms or summary.cautions:
            markup(links_html([(link("model", campaign), "Change the noise or the terms")]))
        markup(coefficients(summary, shown))
    with section(
        "Fit and residuals",
        "Raw data, downsampled, spikes kept; line and 90 % band: predicted from the inputs alone. Wheel, drag or buttons zoom.",
    ):
        await _fits(context, store)
    truth = await _truth(context, folder)
    words = "Filled: draws; pale: 95 % interval. Dashed: prior. Thin line: normal approximation."
    with section("Posteriors", words + " Dotted: the truth of the simulated vehicle." * bool(truth)):
        await _posteriors(context, folder, summary, truth)
    with section("Models and terms"):
        _models(store, summary)
    with section("The next trial"):
        words = sentence_about(summary.next_trial.words, names, labels)
        markup(next_html(words, summary.next_trial.stop or summary.next_trial.best is None, campaign, store))


async def _before_a_choice(context: AppContext, campaign: str, folder: Path) -> None:
    """Show what `estimate` has found, while no structure is chosen."""
    store, units = Store(folder), written_units(folder)
    chains, run = posteriors(store), link("run", campaign)
    with section("No model is chosen yet" if chains or store.mode.is_file() else "No results yet"):
        if not chains and not store.mode.is_file():
            markup(Markup('<p>Run the campaign first: <a href="{}">Run</a>.</p>').format(run))
            return
        words = "<p>These are estimates of single structures. The command run chooses among them and fills this page: "
        markup(Markup(words + '<a href="{}">Run</a>.</p>').format(run))
        await _currency(context, campaign, folder)
        if chains:
            asked = context.worker_pool.draw("estimated", chains, units, files=chains)
            await fill(ui.element("div"), asked, lambda found: markup(estimated_html(found)), "reading …")
            return
        try:
            mode = Results(folder).mode()
        except (SeatrialError, OSError) as error:
            say(error)
            return
        words = (
            '<p class="note">Kept of <code>estimate --by mode</code>: the most probable structure. It is a normal approximation, '
            'which is not checked. The command prints all structures on <a href="{}">Run</a>.</p>'
        )
        markup(Markup(words).format(run) + estimated_html([of_mode(mode, shown_as_written(dict(units)))]))


def posteriors(store: Store) -> tuple[Path, ...]:
    """Return the stored posteriors, in the order of the structures' labels."""
    files = store.posterior("any").parent.glob("*.nc")
    return tuple(sorted(files, key=lambda path: (len(path.stem), path.stem)))


def next_html(words: Markup, stop: bool, campaign: str, store: Store) -> Markup:
    """Say what to do next, with links to the next trial unless it is better not run."""
    links = [(link("design", campaign), "Look at it on the design surface")]
    if store.schedule(store.next_design).is_file():
        links.append((link("download", campaign, file="results/next_schedule.csv"), "Download its schedule (CSV)"))
    return Markup("<p>{}</p>{}").format(words, "" if stop else links_html(links))


_TERM = re.compile(r"\b[A-Z]_\w+")
_TITLE = {
    "alarms": "Do not use these numbers yet",
    "verdicts": "What the data say",
    "cautions": "What to know before using them",
}

_BOLD, _PLAIN = Markup("<strong>{}</strong>"), Markup("{}")
_WITHIN, _WITH_ERROR = "mean ± sd, within the model", "with model error"
_USABLE = "What failed, but not for the coefficients of the chosen model"


def names_and_labels(summary: Summary) -> tuple[dict[str, str], dict[str, str]]:
    """Names of the structures by their terms, as the report has them, and the label of each parameter."""
    text = " ".join((*summary.verdicts, *(term for one in summary.structures for term in one.terms)))
    labels = {}
    for term in set(_TERM.findall(text)):
        with suppress(InputError):
            labels[term] = CoefficientName.parse(term).label
    labels |= {row.name: row.label for row in summary.coefficients}
    return structure_names([Structure(one.label, one.terms) for one in summary.structures]), labels


def coefficients(summary: Summary, shown: Shown) -> Markup:
    """The table of coefficients of the chosen structure, in the units in which they are `shown`; with model error where that makes a ±
    much wider. The value to quote is bold; if that is the average, coefficients that the structure lacks have a row too.
    """
    wider = any(row.model_error_sd is not None for row in summary.coefficients)
    is_averaged = summary.quoted == "averaged"
    is_quoted, averages = summary.usable and bool(summary.quoted), {row.name: row for row in summary.averaged}
    bold = _BOLD if is_quoted else _PLAIN
    rows = []
    for row in (one.in_unit(*shown(one.name, one.unit)) for one in summary.coefficients):
        own, average = Markup(with_sd(row.mean, row.sd)), averages.pop(row.name, None)
        more = _wider(row.model_error_sd, row.model_error_cause)
        if not is_averaged and row.model_error_sd is None:
            own = bold.format(own)
        elif not is_averaged:
            quoted = bold.format(with_sd(row.mean, row.model_error_sd))
            more = Markup("{} <small>{}</small>").format(quoted, row.model_error_cause)
        mean = "" if average is None else _averaged(average, shown, bold)
        shrunk = percent(row.sd / row.prior_sd) if row.prior_sd else ""
        cells = [
            own,
            *[more] * wider,
            *[mean] * is_averaged,
            interval(row),
            short(row.prior_sd),
            unit_html(row.unit),
            shrunk,
        ]
        rows.append([_named(row.label, row.name), *cells])
    for one in averages.values() if is_averaged else ():
        if one.inclusion >= RARE:
            unit = unit_html(shown(one.name, one.unit)[1])
            cells = ["not in it", *[""] * wider, _averaged(one, shown, bold), "", "", unit, ""]
            rows.append([_named(one.label, one.name), *cells])
    head = ["parameter", _WITHIN, *[_WITH_ERROR] * wider, *["averaged over all models"] * is_averaged]
    head += ["95 % interval, within the model", "prior sd", "unit", "sd / prior sd"]
    words = Markup("<p><strong>Bold: the value to quote.</strong> It is {}.</p>").format(QUOTED.get(summary.quoted, ""))
    caption = f"Parameters of {summary.chosen}: {' '.join(summary.terms)}"
    return (words if is_quoted else Markup("")) + table(head, rows, caption, stacks=True)


def _named(label: str, name: str) -> Markup:
    return label_html(label) + Markup(" <small>{}</small>").format(name)


def _averaged(row: StoredAverage, shown: Shown, bold: Markup) -> Markup:
    """Return an averaged value with the ± that counts: with model error if that is larger."""
    factor = shown(row.name, row.unit)[0]
    pair = bold.format(with_sd(factor * row.mean, factor * (row.model_error_sd or row.sd)))
    return pair if row.model_error_sd is None else pair + Markup(" <small>with model error</small>")


def estimated_html(structures: Sequence[EstimatedStructure]) -> Markup:
    """Return the coefficients of each structure as they are before any structure is chosen, and once what makes a ± much wider.

    Args:
        structures: stored estimates.
    """
    rows = Markup("").join(Markup("<li>{}</li>").format(sentence) for sentence in _causes(structures))
    alarms = Markup("").join(
        Markup('<li class="alarm">{}</li>').format(sentence_about(f"{one.label}: {text}", {}, {}))
        for one in structures
        for text in one.alarms
    )
    return Markup("").join(
        [
            Markup('<h3>{}</h3><ul class="findings">{}</ul>').format(_TITLE["alarms"], alarms) if alarms else "",
            *map(_of_structure, structures),
            Markup('<h3>Where the model error comes from</h3><ul class="findings">{}</ul>').format(rows)
            if rows
            else "",
        ]
    )


def _causes(structures: Sequence[EstimatedStructure]) -> list[Markup]:
    """Return a sentence for each cause of a ± with model error, with the parameters and the structures in which it is the cause."""
    labels = {row.name: row.label for one in structures for row in one.values if row.label}
    causes: dict[Finding, dict[tuple[str, ...], list[str]]] = {}
    for one in structures:
        for finding in one.findings:
            causes.setdefault(replace(finding, subject=()), {}).setdefault(finding.subject, []).append(one.label)
    findings = []
    for cause, whose in causes.items():
        parts = [f"{listed(names)} in {listed(list(dict.fromkeys(inside)))}" for names, inside in whose.items()]
        findings.append(replace(cause, subject=("; ".join(parts),)))
    return [sentence_about(sentence(one), {}, labels) for one in findings]


def _of_structure(one: EstimatedStructure) -> Markup:
    wider = any(row.wider is not None for row in one.values)
    cells = [
        [
            _named(row.label, row.name),
            with_sd(row.mean, row.sd),
            *([_wider(row.wider, row.cause)] if wider else []),
            unit_html(row.unit),
        ]
        for row in one.values
    ]
    head = ["parameter", _WITHIN, *([_WITH_ERROR] if wider else []), "unit"]
    return table(head, cells, f"Parameters of {one.label}: {' '.join(one.terms)}", stacks=True)


def of_mode(mode: StoredMode, shown: Shown) -> EstimatedStructure:
    """Return the stored posterior mode of the most probable structure, in the units in which its parameters are `shown`."""
    values = []
    for name, (value, sd) in mode.found.items():
        factor, unit = shown(name, mode.units.get(name, ""))
        wider, cause = mode.wider.get(name, (None, ""))
        more = None if wider is None else factor * wider
        label = CoefficientName.parse(name).label if name in mode.terms else ""
        values.append(EstimatedValue(name, label, unit, factor * value, factor * sd, more, cause))
    return EstimatedStructure("the most probable structure", mode.terms, tuple(values))


def _wider(sd: float | None, cause: str) -> str | Markup:
    return "" if sd is None else Markup("± {} <small>{}</small>").format(short(sd), cause)


def interval(row: StoredCoefficient) -> str:
    """The 95 % interval, with the digits and the power of ten of the mean: `(5.87 to 6.30) × 10⁻⁴`."""
    digits = Digits.of(row.mean, row.sd)
    ends = f"{digits.bare(row.lower_95)} to {digits.bare(row.upper_95)}"
    return f"({ends}){times_ten(digits.exponent)}" if digits.exponent else ends


async def _currency(context: AppContext, campaign: str, folder: Path) -> None:
    """Say so where the results no longer belong to the campaign file, or where others are being made."""

    def build(steps: Any) -> None:
        # The design of the first trial is not made again once the trial was run, and no result depends on it.
        told = [one for one in steps if one.name not in ("report", "design")]
        old, missing = ([one.name for one in told if one.state == state] for state in ("stale", "missing"))
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

    async def show() -> None:
        await fill(ui.element("div"), context.steps(folder), build, "looking whether these results are current …")

    def seen() -> Any:
        return change_of(folder), context.look(folder).running

    await keep_current(ui.element("div"), seen, show)


async def _fits(context: AppContext, store: Store) -> None:
    path = store.predictions
    if not path.is_file():
        markup("<p>No predictions yet.</p>")
        return
    holder = ui.element("div")

    def build(predictions: Predictions) -> Any:
        rows = [
            [
                fit.record + (" (held back)" if fit.held_back else ""),
                fit.channel,
                Markup('<span class="verdict {}">{}</span>').format(fit.level, fit.level),
                typeset(explained_text(fit.explained)) if not fit.missing else "",
                percent(fit.coverage) if fit.samples else "",
                fit.finding,
            ]
            for fit in predictions.fits
        ] + [
            [
                "held-back runs together",
                one.channel,
                Markup('<span class="verdict {}">{}</span>').format(one.level, one.level),
                typeset(explained_text(one.explained, one.runs)),
                percent(one.coverage) if one.effective else "",
                statement(one.verdict),
            ]
            for one in predictions.pooled
        ]
        head = ["run", "channel", "verdict", "explained", "inside 90 % band", "why"]
        markup(table(head, rows, "How well each record is predicted", stacks=True))
        pictures = ui.element("div")
        curves = {
            (i, j): f"run {record}, {channel}{' (held back)' if record in predictions.held_back else ''}"
            for i, record in enumerate(predictions.records)
            for j, channel in enumerate(predictions.channels)
        }

        async def show(at: tuple[int, int]) -> None:
            pictures.clear()
            asked = context.worker_pool.predict("fit_about", path, *at, files=[path])
            await fill(pictures, asked, lambda about: fit_charts(context, path, *at, about), "reading …")

        if len(curves) > 1:
            names = {f"{i}/{j}": words for (i, j), words in curves.items()}
            form = ui.select(names, value="0/0", label="Record and channel").props(LOOK).classes("wide")
            form.move(target_index=1)

            async def changed() -> None:
                i, _, j = str(form.value).partition("/")
                await show((int(i), int(j)))

            form.on_value_change(changed)
        return show((0, 0))

    await fill(holder, context.worker_pool.predict("predicted", path, files=[path]), build)


async def _posteriors(
    context: AppContext, folder: Path, summary: Summary, truth: tuple[tuple[str, float], ...]
) -> None:
    """Draw the posterior of every parameter of the chosen structure, and if wanted those of the other candidates over it."""
    store, terms = Store(folder), {one.label: " ".join(one.terms) for one in summary.structures}
    ranked = sorted(summary.structures, key=lambda one: (one.label != summary.chosen, -one.probability))
    paths = tuple((one.label, store.posterior(one.label)) for one in ranked if store.posterior(one.label).is_file())
    candidates = paths[:CANDIDATES]
    over = ui.checkbox("Other candidate structures over them") if len(candidates) > 1 else None
    named = markup("")
    holder = ui.element("div").classes("figures small")

    def draw(marginals: tuple[Marginal, ...]) -> None:
        for one in marginals:
            with ui.element("figure"):
                markup(Markup("<figcaption>{} <small>{}</small></figcaption>").format(label_html(one.label), one.name))
                marginal_chart(one)

    async def show() -> None:
        holder.clear()
        wanted = candidates if over is not None and over.value else candidates[:1]
        files = [path for _, path in wanted]
        words = Markup("; ").join(f"{label}: {terms[label]}" for label, _ in wanted)
        named.set_content(Markup('<p class="note">{}</p>').format(words) if wanted[1:] else "")
        asked = context.worker_pool.draw("marginals", wanted, truth, written_units(folder), files=files)
        await fill(holder, asked, draw)

    if over is not None:
        over.on_value_change(show)
    await show()


def by_origin(chosen: Selection, summary: Summary) -> dict[str, list[str]]:
    """Optional terms, the most probable first, by what their probability comes from: simulated structures differ in them, or not."""
    ranked = sorted(chosen.inclusion, key=lambda term: -chosen.inclusion[term])
    counts = {term: sum(term in one.terms for one in summary.structures) for term in ranked}
    differ = [term for term in ranked if 0 < counts[term] < len(summary.structures)]
    origins = {
        "Probability that the vehicle needs each term, by the simulated structures": differ,
        "Likewise by the screening alone: the simulated structures do not differ in these terms": [
            term for term in ranked if term not in differ
        ],
    }
    return {title: terms for title, terms in origins.items() if terms}


async def _truth(context: AppContext, folder: Path) -> tuple[tuple[str, float], ...]:
    """True values of a simulated vehicle, as the campaign file has them."""
    from seatrial.campaign.config.toml import toml_content
    from seatrial.cli.campaign_text import read_file

    try:
        content = toml_content(folder, read_file(folder))
        return tuple((str(k), float(v)) for k, v in content.get("truth", {}).items()) if "import" not in content else ()
    except (SeatrialError, OSError, ValueError, TypeError, AttributeError):
        return ()


def _models(store: Store, summary: Summary) -> None:
    names, labels = names_and_labels(summary)
    ranked = sorted(summary.structures, key=lambda one: (-one.probability, -one.log_evidence))
    if len(ranked) > 1:
        with ui.element("div").classes("figures"):
            bars = [Probability(names[one.label], one.probability, one.probability_error) for one in ranked[:MOST]]
            with ui.element("figure"):
                probability_chart(bars, "Probability of each model, with one standard error")
                markup("<figcaption>Probability of each model, with one standard error.</figcaption>")
            try:
                chosen = Results(store.folder).selection()
            except (SeatrialError, OSError):
                chosen = None
            if chosen is not None:
                for title, terms in by_origin(chosen, summary).items():
                    bars = [Probability(term, chosen.inclusion[term], chosen.inclusion_error[term]) for term in terms]
                    with ui.element("figure"):
                        probability_chart(bars, title)
                        markup(Markup("<figcaption>{}.</figcaption>").format(title))
    rows = [
        [
            name_html(names[one.label], labels) + (" (chosen)" if one.label == summary.chosen else ""),
            f"{one.label}: {' '.join(one.terms)}",
            probability(one.probability, one.probability_error),
            f"{one.log_evidence:.2f} ± {max(one.log_evidence_error, 0.01):.2f}",
            sentence_about(one.status, names, labels) if one.status else "",
        ]
        for one in ranked
    ]
    markup(table(["model", "terms", "probability", "log evidence", "note"], rows, "Models", left=2, stacks=True))
