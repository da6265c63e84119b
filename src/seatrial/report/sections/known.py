"""What is known about each parameter of the chosen model, what only about several together, and what would separate them."""

from typing import Any

from markupsafe import Markup

from seatrial.campaign.store.estimates import BY_ITSELF, Direction, Known
from seatrial.campaign.workflow.run import Outcome
from seatrial.report.drawing import labels_of
from seatrial.report.labels import label_html, sentence_html
from seatrial.report.numbers import DASH, decimals, rounded, short, times_ten, typeset, unit_html

VAGUE, LITTLE, STRONG = 0.5, 0.9, 0.9
"""Relative standard deviation, share of the prior's left and correlation beyond which a number is flagged."""


def section(outcome: Outcome) -> dict[str, Any]:
    """What `known.html` prints."""
    known, labels = outcome.known, labels_of(outcome)
    directions = known.directions if len(known.parameters) > 1 else ()
    return {
        "structure": known.structure,
        "rows": rows_of(known, labels),
        "directions": [_direction(item, labels) for item in directions],
        "verdict": verdict_of(known, labels),
    }


def rows_of(known: Known, labels: dict[str, str]) -> list[dict[str, Any]]:
    """One row for each parameter."""
    rows = []
    for item in known.parameters:
        value, sd, exponent = rounded(item.value, item.sd)
        rows.append(
            {
                "name": item.name,
                "label": label_html(labels.get(item.name, item.name)),
                "value": f"({value} ± {sd}){times_ten(exponent)}" if exponent else f"{value} ± {sd}",
                "unit": unit_html(item.unit),
                "known_to": typeset(item.known_to),
                "vague": item.relative > VAGUE,
                "left": f"{short(100 * item.left, 2)} %",
                "little": item.left > LITTLE,
                "correlation": decimals(item.correlation, 3) if item.partner else DASH,
                "partner": label_html(labels.get(item.partner, item.partner)) if item.partner else "",
                "strong": abs(item.correlation) > STRONG,
            }
        )
    return rows


def verdict_of(known: Known, labels: dict[str, str]) -> list[dict[str, Any]]:
    """Sentences as findings of the page; one that all is well where there are none."""
    if not known.verdict:
        return [{"kind": "finding", "text": sentence_html(BY_ITSELF, {})}]
    return [{"kind": "caution", "text": sentence_html(text, labels)} for text in known.verdict]


def _direction(item: Direction, labels: dict[str, str]) -> Markup:
    """The change of one standard error: symbols with what each changes by."""
    parts = [
        Markup('<span style="white-space: nowrap">{} {}</span>').format(
            label_html(labels.get(name, name)),
            typeset(f" {size}").strip(),
        )
        for name, size in item.parts
    ]
    return Markup(", ").join(parts)
