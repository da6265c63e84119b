"""What is true of a simulated vehicle: `[truth]` holds a value of each coefficient, and what sensors and actuators add to it.

What is simulated is what is fitted: beside coefficients stand the names of an estimate (`bias_u`, `lag_u`, `delay`, `current`, `sigma_u`,
`tau_u`, `dof_u`, `share_u`, `process_u`), `net_weight`, `dead_f`, `gain_f_3` and other unknowns of the vehicle that have a prior, and
`lag_n`, the lag of an actuator, instead of what `[vehicle.actuators]` states.
"""

from collections.abc import Mapping

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import CampaignVehicle, WholeVehicle
from seatrial.core.coefficients import is_coefficient
from seatrial.core.errors import InputError, nearest, not_among
from seatrial.core.signals import ACTUAL
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.mounts import mount_names
from seatrial.estimation.simulation.sensor_errors import (
    bias_name,
    drift_name,
    drift_time_name,
    lag_name,
    noise_kinds,
    noise_name,
)
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.model import VehicleModel


def true_coefficients(campaign: Campaign, model: VehicleModel) -> dict[str, float]:
    """Return the true coefficients of a simulated campaign, SI: as named, else as published of a whole vehicle, else 0."""
    published, truth = _published(campaign.vehicle), campaign.truth
    return {term.text: truth.get(term.text, published.get(term.text, 0.0)) for term in model.coefficients}


def check_truth(campaign: Campaign) -> None:
    """Check names of a simulated truth, that every term that is always in the model has a value, and that times and spreads are possible.

    Raises:
        InputError: the first name that is none, or value that is missing or cannot be.
    """
    truth, model = campaign.truth, campaign.model(campaign.full)
    noises = {name for channel in campaign.channels for name in (noise_name(channel), *noise_kinds(channel))}
    names = (
        {*campaign.units, CURRENT, DELAY, *map(lag_name, model.controls)}
        | {one.name for one in model.unknowns if not one.name.startswith(lag_name(""))}
        | {process_name(state) for state in model.states if not state.endswith(ACTUAL)}
        | noises
        | {name(channel) for channel in campaign.channels for name in (bias_name, lag_name)}
        | {name for mount in campaign.mounts.values() for name in mount_names(mount.name)}
    )
    for name in campaign.truth:
        if name not in names and is_coefficient(name):
            raise InputError(
                campaign.where(f"truth.{name}"),
                found=f"[truth] has {name}, and no structure has it",
                expected="true values only of terms of [structure]",
                remedy=f"remove {name} from [truth], or the rule that excludes it from every structure"
                if name in campaign.rules.never
                else f"remove {name} from [truth], or list it in [structure]; if it is misspelt, {nearest(name, names)}",
            )
        if name not in names:
            raise not_among(campaign.where(f"truth.{name}"), name, sorted(names))
    if not truth:
        return
    published = _published(campaign.vehicle)
    for term in campaign.rules.always:
        if term not in truth and term not in published:
            raise InputError(
                campaign.where("truth"),
                found=f"no {term}, which is in every structure",
                expected="a true value of every term of `always`; one of `optional` may be left out, and is then 0",
                remedy=f"add a value, SI; {term} = 0.0 means that the true vehicle has none",
            )
    for channel in campaign.channels:
        there = {kind: name for name, kind in noise_kinds(channel).items() if name in truth}
        if len(there) > 1:
            first, second, *_ = there.values()
            raise InputError(
                campaign.where(f"truth.{second}"),
                found=f"{first} as well",
                expected="noise of one kind: correlated, of heavy tails, drifting under white noise, or proportional to the signal",
                remedy="leave out one of the two",
            )
        both = (drift_name(channel), drift_time_name(channel))
        if len(set(both) & set(truth)) == 1:
            lone, other = both if both[0] in truth else both[::-1]
            raise InputError(
                campaign.where(f"truth.{lone}"),
                found=f"no {other}",
                expected=f"the size of the slow error, {both[0]}, and its correlation time, {both[1]}",
                remedy="add the other, or leave out both",
            )
    spreads = noises | {process_name(state) for state in model.states}
    lags = {lag_name(name) for name in (*model.controls, *campaign.channels)}
    unsigned = {one.name for one in model.unknowns if not one.signed}
    late = {lag_name(name) for name in model.controls if name + ACTUAL in model.states}
    for name, value in truth.items():
        if name in late and value == 0:
            raise InputError(
                campaign.where(f"truth.{name}"),
                found="0 s",
                expected="more than 0 s, because [vehicle.actuators] has a lag",
                remedy="leave it out for the lag stated there, or leave out both",
            )
        if (name in lags | unsigned | {DELAY} and value < 0) or (name in spreads and value <= 0):
            unit = " s" if name in lags | {DELAY} else ""
            raise InputError(
                campaign.where(f"truth.{name}"),
                found=f"{value:g}{unit}",
                expected="more than 0" if name in spreads else f"0{unit} or more",
                remedy="leave it out for none, or for the noise of [sensors]"
                if name in spreads
                else "give a lag above 0 s"
                if unit
                else "leave it out for the value of [vehicle]",
            )


def _published(vehicle: CampaignVehicle) -> Mapping[str, float]:
    """Published coefficients that are true where nothing else is said: those of a whole vehicle."""
    return vehicle.published if isinstance(vehicle, WholeVehicle) else {}
