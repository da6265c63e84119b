"""A TOML file against its schema: whatever is wrong is said with the file, the key, what was found and what was expected."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from seatrial.core.errors import InputError, nearest

Schema = TypeVar("Schema", bound=BaseModel)

ALTERNATIVES = ("float", "str", "constrained-float", "literal['rows']")
"""What the path of an error has after a key whose value may be of several types."""
CAMPAIGN = "the README and `seatrial init` show an example with every table"


def read_toml(path: Path, schema: type[Schema], example: str = CAMPAIGN) -> Schema:
    """Read a file and validate it; `example` says, after a missing key, where one may be seen.

    Raises:
        InputError: not UTF-8, malformed TOML, unknown or missing key, or a value of the wrong type.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(
            f"{path}, line {cause.object[: cause.start].count(10) + 1}",
            found=f"the byte 0x{cause.object[cause.start]:02x}, which is not UTF-8",
            expected="a TOML file in UTF-8",
            remedy="save the file as UTF-8",
        ) from cause
    return parse_toml(path, text, schema, example)


def parse_toml(path: Path, text: str, schema: type[Schema], example: str = CAMPAIGN) -> Schema:
    """Text of a file, as it is or as it is to be written, against its schema; errors as `read_toml`."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as cause:
        raise InputError(
            str(path), found=f"malformed TOML: {cause}", expected="a TOML file in UTF-8", remedy="mend the line named"
        ) from cause
    return validated(path, content, schema, example)


def validated(path: Path, content: Mapping[str, Any], schema: type[Schema], example: str = CAMPAIGN) -> Schema:
    """Content of a file against its schema; errors as `read_toml`."""
    try:
        return schema.model_validate(content)
    except ValidationError as cause:
        raise _as_input_error(path, schema, cause, example) from None


def _as_input_error(path: Path, schema: type[BaseModel], cause: ValidationError, example: str) -> InputError:
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
            remedy=f"add it; {example}",
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
