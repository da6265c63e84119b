"""Vehicles drawn from a campaign's priors, the records of trials they run, and the posterior of all of a vehicle's records.

Every vehicle starts each trial at trim. Its sensors have the noise that `[sensors]` states; all else that is unknown is drawn from
the priors, what is each trial's own anew for each. The noise of a vehicle's k-th trial is the same whatever is run as that trial.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.posterior import build_likelihood, build_parameters, build_posterior
from seatrial.campaign.prior.predictive import speeds
from seatrial.core.errors import NumericalError
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.estimation.output_error import initial_name
from seatrial.estimation.posterior import Posterior
from seatrial.estimation.replicate import replicate
from seatrial.estimation.sensor_errors import noise_name
from seatrial.estimation.trial_data import FOREVER

TRIES = 200
"""Draws from the prior until one is a vehicle that does not run away."""
FEWEST = 4
"""Trials in the smallest posterior that is compiled."""
LABEL = "1"
"""Label of a trial that is simulated on its own."""


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A vehicle that is to be identified.

    Attributes:
        values: parameters that all of its trials share, by name, SI.
        key: random key of its trials.
        refused: draws from the prior before it that ran away.
    """

    values: dict[str, float]
    key: jax.Array
    refused: int


def draw_vehicle(campaign: Campaign, extremes: Float[np.ndarray, "2 n"], key: jax.Array) -> Vehicle:
    """Draw from the priors of the full structure until a vehicle stays below 20 m/s under either extreme of the control.

    Where du/dt rises with the control, the speed in any trial lies between those with its extremes held throughout: a vehicle that
    passes runs away in no trial, so that what a strategy chooses to run does not decide which vehicles count.

    Args:
        campaign: configuration.
        extremes: least and largest control of any trial, held, SI.
        key: random key of the vehicle.

    Raises:
        NumericalError: nearly all draws run away.
    """
    draw_key, trial_key = jax.random.split(key)
    posterior = _posterior_of_one(campaign, extremes[0])
    drawn = np.asarray(posterior.constrain(posterior.sample_prior(draw_key, TRIES)))
    columns = dict(zip(posterior.names, drawn.T, strict=True))
    model = campaign.model(campaign.full)
    params = {term.text: columns[term.text] for term in model.coefficients}
    start = np.tile(_trim(campaign), (TRIES, 1))
    step = np.full(extremes.shape[1], campaign.family.sample_time)
    lost = [speeds(model, "u", params, None, start, control[:, None], step, [0])[1] for control in extremes]
    stays = np.flatnonzero(~np.any(lost, axis=0))
    if not stays.size:
        raise NumericalError(
            f"each of {TRIES} vehicles drawn from the prior runs away under a control that the designs use: narrow the priors; "
            "`seatrial prior` shows why"
        )
    first = int(stays[0])
    values = {name: float(column[first]) for name, column in columns.items() if not _is_own(name)}
    values |= {noise_name(channel): campaign.noise[channel] for channel in campaign.channels}
    return Vehicle(values, trial_key, first)


def run_trial(campaign: Campaign, vehicle: Vehicle, number: int, control: Float[np.ndarray, " n"]) -> Record:
    """Record of a vehicle's trial of this number, from 1.

    Raises:
        NumericalError: the vehicle runs away.
    """
    own_key, noise_key = jax.random.split(jax.random.fold_in(vehicle.key, number))
    posterior, trim = _posterior_of_one(campaign, control), _trim(campaign)
    drawn = np.asarray(posterior.constrain(posterior.sample_prior(own_key, 1)))[0]
    own = {name: float(value) for name, value in zip(posterior.names, drawn, strict=True) if _is_own(name)}
    starts = {initial_name(state, LABEL): trim[i] for i, state in enumerate(campaign.model(campaign.full).states)}
    own |= {name: value for name, value in starts.items() if name in own}
    data = posterior.data._replace(initial=np.asarray(trim, float)[None])
    shown = replicate(posterior.likelihood, vehicle.values | own, data, noise_key).channels
    present, measured = (
        np.stack([np.asarray(column)[0, : control.size] for column in columns], -1)
        for columns in zip(*((channel.present, channel.measured) for channel in shown), strict=True)
    )
    measured = np.where(present > 0, measured, np.nan)
    if not (np.isfinite(measured) == (present > 0)).all():
        raise NumericalError(f"a vehicle drawn from the prior runs away in its trial {number}: narrow the priors")
    columns = dict(zip((campaign.family.control, *campaign.channels), (control, *measured.T), strict=True))
    provenance = Provenance("rehearsed", "", {"trial": number})
    return make_record(
        campaign.family.time(), columns, _channels(campaign.family.control, campaign.channels), provenance, str(number)
    )


def joint_posterior(campaign: Campaign, records: Sequence[Record], most: int) -> Posterior:
    """Posterior of the full structure given all records, filled up with trials of which nothing was measured.

    What is compiled for the likelihood depends on the number of trials: filled up to the next power of two, or to the most there
    can be, a rehearsal needs few programs. A trial of which nothing was measured adds nothing.

    Args:
        campaign: configuration.
        records: trials of one vehicle.
        most: trials there can be.
    """
    n = len(records)
    size = min(most, max(FEWEST, 1 << (n - 1).bit_length()))
    unused = [replace(records[0], label=str(i + 1)) for i in range(n, size)]
    posterior = build_posterior(campaign, campaign.full, [*records, *unused])
    data = jax.device_get(posterior.data)
    used = np.asarray(np.arange(size) < n, float)[:, None]
    channels = tuple(
        channel._replace(
            measured=used * channel.measured,
            present=used * channel.present,
            counts=used * channel.counts,
            gaps=np.where(used > 0, channel.gaps, FOREVER),
        )
        for channel in data.channels
    )
    return replace(posterior, data=jax.device_put(data._replace(channels=channels)))


def _posterior_of_one(campaign: Campaign, control: np.ndarray) -> Posterior:
    """Posterior of one trial whose sensors show zero: what of it is used are parameters, priors and the simulation.

    Not by `build_posterior`, which asks for two trials where coefficients vary between them.
    """
    mask = campaign.measured_mask(campaign.family.time())
    nothing = np.where(mask > 0, 0.0, np.nan)
    blank = Record(
        campaign.family.time(),
        control[:, None],
        nothing,
        _channels(campaign.family.control, campaign.channels),
        Provenance("rehearsed", ""),
        LABEL,
    )
    model = campaign.model(campaign.full)
    return Posterior(build_parameters(campaign, model, [blank]), *build_likelihood(campaign, model, [blank]))


def _channels(control: str, channels: Sequence[str]) -> tuple[Channel, ...]:
    measured = (Channel(name, signal_unit(name), "measurement") for name in channels)
    return (Channel(control, signal_unit(control), "control"), *measured)


def _trim(campaign: Campaign) -> Float[np.ndarray, " n_states"]:
    return np.array(campaign.state_trim(campaign.model(campaign.full)))


def _is_own(name: str) -> bool:
    """Whether a parameter belongs to one trial."""
    return name.endswith(f"[{LABEL}]")
