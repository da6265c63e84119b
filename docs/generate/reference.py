"""Writes the generated pages of the reference; a page that is already as it should be is left alone."""

from collections.abc import Callable
from pathlib import Path

from generate import campaign_file, coefficients, command_line, result_schema, results

PAGES: dict[str, Callable[[], str]] = {
    "command_line": command_line.page,
    "campaign_file": campaign_file.page,
    "coefficients": coefficients.page,
    "results": results.page,
    "json": result_schema.page,
}
"""By file name, how each is made."""


def write_pages(folder: Path) -> None:
    """Write every generated page into a folder."""
    for name, make in PAGES.items():
        path, text = folder / f"{name}.md", make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
