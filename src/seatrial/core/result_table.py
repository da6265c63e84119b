"""Results as consoles and notebooks show them: a heading, a table, and what a reader has to know.

A result takes both as its own methods: `__repr__ = table_text` and `_repr_html_ = table_html`. One that is no table has a text of its own,
and `_repr_html_ = text_html`.
"""

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pandas import DataFrame


class Tabular(Protocol):
    """A result that is shown as a table."""

    @property
    def _heading(self) -> str:
        """What it is, in one line."""
        ...

    @property
    def _remarks(self) -> Sequence[str]:
        """What a reader has to know, one sentence each."""
        ...

    def summary(self) -> "DataFrame":
        """Return its numbers."""
        ...


def aligned(rows: Iterable[Sequence[str]], left: Sequence[int] = ()) -> list[str]:
    """Return rows of cells as lines, each column as wide as its widest cell; those at the places `left` begin at its left side."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    places = {place % len(widths) for place in left}
    return [
        "  ".join(
            cell.ljust(width) if place in places else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def table_text(self: Tabular) -> str:
    """Return a result as text, numbers with four digits; columns of which nothing is known are left out."""
    table = self.summary()
    known = [name for name, column in table.items() if not (column.isna() | (column == "")).all()]
    shown = table[known].to_string(float_format="{:.4g}".format, na_rep="–")
    return "\n".join([self._heading, shown, *(f"- {remark}" for remark in self._remarks)])


def table_html(self: Tabular) -> str:
    """Return a result as HTML, numbers with four digits."""
    shown = self.summary().to_html(float_format="{:.4g}".format, border=0, na_rep="–")
    below = "".join(f"<li>{escape(remark)}</li>" for remark in self._remarks)
    return f"<p><b>{escape(self._heading)}</b></p>{shown}" + (f"<ul>{below}</ul>" if below else "")


def text_html(self: object) -> str:
    """Return the text of a result as HTML, line by line as it stands."""
    return f"<pre>{escape(repr(self))}</pre>"
