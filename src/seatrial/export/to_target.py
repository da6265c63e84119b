"""A vehicle out to a target in one call, wherever it comes from: the catalogue, one's own numbers and draws, or a finished campaign."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seatrial import __version__
from seatrial.campaign.config.campaign import Campaign
from seatrial.core.argument_checks import check_choice, check_kind, check_path
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.from_campaign import of_campaign
from seatrial.export.target import Statement
from seatrial.export.vehicle import CoefficientEstimates, ExportedVehicle, ExportProvenance, of_published
from seatrial.export.write import EXPORTERS, export_vehicle, make_exporter, of_catalogue
from seatrial.sampling.run import Draws
from seatrial.vehicles.catalogue import PublishedVehicle


def export_to(
    what: PublishedVehicle | Campaign | Path | str,
    to: str,
    folder: Path | str,
    *,
    draws: Draws | None = None,
    structure: str | None = None,
    rest: str | None = None,
    **options: Any,
) -> tuple[Statement, list[Path]]:
    """Write a vehicle in the format of a simulator or a table.

    Args:
        what: a vehicle; a finished campaign, or its folder; or the name of a published vehicle.
        to: `gz`, `stonefish`, `fossen`, `holoocean`, `json` or `csv`.
        folder: where its files are written.
        draws: of a posterior of a vehicle's coefficients, whose means take the places of its own values.
        structure: of a campaign, label of another structure than the chosen one.
        rest: of a campaign, published vehicle from which everything comes that it does not model.
        options: of the target: `engine` of `gz`; `density` of the water, kg/m^3, of simulators.

    Returns:
        what the export says of itself (`.lines`), losses in predicted motion included, and the files.

    Raises:
        InputError: an unknown target or option, or a vehicle that the target cannot hold or would make unstable; nothing is written then.
    """
    out = check_path(folder, "folder")
    check_choice(to, tuple(EXPORTERS), "to")
    if draws is not None:
        check_kind(draws, Draws, "draws", "draw them with `sample`")
    if isinstance(what, PublishedVehicle):
        _refuse(what.hull.name, structure=structure, rest=rest)
        vehicle, provenance = of_estimates(what, draws)
    else:
        _refuse(str(what), draws=draws)
        place = what.folder if isinstance(what, Campaign) else check_path(what, "what")
        if place.exists():
            vehicle, provenance = of_campaign(place, structure, rest)
        else:
            _refuse(str(what), structure=structure, rest=rest)
            vehicle, provenance = of_catalogue(str(what))
    return export_vehicle(make_exporter(to, **options), vehicle, provenance, out)


def of_estimates(vehicle: PublishedVehicle, draws: Draws | None = None) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return a vehicle with the means of draws in the places of its own values.

    Raises:
        InputError: draws of none of its coefficients, or forces that are no sum of named terms.
    """
    exported = of_published(vehicle.hull.name, vehicle)
    absent = [f"everything about {rate}" for rate in RATES if rate not in exported.moves] + exported.unknown_drives
    provenance = ExportProvenance(
        "own numbers", exported.name, version=__version__, absent=(", ".join(absent),) if absent else ()
    )
    if draws is None:
        return exported, provenance
    names = tuple(name for name in draws.names if name in exported.coefficients)
    if not names:
        raise InputError(
            "draws",
            found=", ".join(draws.names),
            expected="coefficients of the vehicle: " + ", ".join(exported.coefficients),
            remedy="give the vehicle a value of each term that was estimated",
        )
    table = draws.array(names)
    covariance = np.cov(table.T, bias=True).reshape(len(names), len(names))
    estimated = CoefficientEstimates(names, table.mean(0), np.sqrt(np.diag(covariance)), covariance)
    means = dict(zip(names, map(float, estimated.mean), strict=True))
    cautions = tuple(draws.complaints())
    tether = exported.hull.tether
    if tether is not None:
        pulled = tuple(one.name for one in tether.unknowns if one.name in draws.names)
        tether = tether.at({name: float(draws.array((name,)).mean()) for name in pulled})
    hull, every = replace(exported.hull, tether=tether), {**exported.coefficients, **means}
    return (
        replace(exported, hull=hull, coefficients=every, estimated=estimated),
        replace(provenance, run="own records", cautions=cautions),
    )


def _refuse(what: str, **options: Any) -> None:
    for name, value in options.items():
        if value is not None:
            raise InputError(
                f"export of {what}",
                found=f"{name}, which has no meaning there",
                expected="draws of a vehicle; structure and rest of a campaign",
                remedy=f"leave {name} out",
            )
