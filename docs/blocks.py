"""Code blocks of Markdown pages, and the remarks that say how each is run.

A remark is an HTML comment on the line before a block, or one that holds a block that readers do not see:

    <!-- block: skip takes an hour -->          not run, and why
    <!-- block: except seatrial criteria: ... --> one command of it is not run, and why
    <!-- block: finished -->                    a campaign that it begins is the tutorial's, which has its results
    <!-- block: exit 3 -->                      the code with which its last command ends
    <!-- block: first 8 -->                     show no more than so many lines of what each command prints
    <!-- block: excerpt -->                     show only the lines that the page has already, numbers aside
    <!-- block: file demo -->                   the whole of demo/campaign.toml
    <!-- block: base examples/six_degrees -->   TOML to be checked in a copy of that campaign instead of the tutorial's
    <!-- block: without truth -->               ... and without these tables of it
    <!-- run sh ... -->                         commands that are run and not shown; `<!-- run python ... -->` likewise
"""

import re
from dataclasses import dataclass
from pathlib import Path

LANGUAGES = ("python", "console", "sh", "bash", "toml")
QUIET = ("text", "xml", "yaml", "json", "csv", "{toctree}", "{eval-rst}", "{math}", "{mermaid}")
"""Blocks in which there is nothing to run."""
_REMARK = re.compile(r"<!-- block: (\w+) ?(.*?) ?-->$")
_HIDDEN = re.compile(r"<!-- run (\w+)$")


@dataclass(frozen=True)
class Block:
    """One block: its page, the line of its first line of code (from 0), its language, its lines, and remarks by their first word."""

    page: Path
    line: int
    language: str
    lines: tuple[str, ...]
    remarks: dict[str, str]

    @property
    def where(self) -> str:
        """Page and line, for messages."""
        return f"{self.page.name}:{self.line + 1}"


def read_blocks(page: Path) -> list[Block]:
    """All blocks of a page that are run, in order; one without a language is skipped, which is told.

    Raises:
        ValueError: a block in a language that is neither run nor known to hold nothing to run.
    """
    lines, found, remarks, i = page.read_text(encoding="utf-8").splitlines(), [], {}, 0
    while i < len(lines):
        text = lines[i].strip()
        remark, hidden = _REMARK.match(text), _HIDDEN.match(text)
        if remark:
            remarks[remark[1]] = remark[2]
        elif hidden or text.startswith("```"):
            language, end = (hidden[1], "-->") if hidden else (text.strip("`").split(" ")[0], "```")
            stop = next(j for j in range(i + 1, len(lines)) if lines[j].strip() == end)
            if not language:
                remarks.setdefault("skip", "no language")
            if language in LANGUAGES or not language:
                found.append(Block(page, i + 1, language, tuple(lines[i + 1 : stop]), remarks))
            elif language not in QUIET:
                raise ValueError(f"{page.name}:{i + 1}: a block of {language}; use one of {LANGUAGES}, or text")
            i, remarks = stop, {}
        elif text:
            remarks = {}
        i += 1
    return found


def commands(block: Block) -> list[tuple[str, tuple[str, ...]]]:
    """Commands of a console, sh or bash block, each with the output that stands below it; a backslash at the end goes on below."""
    found: list[tuple[str, list[str]]] = []
    for line in block.lines:
        if found and found[-1][0].endswith("\\") and not found[-1][1]:
            found[-1] = (f"{found[-1][0]}\n{line}", [])
        elif block.language == "console" and not line.startswith("$ "):
            found[-1][1].append(line)
        elif line.strip() and not line.lstrip().startswith("#"):
            found.append((line.removeprefix("$ "), []))
    return [(command, tuple(output)) for command, output in found]
