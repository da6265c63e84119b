"""From a campaign and its records to the posterior of one structure."""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import jax
import numpy as np

from seatrial.campaign.config.assumed_unknowns import varying
from seatrial.campaign.config.campaign import Campaign
from seatrial.compiled.random_keys import seeded_key
from seatrial.core.errors import InputError, located
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, QUATERNION, signal_unit
from seatrial.estimation.posterior.filter_error import FilterError, filter_error
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.posterior.output_error import OutputError, initial_name, output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.unknowns import deviations
from seatrial.estimation.priors import Normal
from seatrial.estimation.simulation.disturbance import disturbed_axes
from seatrial.estimation.simulation.starts import first_measured, level_start
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel

WIDEST = 1e30
"""Standard deviation of a prior, SI, beyond which squares of it leave double precision."""
FEW, SHARED = 12, 0.5
"""Parameters of all structures together up to which each is computed by the programs of all; beyond, those with such a share of them."""
NARROWEST = 1e-9
"""Standard deviation over value of a prior below which rounding is felt."""


def random_key(seed: int, purpose: str) -> jax.Array:
    """Random key of one piece of work, from the campaign's seed and the work's name."""
    return seeded_key(seed, zlib.crc32(purpose.encode()))


def build_posterior(campaign: Campaign, structure: Structure, records: Sequence[Record]) -> Posterior:
    """Joint posterior of a structure's coefficients and nuisances given several trials.

    Raises:
        InputError: a channel a record lacks, a record whose first samples leave the initial state unknown, too few measurements, a
            prior too wide or too narrow to compute with, or what varies between trials of which there is one.
    """
    model = campaign.model(structure)
    parameters = build_parameters(campaign, model, records)
    _check_parameters(campaign, parameters, records)
    guess = _guess(campaign, model, records, parameters)
    return Posterior(parameters, *build_likelihood(campaign, model, records), guess)


def widest(structures: Sequence[Structure]) -> Structure:
    """Return the structure that has every term of several; one of them where that has all."""
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
        terms = tuple(term.text for term in model.coefficients)
        guess = _guess(campaign, wide.likelihood.model, records, wide.parameters, terms)
    return replace(wide, present=np.array([float(name in names) for name in wide.names]), guess=guess)


def _check_parameters(campaign: Campaign, parameters: Sequence[Parameter], records: Sequence[Record]) -> None:
    _check_widths(parameters, campaign.where)
    _check_trials(campaign, records)
    _check_enough(campaign.channels, records, len(parameters))


def _guess(
    campaign: Campaign,
    model: VehicleModel,
    records: Sequence[Record],
    parameters: Sequence[Parameter],
    terms: Sequence[str] | None = None,
) -> np.ndarray | None:
    """Coefficients from the measured motion, of some terms only where these are given; in surge alone draws from the prior do as well."""
    if campaign.vehicle.is_surge:
        return None
    priors = {parameter.name: parameter.prior for parameter in parameters}
    starts = [initial_state(campaign, model, record) for record in records]
    found = first_guess(model, records, starts, priors, terms)
    return np.array([found.get(parameter.name, np.nan) for parameter in parameters])


def is_whole(campaign: Campaign, structure: Structure) -> bool:
    """Whether no candidate has all terms of a structure and more."""
    return not any(set(structure.terms) < set(other.terms) for other in campaign.structures)


def build_parameters(campaign: Campaign, model: VehicleModel, records: Sequence[Record]) -> tuple[Parameter, ...]:
    """Coefficients and nuisances with their priors, those of each trial under its label."""
    labels, own = tuple(record.label for record in records), campaign.own
    parameters = [
        Parameter(term.text, model.unit_of(term), term.label, campaign.prior(term.text)) for term in model.coefficients
    ]
    for unknown, prior in campaign.other_unknowns(model):
        each = unknown.name in own
        parameters += [unknown.of_trial(label, prior) for label in labels] if each else [unknown.parameter(prior)]
    parameters += deviations(varying(campaign.estimation, model), labels)
    if campaign.estimation.free_initial:
        starts = [initial_state(campaign, model, record) for record in records]
        parameters += _initial_states(campaign.noise, model, labels, starts)
    parameters = [replace(one, shown=campaign.shown(one.name, one.unit)) for one in parameters]
    return tuple(parameters)


def build_likelihood(
    campaign: Campaign, model: VehicleModel, records: Sequence[Record]
) -> tuple[OutputError | FilterError, TrialData]:
    """Likelihood of several trials, and its data.

    Raises:
        InputError: records or sensors that this likelihood cannot use, with the campaign's file.
    """
    table = campaign.estimation
    starts = [initial_state(campaign, model, record) for record in records]
    options = {
        "delay": campaign.has_delay,
        "current": table.current != "none",
        "own": campaign.own,
        "varying": tuple(one.name for one in varying(campaign.estimation, model)),
        "starts_over_ground": table.initial != "trim",
    }
    _check_turns(model, records, campaign.channels)
    with located(str(campaign.path)):
        if table.likelihood == "filter-error":
            spread = [first_sd(campaign.noise, state) for state in model.states]
            options["disturbed"] = disturbed_axes(campaign.priors, model)
            return filter_error(model, records, campaign.sensor_models, starts, spread, **options)
        return output_error(
            model, records, campaign.sensor_models, starts, free_initial=campaign.estimation.free_initial, **options
        )


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
                    remedy="give [sensors.attitude] in place of the angles, which jumps nowhere; without loops and rolls over the "
                    'vertical vehicle.attitude = "euler" will do',
                )


def first_sd(noise: Mapping[str, float], state: str) -> float:
    """How far a first measurement lies from the state, SI: the sensor's noise, or 1 where there is no sensor."""
    return noise.get(state, 1.0)


def _initial_states(
    noise: Mapping[str, float], model: VehicleModel, labels: Sequence[str], starts: Sequence[Sequence[float]]
) -> list[Parameter]:
    return [
        Parameter(
            initial_name(state, label),
            signal_unit(state),
            rf"{state}_0[{label}]",
            Normal(value, 5.0 * noise[state] if state in noise else 1.0),
        )
        for label, start in zip(labels, starts, strict=True)
        for state, value in zip(model.states, start, strict=True)
        if not state.endswith(ACTUAL)  # it stands where it is commanded to be
    ]


def _check_widths(parameters: Sequence[Parameter], name_key: Callable[[str], str]) -> None:
    for parameter in parameters:
        mean, sd = float(parameter.prior.mean), float(parameter.prior.sd)
        where = name_key(f"prior.{parameter.name.split('[')[0]}")
        if not sd < WIDEST:
            raise InputError(
                where,
                found=f"a standard deviation of {sd:.3g} {parameter.unit}",
                expected=f"a standard deviation below {WIDEST:g}",
                remedy="give the smallest and the largest value that you would believe",
            )
        if sd < NARROWEST * abs(mean):
            raise InputError(
                where,
                found=f"{mean:.6g} {parameter.unit} with a standard deviation of {sd:.3g}: it leaves nothing to estimate",
                expected=f"a standard deviation of at least {NARROWEST:g} of the value",
                remedy="widen it, or fix the coefficient under [vehicle] if it is known",
            )


def _check_trials(campaign: Campaign, records: Sequence[Record]) -> None:
    if campaign.estimation.varying and len(records) < 2:
        raise InputError(
            campaign.where("estimation.varying"),
            found=f'one trial, "{records[0].label}"',
            expected="two trials at least: how much a coefficient varies between them is what its spread says",
            remedy="fit more runs jointly, or remove `varying` and its priors of spread",
        )


def _check_enough(channels: Sequence[str], records: Sequence[Record], unknowns: int) -> None:
    count = sum(int(np.isfinite(record.channel(channel)).sum()) for record in records for channel in channels)
    if count < 2 * unknowns:
        raise InputError(
            "records " + ", ".join(f'"{record.label}"' for record in records),
            found=f"{count} measurements for {unknowns} unknowns",
            expected=f"at least {2 * unknowns} measurements",
            remedy="check the unit of the time column, or give a longer record",
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
                found="neither a channel with a finite value nor a trim value",
                expected="a first measurement",
                remedy='set estimation.initial = "trim", or map the channel',
            )
    return level_start(model, known)
