"""A campaign as plain data in SI; where it was read from a file, errors name the key and its line."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from math import inf
from pathlib import Path

import numpy as np

from seatrial.campaign.config.assumed_unknowns import assumed_unknowns, no_unknown_prior
from seatrial.campaign.config.autopilot_table import AutopilotSettings
from seatrial.campaign.config.design_table import DesignTable, OwnSchedule, PowerTable
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.quantities import Residuals
from seatrial.campaign.config.schema import (
    ComputeTable,
    EstimationTable,
    Goal,
    PlanTable,
    SelectionTable,
    StructureTable,
)
from seatrial.campaign.config.sensor_table import ATTITUDE, SensorTable
from seatrial.campaign.config.templates import EXAMPLE_VEHICLE
from seatrial.campaign.config.toml import key_lines, key_place
from seatrial.campaign.config.vehicle import CampaignVehicle
from seatrial.campaign.store.stored_result import FILE_NAME
from seatrial.core.coefficients import base_name, configuration_name
from seatrial.core.display_units import Shown, shown_as_written, shown_unit
from seatrial.core.errors import InputError, located
from seatrial.core.signals import ACTUAL, PROPULSION, QUATERNION
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.prior_belief import ACTUATOR_SD
from seatrial.design.stated_prediction import Prediction, prediction
from seatrial.design.sweep import Trim
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.record_posterior import BY_CONFIGURATION
from seatrial.estimation.posterior.unknowns import Unknown, may_differ, slow_noise_priors, unknowns_of
from seatrial.estimation.priors import Prior
from seatrial.estimation.simulation.mounts import Mount
from seatrial.estimation.simulation.sensor_errors import Sensor, bias_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.estimation.simulation.starts import level_start
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.selection.rules import CompiledRules
from seatrial.selection.structure_prior import log_priors
from seatrial.selection.structures import MAX_STRUCTURES, Structure, all_structures, count_structures
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """Vehicle, priors, sensors, trials and goals of a campaign, all in SI.

    Attributes:
        name: in headings.
        seed: of everything random.
        vehicle: its known properties.
        structure: terms that its model may have.
        priors: of coefficients, delay and nuisances, by name, SI.
        prior_units: units in which priors are written, by name; SI if nothing is said.
        sensors: by the channel that each measures.
        mounts: place, turn and scale of sensors, by channel.
        trial_design: the compared trials; None if imported runs are fitted, and none is designed.
        own_schedule: schedule that is compared with the families, and run first; no design of a family depends on it.
        control_limits: of controls, by name, SI.
        motion_limits: of the motion.
        autopilot: through which trials run.
        power: that a trial draws; None if not stated.
        goal: end of the campaign; None if not stated.
        plan: time and energy of a day at sea.
        truth: of a simulated vehicle, by coefficient, with its current and lag, SI; empty for real ones.
        imports: runs and their logs; None if trials are simulated, or none has been run.
        process_noise: standard deviation that a state or coefficient gains in one second, SI; 0 if not stated.
        estimation: likelihood and chains.
        selection: prior of the structures, and effort behind each evidence.
        compute: where work is done.
        accepted: codes of known findings.
        priors_from: folders of earlier campaigns that give priors and fixed coefficients.
        folder: of results, and of files that are named relative to it.
        text: the campaign file, for the line of a key; empty if there is none. Results do not depend on it.
        shortlist: structures that a screening leaves, if there are too many to simulate each.
    """

    name: str
    seed: int
    vehicle: CampaignVehicle
    structure: StructureTable
    priors: Mapping[str, Prior]
    sensors: Mapping[str, SensorTable]
    trial_design: DesignTable | None
    mounts: Mapping[str, Mount] = field(default_factory=dict)
    prior_units: Mapping[str, str] = field(default_factory=dict)
    own_schedule: OwnSchedule | None = None
    control_limits: Mapping[str, Limits] = field(default_factory=dict)
    motion_limits: tuple[MotionLimit, ...] = ()
    autopilot: AutopilotSettings = AutopilotSettings()
    power: PowerTable | None = None
    goal: Goal | None = None
    plan: PlanTable = PlanTable()
    truth: Mapping[str, float] = field(default_factory=dict)
    imports: ImportTable | None = None
    process_noise: Mapping[str, float] = field(default_factory=dict)
    estimation: EstimationTable = EstimationTable()
    selection: SelectionTable = SelectionTable()
    compute: ComputeTable = ComputeTable()
    accepted: frozenset[str] = frozenset()
    priors_from: tuple[str, ...] = ()
    folder: Path = Path()
    text: str = ""
    shortlist: tuple[Structure, ...] = ()

    @property
    def path(self) -> Path:
        """The TOML file."""
        return self.folder / FILE_NAME

    def where(self, key: str) -> str:
        """Name a key, and its line if there is a file, for errors."""
        return key_place(self.path, self.text, key) if self.text else f'campaign "{self.name}", key {key}'

    def where_of_prior(self, key: str) -> str:
        """Name the source of a prior such as `prior.sigma_u`, for errors: its section, or the noise that makes a usual one."""
        name = base_name(key.removeprefix("prior."))
        if not self.text or f"prior.{name}" in key_lines(self.text):
            return self.where(f"prior.{name}")
        kind, _, channel = name.partition("_")
        noise = f"sensors.{ATTITUDE if channel in QUATERNION else channel}.noise"
        return (
            self.where(noise) if kind == "sigma" and noise in key_lines(self.text) else f"{self.path}, key prior.{name}"
        )

    @cached_property
    def rules(self) -> CompiledRules:
        """Which terms may stand together."""
        with located(self.where("structure")):
            return self.structure.compiled()

    @cached_property
    def full(self) -> Structure:
        """All terms that any structure may have; its own candidate where the rules allow that."""
        terms = self.rules.always + self.rules.optional
        if not self.is_large and set(self.structures[0].terms) == set(terms):
            return self.structures[0]
        return Structure("full", terms)

    @property
    def is_large(self) -> bool:
        """Whether there are more structures than can be simulated, so that a screening has to come first."""
        return count_structures(self.rules) > MAX_STRUCTURES

    @cached_property
    def structures(self) -> tuple[Structure, ...]:
        """Candidate structures, those of most terms first."""
        with located(self.where("structure")):
            return self.shortlist or all_structures(self.rules)

    def log_prior(self, structure: Structure) -> float:
        """Log prior of one candidate, nats, but for a constant."""
        return float(log_priors([structure], self.structure.optional, self.selection.structure_prior)[0])

    @property
    def hull(self) -> Hull:
        """Known properties of the vehicle."""
        return self.vehicle.hull

    def model(self, structure: Structure) -> VehicleModel:
        """Vehicle model of one candidate."""
        with located(self.where("vehicle")):
            return self.vehicle.model(structure)

    @cached_property
    def units(self) -> Mapping[str, str]:
        """SI unit of every coefficient that any structure may have."""
        model = self.model(self.full)
        return {term.text: model.unit_of(term) for term in model.coefficients}

    @cached_property
    def shown(self) -> Shown:
        """Units in which parameters are shown: those in which their priors are written."""
        return shown_as_written(self.prior_units)

    def check_no_autopilot(self, what: str, because: str = "") -> None:
        """Check that trials act directly on the controls, for methods without an autopilot, in words, with the reason.

        Raises:
            InputError: trials run through an autopilot.
        """
        if self.autopilot.loops:
            raise InputError(
                self.where(f"autopilot.{self.autopilot.loops[0].holds}"),
                found=f"trials through an autopilot, with {what}{because and ', ' + because}",
                expected="trials that act directly on the controls",
                remedy=f"leave out {what}; the designs of the families, --free-form, --search and --trials run through the autopilot",
            )

    @property
    def channels(self) -> tuple[str, ...]:
        """Measured channels."""
        return tuple(self.sensors)

    @property
    def noise(self) -> Mapping[str, float]:
        """Nominal noise of every channel, SI."""
        return {channel: sensor.noise for channel, sensor in self.sensors.items()}

    @property
    def channel_trim(self) -> Mapping[str, float]:
        """Trim of every channel that is a state, SI."""
        model = self.model(self.full)
        return dict(zip(model.states, self.state_trim(model), strict=True))

    @cached_property
    def sensor_models(self) -> tuple[Sensor, ...]:
        """Measured channels with what is unknown about them."""
        return sensor_models(self.sensors, self.mounts, self.estimation.residuals)

    @cached_property
    def own(self) -> tuple[str, ...]:
        """Names of the unknowns of which every trial has its own."""
        biases = [bias_name(channel) for channel, one in self.sensors.items() if one.bias == "own"]
        return tuple(biases + [CURRENT] * (self.estimation.current == "own"))

    @property
    def configurations(self) -> tuple[str, ...]:
        """Configurations of the vehicle in the fitted runs, each once; none if none is named."""
        return () if self.imports is None else self.imports.configurations

    def by_configuration(self, model: VehicleModel) -> tuple[str, ...]:
        """Return the unknowns of a model that have a value for each configuration."""
        stated = self.estimation.by_configuration
        names = BY_CONFIGURATION if stated is None else stated
        return tuple(name for name in may_differ(model) if name in names) if self.configurations else ()

    def in_next_trial(self, term: str) -> str:
        """Return the parameter that a coefficient is in the next trial: of the configuration of the last fitted run, if it differs."""
        if self.imports is None or term not in self.by_configuration(self.model(self.full)):
            return term
        return configuration_name(term, self.imports.configuration(self.imports.fit[-1]))

    def measured_mask(self, time: np.ndarray) -> np.ndarray:
        """1 at the samples of each sensor, 0 between, shape (n, m)."""
        columns = []
        for sensor in self.sensors.values():
            every = round(1.0 / (sensor.rate * (time[1] - time[0])))
            columns.append((np.arange(time.size) % max(every, 1) == 0).astype(float))
        return np.column_stack(columns)

    def process_sds(self, model: VehicleModel) -> np.ndarray:
        """Standard deviation that each state and coefficient of a model gains in one second, SI; see `ACTUATOR_SD`."""
        names = (*model.states, *(term.text for term in model.coefficients))
        return np.array([self.process_noise.get(name, ACTUATOR_SD * name.endswith(ACTUAL)) for name in names])

    def expected_process(self, model: VehicleModel) -> tuple[float, ...] | None:
        """Return the growth of each state in one second by process noise, SI, the medians of its priors; None for none.

        A trial is designed for the likelihood of its later fit.
        """
        priors = [self.priors.get(process_name(state)) for state in model.states]
        if self.estimation.likelihood == "output-error" or not any(priors):
            return None
        return tuple(0.0 if prior is None else float(prior.constrain(0.0)) for prior in priors)

    def prior(self, name: str) -> Prior:
        """Prior of a coefficient or of the delay, SI.

        Raises:
            InputError: none is stated.
        """
        if name not in self.priors:
            unused = [other for other in self.priors if other not in self.units]
            raise no_prior(self.where, {name: self.units.get(name, "s")}, unused)
        return self.priors[name]

    def coefficient_priors(self, model: VehicleModel) -> tuple[Prior, ...]:
        """Prior of every coefficient of a model, SI; errors as `prior`."""
        return tuple(self.prior(term.text) for term in model.coefficients)

    def other_unknowns(self, model: VehicleModel) -> list[tuple[Unknown, Prior]]:
        """Unknowns of a model other than coefficients and initial states, each with its prior.

        Raises:
            InputError: a prior that is missing.
        """
        assumed = assumed_unknowns(self.estimation, model, self.priors)
        every = unknowns_of(model, self.sensor_models, assumed, self.noise)[len(model.coefficients) :]
        stated = {**slow_noise_priors(self.sensor_models, self.priors), **self.priors}
        unknowns = [(one, prior) for one in every if (prior := stated.get(one.name, one.default)) is not None]
        if missing := [one for one in every if one.name not in self.priors and one.default is None]:
            raise no_unknown_prior(self.where, missing)
        return unknowns

    @property
    def is_simulated(self) -> bool:
        """Whether its trials are run on a simulated vehicle."""
        return bool(self.truth)

    @property
    def has_records(self) -> bool:
        """Whether its trials are simulated or imported; without either it designs from the priors."""
        return self.is_simulated or self.imports is not None

    @property
    def has_delay(self) -> bool:
        """Whether the delay between command and action is estimated."""
        return "delay" in self.priors

    @property
    def design(self) -> DesignTable:
        """Which trials are tried.

        Raises:
            InputError: the campaign designs none.
        """
        if self.trial_design is None:
            raise InputError(
                self.where("design"),
                found="nothing",
                expected="[design]: the control that a trial moves, its duration, shapes, amplitudes and periods",
                remedy="add [design] to design a trial; without it a campaign imports, checks, estimates, selects and reports",
            )
        return self.trial_design

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """Families that are swept; all of one control, trim and timing."""
        with located(self.where("design.families")):
            return tuple(replace(self.family, kind=kind, seed=self.seed) for kind in self.design.families)

    @cached_property
    def family(self) -> Family:
        """Control, trim and timing that all designs share."""
        return self.design.family({**self.hull.trim, **self.autopilot.trim})

    @property
    def limits(self) -> Limits:
        """Limits of the designed control, SI."""
        return self.control_limits.get(self.family.control, Limits())

    @property
    def trim(self) -> Mapping[str, float]:
        """Stated trim values of states and controls, SI; that of the design for a designed control."""
        trim = self.hull.trim
        return trim if self.trial_design is None else {**trim, self.family.control: self.family.trim}

    @property
    def example_vehicle(self) -> str:
        """Return that the vehicle is still the example of a template; empty if it is not."""
        if self.hull.name != EXAMPLE_VEHICLE:
            return ""
        return f'[vehicle] is the example of the template, "{EXAMPLE_VEHICLE}": write the name and the numbers of your vehicle'

    def state_trim(self, model: VehicleModel) -> tuple[float, ...]:
        """Trim value of every state of a model, SI; level and 0 if not stated."""
        return level_start(model, self.trim)

    def pilot(self, controls: Sequence[str]) -> Autopilot | None:
        """Return the autopilot of a vehicle of these controls; None if trials act on them directly."""
        if not self.autopilot.loops:
            return None
        bounds = [self.control_limits.get(name, Limits()) for name in controls]
        lower = tuple(-inf if one.lower is None else one.lower for one in bounds)
        upper = tuple(inf if one.upper is None else one.upper for one in bounds)
        return Autopilot(tuple(controls), self.autopilot.loops, lower, upper)

    def control_trim(self, model: VehicleModel) -> Trim:
        """Trim values of all commands of a trial, SI: controls of a model, then set-points. A command that no design moves stays there.

        Thrusters, fins and side forces are at 0 if not stated; drives ahead must be stated.

        Raises:
            InputError: a propeller, a force ahead or a given velocity without a trim value.
        """
        known = {**self.autopilot.moved, **self.trim, **self.autopilot.trim}
        commands, resting = (*model.controls, *self.autopilot.trim), ("f_", "delta_", "tau_")
        if missing := [
            name for name in commands if name not in known and not (name.startswith(resting) and name not in PROPULSION)
        ]:
            example = ", ".join(f'{name} = "0 {shown_unit(name)[1]}"' for name in missing)
            raise InputError(
                self.where(f"vehicle.trim.{missing[0]}"),
                found="nothing",
                expected=f"the value of {' and '.join(missing)} while a trial moves another control",
                remedy=f"add to the trim of [vehicle], for example {example}",
            )
        return tuple((name, known.get(name, 0.0)) for name in commands)

    def prediction(self, model: VehicleModel) -> Prediction | None:
        """The stated prediction by the model of one structure; None if there is none.

        Raises:
            InputError: a quantity that the vehicle cannot predict, or a control without a trim value.
        """
        stated = None if self.trial_design is None else self.trial_design.prediction
        if stated is None:
            return None
        trim = self.control_trim(model)[: len(model.controls)]
        controls = [stated.control if name == self.family.control else value for name, value in trim]
        with located(self.where("design.prediction.of")):
            start = self.state_trim(model)
            return prediction(model, stated.of, start, controls, stated.after, self.family.sample_time)


def sensor_models(
    sensors: Mapping[str, SensorTable], mounts: Mapping[str, Mount], residuals: Residuals
) -> tuple[Sensor, ...]:
    """Return what is unknown about some sensors; `residuals` are of those that state no others."""
    return tuple(
        Sensor(
            channel,
            one.residuals or residuals,
            one.bias != "none",
            one.lag,
            one.reference == "ground",
            mounts.get(channel),
        )
        for channel, one in sensors.items()
    )


def no_prior(where: Callable[[str], str], missing: Mapping[str, str], unused: Sequence[str]) -> InputError:
    """Return the error of coefficients without a prior; some of those that nothing uses may be meant for them.

    Args:
        where: names a key of the file.
        missing: SI unit of each.
        unused: names that have a prior and no use.
    """
    tables = [
        f"[prior.{name}]"
        + (f" (is [prior.{close[0]}] meant for it?)" if (close := get_close_matches(name, unused, 1)) else "")
        for name in missing
    ]
    return InputError(
        where(f"prior.{next(iter(missing))}"),
        found="nothing",
        expected="a prior of " + ", and of ".join(f"{name}, SI unit {unit}" for name, unit in missing.items()),
        remedy=f'add {" and ".join(tables)}{", each" if len(tables) > 1 else ""} with distribution = "uniform", lower and upper',
    )
