"""The vehicle of a campaign: what is known about it, and its model under every candidate structure.

There are two ways to say one. By its axes: surge of a known mass, or equations of single axes per unit of unknown inertia, with
everything no equation governs given as measured. As a whole: a rigid body in up to six degrees of freedom, from the catalogue or
by hand, of which `moves` says what is modelled; published coefficients that no structure names stay as published.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from seatrial.core.coefficients import CoefficientName
from seatrial.selection.structures import Structure
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.axis_equation import RATE_OF, AxisEquation, axes_vehicle, axis_equation
from seatrial.vehicles.catalogue import PublishedVehicle
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.thrusters import ThrustLaw
from seatrial.vehicles.whole import whole_vehicle


@dataclass(frozen=True)
class AxesVehicle:
    """A vehicle by its axes.

    Attributes:
        hull: what is known about the body.
        axes: whose equations are sought, see `axes_of`; of a known mass X alone.
        published: coefficients of the catalogue, SI.
        catalogue: its name there; empty for one by hand.
    """

    hull: Hull
    axes: tuple[str, ...] = ("X",)
    published: Mapping[str, float] = field(default_factory=dict)
    catalogue: str = ""

    @property
    def is_surge(self) -> bool:
        """Whether it only moves along X."""
        return self.axes == ("X",)

    def model(self, structure: Structure) -> VehicleModel:
        """Return the vehicle model of one candidate."""
        if self.is_surge:
            return whole_vehicle(self.hull, structure.terms, moves=("u",))
        return axes_vehicle(self.hull.name, self.equations(structure))

    def equations(self, structure: Structure) -> tuple[AxisEquation, ...]:
        """Return the equations of motion of one candidate, one for each axis, linear in the coefficients."""
        hull, built = self.hull, []
        for axis in self.axes:
            own = ("X", "T") if axis == "X" else (axis,)
            terms = [term for term in structure.terms if CoefficientName.parse(term).axis in own]
            known = {
                name: value
                for name, value in hull.fixed.items()
                if name != "X_udot" and CoefficientName.parse(name).axis in own
            }
            inertia = None if hull.mass is None else hull.mass - hull.fixed.get("X_udot", 0.0)
            built.append(axis_equation(axis, terms, inertia, hull.thrust_deduction, known, hull.trim))
        return tuple(built)


def axes_of(terms: Sequence[str]) -> tuple[str, ...]:
    """Return the axes whose equations some terms stand in, thrust counted as X."""
    axes = {CoefficientName.parse(term).axis for term in terms}
    return tuple(axis for axis in RATE_OF if axis in axes or (axis == "X" and "T" in axes))


@dataclass(frozen=True)
class WholeVehicle:
    """A rigid body in up to six degrees of freedom; coefficients that no structure names are fixed at their published values.

    Attributes:
        body: of the catalogue or by hand.
        hull: that of `body`, with what is fixed and with the campaign's trim.
        moves: velocities that are modelled.
        given: velocities and angles that are measured.
        positions: those of x, y, z that are states.
        angles: that travel with the state also if no force depends on them.
        attitude: how it is written.
        actuators: lags and limits by control.
        catalogue: its name there; empty for one by hand.
        laws: of thrust, one of each thruster of `body`; none if nothing is said of them.
        unknowns: numbers beside the coefficients to estimate.
        current: whether the water's velocity over the earth is a state of each trial, which stays as it is.
    """

    body: PublishedVehicle
    hull: Hull
    moves: tuple[str, ...]
    given: tuple[str, ...] = ()
    positions: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    attitude: Literal["quaternion", "euler"] = "euler"
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    catalogue: str = ""
    laws: tuple[ThrustLaw, ...] = ()
    unknowns: tuple[str, ...] = ()
    current: bool = False

    @property
    def published(self) -> Mapping[str, float]:
        """Published coefficients, SI, of which priors and a simulated truth may be made."""
        return {**self.body.hull.fixed, **self.body.coefficients}

    @property
    def is_surge(self) -> bool:
        """Whether it only moves along X."""
        return self.moves == ("u",)

    def model(self, structure: Structure) -> VehicleModel:
        """Return the vehicle model of one candidate."""
        return whole_vehicle(
            self.hull,
            structure.terms,
            moves=self.moves,
            given=self.given,
            attitude=self.attitude,
            positions=self.positions,
            angles=self.angles,
            added_coriolis=self.body.added_coriolis,
            thrusters=self.body.thrusters,
            actuators=dict(self.actuators),
            unknowns=self.unknowns,
            current="state" if self.current else None,
        )

    def equations(self, structure: Structure) -> tuple[AxisEquation, ...]:
        """None: its axes are coupled by inertia, weight and buoyancy."""
        return ()


CampaignVehicle = AxesVehicle | WholeVehicle
