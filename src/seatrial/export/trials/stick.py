"""Which stick stands for a control, and which way it is moved for a positive one: that in which the vehicle's own equations go.

    x ahead   y to starboard   z up, nose up   r to starboard      of MANUAL_CONTROL, as ArduSub reads it (joystick.cpp)

A positive rudder turns one vehicle to port and another to starboard, so the sign is that of a difference of accelerations: between the
largest and the smallest value of the trial, neutral included, at trim.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.campaign.problem import random_key
from seatrial.campaign.starts import level_start
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import SIGNALS
from seatrial.export.from_campaign import stored_estimate
from seatrial.vehicles.model import VehicleModel

SPEED = 1.5
"""Speed ahead, m/s, at which fins are judged where the vehicle has no trim speed."""
_DRAWS = 400
_STICKS = {
    "n": ("x", "u", 1),
    "tau_X": ("x", "u", 1),
    "tau_Y": ("y", "v", 1),
    "tau_Z": ("z", "w", -1),
    "tau_N": ("r", "r", 1),
    "delta_r": ("r", "r", 1),
    "delta_s": ("z", "q", 1),
}
"""Stick of a control, the velocity that it stands for, and the sign of that velocity on a positive stick."""


class Stick(NamedTuple):
    """Axis of MANUAL_CONTROL, and 1 or -1: its sign for a positive control."""

    axis: str
    sign: int


def campaign_stick(campaign: Campaign, control: str, value: Float[np.ndarray, " n"]) -> Stick:
    """Return the stick of a campaign's control: by its prior, or by its estimate where the prior allows both ways.

    Raises:
        InputError: no stick stands for the control, it does not move the vehicle as the stick would, or either way is possible.
    """
    _, rate, _ = _row(control)
    model, key = campaign.model(campaign.full), random_key(campaign, "stick")
    drawn = {
        term.text: np.asarray(campaign.prior(term.text, model.unit_of(term)).draw(key, (_DRAWS,)), float)
        for term in model.coefficients
    }
    known = {"u": SPEED, **campaign.hull.trim}
    try:
        return stick_of(model, drawn, control, value, known)
    except EitherWayError:
        estimate = _estimate(campaign, control, rate)
    model = campaign.model(estimate.structure)
    names = tuple(term.text for term in model.coefficients)
    draws = dict(zip(names, estimate.draws(names).T, strict=True))
    try:
        return stick_of(model, draws, control, value, known)
    except EitherWayError as cause:
        raise _undecided(campaign, control, rate, "its estimate") from cause


def stick_of(
    model: VehicleModel,
    params: Mapping[str, Any],
    control: str,
    value: Float[np.ndarray, " n"],
    known: Mapping[str, float],
) -> Stick:
    """Return the stick of a control of a vehicle; `params` may be arrays of draws, which then must all agree.

    Args:
        model: the vehicle.
        params: value of each free coefficient, SI.
        control: its name.
        value: values of the trial, SI.
        known: trim of states and of the other controls, SI; 0 for the rest.

    Raises:
        InputError: no stick stands for the control, or it does not move the vehicle as the stick would.
        EitherWayError: draws of both signs.
    """
    axis, rate, sign = _row(control)
    if rate not in model.states:
        raise _unfit(
            control,
            f"a vehicle of the states {', '.join(model.states)}",
            f"one that moves in {rate}, for which stick {axis} stands",
        )
    high, low = (
        _acceleration(model, params, {**known, control: end}, rate)
        for end in (max(0.0, float(value.max())), min(0.0, float(value.min())))
    )
    change = np.atleast_1d(np.asarray(high - low, float))
    if not (change != 0).any():
        raise _unfit(control, f"no effect on {rate} at trim", "a control that moves the vehicle as its stick would")
    ways = set(np.sign(change[change != 0]))
    if len(ways) > 1:
        raise EitherWayError
    return Stick(axis, round(sign * ways.pop()))


class EitherWayError(Exception):
    """Draws of the coefficients differ in the way that a control moves the vehicle."""


def _row(control: str) -> tuple[str, str, int]:
    if control not in _STICKS:
        what = SIGNALS[control].meaning if control in SIGNALS else "one thruster of several"
        raise _unfit(
            control,
            f"{control}, {what}",
            "a control of a whole motion, for which a stick stands: " + ", ".join(_STICKS),
        )
    return _STICKS[control]


def _acceleration(model: VehicleModel, params: Mapping[str, Any], known: Mapping[str, float], rate: str) -> Any:
    state, control = level_start(model, known), tuple(known.get(name, 0.0) for name in model.controls)
    return model.derivative(params, state, control)[model.states.index(rate)]


def _estimate(campaign: Campaign, control: str, rate: str) -> Any:
    try:
        return stored_estimate(campaign)
    except InputError as cause:
        raise _undecided(campaign, control, rate, "its prior") from cause


def _undecided(campaign: Campaign, control: str, rate: str, by: str) -> InputError:
    terms = [
        term.text
        for term in campaign.model(campaign.full).coefficients
        if control in CoefficientName.parse(term.text).signals
    ]
    return InputError(
        f"{campaign.path}, trial of {control} as a MAVLink script",
        found=f"a positive {control} that may turn {rate} either way, by {by} of {', '.join(terms)}",
        expected="a vehicle of which it is known which way a positive control moves it",
        remedy="bound the prior to one sign, run the campaign, or export with --to csv",
    )


def _unfit(control: str, found: str, expected: str) -> InputError:
    return InputError(
        f"trial of {control} as a MAVLink script",
        found=found,
        expected=expected,
        remedy="export it with --to csv, json, ros2 or mcap, and let your own driver apply it",
    )
