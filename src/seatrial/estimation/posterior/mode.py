"""The fast answer: posterior mode by trust-region Newton, and the normal approximation there.

A likelihood of records is climbed with its information instead of second derivatives (Gauss and Newton's method), and expanded exactly
at the mode alone.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float, Int

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_count, check_numbers
from seatrial.core.coefficients import is_coefficient
from seatrial.core.errors import NumericalError
from seatrial.core.findings import Finding
from seatrial.core.result_table import table_html, table_text
from seatrial.core.serialise import AS_LIST
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.information import expand_likelihood
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior, values_of
from seatrial.estimation.posterior.prior_bounds import bound_finding
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.sensor_errors import drift_name, drift_time_name, noise_name
from seatrial.estimation.simulation.trial_data import first_samples
from seatrial.sampling.target import AT_ONCE, LANES, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

# Curvature in unconstrained space, where every prior has unit spread, that would make the posterior ten times wider
# than its prior.
MIN_CURVATURE = 1e-2
# How far a delay is looked for: in standard deviations of its prior, and closer in those of the posterior about the
# mode.
FARTHEST, NEAR = 3.0, 12.0
# Times that the closer look is widened at most, until the density at its ends is such a share of that at the mode.
DOUBLINGS, MAX_END_SHARE = 3, 1e-4
# Prior draws among which a search begins; fewer of a filter, each of which costs ten simulations.
PRIOR_DRAWS, PRIOR_DRAWS_OF_FILTER = 512, 64
# Samples of a trial from which the mode of its first such part is found first, as with wrong coefficients a long
# simulation goes astray; and the share of their standard deviation over all trials that the controls must reach in it.
MIN_LONG_SAMPLES, N_PARTS, MIN_EXCITATION = 8192, 8, 0.5
# Standard deviations of z within which a start keeps where a prior has bounds: at the bound itself z is infinite.
MAX_INSIDE_SDS = 2.0
# A top is known where a Newton step that gains less than so many nats ends beside it, squared and in standard
# deviations.
MAX_SAME_DISTANCE, MAX_SAME_GAIN = 0.01, 1.0
# A climb is given up whose last steps closed less than such a share of what a known top is higher.
PATIENCE_STEPS, MIN_GAIN_SHARE = 5, 0.2
# Looks at what a start leaves over, and the least share of the variance of the noise that one of them leaves.
NOISE_ROUNDS, MIN_NOISE_SHARE = 4, 1e-3
# Size of a slow part beside that of the white noise that does not matter, and what is left to climb, nats, where the motion is first found
# with it.
FAINT_DRIFT, ROUGH_GAIN = 1e-2, 1e-2
# White noise and slow part that are tried, in shares of what a fit with white noise leaves over, and levels of each at least.
WHITE_SHARES, DRIFT_SHARES, MIN_LEVELS = (1.0, 0.1), (0.03, 2.0), 3
MAX_FOLLOWED, MAX_ROUNDS = (
    3,
    3,
)  # Peaks along the delay, or modes of other structures, that are followed each time, and times
# Standard deviations at which the normal approximation is compared with the density, the largest first; and the fall,
# nats, up to which it holds there: at two it would be 2.
REACH, FALL = 2.0 * 0.7 ** np.arange(16), 6.0
MIN_RISE = 0.1  # Nats above a mode that neither rounding nor the end of a climb explains


class Mode(NamedTuple):
    """Posterior mode in unconstrained space and the Laplace approximation about it.

    Attributes:
        z: mode, shape (d,).
        precision: negative Hessian of the log posterior density, shape (d, d); along a delay, that of its profile.
        cov: its inverse, shape (d, d).
        log_density: unnormalised log posterior density at the mode.
        log_evidence: Laplace approximation of the log evidence.
        values: the mode in the parameters' own units, shape (d,).
        sd: delta-method standard deviations of `values`, shape (d,).
        flat: whether a direction had no curvature, so that its variance was set to the prior's.
        names: of the parameters.
        units: theirs, SI.
        at_bounds: findings about parameters at a bound of their prior.
    """

    z: Annotated[Float[np.ndarray, " d"], AS_LIST]
    precision: Annotated[Float[np.ndarray, "d d"], AS_LIST]
    cov: Annotated[Float[np.ndarray, "d d"], AS_LIST]
    log_density: float
    log_evidence: float
    values: Annotated[Float[np.ndarray, " d"], AS_LIST]
    sd: Annotated[Float[np.ndarray, " d"], AS_LIST]
    flat: bool
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    at_bounds: tuple[Finding, ...] = ()

    @property
    def by_name(self) -> dict[str, float]:
        """The mode by parameter name, SI."""
        return dict(zip(self.names, map(float, self.values), strict=True))

    @property
    def covariance(self) -> Float[np.ndarray, "d d"]:
        """Covariance of `values` by the delta method, SI, shape (d, d)."""
        slope = self.sd / np.sqrt(np.diag(self.cov))
        return self.cov * np.outer(slope, slope)

    @property
    def scale(self) -> Float[np.ndarray, "d d"]:
        """Lower triangle L of the covariance L L', also if rounding makes the covariance singular."""
        values, vectors = np.linalg.eigh(self.cov)
        return triangular_root(vectors * np.sqrt(np.maximum(values, np.finfo(float).tiny)))

    def only(self, at: Int[np.ndarray, " k"]) -> "Mode":
        """Return the mode without the parameters that are absent, of which the density is the standard normal one.

        Args:
            at: places of those that are present, `Posterior.places`.
        """
        absent, block = self.z.size - at.size, np.ix_(at, at)
        return Mode(
            self.z[at],
            self.precision[block],
            self.cov[block],
            self.log_density + 0.5 * absent * float(np.log(2 * np.pi)),
            self.log_evidence,
            self.values[at],
            self.sd[at],
            self.flat,
            tuple(self.names[i] for i in at),
            tuple(self.units[i] for i in at),
            self.at_bounds,
        )

    def expected(self, known: Mapping[str, float]) -> dict[str, float]:
        """Return the values that the normal approximation expects of the other parameters if those of some are known, SI, by name."""
        at = [i for i, name in enumerate(self.names) if name in known]
        rest = [i for i, name in enumerate(self.names) if name not in known]
        cov = self.covariance
        off = np.array([known[self.names[i]] for i in at]) - self.values[at]
        values = self.values[rest] + cov[np.ix_(rest, at)] @ np.linalg.lstsq(cov[np.ix_(at, at)], off)[0]
        return dict(zip((self.names[i] for i in rest), map(float, values), strict=True))

    def summary(self) -> "DataFrame":
        """Return a table with a row for each parameter: unit, value at the mode, and standard deviation of the normal approximation."""
        from pandas import DataFrame

        return DataFrame({"unit": self.units, "mode": self.values, "sd": self.sd}, index=list(self.names))

    @property
    def _heading(self) -> str:
        return f"Posterior mode, log evidence about {self.log_evidence:.2f}"

    @property
    def _remarks(self) -> list[str]:
        flat = ["a direction has no curvature: its variance is the prior's"] if self.flat else []
        return [*flat, *(f"{one.code}: {one.subject[0]}" for one in self.at_bounds)]

    __repr__ = table_text
    _repr_html_ = table_html


def find_mode(
    posterior: Posterior,
    *,
    key: jax.Array | int = 0,
    starts: int | None = None,
    tries: int = 3,
    near: Mapping[str, float] | None = None,
    rough: bool = False,
) -> Mode:
    """Maximise the posterior density from the best of many prior draws, and from the best of them moved to the posterior's guess.

    Commands are steps or lines between their samples, so that the density has a peak about every one of them along a
    delay. The delay is therefore scanned over its prior before the highest peak is taken, and its standard deviation is that of
    the profile over all of them.

    Args:
        posterior: density to maximise.
        key: random key of the prior draws, or a seed.
        starts: prior draws that are evaluated; None for 512, or 64 of a filter-error likelihood, whose density costs ten times more.
        tries: of these, how many of the best are followed to their maximum, beside the guess; of 1, the better of both. One from
            which the density only rises on the straight way to a maximum already found is not: it has nothing else to show.
        near: values by name, SI, near which there may be a mode; they take the place of one of the draws, with what is not told from the
            middle of its prior, and of parts of half of them. What lies outside its prior is moved inside.
        rough: end climbs where 0.01 nats are left, and take the information for the curvature there: enough to draw from, in a tenth of
            the time where commands have kinks.

    Returns:
        the mode, and the normal approximation about it.

    Raises:
        InputError: no posterior, sizes that are none, or in `near` a name of no parameter or something else than a number.
        NumericalError: no prior draw has a finite likelihood, or no maximum was found.
    """
    check_posterior(posterior)
    if starts is None:
        starts = PRIOR_DRAWS_OF_FILTER if isinstance(posterior.likelihood, FilterError) else PRIOR_DRAWS
    check_count(starts, "starts", remedy="take some hundreds")
    check_count(tries, "tries", remedy="leave it out, or follow a few")
    if rough:  # In z every prior is nearly a standard normal one; the exact draws are a program to compile.
        candidates = np.random.default_rng(np.asarray(jax.random.key_data(as_key(key)))).standard_normal(
            (starts, posterior.dim)
        )
    else:
        candidates = np.array(posterior.sample_prior(as_key(key), starts))
    candidates[-1] = 0.0  # the middle of the prior
    if near is not None:
        inside = _inside(posterior, check_numbers(near, "near", known=posterior.names))
        told = np.array([name in near for name in posterior.names])
        for row in inside:
            # Half of the draws of what is not told, such as sizes of the noise, are beside it.
            if not told[posterior.places].all():
                candidates[: starts // 2, told] = row[told]
            candidates[0] = row
    least_gain = ROUGH_GAIN if rough else 0.0
    z, log_density = _highest(posterior, candidates, tries, least_gain)
    if not np.isfinite(log_density):
        raise NumericalError("the search for the posterior mode left the region of finite likelihood; narrow the prior")
    mode = _about(posterior, z, log_density, rough)
    return _along_delay(posterior, mode, rough) if DELAY in posterior.present_names else mode


def higher_mode(posterior: Posterior, known: Mode | None, others: Sequence[Mode]) -> Mode | None:
    """Return a mode that is higher than the one known, above a mode of another structure; None if there is none.

    A structure that contains another has at least the density of the other's mode with its further terms at zero. That place is
    therefore looked at, and the best of all such places are climbed from.

    Args:
        posterior: of one structure.
        known: its highest mode known, None if none is.
        others: modes of structures that share parameters with it, of the same names.
    """
    starts = np.concatenate([np.empty((0, posterior.dim)), *(completed(posterior, one) for one in others)])
    if not len(starts):
        return None
    heights, best = _heights(posterior, starts), known
    for place in _best(heights)[:MAX_FOLLOWED]:
        known_modes = [] if best is None else [(best.z, best.log_density)]
        if best is not None and heights[place] <= best.log_density and is_uphill(posterior, starts[place], best.z):
            continue
        with suppress(NumericalError):
            z, log_density = _maximise(posterior, starts[place], known_modes)
            if best is None or log_density > best.log_density + MIN_RISE:
                best = _about(posterior, z, log_density)
    if best is known or best is None:
        return None
    return _along_delay(posterior, best) if DELAY in posterior.present_names else best


def completed(posterior: Posterior, other: Mode) -> Float[np.ndarray, "n d"]:
    """Return where a mode of another structure lies: what it lacks at zero, what is absent here left out, and what then is expected."""
    absent = [name for name in other.names if name not in posterior.present_names]
    values = {name: 0.0 for name in posterior.present_names if is_coefficient(name.partition("@")[0])} | other.by_name
    moved = other.expected(dict.fromkeys(absent, 0.0)) if absent else {}
    return np.concatenate([_inside(posterior, values), *([_inside(posterior, values | moved)] if moved else [])])


def _highest(
    posterior: Posterior, candidates: Float[np.ndarray, "n d"], tries: int, least_gain: float = 0.0
) -> tuple[Float[np.ndarray, " d"], float]:
    """Return the highest maximum above the guess and the best candidates; that of a long record begins at that of its first part."""
    part = _first_part(posterior)
    if part is not None:
        with suppress(NumericalError):  # a part that leads nowhere: all of the record is searched
            return _maximise(
                posterior, _with_noise(posterior, _highest(part, candidates, tries)[0]), least_gain=least_gain
            )
    drawn = _best(_heights(posterior, candidates))[:tries]
    followed = [*_guessed(posterior, candidates), *candidates[drawn]]
    if tries == 1 and len(followed) > 1:
        followed = [followed[np.argmax(_heights(posterior, np.array(followed)))]]
    if not followed:
        raise NumericalError(
            f"none of {len(candidates)} draws from the prior gives a finite likelihood: under this prior the model diverges, for example "
            f"at {_point(posterior, candidates[0])}. Narrow the prior to damping that dissipates (negative coefficients), or check units."
        )
    held = [i for _, drift, time in _slow_noise(posterior) for i in (*drift, *time)]
    tops = _climbed(
        posterior, (_with_noise(posterior, _nearly_white(posterior, one)) for one in followed), held, least_gain
    )
    if held:
        # A wrong motion leaves slow residuals over: with the noise of these the motion is found in three times as many steps.
        starts = sorted((_with_slow_noise(posterior, z) for z, _ in tops), key=lambda pair: -pair[1])
        tops = _climbed(posterior, (z for z, _ in starts), (), least_gain)
    return max(tops, key=lambda pair: pair[1])


def _climbed(
    posterior: Posterior, starts: Iterable[np.ndarray], held: Sequence[int] = (), least_gain: float = 0.0
) -> list[tuple[np.ndarray, float]]:
    """Return the different maxima above some starts, parameters at some places being held."""
    tops: list[tuple[np.ndarray, float]] = []
    lost = None
    for start in starts:
        if any(is_uphill(posterior, start, top) for top, _ in tops):
            continue
        try:
            top = _maximise(posterior, start, tops, held, least_gain)
        except NumericalError as error:
            lost = error
            continue
        if not any(np.array_equal(top[0], known) for known, _ in tops):
            tops.append(top)
    if lost is not None and not tops:
        raise lost
    return tops


def _first_part(posterior: Posterior) -> Posterior | None:
    """Return the posterior of the first part of long trials in which every control moves about as much as in all of them; None without."""
    data = posterior.data
    if not isinstance(posterior.likelihood, OutputError | FilterError) or data.step.shape[1] < MIN_LONG_SAMPLES:
        return None
    length = data.step.shape[1] // N_PARTS
    inside = np.asarray(data.step) > 0  # what fills up a trial takes no time
    columns = [np.asarray(column) for column in data.control]
    moves = [(column[:, :length][inside[:, :length]].std(), column[inside].std()) for column in columns]
    if any(part < MIN_EXCITATION * whole for part, whole in moves):
        return None
    return replace(posterior, data=first_samples(data, length))


def draw_about(posterior: Posterior, mode: Mode, count: int, random: np.random.Generator) -> Float[np.ndarray, "n d"]:
    """Return draws of z from the normal approximation, cut along its axes on a side where the density falls much faster.

    The data may exclude a size from above and leave it open from below, down to the bound of its prior: its logarithm then has the spread
    of the prior, and a symmetric normal would reach values that the data exclude.
    """
    values, vectors = np.linalg.eigh(mode.cov)
    factor = vectors * np.sqrt(np.abs(values))
    sides = np.concatenate([factor.T, -factor.T])
    reach = np.full(len(sides), np.inf)

    def holds(steps: np.ndarray, sides: np.ndarray) -> np.ndarray:
        points = mode.z + steps[:, None, None] * sides
        drop = mode.log_density - _heights(posterior, points.reshape(-1, mode.z.size)).reshape(points.shape[:2])
        return drop <= FALL

    falls = np.flatnonzero(~holds(REACH[:1], sides)[0])
    if falls.size:
        nearer = holds(REACH[1:], sides[falls])
        reach[falls] = np.where(nearer.any(0), REACH[1:][np.argmax(nearer, 0)], REACH[-1])
    if DELAY in posterior.present_names:  # between the peaks along a delay the density falls and rises again
        reach[np.tile(np.abs(vectors[posterior.names.index(DELAY)]) > 0.5, 2)] = np.inf
    steps = random.standard_normal((count, mode.z.size))
    above, below = np.split(scipy.special.ndtr(reach) - 0.5, 2)
    share = 2.0 * np.where(steps > 0, above, below)
    cut = np.sign(steps) * scipy.special.ndtri(0.5 + share * (scipy.special.ndtr(np.abs(steps)) - 0.5))
    return mode.z + np.where(share < 1.0, cut, steps) @ factor.T


def maximise_from(posterior: Posterior, start: Float[np.ndarray, " d"]) -> Mode:
    """Follow one start to the mode above it.

    Raises:
        NumericalError: the log-likelihood has no finite derivative on the way.
    """
    return _about(posterior, *_maximise(posterior, start))


def is_uphill(posterior: Posterior, start: Float[np.ndarray, " d"], end: Float[np.ndarray, " d"]) -> bool:
    """Return whether the density never falls on the straight way, looked at in as many places as are computed at once.

    Args:
        posterior: whose density is followed.
        start: where the way begins, z, shape (d,).
        end: where it ends, z, shape (d,).
    """
    way = np.linspace(0.0, 1.0, _at_once(posterior))[:, None]
    height = _heights(posterior, start + way * (end - start))
    return bool(np.isfinite(height).all() and (np.diff(height) > 0).all())


def _at_once(posterior: Posterior) -> int:
    """Return how many densities are computed at once."""
    return LANES if isinstance(posterior.likelihood, FilterError) else AT_ONCE


def _heights(posterior: Posterior, z: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    return evaluate(posterior, z, _at_once(posterior))


def _about(posterior: Posterior, z: np.ndarray, log_density: float, rough: bool = False) -> Mode:
    """Normal approximation about a mode."""
    there = _expand(posterior, z, climbing=rough)
    precision = -0.5 * (there.hessian + there.hessian.T)
    cov, log_volume, flat = _invert(precision)
    sd = np.abs(there.slope) * np.sqrt(np.diag(cov))
    present = zip(posterior.present_parameters, there.values[posterior.places], sd[posterior.places], strict=True)
    return Mode(
        z,
        precision,
        cov,
        log_density,
        log_density + 0.5 * posterior.dim * np.log(2 * np.pi) + log_volume,
        there.values,
        sd,
        flat,
        posterior.names,
        tuple(parameter.unit for parameter in posterior.parameters),
        tuple(finding for one in present if (finding := bound_finding(*one))),
    )


def _along_delay(posterior: Posterior, mode: Mode, rough: bool = False) -> Mode:
    """Return the highest peak along the delay, its spread along it that of all peaks."""
    at = posterior.names.index(DELAY)
    for _ in range(MAX_ROUNDS):
        better = _higher_peak(posterior, mode, at, rough)
        if better is None:
            break
        mode = better
    return mode if rough else _with_profile(posterior, mode, at)


def _ridge(mode: Mode, at: int, to: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n d"]:
    """Return positions with one component as stated and the others as the normal approximation expects them then."""
    return mode.z + (to - mode.z[at])[:, None] * (mode.cov[:, at] / mode.cov[at, at])


def _higher_peak(posterior: Posterior, mode: Mode, at: int, rough: bool) -> Mode | None:
    """Follow the highest peaks along one component, near the mode and over the whole prior; None if none is higher."""
    reach = NEAR * np.sqrt(mode.cov[at, at])
    near = mode.z[at] + np.linspace(-reach, reach, AT_ONCE)
    points = _ridge(mode, at, np.sort(np.concatenate([near, np.linspace(-FARTHEST, FARTHEST, AT_ONCE)])))
    heights = _heights(posterior, points)
    middle = heights[1:-1]
    peaks = 1 + np.flatnonzero((middle > heights[:-2]) & (middle >= heights[2:]))
    best, ends, least_gain = mode, [mode.z], ROUGH_GAIN if rough else 1e-6
    for peak in peaks[np.argsort(-heights[peaks])][: 1 if rough else MAX_FOLLOWED]:
        if not any(is_uphill(posterior, points[peak], end) for end in ends):
            z, log_density = _maximise(posterior, points[peak], least_gain=ROUGH_GAIN if rough else 0.0)
            ends.append(z)
            if log_density > best.log_density + least_gain:
                best = _about(posterior, z, log_density, rough)
    return None if best is mode else best


def _profile(posterior: Posterior, mode: Mode, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places along one component to where nothing is left of the density, and the density there over that at the mode."""
    for reach in NEAR * np.sqrt(mode.cov[at, at]) * 2.0 ** np.arange(DOUBLINGS + 1):
        to = mode.z[at] + np.linspace(-reach, reach, AT_ONCE)
        weight = np.exp(_heights(posterior, _ridge(mode, at, to)) - mode.log_density)
        if weight[0] + weight[-1] < MAX_END_SHARE:
            break
    return to, weight


def _with_profile(posterior: Posterior, mode: Mode, at: int) -> Mode:
    """Return the normal approximation whose variance along one component, and log evidence, are those of its profile."""
    sd = np.sqrt(mode.cov[at, at])
    to, weight = _profile(posterior, mode, at)
    area = float(np.trapezoid(weight, to))
    spread = float(np.trapezoid(weight * (to - mode.z[at]) ** 2, to)) / area
    along = mode.cov[:, at] / mode.cov[at, at]
    cov = mode.cov + (spread - sd**2) * np.outer(along, along)
    slope = mode.sd / np.sqrt(np.diag(mode.cov))
    return mode._replace(
        cov=cov,
        precision=np.linalg.inv(cov),
        log_evidence=mode.log_evidence + float(np.log(area / (np.sqrt(2 * np.pi) * sd))),
        sd=slope * np.sqrt(np.diag(cov)),
    )


def _inside(posterior: Posterior, values: Mapping[str, float]) -> np.ndarray:
    """Return where parameters have such values, shape (1, d), in the middle of the prior where one is not told; none if one has no
    place."""
    z = _moved_inside(posterior, np.array([[values.get(name, np.nan) for name in posterior.names]]))
    return z[np.isfinite(z).all(1)]


def _moved_inside(posterior: Posterior, values: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
    """Return where parameters have such values, moved inside their bounds; in the middle of the prior for NaN."""
    low, high = np.array([parameter.prior.bounds for parameter in posterior.parameters], float).T
    z = np.asarray(posterior.unconstrain(np.clip(values, np.nextafter(low, np.inf), np.nextafter(high, -np.inf))))
    z = np.where(np.isfinite(high - low), z.clip(-MAX_INSIDE_SDS, MAX_INSIDE_SDS), z)
    return np.where(np.isnan(values), 0.0, z)


def _best(densities: np.ndarray) -> np.ndarray:
    """Places of the finite densities, the largest first."""
    order = np.argsort(-densities)
    return order[np.isfinite(densities[order])]


def _guessed(posterior: Posterior, candidates: np.ndarray) -> np.ndarray:
    """Return the best candidate with what the posterior guesses instead of what was drawn, shape (1, d); none without a guess."""
    if posterior.guess is None or np.isnan(posterior.guess).all():
        return candidates[:0]
    known = ~np.isnan(posterior.guess)
    z = np.asarray(posterior.unconstrain(np.where(known, posterior.guess, values_of(posterior, candidates[0]))))
    moved = np.where(known, z, candidates)
    return moved[_best(_heights(posterior, moved))[:1]]


def _with_noise(posterior: Posterior, start: np.ndarray) -> np.ndarray:
    """Return a start with the size of each noise at what the motion there leaves over, as long as the likelihood rises.

    n samples with a sum of squares S have the slope g = -n / sigma + S / sigma^3, so that S / n = sigma^2 (1 + sigma g / n): exact for
    white noise about a simulation, and nearer in every round for other noise.
    """
    likelihood, data = posterior.likelihood, posterior.data
    if not isinstance(likelihood, OutputError | FilterError):
        return start
    count = {
        noise_name(name): np.asarray(one.present).sum()
        for name, one in zip(likelihood.channels, data.channels, strict=True)
    }
    at = [i for i in posterior.places if posterior.names[i] in count]
    samples = np.array([count[posterior.names[i]] for i in at])
    best, highest, moved = start, -np.inf, start
    for _ in range(NOISE_ROUNDS):
        values = values_of(posterior, moved)
        value, gradient, _ = map(np.asarray, likelihood_slopes(posterior, values))
        share = 1.0 + values[at] * gradient[at] / samples
        if not (value > highest and np.isfinite(share).all()):
            break
        best, highest = moved, value
        values[at] *= np.sqrt(share.clip(MIN_NOISE_SHARE))
        moved = best.copy()
        moved[at] = _inside(posterior, dict(zip(posterior.names, values, strict=True)))[0, at]
    return best


def _slow_noise(posterior: Posterior) -> list[tuple[list[int], list[int], list[int]]]:
    """Return of each channel with drifting residuals the places of its white noise, of the size of its slow part, and of its time."""
    if not isinstance(posterior.likelihood, OutputError):
        return []
    kinds = [name.partition("[")[0] for name in posterior.names]

    def places(name: str) -> list[int]:
        return [i for i, kind in enumerate(kinds) if kind == name]

    return [
        (places(noise_name(one.channel)), places(drift_name(one.channel)), places(drift_time_name(one.channel)))
        for one in posterior.likelihood.simulator.sensors
        if one.noise == "drifting"
    ]


def _nearly_white(posterior: Posterior, start: np.ndarray) -> np.ndarray:
    """Return a start whose slow noise is too small to matter."""
    values, moved = values_of(posterior, start)[None], start.copy()
    for white, drift, _ in _slow_noise(posterior):
        values[:, drift] = FAINT_DRIFT * values[:, white].min()
        moved[drift] = _moved_inside(posterior, values)[0, drift]
    return moved


def _with_slow_noise(posterior: Posterior, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a start with the best of many noises of each channel that drifts, and the log density there.

    Given the motion the channels are independent, so that all but one may keep their noise.
    """
    channels = _slow_noise(posterior)
    levels = max(MIN_LEVELS, int(((AT_ONCE - 1) / len(channels)) ** (1 / 3)))
    axes = np.geomspace(*WHITE_SHARES, levels), np.geomspace(*DRIFT_SHARES, levels), np.linspace(-1.5, 1.5, levels)
    of_white, of_drift, time = (one.reshape(-1, 1) for one in np.meshgrid(*axes))
    values, tried = values_of(posterior, start), []
    for white, drift, times in channels:
        rows, wanted = np.tile(start, (time.size, 1)), np.tile(values, (time.size, 1))
        wanted[:, white] = of_white * values[white]
        wanted[:, drift] = of_drift * values[white].mean()
        rows[:, white + drift] = _moved_inside(posterior, wanted)[:, white + drift]
        rows[:, times] = time
        tried.append(rows)
    height, *heights = np.split(
        _heights(posterior, np.concatenate([start[None], *tried])), 1 + time.size * np.arange(len(channels))
    )
    moved = start.copy()
    for places, rows, of_rows in zip(channels, tried, heights, strict=True):
        if of_rows.max() > height[0]:
            changed = [i for part in places for i in part]
            moved[changed] = rows[np.argmax(of_rows), changed]
    return moved, float(_heights(posterior, moved[None])[0])


class _Expansion(NamedTuple):
    """What is needed of one point.

    Attributes:
        value: log density.
        gradient: of the log density, shape (d,).
        hessian: of the log density, shape (d, d).
        values: of the parameters in their own units, shape (d,).
        slope: derivative of each value with respect to its own z, shape (d,).
    """

    value: float
    gradient: Float[np.ndarray, " d"]
    hessian: Float[np.ndarray, "d d"]
    values: Float[np.ndarray, " d"]
    slope: Float[np.ndarray, " d"]


def _expand(posterior: Posterior, z: Float[np.ndarray, " d"], climbing: bool = False) -> _Expansion:
    """Return the expansion at a point: that of the likelihood in the parameters' own units, by the chain rule, and the prior's.

    Each value depends on its own z alone, and taking derivatives of that together with the simulation would be most of the compiling.

    Args:
        posterior: to expand.
        z: point.
        climbing: whether minus the information will do for the Hessian of the likelihood.
    """
    prior, values, slope, curvature = (np.asarray(one) for one in expand_prior(posterior, z))
    if climbing:
        value, gradient, information = map(np.asarray, likelihood_slopes(posterior, values))
        hessian = -information
    else:
        value, gradient, hessian = expand_likelihood(posterior, values)
    return _Expansion(
        float(prior[0].sum() + value),
        prior[1] + slope * gradient,
        np.diag(prior[2] + curvature * gradient) + np.outer(slope, slope) * hessian,
        values,
        slope,
    )


def expand_prior(posterior: Posterior, z: Any) -> tuple[Array, Array, Array, Array]:
    """Return log prior densities with two derivatives, shape (3, d), and values with two derivatives, shape (d,) each."""
    return _expand_prior(replace(posterior, data=(), guess=None), z)  # one program for records of any length


@program
def _expand_prior(posterior: Posterior, z: Array) -> tuple[Array, Array, Array, Array]:
    prior, value = posterior.log_priors, posterior.constrain
    along = jnp.ones_like(z)

    def slope(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
        return lambda x: jax.jvp(function, (x,), (along,))[1]

    return (
        jnp.stack([prior(z), slope(prior)(z), slope(slope(prior))(z)]),
        value(z),
        slope(value)(z),
        slope(slope(value))(z),
    )


def _maximise(
    posterior: Posterior,
    start: np.ndarray,
    known_modes: Sequence[tuple[np.ndarray, float]] = (),
    held: Sequence[int] = (),
    least_gain: float = 0.0,
) -> tuple[np.ndarray, float]:
    """Follow one start to its maximum; where parameters at some places are held, roughly."""
    if not held:
        return maximise(
            lambda z: _expand(posterior, z, climbing=True),
            start,
            partial(_point, posterior),
            known_modes=known_modes,
            least_gain=least_gain,
        )
    free = np.setdiff1d(np.arange(start.size), held)

    def whole(part: np.ndarray) -> np.ndarray:
        z = start.copy()
        z[free] = part
        return z

    def expand_at(part: np.ndarray) -> _Expansion:
        there = _expand(posterior, whole(part), climbing=True)
        return there._replace(gradient=there.gradient[free], hessian=there.hessian[np.ix_(free, free)])

    tops = [(top[free], height) for top, height in known_modes]
    part, height = maximise(
        expand_at, start[free], lambda part: _point(posterior, whole(part)), known_modes=tops, least_gain=ROUGH_GAIN
    )
    return whole(part), height


class Expanded(Protocol):
    """A log density at one point, with its gradient, shape (d,), and Hessian, shape (d, d)."""

    @property
    def value(self) -> float:
        """Log density."""
        ...

    @property
    def gradient(self) -> Float[np.ndarray, " d"]:
        """Its gradient."""
        ...

    @property
    def hessian(self) -> Float[np.ndarray, "d d"]:
        """Its Hessian."""
        ...


def maximise(
    expand_at: Callable[[np.ndarray], Expanded],
    start: Float[np.ndarray, " d"],
    words: Callable[[np.ndarray], str],
    most: int = 300,
    known_modes: Sequence[tuple[np.ndarray, float]] = (),
    least_gain: float = 0.0,
) -> tuple[Float[np.ndarray, " d"], float]:
    """Follow one start to its maximum; steps that end where the density is zero or has no derivative are refused by the trust region.

    It ends where what is left to climb is lost in the rounding of the density, on the slope of a top that is known, or where it would not
    come as high in many more steps.

    Args:
        expand_at: expansion of the log density at a point.
        start: where it begins, shape (d,).
        words: names a point, for the error.
        most: steps.
        known_modes: maxima that are known, each with the log density there; one whose slope is reached is not climbed again.
        least_gain: it ends where less is left to climb, nats.

    Returns:
        where it ended, or the known maximum on whose slope it did, shape (d,), and the log density there.

    Raises:
        NumericalError: the density has no finite derivative at the start.
    """
    expand = lru_cache(maxsize=2)(lambda z: expand_at(np.array(z)))

    def is_smooth(z: np.ndarray) -> bool:
        there = expand(tuple(z))
        return all(np.isfinite(one).all() for one in (there.value, there.gradient, there.hessian))

    if not is_smooth(start):
        raise NumericalError(
            f"the log-likelihood has no finite derivative at {words(start)}; narrow the priors around there"
        )

    heights: list[float] = []
    reached: list[tuple[np.ndarray, float]] = []
    highest = max((height for _, height in known_modes), default=-np.inf)

    def stop_if_there(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        there = expand(tuple(intermediate_result.x))
        heights.append(there.value)
        if len(heights) > PATIENCE_STEPS and there.value - heights[-1 - PATIENCE_STEPS] < MIN_GAIN_SHARE * (
            highest - there.value
        ):
            raise StopIteration
        curvature = -there.hessian
        if np.linalg.eigvalsh(curvature)[0] <= 0:
            return
        step = np.linalg.solve(curvature, there.gradient)
        gain = 0.5 * there.gradient @ step
        for top, height in known_modes if gain < MAX_SAME_GAIN else ():
            missed = top - intermediate_result.x - step
            if missed @ curvature @ missed < MAX_SAME_DISTANCE:
                reached.append((top, height))
                raise StopIteration
        if gain < max(least_gain, np.finfo(float).eps * abs(there.value)):
            raise StopIteration

    latest = start

    def height(z: np.ndarray) -> float:
        nonlocal latest
        latest = z
        return -expand(tuple(z)).value if is_smooth(z) else 1e100

    # The derivatives at a step that is refused are asked for all the same, and not used.
    try:
        result = scipy.optimize.minimize(
            height,
            start,
            method="trust-exact",
            jac=lambda z: -expand(tuple(z)).gradient if is_smooth(z) else np.zeros(z.size),
            hess=lambda z: -expand(tuple(z)).hessian if is_smooth(z) else np.eye(z.size),
            callback=stop_if_there,
            options={"gtol": 1e-6, "maxiter": most},
        )
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            f"the maximum of the posterior density cannot be computed: its curvature is not finite near {words(latest)}, and the density "
            f"may rise without bound there. Write parameters that share a spread as mean + spread * z, or bound the spread away from 0"
        ) from error
    return reached[0] if reached else (result.x, -float(result.fun))


def _point(posterior: Posterior, z: np.ndarray) -> str:
    """Return the values of the parameters there, in words."""
    values = values_of(posterior, z)[posterior.places]
    return ", ".join(f"{name} = {value:.4g}" for name, value in zip(posterior.present_names, values, strict=True))


def triangular_root(rows: Float[np.ndarray, "d m"]) -> Float[np.ndarray, "d d"]:
    """Return the lower triangle L of L L' = A A', by rotations.

    Cholesky's factorisation of A A' fails where its condition number exceeds 1e16, as it does near a spread of 0; that of A is its root.

    Args:
        rows: A, of at least as many columns as rows.
    """
    factor = np.asarray(np.linalg.qr(rows.T, mode="r")).T
    return factor * np.where(np.diagonal(factor) < 0.0, -1.0, 1.0)


def _invert(precision: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Inverse, half its log-determinant, and whether a direction without curvature was given unit precision, the prior's order."""
    values, vectors = np.linalg.eigh(precision)
    flat = bool((values <= MIN_CURVATURE).any())
    values = np.where(values <= MIN_CURVATURE, 1.0, values)
    return (vectors / values) @ vectors.T, -0.5 * float(np.log(values).sum()), flat
