"""Every information criterion of every candidate structure, and leave-future-out, kept on disk.

Which to use when, and why DIC and BPIC decide so little: `docs/criteria.md`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.store.estimates import Estimate, HasKey, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter, no_progress, run_side_by_side
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.selection.criteria import aic, bic, deviance_criteria, maximise_likelihood, psis_loo, waic
from seatrial.selection.criterion import Criteria, NestedPair
from seatrial.selection.leave_future_out import block_edges, leave_future_out, past_of
from seatrial.selection.savage_dickey import savage_dickey
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection

# Share of the longest record that is never predicted, and number of blocks in the rest, where none are given.
FIRST_SHARE, BLOCKS = 1 / 3, 20
MOST = 2000  # Draws of which every measurement's density is taken


def stored_criteria(folder: Path, estimate: OfStructure) -> StoredResult[Criteria]:
    """Return where the criteria of a structure are kept, and what they depend on."""
    path = Store(folder).criteria(estimate.structure.label)
    key = key_of("criteria", estimate.key, MOST)
    return StoredResult(path, key, Criteria, f"seatrial criteria {folder}")


def stored_future(
    campaign: Campaign, estimate: OfStructure, trials: HasKey, edges: np.ndarray
) -> StoredResult[Criteria]:
    """Return where the leave-future-out of a structure is kept, and what it depends on."""
    key = key_of("future", estimate_key(campaign, estimate.structure, trials), edges.tolist())
    path = Store(campaign.folder).future(estimate.structure.label)
    return StoredResult(path, key, Criteria, f"seatrial criteria {campaign.folder}")


def criteria_all(
    campaign: Campaign,
    estimates: Sequence[Estimate],
    trials: Trials,
    first: float | None = None,
    block: float | None = None,
    reporter: Reporter = SILENT,
) -> list[Criteria]:
    """Compute the criteria of every structure, side by side; current results are read.

    Args:
        campaign: configuration.
        estimates: posterior of each structure.
        trials: records, of which the fitted ones are used.
        first: length of the stretch that leave-future-out never predicts, s; None for a third of the longest record.
        block: length of its blocks, s; None for a twentieth of the rest.
        reporter: receives what happens.

    Raises:
        InputError: lengths that leave fewer than two blocks.
    """
    edges = future_edges(trials, first, block)
    tasks = []
    for estimate in estimates:
        label = estimate.structure.label
        titles = (f"criteria {label}", f"leave-future-out {label}")
        done = (
            stored_criteria(campaign.folder, estimate).is_current(),
            stored_future(campaign, estimate, trials, edges).is_current(),
        )
        bars = [None if is_done else reporter.progress(title) for title, is_done in zip(titles, done, strict=True)]
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
    now = now or no_progress
    now(0, 1)
    present = stored_criteria(campaign.folder, estimate).read_or_make(lambda: _compute(campaign, estimate, trials))
    now(1, 1)
    future = stored_future(campaign, estimate, trials, edges).read_or_make(
        lambda: _predict(campaign, estimate.structure, trials, edges, later or no_progress)
    )
    predictive = {**present.predictive, **future.predictive}
    return replace(present, predictive=predictive, refused=(*present.refused, *future.refused))


def _compute(campaign: Campaign, estimate: Estimate, trials: Trials) -> Criteria:
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    draws = thin_draws(estimate.data["draws"].values, MOST)
    refused, computed = (), []
    try:
        table = pointwise_log_likelihood(posterior, draws)
        key = random_key(campaign.seed, f"mode {estimate.structure.terms}")
        mode = find_mode(posterior, key, near=dict(zip(estimate.names, estimate.data["mode"].values, strict=True)))
        best = maximise_likelihood(posterior, mode).values
        density = pointwise_log_likelihood(posterior, best[None, None])[0, 0]
        computed = [aic(density, posterior.dim), bic(density, posterior.dim), waic(table), psis_loo(table)]
    except InputError as error:
        needs = "AIC, BIC, WAIC and PSIS-LOO need the density of each measurement by itself"
        refused = (f"{needs}, but found {error.found}",)
    deviance = deviance_criteria(posterior, draws)
    return Criteria(estimate.structure, deviance, {one.method: one for one in computed}, refused)


def _predict(
    campaign: Campaign, structure: Structure, trials: Trials, edges: np.ndarray, progress: Progress
) -> Criteria:
    """Leave-future-out of one structure; where it cannot be had, the reason."""
    past = past_of(partial(build_posterior, campaign, structure), trials.fit)
    blocks = edges.size - 1
    progress(0, blocks)

    def watched(time: float) -> Posterior:
        progress(min(int(np.searchsorted(edges, time)), blocks - 1), blocks)
        return past(time)

    try:
        future = leave_future_out(watched, edges, random_key(campaign.seed, f"future {structure.terms}"))
        criteria = Criteria(structure, None, {future.criterion.method: future.criterion})
    except (InputError, NumericalError) as error:
        why = error.found if isinstance(error, InputError) else error
        criteria = Criteria(structure, None, {}, (f"no leave-future-out of {structure.label}: {why}",))
    progress(blocks, blocks)
    return criteria


def nested_pairs(
    campaign: Campaign, estimates: Sequence[Estimate], trials: Trials, selection: Selection | None
) -> list[NestedPair]:
    """Savage-Dickey ratio of every optional term whose absence is another candidate with the same unknowns otherwise.

    Args:
        campaign: configuration.
        estimates: posterior of each structure.
        trials: records.
        selection: evidences to compare with; None where they have not been computed.
    """
    by_names = {frozenset(estimate.names): estimate for estimate in estimates}
    messages = []
    for larger in estimates:
        terms = [term for term in campaign.structure.optional if term in larger.names]
        pairs = [(term, by_names.get(frozenset(larger.names) - {term})) for term in terms]
        inside = [(term, smaller) for term, smaller in pairs if smaller is not None]
        if inside:
            posterior = build_posterior(campaign, larger.structure, trials.fit)
            z = np.asarray(posterior.unconstrain(jnp.asarray(larger.data["draws"].values)))
            messages += [_pair(posterior, z, term, larger, smaller, selection) for term, smaller in inside]
    return messages


def _pair(
    posterior: Posterior, z: np.ndarray, term: str, larger: Estimate, smaller: Estimate, selection: Selection | None
) -> NestedPair:
    labels = larger.structure.label, smaller.structure.label
    evidence = None
    if selection is not None:
        known = [structure.label for structure in selection.structures]
        one, other = (selection.evidences[known.index(label)] for label in labels)
        evidence = one.log_value - other.log_value, float(np.hypot(one.std_error, other.std_error))
    try:
        ratio = savage_dickey(posterior, term, z)
    except (InputError, NumericalError) as error:
        why = error.sentence(with_remedy=False) if isinstance(error, InputError) else str(error)
        return NestedPair(term, *labels, np.nan, np.nan, evidence, why)
    return NestedPair(term, *labels, ratio.log_value, ratio.std_error, evidence, ratio.status)
