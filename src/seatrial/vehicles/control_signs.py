"""Which way a vehicle goes when a control is pushed: a positive rudder turns one published vehicle to port and another to starboard.

Found by simulation: two runs from straight ahead, with the control pushed a little either way, and the difference of their velocities
after half a second. A propeller is pushed from the speed that holds the vehicle's, since one that is towed brakes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from seatrial.core.signals import RATES
from seatrial.numerics.integrate import rk4_unrolled
from seatrial.vehicles.model import Params, VehicleModel

Sense = Mapping[str, int]  # Sign of each velocity that answers to a positive push of a control
DEFAULT_SPEED = 1.5  # Speed ahead, m/s, at which controls are pushed where a vehicle has no trim speed
DURATION, STEP = 0.5, 0.05  # Of a push, s
_ANGLE, _TURNS, _FORCE = 0.02, 10.0, 1.0  # Size of a push, rad, rad/s, and N or N m
_PROPELLER = np.linspace(0.0, 400.0, 401)  # Speeds, rad/s, among which the one is sought that holds the vehicle's
# The velocity that a control is for; a thruster of an open frame is for all that it moves.
_OWN = {
    "n": "u", "delta_r": "r", "delta_s": "q",
    "tau_X": "u", "tau_Y": "v", "tau_Z": "w", "tau_K": "p", "tau_M": "q", "tau_N": "r",
}  # fmt: skip
# Share of the largest answer, of the translations or of the rotations, below which a thruster's is not told.
_SHARE = 0.2
_WORDS = {
    "u": ("pushes ahead", "pushes astern"),
    "v": ("pushes to starboard", "pushes to port"),
    "w": ("pushes down", "pushes up"),
    "p": ("rolls to starboard", "rolls to port"),
    "q": ("nose up", "nose down"),
    "r": ("turns to starboard", "turns to port"),
}


def control_senses(model: VehicleModel, params: Params, speed: float = DEFAULT_SPEED) -> dict[str, Sense]:
    """Return the sense of every control of a vehicle; empty if a push moves nothing that the control is for.

    Args:
        model: vehicle.
        params: value of each free coefficient, SI.
        speed: ahead, from which it is pushed, m/s; 0 for an open frame.
    """
    start = {"u": speed, "q_w": 1.0}
    steady = {name: _steady(model, params, start) if name == "n" else 0.0 for name in model.controls}
    pushes = [(name, sign * push_of(name)) for name in model.controls for sign in (1, -1)]
    state = tuple(np.full(len(pushes), start.get(name, 0.0)) for name in model.states)
    held = tuple(
        np.array([steady[name] + (push if name == control else 0.0) for control, push in pushes])
        for name in model.controls
    )

    def rate(at: tuple[Any, ...]) -> tuple[Any, ...]:
        return model.derivative(params, at, held)

    for _ in range(round(DURATION / STEP)):
        state = rk4_unrolled(rate, state, STEP)
    ends = {name: np.asarray(state[model.states.index(name)]) for name in RATES if name in model.states}
    return {
        control: sense_of(control, {name: float(end[2 * i] - end[2 * i + 1]) for name, end in ends.items()})
        for i, control in enumerate(model.controls)
    }


def push_of(control: str) -> float:
    """Return the size of a push, SI."""
    return _ANGLE if control.startswith("delta") else _TURNS if control.split("_")[0] == "n" else _FORCE


def sense_of(control: str, answer: Mapping[str, float]) -> Sense:
    """Return the sense of a control from the change of each velocity that a positive push makes, SI; empty if the vehicle ran away."""
    own = _OWN.get(control)
    if not np.isfinite(list(answer.values())).all():
        return {}
    if own is not None:
        return {own: int(np.sign(answer[own]))} if answer.get(own) else {}
    results = {}
    for group in (RATES[:3], RATES[3:]):
        largest = max((abs(answer.get(name, 0.0)) for name in group), default=0.0)
        results |= {
            name: int(np.sign(answer[name]))
            for name in group
            if largest > 0 and abs(answer.get(name, 0.0)) >= _SHARE * largest
        }
    return results


def sense_words(sense: Sense) -> str:
    """Return a sense in words, such as `turns to port`; `does nothing` where it is empty."""
    return ", ".join(_WORDS[name][0 if sign > 0 else 1] for name, sign in sense.items()) or "does nothing"


def _steady(model: VehicleModel, params: Params, start: Mapping[str, float]) -> float:
    """Return the propeller speed that holds the speed ahead best, rad/s."""
    if "u" not in model.states:
        return 0.0
    state = tuple(np.full(_PROPELLER.size, start.get(name, 0.0)) for name in model.states)
    held = tuple(_PROPELLER if name == "n" else np.zeros(_PROPELLER.size) for name in model.controls)
    rate = np.asarray(model.derivative(params, state, held)[model.states.index("u")])
    return float(_PROPELLER[np.abs(rate).argmin()])
