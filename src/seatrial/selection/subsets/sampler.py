"""Posterior over structures too many to visit, by Markov chains over them: the sampled sibling of `all_subsets`.

    inclusion of a term:  mean over the moves that drew it of its probability given the other terms (Rao and Blackwell)
    the same again:       from the evidences of all structures evaluated, as if there were no others (renormalised)
    total:                log p = log sum_{S in A} P(S) p(y | S) - log (share of visits in A)

A are the structures evaluated in the first half of the run, the visits those of the second (George and McCulloch, Statistica
Sinica 7, 1997). Renormalised probabilities are off by at most the probability of what was not evaluated. Standard errors are from
the spread of chains, which start apart; of inclusion, not below what the two ways differ by and cannot blame on the rest.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.core.errors import InputError
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.average import MonteCarlo, SubsetPosterior
from seatrial.selection.subsets.conjugate import evidence_of
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.library import MOST_OPTIONAL, Library, check_library
from seatrial.selection.subsets.prior import Prior
from seatrial.selection.subsets.prior_mass import allowed_mass, closure, wanted_by
from seatrial.selection.subsets.problem import Problem, averages, make_problem
from seatrial.selection.subsets.rules import MOST_TERMS, Rules, bits
from seatrial.selection.subsets.structure_chains import REFRESH, Chains, RuleArrays, make_units, some_starts

MAX_R_HAT = 1.05
"""Of the presence of a term, which is 0 or 1; chains that sit in different modes have 1.4 and more."""
EVERY = 5
"""Moves between two looks at the coefficients."""
LEAST_CHAINS, LEAST_MOVES = 4, 400


class _Seen(NamedTuple):
    """What the chains saw after warm-up, of k optional terms in u units.

    Attributes:
        presence: visits with each term, for each half of each chain, shape (2, chains, k).
        chance: sum of each unit's probability of being there given the rest, shape (chains, u+1).
        draws: moves that drew each unit, shape (chains, u+1).
        pairs: visits with both of each two terms, shape (k, k).
        mean: sum of posterior means, scaled, shape (chains, k).
        moment: sum of z z^T as `averages` wants it, shape (k+1, k+1).
        spread: sum of corner A_S^-1, shape (k, k).
        corner: sum of corners, shape (1,).
        inside: visits in the second half to structures evaluated before it, shape (chains,).
    """

    presence: np.ndarray
    chance: np.ndarray
    draws: np.ndarray
    pairs: np.ndarray
    mean: np.ndarray
    moment: np.ndarray
    spread: np.ndarray
    corner: np.ndarray
    inside: np.ndarray


class _Evaluated(NamedTuple):
    """Different structures, in order of number, and their log P(S) p(y | S)."""

    codes: UInt64[np.ndarray, " n"]
    scores: Float[np.ndarray, " n"]


def subset_posterior(stats: Gram, prior: Prior, names: Sequence[str], **options: Any) -> SubsetPosterior:
    """Posterior over all structures: exact up to 25 optional terms, sampled beyond.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms.
        options: `always`, `rules`, `inclusion` and `top` as of `all_subsets`; `threads` counts where it is exact, and `seed`,
            `chains` and `moves`, as of `sample_subsets`, where it is sampled.

    Raises:
        InputError, NumericalError: as these.
    """
    free = [name for name in names if name not in options.get("always", ())]
    exact = len(free) <= MOST_OPTIONAL and len(names) <= MOST_TERMS
    other = ("seed", "chains", "moves") if exact else ("threads",)
    options = {option: value for option, value in options.items() if option not in other}
    return (all_subsets if exact else sample_subsets)(stats, prior, names, **options)


def sample_subsets(
    stats: Gram,
    prior: Prior,
    names: Sequence[str],
    *,
    always: Sequence[str] = (),
    rules: Rules | None = None,
    inclusion: float | Sequence[float] = 0.5,
    top: int = 1000,
    seed: int = 0,
    chains: int = 64,
    moves: int = 2000,
) -> SubsetPosterior:
    """Probabilities of structures, and averages over them, with Monte Carlo errors in `monte_carlo`.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms, one for each column, at most 63.
        always: terms in every structure.
        rules: which structures are allowed, over `names`; all, if not given.
        inclusion: prior probability that a term is there, before the rules; one for all, or one for each name.
        top: how many of the best structures to keep.
        seed: of the random numbers.
        chains: chains in step, which start apart.
        moves: of each chain, the first quarter of them warm-up.

    Raises:
        InputError: as `all_subsets`, but for the number of optional terms; no optional term; too few chains or moves.
        NumericalError: as `all_subsets`.
    """
    rules = rules or Rules()
    library, chance = _library(stats, names, always, rules, inclusion, top)
    if chains < LEAST_CHAINS or moves < LEAST_MOVES:
        raise InputError(
            "sampling of structures",
            found=f"{chains} chains of {moves} moves",
            expected=f"at least {LEAST_CHAINS} chains of {LEAST_MOVES} moves",
            remedy="errors come from the spread of the chains: give more",
        )
    array = RuleArrays(rules, len(library.names))
    certain = closure(wanted_by(rules, len(library.names)), int(library.certain))
    if not array.allowed(np.array([certain], np.uint64))[0]:
        raise InputError(
            "rules of the structures",
            found="no structure that keeps them all",
            expected="at least one",
            remedy="look for an exclusion between a term and one that it wants, or between terms that are always there",
        )
    evidence_of(stats, prior, range(len(library.names)))  # of all structures this one leaves the least noise
    problem = make_problem(stats, prior, library.sure, library.free, library.chance)
    units, random = make_units(rules, library.free, problem, len(library.names)), np.random.default_rng(seed)
    starts = some_starts(units, certain, array, chains, random)
    walkers = Chains(problem, units, library.free, array, starts, random)
    seen, before, evaluated = _walk(walkers, units.mask.size, moves)

    count, mass = allowed_mass(rules, library.sure, chance.tolist())
    log_share, share_error = _share(seen.inside, moves)
    log_total = float(np.logaddexp.reduce(before.scores)) - log_share
    owner = np.array(
        [int(np.flatnonzero((units.members[:-1] == column).any(1))[0]) for column in range(len(library.free))]
    )
    best = np.lexsort((evaluated.codes, -evaluated.scores))[:top]
    log_evidence, log_chance = _exactly(stats, prior, library, chance, evaluated.codes[best])
    found = _collect(library, problem, seen, owner, moves)
    renormalised = np.ones(len(library.names))
    weight = np.exp(evaluated.scores - np.logaddexp.reduce(evaluated.scores))
    for term in library.free:
        renormalised[term] = weight[evaluated.codes >> np.uint64(term) & np.uint64(1) == 1].sum()
    covered = min(float(np.exp(np.logaddexp.reduce(evaluated.scores) - log_total)), 1.0)
    errors = found.pop("errors")
    status = _status(library.names, found["inclusion"], renormalised, covered, errors)
    # chains that have hardly seen a rare structure agree too well: the evidences know of it
    unexplained = np.maximum(np.abs(found["inclusion"] - renormalised) - (1 - covered), 0.0)
    errors["inclusion_error"] = np.hypot(errors["inclusion_error"], unexplained)
    return SubsetPosterior(
        names=library.names,
        stats=stats,
        prior=prior,
        structures=evaluated.codes[best],
        log_evidence=log_evidence,
        probability=np.exp(log_evidence + log_chance - log_total),
        count=count,
        log_evidence_total=log_total - float(np.log(mass)),
        monte_carlo=MonteCarlo(
            visits=chains * (moves - moves // 4),
            evaluated=evaluated.codes.size,
            covered=covered,
            renormalised=renormalised,
            log_evidence_total_error=share_error,
            status=status,
            **errors,
        ),
        **found,
    )


def _library(
    stats: Gram,
    names: Sequence[str],
    always: Sequence[str],
    rules: Rules,
    inclusion: float | Sequence[float],
    top: int,
) -> tuple[Library, Float[np.ndarray, " d"]]:
    """The question, checked, and the prior probability of every term."""
    if len(names) > MOST_TERMS:
        raise InputError(
            "library of terms",
            found=f"{len(names)} terms",
            expected=f"at most {MOST_TERMS}, the bits of a number",
            remedy="drop some, or put one axis after the other to the question",
        )
    known = [name for name in names if name in always]
    whole = check_library(stats, names, [*always, *names], rules, inclusion, top)
    free = [i for i, name in enumerate(whole.names) if name not in known]
    if not free:
        raise InputError(
            "library of terms",
            found="no optional term",
            expected="at least one",
            remedy="there is one structure only: `evidence_of` gives its evidence",
        )
    sure = [i for i, name in enumerate(whole.names) if name in known]
    chance = np.broadcast_to(np.asarray(inclusion, float), (len(whole.names),))
    return Library(whole.names, sure, free, np.uint64(sum(1 << i for i in sure)), chance[free]), chance


def _walk(walkers: Chains, n_units: int, moves: int) -> tuple[_Seen, _Evaluated, _Evaluated]:
    """Let the chains walk, and give what they saw, what was evaluated in the first half, and what in all."""
    chains, k = walkers.codes.size, walkers.matrix.shape[1] - 1
    warmup = moves // 4
    half = _half(moves)
    seen = _Seen(
        *(np.zeros(shape) for shape in ((2, chains, k), (chains, n_units), (chains, n_units), (k, k), (chains, k))),
        *(np.zeros(shape) for shape in ((k + 1, k + 1), (k, k), (1,), (chains,))),
    )
    found, fresh = _Evaluated(np.empty(0, np.uint64), np.empty(0)), []
    before, at = found, np.arange(chains)[:, None]
    visits = []
    for now in range(moves):
        move = walkers.move()
        fresh.append((move.codes, move.scores))
        if now == half - 1 or now == moves - 1 or (now + 1) % REFRESH == 0:
            walkers.refresh()
            found, fresh = _merge(found, fresh), []
        if now == half - 1:
            before = found
        if now < warmup:
            continue
        there = walkers.present().astype(float)
        seen.presence[int(now >= half)] += there
        seen.chance[at, move.units] += move.chance
        seen.draws[at, move.units] += 1
        if now >= half:
            visits.append(walkers.codes)
        if now % EVERY == 0:
            _look(walkers, there, seen)
    seen.inside[:] = np.isin(np.array(visits), before.codes).sum(0)
    return seen, before, found


def _look(walkers: Chains, there: np.ndarray, seen: _Seen) -> None:
    """Add the coefficients where the chains are."""
    mean = walkers.matrix[:, :-1, -1] * there
    z = np.column_stack([mean, np.full(mean.shape[0], -1.0)])
    corner = walkers.matrix[:, -1, -1]
    seen.pairs[:] += there.T @ there
    seen.mean[:] += mean
    seen.moment[:] += z.T @ z
    weighted = walkers.matrix[:, :-1, :-1] * there[:, :, None] * there[:, None, :]
    seen.spread[:] -= np.tensordot(corner, weighted, 1)
    seen.corner[:] += corner.sum()


def _merge(found: _Evaluated, fresh: list[tuple[np.ndarray, np.ndarray]]) -> _Evaluated:
    """Add structures, each once and only if it is allowed."""
    codes = np.concatenate([found.codes, *(codes.ravel() for codes, _ in fresh)])
    scores = np.concatenate([found.scores, *(scores.ravel() for _, scores in fresh)])
    kept = scores > -np.inf
    codes, first = np.unique(codes[kept], return_index=True)
    return _Evaluated(codes, scores[kept][first])


def _share(inside: Float[np.ndarray, " chains"], moves: int) -> tuple[float, float]:
    """Log of the share of visits in the structures known before, and its standard error."""
    visits = moves - _half(moves)
    share = inside / visits
    # no visit outside says only that there are fewer than about one in all visits
    least = 1.0 / (visits * inside.size)
    value = max(float(share.mean()), least)
    return float(np.log(value)), float(np.hypot(share.std(ddof=1) / np.sqrt(inside.size), least) / value)


def _exactly(
    stats: Gram, prior: Prior, library: Library, chance: np.ndarray, codes: np.ndarray
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Log evidences of some structures by themselves, and logs of their prior probabilities."""
    there = bits(codes, len(library.names)).T.astype(bool)
    logs = np.array([evidence_of(stats, prior, np.flatnonzero(row).tolist()).log_evidence for row in there])
    each = np.where(there, np.log(chance), np.log1p(-chance))
    return logs, each[:, library.free].sum(1)


def _collect(library: Library, problem: Problem, seen: _Seen, owner: np.ndarray, moves: int) -> dict[str, Any]:
    """Averages over the visits, in the order of the library, and their errors."""
    sure, free, chains = library.sure, library.free, seen.mean.shape[0]
    d, order = len(library.names), np.argsort([*library.sure, *library.free])
    looks = seen.moment[-1, -1]
    draws, chance = seen.draws[:, owner], seen.chance[:, owner]
    inclusion, error, r_hat = np.ones(d), np.zeros(d), np.ones(d)
    inclusion[free] = value = chance.sum(0) / draws.sum(0)
    error[free] = (chance - value * draws).std(0, ddof=1) / draws.mean(0) / np.sqrt(chains)
    r_hat[free] = _r_hat(seen.presence, moves)
    joint = np.ones((d, d))
    joint[np.ix_(free, free)] = seen.pairs / looks
    joint[np.ix_(sure, free)], joint[np.ix_(free, sure)] = value, value[:, None]
    np.fill_diagonal(joint, inclusion)
    found = averages(problem, seen.moment, seen.spread, float(seen.corner[0]))
    up = np.vstack([problem.slope[:, :-1], np.eye(len(free))]) * problem.scale
    each = seen.mean * chains / looks @ up.T
    square = np.ix_(order, order)
    return {
        "inclusion": inclusion,
        "joint": joint,
        "mean": found.mean[order],
        "within": found.within[square],
        "between": found.between[square],
        "errors": {
            "inclusion_error": error,
            "r_hat": r_hat,
            "mean_error": (each.std(0, ddof=1) / np.sqrt(chains))[order],
        },
    }


def _half(moves: int) -> int:
    """Move at which the second half after warm-up begins."""
    return (moves + moves // 4) // 2


def _r_hat(presence: Float[np.ndarray, "2 chains k"], moves: int) -> Float[np.ndarray, " k"]:
    """R-hat of numbers that are 0 or 1, between the halves of all chains; 1 where nothing ever changed."""
    length = np.array([_half(moves) - moves // 4, moves - _half(moves)])[:, None, None]
    means = (presence / length).reshape(-1, presence.shape[2])
    within, between = (means * (1 - means)).mean(0), means.var(0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(between > 0, np.sqrt(1 + between / within), 1.0)


def _status(
    names: tuple[str, ...],
    inclusion: np.ndarray,
    renormalised: np.ndarray,
    covered: float,
    errors: dict[str, np.ndarray],
) -> str:
    """What is wrong, in words."""
    said = []
    apart = errors["r_hat"] > MAX_R_HAT
    if apart.any():
        said.append(
            f"the chains disagree about {_listed(names, apart)} (R-hat {errors['r_hat'].max():.2f}, at most {MAX_R_HAT}): "
            "let them make more moves; if they still disagree, terms stand in for one another in ways that single moves miss"
        )
    # what was not evaluated may change the renormalised probabilities by its own probability
    odd = np.abs(inclusion - renormalised) > 5 * errors["inclusion_error"] + (1 - covered) + 0.01
    if odd.any():
        said.append(
            f"the probabilities of {_listed(names, odd)} by visits and by evidences differ by up to "
            f"{np.abs(inclusion - renormalised)[odd].max():.3f}, more than errors explain: make more moves"
        )
    return "; ".join(said)


def _listed(names: tuple[str, ...], which: np.ndarray) -> str:
    return ", ".join(name for name, yes in zip(names, which, strict=True) if yes)
