"""What a positive command means in a target, found by pushing it: a target's convention for fins need not be the vehicle's."""

from collections.abc import Iterable, Mapping

import numpy as np

from seatrial.core.signals import RATES
from seatrial.export.manoeuvre import Plan, plan_for, simulate
from seatrial.export.motion import Motion, motion_of
from seatrial.export.target import Carried
from seatrial.export.vehicle import ExportedVehicle
from seatrial.vehicles.control_signs import DURATION, STEP, Sense, push_of, sense_of, sense_words


def motion_senses(
    vehicle: ExportedVehicle, motion: Motion, plan: Plan, controls: Iterable[str] | None = None
) -> dict[str, Sense]:
    """Return the sense of each control in a motion, from the start of a plan; empty where it moves nothing.

    Args:
        vehicle: whose controls they are.
        motion: its own, or a target's.
        plan: manoeuvre, whose start is taken.
        controls: those that are asked for; all where None.
    """
    held = plan.controls(0.0)
    start = np.zeros(8)
    start[0] = plan.speed

    def end(control: str, push: float) -> np.ndarray:
        pushed = {**held, control: held[control] + push}
        return simulate(motion, {}, lambda t: pushed, start, DURATION, STEP)[-1]

    found = {}
    for control in vehicle.controls if controls is None else controls:
        push = push_of(control)
        answer = end(control, push) - end(control, -push)
        found[control] = sense_of(control, dict(zip(RATES, answer.tolist(), strict=False)))
    return found


def contrary_to(vehicle: ExportedVehicle, convention: Mapping[str, Sense]) -> tuple[str, ...]:
    """Return the controls whose positive values do the contrary of what a target's convention has them do."""
    asked = [control for control in convention if control in vehicle.controls]
    if not asked:
        return ()
    own = motion_of(vehicle)
    senses = motion_senses(vehicle, own, plan_for(vehicle, own), asked)
    return tuple(
        control
        for control, sense in senses.items()
        if any(sense.get(rate) == -sign for rate, sign in convention[control].items())
    )


def command_line(vehicle: ExportedVehicle, carried: Carried, plan: Plan) -> str:
    """Return what positive commands do in the target, in words; nothing for a vehicle without controls."""
    parts = []
    for control, sense in motion_senses(vehicle, carried.motion, plan).items():
        turned = control in carried.reversed
        words = sense_words({rate: -sign if turned else sign for rate, sign in sense.items()})
        parts.append(f"{control} {words}" + (f" (minus seatrial's {control})" if turned else ""))
    return "; ".join(parts)
