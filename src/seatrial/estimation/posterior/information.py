"""What the measurements alone say about the parameters near one point, from exact slopes.

Expected (Fisher) information of an output-error fit: I = sum_k S_k^T R^-1 S_k with S_k = dy_k/dc. It is minus the Hessian of
the log-likelihood of data that are the simulation itself: every term with a residual in it then vanishes, so that what cannot
be separated has no curvature to rounding. Other likelihoods give the observed information, minus their Hessian.

The Hessian of a likelihood of records is the difference of exact gradients some millionths of a standard deviation apart: right to
some 1e-5 of itself, with the one program that also climbs.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.output_error import OutputError, is_deviation
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.slopes import Slopes, likelihood_slopes
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.trial_data import TrialData
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.pilot import Moment, Pilot, close_loop
from seatrial.numerics.integrate import rk4_for_slopes
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import move_by

# Distance of gradients whose difference is a Hessian, over the standard deviation that the data alone give the
# parameter and the root of the number of measurements: what their sums lose by rounding grows with that number, and in
# a standard deviation less bends.
APART = 1e-7


class Expansion(NamedTuple):
    """Log-likelihood at a point, its gradient and its Hessian, in the parameters' own units."""

    value: float
    gradient: Float[np.ndarray, " d"]
    hessian: Float[np.ndarray, "d d"]


def slopes_of_present(posterior: Posterior, values: Float[np.ndarray, " d"]) -> Slopes:
    """Return the slopes of the likelihood about the parameters that are present, at a point that need not lie inside the prior.

    Args:
        posterior: whose likelihood it is.
        values: in the parameters' own units.
    """
    at = posterior.places
    value, gradient, information = map(np.asarray, likelihood_slopes(posterior, _everywhere(posterior, values)))
    return Slopes(float(value), gradient[at], information[np.ix_(at, at)])


def expand_likelihood(posterior: Posterior, point: Float[np.ndarray, " d"]) -> Expansion:
    """Return the log-likelihood with its first and second derivatives, the latter zero about what is absent.

    Args:
        posterior: whose likelihood is expanded.
        point: values of all parameters, those that are absent among them, in their own units.
    """
    here = Slopes(*map(np.asarray, likelihood_slopes(posterior, point)))
    hessian = -here.information
    if isinstance(posterior.likelihood, OutputError | FilterError):
        hessian = _differences(posterior, point, here)
    absent = np.setdiff1d(np.arange(point.size), posterior.places)
    hessian[:, absent] = hessian[absent] = 0.0
    return Expansion(float(here.value), here.gradient, hessian)


def _differences(posterior: Posterior, point: Float[np.ndarray, " d"], here: Slopes) -> Float[np.ndarray, "d d"]:
    """Return the Hessian: minus the information, and what that leaves out by differences of gradients.

    An output-error information leaves out nothing about the noise, which what is shown does not depend on. Along the delay gradients have
    kinks: about that alone nothing is added.
    """
    left_out = np.zeros((point.size,) * 2)
    sizes = np.sqrt(np.diag(here.information).clip(0.0))
    known = posterior.likelihood.noise_parameters if isinstance(posterior.likelihood, OutputError) else frozenset()
    noise = [i for i, name in enumerate(posterior.names) if name in known]
    kinked = [i for i in posterior.places if posterior.names[i] == DELAY]
    apart = APART * np.sqrt(max(1.0, sum(float(np.asarray(one.present).sum()) for one in posterior.data.channels)))
    for i in posterior.places:
        if i in (*kinked, *noise):
            continue
        step = np.zeros(point.size)
        step[i] = apart / max(sizes[i], 1.0 / posterior.parameters[i].prior.sd)
        ahead = np.asarray(likelihood_slopes(posterior, point + step).gradient)
        left_out[i] = (ahead - here.gradient) / step[i] + here.information[i]
    left_out[:, noise] = 0.0
    left_out[kinked] = left_out[:, kinked].T
    return 0.5 * (left_out + left_out.T) - here.information


def likelihood_information(posterior: Posterior, values: Float[np.ndarray, " d"]) -> Float[np.ndarray, "d d"]:
    """Return the information of the data at parameter values in their own units; not finite where the model diverges.

    For output error it is the expected information about the motion and the observed one about the noise; the tails of
    heavy-tailed residuals make it up to twice too large, its rank stays. For other likelihoods it is the observed information.
    Where values vary between trials, the unit variance of their deviations is counted in.
    """
    at, point = posterior.places, np.asarray(values, float)
    if not isinstance(posterior.likelihood, OutputError):
        observed = expand_likelihood(posterior, _everywhere(posterior, point)).hessian
        return _of_hierarchy(posterior) - observed[np.ix_(at, at)]
    result = slopes_of_present(posterior, point).information
    simulated = replace(posterior, data=_simulated_data(posterior, _everywhere(posterior, point)))
    information = np.array(slopes_of_present(simulated, point).information)
    noise = np.flatnonzero(is_noise(posterior))
    information[np.ix_(noise, noise)] = result[np.ix_(noise, noise)]
    return information + _of_hierarchy(posterior)


def _everywhere(posterior: Posterior, values: Float[np.ndarray, " k"]) -> Float[np.ndarray, " d"]:
    """Return values of all parameters, 0 for what is absent."""
    point = np.zeros(posterior.dim)
    point[posterior.places] = values
    return point


def _of_hierarchy(posterior: Posterior) -> Float[np.ndarray, "d d"]:
    """That deviations are standard normal belongs to the model: without it only common value plus deviation would be known."""
    return np.diag([float(is_deviation(name)) for name in posterior.present_names])


def is_noise(posterior: Posterior) -> np.ndarray:
    """Return which parameters belong to the noise of an output-error likelihood and not to what the sensors show, shape (d,)."""
    return np.isin(posterior.present_names, list(posterior.likelihood.noise_parameters))


@program(static_argnums=(0, 1))
def coefficient_information(
    model: VehicleModel,
    channels: tuple[str, ...],
    params: Mapping[str, Any],
    control: Float[Array, "n n_controls"],
    step: Float[Array, " n"],
    start: Float[Array, " n_states"],
    weight: Float[Array, "n m"],
    autopilot: Autopilot | None = None,
    process: Float[Array, " n_states"] | None = None,
) -> Float[Array, "k k"]:
    """Return the expected information of one planned trial about the model's coefficients, SI and in its order; may be batched.

    The sensitivities travel with the state and are summed at once, so that memory does not grow with the number of samples.

    Args:
        model: vehicle; static.
        channels: measured channels, white noise; static.
        params: coefficients about which it is linearised.
        control: control held from each sample to the next; what is commanded under an autopilot.
        step: time to the next sample, s.
        start: state at the first sample.
        weight: one over the standard deviation of each channel at each sample, SI; 0 if it is not measured.
        autopilot: that makes the controls, which are logged: given them, what it decides has no part in the slopes.
        process: standard deviation that each state gains in one second, SI; None if the motion follows the model exactly.
    """
    begin, advance = information_loop(model, channels, params, start, autopilot, process)
    columns = tuple(control[:, i] for i in range(control.shape[1]))
    (_, _, total, *_), _ = jax.lax.scan(advance, begin, (columns, step, weight))
    return total


def fed_back(model: VehicleModel, pilot: Pilot, params: Mapping[str, Any]) -> Callable[[tuple, tuple], tuple]:
    """Return the channels that a pilot feeds back, by the state, the vehicle's first, and the controls; for `close_loop`."""
    n = len(model.states)

    def show(state: tuple, held: tuple) -> tuple:
        return tuple(model.output(name, params, state[:n], held) for name in pilot.outputs)

    return show


def controls_of(
    model: VehicleModel, channels: tuple[str, ...], params: Mapping[str, Any], autopilot: Autopilot | None
) -> tuple[Callable[[tuple, Any, tuple, Array], tuple[tuple, Any]], Any]:
    """Return `(state, memory, told, weight) ->` the controls and the memory, and the first memory.

    The controls are what is told or, through perfect sensors, what the autopilot makes of it; a sensor of weight 0 shows it nothing.
    """
    if autopilot is None:
        return lambda state, memory, told, weight: (told, memory), ()
    law = close_loop(autopilot, fed_back(model, autopilot, params))
    seen = [channels.index(name) for name in autopilot.outputs]

    def decide(state: tuple, memory: Any, told: tuple, weight: Array) -> tuple[tuple, Any]:
        errors = tuple(jnp.where(weight[at] > 0, 0.0, jnp.nan) for at in seen)
        return law(state, memory, Moment(0.0, told, errors))

    return decide, autopilot.begin()


def information_loop(
    model: VehicleModel,
    channels: tuple[str, ...],
    params: Mapping[str, Any],
    start: Float[Array, " n_states"],
    autopilot: Autopilot | None = None,
    process: Float[Array, " n_states"] | None = None,
) -> tuple[tuple, Callable[[tuple, tuple], tuple[tuple, None]]]:
    """Return the time loop of `coefficient_information`, see there: its first carry, whose third part is the sum, and its step."""
    if process is None:
        return _sensitivity_loop(model, channels, params, start, autopilot)
    return _innovation_loop(model, channels, params, start, process, autopilot)


def _sensitivity_loop(
    model: VehicleModel,
    channels: tuple[str, ...],
    params: Mapping[str, Any],
    start: Float[Array, " n_states"],
    autopilot: Autopilot | None,
) -> tuple[tuple, Callable[[tuple, tuple], tuple[tuple, None]]]:
    """Time loop that sums the information of `coefficient_information`: its first carry, and its step.

    Not `time_loop`: state, slopes and what is shown come out of one derivative, where looking first and moving then would take two, and
    the searches of free forms cut it into blocks.

    The carry is the state, its slopes along the k coefficients, the information so far, shape (k, k), and what the autopilot remembers; a
    sample is what is commanded, the time to the next sample and the weights.
    """
    names = tuple(coefficient.text for coefficient in model.coefficients)
    point = tuple(jnp.asarray(params[name], float) for name in names)
    k = len(names)
    directions = tuple(jnp.eye(k)[i] for i in range(k))

    decide, begin = controls_of(model, channels, params, autopilot)

    def advance(carry: tuple, sample: tuple) -> tuple[tuple, None]:
        state, slopes, total, memory = carry
        stated, h, counts = sample
        held, memory = decide(state, memory, stated, counts)

        def moved_and_shown(point: tuple, state: tuple) -> tuple[tuple, Array]:
            named = dict(zip(names, point, strict=True))
            shown = jnp.stack([model.output(name, named, state, held) for name in channels]) * counts
            return move_by(model, named)(state, held, h), shown

        def along(direction: tuple, slope: tuple) -> tuple:
            (moved, _), (moved_slope, shown_slope) = jax.jvp(moved_and_shown, (point, state), (direction, slope))
            return moved, moved_slope, shown_slope

        state, slopes, shown = jax.vmap(along, out_axes=(None, 0, 0))(directions, slopes)
        return (state, slopes, total + shown @ shown.T, memory), None

    state = tuple(start[i] for i in range(start.shape[0]))
    return (state, tuple(jnp.zeros(k) for _ in state), jnp.zeros((k, k)), begin), advance


def _innovation_loop(
    model: VehicleModel,
    channels: tuple[str, ...],
    params: Mapping[str, Any],
    start: Float[Array, " n_states"],
    process: Float[Array, " n_states"],
    autopilot: Autopilot | None,
) -> tuple[tuple, Callable[[tuple, tuple], tuple[tuple, None]]]:
    """Time loop that sums the information of the innovations of a Kalman filter about the motion; carry as `_sensitivity_loop`, then P.

        s_y = H s + dh/dc,  I += s_y' S^-1 s_y,  s <- F (s - K s_y) + df/dc,  S = H P H' + R,  K = P H' S^-1

    Channels, whose noises are independent, are taken in one after the other (Maybeck 1979, section 7.4), so that S is a number.
    What S and K owe to the coefficients is left out. A motion that runs away, or drifts, is remembered as long as the filter does, and
    not without end: without process noise the slopes of an unstable vehicle grow without bound.
    """
    names = tuple(coefficient.text for coefficient in model.coefficients)
    point = jnp.stack([jnp.asarray(params[name], float) for name in names])
    k, n = len(names), len(model.states)
    decide, begin = controls_of(model, channels, params, autopilot)

    def take_in(carry: tuple, channel: tuple) -> tuple[tuple, None]:
        (slopes, total, cov), (by_state, by_point) = carry, channel
        shown, cross = by_state @ slopes + by_point, cov @ by_state
        variance = by_state @ cross + 1.0
        after = slopes - jnp.outer(cross, shown) / variance, total + jnp.outer(shown, shown) / variance
        return (*after, cov - jnp.outer(cross, cross) / variance), None

    def advance(carry: tuple, sample: tuple) -> tuple[tuple, None]:
        state, slopes, total, memory, cov = carry
        stated, h, counts = sample
        held, memory = decide(tuple(state[i] for i in range(n)), memory, stated, counts)

        def moved_and_shown(joint: Array) -> tuple[Array, Array]:
            named = dict(zip(names, (joint[i] for i in range(k)), strict=True))
            now = tuple(joint[k + i] for i in range(n))
            shown = jnp.stack([jnp.asarray(model.output(name, named, now, held), float) for name in channels]) * counts
            moved = jnp.stack(move_by(model, named, rk4_for_slopes)(now, held, h))
            return jnp.concatenate([moved, shown]), moved

        jacobian, moved = jax.jacfwd(moved_and_shown, has_aux=True)(jnp.concatenate([point, state]))
        by_point, by_state = jacobian[:, :k], jacobian[:, k:]
        (slopes, total, cov), _ = jax.lax.scan(take_in, (slopes, total, cov), (by_state[n:], by_point[n:]))
        slopes = by_state[:n] @ slopes + by_point[:n]
        cov = by_state[:n] @ (0.5 * (cov + cov.T)) @ by_state[:n].T + jnp.diag(process**2) * h
        return (moved, slopes, total, memory, cov), None

    carry = (jnp.asarray(start, float), jnp.zeros((n, k)), jnp.zeros((k, k)), begin, jnp.zeros((n, n)))
    return carry, advance


@program
def _simulated_data(posterior: Posterior, values: Array) -> TrialData:
    """Return the posterior's data had every sensor shown what the simulation at these values does."""
    likelihood, data = posterior.likelihood, posterior.data
    named = dict(zip(posterior.names, values, strict=True))

    def of_one_trial(apart: dict, trial: Any, start: Array) -> Array:
        return likelihood.simulator.outputs({**named, **apart}, start, trial.control, trial.step)

    shown = jax.vmap(of_one_trial)(likelihood.apart(named), data, likelihood.starts(named, data))
    channels = tuple(channel._replace(measured=shown[..., i]) for i, channel in enumerate(data.channels))
    return data._replace(channels=channels)
