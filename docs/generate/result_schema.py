"""JSON Schema of what `--json` prints, and its page, from the types of `seatrial.apps.result_shapes`.

`python docs/generate/result_schema.py` writes the schema into the package.
"""

import json
import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints, is_typeddict

from seatrial.apps import result_shapes as shapes

FILE = Path(shapes.__file__).with_name("results.schema.json")
SIMPLE = {str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}


def schema() -> dict[str, Any]:
    """Return the schema of every document; which result it has is said by its command."""
    found: dict[str, Any] = {}
    texts = {"type": "array", "items": {"type": "string"}}
    either = {
        command: {"anyOf": [_schema_of(shape, found), {"type": "null"}]} for command, shape in shapes.RESULTS.items()
    }
    properties = {
        "schema": {"const": shapes.SCHEMA},
        "seatrial": {"type": "string"},
        "command": {"enum": list(shapes.RESULTS)},
        "exit": {"type": "integer"},
        "error": {"anyOf": [_schema_of(shapes.Problem, found), {"type": "null"}]},
        "result": {},
        "files": {"type": "object", "additionalProperties": {"type": "string"}},
        "cautions": texts,
        "alarms": texts,
        "findings": {"type": "array", "items": _schema_of(shapes.Finding, found)},
    }
    cases = [
        {"if": {"properties": {"command": {"const": command}}}, "then": {"properties": {"result": result}}}
        for command, result in either.items()
    ]
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "What seatrial prints with --json"}
    return head | _object(properties, list(properties)) | {"allOf": cases, "$defs": dict(sorted(found.items()))}


def page() -> str:
    """Return the page of the documents: what they share, then the result of each command, key by key."""
    parts = [
        "# What `--json` prints",
        "",
        "Every command that has a result takes `--json`: it prints one document on standard output and nothing else. Progress,",
        "cautions and alarms still go to standard error; `--quiet` leaves the progress out. Numbers are in SI and radians, and",
        "`null` stands where there is none.",
        "",
        "| key | type | |",
        "|---|---|---|",
        f"| `schema` | integer | version of these documents, {shapes.SCHEMA}; keys may be added to it, none is renamed or removed |",
        "| `seatrial` | text | version of the program |",
        "| `command` | text | that was run |",
        "| `exit` | integer | its exit code |",
        "| `error` | Problem or null | why there is no result |",
        "| `result` | see below, or null | what was found |",
        "| `files` | texts by name | what was written |",
        "| `cautions`, `alarms` | texts | what to know before using the result, and why not to use it |",
        "| `findings` | list of Finding | cautions and alarms with their codes and values, and accepted findings |",
        "",
        "A wrong option ends with code 2 and prints no document, nor does a command that is interrupted. The JSON Schema comes with the",
        "package, as `seatrial/apps/results.schema.json`.",
        "",
    ]
    shown: set[str] = set()
    for command, shape in shapes.RESULTS.items():
        parts += [f"## {command}", ""]
        for one in _types_in(shape):
            parts += _rows(one, shown)
    parts += ["## Problem", "", *_rows(shapes.Problem, shown), "## Finding", "", *_rows(shapes.Finding, shown)]
    return "\n".join(parts)


def _rows(shape: Any, shown: set[str]) -> list[str]:
    """Return the table of a type, and below it those of the types in it that have not been shown."""
    said = " ".join((shape.__doc__ or "").split())
    if shape.__name__ in shown:
        return [
            f"As {said.split('`')[1] if '`' in said else shape.__name__}: the same keys, `{shape.__name__}` above.",
            "",
        ]
    shown.add(shape.__name__)
    hints = get_type_hints(shape)
    rows = [f"| `{key}` | {_words(kind)} |" for key, kind in hints.items()]
    parts = [f"**{shape.__name__}.** {said}", "", "| key | type |", "|---|---|", *rows, ""]
    for kind in hints.values():
        for inner in _types_in(kind):
            if inner.__name__ not in shown:
                parts += _rows(inner, shown)
    return parts


def _words(kind: Any) -> str:
    if is_typeddict(kind):
        return kind.__name__
    origin, inside = get_origin(kind), get_args(kind)
    if origin is list:
        return f"list of {_words(inside[0])}"
    if origin is dict:
        return f"{_words(inside[1])} by name"
    if origin in (Union, types.UnionType):
        return " or ".join("null" if one is type(None) else _words(one) for one in inside)
    return {str: "text", int: "integer", float: "number", bool: "true or false", object: "any value"}[kind]


def _types_in(kind: Any) -> list[Any]:
    return [kind] if is_typeddict(kind) else [inner for one in get_args(kind) for inner in _types_in(one)]


def _schema_of(kind: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    if is_typeddict(kind):
        name = kind.__name__
        if name not in definitions:
            definitions[name] = {}
            properties = {key: _schema_of(inner, definitions) for key, inner in get_type_hints(kind).items()}
            described = {"description": " ".join((kind.__doc__ or "").split())}
            definitions[name] = described | _object(properties, sorted(kind.__required_keys__))
        return {"$ref": f"#/$defs/{name}"}
    origin, inside = get_origin(kind), get_args(kind)
    if origin is list:
        return {"type": "array", "items": _schema_of(inside[0], definitions)}
    if origin is dict:
        return {"type": "object", "additionalProperties": _schema_of(inside[1], definitions)}
    if origin in (Union, types.UnionType):
        found = [_schema_of(one, definitions) for one in inside]
        if all(set(one) == {"type"} for one in found):
            return {"type": [one["type"] for one in found]}
        return {"anyOf": found}
    return {} if kind is object else {"type": SIMPLE[kind]}


def _object(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def text() -> str:
    """Return the file that the package holds."""
    return json.dumps(schema(), indent=1) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
