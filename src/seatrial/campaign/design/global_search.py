"""The best design between the points of the grid: amplitude and period of every family by global search (CMA-ES)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import DesignSettings
from seatrial.campaign.design.evaluate import check_whole_trials, plan_of, utility_unit
from seatrial.campaign.design.prior_state_space import HALF, prior_draws
from seatrial.campaign.design.sweep import design_first, design_key, write_design
from seatrial.campaign.design.utility import criterion_of, utility_draws
from seatrial.campaign.store.designs import Searched
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.errors import InputError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.global_search import POPULATION, search_globally
from seatrial.design.robust import utility_table
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import all_controls, inside_limits
from seatrial.design.trial_plan import TrialPlan
from seatrial.manoeuvres.family import Family, design_words


def stored_search(campaign: Campaign, budget: int) -> StoredResult[Searched]:
    """Return where the design found by a global search is kept, and what it depends on."""
    key = key_of("searched", list(Searched.__dataclass_fields__), budget, design_key(campaign))
    return StoredResult(Store(campaign.folder).searched, key, Searched, f"seatrial design {campaign.folder}")


def search_design(campaign: Campaign, budget: int, reporter: Reporter = SILENT) -> tuple[Searched, Family, Path]:
    """Search the box of the grid, family by family, under the priors; a current result is read.

    Args:
        campaign: families, grid, utility (`fisher-d` in place of the filter's entropy) and limits.
        budget: designs to evaluate in all.
        reporter: who is told.

    Returns:
        what was found, its family, and the schedule.

    Raises:
        InputError: a grid of one amplitude or period, too small a budget, or no design inside the limits.
        NumericalError: the motion diverges at a draw of the priors.
    """
    check_search(campaign.design, campaign.where, campaign.families, budget)
    kept = stored_search(campaign, budget)
    design = kept.read_or_make(lambda: _search(campaign, budget, reporter))
    family = next(one for one in campaign.families if one.kind == design.kind)
    path = Store(campaign.folder).schedule(kept.path)
    return design, family, write_design(campaign, path, family.manoeuvre(design.amplitude, design.period))


def check_search(
    design: DesignSettings, where: Callable[[str], str], families: tuple[Family, ...], budget: int
) -> None:
    """Check that there is something to search in, and enough to search it, before any work.

    Raises:
        InputError: a grid of one amplitude or period, too small a budget, or designs that are counted by the second or joule.
    """
    check_whole_trials(design, where, "--search")
    lower, upper = _box(design)
    for name, low, high in zip(("amplitude", "period"), lower, upper, strict=True):
        if not low < high:
            raise InputError(
                where(f"design.{name}"),
                found="one value",
                expected="a range to search in",
                remedy="give `from` below `to`, or leave out --search",
            )
    if budget < (fewest := POPULATION * len(families)):
        raise InputError(
            "--search",
            found=f"{budget} design{'s' * (budget != 1)}",
            expected=f"at least {fewest}: populations of {POPULATION} in each family",
            remedy=f"ask for some {20 * fewest}",
        )


def _search(campaign: Campaign, budget: int, reporter: Reporter) -> Searched:
    lower, upper = _box(campaign.design)
    model = campaign.model(campaign.full)
    plan, best = plan_of(campaign, model), design_first(campaign, reporter).best
    draws = prior_draws(campaign, model)
    optima, refused = [], []
    for family in campaign.families:
        worth = _worth_of(campaign, plan, family, draws[:HALF])
        share, seed = budget // len(campaign.families), campaign.seed
        progress = reporter.progress(f"global search: {family.words}")
        try:
            optima.append((family, search_globally(worth, lower, upper, share, seed, POPULATION, progress=progress)))
        except InputError as error:
            if "allowed" not in error.found:
                raise
            refused.append(family.words)
    if not optima:
        raise InputError(
            campaign.where("design"),
            found=f"{budget} designs, none of them inside the limits",
            expected="some that are",
            remedy="widen the limits, or the ranges of amplitude and period",
        )
    family, optimum = max(optima, key=lambda one: one[1].utility)
    trim = campaign.control_trim(model)
    controls = np.stack([all_controls(family, trim, *(x[None] for x in optimum.settings))[0], best.best_controls()])
    fresh = draws[HALF:]
    utility, beside = utility_table(
        plan, controls, utility_draws(campaign.design, fresh), criterion_of(campaign, plan, fresh)
    ).mean
    safety: tuple[str, ...] = ()
    if campaign.motion_limits:
        probability = campaign.design.probability
        safety = judge_safety(plan, controls[:1], fresh, campaign.motion_limits, probability).words(0)
    row, column = best.best
    grid = design_words(best.family, float(best.amplitude[row]), float(best.period[column]))
    at = optimum.settings
    evaluations = budget // len(campaign.families) // POPULATION * POPULATION * len(campaign.families)
    return Searched(
        family.kind,
        float(at[0]),
        float(at[1]),
        float(utility),
        float(beside),
        grid,
        evaluations,
        optimum.settled,
        safety,
        tuple(refused),
        utility_unit(campaign.design),
        budget,
    )


def _box(design: DesignSettings) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest amplitude and period of the grid."""
    amplitude, period = design.grid()
    return np.array([amplitude[0], period[0]]), np.array([amplitude[-1], period[-1]])


def _worth_of(campaign: Campaign, plan: TrialPlan, family: Family, draws: np.ndarray):
    """Utility of designs by amplitude and period; NaN where one does not fit or may leave the limits."""
    criterion, few = criterion_of(campaign, plan, draws), utility_draws(campaign.design, draws)
    trim, worst = campaign.control_trim(plan.model), campaign.design.over == "worst"

    def worth(settings: np.ndarray) -> np.ndarray:
        controls = all_controls(family, trim, settings[:, 0], settings[:, 1])
        allowed = family.fits(settings[:, 1])
        allowed &= inside_limits(family, controls, trim, campaign.control_limits)
        if campaign.motion_limits:
            # Designs that are refused stand in with the trim, which is quick to judge and not looked at.
            held = np.where(allowed[:, None, None], controls, [value for _, value in trim])
            allowed &= judge_safety(plan, held, draws, campaign.motion_limits, campaign.design.probability).allowed
        held = np.where(allowed[:, None, None], controls, [value for _, value in trim])
        table = utility_table(plan, held, few, criterion)
        return np.where(allowed, table.worst() if worst else table.mean, np.nan)

    return worth
