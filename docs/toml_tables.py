"""TOML fragments of a page laid over a whole campaign file, and written out again."""

import tomllib
from collections.abc import Collection
from typing import Any


def laid_over(base: str, fragment: str, left_out: Collection[str] = ()) -> str:
    """The campaign file with the fragment's keys in place of its own, some tables left out; a prior is replaced as a whole."""
    kept = {key: table for key, table in tomllib.loads(base).items() if key not in left_out}
    return _written(_merged(kept, tomllib.loads(fragment), ()))


def _merged(old: dict[str, Any], new: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    found = dict(old)
    for key, value in new.items():
        both = isinstance(value, dict) and isinstance(found.get(key), dict) and path != ("prior",)
        found[key] = _merged(found[key], value, (*path, key)) if both else value
    return found


def _written(tables: dict[str, Any]) -> str:
    return "".join(f"[{key}]\n{_body(value)}" if isinstance(value, dict) else "" for key, value in tables.items())


def _body(table: dict[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _value(value: Any) -> str:
    """One value on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return _key(value) if isinstance(value, str) else repr(value)


def _key(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
