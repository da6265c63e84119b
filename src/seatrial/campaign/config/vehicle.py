"""The vehicle of a campaign: what is known about it, and its model under every candidate structure.

There are two ways to write one. By its axes: surge of a known mass, or equations of single axes per unit of unknown inertia, with
everything no equation governs given as measured. As a whole: a rigid body in up to six degrees of freedom, from the catalogue or
by hand, of which `moves` says what is modelled; published coefficients that no structure names stay as published.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.selection.structures import Structure
from seatrial.vehicles.axis_equation import RATE_OF, AxisEquation, axes_vehicle, axis_equation
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle

if TYPE_CHECKING:
    from seatrial.campaign.config.campaign import Campaign
    from seatrial.vehicles.hull import Hull


# Where a vehicle's states are at the start of a trial: at trim, or where first measured.


def level_start(model: VehicleModel, known: Mapping[str, float]) -> tuple[float, ...]:
    """Every state from values of some signals, SI: a quaternion from angles, an actuator from its command, 0 where nothing is known."""
    angles = tuple(known.get(angle, 0.0) for angle in ANGLES)
    turned = dict(zip(QUATERNION, map(float, quaternion_of_angles(*angles)), strict=True))
    return tuple(
        turned[state] if state in turned else known.get(state, known.get(state.removesuffix(ACTUAL), 0.0))
        for state in model.states
    )


def first_measured(record: Record) -> dict[str, float]:
    """First value of every channel of a record that has one, and of every control, SI."""
    found = {}
    for name in (*record.controls, *record.measured):
        column = record.channel(name)
        finite = np.flatnonzero(np.isfinite(column))
        if finite.size:
            found[name] = float(column[finite[0]])
    return found


class CampaignVehicle(Protocol):
    """What every campaign asks of its vehicle."""

    @property
    def hull(self) -> "SurgeHull | Hull":
        """What is known about the body: name, mass, fixed coefficients, trim."""
        ...

    @property
    def published(self) -> Mapping[str, float]:
        """Published coefficients, SI, of which priors and a simulated truth may be made."""
        ...

    @property
    def is_surge(self) -> bool:
        """Whether it only moves along X."""
        ...

    def model(self, structure: Structure) -> VehicleModel:
        """Vehicle model of one candidate."""
        ...

    def equations(self, structure: Structure) -> tuple[AxisEquation, ...]:
        """Equations of motion of one candidate, one for each axis, linear in the coefficients; none of a coupled body."""
        ...


def check_alone(campaign: "Campaign", keys: Sequence[str]) -> None:
    """Check that a vehicle of the catalogue is given nothing that the catalogue says.

    Args:
        campaign: whose vehicle has a catalogue name.
        keys: of `[vehicle]` that must not stand beside it.

    Raises:
        InputError: one that does.
    """
    twice = sorted(campaign.source.vehicle.model_fields_set & set(keys))
    if twice:
        raise InputError(
            campaign.where(f"vehicle.{twice[0]}"),
            found=f"catalogue together with {', '.join(twice)}",
            expected="a vehicle of the catalogue, or one by hand",
            remedy=f"remove {', '.join(twice)}, or remove catalogue and give all of it",
        )


@dataclass(frozen=True, eq=False)
class AxesVehicle:
    """A vehicle by its axes: those that the terms name."""

    campaign: "Campaign"
    hull: SurgeHull
    published: Mapping[str, float]

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Axes whose equations are sought, thrust counted as X."""
        found = {CoefficientName.parse(term).axis for term in self.campaign.full.terms}
        return tuple(axis for axis in RATE_OF if axis in found or (axis == "X" and "T" in found))

    @property
    def is_surge(self) -> bool:
        """See `CampaignVehicle`."""
        return self.axes == ("X",)

    def model(self, structure: Structure) -> VehicleModel:
        """See `CampaignVehicle`."""
        if self.hull.mass is not None and not self.is_surge:
            raise InputError(
                self.campaign.where("vehicle.mass"),
                found=f"{self.hull.mass:g} kg, with terms on the axes {' '.join(self.axes)}",
                expected='mass = "unknown", terms on X and T only, or a whole vehicle that says what `moves`',
                remedy="coefficients of other axes than X are estimated per unit of mass or inertia, added mass included",
            )
        with located(self.campaign.where("vehicle")):
            if self.is_surge:
                return surge_vehicle(self.hull, structure.terms)
            return axes_vehicle(self.hull.name, self.equations(structure))

    def equations(self, structure: Structure) -> tuple[AxisEquation, ...]:
        """See `CampaignVehicle`."""
        hull, found = self.hull, []
        for axis in self.axes:
            own = ("X", "T") if axis == "X" else (axis,)
            terms = [term for term in structure.terms if CoefficientName.parse(term).axis in own]
            known = {
                name: value
                for name, value in hull.fixed.items()
                if name != "X_udot" and CoefficientName.parse(name).axis in own
            }
            inertia = None if hull.mass is None else hull.mass - hull.fixed.get("X_udot", 0.0)
            found.append(axis_equation(axis, terms, inertia, hull.thrust_deduction, known, hull.trim))
        return tuple(found)
