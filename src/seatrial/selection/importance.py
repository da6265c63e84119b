"""Evidence by importance sampling about the modes: Z = E_q[p(z) L(z) / q(z)] (Geweke, Econometrica 57, 1989).

About a mode q = 0.8 t_8(m, C) + 0.2 t_8(m, 4 C), which has heavier tails than a posterior that is nearly normal in z; of several modes
each has its share of the draws, and q is the mixture (Owen and Zhou, JASA 95, 2000). It starts from the Laplace approximations and is
refitted to the weighted draws until enough of them count; the draws of the answer are fresh. Whether the weights have a variance is
judged by the index of their tail (Vehtari et al., JMLR 25, 2024).

A posterior that leans on the bound of a prior, as of a term that is not needed, is normal neither in z, whose map bends there, nor without
a bound. Such parameters are drawn first, on the straight line before the map bends, each from a t_8 cut at its bounds given those before
it, and the others given them: exact draws and their exact density (Geweke, Computing Science and Statistics 23, 1991).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
import scipy
from jaxtyping import Float, Int

from seatrial.compiled.random_keys import fold_in, split
from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior.mode import Mode, find_mode, triangular_root
from seatrial.estimation.posterior.noncentred import Uncoupled, coupled, uncouple, uncoupled_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors.box import bent, log_slopes, straightened
from seatrial.sampling.diagnostics import MIN_ESS, load_array_stats
from seatrial.sampling.target import Target, evaluate
from seatrial.selection.evidence import EvidenceSettings
from seatrial.selection.verdict import Evidence

FREEDOM = 8.0
WIDE_SHARE, WIDE_SCALE = 0.2, 2.0  # Share of the widened component, and its standard deviations over those of the other
LEANING_DISTANCE = 4.0  # Standard deviations from a bound within which a posterior leans on it
NO_EDGES = np.array([[-np.inf, np.inf]])  # Edges of components of which none is cut
# Efficiency at which the proposal is not refitted any more, unless the tail of the weights is too heavy.
GOOD_EFFICIENCY = 0.5
# Where too few draws count: so many times what would just be enough, and times the draws asked for at most, are drawn
# again.
DRAW_MARGIN, MAX_DRAW_FACTOR = 1.5, 16.0
# Pareto shape of the weights above which their mean is not to be trusted (Vehtari et al., JMLR 25, 2024).
MAX_K_HAT = 0.7
MISSING_TAIL_INDEX = 10.0  # Tail index that is stated where so few draws carry all weight that none can be found


class ProposalComponent(NamedTuple):
    """What is drawn about one mode.

    Attributes:
        centre: where, in z; on the straight line of z of what leans on a bound; shape (d,).
        factor: triangular factor of the scale matrix there, shape (d, d).
        share: of the draws.
        edges: at which a leaning component is cut, shape (d, 2); infinite for all others.
    """

    centre: Float[np.ndarray, " d"]
    factor: Float[np.ndarray, "d d"]
    share: float = 1.0
    edges: Float[np.ndarray, "d 2"] = NO_EDGES

    @property
    def leaning(self) -> Int[np.ndarray, " k"]:
        """Places of what leans on a bound."""
        return np.flatnonzero(np.isfinite(self.edges).any(1))


class Weights(NamedTuple):
    """Draws, log weights log(p L / q), the same with a smoothed tail that sum to 1, tail index, effective size, refits before, modes."""

    z: Float[np.ndarray, "n d"]
    log_weight: Float[np.ndarray, " n"]
    smoothed: Float[np.ndarray, " n"]
    k_hat: float
    ess: float
    refits: int = 0
    modes: int = 1


@dataclass(frozen=True)
class ImportanceSettings:
    """Size of a run.

    Attributes:
        draws: fresh draws of the final estimate; more of them if too few count.
        pilot: draws of each trial of a proposal.
        refits: how often the proposal may be refitted.
    """

    draws: int = EvidenceSettings.draws
    pilot: int = 2048
    refits: int = 2


def importance_evidence(
    posterior: Posterior,
    key: jax.Array,
    mode: Mode | None = None,
    settings: ImportanceSettings = ImportanceSettings(),
    further: Sequence[Mode] = (),
) -> Evidence:
    """Return the evidence by adaptive importance sampling; arguments and errors as `importance_sample`."""
    return evidence_of(importance_sample(posterior, key, mode, settings, further))


def importance_sample(
    posterior: Posterior,
    key: jax.Array,
    mode: Mode | None = None,
    settings: ImportanceSettings = ImportanceSettings(),
    further: Sequence[Mode] = (),
) -> Weights:
    """Return the weighted draws of the posterior.

    Args:
        posterior: density to integrate; another mode, far from those given, would be missed without a sign.
        key: random key.
        mode: posterior mode, found here if not given.
        settings: size of the run.
        further: other modes.

    Raises:
        NumericalError: no mode, or no draw of finite density.
    """
    mode_key, pilot_key, key = split(key, 3)
    target, centre = uncouple(posterior, find_mode(posterior, key=mode_key) if mode is None else mode)
    modes = [centre, *(uncoupled_mode(target, one) for one in further)]
    edges = edges_of(target)
    proposals = [laplace_proposal(one, edges)._replace(share=1.0 / len(modes)) for one in modes]
    done = 0
    for done in range(settings.refits + 1):
        weights = weigh(target, proposals, fold_in(pilot_key, done), settings.pilot)
        shared = done > 0 or len(modes) == 1  # what each of several modes holds is known from the first refit on
        if done == settings.refits or (
            shared and weights.ess / settings.pilot > GOOD_EFFICIENCY and weights.k_hat <= MAX_K_HAT
        ):
            break
        proposals = refit(proposals, weights, edges)
    weights = weigh(target, proposals, key, settings.draws)
    if weights.ess < MIN_ESS and weights.k_hat <= MAX_K_HAT:
        more = min(DRAW_MARGIN * MIN_ESS / weights.ess, MAX_DRAW_FACTOR)
        weights = weigh(target, proposals, fold_in(key, 1), int(np.ceil(more * settings.draws)))
    return weights._replace(z=np.asarray(coupled(target, weights.z)), refits=done, modes=len(modes))


def evidence_of(weights: Weights) -> Evidence:
    """Return the evidence from weighted draws, its error by the delta method from the variance of the weights."""
    draws = weights.log_weight.size
    diagnostics = {
        "k_hat": weights.k_hat,
        "ess": weights.ess,
        "efficiency": weights.ess / draws,
        "draws": draws,
        "refits": weights.refits,
        "modes": weights.modes,
    }
    return Evidence(
        _log_sum(weights.log_weight) - float(np.log(draws)),
        float(np.sqrt(1.0 / weights.ess - 1.0 / draws)),
        f"importance sampling about {'the mode' if weights.modes == 1 else f'{weights.modes} modes'}",
        diagnostics,
        "; ".join(_complaints(weights)),
    )


def edges_of(target: Target) -> Float[np.ndarray, "d 2"]:
    """Return where the line of each component of z bends into a bound, infinite if it does not."""
    edges, posterior = np.repeat(NO_EDGES, target.dim, 0), target.posterior if isinstance(target, Uncoupled) else target
    if isinstance(posterior, Posterior):
        edges[posterior.places] = [one.prior.edges for one in posterior.present_parameters]
    if isinstance(target, Uncoupled):
        edges[[*target.common, *target.deviation]] = NO_EDGES
    return edges


def laplace_proposal(mode: Mode, edges: Float[np.ndarray, "d 2"] = NO_EDGES) -> ProposalComponent:
    """Return the proposal at the mode, nowhere wider than the prior, which has unit variance in z.

    A density that leans on the edge of its box has almost no curvature at the mode, and its Laplace covariance no meaning.

    Args:
        mode: where, and the precision of z there.
        edges: of each component, of `edges_of`.
    """
    values, vectors = np.linalg.eigh(mode.precision)
    factor = triangular_root(vectors / np.sqrt(np.maximum(values, 1.0)))
    slope = np.exp(log_slopes(mode.z, edges))
    on_line = ProposalComponent(straightened(mode.z, edges), slope[:, None] * factor)
    return _cut(ProposalComponent(mode.z, factor), on_line, edges)


def _cut(free: ProposalComponent, on_line: ProposalComponent, edges: Float[np.ndarray, "d 2"]) -> ProposalComponent:
    """Return the proposal on the straight lines, cut at the edges that it leans on; the one in z where it leans on none."""
    sd = np.sqrt(np.sum(on_line.factor**2, 1))
    leans = np.any(np.abs(edges - on_line.centre[:, None]) < LEANING_DISTANCE * sd[:, None], axis=1)
    return on_line._replace(edges=np.where(leans[:, None], edges, NO_EDGES)) if leans.any() else free


def weigh(target: Target, proposals: Sequence[ProposalComponent], key: jax.Array, n: int) -> Weights:
    """Draw from the proposals, each its share, and weigh the draws.

    Args:
        target: density.
        proposals: components of the mixture.
        key: random key.
        n: number of draws.

    Raises:
        NumericalError: every draw has zero density.
    """
    z = draw_mixture(proposals, key, n)
    log_weight = evaluate(target, z) - log_mixture(proposals, z)
    top = log_weight.max()
    if not np.isfinite(top):
        raise NumericalError(
            f"none of {n} draws about the posterior mode has a finite density: start from another mode, or narrow the prior"
        )
    smoothed, k_hat = smooth_weights(log_weight)
    ess = 1.0 / float(np.sum(np.exp(2 * (log_weight - _log_sum(log_weight)))))
    return Weights(np.asarray(z), log_weight, smoothed, k_hat, ess)


def smooth_weights(log_weight: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], float]:
    """Return log weights with a smoothed tail, whose sum is 1, and k-hat: `MISSING_TAIL_INDEX` where one draw counts and no tail is left.

    Vehtari and others, Pareto smoothed importance sampling, Journal of Machine Learning Research 25, 2024.
    """
    with np.errstate(all="ignore"):
        smoothed, k_hat = load_array_stats().psislw(-np.maximum(log_weight, log_weight.max() - 700.0))
    if np.isfinite(k_hat) and np.isfinite(smoothed).all():
        return np.asarray(smoothed), float(k_hat)
    return log_weight - _log_sum(log_weight), MISSING_TAIL_INDEX


def draw_mixture(proposals: Sequence[ProposalComponent], key: jax.Array, n: int) -> Float[np.ndarray, "n d"]:
    """Draw from the proposals, each its share."""
    random = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    ends = np.rint(n * np.cumsum([proposal.share for proposal in proposals])).astype(int)
    counts = np.diff(ends, prepend=0)
    return np.concatenate([_draw(proposal, random, count) for proposal, count in zip(proposals, counts, strict=True)])


def log_mixture(proposals: Sequence[ProposalComponent], z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the log density of the proposals, each with its share, at some positions."""
    return np.asarray(scipy.special.logsumexp(_log_shares(proposals, z), 0))


def refit(
    proposals: Sequence[ProposalComponent], weights: Weights, edges: Float[np.ndarray, "d 2"] = NO_EDGES
) -> list[ProposalComponent]:
    """Return the proposals with the moments of the weighted draws, the old scale counting as much as d + 2 effective draws.

    Of several, a draw belongs to each as far as each is likely to have made it, and half of the draws are shared by what was found.

    Args:
        proposals: that made the draws.
        weights: the draws with their weights.
        edges: of each component, of `edges_of`.
    """
    result = np.exp(weights.smoothed - _log_sum(weights.smoothed))
    log_shares = _log_shares(proposals, weights.z)
    belongs = result * np.exp(log_shares - scipy.special.logsumexp(log_shares, 0))
    line, count, refitted = straightened(weights.z, edges), len(proposals), []
    for proposal, part in zip(proposals, belongs, strict=True):
        total = float(part.sum())
        if total > 0.0:
            proposal = _cut(
                _refitted(proposal, part / total, weights.z), _refitted(proposal, part / total, line), edges
            )
        refitted.append(proposal._replace(share=0.5 / count + 0.5 * total))
    return refitted


def _refitted(
    proposal: ProposalComponent, share: Float[np.ndarray, " n"], place: Float[np.ndarray, "n d"]
) -> ProposalComponent:
    """Return a proposal without edges fitted to weighted places, in z or on the straight lines; the weights sum to 1."""
    centre = share @ place
    spread = place - centre
    trust, doubt = 1.0 / float(share @ share), centre.size + 2.0
    fresh = np.sqrt(trust / (trust + doubt) * share) * spread.T
    return ProposalComponent(
        centre, triangular_root(np.hstack([fresh, np.sqrt(doubt / (trust + doubt)) * proposal.factor]))
    )


def _complaints(weights: Weights) -> list[str]:
    """Return what is wrong with the weights, in words."""
    complaints = []
    if not weights.k_hat <= MAX_K_HAT:
        complaints.append(
            f"the sum depends on a few draws (Pareto k {weights.k_hat:.2f}, at most {MAX_K_HAT}): the posterior is far from normal, "
            "use tempered SMC"
        )
    if weights.ess < MIN_ESS:
        complaints.append(f"only {weights.ess:.0f} effective draws, at least {MIN_ESS:.0f}: use more draws")
    return complaints


def distance(proposal: ProposalComponent, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Return the squared distance from the centre, in standard deviations."""
    return np.sum(_steps(proposal, z) ** 2, 0)


def _order(proposal: ProposalComponent) -> tuple[Int[np.ndarray, " d"], Float[np.ndarray, "d d"]]:
    """Return in which order components are drawn, what leans first, and the triangular factor of the scale matrix in that order."""
    leaning, everything = proposal.leaning, np.arange(proposal.centre.size)
    if not leaning.size:
        return everything, proposal.factor
    order = np.concatenate([leaning, np.setdiff1d(everything, leaning)])
    return order, triangular_root(proposal.factor[order])


def _steps(proposal: ProposalComponent, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "d n"]:
    """Return the independent steps of unit scale that lead from the centre to z, in the order in which they are drawn."""
    order, factor = _order(proposal)
    return scipy.linalg.solve_triangular(
        factor, (straightened(z, proposal.edges) - proposal.centre)[:, order].T, lower=True
    )


def _limits(
    proposal: ProposalComponent, steps: Float[np.ndarray, "d n"], row: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return between which values a step of what leans stays inside the bounds, given the steps before it."""
    order, factor = _order(proposal)
    before = proposal.centre[order[row]] + factor[row, :row] @ steps[:row]
    low, high = ((edge - before) / factor[row, row] for edge in proposal.edges[order[row]])
    return low, high


def _draw(proposal: ProposalComponent, random: np.random.Generator, n: int) -> Float[np.ndarray, "n d"]:
    """Independent draws about one mode."""
    order, factor = _order(proposal)
    leaning, d = proposal.leaning.size, proposal.centre.size
    steps, stretch = np.empty((d, n)), np.sqrt(FREEDOM / random.chisquare(FREEDOM, n))
    scale = np.where(random.uniform(size=n) < WIDE_SHARE, WIDE_SCALE, 1.0)
    for row in range(leaning):
        begin, end = (scipy.special.stdtr(FREEDOM, limit / scale) for limit in _limits(proposal, steps, row))
        steps[row] = scale * scipy.special.stdtrit(FREEDOM, begin + (end - begin) * random.uniform(size=n))
    steps[leaning:] = ((scale * stretch)[:, None] * random.normal(size=(n, d - leaning))).T
    place = np.empty((n, d))
    place[:, order] = proposal.centre[order] + steps.T @ factor.T
    return bent(place, proposal.edges)


def _log_shares(proposals: Sequence[ProposalComponent], z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "modes n"]:
    """Return the log density of each proposal, times its share."""
    return np.stack([np.log(one.share) + _log_proposal(one, z) for one in proposals])


def _log_proposal(proposal: ProposalComponent, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    steps = _steps(proposal, z)
    plain, wide = _log_steps(proposal, steps), _log_steps(proposal, steps, WIDE_SCALE)
    log_density = np.logaddexp(np.log(1.0 - WIDE_SHARE) + plain, np.log(WIDE_SHARE) + wide)
    volume = np.sum(np.log(np.diag(_order(proposal)[1])))
    return log_density - volume + log_slopes(z, proposal.edges).sum(1)


def _log_steps(
    proposal: ProposalComponent, steps: Float[np.ndarray, "d n"], scale: float = 1.0
) -> Float[np.ndarray, " n"]:
    """Return the log density of steps, those of what leans each cut at its bounds."""
    leaning, d = proposal.leaning.size, proposal.centre.size
    log_density = _log_student(np.sum(steps[leaning:] ** 2, 0), d - leaning, scale)
    for row in range(leaning):
        begin, end = (scipy.special.stdtr(FREEDOM, limit / scale) for limit in _limits(proposal, steps, row))
        log_density += _log_student(steps[row] ** 2, 1, scale) - np.log(end - begin)
    return log_density


def _log_student(square: Float[np.ndarray, " n"], d: int, scale: float = 1.0) -> Float[np.ndarray, " n"]:
    """Return the log density of t_8 in d dimensions at squared distances from its centre."""
    power = 0.5 * (FREEDOM + d)
    constant = (
        scipy.special.gammaln(power)
        - scipy.special.gammaln(0.5 * FREEDOM)
        - 0.5 * d * np.log(FREEDOM * np.pi)
        - d * np.log(scale)
    )
    return constant - power * np.log1p(square / (FREEDOM * scale**2))


def _log_sum(x: np.ndarray) -> float:
    return float(scipy.special.logsumexp(x))
