"""Count faults of style in pages, help texts and strings of the code: `python docs/style.py`, `--all` within the bounds too.

It exits with 1 if a rule has more faults than its bound. Lower a bound when a page has improved; do not raise it.
"""

import ast
import re
import sys
from collections.abc import Iterator
from typing import NamedTuple

from claims import DOCS, ROOT, claims, prose

SOURCES = ROOT / "src" / "seatrial"
OTHERS = r"docs/(?:decisions/|_build/|reference/(?:command_line|coefficients|results)\.md)"
PROGRAMS = {"targets", "trials", "equations"}
"""Folders and modules with texts of programs for simulators and vehicles."""
MOST_WORDS = 25
RULES = {
    "where": r"\bwhere\b",
    "told": r"\b(?:is|are|be|was|were|not) told\b|\btells?\b",
    "what": r"\bwhat\b(?![^.]*\?)",
    "own": r"\bof (?:its|their|your|one's|his|our) own\b(?! [a-z])",
    "in place of": r"\bin (?:its |their )?place of\b",
    "times smaller": r"\btimes (?:smaller|less|lower|narrower|shorter|too small|closer|fewer)\b",
}
"""Words that the rules of CONTRIBUTING.md replace, as patterns."""
BOUNDS = {
    "long": 38,
    "where": 15,
    "told": 0,
    "what": 23,
    "own": 0,
    "in place of": 0,
    "times smaller": 2,
}
"""Most faults of each rule; `long` counts sentences of more than `MOST_WORDS` words."""
_LINK = re.compile(r"!?\[([^]]*)\]\([^)]*\)")
_WORD = re.compile(r"[^\W_]")
_END = re.compile(r"(?<=[.!?:;])[)\"*]*\s+(?=[\"(*\[]*(?:[A-Z0-9`]|seatrial))")


class Text(NamedTuple):
    """Some words of a file, and the line where they begin."""

    file: str
    line: int
    words: str


def main() -> None:
    """Print the faults of each rule that has too many, and the count of each."""
    found = faults()
    wanted = [rule for rule in found if "--all" in sys.argv or len(found[rule]) > BOUNDS[rule]]
    for rule in wanted:
        print(*(f"{one.file}:{one.line}: {rule}: {one.words}" for one in found[rule]), sep="\n")
    print(", ".join(f"{rule}: {len(found[rule])} of at most {bound}" for rule, bound in BOUNDS.items()))
    sys.exit(any(len(found[rule]) > bound for rule, bound in BOUNDS.items()))


def faults() -> dict[str, list[Text]]:
    """Return the sentences with a fault, by rule."""
    found: dict[str, list[Text]] = {rule: [] for rule in BOUNDS}
    for text in (*page_texts(), *code_texts()):
        for sentence in sentences(text):
            if len([word for word in sentence.words.split() if _WORD.search(word)]) > MOST_WORDS:
                found["long"].append(sentence)
            for rule, pattern in RULES.items():
                found[rule] += [sentence] * len(re.findall(pattern, sentence.words, re.IGNORECASE))
    return found


def sentences(text: Text) -> Iterator[Text]:
    """Split a text into its sentences; links are their words, code and mathematics one word each."""
    plain = re.sub(r"`[^`]*`|\{[^}]*\}|\$[^$]*\$", "`x`", _LINK.sub(r"\1", text.words))
    yield from (Text(text.file, text.line, part) for part in _END.split(plain))


def page_texts() -> Iterator[Text]:
    """Yield paragraphs, list items and table cells of all pages but decisions and those that a build leaves behind."""
    for page in (*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))):
        name, begun = page.relative_to(ROOT).as_posix(), None
        if re.match(OTHERS, name):
            continue
        for number, _, line in prose(page, whole="*" in claims().get(name, {})):
            if line.startswith("|"):
                yield from (Text(name, number, cell.strip()) for cell in line.strip("|").split("|"))
            begins = not line.strip() or re.match(r"\s*(?:[-*|>]|\d+\.) |\|", line)
            if begins and begun:
                yield begun
            if begins:
                begun = None if not line.strip() or line.startswith("|") else Text(name, number, line.strip())
            else:
                begun = Text(*begun[:2], f"{begun.words} {line.strip()}") if begun else Text(name, number, line.strip())
        if begun:
            yield begun


def code_texts() -> Iterator[Text]:
    """Yield the help texts of commands and all strings but code for other programs; values in a string are a word each."""
    for path in sorted(path for path in SOURCES.rglob("*.py") if PROGRAMS.isdisjoint((path.parent.name, path.stem))):
        tree, name = ast.parse(path.read_text(encoding="utf-8")), path.relative_to(ROOT).as_posix()
        helping = [*tree.body] if path.parent.name == "commands" else []
        helping = [node for node in helping if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]
        shown = {id(node.body[0].value) for node in helping if isinstance(node.body[0], ast.Expr)}
        quiet = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)} - shown
        quiet |= {id(one) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for one in node.values}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = (part.value if isinstance(part, ast.Constant) else "x" for part in node.values)
                yield Text(name, node.lineno, " ".join("".join(map(str, parts)).split()))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in quiet:
                yield Text(name, node.lineno, " ".join(node.value.split()))


if __name__ == "__main__":
    main()
