"""Writing an export: the exporter by the name that `--to` takes, the vehicle checked first, then every file whole, or none."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from seatrial import __version__
from seatrial.core.argument_checks import check_number
from seatrial.core.errors import InputError, nearest, not_among
from seatrial.core.files import write_bytes, write_text
from seatrial.export.manoeuvre import changes, command_line, growth_rate, plan_for, run_manoeuvre
from seatrial.export.motion import motion_of
from seatrial.export.target import Carried, Exporter, MotionChange, Statement
from seatrial.export.targets.casadi_module import CasadiModule
from seatrial.export.targets.control import Control
from seatrial.export.targets.csv_table import CsvTable
from seatrial.export.targets.draws import DrawsTable
from seatrial.export.targets.fmu import CoSimulationUnit
from seatrial.export.targets.fossen import Fossen
from seatrial.export.targets.gz import Gz
from seatrial.export.targets.holoocean import HoloOcean
from seatrial.export.targets.mjcf import Mujoco
from seatrial.export.targets.own_json import OwnJson
from seatrial.export.targets.stonefish import Stonefish
from seatrial.export.vehicle import ExportedVehicle, ExportProvenance, of_published
from seatrial.messages.structures import QUOTED
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

_SLOW_GROWTH = 0.05  # Growth, 1/s, below which nothing grows much in the manoeuvre
_ROUNDING_SHARE = 1e-9  # Share of a velocity's range, or m/s and rad/s, below which a difference is rounding
GROUP = "seatrial.exporters"  # Entry points by which other packages add exporters
# In the order in which they are listed.
EXPORTERS: dict[str, type[Exporter]] = {
    "gz": Gz,
    "stonefish": Stonefish,
    "fossen": Fossen,
    "casadi": CasadiModule,
    "fmu": CoSimulationUnit,
    "mjcf": Mujoco,
    "holoocean": HoloOcean,
    "json": OwnJson,
    "csv": CsvTable,
    "control": Control,
    "draws": DrawsTable,
}


def state(exporter: Exporter, vehicle: ExportedVehicle, provenance: ExportProvenance) -> Statement:
    """Compare the vehicle with what the target keeps, and say it.

    Args:
        exporter: of the target.
        vehicle: to export.
        provenance: where it comes from.
    """
    carried, own = carried_by(exporter, vehicle), motion_of(vehicle)
    plan = plan_for(vehicle, own)
    kept = bool(carried.holds) or (carried.motion is own and carried.actuators == vehicle.actuators)

    def lost_in(current: float) -> tuple[MotionChange, ...]:
        """Return the changes of the velocities through the water, in a current to the east."""
        sides = ((own, vehicle.actuators), (carried.motion, carried.actuators))
        return () if kept else changes(vehicle, *(run_manoeuvre(*side, plan, (0.0, current, 0.0)) for side in sides))

    result = Statement(
        exporter.target,
        provenance,
        carried,
        lost_in(0.0),
        plan.words,
        (),
        lost_in(provenance.current) if provenance.current else None,
        vehicle.estimated,
    )
    lines = _lines(vehicle, result, command_line(vehicle, carried, plan), growth_rate(own, plan))
    return result._replace(lines=(*lines, *exporter.notes(untethered(vehicle), provenance)))


def carried_by(exporter: Exporter, vehicle: ExportedVehicle) -> Carried:
    """Return what a target keeps of a vehicle; a tether, delays and process noise are kept by none."""
    carried, tether = exporter.carries(untethered(vehicle)), vehicle.hull.tether
    pulled = () if tether is None else (tether.words,)
    return carried._replace(lost=(*carried.lost, *pulled, *vehicle.beside))


def untethered(vehicle: ExportedVehicle) -> ExportedVehicle:
    """Return the vehicle that a target is given."""
    return vehicle if vehicle.hull.tether is None else replace(vehicle, hull=replace(vehicle.hull, tether=None))


def loss_words(loss: Iterable[MotionChange]) -> str:
    """Return the loss in predicted motion in words."""
    shown = [change for change in loss if change.largest > _ROUNDING_SHARE * max(1.0, change.range)]
    if not shown:
        return "none"
    return "; ".join(_change_words(change) for change in shown)


def export_vehicle(
    exporter: Exporter,
    vehicle: ExportedVehicle,
    provenance: ExportProvenance,
    folder: Path,
    announce: Callable[[Statement], None] | None = None,
) -> tuple[Statement, list[Path]]:
    """Write a vehicle's files into a folder; returns what they say of themselves, and their paths.

    Args:
        exporter: of the target.
        vehicle: to export.
        provenance: where it comes from.
        folder: to write into.
        announce: called with the statement before anything is written.

    Raises:
        InputError: a vehicle that the target cannot hold or would make unstable; nothing is written then.
    """
    check_exportable(exporter, vehicle)
    statement = state(exporter, vehicle, provenance)
    if announce is not None:
        announce(statement)
    files = exporter.write(untethered(vehicle), statement)
    for name in exporter.sometimes:
        if name not in files:
            (folder / name).unlink(missing_ok=True)
    for name, content in files.items():
        write_bytes(folder / name, content) if isinstance(content, bytes) else write_text(folder / name, content)
    return statement, [folder / name for name in files]


def check_exportable(exporter: Exporter, vehicle: ExportedVehicle) -> None:
    """Refuse a vehicle that a target cannot hold; raises as `Exporter.check`, and for an unknown mass that the target needs."""
    if vehicle.hull.mass is None and not exporter.takes_unknown_mass:
        raise InputError(
            f'vehicle "{vehicle.name}", export to {exporter.name}',
            found="an unknown mass: every coefficient is per unit of an effective mass or inertia",
            expected="coefficients in newtons, from a vehicle with a known mass",
            remedy="give the mass, and the inertia of axes that turn, and estimate again; or export to control or draws",
        )
    exporter.check(untethered(vehicle))


def exporter_names() -> tuple[str, ...]:
    """Return the names of all targets: those of this package, then those of other packages."""
    return tuple(dict.fromkeys((*EXPORTERS, *(one.name for one in entry_points(group=GROUP)))))


def make_exporter(name: str, shown: Mapping[str, str] = MappingProxyType({}), **options: Any) -> Exporter:
    """Build an exporter; options that are None keep the target's own.

    Args:
        name: of the target.
        shown: what errors call an option that a user knows by another name.
        options: of the target.

    Raises:
        InputError: no target of that name, or an option that it does not have.
    """
    kind = EXPORTERS.get(name) or _of_another_package(name)
    given = {key: value for key, value in options.items() if value is not None}
    for key in given:
        if key not in _options(kind):
            able = ", ".join(other for other, one in EXPORTERS.items() if key in _options(one))
            raise InputError(
                f"export to {name}, {shown.get(key, key)}",
                found=f"an option that {name} does not have",
                expected=f"a target that has this option: {able}"
                if able
                else ", ".join(sorted(_options(kind))) or "no option",
                remedy="leave it out",
            )
    if "density" in given:
        check_number(
            given["density"],
            f"export to {name}, {shown.get('density', 'density')}",
            above=0.0,
            remedy="give it in kg/m^3, for example 1025.0",
        )
    return kind(**given)


def of_catalogue(name: str) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return a published vehicle by name.

    Raises:
        InputError: no such vehicle, which may have been meant as a folder.
    """
    names = vehicle_names()
    if name not in names:
        raise InputError(
            name,
            found="neither a folder nor a vehicle of the catalogue",
            expected="a campaign's folder, or one of " + ", ".join(names),
            remedy=nearest(name, names),
        )
    vehicle = of_published(name, load_vehicle(name))
    return vehicle, ExportProvenance(
        f"catalogue {name}",
        f"{vehicle.name}, as published",
        version=__version__,
        absent=(", ".join(vehicle.absent),) if vehicle.absent else (),
    )


def _of_another_package(name: str) -> type[Exporter]:
    """Return the exporter that an installed package has under a name."""
    points = entry_points(group=GROUP, name=name)
    if not points:
        raise not_among(f"--to {name}", name, exporter_names())
    (entry, *_) = points
    try:
        kind = entry.load()
    except Exception as cause:  # whatever the other package raises when it is imported
        raise _unusable(entry, f"{type(cause).__name__}: {cause}") from cause
    if not (isinstance(kind, type) and issubclass(kind, Exporter) and is_dataclass(kind)):
        raise _unusable(entry, "something else")
    return kind


def _unusable(entry: EntryPoint, found: str) -> InputError:
    package = entry.dist.name if entry.dist else "another package"
    return InputError(
        f"--to {entry.name}, {entry.value} of {package}",
        found=found,
        expected="a frozen dataclass that is an Exporter, as docs/skeletons/exporter.py has it",
        remedy=f"install a version of {package} that fits, or remove it",
    )


def _options(kind: type[Exporter]) -> set[str]:
    return {field.name for field in fields(kind)} - {"name", "target"}


def _lines(vehicle: ExportedVehicle, statement: Statement, commands: str, growth: float) -> list[str]:
    provenance, carried = statement.provenance, statement.carried
    lines = [
        f"{provenance.title}, exported by seatrial {__version__} to {statement.target}",
        f"run: {provenance.run}" + (f" (seatrial {provenance.version})" if provenance.version else ""),
    ]
    if provenance.structure:
        lines.append(f"structure: {provenance.structure}")
    estimated = vehicle.estimated
    heading = "estimated, mean ± standard deviation:"
    lines.append(heading if estimated.names or vehicle.numbers else "estimated: nothing; all values are published")
    for name, mean, sd in zip(estimated.names, estimated.mean, estimated.sd, strict=True):
        lines.append(f"  {name} = {mean:.6g} ± {sd:.2g} {vehicle.unit(name)}")
    lines += [f"  {name} = {one.value:.6g} ± {one.sd:.2g} {one.unit}" for name, one in vehicle.numbers.items()]
    if estimated.quoted == "averaged":
        lines.append(f"to quote: {QUOTED['averaged']}:")
        lines += [
            f"  {one.name} = {one.mean:.6g} ± {one.sd:.2g} {vehicle.unit(one.name)}" for one in estimated.averaged
        ]
    for title, items in (
        ("dropped by the selection", provenance.dropped),
        ("taken from elsewhere", provenance.sources),
        ("absent", provenance.absent),
        ("caution", provenance.cautions),
    ):
        lines += [f"{title}: {item}" for item in items]
    lines += [f"not supported: {item}" for item in carried.lost]
    lines += [] if carried.lost or carried.holds else ["supports all known terms"]
    lines += [f"in another form: {item}" for item in carried.changed]
    lines += [f"a positive command: {commands}"] if commands else []
    if carried.holds:
        return [*lines, f"loss in predicted motion: {carried.holds}"]
    lines.append(f"loss in predicted motion ({statement.manoeuvre}, in still water): {loss_words(statement.loss)}")
    if statement.loss_in_current is not None:
        words = loss_words(statement.loss_in_current)
        lines.append(
            f"the same through the water in the campaign's current, {provenance.current:.2g} m/s from abeam: {words}"
        )
    if growth > _SLOW_GROWTH and loss_words(statement.loss) != "none":
        lines.append(
            "at that speed the vehicle is unstable without control: small differences grow "
            f"{np.exp(growth):.1f} times each second, also those of unsupported terms"
        )
    return lines


def _change_words(change: MotionChange) -> str:
    if not np.isfinite(change.largest):
        return f"{change.rate} diverges in the target"
    share = (
        f" ({change.largest / change.range:.0%} of its range)"
        if change.range > _ROUNDING_SHARE
        else " (its range is 0)"
    )
    return f"{change.rate} by {change.largest:.2g} {change.unit}{share}"
