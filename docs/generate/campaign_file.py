"""The page of a campaign file's keys, from the schema that reads it."""

from collections.abc import Iterator, Sequence
from math import inf
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from seatrial.campaign.config.design_table import DesignTable
from seatrial.campaign.config.quantities import Table, Unit
from seatrial.campaign.config.schema import CampaignFile
from seatrial.manoeuvres.shapes import SHAPES

INTRODUCTION = """# campaign.toml

A campaign is a folder with this file. `seatrial init DIR --template NAME` writes a commented one.
The code writes this page (`python docs/kept_reference.py`).

The shortest file that fits a log:

<!-- block: file shortest -->
```toml
[campaign]
name = "My vehicle, surge"
seed = 1

[vehicle]
name = "my vehicle"
mass = "30 kg"
fixed = { X_udot = -1.0 }
trim = { u = "1.5 m/s", n = "1000 rpm" }

[structure]
always = ["X_uabsu", "T_nabsn"]
optional = ["X_u"]

[prior]
X_u = { distribution = "uniform", lower = -20.0, upper = 0.0 }
X_uabsu = { distribution = "uniform", lower = -50.0, upper = 0.0 }
T_nabsn = { distribution = "uniform", lower = 0.0, upper = 0.2, unit = "N/(rev/s)^2" }
sigma_u = { distribution = "log-uniform", lower = 0.002, upper = 0.2 }

[sensors]
u = { noise = "0.05 m/s" }

[import]
fit = ["1"]

[[import.files]]
path = "log_{run}.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "speed", unit = "m/s" }
channels.n = { column = "propeller", unit = "rpm" }
```

A file that designs a trial has `[design]` instead of `[import]`. With `[truth]` a campaign simulates its trials; it then has no `[import]`.

| task | tables |
|---|---|
| describe the vehicle | [vehicle](#vehicle), [actuators](#vehicleactuatorscontrol), [autopilot](#autopilotchannel) |
| describe an ROV | [thrusters](#vehiclethrusters), [thrust laws](#vehiclethrust_lawsname), [tether](#vehicletether) |
| choose terms and priors | [structure](#structure), [prior](#priorname), [selection](#selection) |
| describe sensors | [sensors](#sensorschannel), [mounts](#mountsname), [estimation](#estimation), [filter](#filter) |
| read logs | [import](#import), [files](#importfiles), [channels](#importfileschannelschannel), [keep](#importkeep), [checks](#checks) |
| design trials | [design](#design), [limits](#limitsname), [power](#power), [goal](#goal), [plan](#plan), [truth](#truth) |
| use more machines | [compute](#compute) |

- A quantity is text with a unit, such as `"200 rpm"`. A plain number is SI, in the unit of the coefficient.
- A key without a default is optional unless it is marked "required".
- `seatrial schema > DIR/campaign.schema.json` lets an editor complete keys, show their meaning and mark mistakes. The first line of a
  template, `#:schema campaign.schema.json`, names that file for editors with Taplo, such as Even Better TOML of VS Code.
- An unknown key, or one without effect, is refused with its line and a remedy.

## `[truth]`

The simulated vehicle: the value of each coefficient by name, SI. Every term of `always` needs one; an optional
term that is left out is 0. Also allowed:

| key | unit | meaning |
|---|---|---|
| `delay` | s | time between command and action |
| `current` | m/s | steady current along the course |
| `bias_CHANNEL` | that of the channel | constant error of a sensor |
| `lag_CHANNEL` | s | time constant of a sensor |
| `sigma_CHANNEL` | that of the channel | its noise, if it is not that of `[sensors]` |
| `tau_CHANNEL`, `dof_CHANNEL` | s, 1 | correlation time of that noise, or degrees of freedom of its heavy tails |
| `share_CHANNEL` | 1 | part of that noise in proportion to the signal, divided by the signal |
| `lag_CONTROL` | s | time constant of an actuator, which no structure has |
| `net_weight`, `x_b`, `gain_f`, `tether_linear`, … | that of its prior | another unknown of the vehicle that has a prior |
| `process_STATE` | that of the state | process noise: standard deviation that a state gains in one second |
"""


def page() -> str:
    """Every table with its keys.

    Raises:
        ValueError: a key without a description.
    """
    parts = [INTRODUCTION]
    for table in _tables(CampaignFile):
        heading, text = _document(table)
        parts += [
            f"## {heading}",
            "",
            text,
            "",
            "| key | takes | unit | default | meaning |",
            "|---|---|---|---|---|",
        ]
        for key, field in _fields(table).items():
            if not field.description:
                raise ValueError(f"{table.__name__} lacks a description of {key}")
            kind = _kind(field.annotation, field.metadata) + _bounds(field)
            parts.append(f"| `{key}` | {kind} | {_unit(field)} | {_default(field)} | {field.description} |")
        parts.append("")
        if table is DesignTable:
            parts += _shapes()
    return "\n".join(parts)


def _tables(table: type[Table]) -> list[type[Table]]:
    """Every table below a table, each once, in the order of the file."""
    found: dict[type[Table], None] = {}
    for field in table.model_fields.values():
        for inner in _inner(field.annotation):
            found |= dict.fromkeys([inner, *_tables(inner)])
    return list(found)


def _inner(annotation: Any) -> list[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [table for one in get_args(annotation) for table in _inner(one)]


def _document(table: type[Table]) -> tuple[str, str]:
    """Heading and text of a table, which its docstring has."""
    text = "\n".join(line.strip() for line in (table.__doc__ or "").strip().splitlines())
    heading, _, rest = text.partition(": ")
    return heading, rest[:1].upper() + rest[1:]


def _fields(table: type[Table]) -> dict[str, Any]:
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _kind(annotation: Any, metadata: Sequence[Any] = ()) -> str:
    """What a key takes, in words."""
    if any(isinstance(one, Unit) for one in metadata):
        return "quantity"
    if get_origin(annotation) is Annotated:
        return _kind(get_args(annotation)[0], get_args(annotation)[1:])
    if get_origin(annotation) is Literal:
        return ", ".join(f"`{value}`" for value in get_args(annotation))
    if annotation in (str, int, float, bool):
        return {str: "text", int: "whole number", float: "number", bool: "true or false"}[annotation]
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is tuple:
        return f"list of {_kind(inner[0])}"
    if origin is dict:
        return f"by name: {_kind(inner[1])}"
    if inner == (str, float) or inner == (str, float, type(None)):
        return "quantity or number"
    if inner:
        return " or ".join(dict.fromkeys(_kind(one) for one in inner if one is not type(None)))
    return "table"


def _unit(field: Any) -> str:
    """The unit of a key, or of all values in it."""
    extra = field.json_schema_extra or {}
    return extra.get("unit", next((one.shown for one in _units(field.annotation, field.metadata)), ""))


def _units(annotation: Any, metadata: Sequence[Any] = ()) -> Iterator[Unit]:
    yield from (one for one in metadata if isinstance(one, Unit))
    if get_origin(annotation) is Annotated:
        yield from _units(get_args(annotation)[0], get_args(annotation)[1:])
    elif get_origin(annotation) is not Literal:
        for one in get_args(annotation):
            yield from _units(one)


def _bounds(field: Any) -> str:
    """Return the bounds of a number, such as ", 2 to 64"."""
    bound = {
        key: value
        for one in field.metadata
        for key in ("ge", "gt", "le", "lt")
        if (value := getattr(one, key, None)) is not None
    }
    low = bound.get("ge", bound.get("gt"))
    high = bound.get("le", bound.get("lt"))
    high = None if high == 2**63 else high  # as large as a number can be
    if low is None and high is None:
        return ""
    if high is None:
        return f", {low:,} or more" if "ge" in bound else f", above {low:,}"
    end = f"{high:,}" if "le" in bound else f"below {high:,}"
    return f", {low:,} to {end}" if low is not None else f", up to {end}" if "le" in bound else f", {end}"


def _default(field: Any) -> str:
    if field.is_required():
        return "required"
    value = field.default if field.default_factory is None else field.default_factory()
    if value is None or value is PydanticUndefined or isinstance(value, BaseModel) or value in ((), {}, inf):
        return ""
    units = list(_units(field.annotation, field.metadata))
    if units:
        return f"`{value:g} {units[0].shown}`"
    return f"`{str(value).lower() if isinstance(value, bool) else list(value) if isinstance(value, tuple) else value}`"


def _shapes() -> list[str]:
    rows = ["### Shapes of input, for `families`", "", "| shape | `period` is |", "|---|---|"]
    for name, shape in SHAPES.items():
        rows.append(f"| `{name}` | the {shape.period_is} |")
    return [*rows, ""]
