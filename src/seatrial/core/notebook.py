"""Results as notebooks show them: a heading, a table, and what a reader has to know."""

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandas import DataFrame


def result_html(heading: str, table: "DataFrame", notes: Iterable[str] = ()) -> str:
    """Return a result as HTML.

    Args:
        heading: what it is, plain text.
        table: of numbers, which are shown with four digits.
        notes: sentences below it, plain text.
    """
    shown = table.to_html(float_format="{:.4g}".format, border=0, na_rep="–")
    below = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<p><b>{escape(heading)}</b></p>{shown}" + (f"<ul>{below}</ul>" if below else "")
