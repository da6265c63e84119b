"""Every information criterion of every candidate structure, kept on disk.

Which to use when, and why DIC and BPIC decide so little: `docs/explanation/criteria.md`.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.store.estimates import Estimate, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter, no_progress, run_side_by_side
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.selection.criteria import aic, bic, deviance_criteria, maximise_likelihood, psis_loo, waic
from seatrial.selection.criterion import Criteria, NestedPair
from seatrial.selection.savage_dickey import savage_dickey
from seatrial.selection.verdict import Selection

MOST = 2000  # Draws of which every measurement's density is taken


def stored_criteria(folder: Path, estimate: OfStructure) -> StoredResult[Criteria]:
    """Return where the criteria of a structure are kept, and what they depend on."""
    path = Store(folder).criteria(estimate.structure.label)
    key = key_of("criteria", estimate.key, MOST)
    return StoredResult(path, key, Criteria, f"seatrial criteria {folder}")


def criteria_all(
    campaign: Campaign, estimates: Sequence[Estimate], trials: Trials, reporter: Reporter = SILENT
) -> list[Criteria]:
    """Compute the criteria of every structure, side by side; current results are read.

    Args:
        campaign: configuration.
        estimates: posterior of each structure.
        trials: records, of which the fitted ones are used.
        reporter: receives what happens.
    """
    tasks = []
    for estimate in estimates:
        stored = stored_criteria(campaign.folder, estimate)
        progress = no_progress if stored.is_current() else reporter.progress(f"criteria {estimate.structure.label}")
        tasks.append(partial(stored.read_or_make, partial(_compute, campaign, estimate, trials, progress)))
    return run_side_by_side(tasks)


def _compute(campaign: Campaign, estimate: Estimate, trials: Trials, progress: Progress) -> Criteria:
    progress(0, 1)
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    draws = thin_draws(estimate.data["draws"].values, MOST)
    refused, computed = (), []
    try:
        table = pointwise_log_likelihood(posterior, draws)
        key = random_key(campaign.seed, f"mode {estimate.structure.terms}")
        mode = find_mode(posterior, key=key, near=dict(zip(estimate.names, estimate.data["mode"].values, strict=True)))
        best = maximise_likelihood(posterior, mode).values
        density = pointwise_log_likelihood(posterior, best[None, None])[0, 0]
        computed = [aic(density, posterior.dim), bic(density, posterior.dim), waic(table), psis_loo(table)]
    except InputError as error:
        needs = "AIC, BIC, WAIC and PSIS-LOO need the density of each measurement by itself"
        refused = (f"{needs}, but found {error.found}",)
    deviance = deviance_criteria(posterior, draws)
    progress(1, 1)
    return Criteria(estimate.structure, deviance, {one.method: one for one in computed}, refused)


def nested_pairs(
    campaign: Campaign, estimates: Sequence[Estimate], trials: Trials, selection: Selection | None
) -> list[NestedPair]:
    """Savage-Dickey ratio of every optional term whose absence is another candidate with the same unknowns otherwise.

    Args:
        campaign: configuration.
        estimates: posterior of each structure.
        trials: records.
        selection: evidences to compare with; None if they have not been computed.
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
