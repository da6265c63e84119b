"""Sweep of a family over amplitude and period: the entropy reduction of every design, many designs in step."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from seatrial.compiled.batching import bucket_length, filled, lanes_at_once, on_accelerator
from seatrial.compiled.programs import program
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.processes import cores
from seatrial.design.entropy import entropy_reduction
from seatrial.filters.belief import Filter
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import filter_within
from seatrial.filters.square_root import unscented_filter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.family import Family, design_words
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre
from seatrial.manoeuvres.pilot import Moment, close_loop
from seatrial.numerics.integrate import Law, time_loop
from seatrial.numerics.state_space import StateSpace

Trim = tuple[tuple[str, float], ...]
"""Every command's name and trim value, SI: controls in the vehicle's order, then set-points of an autopilot."""
LANES = 80  # Designs in one call on a processor: fewer leave its vector units idle, more no longer fit its cache

# Filters beside the square-root unscented one, in words
FILTERS = {ExtendedKalmanFilter: "extended", UnscentedKalmanFilter: "unscented"}


@dataclass(frozen=True, eq=False)
class Sweep:
    """Entropy reduction over a grid; A amplitudes, P periods.

    Attributes:
        family: timing and shape of the designs.
        amplitude: change from trim, SI, shape (A,).
        period: s, shape (P,).
        gain: entropy reduction, nats, NaN if the design breaks a limit or its motion diverges, shape (A, P).
        peak_speed: largest magnitude of the first state in the predicted motion, m/s for a speed, infinite if the motion
            diverges under what is believed, shape (A, P).
        final_sd: predicted standard deviation of each coefficient in filter units, shape (A, P, k).
        trim: every control's name and trim value, in the vehicle's order; the family drives one of them.
        utility: what makes a design the best, if that is not the gain; NaN as there, shape (A, P).
        length: when each is ended, s, if that is not after the family's duration, shape (A, P).
    """

    family: Family
    amplitude: Float[np.ndarray, " A"]
    period: Float[np.ndarray, " P"]
    gain: Float[np.ndarray, "A P"]
    peak_speed: Float[np.ndarray, "A P"]
    final_sd: Float[np.ndarray, "A P k"]
    trim: Trim
    utility: Float[np.ndarray, "A P"] | None = None
    length: Float[np.ndarray, "A P"] | None = None

    @property
    def worth(self) -> Float[np.ndarray, "A P"]:
        """What makes a design the best: the utility, or the gain."""
        return self.gain if self.utility is None else self.utility

    @property
    def best(self) -> tuple[int, int]:
        """Indices of the best design inside the limits."""
        row, column = np.unravel_index(np.nanargmax(self.worth), self.gain.shape)
        return int(row), int(column)

    def inside(
        self, trim: Trim | None = None
    ) -> tuple[Int[np.ndarray, " D"], Int[np.ndarray, " D"], Float[np.ndarray, "D n c"]]:
        """Rows and columns of the designs inside the limits, and all their controls, SI, or those of another vehicle's `trim`."""
        rows, columns = np.nonzero(np.isfinite(self.gain))
        return rows, columns, all_controls(self.family, trim or self.trim, self.amplitude[rows], self.period[columns])

    def controls(self, row: int, column: int, trim: Trim | None = None) -> Float[np.ndarray, "n c"]:
        """All controls of one design, SI, or those of another vehicle's `trim`."""
        return all_controls(
            self.family, trim or self.trim, self.amplitude[row : row + 1], self.period[column : column + 1]
        )[0]

    def best_controls(self, trim: Trim | None = None) -> Float[np.ndarray, "n c"]:
        """All controls of the best design, as `controls`."""
        return self.controls(*self.best, trim)

    def as_run(self) -> "Sweep":
        """The sweep with the duration of its best design, as long as that is to be run."""
        if self.length is None:
            return self
        return replace(self, family=replace(self.family, ended=float(self.length[self.best])))

    def words(self, row: int, column: int) -> str:
        """Name one design, as `design_words`."""
        return design_words(self.family, float(self.amplitude[row]), float(self.period[column]))

    def best_manoeuvre(self) -> Manoeuvre:
        """The best design, as long as it is to be run."""
        row, column = self.best
        made = self.family.manoeuvre(float(self.amplitude[row]), float(self.period[column]))
        return made if self.length is None else replace(made, duration=float(self.length[row, column]))


def sweep_family(
    space: StateSpace,
    family: Family,
    amplitude: Float[np.ndarray, " A"],
    period: Float[np.ndarray, " P"],
    limits: Limits = Limits(),
    method: Filter | None = None,
    measured: Float[np.ndarray, "n m"] | None = None,
    truth: Float[np.ndarray, " d"] | None = None,
    trim: Trim | None = None,
    others: Mapping[str, Limits] | None = None,
    autopilot: Autopilot | None = None,
) -> Sweep:
    """Predict every design's entropy reduction by running the filter over the motion the current belief expects.

    Args:
        space: state space; its initial belief is what is known before the trial.
        family: control channel, trim and timing.
        amplitude: changes from trim, SI.
        period: s.
        limits: bounds of the control.
        method: filter; the square-root unscented one, if not given.
        measured: 1 if a channel is measured, 0 elsewhere; None for every sample.
        truth: state and coefficients that generate the noise-free measurements; None for the mean of the initial belief.
        trim: every command's name and trim value, in order; None if the family's is the only one.
        others: bounds of controls that move with it, by name.
        autopilot: through which the designs act; the filter is given the controls that it makes.

    Raises:
        InputError: no design of the grid is inside the limits; the gentlest is named with all that it breaks.
        NumericalError: the expected motion diverges or the filter fails for every design that is inside the limits.
    """
    amplitudes, periods = (grid.ravel() for grid in np.meshgrid(amplitude, period, indexing="ij"))
    trim = ((family.control, family.trim),) if trim is None else trim
    controls = all_controls(family, trim, amplitudes, periods)
    driven = controls[..., _place(family.control, trim)]
    allowed = _allowed(family, driven, amplitudes, periods, limits)
    allowed &= _others_allowed(family, controls[allowed], trim, others or {}, allowed)
    mask = np.ones((controls.shape[1], len(space.outputs))) if measured is None else measured
    start = space.initial.mean if truth is None else np.asarray(truth, float)
    gaps = np.where(mask > 0, 0.0, np.nan)
    chosen = method or unscented_filter(len(space.states))
    # After the last sample no time passes, nothing is measured and no process noise is added.
    n, size = controls.shape[1], bucket_length(controls.shape[1])
    step, gaps = filled(np.full(n - 1, family.sample_time), size, 0.0), filled(gaps, size, np.nan)
    lanes = filled(controls.swapaxes(0, 1), size).swapaxes(0, 1)
    gain, peak, sd, failures = in_blocks(
        lambda control: _predict(chosen, space, start, control, step, gaps, autopilot), lanes
    )
    broken = allowed & ((failures > 0) | ~np.isfinite(gain))
    if broken.sum() == allowed.sum():
        worst, (factor, unit), name = int(np.argmax(broken)), _shown(family.control), FILTERS.get(type(method))
        raise NumericalError(
            f"the {name or 'square-root unscented'} filter failed for all {allowed.sum()} designs, first at amplitude "
            f"{amplitudes[worst] * factor:.4g} {unit} and period {periods[worst]:.4g} s. The expected motion diverges or the prior is "
            f"too wide. Narrow the priors" + (', or set filter = "square-root-unscented"' if name else "")
        )
    allowed, peak = allowed & ~broken, np.where(broken, np.inf, peak)
    shape = (len(amplitude), len(period))
    return Sweep(
        family,
        np.asarray(amplitude, float),
        np.asarray(period, float),
        np.where(allowed, gain, np.nan).reshape(shape),
        peak.reshape(shape),
        sd.reshape(*shape, -1),
        trim,
    )


def all_controls(family: Family, trim: Trim, amplitude: np.ndarray, period: np.ndarray) -> Float[np.ndarray, "D n c"]:
    """All controls of some designs: those that the family moves, the others at trim."""
    moved = family.signals(amplitude[:, None], period[:, None], family.time()[None, :])
    shape = np.shape(moved[family.control])
    controls = np.broadcast_to(np.array([value for _, value in trim]), (*shape, len(trim))).copy()
    for name, values in moved.items():
        controls[..., _place(name, trim)] = values
    return controls


def inside_limits(
    family: Family, controls: Float[np.ndarray, "D n c"], trim: Trim, limits: Mapping[str, Limits]
) -> Bool[np.ndarray, " D"]:
    """Return whether each design keeps the limits of every control that the family moves and that has any."""
    kept = np.ones(len(controls), bool)
    for name in (family.control, *(one.control for one in family.beside)):
        if name in limits:
            kept &= [not limits[name].excess(one, family.sample_time) for one in controls[..., _place(name, trim)]]
    return kept


def _place(control: str, trim: Trim) -> int:
    return [name for name, _ in trim].index(control)


def _others_allowed(
    family: Family, controls: np.ndarray, trim: Trim, limits: Mapping[str, Limits], allowed: np.ndarray
) -> np.ndarray:
    """Return which designs keep the limits of the controls beside; `controls` are of those that the driven one allows."""
    kept = allowed.copy()
    kept[allowed] = inside_limits(family, controls, trim, limits)
    if not kept.any():
        names = ", ".join(one.control for one in family.beside if one.control in limits)
        raise InputError(
            f"design grid, controls {names} beside {family.control}",
            found=f"none of {allowed.sum()} designs inside their limits",
            expected="one at least",
            remedy="lower their amplitudes under `together` of [design], lengthen `ramp`, or widen their limits",
        )
    return kept


def _allowed(
    family: Family, controls: np.ndarray, amplitudes: np.ndarray, periods: np.ndarray, limits: Limits
) -> np.ndarray:
    fits = family.fits(periods)
    if not fits.any():
        range_text = f"periods from {periods.min():g} s to {periods.max():g} s"
        raise InputError(f"design grid, {family.words}", found=range_text, **family.expected())
    excesses: list[dict[str, tuple[float, float]]] = [limits.excess(one, family.sample_time) for one in controls]
    allowed = fits & np.array([not excess for excess in excesses])
    if not allowed.any():
        factor, unit = _shown(family.control)
        # One that breaks the fewest limits, and of these the one whose excesses, as shares of the bounds, are least together.
        gentlest = min(np.flatnonzero(fits), key=lambda i: (len(excesses[i]), sum(map(_share, excesses[i].values()))))
        broken = " and ".join(
            f"{name} limit {bound * factor:.6g}{f' {unit}/s' if name == 'rate' else f' {unit}'}, reaching {reached * factor:.6g}"
            for name, (reached, bound) in excesses[gentlest].items()
        )
        raise InputError(
            f"design grid, control {family.control}",
            found=f"no design of {fits.sum()} inside the limits; the gentlest, of amplitude {amplitudes[gentlest] * factor:.4g} {unit} "
            f"and period {periods[gentlest]:.4g} s, breaks its {broken}",
            expected="at least one design inside the limits",
            remedy="lower the amplitudes, lengthen `ramp` if the rate is the broken limit, or widen the limits if the vehicle allows it"
            if not limits.excess(np.array([family.trim, family.trim]), family.sample_time)
            else f"the trim itself, {family.trim * factor:.6g} {unit}, is outside: correct it in [vehicle.trim], or widen the limits",
        )
    return allowed


def _share(excess: tuple[float, float]) -> float:
    reached, bound = excess
    return abs(reached - bound) / max(abs(bound), 1e-9)


def _shown(control: str) -> tuple[float, str]:
    try:
        return shown_unit(control)
    except KeyError:  # a control that is no signal of a vehicle
        return 1.0, "(SI)"


def in_blocks(run: Callable[..., tuple], *designs: np.ndarray) -> list[np.ndarray]:
    """Run over designs, one a row, in blocks of one size; the last block repeats its last design.

    On a processor blocks go to every core; on an accelerator one block after the other has all of it.
    """
    n = designs[0].shape[0]
    lanes = lanes_at_once(run, *designs, cpu=LANES)
    blocks = np.minimum(np.arange(-(-n // lanes) * lanes), n - 1).reshape(-1, lanes)
    with ThreadPoolExecutor(max_workers=1 if on_accelerator() else cores()) as pool:
        results = pool.map(lambda block: jax.tree.map(np.asarray, run(*(x[block] for x in designs))), blocks)
        return [np.concatenate(parts)[:n] for parts in zip(*results, strict=True)]


def at_every_draw(
    run: Callable[[Array, Array, Array], Array], controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> np.ndarray:
    """Run every design with every draw, in blocks: `(all controls, number of each design, coefficients)`; shape (D, S, ...)."""
    shape, held = (len(controls), len(draws)), jax.device_put(controls)
    design, draw = (index.ravel() for index in np.indices(shape))
    result = in_blocks(lambda which, values: (run(held, which, values),), design, draws[draw])[0]
    return result.reshape(*shape, *result.shape[1:])


@program(static_argnums=0)
def _predict(
    method: Filter,
    space: StateSpace,
    start: Array,
    controls: Array,
    steps: Array,
    gaps: Array,
    autopilot: Autopilot | None,
):
    d = space.n_dynamic
    fixed = tuple(start[d:])
    fed_back = [] if autopilot is None else [space.outputs.index(name) for name in autopilot.outputs]

    def observe(state: tuple, held: tuple) -> tuple:
        return space.observe((*state, *fixed), held)

    def one(commands: Array):
        def move(state: tuple, held: tuple, h: Array) -> tuple:
            return space.transition((*state, *fixed), held, h)

        def look(state: tuple, memory: Any, held: tuple, _: Any) -> tuple:
            return memory, (observe(state, held), state[0], held)

        columns: tuple | Law = tuple(commands[:, i] for i in range(commands.shape[1]))
        memory, moments = (), None
        if autopilot is not None:
            time = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)[:-1]])
            moments, memory = Moment(time, columns, tuple(gaps[:, i] for i in fed_back)), autopilot.begin()
            columns = close_loop(autopilot, lambda state, held: tuple(observe(state, held)[i] for i in fed_back))
        _, (outputs, speed, held) = time_loop(move, tuple(start[:d]), columns, steps, look, memory, moments)
        control, measurement = jnp.stack(held, 1), jnp.stack(outputs, 1) + gaps
        summary = filter_within(method, space, control, measurement, steps, growth=jnp.where(steps > 0, 1.0, 0.0))
        gain = entropy_reduction(space.initial, summary.final, d)
        return gain, jnp.max(jnp.abs(speed)), summary.final.sd[d:], summary.failures

    return jax.vmap(one)(controls)
