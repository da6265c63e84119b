"""Posterior over structures too many to visit, by Markov chains over them: the sampled sibling of `all_subsets`.

    inclusion of a term:  mean over the moves that drew it of its probability given the other terms (Rao and Blackwell)
    the same again:       from the evidences of all structures evaluated, as if there were no others (renormalised)
    total:                log p = log sum_{S in A} P(S) p(y | S) - log (share of visits in A)

A are the structures evaluated in the first half of the run, the visits those of the second (George and McCulloch, Statistica
Sinica 7, 1997). Renormalised probabilities are off by at most the probability of what was not evaluated. Standard errors are from
the spread of chains, which start apart; of inclusion, not below what the two ways differ by and cannot blame on the rest.
Where the best structures hold nearly everything, all averages are over them by their evidences, and off by the rest.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.average import MonteCarlo, SubsetPosterior
from seatrial.selection.subsets.chain_statistics import Seen, Sums, presence_r_hat, share_inside, sums_over, walk
from seatrial.selection.subsets.conjugate import evidence_of
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.prior import Prior
from seatrial.selection.subsets.prior_mass import allowed_mass, closure, wanted_by
from seatrial.selection.subsets.problem import Problem, averages, make_problem
from seatrial.selection.subsets.rules import MOST_TERMS, Rules, bits, no_structure
from seatrial.selection.subsets.structure_chains import Chains, RuleArrays, make_units, rungs_between, some_starts
from seatrial.selection.subsets.subset_problem import MOST_OPTIONAL, Question, check_question

MAX_R_HAT = 1.05
"""Of the presence of a term, which is 0 or 1; chains that sit in different modes have 1.4 and more."""
HELD, BEST = 0.99, 4096
"""Probability that these best structures must hold together for averages over them to stand for all."""
LEAST_CHAINS, LEAST_MOVES = 4, 400
LEAST_LADDERS = 8
"""Chains at least where each has a ladder."""


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
        chains: walkers in step, which start apart; where evidences lie far apart, they are shared out over ladders of temperatures, of
            which each is one chain.
        moves: of each chain, the first quarter of them warm-up.

    Raises:
        InputError: as `all_subsets`, but for the number of optional terms; no optional term; too few chains or moves.
        NumericalError: as `all_subsets`.
    """
    rules = rules or Rules()
    question, chance = _question(stats, names, always, rules, inclusion, top)
    if chains < LEAST_CHAINS or moves < LEAST_MOVES:
        raise InputError(
            "sampling of structures",
            found=f"{chains} chains of {moves} moves",
            expected=f"at least {LEAST_CHAINS} chains of {LEAST_MOVES} moves",
            remedy="errors come from the spread of the chains: give more",
        )
    array = RuleArrays(rules, len(question.names))
    certain = closure(wanted_by(rules, len(question.names)), int(question.certain))
    if not array.allowed(np.array([certain], np.uint64))[0]:
        raise no_structure()
    evidence_of(stats, prior, range(len(question.names)))  # of all structures this one leaves the least noise
    problem = make_problem(stats, prior, question.sure, question.free, question.chance)
    units, random = make_units(rules, question.free, problem, len(question.names)), np.random.default_rng(seed)
    starts = some_starts(units, certain, array, chains, random)
    scores = Chains(problem, units, question.free, array, starts, chains, random).move().scores
    rungs = rungs_between(float(scores[scores > -np.inf].min()), float(scores.max()))
    chains = chains if rungs == 1 else max(chains // rungs, LEAST_LADDERS)
    starts = some_starts(units, certain, array, chains * rungs, random)
    walkers = Chains(problem, units, question.free, array, starts, chains, random)
    seen, before, evaluated = walk(walkers, units.mask.size, moves)

    count, mass = allowed_mass(rules, question.sure, chance.tolist())
    log_share, share_error = share_inside(seen.inside, moves)
    log_total = float(np.logaddexp.reduce(before.scores)) - log_share
    owner = np.array(
        [int(np.flatnonzero((units.members[:-1] == column).any(1))[0]) for column in range(len(question.free))]
    )
    ranked = np.lexsort((evaluated.codes, -evaluated.scores))
    best, most = ranked[:top], ranked[:BEST]
    log_evidence, log_chance = _exactly(stats, prior, question, chance, evaluated.codes[best])
    renormalised = np.ones(len(question.names))
    weight = np.exp(evaluated.scores - np.logaddexp.reduce(evaluated.scores))
    for term in question.free:
        renormalised[term] = weight[evaluated.codes >> np.uint64(term) & np.uint64(1) == 1].sum()
    covered = min(float(np.exp(np.logaddexp.reduce(evaluated.scores) - log_total)), 1.0)
    held = min(covered * float(weight[most].sum()), 1.0)
    found = _by_visits(question, problem, seen, owner, moves)
    errors = found.pop("errors")
    if held >= HELD:
        listed = Chains(problem, units, question.free, array, evaluated.codes[most], most.size, random)
        share = weight[most] / weight[most].sum()
        found = _averaged(question, problem, sums_over(listed.matrix, listed.present().astype(float), share))
        errors["inclusion_error"] = np.full(len(question.names), 1 - held)
        errors["mean_error"] = (1 - held) * np.sqrt(np.diag(found["within"] + found["between"]) + found["mean"] ** 2)
        status = ""
    else:
        status = _status(question.names, found["inclusion"], renormalised, covered, errors)
        # chains that have hardly seen a rare structure agree too well: the evidences know of it
        unexplained = np.maximum(np.abs(found["inclusion"] - renormalised) - (1 - covered), 0.0)
        errors["inclusion_error"] = np.hypot(errors["inclusion_error"], unexplained)
    return SubsetPosterior(
        names=question.names,
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


def _question(
    stats: Gram,
    names: Sequence[str],
    always: Sequence[str],
    rules: Rules,
    inclusion: float | Sequence[float],
    top: int,
) -> tuple[Question, Float[np.ndarray, " d"]]:
    """The question, checked, and the prior probability of every term."""
    if len(names) > MOST_TERMS:
        raise InputError(
            "library of terms",
            found=f"{len(names)} terms",
            expected=f"at most {MOST_TERMS}, the bits of a number",
            remedy="drop some, or put one axis after the other to the question",
        )
    known = [name for name in names if name in always]
    whole = check_question(stats, names, [*always, *names], rules, inclusion, top)
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
    return Question(whole.names, sure, free, np.uint64(sum(1 << i for i in sure)), chance[free]), chance


def _exactly(
    stats: Gram, prior: Prior, question: Question, chance: np.ndarray, codes: np.ndarray
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Log evidences of some structures by themselves, and logs of their prior probabilities."""
    there = bits(codes, len(question.names)).T.astype(bool)
    logs = np.array([evidence_of(stats, prior, np.flatnonzero(row).tolist()).log_evidence for row in there])
    each = np.where(there, np.log(chance), np.log1p(-chance))
    return logs, each[:, question.free].sum(1)


def _by_visits(question: Question, problem: Problem, seen: Seen, owner: np.ndarray, moves: int) -> dict[str, Any]:
    """Averages over the visits, in the order of the library, and their errors."""
    free, chains, d = question.free, seen.mean.shape[0], len(question.names)
    found, looks = _averaged(question, problem, seen.sums), seen.sums.moment[-1, -1]
    draws, chance = seen.draws[:, owner], seen.chance[:, owner]
    error, r_hat = np.zeros(d), np.ones(d)
    inclusion = found["inclusion"]
    inclusion[free] = value = chance.sum(0) / draws.sum(0)
    error[free] = (chance - value * draws).std(0, ddof=1) / draws.mean(0) / np.sqrt(chains)
    r_hat[free] = presence_r_hat(seen.presence, moves)
    sure = question.sure
    found["joint"][np.ix_(sure, free)], found["joint"][np.ix_(free, sure)] = value, value[:, None]
    np.fill_diagonal(found["joint"], inclusion)
    up = np.vstack([problem.slope[:, :-1], np.eye(len(free))]) * problem.scale
    each = seen.mean * chains / looks @ up.T
    mean_error = (each.std(0, ddof=1) / np.sqrt(chains))[_library_order(question)]
    return {**found, "errors": {"inclusion_error": error, "r_hat": r_hat, "mean_error": mean_error}}


def _averaged(question: Question, problem: Problem, sums: Sums) -> dict[str, Any]:
    """Inclusion, coefficients and their covariances from weighted sums, in the order of the library."""
    sure, free, d = question.sure, question.free, len(question.names)
    share = sums.pairs / sums.moment[-1, -1]
    joint = np.ones((d, d))
    joint[np.ix_(free, free)] = share
    joint[np.ix_(sure, free)], joint[np.ix_(free, sure)] = np.diag(share), np.diag(share)[:, None]
    found, order = averages(problem, sums.moment, sums.spread, float(sums.corner[0])), _library_order(question)
    square = np.ix_(order, order)
    return {
        "inclusion": np.diag(joint).copy(),
        "joint": joint,
        "mean": found.mean[order],
        "within": found.within[square],
        "between": found.between[square],
    }


def _library_order(question: Question) -> np.ndarray:
    """Where each term of the library stands among those always there and then the others."""
    return np.argsort([*question.sure, *question.free])


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
