"""Results as JSON, as NetCDF and as a JSON Schema, derived from their types: frozen dataclasses, read by their annotations.

In NetCDF an array is a variable, whose dimensions its annotation names: `Float[np.ndarray, "family amplitude"]`. A tuple of names that is
`Annotated` with a dimension holds the labels along it. All other fields are attributes. A result with a field `data` has its arrays there.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from math import isfinite
from typing import Annotated, Any, TypeVar, get_origin, get_type_hints

import numpy as np
from jaxtyping import AbstractArray
from pydantic import BeforeValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema

from seatrial.core.dataset import Dataset

Result = TypeVar("Result")
# Annotates an array of a result that is kept as JSON.
AS_LIST = BeforeValidator(lambda values: np.asarray(values, float))


@lru_cache(maxsize=256)
def adapter_of(kind: Any) -> TypeAdapter[Any]:
    """Return the adapter of a type, in a tuple because a dataclass takes no settings from outside."""
    return TypeAdapter(tuple[kind], config=ConfigDict(arbitrary_types_allowed=True, ser_json_inf_nan="constants"))  # pyright: ignore[reportInvalidTypeForm]


def to_plain(result: Any, kind: Any = None, stored: bool = True) -> Any:
    """Return a result as JSON has it.

    Args:
        result: a dataclass, or what is put together of them.
        kind: its type, if that is no dataclass.
        stored: whether it is read again: computed fields are left out then, and what is no number has its name instead of null.
    """
    serializer = adapter_of(kind or type(result)).serializer
    (plain,) = serializer.to_python((result,), mode="json", round_trip=stored, warnings="none", fallback=_plain)
    return _finite(plain, stored)


def from_plain(kind: type[Result], content: Any) -> Result:
    """Return the result that `to_plain` wrote; keys that the type does not have are passed over.

    Raises:
        ValueError: it lacks a field, or has one of another type.
    """
    try:
        (result,) = adapter_of(kind).validate_python((content,))
    except ValidationError as cause:
        first = cause.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc'][1:]))}: {first['msg']}") from cause
    return result


def to_dataset(result: Any) -> Dataset:
    """Return a result as a dataset."""
    kind, hints = type(result), _hints(type(result))
    body = getattr(result, "data", None) or Dataset()
    variables, coords, attrs = {}, {}, {}
    for field in fields(kind):
        hint, value = hints[field.name], getattr(result, field.name)
        if field.name == "data":
            continue
        if (dim := _labelled(hint)) is not None:
            coords[dim] = list(value)
        elif (dims := _dims(hint)) is not None:
            place = coords if dims == (field.name,) else variables
            place[field.name] = (dims, np.asarray(value), dict(field.metadata))
        elif hint is str:
            attrs[field.name] = value
        else:
            attrs[field.name] = json.dumps(to_plain(value, hint))
    for name, one in body.variables.items():
        (coords if name in body.coordinates else variables)[name] = tuple(one)
    return Dataset(variables, coords, {**body.attrs, **attrs})


def from_dataset(kind: type[Result], dataset: Dataset) -> Result:
    """Return the result that `to_dataset` wrote.

    Raises:
        KeyError: it lacks a field.
        ValueError: it has one of another type.
    """
    hints, given = _hints(kind), {}
    for field in fields(kind):  # pyright: ignore[reportArgumentType]
        hint = hints[field.name]
        if field.name == "data":
            given[field.name] = dataset
        elif (dim := _labelled(hint)) is not None:
            given[field.name] = tuple(map(str, dataset[dim].values))
        elif _dims(hint) is not None:
            given[field.name] = dataset[field.name].values
        elif hint is str:
            given[field.name] = str(dataset.attrs[field.name])
        else:
            given[field.name] = from_plain(hint, json.loads(dataset.attrs[field.name]))
    return kind(**given)


def schema_of(kinds: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the JSON Schemas of types by name, as `to_plain` writes them for others, and the definitions that they share."""
    inputs = [(name, "serialization", adapter_of(kind)) for name, kind in kinds.items()]
    schemas, shared = TypeAdapter.json_schemas(inputs, schema_generator=_Schema)  # pyright: ignore[reportArgumentType]
    return {name: schema["prefixItems"][0] for (name, _), schema in schemas.items()}, shared.get("$defs", {})


class _Schema(GenerateJsonSchema):
    """Schemas in which a number may be null, and an array is lists of numbers."""

    def float_schema(self, schema: Any) -> dict[str, Any]:
        return {"type": ["number", "null"]}

    def is_instance_schema(self, schema: Any) -> dict[str, Any]:
        described: dict[str, Any] = {"type": ["number", "null"]}
        for _ in _dims(schema["cls"]) or ():
            described = {"type": "array", "items": described}
        return described

    def get_title_from_name(self, name: str) -> str:
        return name

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


@lru_cache(maxsize=256)
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _labelled(hint: Any) -> str | None:
    return hint.__metadata__[0] if get_origin(hint) is Annotated and isinstance(hint.__metadata__[0], str) else None


def _dims(hint: Any) -> tuple[str, ...] | None:
    """Return the dimensions of an array's annotation; None of what is no array."""
    is_array = isinstance(hint, type) and issubclass(hint, AbstractArray)
    return tuple(hint.dim_str.split()) if is_array else None


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return to_plain(value) if is_dataclass(value) else str(value)


def _finite(value: Any, stored: bool) -> Any:
    """Return JSON without numbers that it does not know."""
    if isinstance(value, float) and not isfinite(value):
        return str(value) if stored else None
    if isinstance(value, dict):
        return {name: _finite(item, stored) for name, item in value.items()}
    return [_finite(item, stored) for item in value] if isinstance(value, list) else value
