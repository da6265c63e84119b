"""A Matplotlib figure as SVG that stands inside a page: text stays text, colours follow the page, ids are its own.

The same figure gives the same bytes, whatever else is on the page and whenever it is drawn.
"""

import io
import re
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from seatrial.report.figures.style import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ID = re.compile(r'\sid="([^"]*)"')
_REFERENCE = re.compile(r'(?:url\(#|href="#)([^)"]*)')
_TAG = re.compile(r"<[^>]*>")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_FONT = re.compile(r"'DejaVu Sans'[^;\"]*")
_VARIABLE = {light: f"var(--{name})" for name, (light, _) in PALETTE.items()}
_COLOUR = re.compile("|".join(_VARIABLE))
_STYLE = re.compile(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
"""Matplotlib's style sheet would apply to the whole page; the page has its own."""


def inline_svg(figure: "Figure", name: str, title: str, description: str = "") -> Markup:
    """Draw a figure as an inline SVG element.

    Args:
        figure: figure whose colours come from the palette.
        name: unique on the page, letters, digits and hyphens: prefix of every id.
        title: what the figure is, for those who cannot see it.
        description: what it shows, likewise.
    """
    return inlined(draw_svg(figure, name), name, title, description)


def inlined(text: str, name: str, title: str, description: str = "") -> Markup:
    """Make an inline element of a whole SVG file that `draw_svg` drew; see `inline_svg`."""
    head, body = text[text.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="([^"]*)"', head)
    assert box is not None
    body = _STYLE.sub("", body)
    body = _COLOUR.sub(lambda match: _VARIABLE[match[0]], _FONT.sub("var(--figure-font)", body))
    described = f'<title id="{name}-title">{escape(title)}</title>'
    described += f'<desc id="{name}-desc">{escape(description)}</desc>' if description else ""
    labelled = f"{name}-title {name}-desc" if description else f"{name}-title"
    return Markup(
        f'<svg viewBox="{box[1]}" role="img" aria-labelledby="{labelled}" focusable="false">{described}{_own_ids(body, name)}'
    )


def axes_box(figure: "Figure") -> tuple[float, float, float, float]:
    """Left, top, right and bottom of all axes of a figure, as shares of its width and height from the upper left corner."""
    places = [axes.get_position() for axes in figure.axes]
    return places[0].x0, 1 - places[0].y1, places[0].x1, 1 - min(place.y0 for place in places)


def draw_svg(figure: "Figure", salt: str = "seatrial") -> str:
    """Draw a figure as a whole SVG file, in the light palette, without date or other accidents, coordinates to 0.01 point."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt, "path.simplify": True}):
        figure.savefig(
            stream,
            format="svg",
            transparent=True,
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        )
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", stream.getvalue(), flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", _TAG.sub(lambda tag: _NUMBER.sub(_round, tag[0]), text))


def _own_ids(body: str, name: str) -> str:
    """Prefix the ids that something refers to and drop the others."""
    used = set(_REFERENCE.findall(body))
    body = _ID.sub(lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "", body)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", body)


def _round(number: re.Match) -> str:
    text = f"{float(number[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
