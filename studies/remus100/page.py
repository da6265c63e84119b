"""The page of the study, and its figures as files: every item with its verdict, in the order of the paper."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

from seatrial.core.files import atomic_path, write_text
from seatrial.report.drawing import Drawing
from seatrial.report.figures.style import POINT, own_settings
from seatrial.report.html import render_html
from seatrial.report.labels import name_html
from seatrial.report.numbers import typeset
from seatrial.report.pdf import draw_pdf
from seatrial.report.svg import draw_svg, inlined
from studies.remus100.cards import LOOKS, card, labels_of, verdict_words
from studies.remus100.figures.panels import COLUMN
from studies.remus100.figures.registry import FIGURES, chosen_figures
from studies.remus100.items import Item
from studies.remus100.registry import ENTRIES, chosen_items
from studies.remus100.run import FILE_NAME
from studies.remus100.study import FULL, Study
from studies.remus100.unprinted import settings_rows

Drawn: TypeAlias = dict[str, list[tuple[Drawing, str]]]
"""Figures by the item they stand under, each with its width: `wide` or `column`."""
SECTIONS = {
    "equations-2": ("ii", "II. Vehicle model"),
    "table-1": ("iii-filters", "III. Filters"),
    "equations-3": ("iii-design", "III. Experiment design"),
    "equations-4": ("iv-estimation", "IV. Estimation"),
    "listing-1": ("iv-selection", "IV. Model selection"),
    "iteration": ("v", "V. The two stages repeated"),
    "readings": ("units", "Readings of the units"),
}
"""Anchor and title of each section, by the first item that can stand in it."""
SIZES = {
    "filter_seeds": "trials of Tables I and II",
    "tuning_seeds": "trials behind the remarks on P, Q and R",
    "chains": "chains in step of each Markov chain run",
    "burn_in": "iterations dropped",
    "draws": "iterations kept",
    "listing_repeats": "seeds of Listing 1",
    "listing_shared": "seeds of Listing 1 with shared draws",
    "listing_draws": "prior draws of each model for each seed",
    "data_seeds": "trials behind the probability of M-0 over its true coefficient",
    "importance_draws": "draws of importance sampling for Tables IV and V",
    "smc_particles": "particles of each of four repeats of tempered SMC; none leaves it out",
    "bridge_draws": "draws of each of 32 chains for bridge sampling",
    "nested_live": "live points of nested sampling; none leaves it out",
    "criteria_draws": "draws behind WAIC and PSIS-LOO",
}
"""What each sample size counts."""


def write_paper(study: Study, items: Sequence[Item]) -> Path:
    """Write `report.html` and its figures, as SVG and PDF, in the study's folder, each file atomically; return the page's path."""
    drawings = _draw_figures(study, items)
    path = study.folder / "report.html"
    write_text(path, _render(study, items, drawings))
    return path


def _render(study: Study, items: Sequence[Item], drawings: Drawn) -> str:
    sizes, possible = study.sizes, len(chosen_items([], study.reading.is_paper))
    cards = [card(item, study.reading) | {"drawings": drawings.get(item.key, [])} for item in items]
    sections = {anchor: [one for one in cards if _section(one["key"]) == anchor] for anchor, _ in SECTIONS.values()}
    titles = {anchor: title for anchor, title in SECTIONS.values() if sections[anchor]}
    return render_html(
        "paper.html",
        contents={
            "verdicts": "Verdicts",
            **titles,
            "unprinted": "What the paper leaves open",
            "method": "How this was computed",
        },
        cards=cards,
        sections=sections,
        study={
            "vehicle": typeset(study.reading.source.name),
            "is_paper": study.reading.is_paper,
            "reading": study.reading.name,
            "seed": study.seed,
            "share": f"All {possible} items" if len(items) == possible else f"{len(items)} of {possible} items",
            "scope": f"{sizes.chains} chains of {sizes.burn_in} + {sizes.draws} iterations, Listing 1 over {sizes.listing_repeats} "
            f"seeds of {sizes.listing_draws} draws, filters over {sizes.filter_seeds} trials",
            "is_full": sizes == FULL,
            "counts": _counts(study, items),
            "sizes": _sizes(study),
            "unprinted": settings_rows(study.reading),
            "figures": [f"figures/{key}" for key in chosen_figures(item.key for item in items)],
            "numbers": FILE_NAME,
        },
    )


def _draw_figures(study: Study, items: Sequence[Item]) -> Drawn:
    """Write every figure whose item was judged, and return its inline form by that item's key."""
    drawings: Drawn = {}
    labels = labels_of(study.reading)
    for key, item in chosen_figures(one.key for one in items).items():
        figure = FIGURES[key]
        with own_settings():
            drawn = figure.draw(study)
            svg, pdf = draw_svg(drawn, key), draw_pdf(drawn)
        folder = study.folder / "figures"
        write_text(folder / f"{key}.svg", svg)
        with atomic_path(folder / f"{key}.pdf") as temporary:
            temporary.write_bytes(pdf)
        caption = name_html(typeset(figure.caption(study)), labels)
        inline = inlined(svg, f"drawn-{key}", figure.title, caption.striptags())
        kind = "column" if drawn.get_figwidth() <= COLUMN * POINT else "wide"
        drawings.setdefault(item, []).append((Drawing(inline, caption), kind))
    return drawings


def _section(key: str) -> str:
    """Anchor of the section in which an item stands: the last to begin before it, or with it."""
    order = list(ENTRIES)
    return [anchor for first, (anchor, _) in SECTIONS.items() if order.index(first) <= order.index(key)][-1]


def _counts(study: Study, items: Sequence[Item]) -> list[dict[str, Any]]:
    """How many items have each verdict."""
    counted = Counter(item.verdict for item in items)
    return [
        {"words": verdict_words(verdict, study.reading), "look": look, "count": counted[verdict]}
        for verdict, look in LOOKS.items()
        if counted[verdict]
    ]


def _sizes(study: Study) -> list[dict[str, Any]]:
    """Sample sizes here beside those of the full study."""
    here, full = asdict(study.sizes), asdict(FULL)
    return [{"words": words, "here": here[name], "full": full[name]} for name, words in SIZES.items()]
