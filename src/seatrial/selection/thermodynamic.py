"""Evidence by stepping-stone and thermodynamic integration over one ladder of tempered chains.

    log Z = sum_k log E_k[L^(b_k+1 - b_k)]      Xie et al., Systematic Biology 60, 2011
    log Z = int_0^1 E_b[log L] db               Friel and Pettitt, J. R. Stat. Soc. B 70, 2008

with E_k over p L^b_k. Copies of the whole ladder run side by side and exchange nothing once tuned, so that the error is that of
the spread of the copies (jackknife), whatever the correlation along chains and rungs.

What it cannot see: a narrow peak of small prior mass that no chain meets before the cold rungs have closed about a broad one
(a phase transition), or a mode that the prior draws never lead to. A peak met by some copies shows as an error or a drift.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.special import logsumexp

from seatrial.core.progress import Progress, no_progress
from seatrial.sampling.target import Target
from seatrial.sampling.tempered_ladder import DEAD, Ladder, LadderSettings, sample_ladder
from seatrial.selection.evidence import ALIVE, Evidence

MIN_SWAP = 0.1
"""Acceptance of swaps below which neighbours on the ladder hardly overlap."""
MIN_SHARE = 0.02
"""Share of a rung's draws that count towards the next below which a few of them carry the ratio."""
MAX_DRIFT = 4.0
"""Difference of the two halves of a run, in its errors, that chance does not explain."""
MAX_CUT = 0.1
"""Discretisation error, nats, above which the integral is not believed."""
_USUAL = LadderSettings()


def stepping_stone_evidence(
    target: Target, key: jax.Array, settings: LadderSettings = _USUAL, progress: Progress = no_progress
) -> Evidence:
    """Evidence by stepping-stone; arguments and errors as `sample_ladder`."""
    return stepping_stone(sample_ladder(target, key, settings, progress))


def thermodynamic_evidence(
    target: Target, key: jax.Array, settings: LadderSettings = _USUAL, progress: Progress = no_progress
) -> Evidence:
    """Evidence by thermodynamic integration; arguments and errors as `sample_ladder`."""
    return thermodynamic(sample_ladder(target, key, settings, progress))


def stepping_stone(ladder: Ladder) -> Evidence:
    """Evidence from the ratios of neighbouring rungs."""
    step = np.diff(ladder.temperatures)[:, None]
    values, weights = ladder.log_likelihood, step * ladder.log_likelihood[:, :-1]
    heaviest = np.exp(weights - weights.max((0, 2), keepdims=True))
    share = (heaviest.sum((0, 2)) ** 2 / (heaviest**2).sum((0, 2))) / (weights.size / step.size)

    def combine(draws: slice) -> np.ndarray:
        return np.array([row.sum() for row in _leave_one_out(step * values[draws, :-1])])

    log_value, error, drift = _judged(combine, len(values))
    diagnostics = _diagnostics(ladder, drift) | {"lowest_share": float(share.min())}
    complaints = _complaints(ladder, drift)
    if share.min() < MIN_SHARE:
        complaints.append(
            f"a few draws carry the step between two rungs ({share.min():.1%} of them count): use more rungs"
        )
    return Evidence(log_value, error, "stepping-stone", diagnostics, "; ".join(complaints))


def thermodynamic(ladder: Ladder) -> Evidence:
    """Evidence from the integral of the mean log-likelihood, by the trapezoid with corrected ends of every step.

    The stated error adds, squared, the error of the integration: an eighth of what taking every second rung changes. The rule
    is of fourth order in a ladder that changes slowly, so that a sixteenth is to be expected.
    """
    values = ladder.log_likelihood

    def integrals(draws: slice, every: int = 1) -> np.ndarray:
        return _integrals(ladder.temperatures[::every], values[draws, ::every])

    log_value, error, drift = _judged(integrals, len(values))
    cut = abs(log_value - float(integrals(slice(None), 2)[0])) / 8.0
    complaints = _complaints(ladder, drift)
    if cut > MAX_CUT:
        complaints.append(f"the integral over the ladder is uncertain by {cut:.2f} nats: use more rungs")
    diagnostics = _diagnostics(ladder, drift) | {"monte_carlo_error": error, "discretisation_error": cut}
    return Evidence(
        log_value, float(np.hypot(error, cut)), "thermodynamic integration", diagnostics, "; ".join(complaints)
    )


def _integrals(b: Float[np.ndarray, " rungs"], values: Float[np.ndarray, "draws rungs copies"]) -> np.ndarray:
    """Corrected trapezoid of all copies first, then without each of them, relative to the part of the prior alive."""
    alive = values > DEAD
    centre = np.mean(values, (0, 2), where=alive)[:, None]
    off = np.where(alive, values - centre, 0.0)
    sums = np.stack([alive.sum(0), off.sum(0), (off * off).sum(0)])
    count, first, second = np.concatenate([sums.sum(2)[..., None], sums.sum(2)[..., None] - sums], 2)
    mean, variance = centre + first / count, second / count - (first / count) ** 2
    step = np.diff(b)
    area = step @ (mean[1:] + mean[:-1]) / 2 - step**2 @ np.diff(variance, axis=0) / 12
    return np.log(count[0] / count[1]) + area


def _leave_one_out(logs: Float[np.ndarray, "draws pairs copies"]) -> Float[np.ndarray, "rows pairs"]:
    """Log mean of exponentials over draws and copies: of all copies first, then without each of them."""
    draws, _, copies = logs.shape
    each = np.asarray(logsumexp(logs, 0))
    rows = [logsumexp(each, 1) - np.log(copies * draws)]
    rows += [logsumexp(np.delete(each, m, 1), 1) - np.log((copies - 1) * draws) for m in range(copies)]
    return np.array(rows)


def _judged(estimate: Callable[[slice], np.ndarray], draws: int) -> tuple[float, float, float]:
    """Value, its jackknife error over the copies, and the difference of the halves of the run in its own error."""
    rows = estimate(slice(None))
    change = estimate(slice(draws // 2)) - estimate(slice(draws // 2, None))
    return float(rows[0]), _jackknife(rows), float(abs(change[0])) / max(_jackknife(change), 1e-12)


def _jackknife(rows: np.ndarray) -> float:
    """Standard error from leave-one-out values, which follow the first, widened as Student's t at 95 %."""
    n = rows.size - 1
    widened = stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975)
    return float(np.sqrt((n - 1) * np.var(rows[1:])) * widened)


def _diagnostics(ladder: Ladder, drift: float) -> dict[str, Any]:
    return {
        "rungs": ladder.temperatures.size,
        "lowest_swap": float(ladder.swap.min()),
        "arrivals": ladder.arrivals,
        "drift": drift,
        "alive": float(np.mean(ladder.log_likelihood[:, 0] > DEAD)),
    }


def _complaints(ladder: Ladder, drift: float) -> list[str]:
    """What is wrong with the chains, in words."""
    said, alive = [], float(np.mean(ladder.log_likelihood[:, 0] > DEAD))
    if ladder.swap.min() < MIN_SWAP:
        k = int(ladder.swap.argmin())
        said.append(
            f"the ladder is too coarse: between temperatures {ladder.temperatures[k]:.2g} and {ladder.temperatures[k + 1]:.2g} "
            f"only {ladder.swap[k]:.0%} of the swaps were accepted, use more rungs"
        )
    if ladder.arrivals < 1.0:
        said.append(
            "hardly any draw came from the prior all the way to the posterior: use more rungs and longer chains"
        )
    if drift > MAX_DRIFT:
        said.append(f"the two halves of the run differ by {drift:.1f} of their errors: use a longer warm-up")
    if alive < ALIVE:
        said.append(f"only {alive:.1%} of the prior can be simulated: narrow it to damping that dissipates")
    return said
