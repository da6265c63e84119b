"""Change one key of a TOML file and leave everything else as its author wrote it: comments, order, spaces.

The text is edited line by line; then old and new text are parsed and must differ in that key alone. What this little editor does not
understand (a table written inline over several lines, say) is refused rather than guessed.
"""

import copy
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import InputError

_HEADER = re.compile(r"^\s*\[(?!\[)\s*([^\]]+?)\s*\]\s*(#.*)?$")
_ANY_HEADER = re.compile(r"^\s*\[")
_STRING = r"\"(?:[^\"\\\n]|\\.)*\"|'[^'\n]*'"
_VALUE = rf"(?:{_STRING}|[^\s,#{{}}\[\]\"']+)"


def set_key(text: str, table: str, key: str, value: str | float | bool | None, where: str = "the file") -> str:
    """Set a key of a table, or remove it.

    Args:
        text: of the file.
        table: its name, such as `limits.n`; made at the end of the file where it is missing.
        key: bare key.
        value: string, number or truth value; None removes the key.
        where: file, for errors.

    Raises:
        InputError: text that is not TOML, or that writes the key in a way that cannot be edited line by line.
    """
    before = toml_content(where, text)
    wanted = copy.deepcopy(before)
    there = _put(wanted, table.split("."), key, value)
    if there and _exact(wanted) == _exact(before):
        return text
    for candidate in (_inline(text, table, key, value), _in_table(text, table, key, value)):
        if there and candidate is not None and _same(candidate, wanted):
            return candidate
    raise InputError(
        f"{where}, key {table}.{key}",
        found="a key that is written in a way that cannot be edited line by line",
        expected=f"a line `{key} = …` under [{table}]",
        remedy="edit the file in a text editor",
    )


def comment_out(text: str, table: str) -> str:
    """Turn a table, and tables below it, into comments; the rest stays as it is."""
    lines, inside = [], False
    for line in text.splitlines(keepends=True):
        if _ANY_HEADER.match(line):
            name = line.strip().split("#")[0].strip().strip("[]").strip()
            inside = name == table or name.startswith(f"{table}.")
        lines.append(f"# {line}" if inside and line.strip() and not line.lstrip().startswith("#") else line)
    return "".join(lines)


def written(value: str | float | bool) -> str:
    """A value as TOML writes it: JSON's escapes are among TOML's."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _in_table(text: str, table: str, key: str, value: str | float | bool | None) -> str | None:
    """Edit the line of the key under its header, or add one below the last line of the table, or add the table."""
    lines = text.splitlines(keepends=True)
    ending = "\r\n" if "\r\n" in text else "\n"
    start = next((i for i, line in enumerate(lines) if (m := _HEADER.match(line)) and m[1] == table), None)
    if start is None:
        if value is None:
            return None
        gap = "" if not text or text.endswith("\n") else ending
        return f"{text}{gap}{ending}[{table}]{ending}{key} = {written(value)}{ending}"
    end = next((i for i in range(start + 1, len(lines)) if _ANY_HEADER.match(lines[i])), len(lines))
    line = re.compile(rf"^(\s*{re.escape(key)}\s*=\s*){_VALUE}(\s*(?:#.*)?\r?\n?)$")
    for i in range(start + 1, end):
        if match := line.match(lines[i]):
            lines[i : i + 1] = [] if value is None else [f"{match[1]}{written(value)}{match[2]}"]
            return "".join(lines)
    if value is None:
        return None
    last = max(
        i for i in range(start, end) if i == start or (lines[i].strip() and not lines[i].lstrip().startswith("#"))
    )
    if not lines[last].endswith("\n"):
        lines[last] += ending
    lines.insert(last + 1, f"{key} = {written(value)}{ending}")
    return "".join(lines)


def _inline(text: str, table: str, key: str, value: str | float | bool | None) -> str | None:
    """Edit a key of an inline table of one line: `amplitude = { from = "100 rpm", to = "200 rpm", points = 20 }`."""
    parent, _, name = table.rpartition(".")
    if value is None or not parent:
        return None
    here, lines = "", text.splitlines(keepends=True)
    line = re.compile(rf"^\s*{re.escape(name)}\s*=\s*\{{.*\}}\s*(#.*)?\r?\n?$")
    pair = re.compile(rf"((?:[{{,])\s*{re.escape(key)}\s*=\s*){_VALUE}")
    for i, one in enumerate(lines):
        if header := _HEADER.match(one):
            here = header[1]
        elif here == parent and line.match(one):
            changed, count = pair.subn(lambda found: f"{found[1]}{written(value)}", one, count=1)
            if count:
                lines[i] = changed
                return "".join(lines)
    return None


def _put(content: dict[str, Any], path: Sequence[str], key: str, value: Any) -> bool:
    """Put a value into parsed content; False where something else than a table is in its way."""
    place: Any = content
    for name in path:
        if not isinstance(place, dict):
            return False
        if value is None and name not in place:
            return True
        place = place.setdefault(name, {})
    if not isinstance(place, dict):
        return False
    if value is None:
        place.pop(key, None)
    else:
        place[key] = value
    return True


def _same(text: str, wanted: Mapping[str, Any]) -> bool:
    try:
        found = toml_content("", text)
    except InputError:
        return False
    return _exact(found) == _exact(wanted)


def _exact(content: Any) -> str:
    """Content as text that also tells 1 from 1.0 and NaN from NaN."""
    return json.dumps(content, sort_keys=True, default=repr)
