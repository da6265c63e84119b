"""The package's own JSON, format 1: all that is known of a vehicle but a tether, with units, covariance and provenance.

Its axes are forward, starboard and down from the body's origin, its numbers SI and radians; `read_exported` gives the vehicle back.
"""

import json
from dataclasses import dataclass
from math import isfinite
from typing import Any

from seatrial.core.signals import RATES, signal_unit
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import UNCERTAINTY, ExportedVehicle
from seatrial.vehicles.actuators import Actuator

FORMAT = 1
FRAME = "forward, starboard, down; angles in radians; a velocity is that through the water"
EQUATION = (
    "(M_RB + M_A) d(nu)/dt = sum of coefficient x regressor + thrust - C(nu) nu - g; added masses are SNAME's, M_A = -X_udot; "
    "coriolis of the added mass is among the coefficients if added_coriolis is named, and follows from M_A if it is automatic"
)


@dataclass(frozen=True)
class OwnJson(Exporter):
    """See the module."""

    name: str = "json"
    target: str = f"seatrial JSON, format {FORMAT}"

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        content = document(vehicle, statement)
        return {"vehicle.json": json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"}


def document(vehicle: ExportedVehicle, statement: Statement) -> dict[str, Any]:
    """Return the content of the file."""
    provenance = statement.provenance
    return {
        "format": FORMAT,
        "about": list(statement.lines),
        "provenance": {
            "run": provenance.run,
            "title": provenance.title,
            "structure": provenance.structure,
            "seatrial": provenance.version,
            "dropped": list(provenance.dropped),
            "absent": list(provenance.absent),
            "sources": list(provenance.sources),
            "cautions": list(provenance.cautions),
            "current": provenance.current,
            "speeds": provenance.speeds and list(provenance.speeds),
        },
        **described(vehicle),
    }


def described(vehicle: ExportedVehicle) -> dict[str, Any]:
    """Return the vehicle itself: what a reader builds it from, and what follows from that and must agree."""
    hull, estimated, known = vehicle.hull, vehicle.estimated, vehicle.knows_body
    sd = dict(zip(estimated.names, estimated.sd, strict=True))
    return {
        "name": vehicle.name,
        "frame": FRAME,
        "equation": EQUATION,
        "moves": list(vehicle.moves),
        "added_coriolis": vehicle.added_coriolis,
        "body": {
            "mass": {"value": hull.mass, "unit": "kg"},
            "inertia_about_origin": {"value": list(hull.inertia), "unit": "kg m^2"},
            "products_of_inertia": {"value": list(hull.products) if known else None, "unit": "kg m^2"},
            "centre_of_gravity": {"value": list(hull.centre_of_gravity) if known else None, "unit": "m"},
            "centre_of_buoyancy": {"value": list(hull.centre_of_buoyancy) if known else None, "unit": "m"},
            "weight": {"value": hull.weight if known else None, "unit": "N"},
            "buoyancy": {"value": hull.buoyancy if known else None, "unit": "N"},
            "thrust_deduction": {"value": hull.thrust_deduction, "unit": "1"},
            "wake": {"value": hull.wake, "unit": "1"},
        },
        "trim": {name: {"value": value, "unit": signal_unit(name)} for name, value in hull.trim.items()},
        "coefficients": [
            {
                "name": name,
                "value": float(value),
                "sd": float(sd[name]) if name in sd else None,
                "unit": vehicle.unit(name),
                "source": "estimated" if name in sd else "given",
            }
            for name, value in vehicle.coefficients.items()
        ],
        "numbers": [{"name": name, **vars(one)} for name, one in vehicle.numbers.items()],
        "estimated": {
            "names": list(estimated.names),
            "mean": estimated.mean.tolist(),
            "sd": estimated.sd.tolist(),
            "covariance": estimated.covariance.tolist(),
            "uncertainty": UNCERTAINTY,
            "quoted": estimated.quoted,
            "averaged": [{**vars(one), "unit": vehicle.unit(one.name)} for one in estimated.averaged],
            "units": [vehicle.unit(name) for name in estimated.names],
        },
        "matrices": {
            "order": list(RATES),
            "rigid_mass": (vehicle.rigid_mass.tolist() if vehicle.is_whole else None),
            "added_mass": vehicle.added_mass.tolist(),
            "units": "kg, kg m and kg m^2",
        },
        "thrusters": [
            {"place": list(thruster.place), "direction": list(thruster.direction), "unit": "m"}
            for thruster in vehicle.thrusters
        ],
        "actuators": {name: _actuator(name, actuator) for name, actuator in vehicle.actuators.items()},
    }


def _actuator(name: str, actuator: Actuator) -> dict[str, Any]:
    """Return an actuator as a table; a limit that is none is written as null: JSON has no infinity."""
    limits = {key: getattr(actuator, key) for key in ("lower", "upper", "rate")}
    finite = {key: value if isfinite(value) else None for key, value in limits.items()}
    return {"time_constant": actuator.time_constant, **finite, "unit": signal_unit(name)}
