"""The keys of a campaign's TOML file. Quantities with a dimension are strings with a unit, such as "200 rpm"."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from seatrial.campaign.config.settings import DesignFilter, Residuals, Scope, Utility
from seatrial.sampling.names import DEFAULT, SamplerName

Quantity = str | float
"""A number and its unit in quotes; a number alone is let through to where its unit is known, so that the error can name it."""


class Table(BaseModel):
    """A TOML table: unknown keys are refused, and nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""What stands in headings: one line of text."""


class CampaignTable(Table):
    """`[campaign]`: its name, and the seed of everything random."""

    name: Name
    seed: int = Field(ge=0, lt=2**63)


class ActuatorTable(Table):
    """`[vehicle.actuators.CONTROL]`: how late it follows its command, and its limits; `rate` by the second."""

    lag: Quantity = "0 s"
    lower: Quantity | None = None
    upper: Quantity | None = None
    rate: Quantity | None = None


Triple = list[Quantity]


class VehicleTable(Table):
    """`[vehicle]`: a catalogue name, or mass ("unknown" for coefficients per unit mass), thrust deduction and fixed coefficients.

    A whole vehicle is one of the catalogue in six degrees of freedom, or one by hand that says which of u v w p q r `moves`; then
    `given` are velocities and angles that are measured, `positions` those of x y z that are states, and lengths are from the body's
    origin. `published_to` is how well the catalogue's coefficients are believed, as a share of each, where they have no prior;
    `known_from` names folders of earlier campaigns, whose coefficients are priors here where they are sought, and fixed where not.
    """

    catalogue: str | None = None
    name: Name | None = None
    mass: Quantity | None = None
    inertia: Triple | None = Field(default=None, min_length=3, max_length=3)
    products: Triple | None = Field(default=None, min_length=3, max_length=3)
    centre_of_gravity: Triple | None = Field(default=None, min_length=3, max_length=3)
    centre_of_buoyancy: Triple | None = Field(default=None, min_length=3, max_length=3)
    weight: Quantity | None = None
    buoyancy: Quantity | None = None
    moves: list[Literal["u", "v", "w", "p", "q", "r"]] | None = Field(default=None, min_length=1)
    given: list[str] = []
    positions: list[Literal["x", "y", "z"]] = []
    attitude: Literal["quaternion", "euler"] = "euler"
    actuators: Literal["published"] | dict[str, ActuatorTable] | None = None
    published_to: Quantity | None = None
    known_from: list[str] = []
    thrust_deduction: float = Field(default=0.0, ge=0.0, lt=1.0)
    wake: float = Field(default=0.0, lt=1.0)
    fixed: dict[str, float] = {}
    trim: dict[str, Quantity] = {}


class StructureTable(Table):
    """`[structure]`: terms always there, terms whose presence the data decide, and which of them may stand together.

    Rules are lines such as "X_uabsu requires X_u", "together X_u X_uabsu", "at most one of X_u3 X_du3", "never X_0", "heredity".
    Where more than 64 structures are left, a screening in closed form chooses `shortlist` of them at most to be simulated. `g` screens
    under Zellner's g-prior about zero, whose variance is g times that of least squares, in place of the stated priors; "rows" makes it
    worth one row.
    """

    always: list[str] = []
    optional: list[str] = []
    rules: list[str] = []
    shortlist: int = Field(default=6, ge=2, le=64)
    g: Annotated[float, Field(gt=0.0)] | Literal["rows"] | None = None


class PriorTable(Table):
    """`[prior.NAME]`: what is believed before the trial; `unit` if the numbers are not SI.

    | distribution | numbers |
    |---|---|
    | uniform, log-uniform | `lower`, `upper` |
    | normal | `mean`, `sd` |
    | truncated-normal | `mean` and `sd` of the normal before it is cut, and `lower`, `upper` or both |
    | half-normal | `scale`, and the bound it falls off from, `lower` or `upper`; 68 % lie within `scale` of it |
    | log-normal | `median`, whose sign all values have, and `factor`; 68 % lie within that factor of the median |

    `physical = true` cuts the prior to the side that physics allows: damping dissipates (`X_u` and `X_uabsu` below 0) and mass
    plus added mass is positive (`X_udot` below the mass).
    """

    model_config = ConfigDict(allow_inf_nan=True)  # `read_prior` says what to write instead

    distribution: Literal["uniform", "log-uniform", "normal", "half-normal", "log-normal", "truncated-normal"]
    lower: float | None = None
    upper: float | None = None
    mean: float | None = None
    sd: float | None = None
    scale: float | None = None
    median: float | None = None
    factor: float | None = None
    unit: str | None = None
    physical: bool = False


class SensorTable(Table):
    """`[sensors.CHANNEL]`: standard deviation of its noise, its rate if lower than the sample rate, and what is unknown about it.

    `residuals` overrides that of `[estimation]`; `bias` is a constant error, `lag` a time constant, each with a prior of its own
    (`[prior.bias_u]`, `[prior.lag_u]`); `over` says whether a speed is measured over ground or through the water.
    """

    noise: Quantity
    rate: Quantity | None = None
    residuals: Residuals | None = None
    bias: Scope = "none"
    lag: bool = False
    over: Literal["ground", "water"] = "ground"


class LimitsTable(Table):
    """`[limits.NAME]`: bounds of a control and of its rate of change, of a state of the motion (`u`), of the distance travelled
    (`distance`) or of the advance along the course (`advance`)."""

    lower: Quantity | None = None
    upper: Quantity | None = None
    rate: Quantity | None = None


class RangeTable(Table):
    """An evenly spaced range of a quantity."""

    start: Quantity = Field(alias="from")
    stop: Quantity = Field(alias="to")
    points: int = Field(ge=1, le=1000)


class PowerTable(Table):
    """`[power]`: what a trial draws from the battery: the hotel load, and the propulsion at one operating point (~ cube of the
    control)."""

    hotel: Quantity
    propulsion: Quantity
    at: Quantity


class RelayTable(Table):
    """`[design.relay]`: the self-oscillating test: the control goes from one side of trim to the other whenever the measured `output`
    is a `threshold` away from its trim; with the heading as output it is the zigzag of ships."""

    output: str
    threshold: RangeTable


class PredictionTable(Table):
    """`[design.prediction]`: what the coefficients are wanted for: a state, the `distance` travelled or the `advance`, so long after the
    designed control is set to `control` at trim; with the propeller stopped, `of = "distance"` is the stopping distance."""

    of: str
    control: Quantity
    after: Quantity


class DesignTable(Table):
    """`[design]`: families of inputs that are swept over one grid of amplitudes and periods, and what makes one of them the best.

    `utility` is the entropy reduction by the `filter`, or a criterion of the Fisher information: `fisher-d` (nats), `fisher-a` (mean
    variance), `fisher-e` (least known combination), `fisher-me` (balance), `fisher-c` (the stated `prediction`), or `discrimination`
    (evidence against the structure that is hardest to tell from the full one), `over` the mean of draws of what is believed, at its
    mean (`local`) or at the worst draw; `per` trial, joule or second, where a trial is ended when that pays and takes `turnaround` more
    around it. Limits on the motion are kept with `probability`.
    """

    control: str
    families: list[str] = Field(default=["repeated-doublet"], min_length=1)
    utility: Utility = "entropy"
    filter: DesignFilter = "square-root-unscented"
    over: Literal["mean", "local", "worst"] = "mean"
    per: Literal["trial", "joule", "second"] = "trial"
    turnaround: Quantity = "0 s"
    probability: float = Field(default=0.95, gt=0.0, lt=0.99)
    trim: Quantity | None = None
    duration: Quantity
    active: Quantity
    start: Quantity = "1 s"
    ramp: Quantity = "0 s"
    sample_time: Quantity
    amplitude: RangeTable
    period: RangeTable
    relay: RelayTable | None = None
    prediction: PredictionTable | None = None


class GoalTable(Table):
    """`[goal]`: what ends the campaign: `sd` of each coefficient, a quantity or a percentage of its value ("10 %"), whether one
    structure is to hold 95 % of the probability, and the most trials to run; where only these are given, all of them are run."""

    sd: dict[str, Quantity | float] = {}
    decided: bool = False
    trials: int = Field(default=5, ge=1, le=100)


class TimeTable(Table):
    """Which column holds time, and in which unit; the unit may be left out where the log states it."""

    column: str
    unit: str | None = None


class ColumnTable(Table):
    """Which column holds a channel, in which unit; `scale` multiplies it, -1 to turn an axis round, and then `offset` is added.

    `curve` is a CSV of two columns with a header, the logged number and what it stands for in `unit`, between whose rows it is
    interpolated: the thrust of each PWM width in microseconds, from the maker's table.
    """

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    curve: str | None = None


class FileTable(Table):
    """`[[import.files]]`: one log of a trial; `{run}` in the path stands for the run's label.

    `table` is the topic, type of message, struct or variable where a log has several. `time` may be left out where the format
    has a clock of its own. `axes` are NED with body axes forward, right, down, or ENU with forward, left, up (REP 103). Channels
    `v_north`, `v_east` and `v_down` become velocities along the body, and `q_w`, `q_x`, `q_y`, `q_z` angles. For CSV and TSV are
    `delimiter` ("whitespace" too), `encoding`, `skip_rows`, `header_rows` and, for those without a header, `names` of all columns.
    """

    path: str
    table: str | None = None
    time: TimeTable | None = None
    channels: dict[str, ColumnTable]
    clock: Literal["as_stamped", "even", "drop_repeated"] = "as_stamped"
    axes: Literal["NED", "ENU"] = "NED"
    delimiter: str | None = None
    encoding: str = "utf-8"
    skip_rows: int = Field(default=0, ge=0, le=1_000_000)
    header_rows: int = Field(default=1, ge=1, le=1000)
    names: list[str] | None = Field(default=None, min_length=1)


class TrimTable(Table):
    """`[import.trim.RUN]`: where one run begins and ends, in place of what `[import]` says for all."""

    start: Quantity | None = None
    end: Quantity | None = None


class ImportTable(Table):
    """`[import]`: runs that are fitted jointly, runs that are only predicted, and how their files become records.

    Every run is trimmed to between `start` and `end`, counted from where its files overlap, and cut into pieces of about `split`, each
    a trial with a start of its own: for long records, and for vehicles that leave their course slowly.
    """

    fit: list[str] = Field(min_length=1)
    predict: list[str] = []
    step: Quantity | None = None
    start: Quantity | None = None
    end: Quantity | None = None
    trim: dict[str, TrimTable] = {}
    split: Quantity | None = None
    files: list[FileTable] = Field(min_length=1)


class FilterTable(Table):
    """`[filter]`: what the model leaves out, as the standard deviation that each state or coefficient gains in one second."""

    process_noise: dict[str, Quantity | float] = {}


class EstimationTable(Table):
    """`[estimation]`: likelihood, initial state, residuals, a current along the course, what varies between trials, size of the chains.

    `filter-error` adds process noise, with a prior of each state's (`[prior.process_u]`, what it gains in one second), or a force with
    a memory on any axis (`[prior.disturbance_X]`, its standard deviation in the unit of X_0, and `[prior.disturbance_time_X]`, its
    correlation time), beside which process noise of any state may be left out. Residuals are `white`, `coloured` (with
    `[prior.tau_u]`) or `heavy`-tailed. Coefficients under `varying` differ from trial to trial about a common value, by a spread with
    a prior of its own (`[prior.spread_X_u]`).
    """

    likelihood: Literal["output-error", "filter-error"] = "output-error"
    initial: Literal["trim", "measured", "estimated"] = "trim"
    residuals: Residuals = "white"
    current: Scope = "none"
    varying: list[str] = []
    sampler: SamplerName = DEFAULT
    chains: int = Field(default=32, ge=2, le=1024)
    warmup: int = Field(default=500, ge=100, le=1_000_000, multiple_of=100)
    draws: int = Field(default=1500, ge=100, le=1_000_000, multiple_of=100)
    thin: Literal[1, 2, 4, 5, 10, 20, 25, 50, 100] = 1


class SelectionTable(Table):
    """`[selection]`: size of the two methods behind each evidence: particles and independent repeats of tempered SMC, and draws of the
    importance sampling about the modes.

    Without `particles` there are 512, or 64 for each parameter where that is more. Where a verdict asks for more particles, more
    repeats or more draws, these are meant.
    """

    particles: int | None = Field(default=None, ge=64, le=1_000_000)
    repeats: int = Field(default=4, ge=2, le=1000)
    draws: int = Field(default=20480, ge=1024, le=10_000_000)


class SlurmTable(Table):
    """`[compute.slurm]`: what each of some jobs asks for; a worker of one thread on each of its cores shares its memory."""

    memory: str = Field(pattern=r"^[0-9.]+ ?[kMGT]i?B$")
    walltime: str = Field(pattern=r"^[0-9:-]+$")
    cores: int = Field(default=1, ge=1, le=4096)
    jobs: int = Field(default=1, ge=1, le=10_000)
    queue: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.,-]+$")
    account: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]+$")
    interface: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]+$")


class ComputeTable(Table):
    """`[compute]`: where work is done, which is no part of what is computed: `local`, `slurm`, or the address of a Dask scheduler."""

    workers: str = "local"
    slurm: SlurmTable | None = None


class CampaignFile(Table):
    """The whole file."""

    campaign: CampaignTable
    vehicle: VehicleTable
    structure: StructureTable
    prior: dict[str, PriorTable] = {}
    sensors: dict[str, SensorTable] = Field(min_length=1)
    limits: dict[str, LimitsTable] = {}
    design: DesignTable
    power: PowerTable | None = None
    goal: GoalTable | None = None
    truth: dict[str, float] = {}
    imported: ImportTable | None = Field(default=None, alias="import")
    filter: FilterTable = FilterTable()
    estimation: EstimationTable = EstimationTable()
    selection: SelectionTable = SelectionTable()
    compute: ComputeTable = ComputeTable()
