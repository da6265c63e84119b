"""The documents that `--json` prints, one for each command, and their JSON Schema: `python -m seatrial.cli.result_schema` prints it.

All numbers are in SI and radians; null stands if there is none. A document holds results as their families define them. Types that
are written out here are what a command puts together of several, or a few numbers of a result that is long. A key is added when a command
finds more; none is renamed, removed or given another meaning without raising `SCHEMA` of `answer.py`.
"""

import json
from typing import Any

from typing_extensions import TypedDict

from seatrial.campaign.prior.predictive import Believed
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.predictions import Fit
from seatrial.campaign.store.summary import Summary
from seatrial.cli.answer import SCHEMA
from seatrial.core.serialise import schema_of
from seatrial.design.batch import PlannedBatch
from seatrial.design.plan_search import Plan
from seatrial.design.results import BestDesign, FreeTrial, RelayTrial, Searched
from seatrial.design.sensor_choice import SensorComparison
from seatrial.design.utility_agreement import Agreement
from seatrial.estimation.diagnostics.known import ErrorShares, Known, KnownParameter
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.estimation.prediction.baseline_comparison import Comparison
from seatrial.export.target import MotionChange
from seatrial.export.vehicle import CoefficientEstimates
from seatrial.logs.guess import Guess
from seatrial.logs.summary import ClockSummary, ColumnSummary
from seatrial.selection.criterion import NestedPair
from seatrial.selection.cross_validation import CrossValidation
from seatrial.selection.verdict import Selection

Number = float | None


class Problem(TypedDict):
    """Reason why a command ended without a result. Unknown parts are empty."""

    message: str
    where: str
    found: str
    expected: str
    remedy: str


class FindingRow(TypedDict):
    """One finding: its code, level (pass, note, caution or alarm), subject, numbers in SI, one sentence, and the remedies."""

    code: str
    level: str
    subject: list[str]
    values: dict[str, object]
    remedies: list[str]
    message: str
    remedy: str


class Code(TypedDict):
    """A code of a finding, and its title."""

    code: str
    title: str


class Explain(TypedDict):
    """`explain`: the codes that are listed or explained."""

    codes: list[Code]


class CampaignSchema(TypedDict):
    """`schema`: the JSON Schema of a campaign file."""

    campaign_schema: dict[str, object]


class Named(TypedDict):
    """A quantity by its name, and its SI unit."""

    name: str
    unit: str


class FirstValue(Named):
    """One number of a first answer, SI, by the method `by`; `shares` as in `StoredCoefficient`, null if the ± is only the noise."""

    by: str
    value: Number
    sd: Number
    shares: ErrorShares | None
    cause: str


class EstimatedStructure(TypedDict):
    """One structure by chains; `contains` gives the parts of the ± and how to reduce the largest."""

    estimate: Estimate
    contains: list[str]
    known: Known
    held_back: list[Fit]


class FirstStructure(TypedDict):
    """First answer of one structure; `contains` as in `EstimatedStructure`."""

    label: str
    terms: list[str]
    values: list[FirstValue]
    contains: list[str]
    log_evidence_laplace: Number
    held_back: list[Fit]
    symmetry: list[str]


class Estimates(TypedDict, total=False):
    """`estimate`: `structures` by chains, `first_answers` with `--by mode` and `--by equation-error`.

    `taken_as_exact` names the inertias and forces with which all coefficients scale.
    """

    by: str
    taken_as_exact: str
    structures: list[EstimatedStructure]
    first_answers: list[FirstStructure]
    baselines: list[Comparison]


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


class Criterion(TypedDict):
    """One criterion of one structure with its Monte Carlo error; `unit` states whether higher or lower is better."""

    structure: str
    criterion: str
    value: Number
    error: Number
    status: str


class Criteria(TypedDict):
    """`criteria`."""

    criteria: list[Criterion]
    savage_dickey: list[NestedPair]


class _Designs(TypedDict):
    designs: list[BestDesign]
    refused: dict[str, str]
    coefficients: list[KnownParameter]


class Designs(_Designs, total=False):
    """`design`: the best of each family, the best of all first; then the results of its options."""

    free_form: FreeTrial
    self_oscillation: RelayTrial
    searched: Searched
    batch: PlannedBatch
    sensors: SensorComparison
    rankings: list[Agreement]


class ExpectedChannel(TypedDict):
    """One channel, SI: the ends of its 90 % range over the trial, and the share of the measured values inside it."""

    channel: str
    unit: str
    lowest: Number
    highest: Number
    measured_inside: Number


class Prior(TypedDict):
    """`prior`: steady speed, m/s, and time constant, s, by their 5, 50 and 95 % quantiles, null but for surge; shares of the draws."""

    over: str
    steady_speed: list[Number] | None
    time_constant: list[Number] | None
    diverging: Number
    channels: list[ExpectedChannel]
    priors: list[Believed]


class Strategy(TypedDict):
    """One way of choosing trials: how many it needs, its error, and the share of vehicles that met the goal after each."""

    name: str
    trials: Number
    trials_error: Number
    share_met: list[Number]
    median_sd: list[list[Number]]


class Rehearsal(TypedDict):
    """`plan --vehicles N`: the trials that each strategy needed on vehicles drawn from the priors."""

    vehicles: int
    most: int
    coefficients: list[str]
    strategies: list[Strategy]


class RecordRow(TypedDict):
    """One record: its length, s, and its channels."""

    label: str
    held_back: bool
    samples: int
    duration: Number
    controls: list[str]
    measured: list[str]


class Records(TypedDict):
    """`simulate` and `import`."""

    records: list[RecordRow]


class Checked(TypedDict):
    """One record with its findings, its gaps, and its controls that never move."""

    label: str
    level: str
    findings: list[FindingRow]
    cautions: list[str]


class Check(TypedDict):
    """`check`; no record if there is none yet."""

    records: list[Checked]


class Tuned(TypedDict):
    """One record: normalised innovation squared with its band, and the changes that are recommended."""

    record: str
    nis: Number
    nis_band: list[Number]
    changes: list[FindingRow]


class Tuning(TypedDict):
    """`tuning`."""

    records: list[Tuned]


class Calibrated(TypedDict):
    """`calibrate`: quantities whose ranks leave the band, p-value of each."""

    structure: str
    method: str
    replicates: int
    outside: list[str]
    p_values: dict[str, Number]


class Next(TypedDict):
    """`next`: the trial to run, null to stop, and why."""

    trial: BestDesign | None
    advice: list[str]


class Coefficient(Named):
    """A coefficient of a published vehicle, SI."""

    value: Number


class VehiclePage(TypedDict):
    """One published vehicle."""

    name: str
    title: str
    mass: Number
    moves: list[str]
    controls: list[str]
    coefficients: list[Coefficient]
    notes: str


class VehicleName(TypedDict):
    """A name in the catalogue, with its title."""

    name: str
    title: str


class Vehicle(TypedDict, total=False):
    """`vehicle`: all names, or the page of one."""

    vehicles: list[VehicleName]
    vehicle: VehiclePage


class Init(TypedDict):
    """`init`: the template; null if options or answers replaced it."""

    template: str | None


class Export(TypedDict, total=False):
    """`export`: of a trial, or of a vehicle with its estimated coefficients and the differences between its motion and the target's."""

    target: str
    estimated: CoefficientEstimates
    loss: list[MotionChange]
    trial: str
    control: str


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
    "estimate": Estimates,
    "profile": Profiles,
    "select": Selection,
    "criteria": Criteria,
    "crossvalidate": CrossValidation,
    "check": Check,
    "tuning": Tuning,
    "calibrate": Calibrated,
    "next": Next,
    "report": Summary,
    "run": Summary,
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
        "title": "Output of seatrial with --json",
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
        "allOf": cases,
        "$defs": definitions,
    }


if __name__ == "__main__":
    print(json.dumps(schema(), indent=1))
