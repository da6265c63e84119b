"""Posterior over structures too many to visit, by Markov chains over them: the sampled sibling of `all_subsets`.

    inclusion of a term:  mean over the moves that drew it of its probability given the other terms (Rao and Blackwell)
    the same again:       from the evidences of all structures evaluated, as if there were no others (renormalised)
    total:                log sum_S P(S) p(y | S) = log sum_{S in A} P(S) p(y | S) - log (share of visits in A)

A are the structures evaluated in the first half of the run, the visits those of the second (George and McCulloch, Statistica
Sinica 7, 1997). Renormalised probabilities are off by at most the probability of what was not evaluated. Standard errors are from
the spread of chains, which start apart; of inclusion, not below what the two ways differ by and cannot blame on the rest.
What the chains see, every structure evaluated excepted, is seen on the cold rungs of their ladders.
Where the best structures hold nearly everything, all averages are over them by their evidences, and off by the rest.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.selection.rule_masks import MAX_TERMS, RuleMasks, bits, count_allowed, no_structure
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.average import MonteCarlo, SubsetPosterior
from seatrial.selection.subsets.conjugate import Prior, evidence_of
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.problem import (
    MOST_OPTIONAL,
    Candidates,
    Problem,
    averages,
    check_candidates,
    make_problem,
)
from seatrial.selection.subsets.structure_chains import (
    REFRESH_MOVES,
    Chains,
    make_units,
    rungs_between,
    some_starts,
)

# Of the presence of a term, which is 0 or 1; chains that sit in different modes have 1.4 and more.
MAX_PRESENCE_R_HAT = 1.05
# Probability that these best structures must hold together for averages over them to stand for all.
MIN_HELD_PROBABILITY, BEST_COUNT = 0.99, 4096
MIN_LADDERS = 8  # Chains at least where each has a ladder
LOOK_INTERVAL = 5  # Moves between two looks at the coefficients


class StructureSums(NamedTuple):
    """Weighted sums over structures, of k optional terms, in scaled columns.

    Attributes:
        pairs: weight of both of each two terms, shape (k, k).
        moment: sum of w z z^T, z the posterior means and -1, shape (k+1, k+1).
        spread: sum of w corner A_S^-1, shape (k, k).
        corner: sum of w corner, shape (1,).
    """

    pairs: np.ndarray
    moment: np.ndarray
    spread: np.ndarray
    corner: np.ndarray


class Visits(NamedTuple):
    """What the chains saw after warm-up, of k optional terms in u units.

    Attributes:
        presence: visits with each term, for each half of each chain, shape (2, chains, k).
        chance: sum of each unit's probability of being there given the rest, shape (chains, u+1).
        draws: moves that drew each unit, shape (chains, u+1).
        mean: sum of posterior means, scaled, shape (chains, k).
        sums: over the looks.
        inside: visits in the second half to structures evaluated before it, shape (chains,).
    """

    presence: np.ndarray
    chance: np.ndarray
    draws: np.ndarray
    mean: np.ndarray
    sums: StructureSums
    inside: np.ndarray


class Evaluated(NamedTuple):
    """Different structures, in order of number, and their log P(S) p(y | S)."""

    codes: UInt64[np.ndarray, " n"]
    scores: Float[np.ndarray, " n"]


def subset_posterior(stats: Gram, prior: Prior, names: Sequence[str], **options: Any) -> SubsetPosterior:
    """Return the posterior over all structures: exact up to 25 optional terms, sampled beyond.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms.
        options: `always`, `rules`, `log_prior` and `top` as of `all_subsets`; `threads` counts where it is exact, and `seed`,
            `chains` and `moves`, as of `sample_subsets`, where it is sampled.

    Raises:
        InputError, NumericalError: as these.
    """
    free = [name for name in names if name not in options.get("always", ())]
    exact = len(free) <= MOST_OPTIONAL and len(names) <= MAX_TERMS
    other = ("seed", "chains", "moves") if exact else ("threads",)
    options = {option: value for option, value in options.items() if option not in other}
    return (all_subsets if exact else sample_subsets)(stats, prior, names, **options)


def sample_subsets(
    stats: Gram,
    prior: Prior,
    names: Sequence[str],
    *,
    always: Sequence[str] = (),
    rules: RuleMasks | None = None,
    log_prior: Float[np.ndarray, " k1"] | None = None,
    top: int = 1000,
    seed: int = 0,
    chains: int = 64,
    moves: int = 2000,
) -> SubsetPosterior:
    """Return the probabilities of structures, and averages over them, with Monte Carlo errors in `monte_carlo`.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms, one for each column, at most 63.
        always: terms in every structure.
        rules: which structures are allowed, over `names`; all, if not given.
        log_prior: of a structure by its number of optional terms, as of `log_prior_by_size`; all structures alike, if not given.
        top: how many of the best structures to keep.
        seed: of the random numbers.
        chains: walkers in step, which start apart; where evidences lie far apart, they are shared out over ladders of temperatures, of
            which each is one chain.
        moves: of each chain, the first quarter of them warm-up.

    Raises:
        InputError: as `all_subsets`.
        NumericalError: as `all_subsets`.
    """
    rules = rules or RuleMasks()
    candidates = check_candidates(stats, names, always)
    certain, _ = rules.links(len(candidates.names)).decided(int(candidates.certain))
    if not rules.allowed(np.array([certain], np.uint64))[0]:
        raise no_structure()
    evidence_of(stats, prior, range(len(candidates.names)))  # of all structures this one leaves the least noise
    problem = make_problem(stats, prior, candidates.sure, candidates.free, log_prior)
    units, random = make_units(rules, candidates.free, problem, len(candidates.names)), np.random.default_rng(seed)
    starts = some_starts(units, certain, rules, chains, random)
    scores = Chains(problem, units, candidates.free, rules, starts, chains, random).move().scores
    rungs = rungs_between(float(scores[scores > -np.inf].min()), float(scores.max()))
    chains = chains if rungs == 1 else max(chains // rungs, MIN_LADDERS)
    starts = some_starts(units, certain, rules, chains * rungs, random)
    walkers = Chains(problem, units, candidates.free, rules, starts, chains, random)
    seen, before, evaluated = walk(walkers, units.mask.size, moves)

    log_total = float(np.logaddexp.reduce(before.scores)) - log_share_inside(seen.inside, moves)
    owner = np.array(
        [int(np.flatnonzero((units.members[:-1] == column).any(1))[0]) for column in range(len(candidates.free))]
    )
    ranked = np.lexsort((evaluated.codes, -evaluated.scores))
    best, most = ranked[:top], ranked[:BEST_COUNT]
    # The log evidences of some structures by themselves.
    is_present = bits(evaluated.codes[best], len(candidates.names)).T.astype(bool)
    log_evidence = np.array(
        [evidence_of(stats, prior, np.flatnonzero(row).tolist()).log_evidence for row in is_present]
    )
    log_weight = log_evidence
    if problem.log_prior is not None:
        log_weight = log_evidence + problem.log_prior[is_present[:, candidates.free].sum(1)]
    renormalised = np.ones(len(candidates.names))
    weight = np.exp(evaluated.scores - np.logaddexp.reduce(evaluated.scores))
    for term in candidates.free:
        renormalised[term] = weight[evaluated.codes >> np.uint64(term) & np.uint64(1) == 1].sum()
    covered = min(float(np.exp(np.logaddexp.reduce(evaluated.scores) - log_total)), 1.0)
    held = min(covered * float(weight[most].sum()), 1.0)
    result = _by_visits(candidates, problem, seen, owner, moves)
    errors = result.pop("errors")
    if held >= MIN_HELD_PROBABILITY:
        listed = Chains(problem, units, candidates.free, rules, evaluated.codes[most], most.size, random)
        share = weight[most] / weight[most].sum()
        result = _averaged(candidates, problem, sums_over(listed.matrix, listed.present().astype(float), share))
        errors["inclusion_error"] = np.full(len(candidates.names), 1 - held)
        errors["mean_error"] = (1 - held) * np.sqrt(np.diag(result["within"] + result["between"]) + result["mean"] ** 2)
        status = ""
    else:
        status = _status(candidates.names, result["inclusion"], renormalised, covered, errors)
        # chains that have hardly seen a rare structure agree too well: the evidences know of it
        unexplained = np.maximum(np.abs(result["inclusion"] - renormalised) - (1 - covered), 0.0)
        errors["inclusion_error"] = np.hypot(errors["inclusion_error"], unexplained)
    return SubsetPosterior(
        names=candidates.names,
        structures=evaluated.codes[best],
        log_evidence=log_evidence,
        probability=np.exp(log_weight - log_total),
        count=count_allowed(rules, candidates.sure, len(candidates.names)),
        monte_carlo=MonteCarlo(
            covered=covered,
            renormalised=renormalised,
            status=status,
            **errors,
        ),
        **result,
    )


def walk(walkers: Chains, n_units: int, moves: int) -> tuple[Visits, Evaluated, Evaluated]:
    """Let the chains walk, and give what they saw, what was evaluated in the first half, and what in all.

    Args:
        walkers: at their starts.
        n_units: number of units, that of nobody included.
        moves: of each chain, the first quarter of them warm-up.
    """
    chains, k = walkers.cold.size, walkers.matrix.shape[1] - 1
    warmup = moves // 4
    half = half_of(moves)
    seen = Visits(
        presence=np.zeros((2, chains, k)),
        chance=np.zeros((chains, n_units)),
        draws=np.zeros((chains, n_units)),
        mean=np.zeros((chains, k)),
        sums=StructureSums(np.zeros((k, k)), np.zeros((k + 1, k + 1)), np.zeros((k, k)), np.zeros(1)),
        inside=np.zeros(chains),
    )
    result, fresh = Evaluated(np.empty(0, np.uint64), np.empty(0)), []
    before, at = result, np.arange(chains)[:, None]
    visits = []
    for now in range(moves):
        move = walkers.move()
        fresh.append((move.codes, move.scores))
        if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH_MOVES == 0:
            walkers.refresh()
            # Add structures, each once and only if it is allowed.
            codes = np.concatenate([result.codes, *(codes.ravel() for codes, _ in fresh)])
            scores = np.concatenate([result.scores, *(scores.ravel() for _, scores in fresh)])
            kept = scores > -np.inf
            codes, first = np.unique(codes[kept], return_index=True)
            result, fresh = Evaluated(codes, scores[kept][first]), []
        if now == half - 1:
            before = result
        if now < warmup:
            continue
        cold = walkers.cold
        is_present = walkers.present()[cold].astype(float)
        seen.presence[int(now >= half)] += is_present
        seen.chance[at, move.units] += move.chance
        seen.draws[at, move.units] += 1
        if now >= half:
            visits.append(walkers.codes[cold])
        if now % LOOK_INTERVAL == 0:
            _look(walkers, is_present, seen)
    seen.inside[:] = np.isin(np.array(visits), before.codes).sum(0)
    return seen, before, result


def sums_over(
    matrix: Float[np.ndarray, "n k1 k1"], is_present: Float[np.ndarray, "n k"], weight: Float[np.ndarray, " n"]
) -> StructureSums:
    """Return the sums over structures whose swept matrices and terms are given.

    Args:
        matrix: swept matrix of each structure, shape (n, k+1, k+1).
        is_present: whether each optional term is there, 0 or 1, shape (n, k).
        weight: of each structure, shape (n,).
    """
    z = np.column_stack([matrix[:, :-1, -1] * is_present, np.full(weight.size, -1.0)])
    corner = weight * matrix[:, -1, -1]
    covariance = matrix[:, :-1, :-1] * is_present[:, :, None] * is_present[:, None, :]
    return StructureSums(
        (weight * is_present.T) @ is_present,
        (weight * z.T) @ z,
        -np.tensordot(corner, covariance, 1),
        np.array([corner.sum()]),
    )


def log_share_inside(inside: Float[np.ndarray, " chains"], moves: int) -> float:
    """Return the log of the share of visits in the structures known before, which counts as one visit if there is none."""
    visits = (moves - half_of(moves)) * inside.size
    return float(np.log(max(float(inside.sum()), 1.0) / visits))


def half_of(moves: int) -> int:
    """Move at which the second half after warm-up begins."""
    return (moves + moves // 4) // 2


def presence_r_hat(presence: Float[np.ndarray, "2 chains k"], moves: int) -> Float[np.ndarray, " k"]:
    """R-hat of numbers that are 0 or 1, between the halves of all chains; 1 if nothing ever changed."""
    length = np.array([half_of(moves) - moves // 4, moves - half_of(moves)])[:, None, None]
    means = (presence / length).reshape(-1, presence.shape[2])
    within, between = (means * (1 - means)).mean(0), means.var(0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(between > 0, np.sqrt(1 + between / within), 1.0)


def _by_visits(candidates: Candidates, problem: Problem, seen: Visits, owner: np.ndarray, moves: int) -> dict[str, Any]:
    """Return the averages over the visits, in the order of the library, and their errors."""
    free, chains, d = candidates.free, seen.mean.shape[0], len(candidates.names)
    result, looks = _averaged(candidates, problem, seen.sums), seen.sums.moment[-1, -1]
    draws, chance = seen.draws[:, owner], seen.chance[:, owner]
    error, r_hat = np.zeros(d), np.ones(d)
    inclusion = result["inclusion"]
    inclusion[free] = value = chance.sum(0) / draws.sum(0)
    error[free] = (chance - value * draws).std(0, ddof=1) / draws.mean(0) / np.sqrt(chains)
    r_hat[free] = presence_r_hat(seen.presence, moves)
    sure = candidates.sure
    result["joint"][np.ix_(sure, free)], result["joint"][np.ix_(free, sure)] = value, value[:, None]
    np.fill_diagonal(result["joint"], inclusion)
    up = np.vstack([problem.slope[:, :-1], np.eye(len(free))]) * problem.scale
    each = seen.mean * chains / looks @ up.T
    mean_error = (each.std(0, ddof=1) / np.sqrt(chains))[_library_order(candidates)]
    return {**result, "errors": {"inclusion_error": error, "r_hat": r_hat, "mean_error": mean_error}}


def _averaged(candidates: Candidates, problem: Problem, sums: StructureSums) -> dict[str, Any]:
    """Inclusion, coefficients and their covariances from weighted sums, in the order of the library."""
    sure, free, d = candidates.sure, candidates.free, len(candidates.names)
    share = sums.pairs / sums.moment[-1, -1]
    joint = np.ones((d, d))
    joint[np.ix_(free, free)] = share
    joint[np.ix_(sure, free)], joint[np.ix_(free, sure)] = np.diag(share), np.diag(share)[:, None]
    result, order = averages(problem, sums.moment, sums.spread, float(sums.corner[0])), _library_order(candidates)
    square = np.ix_(order, order)
    return {
        "inclusion": np.diag(joint).copy(),
        "joint": joint,
        "mean": result.mean[order],
        "within": result.within[square],
        "between": result.between[square],
    }


def _library_order(candidates: Candidates) -> np.ndarray:
    """Return where each term of the library stands among those always there and then the others."""
    return np.argsort([*candidates.sure, *candidates.free])


def _status(
    names: tuple[str, ...],
    inclusion: np.ndarray,
    renormalised: np.ndarray,
    covered: float,
    errors: dict[str, np.ndarray],
) -> str:
    """Return what is wrong, in words."""
    messages = []
    apart = errors["r_hat"] > MAX_PRESENCE_R_HAT
    if apart.any():
        messages.append(
            f"the chains disagree about {_listed(names, apart)} (R-hat {errors['r_hat'].max():.2f}, at most {MAX_PRESENCE_R_HAT}): let "
            f"them make more moves. If they still disagree, some terms can replace others, which single moves do not find"
        )
    # what was not evaluated may change the renormalised probabilities by its own probability
    odd = np.abs(inclusion - renormalised) > 5 * errors["inclusion_error"] + (1 - covered) + 0.01
    if odd.any():
        messages.append(
            f"the probabilities of {_listed(names, odd)} by visits and by evidences differ by up to "
            f"{np.abs(inclusion - renormalised)[odd].max():.3f}, more than errors explain: make more moves"
        )
    return "; ".join(messages)


def _listed(names: tuple[str, ...], which: np.ndarray) -> str:
    return ", ".join(name for name, yes in zip(names, which, strict=True) if yes)


def _look(walkers: Chains, is_present: np.ndarray, seen: Visits) -> None:
    """Add the coefficients where the chains are."""
    matrix = walkers.matrix[walkers.cold]
    seen.mean[:] += matrix[:, :-1, -1] * is_present
    for total, part in zip(seen.sums, sums_over(matrix, is_present, np.ones(len(is_present))), strict=True):
        total[:] += part
