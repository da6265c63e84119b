"""A table of coefficients with their covariance, for a spreadsheet: one row a coefficient, the statement above it in lines with #."""

import csv
import io
from dataclasses import dataclass
from math import isfinite

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import signal_unit
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import UNCERTAINTY, AveragedCoefficient, ExportedVehicle
from seatrial.vehicles.hull import Hull

# Columns of the average over all models.
_AVERAGED_COLUMNS = ("averaged_mean", "averaged_sd")


@dataclass(frozen=True)
class CsvTable(Exporter):
    """See the module."""

    name: str = "csv"
    target: str = "CSV table of coefficients (RFC 4180, comments with #)"

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        estimated = vehicle.estimated
        known = dict(zip(estimated.names, range(len(estimated.names)), strict=True))
        averages = {one.name: one for one in estimated.averaged}
        rows = []
        for name, value in vehicle.coefficients.items():
            if name not in known:
                rows.append([name, repr(float(value)), "", vehicle.unit(name), "given"])
                continue
            entries = [*_of_average(averages.pop(name, None)), *estimated.covariance[known[name]]]
            sd = repr(float(estimated.sd[known[name]]))
            rows.append([name, repr(float(value)), sd, vehicle.unit(name), "estimated", *map(_number, entries)])
        for name, one in averages.items():
            rows.append([name, "", "", vehicle.unit(name), "in other models", *map(_number, _of_average(one))])
        rows += [[name, repr(one.value), repr(one.sd), one.unit, "estimated"] for name, one in vehicle.numbers.items()]
        body = [[name, repr(value), "", unit, "body"] for name, value, unit in body_rows(vehicle)]
        head = ["name", "value", "sd", "unit", "source", *_AVERAGED_COLUMNS]
        head += [f"covariance with {name}" for name in known]
        full = [row + [""] * (len(head) - len(row)) for row in (*rows, *body)]
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([head, *full])
        text = "".join(f"# {line}\n" for line in (*statement.lines, UNCERTAINTY)) + stream.getvalue()
        return {"coefficients.csv": text}


def _of_average(one: AveragedCoefficient | None) -> tuple[float | None, ...]:
    return (None,) * len(_AVERAGED_COLUMNS) if one is None else (one.mean, one.sd)


def _number(value: float | None) -> str:
    return "" if value is None else repr(float(value))


def body_rows(vehicle: ExportedVehicle) -> list[tuple[str, float, str]]:
    """Return everything of the body that is known, as (name, value, SI unit)."""
    hull = vehicle.hull
    rows: list[tuple[str, float | None, str]] = [("mass", hull.mass, "kg")]
    rows += [("thrust_deduction", hull.thrust_deduction, "1"), ("wake", hull.wake, "1")]
    rows += _whole_rows(hull) if vehicle.knows_body else []
    rows += _driven_rows(vehicle)
    used = {signal for name in vehicle.forces for signal in CoefficientName.parse(name).trim_signals}
    rows += [(f"trim {name}", value, signal_unit(name)) for name, value in hull.trim.items() if name in used]
    return [(name, float(value), unit) for name, value, unit in rows if value is not None]


def _driven_rows(vehicle: ExportedVehicle) -> list[tuple[str, float | None, str]]:
    """Return the thrusters, lags and limits, and whether the added mass brings its Coriolis forces itself."""
    rows: list[tuple[str, float | None, str]] = []
    for number, thruster in enumerate(vehicle.thrusters, 1):
        rows += [(f"thruster {number} {a}", value, "m") for a, value in zip("xyz", thruster.place, strict=True)]
        parts = zip("xyz", thruster.column[:3], strict=True)
        rows += [(f"thruster {number} direction {a}", value, "1") for a, value in parts]
    for name, actuator in vehicle.actuators.items():
        unit = signal_unit(name)
        rows.append((f"{name} lag", actuator.time_constant, "s"))
        bounds = {"lower": actuator.lower, "upper": actuator.upper, "rate": actuator.rate}
        rows += [
            (f"{name} {key}", value, f"({unit})/s" if key == "rate" else unit)
            for key, value in bounds.items()
            if isfinite(value)
        ]
    return [*rows, ("coriolis_of_added_mass_automatic", float(vehicle.added_coriolis == "automatic"), "1")]


def _whole_rows(hull: Hull) -> list[tuple[str, float | None, str]]:
    rows: list[tuple[str, float | None, str]] = []
    rows += [(f"I_{a}{a}", value, "kg m^2") for a, value in zip("xyz", hull.inertia, strict=True)]
    rows += [(f"I_{pair}", value, "kg m^2") for pair, value in zip(("xy", "xz", "yz"), hull.products, strict=True)]
    rows += [(f"{a}_g", value, "m") for a, value in zip("xyz", hull.centre_of_gravity, strict=True)]
    rows += [(f"{a}_b", value, "m") for a, value in zip("xyz", hull.centre_of_buoyancy, strict=True)]
    rows += [("weight", hull.weight, "N"), ("buoyancy", hull.buoyancy, "N")]
    return rows
