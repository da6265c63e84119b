"""The trial that was run, what is known after it, and the next one: how informative each design is, and what it looks like."""

from math import floor, log10
from typing import Any

import numpy as np
from markupsafe import Markup

from seatrial.campaign.data.true_vehicle import FIRST
from seatrial.campaign.design.schedule import design_words
from seatrial.campaign.design.sweep import Designs
from seatrial.campaign.store.estimates import BY_ITSELF, Direction, Known
from seatrial.campaign.workflow.next_trial import propose
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import shown_unit
from seatrial.core.record import Record
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.report.drawing import (
    Drawing,
    axes_box,
    draw,
    labels_of,
    schedule_figure,
    signal_axis,
    signal_symbol,
    units_of,
)
from seatrial.report.figures.records import covered, raw_record
from seatrial.report.figures.style import unit_label
from seatrial.report.figures.surface import design_surface
from seatrial.report.labels import label_html, sentence_html
from seatrial.report.numbers import DASH, decimals, percent, rounded, short, times_ten, typeset, unit_html, with_sd

VAGUE, LITTLE, STRONG = 0.5, 0.9, 0.9
"""Relative standard deviation, share of the prior's left and correlation beyond which a number is flagged."""
# Where each imported record begins and ends: its raw plot with two handles, and the command that would cut it there.

MOST = 500
"""Samples drawn of each channel."""
_STEPS = 500


def known_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `known.html` prints."""
    known, labels = outcome.known, labels_of(outcome)
    directions = known.directions if len(known.parameters) > 1 else ()
    return {
        "structure": known.structure,
        "rows": rows_of(known, labels),
        "directions": [_direction(item, labels) for item in directions],
        "verdict": verdict_of(known, labels),
    }


def rows_of(known: Known, labels: dict[str, str]) -> list[dict[str, Any]]:
    """Return one row for each parameter."""
    return [
        {
            "name": item.name,
            "label": label_html(labels.get(item.name, item.name)),
            "value": with_sd(item.value, item.sd),
            "unit": unit_html(item.unit),
            "known_to": typeset(item.known_to),
            "vague": item.relative > VAGUE,
            "left": f"{short(100 * item.left, 2)} %",
            "little": item.left > LITTLE,
            "correlation": decimals(item.correlation, 3) if item.partner else DASH,
            "partner": label_html(labels.get(item.partner, item.partner)) if item.partner else "",
            "strong": abs(item.correlation) > STRONG,
        }
        for item in known.parameters
    ]


def verdict_of(known: Known, labels: dict[str, str]) -> list[dict[str, Any]]:
    """Sentences as findings of the page; one that all is well where there are none."""
    if not known.verdict:
        return [{"kind": "finding", "text": sentence_html(BY_ITSELF, {})}]
    return [{"kind": "caution", "text": sentence_html(text, labels)} for text in known.verdict]


def trimmed_records(outcome: Outcome) -> list[dict[str, Any]]:
    """Return what `trimming.html` prints of each record that a log was imported to as a whole."""
    records = (*outcome.trials.fit, *outcome.trials.predict)
    return [_one(index, record) for index, record in enumerate(records) if _is_whole(record)]


def trial_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `trial.html` prints."""
    first = outcome.first
    imported = outcome.campaign.imports is not None
    return {
        "imported": imported,
        "was_run": any(record.label == FIRST for record in outcome.trials.fit),
        "records": record_rows(outcome),
        "design": None if first is None else _designed(outcome, first),
        "coverage": _coverage(outcome) if imported else [],
        "trimmed": trimmed_records(outcome) if imported else [],
    }


def next_section(outcome: Outcome) -> dict[str, Any]:
    """Return what `next.html` prints."""
    trial, proposal = outcome.summary["next_trial"], propose(outcome)
    names = list(trial["sd_before"])
    gain = trial["gain_nat"]
    return {
        "figures": sweep_drawings(outcome, outcome.next, "next"),
        "families": _families(outcome.next),
        "stop": proposal.trial is None,
        "said": [line[:1].upper() + line[1:] for line in proposal.lines],
        "best": best_words(outcome.next),
        "gain": short(gain),
        "shrinks": short(float(np.exp(gain)), 2),
        "structure": outcome.chosen.structure.label,
        "rows": _sd_rows(outcome, names, list(trial["sd_before"].values()), list(trial["sd_after"].values())),
    }


def sweep_drawings(outcome: Outcome, designs: Designs, name: str) -> list[Drawing]:
    """Surface and chosen control of the best family's sweep."""
    sweep = designs.best
    row, column = sweep.best
    control = sweep.family.control
    factor, unit = shown_unit(control)
    forbidden = int(np.isnan(sweep.gain).sum())
    caption = f"Each of {sweep.gain.size} designs, the best marked by a star"
    caption += f"; hatched: {forbidden} designs that break a limit." if forbidden else "; none breaks a limit."
    edges = [
        name
        for name, at, grid in (("amplitude", row, sweep.amplitude), ("period", column, sweep.period))
        if grid.size > 1 and at in (0, grid.size - 1)
    ]
    if edges:
        caption += (
            f" The best {' and '.join(edges)} {'lies' if len(edges) == 1 else 'lie'} on the edge of what was searched."
        )
    surface = design_surface(
        sweep.period,
        sweep.amplitude * factor,
        sweep.gain,
        sweep.best,
        (unit_label(sweep.family.shape.period_is, "s"), unit_label(f"amplitude of {signal_symbol(control)}", unit)),
    )
    schedule = schedule_of(sweep.best_manoeuvre(), sweep.family.sample_time)
    chosen = schedule_figure(schedule, outcome.campaign.limits)
    return [
        draw(
            surface,
            f"{name}-surface",
            f"Entropy reduction over period and amplitude of the {sweep.family.words}",
            caption,
            "What each design would teach",
        ),
        draw(
            chosen,
            f"{name}-input",
            "Control of the best design over time",
            f"{best_words(designs)}.",
            "The best design",
        ),
    ]


def best_words(designs: Designs) -> str:
    """Name the best design, as a sentence begins."""
    sweep = designs.best
    row, column = sweep.best
    words = design_words(sweep.family, float(sweep.amplitude[row]), float(sweep.period[column]))
    return words[:1].upper() + words[1:]


def record_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Return one row for each record: how it was used, how long it is and what it covers."""
    fitted = {record.label for record in outcome.trials.fit}
    return [
        {
            "label": record.label,
            "held_back": record.label not in fitted,
            "seconds": f"{record.time[-1] - record.time[0]:.1f}",
            "samples": record.time.size,
            "step": _step(record),
            "ranges": [(name, *_range(record, name)) for name in (*record.controls, *record.measured)],
        }
        for record in (*outcome.trials.fit, *outcome.trials.predict)
    ]


def _direction(item: Direction, labels: dict[str, str]) -> Markup:
    """Return the change of one standard error: symbols with what each changes by."""
    parts = [
        Markup('<span style="white-space: nowrap">{} {}</span>').format(
            label_html(labels.get(name, name)),
            typeset(f" {size}").strip(),
        )
        for name, size in item.parts
    ]
    return Markup(", ").join(parts)


def _is_whole(record: Record) -> bool:
    options = record.provenance.options
    return {"start", "end", "available"} <= set(options) and "piece" not in options


def _one(index: int, record: Record) -> dict[str, Any]:
    options = record.provenance.options
    begin = float(options["start"])
    time = record.time + begin
    columns = [(signal_axis(name), _shown(record, name)) for name in (*record.measured, *record.controls)]
    figure = raw_record(time, columns, len(record.measured), MOST)
    left, top, right, bottom = (100 * share for share in axes_box(figure))
    step = float(f"{(time[-1] - begin) / _STEPS:.0e}")
    return {
        "run": record.label,
        "drawing": draw(figure, f"raw-{index}", f"Record {record.label} as it is, control and every channel over time"),
        "place": f"left: {left:.2f}%; width: {right - left:.2f}%; top: {top:.2f}%; height: {bottom - top:.2f}%",
        "first": f"{begin:.6g}",
        "last": f"{time[-1]:.6g}",
        "available": f"{float(options['available']):.6g}",
        "step": f"{step:g}",
    }


def _shown(record: Record, name: str) -> np.ndarray:
    return record.channel(name) * shown_unit(name)[0]


def _designed(outcome: Outcome, first: Designs) -> dict[str, Any]:
    """Return the trial as it was designed, beside what the records gave."""
    filtered = [str(name) for name in outcome.filter["coefficient"].values]
    full = outcome.estimates[0]
    before = [float(full.data.sel(parameter=name)["prior_sd"]) for name in filtered]
    reached = [float(full.data.sel(parameter=name)["sd"]) for name in filtered]
    promised = dict(zip(first.names, first.best.final_sd[first.best.best], strict=True))
    return {
        "figures": sweep_drawings(outcome, first, "first"),
        "words": best_words(first),
        "families": _families(first),
        "structure": full.structure.label,
        "rows": _sd_rows(outcome, filtered, before, [promised[name] for name in filtered], reached),
        "promised": None if outcome.promised is None else rows_of(outcome.promised, labels_of(outcome)),
        "foreseen": [] if outcome.promised is None else verdict_of(outcome.promised, labels_of(outcome)),
    }


def _families(designs: Designs) -> list[str]:
    """Return the best of every family, where there is more than one."""
    several = len(designs.sweeps) + len(designs.refused) > 1
    return designs.lines() if several else designs.diverging()


def _step(record: Record) -> str:
    step = np.diff(record.time)
    return (
        short(float(np.median(step)))
        if np.ptp(step) <= 1e-6 * step[0]
        else f"{short(step.min())} to {short(step.max())}"
    )


def _range(record: Record, name: str) -> tuple[str, str]:
    factor, unit = shown_unit(name)
    values = record.channel(name) * factor
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    count = max(0, 2 - floor(log10(max(abs(low), abs(high), 1e-300))))
    return f"{decimals(low, count)} to {decimals(high, count)}", unit


def _coverage(outcome: Outcome) -> list[Drawing]:
    control, channel = outcome.trials.fit[0].controls[0], outcome.campaign.channels[0]
    factors = shown_unit(control)[0], shown_unit(channel)[0]
    groups = [
        [(record.channel(control) * factors[0], record.channel(channel) * factors[1]) for record in records]
        for records in (outcome.trials.fit, outcome.trials.predict)
    ]
    figure = covered(groups[0], groups[1], (signal_axis(control), signal_axis(channel)))
    return [
        draw(
            figure,
            "covered",
            f"Measured {channel} against control {control} of all records",
            "All samples of the fitted records, and of those held back. Where held-back samples lie outside the fitted ones, their "
            "prediction is extrapolation.",
            "What the records cover",
        )
    ]


def _sd_rows(
    outcome: Outcome, names: list[str], before: list[float], after: Any, reached: list[float] | None = None
) -> list[dict[str, Any]]:
    labels, units = labels_of(outcome), units_of(outcome)
    rows = []
    for index, name in enumerate(names):
        exponent = rounded(0.0, before[index])[2]
        numbers = [
            short(value * 10.0**-exponent, 2)
            for value in (before[index], after[index], *([reached[index]] if reached else []))
        ]
        rows.append(
            {
                "name": name,
                "label": label_html(labels.get(name, name)),
                "unit": Markup(times_ten(exponent).strip("× ") + " ") + unit_html(units[name])
                if exponent
                else unit_html(units[name]),
                "before": numbers[0],
                "after": numbers[1],
                "reached": numbers[2] if reached else "",
                "left": percent(after[index] / before[index]),
            }
        )
    return rows
