"""Sweep of self-oscillating tests over control amplitude and threshold: the entropy reduction of every design, in step."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.design.entropy import entropy_reduction
from seatrial.design.sweep import in_blocks
from seatrial.filters.belief import Filter
from seatrial.filters.run import summarise_filter
from seatrial.filters.square_root import unscented_filter
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.relay import RelayFamily, check_family, run_relay
from seatrial.numerics.state_space import StateSpace


@dataclass(frozen=True, eq=False)
class RelaySweep:
    """Entropy reduction over a grid; A amplitudes, T thresholds.

    Attributes:
        family: what the designs share.
        amplitude: change of control from trim, SI, shape (A,).
        threshold: change of output from trim at which the control is reversed, SI, shape (T,).
        gain: entropy reduction, nats, NaN where the design breaks a limit, shape (A, T).
        peak_speed: largest |u| of the predicted motion, m/s, shape (A, T).
        final_sd: predicted standard deviation of each coefficient in filter units, shape (A, T, k).
        switches: reversals of the control, shape (A, T).
        reached: largest change of the output from trim, SI, shape (A, T).
    """

    family: RelayFamily
    amplitude: Float[np.ndarray, " A"]
    threshold: Float[np.ndarray, " T"]
    gain: Float[np.ndarray, "A T"]
    peak_speed: Float[np.ndarray, "A T"]
    final_sd: Float[np.ndarray, "A T k"]
    switches: Float[np.ndarray, "A T"]
    reached: Float[np.ndarray, "A T"]

    @property
    def oscillates(self) -> np.ndarray:
        """Whether both thresholds are reached, so that the test is more than a step, shape (A, T)."""
        return self.switches >= 2

    @property
    def best(self) -> tuple[int, int]:
        """Indices of the most informative design inside the limits that oscillates."""
        row, column = np.unravel_index(np.nanargmax(np.where(self.oscillates, self.gain, np.nan)), self.gain.shape)
        return int(row), int(column)


def sweep_relay(
    space: StateSpace,
    family: RelayFamily,
    amplitude: Float[np.ndarray, " A"],
    threshold: Float[np.ndarray, " T"],
    limits: Limits = Limits(),
    method: Filter | None = None,
    measured: Float[np.ndarray, "n m"] | None = None,
    truth: Float[np.ndarray, " d"] | None = None,
    noise: Float[np.ndarray, " n"] | None = None,
) -> RelaySweep:
    """Predict every design's entropy reduction by running the filter over the closed loop the current belief expects.

    Args:
        space: state space; its initial belief is what is known before the trial.
        family: control, output, trim and timing.
        amplitude: changes of control from trim, SI.
        threshold: changes of output from trim, SI.
        limits: bounds of the control.
        method: filter; the square-root unscented one, if not given.
        measured: 1 where a channel is measured, 0 elsewhere; None for every sample.
        truth: state and coefficients that generate the noise-free measurements; None for the mean of the initial belief.
        noise: error of the output as the relay sees it, the same for all designs; None for a perfect sensor.

    Raises:
        InputError: amplitudes or thresholds that are not positive, no design inside the limits, or none that oscillates.
        NumericalError: the expected motion diverges or the filter fails for a design that is inside the limits.
    """
    check_family(family, space)
    amplitudes, thresholds = (grid.ravel() for grid in np.meshgrid(amplitude, threshold, indexing="ij"))
    allowed = _allowed(family, amplitudes, thresholds, limits)
    n = family.time().size
    mask = np.ones((n, len(space.outputs))) if measured is None else measured
    start = space.initial.mean if truth is None else np.asarray(truth, float)
    gaps = np.where(mask > 0, 0.0, np.nan)
    error = np.zeros(n) if noise is None else np.asarray(noise, float)
    method = method or unscented_filter(len(space.states))
    gain, peak, sd, switches, reached, failures = in_blocks(
        lambda a, y: _predict(method, family, space, start, a, y, gaps, error), amplitudes, thresholds
    )
    broken = allowed & ((failures > 0) | ~np.isfinite(gain))
    if broken.any():
        worst = int(np.argmax(broken))
        raise NumericalError(
            f"the filter failed for {broken.sum()} of {allowed.sum()} designs, first at amplitude {amplitudes[worst]:.4g} "
            f"and threshold {thresholds[worst]:.4g} (SI): the expected motion diverges or the prior is too wide for it; "
            "narrow the priors"
        )
    if not (switches[allowed] >= 2).any():
        raise InputError(
            f"design grid, output {family.output}",
            found=f"a largest change from trim of {reached[allowed].max():.4g} (SI), and never on both sides",
            expected=f"at least one design that goes {thresholds.min():.4g} either way and so oscillates",
            remedy="raise the amplitudes, lower the thresholds, lengthen the trial, or change the sign of `effect`",
        )
    shape = (len(amplitude), len(threshold))
    return RelaySweep(
        family,
        np.asarray(amplitude, float),
        np.asarray(threshold, float),
        np.where(allowed, gain, np.nan).reshape(shape),
        peak.reshape(shape),
        sd.reshape(*shape, -1),
        switches.reshape(shape),
        reached.reshape(shape),
    )


def _allowed(family: RelayFamily, amplitudes: np.ndarray, thresholds: np.ndarray, limits: Limits) -> np.ndarray:
    if not (np.isfinite([*amplitudes, *thresholds]).all() and min(*amplitudes, *thresholds) > 0):
        raise InputError(
            "design grid",
            found=f"amplitudes from {amplitudes.min():g}, thresholds from {thresholds.min():g}",
            expected="positive numbers",
            remedy="both are changes from trim; `effect` says which way the output moves",
        )
    excesses = []
    for amplitude in amplitudes:
        # The steepest edge goes from one side to the other: a relay never does more.
        step = min(2 * amplitude, family.rate * family.sample_time)
        edge = family.control_trim + np.append(np.arange(-amplitude, amplitude, step), amplitude)
        excesses.append(limits.excess(edge, family.sample_time))
    allowed = np.array([not excess for excess in excesses])
    if not allowed.any():
        gentlest = excesses[int(np.argmin(amplitudes))]
        raise InputError(
            f"design grid, control {family.control}",
            found="; ".join(
                f"{name} limit {bound:.6g}, but the gentlest design reaches {value:.6g}"
                for name, (value, bound) in gentlest.items()
            )
            + " (SI)",
            expected="at least one design inside the limits",
            remedy="lower the amplitudes, set `rate` if that is at fault, or widen the limits if the vehicle allows it",
        )
    return allowed


@program(static_argnums=(0, 1))
def _predict(
    method: Filter,
    family: RelayFamily,
    space: StateSpace,
    start: Array,
    amplitudes: Array,
    thresholds: Array,
    gaps: Array,
    error: Array,
):
    def one(amplitude: Array, threshold: Array):
        run = run_relay(space, family, amplitude, threshold, start, error)
        step = jnp.full(run.control.shape[0], family.sample_time)
        summary = summarise_filter(method, space, run.control, run.outputs + gaps, step)
        gain = entropy_reduction(space.initial, summary.final, space.n_dynamic)
        peak = jnp.max(jnp.abs(run.state[:, 0]))
        return gain, peak, summary.final.sd[space.n_dynamic :], run.switches, run.reached, summary.failures

    return jax.vmap(one)(amplitudes, thresholds)
