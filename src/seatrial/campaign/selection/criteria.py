"""Every information criterion of every candidate structure, and leave-future-out, kept on disk.

Which to use when, and why DIC and BPIC decide so little: `docs/criteria.md`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import build_posterior, random_key
from seatrial.campaign.store.estimates import Estimate, HasKey, OfStructure
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.campaign.store.structures import NestedPair, StoredCriteria
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.reporter import SILENT, Progress, Reporter, no_progress, run_side_by_side
from seatrial.core.result_table import aligned
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood, thin_draws
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.selection.criteria import (
    SMALL_DIFFERENCE,
    DevianceCriteria,
    MonteCarloValue,
    PredictiveCriterion,
    aic,
    bic,
    compare,
    deviance_criteria,
    maximise_likelihood,
    psis_loo,
    waic,
)
from seatrial.selection.leave_future_out import block_edges, leave_future_out, past_of
from seatrial.selection.savage_dickey import savage_dickey
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Selection

# Share of the longest record that is never predicted, and number of blocks in the rest, where none are given.
FIRST_SHARE, BLOCKS = 1 / 3, 20
MOST = 2000  # Draws of which every measurement's density is taken
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

    def values(self) -> dict[str, tuple[MonteCarloValue, str]]:
        """Return each criterion with its Monte Carlo error, and what is wrong with it."""
        deviance = {"DIC": (self.deviance.dic, ""), "BPIC": (self.deviance.bpic, "")}
        return deviance | {name: (one.value, one.status) for name, one in self.predictive.items()}


def stored_criteria(folder: Path, estimate: OfStructure) -> StoredResult[StoredCriteria]:
    """Return where the criteria of a structure are kept, and what they depend on."""
    path = Store(folder).criteria(estimate.structure.label)
    key = key_of("criteria", estimate.key, MOST)
    return StoredResult(path, key, StoredCriteria, f"seatrial criteria {folder}")


def stored_future(
    campaign: Campaign, estimate: OfStructure, trials: HasKey, edges: np.ndarray
) -> StoredResult[StoredCriteria]:
    """Return where the leave-future-out of a structure is kept, and what it depends on."""
    key = key_of("future", estimate_key(campaign, estimate.structure, trials), edges.tolist())
    path = Store(campaign.folder).future(estimate.structure.label)
    return StoredResult(path, key, StoredCriteria, f"seatrial criteria {campaign.folder}")


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
    merged = {**_criteria_in(present), **_criteria_in(future)}
    refused = tuple(one.refused for one in (present, future) if one.refused)
    deviance = DevianceCriteria(*(MonteCarloValue(*pair) for pair in present.deviance))
    return Criteria(estimate.structure, deviance, merged, edges, refused)


def _compute(campaign: Campaign, estimate: Estimate, trials: Trials) -> StoredCriteria:
    posterior = build_posterior(campaign, estimate.structure, trials.fit)
    draws = thin_draws(estimate.data["draws"].values, MOST)
    refused, computed = "", []
    try:
        table = pointwise_log_likelihood(posterior, draws)
        key = random_key(campaign.seed, f"mode {estimate.structure.terms}")
        mode = find_mode(posterior, key, near=dict(zip(estimate.names, estimate.data["mode"].values, strict=True)))
        best = maximise_likelihood(posterior, mode).values
        density = pointwise_log_likelihood(posterior, best[None, None])[0, 0]
        computed = [
            aic(density, posterior.dim),
            bic(density, posterior.dim),
            waic(table),
            psis_loo(table),
        ]
    except InputError as error:
        refused = f"AIC, BIC, WAIC and PSIS-LOO need the density of each measurement by itself, but found {error.found}"
    deviance = deviance_criteria(posterior, draws)
    return _stored(computed, refused, tuple(tuple(one) for one in deviance))


def _predict(
    campaign: Campaign, structure: Structure, trials: Trials, edges: np.ndarray, progress: Progress
) -> StoredCriteria:
    """Leave-future-out of one structure; where it cannot be had, the reason."""
    past = past_of(partial(build_posterior, campaign, structure), trials.fit)
    blocks = edges.size - 1
    progress(0, blocks)

    def watched(time: float) -> Posterior:
        progress(min(int(np.searchsorted(edges, time)), blocks - 1), blocks)
        return past(time)

    try:
        future = leave_future_out(watched, edges, random_key(campaign.seed, f"future {structure.terms}"))
        criteria = _stored([future.criterion], "")
    except (InputError, NumericalError) as error:
        criteria = _stored(
            [], f"no leave-future-out of {structure.label}: {error.found if isinstance(error, InputError) else error}"
        )
    progress(blocks, blocks)
    return criteria


def _stored(
    found: Sequence[PredictiveCriterion], refused: str, deviance: tuple[tuple[float, float], ...] = ()
) -> StoredCriteria:
    shape = len(found), max((one.pointwise.size for one in found), default=0)
    tails = [one.k_hat if one.k_hat.size else np.full(shape[1], np.nan) for one in found]
    return StoredCriteria(
        methods=tuple(one.method for one in found),
        value=np.array([one.value.value for one in found], float),
        error=np.array([one.value.error for one in found], float),
        std_error=np.array([one.std_error for one in found], float),
        effective=np.array([one.effective for one in found], float),
        pointwise=np.array([one.pointwise for one in found], float).reshape(shape),
        k_hat=np.array(tails, float).reshape(shape),
        status=tuple(one.status for one in found),
        refused=refused,
        deviance=deviance,
    )


def _criteria_in(stored: StoredCriteria) -> dict[str, PredictiveCriterion]:
    columns = (stored.methods, stored.value, stored.error, stored.std_error, stored.effective)
    return {
        method: PredictiveCriterion(
            cast(Any, method),
            MonteCarloValue(float(value), float(error)),
            float(std_error),
            float(effective),
            pointwise,
            k_hat[~np.isnan(k_hat)],
            status,
        )
        for method, value, error, std_error, effective, pointwise, k_hat, status in zip(
            *columns, stored.pointwise, stored.k_hat, stored.status, strict=True
        )
    }


# Criteria side by side, in words: each structure's difference to the best, what that tells apart, and nested pairs by
# Savage-Dickey.

METHODS = ("DIC", "BPIC", "AIC", "BIC", "WAIC", "PSIS-LOO", FUTURE)
WHY = (
    "DIC and BPIC decide little: a term without effect changes them by 2 or 3 minus a random 1 ± 1.4, so a few units are noise. "
    "Neither penalises a wide prior. Decide by evidence (seatrial select)"
)


class Difference(NamedTuple):
    """How far a structure is behind the best by one criterion, and the standard error of that; NaN where there is none."""

    delta: float
    error: float

    @property
    def is_clear(self) -> bool:
        """Whether it is beyond what its error and the smallness of such differences leave open."""
        return bool(self.delta >= max(SMALL_DIFFERENCE, 2 * self.error))


def differences(found: Sequence[Criteria]) -> dict[str, list[Difference]]:
    """Of every criterion, how far each structure is behind the best one, which has (0, 0)."""
    table = {}
    for name in METHODS:
        if name in ("DIC", "BPIC"):
            values = [getattr(one.deviance, name.lower()) for one in found]
            best = min(values, key=lambda pair: pair.value)
            table[name] = [
                Difference(0.0, 0.0)
                if one is best
                else Difference(one.value - best.value, float(np.hypot(one.error, best.error)))
                for one in values
            ]
            continue
        terms = [one.predictive.get(name) for one in found]
        best = min((one for one in terms if one is not None), key=lambda one: one.value.value, default=None)
        table[name] = [
            Difference(np.nan, np.nan)
            if one is None or best is None
            else Difference(0.0, 0.0)
            if one is best
            else Difference(*compare(one, best)[:2])
            for one in terms
        ]
    return table


def criteria_lines(found: Sequence[Criteria]) -> list[str]:
    """A table of the differences, and what they tell apart."""
    table = differences(found)
    heads = ["", *(item for name in METHODS for item in ([name, "k-hat"] if name == "PSIS-LOO" else [name])), "terms"]
    rows = []
    for i, one in enumerate(found):
        row = [one.structure.label]
        for name in METHODS:
            row.append(_cell(table[name][i]))
            if name == "PSIS-LOO":
                k_hat = one.predictive[name].k_hat if name in one.predictive else np.empty(0)
                row.append(f"{k_hat.max():.2f}" if k_hat.size else "-")
        rows.append([*row, " ".join(one.structure.terms)])
    lines = aligned((heads, *rows), left=(0, -1))
    return ["differences to the best, lower is better", *lines, *_apart(found, table), WHY]


def criteria_cautions(found: Sequence[Criteria]) -> list[str]:
    """What is missing, or not to be trusted."""
    messages = [text for one in found for text in one.refused]
    messages += [
        f"{one.structure.label}, {name}: {criterion.status}"
        for one in found
        for name, criterion in one.predictive.items()
        if criterion.status
    ]
    return list(dict.fromkeys(messages))


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
    lower, upper = (float(bound) for bound in posterior.parameters[posterior.names.index(term)].prior.bounds)
    if not lower < 0 < upper:
        return NestedPair(
            term, *labels, np.nan, np.nan, evidence, "0 is not inside the prior, so only evidences compare them"
        )
    try:
        ratio = savage_dickey(posterior, term, z)
    except InputError as error:
        return NestedPair(term, *labels, np.nan, np.nan, evidence, error.sentence(with_remedy=False))
    except NumericalError as error:
        return NestedPair(term, *labels, np.nan, np.nan, evidence, str(error))
    return NestedPair(term, *labels, ratio.log_value, ratio.std_error, evidence, ratio.status)


def _cell(difference: Difference) -> str:
    if not np.isfinite(difference.delta):
        return "-"
    if difference == (0.0, 0.0):
        return "best"
    return f"{difference.delta:+.1f} ± {difference.error:.1f}"


def _apart(found: Sequence[Criteria], table: dict[str, list[Difference]]) -> list[str]:
    """Which structures are clearly behind, by which criteria."""
    if len(found) < 2:
        return ["only one structure: there is nothing to compare it with"]
    clear = {one.structure.label: [name for name in METHODS if table[name][i].is_clear] for i, one in enumerate(found)}
    behind = [f"{label} is behind by {', '.join(names)}" for label, names in clear.items() if names]
    rest = "no criterion separates the structures" if not behind else "the others cannot be separated"
    return [f"beyond {SMALL_DIFFERENCE:g} and two standard errors: {'; '.join([*behind, rest])}"]
