"""A page from its template: everything that is not markup made here is escaped, and the same content gives the same bytes."""

import re
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from seatrial import __version__
from seatrial.report.figures.style import PALETTE

_PERCENT = re.compile(r"(?<=\d) %")
"""A number and its percent sign stay on one line."""


def render_html(template: str, **content: Any) -> str:
    """Fill a template; the palette and the version are known to all."""
    environment = Environment(
        loader=PackageLoader("seatrial.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    html = environment.get_template(template).render(palette=PALETTE, version=__version__, **content)
    return _PERCENT.sub("\u202f%", html)
