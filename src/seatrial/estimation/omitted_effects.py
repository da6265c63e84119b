"""Effects that a fitted model leaves out: which the data ask for, and by how much each would move the parameters.

A model may explain nearly all of its data and still be wrong: what it lacks hides in its coefficients. With residuals r and sensitivities J
over the noise, whitened where the noise is coloured or drifts, posterior covariance C, and the signature g of an effect that is left out,

    information = g' (I - J C J') g,  size = g' (I - J C J') r / information,  shift of the parameters = -C J' g size

(Rao, Proc. Camb. Phil. Soc. 44, 1948). Under a prior worth one sample the log odds that the effect is there are

    1/2 size^2 information w - 1/2 log(n w) - log m

(Schwarz, Annals of Statistics 6, 1978): n samples that are worth w n independent ones, and m effects that are looked for, one of which is
as probable as none. A force that other structures have is as probable as not and has a prior of its own, normal here: log c - log s takes
the place of the last two terms, c its standard deviation before the data and s after them, less what the size costs under it. While the
odds of the best are above one it is taken in, all are fitted anew by Gauss and Newton's method, and the others are looked at again. Noise
with a memory takes up a part of a missing effect and then hides it: effects are also looked for as if the noise had none, and its shape is
found anew in each fit. Which effects are there is not known: over all these fits s, each a normal density that counts by its odds, a
parameter lies within x of its value at the mode with the probability

    sum_s p_s [Phi((x - shift_s) / sd_s) - Phi((-x - shift_s) / sd_s)]

(model averaging: Hoeting et al., Statistical Science 14, 1999). The x of 90 %, over that of one normal density, is the second standard
deviation: where no effect is probable it is the first one.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr, ndtri

from seatrial.core.coefficients import CoefficientName, is_coefficient
from seatrial.core.programs import program
from seatrial.core.signals import ACTUAL, QUATERNION, RATES, signal_unit
from seatrial.estimation.delayed_control import delay_control
from seatrial.estimation.mode import Mode, expand_prior
from seatrial.estimation.output_error import OutputError
from seatrial.estimation.posterior import Posterior, values_of
from seatrial.estimation.prediction_scores import effective_samples, whiteness
from seatrial.estimation.priors import Prior, Uniform
from seatrial.estimation.sensor_errors import Sensor, correlation_name, drift_name, drift_time_name, noise_name
from seatrial.vehicles.model import VehicleModel, outside_force

SPEEDS = dict(zip("XYZKMN", RATES, strict=True))
"""Velocity along or about each axis."""
MOTIONS = {*RATES, "phi", "theta", "psi"}
"""Controls that are motions given as measured, and no commands."""
HIDDEN = 1e-4
"""Share of a signature that the parameters must leave for it to be told from them."""
LIKELY = 0.01
"""P-value of a test of whiteness from which residuals are taken for white."""
MOST, STEPS, HALVINGS = 3, 8, 4
"""Effects that are taken in at most; steps of a fit, and how often one that does not climb is halved."""
CONTENDERS, ALIKE = 3, 0.5
"""Effects that are fitted to see which is best, those with the highest odds to first order, and their share of the highest log odds."""
CLOSE = 3.0
"""Difference of log odds up to which two effects do equally well."""
ROUNDS, GRIDS, POINTS = 2, (3.0, 0.6), 11
"""How often the shape of a noise with a memory is found anew for a fit; half widths of the grids on which it is, in units of z, and points
along each side."""
SETTLED = 1e-2
"""Gain of a step, nats, below which a fit has ended."""
TINY = float(np.finfo(float).tiny)
SINGULAR = 1e-10
"""Share of the largest eigenvalue of a scaled curvature below which a direction is not told."""
BAND, BISECTIONS = 0.95, 50
"""Probability below the upper end of a 90 % interval, and halvings by which that end is found."""
NAMED, BLAMED = 3, 0.5
"""Effects that are named as a cause, at most, and their share of the probability that the first of them puts outside."""
COUPLED = ("tau_", "delta_")
"""How controls begin that may act on other axes than the model has them on: generalised forces, which may act off the centre, and fins."""
SIDE_BY_SIDE = 8
"""Slopes that are computed at once: each needs a control of its own over the whole record."""
INSTANT = 1e-9
"""Lag that is none, s."""


@dataclass(frozen=True)
class Effect:
    """Something that a model may lack.

    Attributes:
        kind: a force of the vehicle, an error of a command or of a sensor, or a start that is not known; a command leads that acts
            before its stamps, such as one that was measured while it changed and is taken as held.
        of: coefficient of the force, control, measured channel or state; empty for the delay of all commands.
        unit: of its size, SI.
    """

    kind: Literal["force", "command offset", "command lag", "command lead", "delay", "sensor offset", "start"]
    of: str
    unit: str

    @property
    def is_positive(self) -> bool:
        """Whether its size cannot be below zero."""
        return self.kind in ("delay", "command lag", "command lead")


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
        sought: how many were looked for; 0 where none can be.
        spread: second standard deviation over the first one, shape (d,).
        causes: of each parameter, the effects that put most probability beyond the first one; none where nothing was looked for.
        worth: share of the samples that the residuals are worth with what was found; 1 where they are white.
    """

    found: tuple[Omitted, ...]
    sought: int
    spread: Float[np.ndarray, " d"]
    causes: tuple[tuple[Effect, ...], ...]
    worth: float = 1.0


class Linear(NamedTuple):
    """What was measured beside what is shown, over the noise, at one point, and how it changes with z and with each effect.

    Sums over all samples say all of it: by length, the columns would be most of what a fit keeps in memory.

    Attributes:
        dim: number of components of z, d.
        products: sums of products of the slopes of what is shown along z and along the size of each of m effects, 0 for those that the
            structure has, shape (d + m, d + m).
        pull: sums of their products with what was measured less shown, shape (d + m,).
        count: samples.
        worth: share of them that these residuals are worth where they are correlated.
        log_noise: sum over samples of the log of the residuals' standard deviation in their channel.
    """

    dim: int
    products: Float[np.ndarray, "dm dm"]
    pull: Float[np.ndarray, " dm"]
    count: int
    worth: float
    log_noise: float

    def price(self, size: float, variance: float, option: Prior | None = None) -> float:
        """Return what one more effect has to gain, nats.

        Args:
            size: of the effect.
            variance: of its size after the data.
            option: its prior where other structures have it; None for one that no structure has.
        """
        if option is None:
            sought = np.count_nonzero(np.diag(self.products)[self.dim :])
            return 0.5 * float(np.log(max(self.count * self.worth, 2.0))) + float(np.log(max(sought, 1)))
        middle, precision = _about(option, size)
        if isinstance(
            option, Uniform
        ):  # its density is that of a normal one a third of a nat below the peak, everywhere
            return 0.5 * float(np.log(6 / np.pi / min(variance * precision, 1.0)))
        return 0.5 * ((size - middle) ** 2 * precision - float(np.log(min(variance * precision, 1.0))))


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


class _Problem(NamedTuple):
    """What is searched: a posterior, and the effects that are looked for."""

    posterior: Posterior
    effects: tuple[Effect, ...]

    @property
    def options(self) -> dict[int, Prior]:
        """Priors of the effects that are terms of other structures, by place."""
        known = {one.name: one.prior for one in self.posterior.parameters}
        forces = {i: one.of for i, one in enumerate(self.effects) if one.kind == "force"}
        return {i: known[of] for i, of in forces.items() if of in known and of not in self.posterior.present_names}

    @property
    def shapes(self) -> list[tuple[int, Sensor, list[int]]]:
        """Each sensor of noise with a memory: its channel's place, itself, and the places in z of what its noise has beside its size."""
        names, found = self.posterior.names, []
        for i, sensor in enumerate(self.posterior.likelihood.simulator.sensors):
            if sensor.noise in ("coloured", "drifting"):
                found.append((i, sensor, [names.index(one) for one in sensor.noise_parameters[1:]]))
        return found


class _Fit(NamedTuple):
    """The parameters and some effects fitted together.

    Attributes:
        z: parameters, shape (d,).
        sizes: of every effect, 0 for those that are not taken in, shape (m,).
        taken: places of those that are, k of them.
        cov: of z and then of their sizes, as if all samples were independent, shape (d + k, d + k).
        log_odds: against the model without any.
        at: what is linear about it.
    """

    z: np.ndarray
    sizes: np.ndarray
    taken: tuple[int, ...]
    cov: np.ndarray
    log_odds: float
    at: Linear

    def price(self, place: int, problem: _Problem) -> float:
        """Return what an effect that is taken in has to gain, nats."""
        k = self.z.size + self.taken.index(place)
        return self.at.price(self.sizes[place], self.cov[k, k] / self.at.worth, problem.options.get(place))

    @property
    def variance(self) -> np.ndarray:
        """Of z and the sizes, of as many samples as the residuals are worth, shape (d + k,); of the model itself, as it states it."""
        return np.diag(self.cov) / (self.at.worth if self.taken else 1.0)


def omitted_effects(posterior: Posterior, mode: Mode) -> OmittedEffects:
    """Return what the data ask for and the model lacks, and what that does to its parameters.

    Looked for are forces along each axis (constant, linear, quadratic and cubic in its own velocity, linear in a control that drives other
    axes, and terms that other structures of the posterior have), offset, lag and lead of each command, a common delay, offsets of the
    sensors and starts, as far as the model has none.

    Args:
        posterior: of records; where its likelihood has process noise nothing is looked for.
        mode: of the posterior, all its parameters.
    """
    effects = tuple(_candidates(posterior)) if isinstance(posterior.likelihood, OutputError) else ()
    if not effects:
        return OmittedEffects((), 0, np.ones(posterior.dim), ((),) * posterior.dim)
    problem, none = _Problem(posterior, effects), np.zeros(len(effects))
    sd = np.sqrt(np.diag(mode.cov))
    at = _linear(problem, mode.z, none)
    fit = _Fit(mode.z, none, (), _covariance(problem, mode.z, none, (), at, np.diag(mode.cov)), 0.0, at)
    tried, within, found = [(0.0, sd**2, np.zeros(posterior.dim))], [()], []
    while True:
        scores = _scores(problem, fit)
        near = _contenders(scores)
        if problem.shapes:  # noise with a memory takes up a part of an effect, and then hides it
            near = list(dict.fromkeys([*near, *_contenders(_scores(problem, fit, as_white=True))]))
        if len(fit.taken) == MOST or not near:
            break
        fits = [_fitted(problem, fit, (*fit.taken, i)) for i in near]
        tried += [(one.log_odds, one.variance[: posterior.dim], one.z - mode.z) for one in fits]
        within += [one.taken for one in fits]
        best = max(fits, key=lambda one: one.log_odds)
        if best.log_odds <= fit.log_odds:
            scores = {i: one for i, one in scores.items() if i not in near}
            break
        rivals = [one.taken[-1] for one in fits if one is not best and one.log_odds > best.log_odds - CLOSE]
        alike = tuple(effects[i] for i in rivals)
        found.append((best.taken[-1], best.log_odds - fit.log_odds, (best.z - fit.z) / sd, alike))
        fit = _without_spent(problem, best)
        if fit is not best:
            tried.append((fit.log_odds, fit.variance[: posterior.dim], fit.z - mode.z))
            within.append(fit.taken)
    own = fit.variance[: posterior.dim]
    tried += [(fit.log_odds + one.log_odds, own + one.variance, fit.z + one.shift - mode.z) for one in scores.values()]
    within += [(*fit.taken, i) for i in scores]
    log_odds, variance, shift = map(np.array, zip(*tried, strict=True))
    weight, shift, width = np.exp(log_odds - log_odds.max()), shift / sd, np.sqrt(variance) / sd
    spread = half_width(weight, shift, width) / ndtri(BAND)
    beyond = weight[:, None] * (1.0 - inside(ndtri(BAND), shift, width))
    blamed = np.array([beyond[[i in taken for taken in within]].sum(0) for i in range(len(effects))])
    errors = dict(zip(fit.taken, np.sqrt(fit.variance[posterior.dim :]), strict=True))
    omitted = [
        Omitted(effects[i], float(fit.sizes[i]), float(errors[i]), float(odds), shift, alike)
        for i, odds, shift, alike in found
        if i in errors
    ]
    causes = tuple(
        tuple(effects[i] for i in np.argsort(-one, kind="stable")[:NAMED] if one[i] > BLAMED * one.max())
        for one in blamed.T
    )
    sought = int(_absent(posterior, effects).sum())
    return OmittedEffects(tuple(omitted), sought, np.maximum(spread, 1.0), causes, fit.at.worth)


def _contenders(scores: Mapping[int, Score]) -> list[int]:
    """Return the places of the effects that are worth a fit: with the highest odds, above one, to first order."""
    ranked = sorted(scores, key=lambda i: -scores[i].log_odds)[:CONTENDERS]
    return [i for i in ranked if scores[i].log_odds >= max(0.0, ALIKE * scores[ranked[0]].log_odds)]


def _scores(problem: _Problem, fit: _Fit, as_white: bool = False) -> dict[int, Score]:
    """Return what each effect would do to first order, or what it would do if the noise had no memory."""
    at, cov = fit.at, fit.cov
    if as_white:
        at = _linear(problem, fit.z, fit.sizes, as_white=True)
        cov = _covariance(problem, fit.z, fit.sizes, fit.taken, at, np.diag(fit.cov)[: fit.z.size])
    scores = score_effects(at, cov, fit.taken, problem.options)
    return {i: one for i, one in scores.items() if one.size > 0 or not problem.effects[i].is_positive}


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


def score_effects(
    at: Linear,
    cov: Float[np.ndarray, "dk dk"],
    taken: tuple[int, ...] = (),
    options: Mapping[int, Prior] = {},
) -> dict[int, Score]:
    """Return what each effect would do by itself; of those that no structure has, what the parameters can imitate entirely is left out.

    Args:
        at: what is linear about a fit.
        cov: posterior covariance of z, and then of the effects that are in the fit.
        taken: places of these.
        options: priors of effects that are terms of other structures, by place.
    """
    d = at.dim
    fitted = [*range(d), *(d + i for i in taken)]
    along, own = at.products[fitted, d:], np.diag(at.products)[d:]
    absorbed = cov @ along
    information = own - (along * absorbed).sum(0)
    pull = at.pull[d:] - absorbed.T @ at.pull[fitted]
    scores = {}
    for i in range(own.size):
        told, option = float(information[i]), options.get(i)
        if i in taken or not own[i] > 0 or (option is None and not told > HIDDEN * own[i]):
            continue
        middle, before = (0.0, 0.0) if option is None else _about(option, float(pull[i]) / max(told, TINY))
        precision = max(told, 0.0) * at.worth + before
        size = (float(pull[i]) * at.worth + middle * before) / precision
        gain = at.worth * (size * float(pull[i]) - 0.5 * size**2 * told)
        log_odds = gain - at.price(size, 1.0 / precision, option)
        scores[i] = Score(size, told, log_odds, -absorbed[:d, i] * size, absorbed[:d, i] ** 2 / precision)
    return scores


def _fitted(problem: _Problem, before: _Fit, taken: tuple[int, ...]) -> _Fit:
    """Return the fit with one effect more or less, by Gauss and Newton's steps from the fit before, with the noise that is then left."""
    d, here = problem.posterior.dim, list(taken)
    moves = np.flatnonzero(np.diag(before.at.products)[:d])
    sizes = np.where(np.isin(np.arange(before.sizes.size), taken), before.sizes, 0.0)
    at = before.at if set(before.taken) <= set(taken) else _linear(problem, before.z, sizes)
    z, sizes, at = _climbed(problem, before.z, sizes, at, moves, here)
    for _ in range(ROUNDS * bool(problem.shapes)):
        z = _with_noise_left(problem, z, sizes)
        z, sizes, at = _climbed(problem, z, sizes, _linear(problem, z, sizes), moves, here)
    cov = _covariance(problem, z, sizes, taken, at, np.diag(before.cov)[:d])
    fit = _Fit(z, sizes, taken, cov, 0.0, at)
    paid = sum(fit.price(i, problem) for i in taken if i not in before.taken)
    paid -= sum(before.price(i, problem) for i in before.taken if i not in taken)
    return fit._replace(log_odds=before.log_odds + (before.at.log_noise - at.log_noise) * at.worth - paid)


def _without_spent(problem: _Problem, fit: _Fit) -> _Fit:
    """Return the fit without a lag, lead or delay that a later effect has taken the place of."""
    errors = np.sqrt(fit.variance[problem.posterior.dim :])
    spent = [
        i
        for i, error in zip(fit.taken[:-1], errors, strict=False)
        if problem.effects[i].is_positive and fit.sizes[i] < error
    ]
    for i in spent:
        less = _fitted(problem, fit, tuple(j for j in fit.taken if j != i))
        fit = less if less.log_odds >= fit.log_odds else fit
    return fit


def _covariance(
    problem: _Problem,
    z: np.ndarray,
    sizes: np.ndarray,
    taken: tuple[int, ...],
    at: Linear,
    still: Float[np.ndarray, " d"],
) -> Float[np.ndarray, "dk dk"]:
    """Return the covariance of all parameters and then of the effects that are taken in, as if all samples were independent.

    It is made of the very sums that say what an effect adds: of one that the parameters nearly imitate, the difference is all there is.

    Args:
        problem: what is searched.
        z: parameters.
        sizes: of the effects.
        taken: places of those that are in.
        at: what is linear about these.
        still: variances of the parameters that change nothing that is shown.
    """
    d, k, here = z.size, len(taken), list(taken)
    moves = np.flatnonzero(np.diag(at.products)[:d])
    fitted, among = np.r_[moves, d + np.array(here, int)], np.r_[moves, d + np.arange(k)]
    cov = np.diag(np.r_[still, np.zeros(k)])
    prior = _all_priors(problem, z, sizes, moves, here)
    cov[np.ix_(among, among)] = _inverse(at.products[np.ix_(fitted, fitted)], prior[2])
    return cov


def _climbed(
    problem: _Problem, z: np.ndarray, sizes: np.ndarray, at: Linear, moves: np.ndarray, here: list[int]
) -> tuple[np.ndarray, np.ndarray, Linear]:
    """Return parameters and sizes of effects where the density is highest, and what is linear there; the noise stays as it is shaped.

    Args:
        problem: what is searched.
        z: parameters to begin from.
        sizes: of the effects to begin from.
        at: what is linear there.
        moves: places of the parameters that change what is shown.
        here: places of the effects that are fitted.
    """
    fitted = np.r_[moves, z.size + np.array(here)]
    lowest = np.where([problem.effects[i].is_positive for i in here], 0.0, -np.inf)
    for _ in range(STEPS):
        prior = _all_priors(problem, z, sizes, moves, here)
        height = prior[0].sum() - at.log_noise
        uphill = at.pull[fitted] + prior[1]
        step = _inverse(at.products[np.ix_(fitted, fitted)], prior[2]) @ uphill
        for share in 0.5 ** np.arange(HALVINGS):
            tried, new = z.copy(), sizes.copy()
            tried[moves] += share * step[: moves.size]
            new[here] = np.maximum(sizes[here] + share * step[moves.size :], lowest)
            near = _linear(problem, tried, new)
            gain = _all_priors(problem, tried, new, moves, here)[0].sum() - near.log_noise - height
            if gain > 0:
                break
        else:
            break
        z, sizes, at = tried, new, near
        if gain < SETTLED:
            break
    return z, sizes, at


def _with_noise_left(problem: _Problem, z: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the parameters, those that shape the noise as the residuals show it: by a grid, and a finer one about the best of it."""
    posterior, data = problem.posterior, problem.posterior.data
    shown, _ = _shown(posterior, problem.effects, z, sizes, np.eye(SIDE_BY_SIDE, z.size + sizes.size))
    for i, sensor, places in problem.shapes:
        channel = data.channels[i]
        residual = np.asarray(channel.measured) - np.asarray(shown[i])
        present = np.asarray(channel.present) > 0
        gaps = np.take_along_axis(np.asarray(channel.gaps), np.asarray(channel.kind), 1)
        for width in GRIDS:
            ways = np.stack(np.meshgrid(*[np.linspace(-width, width, POINTS)] * len(places)), -1).reshape(
                -1, len(places)
            )
            tried = np.repeat(z[None], len(ways), 0)
            tried[:, places] += ways
            named = dict(zip(posterior.names, np.asarray(values_of(posterior, tried)).T, strict=True))
            log_sd, squares, count = np.zeros(len(ways)), np.zeros(len(ways)), int(present.sum())
            for own, here, gap in zip(residual, present, gaps, strict=True):
                new, more = whiten(sensor, named, gap[here], np.repeat(own[here, None], len(ways), 1))
                log_sd, squares = log_sd + more, squares + (new**2).sum(0)
            prior = sum(np.asarray(posterior.parameters[k].prior.log_density(tried[:, k])) for k in places)
            z = tried[np.argmax(prior - log_sd - 0.5 * count * np.log(squares))]
    return z


def _priors(posterior: Posterior, z: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the log prior densities of some parameters with two derivatives, shape (3, k)."""
    return np.asarray(expand_prior(posterior, z)[0])[:, at]


def _all_priors(problem: _Problem, z: np.ndarray, sizes: np.ndarray, moves: np.ndarray, here: list[int]) -> np.ndarray:
    """Return the same of parameters and then of effects, 0 for those that no structure has."""
    options, of_effects = problem.options, np.zeros((3, len(here)))
    for k, i in enumerate(here):
        if i in options:
            middle, precision = _about(options[i], sizes[i])
            away = sizes[i] - middle
            of_effects[:, k] = -0.5 * away**2 * precision, -away * precision, -precision
    return np.concatenate([_priors(problem.posterior, z, moves), of_effects], axis=1)


def _about(prior: Prior, size: float) -> tuple[float, float]:
    """Return where a prior draws a size to, and its curvature: a uniform one to the nearest size inside."""
    inside = np.clip(size, *prior.bounds) if isinstance(prior, Uniform) else prior.mean
    return float(inside), float(prior.sd) ** -2.0


def _inverse(curvature: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return the covariance of k parameters and then of effects, for the curvatures of independent samples and of the log prior density."""
    curvature = curvature + np.diag(np.pad(np.maximum(-prior, 0.0), (0, len(curvature) - prior.size)))
    size = np.sqrt(np.maximum(np.diag(curvature), np.finfo(float).tiny))
    return np.linalg.pinv(curvature / np.outer(size, size), rcond=SINGULAR, hermitian=True) / np.outer(size, size)


def _linear(problem: _Problem, z: np.ndarray, sizes: np.ndarray, as_white: bool = False) -> Linear:
    """Return what is linear about one point, over the noise that the residuals themselves show there; no sample where it diverges.

    Args:
        problem: what is searched.
        z: parameters, those of the noise included.
        sizes: of the effects.
        as_white: whether the noise is taken for white.
    """
    posterior, effects = problem
    values: dict[str, float] = {}
    if problem.shapes and not as_white:
        values = dict(zip(posterior.names, np.asarray(values_of(posterior, z[None]))[0].tolist(), strict=True))
    data, d, sought = posterior.data, z.size, np.r_[np.ones(z.size), _absent(posterior, effects)]
    present = [np.asarray(channel.present) > 0 for channel in data.channels]
    edges = np.cumsum([0, *(here.sum() for here in present)])
    filled = -(-sought.size // SIDE_BY_SIDE) * SIDE_BY_SIDE  # as many in each call: one program
    ways = np.eye(filled, sought.size)
    rows = np.empty((edges[-1], 1 + filled))
    for first in range(0, filled, SIDE_BY_SIDE):
        shown, slopes = _shown(posterior, effects, z, sizes, ways[first : first + SIDE_BY_SIDE])
        if not all(np.isfinite(one).all() for one in (*shown, *slopes)):
            return Linear(d, np.zeros((sought.size,) * 2), np.zeros(sought.size), 0, 1.0, np.inf)
        for i, (here, channel) in enumerate(zip(present, data.channels, strict=True)):
            own = rows[edges[i] : edges[i + 1]]
            own[:, 0] = (np.asarray(channel.measured) - np.asarray(shown[i]))[here]
            own[:, 1 + first : 1 + first + SIDE_BY_SIDE] = np.asarray(slopes[i])[:, here].T
    step = np.asarray(data.step)
    time = np.cumsum(step, 1) - step
    products, log_noise, shares = np.zeros((1 + sought.size,) * 2), 0.0, [1.0]
    for i, (sensor, channel) in enumerate(zip(posterior.likelihood.simulator.sensors, data.channels, strict=True)):
        own, begin = rows[edges[i] : edges[i + 1], : 1 + sought.size], 0
        for trial, here in enumerate(present[i]):
            piece = slice(begin, begin := begin + here.sum())
            gaps = np.asarray(channel.gaps)[trial][np.asarray(channel.kind)[trial, here]]
            if not as_white:
                own[piece], log_sd = whiten(sensor, values, gaps, own[piece])
                log_noise += float(log_sd[0])
            shares.append(_worth(time[trial, here], own[piece, 0]))
        noise = np.sqrt(np.mean(own[:, 0] ** 2)) if len(own) else 0.0
        noise = noise if noise > 0 else 1.0
        products += own.T @ own / noise**2
        log_noise += len(own) * float(np.log(noise))
    pull, products = products[0, 1:] * sought, products[1:, 1:] * np.outer(sought, sought)
    return Linear(d, products, pull, len(rows), min(shares), log_noise)


def whiten(
    sensor: Sensor, values: Mapping[str, Any], gaps: Float[np.ndarray, " n"], columns: Float[np.ndarray, "n c"]
) -> tuple[Float[np.ndarray, "n c"], Float[np.ndarray, " c"]]:
    """Return what is new in each sample of columns that have the noise of a sensor, over its standard deviation but for a common factor.

    And the sum of the logs of these standard deviations.

    Args:
        sensor: whose noise it is.
        values: its parameters by name, SI: of all columns, or of each, shape (c,).
        gaps: time from the measurement before, s.
        columns: residuals, or what they change with.
    """
    channel = sensor.channel
    if sensor.noise == "coloured":
        memory = np.exp(-gaps[:, None] / values[correlation_name(channel)])
        before = np.concatenate([np.zeros((1, columns.shape[1])), columns[:-1]])
        sd = np.sqrt(1.0 - memory**2)
        return (columns - memory * before) / sd, np.log(sd).sum(0)
    if sensor.noise != "drifting":
        return columns, np.zeros(1)
    sd, drift = values[noise_name(channel)], values[drift_name(channel)]
    new, mean, variance, log_sd = np.empty_like(columns), np.zeros(columns.shape[1]), 0.0, 0.0
    for k, memory in enumerate(np.exp(-gaps[:, None] / values[drift_time_name(channel)])):
        expected = memory * mean
        before = memory**2 * variance + drift**2 * (1.0 - memory**2)
        total = before + sd**2
        innovation, gain = columns[k] - expected, before / total
        new[k] = innovation / np.sqrt(total)
        mean, variance = expected + gain * innovation, before * (1.0 - gain)
        log_sd = log_sd + 0.5 * np.log(total)
    return new, np.atleast_1d(log_sd)


def _absent(posterior: Posterior, effects: tuple[Effect, ...]) -> np.ndarray:
    """Return which effects the structure does not have as terms of its own, shape (m,)."""
    return np.array([one.kind != "force" or one.of not in posterior.present_names for one in effects])


def _candidates(posterior: Posterior) -> Iterator[Effect]:
    """Yield what to look for: the same for all structures of a vehicle, so that they share a program."""
    likelihood: Any = posterior.likelihood
    model, simulator = likelihood.model, likelihood.simulator
    known = {CoefficientName.parse(name) for name, _ in model.constants if is_coefficient(name)}
    terms = {one: one.text for one in model.coefficients}
    driven = {(one.axis, control) for one in (*terms, *known) for control in model.controls if control in one.signals}
    driven |= {(axis, f"tau_{axis}") for axis in model.pushed}
    for axis in model.pushed:
        speed = SPEEDS[axis]
        texts = [f"{axis}_0"]
        texts += [f"{axis}_{speed}", f"{axis}_{speed}abs{speed}", f"{axis}_{speed}3"] * (speed in model.states)
        coupled = [one for one in model.controls if one.startswith(COUPLED) and (axis, one) not in driven]
        texts += [f"{axis}_{control}" for control in coupled]
        for name in map(CoefficientName.parse, texts):
            terms.setdefault(name, name.text)
    for name, text in terms.items():
        if name not in known:
            yield Effect("force", text, model.unit_of(name))
    lags = {unknown.name for unknown in model.unknowns}
    for control in model.controls:
        if control not in MOTIONS:
            yield Effect("command offset", control, signal_unit(control))
            yield Effect("command lead", control, "s")
            if f"lag_{control}" not in lags and control + ACTUAL not in model.states:
                yield Effect("command lag", control, "s")
    if not simulator.delay and not MOTIONS & set(model.controls):
        yield Effect("delay", "", "s")
    for sensor in simulator.sensors:
        if not sensor.bias:
            yield Effect("sensor offset", sensor.channel, signal_unit(sensor.channel))
    if not likelihood.free_initial:
        for state in model.states:
            if state not in QUATERNION:
                yield Effect("start", state, signal_unit(state))


def _worth(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]) -> float:
    """Return the share of the samples that residuals of one channel of a trial are worth; 1 where they are white, or too few to tell."""
    if len(time) <= 8 or whiteness(time, residual).p_value >= LIKELY:
        return 1.0
    return effective_samples(time, residual) / len(time)


@program(static_argnums=1)
def _shown(
    posterior: Posterior, effects: tuple[Effect, ...], z: Array, sizes: Array, ways: Float[Array, "k dm"]
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return what each sensor shows, shape (trials, n), and its slopes along ways of z and then the sizes, shape (k, trials, n)."""
    likelihood: Any = posterior.likelihood
    simulator = replace(likelihood.simulator, model=_pushed(likelihood.model, effects))

    def shown(z: Array, sizes: Array) -> tuple[Array, ...]:
        size = dict(zip(effects, sizes, strict=True))
        named: dict[str, Any] = dict(zip(posterior.names, posterior.constrain(z), strict=True))
        for one, x in size.items():
            if one.kind == "force":
                own = one.of if one.of in named else f"omitted {one.of}"
                named[own] = named.get(own, 0.0) + x

        def of_one_trial(apart: dict, trial: Any, start: Array) -> tuple[Array, ...]:
            control = dict(zip(likelihood.model.controls, trial.control, strict=True))
            starts, biases = start, {}
            for one, x in size.items():
                match one.kind:
                    case "command offset":
                        control[one.of] = control[one.of] + x
                    case "command lead":
                        control[one.of] = _early(control[one.of], trial.step, x)
                    case "command lag":
                        control[one.of] = _late(control[one.of], trial.step, x + INSTANT)
                    case "start":
                        starts = starts.at[likelihood.model.states.index(one.of)].add(x)
                    case "sensor offset":
                        biases[one.of] = x
            if (delay := Effect("delay", "", "s")) in size:
                control = {
                    name: column if name in MOTIONS else delay_control(column, size[delay] / trial.step[0])
                    for name, column in control.items()
                }
            seen = simulator.follow({**named, **apart}, starts, tuple(control.values()), trial.step).kept
            return tuple(x + biases.get(channel, 0.0) for channel, x in zip(likelihood.channels, seen, strict=True))

        return jax.vmap(of_one_trial)(likelihood.apart(named), posterior.data, likelihood.starts(named, posterior.data))

    along = ways[:, : z.size], ways[:, z.size :]
    return jax.vmap(lambda *way: jax.jvp(shown, (z, sizes), way), out_axes=(None, 0))(*along)


def _pushed(model: VehicleModel, effects: tuple[Effect, ...]) -> VehicleModel:
    """Return the model with the forces that it has no coefficient for."""
    coefficients = {one.text for one in model.coefficients}
    forces = [CoefficientName.parse(one.of) for one in effects if one.kind == "force" and one.of not in coefficients]
    trim = {name.removeprefix("trim "): value for name, value in model.constants if name.startswith("trim ")}

    def derivative(params: Any, state: tuple, control: tuple) -> tuple:
        signals = dict(zip((*model.states, *model.controls), (*state, *control), strict=True))
        pushes: dict[str, Any] = {}
        for force in forces:
            name = outside_force(force.axis)
            before = pushes.get(name, params.get(name, 0.0))
            pushes[name] = before + params[f"omitted {force.text}"] * force.regressor(signals, trim)
        return model.derivative({**params, **pushes}, state, control)

    return replace(model, derivative=derivative, constants=(*model.constants, ("omitted", float(len(forces)))))


def _early(control: Float[Array, " n"], step: Float[Array, " n"], lead: Any) -> Float[Array, " n"]:
    """Return the mean over each step of a held command whose every change comes so much before its sample, at most one step."""
    return control + lead / jnp.where(step > 0, step, jnp.inf) * jnp.append(jnp.diff(control), 0.0)


def _late(control: Float[Array, " n"], step: Float[Array, " n"], lag: Any) -> Float[Array, " n"]:
    """Return the mean over each step of what follows a held command with a lag, from where the first one holds it."""

    def follow(actual: Array, sample: tuple) -> tuple[Array, Array]:
        command, h = sample
        h = jnp.where(h > 0, h, 1.0)
        left = jnp.exp(-h / lag)
        away = actual - command
        return command + away * left, command + away * (1.0 - left) * lag / h

    return jax.lax.scan(follow, control[0], (control, step))[1]
