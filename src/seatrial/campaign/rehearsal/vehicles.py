"""Vehicles drawn from a campaign's priors, the records of trials they run, and the posterior of all of a vehicle's records.

Every vehicle starts each trial at trim. Its sensors have the noise that `[sensors]` states; all else that is unknown is drawn from
the priors, what is each trial's own anew for each. The noise of a vehicle's k-th trial is the same whatever is run as that trial.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.true_vehicle import at_first_command
from seatrial.campaign.inference.posterior import build_posterior, posterior_of_one
from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.posterior.output_error import initial_name
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.replicate import replicate
from seatrial.estimation.posterior.simulated_record import simulate_trial
from seatrial.estimation.simulation.sensor_errors import noise_name
from seatrial.estimation.simulation.trial_data import FOREVER

MAX_PRIOR_DRAWS = 200  # Draws from the prior until one is a vehicle that does not run away
RUNAWAY_SPEED = 20.0  # Speed from which a vehicle has run away, m/s
MIN_POSTERIOR_TRIALS = 4  # Trials in the smallest posterior that is compiled
TRIAL_LABEL = "1"  # Label of a trial that is simulated on its own


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


def draw_vehicle(campaign: Campaign, plan: TrialPlan, trying: Float[np.ndarray, "D n c"], key: jax.Array) -> Vehicle:
    """Draw from the priors of the full structure until a vehicle stays below 20 m/s in every trial that there is.

    Among the trials are the extremes of all commands, each held throughout. Where du/dt rises with the control, the speed in any trial lies
    between those: what a strategy chooses to run does not decide which vehicles count.

    Args:
        campaign: configuration.
        plan: of its trials.
        trying: every command of the trials that a vehicle has to bear, SI.
        key: random key of the vehicle.

    Raises:
        NumericalError: nearly all draws run away.
    """
    draw_key, trial_key = jax.random.split(key)
    posterior = _posterior_of_one(campaign, _columns(campaign, trying[0]))
    drawn = np.asarray(posterior.constrain(posterior.sample_prior(draw_key, MAX_PRIOR_DRAWS)))
    columns = dict(zip(posterior.names, drawn.T, strict=True))
    coefficients = np.stack([columns[name] for name in plan.names], -1)
    bears = (i for i, values in enumerate(coefficients) if in_blocks(partial(_stays, plan, values), trying)[0].all())
    if (first := next(bears, None)) is None:
        raise NumericalError(
            f"each of {MAX_PRIOR_DRAWS} vehicles drawn from the prior diverges under a control of the designs: narrow the priors; "
            "`seatrial prior` shows the cause"
        )
    values = {name: float(column[first]) for name, column in columns.items() if not _is_own(name)}
    values |= {noise_name(channel): campaign.noise[channel] for channel in campaign.channels}
    return Vehicle(values, trial_key, first)


def run_trial(campaign: Campaign, vehicle: Vehicle, number: int, control: Float[np.ndarray, "n c"]) -> Record:
    """Record of a vehicle's trial of this number, from 1, through the autopilot where there is one.

    Raises:
        NumericalError: the vehicle runs away.
    """
    own_key, noise_key = jax.random.split(jax.random.fold_in(vehicle.key, number))
    commands, trim = _columns(campaign, control), _trim(campaign)
    posterior = _posterior_of_one(campaign, commands)
    drawn = np.asarray(posterior.constrain(posterior.sample_prior(own_key, 1)))[0]
    own = {name: float(value) for name, value in zip(posterior.names, drawn, strict=True) if _is_own(name)}
    starts = {initial_name(state, TRIAL_LABEL): trim[i] for i, state in enumerate(campaign.model(campaign.full).states)}
    own |= {name: value for name, value in starts.items() if name in own}
    run = _run_through_autopilot if campaign.autopilot.loops else _run_directly
    columns = run(campaign, posterior, vehicle.values | own, commands, noise_key)
    present = campaign.measured_mask(campaign.family.time()) > 0
    measured = np.stack([columns[name] for name in campaign.channels], -1)
    if not (np.isfinite(measured) == present).all():
        raise NumericalError(f"a vehicle drawn from the prior diverges in its trial {number}: narrow the priors")
    provenance = Provenance("rehearsed", "", {"trial": number})
    return make_record(campaign.family.time(), columns, _channels(campaign.channels, columns), provenance, str(number))


def _run_directly(
    campaign: Campaign,
    posterior: Posterior,
    values: Mapping[str, float],
    commands: Mapping[str, np.ndarray],
    key: jax.Array,
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return controls and measurements of a trial that acts on the controls, by the likelihood's own simulation."""
    data = posterior.data._replace(initial=np.asarray(_trim(campaign), float)[None])
    shown = replicate(posterior.likelihood, values, data, key).channels
    size = campaign.family.time().size
    measured = [
        np.where(np.asarray(one.present)[0, :size] > 0, np.asarray(one.measured)[0, :size], np.nan) for one in shown
    ]
    return {**commands, **dict(zip(campaign.channels, measured, strict=True))}


def _run_through_autopilot(
    campaign: Campaign,
    posterior: Posterior,
    values: Mapping[str, float],
    commands: Mapping[str, np.ndarray],
    key: jax.Array,
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return controls, set-points and measurements of a trial that runs through the autopilot."""
    simulator = posterior.likelihood.output.simulator
    here = {name.removesuffix(f"[{TRIAL_LABEL}]"): value for name, value in values.items()}
    time = campaign.family.time()
    try:
        return simulate_trial(
            simulator,
            here,
            time,
            commands,
            at_first_command(simulator.model, _trim(campaign).tolist(), commands),
            campaign.measured_mask(time) > 0,
            tuple(jax.random.split(key, len(campaign.channels))),
            campaign.pilot(simulator.model.controls),
        )
    except NumericalError as cause:
        raise NumericalError(
            "a vehicle drawn from the prior diverges under the autopilot: narrow the priors"
        ) from cause


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
    size = min(most, max(MIN_POSTERIOR_TRIALS, 1 << (n - 1).bit_length()))
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


def _posterior_of_one(campaign: Campaign, commands: Mapping[str, np.ndarray]) -> Posterior:
    """Posterior of one trial whose sensors show zero."""
    time = campaign.family.time()
    nothing = np.where(campaign.measured_mask(time) > 0, 0.0, np.nan)
    columns = {**commands, **dict(zip(campaign.channels, nothing.T, strict=True))}
    blank = Record(
        time,
        np.column_stack([columns[name] for name in commands]),
        nothing,
        _channels(campaign.channels, columns),
        Provenance("rehearsed", ""),
        TRIAL_LABEL,
    )
    return posterior_of_one(campaign, campaign.full, blank)


def _columns(campaign: Campaign, control: Float[np.ndarray, "n c"]) -> dict[str, Float[np.ndarray, " n"]]:
    """Return every command of a trial by its name."""
    names = [name for name, _ in campaign.control_trim(campaign.model(campaign.full))]
    return dict(zip(names, control.T, strict=True))


@program
def _stays(plan: TrialPlan, values: Array, controls: Array) -> tuple[Array]:
    """Return whether a vehicle stays below `RUNAWAY_SPEED` in each trial."""
    fast = [i for i, name in enumerate(plan.model.states) if name in ("u", "v", "w")]

    def one(control: Array) -> Array:
        motion = plan.motion(values, control)
        return jnp.isfinite(motion).all() & (jnp.abs(motion[:, jnp.array(fast, int)]) < RUNAWAY_SPEED).all()

    return (jax.vmap(one)(controls),)


def _channels(channels: tuple[str, ...], names: Collection[str]) -> tuple[Channel, ...]:
    return tuple(Channel(name, signal_unit(name), "measurement" if name in channels else "control") for name in names)


def _trim(campaign: Campaign) -> Float[np.ndarray, " n_states"]:
    return np.array(campaign.state_trim(campaign.model(campaign.full)))


def _is_own(name: str) -> bool:
    """Whether a parameter belongs to one trial."""
    return name.endswith(f"[{TRIAL_LABEL}]")
