"""Change one key of a TOML file and leave everything else as its author wrote it: comments, order, spaces.

tomlkit edits the text; then old and new text are parsed by the standard library and must differ in that key alone.
"""

import copy
import json
import re
import tomllib
from collections.abc import Iterator, MutableMapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import InputError

_BARE = re.compile(r"[A-Za-z0-9_-]+")
Value = str | float | bool | Sequence[str] | None


class Section(NamedTuple):
    """A table as it stands in a file: its name as `dotted` writes it, empty for what is above the first, and its lines with the comments
    right above it.
    """

    name: str
    text: str


def sections_of(text: str) -> list[Section]:
    """Divide a TOML file into its tables; their texts joined are the file."""
    sections, name, lines = [], "", []
    for line in text.splitlines(keepends=True):
        if path := _path_of(line):
            above = len(lines)
            while above and lines[above - 1].lstrip().startswith("#"):
                above -= 1
            sections.append(Section(name, "".join(lines[:above])))
            name, lines = dotted(*path), lines[above:]
        lines.append(line)
    return [*sections, Section(name, "".join(lines))]


def dotted(*path: str) -> str:
    """Return the name of a table as TOML writes it, such as `import.trim."day 1"`."""
    return ".".join(one if _BARE.fullmatch(one) else json.dumps(one, ensure_ascii=False) for one in path)


def _path_of(header: str) -> list[str]:
    """Return the parts of the name of a table that a line begins; none where it begins none."""
    content: Any = {}
    if header.lstrip().startswith("["):
        with suppress(tomllib.TOMLDecodeError):
            content = tomllib.loads(header)
    path = []
    while content:
        ((name, inside),) = content.items()
        path.append(name)
        content = inside[0] if isinstance(inside, list) else inside
    return path


def set_key(text: str, table: str, key: str, value: Value, where: str = "the file") -> str:
    """Set a key of a table, or remove it.

    Args:
        text: of the file.
        table: its name as `dotted` writes it, such as `limits.n`; made at the end of the file where it is missing.
        key: bare key; a new one stands right below the last of its table, above comments that follow it.
        value: string, number, truth value or strings; None removes the key.
        where: file, for errors.

    Raises:
        InputError: text that is not TOML, or that has something else in the place of the table.
    """
    from tomlkit.exceptions import TOMLKitError

    before = toml_content(where, text)
    wanted, path = copy.deepcopy(before), _path_of(f"[{table}]")
    try:
        _put(wanted, path, key, value)
        if _exact(wanted) == _exact(before) or (value is None and not _has(before, path)):
            return text
        for edited in _edits(text, table, key, value, before):
            if text.count("\n") == text.count("\r\n") > 0:
                edited = re.sub(r"(?<!\r)\n", "\r\n", edited)
            with suppress(InputError):
                if _exact(toml_content(where, edited)) == _exact(wanted):
                    return edited
    except (TOMLKitError, TypeError, AttributeError, InputError):  # something that is no table is in its way
        pass
    raise InputError(
        f"{where}, key {table}.{key}",
        found="a key that cannot be edited where it stands",
        expected=f"a line `{key} = …` under [{table}]",
        remedy="edit the file in a text editor",
    )


def _edits(text: str, table: str, key: str, value: Value, before: Any) -> Iterator[str]:
    """Yield texts with the key set, the first wanted first; a line within a string may look like a table, so each has to be read again."""
    import tomlkit

    path, line = _path_of(f"[{table}]"), f"{key} = {written(value)}\n" if value is not None else ""
    if not _has(before, path):
        yield f"{_ended(text)}\n[{table}]\n{line}"
        return
    if not _has(before, [*path, key]):
        at = 0
        for one in sections_of(text):
            if one.name == table:
                lines = one.text.splitlines(keepends=True)
                while not lines[-1].strip() or lines[-1].lstrip().startswith("#"):
                    lines.pop()
                end = at + len("".join(lines))
                yield _ended(text[:end]) + line + text[end:]
            at += len(one.text)
    document = tomlkit.parse(text)
    _put(document, path, key, value)
    yield tomlkit.dumps(document)


def _ended(text: str) -> str:
    """Text whose last line is ended."""
    return text if not text or text.endswith("\n") else text + "\n"


def comment_out(text: str, table: str) -> str:
    """Turn a table, and tables below it, into comments; the rest stays as it is."""
    lines = []
    for one in sections_of(text):
        is_below = f"{one.name}.".startswith(f"{table}.")
        lines += [
            f"# {line}" if is_below and line.strip() and not line.lstrip().startswith("#") else line
            for line in one.text.splitlines(keepends=True)
        ]
    return "".join(lines)


def written(value: Value) -> str:
    """A value as TOML writes it."""
    import tomlkit

    return tomlkit.item(value).as_string()


def _has(content: Any, path: Sequence[str]) -> bool:
    for name in path:
        if not isinstance(content, dict) or name not in content:
            return False
        content = content[name]
    return True


def _put(content: MutableMapping[str, Any], path: Sequence[str], key: str, value: Any) -> None:
    """Put a value into parsed content, or take it out."""
    for name in path:
        content = content.setdefault(name, {})
    there = content.get(key)
    if value is None:
        content.pop(key, None)
    elif isinstance(there, list) and isinstance(value, list):  # in its place, so that comments between its lines stay
        for one in [one for one in there if one not in value]:
            there.remove(one)
        for one in [one for one in value if one not in there]:
            there.append(one)
    else:
        content[key] = value


def _exact(content: Any) -> str:
    """Content as text that also tells 1 from 1.0 and NaN from NaN."""
    return json.dumps(content, sort_keys=True, default=repr)
