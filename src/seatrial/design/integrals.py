"""Integrals that travel with a vehicle's state through a trial: way, heading, track in the horizontal plane, energy.

    d/dt (x, i) = (f(x, control), g(x, i, control)),  both in one Runge-Kutta step

The track is that of a level vehicle in still water, from the place and heading of the first sample:
dx/dt = u cos(psi) - v sin(psi), dy/dt = u sin(psi) + v cos(psi), dpsi/dt = r (Fossen, 2021, with phi = theta = 0).
"""

from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from seatrial.core.errors import InputError, nearest
from seatrial.design.trial_plan import TrialPlan
from seatrial.numerics.integrate import Move
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import move_by

Rate = Callable[[Mapping[str, Any]], Any]
"""Rate of an integral from the signals of `signals_at`."""
# Signals that a vehicle without such a state may still follow: what each is integrated from, and its rate; m or rad
KNOWN: dict[str, tuple[tuple[str, ...], Rate]] = {
    "distance": (("u",), lambda now: jnp.abs(now["u"])),
    "advance": (("u",), lambda now: now["u"]),
    "psi": (("r",), lambda now: now["r"]),
    "x": (("u", "v", "psi"), lambda now: now["u"] * jnp.cos(now["psi"]) - now["v"] * jnp.sin(now["psi"])),
    "y": (("u", "v", "psi"), lambda now: now["u"] * jnp.sin(now["psi"]) + now["v"] * jnp.cos(now["psi"])),
}


def motion_signals(model: VehicleModel) -> tuple[str, ...]:
    """Return what can be told of a vehicle's motion: its states, and the integrals of `KNOWN` that its states give."""
    signals = list(model.states)
    for name, (needs, _) in KNOWN.items():
        if name not in signals and set(needs) <= set(signals):
            signals.append(name)
    return tuple(signals)


def integrals_for(model: VehicleModel, names: tuple[str, ...], where: str) -> dict[str, Rate]:
    """Integrals of `KNOWN` that must travel with the state so that all names can be read; none for names that are states.

    Raises:
        InputError: a name that is neither a state nor can be integrated from the states and controls.
    """
    integrals: dict[str, Rate] = {}
    for name in names:
        if name in model.states:
            continue
        if name not in KNOWN:
            raise InputError(
                where,
                found=f'"{name}", which is no state of the vehicle "{model.name}"',
                expected="one of its states: " + ", ".join(model.states),
                remedy=nearest(name, model.states),
            )
        needs, rate = KNOWN[name]
        missing = [need for need in needs if need not in (*model.states, *model.controls, *KNOWN)]
        if missing:
            raise InputError(
                where,
                found=f'"{name}", and the vehicle "{model.name}" has no {" and no ".join(missing)} to integrate it from',
                expected=f"a state {name}, or {', '.join(needs)}; its states: " + ", ".join(model.states),
                remedy="leave this limit out, or plan with a vehicle that moves along these axes",
            )
        integrals |= integrals_for(model, tuple(need for need in needs if need not in model.controls), where)
        integrals[name] = rate
    return integrals


def signals_at(plan: TrialPlan, integrals: Mapping[str, Rate], joint: tuple, held: tuple) -> dict[str, Any]:
    """Controls, states and integrals by name at one sample."""
    names = (*plan.model.states, *integrals)
    return {**dict(zip(plan.model.controls, held, strict=True)), **dict(zip(names, joint, strict=True))}


def joint_start(plan: TrialPlan, integrals: Mapping[str, Rate]) -> tuple:
    """State at the first sample and integrals, 0 there."""
    return (*(plan.start[i] for i in range(plan.start.shape[0])), *(jnp.zeros(()) for _ in integrals))


def joint_move(plan: TrialPlan, integrals: Mapping[str, Rate], values: Float[Array, " k"]) -> Move:
    """Return what moves state and integrals to the next sample."""

    def rates(joint: tuple, held: tuple) -> tuple:
        now = signals_at(plan, integrals, joint, held)
        return tuple(of(now) for of in integrals.values())

    return move_by(plan.model, plan.named(values), others=rates)


def follow_joint(
    plan: TrialPlan,
    integrals: Mapping[str, Rate],
    values: Float[Array, " k"],
    control: Float[Array, "n c"],
    look: Callable[[Any, Mapping[str, Any]], tuple[Any, Any]],
    memory: Any = (),
    noise: Float[Array, "n m"] | None = None,
) -> tuple[dict[str, Any], Any, Any]:
    """Follow state and integrals through a trial; traced, may be batched and differentiated.

    Args:
        plan: vehicle and start.
        integrals: what travels with the state.
        values: coefficients, SI.
        control: every command, held from each sample to the next, SI.
        look: `(memory, signals) ->` the memory and what is kept of each sample.
        memory: before the first sample.
        noise: of each channel over its standard deviation, as an autopilot sees it; None for perfect sensors.

    Returns:
        Signals at the end of the last step, the memory, and what was kept.
    """

    def seen(joint: tuple, memory: Any, held: tuple, _: None) -> tuple:
        return look(memory, signals_at(plan, integrals, joint, held))

    move, start = joint_move(plan, integrals, values), joint_start(plan, integrals)
    end, held, memory, kept = plan.follow(plan.named(values), move, start, control, seen, memory, noise=noise)
    return signals_at(plan, integrals, end, held), memory, kept
