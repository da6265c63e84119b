"""The keys of a campaign's TOML file. Quantities with a dimension are strings with a unit, such as "200 rpm"."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Quantity = str


class Table(BaseModel):
    """A TOML table: unknown keys are refused, and nothing is converted silently."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class CampaignTable(Table):
    """`[campaign]`: its name, and the seed of everything random."""

    name: str
    seed: int = Field(ge=0, lt=2**63)


class VehicleTable(Table):
    """`[vehicle]`: a catalogue name, or mass ("unknown" for coefficients per unit mass), thrust deduction and fixed coefficients."""

    catalogue: str | None = None
    name: str | None = None
    mass: Quantity | None = None
    thrust_deduction: float = 0.0
    fixed: dict[str, float] = {}
    trim: dict[str, Quantity] = {}


class StructureTable(Table):
    """`[structure]`: terms always there, and terms whose presence the data decide."""

    always: list[str] = []
    optional: list[str] = []


class PriorTable(Table):
    """`[prior.NAME]`: uniform or log-uniform between `lower` and `upper`, or normal by `mean` and `sd`; `unit` if not SI."""

    distribution: Literal["uniform", "log-uniform", "normal"]
    lower: float | None = None
    upper: float | None = None
    mean: float | None = None
    sd: float | None = None
    unit: str | None = None


class SensorTable(Table):
    """`[sensors.CHANNEL]`: standard deviation of its noise, and its rate if lower than the sample rate."""

    noise: Quantity
    rate: Quantity | None = None


class LimitsTable(Table):
    """`[limits.CONTROL]`: bounds of a control and of its rate of change."""

    lower: Quantity | None = None
    upper: Quantity | None = None
    rate: Quantity | None = None


class RangeTable(Table):
    """An evenly spaced range of a quantity."""

    start: Quantity = Field(alias="from")
    stop: Quantity = Field(alias="to")
    points: int = Field(ge=1, le=1000)


class DesignTable(Table):
    """`[design]`: the family of repeated doublets that is swept."""

    control: str
    trim: Quantity | None = None
    duration: Quantity
    active: Quantity
    start: Quantity = "1 s"
    ramp: Quantity = "0 s"
    sample_time: Quantity
    amplitude: RangeTable
    period: RangeTable


class TimeTable(Table):
    """Which column holds time, and in which unit."""

    column: str
    unit: str


class ColumnTable(Table):
    """Which column holds a channel, in which unit; `scale` multiplies it, -1 to turn an axis round."""

    column: str
    unit: str
    scale: float = 1.0


class FileTable(Table):
    """`[[import.files]]`: one file of a trial; `{run}` in the path stands for the run's label."""

    path: str
    time: TimeTable
    channels: dict[str, ColumnTable]
    clock: Literal["as_stamped", "even", "drop_repeated"] = "as_stamped"
    delimiter: str | None = None
    encoding: str = "utf-8"
    skip_rows: int = Field(default=0, ge=0)


class ImportTable(Table):
    """`[import]`: runs that are fitted jointly, runs that are only predicted, and how their files become records."""

    fit: list[str] = Field(min_length=1)
    predict: list[str] = []
    step: Quantity | None = None
    start: Quantity | None = None
    end: Quantity | None = None
    files: list[FileTable] = Field(min_length=1)


class FilterTable(Table):
    """`[filter]`: what the model leaves out, as the standard deviation that each state or coefficient gains in one second."""

    process_noise: dict[str, Quantity | float] = {}


class EstimationTable(Table):
    """`[estimation]`: initial state, colour of the residuals, size of the chains."""

    initial: Literal["trim", "measured", "estimated"] = "trim"
    residuals: Literal["white", "coloured"] = "white"
    chains: int = Field(default=32, ge=2, le=1024)
    warmup: int = Field(default=1000, ge=100, multiple_of=100)
    draws: int = Field(default=4000, ge=100, multiple_of=100)
    thin: Literal[1, 2, 4, 5, 10, 20, 25, 50, 100] = 1


class SelectionTable(Table):
    """`[selection]`: particles and independent repeats of the tempered SMC behind each evidence."""

    particles: int = Field(default=1024, ge=64)
    repeats: int = Field(default=4, ge=2)


class CampaignFile(Table):
    """The whole file."""

    campaign: CampaignTable
    vehicle: VehicleTable
    structure: StructureTable
    prior: dict[str, PriorTable]
    sensors: dict[str, SensorTable] = Field(min_length=1)
    limits: dict[str, LimitsTable] = {}
    design: DesignTable
    truth: dict[str, float] = {}
    imported: ImportTable | None = Field(default=None, alias="import")
    filter: FilterTable = FilterTable()
    estimation: EstimationTable = EstimationTable()
    selection: SelectionTable = SelectionTable()
