"""On which line of a TOML file each key stands, which `tomllib` does not say; for errors about what it has read."""

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

_HEADER = re.compile(r"""[ \t]*\[(\[?)((?:"(?:\\.|[^"\\\n])*"|'[^'\n]*'|[^]"'\n])*)\]{1,2}""")
_TOKEN = re.compile(
    r"""(?P<text>"{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
    r"""|(?P<mark>[][{}=,\n])|(?P<word>[^\s#"'{}=,[\]]+)|(?P<gap>\#[^\n]*|[^\S\n]+)""",
    re.DOTALL,
)
_PART = re.compile(r"""\s*("(?:\\.|[^"\\\n])*"|'[^'\n]*'|[^\s."']+)\s*\.?""")


def key_place(path: Path, text: str, key: str) -> str:
    """Return file, line and key, for errors: `campaign.toml:17, key design.control`.

    Args:
        path: of the file.
        text: its content, TOML that can be read; empty where nobody knows it.
        key: with dots; `files[0].path` and `files.0.path` are the same. Where nothing stands there, the line is that of its table, or the
            last one where that is missing too.
    """
    lines, there = key_lines(text), re.sub(r"\[(\d+)\]", r".\1", key)
    while there and there not in lines:
        there = there.rpartition(".")[0]
    if not text:
        return f"{path}, key {key}"
    return f"{path}:{lines[there] if there else text.rstrip().count(chr(10)) + 1}, key {key}"


@lru_cache(maxsize=16)
def key_lines(text: str) -> Mapping[str, int]:
    """Return the line of every key and of every element of an array, by its path with dots; of a table, its first mention."""
    found: dict[str, int] = {}
    tables: dict[str, int] = {}
    brackets: list[tuple[str, int | None]] = [("", None)]
    """What is open: the path of a table, or that of an array with the number of its next element."""
    at, line, word, key = 0, 1, "", ""
    while at < len(text):
        fresh = len(brackets) == 1 and not (word or key)
        header = _HEADER.match(text, at) if fresh else None
        if header:
            name = _header(header[2], tables, is_array=bool(header[1]))
            _note(found, name, line)
            brackets[0], at = (name, None), header.end()
            continue
        token = _TOKEN.match(text, at)
        if token is None:
            break
        at, part, (path, count) = token.end(), token[0], brackets[-1]
        is_value = bool(key) or count is not None
        here = key if count is None else f"{path}.{count}"
        if token.lastgroup in ("text", "word"):
            if not is_value:
                word += part
            elif count is not None:
                _note(found, here, line)
        elif part == "=" and not is_value:
            key, word = _joined(path, *_parts(word)), ""
            _note(found, key, line)
        elif part in ("[", "{") and is_value:
            _note(found, here, line)
            brackets.append((here, 0 if part == "[" else None))
            key = ""
        elif part in ("]", "}") and len(brackets) > 1:
            brackets.pop()
            key = word = ""
        elif part == "," and count is not None:
            brackets[-1] = (path, count + 1)
        elif part == "," or (part == "\n" and count is None):
            key = word = ""
        line += part.count("\n")
    return found


def _header(written: str, tables: dict[str, int], *, is_array: bool) -> str:
    """Path of a table by its header; each table of an array has its number, counted in `tables`."""
    *above, last = _parts(written)
    path = ""
    for part in above:
        path = _joined(path, part)
        path = f"{path}.{tables[path] - 1}" if path in tables else path
    path = _joined(path, last)
    if is_array:
        tables[path] = tables.get(path, 0) + 1
        path = f"{path}.{tables[path] - 1}"
    return path


def _note(found: dict[str, int], path: str, line: int) -> None:
    """Note the line of a key, and of tables above it that no header of their own has."""
    while path:
        found.setdefault(path, line)
        path = path.rpartition(".")[0]


def _parts(written: str) -> list[str]:
    return [part[1:-1] if part[0] in "\"'" else part for part in _PART.findall(written)] or [""]


def _joined(*parts: str) -> str:
    return ".".join(part for part in parts if part)
