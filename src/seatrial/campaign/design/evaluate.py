"""Weighs the designs of a sweep: which keep the vehicle inside its limits, what each is worth, and what it costs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import DesignSettings
from seatrial.campaign.design.utility import UTILITY_DRAWS, criterion_of, utility_draws
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.design.cost import PropellerPower, expected_cost, gain_per_cost, in_joules
from seatrial.design.fisher_utilities import Criterion, Discrimination, find_criterion
from seatrial.design.limit_conflicts import check_some_allowed
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.stopping import best_stops
from seatrial.design.sweep import Sweep, in_blocks
from seatrial.design.trial_plan import TrialPlan, plan_trial
from seatrial.manoeuvres.family import design_words
from seatrial.vehicles.model import VehicleModel


def plan_of(campaign: Campaign, model: VehicleModel) -> TrialPlan:
    """Plan of the campaign's trials: from trim, with its sensors."""
    time = campaign.family.time()
    start = campaign.state_trim(model)
    measured = campaign.noise, time.size, campaign.family.sample_time, campaign.measured_mask(time)
    return plan_trial(model, start, *measured, campaign.pilot(model.controls), campaign.expected_process(model))


def applied_controls(
    campaign: Campaign,
    model: VehicleModel,
    values: Float[np.ndarray, " k"],
    controls: Float[np.ndarray, "D n c"],
) -> Float[np.ndarray, "D n n_controls"]:
    """Return the controls of a vehicle under some designs, SI: as its autopilot makes them for these coefficients, or as commanded."""
    plan = plan_of(campaign, model)
    if plan.autopilot is None:
        return controls
    return in_blocks(lambda control: (_applied(plan, values, control),), controls)[0]


@program
def _applied(plan: TrialPlan, values: Array, controls: Array) -> Array:
    return jax.vmap(lambda control: plan.applied(values, control))(controls)


def weigh(
    campaign: Campaign,
    plan: TrialPlan,
    sweep: Sweep,
    draws: Float[np.ndarray, "S k"],
    scales: Float[np.ndarray, " k"],
) -> Sweep:
    """The sweep without the designs that may leave the limits of the motion, and with what each of the others is worth.

    Where seconds are counted, all that is said of a design, its limits included, is of the trial as it is ended.

    Args:
        campaign: limits, utility and power.
        plan: of its trials.
        sweep: entropy reduction of each design.
        draws: coefficients drawn from what is believed, SI; half of them choose.
        scales: units of the coefficients in the sweep, SI.

    Raises:
        InputError: no design keeps the limits of the motion with the probability asked for, or limits the vehicle cannot have.
        NumericalError: the motion diverges at a draw that a utility is averaged over.
    """
    limits, design, power = campaign.motion_limits, campaign.design, campaign.power
    if not limits and design.utility == "entropy" and design.per == "trial":
        return sweep
    if design.per == "second":
        sweep = _by_the_second(criterion_of(campaign, plan, draws), design, plan, sweep, draws, scales)
    rows, columns, controls = sweep.inside()
    if limits:
        samples = None if sweep.length is None else _samples(sweep, sweep.length[rows, columns])
        safety = judge_safety(plan, controls, _for_choice(draws), limits, design.probability, samples=samples)
        places = zip(rows, columns, strict=True)
        words = tuple(design_words(sweep.family, sweep.amplitude[i], sweep.period[j]) for i, j in places)
        check_some_allowed(replace(safety, names=words))
        sweep = _only(sweep, rows, columns, safety.allowed)
        rows, columns, controls = sweep.inside()
    if design.per == "second":
        return sweep
    utility = sweep.gain[rows, columns]
    if design.utility != "entropy":
        utility = _utility(criterion_of(campaign, plan, draws), design, plan, controls, draws)
    if design.per == "joule":
        if power is None:
            raise InputError(
                campaign.where("design.per"),
                found='"joule" without what the vehicle draws',
                expected="the power of the propulsion and of the hotel load",
                remedy='state them, or count by the "trial"',
            )
        cost = in_joules(power.hotel, PropellerPower(power.propulsion, power.at, sweep.family.control))
        if design.utility != "entropy":
            # Utility without information: what is counted for a joule is the gain beyond it.
            criterion = criterion_of(campaign, plan, draws)
            few, k = utility_draws(design, draws), draws.shape[1]
            utility = utility - float(np.mean(np.asarray(criterion(np.zeros((len(few), k, k))))))
        utility = gain_per_cost(utility, expected_cost(plan, cost, controls, draws[:UTILITY_DRAWS]).mean)
    values = np.full(sweep.gain.shape, np.nan)
    values[rows, columns] = utility
    return replace(sweep, utility=values)


def safety_lines(
    limits: Sequence[MotionLimit],
    probability: float,
    plan: TrialPlan,
    sweep: Sweep,
    draws: Float[np.ndarray, "S k"],
) -> Sequence[str]:
    """How surely the best design keeps each limit of the motion, on draws that had no part in choosing it."""
    if not limits:
        return ()
    fresh = draws[len(_for_choice(draws)) :]
    samples = None if sweep.length is None else _samples(sweep, sweep.length[[sweep.best[0]], [sweep.best[1]]])
    controls = sweep.best_controls()[None]
    return judge_safety(plan, controls, fresh, limits, probability, samples=samples).words(0)


def plan_as_run(plan: TrialPlan, sweep: Sweep) -> TrialPlan:
    """The plan of a sweep's best design, ended when that is."""
    return plan if sweep.length is None else plan.until(int(_samples(sweep, sweep.length[sweep.best])))


def _for_choice(draws: np.ndarray) -> np.ndarray:
    """The half of the draws by which designs are chosen; the other half judges the one that is."""
    return draws[: len(draws) // 2]


def check_whole_trials(design: DesignSettings, where: Callable[[str], str], option: str, joules: bool = False) -> None:
    """Check that designs are of full length, as an option of `seatrial design` takes them, and worth what one trial teaches.

    Args:
        design: which trials are tried.
        where: names a key of the campaign file, for errors.
        option: in words.
        joules: whether the option may stand beside designs that are counted per joule.

    Raises:
        InputError: the campaign counts seconds, or joules where the option cannot.
    """
    per = design.per
    if per == "second" or (per == "joule" and not joules):
        why = "knows trials of full length only" if per == "second" else "does not count joules"
        raise InputError(
            where("design.per"),
            found=f'"{per}" with {option}, which {why}',
            expected='"trial" or "joule"' if joules else '"trial"',
            remedy=f'set per = "trial", or leave out {option}',
        )


def utility_unit(design: DesignSettings) -> str:
    """Unit of the utility that is maximised."""
    units = {"entropy": "nat", "fisher-d": "nat", "fisher-me": "nat", "fisher-c": "nat", "discrimination": "nat"}
    unit = units.get(design.utility, "")
    return unit + {"joule": "/J", "second": "/s", "trial": ""}[design.per]


def _utility(
    criterion: Criterion | Discrimination,
    design: DesignSettings,
    plan: TrialPlan,
    controls: np.ndarray,
    draws: np.ndarray,
) -> np.ndarray:
    table = utility_table(plan, controls, utility_draws(design, draws), criterion)
    return table.worst() if design.over == "worst" else table.mean


def _by_the_second(
    criterion: Criterion | Discrimination,
    design: DesignSettings,
    plan: TrialPlan,
    sweep: Sweep,
    draws: np.ndarray,
    scales: np.ndarray,
) -> Sweep:
    """Each design ended when that is worth most for the time it takes; its gain is the D criterion of what is measured by then."""
    rows, columns, controls = sweep.inside()
    few, cov = utility_draws(design, draws), np.atleast_2d(np.cov(draws, rowvar=False))
    stops = best_stops(plan, controls, few, criterion, design.turnaround)
    left = np.linalg.inv(stops.information + np.linalg.inv(cov))
    utility, length, gain = (np.full(sweep.gain.shape, np.nan) for _ in range(3))
    peak = np.where(np.isposinf(sweep.peak_speed), np.inf, np.nan)
    final_sd = np.full_like(sweep.final_sd, np.nan)
    utility[rows, columns], length[rows, columns] = stops.rate, stops.length
    gain[rows, columns] = np.asarray(find_criterion("fisher-d", cov)(stops.information)).mean(-1)
    final_sd[rows, columns] = np.sqrt(np.diagonal(left, axis1=2, axis2=3).mean(1)) / scales
    (leading,) = in_blocks(partial(_leading, plan, draws.mean(0)), controls)
    taken = np.arange(leading.shape[1]) < stops.samples[:, None]
    peak[rows, columns] = np.where(taken, np.abs(leading), 0.0).max(1)
    return replace(sweep, gain=gain, final_sd=final_sd, peak_speed=peak, utility=utility, length=length)


@program
def _leading(plan: TrialPlan, values: Array, controls: Array) -> tuple[Array]:
    return (jax.vmap(lambda control: plan.motion(values, control)[:, 0])(controls),)


def _samples(sweep: Sweep, length: np.ndarray) -> np.ndarray:
    return np.round(length / sweep.family.sample_time).astype(int)


def _only(sweep: Sweep, rows: np.ndarray, columns: np.ndarray, allowed: np.ndarray) -> Sweep:
    lost = rows[~allowed], columns[~allowed]
    gain, utility = sweep.gain.copy(), None if sweep.utility is None else sweep.utility.copy()
    for worth in (gain, utility):
        if worth is not None:
            worth[lost] = np.nan
    return replace(sweep, gain=gain, utility=utility)
