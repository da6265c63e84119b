"""Measurements that are linear in parameters and sources of error, about one motion, and the densities of sets of these sources.

About the mode all is linear and normal: measurements y = J z + G w + e, with the sensitivities J of the parameters z and G of the sizes w
of the sources (`error_sources`), and noise e of covariance R. For a set S of sources with standard deviations s the parameters and the
sizes have, with W = diag(1 / s^2) and the curvature P of the prior about its peak m,

    precision   H = [J G]' R^-1 [J G] + diag(P, W)
    values      H^-1 ([J G]' R^-1 y + (P m, 0))
    log p(y|S)  = log N(y - J z - G w; 0, R) - 1/2 (z - m)' P (z - m) - 1/2 w' W w - 1/2 log|H| + 1/2 log|W| + constant

Which sources there are, and how large, is not known: their sets are averaged by these densities times their prior probabilities. Stated
sources are in each set. None of the others is there with the probability `NOTHING`; a term of another structure is as probable as not, and
has its own prior. The noise of each channel is the one that makes the residuals of a set most probable, among the shape at
the mode and such with a smaller slow part: what a source explains was a part of the noise.

Parameters are those on the straight lines that the maps of priors bend into their bounds: a box is flat there, and cut. A set's density is
times the share of its normal density between the bounds, one parameter after the other, and its values and covariance are the moments of
what is left, exact of one parameter that is cut.
"""

from collections.abc import Mapping, Sequence
from math import gcd
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from seatrial.compiled.batching import bucket_length
from seatrial.compiled.programs import program
from seatrial.estimation.diagnostics.error_sources import FEW, Effect, Perturbed, linearise
from seatrial.estimation.posterior.mode import expand_prior
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors import Prior, Uniform
from seatrial.estimation.priors.box import bent, log_slopes, straightened
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    drift_name,
    drift_time_name,
    noise_name,
    share_name,
)
from seatrial.estimation.simulation.trial_data import FOREVER, ChannelData

NOTHING = 0.9  # Probability that none of the sources that are looked for is there
SHARES = np.geomspace(0.003, 3.0, 7)  # Standard deviations of sizes that are found, shares of the force
SHRUNK = (1.0, 0.3, 0.1)  # Slow parts of a noise that are tried beside none, over that at the mode
# Slow parts that are tried under a noise taken as white: sizes, over the white part, and memories, in intervals of the
# samples.
SLOW, LENGTHS = (0.5, 2.0), (5.0, 50.0, 500.0)
MAX_SOURCES, KEPT = 3, 4  # Sources in a set at most, and sets to which another is added
NEAR_SIZES = 3  # Sizes of a source that are tried beside others
MIN_LOG_SHARE = -6.0  # Log probability of such a set, over that of the best
# Rounds in which the noise of a set is found at most, and the gain that ends them.
NOISE_ROUNDS, NOISE_SETTLED = 6, 1e-3
BLOCK = 128  # Samples that are summed at once, few enough for the cache
MAX_LEFT = 0.5  # Share of the variance of each channel that slow residuals leave from which a model describes nothing
TINY = float(np.finfo(float).tiny)
LOG_ROOT = 0.5 * float(np.log(2.0 * np.pi))
# Distances in z from a bound: within which the motion is not linearised, and from which on a prior has no bend; and least
# variance that a cut leaves, over that before it.
NEAR_BOUND, CLEAR, MIN_NARROWED = 0.01, 0.25, 1e-9
SMOOTH = "smooth force"


class Option(NamedTuple):
    """How large a source may be: mean and standard deviation of its size before the data, and the log of its prior odds."""

    mean: float
    sd: float
    log_odds: float


class Member(NamedTuple):
    """One set of sources.

    Attributes:
        chosen: places of the sources in it, and how large each is thought to be before the data.
        log_density: log of its probability, but for a constant.
        values: of the moving parameters and of the sizes in the set, after the data.
        cov: their covariance.
        information: of the data about them.
        precision: of their priors.
        columns: places among all sizes of those in the set.
        noise: shape and standard deviation of the noise of each channel.
    """

    chosen: tuple[tuple[int, Option], ...]
    log_density: float
    values: Float[np.ndarray, " q"]
    cov: Float[np.ndarray, "q q"]
    information: Float[np.ndarray, "q q"]
    precision: Float[np.ndarray, " q"]
    columns: Int[np.ndarray, " c"]
    noise: tuple[tuple[int, float], ...]


class Shape(NamedTuple):
    """Sums over the measurements of one channel under noise of one shape and unit standard deviation.

    Attributes:
        products: of y and of the slopes along the moving parameters and all sizes, shape (1 + k + m, 1 + k + m).
        log_sd: sum of the logs of the standard deviations of what is new in each.
    """

    products: Float[np.ndarray, "a a"]
    log_sd: float


class LinearModel:
    """Measurements that are linear in parameters and sources, about one motion."""

    def __init__(self, posterior: Posterior, at: Perturbed) -> None:
        """Linearise.

        Args:
            posterior: of records.
            at: its sources about a motion.
        """
        likelihood, names = posterior.likelihood, posterior.names
        noise = likelihood.noise_parameters
        self.sources, self.at = at.sources, at
        self.moving = [i for i in posterior.places if names[i] not in noise]
        edges = edges_of(posterior)
        self.x, slope = straightened(at.z, edges), np.exp(log_slopes(at.z, edges))
        self.edges = edges[self.moving]
        values = dict(zip(names, np.asarray(expand_prior(posterior, at.z)[1]), strict=True))
        kept = np.r_[0, 1 + np.array(self.moving, int), 1 + len(names) + np.arange(at.sizes.size)]
        # Structures of few parameters share the program of all columns; of many, what does not move is not summed.
        summed = np.arange(1 + len(names) + at.sizes.size) if posterior.dim <= FEW else kept
        chosen = np.ix_(*[np.flatnonzero(np.isin(summed, kept))] * 2)
        self.channels: list[tuple[float, list[Shape]]] = []
        self.first: list[tuple[int, float]] = []
        self.is_finite = True
        linearised = linearise(posterior, at)
        for channel, sensor in zip(posterior.data.channels, likelihood.simulator.sensors, strict=True):
            # Of the slopes of a long record no copy outlives its use.
            rows = _along(next(linearised), at.z, self.x, slope)
            rows = rows if summed.size == rows.shape[2] else rows[..., summed]
            self.is_finite &= bool(np.isfinite(rows).all())
            shapes = noise_shapes(sensor, values, channel, rows) if self.is_finite else []
            del rows
            shapes = [Shape(one.products[chosen], one.log_sd) for one in shapes]
            self.channels.append((float(np.asarray(channel.present).sum()), shapes))
            self.first.append((0, float(values[noise_name(sensor.channel)])))
        # Where a map bends, its slope is a part of the density of the prior; on the line it is none.
        clear = np.clip(self.x, edges[:, 0] + CLEAR, edges[:, 1] - CLEAR)
        prior = np.asarray(expand_prior(posterior, clear)[0])[:, self.moving]
        self.curvature = np.maximum(-prior[2], TINY)
        self.peak = clear[self.moving] + prior[1] / self.curvature
        self.height = prior[0] + 0.5 * prior[1] ** 2 / self.curvature
        self.smooth = {i for i, one in enumerate(self.sources) if one.effect.kind == SMOOTH}
        self.options = self._options({one.name: one.prior for one in posterior.parameters})

    def _options(self, priors: Mapping[str, Prior]) -> dict[int, list[Option]]:
        """Return how large each source that is looked for may be."""
        found = [i for i, one in enumerate(self.sources) if one.stated is None]
        absent = NOTHING ** (1.0 / max(len(found), 1))
        odds = float(np.log1p(-absent) - np.log(absent) - np.log(SHARES.size))
        result = {}
        for i in found:
            one = self.sources[i]
            if one.effect.of in priors and one.effect.kind == "force":  # a term of another structure
                prior = priors[one.effect.of]
                mean = 0.0 if isinstance(prior, Uniform) else float(prior.mean) / one.worth
                result[i] = [Option(mean, float(prior.sd) / abs(one.worth), 0.0)]
            else:
                result[i] = [Option(0.0, share, odds) for share in SHARES]
        return result

    def members(self, sets: Sequence[Mapping[int, Option]]) -> list[Member]:
        """Return what each set of sources, with those that are stated, makes of the parameters, with the noise that then remains."""
        stated = {i: Option(0.0, one.stated, 0.0) for i, one in enumerate(self.sources) if one.stated is not None}
        every = [(stated | dict(chosen)).items() for chosen in sets]
        columns = [np.array([place for i, _ in one for place in self.sources[i].columns], int) for one in every]
        options = [[option for i, option in one for _ in self.sources[i].columns] for one in every]
        result: dict[int, Member] = {}
        widths = [len(one) for one in columns]
        for width in dict.fromkeys(widths):  # as many columns together: one by one they take ten times longer
            own = [i for i, other in enumerate(widths) if other == width]
            spread, mean = (
                np.array([[number(one) for one in options[i]] for i in own]).reshape(len(own), width)
                for number in (lambda one: one.sd**-2.0, lambda one: one.mean)
            )
            for i, (density, *rest) in zip(
                own, self._solve_alike(np.array([columns[i] for i in own]), spread, mean), strict=True
            ):
                odds = sum(one.log_odds for one in sets[i].values())
                result[i] = Member(tuple(sets[i].items()), density + odds, *rest)
        return [result[i] for i in range(len(sets))]

    def _solve_alike(
        self, columns: Int[np.ndarray, "g c"], spread: Float[np.ndarray, "g c"], centre: Float[np.ndarray, "g c"]
    ) -> list[tuple]:
        """Return what a `Member` says but for `chosen`, of g sets of c columns with precisions and means of their sizes."""
        k, g = len(self.moving), len(columns)
        first = np.broadcast_to(np.arange(1 + k), (g, 1 + k))
        among = np.concatenate([first, 1 + k + columns], 1)
        precision = np.concatenate([np.broadcast_to(self.curvature, (g, k)), spread], 1)
        mean = np.concatenate([np.broadcast_to(self.peak, (g, k)), centre], 1)
        sums = [np.stack([one.products for one in shapes]) for _, shapes in self.channels]
        log_sds = [np.array([one.log_sd for one in shapes])[:, None] for _, shapes in self.channels]
        noise = [[*self.first] for _ in range(g)]
        result: list[tuple] = [()] * g
        last, left = np.full(g, -np.inf), np.arange(g)
        for _ in range(NOISE_ROUNDS):
            here = among[left]
            rows, columns_of = here[:, :, None], here[:, None, :]
            information = np.zeros((left.size, *among.shape[1:], *among.shape[1:]))
            for c, own in enumerate(sums):
                shape, sd = (np.array([noise[i][c][part] for i in left]) for part in (0, 1))
                information += own[shape.astype(int)[:, None, None], rows, columns_of] / sd[:, None, None] ** 2
            peak, log_volume, cov = _solve(information, precision[left], mean[left])
            values, cov, log_share = cut(peak, cov, self.edges)
            density, found = log_share, []
            squares = [self._squares(here, values, sums)]
            squares.append(squares[0] if values is peak else self._squares(here, peak, sums))
            for (count, _), log_sd, square, least in zip(self.channels, log_sds, *squares, strict=True):
                sd = np.sqrt(np.maximum(square, TINY) / max(count, 1.0))
                best = np.argmax(-log_sd - count * np.log(sd), 0), np.arange(left.size)
                found.append([(int(shape), float(sd[shape, i])) for i, shape in enumerate(best[0])])
                density += -log_sd[best[0], 0] - count * np.log(sd[best]) - 0.5 * least[best] / sd[best] ** 2
            off = peak - mean[left]
            density += -0.5 * (precision[left] * off**2).sum(1) - log_volume + 0.5 * np.log(spread[left]).sum(1)
            for j, i in enumerate(left):
                noise[i] = [one[j] for one in found]
                data = information[j, 1:, 1:]
                result[i] = float(density[j]), values[j], cov[j], data, precision[i], columns[i], tuple(noise[i])
            moved = np.abs(density - last[left]) >= NOISE_SETTLED
            last[left] = density
            if not (left := left[moved]).size:
                break
        return result

    def _squares(
        self,
        among: Int[np.ndarray, "g q"],
        values: Float[np.ndarray, "g q"],
        sums: Sequence[Float[np.ndarray, "h a a"]],
    ) -> list[Float[np.ndarray, "h g"]]:
        """Return for each channel the squares that g sets leave under noise of each of h shapes.

        With b of the columns that sets have of their own, the squares are a' P a = a_s' P_ss a_s + 2 b' P_b a - b' P_bb b.
        """
        away = np.c_[np.ones(len(values)), -values]
        shared = int(np.argmin(np.append((among == among[0]).all(0), False)))
        same, own, alike, apart = among[0, :shared], among[:, shared:], away[:, :shared], away[:, shared:]
        result = []
        for products in sums:
            squares = ((alike @ products[:, same[:, None], same]) * alike).sum(2)
            rows = products[:, own[:, :, None], among[:, None]]
            along = 2.0 * np.einsum("hgcq,gq->hgc", rows, away)
            along -= np.einsum("hgcq,gq->hgc", rows[..., shared:], apart)
            result.append(squares + (along * apart).sum(2))
        return result

    def average(self, kinds: Sequence[str] = ()) -> list[Member]:
        """Return sets of sources, the most probable first.

        Sources are added one by one to the best sets so far.

        Args:
            kinds: of sources that are left out.
        """
        looked = {i: options for i, options in self.options.items() if self.sources[i].effect.kind not in kinds}
        members = {(): self.members([{}])[0]}
        front: list[dict[int, Option]] = [{}]
        for _ in range(MAX_SOURCES):
            sets = [
                {**chosen, i: option} for chosen in front for i in looked.keys() - chosen.keys() for option in looked[i]
            ]
            keys = [tuple(sorted(one.items())) for one in sets]
            fresh = [key for key in dict.fromkeys(keys) if key not in members]
            members |= dict(zip(fresh, self.members([dict(key) for key in fresh]), strict=True))
            grown: dict[frozenset[int], tuple[float, dict[int, Option]]] = {}
            for key in keys:
                height, own = members[key].log_density, frozenset(dict(key))
                if height > grown.get(own, (-np.inf, {}))[0]:
                    grown[own] = height, dict(key)
            if front == [{}]:  # from here on the sizes that do best alone
                for i, options in looked.items():
                    alone = [(members[((i, one),)].log_density, one) for one in options]
                    looked[i] = [one for _, one in sorted(alone, reverse=True)[:NEAR_SIZES]]
            best = max(one.log_density for one in members.values())
            ranked = sorted(grown.values(), key=lambda pair: -pair[0])[:KEPT]
            front = [chosen for height, chosen in ranked if height > best + MIN_LOG_SHARE]
            if not front:
                break
        return sorted(members.values(), key=lambda one: -one.log_density)

    def with_force(self, share: float, members: Sequence[Member]) -> list[Member]:
        """Return sets of sources with a stated smooth force of this share along each axis, unless the set has one."""
        smooth = {i: Option(0.0, share, 0.0) for i in self.smooth if share}
        result = self.members([{**smooth, **dict(one.chosen)} for one in members])
        return [one._replace(chosen=before.chosen) for one, before in zip(result, members, strict=True)]

    def added(
        self, members: Sequence[Member], weight: Float[np.ndarray, " s"], at: int, mode: float
    ) -> Float[np.ndarray, " sources"]:
        """Return what the noise, with the prior, and then each source add to the mean square error of a parameter about the mode.

        Args:
            members: sets of sources.
            weight: their probabilities.
            at: place of the parameter among those that move.
            mode: its value there.
        """
        k, result = len(self.moving), np.zeros(1 + len(self.sources))
        owner = {place: i for i, one in enumerate(self.sources) for place in one.columns}
        for one, share in zip(members, weight, strict=True):
            gain = one.cov[at]
            result[0] += share * (gain @ one.information @ gain + gain[:k] ** 2 @ one.precision[:k])
            for j, place in enumerate(one.columns):
                result[1 + owner[place]] += share * gain[k + j] ** 2 * one.precision[k + j]
            away = (one.values[at] - mode) ** 2
            for i, _ in one.chosen:
                result[1 + i] += share * away / len(one.chosen)
        return result

    def after(self, member: Member) -> dict[Effect, tuple[float, float]]:
        """Return the size of each stated source after the data and its standard deviation, over the one stated."""
        k, result = len(self.moving), {}
        for one in self.sources:
            if one.stated is not None:
                at = k + int(np.flatnonzero(member.columns == one.columns[0])[0])
                size, sd = float(member.values[at]), float(np.sqrt(member.cov[at, at]))
                result[one.effect] = size / one.stated, sd / one.stated
        return result

    def describes(self, member: Member, channels: Sequence[ChannelData]) -> bool:
        """Return whether a set leaves less than slow residuals of most of the variance of some channel, about the mean of each run."""
        k, away = len(self.moving), np.zeros(1 + len(self.moving) + self.at.sizes.size)
        away[0], away[1 : 1 + k], away[1 + k + member.columns] = 1.0, -member.values[:k], -member.values[k:]
        for (_, shapes), channel, (shape, _) in zip(self.channels, channels, member.noise, strict=True):
            here, y = (np.asarray(one, float) for one in (channel.present, channel.measured))
            mean = (here * y).sum(1, keepdims=True) / np.maximum(here.sum(1, keepdims=True), 1.0)
            white = next((i for i, one in enumerate(shapes) if one.log_sd == 0.0), None)
            if white in (None, shape):
                return True
            if away @ shapes[white].products @ away < MAX_LEFT * np.sum(here * (y - mean) ** 2):
                return True
        return False


def noise_shapes(
    sensor: Sensor, values: Mapping[str, Any], channel: ChannelData, rows: Float[np.ndarray, "trials n a"]
) -> list[Shape]:
    """Return the sums of products of columns under the noise of a sensor and, of a slow part, under smaller ones.

    Args:
        sensor: whose noise it is.
        values: its parameters by name, SI.
        channel: when it was measured.
        rows: columns, 0 if it was not.
    """
    here, gaps = np.asarray(channel.present) > 0, np.asarray(channel.gaps)
    samples = min(here.shape[1], bucket_length(int(here.sum(1).max(initial=1))))
    first = np.argsort(~here, 1, kind="stable")[:, :samples]  # measured samples first: the others change nothing
    here, kind = (np.take_along_axis(one, first, 1) for one in (here, np.asarray(channel.kind)))
    gap = np.where(here, np.take_along_axis(gaps, kind, 1), FOREVER)
    rows = rows if here.all() and samples == rows.shape[1] else np.take_along_axis(rows, first[..., None], 1)
    if sensor.noise == "proportional":  # white in units of its size; the measured signal is near enough to that shown
        size = values[share_name(sensor.channel)] * np.take_along_axis(np.asarray(channel.measured), first, 1)
        rows = rows / np.hypot(1.0, size / values[noise_name(sensor.channel)])[..., None]
    where = rows, here.astype(float), gap
    if sensor.noise == "coloured":
        return _sums(*where, [(1.0, values[correlation_name(sensor.channel)], 0.0)], 0.0)
    if sensor.noise == "drifting":
        size, time = (values[name(sensor.channel)] for name in (drift_name, drift_time_name))
        size /= values[noise_name(sensor.channel)]
        return [*_sums(*where, [(shrunk * size, time, 0.0) for shrunk in SHRUNK], 1.0), _white(where[0])]
    step = float(np.median(gaps[gaps < FOREVER])) if (gaps < FOREVER).any() else 1.0
    slow = [(size, length * step, smooth) for size in SLOW for length in LENGTHS for smooth in (0.0, 1.0)]
    return [_white(where[0]), *_sums(*where, slow, 1.0)]


def _white(rows: Float[np.ndarray, "trials n a"]) -> Shape:
    return Shape(np.asarray(_products(rows)), 0.0)


@program
def _products(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return flat.T @ flat


def _sums(
    rows: Float[np.ndarray, "trials n a"],
    here: Float[np.ndarray, "trials n"],
    gap: Float[np.ndarray, "trials n"],
    slow: Sequence[tuple[float, float, float]],
    white: float,
) -> list[Shape]:
    """Return the sums under slow parts, each of a size, a memory and whether it is smooth, beside a white part."""
    products, log_sd = _whitened_sums(rows, here, gap, *map(np.array, zip(*slow, strict=True)), white)
    return [Shape(*one) for one in zip(np.asarray(products), map(float, np.asarray(log_sd)), strict=True)]


@program
def _whitened_sums(
    rows: Array, here: Array, gap: Array, slow: Array, time: Array, smooth: Array, white: Array
) -> tuple[Array, Array]:
    """Return the sums of products of what is new in each measurement, by a Kalman filter, and of the logs of its sd, of each slow part.

    The slow part x has a correlation exp(-t / time), or, if it is smooth, as of a force that drifts and moves a mass, that times
    1 + t / time: with its rate over that of the memory, y,

        (x, y)' = exp(-t / time) [[1 + t / time, t / time], [-t / time, 1 - t / time]] (x, y) + noise

    What is new in a block of samples stays in the processor's cache until it is summed.
    """
    shapes, (n, columns) = slow.size, rows.shape[1:]
    half = columns // 2

    def weigh(cov: tuple, sample: tuple) -> tuple[tuple, tuple]:
        (xx, xy, yy), (is_here, t) = cov, sample
        past = jnp.minimum(t / time, 700.0)
        left, t = jnp.exp(-past), smooth * past
        a, b, c, d = left * (1.0 + t), left * t, -left * t, left * (1.0 - t)
        # What is lost of the covariance, that at rest being slow^2 of both, comes back as noise.
        xx, yy = xx - slow**2, yy - slow**2
        xx, xy, yy = (
            a * a * xx + 2.0 * a * b * xy + b * b * yy + slow**2,
            a * c * xx + (a * d + b * c) * xy + b * d * yy,
            c * c * xx + 2.0 * c * d * xy + d * d * yy + slow**2,
        )
        total = xx + white**2
        gain, along = is_here * xx / total, is_here * xy / total
        weights = jnp.stack([is_here / jnp.sqrt(total), gain, along, a, b, c, d])
        return (xx - gain * xx, xy - gain * xy, yy - along * xy), (weights, is_here * 0.5 * jnp.log(total))

    def follow(means: tuple, sample: tuple) -> tuple[tuple, Array]:
        (mean, rate), (row, weights) = means, sample
        weight, gain, along, a, b, c, d = weights[..., None]
        mean, rate = a * mean + b * rate, c * mean + d * rate
        innovation = row - mean
        return (mean + gain * innovation, rate + along * innovation), weight * innovation

    def add_block(carry: tuple, block: tuple) -> tuple[tuple, None]:
        means, sums = carry
        means, new = jax.lax.scan(follow, means, block)
        upper = jnp.einsum("nhi,nhj->hij", new[..., :half], new)
        lower = jnp.einsum("nhi,nhj->hij", new[..., half:], new[..., half:])
        return (means, (sums[0] + upper, sums[1] + lower)), None

    def add_trial(sums: tuple, trial: tuple) -> tuple[tuple, Array]:
        rows, here, gap = trial
        start = slow**2, jnp.zeros(shapes), slow**2
        _, (weights, log_sd) = jax.lax.scan(weigh, start, (here, gap))
        zero, length = jnp.zeros((shapes, columns)), gcd(n, BLOCK)
        blocks = rows.reshape(-1, length, columns), weights.reshape(-1, length, *weights.shape[1:])
        (_, sums), _ = jax.lax.scan(add_block, ((zero, zero), sums), blocks)
        return sums, log_sd.sum(0)

    nothing = jnp.zeros((shapes, half, columns)), jnp.zeros((shapes, columns - half, columns - half))
    (upper, lower), log_sd = jax.lax.scan(add_trial, nothing, (rows, here, gap))
    left = jnp.concatenate([upper[..., :half], upper[..., half:].swapaxes(1, 2)], 1)
    return jnp.concatenate([left, jnp.concatenate([upper[..., half:], lower], 1)], 2), log_sd.sum(0)


def _solve(
    information: Float[np.ndarray, "g a a"], precision: Float[np.ndarray, "g q"], mean: Float[np.ndarray, "g q"]
) -> tuple[Float[np.ndarray, "g q"], Float[np.ndarray, " g"], Float[np.ndarray, "g q q"]]:
    """Return the values of highest density, half the log determinants of their precisions, and the inverses of these."""
    q = precision.shape[1]
    size = np.sqrt(
        np.einsum("gii->gi", information)[:, 1:] + precision
    )  # those of columns differ by many powers of ten
    pairs = size[:, :, None] * size[:, None, :]
    whole = (information[:, 1:, 1:] + precision[:, :, None] * np.eye(q)) / pairs
    root = np.linalg.cholesky(whole)
    cov = np.linalg.inv(whole) / pairs
    log_volume = np.log(np.einsum("gii->gi", root) * size).sum(1)
    return np.einsum("gij,gj->gi", cov, information[:, 1:, 0] + precision * mean), log_volume, cov


def edges_of(posterior: Posterior) -> Float[np.ndarray, "d 2"]:
    """Return between which edges the map of each prior is straight, in z."""
    return np.array([one.prior.edges for one in posterior.parameters])


def inside(z: Float[np.ndarray, " d"], edges: Float[np.ndarray, "d 2"]) -> Float[np.ndarray, " d"]:
    """Return z no nearer to a bound than where a value still follows it."""
    return bent(np.clip(straightened(z, edges), edges[:, 0] + NEAR_BOUND, edges[:, 1] - NEAR_BOUND), edges)


def _along(
    rows: Float[np.ndarray, "trials n a"],
    z: Float[np.ndarray, " d"],
    x: Float[np.ndarray, " d"],
    slope: Float[np.ndarray, " d"],
) -> Float[np.ndarray, "trials n a"]:
    """Turn slopes along z into those along straight lines x, and what is expected with them, in place; see `linearise`."""
    along = rows[..., 1 : 1 + z.size]
    rows[..., 0] += along @ (x / slope - z)
    along /= slope
    return rows


def cut(
    values: Float[np.ndarray, "g q"], cov: Float[np.ndarray, "g q q"], edges: Float[np.ndarray, "k 2"]
) -> tuple[Float[np.ndarray, "g q"], Float[np.ndarray, "g q q"], Float[np.ndarray, " g"]]:
    """Return the moments of normal densities cut at the edges of the first k parameters, and the logs of the shares that are left."""
    log_share = np.zeros(len(values))
    for k in np.flatnonzero(np.isfinite(edges).any(1)):
        sd = np.sqrt(cov[:, k, k])
        low, high = (edges[k] - values[:, k, None]).T / sd
        turned = np.where(low > -high, -1.0, 1.0)  # the tail in which logs keep their digits
        low, high = np.where(turned < 0, -high, low), np.where(turned < 0, -low, high)
        log_high = scipy.special.log_ndtr(high)
        share = log_high + np.log(-np.expm1(np.minimum(scipy.special.log_ndtr(low) - log_high, -TINY)))
        at_low, at_high = (np.exp(-0.5 * edge**2 - LOG_ROOT - share) for edge in (low, high))
        shift = at_low - at_high
        with np.errstate(invalid="ignore"):
            ends = [np.where(density > 0, edge * density, 0.0) for edge, density in ((low, at_low), (high, at_high))]
        narrowed = np.clip(1.0 + ends[0] - ends[1] - shift**2, MIN_NARROWED, 1.0)
        column = cov[:, :, k] / sd[:, None]
        values = values + column * (turned * shift)[:, None]
        cov = cov + column[:, :, None] * column[:, None, :] * (narrowed - 1.0)[:, None, None]
        log_share = log_share + share
    return values, cov, log_share
