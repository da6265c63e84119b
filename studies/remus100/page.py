"""The page of the study, and its figures as files: every item with its verdict, in the order of the paper."""

import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from markupsafe import Markup

from seatrial.core.coefficients import CoefficientName
from seatrial.core.files import atomic_path, write_text
from seatrial.numerics.sigma_points import UnscentedRule
from seatrial.report.drawing import Drawing, draw_svg, inlined
from seatrial.report.figures.style import POINT, own_settings
from seatrial.report.html import render_html
from seatrial.report.labels import name_html, sentence_html
from seatrial.report.numbers import plain, rounded, times_ten, typeset
from studies.remus100.designs import ACTIVE as WINDOWS
from studies.remus100.designs import INITIAL_VARIANCE as DESIGN_VARIANCE
from studies.remus100.figures import FIGURES
from studies.remus100.filters import BOUND_SHARE, HOLD, INITIAL_VARIANCE, N_STEPS, STEP
from studies.remus100.panels import COLUMN, printed_unit
from studies.remus100.reading import NAMES, RPM, Reading
from studies.remus100.registry import ENTRIES
from studies.remus100.run import FILE_NAME
from studies.remus100.study import FULL, Item, Number, Study, Verdict
from studies.remus100.trial import ACTIVE, DURATION, PERIOD, N

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Class of the badge of each verdict.
LOOKS: dict[Verdict, str] = {
    "reproduced": "reproduced",
    "not comparable": "open",
    "contradicted": "contradicted",
}
UNITS = {"s": "s", "rpm": "rpm"}  # Units at the end of a setting's name
DIGITS, PRINTED_DIGITS = 4, 6
MAX_TABLE_ROWS = 12  # Rows from which a table of numbers is set in two
# The figure of an item, with its width: `wide` or `column`.
Drawn: TypeAlias = dict[str, tuple[Drawing, str]]
# Anchor and title of each section, by the first item that can stand in it.
SECTIONS = {
    "equations-2": ("ii", "II. Vehicle model"),
    "table-1": ("iii-filters", "III. Filters"),
    "equations-3": ("iii-design", "III. Experiment design"),
    "equations-4": ("iv-estimation", "IV. Estimation"),
    "listing-1": ("iv-selection", "IV. Model selection"),
    "iteration": ("v", "V. The two stages repeated"),
    "readings": ("units", "Readings of the units"),
}
# What each sample size counts.
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


def card(item: Item, reading: Reading) -> dict[str, Any]:
    """Return what the templates print of an item."""
    labels = labels_of(reading)
    # Long tables are halved, to stand side by side.
    rows = [_row(number, labels) for number in item.numbers]
    middle = (len(rows) + 1) // 2 if len(rows) > MAX_TABLE_ROWS else len(rows)
    return {
        "key": item.key,
        "title": name_html(typeset(item.title), labels),
        "verdict": item.verdict,
        "look": LOOKS[item.verdict],
        "because": sentence_html(item.because, labels) if item.because else Markup(""),
        "short": sentence_html(item.because.split("; ")[0], labels) if item.because else Markup(""),
        "tables": [half for half in (rows[:middle], rows[middle:]) if half],
        "has_printed": any(number.printed is not None for number in item.numbers),
        "has_error": any(number.error for number in item.numbers),
        "settings": [_setting(name, value, labels) for name, value in item.settings.items() if not _is_text(value)],
        "said": [
            (f"{name[:1].upper()}{name[1:]}", [sentence_html(text, labels) for text in value])
            for name, value in item.settings.items()
            if _is_text(value)
        ],
    }


def labels_of(reading: Reading) -> dict[str, str]:
    """Return the LaTeX label of every name that items speak of."""
    labels = {name: CoefficientName.parse(name).label for name in (*NAMES, reading.doubted, "X_udot")}
    slopes = {f"d{name}": f"d{label}" for name, label in labels.items()}
    return labels | slopes | {"sigma_u": r"\sigma_{u}", "udot": r"\dot{u}", "p_D": "p_{D}", "P_0": "P_{0}"}


def settings_rows(reading: Reading) -> list[tuple[str, Markup]]:
    """Return pairs of what is left open and how it is read, the values those that were used."""
    rule, doubted = UnscentedRule(), reading.doubted
    low, high = (plain(bound / RPM) for bound in (reading.lowest, reading.highest))
    share = f"{100 * BOUND_SHARE:g}%"
    small, large = map(plain, reading.doubted_values)
    rows = {
        "Units of T and n": f"T is printed in {printed_unit(reading, 'T_nabsn')}; trim is at {plain(reading.turns / RPM)} rpm and "
        f"{plain(reading.hull.trim['u'])} m/s",
        "Inertia": f"m - X_udot = {plain(reading.inertia)} kg, thrust deduction {plain(reading.hull.thrust_deduction)}",
        "Input of Figures 1 and 2": f"random steps of up to +-{plain(reading.steps / RPM)} rpm about trim, each held for "
        f"{plain(HOLD)} s, from trim, {plain(N_STEPS * STEP)} s at {plain(STEP)} s",
        "Noise": f"standard deviation {plain(reading.filter_noise)} m/s of u, and the same number of du/dt, for the filters; "
        f"{plain(reading.sigma)} m/s of u, which alone is measured, in Section IV",
        "P of the filters": f"variance {INITIAL_VARIANCE[1]:.0e} of the drag coefficients, as the tables have it, in Section "
        f"III's comparisons; {DESIGN_VARIANCE[1]:.0e}, as the text has it, in its designs",
        "Bounds of SRUKF-C": f"{share} of the true value to either side",
        "Sigma points": f"alpha {plain(rule.alpha)}, beta {plain(rule.beta)}, kappa {plain(rule.kappa)}",
        "Manoeuvre window": "whole doublets within "
        + ", ".join(plain(window) for window in WINDOWS.values())
        + f" s of {plain(DURATION)} s, side by side; amplitudes from {low} to {high} rpm",
        "Entropy": "of the three coefficients, without the speed; H = -E[log p], so that the gain is H(prior) - H(posterior)",
        "Trial of Section IV": f"doublets of {high} rpm and {plain(PERIOD)} s for {plain(ACTIVE)} s, {N} samples in "
        f"{plain(DURATION)} s, noise of seed 1",
        "Priors": "uniform about half the true value, 200% of it to either side; sigma_u from 0 to twice the true one",
        "Prior of the doubted term": f"in Tables IV and V as the others, with {doubted} = {small} and {large}; in Table VI, where it is "
        f"called uninformative, within +-{plain(reading.wide)} [SI]",
        "Geweke's score": "with the variance of the mean of each segment; with that of the draws, as printed, it could hardly fail",
        "Columns BF of Tables IV and V": "posterior probabilities at equal prior ones; M-0 is the model with the doubted term, M-1 "
        "the one without",
    }
    labels = labels_of(reading)
    return [(what, name_html(typeset(words), labels)) for what, words in rows.items()]


def write_paper(study: Study, items: Sequence[Item]) -> Path:
    """Write `report.html` and its figures, as SVG and PDF, in the study's folder, each file atomically; return the page's path."""
    drawings = _draw_figures(study, items)
    path = study.folder / "report.html"
    write_text(path, _render(study, items, drawings))
    return path


def _row(number: Number, labels: dict[str, str]) -> dict[str, Any]:
    value, error, exponent = rounded(number.found, number.error) if number.error else ("", "", 0)
    return {
        "name": name_html(typeset(number.name), labels),
        "printed": "" if number.printed is None else plain(number.printed, PRINTED_DIGITS),
        "found": value or plain(number.found, DIGITS),
        "error": error,
        "power": times_ten(exponent),
    }


def _is_text(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(one, str) and " " in one for one in value)


def _setting(name: str, value: Any, labels: dict[str, str]) -> Markup:
    """Write a setting as `steps 400 rpm`."""
    words, _, unit = name.rpartition("_")
    if unit not in UNITS:
        words, unit = name, ""
    if words not in labels:
        words = words.replace("_", " ")
    return Markup("{} {}").format(name_html(words, labels), name_html(f"{_value(value)} {unit}".rstrip(), labels))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return plain(value, PRINTED_DIGITS)
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_value(one)}" for key, one in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_value, value))
    return typeset(str(value))


def _render(study: Study, items: Sequence[Item], drawings: Drawn) -> str:
    sizes, possible = study.sizes, len(ENTRIES)
    cards = [card(item, study.reading) | {"drawing": drawings.get(item.key)} for item in items]
    sections = {anchor: [one for one in cards if _section(one["key"]) == anchor] for anchor, _ in SECTIONS.values()}
    titles = {anchor: title for anchor, title in SECTIONS.values() if sections[anchor]}
    counted = Counter(item.verdict for item in items)
    here, full = asdict(study.sizes), asdict(FULL)
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
            "vehicle": typeset(study.reading.title),
            "reading": study.reading.name,
            "seed": study.seed,
            "share": f"All {possible} items" if len(items) == possible else f"{len(items)} of {possible} items",
            "scope": f"{sizes.chains} chains of {sizes.burn_in} + {sizes.draws} iterations, Listing 1 over {sizes.listing_repeats} "
            f"seeds of {sizes.listing_draws} draws, filters over {sizes.filter_seeds} trials",
            "is_full": sizes == FULL,
            "counts": [
                {"words": verdict, "look": look, "count": counted[verdict]}
                for verdict, look in LOOKS.items()
                if counted[verdict]
            ],
            "sizes": [{"words": words, "here": here[name], "full": full[name]} for name, words in SIZES.items()],
            "unprinted": settings_rows(study.reading),
            "figures": [f"figures/{key}" for key in drawings],
            "numbers": FILE_NAME,
        },
    )


def _draw_figures(study: Study, items: Sequence[Item]) -> Drawn:
    """Write the figure of every item that has one, and return its inline form by the item's key."""
    drawings: Drawn = {}
    labels = labels_of(study.reading)
    for key in [one.key for one in items if one.key in FIGURES]:
        figure = FIGURES[key]
        with own_settings():
            drawn = figure.draw(study)
            svg, pdf = draw_svg(drawn, key), _draw_pdf(drawn)
        folder = study.folder / "figures"
        write_text(folder / f"{key}.svg", svg)
        with atomic_path(folder / f"{key}.pdf") as temporary:
            temporary.write_bytes(pdf)
        caption = name_html(typeset(figure.caption(study)), labels)
        inline = inlined(svg, f"drawn-{key}", figure.title, caption.striptags())
        kind = "column" if drawn.get_figwidth() <= COLUMN * POINT else "wide"
        drawings[key] = Drawing(inline, caption), kind
    return drawings


def _draw_pdf(figure: "Figure") -> bytes:
    """Draw a figure as a PDF file, in the light palette, its text embedded as TrueType, which journals accept."""
    import matplotlib

    stream = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        figure.savefig(
            stream, format="pdf", transparent=True, metadata={"CreationDate": None, "Creator": None, "Producer": None}
        )
    return stream.getvalue()


def _section(key: str) -> str:
    """Return the anchor of the section in which an item stands: the last to begin before it, or with it."""
    order = list(ENTRIES)
    return [anchor for first, (anchor, _) in SECTIONS.items() if order.index(first) <= order.index(key)][-1]
