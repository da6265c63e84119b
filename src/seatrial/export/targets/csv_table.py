"""A table of coefficients with their covariance, for a spreadsheet: one row a coefficient, the statement above it in lines with #."""

import csv
import io
from dataclasses import dataclass

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import signal_unit
from seatrial.export.target import Exporter, Statement
from seatrial.export.targets.own_json import described
from seatrial.export.vehicle import UNCERTAINTY, ExportedVehicle

# Names of the components of what `described` has in one.
_COMPONENTS = {
    "inertia_about_origin": ("I_xx", "I_yy", "I_zz"),
    "products_of_inertia": ("I_xy", "I_xz", "I_yz"),
    "centre_of_gravity": ("x_g", "y_g", "z_g"),
    "centre_of_buoyancy": ("x_b", "y_b", "z_b"),
}


@dataclass(frozen=True)
class CsvTable(Exporter):
    """See the module."""

    name: str = "csv"
    target: str = "CSV table of coefficients (RFC 4180, comments with #)"

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        estimated, stream = vehicle.estimated, io.StringIO()
        columns = [f"covariance with {name}" for name in estimated.names]
        errors = {
            name: {"source": "estimated", "sd": sd, **dict(zip(columns, row, strict=True))}
            for name, sd, row in zip(estimated.names, estimated.sd, estimated.covariance, strict=True)
        }
        averages = {one.name: {"averaged_mean": one.mean, "averaged_sd": one.sd} for one in estimated.averaged}
        rows = [
            {"name": name, "value": float(value), "unit": vehicle.unit(name), "source": "given", **errors.get(name, {})}
            | (averages.pop(name, {}) if name in errors else {})
            for name, value in vehicle.coefficients.items()
        ]
        rows += [
            {"name": name, "unit": vehicle.unit(name), "source": "in other models", **one}
            for name, one in averages.items()
        ]
        rows += [{"name": name, "source": "estimated", **vars(one)} for name, one in vehicle.numbers.items()]
        rows += [{"name": name, "value": x, "unit": unit, "source": "body"} for name, x, unit in body_rows(vehicle)]
        head = ["name", "value", "sd", "unit", "source", "averaged_mean", "averaged_sd", *columns]
        table = csv.DictWriter(stream, head, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        text = "".join(f"# {line}\n" for line in (*statement.lines, UNCERTAINTY)) + stream.getvalue()
        return {"coefficients.csv": text}


def body_rows(vehicle: ExportedVehicle) -> list[tuple[str, float, str]]:
    """Return everything of the body that is known, as (name, value, SI unit)."""
    content, rows = described(vehicle), []
    for key, one in content["body"].items():
        names = _COMPONENTS.get(key, (key,))
        rows += [(name, value, one["unit"]) for name, value in zip(names, np.atleast_1d(one["value"]), strict=False)]
    for number, thruster in enumerate(vehicle.thrusters, 1):
        parts = {"": (thruster.place, "m"), "direction ": (thruster.column[:3], "1")}
        rows += [
            (f"thruster {number} {part}{axis}", value, unit)
            for part, (values, unit) in parts.items()
            for axis, value in zip("xyz", values, strict=True)
        ]
    for name, one in content["actuators"].items():
        units = {"time_constant": "s", "lower": one["unit"], "upper": one["unit"], "rate": f"({one['unit']})/s"}
        rows += [(f"{name} {'lag' if key == 'time_constant' else key}", one[key], unit) for key, unit in units.items()]
    rows.append(("coriolis_of_added_mass_automatic", vehicle.added_coriolis == "automatic", "1"))
    used = {signal for name in vehicle.forces for signal in CoefficientName.parse(name).trim_signals}
    rows += [(f"trim {name}", x, signal_unit(name)) for name, x in vehicle.hull.trim.items() if name in used]
    return [(name, float(value), unit) for name, value, unit in rows if value is not None]
