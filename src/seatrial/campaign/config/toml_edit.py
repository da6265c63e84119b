"""Replace values and tables of a TOML file: everything else stays as its author wrote it, comments and order included.

tomlkit edits the text; then old and new text are parsed by the standard library and must differ in these places alone.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from seatrial.campaign.config.toml import toml_content
from seatrial.core.errors import InputError

Key = tuple[str, ...]  # A key below the tables that contain it, such as ("limits", "n", "upper")


def with_values(text: str, values: Mapping[Key, Any], where: str = "the file") -> str:
    """Return the text of a TOML file with other values.

    Args:
        text: of the file.
        values: by key; one that is missing is added to its table. A table or an array of tables is replaced whole. None removes the key;
            a table that is removed stays as a comment at the end of the file.
        where: file, for errors.

    Raises:
        InputError: text that is not TOML, or that has something else in the place of a table.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    wanted, edited, removed = toml_content(where, text), text, ""
    try:
        for key, value in values.items():
            before = _put(wanted, key, value)
            if _exact(before) == _exact(value):
                continue
            document = tomlkit.parse(edited)
            _replace(document, key, value)
            edited = tomlkit.dumps(document)
            if value is None and isinstance(before, dict):
                for name in reversed(key):
                    before = {name: before}
                removed += "\n" + "".join(f"# {line}\n" for line in tomlkit.dumps(before).splitlines() if line)
        edited = edited.rstrip() + "\n" + removed if removed else edited
        if text.count("\n") == text.count("\r\n") > 0:
            edited = re.sub(r"(?<!\r)\n", "\r\n", edited)
        if _exact(toml_content(where, edited)) == _exact(wanted):
            return edited
    except (TOMLKitError, TypeError, AttributeError, InputError):  # something that is no table is in its way
        pass
    raise InputError(
        f"{where}, key {'.'.join(next(iter(values), ('',)))}",
        found="a key that seatrial cannot edit",
        expected="each table under a separate header",
        remedy="edit the file in a text editor",
    )


def written_tables(name: str, tables: list[dict[str, Any]]) -> str:
    """Return an array of tables as TOML writes it; a table of tables within has a line for each."""
    import tomlkit

    first, *others = reversed(name.split("."))
    content: Any = {first: _item(tables)} if tables else {}
    for one in others:
        content = {one: content}
    return tomlkit.dumps(content)


def _put(content: Any, key: Key, value: Any) -> Any:
    """Put a value into parsed content, or take it out; returns the value before."""
    *tables, name = key
    for table in tables:
        if table not in content and value is None:
            return None
        content = content.setdefault(table, {})
    before = content.get(name)
    if value is None:
        content.pop(name, None)
    else:
        content[name] = value
    return before


def _replace(document: Any, key: Key, value: Any) -> None:
    """Put a value into a document of tomlkit, or take it out; comments that follow its table stay above what follows them."""
    from tomlkit.container import OutOfOrderTableProxy

    content, path, place = document, list(key), (document.body, 0)
    while path[0] in content:
        if isinstance(content, OutOfOrderTableProxy):  # its tables stand apart, in no common list
            _put(document, key, _item(value))
            return
        body = content.body if content is document else content.value.body
        at = next(i for i, (name, _) in enumerate(body) if name is not None and name.key == path[0])
        above = _end(body[at - 1][1]) if at else None
        place = (body, at) if at and above is None else (above, len(above)) if above is not None else place
        if len(path) == 1:
            break
        content = content[path.pop(0)]
    name = path[0]
    end, after = _end(content.get(name, content)), []
    while end and end[-1][0] is None:
        after.insert(0, end.pop())
    if value is None:
        del content[name]
        place[0][place[1] : place[1]] = after
        return
    value = _item(value)
    for part in reversed(path[1:]):
        value = {part: value}
    content[name] = value
    (_end(content[name]) or _end(content) or []).extend(after)


def _end(item: Any) -> list[Any] | None:
    """Return the list of tomlkit at the end of which the comments below a table stand; None for a value."""
    from tomlkit.container import Container
    from tomlkit.items import AoT, Table

    if isinstance(item, AoT):
        item = item.body[-1]
    if not isinstance(item, Container | Table):
        return None
    body = item.body if isinstance(item, Container) else item.value.body
    inner = _end(body[-1][1]) if body else None
    return body if inner is None else inner


def _item(value: Any) -> Any:
    """Return a value for tomlkit: an array of tables with a line for every value."""
    import tomlkit

    if not (isinstance(value, list) and value and all(isinstance(one, dict) for one in value)):
        return value
    tables = tomlkit.aot()
    for one in value:
        table = tomlkit.table()
        for name, inside in one.items():
            is_of_tables = (
                isinstance(inside, dict) and inside and all(isinstance(part, dict) for part in inside.values())
            )
            parts = {(name, key): part for key, part in inside.items()} if is_of_tables else {(name,): inside}
            for path, part in parts.items():
                table.append(tomlkit.key(path), _inline(part))
        tables.append(table)
    return tables


def _inline(value: Any) -> Any:
    """Return a value for tomlkit that stands in one line."""
    import tomlkit

    if not isinstance(value, dict):
        return value
    table = tomlkit.inline_table()
    table.update({name: _inline(inside) for name, inside in value.items()})
    return table


def _exact(content: Any) -> str:
    """Return content as text that also distinguishes 1 from 1.0 and NaN from NaN."""
    return json.dumps(content, sort_keys=True, default=repr)
