"""The page of a campaign file's keys, from the schema that reads it."""

from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from generate.key_meanings import MEANINGS
from seatrial.campaign.config import schema
from seatrial.manoeuvres.shapes import SHAPES

HEADINGS: dict[str, type[BaseModel]] = {
    "[campaign]": schema.CampaignTable,
    "[vehicle]": schema.VehicleTable,
    "[vehicle.actuators.CONTROL]": schema.ActuatorTable,
    "[[vehicle.thrusters]]": schema.ThrusterTable,
    "[vehicle.thrust_laws.NAME]": schema.ThrustLawTable,
    "[vehicle.tether]": schema.TetherTable,
    "[structure]": schema.StructureTable,
    "[prior.NAME]": schema.PriorTable,
    "[sensors.CHANNEL]": schema.SensorTable,
    "[mounts.NAME]": schema.MountTable,
    "[limits.NAME]": schema.LimitsTable,
    "[autopilot.CHANNEL]": schema.LoopTable,
    "[design]": schema.DesignTable,
    "Ranges: design.amplitude, design.period, design.relay.threshold": schema.RangeTable,
    "[design.together.CONTROL]": schema.BesideTable,
    "[design.relay]": schema.RelayTable,
    "[design.prediction]": schema.PredictionTable,
    "[power]": schema.PowerTable,
    "[goal]": schema.GoalTable,
    "[plan]": schema.PlanTable,
    "[import]": schema.ImportTable,
    "[[import.files]]": schema.FileTable,
    "[import.trim.RUN]": schema.TrimTable,
    "[import.files.time]": schema.TimeTable,
    "[import.files.channels.CHANNEL]": schema.ColumnTable,
    "[filter]": schema.FilterTable,
    "[estimation]": schema.EstimationTable,
    "[selection]": schema.SelectionTable,
    "[checks]": schema.ChecksTable,
    "[compute]": schema.ComputeTable,
    "[compute.slurm]": schema.SlurmTable,
}
INTRODUCTION = """# campaign.toml

A campaign is a folder with this file in it. Here is every key, table by table, as the code reads it (`python docs/kept_reference.py`
writes this page). `seatrial init DIR --template NAME` writes a commented file to start from.

- A quantity with a dimension is text with a unit, such as `"200 rpm"`. A plain number is SI, in the unit of the coefficient.
- A key without a default is optional unless "required" stands there.
- An unknown key, or one that has no effect beside the others, is refused with its line and a remedy.
- `{ a = 1, b = 2 }` on one line is the same as a table of its own.

The smallest file that designs a trial has `[campaign]`, `[vehicle]`, `[structure]`, a `[prior.NAME]` for each term, `[sensors.CHANNEL]` and
`[design]`; one that only fits logs has `[import]` instead. With `[import]` a campaign reads logs, with `[truth]` it simulates them; it may
not have both. All other tables are optional.

## `[truth]`

The vehicle that is simulated: the value of each coefficient by name, SI. Every term of `always` needs one; an optional
term that is left out is 0. These are allowed too:

| key | unit | meaning |
|---|---|---|
| `delay` | s | time between command and action |
| `current` | m/s | steady current along the course |
| `bias_CHANNEL` | that of the channel | constant error of a sensor |
| `lag_CHANNEL` | s | time constant of a sensor |
| `sigma_CHANNEL` | that of the channel | its noise, if it is not that of `[sensors]` |
| `tau_CHANNEL`, `dof_CHANNEL` | s, 1 | correlation time of that noise, or degrees of freedom of its heavy tails |
| `lag_CONTROL` | s | time constant of an actuator, which no structure has |
| `net_weight`, `x_b`, `gain_f`, `tether_linear`, … | that of its prior | another unknown of the vehicle that has a prior |
| `process_STATE` | that of the state | process noise: what it adds to a state in one second |
"""


def page() -> str:
    """Every table with its keys.

    Raises:
        ValueError: a key that nothing explains, or a meaning without a key.
    """
    parts = [INTRODUCTION]
    for heading, table in _headings().items():
        parts += [
            f"## `{heading}`",
            "",
            _document(table),
            "",
            "| key | takes | unit | default | meaning |",
            "|---|---|---|---|---|",
        ]
        for key, field in _fields(table).items():
            unit, meaning = _meaning(table, key)
            kind = _kind(field.annotation)
            kind = kind.replace("text", "quantity") if unit else kind
            kind += _bounds(field)
            parts.append(f"| `{key}` | {kind} | {unit} | {_default(field)} | {meaning} |")
        parts.append("")
        if table is schema.DesignTable:
            parts += _shapes()
    return "\n".join(parts)


def _document(table: type[BaseModel]) -> str:
    """The schema's own words."""
    lines = (table.__doc__ or "").strip().splitlines()
    text = "\n".join(line.strip() for line in lines)
    head, colon, rest = text.partition(": ")
    return rest[:1].upper() + rest[1:] if colon and head.startswith("`[") else text


def _fields(table: type[BaseModel]) -> dict[str, Any]:
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _kind(annotation: Any) -> str:
    """What a key takes, in words."""
    if get_origin(annotation) is Annotated:
        return _kind(get_args(annotation)[0])
    if get_origin(annotation) is Literal:
        return ", ".join(f"`{value}`" for value in get_args(annotation))
    if annotation is str:
        return "text"
    if annotation in (int, float, bool):
        return {int: "whole number", float: "number", bool: "true or false"}[annotation]
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is list:
        return f"list of {_kind(inner[0])}"
    if origin is dict:
        return f"by name: {_kind(inner[1])}"
    if inner:
        return " or ".join(dict.fromkeys(_kind(one) for one in inner if one is not type(None)))
    return "table"


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
    if value is None or value is PydanticUndefined or isinstance(value, BaseModel) or value in ([], {}):
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _shapes() -> list[str]:
    rows = ["### Shapes of input, for `families`", "", "| shape | `period` is |", "|---|---|"]
    for name, shape in SHAPES.items():
        rows.append(f"| `{name}` | the {shape.period_is} |")
    return [*rows, ""]


def _meaning(table: type[BaseModel], key: str) -> tuple[str, str]:
    """Unit and meaning of a key; one that only the schema's own words tell of is sent there.

    Raises:
        ValueError: a key that nothing explains.
    """
    told = MEANINGS.get(table.__name__, {}).get(key)
    if told is None and f"`{key}`" not in (table.__doc__ or ""):
        raise ValueError(f"docs/generate/key_meanings.py: {table.__name__} lacks {key}")
    return told or ("", "see above")


def _headings() -> dict[str, type[BaseModel]]:
    """Every table, those of `HEADINGS` first.

    Raises:
        ValueError: meanings of keys that the schema has no more.
    """
    tables = [one for one in vars(schema).values() if isinstance(one, type) and issubclass(one, schema.Table)]
    for table in tables:
        gone = set(MEANINGS.get(table.__name__, {})) - set(_fields(table))
        if gone:
            raise ValueError(f"docs/generate/key_meanings.py: {table.__name__} has no {sorted(gone)}")
    known = {schema.Table, schema.CampaignFile, *HEADINGS.values()}
    return HEADINGS | {(one.__doc__ or "").split("`")[1]: one for one in tables if one not in known}
