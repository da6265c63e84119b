"""A TOML file against its schema: whatever is wrong is said with the file, the key, what was found and what was expected."""

import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from seatrial.core.errors import InputError, nearest

Schema = TypeVar("Schema", bound=BaseModel)

ALTERNATIVES = ("float", "str", "constrained-float", "literal['rows']")
"""What the path of an error has after a key whose value may be of several types."""
Example = Callable[[Sequence[str | int]], str]
"""What to say after a missing key, from its path: where one may be seen, or one itself."""
_HEADER = re.compile(r"^\s*\[+\s*([^\]]+?)\s*\]")


def read_toml(path: Path, schema: type[Schema], example: Example) -> Schema:
    """Read a file and validate it.

    Raises:
        InputError: not UTF-8, malformed TOML, unknown or missing key, or a value of the wrong type.
    """
    return parse_toml(path, read_text(path), schema, example)


def read_text(path: Path) -> str:
    """Read the text of a TOML file.

    Raises:
        InputError: not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(
            f"{path}, line {cause.object[: cause.start].count(10) + 1}",
            found=f"the byte 0x{cause.object[cause.start]:02x}, which is not UTF-8",
            expected="a TOML file in UTF-8",
            remedy="save the file as UTF-8",
        ) from cause


def parse_toml(path: Path, text: str, schema: type[Schema], example: Example) -> Schema:
    """Validate the text of a file, as it is or as it is to be written; errors as `read_toml`."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as cause:
        raise InputError(
            str(path), found=f"malformed TOML: {cause}", expected="a TOML file in UTF-8", remedy="mend the line named"
        ) from cause
    try:
        return schema.model_validate(content)
    except ValidationError as cause:
        raise _as_input_error(path, schema, cause, example) from None


@contextmanager
def with_lines(path: Path, text: str) -> Iterator[None]:
    """Put the line of the file before the key that an input error of the block names, where it stands on a line of its own."""
    before = f"{path}, key "
    try:
        yield
    except InputError as error:
        key = error.where.rpartition(before)[2] if error.where.startswith(before) else ""
        line = line_of(text, key.partition(":")[0]) if key else None
        if line is None:
            raise
        where = f"{path}, line {line}, key {key}"
        raise InputError(where, found=error.found, expected=error.expected, remedy=error.remedy) from error.__cause__


def line_of(text: str, key: str) -> int | None:
    """Return the line, from 1, of a dotted key or of the table that should hold it; None where no line is its own."""
    tables: dict[str, dict[str, int]] = {"": {}}
    here = tables[""]
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            here = tables.setdefault(header[1], {"": number})
        elif (name := line.partition("=")[0].strip()) and "=" in line:
            here.setdefault(name, number)
    parts = key.split(".")
    for size in range(len(parts), -1, -1):
        table = tables.get(".".join(parts[:size]), {})
        for end in range(len(parts), size, -1):
            if (line := table.get(".".join(parts[size:end]))) is not None:
                return line
        if "" in table:
            return table[""]
    return None


def _as_input_error(path: Path, schema: type[BaseModel], cause: ValidationError, example: Example) -> InputError:
    first = min(cause.errors(), key=lambda error: error["type"] != "extra_forbidden")
    location = [part for part in first["loc"] if part not in ALTERNATIVES]
    where = f"{path}, key {'.'.join(map(str, location))}"
    if first["type"] == "extra_forbidden":
        allowed = _keys_at(schema, location[:-1])
        return InputError(
            where,
            found=f'unknown key "{location[-1]}"',
            expected="one of " + ", ".join(allowed),
            remedy=nearest(str(location[-1]), allowed),
        )
    if first["type"] == "missing":
        return InputError(
            where,
            found="nothing",
            expected=f'the key "{location[-1]}"',
            remedy=f"add it; {example(location)}",
        )
    return InputError(
        where,
        found=repr(first.get("input"))[:80],
        expected="text in quotes" if first["type"] == "string_type" else first["msg"].removeprefix("Input should be "),
        remedy='quantities are strings such as "200 rpm"' if first["type"] == "string_type" else "correct the value",
    )


def _keys_at(schema: type[BaseModel], location: list[str | int]) -> list[str]:
    """Keys the schema allows at a place, following tables, lists and named sub-tables."""
    table: Any = schema
    for part in location:
        if isinstance(table, type) and issubclass(table, BaseModel):
            fields = {field.alias or name: field.annotation for name, field in table.model_fields.items()}
            table = fields[str(part)]
        else:
            table = get_args(table)[-1] if get_args(table) else table
        options = [option for option in get_args(table) if isinstance(option, type) and issubclass(option, BaseModel)]
        if len(options) == 1 and "|" in str(table):
            table = options[0]
    return [field.alias or name for name, field in table.model_fields.items()]
