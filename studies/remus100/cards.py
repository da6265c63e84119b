"""What the page prints of one item: verdict with its reason, numbers, settings."""

from typing import Any

from markupsafe import Markup

from seatrial.core.coefficients import CoefficientName
from seatrial.report.labels import name_html, sentence_html
from seatrial.report.numbers import plain, rounded, times_ten, typeset
from studies.remus100.items import Item, Number, Verdict
from studies.remus100.vehicle_file import NAMES, Reading

LOOKS: dict[Verdict, str] = {
    "reproduced": "reproduced",
    "reproduced in shape": "shape",
    "differs": "differs",
    "cannot hold": "cannot",
}
"""Class of the badge of each verdict."""
ELSEWHERE: dict[Verdict, str] = {
    "reproduced": "holds",
    "reproduced in shape": "holds in shape",
    "differs": "does not hold",
    "cannot hold": "cannot hold",
}
"""Verdicts in the words for a vehicle that is not the paper's: nothing of it is printed to be reproduced."""
UNITS = {"s": "s", "rpm": "rpm"}
"""Units at the end of a setting's name."""
DIGITS, PRINTED_DIGITS = 4, 6
LONG = 12
"""Rows from which a table of numbers is set in two."""


def card(item: Item, reading: Reading) -> dict[str, Any]:
    """What the templates print of an item."""
    labels = labels_of(reading)
    return {
        "key": item.key,
        "title": name_html(typeset(item.title), labels),
        "verdict": verdict_words(item.verdict, reading),
        "look": LOOKS[item.verdict],
        "because": sentence_html(item.because, labels) if item.because else Markup(""),
        "short": sentence_html(item.because.split("; ")[0], labels) if item.because else Markup(""),
        "tables": _halves([_row(number, labels) for number in item.numbers]),
        "has_printed": any(number.printed is not None for number in item.numbers),
        "has_error": any(number.error for number in item.numbers),
        "settings": [_setting(name, value, labels) for name, value in item.settings.items() if not _is_text(value)],
        "said": [
            (f"{name[:1].upper()}{name[1:]}", [sentence_html(text, labels) for text in value])
            for name, value in item.settings.items()
            if _is_text(value)
        ],
    }


def verdict_words(verdict: Verdict, reading: Reading) -> str:
    """Verdict in the words that fit the vehicle."""
    return verdict if reading.is_paper else ELSEWHERE[verdict]


def labels_of(reading: Reading) -> dict[str, str]:
    """LaTeX label of every name that items speak of."""
    labels = {name: CoefficientName.parse(name).label for name in (*NAMES, reading.doubted, "X_udot")}
    slopes = {f"d{name}": f"d{label}" for name, label in labels.items()}
    return labels | slopes | {"sigma_u": r"\sigma_{u}", "udot": r"\dot{u}", "p_D": "p_{D}", "P_0": "P_{0}"}


def _row(number: Number, labels: dict[str, str]) -> dict[str, Any]:
    value, error, exponent = rounded(number.found, number.error) if number.error else ("", "", 0)
    return {
        "name": name_html(typeset(number.name), labels),
        "printed": "" if number.printed is None else plain(number.printed, PRINTED_DIGITS),
        "found": value or plain(number.found, DIGITS),
        "error": error,
        "power": times_ten(exponent),
    }


def _halves(rows: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Return one table, or two of about the same length; none without rows."""
    middle = (len(rows) + 1) // 2 if len(rows) > LONG else len(rows)
    return [half for half in (rows[:middle], rows[middle:]) if half]


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
