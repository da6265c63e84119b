"""What is known of a plan's coefficients before a trial, and the vector z in which its components are independent.

Under independent priors z is that of each prior; under a joint normal N(m, L L^T) the coefficients are m + L z. Either way z has
mean 0 and standard deviation 1, or nearly, and every function here that compiled code calls acts on one z.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.core.signals import ACTUAL
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.priors import Prior, by_kind, nominal
from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.model import VehicleModel

# Standard deviation of the vehicle's own state about its start at the begin of a designed trial, in its unit (m/s)
STATE_SD = 0.05
# What an actuator gains by noise in a sample or a second, in its unit: without any it ends exactly where it is told to
# be, and covariances without full rank have no factor
ACTUATOR_SD = 1e-4 * STATE_SD
QUANTILE_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)  # Of a motion over draws of the priors
MAX_LOST_SHARE = 0.5  # Share of draws without a motion above which a prior is not to be used
Belief = tuple[Prior, ...] | Gaussian
"""What is known before: independent priors of the coefficients in the plan's order, or their joint normal distribution, SI."""


def normal_belief(draws: Float[np.ndarray, "S k"]) -> Gaussian:
    """Joint normal with the mean and covariance of draws of a posterior, SI.

    Raises:
        InputError: too few draws, or a coefficient or combination of them that does not vary.
    """
    draws = np.asarray(draws, float)
    sd = draws.std(0)
    if len(draws) <= draws.shape[1] or not (np.isfinite(sd).all() and (sd > 0).all()):
        raise InputError(
            "draws of the coefficients",
            found=f"{len(draws)} draws of {draws.shape[1]} coefficients with standard deviations {sd}",
            expected="more draws than coefficients, all finite and varying",
            remedy="use more posterior draws, and leave out known coefficients",
        )
    return Gaussian(jnp.asarray(draws.mean(0)), jnp.linalg.cholesky(jnp.asarray(np.atleast_2d(np.cov(draws.T)))))


def normal_of(belief: Belief) -> Gaussian:
    """Joint normal about the nominal values of independent priors, with their standard deviations; a joint normal as it is."""
    if isinstance(belief, Gaussian):
        return belief
    return Gaussian(np.array(list(map(nominal, belief))), np.diag([prior.sd for prior in belief]))


def coefficient_space(
    model: VehicleModel,
    belief: Gaussian,
    start: Sequence[float],
    noise: Mapping[str, float],
    process: Float[np.ndarray, " d"] | None = None,
) -> tuple[StateSpace, Float[np.ndarray, " k"]]:
    """State space of a trial, and the standard deviations in whose units its coefficients are, so that each is of order one.

    Args:
        model: vehicle.
        belief: about its k coefficients, SI.
        start: state at the first sample, SI.
        noise: standard deviation of each measured channel, SI.
        process: of what each state gains by noise from one sample to the next, SI; None for none.
    """
    scales, d = np.asarray(belief.sd), len(model.states)
    chol = np.zeros((d + scales.size,) * 2)
    chol[range(d), range(d)] = STATE_SD
    chol[d:, d:] = np.asarray(belief.chol_cov) / scales[:, None]
    initial = Gaussian(np.concatenate([start, np.asarray(belief.mean) / scales]), chol)
    gained, shown = np.zeros(d + scales.size), np.array(list(noise.values()))
    late = [ACTUATOR_SD if state.endswith(ACTUAL) else 0.0 for state in model.states]
    gained[:d] = np.maximum(0.0 if process is None else process, late)
    return discretise(model, tuple(noise), initial, gained, shown, scales.tolist()), scales


def prior_cov(belief: Belief) -> Float[np.ndarray, "k k"]:
    """Covariance of the coefficients, SI."""
    if isinstance(belief, Gaussian):
        return np.asarray(belief.cov)
    return np.diag([float(prior.sd) ** 2 for prior in belief])


def draw_values(belief: Belief, key: jax.Array, n: int) -> Float[np.ndarray, "n k"]:
    """Draws of the coefficients, SI: those of `draw_z` under the same key."""
    return np.asarray(_draws(belief, key, n)[1])


def draw_z(belief: Belief, key: jax.Array, n: int) -> Float[np.ndarray, "n k"]:
    """Draws of z, in which a joint normal is standard normal."""
    return np.asarray(_draws(belief, key, n)[0])


def values_of(belief: Belief, z: Float[Array, " k"]) -> Float[Array, " k"]:
    """Coefficients, SI, of one z."""
    if isinstance(belief, Gaussian):
        return belief.mean + belief.chol_cov @ z
    return jnp.stack([prior.constrain(z[i]) for i, prior in enumerate(belief)])


def log_priors(belief: Belief, z: Float[Array, " k"]) -> Float[Array, " k"]:
    """Log prior density of each component of z."""
    if isinstance(belief, Gaussian):
        return -0.5 * (z * z + jnp.log(2 * jnp.pi))
    return jnp.stack([prior.log_density(z[i]) for i, prior in enumerate(belief)])


def entropies(belief: Belief) -> Float[np.ndarray, " k"]:
    """Entropy of each component of z, nats, by quadrature: of unit variance, next to nothing of it lies beyond 20."""
    k = belief.mean.size if isinstance(belief, Gaussian) else len(belief)
    grid = np.linspace(-20.0, 20.0, 40001)
    logs = np.asarray(_log_densities(belief, np.broadcast_to(grid[:, None], (grid.size, k))))
    density = np.exp(logs)
    return -np.trapezoid(density * np.where(density > 0, logs, 0.0), grid, axis=0)


def outputs_of(
    plan: TrialPlan, belief: Belief, control: Float[Array, "n c"], z: Float[Array, " k"]
) -> Float[Array, " data"]:
    """What all sensors would show at one z without noise, over their noise."""
    return plan.outputs(values_of(belief, z), control).ravel()


@program(static_argnums=2)
def _draws(belief: Belief, key: jax.Array, n: int) -> tuple[Array, Array]:
    """Draws of z and of the coefficients."""
    if isinstance(belief, Gaussian):
        z = jax.random.normal(key, (n, belief.mean.size))
        return z, jax.vmap(lambda one: values_of(belief, one))(z)
    z = by_kind(belief, lambda prior, key: prior.sample(key, (n,)), jax.random.split(key, len(belief)))
    return z, by_kind(belief, lambda prior, z: prior.constrain(z), z)


@program
def _log_densities(belief: Belief, z: Array) -> Array:
    return jax.vmap(lambda one: log_priors(belief, one))(z)


def most_have(values: Float[np.ndarray, " draws"]) -> bool:
    """Return whether at least half of the draws have a value."""
    return bool(np.isnan(values).mean() <= MAX_LOST_SHARE)
