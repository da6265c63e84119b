"""One sample at a time: the campaign's square-root UKF about a vehicle's states and coefficients, compiled for one step.

Coefficients are in units of the standard deviations of their priors. Bounds of priors do not act inside the recursion: sigma points and
means that are moved to a boundary at every sample bias all that follows. What is believed is cut at them when it is looked at
(`within_bounds`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.filter_trace import prior_belief
from seatrial.campaign.inference.posterior import first_sd
from seatrial.compiled.programs import program
from seatrial.estimation.simulation.starts import level_start
from seatrial.filters.belief import Filter
from seatrial.filters.square_root import unscented_filter
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.model import VehicleModel

# Standard deviation of a state that its first measurement gives, over the sensor's noise: the measurement itself is
# still to come
FIRST_SPREAD = 10.0

# Of its trim, at which the acceleration of a velocity is looked at: where it changes its sign the motion is steady
TRIM_SHARES = np.geomspace(1 / 8, 8, 193)
BELIEF_DRAWS = 32  # Vehicles drawn from what is believed
CERTAIN_SDS = 5.0  # Standard deviations from its mean beyond which a bound does not matter


class Stepped(NamedTuple):
    """What one sample has taught; m channels.

    Attributes:
        normalised: innovation of each channel given those before it, over its standard deviation, NaN if missing, shape (m,).
        failed: whether the covariance was lost; the belief is then not to be used.
    """

    normalised: Float[np.ndarray, " m"]
    failed: bool


@dataclass(frozen=True, eq=False)
class Recursion:
    """What every step of one campaign shares.

    Attributes:
        model: vehicle.
        space: states and coefficients; process noise is what is gained in one second.
        method: filter.
        scales: SI value of one unit of each coefficient.
        prior: belief about the coefficients before the first sample, in these units.
        bounds: of each coefficient in its prior, in these units, shape (k, 2).
        trim: values of signals at trim, SI.
        noise: of every channel, SI.
    """

    model: VehicleModel
    space: StateSpace
    method: Filter
    scales: Float[np.ndarray, " k"]
    prior: Gaussian
    bounds: Float[np.ndarray, "k 2"]
    trim: Mapping[str, float]
    noise: Mapping[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return tuple(term.text for term in self.model.coefficients)

    def begin(self, known: Mapping[str, float], coefficients: Gaussian) -> Gaussian:
        """Return the belief at a first sample, or at one behind a gap.

        Args:
            known: values of signals that are measured then, SI.
            coefficients: belief about them, in units of `scales`.
        """
        d, mean = len(self.model.states), level_start(self.model, {**self.trim, **known})
        sds = [FIRST_SPREAD * self.noise[one] if one in known else first_sd({}, one) for one in self.model.states]
        chol = np.zeros((d + self.scales.size,) * 2)
        chol[range(d), range(d)] = sds
        chol[d:, d:] = coefficients.chol_cov
        return Gaussian(np.concatenate([mean, coefficients.mean]), chol)

    def step(
        self,
        belief: Gaussian,
        held: Float[np.ndarray, " c"],
        seconds: float,
        now: Float[np.ndarray, " c"],
        measured: Float[np.ndarray, " m"],
    ) -> tuple[Gaussian, Stepped]:
        """Return the belief after one sample, and what it has taught.

        Args:
            belief: after the sample before.
            held: controls since then, SI.
            seconds: since then, 0 at a first sample.
            now: controls from now on, SI.
            measured: SI, NaN if missing.
        """
        after, told = _stepper(self.method)(self.space, belief, held, seconds, now, measured)
        told = np.asarray(told)
        return after, Stepped(told[:-1], bool(told[-1]))

    def coefficients(self, belief: Gaussian) -> Gaussian:
        """Return the belief about the coefficients, in units of `scales`."""
        return jax.device_get(belief).marginal(self.space.n_dynamic)

    def shares_of_trim(
        self, name: str, mean: Float[np.ndarray, " k"], cov: Float[np.ndarray, "k k"]
    ) -> Float[np.ndarray, " d"]:
        """Return a velocity over its trim in steady motion with the controls at trim, of vehicles drawn from the belief; NaN for none.

        Args:
            name: of the velocity, whose trim is not 0.
            mean: of the coefficients, in units of `scales`.
            cov: of them.
        """
        drawn = (
            np.random.default_rng(0).multivariate_normal(mean, cov, BELIEF_DRAWS, check_valid="ignore") * self.scales
        )
        state = np.array(level_start(self.model, self.trim))
        control = np.array([self.trim.get(one, 0.0) for one in self.model.controls])
        ahead = np.asarray(_accelerations(self.model, name)(drawn, state, control)) * np.sign(self.trim[name])
        settles = (ahead[:, :-1] > 0) & (ahead[:, 1:] <= 0)
        nearest = np.argmin(np.where(settles, np.abs(np.log(TRIM_SHARES[:-1])), np.inf), axis=1)
        return np.where(settles.any(axis=1), np.sqrt(TRIM_SHARES[nearest] * TRIM_SHARES[nearest + 1]), np.nan)


def within_bounds(
    mean: Float[np.ndarray, " k"], cov: Float[np.ndarray, "k k"], bounds: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " k"]:
    """Return the mean of a normal distribution that is cut at its bounds, one after the other (Simon and Simon, IJSS 41, 2010).

    Args:
        mean: of it.
        cov: of it.
        bounds: lower and upper of each component, infinite if there is none.
    """
    mean, cov = np.array(mean), np.array(cov)
    for i, (low, high) in enumerate(bounds):
        sd = np.sqrt(cov[i, i])
        a, b = (low - mean[i]) / sd, (high - mean[i]) / sd
        if a < -CERTAIN_SDS and b > CERTAIN_SDS:
            continue
        moved, variance = _cut(a, b)
        along = cov[:, i] / cov[i, i]
        mean = mean + along * moved * sd
        cov = cov + np.outer(along, along) * (variance - 1.0) * cov[i, i]
    return np.clip(mean, bounds[:, 0], bounds[:, 1])


def _cut(a: float, b: float) -> tuple[float, float]:
    """Return the mean and the variance of a standard normal between two numbers; far out in its tail those of the nearer one."""
    if a > 0:
        mean, variance = _cut(-b, -a)
        return -mean, variance
    inside = ndtr(b) - ndtr(a)
    if inside < 1e-12:
        return b, 0.0
    at_a, at_b = (np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi) if np.isfinite(x) else 0.0 for x in (a, b))
    mean = (at_a - at_b) / inside
    ends = (a * at_a if at_a else 0.0) - (b * at_b if at_b else 0.0)
    return float(np.clip(mean, a, b)), float(max(1.0 + ends / inside - mean**2, 0.0))


def live_recursion(campaign: Campaign) -> Recursion:
    """Return the recursion of a campaign's full structure, from its priors.

    Raises:
        InputError: a prior that is missing.
    """
    model = campaign.model(campaign.full)
    priors = campaign.coefficient_priors(model)
    prior, scales = prior_belief(priors)
    d = len(model.states)
    initial = Gaussian(np.zeros(d + scales.size), np.eye(d + scales.size))
    gained = campaign.process_sds(model) / np.concatenate([np.ones(d), scales])
    noise = np.array(list(campaign.noise.values()))
    space = discretise(model, campaign.channels, initial, gained, noise, scales.tolist())
    bounds = np.array([one.bounds for one in priors]) / scales[:, None]
    method = unscented_filter(len(space.states))
    return Recursion(model, space, method, scales, prior, bounds, dict(campaign.hull.trim), dict(campaign.noise))


@lru_cache(maxsize=8)
def _stepper(method: Filter) -> Any:
    @program
    def step(
        space: StateSpace,
        belief: Gaussian,
        held: Array,
        seconds: Array,
        now: Array,
        measured: Array,
    ) -> tuple[Gaussian, Array]:
        moving = replace(space, process_sd=space.process_sd * jnp.sqrt(seconds))
        before, current, shown = method.form.begin(belief), tuple(now), tuple(measured)
        prior = jax.lax.cond(
            seconds > 0,
            lambda: _arrays(method.predict(moving, before, tuple(held), seconds)[0]),
            lambda: _arrays(before),
        )
        after, update = method.update(space, prior, current, shown)
        failed = update.failed | ~method.form.positive(after)
        normalised = [
            jnp.where(jnp.isfinite(y), e / jnp.sqrt(v), jnp.nan)
            for y, e, v in zip(shown, update.residual, update.variance, strict=True)
        ]
        outputs = jnp.stack([jnp.asarray(x, float) for x in (*normalised, failed)])
        return method.form.end(after), outputs

    return step


@lru_cache(maxsize=8)
def _accelerations(model: VehicleModel, name: str) -> Any:
    """Return what gives the acceleration of one velocity at every share of its trim, shape (d, s), all else being at trim."""
    names, index = [term.text for term in model.coefficients], model.states.index(name)

    @program
    def accelerations(drawn: Array, state: Array, control: Array) -> Array:
        def at(values: Array, share: Array) -> Array:
            moved = state.at[index].multiply(share)
            return model.derivative(dict(zip(names, values, strict=True)), tuple(moved), tuple(control))[index]

        return jax.vmap(jax.vmap(at, (None, 0)), (0, None))(drawn, jnp.asarray(TRIM_SHARES))

    return accelerations


def _arrays(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x, float), tree)
