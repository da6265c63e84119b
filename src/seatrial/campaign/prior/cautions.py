"""What to know about a campaign file before a trial: terms that may be one, limits out of reach, a start that the controls do not hold."""

from collections.abc import Mapping
from math import hypot, sqrt

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.campaign.design.problem import prior_draws
from seatrial.campaign.prior.predictive import steady_motion
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import plain, shown_unit
from seatrial.core.term_checks import terms_that_may_be_one
from seatrial.design.prior_belief import most_have
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.vehicles.hull import Hull

MAX_SPEED_SHARE = 0.2  # Share of a steady speed by which the start may lie beyond the 90 % range of the priors

# Radii of gyration of the smallest vehicle and of a ship of 400 m, m, and how many times as far as the farthest
# thruster one may be
GYRATION_RADII, TIMES_REACH = (0.02, 120.0), 10.0
FAR_TIMES = 1e4  # Times its trim from which a limit of a control is doubted


def file_cautions(campaign: Campaign) -> list[str]:
    """Return a sentence for each thing that is worth correcting in the file, though it can be used."""
    return [
        *vehicle_cautions(campaign),
        *terms_that_may_be_one(map(CoefficientName.parse, campaign.full.terms)),
        *_limits_out_of_reach(campaign.control_limits, campaign.trim),
        *_start_that_is_not_held(campaign),
    ]


def vehicle_cautions(campaign: Campaign) -> list[str]:
    """Report that the vehicle is still that of an example, or that its mass and a moment of inertia are not of one body."""
    cautions, vehicle = [campaign.example_vehicle] if campaign.example_vehicle else [], campaign.vehicle
    if isinstance(vehicle, WholeVehicle):
        reach = max((hypot(*one.place) for one in vehicle.body.thrusters), default=0.0)
        cautions += doubtful_radii(vehicle.hull, reach)
    return cautions


def doubtful_radii(hull: Hull, reach: float = 0.0) -> list[str]:
    """Return which radius of gyration, sqrt(I / m), no vehicle has; that of a rod is 0.29 times its length.

    Args:
        hull: of the vehicle.
        reach: distance of its most distant thruster from its origin, m; 0 if none is known.
    """
    if hull.mass is None:
        return []
    least, most = GYRATION_RADII[0], min(GYRATION_RADII[1], TIMES_REACH * reach or GYRATION_RADII[1])
    size = f", and the most distant thruster is {reach:.2g} m from the origin" if reach else ""
    radii = {
        f"{axis}{axis}": (one, sqrt(one / hull.mass)) for axis, one in zip("xyz", hull.inertia, strict=True) if one
    }
    return [
        f"a mass of {hull.mass:.4g} kg and I_{axes} = {inertia:.4g} kg m^2 make a radius of gyration of {radius:.3g} m{size}: "
        f"{least:g} m to {most:.3g} m is expected. Check the units of mass and inertia under [vehicle]"
        for axes, (inertia, radius) in radii.items()
        if not least <= radius <= most
    ]


def _limits_out_of_reach(control_limits: Mapping[str, Limits], trim: Mapping[str, float]) -> list[str]:
    """Return which limits of controls are so far from the trim, or from the other limit where the trim is 0, that they limit nothing."""
    cautions = []
    for name, limits in control_limits.items():
        at_trim, (factor, unit) = abs(trim.get(name, 0.0)), shown_unit(name)
        for key, bound, other in (("lower", limits.lower, limits.upper), ("upper", limits.upper, limits.lower)):
            usual, beside = (at_trim, "the trim") if at_trim else (abs(other or 0.0), "the other limit")
            if bound is not None and usual > 0 and abs(bound) > FAR_TIMES * usual:
                cautions.append(
                    f"the {key} limit of {name} is {bound * factor:.3g} {unit}, {plain(abs(bound) / usual)} times {beside}: it limits "
                    "nothing. Correct the number or its unit"
                )
    return cautions


def _start_that_is_not_held(campaign: Campaign) -> list[str]:
    """Say so where trials begin at a speed at which the controls at trim do not keep the vehicle, by 90 % of the priors."""
    model, known = campaign.model(campaign.full), campaign.trim
    if not {"u", *model.controls} <= {*known} or "u" not in model.states or campaign.autopilot.loops:
        return []
    draws = prior_draws(campaign, model)
    params = {term.text: draws[:, i] for i, term in enumerate(model.coefficients)}
    held = dict(zip(model.states, campaign.state_trim(model), strict=True))
    speed, _ = steady_motion(model, params, [known[name] for name in model.controls], known["u"], held)
    if not most_have(speed):
        return []
    low, middle, high = np.nanquantile(speed, (0.05, 0.5, 0.95))
    if low - MAX_SPEED_SHARE * abs(low) <= known["u"] <= high + MAX_SPEED_SHARE * abs(high):
        return []
    at = ", ".join(
        f"{name} = {known[name] * factor:.4g} {unit}"
        for name, (factor, unit) in ((name, shown_unit(name)) for name in model.controls)
    )
    return [
        f"a trial begins at {known['u']:.3g} m/s, but by 90 % of the prior {at} gives {low:.3g} to {high:.3g} m/s, so that the vehicle "
        f'leaves its trim. Correct u or the controls in vehicle.trim (they give u = "{middle:.2g} m/s"), or the priors'
    ]
