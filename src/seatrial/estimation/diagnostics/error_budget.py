"""Standard deviations that contain every error: noise, what is stated, differences between runs, and what the model may lack.

About the mode all is linear and normal: measurements y = J z + G w + e, with the sensitivities J of the parameters z and G of the sizes w
of the sources (`error_sources`), and noise e of covariance R. For a set S of sources with standard deviations s the parameters and the
sizes have, with W = diag(1 / s^2) and the curvature P of the prior about its peak m,

    precision   H = [J G]' R^-1 [J G] + diag(P, W)
    values      H^-1 ([J G]' R^-1 y + (P m, 0))
    log p(y|S)  = log N(y - J z - G w; 0, R) - 1/2 (z - m)' P (z - m) - 1/2 w' W w - 1/2 log|H| + 1/2 log|W| + constant

Which sources there are, and how large, is not known: their sets are averaged by these densities times their prior probabilities. Stated
sources are in each set. None of the others is there with the probability `NOTHING`; a term of another structure is as probable as not, and
has its own prior. The noise of each channel is the one that makes the residuals of a set most probable, among the shape at
the mode and such with a smaller slow part: what a source explains was a part of the noise. A set is followed: the motion and its
sensitivities are found anew at the values of the best one, until these stay. The stated smooth force is added to the sets once their
probabilities are known: it would take up what an effect explains, and hide its size.

Parameters are those on the straight lines that the maps of priors bend into their bounds: a box is flat there, and cut. A set's density is
times the share of its normal density between the bounds, one parameter after the other, and its values and covariance are the moments of
what is left, exact of one parameter that is cut.

A parameter lies within x of its value at the mode with the probability sum_S p_S [Phi((x - shift_S) / sd_S) - Phi((-x - shift_S) / sd_S)]
(Hoeting et al., Statistical Science 14, 1999). The standard deviation with all errors is the x of 90 %, over that of one normal
density: the variance of the average would be that of sets of little probability.

An estimate of a linear model is off by the sum of what each source does, so that its variance is the sum over sources: with K the gain of z
on y, K R K' is that of the noise, and (K G)_j^2 s_j^2 that of a source j.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.special import log_ndtr, ndtr, ndtri

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_kind
from seatrial.core.result_table import table_html, table_text
from seatrial.estimation.diagnostics.error_sources import (
    LAGS,
    Effect,
    Perturbed,
    Source,
    StatedErrors,
    lay_out,
    linearise,
)
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.estimation.posterior.mode import Mode, expand_prior
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors import Prior, Uniform
from seatrial.estimation.priors.box import bent, log_slopes, straightened
from seatrial.estimation.simulation.sensor_errors import (
    Sensor,
    correlation_name,
    drift_name,
    drift_time_name,
    noise_name,
)
from seatrial.estimation.simulation.trial_data import FOREVER, ChannelData

if TYPE_CHECKING:
    from pandas import DataFrame

NOTHING = 0.9  # Probability that none of the sources that are looked for is there
SHARES = np.geomspace(0.003, 3.0, 7)  # Standard deviations of sizes that are found, shares of the force
SHRUNK = (1.0, 0.3, 0.1, 0.0)  # Slow parts of a noise that are tried, over that at the mode
# Slow parts that are tried under a noise taken as white: sizes, over the white part, and memories, in intervals of the
# samples.
SLOW, LENGTHS = (0.5, 2.0), (5.0, 50.0, 500.0)
MAX_SOURCES, KEPT = 3, 4  # Sources in a set at most, and sets to which another is added
NEAR_SIZES = 3  # Sizes of a source that are tried beside others
MIN_LOG_SHARE = -6.0  # Log probability of such a set, over that of the best
ROUNDS, SETTLED = 9, 0.2  # Rounds in which sets are followed at most; move of a value, over its sd, that ends them
WIDE_LAGS, CLOSE_LAGS, NEAR_LAG = 1.3, 1.05, 0.1  # Ratios about a lag that was found, and its move that narrows them
LATE = "command lag", "delay", "backlash"  # Effects of two columns, whose size is between those of these
MIN_LATE, MIN_LAG = 0.2, 0.02  # Share of a command that comes late, and lag, s, from which a lag is followed
# Rounds in which the noise of a set is found at most, and the gain that ends them.
NOISE_ROUNDS, NOISE_SETTLED = 6, 1e-3
# Probability below the upper end of a 90 % interval, and halvings by which that end is found.
BAND, BISECTIONS = 0.95, 50
# Shift of a coefficient, in standard deviations, and log odds from which a missing effect is reported: 20 to 1, strong
# evidence (Kass and Raftery, Journal of the American Statistical Association 90, 1995).
MIN_SHIFT, MIN_LOG_ODDS = 1.0, 3.0
MIN_SLOW_RATIO = 1.5  # Ratio of a standard deviation to that of white noise from which slow noise is named as its cause
MIN_CONTRADICTION = 2.5  # Distance of a stated input from its value by the data, in stated standard deviations
MIN_ALIKE_SHARE = 0.05  # Probability of an effect in place of the one that is found, from which it is named beside it
MAX_LEFT = 0.8  # Share of the variance of each channel that slow residuals leave from which a model describes nothing
MAX_CAUSES, MIN_CAUSE_SHARE = 3, 0.5  # Sources named as a cause at most, and their share of what the first of them adds
TINY = float(np.finfo(float).tiny)
LOG_ROOT = 0.5 * float(np.log(2.0 * np.pi))
# Distances in z from a bound: within which the motion is not linearised, and from which on a prior has no bend. Slope of the map of a
# prior below which a mode lies at a bound, and least variance that a cut leaves, over that before it.
NEAR_BOUND, CLEAR, MIN_SLOPE, MIN_NARROWED = 0.01, 0.25, 0.5, 1e-9
SMOOTH = "smooth force"
MIN_WEIGHT = 1e-4  # Probability of a set, over that of the best, below which it is left out of the average
ORIGINS = ("noise", "stated", "runs", "model")
EXACT = StatedErrors(0.0, 0.0, 0.0, 0.0)


class Omitted(NamedTuple):
    """An effect that the model lacks.

    Attributes:
        effect: which.
        size: its estimated size, in its own unit.
        sd: standard error of the size.
        log_odds: that it is there.
        shift: by how much the parameters would move if it were added, over their standard deviations, shape (k,).
        alike: effects that may be there in its place.
    """

    effect: Effect
    size: float
    sd: float
    log_odds: float
    shift: Float[np.ndarray, " k"]
    alike: tuple[Effect, ...]


@dataclass(frozen=True)
class ErrorBudget:
    """Standard deviations with all errors, of each of the k parameters that all runs share.

    Attributes:
        names: of the parameters.
        ratio: standard deviation with all errors, over that of the normal approximation within the model, shape (k,).
        shares: of the variance from each of `ORIGINS`, shape (4, k).
        causes: sources that make most of what the noise does not, by parameter.
        omitted: effects that are there more probably than not, the most probable first.
        tried: effects that were looked for; none where the likelihood has process noise, or is one's own.
        stated: of each stated source but the smooth force its value after the data and its standard deviation, over the one stated.
        slow: channels whose residuals are slow although their noise is taken as white.
        describes: whether the best set leaves less than slow residuals of nearly the whole variance on some channel; where not, each
            standard deviation is that of the prior.
        farthest: root mean square distances of the priors from the values at the mode, SI, shape (k,): as far off as a value is by the
            prior alone.
        values: at the mode, SI, shape (k,).
        within: standard deviations of the normal approximation within the model, SI, shape (k,).
        units: SI units.
    """

    names: tuple[str, ...]
    ratio: Float[np.ndarray, " k"]
    shares: Float[np.ndarray, "4 k"]
    causes: tuple[tuple[Effect, ...], ...]
    omitted: tuple[Omitted, ...]
    tried: tuple[Effect, ...]
    stated: Mapping[Effect, tuple[float, float]]
    slow: tuple[str, ...]
    describes: bool
    farthest: Float[np.ndarray, " k"]
    values: Float[np.ndarray, " k"]
    within: Float[np.ndarray, " k"]
    units: tuple[str, ...]

    def summary(self) -> "DataFrame":
        """Return a table with a row for each parameter, SI: value, standard deviation with all errors, shares of its variance, and the
        source that adds most if that is not the noise."""
        from pandas import DataFrame

        columns: dict[str, Any] = {"unit": self.units, "value": self.values}
        columns["sd"] = [self.sd(name, float(one)) for name, one in zip(self.names, self.within, strict=True)]
        columns |= dict(zip(ORIGINS, self.shares, strict=True))
        first = [self.cause(name)[:1] for name in self.names]
        columns["cause"] = [f"{one[0].kind} {one[0].of}".rstrip() if one else "" for one in first]
        return DataFrame(columns, index=list(self.names))

    _heading = "Standard deviations with all errors, SI"

    @property
    def _remarks(self) -> list[str]:
        return [] if self.tried else ["the noise alone: beside process noise other errors are not weighed"]

    __repr__ = table_text
    _repr_html_ = table_html

    def sd(self, name: str, within: float) -> float:
        """Return the standard deviation of a parameter with all errors, at most that of its prior about the value.

        Args:
            name: of the parameter; of one that a run has of its own it is `within`.
            within: its standard deviation within the model.
        """
        if name not in self.names:
            return within
        at = self.names.index(name)
        return max(within, min(within * float(self.ratio[at]), float(self.farthest[at])))

    def shares_of(self, name: str) -> ErrorShares:
        """Return what the variance of a parameter is made of; of one that a run has of its own, noise."""
        return ErrorShares(*map(float, self.shares[:, self.names.index(name)])) if name in self.names else ErrorShares()

    def is_prior(self, name: str, within: float) -> bool:
        """Whether that standard deviation is the one of the prior about the value: nothing narrows it."""
        at = self.names.index(name)
        return within < 0.999 * float(self.farthest[at]) <= 0.999 * within * float(self.ratio[at])

    def cause(self, name: str) -> tuple[Effect, ...]:
        """Return the sources that make most of the mean square error of a parameter; none where slow residuals do."""
        at = self.names.index(name)
        return self.causes[at] if self.shares[0, at] < 0.5 else ()


def error_budget(posterior: Posterior, mode: Mode, stated: StatedErrors = StatedErrors()) -> ErrorBudget:
    """Return the standard deviations at the mode with all errors, and what they are made of.

    Args:
        posterior: of records; of a log density of one's own, and of one with process noise, the normal approximation is all there is.
        mode: of the posterior, all its parameters.
        stated: standard deviations of what no residual shows.
    """
    check_kind(posterior, Posterior, "posterior", "make it with `make_posterior`")
    check_kind(mode, Mode, "mode", "find it with `find_mode`")
    check_kind(stated, StatedErrors, "stated", "make them with `StatedErrors`")
    shared = np.array([i for i in posterior.places if "[" not in posterior.names[i]], int)
    names = tuple(posterior.names[i] for i in shared)
    values = dict(zip(mode.names, mode.values, strict=True))
    priors = {one.name: one.prior for one in posterior.parameters}
    farthest = np.array([np.hypot(priors[one].sd, values[one] - priors[one].mean) for one in names])
    sds, units = dict(zip(mode.names, mode.sd, strict=True)), {one.name: one.unit for one in posterior.parameters}
    value, within = (np.array([one[name] for name in names]) for one in (values, sds))
    at_mode = value, within, tuple(units[name] for name in names)
    shares = np.repeat(np.array([[1.0], [0.0], [0.0], [0.0]]), len(names), 1)
    alone = ErrorBudget(
        names, np.ones(len(names)), shares, ((),) * len(names), (), (), {}, (), True, farthest, *at_mode
    )
    if not isinstance(posterior.likelihood, OutputError):
        return alone
    model, members = follow_sources(posterior, mode, stated)
    edges = edges_of(posterior)
    x, slope = straightened(mode.z, edges), np.exp(log_slopes(mode.z, edges))
    # About a bound the normal approximation says nothing of a parameter, of the others that they hold with it.
    sd = np.where(slope > MIN_SLOPE, np.sqrt(np.diag(mode.cov)) * slope, np.inf)
    moving = {place: k for k, place in enumerate(model.moving)}
    ratio, shares = np.ones(len(names)), shares.copy()
    weight = np.exp([one.log_density - members[0].log_density for one in members])
    members, weight = members[: (kept := int((weight > MIN_WEIGHT).sum()))], weight[:kept] / weight[:kept].sum()
    widened = model.with_force(stated.force, members)
    causes: list[tuple[Effect, ...]] = [()] * len(names)
    for k, place in enumerate(shared):
        if place not in moving or np.isinf(sd[place]):
            continue
        at = moving[place]
        shift = np.array([one.values[at] - x[place] for one in widened]) / sd[place]
        width = np.array([np.sqrt(one.cov[at, at]) for one in widened]) / sd[place]
        ratio[k] = max(1.0, half_width(weight, shift[:, None], width[:, None])[0] / ndtri(BAND))
        added = model.added(widened, weight, at, x[place])
        shares[:, k] = _by_origin(model.sources, added)
        causes[k] = _most(model.sources, added[1:])
    omitted = _omitted(model, members, weight, x, shared, moving, sd)
    tried = tuple(model.sources[i].effect for i in model.options)
    sensors = zip(posterior.likelihood.simulator.sensors, members[0].noise, strict=True)
    slow = tuple(one.channel for one, (shape, _) in sensors if shape and one.noise in ("white", "heavy"))
    after, describes = model.after(members[0]), model.describes(members[0], posterior.data.channels)
    if not describes:
        ratio = np.full(len(names), np.inf)
    return ErrorBudget(names, ratio, shares, tuple(causes), omitted, tried, after, slow, describes, farthest, *at_mode)


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
        expected = [_along(rows, at.z, self.x, slope) for rows in linearise(posterior, at)]
        self.is_finite = all(np.isfinite(one).all() for one in expected)
        values = dict(zip(names, np.asarray(posterior.constrain(at.z)), strict=True))
        kept = np.r_[0, 1 + np.array(self.moving, int), 1 + len(names) + np.arange(at.sizes.size)]
        self.channels: list[tuple[float, list[Shape]]] = []
        self.first: list[tuple[int, float]] = []
        for rows, channel, sensor in zip(expected, posterior.data.channels, likelihood.simulator.sensors, strict=True):
            shapes = noise_shapes(sensor, values, channel, rows[..., kept]) if self.is_finite else []
            self.channels.append((float(np.asarray(channel.present).sum()), shapes))
            self.first.append((0, float(values[noise_name(sensor.channel)])))
        # Where a map bends, its slope is a part of the density of the prior; on the line it is none.
        clear = np.clip(self.x, edges[:, 0] + CLEAR, edges[:, 1] - CLEAR)
        prior = np.asarray(expand_prior(posterior, clear)[0])[:, self.moving]
        self.curvature = np.maximum(-prior[2], TINY)
        self.peak = clear[self.moving] + prior[1] / self.curvature
        self.height = prior[0] + 0.5 * prior[1] ** 2 / self.curvature
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
            squares = [self._squares(here, one, sums) for one in (values, peak)]
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
        """Return for each channel the squares that g sets leave under noise of each of h shapes."""
        away = np.zeros((len(values), sums[0].shape[1]))
        np.put_along_axis(away, among, np.c_[np.ones(len(values)), -values], 1)
        return [((away @ own) * away).sum(2) for own in sums]  # of all columns: one product of matrices for each shape

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
        smooth = {
            i: Option(0.0, share, 0.0) for i, one in enumerate(self.sources) if one.effect.kind == SMOOTH and share
        }
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
        """Whether a set leaves less than slow residuals of nearly the whole variance of some channel, about the mean of each run."""
        k, away = len(self.moving), np.zeros(1 + len(self.moving) + self.at.sizes.size)
        away[0], away[1 : 1 + k], away[1 + k + member.columns] = 1.0, -member.values[:k], -member.values[k:]
        for (_, shapes), channel, (shape, _) in zip(self.channels, channels, member.noise, strict=True):
            here, y = (np.asarray(one, float) for one in (channel.present, channel.measured))
            mean = (here * y).sum(1, keepdims=True) / np.maximum(here.sum(1, keepdims=True), 1.0)
            white = [i for i, one in enumerate(shapes) if one.log_sd == 0.0]
            if (
                not white
                or shape in white
                or away @ shapes[white[0]].products @ away < MAX_LEFT * np.sum(here * (y - mean) ** 2)
            ):
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
        rows: columns, 0 where it was not.
    """
    where = channel.present, channel.gaps, channel.kind
    if sensor.noise == "coloured":
        return [_sums(rows, *where, 1.0, values[correlation_name(sensor.channel)], 0.0, 0.0)]
    if sensor.noise != "drifting":
        gaps = np.asarray(channel.gaps)
        step = float(np.median(gaps[gaps < FOREVER])) if (gaps < FOREVER).any() else 1.0
        slow = [(size, length * step, smooth) for size in SLOW for length in LENGTHS for smooth in (0.0, 1.0)]
        return [_sums(rows, *where, size, time, 1.0, smooth) for size, time, smooth in [(0.0, 1.0, 0.0), *slow]]
    slow = values[drift_name(sensor.channel)] / values[noise_name(sensor.channel)]
    return [_sums(rows, *where, shrunk * slow, values[drift_time_name(sensor.channel)], 1.0, 0.0) for shrunk in SHRUNK]


def _sums(rows: Any, present: Any, gaps: Any, kind: Any, slow: Any, time: Any, white: Any, smooth: Any) -> Shape:
    products, log_sd = _whitened_sums(rows, present, gaps, kind, slow, time, white, smooth)
    return Shape(np.asarray(products), float(log_sd))


@program
def _whitened_sums(
    rows: Array, present: Array, gaps: Array, kind: Array, slow: Array, time: Array, white: Array, smooth: Array
) -> tuple[Array, Array]:
    """Return the sums of products of what is new in each measurement, by a Kalman filter, and of the logs of its sd.

    The slow part x has a correlation exp(-t / time), or, where it is smooth, as of a force that drifts and moves a mass, that times
    1 + t / time: with its rate over that of the memory, y,

        (x, y)' = exp(-t / time) [[1 + t / time, t / time], [-t / time, 1 - t / time]] (x, y) + noise
    """

    def of_trial(rows: Array, present: Array, gaps: Array, kind: Array) -> tuple[Array, Array]:
        past = jnp.minimum(gaps / time, 700.0)[kind]

        def advance(carry: tuple, sample: tuple) -> tuple[tuple, tuple]:
            (mean, rate), (xx, xy, yy) = carry
            row, here, t = sample  # the time since what was measured before
            left, t = jnp.exp(-t), smooth * t
            a, b, c, d = left * (1.0 + t), left * t, -left * t, left * (1.0 - t)
            mean, rate = a * mean + b * rate, c * mean + d * rate
            # What is lost of the covariance, that at rest being slow^2 of both, comes back as noise.
            xx, xy, yy = xx - slow**2, xy, yy - slow**2
            xx, xy, yy = (
                a * a * xx + 2.0 * a * b * xy + b * b * yy + slow**2,
                a * c * xx + (a * d + b * c) * xy + b * d * yy,
                c * c * xx + 2.0 * c * d * xy + d * d * yy + slow**2,
            )
            total = xx + white**2
            innovation, gain, along = row - mean, xx / total, xy / total
            after = mean + gain * innovation, rate + along * innovation
            after = after, (xx - gain * xx, xy - gain * xy, yy - along * xy)
            carry = jax.tree.map(lambda new, old: jnp.where(here > 0, new, old), after, carry)
            return carry, (here * innovation / jnp.sqrt(total), here * 0.5 * jnp.log(total))

        zero = jnp.zeros(rows.shape[1])
        start = (zero, zero), (slow**2 * jnp.ones(()), jnp.zeros(()), slow**2 * jnp.ones(()))
        _, (new, log_sd) = jax.lax.scan(advance, start, (rows, present, past))
        return new.T @ new, log_sd.sum()

    products, log_sd = jax.vmap(of_trial)(rows, present, gaps, kind)
    return products.sum(0), log_sd.sum()


def follow_sources(
    posterior: Posterior, mode: Mode, stated: StatedErrors, among: Collection[Effect] | None = None
) -> tuple[LinearModel, list[Member]]:
    """Return the sets of sources, of all or among some effects, about the motion of the best one.

    The smooth force waits until the others have settled: it would take up what is not linear about them. A lag and a delay are alike at
    first: where the best set has one of them, it is looked whether one without it leads to a better.
    """
    left_out = (SMOOTH,)
    model, best = _follow_best(posterior, mode, stated, left_out, among)
    for kind in {model.sources[i].effect.kind for i, _ in best.chosen} & {*LATE}:
        other = _follow_best(posterior, mode, stated, (*left_out, kind), among)
        model, best = max((model, best), other, key=lambda pair: pair[1].log_density)
    return model, model.average()


def _follow_best(
    posterior: Posterior,
    mode: Mode,
    stated: StatedErrors,
    left_out: Sequence[str],
    among: Collection[Effect] | None,
) -> tuple[LinearModel, Member]:
    """Follow the best set of sources, but for some kinds, from the mode to where it stays."""
    edges = edges_of(posterior)
    at = lay_out(posterior, inside(mode.z, edges), stated, among=among)
    assert at is not None, "the motion at the mode is finite"
    known = model = LinearModel(posterior, at)
    z, sizes, lags = at.z, at.sizes, at.lags
    for _ in range(ROUNDS):
        if model is not None and model.is_finite:
            known, best = model, model.average(left_out)[0]
            k = len(known.moving)
            x, sizes = known.x.copy(), np.zeros(known.at.sizes.size)
            x[known.moving], sizes[best.columns] = best.values[:k], best.values[k:]
            z = inside(bent(x, edges), edges)
            moved = np.abs(straightened(z, edges) - known.x)[known.moving] / np.sqrt(np.diag(best.cov)[:k])
            lags, own = _follow_lags(known, sizes)
            if moved.max(initial=0.0) < SETTLED and all(b / a < WIDE_LAGS for a, b in lags.values()):
                break
        else:  # too far: half of the way
            z, sizes, lags = 0.5 * (z + known.at.z), 0.5 * (sizes + known.at.sizes), known.at.lags
            own = sizes
        at = lay_out(posterior, z, stated, known.at, sizes, lags, among)
        model = None if at is None else LinearModel(posterior, at._replace(sizes=own))
    return known, best


def _follow_lags(
    model: LinearModel, sizes: Float[np.ndarray, " m"]
) -> tuple[dict[Effect, tuple[float, float]], Float[np.ndarray, " m"]]:
    """Return pairs of lags about those that were found, and sizes that mean the same with them."""
    lags, sizes = {}, sizes.copy()
    for one in model.sources:
        if one.effect.kind not in LATE:
            continue
        pair, places = np.array(model.at.lags.get(one.effect, LAGS)), list(one.columns)
        late = float(sizes[places].sum())
        if late > MIN_LATE and (lag := float(sizes[places] @ pair) / late) > MIN_LAG:
            lag = float(np.clip(lag, 0.5 * pair[0], 2.0 * pair[1]))
            is_near = one.effect in model.at.lags and abs(np.log(lag / np.sqrt(np.prod(pair)))) < NEAR_LAG
            ratio = CLOSE_LAGS if is_near else WIDE_LAGS
            lags[one.effect] = lag / ratio, lag * ratio
            sizes[places] = 0.5 * late
    return lags, sizes


def _omitted(
    model: LinearModel,
    members: Sequence[Member],
    weight: Float[np.ndarray, " s"],
    x: Float[np.ndarray, " d"],
    shared: Int[np.ndarray, " k"],
    moving: Mapping[int, int],
    sd: Float[np.ndarray, " d"],
) -> tuple[Omitted, ...]:
    """Return the effects that are there more probably than not, the most probable first."""
    within = [{i for i, _ in one.chosen} for one in members]
    result = []
    for i in model.options:
        there = np.array([i in one for one in within])
        probability = float(weight[there].sum())
        if probability <= 0.5:
            continue
        source, best = model.sources[i], members[int(np.argmax(there))]
        k = len(model.moving)
        at = k + np.flatnonzero(np.isin(best.columns, source.columns))
        is_late = source.effect.kind in LATE
        along = np.array(model.at.lags.get(source.effect, LAGS)) if is_late else np.ones(at.size)
        size = source.worth * float(along @ best.values[at])
        error = abs(source.worth) * float(np.sqrt(along @ best.cov[np.ix_(at, at)] @ along))
        if at.size > 1 and not is_late:  # of runs, or of places: no one size
            size, error = abs(source.worth) * float(np.sqrt(np.mean(best.values[at] ** 2))), 0.0
        shift = np.array(
            [(best.values[moving[place]] - x[place]) / sd[place] if place in moving else 0.0 for place in shared]
        )
        rivals = {
            j: float(weight[[j in one and i not in one for one in within]].sum()) for j in model.options if j != i
        }
        alike = tuple(model.sources[j].effect for j in rivals if rivals[j] > MIN_ALIKE_SHARE)
        log_odds = float(np.log(probability) - np.log(max(1.0 - probability, TINY)))
        result.append(Omitted(source.effect, size, error, log_odds, shift, alike))
    return tuple(sorted(result, key=lambda one: -one.log_odds))


def _by_origin(sources: Sequence[Source], added: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 4"]:
    """Return the shares of a mean square error from noise, what is stated, differences between runs, and the model."""
    origin = [2 if one.effect.kind == "run force" else 1 if one.stated is not None else 3 for one in sources]
    return np.bincount([0, *origin], added, 4) / added.sum()


def _most(sources: Sequence[Source], added: Float[np.ndarray, " n"]) -> tuple[Effect, ...]:
    """Return the effects of the sources that add most, the largest first."""
    largest = np.argsort(-added, kind="stable")[:MAX_CAUSES]
    return tuple(sources[i].effect for i in largest if added[i] > MIN_CAUSE_SHARE * max(added[largest[0]], TINY))


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
    """Return what is expected of a channel and its slopes along straight lines x, from those along z; see `linearise`."""
    d = z.size
    along = rows[..., 1 : 1 + d] / slope
    expected = rows[..., 0] - rows[..., 1 : 1 + d] @ z + along @ x
    return np.concatenate([expected[..., None], along, rows[..., 1 + d :]], -1)


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
        log_high = log_ndtr(high)
        share = log_high + np.log(-np.expm1(np.minimum(log_ndtr(low) - log_high, -TINY)))
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
        held = share @ (ndtr((middle - shift) / sd) - ndtr((-middle - shift) / sd))
        low, high = np.where(held < 2 * BAND - 1, middle, low), np.where(held < 2 * BAND - 1, high, middle)
    return high
