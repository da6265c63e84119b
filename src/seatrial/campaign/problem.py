"""From a campaign and its records to the posterior of one structure."""

import zlib
from collections.abc import Sequence

import jax
import numpy as np

from seatrial.campaign.config import Campaign
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import SIGNALS, signal_unit
from seatrial.estimation.output_error import correlation_name, initial_name, noise_name, output_error
from seatrial.estimation.posterior import Parameter, Posterior
from seatrial.estimation.priors import Normal
from seatrial.selection.structures import Structure
from seatrial.vehicles.model import VehicleModel


def random_key(campaign: Campaign, purpose: str) -> jax.Array:
    """Random key of one piece of work, from the campaign's seed and the work's name."""
    return jax.random.fold_in(jax.random.key(campaign.source.campaign.seed), zlib.crc32(purpose.encode()))


def build_posterior(campaign: Campaign, structure: Structure, records: Sequence[Record]) -> Posterior:
    """Joint posterior of a structure's coefficients and nuisances given several trials.

    Raises:
        InputError: a channel a record lacks, or a record whose first samples leave the initial state unknown.
    """
    model = campaign.model(structure)
    settings = campaign.source.estimation
    starts = [initial_state(campaign, model, record) for record in records]
    estimated = settings.initial == "estimated"
    parameters = [
        Parameter(term.text, model.unit_of(term), term.label, campaign.prior(term.text, model.unit_of(term)))
        for term in model.coefficients
    ]
    if campaign.has_delay:
        parameters.append(Parameter("delay", "s", r"t_{\mathrm{delay}}", campaign.prior("delay", "s")))
    for channel in campaign.channels:
        parameters.append(
            Parameter(
                noise_name(channel),
                signal_unit(channel),
                rf"\sigma_{{{_channel_label(channel)}}}",
                campaign.noise_prior(channel),
            )
        )
        if settings.residuals == "coloured":
            name = correlation_name(channel)
            parameters.append(Parameter(name, "s", rf"\tau_{{{_channel_label(channel)}}}", campaign.prior(name, "s")))
    if estimated:
        for record, start in zip(records, starts, strict=True):
            parameters += [
                Parameter(
                    initial_name(state, record.label),
                    signal_unit(state),
                    rf"{state}_0[{record.label}]",
                    Normal(value, 5.0 * campaign.noise(state) if state in campaign.channels else 1.0),
                )
                for state, value in zip(model.states, start, strict=True)
            ]
    _check_enough(campaign, records, len(parameters))
    likelihood, data = output_error(
        model,
        records,
        campaign.channels,
        starts,
        colour=settings.residuals,
        delay=campaign.has_delay,
        free_initial=estimated,
    )
    return Posterior(tuple(parameters), likelihood, data)


def _check_enough(campaign: Campaign, records: Sequence[Record], unknowns: int) -> None:
    count = sum(int(np.isfinite(record.channel(channel)).sum()) for record in records for channel in campaign.channels)
    if count < 2 * unknowns:
        raise InputError(
            "records " + ", ".join(f'"{record.label}"' for record in records),
            found=f"{count} measurements for {unknowns} unknowns",
            expected=f"at least {2 * unknowns} measurements",
            remedy="check the unit of the time column, or give a longer record",
        )


def initial_state(campaign: Campaign, model: VehicleModel, record: Record) -> tuple[float, ...]:
    """Initial state of a trial: trim, or the first measurement.

    Raises:
        InputError: a state that is not measured and has no trim value.
    """
    values = []
    for state in model.states:
        if campaign.source.estimation.initial == "trim":
            values.append(campaign.hull.trim[state])
            continue
        column = record.channel(state)
        finite = np.flatnonzero(np.isfinite(column))
        if finite.size == 0:
            raise InputError(
                f'record "{record.label}", channel "{state}"',
                found="no finite value",
                expected="a first measurement",
                remedy='set estimation.initial = "trim", or map the channel',
            )
        values.append(float(column[finite[0]]))
    return tuple(values)


def _channel_label(channel: str) -> str:
    return SIGNALS[channel].label if channel in SIGNALS else rf"\dot{{{channel.removesuffix('dot')}}}"
