"""Run the notebooks and the gallery, and write what their code shows into the pages: `python docs/notebooks.py [PAGE ...]`.

A notebook is a page of Markdown in `docs/notebooks`; its Python blocks are cells. What a cell prints, the value of its last line and
the figures that it leaves open stand below it, between two comments. The cells of a page share one namespace and one empty folder.
`--check` writes nothing and compares text loosely: numbers may differ, four lines in five must be there. `--ipynb FOLDER` writes the
cells as Jupyter notebooks.
"""

import argparse
import ast
import contextlib
import io
import json
import os
import re
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
from block_work import LEAST_SHARE, _share_found

DOCS = Path(__file__).parent
NOTEBOOKS = DOCS / "notebooks"
BEGIN, END = "<!-- shown by the code above -->", "<!-- end -->"
DOTS_PER_INCH, COLOURS = 110, 48
"""Of pictures, which are small files with few colours."""


@dataclass
class Cell:
    """A piece of a page: prose, or code with what stands below it."""

    is_code: bool
    lines: list[str] = field(default_factory=list)
    shown: list[str] = field(default_factory=list)


def read_cells(page: Path) -> list[Cell]:
    """Split a page into prose and code."""
    cells, inside = [Cell(False)], ""
    for line in page.read_text(encoding="utf-8").splitlines():
        if inside == "shown":
            inside = "" if line == END else inside
            cells[-2].shown += [line] if inside else []
        elif inside == "code":
            if line == "```":
                inside = ""
                cells.append(Cell(False))
            else:
                cells[-1].lines.append(line)
        elif line == "```python":
            inside = "code"
            cells.append(Cell(True))
        elif line == BEGIN:
            inside = "shown"
            cells[-1].lines.clear()  # the empty line between
        else:
            cells[-1].lines.append(line)
    return cells


def run_cell(cell: Cell, namespace: dict[str, Any], pictures: Path) -> list[str]:
    """Run a cell, and return what it shows, as lines of Markdown.

    Args:
        cell: code.
        namespace: of the page.
        pictures: where its first figure is saved, without a suffix; others get a letter more.
    """
    tree, printed = ast.parse("\n".join(cell.lines)), io.StringIO()
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    value = None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), namespace)
    parts = [["```text", *printed.getvalue().rstrip().splitlines(), "```"]] if printed.getvalue().strip() else []
    if hasattr(value, "_repr_html_"):
        parts.append(_html(value).splitlines())
    return [line for part in [*parts, *_figures(pictures)] for line in ["", *part]][1:]


def _html(value: Any) -> str:
    """Return a value as a notebook shows it, a row to a line; of a plain table its numbers with four digits."""
    whole = hasattr(value, "to_html")
    text = value.to_html(float_format="{:.4g}".format, border=0, na_rep="–") if whole else value._repr_html_()
    return re.sub(r"(<tr|</table>|<li>)", r"\n\1", re.sub(r">\s+<", "><", text))


def _figures(place: Path) -> list[list[str]]:
    """Save the figures that are open, close them, and return a line for each."""
    from matplotlib import pyplot
    from PIL import Image

    lines = []
    for number in pyplot.get_fignums():
        path = place.with_name(f"{place.name}{chr(ord('a') + len(lines))}.png")
        stream = io.BytesIO()
        pyplot.figure(number).savefig(stream, dpi=DOTS_PER_INCH)
        Image.open(stream).convert("RGB").quantize(COLOURS).save(path, optimize=True)
        lines.append([f"![]({path.name})"])
    pyplot.close("all")
    return lines


def run_page(page: Path, pictures: Path) -> tuple[str, list[str]]:
    """Run a page; returns its text with what is shown now, and the lines of cells that show something else."""
    from matplotlib import pyplot

    pyplot.close("all")  # what was drawn before is not the page's
    cells, namespace, changed = read_cells(page), {"__name__": "__main__"}, []
    text: list[str] = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for number, cell in enumerate(cells):
            if not cell.is_code:
                text += cell.lines
                continue
            shown = run_cell(cell, namespace, pictures / f"{page.stem}-{number}")
            same = _share_found(tuple(cell.shown), shown) >= LEAST_SHARE if cell.shown else not shown
            if not same:
                changed.append(f"{page.name}: `{cell.lines[0]}` ... shows something else now\n" + "\n".join(shown))
            text += ["```python", *cell.lines, "```", *(["", BEGIN, *shown, END] if shown else [])]
    return "\n".join(text) + "\n", changed


def as_ipynb(page: Path) -> str:
    """Return the cells of a page as a Jupyter notebook without outputs."""
    cells = []
    for cell in read_cells(page):
        source = "\n".join(cell.lines).strip("\n")
        if source:
            own = {"execution_count": None, "outputs": []} if cell.is_code else {}
            kind = "code" if cell.is_code else "markdown"
            cells.append({"cell_type": kind, "id": f"{len(cells)}", "metadata": {}, "source": source, **own})
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}, indent=1) + "\n"


def main() -> None:
    """Run pages, and write them or compare."""
    parser = argparse.ArgumentParser(description="Run the notebooks and the gallery.")
    parser.add_argument("pages", nargs="*", type=Path, help="pages; all if none")
    parser.add_argument(
        "--check", action="store_true", help="write nothing; end with 1 where a page shows something else"
    )
    parser.add_argument("--ipynb", type=Path, metavar="FOLDER", help="write Jupyter notebooks there, and run nothing")
    options = parser.parse_args()
    pages = [page.resolve() for page in options.pages] or sorted(set(NOTEBOOKS.glob("*.md")) - {NOTEBOOKS / "index.md"})
    if options.ipynb:
        options.ipynb.mkdir(parents=True, exist_ok=True)
        for page in pages:
            (options.ipynb / f"{page.stem}.ipynb").write_text(as_ipynb(page), encoding="utf-8")
        return
    mpl.use("agg")
    failed = []
    with tempfile.TemporaryDirectory() as aside:
        for page in pages:
            begun = time.monotonic()
            text, changed = run_page(page, Path(aside) if options.check else page.parent)
            print(f"{time.monotonic() - begun:6.1f} s  {page.relative_to(DOCS)}", flush=True)
            failed += changed
            if not options.check:
                page.write_text(text, encoding="utf-8")
    for said in failed if options.check else ():
        print(f"FAILED {said}")
    sys.exit(bool(failed and options.check))


if __name__ == "__main__":
    os.environ.setdefault("COLUMNS", "120")
    main()
