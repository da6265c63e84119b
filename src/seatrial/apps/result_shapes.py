"""What `--json` prints, as types: one document for each command, all numbers in SI and radians, null where there is none.

`seatrial/apps/results.schema.json` is made of these types by `python docs/generate/result_schema.py`. A key is added when a command
finds more; none is renamed, removed or given another meaning without raising `SCHEMA`.
"""

from typing import TypedDict

SCHEMA = 1
"""Version of the documents."""
Number = float | None


class Problem(TypedDict):
    """Why a command ended without a result; what is found, expected and to be done is empty where it is not known."""

    message: str
    where: str
    found: str
    expected: str
    remedy: str


class Finding(TypedDict):
    """One finding: its code, level (pass, note, caution or alarm), what it concerns, numbers in SI, one sentence, and what to do."""

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


class Parameter(Named):
    """Posterior of one parameter, SI: mean, standard deviation, shortest 95 % interval, both within the model, mode, and the health of its
    draws.

    `model_error_sd` is the standard deviation that survives an error of the model, null where it is not larger by more than a half;
    `model_error_cause` says what makes most of it.
    """

    mean: Number
    sd: Number
    lower_95: Number
    upper_95: Number
    mode: Number
    model_error_sd: Number
    model_error_cause: str
    r_hat: Number
    ess_bulk: Number
    ess_tail: Number


class Averaged(Named):
    """A parameter averaged over all structures by their probabilities, SI; absent counts as zero. `sd` and the shortest 95 % interval hold
    within the structures, `model_error_sd` also if they are wrong; null where it is not larger by more than a half. `model_error_cause`
    says what makes most of it.
    """

    mean: Number
    sd: Number
    lower_95: Number
    upper_95: Number
    model_error_sd: Number
    model_error_cause: str
    inclusion: Number


class Known(Named):
    """How well one parameter is known, SI: its standard deviation, over its value, over the prior's, and its closest companion.

    `model_error_sd` is that of `Parameter`; null of a design.
    """

    value: Number
    sd: Number
    model_error_sd: Number
    relative: Number
    left: Number
    partner: str
    correlation: Number


class Fit(TypedDict):
    """How one channel of one record is predicted from its inputs alone, SI; shares are of the measured variance or of the samples.

    `reason` ends with `advice`, which is empty where there is nothing to do.
    """

    record: str
    held_back: bool
    channel: str
    code: str
    level: str
    reason: str
    advice: str
    samples: int
    effective: Number
    explained: Number
    rmse: Number
    crps: Number
    coverage_50: Number
    coverage: Number


class Baseline(TypedDict):
    """How the model stands beside simple predictors on one channel of the held-back records."""

    channel: str
    level: str
    p_value: Number
    sentence: str


class EstimatedStructure(TypedDict):
    """One structure with its parameters; `model_error` says what the ± with model error is made of and how to get rid of it."""

    label: str
    terms: list[str]
    parameters: list[Parameter]
    model_error: list[str]
    log_evidence_laplace: Number
    known: list[Known]
    symmetry: list[str]
    held_back: list[Fit]


class FirstValue(Named):
    """One number of a first answer, SI; `by` says how it was found. The ± with model error is that of `Parameter`: null of a regression."""

    by: str
    value: Number
    sd: Number
    model_error_sd: Number
    model_error_cause: str


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
    baselines: list[Baseline]


class Structure(TypedDict):
    """One candidate with its evidence, nats, and its probability; each with its Monte Carlo standard error.

    The resolution is the smallest difference, nats, that the check of the evidence would have noticed; null without a check.
    """

    label: str
    terms: list[str]
    log_evidence: Number
    log_evidence_error: Number
    log_evidence_resolution: Number
    probability: Number
    probability_error: Number
    method: str
    status: str


class Inclusion(TypedDict):
    """Probability that a term is needed, and its Monte Carlo standard error."""

    term: str
    probability: Number
    error: Number


class Select(TypedDict):
    """`select`."""

    chosen: str
    structures: list[Structure]
    inclusion: list[Inclusion]
    verdicts: list[str]


class Criterion(TypedDict):
    """One criterion of one structure with its Monte Carlo error; `unit` says which way is better."""

    structure: str
    criterion: str
    value: Number
    error: Number
    status: str


class Ratio(TypedDict):
    """Savage-Dickey log Bayes factor of a term between two structures, nats."""

    term: str
    larger: str
    smaller: str
    value: Number
    error: Number
    agrees: bool


class Criteria(TypedDict):
    """`criteria`."""

    criteria: list[Criterion]
    savage_dickey: list[Ratio]


class LeftOut(TypedDict):
    """One structure under one model of the error: log density of each run given the others, nats."""

    structure: str
    terms: list[str]
    error_model: str
    elpd: list[Number]
    total: Number
    log_evidence: Number
    status: str
    refused: str


class CrossValidate(TypedDict):
    """`crossvalidate`."""

    runs: list[str]
    best: str
    recommended: str | None
    candidates: list[LeftOut]


class Profile(Named):
    """Profile likelihood of one parameter, SI: its 95 % interval, null at an end that is open, and the curve."""

    kind: str
    best: Number
    lower: Number
    upper: Number
    values: list[Number]
    drop: list[Number]


class Profiles(TypedDict):
    """`profile`."""

    structure: str
    profiles: list[Profile]


class Design(TypedDict):
    """The best design of one family, SI: amplitude about trim, period, s, entropy reduction, nats."""

    family: str
    control: str
    unit: str
    trim: Number
    amplitude: Number
    period: Number
    gain_nat: Number
    worth: Number


class FreeForm(TypedDict):
    """A schedule of no fixed shape: levels of the control, SI, and D criteria, nats."""

    levels: list[Number]
    utility: Number
    beside: Number
    family: str


class SelfOscillation(TypedDict):
    """A self-oscillating test, SI."""

    control: str
    output: str
    amplitude: Number
    threshold: Number
    gain: Number
    utility: Number
    oscillates: Number


class Searched(TypedDict):
    """The design found between the points of the grid, SI."""

    kind: str
    amplitude: Number
    period: Number
    utility: Number
    beside: Number
    evaluations: int
    unit: str


class Batch(TypedDict):
    """Trials planned together: in words, their utility after each, and their schedules."""

    trials: list[str]
    utility: list[Number]
    schedules: list[str]
    unit: str


class SensorRow(TypedDict):
    """The best design with other sensors: what it is worth, and the standard deviation of each coefficient, SI."""

    sensors: str
    utility: Number
    sd: dict[str, Number]


class Ranking(TypedDict):
    """How one measure ranks designs beside their simulated information gain; regret in nats."""

    name: str
    correlation: Number
    regret: Number
    regret_error: Number


class _Design(TypedDict):
    designs: list[Design]
    refused: dict[str, str]
    coefficients: list[Known]


class Designs(_Design, total=False):
    """`design`: the best of each family, the best of all first; then what its options asked for."""

    free_form: FreeForm
    self_oscillation: SelfOscillation
    searched: Searched
    batch: Batch
    sensors: list[SensorRow]
    rankings: list[Ranking]


class Stage(TypedDict):
    """Coefficients that are sought together: the velocities that move, those that are given, and the earlier stages it needs, from 1."""

    axes: str
    sought: list[str]
    moves: list[str]
    given: list[str]
    needs: list[int]


class PlannedTrial(TypedDict):
    """One trial: its stage, from 1, the design in words, and the chance of meeting the goals if it alone is dropped."""

    stage: int
    words: str
    control: str
    schedule: str
    without: Number


class Further(TypedDict):
    """What the chance asked for would take: trials, s and J."""

    trials: int
    seconds: Number
    joules: Number | None


class Plan(TypedDict):
    """`plan`: trials in their order, the chance that all goals are met, that of each, and that of all others if one goal is dropped.

    Time is in s, energy in J; `ended_by` says what keeps the plan from going on.
    """

    basis: str
    stages: list[Stage]
    trials: list[PlannedTrial]
    chance: Number
    chance_error: Number
    goals: dict[str, Number]
    without_goal: dict[str, Number]
    seconds: Number
    joules: Number | None
    ended_by: str
    further: Further | None


class Reach(TypedDict):
    """What one prior does where it alone varies, SI: the range of the steady speed, or the largest value of the channel it moves most."""

    channel: str
    low: Number
    high: Number


class Believed(Named):
    """One prior, SI: its 5, 50 and 95 % quantiles, and what it does alone; null for what moves no vehicle."""

    quantiles: list[Number]
    alone: Reach | None


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
    """`rehearse`."""

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
    """One record and what was found about it."""

    label: str
    level: str
    findings: list[Finding]


class Check(TypedDict):
    """`check`; no record where there is none yet."""

    records: list[Checked]


class Change(TypedDict):
    """What of a filter to change: P, Q, R or the trial, and which way."""

    change: str
    direction: str
    words: str


class Tuned(TypedDict):
    """One record: normalised innovation squared with its band, and what to change."""

    record: str
    nis: Number
    nis_band: list[Number]
    changes: list[Change]


class Tuning(TypedDict):
    """`tuning`."""

    records: list[Tuned]


class Calibration(TypedDict):
    """`calibrate`: quantities whose ranks leave the band, p-value of each."""

    structure: str
    method: str
    replicates: int
    outside: list[str]
    p_values: dict[str, Number]


class Next(TypedDict):
    """`next`: the trial to run, null to stop, and why."""

    trial: Design | None
    advice: list[str]


class Run(TypedDict):
    """`run` and `report`: the chosen structure, what supports it, how it predicts, and what to run next.

    `quoted` says whose values to quote, with `model_error_sd` if it is not null: `chosen`, those of `parameters`, or `averaged`.
    """

    chosen: str
    terms: list[str]
    parameters: list[Parameter]
    averaged: list[Averaged]
    quoted: str
    structures: list[Structure]
    inclusion: list[Inclusion]
    verdicts: list[str]
    fits: list[Fit]
    baselines: list[Baseline]
    next: Next


class Clock(Named):
    """One clock of a table: length, s, rate, Hz."""

    duration: Number
    rate: Number


class Column(TypedDict):
    """One column: how many values it has, and their range as written."""

    name: str
    unit: str | None
    count: int
    least: Number
    greatest: Number


class Table(TypedDict):
    """One table, topic or type of message of a log."""

    name: str
    rows: int
    clocks: list[Clock]
    columns: list[Column]


class Guess(TypedDict):
    """What channel a column may be, and why."""

    channel: str
    table: str
    column: str
    unit: str
    reason: str


class Log(TypedDict):
    """`inspect`; `map` is the guessed map as TOML."""

    kind: str
    tables: list[Table]
    guesses: list[Guess]
    map: str


class Logs(TypedDict):
    """`inspect` of several logs, in the order given; a channel is in the `map` of the first log that has it."""

    logs: list[Log]


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
    """A name in the catalogue, and what it is."""

    name: str
    title: str


class Vehicle(TypedDict, total=False):
    """`vehicle`: all names, or the page of one."""

    vehicles: list[VehicleName]
    vehicle: VehiclePage


class Init(TypedDict):
    """`init`: the template, null where options or answers said what is known."""

    template: str | None


class Loss(TypedDict):
    """How far a target's vehicle leaves the estimated one in the standard manoeuvre: the largest difference of a velocity, SI."""

    velocity: str
    unit: str
    largest: Number


class ExportedCoefficient(Named):
    """An estimated coefficient of an export, SI: `sd` within the exported model, the others as in `Parameter`."""

    mean: Number
    sd: Number
    model_error_sd: Number


class ExportedAverage(Named):
    """A coefficient averaged over all structures, as in `Averaged`."""

    mean: Number
    sd: Number
    model_error_sd: Number
    inclusion: Number


class Export(TypedDict, total=False):
    """`export`: of a vehicle with its estimated coefficients and what is lost, or of a trial; `quoted` as in `Run`, empty if not known."""

    target: str
    coefficients: list[ExportedCoefficient]
    averaged: list[ExportedAverage]
    quoted: str
    loss: list[Loss]
    trial: str
    control: str


class Scored(TypedDict):
    """One method on one channel of all held-back runs, SI."""

    method: str
    task: str
    channel: str
    unit: str
    runs: int
    diverging: int
    explained: Number
    crps: Number
    log_score: Number
    coverage_90: Number


class SetName(TypedDict):
    """A set of public records."""

    name: str
    title: str
    licence: str
    get: str


class Benchmark(TypedDict, total=False):
    """`benchmark`: scores, or with `--list` the sets and methods."""

    set: str
    scores: list[Scored]
    not_beaten: list[str]
    sets: list[SetName]
    methods: list[str]


RESULTS = {
    "vehicle": Vehicle,
    "explain": Explain,
    "schema": CampaignSchema,
    "init": Init,
    "prior": Prior,
    "design": Designs,
    "plan": Plan,
    "rehearse": Rehearsal,
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
"""Type of `result` in the document of each command."""
