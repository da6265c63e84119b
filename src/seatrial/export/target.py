"""What every exporter is: a name, a target and its version, what the target keeps of a vehicle, and the files it writes.

An exporter is a frozen dataclass whose other fields are the target's options: docs/skeletons/exporter.py is one to copy, and a line in
`EXPORTERS` of write.py puts it into the conformance test. One of another package needs an entry point of the group `seatrial.exporters`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple

from seatrial.core.signals import RATES
from seatrial.export.motion import Motion, motion_of
from seatrial.export.stability import check_stable
from seatrial.export.vehicle import CoefficientEstimates, ExportedVehicle, ExportProvenance, require_known
from seatrial.vehicles.actuators import Actuator


class Carried(NamedTuple):
    """What a target keeps.

    Attributes:
        motion: accelerations in the target, in our axes.
        lost: what it cannot carry, in words; empty if it carries everything.
        changed: what it carries in another form, in words.
        actuators: lags, rates and limits that it has, by control; a control without one acts at once.
        reversed: controls whose command in the target is minus the vehicle's, since the target's own convention has them so.
        holds: where it keeps the motion if it does so near some states only, in words; empty for a target that keeps it everywhere.
    """

    motion: Motion
    lost: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    actuators: Mapping[str, Actuator] = MappingProxyType({})
    reversed: tuple[str, ...] = ()
    holds: str = ""


@dataclass(frozen=True)
class MotionChange:
    """Largest difference of one velocity between the vehicle and the target's, and the range of the vehicle's own; SI."""

    rate: str
    unit: str
    largest: float
    range: float


class Statement(NamedTuple):
    """What each export says of itself.

    Attributes:
        target: name and version.
        provenance: where the vehicle comes from.
        carried: what the target keeps.
        loss: by velocity, in the standard manoeuvre; a target that runs away has infinite ones, one that keeps the motion has none.
        manoeuvre: the standard manoeuvre in words.
        lines: all of it as text.
        loss_in_current: as `loss`, in the current that was estimated; None if there was none.
        estimated: which coefficients were estimated, and how well.
    """

    target: str
    provenance: ExportProvenance
    carried: Carried
    loss: tuple[MotionChange, ...]
    manoeuvre: str
    lines: tuple[str, ...]
    loss_in_current: tuple[MotionChange, ...] | None = None
    estimated: CoefficientEstimates = CoefficientEstimates()


@dataclass(frozen=True)
class Exporter(ABC):
    """One target; what it does not say otherwise is that of a target that keeps every vehicle as it is.

    Attributes:
        name: after `--to`.
        target: the target and the version its format was read from.
        takes_unknown_mass: whether its numbers do not need the mass.
        simulates: velocities whose motion, mass and inertia have to be known: `all`, those in which the vehicle `moves`, or `nothing`.
        sometimes: names of files that it has of some vehicles only; where an earlier export into the same folder left one, it is removed.
    """

    name: str = ""
    target: str = ""
    takes_unknown_mass: ClassVar[bool] = False
    simulates: ClassVar[Literal["all", "moves", "nothing"]] = "nothing"
    sometimes: ClassVar[tuple[str, ...]] = ()

    def check(self, vehicle: ExportedVehicle) -> None:
        """Refuse a vehicle that the target cannot hold or would make unstable.

        Raises:
            InputError: names the coefficient or what is not known, its value and the remedy.
        """
        if self.simulates != "nothing":
            require_known(vehicle, self.name, RATES if self.simulates == "all" else vehicle.moves)
        check_stable(vehicle, self.name)

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """Return what the target keeps of the vehicle."""
        return Carried(motion_of(vehicle), actuators=vehicle.actuators)

    def notes(self, vehicle: ExportedVehicle, provenance: ExportProvenance) -> Sequence[str]:
        """Return further lines of the statement."""
        return ()

    @abstractmethod
    def write(self, vehicle: ExportedVehicle, statement: Statement) -> Mapping[str, str | bytes]:
        """Return texts, or bytes of binary files, by file name; each repeats the statement."""
