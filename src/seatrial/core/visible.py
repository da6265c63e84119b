"""Text that anybody may have written, such as the name of a file or a column, as a terminal or a page may show it."""

import re

# Controls of a terminal, marks that turn the direction of the text around them, and bytes of a path that are no UTF-8.
_HIDDEN_CHARACTERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: str) -> str:
    r"""Return a text in which each character that a terminal would obey, or that hides others, is shown as `\u001b`.

    Line feeds and tabulators stay; within strings of JSON the result means the same.
    """
    return _HIDDEN_CHARACTERS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
