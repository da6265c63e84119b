"""What makes a design of a campaign worth running: its filter, its criterion of the information, and the prediction it serves."""

from math import inf

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, located
from seatrial.core.signals import signal_unit
from seatrial.design.fisher_utilities import Criterion, Discrimination, find_criterion
from seatrial.design.stated_prediction import TRACKS, Prediction, prediction
from seatrial.design.trial_plan import TrialPlan
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.square_root import MOST_UNROLLED, unscented_filter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.vehicles.model import VehicleModel

UTILITY_DRAWS = 32
"""Draws over which a utility is averaged, the same for all designs."""


def design_filter(campaign: Campaign, n_states: int) -> Filter:
    """The filter whose entropy reduction is predicted, for so many states.

    Raises:
        InputError: a filter that does not do for as many.
    """
    name = campaign.source.design.filter
    if name == "square-root-unscented":
        return unscented_filter(n_states)
    if n_states > 2 * MOST_UNROLLED:
        raise InputError(
            campaign.where("design.filter"),
            found=f'"{name}" for {n_states} states and coefficients',
            expected=f"at most {2 * MOST_UNROLLED}: it is compiled number by number",
            remedy='set filter = "square-root-unscented"',
        )
    return UnscentedKalmanFilter() if name == "unscented" else ExtendedKalmanFilter()


def utility_draws(campaign: Campaign, draws: Float[np.ndarray, "S k"]) -> Float[np.ndarray, "s k"]:
    """The draws over which a utility is taken: their mean alone where it is local."""
    return draws.mean(0)[None] if campaign.source.design.over == "local" else draws[:UTILITY_DRAWS]


def check_utility(campaign: Campaign) -> None:
    """Check what makes a design the best: the prediction, what the utility needs, and what is counted.

    Raises:
        InputError: naming the key at fault.
    """
    table, where = campaign.source.design, campaign.where
    wanted = stated_prediction(campaign, campaign.model(campaign.full))
    if table.utility == "fisher-c" and wanted is None:
        raise InputError(
            where("design.utility"),
            found='"fisher-c" without [design.prediction]',
            expected="the prediction whose variance is to fall",
            remedy='add [design.prediction] with of = "distance", control = "0 rpm" and after = "30 s"',
        )
    if table.utility == "discrimination" and not campaign.rules.optional:
        raise InputError(
            where("design.utility"),
            found='"discrimination" of a single structure',
            expected="terms whose presence the data decide",
            remedy='add them to structure.optional, or set utility = "fisher-d"',
        )
    turnaround = campaign.si(table.turnaround, "s", "design.turnaround")
    if not 0 <= turnaround < inf:
        raise InputError(
            where("design.turnaround"), found=f"{turnaround:g} s", expected="0 s or more", remedy='for example "2 min"'
        )
    if turnaround > 0 and table.per != "second":
        raise InputError(
            where("design.turnaround"),
            found=f'{turnaround:g} s with per = "{table.per}", which does not count it',
            expected='per = "second" beside it',
            remedy='set per = "second", or remove turnaround',
        )
    if table.over == "worst" and table.per == "second":
        raise InputError(
            where("design.over"),
            found='"worst" with per = "second"',
            expected="mean or local",
            remedy='set over = "mean"',
        )


def criterion_of(campaign: Campaign, plan: TrialPlan, draws: Float[np.ndarray, "S k"]) -> Criterion | Discrimination:
    """The campaign's criterion of the information about a plan's coefficients.

    Args:
        campaign: utility, prediction and structures.
        plan: vehicle of the trial.
        draws: its coefficients as they are believed, SI.
    """
    table, cov = campaign.source.design, np.atleast_2d(np.cov(draws, rowvar=False))
    name = "fisher-d" if table.utility == "entropy" else table.utility
    if name == "discrimination":
        rivals = _rivals(campaign, plan.names)
        if len(rivals):
            return Discrimination(utility_draws(campaign, draws), rivals, cov)
        name = "fisher-d"  # the smallest structure was chosen: what settles it against others is searched beside this
    if name != "fisher-c":
        return find_criterion(name, cov)
    wanted = stated_prediction(campaign, plan.model)
    assert wanted is not None  # `check_utility`
    return find_criterion(name, cov, wanted.at(draws.mean(0))[1])


def stated_prediction(campaign: Campaign, model: VehicleModel) -> Prediction | None:
    """The prediction of `[design.prediction]`, by one structure's model; None where there is none.

    Raises:
        InputError: something the vehicle cannot predict, a time that is not positive, or units that do not fit.
    """
    table, family = campaign.source.design.prediction, campaign.family
    if table is None:
        return None
    after = campaign.si(table.after, "s", "design.prediction.after")
    if not 0 < after < 1e5:
        raise InputError(
            campaign.where("design.prediction.after"),
            found=f"{after:g} s",
            expected="a positive time of 100 000 s at most",
            remedy='for example "30 s"',
        )
    set_to = campaign.si(table.control, signal_unit(family.control), "design.prediction.control")
    control = [set_to if name == family.control else value for name, value in campaign.control_trim(model)]
    with located(campaign.where("design.prediction.of")):
        return prediction(model, table.of, campaign.state_trim(model), control, after, family.sample_time)


def prediction_lines(
    campaign: Campaign, plan: TrialPlan, control: Float[np.ndarray, "n c"], draws: Float[np.ndarray, "S k"]
) -> tuple[str, ...]:
    """How well the stated prediction is known now and after a design, in words; none where there is none."""
    wanted = stated_prediction(campaign, plan.model)
    if wanted is None:
        return ()
    table, mean = campaign.source.design.prediction, draws.mean(0)
    assert table is not None
    value, gradient = wanted.at(mean)
    before = np.atleast_2d(np.cov(draws, rowvar=False))
    after = np.linalg.inv(np.linalg.inv(before) + np.asarray(plan.information(mean, control)))
    factor, unit = (1.0, "m") if table.of in TRACKS else shown_unit(table.of)
    now, then = (float(np.sqrt(gradient @ cov @ gradient)) * factor for cov in (before, after))
    return (
        f"{table.of} {table.after} after {campaign.family.control} is set to {table.control}: {value * factor:.4g} {unit}, "
        f"known to ± {now:.2g} {unit} now and ± {then:.2g} {unit} after it",
    )


def _rivals(campaign: Campaign, names: tuple[str, ...]) -> np.ndarray:
    """What each structure lacks of these terms, shape (R, k); where there are too many, those that lack one term alone."""
    if campaign.is_large and not campaign.shortlist:
        lacking = [{name} for name in names if name in campaign.rules.optional]
    else:
        lacking = [set(names) - set(one.terms) for one in campaign.structures if set(one.terms) < set(names)]
    return np.array([[name in lost for name in names] for lost in lacking], bool).reshape(-1, len(names))
