"""Small pieces of XML text: numbers that read back exactly, comments that cannot end early, and a root with its statement above it."""

from collections.abc import Iterable
from xml.sax.saxutils import escape

import numpy as np

XML_HEAD = '<?xml version="1.0"?>\n'


def number(value: float) -> str:
    """Return a number that reads back to the same bits; -0 is 0."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float]) -> str:
    """Return the numbers with blanks between."""
    return " ".join(number(value) for value in values)


def pose(place: Iterable[float]) -> str:
    """Return the position, and a roll, pitch and yaw of zero."""
    return numbers([*place, 0.0, 0.0, 0.0])


def comment(lines: Iterable[str]) -> str:
    """Return a comment; two hyphens in a row, which would end it, are set apart."""
    text = "\n".join(f"  {line}" for line in lines)
    while "--" in text:
        text = text.replace("--", "- -")
    return f"<!--\n{text}\n-->\n"


def text(value: str) -> str:
    """Return text or an attribute's value, escaped."""
    return escape(value, {'"': "&quot;"})


def inertia_elements(inertia: np.ndarray) -> str:
    """Return the six elements of an inertia tensor, as SDF and URDF name them."""
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    return "".join(f"<{name}>{number(inertia[at])}</{name}>" for name, at in pairs.items())


def identifier(name: str) -> str:
    """Return a name of letters, digits and underscores that begins with a letter."""
    kept = "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower())
    kept = "_".join(part for part in kept.split("_") if part)
    return kept if kept[:1].isalpha() else f"vehicle_{kept}".rstrip("_")
