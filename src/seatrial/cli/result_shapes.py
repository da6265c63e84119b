"""Parts of what `--json` prints that no family of results defines: what commands put together. `result_schema.py` has the whole."""

from typing_extensions import TypedDict

Number = float | None


class Problem(TypedDict):
    """Why a command ended without a result; what is found, expected and to be done is empty where it is not known."""

    message: str
    where: str
    found: str
    expected: str
    remedy: str


class FindingRow(TypedDict):
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


class FirstValue(Named):
    """One number of a first answer, SI, found as `by` says; `model_error_sd` is that of `StoredCoefficient`, null of a regression."""

    by: str
    value: Number
    sd: Number
    model_error_sd: Number
    model_error_cause: str


class Inclusion(TypedDict):
    """Probability that a term is needed, and its Monte Carlo standard error."""

    term: str
    probability: Number
    error: Number


class Criterion(TypedDict):
    """One criterion of one structure with its Monte Carlo error; `unit` says which way is better."""

    structure: str
    criterion: str
    value: Number
    error: Number
    status: str


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
    """One record and what was found about it."""

    label: str
    level: str
    findings: list[FindingRow]


class Check(TypedDict):
    """`check`; no record where there is none yet."""

    records: list[Checked]


class Tuned(TypedDict):
    """One record: normalised innovation squared with its band, and what to change."""

    record: str
    nis: Number
    nis_band: list[Number]
    changes: list[FindingRow]


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
    """An estimated coefficient of an export, SI: `sd` within the exported model, the others as in `StoredCoefficient`."""

    mean: Number
    sd: Number
    model_error_sd: Number


class ExportedAverage(Named):
    """A coefficient averaged over all structures, as in `StoredAverage`."""

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
