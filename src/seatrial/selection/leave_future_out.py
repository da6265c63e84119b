"""Leave-future-out: how well a model predicts the next block of a time series given all before it, block after block.

    LFO = -2 sum_b log p(y_b | y_<b),   p(y_b | y_<b) = E[p(y_b | y_<b, theta)] over the posterior given y_<b

Buerkner, Gabry and Vehtari (Journal of Statistical Computation and Simulation 90, 2020). The posterior is found anew only
where reweighting the draws of the last one fails: Pareto k above 0.7, or fewer than 400 effective draws, since a posterior
that shrinks inside an old one has light-tailed weights however few of them count. The joint density of a block, whose M samples
are predicted M steps ahead at most, is a difference of two log-likelihoods: any likelihood will do, coloured residuals included.

As the blocks do not overlap, the sum is the log evidence of everything after the first stretch given that stretch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.sampling.diagnostics import MIN_ESS
from seatrial.selection.criteria import deviances
from seatrial.selection.criterion import Comparison, MonteCarloValue, PredictiveCriterion, compare, sum_error
from seatrial.selection.importance import MAX_K_HAT, ImportanceSettings, importance_sample

Past = Callable[[float], Posterior]  # Posterior given what was measured before a time, s; always of the same parameters
SETTINGS = ImportanceSettings(draws=4096, pilot=2048)
MIN_BLOCKS = 10  # Number of blocks below which the spread between them says little about the error of their sum


@dataclass(frozen=True, eq=False)
class LeaveFutureOut:
    """How badly each block is predicted from its past.

    Attributes:
        criterion: the sum; `pointwise` and `k_hat` have one entry for each block.
        edges: times that bound the blocks, s, shape (blocks + 1,).
        refits: times at which the posterior was found anew, the first edge included, s.
    """

    criterion: PredictiveCriterion
    edges: Float[np.ndarray, " b1"]
    refits: tuple[float, ...]


def leave_future_out(
    past: Past,
    edges: Sequence[float] | Float[np.ndarray, " b1"],
    key: jax.Array,
    settings: ImportanceSettings = SETTINGS,
    max_k_hat: float = MAX_K_HAT,
) -> LeaveFutureOut:
    """Predict each block from all that was measured before it.

    Args:
        past: posterior given what was measured before a time: see `past_of`.
        edges: times that bound the blocks, s; what was measured before the first is never predicted.
        key: random key.
        settings: draws of each posterior that is found, by importance sampling about its mode.
        max_k_hat: tail index of the weights above which the posterior is found anew; -inf always does.

    Raises:
        InputError: fewer than two blocks, or edges that do not increase.
        NumericalError: a posterior without a mode, or a block that no draw gives a finite density.
    """
    edges = np.asarray(edges, dtype=float)
    if edges.size < 3 or not (np.diff(edges) > 0).all():
        raise InputError(
            "leave-future-out, edges of the blocks",
            found=np.array2string(edges, precision=6, threshold=8),
            expected="at least three increasing times",
            remedy="use shorter blocks, or a shorter first stretch",
        )
    stretch = _begin(past(float(edges[0])), key, settings)
    pointwise, k_hats, refits, variance = [], [], [float(edges[0])], 0.0
    for b, (edge, end) in enumerate(pairwise(map(float, edges))):
        if b > 0 and not (stretch.k_hat <= max_k_hat and stretch.ess >= MIN_ESS):
            variance += stretch.variance
            stretch = _begin(past(edge), jax.random.fold_in(key, b), settings)
            refits.append(edge)
        k_hats.append(stretch.k_hat)
        value, stretch = _predict(stretch, past(end), edge)
        pointwise.append(value)
    variance += stretch.variance
    k_hat, points = np.array(k_hats), -2 * np.array(pointwise)
    total = MonteCarloValue(float(points.sum()), 2 * float(np.sqrt(variance)))
    criterion = PredictiveCriterion(
        "leave-future-out", total, sum_error(points), np.nan, points, k_hat, "; ".join(_complaints(k_hat, max_k_hat))
    )
    return LeaveFutureOut(criterion, edges, tuple(refits))


def compare_futures(one: LeaveFutureOut, other: LeaveFutureOut) -> Comparison:
    """Return the difference of two models, first minus second, its error from the differences between blocks.

    Raises:
        InputError: different blocks.
    """
    if not np.array_equal(one.edges, other.edges):
        raise InputError(
            "comparison of two models by leave-future-out",
            found=f"blocks from {one.edges[0]:g} to {one.edges[-1]:g} s and from {other.edges[0]:g} to {other.edges[-1]:g} s",
            expected="the same blocks",
            remedy="compute both with the same edges",
        )
    return compare(one.criterion, other.criterion)


def block_edges(records: Sequence[Record], first: float, block: float) -> Float[np.ndarray, " b1"]:
    """Return the edges of blocks of equal length, the last cut short by the end; blocks in which nothing was measured join the next.

    Args:
        records: trials; their clocks run side by side, each from its own first sample.
        first: length of the stretch that is never predicted, s: enough to determine the parameters.
        block: length of a block, s.

    Raises:
        InputError: lengths that are not positive, or leave fewer than two blocks.
    """
    times = np.concatenate(
        [(record.time - record.time[0])[np.isfinite(record.measurement).any(axis=1)] for record in records]
    )
    end = float(times.max()) if times.size else 0.0
    if first <= 0 or block <= 0 or first + block >= end:
        raise InputError(
            "leave-future-out, blocks",
            found=f"a first stretch of {first:g} s and blocks of {block:g} s in records of {end:g} s",
            expected="positive lengths and at least two blocks",
            remedy="shorten them",
        )
    edges = np.append(np.arange(first, end, block), end + 1e-6 * block)
    measured = np.histogram(times, edges)[0] > 0
    return np.concatenate([edges[:1], edges[1:][measured]])


def past_of(posterior_of: Callable[[Sequence[Record]], Posterior], records: Sequence[Record]) -> Past:
    """Return the posteriors of records cut off at a time; compiled code is shared where the samples are evenly spaced.

    Args:
        posterior_of: posterior of records, such as `partial(build_posterior, campaign, structure)`.
        records: trials; their clocks run side by side, each from its own first sample.
    """

    def past(time: float) -> Posterior:
        return posterior_of([_before(record, time) for record in records])

    return past


class _Stretch(NamedTuple):
    """Draws of one posterior, reweighted as blocks are added to what it knows.

    Attributes:
        values: draws in their own units, shape (n, d).
        log_likelihood: of all that is known, shape (n,).
        log_weight: as sampled and reweighted, shape (n,).
        smoothed: log weights that sum to 1, their tail smoothed, shape (n,).
        k_hat: tail index of the weights.
        influence: of each draw on the sum of the blocks predicted so far, shape (n,).
    """

    values: np.ndarray
    log_likelihood: np.ndarray
    log_weight: np.ndarray
    smoothed: np.ndarray
    k_hat: float
    influence: np.ndarray

    @property
    def ess(self) -> float:
        """Effective draws."""
        return 1.0 / float(np.sum(np.exp(2 * self.smoothed)))

    @property
    def variance(self) -> float:
        """Monte Carlo variance of the sum of the blocks predicted, the draws being independent."""
        return float(self.influence @ self.influence)


def _begin(known: Posterior, key: jax.Array, settings: ImportanceSettings) -> _Stretch:
    drawn = importance_sample(known, key, settings=settings)
    values = np.asarray(known.constrain(jnp.asarray(drawn.z)))
    log_likelihood = _log_likelihood(known, values)
    return _Stretch(values, log_likelihood, drawn.log_weight, drawn.smoothed, drawn.k_hat, np.zeros(len(values)))


def _predict(stretch: _Stretch, later: Posterior, edge: float) -> tuple[float, _Stretch]:
    """Return the log density of the block up to what `later` knows, and the draws knowing it; one that diverged never comes back."""
    from arviz_stats.base.array import array_stats

    log_likelihood = _log_likelihood(later, stretch.values)
    alive = np.isfinite(log_likelihood) & np.isfinite(stretch.log_weight)
    density = np.subtract(log_likelihood, stretch.log_likelihood, out=np.full(alive.size, -np.inf), where=alive)
    joint = stretch.smoothed + density
    value = float(logsumexp(joint))
    if not np.isfinite(value):
        raise NumericalError(
            f"no draw of the posterior gives what was measured after {edge:g} s a finite density; "
            "the model diverges there, or the first stretch is too short to determine the parameters",
        )
    log_weight = stretch.log_weight + density
    smoothed, k_hat = array_stats.psislw(-np.maximum(log_weight, log_weight.max() - 700.0))
    influence = stretch.influence + np.exp(joint - value) - np.exp(stretch.smoothed)
    return value, _Stretch(stretch.values, log_likelihood, log_weight, np.asarray(smoothed), float(k_hat), influence)


def _log_likelihood(posterior: Posterior, values: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the log-likelihood of draws in their own units, padded to a multiple of 512 so that one program serves all."""
    n = values.shape[0]
    filled = values[np.minimum(np.arange(-(-n // 512) * 512), n - 1)]
    return -0.5 * np.asarray(deviances(posterior, jnp.asarray(filled)))[:n]


def _before(record: Record, time: float) -> Record:
    """Return the record without its measurements from a time after its first sample on; its controls are all kept."""
    known = record.time - record.time[0] < time
    return replace(record, measurement=np.where(known[:, None], record.measurement, np.nan))


def _complaints(k_hat: np.ndarray, max_k_hat: float) -> list[str]:
    complaints = []
    bad = int((~(k_hat <= max(max_k_hat, MAX_K_HAT))).sum())
    if bad:
        complaints.append(
            f"the predictions of {bad} of {k_hat.size} blocks depend on a few draws (k-hat up to {k_hat.max():.2f}, "
            f"at most {MAX_K_HAT}) although the posterior was sampled again: it is far from normal there; lengthen the first stretch"
        )
    if k_hat.size < MIN_BLOCKS:
        complaints.append(
            f"only {k_hat.size} blocks: the standard error over them is rough, use at least {MIN_BLOCKS} shorter ones"
        )
    return complaints
