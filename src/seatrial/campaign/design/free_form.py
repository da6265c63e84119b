"""The free-form trial: not a member of a family but every level chosen, by gradients, inside all limits."""

from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import DesignSettings
from seatrial.campaign.design.evaluate import check_whole_trials, plan_of
from seatrial.campaign.design.prior_state_space import HALF
from seatrial.campaign.design.sweep import design_first, design_key, write_design
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.designs import FreeTrial
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.free_form import design_free_form
from seatrial.design.free_form_problem import FreeFormProblem
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.prior_belief import draw_values, prior_cov
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.free_form import SteppedInput, nearest_levels
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre

UTILITY_POINTS = 4  # Draws of the priors over which the utility is averaged
SAFE_DRAWS = 64  # Draws for which limits of the motion hold during the search; judged on fresh ones afterwards

RISK_SHARE = 0.75  # Share of the risk allowed that the search takes: the rest is for what draws it has not seen


def stored_free_trial(campaign: Campaign, levels: int) -> StoredResult[FreeTrial]:
    """Return where the free-form trial is kept, and what it depends on."""
    key = key_of("free form", "active", levels, design_key(campaign))
    return StoredResult(Store(campaign.folder).free_design, key, FreeTrial, f"seatrial design {campaign.folder}")


def design_free_trial(campaign: Campaign, levels: int, reporter: Reporter = SILENT) -> tuple[FreeTrial, Path]:
    """Search the levels that teach most about the full structure under its priors; a current result is read.

    Returns:
        what was found, and the schedule.

    Raises:
        InputError: no bounds of the control, limits that admit nothing, or several controls that move together.
        NumericalError: the vehicle diverges at a draw of the priors.
    """
    check_free_trial(campaign)
    if (edge := _form(campaign.family, levels).edge) < campaign.family.ramp:
        reporter.say(
            f"{levels} levels are {edge:.4g} s apart, and design.ramp in {campaign.path} is {campaign.family.ramp:g} s: the control goes "
            f"in straight lines from level to level; {int(campaign.family.active / campaign.family.ramp)} levels or fewer keep the ramp"
        )
    kept = stored_free_trial(campaign, levels)
    trial = kept.read_or_make(lambda: _search(campaign, levels, reporter))
    manoeuvre = _form(campaign.family, levels).manoeuvre(np.array(trial.levels))
    return trial, write_design(campaign, Store(campaign.folder).schedule(kept.path), manoeuvre)


def check_free_trial(campaign: Campaign) -> None:
    """Check that a campaign has what a free form needs, before any work.

    Raises:
        InputError: several controls that move together, designs that are counted by the second or joule, a control without both bounds.
    """
    if campaign.family.beside:
        raise InputError(
            campaign.where("design.together"),
            found=f"{', '.join(one.control for one in campaign.family.beside)} beside {campaign.family.control}, with --free-form",
            expected="one control or set-point: its levels alone are searched",
            remedy="leave out `together` or --free-form",
        )
    check_whole_trials(campaign.design, campaign.where, "--free-form")
    limits, control = campaign.limits, campaign.family.control
    if None in (limits.lower, limits.upper) or inf in (abs(limits.lower or 0.0), abs(limits.upper or 0.0)):
        unit = shown_unit(control)[1]
        raise InputError(
            campaign.where(f"limits.{control}"),
            found="a bound that is missing",
            expected="lower and upper: a free form goes as far as it may",
            remedy=f'for example lower = "800 {unit}"',
        )


def _search(campaign: Campaign, levels: int, reporter: Reporter) -> FreeTrial:
    model, form = campaign.model(campaign.full), _form(campaign.family, levels)
    priors = campaign.coefficient_priors(model)
    plan, cov = plan_of(campaign, model), prior_cov(priors)
    draws = draw_values(priors, random_key(campaign.seed, "draws of the free form"), 2 * HALF)
    best = design_first(campaign, reporter).best
    family = best.best_manoeuvre()
    problem = FreeFormProblem(
        plan,
        form,
        campaign.limits,
        draws[:UTILITY_POINTS],
        cov,
        dict(campaign.control_trim(model)),
        motion=campaign.motion_limits,
        draws=draws[:SAFE_DRAWS],
        risk=RISK_SHARE * (1.0 - campaign.design.probability),
    )
    time, control = family.sample(best.family.sample_time)
    near = nearest_levels(form, time, control)
    optimum = design_free_form(
        problem,
        campaign.seed,
        {f"the best {family.name}": near, **_random(campaign.limits, campaign.seed, form.size)},
        progress=reporter.progress("free-form design"),
    )
    controls = np.stack([_commands(campaign, plan, one) for one in (optimum.manoeuvre, family)])
    # Both by the same measure, on draws that had no part in the search.
    judged = utility_table(plan, controls, draws[SAFE_DRAWS : SAFE_DRAWS + 64], find_criterion("fisher-d", cov)).mean
    return FreeTrial(
        tuple(map(float, optimum.levels)),
        float(judged[0]),
        float(judged[1]),
        family.name,
        float(optimum.at_bounds),
        optimum.active,
        _safety(campaign.motion_limits, campaign.design, plan, controls[0], draws),
        tuple((one.name, float(one.before), float(one.utility)) for one in optimum.outcomes),
        optimum.status,
    )


def _commands(campaign: Campaign, plan: TrialPlan, manoeuvre: Manoeuvre) -> Float[np.ndarray, "n c"]:
    """Return every command of a trial, SI: all but the one that is driven at trim."""
    _, driven = manoeuvre.sample(campaign.family.sample_time)
    held = {**dict(campaign.control_trim(plan.model)), campaign.family.control: driven}
    return np.column_stack([np.broadcast_to(held[name], driven.shape) for name in plan.commands])


def _safety(
    motion_limits: Sequence[MotionLimit],
    design: DesignSettings,
    plan: TrialPlan,
    control: Float[np.ndarray, "n c"],
    draws: np.ndarray,
) -> tuple[str, ...]:
    if not motion_limits:
        return ()
    probability = design.probability
    return judge_safety(plan, control[None], draws[HALF:], motion_limits, probability).words(0)


def _form(family: Family, levels: int) -> SteppedInput:
    """Levels over the active time of the families, and the way back to trim after it, or before the end of the trial.

    Each edge takes the ramp of the families, or the whole interval where that is shorter.
    """
    active = min(family.active, family.duration - family.start - family.ramp)
    return SteppedInput(
        family.control, family.trim, family.duration, family.start, active, levels, min(family.ramp, active / levels)
    )


def _random(limits: Limits, seed: int, size: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    assert limits.lower is not None
    assert limits.upper is not None
    return {f"random levels {i + 1}": random.choice([limits.lower, limits.upper], size) for i in range(2)}
