"""A page from its template: everything that is not markup made here is escaped, and the same content gives the same bytes."""

from base64 import b64encode
from functools import cache
from hashlib import sha256
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from seatrial import __version__
from seatrial.core.visible import visible
from seatrial.report.figures.style import PALETTE
from seatrial.report.glossary import with_meanings
from seatrial.report.numbers import with_percent_signs_kept


def render_html(template: str, script: str = "", **content: Any) -> str:
    """Fill a template; the palette and the version are known to all.

    Args:
        template: file name.
        script: template of the only script that the page may run, which it names by its hash; none by default.
        content: what the template prints.
    """
    environment = _environment()
    code = environment.get_template(script).render() if script else ""
    allowed = f"script-src 'sha256-{b64encode(sha256(code.encode()).digest()).decode()}'; " if code else ""
    about = {"palette": PALETTE, "version": __version__, "script": Markup(code), "allowed": Markup(allowed)}
    html = environment.get_template(template).render(**about, **content)
    return visible(with_percent_signs_kept(html))


@cache
def _environment() -> Environment:
    """Templates, each compiled once for all pages of a process."""
    environment = Environment(
        loader=PackageLoader("seatrial.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["with_meanings"] = with_meanings
    return environment
