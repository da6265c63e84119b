"""Every information criterion of every candidate structure, and leave-future-out, kept on disk.

Which to use when, and why DIC and BPIC decide so little: `docs/criteria.md`.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.estimate import Estimate, estimate_key
from seatrial.campaign.problem import build_posterior, random_key
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch, run_side_by_side
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.mode import find_mode
from seatrial.estimation.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior import Posterior
from seatrial.sampling.target import Progress
from seatrial.selection.criteria import (
    DevianceCriteria,
    Estimated,
    PredictiveCriterion,
    deviance_criteria,
    psis_loo,
    waic,
)
from seatrial.selection.leave_future_out import block_edges, leave_future_out, past_of
from seatrial.selection.likelihood_criteria import aic, bic, maximise_likelihood
from seatrial.selection.structures import Structure

FIRST_SHARE, BLOCKS = 1 / 3, 20
"""Share of the longest record that is never predicted, and number of blocks in the rest, where none are given."""
MOST = 2000
"""Draws of which every measurement's density is taken."""
FUTURE = "leave-future-out"


@dataclass(frozen=True, eq=False)
class Criteria:
    """Criteria of one structure.

    Attributes:
        structure: which terms.
        deviance: DIC and BPIC with what they are made of.
        predictive: AIC, BIC, WAIC, PSIS-LOO and leave-future-out by name, as far as they exist.
        edges: times that bound the blocks of leave-future-out, s.
        refused: why others do not exist, in words.
    """

    structure: Structure
    deviance: DevianceCriteria
    predictive: dict[str, PredictiveCriterion]
    edges: np.ndarray
    refused: tuple[str, ...]


def criteria_all(
    campaign: Campaign,
    estimates: Sequence[Estimate],
    trials: Trials,
    first: float | None = None,
    block: float | None = None,
    watch: Watch = SILENT,
) -> list[Criteria]:
    """Compute the criteria of every structure, side by side; current results are read.

    Args:
        campaign: configuration.
        estimates: posterior of each structure.
        trials: records, of which the fitted ones are used.
        first: length of the stretch that leave-future-out never predicts, s; None for a third of the longest record.
        block: length of its blocks, s; None for a twentieth of the rest.
        watch: receives what happens.

    Raises:
        InputError: lengths that leave fewer than two blocks.
    """
    edges = future_edges(trials, first, block)
    tasks = []
    for estimate in estimates:
        label = estimate.structure.label
        titles = (f"criteria {label}", f"leave-future-out {label}")
        done = (
            is_current(Store(campaign.folder).criteria(label), _key(estimate)),
            is_current(Store(campaign.folder).future(label), _future_key(campaign, estimate, trials, edges)),
        )
        bars = [None if there else watch.progress(title) for title, there in zip(titles, done, strict=True)]
        tasks.append(partial(_both, campaign, estimate, trials, edges, *bars))
    return run_side_by_side(tasks)


def future_edges(trials: Trials, first: float | None = None, block: float | None = None) -> np.ndarray:
    """Times that bound the blocks of leave-future-out, s.

    Raises:
        InputError: lengths that leave fewer than two blocks.
    """
    longest = max(float(record.time[-1] - record.time[0]) for record in trials.fit)
    begin = FIRST_SHARE * longest if first is None else first
    return block_edges(trials.fit, begin, (longest - begin) / BLOCKS if block is None else block)


def _both(
    campaign: Campaign,
    estimate: Estimate,
    trials: Trials,
    edges: np.ndarray,
    now: Progress | None,
    later: Progress | None,
) -> Criteria:
    """Criteria of one structure: computed where a bar is given, and then read."""
    store, label = Store(campaign.folder), estimate.structure.label
    if now is not None:
        now(0, 1)
        write_dataset(store.criteria(label), _compute(campaign, estimate, trials), _key(estimate))
        now(1, 1)
    if later is not None:
        key = _future_key(campaign, estimate, trials, edges)
        write_dataset(store.future(label), _predict(campaign, estimate.structure, trials, edges, later), key)
    present, future = open_dataset(store.criteria(label)), open_dataset(store.future(label))
    found = {**_criteria_in(present), **_criteria_in(future)}
    refused = tuple(text for data in (present, future) if (text := data.attrs["refused"]))
    deviance = DevianceCriteria(*(Estimated(*pair) for pair in json.loads(present.attrs["deviance"])))
    return Criteria(estimate.structure, deviance, found, edges, refused)


def _compute(campaign: Campaign, estimate: Estimate, trials: Trials) -> xr.Dataset:
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    draws = thin_draws(estimate.data["draws"].values, MOST)
    refused, found = "", []
    try:
        table = pointwise_log_likelihood(posterior, draws)
        found = [*_at_maximum(campaign, posterior, estimate.structure), waic(table), psis_loo(table)]
    except InputError as error:
        refused = f"AIC, BIC, WAIC and PSIS-LOO need the density of each measurement by itself, but found {error.found}"
    deviance = deviance_criteria(posterior, draws)
    return _dataset(found, refused).assign_attrs(deviance=json.dumps([tuple(one) for one in deviance]))


def _at_maximum(campaign: Campaign, posterior: Posterior, structure: Structure) -> list[PredictiveCriterion]:
    mode = find_mode(posterior, random_key(campaign, f"mode {structure.terms}"))
    best = maximise_likelihood(posterior, mode).values
    density = pointwise_log_likelihood(posterior, best[None, None])[0, 0]
    return [aic(density, posterior.dim), bic(density, posterior.dim)]


def _predict(
    campaign: Campaign, structure: Structure, trials: Trials, edges: np.ndarray, progress: Progress
) -> xr.Dataset:
    """Leave-future-out of one structure; where it cannot be had, the reason."""
    past = past_of(partial(build_posterior, campaign, structure), trials.fit)
    blocks = edges.size - 1
    progress(0, blocks)

    def watched(time: float) -> Posterior:
        progress(min(int(np.searchsorted(edges, time)), blocks - 1), blocks)
        return past(time)

    try:
        found = leave_future_out(watched, edges, random_key(campaign, f"future {structure.terms}"))
        dataset = _dataset([found.criterion], "")
    except (InputError, NumericalError) as error:
        reason = error.found if isinstance(error, InputError) else str(error).removeprefix(f"{FUTURE}: ")
        dataset = _dataset([], f"no leave-future-out of {structure.label}: {reason}")
    progress(blocks, blocks)
    return dataset


def _dataset(found: Sequence[PredictiveCriterion], refused: str) -> xr.Dataset:
    """Criteria by their contributions; what is one number of each goes into an attribute."""
    numbers = {
        one.method: [
            one.value.value,
            one.value.error,
            one.std_error,
            None if np.isnan(one.effective) else one.effective,
            one.status,
        ]
        for one in found
    }
    columns = {f"pointwise {one.method}": ("point", one.pointwise) for one in found}
    columns |= {f"k_hat {one.method}": ("point", one.k_hat) for one in found if one.k_hat.size}
    return xr.Dataset(columns, attrs={"criteria": json.dumps(numbers), "refused": refused})


def _criteria_in(data: xr.Dataset) -> dict[str, PredictiveCriterion]:
    found: dict[str, Any] = {}
    for method, (value, error, std_error, effective, status) in json.loads(data.attrs["criteria"]).items():
        k_hat = data[f"k_hat {method}"].values if f"k_hat {method}" in data else np.empty(0)
        count = np.nan if effective is None else effective
        pointwise = data[f"pointwise {method}"].values
        found[method] = PredictiveCriterion(method, Estimated(value, error), std_error, count, pointwise, k_hat, status)
    return found


def _key(estimate: Estimate) -> str:
    return key_of("criteria", estimate.key, MOST)


def _future_key(campaign: Campaign, estimate: Estimate, trials: Trials, edges: np.ndarray) -> str:
    return key_of("future", estimate_key(campaign, estimate.structure, trials), edges.tolist())
