"""A vehicle on its way out: plain numbers in SI, body axes forward, starboard, down, and where each of them comes from.

Added masses keep their names (`X_udot`, negative); `added_mass` is the positive matrix M_A. Everything that is not known is absent
from the coefficients or None in the hull, never zero by default.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isclose
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.vehicles.active_dof import AddedCoriolis
from seatrial.vehicles.actuators import Actuator, lags_of
from seatrial.vehicles.catalogue import PublishedVehicle, load_vehicle, vehicle_names
from seatrial.vehicles.hull import Hull, added_mass_matrix, floating_unknowns, rigid_mass_matrix
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import Thruster, acting_thrusters
from seatrial.vehicles.whole import whole_vehicle

CONFIGURATION = "--configuration"  # The option that names the configuration of the vehicle whose values are exported
FILL_FROM = "--fill-from"  # The option that names a published vehicle for what a campaign does not know
# What the numbers of `CoefficientEstimates` mean, as the files say it.
UNCERTAINTY = (
    "sd and covariance of a campaign contain noise, stated inputs, differences between runs and effects that the model may lack. "
    "Correlations are those of the posterior. Averaged values are over all models by their probabilities; a model without the "
    "coefficient counts as zero"
)
SAME_MASS = 1e-3  # Difference of two masses, as a share, up to which they are the same vehicle's


@dataclass(frozen=True)
class AveragedCoefficient:
    """A coefficient averaged over all structures by their probabilities, SI; a structure without it counts as zero.

    `inclusion` is the probability of the structures that have it.
    """

    name: str
    mean: float
    sd: float
    inclusion: float


class PriorRanges(NamedTuple):
    """Bounds and standard deviation of the prior of each coefficient, SI."""

    lower: Float[np.ndarray, " k"]
    upper: Float[np.ndarray, " k"]
    sd: Float[np.ndarray, " k"]


@dataclass(frozen=True, eq=False)
class CoefficientEstimates:
    """The coefficients by the data, SI.

    Attributes:
        names: of the coefficients of one structure, in the order of the arrays.
        mean: of the posterior.
        sd: its standard deviation, with all errors.
        covariance: of these standard deviations, with the correlations of the posterior.
        averaged: over all structures; none if there was only one.
        quoted: the values to quote, `chosen` or `averaged`; empty if this is not stated.
        prior: what was known before; None if this is not stated.
    """

    names: tuple[str, ...] = ()
    mean: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    sd: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    covariance: Float[np.ndarray, "k k"] = field(default_factory=lambda: np.zeros((0, 0)))
    averaged: tuple[AveragedCoefficient, ...] = ()
    quoted: str = ""
    prior: PriorRanges | None = None


@dataclass(frozen=True)
class EstimatedNumber:
    """A number of a vehicle that no coefficient is, such as `gain_f_3`, `dead_f`, `net_weight` or `lag_n`; with its error, SI."""

    value: float
    sd: float
    unit: str


@dataclass(frozen=True, eq=False)
class ExportProvenance:
    """Where a vehicle comes from.

    Attributes:
        run: key of the posterior; of a published vehicle its name in the catalogue.
        title: what a reader calls it.
        structure: label of the exported structure, empty for a published vehicle.
        version: of seatrial.
        dropped: candidate terms that the exported structure leaves out.
        absent: what is not known, in words.
        sources: where the rest comes from, in words.
        cautions: what the estimate's own checks complain about.
        current: largest that was estimated beside the coefficients, m/s.
        speeds: between which 98 % of the speeds ahead in the fitted records lie, m/s; None if none was measured.
    """

    run: str
    title: str
    structure: str = ""
    version: str = ""
    dropped: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()
    current: float = 0.0
    speeds: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ExportedVehicle:
    """A vehicle as an exporter sees it.

    Attributes:
        name: short name.
        hull: rigid body, weight, buoyancy, thrust deduction, wake and trim; its `fixed` is empty.
        coefficients: every coefficient, added masses included, SI.
        moves: velocities that are modelled; all six for most simulators.
        added_coriolis: whether Coriolis forces of the added mass are among the coefficients or follow from it.
        thrusters: of an open frame; none for one propeller on the axis.
        actuators: lag and limits by control.
        estimated: which coefficients were estimated, and how well.
        numbers: what else of its equation was estimated, by name; hull and actuators have them, see `with_numbers`.
        beside: what was estimated that no target has, in words: a delay, process noise, differences between trials.
        given: velocities that are inputs of its equations, as of a ship whose speed is measured; they do not change.
    """

    name: str
    hull: Hull
    coefficients: Mapping[str, float]
    moves: tuple[str, ...] = RATES
    added_coriolis: AddedCoriolis = "named"
    thrusters: tuple[Thruster, ...] = ()
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    estimated: CoefficientEstimates = field(default_factory=CoefficientEstimates)
    numbers: Mapping[str, EstimatedNumber] = field(default_factory=dict)
    beside: tuple[str, ...] = ()
    given: tuple[str, ...] = ()

    @property
    def thrust_law(self) -> dict[str, float]:
        """Gains, share astern and dead zone of its thrusters, SI; see `thrust_unknowns`."""
        elsewhere = {one.name for one in floating_unknowns(self.hull)}
        return {
            name: one.value
            for name, one in self.numbers.items()
            if name not in elsewhere and not name.startswith("lag_")
        }

    @property
    def unknown_drives(self) -> list[str]:
        """What is not known of the actuators, in words."""
        lags = [f"lag of {name}" for name, actuator in self.actuators.items() if actuator.time_constant == 0]
        return [f"limits and lag of {name}" for name in self.controls if name not in self.actuators] + lags

    @property
    def absent(self) -> list[str]:
        """What is not known of it, in words: velocities and actuators."""
        return [
            f"everything about {rate}" for rate in RATES if rate not in (*self.moves, *self.given)
        ] + self.unknown_drives

    @property
    def is_whole(self) -> bool:
        """Whether everything is known that a simulator of six degrees of freedom needs."""
        return self.hull.mass is not None and set(self.moves) == set(RATES) and None not in self.hull.inertia

    @property
    def knows_body(self) -> bool:
        """Whether more than the mass is known of the rigid body."""
        return any(value is not None for value in self.hull.inertia)

    @property
    def rigid_mass(self) -> Float[np.ndarray, "6 6"]:
        """M_RB about the origin, SI."""
        return rigid_mass_matrix(self.hull)

    @property
    def added_mass(self) -> Float[np.ndarray, "6 6"]:
        """M_A about the origin, SI, positive."""
        return added_mass_matrix(self.coefficients)

    @property
    def forces(self) -> dict[str, float]:
        """The coefficients that are no added masses."""
        return {
            name: value for name, value in self.coefficients.items() if not CoefficientName.parse(name).is_added_mass
        }

    @cached_property
    def acting_thrusters(self) -> list[tuple[int, Thruster, str]]:
        """Place, from 1, and control of each of several thrusters that push along or about a velocity that moves."""
        return acting_thrusters(self.thrusters, [CoefficientName.parse(name) for name in self.forces], self.moves)

    @cached_property
    def controls(self) -> tuple[str, ...]:
        """Names of its controls."""
        return tuple(name for name in self.model().controls if name not in self.given)

    def model(self, free: Iterable[str] | None = None, **states: tuple[str, ...]) -> VehicleModel:
        """Return the same vehicle as a model without actuators, whose attitude is kept by Euler angles.

        Args:
            free: its parameters, coefficients and numbers of the thrust law; all but added masses if None.
            states: `positions` and `angles` that it has.
        """
        free = [*self.forces, *self.thrust_law] if free is None else list(free)
        fixed = {name: value for name, value in self.coefficients.items() if name not in free}
        return whole_vehicle(
            replace(self.hull, fixed=fixed),
            tuple(name for name in self.coefficients if name in free),
            moves=self.moves,
            given=self.given,
            attitude="euler",
            added_coriolis=self.added_coriolis,
            thrusters=self.thrusters,
            unknowns=tuple(name for name in self.thrust_law if name in free),
            **states,
        )

    def with_numbers(self, numbers: Mapping[str, EstimatedNumber]) -> "ExportedVehicle":
        """Return it with estimated numbers: weight less buoyancy, the centre of buoyancy and lags go where they belong."""
        value = {name: one.value for name, one in numbers.items()}
        hull, centre = self.hull, zip("xyz", self.hull.centre_of_buoyancy, strict=True)
        net = value.get("net_weight", hull.weight - hull.buoyancy)
        x, y, z = (value.get(f"{axis}_b", stated) for axis, stated in centre)
        lags = {
            name: next((value[lag] for lag in lags_of(name) if lag in value), one.time_constant)
            for name, one in self.actuators.items()
        }
        return replace(
            self,
            hull=replace(hull, buoyancy=hull.weight - net, centre_of_buoyancy=(x, y, z)),
            actuators={name: replace(one, time_constant=lags[name]) for name, one in self.actuators.items()},
            numbers=dict(numbers),
        )

    def unit(self, name: str) -> str:
        """Return the SI unit of a coefficient, without the kilogram if the mass is unknown."""
        parsed = CoefficientName.parse(name)
        return parsed.unit if self.hull.mass is not None else self.model().unit_of(parsed)


def of_published(name: str, published: PublishedVehicle) -> ExportedVehicle:
    """Return a vehicle of the catalogue.

    Raises:
        InputError: its forces are no sum of named terms.
    """
    if published.written is not None:
        raise InputError(
            f'vehicle "{name}"',
            found="forces without named coefficients",
            expected="a vehicle of named coefficients",
            remedy="this vehicle is that of Fossen's simulator: use it, or export remus100_hall_anstee",
        )
    coefficients = {**published.hull.fixed, **published.coefficients}
    return ExportedVehicle(
        published.hull.name,
        replace(published.hull, fixed={}),
        coefficients,
        published.moves,
        published.added_coriolis,
        published.thrusters,
        dict(published.actuators),
    )


def require_known(vehicle: ExportedVehicle, target: str, moves: tuple[str, ...]) -> None:
    """Refuse a vehicle of which a target would have to invent a part.

    Args:
        vehicle: to export.
        target: name, for the error.
        moves: velocities that the target simulates.

    Raises:
        InputError: one of them does not move, or the mass or the inertia of an axis that turns is unknown.
    """
    missing = [rate for rate in moves if rate not in vehicle.moves]
    inertia = zip("xyz", RATES[3:], vehicle.hull.inertia, strict=True)
    unknown = [f"I_{axis}{axis}" for axis, rate, value in inertia if rate in moves and value is None]
    unknown += ["mass"] if vehicle.hull.mass is None else []
    if not (missing or unknown):
        return
    parts = [f"nothing about {' '.join(missing)}"] if missing else []
    parts += [f"no {', '.join(unknown)}"] if unknown else []
    rest = rest_for(vehicle)
    raise InputError(
        f'vehicle "{vehicle.name}", export to {target}',
        found="; ".join(parts),
        expected=f"mass, and inertia and motion in {' '.join(moves)}, because the target simulates them",
        remedy=(f"for a campaign, take the rest from a published vehicle, `{FILL_FROM} {rest}`; or " if rest else "")
        + "export to json or csv, which contain all known values",
    )


def rest_for(vehicle: ExportedVehicle) -> str | None:
    """Return the published vehicle from which the rest of one may come, None if none fits.

    It is whole, of the same mass, and has all of the vehicle's controls; of several, the nearest in mass, and then the one that shares
    most coefficients.
    """
    results, controls = [], set(vehicle.controls)
    for name in vehicle_names():
        published = load_vehicle(name)
        if published.written is not None or not same_mass(vehicle.hull, published.hull):
            continue
        whole = of_published(name, published)
        if whole.is_whole and controls <= set(whole.controls):
            shared = len(set(vehicle.coefficients) & set(whole.coefficients))
            results.append((abs((whole.hull.mass or 0.0) - (vehicle.hull.mass or 0.0)), -shared, name))
    return min(results)[2] if results else None


def same_mass(one: Hull, other: Hull) -> bool:
    """Return whether two hulls are of one known mass."""
    return one.mass is not None and other.mass is not None and isclose(one.mass, other.mass, rel_tol=SAME_MASS)
