"""What is known about each parameter and about several together, kept on disk: of the best design, and of each fit.

The directions are the eigenvectors v of the information of the data alone, scaled by the values: v / sqrt(eigenvalue) is the
change of all parameters at once, in shares of their values, that makes the data one standard error less likely.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import CampaignVehicle, WholeVehicle
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.store.estimates import Drawn, Estimate, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.coefficients import CoefficientName
from seatrial.design.sweep import Sweep
from seatrial.estimation.diagnostics.identifiability import Identifiability, identifiability_of_design, identify
from seatrial.estimation.diagnostics.known import Direction, Known, KnownParameter
from seatrial.estimation.diagnostics.symmetry import PriorCurve, symmetries
from seatrial.estimation.posterior.information import likelihood_information
from seatrial.estimation.posterior.output_error import is_deviation
from seatrial.estimation.posterior.posterior import Parameter
from seatrial.messages.identifiability import identifiability_cautions, symmetry_sentence

NAMED = 0.1  # Share of the largest move from which a parameter is named in a direction


def stored_known_after(campaign: Campaign, estimate: OfStructure) -> StoredResult[Known]:
    """Return where it is kept what a fit tells about each parameter, and what that depends on."""
    path = Store(campaign.folder).known(estimate.structure.label)
    key = key_of("known", estimate.key, dict(campaign.prior_units))
    return StoredResult(path, key, Known, f"seatrial estimate {campaign.folder}")


def stored_known_before(campaign: Campaign) -> StoredResult[Known]:
    """Return where it is kept what the best design would tell about each parameter, and what that depends on."""
    key = key_of("known", design_key(campaign), dict(campaign.prior_units))
    return StoredResult(Store(campaign.folder).known_design, key, Known, f"seatrial design {campaign.folder}")


def known_after(campaign: Campaign, estimate: Estimate, trials: Trials) -> Known:
    """Judge a fit by the information of its data at the mode and the covariance of its draws; a current result is read."""

    def judge() -> Known:
        posterior = Study(campaign, trials.fit).posterior(estimate.structure)
        values = estimate.data["mode"].values
        information = likelihood_information(posterior, values)
        cov = np.atleast_2d(np.cov(estimate.draws().T))
        result = identify(posterior.present_parameters, values, information, cov=cov, at=campaign.hull.trim)
        known = _known(result, information, estimate.structure.label)
        parameters = tuple(_with_all_errors(one, estimate) for one in known.parameters)
        symmetry = symmetry_of(campaign.vehicle, estimate, estimate.prior_curves)
        return replace(known, parameters=parameters, symmetry=symmetry)

    return stored_known_after(campaign, estimate).read_or_make(judge)


def _with_all_errors(parameter: KnownParameter, estimate: Estimate) -> KnownParameter:
    """Return a parameter with the ± of the estimate, which holds more than the noise, instead of that of its draws."""
    wider = estimate.sd(parameter.name) / parameter.sd if parameter.sd else 1.0
    left = max(parameter.left, min(1.0, wider * parameter.left))
    return replace(parameter, sd=wider * parameter.sd, relative=wider * parameter.relative, left=left)


def symmetry_of(
    vehicle: CampaignVehicle, drawn: Drawn, priors: Callable[[], Mapping[str, tuple[np.ndarray, np.ndarray]]]
) -> tuple[str, ...]:
    """Say of a whole vehicle which sides the data find alike; the others have too few terms for that to be a question of its own.

    Args:
        vehicle: of the campaign.
        drawn: draws of the posterior.
        priors: gives values that increase and the density there, of each of its parameters.
    """
    if not isinstance(vehicle, WholeVehicle):
        return ()
    curves = {name: PriorCurve(*curve) for name, curve in priors().items()}
    return tuple(symmetry_sentence(one) for one in symmetries(curves, drawn.draws(), vehicle.body.thrusters))


def known_before(campaign: Campaign, sweep: Sweep) -> Known:
    """Judge the best design for the full structure at its prior means, sensors as rare as they are; a current result is read."""
    structure = campaign.full

    def judge() -> Known:
        model, family = campaign.model(structure), campaign.family
        units = {term.text: model.unit_of(term) for term in model.coefficients}
        parameters = [
            Parameter(name, unit, CoefficientName.parse(name).label, campaign.prior(name), campaign.shown(name, unit))
            for name, unit in units.items()
        ]
        share = campaign.measured_mask(family.time()).mean(axis=0)
        noise = {
            channel: campaign.noise[channel] / float(np.sqrt(present))
            for channel, present in zip(campaign.channels, share, strict=True)
        }
        start = campaign.state_trim(model)
        trial = sweep.best_controls(), family.sample_time, start, noise
        through = campaign.pilot(model.controls), campaign.expected_process(model)
        result = identifiability_of_design(parameters, model, *trial, campaign.hull.trim, *through)
        return _known(result, None, structure.label)

    return stored_known_before(campaign).read_or_make(judge)


def _known(found: Identifiability, information: np.ndarray | None, label: str) -> Known:
    parameters = []
    for i, name in enumerate(found.names):
        if is_deviation(name):  # its natural value is zero; the trial's own value is told with the estimates
            continue
        others = np.abs(found.correlation[i] * (np.arange(len(found.names)) != i))
        j = int(np.argmax(others))
        parameters.append(
            KnownParameter(
                name,
                found.units[i],
                float(found.values[i]),
                float(found.sd[i]),
                float(found.relative_sd[i]),
                float(found.contraction[i]),
                found.names[j] if j != i else "",
                float(found.correlation[i, j]) if j != i else 0.0,
            )
        )
    directions = () if information is None else _directions(found, information)
    return Known(found.stage, label, tuple(parameters), directions, tuple(identifiability_cautions(found)))


def _directions(found: Identifiability, information: np.ndarray) -> tuple[Direction, ...]:
    """Eigenvectors of the information in shares of the values, or of prior standard deviations where these are near zero."""
    relative = np.abs(found.values) > 1e-6 * found.prior_sd
    scale = np.where(relative, found.values, found.prior_sd)
    scaled = information * np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return ()
    eigenvalues, vectors = np.linalg.eigh(scaled)
    directions = []
    for value, vector in zip(eigenvalues[::-1], vectors.T[::-1], strict=True):
        if not value > 0:
            continue
        move = vector / np.sqrt(value)
        move = move * np.sign(move[np.argmax(np.abs(move))])
        order = [
            i
            for i in np.argsort(-np.abs(move))
            if abs(move[i]) > NAMED * np.abs(move).max() and not is_deviation(found.names[i])
        ]
        if not order:
            continue
        directions.append(
            Direction(
                float(1 / np.sqrt(value)),
                tuple((found.names[i], float(move[i])) for i in order),
                tuple(bool(relative[i]) for i in order),
            )
        )
    return tuple(directions)
