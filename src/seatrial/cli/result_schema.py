"""The documents that `--json` prints, one for each command, and their JSON Schema: `python -m seatrial.cli.result_schema` prints it.

All numbers are in SI and radians; null stands where there is none. A document holds results as their families define them, and what
commands put together of them (`result_shapes.py`). A key is added when a command finds more; none is renamed, removed or given another
meaning without raising `SCHEMA` of `answer.py`.
"""

import json
from dataclasses import dataclass
from typing import Any

from pydantic import computed_field
from typing_extensions import TypedDict

from seatrial.campaign.store.cross_validation import Candidate
from seatrial.campaign.store.designs import FreeTrial, RelayTrial, Searched
from seatrial.campaign.store.estimates import KnownParameter, StoredCoefficient
from seatrial.campaign.store.predictions import Fit
from seatrial.campaign.store.structures import NestedPair, StoredAverage
from seatrial.cli.answer import SCHEMA
from seatrial.cli.result_shapes import (
    Batch,
    Benchmark,
    Calibration,
    CampaignSchema,
    Check,
    Criterion,
    Design,
    Explain,
    Export,
    FindingRow,
    FirstValue,
    Inclusion,
    Init,
    Next,
    Plan,
    Prior,
    Problem,
    Records,
    Rehearsal,
    SensorRow,
    Tuning,
    Vehicle,
)
from seatrial.core.serialise import schema_of
from seatrial.design.utility_agreement import Agreement
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.estimation.prediction.baseline_comparison import Comparison
from seatrial.logs.guess import Guess
from seatrial.logs.summary import ClockSummary, ColumnSummary
from seatrial.messages.predictions import comparison_text
from seatrial.selection.verdict import StructureRow

Number = float | None


@dataclass(frozen=True)
class ComparisonRow(Comparison):  # noqa: D101 (its docstring is that of its base)
    __doc__ = Comparison.__doc__

    @computed_field
    @property
    def sentence(self) -> str:
        """What that means and what to do."""
        return comparison_text(self)


class EstimatedStructure(TypedDict):
    """One structure with its parameters; `model_error` says what the ± with model error is made of and how to get rid of it."""

    label: str
    terms: list[str]
    parameters: list[StoredCoefficient]
    model_error: list[str]
    log_evidence_laplace: Number
    known: list[KnownParameter]
    symmetry: list[str]
    held_back: list[Fit]


class FirstStructure(TypedDict):
    """First answer of one structure; `model_error` as in `EstimatedStructure`."""

    label: str
    terms: list[str]
    values: list[FirstValue]
    model_error: list[str]
    log_evidence_laplace: Number
    held_back: list[Fit]
    symmetry: list[str]


class Estimate(TypedDict, total=False):
    """`estimate`: `structures` by chains, `first_answers` with `--by mode` and `--by equation-error`.

    `taken_as_exact` says which inertias and forces all coefficients scale with.
    """

    by: str
    taken_as_exact: str
    structures: list[EstimatedStructure]
    first_answers: list[FirstStructure]
    baselines: list[ComparisonRow]


class Table(TypedDict):
    """One table, topic or type of message of a log."""

    name: str
    rows: int
    clocks: list[ClockSummary]
    columns: list[ColumnSummary]


class Log(TypedDict):
    """`inspect`; `map` is the guessed map as TOML."""

    kind: str
    tables: list[Table]
    guesses: list[Guess]
    map: str


class Logs(TypedDict):
    """`inspect` of several logs, in the order given; a channel is in the `map` of the first log that has it."""

    logs: list[Log]


class Select(TypedDict):
    """`select`."""

    chosen: str
    structures: list[StructureRow]
    inclusion: list[Inclusion]
    verdicts: list[str]


class Criteria(TypedDict):
    """`criteria`."""

    criteria: list[Criterion]
    savage_dickey: list[NestedPair]


class CrossValidate(TypedDict):
    """`crossvalidate`."""

    runs: list[str]
    best: str
    recommended: str | None
    candidates: list[Candidate]


class _Design(TypedDict):
    designs: list[Design]
    refused: dict[str, str]
    coefficients: list[KnownParameter]


class Designs(_Design, total=False):
    """`design`: the best of each family, the best of all first; then what its options asked for."""

    free_form: FreeTrial
    self_oscillation: RelayTrial
    searched: Searched
    batch: Batch
    sensors: list[SensorRow]
    rankings: list[Agreement]


class Run(TypedDict):
    """`run` and `report`: the chosen structure, what supports it, how it predicts, and what to run next.

    `quoted` says whose values to quote, with `model_error_sd` if it is not null: `chosen`, those of `parameters`, or `averaged`.
    """

    chosen: str
    terms: list[str]
    parameters: list[StoredCoefficient]
    averaged: list[StoredAverage]
    quoted: str
    structures: list[StructureRow]
    inclusion: list[Inclusion]
    verdicts: list[str]
    fits: list[Fit]
    baselines: list[ComparisonRow]
    next: Next


# Type of `result` in the document of each command.
RESULTS = {
    "vehicle": Vehicle,
    "explain": Explain,
    "schema": CampaignSchema,
    "init": Init,
    "prior": Prior,
    "design": Designs,
    "plan": Plan | Rehearsal,
    "simulate": Records,
    "inspect": Log | Logs,
    "import": Records,
    "estimate": Estimate,
    "profile": Profiles,
    "select": Select,
    "criteria": Criteria,
    "crossvalidate": CrossValidate,
    "check": Check,
    "tuning": Tuning,
    "calibrate": Calibration,
    "next": Next,
    "report": Run,
    "run": Run,
    "benchmark": Benchmark,
    "export": Export,
}


def schema() -> dict[str, Any]:
    """Return the schema of every document; its command says which result it has."""
    shared = {"Problem": Problem, "FindingRow": FindingRow}
    results, definitions = schema_of({**RESULTS, **shared})
    for described in definitions.values():
        if "properties" in described:
            described["additionalProperties"] = False
    texts = {"type": "array", "items": {"type": "string"}}
    properties = {
        "schema": {"const": SCHEMA},
        "seatrial": {"type": "string"},
        "command": {"enum": list(RESULTS)},
        "exit": {"type": "integer"},
        "error": {"anyOf": [results["Problem"], {"type": "null"}]},
        "result": {},
        "files": {"type": "object", "additionalProperties": {"type": "string"}},
        "cautions": texts,
        "alarms": texts,
        "findings": {"type": "array", "items": results["FindingRow"]},
    }
    cases = [
        {
            "if": {"properties": {"command": {"const": command}}},
            "then": {"properties": {"result": {"anyOf": [results[command], {"type": "null"}]}}},
        }
        for command in RESULTS
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "What seatrial prints with --json",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "allOf": cases,
        "$defs": definitions,
    }


if __name__ == "__main__":
    print(json.dumps(schema(), indent=1))
