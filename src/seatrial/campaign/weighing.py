"""Weighs the designs of a sweep: which keep the vehicle inside its limits, what each is worth, and what it costs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.design.conflicts import check_some_allowed
from seatrial.design.cost import PropellerPower, expected_cost, gain_per_cost, in_joules
from seatrial.design.criteria import find_criterion
from seatrial.design.plan import TrialPlan, plan_trial
from seatrial.design.robust import local_utility, utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import Sweep
from seatrial.vehicles.model import VehicleModel

SAFETY_DRAWS = 400
"""Draws of what is believed behind each probability of staying inside the limits, where a posterior has twice as many."""
UTILITY_DRAWS = 32
"""Draws over which a utility is averaged, the same for all designs."""


def plan_of(campaign: Campaign, model: VehicleModel) -> TrialPlan:
    """Plan of the campaign's trials: from trim, with its sensors."""
    time = campaign.family.time()
    start = [campaign.hull.trim.get(state, 0.0) for state in model.states]
    noise = {channel: campaign.noise(channel) for channel in campaign.channels}
    return plan_trial(model, start, noise, time.size, campaign.family.sample_time, campaign.measured_mask(time))


def weigh(campaign: Campaign, plan: TrialPlan, sweep: Sweep, draws: Float[np.ndarray, "S k"]) -> Sweep:
    """The sweep without the designs that may leave the limits of the motion, and with what each of the others is worth.

    Args:
        campaign: limits, utility and power.
        plan: of its trials.
        sweep: entropy reduction of each design.
        draws: coefficients drawn from what is believed, SI; half of them choose.

    Raises:
        InputError: no design keeps the limits of the motion with the probability asked for, or limits the vehicle cannot have.
        NumericalError: the motion diverges at a draw that a utility is averaged over.
    """
    limits, table = campaign.motion_limits, campaign.source.design
    if not limits and table.utility == "entropy" and table.per == "trial":
        return sweep
    rows, columns, control = sweep.inside()
    if limits:
        safety = judge_safety(plan, control[..., None], _for_choice(draws), limits, table.probability)
        check_some_allowed(safety)
        sweep = _only(sweep, rows, columns, safety.allowed)
        rows, columns, control = sweep.inside()
    controls, utility = control[..., None], sweep.gain[rows, columns]
    if table.utility != "entropy":
        utility = _utility(campaign, plan, controls, draws)
    if table.per == "joule":
        power, at, hotel = campaign.power()
        cost = in_joules(hotel, PropellerPower(power, at, sweep.family.control))
        utility = gain_per_cost(
            utility - _of_no_trial(campaign, draws), expected_cost(plan, cost, controls, draws[:UTILITY_DRAWS]).mean
        )
    found = np.full(sweep.gain.shape, np.nan)
    found[rows, columns] = utility
    return replace(sweep, utility=found)


def safety_lines(campaign: Campaign, plan: TrialPlan, sweep: Sweep, draws: Float[np.ndarray, "S k"]) -> Sequence[str]:
    """How surely the best design keeps each limit of the motion, on draws that had no part in choosing it."""
    if not campaign.motion_limits:
        return ()
    control = sweep.best_manoeuvre().sample(sweep.family.sample_time)[1]
    fresh, probability = draws[len(_for_choice(draws)) :], campaign.source.design.probability
    return judge_safety(plan, control[None, :, None], fresh, campaign.motion_limits, probability).words(0)


def _for_choice(draws: np.ndarray) -> np.ndarray:
    """The half of the draws by which designs are chosen; the other half judges the one that is."""
    return draws[: len(draws) // 2]


def utility_unit(campaign: Campaign) -> str:
    """Unit of the utility that is maximised."""
    table = campaign.source.design
    units = {"entropy": "nat", "fisher-d": "nat", "fisher-me": "nat"}
    unit = units.get(table.utility, "")
    return f"{unit}/J" if table.per == "joule" else unit


def _of_no_trial(campaign: Campaign, draws: np.ndarray) -> float:
    """Utility without information: what is counted for a joule is the gain beyond it."""
    name, cov = campaign.source.design.utility, np.atleast_2d(np.cov(draws, rowvar=False))
    return 0.0 if name == "entropy" else float(find_criterion(name, cov)(np.zeros_like(cov)))


def _utility(campaign: Campaign, plan: TrialPlan, controls: np.ndarray, draws: np.ndarray) -> np.ndarray:
    table = campaign.source.design
    criterion = find_criterion(table.utility, np.atleast_2d(np.cov(draws, rowvar=False)))
    if table.over == "local":
        return local_utility(plan, controls, draws.mean(0), criterion)
    found = utility_table(plan, controls, draws[:UTILITY_DRAWS], criterion)
    return found.worst() if table.over == "worst" else found.mean


def _only(sweep: Sweep, rows: np.ndarray, columns: np.ndarray, allowed: np.ndarray) -> Sweep:
    gain = sweep.gain.copy()
    gain[rows[~allowed], columns[~allowed]] = np.nan
    return replace(sweep, gain=gain)
