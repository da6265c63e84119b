"""What a campaign is told, as plain data in SI: one small class for each part of a campaign file, without the file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import PurePath
from typing import Literal

import numpy as np

from seatrial.estimation.simulation.mounts import Mount
from seatrial.logs.run_conditions import Comparison
from seatrial.logs.source import Between
from seatrial.manoeuvres.autopilot import Loop
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.schedule import Schedule
from seatrial.sampling.names import DEFAULT, SamplerName
from seatrial.selection.rules import CompiledRules
from seatrial.selection.structures import structure_rules
from seatrial.vehicles.thrusters import ThrustLaw

Residuals = Literal["white", "coloured", "heavy", "drifting"]
Scope = Literal["none", "shared", "own"]
"""Whether something is unknown, and if so whether all trials share it or every one has its own."""
Utility = Literal["entropy", "fisher-d", "fisher-a", "fisher-e", "fisher-me", "fisher-c", "discrimination"]
DesignFilter = Literal["square-root-unscented", "unscented", "extended"]


@dataclass(frozen=True)
class StructureSettings:
    """Which terms a model may have.

    Attributes:
        always: terms in every structure.
        optional: terms whose presence the data decide.
        rules: which of them may stand together, see `seatrial.selection.rules`.
        shortlist: most structures that are simulated where a screening has to choose them.
        g: of Zellner's g-prior of the screening, "rows" for one worth one row; None for the stated priors.
    """

    always: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    rules: tuple[str, ...] = ()
    shortlist: int = 6
    g: float | Literal["rows"] | None = None

    def compiled(self) -> CompiledRules:
        """Return which terms may stand together; errors as `structure_rules`."""
        return structure_rules(self.always, self.optional, self.rules)


@dataclass(frozen=True)
class SensorSettings:
    """What is known about the sensor of one channel.

    Attributes:
        noise: standard deviation, SI.
        rate: samples a second; infinitely many where it gives one whenever there is one.
        residuals: their kind; None for that of all sensors.
        bias: whether it has a constant error, and whose.
        lag: whether it answers late.
        over: whether a speed is measured over ground or through the water.
        mount: where it sits, how it is turned, and its scale; None where nothing is said.
    """

    noise: float
    rate: float = inf
    residuals: Residuals | None = None
    bias: Scope = "none"
    lag: bool = False
    over: Literal["ground", "water"] = "ground"
    mount: Mount | None = None


@dataclass(frozen=True)
class RelaySettings:
    """The self-oscillating test: the channel that is fed back, and the thresholds about its trim to try, SI."""

    output: str
    thresholds: tuple[float, ...]


@dataclass(frozen=True)
class StatedPrediction:
    """What the coefficients are wanted for: a state or a track, `after` s once the control is set to `control`, SI."""

    of: str
    control: float
    after: float


@dataclass(frozen=True, eq=False)
class OwnSchedule:
    """A schedule that somebody wrote or recorded.

    Attributes:
        source: its file.
        schedule: controls over time, sampled as designs are, SI.
        skipped: lines between two samples, of which these take nothing.
    """

    source: str
    schedule: Schedule
    skipped: tuple[int, ...] = ()

    @property
    def label(self) -> str:
        """Name of its record."""
        return PurePath(self.source).stem


@dataclass(frozen=True)
class DesignSettings:
    """Designs to try, and what makes one of them the best.

    Attributes:
        family: control, trim and timing that all designs share.
        kinds: shapes of the input that are tried.
        amplitudes: of the control about its trim, SI.
        periods: s.
        utility: what is to be large.
        filter: whose entropy reduction is predicted.
        over: the mean of draws of what is believed, its mean alone, or the worst draw.
        per: what a utility is counted by.
        turnaround: time that a trial takes beside its own, s.
        probability: with which limits of the motion are kept.
        relay: the self-oscillating test.
        prediction: what the coefficients are wanted for.
        own: schedule that is weighed beside the families, and run first; no design of a family depends on it.
    """

    family: Family
    kinds: tuple[str, ...]
    amplitudes: tuple[float, ...]
    periods: tuple[float, ...]
    utility: Utility = "entropy"
    filter: DesignFilter = "square-root-unscented"
    over: Literal["mean", "local", "worst"] = "mean"
    per: Literal["trial", "joule", "second"] = "trial"
    turnaround: float = 0.0
    probability: float = 0.95
    relay: RelaySettings | None = None
    prediction: StatedPrediction | None = None
    own: OwnSchedule | None = field(default=None, compare=False)

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Return amplitudes, SI, and periods, s."""
        return np.array(self.amplitudes), np.array(self.periods)


@dataclass(frozen=True)
class AutopilotSettings:
    """The loops of the autopilot, none where there is none, and the set-point of each while a trial leaves it alone, SI."""

    loops: tuple[Loop, ...] = ()
    set_points: tuple[float, ...] = ()

    @property
    def trim(self) -> dict[str, float]:
        """Set-points by name, SI."""
        return {loop.set_point: value for loop, value in zip(self.loops, self.set_points, strict=True)}

    @property
    def moved(self) -> dict[str, float]:
        """All that loops move, with 0: what is added where nothing else is said."""
        return {name: 0.0 for loop in self.loops for name, _ in loop.moves}


@dataclass(frozen=True)
class Power:
    """What a trial draws from the battery: `propulsion` W at the control `at`, SI, and beside it `hotel` W."""

    propulsion: float
    at: float
    hotel: float


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


@dataclass(frozen=True)
class PlanSettings:
    """What a day at sea allows.

    Attributes:
        time: on the water, s; infinite where nothing is said.
        battery: energy of it, J; infinite where nothing is said.
        turnaround: time that a trial takes beside its own, s.
        chance: of meeting the goals from which on no trial is added.
    """

    time: float = inf
    battery: float = inf
    turnaround: float = 0.0
    chance: float = 0.9


@dataclass(frozen=True)
class LogColumn:
    """Column that holds a channel, in a unit; multiplied by `scale`, then `offset` is added; `curve` names a table to read it off.

    Of a sum of columns, `column` is the sum as it was written, and `parts` are its factors and columns. `law` is that of a thruster, whose
    command the column or the sum is, after `offset` is added; `scale` then multiplies the thrust. `between` says what a control does
    between its samples; None where that is not said.
    """

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    curve: str | None = None
    parts: tuple[tuple[float, str], ...] = ()
    law: ThrustLaw | None = None
    between: Between | None = None


@dataclass(frozen=True)
class LogFile:
    """One log of a trial.

    Attributes:
        path: with `{run}` in place of the run's label, relative to the campaign's folder.
        channels: by name.
        table: topic, type of message, struct or variable, where a log has several.
        time: column that holds time; None for the clock of the format.
        time_unit: its unit; None where the log states it.
        clock: how time stamps are taken.
        shift: added to them, s.
        axes: of the body and the earth.
        delimiter: between columns of text; None to find it out.
        encoding: of text.
        skip_rows: before the header.
        header_rows: of the header.
        names: of all columns, where there is no header.
        layout: which of the last five are stated; a log that is no text must not be told them.
        runs: that have this log; none where all have.
    """

    path: str
    channels: Mapping[str, LogColumn]
    table: str | None = None
    time: str | None = None
    time_unit: str | None = None
    clock: Literal["as_stamped", "even", "drop_repeated"] = "as_stamped"
    shift: float = 0.0
    axes: Literal["NED", "ENU"] = "NED"
    delimiter: str | None = None
    encoding: str = "utf-8"
    skip_rows: int = 0
    header_rows: int = 1
    names: tuple[str, ...] | None = None
    layout: tuple[str, ...] = field(default=(), compare=False)
    runs: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeepRule:
    """When a run is what it is taken for.

    Attributes:
        path: of a log, with `{run}` in place of the run's label.
        when: the condition as written.
        condition: its comparisons.
        table: topic or type of message, where the log has several.
        time: column that holds time; None for the clock of the format.
        time_unit: its unit; None where the log states it.
        delimiter: between columns of text; None to find it out.
    """

    path: str
    when: str
    condition: tuple[Comparison, ...]
    table: str | None = None
    time: str | None = None
    time_unit: str | None = None
    delimiter: str | None = None


@dataclass(frozen=True)
class Imports:
    """Runs, and how their logs become records.

    Attributes:
        fit: runs that are fitted jointly.
        predict: runs that are only predicted.
        files: logs of each run.
        step: between samples, s; None for that of the logs.
        split: length of the pieces into which a run is cut, s; None to leave it whole.
        ends: of each run, where it starts and ends, s from where its logs overlap, as far as anything is said.
        own_ends: runs whose ends are stated for themselves.
        schedule: table that was commanded, with `{run}` in place of the run's label; None where that is not known.
        keep: conditions to whose longest common stretch every run is cut.
    """

    fit: tuple[str, ...]
    predict: tuple[str, ...]
    files: tuple[LogFile, ...]
    step: float | None = None
    split: float | None = None
    ends: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    own_ends: tuple[str, ...] = ()
    schedule: str | None = None
    keep: tuple[KeepRule, ...] = ()

    @property
    def runs(self) -> tuple[str, ...]:
        """All runs, those that are fitted first."""
        return (*self.fit, *self.predict)

    def of(self, run: str) -> dict[int, LogFile]:
        """Return the logs of one run, by their places in `files`."""
        return {index: file for index, file in enumerate(self.files) if not file.runs or run in file.runs}


@dataclass(frozen=True)
class EstimationSettings:
    """Likelihood, where trials begin, residuals, a current along the course, what varies between trials, and the chains."""

    likelihood: Literal["output-error", "filter-error"] = "output-error"
    initial: Literal["trim", "measured", "estimated"] = "trim"
    residuals: Residuals = "white"
    current: Scope = "none"
    varying: tuple[str, ...] = ()
    sampler: SamplerName = DEFAULT
    chains: int = 32
    warmup: int = 500
    draws: int = 1500
    thin: int = 1

    @property
    def lengths(self) -> tuple[int, ...]:
        """Draws after which chains are looked at, and end if they agree: as many as asked for, then twice and four times as many."""
        return tuple(times * self.draws for times in (1, 2, 4))

    @property
    def free_initial(self) -> bool:
        """Whether initial states are parameters, fitted to the whole run; a filter takes them as uncertain anyway."""
        return self.initial == "estimated" and self.likelihood == "output-error"


@dataclass(frozen=True)
class SelectionSettings:
    """Particles and independent repeats of tempered SMC behind each evidence, and draws of the importance sampling beside it."""

    particles: int | None = None
    repeats: int = 4
    draws: int = 20480


@dataclass(frozen=True)
class SlurmJobs:
    """What each of some jobs asks SLURM for."""

    memory: str
    walltime: str
    cores: int = 1
    jobs: int = 1
    queue: str | None = None
    account: str | None = None
    interface: str | None = None


@dataclass(frozen=True)
class ComputeSettings:
    """Where work is done, which is no part of what is computed: `local`, `slurm`, or the address of a Dask scheduler."""

    workers: str = "local"
    slurm: SlurmJobs | None = None
