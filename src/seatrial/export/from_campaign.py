"""The vehicle of a finished campaign: its estimated structure, and the rest from its body or from a published vehicle.

Nothing is computed here: results that are missing, or were made from another configuration than the folder now holds, are refused.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from seatrial import __version__
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.vehicle import CampaignVehicle, WholeVehicle
from seatrial.campaign.inference.estimate import stored_estimates
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import Store, read_result
from seatrial.campaign.store.summary import Summary
from seatrial.campaign.workflow.steps import NotCurrent, Workflow
from seatrial.core.argument_checks import check_kind, check_path
from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import RATES
from seatrial.estimation.posterior.configurations import names_in
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.output_error import spread_name
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import disturbance_name, disturbance_time_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.export.target import Statement
from seatrial.export.vehicle import (
    CONFIGURATION,
    FILL_FROM,
    AveragedCoefficient,
    CoefficientEstimates,
    EstimatedNumber,
    ExportedVehicle,
    ExportProvenance,
    PriorRanges,
    of_published,
    rest_for,
    same_mass,
)
from seatrial.export.write import EXPORTERS, export_vehicle, make_exporter, of_catalogue
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.messages.render import sentences
from seatrial.sampling.run import Draws
from seatrial.selection.structures import Structure
from seatrial.vehicles.active_dof import acting_terms
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.axis_equation import RATE_OF
from seatrial.vehicles.catalogue import PublishedVehicle, load_vehicle
from seatrial.vehicles.hull import GRAVITY, Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.tether import TETHER


def of_campaign(
    folder: Path | str, structure: str | None = None, rest: str | None = None, configuration: str | None = None
) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return the vehicle that a campaign's data support.

    Args:
        folder: of the campaign.
        structure: label of another structure than the chosen one.
        rest: published vehicle from which everything is taken that the campaign does not model.
        configuration: of the vehicle, if coefficients differ between several.

    Raises:
        InputError: results missing or made from another configuration, an unknown structure or configuration, estimates per unit of an
            unknown mass, or a published vehicle of another mass.
    """
    campaign = load_campaign(folder)
    estimate = stored_estimate(campaign, structure).in_configuration(configuration, CONFIGURATION)
    alone, provenance = _alone(campaign, estimate, configuration)
    return (
        (alone, provenance)
        if rest is None
        else _with_rest(campaign.vehicle, campaign.model(campaign.full), alone, provenance, rest)
    )


def stored_estimate(campaign: Campaign, label: str | None = None) -> Estimate:
    """Return the stored posterior of a structure, the chosen one if none is named.

    Raises:
        InputError: results missing or made from another configuration, or an unknown structure.
    """
    store, remedy = Store(campaign.folder), f"run `seatrial run {campaign.folder}` first"
    summary = read_result(Summary, store.summary, f"seatrial run {campaign.folder}")
    if summary.seatrial_version != __version__:
        raise _stale(campaign.folder, f"results of seatrial {summary.seatrial_version}", remedy)
    flow = Workflow(campaign)
    try:
        campaign, trials = flow.seen("candidates"), flow.seen("trials")
    except NotCurrent as cause:
        raise _stale(campaign.folder, "records or a screening of another configuration, or none", remedy) from cause
    labels = {structure.label: structure for structure in campaign.structures}
    chosen = label or summary.chosen
    if chosen not in labels:
        raise InputError(
            f"{campaign.folder}, structure {chosen}",
            found=f'"{chosen}"' if label else f'"{chosen}", which the campaign no longer has',
            expected="one of " + ", ".join(labels),
            remedy=nearest(chosen, labels) if label else remedy,
        )
    kept = stored_estimates(campaign, trials)[labels[chosen]]
    if not kept.is_current():
        raise _stale(campaign.folder, "another configuration, or none", remedy)
    return kept.read()


def _alone(
    campaign: Campaign, estimate: Estimate, configuration: str | None
) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return what the campaign itself knows."""
    hull, vehicle, structure = campaign.hull, campaign.vehicle, estimate.structure
    if isinstance(vehicle, WholeVehicle) and not vehicle.moves:
        raise InputError(
            campaign.where("vehicle.moves"),
            found="a vehicle tied in place, which gives thrust but no motion",
            expected="a vehicle that moves",
            remedy="name this campaign in priors_from of a campaign with motion, and export that",
        )
    summary = read_result(Summary, Store(campaign.folder).summary, f"seatrial run {campaign.folder}")
    estimated = _estimated(estimate, structure, summary, configuration)
    means = dict(zip(estimated.names, map(float, estimated.mean), strict=True))
    coefficients = {**hull.fixed, **means}
    model = vehicle.model(structure)
    common = {
        "coefficients": coefficients,
        "estimated": estimated,
        "beside": _beside(estimate),
        "actuators": _actuators(campaign.control_limits, model),
    }
    if isinstance(vehicle, WholeVehicle):
        tether = vehicle.hull.tether
        numbers = {
            one.name: EstimatedNumber(float(estimate.draws([one.name]).mean()), estimate.sd(one.name), one.unit)
            for one in model.unknowns
            if one.name in estimate.names
        }
        pulled = {name: one.value for name, one in numbers.items() if name in TETHER}
        result = ExportedVehicle(
            hull.name,
            replace(vehicle.hull, fixed={}, tether=tether and tether.at(pulled)),
            moves=tuple(rate for rate in RATES if rate in vehicle.body.moves) or ("u",),
            added_coriolis=vehicle.body.added_coriolis,
            thrusters=vehicle.body.thrusters,
            **common,
        ).with_numbers({name: one for name, one in numbers.items() if name not in TETHER})
        moved = ", ".join(rate for rate in RATES if rate in model.states)
    else:
        weight = 0.0 if hull.mass is None else hull.mass * GRAVITY
        drive = {"thrust_deduction": hull.thrust_deduction, "trim": hull.trim}
        moves, given = tuple(RATE_OF[axis] for axis in vehicle.axes), [rate for rate in RATES if rate in model.controls]
        body = Hull(hull.name, hull.mass, weight=weight, buoyancy=weight, **drive)
        result = ExportedVehicle(hull.name, body, moves=moves, given=tuple(given), **common)
        moved = ", ".join(moves)
    source = vehicle.catalogue
    given = [name for name in coefficients if name not in means]
    where = f"catalogue {source}" if source else "campaign.toml"
    names = tuple(name for name in estimate.names if name.split("[")[0] == CURRENT)
    trial_limited = [
        name for name, limits in campaign.control_limits.items() if name in result.actuators and limits != Limits()
    ]
    return result, ExportProvenance(
        estimate.key,
        campaign.name,
        f"{structure.label} ({' '.join(structure.terms)}), estimated from the motion in {moved}"
        + (f", configuration {configuration}" if configuration else ""),
        str(estimate.data.attrs.get("seatrial_version", "")),
        tuple(term for term in campaign.full.terms if term not in structure.terms),
        (", ".join(result.absent),) if result.absent else (),
        (
            f"{'body' if result.knows_body else 'mass' if hull.mass else 'no mass'}{', and ' + ' '.join(given) if given else ''}: {where}",
            *(
                [f"limits of {', '.join(trial_limited)}: those of its trials, [limits] of campaign.toml"]
                if trial_limited
                else []
            ),
        ),
        estimate.alarms,
        float(np.abs(estimate.draws(names).mean(0)).max()) if names else 0.0,
        _fitted_speeds(campaign),
    )


def _fitted_speeds(campaign: Campaign) -> tuple[float, float] | None:
    """Return between which speeds ahead, m/s, 98 % of the measured ones of the fitted records lie; None without a measured one."""
    fitted = None if campaign.imports is None else campaign.imports.fit
    records = [one.path for one in Workflow(campaign).stored("trials") if fitted is None or one.path.stem in fitted]
    measured = [data["u"].values for data in map(open_dataset, records) if "u" in data.data_vars]
    speeds = np.concatenate([np.zeros(0), *measured])
    speeds = speeds[np.isfinite(speeds)]
    return (float(np.quantile(speeds, 0.01)), float(np.quantile(speeds, 0.99))) if speeds.size else None


def _with_rest(
    vehicle: CampaignVehicle, model: VehicleModel, alone: ExportedVehicle, provenance: ExportProvenance, rest: str
) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return the published vehicle, in which all that acts in the campaign's motion is the campaign's."""
    published = of_published(rest, load_vehicle(rest))
    own, other = alone.hull.mass, published.hull.mass
    if not same_mass(alone.hull, published.hull):
        fitting = rest_for(alone)
        raise InputError(
            f"{FILL_FROM} {rest}",
            found=f"a mass of {other} kg, but the coefficients were estimated with {own} kg",
            expected="the same mass, because coefficients depend on it",
            remedy=(
                f"`{FILL_FROM} {fitting}`"
                if fitting
                else f"no published vehicle of {own} kg fits: leave {FILL_FROM} out"
            )
            + f", or estimate with the mass of {rest}",
        )
    whole = isinstance(vehicle, WholeVehicle)
    moves = model.states if whole else ("u",)
    replaced = {
        CoefficientName.parse(name)
        for name in acting_terms(
            tuple(published.coefficients), tuple(r for r in RATES if r in moves), (), published.thrusters
        )
    } | {CoefficientName.parse(name) for name in alone.coefficients}
    kept = {
        name: value for name, value in published.coefficients.items() if CoefficientName.parse(name) not in replaced
    }
    gone = [name for name in published.coefficients if name not in kept and name not in alone.coefficients]
    hull = replace(
        published.hull,
        mass=own,
        thrust_deduction=alone.hull.thrust_deduction,
        trim={**published.hull.trim, **alone.hull.trim},
        tether=alone.hull.tether,
    )
    result = replace(
        published,
        name=alone.name,
        hull=replace(hull, name=alone.name),
        coefficients={**alone.coefficients, **kept},
        actuators={**published.actuators, **alone.actuators},
        estimated=alone.estimated,
        beside=alone.beside,
    ).with_numbers(alone.numbers)
    return result, replace(
        provenance,
        sources=(
            *provenance.sources,
            f"{FILL_FROM} {rest}: rigid body, weight and buoyancy, and the {len(kept)} coefficients of motions outside the campaign",
            *(
                [f"of {rest} left out, because they act in the motion of the campaign: {' '.join(gone)}"]
                if gone
                else []
            ),
        ),
        absent=(", ".join(result.unknown_drives),) if result.unknown_drives else (),
    )


def _actuators(limited: Mapping[str, Limits], model: VehicleModel) -> dict[str, Actuator]:
    """Return the lags and limits of the campaign's vehicle; a control has those of its trials where it has no others."""
    results: dict[str, dict[str, float]] = {}
    for key, value in model.constants:
        if key.startswith("actuator "):
            _, name, part = key.split(" ")
            results.setdefault(name, {})[part] = value
    actuators = {name: Actuator(**parts) for name, parts in results.items()}
    for name, limits in limited.items():
        if name in model.controls and name not in actuators and limits != Limits():
            bounds = ((limits.lower, -inf), (limits.upper, inf), (limits.rate, inf))
            actuators[name] = Actuator(0.0, *(no_bound if bound is None else bound for bound, no_bound in bounds))
    return actuators


def _beside(estimate: Estimate) -> tuple[str, ...]:
    """Return what was estimated that acts on the motion and is not in its equation, in words."""
    kinds = {
        process_name(""): "process noise, gained in one second",
        disturbance_name(""): "a slow disturbing force, its standard deviation",
        spread_name(""): "differences between trials, their standard deviation",
    }
    meaning = {
        name: words
        for name in estimate.names
        for kind, words in kinds.items()
        if name.startswith(kind) and not name.startswith(disturbance_time_name(""))
    }
    meaning |= {name: "a delay between command and action" for name in estimate.names if name == DELAY}
    rows = {name: estimate.data.sel(parameter=name) for name in meaning}
    return tuple(
        f"{words}: {name} = {float(rows[name]['mean']):.4g} {rows[name]['unit'].item()}"
        for name, words in meaning.items()
    )


def _estimated(
    estimate: Estimate, structure: Structure, summary: Summary, configuration: str | None
) -> CoefficientEstimates:
    names = tuple(term for term in structure.terms if term in estimate.names)
    widened = np.stack([estimate.widened_draws(name) for name in names], 1) if names else np.zeros((1, 0))
    covariance = np.cov(widened.T, bias=True).reshape(len(names), len(names))
    kept = names_in([one.name for one in summary.averaged], configuration, CONFIGURATION) if summary.averaged else {}
    averaged = tuple(
        AveragedCoefficient(kept[one.name], one.mean, one.sd, one.inclusion)
        for one in summary.averaged
        if is_coefficient(kept.get(one.name, ""))
    )
    rows = estimate.data.sel(parameter=list(names))
    return CoefficientEstimates(
        names,
        estimate.draws(names).mean(0),
        np.sqrt(np.diag(covariance)),
        covariance,
        averaged,
        summary.quoted if averaged else "",
        PriorRanges(*(rows[f"prior_{key}"].values for key in PriorRanges._fields)),
    )


def _stale(folder: Path, estimate: str, remedy: str) -> InputError:
    return InputError(
        str(folder), found=estimate, expected="finished results of the present campaign.toml", remedy=remedy
    )


# A vehicle out to a target in one call, wherever it comes from: the catalogue, one's own numbers and draws, or a
# finished campaign.


def export_to(
    what: PublishedVehicle | Campaign | Path | str,
    to: str,
    folder: Path | str,
    *,
    draws: Draws | None = None,
    structure: str | None = None,
    rest: str | None = None,
    configuration: str | None = None,
    announce: Callable[[Statement], None] | None = None,
    **options: Any,
) -> tuple[Statement, list[Path]]:
    """Write a vehicle in the format of a simulator or a table.

    Args:
        what: a vehicle; a finished campaign, or its folder; or the name of a published vehicle.
        to: a target, such as `gz`, `casadi` or `json`; `seatrial export --help` lists them.
        folder: of its files.
        draws: of a posterior of the coefficients of a vehicle; their means replace its values.
        structure: of a campaign, label of a structure instead of the chosen one.
        rest: of a campaign, published vehicle with all coefficients that it does not model.
        configuration: of a campaign, or of draws, in which coefficients differ between configurations of the vehicle.
        announce: called with the statement, which says what is lost, before anything is written.
        options: of the target: `engine` of `gz`; `density` of the water, kg/m^3, of simulators; `count` and `seed` of draws; `speeds`, m/s,
            of `control`.

    Returns:
        the statement of the export (`.lines`) with losses in predicted motion, and the files.

    Raises:
        InputError: an unknown target or option, or a vehicle that the target cannot hold or would make unstable; nothing is written then.
    """
    out = check_path(folder, "folder")
    exporter = make_exporter(check_kind(to, str, "to", "one of " + ", ".join(EXPORTERS)), **options)
    if draws is not None:
        check_kind(draws, Draws, "draws", "draw them with `sample`")
    if isinstance(what, PublishedVehicle):
        _refuse(what.hull.name, structure=structure, rest=rest)
        vehicle, provenance = of_estimates(what, draws, configuration)
    else:
        _refuse(str(what), draws=draws)
        place = what.folder if isinstance(what, Campaign) else check_path(what, "what")
        if place.exists():
            vehicle, provenance = of_campaign(place, structure, rest, configuration)
        else:
            _refuse(str(what), structure=structure, rest=rest, configuration=configuration)
            vehicle, provenance = of_catalogue(str(what))
    return export_vehicle(exporter, vehicle, provenance, out, announce)


def of_estimates(
    vehicle: PublishedVehicle, draws: Draws | None = None, configuration: str | None = None
) -> tuple[ExportedVehicle, ExportProvenance]:
    """Return a vehicle with the means of draws in the places of its own values, those of one configuration if they differ.

    Raises:
        InputError: draws of none of its coefficients, no configuration although they differ, or forces that are no sum of named terms.
    """
    exported = of_published(vehicle.hull.name, vehicle)
    absent = (", ".join(exported.absent),) if exported.absent else ()
    provenance = ExportProvenance("own numbers", exported.name, version=__version__, absent=absent)
    if draws is None:
        _refuse(exported.name, configuration=configuration)
        return exported, provenance
    chosen = names_in(draws.names, configuration, "configuration")
    at = [draws.names.index(name) for name in chosen]
    units = tuple(draws.units[i] for i in at)
    draws = replace(draws, z=draws.z[..., at], values=draws.values[..., at], names=tuple(chosen.values()), units=units)
    names = tuple(name for name in draws.names if name in exported.coefficients)
    if not names:
        raise InputError(
            "draws",
            found=", ".join(draws.names),
            expected="coefficients of the vehicle: " + ", ".join(exported.coefficients),
            remedy="give the vehicle a value of each estimated term",
        )
    table = draws.array(names)
    covariance = np.cov(table.T, bias=True).reshape(len(names), len(names))
    estimated = CoefficientEstimates(names, table.mean(0), np.sqrt(np.diag(covariance)), covariance)
    means = dict(zip(names, map(float, estimated.mean), strict=True))
    cautions = tuple(sentences(draws.findings()))
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
