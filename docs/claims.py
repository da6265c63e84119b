"""Measured figures in README and docs, each with what shows it: `python docs/claims.py` lists those that nothing shows.

`claims.toml` has a table for each page: a phrase of the page, or a heading for all that stands under it, and the command, the test or the
source that its figures come from. A page that a command writes whole, or from `<!-- results -->` on, is named with that command under "*";
what stands between `<!-- results: COMMAND -->` and `<!-- end of results -->` is named there. An entry may be a table,

    "slope 0.88 ± 0.07" = { shown = "python docs/study.py", numbers = "slope {study[one arm][slope]:.2f} ± {study[one arm][error]:.2f}" }

in which `numbers` says how the phrase follows from docs/dev/study.json; a phrase that differs is an error. `{x:.0%}` is a share in per cent
with its sign, and `{x:.0p}` without it.
"""

import json
import re
import string
import sys
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent
GENERATED = ("decisions", "vehicles", "reference", "_build", "json.md", "findings.md")
"""Folders without claims of their own: choices with their numbers of the day, and pages that are written from the code."""
SHOWN_BY = ("tests/", "src/", "benchmarks/", "studies/", "make ", "python ", "seatrial ", "source: ")
"""How an entry begins: a test, the line of code that sets a limit, a command, or a reference."""
_NAMES = (
    r"[A-Za-z]\w*_\w*|Apache 2\.0|WSL 2|ISO 8601|PX4|REMUS 100|ROS \d(?: and \d)?|BlueROV2|3-2-1-1"
    r"|Python 3\.\d+ to 3\.\d+|code \d+|chapter \d+|M-\d|2B"
)
_NOT_A_FIGURE = re.compile(rf"`[^`]*`|^\$\$.*|!?\[[^]]*\]\([^)]*\)|\$[^$]*\$|\((?:19|20)\d\d\)|^\d+\. |{_NAMES}")


def main() -> None:
    """Print what is wrong, and exit with 1 if anything is."""
    wrong = [*unshown(), *broken(), *different()]
    print("\n".join(wrong) or "every figure has its command, test or source")
    sys.exit(bool(wrong))


def pages() -> list[Path]:
    """Return README and the pages of the docs that people wrote."""
    written = (page for page in sorted(DOCS.rglob("*.md")) if not set(page.relative_to(DOCS).parts) & set(GENERATED))
    return [ROOT / "README.md", *written]


def registered() -> dict[str, dict[str, Any]]:
    """Return the entries of claims.toml: page -> phrase -> what shows it, or that with the format of its numbers."""
    return tomllib.loads((DOCS / "claims.toml").read_text(encoding="utf-8"))


def claims() -> dict[str, dict[str, str]]:
    """Return what is claimed: page -> phrase -> what shows it."""
    return {
        page: {phrase: one if isinstance(one, str) else one["shown"] for phrase, one in entries.items()}
        for page, entries in registered().items()
    }


def unshown() -> list[str]:
    """Return the lines with a figure that no entry covers, each as `page:line: text`."""
    registered, found = claims(), []
    for page in pages():
        name = page.relative_to(ROOT).as_posix()
        entries = registered.get(name, {})
        for number, heading, line in prose(page, whole="*" in entries):
            covered = heading in entries or any(phrase in line for phrase in entries)
            if re.search(r"\d", _NOT_A_FIGURE.sub("", line)) and not covered:
                found.append(f"{name}:{number}: {line.strip()}")
    return found


def broken() -> list[str]:
    """Return the entries that no longer fit: a phrase that its page lacks, a test or a script that is not there."""
    found = []
    for name, entries in claims().items():
        text = (ROOT / name).read_text(encoding="utf-8") if (ROOT / name).is_file() else ""
        text = " ".join(text.split())
        for phrase, shown in entries.items():
            if phrase != "*" and phrase not in text:
                found.append(f'{name}: "{phrase}" is not on the page')
            if not shown.startswith(SHOWN_BY):
                found.append(f'{name}: "{phrase}": {shown} begins with none of {", ".join(SHOWN_BY)}')
            found += [f'{name}: "{phrase}": there is no {place}' for place in _missing(shown)]
    return found


def different() -> list[str]:
    """Return the phrases that differ from the numbers of their studies."""
    found = []
    for name, entries in registered().items():
        for phrase, entry in entries.items():
            if not isinstance(entry, str):
                try:
                    says = re.sub(r"(?<=\d)%", " %", Words().vformat(entry["numbers"], (), Studies()))
                except (LookupError, OSError, TypeError, ValueError) as error:
                    says = f"{type(error).__name__} {error}"
                found += [f'{name}: "{phrase}": its study has "{says}"'] * (says != phrase)
    return found


class Words(string.Formatter):
    """Formats as `str.format` does, and shares in per cent without a sign."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return a value in words."""
        if format_spec.endswith("p"):
            return format(100 * value, f"{format_spec[:-1]}f")
        return format(value, format_spec)


class Studies(dict):
    """Numbers of studies by name, read when asked for."""

    def __missing__(self, name: str) -> Any:
        self[name] = json.loads((DOCS / "dev" / f"{name}.json").read_text(encoding="utf-8"))
        return self[name]


def _missing(shown: str) -> list[str]:
    """Return the files and names that an entry speaks of and that are not there."""
    missing = []
    for path, name in re.findall(
        r"((?:tests|src|studies|docs|examples|benchmarks|release)/[\w./-]+\.\w+)(?:::(\w+))?", shown
    ):
        file = ROOT / path
        if not file.is_file():
            missing.append(path)
        elif name and not re.search(rf"\b{name}\b", file.read_text(encoding="utf-8")):
            missing.append(f"{path}::{name}")
    return missing


def prose(page: Path, whole: bool) -> list[tuple[int, str, str]]:
    """Return number, heading and text of the lines that people wrote, without code.

    `whole`: a command writes all after `<!-- results -->`, or the page.
    """
    lines = page.read_text(encoding="utf-8").splitlines()
    end = next((i for i, line in enumerate(lines) if line == "<!-- results -->"), 0) if whole else len(lines)
    found, inside, heading = [], "", ""
    for number, line in enumerate(lines[:end], 1):
        if inside:
            inside = "" if line.strip() == inside else inside
        elif line.lstrip().startswith("```"):
            inside = "```"
        elif line.startswith("<!-- results: "):  # and the command that writes them, up to their end
            inside = "<!-- end of results -->"
        elif line.lstrip().startswith("<!--"):
            inside = "" if "-->" in line else "-->"
        elif line.startswith("#"):
            heading = line
        else:
            found.append((number, heading, line))
    return found


if __name__ == "__main__":
    main()
