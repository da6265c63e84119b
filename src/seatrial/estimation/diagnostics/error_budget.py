"""Standard deviations that contain every error: noise, what is stated, differences between runs, and what the model may lack.

The sets of sources (`linear_model`) are followed: the motion and its sensitivities are found anew at the values of the best set, until
these stay. The stated smooth force is added to the sets once their probabilities are known: it would take up what an effect explains, and
hide its size.

A parameter lies within x of its value at the mode with the probability sum_S p_S [Phi((x - shift_S) / sd_S) - Phi((-x - shift_S) / sd_S)]
(Hoeting et al., Statistical Science 14, 1999). The standard deviation with all errors is the x of 90 %, over that of one normal
density: the variance of the average would be that of sets of little probability.

An estimate of a linear model is off by the sum of what each source does, so that its variance is the sum over sources: with K the gain of z
on y, K R K' is that of the noise, and (K G)_j^2 s_j^2 that of a source j.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

from seatrial.core.argument_checks import check_kind
from seatrial.core.result_table import table_html, table_text
from seatrial.estimation.diagnostics.error_sources import (
    LAGS,
    Effect,
    Source,
    StatedErrors,
    lay_out,
)
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.estimation.diagnostics.linear_model import SMOOTH, TINY, LinearModel, Member, edges_of, inside
from seatrial.estimation.posterior.configurations import ConfigurationDifference, differences
from seatrial.estimation.posterior.mode import MIN_LONG_SAMPLES, Mode
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.priors.box import bent, log_slopes, straightened

if TYPE_CHECKING:
    from pandas import DataFrame

ROUNDS, SETTLED = 9, 0.2  # Rounds in which sets are followed at most; move of a value, over its sd, that ends them
MAX_DROP = 10.0  # Nats by which the best set may become less probable about the motion that it leads to
WIDE_LAGS, CLOSE_LAGS, NEAR_LAG = 1.3, 1.05, 0.1  # Ratios about a lag that was found, and its move that narrows them
LATE = "command lag", "delay", "backlash"  # Effects of two columns, whose size is between those of these
MIN_LATE, MIN_LAG = 0.2, 0.02  # Share of a command that comes late, and lag, s, from which a lag is followed
# Probability below the upper end of a 90 % interval, and halvings by which that end is found.
BAND, BISECTIONS = 0.95, 50
# Shift of a coefficient, in standard deviations, and log odds from which a missing effect is reported: 20 to 1, strong
# evidence (Kass and Raftery, Journal of the American Statistical Association 90, 1995).
MIN_SHIFT, MIN_LOG_ODDS = 1.0, 3.0
MIN_SLOW_RATIO = 1.5  # Ratio of a standard deviation to that of white noise from which slow noise is named as its cause
MIN_CONTRADICTION = 2.5  # Distance of a stated input from its value by the data, in stated standard deviations
MIN_ALIKE_SHARE = 0.05  # Probability of an effect in place of the one that is found, from which it is named beside it
MAX_CAUSES, MIN_CAUSE_SHARE = 3, 0.5  # Sources named as a cause at most, and their share of what the first of them adds
MIN_SLOPE = 0.5  # Slope of the map of a prior below which a mode lies at a bound
MIN_WEIGHT = 1e-4  # Probability of a set, over that of the best, below which it is left out of the average
ORIGINS = ("noise", "stated", "runs", "model")
EXACT = StatedErrors(0.0, 0.0, 0.0, 0.0)


class Omitted(NamedTuple):
    """An effect that the model lacks.

    Attributes:
        effect: which.
        size: its estimated size, in its own unit.
        sd: standard error of the size.
        log_odds: that it is there, or one of those alike.
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
        ratio: standard deviation with all errors, divided by that of the normal approximation within the model, shape (k,).
        shares: of the variance from each of `ORIGINS`, shape (4, k).
        causes: sources of most of the error that is not noise, by parameter.
        omitted: effects with a probability above one half, the most probable first.
        tried: effects that were tried; none if the likelihood has process noise, or is the user's.
        stated: of each stated source but the smooth force, its value by the data and its standard deviation, divided by the stated one.
        slow: channels with slow residuals and a white noise model.
        describes: whether the best set without a smooth force leaves less than slow residuals of most of the variance on some channel;
            if not, each standard deviation is as wide as the prior.
        farthest: root mean square distances of the priors from the values at the mode, SI, shape (k,): as far off as a value is by the
            prior alone.
        values: at the mode, SI, shape (k,).
        within: standard deviations of the normal approximation within the model, SI, shape (k,).
        units: SI units.
        correlation: of the parameters with all errors: one that acts alike on two of them cancels in their difference, shape (k, k).
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
    correlation: Float[np.ndarray, "k k"]

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
        return [] if self.tried else ["only noise: with process noise, other errors are not computed"]

    __repr__ = table_text
    _repr_html_ = table_html

    def sd(self, name: str, within: float) -> float:
        """Return the standard deviation of a parameter with all errors, at most that of its prior about the value.

        Args:
            name: of the parameter; for one of a single run the result is `within`.
            within: its standard deviation within the model.
        """
        if name not in self.names:
            return within
        at = self.names.index(name)
        return max(within, min(within * float(self.ratio[at]), float(self.farthest[at])))

    def changes(self, values: Mapping[str, float], within: Mapping[str, float]) -> tuple[ConfigurationDifference, ...]:
        """Return the changes between configurations of the vehicle, with all errors.

        Args:
            values: of the parameters, SI.
            within: their standard deviations within the model, SI.
        """
        sd = np.array([self.sd(name, within[name]) for name in self.names])
        mean = np.array([values[name] for name in self.names])
        return differences(self.names, self.units, mean, self.correlation * np.outer(sd, sd))

    def shares_of(self, name: str) -> ErrorShares:
        """Return the parts of the variance of a parameter; for one of a single run, noise."""
        return ErrorShares(*map(float, self.shares[:, self.names.index(name)])) if name in self.names else ErrorShares()

    def is_prior(self, name: str, within: float) -> bool:
        """Whether that standard deviation is the one of the prior about the value: nothing narrows it."""
        at = self.names.index(name)
        return within < 0.999 * float(self.farthest[at]) <= 0.999 * within * float(self.ratio[at])

    def cause(self, name: str) -> tuple[Effect, ...]:
        """Return the sources of most of the mean square error of a parameter; none if slow residuals are."""
        at = self.names.index(name)
        return self.causes[at] if self.shares[0, at] < 0.5 else ()


def error_budget(posterior: Posterior, mode: Mode, stated: StatedErrors = StatedErrors()) -> ErrorBudget:
    """Return the standard deviations at the mode with all errors, and their parts.

    Args:
        posterior: of records; for a user's log density, and with process noise, the result is only the normal approximation.
        mode: of the posterior, all its parameters.
        stated: standard deviations of stated inputs.
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
    correlation = mode.covariance[np.ix_(shared, shared)] / np.outer(within, within)
    alone = ErrorBudget(
        names, np.ones(len(names)), shares, ((),) * len(names), (), (), {}, (), True, farthest, *at_mode, correlation
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
    # A smooth force could follow any motion.
    plain = next(one for one in members if not {i for i, _ in one.chosen} & model.smooth)
    describes = model.describes(plain, posterior.data.channels)
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
        ratio[k] = max(1.0, half_width(weight, shift[:, None], width[:, None])[0] / scipy.special.ndtri(BAND))
        added = model.added(widened, weight, at, x[place])
        shares[:, k] = _by_origin(model.sources, added)
        causes[k] = _most(model.sources, added[1:])
    there = [k for k, place in enumerate(shared) if place in moving and np.isfinite(sd[place])]
    rows = [moving[shared[k]] for k in there]
    offsets = np.array([one.values[rows] for one in widened])
    offsets -= weight @ offsets
    joint = np.tensordot(
        weight, [one.cov[np.ix_(rows, rows)] + np.outer(off, off) for one, off in zip(widened, offsets, strict=True)], 1
    )
    correlation[np.ix_(there, there)] = joint / np.sqrt(np.outer(np.diag(joint), np.diag(joint)))
    omitted = _omitted(model, members, weight, x, shared, moving, sd)
    tried = tuple(model.sources[i].effect for i in model.options)
    sensors = zip(posterior.likelihood.simulator.sensors, members[0].noise, strict=True)
    slow = tuple(
        one.channel for one, (shape, _) in sensors if shape and one.noise in ("white", "heavy", "proportional")
    )
    after = model.after(members[0])
    if not describes:
        ratio, shares = np.full(len(names), np.inf), np.repeat(np.array([[0.0], [0.0], [0.0], [1.0]]), len(names), 1)
    return ErrorBudget(
        names, ratio, shares, tuple(causes), omitted, tried, after, slow, describes, farthest, *at_mode, correlation
    )


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
    """Follow the best set of sources, but for some kinds, from the mode to where it stays.

    The smooth force is not among those of the first round. Its columns are half of all, and on a long record most of the time, so that
    the first round does without them there.
    """
    edges = edges_of(posterior)

    def begin(smooth: bool) -> LinearModel:
        at = lay_out(posterior, inside(mode.z, edges), stated, among=among, smooth=smooth)
        assert at is not None, "the motion at the mode is finite"
        return LinearModel(posterior, at)

    is_short = posterior.data.step.size < MIN_LONG_SAMPLES
    first = known = model = begin(is_short)
    z, sizes, lags = first.at.z, first.at.sizes, first.at.lags
    best: Member | None = None
    for _ in range(ROUNDS):
        members = _sets_of(model, left_out) if model is not None else []
        if model is not None and members and (best is None or members[0].log_density > best.log_density - MAX_DROP):
            known, best = model, members[0]
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
        if at is None:
            model = None
            continue
        at.sizes[: own.size] = own
        model = LinearModel(posterior, at)
    if known is first and not is_short:
        known = begin(True)
        best = known.average(left_out)[0]
    assert best is not None, "of the motion at the mode sets are known"
    return known, best


def _sets_of(model: LinearModel, left_out: Sequence[str]) -> list[Member]:
    """Return the sets of sources about a motion; none if it is not finite, or too large for double precision to solve."""
    try:
        return model.average(left_out) if model.is_finite else []
    except np.linalg.LinAlgError:
        return []


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
        alike = [j for j in rivals if rivals[j] > MIN_ALIKE_SHARE]
        either = float(weight[[not one.isdisjoint({i, *alike}) for one in within]].sum())
        log_odds = float(np.log(either) - np.log(max(1.0 - either, TINY)))
        rival_effects = tuple(model.sources[j].effect for j in alike)
        result.append(Omitted(source.effect, size, error, log_odds, shift, rival_effects))
    return tuple(sorted(result, key=lambda one: -one.log_odds))


def _by_origin(sources: Sequence[Source], added: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 4"]:
    """Return the shares of a mean square error from noise, what is stated, differences between runs, and the model."""
    origin = [2 if one.effect.kind == "run force" else 1 if one.stated is not None else 3 for one in sources]
    return np.bincount([0, *origin], added, 4) / added.sum()


def _most(sources: Sequence[Source], added: Float[np.ndarray, " n"]) -> tuple[Effect, ...]:
    """Return the effects of the sources that add most, the largest first."""
    largest = np.argsort(-added, kind="stable")[:MAX_CAUSES]
    return tuple(sources[i].effect for i in largest if added[i] > MIN_CAUSE_SHARE * max(added[largest[0]], TINY))


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
        held = share @ (scipy.special.ndtr((middle - shift) / sd) - scipy.special.ndtr((-middle - shift) / sd))
        low, high = np.where(held < 2 * BAND - 1, middle, low), np.where(held < 2 * BAND - 1, high, middle)
    return high
