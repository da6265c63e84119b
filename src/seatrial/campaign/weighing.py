"""Weighs the designs of a sweep: which keep the vehicle inside its limits, what each is worth, and what it costs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.campaign.design_words import design_words
from seatrial.campaign.utilities import UTILITY_DRAWS, criterion_of, utility_draws
from seatrial.core.errors import InputError
from seatrial.design.conflicts import check_some_allowed
from seatrial.design.cost import PropellerPower, expected_cost, gain_per_cost, in_joules
from seatrial.design.plan import TrialPlan, plan_trial
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.stopping import best_stops
from seatrial.design.sweep import Sweep
from seatrial.vehicles.model import VehicleModel


def plan_of(campaign: Campaign, model: VehicleModel) -> TrialPlan:
    """Plan of the campaign's trials: from trim, with its sensors."""
    time = campaign.family.time()
    start = campaign.state_trim(model)
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
    rows, columns, controls = sweep.inside()
    if limits:
        safety = judge_safety(plan, controls, _for_choice(draws), limits, table.probability)
        places = zip(rows, columns, strict=True)
        words = tuple(design_words(sweep.family, sweep.amplitude[i], sweep.period[j]) for i, j in places)
        check_some_allowed(replace(safety, names=words))
        sweep = _only(sweep, rows, columns, safety.allowed)
        rows, columns, controls = sweep.inside()
    if table.per == "second":
        return _by_the_second(campaign, plan, sweep, draws)
    utility = sweep.gain[rows, columns]
    if table.utility != "entropy":
        utility = _utility(campaign, plan, controls, draws)
    if table.per == "joule":
        power, at, hotel = campaign.power()
        cost = in_joules(hotel, PropellerPower(power, at, sweep.family.control))
        utility = gain_per_cost(
            utility - _of_no_trial(campaign, plan, draws),
            expected_cost(plan, cost, controls, draws[:UTILITY_DRAWS]).mean,
        )
    found = np.full(sweep.gain.shape, np.nan)
    found[rows, columns] = utility
    return replace(sweep, utility=found)


def safety_lines(campaign: Campaign, plan: TrialPlan, sweep: Sweep, draws: Float[np.ndarray, "S k"]) -> Sequence[str]:
    """How surely the best design keeps each limit of the motion, on draws that had no part in choosing it."""
    if not campaign.motion_limits:
        return ()
    fresh, probability = draws[len(_for_choice(draws)) :], campaign.source.design.probability
    return judge_safety(plan, sweep.best_controls()[None], fresh, campaign.motion_limits, probability).words(0)


def _for_choice(draws: np.ndarray) -> np.ndarray:
    """The half of the draws by which designs are chosen; the other half judges the one that is."""
    return draws[: len(draws) // 2]


def utility_unit(campaign: Campaign) -> str:
    """Unit of the utility that is maximised."""
    table = campaign.source.design
    units = {"entropy": "nat", "fisher-d": "nat", "fisher-me": "nat", "fisher-c": "nat", "discrimination": "nat"}
    unit = units.get(table.utility, "")
    return unit + {"joule": "/J", "second": "/s", "trial": ""}[table.per]


def _of_no_trial(campaign: Campaign, plan: TrialPlan, draws: np.ndarray) -> float:
    """Utility without information: what is counted for a joule is the gain beyond it."""
    if campaign.source.design.utility == "entropy":
        return 0.0
    few, k = utility_draws(campaign, draws), draws.shape[1]
    return float(np.mean(np.asarray(criterion_of(campaign, plan, draws)(np.zeros((len(few), k, k))))))


def _utility(campaign: Campaign, plan: TrialPlan, controls: np.ndarray, draws: np.ndarray) -> np.ndarray:
    found = utility_table(plan, controls, utility_draws(campaign, draws), criterion_of(campaign, plan, draws))
    return found.worst() if campaign.source.design.over == "worst" else found.mean


def _by_the_second(campaign: Campaign, plan: TrialPlan, sweep: Sweep, draws: np.ndarray) -> Sweep:
    """Each design ended when that is worth most for the time it takes."""
    rows, columns, controls = sweep.inside()
    table, shape = campaign.source.design, sweep.gain.shape
    if table.over == "worst":
        raise InputError(
            campaign.where("design.over"),
            found='"worst" with per = "second"',
            expected="mean or local",
            remedy='set over = "mean"',
        )
    turnaround = campaign.si(table.turnaround, "s", "design.turnaround")
    rate, length = best_stops(
        plan, controls, utility_draws(campaign, draws), criterion_of(campaign, plan, draws), turnaround
    )
    utility, lengths = np.full(shape, np.nan), np.full(shape, np.nan)
    utility[rows, columns], lengths[rows, columns] = rate, length
    return replace(sweep, utility=utility, length=lengths)


def _only(sweep: Sweep, rows: np.ndarray, columns: np.ndarray, allowed: np.ndarray) -> Sweep:
    gain = sweep.gain.copy()
    gain[rows[~allowed], columns[~allowed]] = np.nan
    return replace(sweep, gain=gain)
