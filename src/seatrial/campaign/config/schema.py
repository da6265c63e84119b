"""The keys of a campaign's TOML file. Quantities with a dimension are strings with a unit, such as "200 rpm"."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from seatrial.campaign.config.settings import DesignFilter, Residuals, Scope, SelectionSettings, Utility
from seatrial.sampling.names import DEFAULT, SamplerName

Quantity = str | float
"""A number and its unit in quotes; a number alone is let through to where its unit is known, so that the error can name it."""


class Table(BaseModel):
    """A TOML table: unknown keys are refused, and nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


Name = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]
"""What stands in headings: one line of text."""


class CampaignTable(Table):
    """`[campaign]`: the name of the campaign, and the seed of all random numbers."""

    name: Name
    seed: int = Field(ge=0, lt=2**63)


class ActuatorTable(Table):
    """`[vehicle.actuators.CONTROL]`: how late an actuator follows its command, and its limits."""

    lag: Quantity = "0 s"
    lower: Quantity | None = None
    upper: Quantity | None = None
    rate: Quantity | None = None


Triple = list[Quantity]


class ThrustLawTable(Table):
    """`[vehicle.thrust_laws.NAME]`: the thrust of a logged command, such as a pulse width in microseconds.

    `curve` is a CSV of two columns with a header, the command and the thrust in N; in its place `polynomial` gives the thrust in N by
    powers of the command minus `neutral`, the constant first. Between the two commands of `dead_zone`, ends included, there is no
    thrust. Negative thrust is multiplied by `reverse`. `lag` is the time constant of the thrust. A channel f_1 in the unit "command" is
    converted by the law of thruster 1. Commands beyond the curve are refused, and so are those below 500 or above 2500 where a polynomial
    has a `neutral` between 1000 and 2000, as one of pulse widths has.
    """

    curve: str | None = None
    polynomial: list[float] | None = Field(default=None, min_length=2, max_length=12)
    neutral: float = 0.0
    dead_zone: list[float] | None = Field(default=None, min_length=2, max_length=2)
    reverse: float = Field(default=1.0, gt=0.0)
    lag: Quantity | None = None


class ThrusterTable(Table):
    """`[[vehicle.thrusters]]`: place from the body's origin and direction of positive thrust, forward, starboard and down.

    `law` names its law of thrust; if there is only one law, all thrusters use it.
    """

    place: Triple = Field(min_length=3, max_length=3)
    direction: list[float] = Field(min_length=3, max_length=3)
    law: str | None = None


class TetherTable(Table):
    """`[vehicle.tether]`: a tether that drags where it is made fast, `point` from the body's origin, forward, starboard and down.

    The force is -(linear + quadratic |v|) v, v being the velocity of the point through the water. A drag is sought if it has a prior,
    `[prior.tether_linear]` or `[prior.tether_quadratic]`.
    """

    point: Triple | None = Field(default=None, min_length=3, max_length=3)
    linear: Quantity = "0 N s/m"
    quadratic: Quantity = "0 N s^2/m^2"


class VehicleTable(Table):
    """`[vehicle]`: a vehicle of the catalogue by name, or one described here.

    A surge vehicle needs a mass, a thrust deduction and its known coefficients. A whole vehicle is one of the catalogue in six degrees
    of freedom, or one that says which of u v w p q r it `moves` in. Lengths count from the body's origin. With `moves = []` it is held, as
    at a bollard, and gauges measure `force_X` to `moment_N`.

    Without `thrusters` the vehicle has those of the catalogue. The forces f_1, f_2, … drive them, or the speeds n_1, n_2, … if terms of T
    have n. `added_coriolis` says whether Coriolis forces of the added mass are terms (X_wq, …) or follow from it.
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
    moves: list[Literal["u", "v", "w", "p", "q", "r"]] | None = None
    given: list[str] = []
    positions: list[Literal["x", "y", "z"]] = []
    attitude: Literal["quaternion", "euler"] = "euler"
    current: bool = False
    actuators: Literal["published"] | dict[str, ActuatorTable] | None = None
    thrusters: list[ThrusterTable] = Field(default=[], max_length=64)
    thrust_laws: dict[str, ThrustLawTable] = {}
    tether: TetherTable | None = None
    added_coriolis: Literal["named", "automatic"] = "named"
    published_to: Quantity | None = None
    known_from: list[str] = []
    thrust_deduction: float = Field(default=0.0, ge=0.0, lt=1.0)
    wake: float = Field(default=0.0, lt=1.0)
    fixed: dict[str, float] = {}
    trim: dict[str, Quantity] = {}


class StructureTable(Table):
    """`[structure]`: terms that are always there, terms that the data may keep or drop, and which of them may stand together.

    Rules are lines such as "X_uabsu requires X_u", "together X_u X_uabsu", "at most one of X_u3 X_du3", "never X_0", "heredity".
    If they leave more than 64 structures, a screening in closed form chooses at most `shortlist` of them to be simulated. It uses the
    stated priors, or Zellner's g-prior about zero, whose variance is g times that of least squares; with "rows" it is worth one row.
    """

    always: list[str] = []
    optional: list[str] = []
    rules: list[str] = []
    shortlist: int = Field(default=6, ge=2, le=64)
    g: Annotated[float, Field(gt=0.0)] | Literal["rows"] | None = None


class PriorTable(Table):
    """`[prior.NAME]`: the plausible values of a coefficient before the trial.

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
    """`[sensors.CHANNEL]`: the noise of a sensor, how often it measures, and its unknown errors.

    An unknown `bias` (a constant error) or `lag` (a time constant) needs a prior, `[prior.bias_u]` or `[prior.lag_u]`.

    `[sensors.attitude]` is the whole attitude, by a quaternion or three angles of the log, with its noise as an angle about any axis.
    """

    noise: Quantity
    rate: Quantity | None = None
    residuals: Residuals | None = None
    bias: Scope = "none"
    lag: bool = False
    over: Literal["ground", "water"] = "ground"


class MountTable(Table):
    """`[mounts.NAME]`: a sensor of several `channels`, such as the u, v and w of a Doppler log or the z of a pressure cell.

    `place` is from the body's origin, forward, starboard and down; `roll`, `pitch` and `yaw` turn the sensor's axes in those of the body;
    `scale` is the shown value over the true one; `late` is the delay of its clock, 1 s at most. Each is estimated if it has a
    prior: `[prior.x_NAME]`, `[prior.yaw_NAME]`, `[prior.scale_NAME]`, `[prior.late_NAME]`.
    """

    channels: list[str] = Field(min_length=1)
    place: Triple | None = Field(default=None, min_length=3, max_length=3)
    roll: Quantity = "0 deg"
    pitch: Quantity = "0 deg"
    yaw: Quantity = "0 deg"
    scale: float = Field(default=1.0, gt=0.0)
    late: Quantity = "0 s"


class LimitsTable(Table):
    """`[limits.NAME]`: bounds of any control and of its rate of change, of a state of the motion such as `u`, or of the way: the `distance`
    travelled, the `advance` along the keel, and `x` and `y`, metres ahead and to starboard of the start and its heading."""

    lower: Quantity | None = None
    upper: Quantity | None = None
    rate: Quantity | None = None


class LoopTable(Table):
    """`[autopilot.CHANNEL]`: a loop of the vehicle's autopilot, which holds a measured channel such as `psi`, `z`, `u` or `theta`.

    With e the set-point less the measured channel, its output is kp e + ki times the integral of e - kd times the channel's rate of
    change. It `moves` controls, each by its share of that, or the set-point of a loop further down (`theta_set`): depth through pitch.
    Trials then run through the autopilot: what `[design]` drives is a set-point such as `psi_set`, or a control, to which it is added.
    """

    moves: dict[str, float] = Field(min_length=1)
    kp: Quantity
    ki: Quantity | None = None
    kd: Quantity | None = None
    derivative: str | None = None
    set_point: Quantity | None = None
    limit: Quantity | None = None
    rate: Quantity | None = None
    interval: Quantity | None = None


class RangeTable(Table):
    """An evenly spaced range of a quantity."""

    start: Quantity = Field(alias="from")
    stop: Quantity = Field(alias="to")
    points: int = Field(ge=1, le=1000)


class PowerTable(Table):
    """`[power]`: the power that the battery gives: the hotel load, and the propulsion, which grows with the cube of the control."""

    hotel: Quantity
    propulsion: Quantity
    at: Quantity


class RelayTable(Table):
    """`[design.relay]`: the self-oscillating test. The control changes to the other side of trim whenever the measured `output` is a
    `threshold` away from its trim. With the heading as output it is the zigzag of ships."""

    output: str
    threshold: RangeTable


class PredictionTable(Table):
    """`[design.prediction]`: the prediction for which the coefficients are wanted: a state, the `distance` travelled or the `advance`, some
    time after the designed control is set to a value at trim. With the propeller stopped, `of = "distance"` is the stopping distance."""

    of: str
    control: Quantity
    after: Quantity


class BesideTable(Table):
    """`[design.together.CONTROL]`: a control that moves with the designed one, with a period of its own, `period` times as long."""

    amplitude: Quantity
    period: float = Field(default=1.0, ge=0.1, le=10.0)


class DesignTable(Table):
    """`[design]`: shapes of input that are compared on one grid of amplitudes and periods, and what makes one of them the best.

    | utility | the best design ... |
    |---|---|
    | `entropy` | lowers the entropy of the coefficients most, in nats, as the `filter` computes it |
    | `fisher-d` | the same, by the Fisher information |
    | `fisher-a` | leaves the smallest mean variance |
    | `fisher-e` | gives the most information about the combination that is least known |
    | `fisher-me` | gives similar information about all combinations |
    | `fisher-c` | makes the stated `prediction` most certain |
    | `discrimination` | tells the full structure best from the one most like it |

    With `per` a joule or a second, a trial ends where more of it would lower the information per cost.

    `schedule` is a CSV of your own, with columns `time_s` and one for each control that moves, with its unit, such as `n_rpm`. It is
    compared with the families, and is the first trial that is run. Controls named under `together` move at the same
    time. The amplitude of each, `{ n = "100 rpm" }`, is used with the largest amplitude of `control`; smaller designs shrink it in
    proportion. A control with slower motion may have a longer period: `{ n = { amplitude = "100 rpm", period = 2.0 } }`.

    Without this table a campaign with `[import]` is fitted and reported, and no next trial is proposed.
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
    together: dict[str, Quantity | BesideTable] = {}
    duration: Quantity
    active: Quantity
    start: Quantity = "1 s"
    ramp: Quantity = "0 s"
    sample_time: Quantity
    schedule: str | None = None
    amplitude: RangeTable
    period: RangeTable
    relay: RelayTable | None = None
    prediction: PredictionTable | None = None


class GoalTable(Table):
    """`[goal]`: what ends the campaign. A standard deviation is a quantity or a percentage of the value ("10 %").

    If only `trials` is given, all of them are run.
    """

    sd: dict[str, Quantity | float] = {}
    decided: bool = False
    trials: int = Field(default=5, ge=1, le=100)


class PlanTable(Table):
    """`[plan]`: limits of a day at sea: `time` on the water, the `battery`, and the `turnaround`, the time between trials. `seatrial plan`
    adds no further trial once the `chance` of meeting the goals is reached."""

    time: Quantity | None = None
    battery: Quantity | None = None
    turnaround: Quantity = "0 s"
    chance: float = Field(default=0.9, gt=0.0, lt=1.0)


class TimeTable(Table):
    """The column that holds time, and its unit."""

    column: str
    unit: str | None = None


class ColumnTable(Table):
    """The column that holds a channel, its unit, and what is done to its numbers: `scale` multiplies them, then `offset` is added.

    `curve` is a CSV with a header and two columns: a logged number, and what it stands for in `unit`. Between its rows it is interpolated.
    Use it for the maker's table of thrust over PWM width.

    In place of a column, `sum` is a sum of columns of the table with factors, such as "0.12 data[0] - 0.12 data[1]"; names with other
    signs than letters, digits and . _ / [ ] are written in single quotes. The curve is applied to each column. Forces of thrusters may be
    in the unit "command": `[vehicle.thrust_laws]` makes thrust of the column, or of the sum. `offset` is then in units of the command and
    is added before the law, and `scale` multiplies the thrust.

    A control is held from each sample to the next, as a command is. `between = "line"` is for a control that was measured while it changed,
    such as the speed of a propeller: over each step it is the mean of the straight line between its samples. Where neither is said it is
    held, and a caution tells of a control that changes at nearly every sample, as a measured one does; `between = "held"` says that it is a
    command.
    """

    column: str | None = None
    sum: str | None = None
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    curve: str | None = None
    between: Literal["held", "line"] | None = None


class FileTable(Table):
    """`[[import.files]]`: one log of a trial; `{run}` in the path stands for the run's label.

    `time` is not needed if the format has a clock of its own. Channels `v_north`, `v_east` and `v_down` become velocities along the body,
    and `q_w`, `q_x`, `q_y`, `q_z` become angles. `delimiter`, `encoding`, `skip_rows`, `header_rows` and `names` are for CSV and TSV.
    """

    path: str
    table: str | None = None
    time: TimeTable | None = None
    channels: dict[str, ColumnTable]
    runs: list[str] | None = Field(default=None, min_length=1)
    clock: Literal["as_stamped", "even", "drop_repeated"] = "as_stamped"
    shift: Quantity | None = None
    axes: Literal["NED", "ENU"] = "NED"
    delimiter: str | None = None
    encoding: str = "utf-8"
    skip_rows: int = Field(default=0, ge=0, le=1_000_000)
    header_rows: int = Field(default=1, ge=1, le=1000)
    names: list[str] | None = Field(default=None, min_length=1)


class KeepTable(Table):
    """`[[import.keep]]`: conditions on a log of the trial that a run must meet: `when = "armed == 1 and voltage > 14.5"`.

    Each run is cut to the longest stretch in which every condition holds, between its start and end. Comparisons of columns with numbers
    (`==`, `!=`, `<`, `<=`, `>`, `>=`) are joined by `and`; a number holds from its stamp to the next.
    """

    path: str
    when: str
    table: str | None = None
    time: TimeTable | None = None
    delimiter: str | None = None


class TrimTable(Table):
    """`[import.trim.RUN]`: where one run begins and ends, instead of what `[import]` says for all runs."""

    start: Quantity | None = None
    end: Quantity | None = None


class ImportTable(Table):
    """`[import]`: runs that are fitted jointly, runs that are only predicted, and how their files become records.

    Every run is cut to `start` and `end`, counted from the beginning of the record, where all its files have begun. `split` divides it into
    pieces, each a trial with a start of its own: for long records, and for vehicles that leave their course slowly. `schedule` is the
    table that was commanded; `{run}` stands for the run's label. A run without `start` and `end` is cut to it, and `import` says how
    well it was followed.
    """

    fit: list[str] = Field(min_length=1)
    predict: list[str] = []
    step: Quantity | None = None
    start: Quantity | None = None
    end: Quantity | None = None
    trim: dict[str, TrimTable] = {}
    split: Quantity | None = None
    schedule: str | None = None
    keep: list[KeepTable] = []
    files: list[FileTable] = Field(min_length=1)


class FilterTable(Table):
    """`[filter]`: process noise of the filter, for effects that the model lacks."""

    process_noise: dict[str, Quantity | float] = {}


class EstimationTable(Table):
    """`[estimation]`: likelihood, initial state, noise, current, what varies between trials, and size of the chains.

    | setting | priors that it needs |
    |---|---|
    | `residuals = "coloured"` | `[prior.tau_u]`, the correlation time |
    | `residuals = "drifting"` | `[prior.drift_u]` and `[prior.drift_time_u]`, size and correlation time of the slow part |
    | `likelihood = "filter-error"`, process noise | `[prior.process_u]`, what each state gains in one second |
    | the same, a disturbance | `[prior.disturbance_X]`, its standard deviation in the unit of X_0 |
    | | and `[prior.disturbance_time_X]`, its correlation time |
    | `current` | `[prior.current]` |
    | `varying = ["X_u"]` | `[prior.spread_X_u]`, how much X_u differs between trials |
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
    """`[selection]`: size of the two methods that compute each evidence.

    If a verdict asks for more particles, repeats or draws, raise these.
    """

    particles: int | None = Field(default=None, ge=64, le=1_000_000)
    repeats: int = Field(default=4, ge=2, le=1000)
    draws: int = Field(default=SelectionSettings.draws, ge=1024, le=10_000_000)


class SlurmTable(Table):
    """`[compute.slurm]`: the resources of each job. Its memory is shared by its workers, one on each core."""

    memory: str = Field(pattern=r"^[0-9.]+ ?[kMGT]i?B$")
    walltime: str = Field(pattern=r"^[0-9:-]+$")
    cores: int = Field(default=1, ge=1, le=4096)
    jobs: int = Field(default=1, ge=1, le=10_000)
    queue: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.,-]+$")
    account: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]+$")
    interface: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]+$")


class ComputeTable(Table):
    """`[compute]`: where the computation runs. It does not change any result."""

    workers: str = "local"
    slurm: SlurmTable | None = None


class ChecksTable(Table):
    """`[checks]`: findings that are right but known. Each is then one line, not a caution or an alarm.

    `seatrial explain` lists the codes.
    """

    accept: list[str] = []


class CampaignFile(Table):
    """The whole file."""

    campaign: CampaignTable
    vehicle: VehicleTable
    structure: StructureTable
    prior: dict[str, PriorTable] = {}
    sensors: dict[str, SensorTable] = Field(min_length=1)
    mounts: dict[str, MountTable] = {}
    limits: dict[str, LimitsTable] = {}
    autopilot: dict[str, LoopTable] = {}
    design: DesignTable | None = None
    power: PowerTable | None = None
    goal: GoalTable | None = None
    plan: PlanTable | None = None
    truth: dict[str, float] = {}
    imported: ImportTable | None = Field(default=None, alias="import")
    filter: FilterTable = FilterTable()
    estimation: EstimationTable = EstimationTable()
    selection: SelectionTable = SelectionTable()
    checks: ChecksTable = ChecksTable()
    compute: ComputeTable = ComputeTable()
