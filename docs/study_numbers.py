"""Numbers of studies: each stands in docs/dev/NAME.json with the commit that made it, and its page shows tables that are made from it."""

import json
import re
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from seatrial.core.files import write_text

DEV = Path(__file__).parent / "dev"
RESULTS = "<!-- results -->"
"""Where the tables of a study begin in its page; they end with the page."""


def keep(name: str, numbers: dict[str, Any]) -> None:
    """Write the numbers of a study, with the commit of the code that made them."""
    text = json.dumps({"commit": commit(), **numbers}, indent=1)
    text = re.sub(r"\[[^][{}\"]*\]", lambda row: " ".join(row[0].split()), text)  # a row of numbers is a line
    write_text(DEV / f"{name}.json", text + "\n")


def kept(name: str) -> dict[str, Any]:
    """Return the numbers of a study."""
    return json.loads((DEV / f"{name}.json").read_text(encoding="utf-8"))


def show(name: str, tables: str) -> None:
    """Write tables into the page of a study."""
    page = DEV / f"{name}.md"
    before = page.read_text(encoding="utf-8").split(RESULTS)[0]
    write_text(page, f"{before}{RESULTS}\n\n{tables}")


@cache
def commit() -> str:
    """Return the commit of the working tree, marked if files differ from it; a study of hours calls it when it begins."""
    command = ["git", "-C", str(DEV), "describe", "--always", "--abbrev=10", "--exclude=*", "--dirty=, changed"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
