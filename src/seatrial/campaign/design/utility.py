"""What makes a design of a campaign worth running: its filter, its criterion of the information, and the prediction it serves."""

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import DesignFilter, DesignSettings
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.design.fisher_utilities import Criterion, Discrimination, find_criterion
from seatrial.design.trial_plan import TrialPlan
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.square_root import MAX_UNROLLED_STATES, unscented_filter
from seatrial.filters.unscented import UnscentedKalmanFilter

UTILITY_DRAWS = 32  # Draws over which a utility is averaged, the same for all designs


def design_filter(name: DesignFilter, n_states: int, where: str) -> Filter:
    """The filter whose entropy reduction is predicted, for so many states; `where` names the setting, for errors.

    Raises:
        InputError: a filter that does not do for as many.
    """
    if name == "square-root-unscented":
        return unscented_filter(n_states)
    if n_states > 2 * MAX_UNROLLED_STATES:
        raise InputError(
            where,
            found=f'"{name}" for {n_states} states and coefficients',
            expected=f"at most {2 * MAX_UNROLLED_STATES}: it is compiled number by number",
            remedy='set filter = "square-root-unscented"',
        )
    return UnscentedKalmanFilter() if name == "unscented" else ExtendedKalmanFilter()


def utility_draws(design: DesignSettings, draws: Float[np.ndarray, "S k"]) -> Float[np.ndarray, "s k"]:
    """The draws over which a utility is taken: their mean alone where it is local."""
    return draws.mean(0)[None] if design.over == "local" else draws[:UTILITY_DRAWS]


def criterion_of(campaign: Campaign, plan: TrialPlan, draws: Float[np.ndarray, "S k"]) -> Criterion | Discrimination:
    """The campaign's criterion of the information about a plan's coefficients.

    Args:
        campaign: utility, prediction and structures.
        plan: vehicle of the trial.
        draws: its coefficients as they are believed, SI.
    """
    design, cov = campaign.design, np.atleast_2d(np.cov(draws, rowvar=False))
    name = "fisher-d" if design.utility == "entropy" else design.utility
    if name == "discrimination":
        # Where there are too many structures, those that lack one term alone stand for all.
        terms = set(plan.names)
        if campaign.is_large and not campaign.shortlist:
            lacking = [{name} for name in plan.names if name in campaign.rules.optional]
        else:
            lacking = [terms - set(one.terms) for one in campaign.structures if set(one.terms) < terms]
        rivals = np.array([[name in lost for name in plan.names] for lost in lacking], bool).reshape(-1, len(terms))
        if len(rivals):
            return Discrimination(utility_draws(design, draws), rivals, cov)
        name = "fisher-d"  # the smallest structure was chosen: what settles it against others is searched beside this
    if name != "fisher-c":
        return find_criterion(name, cov)
    wanted = campaign.prediction(plan.model)
    if wanted is None:
        raise InputError(
            campaign.where("design.utility"),
            found='"fisher-c" without a prediction',
            expected="the prediction to improve",
            remedy="state it beside the utility",
        )
    return find_criterion(name, cov, wanted.at(draws.mean(0))[1])


def prediction_lines(
    campaign: Campaign, plan: TrialPlan, control: Float[np.ndarray, "n c"], draws: Float[np.ndarray, "S k"]
) -> tuple[str, ...]:
    """How well the stated prediction is known now and after a design, in words; none where there is none."""
    wanted, stated = campaign.prediction(plan.model), campaign.design.prediction
    if wanted is None or stated is None:
        return ()
    mean, (drive, drive_unit) = draws.mean(0), shown_unit(campaign.family.control)
    value, gradient = wanted.at(mean)
    before = np.atleast_2d(np.cov(draws, rowvar=False))
    after = np.linalg.inv(np.linalg.inv(before) + np.asarray(plan.information(mean, control)))
    factor, unit = shown_unit(stated.of)
    now, then = (float(np.sqrt(gradient @ cov @ gradient)) * factor for cov in (before, after))
    return (
        f"{stated.of} {stated.after:g} s after {campaign.family.control} is set to {stated.control * drive:.4g} {drive_unit}: "
        f"{value * factor:.4g} {unit}, "
        f"known to ± {now:.2g} {unit} now and ± {then:.2g} {unit} after it",
    )
