"""How well the cheap measures of a design agree with its expected information gain, over some designs of a campaign.

The expected information gain is that of the whole prior, by nested Monte Carlo with its error; the cheap ones are what a sweep can
afford: the filter's entropy reduction at the prior means, and criteria of the Fisher information there or over draws.
"""

import json

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.evaluate import check_whole_trials, plan_of
from seatrial.campaign.design.sweep import design_first, design_key
from seatrial.campaign.design.utility import UTILITY_DRAWS
from seatrial.campaign.inference.posterior import random_key
from seatrial.campaign.store.designs import EXPECTED, Measures
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Reporter
from seatrial.design.expected_gain import GainSettings, importance_gain
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.prior_belief import draw_values, prior_cov
from seatrial.design.robust import local_utility, utility_table
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.manoeuvres.family import design_words

FISHER_CRITERIA = ("fisher-d", "fisher-a", "fisher-e", "fisher-me")
# Four times the usual importance draws: weak designs leave posteriors that press on the priors' bounds
GAIN_SETTINGS = GainSettings(inner=256)


def stored_measures(campaign: Campaign, count: int) -> StoredResult[Measures]:
    """Return where the measures of so many designs are kept, and what they depend on."""
    key = key_of("measures", count, design_key(campaign))
    return StoredResult(Store(campaign.folder).measures, key, Measures)


def compare_measures(campaign: Campaign, count: int, reporter: Reporter = SILENT) -> Measures:
    """Compute every measure for the best design of each family and for others spread over what they reach; a current result is read.

    Args:
        campaign: its priors, families and limits.
        count: designs, 5 at least.
        reporter: who is told.

    Raises:
        InputError: as `check_comparison`.
        NumericalError: the motion diverges at a draw of the priors.
    """
    check_comparison(campaign)
    return stored_measures(campaign, count).read_or_make(lambda: Measures(_compute(campaign, count, reporter)))


def check_comparison(campaign: Campaign) -> None:
    """Check that the expected gain of a campaign's designs can be computed, before any work.

    Raises:
        InputError: process noise is expected, which the expected gain knows nothing of, or designs that are counted by the second.
    """
    check_whole_trials(campaign.design, campaign.where, "--compare", joules=True)
    model = campaign.model(campaign.full)
    process = campaign.expected_process(model) or (0.0,) * len(model.states)
    moved = [
        name
        for state, sd in zip(model.states, process, strict=True)
        if sd and (name := process_name(state)) in campaign.priors
    ]
    if moved:
        raise InputError(
            campaign.where(f"prior.{moved[0]}"),
            found="process noise, with --compare",
            expected="a motion that follows the model: the expected gain counts the sensors' noise only, the cheap measures both",
            remedy="leave out --compare, or compare without the priors of process noise",
        )


def _compute(campaign: Campaign, count: int, reporter: Reporter) -> Dataset:
    designs, model = design_first(campaign, reporter), campaign.model(campaign.full)
    priors = campaign.coefficient_priors(model)
    plan, cov = plan_of(campaign, model), prior_cov(priors)
    names, controls, entropy = [], [], []
    for sweep, row, column in _spread(designs.sweeps, count):
        amplitude, period = float(sweep.amplitude[row]), float(sweep.period[column])
        names.append(design_words(sweep.family, amplitude, period))
        controls.append(sweep.controls(row, column))
        entropy.append(float(sweep.gain[row, column]))
    held = np.stack(controls)
    measures = {"entropy of the filter": np.array(entropy)}
    mean = np.array([float(prior.mean) for prior in priors])
    for name in FISHER_CRITERIA:
        measures[f"{name} at the prior means"] = local_utility(plan, held, mean, find_criterion(name, cov))
    draws = draw_values(priors, random_key(campaign.seed, "draws of the measures"), UTILITY_DRAWS)
    averaged = utility_table(plan, held, draws, find_criterion("fisher-d", cov)).mean
    measures[f"fisher-d over {UTILITY_DRAWS} draws"] = averaged
    progress, gains, refused = reporter.progress(f"expected gain of {len(names)} designs"), [], []
    for done, control in enumerate(held):
        progress(done, len(names))
        gains.append(importance_gain(plan, priors, control, random_key(campaign.seed, "expected gain"), GAIN_SETTINGS))
        if gains[-1].status:
            refused.append(f"{names[done]}: {gains[-1].status}")
    progress(len(names), len(names))
    if len(refused) > len(names) / 2:
        raise NumericalError("the expected gain cannot be computed for most designs; " + refused[0])
    kept = np.array([not gain.status for gain in gains])
    measures[EXPECTED] = np.array([gain.value for gain in gains])
    measures["error"] = np.array([gain.std_error for gain in gains])
    return Dataset(
        {name: ("design", values[kept]) for name, values in measures.items()},
        coords={"design": np.array(names)[kept]},
        attrs={"refused": json.dumps(refused)},
    )


def _spread(sweeps: tuple, count: int) -> list[tuple]:
    """The best design of each family, and others at even ranks of the gain among all that are inside the limits."""
    chosen = [(sweep, *sweep.best) for sweep in sweeps[:count]]
    others = [(sweep, int(i), int(j)) for sweep in sweeps for i, j in np.argwhere(np.isfinite(sweep.gain))]
    others = [one for one in others if (one[1], one[2]) != one[0].best]
    others.sort(key=lambda one: one[0].gain[one[1], one[2]])
    places = np.linspace(0, len(others) - 1, min(count - len(chosen), len(others))).round().astype(int)
    return chosen + [others[place] for place in places]
