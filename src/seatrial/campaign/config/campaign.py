"""A campaign's configuration as objects in SI; every error names the file and the key."""

from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from math import inf
from pathlib import Path

import numpy as np

from seatrial.campaign.config.goal import Goal, read_goal
from seatrial.campaign.config.limits import read_control_limits, read_family, read_motion_limits, read_power
from seatrial.campaign.config.priors import read_prior
from seatrial.campaign.config.schema import CampaignFile, RangeTable
from seatrial.campaign.config.toml import key_place
from seatrial.campaign.config.vehicle import CampaignVehicle, level_start
from seatrial.campaign.config.whole_vehicle import read_vehicle
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.sweep import Trim
from seatrial.estimation.priors import Prior, Uniform
from seatrial.estimation.sensors import Sensor, bias_name, noise_name
from seatrial.estimation.simulation import CURRENT
from seatrial.manoeuvres.family import Family, check_family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.selection.rules import CompiledRules
from seatrial.selection.structures import MAX_STRUCTURES, Structure, all_structures, count_structures, structure_rules
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull

FILE_NAME = "campaign.toml"
SMALLEST, LARGEST = 1e-30, 1e30
"""Sizes of a quantity, SI, whose products and quotients double precision still holds."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign's configuration. `source` holds the file as written, in its own units; properties give SI objects.

    `text` is the file itself, which says on what line a key stands; it is no part of what is computed. Where there are too many
    structures to simulate each, `shortlist` is what a screening has left of them.
    """

    folder: Path
    source: CampaignFile
    shortlist: tuple[Structure, ...] = ()
    text: str = ""

    @property
    def path(self) -> Path:
        """The TOML file."""
        return self.folder / FILE_NAME

    def where(self, key: str) -> str:
        """Name a key and its line, for errors."""
        return key_place(self.path, self.text, key)

    def si(self, text: str | float, unit: str, key: str) -> float:
        """Read a quantity of this file.

        Raises:
            InputError: no quantity of this dimension, or one of a size that nothing has.
        """
        value = quantity(text, unit, self.where(key))
        if value == 0 or SMALLEST <= abs(value) <= LARGEST:
            return value
        raise InputError(
            self.where(key),
            found=f'"{text}", which is {value:.3g} {unit}',
            expected=f"0, or a size from {SMALLEST:g} to {LARGEST:g} in SI",
            remedy="correct the number or its unit",
        )

    @cached_property
    def rules(self) -> CompiledRules:
        """Which terms may stand together."""
        table = self.source.structure
        with located(self.where("structure")):
            return structure_rules(table.always, table.optional, table.rules)

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

    @cached_property
    def vehicle(self) -> CampaignVehicle:
        """The vehicle."""
        return read_vehicle(self)

    @property
    def hull(self) -> SurgeHull | Hull:
        """What is known about the vehicle."""
        return self.vehicle.hull

    def model(self, structure: Structure) -> VehicleModel:
        """Vehicle model of one candidate."""
        return self.vehicle.model(structure)

    @property
    def leading(self) -> str:
        """The state that is shown where one alone is: the surge speed, or the first."""
        states = self.model(self.full).states
        return "u" if "u" in states else states[0]

    def check_surge(self, what: str) -> None:
        """Check that the vehicle only moves along X, for what knows no other.

        Raises:
            InputError: it has other axes.
        """
        if not self.vehicle.is_surge:
            raise InputError(
                self.where("structure"),
                found=f"a vehicle of the states {', '.join(self.model(self.full).states)}",
                expected=f"one that only moves along X, of which alone {what} knows so far",
                remedy="`seatrial design`, `select`, `estimate`, `run`, `profile` and `criteria` work on other axes",
            )

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Measured channels."""
        known = self.model(self.full).channel_units()
        for name in self.source.sensors:
            if name not in known:
                raise InputError(
                    self.where(f"sensors.{name}"),
                    found=f'channel "{name}"',
                    expected="one of " + ", ".join(known),
                    remedy=nearest(name, known),
                )
        return tuple(self.source.sensors)

    @cached_property
    def sensors(self) -> tuple[Sensor, ...]:
        """Measured channels with what is unknown about them."""
        shared = self.source.estimation.residuals
        return tuple(
            Sensor(channel, table.residuals or shared, table.bias != "none", table.lag, table.over == "ground")
            for channel, table in ((channel, self.source.sensors[channel]) for channel in self.channels)
        )

    @cached_property
    def own(self) -> tuple[str, ...]:
        """Names of the unknowns of which every trial has its own."""
        biases = [bias_name(channel) for channel in self.channels if self.source.sensors[channel].bias == "own"]
        return tuple(biases + [CURRENT] * (self.source.estimation.current == "own"))

    def noise(self, channel: str) -> float:
        """Nominal noise of a sensor, SI."""
        value = self.si(self.source.sensors[channel].noise, signal_unit(channel), f"sensors.{channel}.noise")
        if not value > 0:
            raise InputError(
                self.where(f"sensors.{channel}.noise"),
                found=f"{value:g}",
                expected="more than 0",
                remedy="estimate it from a quiet stretch of the record",
            )
        return value

    def rate(self, channel: str) -> float:
        """Samples a second of a sensor, infinitely many where it gives one whenever there is one."""
        text = self.source.sensors[channel].rate
        rate = inf if text is None else self.si(text, "1/s", f"sensors.{channel}.rate")
        if not rate > 0:
            raise InputError(
                self.where(f"sensors.{channel}.rate"),
                found=f'"{text}"',
                expected="more than 0",
                remedy='for example "5 Hz", or leave the key out for a sample in each step',
            )
        return rate

    def process_noise(self) -> np.ndarray:
        """Standard deviation that each state and coefficient of the full structure gains in one second, SI; 0 if not given."""
        table, model = self.source.filter.process_noise, self.model(self.full)
        units = {state: signal_unit(state) for state in model.states}
        units |= {term.text: model.unit_of(term) for term in model.coefficients}
        values = dict.fromkeys(units, 0.0)
        for name, written in table.items():
            key = f"filter.process_noise.{name}"
            if name not in units:
                raise InputError(
                    self.where(key),
                    found=f'"{name}"',
                    expected="a state or a coefficient: " + ", ".join(units),
                    remedy=nearest(name, units),
                )
            values[name] = written if isinstance(written, float) else self.si(written, units[name], key)
            if not 0 <= values[name] < inf:
                raise InputError(
                    self.where(key), found=f"{written}", expected="0 or more", remedy="0 says that the model is perfect"
                )
        return np.array(list(values.values()))

    def measured_mask(self, time: np.ndarray) -> np.ndarray:
        """1 where each sensor gives a sample, 0 between, shape (n, m)."""
        columns = []
        for channel in self.channels:
            every = round(1.0 / (self.rate(channel) * (time[1] - time[0])))
            columns.append((np.arange(time.size) % max(every, 1) == 0).astype(float))
        return np.column_stack(columns)

    def prior(self, name: str, unit: str) -> Prior:
        """Prior of a coefficient or nuisance, SI.

        Raises:
            InputError: no prior under that name, missing or inconsistent numbers, or none that are physical where `physical` is set.
        """
        table = self.source.prior.get(name)
        if table is None:
            unused = [other for other in self.source.prior if other not in self.full.terms]
            meant = f" (is [prior.{close[0]}] meant for it?)" if (close := get_close_matches(name, unused, 1)) else ""
            raise InputError(
                self.where(f"prior.{name}"),
                found="nothing",
                expected=f"a prior of {name}, SI unit {unit}",
                remedy=f'add [prior.{name}] with distribution = "uniform", lower and upper{meant}',
            )
        inertia = 1.0 if self.hull.mass is None else self.hull.mass
        return read_prior(table, unit, self.where(f"prior.{name}"), name=name, inertia=inertia)

    def noise_prior(self, channel: str) -> Prior:
        """Prior of a channel's noise: as given, else uniform up to five times the nominal noise."""
        name = noise_name(channel)
        if name in self.source.prior:
            return self.prior(name, signal_unit(channel))
        return Uniform(0.0, 5.0 * self.noise(channel))

    @property
    def is_simulated(self) -> bool:
        """Whether its trials are run on a simulated vehicle."""
        return bool(self.source.truth)

    @property
    def has_records(self) -> bool:
        """Whether its trials are simulated or imported; without either it designs, from what is believed."""
        return self.is_simulated or self.source.imported is not None

    @property
    def has_delay(self) -> bool:
        """Whether the delay between command and action is estimated."""
        return "delay" in self.source.prior

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """Families that are swept; all of one control, trim and timing."""
        kinds, seed = self.source.design.families, self.source.campaign.seed
        if len(set(kinds)) < len(kinds):
            raise InputError(
                self.where("design.families"),
                found=", ".join(kinds),
                expected="each family once",
                remedy="remove the repetition",
            )
        with located(self.where("design.families")):
            return tuple(check_family(replace(self.family, kind=kind, seed=seed)) for kind in kinds)

    @cached_property
    def family(self) -> Family:
        """Control, trim and timing that all designs share."""
        return read_family(self)

    def state_trim(self, model: VehicleModel) -> tuple[float, ...]:
        """Trim value of every state of a model, SI; level and 0 where [vehicle.trim] says nothing."""
        return level_start(model, self.hull.trim)

    def control_trim(self, model: VehicleModel) -> Trim:
        """Every control of a model with its trim value, SI; what a designed trial leaves alone stays there.

        Raises:
            InputError: a control without a trim value.
        """
        known = {**self.hull.trim, self.family.control: self.family.trim}
        for name in model.controls:
            if name not in known:
                raise InputError(
                    self.where(f"vehicle.trim.{name}"),
                    found="nothing",
                    expected=f"the value at which {name} is held while {self.family.control} is driven",
                    remedy=f'add it to the trim of [vehicle], for example {name} = "0 {shown_unit(name)[1]}"',
                )
        return tuple((name, known[name]) for name in model.controls)

    @cached_property
    def goal(self) -> Goal | None:
        """What ends the campaign; None where nothing is said."""
        table = self.source.goal
        if table is None:
            return None
        model = self.model(self.full)
        return read_goal(table, {term.text: model.unit_of(term) for term in model.coefficients}, self.where("goal"))

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (SI) and periods (s) of the sweep."""
        table = self.source.design
        return self.range(table.amplitude, signal_unit(table.control), "design.amplitude"), self.range(
            table.period, "s", "design.period"
        )

    def limits(self) -> Limits:
        """Limits of the designed control."""
        return read_control_limits(self)

    @cached_property
    def motion_limits(self) -> tuple[MotionLimit, ...]:
        """Limits of the motion."""
        return read_motion_limits(self)

    def power(self) -> tuple[float, float, float]:
        """Propulsion, W, the control at which it is drawn, SI, and the hotel load, W."""
        return read_power(self)

    def range(self, table: RangeTable, unit: str, key: str) -> np.ndarray:
        """An evenly spaced range of positive quantities, SI."""
        start, stop = self.si(table.start, unit, f"{key}.from"), self.si(table.stop, unit, f"{key}.to")
        if not 0 < start <= stop:
            raise InputError(
                self.where(key),
                found=f"from {table.start} to {table.stop}",
                expected="0 < from <= to",
                remedy="swap or correct them",
            )
        return np.linspace(start, stop, table.points)
