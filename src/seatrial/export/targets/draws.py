"""Draws of the posterior, for scenarios of a controller and for a learner: CSV, JSON and NumPy's NPZ with names, units and weights."""

import csv
import io
import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seatrial.core.errors import InputError
from seatrial.export.ensemble import DRAWS, ellipsoid_of, ensemble_lines, ensemble_of, widths_of
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import UNCERTAINTY, ExportedVehicle, ExportProvenance


@dataclass(frozen=True)
class DrawsTable(Exporter):
    """See the module; `count` and `seed` are those of `ensemble_of`."""

    name: str = "draws"
    target: str = "draws of the posterior (CSV, JSON, NPZ), format 1"
    count: int = DRAWS
    seed: int = 0
    takes_unknown_mass: ClassVar[bool] = True

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        super().check(vehicle)
        if not vehicle.estimated.names:
            raise InputError(
                f'vehicle "{vehicle.name}", export to {self.name}',
                found="values without a covariance, so that there is nothing to draw from",
                expected="coefficients that were estimated",
                remedy="export a finished campaign, or give the `draws` of a posterior to `seatrial.export_vehicle`",
            )

    def notes(self, vehicle: ExportedVehicle, provenance: ExportProvenance) -> tuple[str, ...]:
        """Return how the draws came about, and how far to randomise."""
        return ensemble_lines(vehicle, ensemble_of(vehicle, self.count, self.seed))

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str | bytes]:
        """See `Exporter`."""
        ensemble, ellipsoid = ensemble_of(vehicle, self.count, self.seed), ellipsoid_of(vehicle.estimated)
        units = [vehicle.unit(name) for name in ensemble.names]
        weights = np.full(len(ensemble.values), 1.0 / len(ensemble.values))
        about = [*statement.lines, UNCERTAINTY]
        given = {name: float(value) for name, value in vehicle.coefficients.items() if name not in ensemble.names}
        arrays = {
            "about": np.array("\n".join(about)),
            "names": np.array(ensemble.names),
            "units": np.array(units),
            "weights": weights,
            "draws": ensemble.values,
            "ellipsoid_centre": ellipsoid.centre,
            "ellipsoid_matrix": ellipsoid.matrix,
            "ellipsoid_squared_radius": np.array(ellipsoid.squared_radius),
            "given_names": np.array(list(given)),
            "given_values": np.array(list(given.values())),
        }
        content = {
            "format": 1,
            "about": about,
            "seed": self.seed,
            "names": list(ensemble.names),
            "units": units,
            "weights": weights.tolist(),
            "draws": ensemble.values.tolist(),
            "replaced": dict(ensemble.replaced),
            "randomise": [width._asdict() for width in widths_of(vehicle.estimated)],
            "ellipsoid": {
                "centre": ellipsoid.centre.tolist(),
                "matrix": ellipsoid.matrix.tolist(),
                "squared_radius": ellipsoid.squared_radius,
                "probability": ellipsoid.probability,
            },
            "given": given,
        }
        binary, text = io.BytesIO(), io.StringIO()
        np.savez(binary, **arrays)
        head = ["weight", *(f"{name} [{unit}]" for name, unit in zip(ensemble.names, units, strict=True))]
        rows = np.column_stack([weights, ensemble.values]).tolist()
        csv.writer(text, lineterminator="\n").writerows([head, *([repr(x) for x in row] for row in rows)])
        return {
            "draws.csv": "".join(f"# {line}\n" for line in about) + text.getvalue(),
            "draws.json": json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n",
            "draws.npz": binary.getvalue(),
        }
