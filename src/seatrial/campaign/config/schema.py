"""The tables of a campaign's TOML file, which are the settings of a campaign too: each key with its unit, its default and its meaning.

What a file writes as a quantity, such as "200 rpm", is SI here. A table that depends on the vehicle is completed by the reader beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from seatrial.campaign.config.autopilot_table import LoopTable
from seatrial.campaign.config.design_table import DesignTable, LimitsTable, PowerTable
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.quantities import (
    Name,
    Quantity,
    Residuals,
    Scope,
    Several,
    Table,
    Turnaround,
    Unit,
    noted,
    refused,
    without_effect,
)
from seatrial.campaign.config.sensor_table import MountTable, SensorTable
from seatrial.campaign.config.vehicle_table import VehicleTable
from seatrial.sampling.names import DEFAULT, SamplerName
from seatrial.selection.rules import CompiledRules
from seatrial.selection.structure_prior import StructurePrior
from seatrial.selection.structures import MAX_STRUCTURES, structure_rules

StatedShare = Annotated[float, Field(gt=0.0, lt=1.0)] | Literal["exact"]
StatedCount = Annotated[float, Field(gt=0.0, lt=100.0)] | Literal["exact"]
Joules = Annotated[float, Unit("J", above=0.0, remedy='for example battery = "500 W h"')]
MIN_KEPT_DRAWS = 20  # Draws that are kept of a chain: its first tenth is compared with its last half


class CampaignTable(Table):
    """`[campaign]`: the name of the campaign, and the seed of all random numbers."""

    name: Name = Field(description="title of the campaign, shown in the report")
    seed: int = Field(
        ge=0, lt=2**63, description="start of all random numbers: the same seed gives the same results, bit for bit"
    )


class StructureTable(Table):
    """`[structure]`: terms of every model, terms that the data may keep or drop, and rules for their combination.

    Rules are lines such as "X_uabsu requires X_u", "together X_u X_uabsu", "at most one of X_u3 X_du3", "never X_0", "heredity".
    If they leave more than 64 structures, a screening in closed form chooses at most `shortlist` of them to be
    simulated. It uses the stated priors or Zellner's g-prior. The g-prior has its mean at zero and g times the variance
    of least squares. With "rows" it has the information of one row.
    """

    always: Several[str] = Field(default=(), description="terms that every structure has, by name")
    optional: Several[str] = Field(
        default=(), description="terms that the data may keep or drop; all subsets are compared"
    )
    rules: Several[str] = Field(default=(), description="rules for combinations of terms, one in each line")
    shortlist: int = Field(
        default=6,
        ge=2,
        le=64,
        description="number of structures that are simulated, if there are more than 64 and a screening has to choose",
    )
    g: Annotated[float, Field(gt=0.0)] | Literal["rows"] | None = Field(
        default=None, description="g of Zellner's g-prior, which then replaces the stated priors in the screening"
    )

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        for key in sorted({"shortlist", "g"} & self.model_fields_set):
            if 2 ** len(self.optional) <= MAX_STRUCTURES:
                raise without_effect(
                    key, f"all of {MAX_STRUCTURES} structures or fewer are simulated, and none screened"
                )
        if "T_f" in self.optional:
            raise refused(
                "T_f, the thrust of a commanded newton",
                "T_f in every structure: without it a command makes no thrust",
                "move it to always",
                key="optional",
            )
        return self

    def compiled(self) -> CompiledRules:
        """Return which terms may stand together; errors as `structure_rules`."""
        return structure_rules(self.always, self.optional, self.rules)


_OF_PRIOR: Any = {"unit": "SI, or `unit`"}


class PriorTable(Table):
    """`[prior.NAME]`: the plausible values of a coefficient before the trial.

    | distribution | numbers |
    |---|---|
    | uniform, log-uniform | `lower`, `upper` |
    | normal | `mean`, `sd` |
    | truncated-normal | `mean` and `sd` of the normal before it is cut, and `lower`, `upper` or both |
    | half-normal | `scale`, and the bound it falls off from, `lower` or `upper`; 68 % lie within `scale` of it |
    | log-normal | `median`, whose sign all values have, and `factor`; 68 % lie within that factor of the median |

    `dissipative = true` cuts the prior to the side that physics allows. Damping dissipates (`X_u` and `X_uabsu` below
    0), and mass plus added mass is positive (`X_udot` below the mass).
    """

    model_config = ConfigDict(allow_inf_nan=True)  # `read_prior` says what to write instead

    distribution: Literal["uniform", "log-uniform", "normal", "half-normal", "log-normal", "truncated-normal"] = Field(
        description="form of the prior; the table above has the numbers of each form"
    )
    lower: float | None = Field(default=None, description="lower bound", json_schema_extra=_OF_PRIOR)
    upper: float | None = Field(default=None, description="upper bound", json_schema_extra=_OF_PRIOR)
    mean: float | None = Field(default=None, description="mean of a normal", json_schema_extra=_OF_PRIOR)
    sd: float | None = Field(default=None, description="standard deviation of a normal", json_schema_extra=_OF_PRIOR)
    scale: float | None = Field(
        default=None, description="width of a half-normal: 68 % lie within it", json_schema_extra=_OF_PRIOR
    )
    median: float | None = Field(
        default=None, description="median of a log-normal, with its sign", json_schema_extra=_OF_PRIOR
    )
    factor: float | None = Field(
        default=None, description="spread of a log-normal: 68 % lie within this factor of the median"
    )
    unit: str | None = Field(default=None, description="unit of the numbers above, if it is not SI")
    dissipative: bool = Field(default=False, description="cut the prior to the side that physics allows")


class GoalTable(Table):
    """`[goal]`: the end of the campaign. A standard deviation is a quantity or a percentage of the value ("10 %").

    If only `trials` is given, all of them are run.
    """

    sd: dict[str, Quantity | float] = Field(
        default={},
        description="standard deviation wanted of each coefficient",
        json_schema_extra={"unit": "that of the coefficient, or percentage"},
    )
    decided: bool = Field(default=False, description="whether one structure must have 95 % of the probability")
    trials: int = Field(default=5, ge=1, le=100, description="most trials to run")


class PlanTable(Table):
    """`[plan]`: limits of a day at sea. `seatrial plan` adds no trial once the `chance` of meeting the goals is reached."""

    time: Annotated[float, Unit("s", above=0.0, expected="more than 0", remedy='for example time = "4 h"')] = Field(
        default=inf, description="time on the water, all trials with their turnaround"
    )
    battery: Joules = Field(default=inf, description="energy for all trials, by [power]")
    turnaround: Turnaround = Field(default=0.0, description="time between trials, such as the way back")
    chance: float = Field(
        default=0.9, gt=0.0, lt=1.0, description="chance of meeting all goals at which no further trial is added"
    )


class FilterTable(Table):
    """`[filter]`: process noise of the filter, for effects that the model lacks."""

    process_noise: dict[str, Quantity | float] = Field(
        default={},
        description="growth of the standard deviation of each state or coefficient in one second, by name",
        json_schema_extra={"unit": "SI, or a quantity"},
    )


class EstimationTable(Table):
    """`[estimation]`: likelihood, initial state, noise, current, differences between trials, and size of the chains.

    | setting | priors that it needs |
    |---|---|
    | `residuals = "coloured"` | `[prior.tau_u]`, the correlation time |
    | `residuals = "drifting"` | none: `[prior.drift_u]` and `[prior.drift_time_u]`, size and time of the slow part, have defaults |
    | `likelihood = "filter-error"`, process noise | `[prior.process_u]`, gain of each state in one second |
    | the same, a disturbance | `[prior.disturbance_X]`, its standard deviation in the unit of X_0 |
    | | and `[prior.disturbance_time_X]`, its correlation time |
    | `current` | `[prior.current]` |
    | `varying = ["X_u"]` | `[prior.spread_X_u]`, the standard deviation of X_u between trials |
    | `by_configuration = ["X_u"]` | `[prior.X_u]`, of every configuration; or a separate one, `[prior."X_u@loaded"]` |
    """

    likelihood: Literal["output-error", "filter-error"] = Field(
        default="output-error", description="source of the misfit: [which likelihood?](../how-to/likelihoods.md)"
    )
    initial: Literal["trim", "measured", "estimated"] = Field(
        default="trim",
        description="initial state of each trial: trim, the first measurement, or unknown values that are estimated",
    )
    residuals: Residuals = Field(
        default="white", description="form of the noise: [which likelihood?](../how-to/likelihoods.md)"
    )
    current: Scope = Field(
        default="none", description="an unknown steady current along the course: one for all trials, or one for each"
    )
    varying: Several[str] = Field(default=(), description="coefficients that differ from trial to trial")
    start_values: dict[str, float] = Field(
        default={},
        description="values from which the search for the posterior mode begins too, by name; the search keeps the highest mode, and no "
        "prior changes",
        json_schema_extra={"unit": "SI"},
    )
    by_configuration: Several[str] | None = Field(
        default=None,
        description="coefficients and other unknowns of the vehicle with a value for each configuration; `net_weight` and `z_b` by "
        "default, if they have a prior",
    )
    inertia_error: StatedShare = Field(
        default=0.05,
        description='standard deviation of each stated inertia, including added mass, as a share; or "exact"',
    )
    scale_error: StatedShare = Field(
        default=0.01, description='standard deviation of the scale of each velocity sensor, as a share; or "exact"'
    )
    clock_error: StatedCount = Field(
        default=0.5,
        description='standard deviation of the time between commands and motion, in intervals of the samples; or "exact"',
    )
    force_error: StatedShare = Field(
        default=0.07,
        description='standard deviation of the forces of motion, and of those of commands, about their formulas, as a share; or "exact"',
    )
    sampler: SamplerName = Field(
        default=DEFAULT, description="sampler of the posterior: [samplers](../explanation/samplers.md)"
    )
    chains: int = Field(default=32, ge=2, le=1024, description="number of chains")
    warmup: int = Field(
        default=500,
        ge=100,
        le=1_000_000,
        multiple_of=100,
        description="draws at the start of each chain that are discarded",
    )
    draws: int = Field(
        default=1500,
        ge=100,
        le=1_000_000,
        multiple_of=100,
        description="draws of each chain after that; doubled once or twice if chains disagree or have too few effective draws",
    )
    thin: Literal[1, 2, 4, 5, 10, 20, 25, 50, 100] = Field(default=1, description="keep one draw of this many")

    @model_validator(mode="after")
    def _check_kept(self) -> Self:
        if (kept := self.draws // self.thin) < MIN_KEPT_DRAWS:
            raise refused(
                f"one of {self.thin} kept, {kept} of {self.draws} draws of each chain",
                f"{MIN_KEPT_DRAWS} draws or more of each chain, to judge its convergence",
                "thin less, or ask for more draws",
                key="thin",
            )
        return self

    @property
    def lengths(self) -> tuple[int, ...]:
        """Draws after which chains are examined, and end if they agree: as many as asked for, then twice and four times as many."""
        return tuple(times * self.draws for times in (1, 2, 4))

    @property
    def free_initial(self) -> bool:
        """Whether initial states are parameters, fitted to the whole run; a filter takes them as uncertain anyway."""
        return self.initial == "estimated" and self.likelihood == "output-error"


class SelectionTable(Table):
    """`[selection]`: prior of the structures, size of the method that computes each evidence, and of the one that checks it if a decision
    depends on it.

    If a verdict asks for more particles, repeats or draws, raise these.
    """

    structure_prior: StructurePrior = Field(
        default="equal",
        description="what is equally probable before the data: every structure, or with `multiplicity` every number of optional terms: "
        "[which prior?](../how-to/structures.md#many-optional-terms)",
    )

    particles: int | None = Field(
        default=None,
        ge=64,
        le=1_000_000,
        description="particles of the tempered SMC that checks an evidence; if not given, the larger of 512 and 64 for each parameter",
    )
    repeats: int = Field(default=4, ge=2, le=1000, description="independent repeats of it")
    draws: int = Field(
        default=8192, ge=1024, le=10_000_000, description="draws of the importance sampling that gives each evidence"
    )


class SlurmTable(Table):
    """`[compute.slurm]`: the resources of each job. Its memory is shared by its workers, one on each core."""

    memory: str = Field(pattern=r"^[0-9.]+ ?[kMGT]i?B$", description="memory of each job, such as `4 GB`")
    walltime: str = Field(pattern=r"^[0-9:-]+$", description="time limit of each job, as SLURM writes it")
    cores: int = Field(default=1, ge=1, le=4096, description="cores of each job, one worker on each")
    jobs: int = Field(default=1, ge=1, le=10_000, description="number of jobs")
    queue: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.,-]+$", description="partition to submit to")
    account: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]+$", description="account to charge")
    interface: str | None = Field(
        default=None, pattern=r"^[A-Za-z0-9_.-]+$", description="network interface of the workers"
    )


class ComputeTable(Table):
    """`[compute]`: place of the computation. It does not change any result."""

    workers: str = Field(
        default="local",
        description="place of the work: `local`, `slurm`, or the address of a Dask scheduler such as "
        "`tcp://10.0.0.1:8786`",
    )
    slurm: SlurmTable | None = Field(default=None, description="resources of each job, `[compute.slurm]`")


@dataclass(frozen=True)
class Goal:
    """What ends a campaign.

    Attributes:
        shares: standard deviation wanted of a coefficient, as a share of its value.
        sds: standard deviation wanted, SI.
        decided: whether one structure is to hold 95 % of the probability.
        trials: most trials to run; where nothing else is asked for, the goal is met once these are run.
    """

    shares: Mapping[str, float] = field(default_factory=dict)
    sds: Mapping[str, float] = field(default_factory=dict)
    decided: bool = False
    trials: int = 5

    @property
    def only_trials(self) -> bool:
        """Whether nothing is asked for but a number of trials: all of them are run then."""
        return not (self.shares or self.sds or self.decided)

    def unmet(self, known: Mapping[str, tuple[float, float]]) -> dict[str, float]:
        """Coefficients not yet known well enough, each with its standard deviation over the one wanted.

        Args:
            known: name to mean and standard deviation, SI; a coefficient that is missing here is not in the structure.
        """
        wanted = {name: share * abs(known[name][0]) for name, share in self.shares.items() if name in known}
        wanted |= {name: sd for name, sd in self.sds.items() if name in known}
        return {name: known[name][1] / sd for name, sd in wanted.items() if known[name][1] > sd}


class ChecksTable(Table):
    """`[checks]`: findings that are right but known. Each is then one line, not a caution or an alarm.

    `seatrial explain` lists the codes.
    """

    accept: Several[str] = Field(default=(), description="codes of findings that are accepted, such as `clock-shift`")


class CampaignFile(Table):
    """The whole file."""

    campaign: CampaignTable
    vehicle: VehicleTable
    structure: StructureTable
    prior: dict[str, PriorTable] = Field(default={})
    sensors: dict[Annotated[str, noted("channel")], SensorTable] = Field(min_length=1)
    mounts: dict[str, MountTable] = Field(default={})
    limits: dict[Annotated[str, noted("limited")], LimitsTable] = Field(default={})
    autopilot: dict[Annotated[str, noted("channel")], LoopTable] = Field(default={})
    design: DesignTable | None = None
    power: PowerTable | None = None
    goal: GoalTable | None = None
    plan: PlanTable | None = None
    truth: dict[str, float] = Field(default={})
    imported: ImportTable | None = Field(default=None, alias="import")
    filter: FilterTable = FilterTable()
    estimation: EstimationTable = EstimationTable()
    selection: SelectionTable = SelectionTable()
    checks: ChecksTable = ChecksTable()
    compute: ComputeTable = ComputeTable()


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file, by which editors complete keys, show their meaning, and mark mistakes."""
    return {"$schema": "http://json-schema.org/draft-07/schema#", **_for_editors(CampaignFile.model_json_schema())}


def _for_editors(node: Any) -> Any:
    """Return a part of the schema as a file is written: units in the text, defaults with their unit, and no null, which TOML lacks."""
    if isinstance(node, list):
        return [_for_editors(one) for one in node]
    if not isinstance(node, dict):
        return node
    node = {key: _for_editors(one) for key, one in node.items() if not (key == "title" and isinstance(one, str))}
    if node.get("default", 0) in (None, inf):
        del node["default"]
    if "anyOf" in node:
        kinds = [one for one in node.pop("anyOf") if one != {"type": "null"}]
        node = {**kinds[0], **node} if len(kinds) == 1 else {**node, "anyOf": kinds}
    if isinstance(unit := node.pop("unit", None), str):
        if isinstance(default := node.get("default"), float) and not unit.startswith("that"):
            node["default"] = f"{default:g} {unit}"
        if "description" in node:
            node["description"] = f"{node['description']} [{unit}]"
        else:  # one of several kinds, or of a list
            node["description"] = f"[{unit}]"
    elif unit is not None:
        node["unit"] = unit
    return node
