"""Numbers of studies: each stands in docs/dev/NAME.json with the commit that made it, and pages show tables that are made from it.

The tables of a page stand behind `<!-- results -->`, up to its end, or between `<!-- results: COMMAND -->` and `<!-- end of results -->`.
"""

import json
import re
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from seatrial.core.files import write_text

DEV = Path(__file__).parent / "dev"
RESULTS, END = "<!-- results -->", "<!-- end of results -->"


def keep(name: str, numbers: dict[str, Any]) -> None:
    """Write the numbers of a study, with the commit of the code that made them."""
    text = json.dumps({"commit": commit(), **numbers}, indent=1)
    rows = re.compile(r'\[\n[^][{}"]*]')  # of numbers alone: a line each
    text = rows.sub(lambda row: f"[{' '.join(row[0][1:-1].split())}]", text)
    write_text(DEV / f"{name}.json", text + "\n")


def kept(name: str) -> dict[str, Any]:
    """Return the numbers of a study."""
    return json.loads((DEV / f"{name}.json").read_text(encoding="utf-8"))


def show(page: str, tables: str, command: str = "") -> None:
    """Write tables into a page of docs/dev, between the marks of a command if one is given."""
    before, _, after = _parts(page, command)
    write_text(DEV / f"{page}.md", before + tables + after)


def shown(page: str, command: str = "") -> str:
    """Return the tables that a page shows."""
    return _parts(page, command)[1]


@cache
def commit() -> str:
    """Return the commit of the working tree, marked if files differ from it; a study of hours calls it when it begins."""
    command = [
        "git",
        "-C",
        str(Path(__file__).parent),
        "describe",
        "--always",
        "--abbrev=10",
        "--exclude=*",
        "--dirty=, changed",
    ]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _parts(page: str, command: str) -> tuple[str, str, str]:
    """Return the text of a page before its tables, the tables, and the text after them."""
    begin = f"<!-- results: {command} -->\n\n" if command else f"{RESULTS}\n\n"
    before, mark, rest = (DEV / f"{page}.md").read_text(encoding="utf-8").partition(begin)
    tables, *after = rest.split(f"\n{END}", 1) if command else (rest,)
    return before + (mark or begin), tables, "".join(f"\n{END}{text}" for text in after)
