"""Writes the generated pages of the reference; a page that is already as it should be is left alone."""

from collections.abc import Callable
from pathlib import Path

from generate import campaign_file, coefficients, command_line, result_schema, results

PAGES: dict[str, Callable[[], str]] = {
    "reference/command_line": command_line.page,
    "reference/campaign_file": campaign_file.page,
    "reference/coefficients": coefficients.page,
    "reference/results": results.page,
    "dev/json": result_schema.page,
}
"""By page of the docs, how each is made."""


def write_pages(folder: Path) -> None:
    """Write every generated page into the folder of the docs."""
    for name, make in PAGES.items():
        path, text = folder / f"{name}.md", make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
