"""Posterior over all 2^k structures of a linear regression in closed form, none of them stored.

    P(S | y) ~ P(S) p(y | S) = exp(constant) D_S^-1/2 (2 b_S)^-a,  D_S the product of pivots that carry the priors, too

Terms always there are eliminated first. Of the others the first are doubled at once, into lanes; then blocks of lanes double
the last ones and keep sums only: the total, joint inclusion, moments of the coefficients, and the best structures seen.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.core.engine import cores
from seatrial.selection.subsets.average import SubsetPosterior
from seatrial.selection.subsets.best import Best
from seatrial.selection.subsets.conjugate import evidence_of
from seatrial.selection.subsets.doubling import Doubling
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.prior import Prior
from seatrial.selection.subsets.problem import Averages, Problem, averages, make_problem
from seatrial.selection.subsets.question import Question, check_question
from seatrial.selection.subsets.rules import Rules, bits, conditions, no_structure, spread
from seatrial.selection.subsets.sums import Block, Sums, add_block, no_sums

LEVELS, LANES = 10, 64
"""Doublings and lanes of a block: 65 536 structures, whose arrays fit the cache."""
NEGLIGIBLE = 40.0
"""Nats: a block is left out if all structures at its best would weigh exp(-40) of the best one of the first block."""


def all_subsets(
    stats: Gram,
    prior: Prior,
    names: Sequence[str],
    *,
    always: Sequence[str] = (),
    rules: Rules | None = None,
    inclusion: float | Sequence[float] = 0.5,
    top: int = 1000,
    threads: int | None = None,
) -> SubsetPosterior:
    """Probabilities of all structures, and averages over them.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise.
        names: of the terms, one for each column.
        always: terms in every structure.
        rules: which structures are allowed, over `names`; all, if not given.
        inclusion: prior probability that a term is there, before the rules; one for all, or one for each name.
        top: how many of the best structures to keep.
        threads: how many blocks at once; as many as there are cores, if not given.

    Raises:
        InputError: terms that the data cannot tell apart, too few data, too many optional terms, or rules that no structure keeps.
        NumericalError: a structure that leaves no noise, or numbers out of range.
    """
    question = check_question(stats, names, always, rules, inclusion, top)
    free, chance = question.free, question.chance
    evidence_of(stats, prior, range(len(question.names)))  # of all structures this one leaves the least noise
    problem, best = make_problem(stats, prior, question.sure, free, chance), Best(top)
    fixed = max(len(free) - LEVELS, 0)
    outer = Doubling(len(free) + 1, fixed, 1)
    matrix, determinant = outer.eliminate(
        problem.matrix[..., None], np.array([problem.start]), *_parts(problem, slice(fixed))
    )
    lane_terms = spread(np.arange(2**fixed), free[:fixed]) | question.certain
    block = Block(
        problem.shape,
        *_parts(problem, slice(fixed, None)),
        np.exp(_log_chance(np.arange(2 ** (len(free) - fixed)), chance[fixed:])),
        None if rules is None else conditions(rules, lane_terms, free[fixed:]),
        fixed,
    )
    lanes = min(LANES, 2**fixed)
    sums = no_sums(len(free) - fixed, 2**fixed, 2**fixed // lanes)

    def add(firsts: Iterable[int], negligible: float = -np.inf) -> None:
        tree = Doubling(len(free) - fixed + 1, len(free) - fixed, lanes)
        for first in firsts:
            add_block(block, tree, matrix, determinant, first, negligible, sums, best)

    *others, last = range(0, 2**fixed, lanes)
    add([last])
    floor = float(sums.peak[last]) - NEGLIGIBLE - len(free) * np.log(2)
    _share(lambda firsts: add(firsts, floor), others, threads)
    if not sums.allowed.any():
        raise no_structure()
    lane_chance = np.exp(_log_chance(np.arange(2**fixed), chance[:fixed]))
    log_mass = float(np.log(lane_chance @ sums.chance))
    found = _collect(question, problem, outer, sums.rescaled(), best, log_mass)
    return SubsetPosterior(stats=stats, prior=prior, **found)


def _collect(
    question: Question, problem: Problem, outer: Doubling, sums: Sums, best: Best, log_mass: float
) -> dict[str, Any]:
    """Put the sums of all lanes together; `log_mass` is of the prior probability of the allowed structures."""
    sure, free = question.sure, question.free
    log_total = problem.constant + float(sums.peak[0] + np.log(sums.weight.sum()))
    scores, codes = best.ranked()
    joint = np.ones((len(question.names),) * 2)
    joint[np.ix_(free, free)] = together = sums.joint()
    joint[np.ix_(sure, free)] = np.diag(together)
    joint[np.ix_(free, sure)] = np.diag(together)[:, None]
    return dict(
        names=question.names,
        structures=spread(codes, free) | question.certain,
        log_evidence=problem.constant + scores - _log_chance(codes, question.chance),
        probability=np.exp(problem.constant + scores - log_total),
        count=int(sums.allowed.sum()),
        log_evidence_total=log_total - log_mass,
        inclusion=np.diag(joint).copy(),
        joint=joint,
        **_averages(problem, outer, sums, np.argsort([*sure, *free]))._asdict(),
    )


def _averages(problem: Problem, outer: Doubling, sums: Sums, order: np.ndarray) -> Averages:
    """Moments of the coefficients from those of the lanes, in the order of the library."""
    moment = outer.gather_moments(sums.moment)[..., 0]
    spread, corner = outer.gather_spreads(sums.spread, sums.corner)
    found = averages(problem, moment, spread[..., 0], float(corner[0]))
    square = np.ix_(order, order)
    return Averages(found.mean[order], found.within[square], found.between[square])


def _parts(problem: Problem, terms: slice) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Pivots and squares of some terms."""
    return (
        None if problem.pivots is None else problem.pivots[terms],
        None if problem.squares is None else problem.squares[terms],
    )


def _log_chance(codes: np.ndarray, chance: Float[np.ndarray, " terms"]) -> Float[np.ndarray, " m"]:
    """Log of the prior probability of structures without rules."""
    there = bits(codes, chance.size)
    return np.log(chance) @ there + np.log1p(-chance) @ (1 - there)


def _share(work: Callable[[Iterable[int]], None], firsts: list[int], threads: int | None) -> None:
    """Let several threads take blocks from one list."""
    count, queue = min(threads or cores(), len(firsts)), iter(firsts)
    if count < 2:
        work(queue)
        return
    with ThreadPoolExecutor(count) as pool:
        for done in [pool.submit(work, queue) for _ in range(count)]:
            done.result()
