"""Words of the glossary in a page: the first use of each in a part has its meaning, for a pointer, a key or a finger."""

import re

from markupsafe import Markup, escape

from seatrial.messages.glossary import GLOSSARY

_PIECE = re.compile(r"<!--.*?-->|<(/?)([a-zA-Z][\w-]*)[^>]*>|[^<]+", re.DOTALL)
_WORD = re.compile(
    r"(?<![\w-])(?:" + "|".join(f"({word.forms})" for word in GLOSSARY.values()) + r")(?![\w-])", re.IGNORECASE
)
_SILENT = (
    "a",
    "abbr",
    "button",
    "code",
    "h1",
    "h2",
    "h3",
    "pre",
    "script",
    "select",
    "style",
    "summary",
    "svg",
    "title",
)
"""Elements whose text stays as it is: headings, small print, what can be clicked, what is quoted, and what was explained already."""


def with_meanings(html: str) -> Markup:
    """Return markup in which the first use of each word of the glossary in each section has its meaning."""
    names, met, silent, pieces = list(GLOSSARY), set[str](), "", []

    def explained(match: re.Match[str]) -> str:
        name = names[(match.lastindex or 1) - 1]
        if name in met:
            return match[0]
        met.add(name)
        meaning = escape(GLOSSARY[name].meaning)
        return f'<abbr class="word" tabindex="0" title="{name}: {meaning}">{match[0]}</abbr>'

    for piece in _PIECE.finditer(html):
        closes, tag = piece[1], (piece[2] or "").lower()
        if not tag:
            pieces.append(piece[0] if silent or piece[0].startswith("<!") else _WORD.sub(explained, piece[0]))
            continue
        if tag == "section":
            met.clear()
        if not silent and not closes and tag in _SILENT:
            silent = tag
        elif closes and tag == silent:
            silent = ""
        pieces.append(piece[0])
    return Markup("".join(pieces))
