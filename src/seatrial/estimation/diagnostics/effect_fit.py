"""The parameters of a model and effects that it may lack, fitted together, with the noise as the residuals of each fit show it.

Gauss and Newton's method climbs the posterior density along the parameters and the sizes of the effects. The noise's size follows from the
residuals; the shape of a noise with a memory is found again by a grid.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from seatrial.estimation.diagnostics.candidate_effects import Effect, show_with_effects
from seatrial.estimation.posterior.mode import Mode, expand_prior
from seatrial.estimation.posterior.posterior import Posterior, values_of
from seatrial.estimation.prediction.prediction_scores import effective_samples, whiteness
from seatrial.estimation.priors import Prior, Uniform
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    drift_name,
    drift_time_name,
    noise_name,
)
from seatrial.estimation.simulation.trial_data import ChannelData, TrialData

LIKELY = 0.01  # P-value of a test of whiteness from which residuals are taken for white
STEPS, HALVINGS = 8, 4  # Steps of a fit, and how often one that does not climb is halved
SETTLED = 1e-2  # Gain of a step, nats, below which a fit has ended
# How often the shape of a noise with a memory is found again for a fit; half widths of the grids on which it is, in
# units of z, and points along each side.
ROUNDS, GRIDS, POINTS = 2, (3.0, 0.6), 11
SINGULAR = 1e-10  # Share of the largest eigenvalue of a scaled curvature below which a direction is not told
SIDE_BY_SIDE = 8  # Slopes that are computed at once: each needs a control of its own over the whole record


@dataclass(frozen=True)
class EffectProblem:
    """A posterior of d parameters, its mode, and m effects that its model may lack."""

    posterior: Posterior
    mode: Mode
    effects: tuple[Effect, ...]

    @cached_property
    def absent(self) -> Bool[np.ndarray, " m"]:
        """Which effects the structure does not have as terms of its own."""
        present = self.posterior.present_names
        return np.array([one.kind != "force" or one.of not in present for one in self.effects])

    @cached_property
    def priors(self) -> dict[int, Prior]:
        """Priors of the effects that are terms of other structures, by place."""
        known = {one.name: one.prior for one in self.posterior.parameters}
        forces = {i: one.of for i, one in enumerate(self.effects) if one.kind == "force" and self.absent[i]}
        return {i: known[of] for i, of in forces.items() if of in known}

    @cached_property
    def shapes(self) -> dict[int, list[int]]:
        """Places in z of what shapes each noise with a memory, by the place of its channel."""
        return {
            i: [self.posterior.names.index(one) for one in sensor.noise_parameters[1:]]
            for i, sensor in enumerate(self.posterior.likelihood.simulator.sensors)
            if sensor.noise in ("coloured", "drifting")
        }


class Linearisation(NamedTuple):
    """The residuals at one point, over the noise, and how they change with z and with each effect.

    Sums over all samples say all of it: by length, the columns would be most of what a fit keeps in memory.

    Attributes:
        z: parameters of the point, shape (d,).
        sizes: of every effect there, 0 for those that are not fitted, shape (m,).
        products: sums of products of the slopes of what is shown along z and then the sizes, 0 for effects that the structure has, shape
            (d + m, d + m).
        pull: sums of their products with the residuals, shape (d + m,).
        count: samples.
        worth: share of them that these residuals are worth where they are correlated.
        log_noise: sum over samples of the log of the residuals' standard deviation in their channel.
    """

    z: Float[np.ndarray, " d"]
    sizes: Float[np.ndarray, " m"]
    products: Float[np.ndarray, "dm dm"]
    pull: Float[np.ndarray, " dm"]
    count: int
    worth: float
    log_noise: float

    @property
    def moving(self) -> Int[np.ndarray, " k"]:
        """Places of the parameters that change what is shown."""
        return np.flatnonzero(np.diag(self.products)[: self.z.size])

    def penalty(self, size: float, variance: float, prior: Prior | None = None) -> float:
        """Return what one more effect has to gain, nats.

        Args:
            size: of the effect.
            variance: of its size after the data.
            prior: of its size where other structures have it; None for one that no structure has.
        """
        if prior is None:
            sought = np.count_nonzero(np.diag(self.products)[self.z.size :])
            return 0.5 * float(np.log(max(self.count * self.worth, 2.0))) + float(np.log(max(sought, 1)))
        mean, precision = normal_prior(prior, size)
        share = min(variance * precision, 1.0)
        if isinstance(prior, Uniform):  # everywhere a third of a nat below the peak of its normal density
            return 0.5 * float(np.log(6 / np.pi / share))
        return 0.5 * ((size - mean) ** 2 * precision - float(np.log(share)))


def normal_prior(prior: Prior, size: float) -> tuple[float, float]:
    """Return mean and precision of the normal density that stands for a prior; the mean of a uniform one is the nearest size inside."""
    mean = np.clip(size, *prior.bounds) if isinstance(prior, Uniform) else prior.mean
    return float(mean), float(prior.sd) ** -2.0


class Fit(NamedTuple):
    """The parameters and some effects fitted together.

    Attributes:
        at: where the density is highest.
        included: places of the effects that are fitted, k of them.
        cov: of z and then of their sizes, as if all samples were independent, shape (d + k, d + k).
        log_odds: against the model without any.
    """

    at: Linearisation
    included: tuple[int, ...]
    cov: Float[np.ndarray, "dk dk"]
    log_odds: float = 0.0

    @property
    def variance(self) -> Float[np.ndarray, " dk"]:
        """Of z and the sizes, of as many samples as the residuals are worth; of the model itself, as it states it."""
        return np.diag(self.cov) / (self.at.worth if self.included else 1.0)

    def penalty(self, place: int, problem: EffectProblem) -> float:
        """Return what an effect that is included has to gain, nats."""
        k = self.at.z.size + self.included.index(place)
        return self.at.penalty(self.at.sizes[place], self.cov[k, k] / self.at.worth, problem.priors.get(place))


def fit_effects(problem: EffectProblem, before: Fit, included: tuple[int, ...]) -> Fit:
    """Return the fit with one effect more or less, by Gauss and Newton's steps from the fit before, with the noise that then remains."""
    (changed,) = {*included} ^ {*before.included}
    is_more, at = changed in included, before.at
    if not is_more:
        at = linearise(problem, at.z, np.where(np.arange(at.sizes.size) == changed, 0.0, at.sizes))
    at = _climb(problem, at, included)
    for _ in range(ROUNDS * bool(problem.shapes)):
        at = _climb(problem, linearise(problem, _shape_noise(problem, at), at.sizes), included)
    fit = fit_at(problem, at, included)
    paid = fit.penalty(changed, problem) if is_more else -before.penalty(changed, problem)
    return fit._replace(log_odds=before.log_odds + (before.at.log_noise - at.log_noise) * at.worth - paid)


def fit_at(problem: EffectProblem, at: Linearisation, included: tuple[int, ...] = ()) -> Fit:
    """Return the fit of some effects if its highest density is at a point, with log odds of 0.

    Its covariance is made of the very sums that say what an effect adds: of one that the parameters nearly imitate, the difference is all
    there is. Parameters that change nothing that is shown keep the variances at the mode.
    """
    among = np.r_[at.moving, at.z.size + np.arange(len(included))]
    cov = np.diag(np.r_[np.diag(problem.mode.cov), np.zeros(len(included))])
    cov[np.ix_(among, among)] = _expand(problem, at, included)[2]
    return Fit(at, included, cov)


def linearise(
    problem: EffectProblem, z: Float[np.ndarray, " d"], sizes: Float[np.ndarray, " m"], as_white: bool = False
) -> Linearisation:
    """Return what is linear about one point, over the noise that the residuals themselves show there; no sample where it diverges.

    Args:
        problem: what is searched.
        z: parameters, those of the noise included.
        sizes: of the effects.
        as_white: whether the noise is taken for white.
    """
    posterior, data, width = problem.posterior, problem.posterior.data, z.size + sizes.size
    values: dict[str, float] = {}
    if problem.shapes and not as_white:
        values = dict(zip(posterior.names, np.asarray(values_of(posterior, z[None]))[0].tolist(), strict=True))
    filled = -(-width // SIDE_BY_SIDE) * SIDE_BY_SIDE  # as many in each call: one program
    ways = np.eye(filled, width)
    present = [np.asarray(channel.present) > 0 for channel in data.channels]
    rows = [np.empty((here.sum(), 1 + filled)) for here in present]
    for first in range(0, filled, SIDE_BY_SIDE):
        last = first + SIDE_BY_SIDE
        shown, slopes = show_with_effects(posterior, problem.effects, z, sizes, ways[first:last])
        if not all(np.isfinite(one).all() for one in (*shown, *slopes)):
            return Linearisation(z, sizes, np.zeros((width, width)), np.zeros(width), 0, 1.0, np.inf)
        for own, channel, here, x, slope in zip(rows, data.channels, present, shown, slopes, strict=True):
            own[:, 0] = (np.asarray(channel.measured) - np.asarray(x))[here]
            own[:, 1 + first : 1 + last] = np.asarray(slope)[:, here].T
    products, log_noise, shares = np.zeros((1 + width, 1 + width)), 0.0, [1.0]
    for row, sensor, channel in zip(rows, posterior.likelihood.simulator.sensors, data.channels, strict=True):
        own, begin = row[:, : 1 + width], 0
        for _, times, gaps in _measurements(data, channel):
            piece = slice(begin, begin := begin + gaps.size)
            if not as_white:
                own[piece], log_sd = whiten(sensor, values, gaps, own[piece])
                log_noise += float(log_sd[0])
            shares.append(_worth(times, own[piece, 0]))
        noise = np.sqrt(np.mean(own[:, 0] ** 2)) if len(own) else 0.0
        noise = noise if noise > 0 else 1.0
        products += own.T @ own / noise**2
        log_noise += len(own) * float(np.log(noise))
    sought = np.r_[np.ones(z.size), problem.absent]
    pull, products = products[0, 1:] * sought, products[1:, 1:] * np.outer(sought, sought)
    return Linearisation(z, sizes, products, pull, sum(map(len, rows)), min(shares), log_noise)


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


def _climb(problem: EffectProblem, at: Linearisation, included: tuple[int, ...]) -> Linearisation:
    """Return where the density is highest, from a point on; the noise stays as it is shaped."""
    moving, fitted = at.moving, list(included)
    lowest = np.where([problem.effects[i].is_positive for i in included], 0.0, -np.inf)
    height, slope, cov = _expand(problem, at, included)
    for _ in range(STEPS):
        step = cov @ slope
        for share in 0.5 ** np.arange(HALVINGS):
            z, sizes = at.z.copy(), at.sizes.copy()
            z[moving] += share * step[: moving.size]
            sizes[fitted] = np.maximum(sizes[fitted] + share * step[moving.size :], lowest)
            near = linearise(problem, z, sizes)
            higher, slope, cov = _expand(problem, near, included)
            if higher > height:
                break
        else:
            break
        at, gain, height = near, higher - height, higher
        if gain < SETTLED:
            break
    return at


def _shape_noise(problem: EffectProblem, at: Linearisation) -> Float[np.ndarray, " d"]:
    """Return the parameters, those that shape the noise as the residuals show it: by a grid, and a finer one about the best of it."""
    posterior, z = problem.posterior, at.z
    shown, _ = show_with_effects(posterior, problem.effects, z, at.sizes, np.eye(SIDE_BY_SIDE, len(at.pull)))
    for i, places in problem.shapes.items():
        sensor, channel = posterior.likelihood.simulator.sensors[i], posterior.data.channels[i]
        residual = np.asarray(channel.measured) - np.asarray(shown[i])
        for width in GRIDS:
            axes = [np.linspace(-width, width, POINTS)] * len(places)
            ways = np.stack(np.meshgrid(*axes), -1).reshape(-1, len(places))
            tried = np.repeat(z[None], len(ways), 0)
            tried[:, places] += ways
            named = dict(zip(posterior.names, np.asarray(values_of(posterior, tried)).T, strict=True))
            log_sd, squares, count = np.zeros(len(ways)), np.zeros(len(ways)), 0
            for own, (here, _, gaps) in zip(residual, _measurements(posterior.data, channel), strict=True):
                new, more = whiten(sensor, named, gaps, np.repeat(own[here, None], len(ways), 1))
                log_sd, squares, count = log_sd + more, squares + (new**2).sum(0), count + gaps.size
            prior = sum(np.asarray(posterior.parameters[k].prior.log_density(tried[:, k])) for k in places)
            z = tried[np.argmax(prior - log_sd - 0.5 * count * np.log(squares))]
    return z


def _expand(
    problem: EffectProblem, at: Linearisation, included: tuple[int, ...]
) -> tuple[float, Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Return the log posterior density, but for a constant, its slopes along what is fitted, and the covariance of that.

    The covariance is that of independent samples; effects that no structure has are without a prior.
    """
    of_effects = np.zeros((3, len(included)))
    for k, i in enumerate(included):
        if i in problem.priors:
            mean, precision = normal_prior(problem.priors[i], at.sizes[i])
            away = at.sizes[i] - mean
            of_effects[:, k] = -0.5 * away**2 * precision, -away * precision, -precision
    of_parameters = np.asarray(expand_prior(problem.posterior, at.z)[0])[:, at.moving]
    prior = np.concatenate([of_parameters, of_effects], axis=1)
    fitted = np.r_[at.moving, at.z.size + np.array(included, int)]
    curvature = at.products[np.ix_(fitted, fitted)] + np.diag(np.maximum(-prior[2], 0.0))
    size = np.sqrt(np.maximum(np.diag(curvature), np.finfo(float).tiny))
    cov = np.linalg.pinv(curvature / np.outer(size, size), rcond=SINGULAR, hermitian=True) / np.outer(size, size)
    return prior[0].sum() - at.log_noise, at.pull[fitted] + prior[1], cov


def _measurements(data: TrialData, channel: ChannelData) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield of each trial where a channel was measured, when, s, and the time since the measurement before, s."""
    arrays = map(np.asarray, (channel.present, channel.gaps, channel.kind))
    for present, gaps, kind, time in zip(*arrays, data.time, strict=True):
        here = present > 0
        yield here, time[here], gaps[kind[here]]


def _worth(time: Float[np.ndarray, " n"], residual: Float[np.ndarray, " n"]) -> float:
    """Return the share of the samples that residuals of one channel of a trial are worth; 1 where they are white, or too few to tell."""
    if len(time) <= 8 or whiteness(time, residual).p_value >= LIKELY:
        return 1.0
    return effective_samples(time, residual) / len(time)
