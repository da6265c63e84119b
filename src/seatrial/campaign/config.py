"""From a campaign's TOML file to checked objects in SI; every error names the file and the key."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel, ValidationError

from seatrial.campaign.prior_tables import read_prior
from seatrial.campaign.schema import CampaignFile, RangeTable
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located, nearest
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.design.sweep import DoubletFamily
from seatrial.estimation.output_error import correlation_name, noise_name
from seatrial.estimation.priors import Prior, Uniform
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.selection.structures import Structure, all_structures
from seatrial.vehicles.catalogue import catalogue_vehicle
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle

FILE_NAME = "campaign.toml"


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign's configuration. `source` holds the file as written, in its own units; properties give SI objects."""

    folder: Path
    source: CampaignFile

    @property
    def path(self) -> Path:
        """The TOML file."""
        return self.folder / FILE_NAME

    def where(self, key: str) -> str:
        """Name a key, for errors."""
        return f"{self.path}, key {key}"

    def si(self, text: str | float, unit: str, key: str) -> float:
        """Read a quantity of this file."""
        return quantity(text, unit, self.where(key))

    @cached_property
    def structures(self) -> tuple[Structure, ...]:
        """Candidate structures, the full one first."""
        with located(self.where("structure")):
            return all_structures(self.source.structure.always, self.source.structure.optional)

    @cached_property
    def hull(self) -> SurgeHull:
        """What is known about the vehicle."""
        table = self.source.vehicle
        if table.catalogue is not None:
            if table.mass is not None or table.fixed or table.trim or table.name:
                raise InputError(
                    self.where("vehicle"),
                    found="catalogue together with other keys",
                    expected="catalogue alone, or all by hand",
                    remedy="remove the other keys, or remove catalogue and give them all",
                )
            with located(self.where("vehicle.catalogue")):
                return catalogue_vehicle(table.catalogue).hull
        if table.mass is None:
            raise InputError(
                self.where("vehicle.mass"),
                found="neither a mass nor a catalogue name",
                expected='for example "30.5 kg", or "unknown"',
                remedy='with "unknown" every coefficient is estimated per unit of effective mass',
            )
        for name in table.trim:
            if name not in ("u", "n", "tau_X"):
                raise InputError(
                    self.where(f"vehicle.trim.{name}"),
                    found=f'signal "{name}"',
                    expected="u, n or tau_X",
                    remedy="remove it",
                )
        mass = None if table.mass == "unknown" else self.si(table.mass, "kg", "vehicle.mass")
        trim = {name: self.si(text, signal_unit(name), f"vehicle.trim.{name}") for name, text in table.trim.items()}
        return SurgeHull(table.name or "vehicle", mass, table.thrust_deduction, table.fixed, trim)

    def model(self, structure: Structure) -> VehicleModel:
        """Vehicle model of one candidate."""
        with located(self.where("vehicle")):
            return surge_vehicle(self.hull, structure.terms)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Measured channels."""
        known = self.model(self.structures[0]).channel_units()
        for name in self.source.sensors:
            if name not in known:
                raise InputError(
                    self.where(f"sensors.{name}"),
                    found=f'channel "{name}"',
                    expected="one of " + ", ".join(known),
                    remedy=nearest(name, known),
                )
        return tuple(self.source.sensors)

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

    def measured_mask(self, time: np.ndarray) -> np.ndarray:
        """1 where each sensor gives a sample, 0 between, shape (n, m)."""
        columns = []
        for channel in self.channels:
            rate = self.source.sensors[channel].rate
            every = 1
            if rate is not None:
                every = round(1.0 / (self.si(rate, "1/s", f"sensors.{channel}.rate") * (time[1] - time[0])))
            columns.append((np.arange(time.size) % max(every, 1) == 0).astype(float))
        return np.column_stack(columns)

    def prior(self, name: str, unit: str) -> Prior:
        """Prior of a coefficient or nuisance, SI.

        Raises:
            InputError: no prior under that name, missing or inconsistent numbers.
        """
        table = self.source.prior.get(name)
        if table is None:
            raise InputError(
                self.where(f"prior.{name}"),
                found="nothing",
                expected=f"a prior of {name}, SI unit {unit}",
                remedy=f'add [prior.{name}] with distribution = "uniform", lower and upper',
            )
        return read_prior(table, unit, self.where(f"prior.{name}"))

    def noise_prior(self, channel: str) -> Prior:
        """Prior of a channel's noise: as given, else uniform up to five times the nominal noise."""
        name = noise_name(channel)
        if name in self.source.prior:
            return self.prior(name, signal_unit(channel))
        return Uniform(0.0, 5.0 * self.noise(channel))

    @property
    def has_delay(self) -> bool:
        """Whether the delay between command and action is estimated."""
        return "delay" in self.source.prior

    @cached_property
    def family(self) -> DoubletFamily:
        """What the designs share."""
        table = self.source.design
        controls = self.model(self.structures[0]).controls
        if table.control not in controls:
            raise InputError(
                self.where("design.control"),
                found=f'"{table.control}"',
                expected="a control of the vehicle: " + ", ".join(controls),
                remedy=nearest(table.control, controls),
            )
        unit = signal_unit(table.control)
        trim = (
            self.hull.trim.get(table.control, 0.0) if table.trim is None else self.si(table.trim, unit, "design.trim")
        )
        seconds = {
            key: self.si(getattr(table, key), "s", f"design.{key}")
            for key in ("duration", "active", "sample_time", "start", "ramp")
        }
        family = DoubletFamily(table.control, trim, **seconds)
        if not 0 < family.sample_time <= family.duration / 10:
            raise InputError(
                self.where("design.sample_time"),
                found=f"{family.sample_time:g} s",
                expected="more than 0 and a tenth of the duration at most",
                remedy='for example "0.02 s"',
            )
        if family.start + family.active > family.duration * (1 + 1e-9):
            raise InputError(
                self.where("design.active"),
                found=f"start {family.start:g} s + active {family.active:g} s",
                expected=f"an end within the duration, {family.duration:g} s",
                remedy="lengthen the duration or shorten `active`",
            )
        return family

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (SI) and periods (s) of the sweep."""
        table = self.source.design
        return self._range(table.amplitude, signal_unit(table.control), "design.amplitude"), self._range(
            table.period, "s", "design.period"
        )

    def limits(self) -> Limits:
        """Limits of the designed control."""
        for name in self.source.limits:
            if name != self.source.design.control:
                raise InputError(
                    self.where(f"limits.{name}"),
                    found=f'control "{name}"',
                    expected=f'the designed control, "{self.source.design.control}"',
                    remedy=nearest(name, [self.source.design.control]),
                )
        table = self.source.limits.get(self.source.design.control)
        if table is None:
            return Limits()
        unit = signal_unit(self.source.design.control)
        rate_unit = "N/s" if self.source.design.control.startswith("tau") else "rad/s^2"
        key = f"limits.{self.source.design.control}"
        return Limits(
            *(
                None if text is None else self.si(text, at, f"{key}.{name}")
                for name, text, at in (
                    ("lower", table.lower, unit),
                    ("upper", table.upper, unit),
                    ("rate", table.rate, rate_unit),
                )
            )
        )

    def _range(self, table: RangeTable, unit: str, key: str) -> np.ndarray:
        start, stop = self.si(table.start, unit, f"{key}.from"), self.si(table.stop, unit, f"{key}.to")
        if not 0 < start <= stop:
            raise InputError(
                self.where(key),
                found=f"from {table.start} to {table.stop}",
                expected="0 < from <= to",
                remedy="swap or correct them",
            )
        return np.linspace(start, stop, table.points)


def load_campaign(folder: Path) -> Campaign:
    """Read and check the campaign of a folder.

    Raises:
        InputError: no such file, malformed TOML, unknown or missing key, wrong type, unit or name.
    """
    path = folder / FILE_NAME
    if not path.is_file():
        raise InputError(
            str(path),
            found="no such file",
            expected=f"a campaign folder with {FILE_NAME}",
            remedy=f"create one with `seatrial init {folder}`",
        )
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as cause:
        raise InputError(
            str(path), found=f"malformed TOML: {cause}", expected="a TOML file in UTF-8", remedy="mend the line named"
        ) from cause
    try:
        campaign = Campaign(folder, CampaignFile.model_validate(content))
    except ValidationError as cause:
        raise _as_input_error(path, content, cause) from None
    _check(campaign)
    return campaign


def _check(campaign: Campaign) -> None:
    """Resolve everything once, so that mistakes are found before any work is done."""
    full = campaign.structures[0]
    model = campaign.model(full)
    names = {term.text for term in model.coefficients}
    for name in names:
        campaign.prior(name, model.unit_of(CoefficientName.parse(name)))
    nuisances = {noise_name(channel) for channel in campaign.channels}
    if campaign.source.estimation.residuals == "coloured":
        for channel in campaign.channels:
            nuisances.add(correlation_name(channel))
            campaign.prior(correlation_name(channel), "s")
    allowed = names | nuisances | {"delay"}
    for name in campaign.source.prior:
        if name not in allowed:
            raise InputError(
                campaign.where(f"prior.{name}"),
                found=f'"{name}", which nothing uses',
                expected="one of " + ", ".join(sorted(allowed)),
                remedy=nearest(name, allowed),
            )
    if campaign.has_delay and not isinstance(campaign.prior("delay", "s"), Uniform):
        raise InputError(
            campaign.where("prior.delay"),
            found="a normal prior",
            expected="a uniform prior from 0 s",
            remedy="give lower and upper",
        )
    for channel in campaign.channels:
        campaign.noise(channel)
        if campaign.noise_prior(channel).bounds[0] < 0:
            raise InputError(
                campaign.where(f"prior.{noise_name(channel)}"),
                found="a support that reaches below 0",
                expected="a uniform prior from 0 up",
                remedy="give lower = 0 and upper",
            )
    _ = campaign.family, campaign.grid(), campaign.limits()
    _check_source(campaign, names)


def _check_source(campaign: Campaign, names: set[str]) -> None:
    source = campaign.source
    if (source.imported is None) == (not source.truth):
        raise InputError(
            str(campaign.path),
            found="both [truth] and [import]" if source.truth else "neither [truth] nor [import]",
            expected="one of them: a simulated vehicle or a real log",
            remedy="give [truth] with coefficients, or [import] with files",
        )
    for name in source.truth:
        if name not in names:
            raise InputError(
                campaign.where(f"truth.{name}"),
                found=f'"{name}"',
                expected="one of " + ", ".join(sorted(names)),
                remedy=nearest(name, names),
            )
    if source.estimation.initial == "trim" and "u" not in campaign.hull.trim:
        raise InputError(
            campaign.where("estimation.initial"),
            found='"trim"',
            expected="a vehicle whose trim speed is known",
            remedy='give vehicle.trim.u, or set initial = "measured" or "estimated"',
        )


def _as_input_error(path: Path, content: Mapping[str, Any], cause: ValidationError) -> InputError:
    first = cause.errors()[0]
    location = [part for part in first["loc"] if isinstance(part, str | int)]
    key = ".".join(str(part) for part in location)
    where = f"{path}, key {key}"
    if first["type"] == "extra_forbidden":
        allowed = _keys_at(location[:-1])
        return InputError(
            where,
            found=f'unknown key "{location[-1]}"',
            expected="one of " + ", ".join(allowed),
            remedy=nearest(str(location[-1]), allowed),
        )
    if first["type"] == "missing":
        return InputError(
            where,
            found="nothing",
            expected=f'the key "{location[-1]}"',
            remedy="add it; `seatrial init` writes an example with every table",
        )
    return InputError(
        where,
        found=repr(first.get("input"))[:80],
        expected=first["msg"],
        remedy='correct the value; quantities are strings such as "200 rpm"',
    )


def _keys_at(location: list[str | int]) -> list[str]:
    """Keys the schema allows at a place, following tables, lists and named sub-tables."""
    table: Any = CampaignFile
    for part in location:
        if isinstance(table, type) and issubclass(table, BaseModel):
            fields = {field.alias or name: field.annotation for name, field in table.model_fields.items()}
            table = fields[str(part)]
        else:
            table = get_args(table)[-1] if get_args(table) else table
        options = [option for option in get_args(table) if isinstance(option, type) and issubclass(option, BaseModel)]
        if len(options) == 1 and "|" in str(table):
            table = options[0]
    return [field.alias or name for name, field in table.model_fields.items()]
