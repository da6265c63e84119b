"""Effects that a fitted model leaves out: which the data ask for, and by how much each would move the parameters.

A model may explain nearly all of its data and still be wrong: what it lacks hides in its coefficients. With residuals r and sensitivities J
over the noise, whitened where the noise is coloured or drifts, posterior covariance C, and the signature g of an effect that is left out,

    information = g' (I - J C J') g,  size = g' (I - J C J') r / information,  shift of the parameters = -C J' g size

(Rao, Proc. Camb. Phil. Soc. 44, 1948). Under a prior worth one sample the log odds that the effect is there are

    1/2 size^2 information w - 1/2 log(n w) - log m

(Schwarz, Annals of Statistics 6, 1978): n samples that are worth w n independent ones, and m effects that are looked for, one of which is
as probable as none. A force that other structures have is as probable as not and has a prior of its own, normal here: log c - log s takes
the place of the last two terms, c its standard deviation before the data and s after them, less what the size costs under it. While the
odds of the best are above one it is taken in, all are fitted again (`effect_fit`), and the others are looked at again. Noise
with a memory takes up a part of a missing effect and then hides it: effects are also looked for as if the noise had none, and its shape is
found anew in each fit. Which effects are there is not known: over all these fits s, each a normal density that counts by its odds, a
parameter lies within x of its value at the mode with the probability

    sum_s p_s [Phi((x - shift_s) / sd_s) - Phi((-x - shift_s) / sd_s)]

(model averaging: Hoeting et al., Statistical Science 14, 1999). The x of 90 %, over that of one normal density, is the second standard
deviation: where no effect is probable it is the first one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from seatrial.estimation.diagnostics.candidate_effects import Effect, candidate_effects
from seatrial.estimation.diagnostics.effect_fit import EffectProblem, Fit, fit_at, fit_effects, linearise, normal_prior
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors import Prior

# Shift of a coefficient, in standard deviations, and log odds from which a missing effect is reported: 20 to 1, strong
# evidence (Kass and Raftery, Journal of the American Statistical Association 90, 1995).
MIN_SHIFT, MIN_LOG_ODDS = 1.0, 3.0
MIN_VISIBLE_SHARE = 1e-4  # Share of a signature that the parameters must leave for it to be told from them
MAX_EFFECTS = 3  # Effects that are taken in at most
# Effects that are fitted to see which is best, those with the highest odds to first order, and their share of the
# highest log odds.
MAX_CONTENDERS, MIN_CONTENDER_SHARE = 3, 0.5
MAX_RIVAL_GAP = 3.0  # Difference of log odds up to which two effects do equally well
TINY = float(np.finfo(float).tiny)
# Probability below the upper end of a 90 % interval, and halvings by which that end is found.
BAND, BISECTIONS = 0.95, 50
# Effects that are named as a cause, at most, and their share of the probability that the first of them puts outside.
MAX_CAUSES, MIN_CAUSE_SHARE = 3, 0.5


class Omitted(NamedTuple):
    """One effect that the model lacks.

    Attributes:
        effect: which.
        size: its estimated size, in its own unit.
        sd: standard error of the size.
        log_odds: that it is there and not missing by chance.
        shift: by how much the parameters would move if it were added, over their standard deviations, shape (d,).
        alike: effects that would do nearly as well in its place.
    """

    effect: Effect
    size: float
    sd: float
    log_odds: float
    shift: Float[np.ndarray, " d"]
    alike: tuple[Effect, ...]


@dataclass(frozen=True)
class OmittedEffects:
    """What a fitted model leaves out.

    Attributes:
        found: effects of which the data say that they are there, in the order in which they were found.
        tried: all that were looked for; none where none can be.
        spread: second standard deviation over the first one, shape (d,).
        causes: of each parameter, the effects that put most probability beyond the first one; none where nothing was looked for.
        worth: share of the samples that the residuals are worth with what was found; 1 where they are white.
    """

    found: tuple[Omitted, ...]
    tried: tuple[Effect, ...]
    spread: Float[np.ndarray, " d"]
    causes: tuple[tuple[Effect, ...], ...]
    worth: float = 1.0


class Score(NamedTuple):
    """What one effect would do by itself, to first order.

    Attributes:
        size: estimated, in its own unit.
        information: about it, of samples that are independent.
        log_odds: that it is there.
        shift: of z, shape (d,).
        variance: by how much that of z grows with it, shape (d,).
    """

    size: float
    information: float
    log_odds: float
    shift: Float[np.ndarray, " d"]
    variance: Float[np.ndarray, " d"]


class _Member(NamedTuple):
    """One of the normal densities that are averaged: the effects in it, its log odds, and variance and shift of z, shape (d,)."""

    included: tuple[int, ...]
    log_odds: float
    variance: Float[np.ndarray, " d"]
    shift: Float[np.ndarray, " d"]


def omitted_effects(posterior: Posterior, mode: Mode) -> OmittedEffects:
    """Return what the data ask for and the model lacks, of `candidate_effects`, and what that does to its parameters.

    Args:
        posterior: of records; where its likelihood has process noise nothing is looked for.
        mode: of the posterior, all its parameters.
    """
    effects = tuple(candidate_effects(posterior)) if isinstance(posterior.likelihood, OutputError) else ()
    d, sd = posterior.dim, np.sqrt(np.diag(mode.cov))
    if not effects:
        return OmittedEffects((), (), np.ones(d), ((),) * d)
    problem = EffectProblem(posterior, mode, effects)
    fit = fit_at(problem, linearise(problem, mode.z, np.zeros(len(effects))))
    members, result = [_Member((), 0.0, sd**2, np.zeros(d))], {}

    def member(fit: Fit) -> _Member:
        return _Member(fit.included, fit.log_odds, fit.variance[:d], fit.at.z - mode.z)

    while True:
        scores = _scores(problem, fit)
        near = _contenders(scores)
        if problem.shapes:  # noise with a memory takes up a part of an effect, and then hides it
            near = list(dict.fromkeys([*near, *_contenders(_scores(problem, fit, as_white=True))]))
        if len(fit.included) == MAX_EFFECTS or not near:
            break
        fits = [fit_effects(problem, fit, (*fit.included, i)) for i in near]
        members += map(member, fits)
        best = max(fits, key=lambda one: one.log_odds)
        if best.log_odds <= fit.log_odds:
            scores = {i: one for i, one in scores.items() if i not in near}
            break
        rivals = [one for one in fits if one is not best and one.log_odds > best.log_odds - MAX_RIVAL_GAP]
        alike = tuple(effects[one.included[-1]] for one in rivals)
        result[best.included[-1]] = best.log_odds - fit.log_odds, (best.at.z - fit.at.z) / sd, alike
        fit = _without_spent(problem, best)
        if fit is not best:
            members.append(member(fit))
    own = member(fit)
    for i, one in scores.items():
        shift = fit.at.z + one.shift - mode.z
        members.append(_Member((*fit.included, i), fit.log_odds + one.log_odds, own.variance + one.variance, shift))
    errors = dict(zip(fit.included, np.sqrt(fit.variance[d:]), strict=True))
    omitted = tuple(
        Omitted(effects[i], float(fit.at.sizes[i]), float(errors[i]), float(log_odds), shift, alike)
        for i, (log_odds, shift, alike) in result.items()
        if i in errors
    )
    tried = tuple(effects[i] for i in np.flatnonzero(problem.absent))
    return OmittedEffects(omitted, tried, *_average(members, sd, effects), fit.at.worth)


def _contenders(scores: Mapping[int, Score]) -> list[int]:
    """Return the places of the effects that are worth a fit: with the highest odds, above one, to first order."""
    ranked = sorted(scores, key=lambda i: -scores[i].log_odds)[:MAX_CONTENDERS]
    return [i for i in ranked if scores[i].log_odds >= max(0.0, MIN_CONTENDER_SHARE * scores[ranked[0]].log_odds)]


def _scores(problem: EffectProblem, fit: Fit, as_white: bool = False) -> dict[int, Score]:
    """Return what each effect would do to first order, or what it would do if the noise had no memory."""
    if as_white:
        fit = fit_at(problem, linearise(problem, fit.at.z, fit.at.sizes, as_white=True), fit.included)
    scores = score_effects(fit, problem.priors)
    return {i: one for i, one in scores.items() if one.size > 0 or not problem.effects[i].is_positive}


def score_effects(fit: Fit, priors: Mapping[int, Prior] = {}) -> dict[int, Score]:
    """Return what each effect would do by itself; of those that no structure has, what the parameters can imitate entirely is left out.

    Args:
        fit: of the parameters, and the effects that are in it already.
        priors: of effects that are terms of other structures, by place.
    """
    at, d = fit.at, fit.at.z.size
    fitted = [*range(d), *(d + i for i in fit.included)]
    along, own = at.products[fitted, d:], np.diag(at.products)[d:]
    absorbed = fit.cov @ along
    information = own - (along * absorbed).sum(0)
    pull = at.pull[d:] - absorbed.T @ at.pull[fitted]
    scores = {}
    for i in range(own.size):
        stated, prior = float(information[i]), priors.get(i)
        if i in fit.included or not own[i] > 0 or (prior is None and not stated > MIN_VISIBLE_SHARE * own[i]):
            continue
        mean, before = (0.0, 0.0) if prior is None else normal_prior(prior, float(pull[i]) / max(stated, TINY))
        precision = max(stated, 0.0) * at.worth + before
        size = (float(pull[i]) * at.worth + mean * before) / precision
        gain = at.worth * (size * float(pull[i]) - 0.5 * size**2 * stated)
        log_odds = gain - at.penalty(size, 1.0 / precision, prior)
        scores[i] = Score(size, stated, log_odds, -absorbed[:d, i] * size, absorbed[:d, i] ** 2 / precision)
    return scores


def _without_spent(problem: EffectProblem, fit: Fit) -> Fit:
    """Return the fit without a lag, lead or delay that a later effect has taken the place of."""
    sizes, errors = fit.at.sizes, dict(zip(fit.included, np.sqrt(fit.variance[problem.posterior.dim :]), strict=True))
    for i in fit.included[:-1]:
        if problem.effects[i].is_positive and sizes[i] < errors[i]:
            less = fit_effects(problem, fit, tuple(j for j in fit.included if j != i))
            fit = less if less.log_odds >= fit.log_odds else fit
    return fit


def _average(
    members: Sequence[_Member], sd: Float[np.ndarray, " d"], effects: tuple[Effect, ...]
) -> tuple[Float[np.ndarray, " d"], tuple[tuple[Effect, ...], ...]]:
    """Return `spread` and `causes` of `OmittedEffects` of the average of normal densities, for the standard deviations without effects."""
    log_odds, variance, shift = (np.array([one[k] for one in members]) for k in (1, 2, 3))
    weight, shift, width = np.exp(log_odds - log_odds.max()), shift / sd, np.sqrt(variance) / sd
    spread = half_width(weight, shift, width) / ndtri(BAND)
    beyond = weight[:, None] * (1.0 - inside(ndtri(BAND), shift, width))
    blamed = np.array([beyond[[i in one.included for one in members]].sum(0) for i in range(len(effects))])
    causes = tuple(
        tuple(effects[i] for i in np.argsort(-one, kind="stable")[:MAX_CAUSES] if one[i] > MIN_CAUSE_SHARE * one.max())
        for one in blamed.T
    )
    return np.maximum(spread, 1.0), causes


def half_width(
    weight: Float[np.ndarray, " s"], shift: Float[np.ndarray, "s d"], sd: Float[np.ndarray, "s d"]
) -> Float[np.ndarray, " d"]:
    """Return how far from 0 each of d parameters lies with 90 % probability if its density is a mixture of s normal ones.

    Args:
        weight: of each density, not normalised.
        shift: their means.
        sd: their standard deviations.
    """
    share, low, high = weight / weight.sum(), np.zeros(shift.shape[1]), (np.abs(shift) + 4 * sd).max(0)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        held = share @ inside(middle, shift, sd)
        low, high = np.where(held < 2 * BAND - 1, middle, low), np.where(held < 2 * BAND - 1, high, middle)
    return high


def inside(
    half: Float[np.ndarray, " d"] | float, shift: Float[np.ndarray, "s d"], sd: Float[np.ndarray, "s d"]
) -> Float[np.ndarray, "s d"]:
    """Return the probability of s normal densities, of mean `shift`, within so much of 0."""
    return ndtr((half - shift) / sd) - ndtr((-half - shift) / sd)
