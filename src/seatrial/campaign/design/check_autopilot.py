"""Says before anything is designed whether the autopilot keeps every vehicle that is believed possible stable, and if not, what to do."""

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.evaluate import plan_of
from seatrial.core.errors import InputError
from seatrial.core.reporter import Reporter
from seatrial.core.signals import ACTUAL
from seatrial.design.loop_stability import GainChange, best_gain_change, loop_growth
from seatrial.manoeuvres.autopilot import GAINS
from seatrial.vehicles.model import VehicleModel

VEHICLES = 200  # Draws that are looked at
# Share of unstable vehicles from which the autopilot is at fault, and not what is believed of the vehicle
NEARLY_ALL = 0.9
# What moves, in words, by the state that takes the largest part
AXIS_WORDS = {
    **dict.fromkeys(("u", "x"), "surge (speed)"),
    **dict.fromkeys(("v", "r", "psi", "y"), "yaw (heading)"),
    **dict.fromkeys(("w", "z"), "heave (depth)"),
    **dict.fromkeys(("q", "theta"), "pitch"),
    **dict.fromkeys(("p", "phi"), "roll"),
}


def check_autopilot(
    campaign: Campaign, model: VehicleModel, draws: Float[np.ndarray, "S k"], reporter: Reporter
) -> None:
    """Check that the autopilot keeps vehicles stable with the probability with which limits are kept; tells it where some are not.

    Args:
        campaign: autopilot and probability.
        model: vehicle.
        draws: its coefficients as they are believed, SI.
        reporter: who is told.

    Raises:
        InputError: too many vehicles that are unstable under the autopilot.
    """
    if not campaign.autopilot.loops:
        return
    few, plan = draws[:VEHICLES], plan_of(campaign, model)
    trim = np.array([value for _, value in campaign.control_trim(model)])
    growth = loop_growth(plan, trim, few)
    lost = growth.unstable
    if not lost.any():
        return
    share, probability = float(lost.mean()), campaign.design.probability
    states, counts = np.unique(growth.state[lost], return_counts=True)
    state = model.states[int(states[counts.argmax()])]
    axis = AXIS_WORDS.get(state, f"the actuator {state.removesuffix(ACTUAL)}")
    doubling = float(np.log(2) / np.median(growth.rate[lost]))
    finding = f"{share:.0%} of the vehicles that the priors allow are unstable under the autopilot, most in {axis}" + (
        f": a small motion there doubles in {doubling:.2g} s" if doubling > 0 else ": they run away"
    )
    remedy = _advice(best_gain_change(plan, trim, few), share)
    if share > 1.0 - probability:
        raise InputError(
            campaign.where(f"autopilot.{campaign.autopilot.loops[0].holds}"),
            found=finding,
            expected=f"an autopilot that holds {probability:.0%} of them",
            remedy=remedy,
        )
    reporter.say(f"caution: {finding}; {remedy}")


def _advice(change: GainChange | None, share: float) -> str:
    """Return what to do where a share of the vehicles is unstable."""
    if change is None or change.unstable > NEARLY_ALL:
        helps = "no gain alone, turned round, halved or doubled, helps"
        if share > NEARLY_ALL:
            return (
                "the autopilot is unstable for the vehicle itself, whatever its priors: check the signs of its gains and of what it "
                f"drives, and tune it on calm water first; {helps}"
            )
        return f"{helps}: narrow the priors, or tune the autopilot on calm water first"
    verb = "turn the sign of" if change.factor < 0 else "halve" if change.factor < 1 else "double"
    gains = " and ".join(f"{gain} ({GAINS[gain]} gain)" for gain in change.gains)
    return f"{verb} {gains} of [autopilot.{change.holds}]: {change.unstable:.0%} remain unstable then"
