"""The page of what `--json` prints, from its JSON Schema."""

import inspect
import re
from typing import Any

from seatrial.cli.answer import SCHEMA
from seatrial.cli.result_schema import RESULTS, schema

WORDS = {"string": "text", "integer": "integer", "number": "number", "boolean": "true or false", "null": "null"}
HEAD = f"""# Output of `--json`

Every command that has a result takes `--json`: it prints one document on standard output and nothing else. Progress,
cautions and alarms still go to standard error; `--quiet` leaves the progress out. Numbers are in SI and radians, and
a missing number is `null`.

| key | type | |
|---|---|---|
| `schema` | integer | version of these documents, {SCHEMA}; keys may be added to it, none is renamed or removed |
| `seatrial` | text | version of the program |
| `command` | text | that was run |
| `exit` | integer | its exit code |
| `error` | Problem or null | reason if there is no result |
| `result` | see below, or null | result of the command |
| `files` | texts by name | files that were written |
| `cautions`, `alarms` | texts | limits of the result, and reasons not to use it |
| `findings` | list of FindingRow | cautions and alarms with their codes and values, and accepted findings |

A wrong option ends with exit code 2 and prints no document. An interrupted command prints none either. The command
`python -m seatrial.cli.result_schema` prints the JSON Schema of the documents.
"""


def page() -> str:
    """Return the page of the documents: what they share, then the result of each command, key by key."""
    whole = schema()
    definitions, shown = whole["$defs"], set()
    parts = [HEAD]
    for case in whole["allOf"]:
        command = case["if"]["properties"]["command"]["const"]
        parts += [f"## {command}", ""]
        for name in _names_in(case["then"]):
            parts += _tables(name, definitions, shown)
    parts += ["## Problem", ""]
    for name in ("Problem", "FindingRow"):
        parts += _tables(name, definitions, shown)
    assert set(RESULTS) <= {part.removeprefix("## ") for part in parts}
    return "\n".join(parts)


def _tables(name: str, definitions: dict[str, Any], shown: set[str]) -> list[str]:
    """Return the table of a type, and below it those of the types in it that have not been shown."""
    described = definitions[name]
    text, meanings = _docstring(described.get("description", ""))
    if name in shown:
        first = text.split("`")[1] if "`" in text else name
        return [f"As {first}: the same keys, `{name}` above.", ""]
    shown.add(name)
    rows = []
    for key, kind in described.get("properties", {}).items():
        meaning = meanings.get(key) or " ".join(kind.get("description", "").split())
        rows.append(f"| `{key}` | {_words(kind)} | {meaning} |".replace("|  |", "| |"))
    parts = [f"**{name}.** {text}", "", "| key | type | |", "|---|---|---|", *rows, ""]
    for inner in _names_in(described.get("properties", {})):
        if inner not in shown:
            parts += _tables(inner, definitions, shown)
    return parts


def _docstring(text: str) -> tuple[str, dict[str, str]]:
    """Return the text of a docstring, and the meaning of each attribute."""
    head, _, attributes = inspect.cleandoc(text).partition("Attributes:\n")
    found = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", attributes, re.MULTILINE)
    return " ".join(head.split()), {name: " ".join(meaning.split()) for name, meaning in found}


def _words(kind: dict[str, Any]) -> str:
    if "$ref" in kind:
        return kind["$ref"].rsplit("/", 1)[1]
    if "enum" in kind or "const" in kind:
        return "one of " + ", ".join(f"`{one}`" for one in kind.get("enum", [kind.get("const")]))
    if "anyOf" in kind:
        return " or ".join(dict.fromkeys(_words(one) for one in kind["anyOf"]))
    types = kind.get("type", "object")
    if isinstance(types, list):
        return " or ".join(WORDS[one] for one in types if one != "null")
    if types == "array":
        inside = [*kind.get("prefixItems", ()), *([kind["items"]] if kind.get("items") else [])]
        return "list of " + (" and ".join(dict.fromkeys(map(_words, inside))) or "anything")
    if types == "object":
        values = kind.get("additionalProperties")
        return f"{_words(values)} by name" if isinstance(values, dict) and values else "anything by name"
    return WORDS[types]


def _names_in(kind: Any) -> list[str]:
    """Return the types that a schema names, in its order."""
    if isinstance(kind, dict):
        own = [kind["$ref"].rsplit("/", 1)[1]] if "$ref" in kind else []
        return list(dict.fromkeys(own + [name for value in kind.values() for name in _names_in(value)]))
    return [name for value in kind for name in _names_in(value)] if isinstance(kind, list) else []
