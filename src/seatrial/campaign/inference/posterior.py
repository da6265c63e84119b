"""From a campaign and its records to the posterior of one structure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.core.coefficients import base_name, configuration_of
from seatrial.core.errors import InputError, located, too_few
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.posterior.output_error import initial_name
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.record_posterior import (
    guess_of,
    make_posterior,
    parameters_of,
    priors_of_guess,
)
from seatrial.estimation.priors import Normal, Prior
from seatrial.estimation.simulation.starts import first_measured, level_start
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel

WIDEST = 1e30  # Standard deviation of a prior, SI, beyond which squares of it leave double precision
# Parameters of all structures together up to which each is computed by the programs of all; beyond, those with such a
# share of them.
FEW, SHARED = 12, 0.5
NARROWEST = 1e-9  # Standard deviation over value of a prior below which rounding is felt


def build_posterior(campaign: Campaign, structure: Structure, records: Sequence[Record]) -> Posterior:
    """Joint posterior of a structure's coefficients and nuisances given several trials.

    Raises:
        InputError: a channel a record lacks, a record whose first samples leave the initial state unknown, too few measurements, a
            prior too wide or too narrow to compute with, or what varies between trials of which there is one.
    """
    model = campaign.model(structure)
    _check_parameters(campaign, build_parameters(campaign, model, records), records)
    return _posterior(campaign, model, records)


def _posterior(campaign: Campaign, model: VehicleModel, records: Sequence[Record]) -> Posterior:
    """Return the posterior of a model, given trials that are not checked to determine it; errors as `make_posterior`."""
    starts = [initial_state(campaign, model, record) for record in records]
    _check_turns(model, records, campaign.channels)
    with located(str(campaign.path)):
        posterior = make_posterior(
            model,
            records,
            _priors(campaign, model, records),
            campaign.sensor_models,
            start=starts,
            start_sd={state: first_sd(campaign.noise, state) for state in model.states},
            starts_over_ground=campaign.estimation.initial != "trim",
            own=campaign.own,
            by_configuration=campaign.by_configuration(model),
        )
    return replace(posterior, parameters=_shown(campaign, posterior.parameters))


def _shown(campaign: Campaign, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Return parameters in the units of their priors."""
    return tuple(replace(one, shown=campaign.shown(one.name, one.unit)) for one in parameters)


def widest(structures: Sequence[Structure]) -> Structure:
    """Return the structure that has every term of several; one of them if that has all."""
    terms = tuple(dict.fromkeys(term for one in structures for term in one.terms))
    whole = next((one for one in structures if set(one.terms) == set(terms)), None)
    return whole or Structure("all", terms)


def shared_model(campaign: Campaign, structure: Structure) -> VehicleModel:
    """Return the model of all structures, if under this one the vehicle has the same states and controls; else this one's own."""
    own, wide = campaign.model(structure), campaign.model(widest(campaign.structures))
    return wide if (wide.states, wide.controls) == (own.states, own.controls) else own


def narrow_posterior(campaign: Campaign, wide: Posterior, structure: Structure, records: Sequence[Record]) -> Posterior:
    """Return the posterior of a structure as that of a wider one in which some parameters are absent; errors as `build_posterior`.

    Both share all that is compiled. One of its own is built where the structure has few of many parameters (`FEW`, `SHARED`), or another
    motion: states or controls that go with the terms.
    """
    model = campaign.model(structure)
    parameters = build_parameters(campaign, model, records)
    _check_parameters(campaign, parameters, records)
    names = {parameter.name for parameter in parameters}
    known = {parameter.name: parameter for parameter in wide.parameters}
    same = shared_model(campaign, structure) == wide.likelihood.model
    same = same and all(known.get(parameter.name) == parameter for parameter in parameters)
    if not same or (wide.dim > FEW and len(parameters) < SHARED * wide.dim):
        return build_posterior(campaign, structure, records)
    guess = wide.guess
    if guess is not None:
        terms, common = tuple(term.text for term in model.coefficients), wide.likelihood.model
        starts = [initial_state(campaign, common, record) for record in records]
        coefficients = first_guess(common, records, starts, priors_of_guess(wide.parameters), terms)
        guess = guess_of(wide.parameters, coefficients)
    return replace(wide, present=np.array([float(name in names) for name in wide.names]), guess=guess)


def _check_parameters(campaign: Campaign, parameters: Sequence[Parameter], records: Sequence[Record]) -> None:
    _check_widths(parameters, campaign.where)
    if campaign.estimation.varying and len(records) < 2:
        raise InputError(
            campaign.where("estimation.varying"),
            found=f'one trial, "{records[0].label}"',
            expected="at least two trials, because the spread of a coefficient is its variation between trials",
            remedy="fit more runs jointly, or remove `varying` and its priors of spread",
        )
    count = sum(int(np.isfinite(record.channel(channel)).sum()) for record in records for channel in campaign.channels)
    if count < 2 * len(parameters):
        raise too_few(
            "records " + ", ".join(f'"{record.label}"' for record in records),
            f"{count} measurements for {len(parameters)} unknowns",
            f"{2 * len(parameters)} measurements",
            "check the unit of the time column, or give a longer record",
        )


def is_whole(structure: Structure, candidates: Sequence[Structure]) -> bool:
    """Whether no candidate has all terms of a structure and more."""
    return not any(set(structure.terms) < set(other.terms) for other in candidates)


def build_parameters(campaign: Campaign, model: VehicleModel, records: Sequence[Record]) -> tuple[Parameter, ...]:
    """Coefficients and nuisances with their priors, those of each trial under its label."""
    labels = [record.label for record in records]
    priors = _priors(campaign, model, records)
    configurations = tuple(dict.fromkeys(record.configuration for record in records))
    differing = campaign.by_configuration(model), configurations
    return _shown(campaign, parameters_of(model, campaign.sensor_models, priors, labels, campaign.own, *differing))


def posterior_of_one(campaign: Campaign, structure: Structure, record: Record) -> Posterior:
    """Return the posterior of one trial, of which parameters, priors and simulation are used, as one of all structures.

    Not by `build_posterior`, which asks for two trials where coefficients vary between them, and for measurements.
    """
    wide = _posterior(campaign, shared_model(campaign, structure), [record])
    names = {one.name for one in build_parameters(campaign, campaign.model(structure), [record])}
    present = np.array([float(name in names) for name in wide.names])
    return replace(wide, present=None if present.all() else present, guess=None)


def _check_turns(model: VehicleModel, records: Sequence[Record], channels: Sequence[str]) -> None:
    """Refuse angles of sensors beyond half a turn where the attitude is a quaternion, whose angles never are."""
    if not set(QUATERNION) <= set(model.states):
        return
    for record in records:
        for angle in (name for name in ANGLES if name in channels and name in record.measured):
            furthest = float(np.nanmax(np.abs(record.channel(angle))))
            if furthest > np.pi:
                raise InputError(
                    f'record "{record.label}", channel "{angle}"',
                    found=f"{np.degrees(furthest):.0f} deg",
                    expected="angles within 180 deg, as a quaternion gives them",
                    remedy="give [sensors.attitude] instead of the angles, because it never jumps; or, without loops and rolls over the "
                    'vertical, set vehicle.attitude = "euler"',
                )


def first_sd(noise: Mapping[str, float], state: str) -> float:
    """How far a first measurement lies from the state, SI: the sensor's noise, or 1 if there is no sensor."""
    return noise.get(state, 1.0)


def _priors(campaign: Campaign, model: VehicleModel, records: Sequence[Record]) -> dict[str, Prior]:
    """Return the prior of every unknown by name, SI; that of an initial state lies about the start of its own trial."""
    priors = {term.text: campaign.prior(term.text) for term in model.coefficients}
    priors |= {unknown.name: prior for unknown, prior in campaign.other_unknowns(model)}
    named = {record.configuration for record in records}
    differing = campaign.by_configuration(model)
    priors |= {
        name: prior
        for name, prior in campaign.priors.items()
        if configuration_of(name) in named and base_name(name) in differing
    }
    for record in records if campaign.estimation.free_initial else ():
        for state, value in zip(model.states, initial_state(campaign, model, record), strict=True):
            if not state.endswith(ACTUAL):
                sd = 5.0 * campaign.noise[state] if state in campaign.noise else 1.0
                priors[initial_name(state, record.label)] = Normal(value, sd)
    return priors


def _check_widths(parameters: Sequence[Parameter], name_key: Callable[[str], str]) -> None:
    for parameter in parameters:
        mean, sd = float(parameter.prior.mean), float(parameter.prior.sd)
        where = name_key(f"prior.{base_name(parameter.name)}")
        if not sd < WIDEST:
            raise InputError(
                where,
                found=f"a standard deviation of {sd:.3g} {parameter.unit}",
                expected=f"a standard deviation below {WIDEST:g}",
                remedy="give the smallest and the largest plausible value",
            )
        if sd < NARROWEST * abs(mean):
            raise InputError(
                where,
                found=f"{mean:.6g} {parameter.unit} with a standard deviation of {sd:.3g}, which leaves nothing to estimate",
                expected=f"a standard deviation of at least {NARROWEST:g} of the value",
                remedy="widen it, or fix the coefficient under [vehicle] if it is known",
            )


def initial_state(campaign: Campaign, model: VehicleModel, record: Record) -> tuple[float, ...]:
    """Initial state of a trial: trim, or the first measurement where there is one.

    Raises:
        InputError: a state that is not measured and has no trim value; of a whole vehicle such states start at 0 and level.
    """
    if campaign.estimation.initial == "trim":
        return campaign.state_trim(model)
    known = {**campaign.hull.trim, **first_measured(record)}
    for state in model.states:
        if state not in known and campaign.vehicle.equations(campaign.full):
            raise InputError(
                f'record "{record.label}", channel "{state}"',
                found="no channel with a finite value and no trim value",
                expected="a first measurement",
                remedy='set estimation.initial = "trim", or map the channel',
            )
    return level_start(model, known)
