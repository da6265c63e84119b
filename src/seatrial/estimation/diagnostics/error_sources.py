"""Sources of error beside the noise of the sensors, and how each of them moves what the sensors show.

    stated      the inertia of each axis, the scale of a velocity sensor, the time between the commands and the motion, and by how much
                forces depart from their formulas, by a smooth force
    found       a force along each axis that differs from run to run; effects that the model may lack: a term, a lag, a backlash or an
                offset of a command, a thrust that falls with the speed, an offset of a sensor, a start; and a larger smooth force

Each source is a column, or some, along which force, commands, starts and outputs change in proportion to its sizes. A force is held over
each step at the mean of its values at both ends, about a motion that is known: to second order in the step, and without the cost of its
equation in every derivative. Sizes of what is found are shares of the root mean square of the force, the command or the channel.

The smooth force is a Gaussian process of velocities, commands and those of some time before, x in units of their reach: the model's
forces of motion f and of commands g, each times a share that changes smoothly, with the kernel
s^2 (f(x) f(x') + g(x) g(x')) exp(-|x - x'|^2 / 2), by the columns of its pivoted Cholesky factor (Foster et al., Journal of
Machine Learning Research 10, 2009). Drag of another power, or a thrust that falls with the inflow, is nearly the same in the data as
other coefficients: only what is stated covers it.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate
from tempfile import TemporaryFile
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.argument_checks import check_number
from seatrial.core.coefficients import CoefficientName, base_name, is_coefficient
from seatrial.core.signals import (
    ACTUAL,
    ANGLES,
    OVER_GROUND,
    PROPULSION,
    QUATERNION,
    RATES,
    SPEEDS,
    is_thruster,
    signal_unit,
)
from seatrial.estimation.posterior.mode import expand_prior
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.simulation.mounts import SCALE
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.vehicles.coriolis import entry_products
from seatrial.vehicles.hull import AXES
from seatrial.vehicles.model import VehicleModel, outside_force

MOTIONS = {*RATES, *ANGLES}  # Controls that are motions given as measured, and no commands
# How controls begin that may act on other axes than the model has them on: generalised forces, which may act off the
# centre, and fins.
COUPLED = ("tau_", "delta_")
# Lags and delays of commands, s, of which sums stand for any between and about them; half a backlash, over this share of
# the spread of its command.
LAGS, SLACK = (0.5, 2.0), 0.25
# Columns of the smooth force, and points of which they are made.
RANK, POINTS = 12, 500
REACH, SHARE = 3.0, 0.6  # Reach of its kernel, in standard deviations of an input, and at least as a share of its mean
RIDGE = 1e-7  # Of the kernel, for rounding
MIN_RUNS = 3  # Runs from which on a difference between runs is told from an error of the model
FEW = 12  # Parameters up to which all structures have the same programs, at the cost of columns of zeros
SIDE_BY_SIDE = 8  # Slopes that are computed at once: each needs controls of its own over the whole record

Kind = Literal[
    "inertia",
    "scale",
    "clock",
    "run force",
    "force",
    "command lag",
    "delay",
    "backlash",
    "command offset",
    "thrust loss",
    "sensor offset",
    "start",
    "smooth force",
]


@dataclass(frozen=True)
class StatedErrors:
    """Standard deviations of stated inputs, which no residual shows; 0 for exact ones.

    Attributes:
        inertia: of each axis, divided by its stated value.
        scale: of each sensor of a velocity.
        clock: of the time between commands and motion, in intervals of the samples; if it is exact, a shift is tried as an effect.
        force: share by which the forces of motion, and those of commands, depart from their formulas.
    """

    inertia: float = 0.05
    scale: float = 0.01
    clock: float = 0.5
    force: float = 0.07

    def __post_init__(self) -> None:
        """Refuse what is no standard deviation."""
        for name, value in vars(self).items():
            most = np.inf if name == "clock" else 1.0
            check_number(
                value, f"{name} of stated errors", least=0.0, most=most, remedy="write 0 for exact, 0.05 for 5 %"
            )


@dataclass(frozen=True)
class Effect:
    """One source of error.

    Attributes:
        kind: of it.
        of: axis, coefficient, control, measured channel or state; empty for all commands.
        unit: of its size, SI; "1" for shares.
    """

    kind: Kind
    of: str
    unit: str = "1"


class Source(NamedTuple):
    """An effect with its columns.

    Attributes:
        effect: which.
        columns: their places among the sizes.
        stated: standard deviation of its size; None if it is found.
        worth: size in the effect's own unit, over that along its column.
    """

    effect: Effect
    columns: tuple[int, ...]
    stated: float | None = None
    worth: float = 1.0


class Changes(NamedTuple):
    """Changes of the motion and of what is shown; of several ways at once, these are the last axis of each array, as time loops want it.

    Attributes:
        force: on each axis of the model, N or N m, shape (axes, trials, n).
        control: of each control, shape (n_controls, trials, n).
        start: of each state, shape (n_states, trials).
        scale: of what each sensor shows, as a share, shape (channels,).
        offset: of what each sensor shows, shape (channels,).
    """

    force: Float[np.ndarray, "axes trials n"]
    control: Float[np.ndarray, "n_controls trials n"]
    start: Float[np.ndarray, "n_states trials"]
    scale: Float[np.ndarray, " channels"]
    offset: Float[np.ndarray, " channels"]

    def add(self, column: "Column", size: float, *way: int) -> None:
        """Add so much of a column, to one of several ways where it is said which."""
        field, at, values = column
        array = getattr(self, field)
        array[(slice(None) if at is None else at, *[slice(None)] * (array.ndim - 1 - len(way)), *way)] += size * values


# What changes along one size: the field of `Changes`, its place on the first axis (None for all), and by how much.
Column = tuple[str, int | None, Any]


class Perturbed(NamedTuple):
    """A posterior of d parameters about whose motion sources of error are laid out.

    Attributes:
        z: parameters of the motion, shape (d,).
        sizes: of the sources in it, shape (m,).
        sources: of error.
        columns: of the sources, by their places among the sizes.
        lags: pairs of lags, s, that stand for those of commands where they were found before; of backlash, in units of its `worth`.
        force: root mean square of the larger of the two forces that velocities and that commands make, by axis.
    """

    z: Float[np.ndarray, " d"]
    sizes: Float[np.ndarray, " m"]
    sources: tuple[Source, ...]
    columns: tuple[Column, ...]
    lags: Mapping[Effect, tuple[float, float]]
    force: Mapping[str, float]


def lay_out(
    posterior: Posterior,
    z: Float[np.ndarray, " d"],
    stated: StatedErrors,
    before: Perturbed | None = None,
    sizes: Float[np.ndarray, " m"] | None = None,
    lags: Mapping[Effect, tuple[float, float]] = {},
    among: Collection[Effect] | None = None,
    smooth: bool = True,
) -> Perturbed | None:
    """Return the sources about a motion; None if it diverges.

    Args:
        posterior: of records.
        z: parameters of the motion, shape (d,).
        stated: standard deviations of what is stated.
        before: sources of the motion, with their columns; None for none.
        sizes: of these.
        lags: pairs of lags, s, of effects, instead of `LAGS`.
        among: effects that may be sources; all if None.
        smooth: whether the smooth force has its columns, half of all; without it is only counted.
    """
    motion = _Motion(posterior, z, before, sizes)
    if not all(np.isfinite(x).all() for x in motion.states.values()):
        return None
    motion.weigh()
    builder = _Builder()
    present = {*posterior.present_names}
    for effect, worth, stated_sd, columns in _sources(motion, stated, lags, smooth):
        if (effect.kind == "force" and effect.of in present) or not (among is None or effect in among):
            builder.leave_out(columns)
        else:
            builder.add(effect, worth, stated_sd, columns)
    own = np.zeros(len(builder.columns))
    if sizes is not None:
        own[: sizes.size] = sizes
    return Perturbed(z, own, tuple(builder.sources), tuple(builder.columns), lags, motion.force)


def linearise(posterior: Posterior, at: Perturbed) -> Iterator[Float[np.ndarray, "trials n _"]]:
    """Yield of each channel what it would be measured as, and its slopes along z and then the sizes: y = slopes (z, sizes) + noise.

    Args:
        posterior: of records.
        at: where; not finite where the motion diverges.

    Yields:
        an array for each channel, shape (trials, n, 1 + d + m), 0 if nothing was measured.
    """
    d, point, noise = at.z.size, np.concatenate([at.z, at.sizes]), posterior.likelihood.noise_parameters
    moving = [i for i, name in enumerate(posterior.names) if name not in noise]  # of the noise slopes are 0
    moving += [d + place for source in at.sources for place in source.columns]
    groups = [moving[first : first + SIDE_BY_SIDE] for first in range(0, len(moving), SIDE_BY_SIDE)]
    here = [np.flatnonzero(np.asarray(channel.present) > 0) for channel in posterior.data.channels]
    changes = _changes(posterior, at.columns, at.sizes)
    shown: Sequence[Array] = ()
    # Every way yields all channels, and each channel needs all ways: a long record's slopes wait in a file, not in memory.
    with TemporaryFile() as file:
        for group in groups:
            ways, along = np.zeros((SIDE_BY_SIDE, d)), _nothing(posterior, SIDE_BY_SIDE)  # as many in each call
            for way, place in enumerate(group):
                if place < d:
                    ways[way, place] = 1.0
                else:
                    along.add(at.columns[place - d], 1.0, way)
            shown, parts = _shown_and_slopes(posterior, changes, at.z, ways, along)
            for part, of_channel in zip(parts, here, strict=True):
                file.write(np.asarray(part, float).reshape(-1, SIDE_BY_SIDE)[of_channel].data)
        lengths = SIDE_BY_SIDE * np.array([one.size for one in here])

        def rows_of(i: int) -> Float[np.ndarray, "trials n _"]:
            measured = np.asarray(posterior.data.channels[i].measured)
            rows = np.zeros((measured.size, 1 + point.size))
            rows[here[i], 0] = (measured - np.asarray(shown[i])).ravel()[here[i]]
            for number, group in enumerate(groups):
                file.seek(8 * int(number * lengths.sum() + lengths[:i].sum()))
                own = np.frombuffer(file.read(8 * int(lengths[i]))).reshape(-1, SIDE_BY_SIDE)[:, : len(group)]
                rows[here[i], 0] += own @ point[group]
                rows[here[i][:, None], 1 + np.array(group)] = own
            return rows.reshape(*measured.shape, -1)

        for i in range(len(here)):
            yield rows_of(i)


class _Motion:
    """The motion of all trials at some parameters, and the forces that the model makes along it."""

    def __init__(
        self,
        posterior: Posterior,
        z: Float[np.ndarray, " d"],
        before: Perturbed | None,
        sizes: Float[np.ndarray, " m"] | None,
    ) -> None:
        self.posterior = posterior
        self.likelihood: Any = posterior.likelihood
        self.data, self.model = posterior.data, self.likelihood.model
        self.step = np.asarray(self.data.step)
        self.inside = self.step > 0  # what fills up a trial takes no time
        changes = _nothing(posterior) if before is None else _changes(posterior, before.columns, sizes)
        shown = _follow(posterior, self.model.states, changes, z)
        self.states = dict(zip(self.model.states, np.asarray(shown), strict=True))
        last = self.inside & ~np.concatenate([self.inside[:, 1:], np.zeros_like(self.inside[:, :1])], 1)
        self.next = {
            name: np.where(last, x, np.concatenate([x[:, 1:], x[:, -1:]], 1)) for name, x in self.states.items()
        }
        self.controls = dict(zip(self.model.controls, map(np.asarray, self.data.control), strict=True))
        self.params = dict(zip(posterior.names, np.asarray(expand_prior(posterior, z)[1]), strict=True))
        apart = self.likelihood.apart(self.params)
        self.params |= {name: np.asarray(values)[:, None] for name, values in apart.items()}
        self.rates = [state for state in self.model.states if state in RATES]
        self.inertia: dict[str, float] = {}
        self.force: dict[str, float] = {}

    def weigh(self) -> None:
        """Find the inertia and the force of each axis."""
        self.inertia = {axis: self._inertia(axis) for axis in self.model.disturbance_axes}
        self.force = {axis: self._force(axis) for axis in self.model.disturbance_axes}

    def mean(self, function: Callable[[Mapping[str, Any]], Any]) -> Float[np.ndarray, "trials n"]:
        """Return the mean over each step of a function of states and controls."""
        ends = (np.asarray(function({**states, **self.controls})) for states in (self.states, self.next))
        return np.where(self.inside, 0.5 * sum(ends), 0.0)

    def rms(self, values: Float[np.ndarray, "trials n"]) -> float:
        """Return the root mean square, 1 if it is 0."""
        return float(np.sqrt(np.mean(np.square(values[self.inside])))) or 1.0

    def acceleration(self, axis: str, signals: Mapping[str, Any], outside: float = 0.0) -> np.ndarray:
        """Return the rate of the axis's velocity, for states and controls and a force from outside."""
        state, control = (tuple(signals[name] for name in names) for names in (self.model.states, self.model.controls))
        params = {**self.params, outside_force(axis): outside}
        return np.asarray(self.model.derivative(params, state, control)[self.model.states.index(SPEEDS[axis])])

    def _inertia(self, axis: str) -> float:
        """Return the inertia against a force on the axis, that of the added mass included."""
        here = {**self.states, **self.controls}
        per_force = self.acceleration(axis, here, 1.0) - self.acceleration(axis, here)
        return 1.0 / float(np.mean(per_force))

    def parts(self, axis: str, states: Mapping[str, np.ndarray]) -> Float[np.ndarray, "trials n 2"]:
        """Return the forces that velocities and that commands make, for states at one end of each step."""
        here = {**states, **self.controls}
        still = {name: np.zeros_like(x) if name in RATES else x for name, x in here.items()}
        idle = {
            name: np.zeros_like(x) if name in self.controls or name.endswith(ACTUAL) else x for name, x in here.items()
        }
        whole = self.acceleration(axis, here)
        parts = (np.broadcast_to(whole - self.acceleration(axis, other), self.step.shape) for other in (still, idle))
        return self.inertia[axis] * np.stack([*parts], -1)

    def _force(self, axis: str) -> float:
        """Return the root mean square of the larger of the two forces that velocities and that commands make."""
        return max(map(self.rms, np.moveaxis(self.parts(axis, self.states), -1, 0)))


class _Builder:
    """Collects sources and their columns."""

    def __init__(self) -> None:
        self.sources: list[Source] = []
        self.columns: list[Column] = []

    def add(self, effect: Effect, worth: float, stated: float | None, columns: list[Column]) -> None:
        """Add a source."""
        first = len(self.columns)
        self.sources.append(Source(effect, tuple(range(first, first + len(columns))), stated, worth))
        self.columns += columns

    def leave_out(self, columns: list[Column]) -> None:
        """Keep the places of what is no source here: structures of which it is one then have the same programs."""
        self.columns += columns


def _sources(
    motion: _Motion, stated: StatedErrors, lags: Mapping[Effect, tuple[float, float]], smooth: bool
) -> Iterator[tuple[Effect, float, float | None, list[Column]]]:
    """Yield every source that the model does not have: the effect, its `worth`, its stated standard deviation, and its columns."""
    likelihood, model, data = motion.likelihood, motion.model, motion.data
    axes, controls = model.disturbance_axes, model.controls
    step = np.where(motion.inside, motion.step, 1.0)
    interval = float(np.median(motion.step[motion.inside]))
    commands = [name for name in controls if name not in MOTIONS]
    for axis, (body, added) in _stated_inertia(model).items():
        gain = (motion.next[SPEEDS[axis]] - motion.states[SPEEDS[axis]]) / step
        if stated.inertia and body + added:
            column = _force_of_inertia(motion, axis, body, added, gain * motion.inside)
            yield Effect("inertia", axis), 1.0, stated.inertia, [column]
    for i, sensor in enumerate(likelihood.simulator.sensors):
        is_free = sensor.mount is not None and f"{SCALE}_{sensor.mount.name}" in sensor.mount.unknown
        if stated.scale and sensor.channel in (*RATES, *OVER_GROUND) and not is_free:
            yield Effect("scale", sensor.channel), 1.0, stated.scale, [("scale", i, 1.0)]
    if commands and not likelihood.simulator.delay:
        shift = np.zeros(_shape(motion.posterior, "control"))
        for name in commands:
            change = np.append(np.diff(motion.controls[name], axis=1), np.zeros((len(step), 1)), axis=1)
            shift[controls.index(name)] = change * (interval / step) * motion.inside
        yield Effect("clock", "", "s"), interval, stated.clock or None, [("control", None, shift)]
    if len(step) >= MIN_RUNS:
        for axis in axes:
            runs = [
                motion.force[axis] * motion.inside * (np.arange(len(step)) == run)[:, None] for run in range(len(step))
            ]
            yield (
                Effect("run force", axis),
                motion.force[axis],
                None,
                [("force", axes.index(axis), one) for one in runs],
            )
    trim = {name.removeprefix("trim "): value for name, value in model.constants if name.startswith("trim ")}
    for term in _forces(motion.posterior):
        shape = motion.mean(lambda signals, term=term: term.regressor(signals, trim))
        size = motion.force[term.axis] / motion.rms(shape)
        effect = Effect("force", term.text, model.unit_of(term))
        yield effect, size, None, [("force", axes.index(term.axis), size * shape)]
    if any(map(_propels, controls)) and "u" in model.states and not _has_loss(model):
        yield Effect("thrust loss", "", "s/m"), 1.0, None, [("force", None, _thrust_loss(motion))]
    past: dict[str, list[np.ndarray]] = {}
    for name in commands:
        past[name] = [_late(motion.controls[name], motion.step, lag) for lag in LAGS]
        size, at = motion.rms(motion.controls[name]), controls.index(name)
        yield Effect("command offset", name, signal_unit(name)), size, None, [("control", at, size)]
    unknown = {one.name for one in model.unknowns}
    may_lag = [one for one in commands if f"lag_{one}" not in unknown and one + ACTUAL not in model.states]
    for name in commands:
        spread = float(motion.controls[name][motion.inside].std())
        if spread and not name.startswith("tau_"):
            command, worth, effect = motion.controls[name], SLACK * spread, Effect("backlash", name, signal_unit(name))
            follows = [_with_backlash(command, slack * worth) - command for slack in lags.get(effect, LAGS)]
            yield effect, worth, None, [("control", controls.index(name), one) for one in follows]
    late_alike = [Effect("delay", "", "s")] * (not likelihood.simulator.delay)
    late_alike += [Effect("command lag", "", "s")] * (len(may_lag) > 1)
    for effect in (*(Effect("command lag", name, "s") for name in may_lag), *late_alike):
        columns = np.zeros((2, *_shape(motion.posterior, "control")))
        for name in [effect.of] if effect.of else may_lag if effect.kind == "command lag" else commands:
            for column, lag in zip(columns, lags.get(effect, LAGS), strict=True):
                follow = _late if effect.kind == "command lag" else _delayed
                column[controls.index(name)] = follow(motion.controls[name], motion.step, lag) - motion.controls[name]
        if commands:
            yield effect, 1.0, None, [("control", None, one) for one in columns]
    for i, sensor in enumerate(likelihood.simulator.sensors):
        if not sensor.bias:
            size = motion.rms(np.asarray(data.channels[i].measured))
            yield (
                Effect("sensor offset", sensor.channel, signal_unit(sensor.channel)),
                size,
                None,
                [("offset", i, size)],
            )
    if not likelihood.free_initial:
        for i, state in enumerate(model.states):
            if state not in QUATERNION:
                yield (
                    Effect("start", state, signal_unit(state)),
                    (size := motion.rms(motion.states[state])),
                    None,
                    [("start", i, size)],
                )
    for i, axis in enumerate(axes):
        features = _features(motion, past, axis) if smooth else ()
        yield Effect("smooth force", axis), 1.0, None, [("force", i, one) for one in features]


def _forces(posterior: Posterior) -> list[CoefficientName]:
    """Return the terms that a model may lack: constant, linear, quadratic and cubic in the axis's own velocity, in that times the speed
    ahead, linear in a control that drives other axes, and terms that other structures of the posterior have; and of a model with few
    parameters those that it has itself, which others may lack."""
    model: VehicleModel = posterior.likelihood.model
    known = {CoefficientName.parse(name) for name, _ in model.constants if is_coefficient(name)}
    everything = {*model.coefficients, *known}
    driven = {(one.axis, control) for one in everything for control in model.controls if control in one.signals}
    driven |= {(axis, f"tau_{axis}") for axis in model.disturbance_axes}
    terms = dict.fromkeys(model.coefficients)
    for axis in model.disturbance_axes:
        speed = SPEEDS[axis]
        texts = [
            f"{axis}_0",
            *([f"{axis}_{speed}", f"{axis}_{speed}abs{speed}", f"{axis}_{speed}3"] * (speed in model.states)),
        ]
        texts += [f"{axis}_u{speed}"] * (speed != "u" and {"u", speed} <= {*model.states})
        texts += [f"{axis}_{one}" for one in model.controls if one.startswith(COUPLED) and (axis, one) not in driven]
        terms |= dict.fromkeys(map(CoefficientName.parse, texts))
    rivals = posterior.present is not None and posterior.dim <= FEW
    present = set(map(base_name, posterior.present_names))
    known |= set() if rivals else {one for one in model.coefficients if one.text in present}
    # A wrong added mass is an error of the inertia, which is a stated input.
    lacking = (one for one in terms if one not in known and not one.is_added_mass)
    return [one for one in lacking if one.axis in model.disturbance_axes]


def _propels(control: str) -> bool:
    """Return whether a control is the speed or the force of a propeller or thruster, or drives the vehicle ahead by itself."""
    return control in PROPULSION or is_thruster(control)


def _has_loss(model: VehicleModel) -> bool:
    """Return whether a term of the model already makes the thrust depend on the speed ahead."""
    known = [CoefficientName.parse(name) for name, _ in model.constants if is_coefficient(name)]
    driving = {name for name in model.controls if _propels(name)}
    return any("u" in one.signals and driving & {*one.signals} for one in (*model.coefficients, *known))


def _thrust_loss(motion: _Motion) -> Float[np.ndarray, "axes trials n"]:
    """Return the change of the force on each axis if each m/s ahead takes away all of every command of propulsion, to first order."""
    small = 1e-3 / motion.rms(motion.states["u"])
    forces = []
    for axis in motion.model.disturbance_axes:

        def lost(signals: Mapping[str, Any], axis: str = axis) -> np.ndarray:
            left = {name: x * (1.0 - small * signals["u"]) for name, x in motion.controls.items() if _propels(name)}
            return motion.acceleration(axis, {**signals, **left}) - motion.acceleration(axis, signals)

        forces.append(motion.inertia[axis] * motion.mean(lost) / small)
    return np.stack(forces)


def _force_of_inertia(motion: _Motion, axis: str, body: float, added: float, gain: np.ndarray) -> Column:
    """Return the force that a larger inertia of an axis needs, and the Coriolis forces that come with it.

    A mass needs its whole acceleration along the axis, v_y' + u r - w p along Y, also if u is measured and does not move. Coriolis forces
    of the added mass are in proportion to it if they follow from it; otherwise they are coefficients.

    Args:
        motion: about which the force is laid out.
        axis: of the inertia.
        body: inertia of the rigid body, kg or kg m^2.
        added: that of the added mass.
        gain: acceleration along the axis over each step, SI, shape (trials, n).
    """
    at, axes, constants = AXES.index(axis), motion.model.disturbance_axes, dict(motion.model.constants)
    forces = {axis: -(body + added) * gain}
    products = [(added * constants.get("automatic coriolis", 0.0), one) for one in entry_products(at, at)]
    if f"mass {at}{at}" in constants:  # equations of single axes name the Coriolis forces that they have
        of_body = entry_products(at, at) if at >= 3 else [p for row in range(3) for p in entry_products(row, row)]
        products += [(body, one) for one in of_body if at >= 3 or one.name.axis == axis]
    for inertia, (name, factor) in products:
        is_present = all(signal in motion.states or signal in motion.controls for signal in name.signals)
        if inertia and name.axis in axes and is_present:
            force = inertia * factor * motion.mean(lambda signals, name=name: name.regressor(signals, {}))
            forces[name.axis] = forces.get(name.axis, 0.0) + force
    if len(forces) == 1:
        return "force", axes.index(axis), forces[axis]
    return "force", None, np.stack([np.broadcast_to(forces.get(one, 0.0), gain.shape) for one in axes])


def _stated_inertia(model: VehicleModel) -> dict[str, tuple[float, float]]:
    """Return the inertia of each axis that is stated: of the body, and of the added mass; none if forces are per unit of it."""
    stated = dict(model.constants)
    if model.per_unit_mass:
        return {}
    result = {}
    for axis in model.disturbance_axes:
        at = "XYZKMN".index(axis)
        body = stated.get(f"mass {at}{at}", stated.get(f"inertia {axis}", 0.0))
        result[axis] = body, -stated.get(f"{axis}_{SPEEDS[axis]}dot", 0.0)
    return result


def _features(motion: _Motion, past: Mapping[str, list[np.ndarray]], axis: str) -> Float[np.ndarray, "rank trials n"]:
    """Return the columns of the smooth force, means over each step."""
    constant = [x for values in past.values() for x in values]
    ends = []
    for states in (motion.states, motion.next):
        inputs = [*(states[rate] for rate in motion.rates), *motion.controls.values(), *constant]
        ends.append(np.concatenate([motion.parts(axis, states), np.stack(inputs, -1)], -1)[motion.inside])
    mean, spread = np.abs(ends[0].mean(0))[2:], ends[0].std(0)[2:]
    moves = spread > 1e-9 * (1.0 + mean)
    reach = np.maximum(REACH * spread, SHARE * mean)[
        moves
    ]  # small motions about a trim do not make forces change faster

    def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        x, y = (one[:, 2:][:, moves] / reach for one in (a, b))
        apart = np.square(x).sum(1)[:, None] + np.square(y).sum(1) - 2.0 * (x @ y.T)
        return (a[:, :2] @ b[:, :2].T) * np.exp(-0.5 * np.maximum(apart, 0.0))

    random = np.random.default_rng(0)
    points = ends[0][np.sort(random.choice(len(ends[0]), min(len(ends[0]), POINTS), replace=False))]
    pivots, factor, left = [], np.zeros((len(points), 0)), np.square(points[:, :2]).sum(1)
    ridge = RIDGE * (float(left.max()) or 1.0)
    for _ in range(min(RANK, len(points))):
        pivots.append(at := int(np.argmax(left)))
        column = (kernel(points, points[[at]])[:, 0] - factor @ factor[at]) / np.sqrt(max(left[at], ridge))
        factor, left = np.column_stack([factor, column]), np.maximum(left - column**2, 0.0)
    root = np.linalg.cholesky(kernel(points[pivots], points[pivots]) + ridge * np.eye(len(pivots)))
    features = np.zeros((len(pivots), *motion.step.shape))
    for end in ends:
        features[:, motion.inside] += 0.5 * np.linalg.solve(root, kernel(points[pivots], end))
    return features


def _late(
    column: Float[np.ndarray, "trials n"], step: Float[np.ndarray, "trials n"], lag: float
) -> Float[np.ndarray, "trials n"]:
    """Return the mean over each step of what follows a held command with a lag, from where the first one holds it."""
    left = np.exp(-step / lag)
    share = np.where(step > 0, (1.0 - left) * lag / np.where(step > 0, step, 1.0), 1.0)
    # Numbers one by one: arrays as short as the number of trials take ten times longer.
    actual = [
        [*accumulate(zip(own[:-1], rest[:-1], strict=True), lambda x, at: at[0] + (x - at[0]) * at[1], initial=own[0])]
        for own, rest in zip(column.tolist(), left.tolist(), strict=True)
    ]
    return column + (np.array(actual) - column) * share


def _with_backlash(column: Float[np.ndarray, "trials n"], slack: float) -> Float[np.ndarray, "trials n"]:
    """Return what follows a held command once that has moved away from it by half of a backlash."""
    return np.array([[*accumulate(own, lambda x, at: min(max(x, at - slack), at + slack))] for own in column.tolist()])


def _delayed(
    column: Float[np.ndarray, "trials n"], step: Float[np.ndarray, "trials n"], delay: float
) -> Float[np.ndarray, "trials n"]:
    """Return the mean over each step of a held command some time before, from where the first one holds it."""
    delayed = np.empty_like(column)
    for own, times, values in zip(delayed, np.cumsum(step, 1) - step, column, strict=True):
        area = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(times))])
        ends = [np.interp(times + shift - delay, times, area) for shift in (0.0, step.max())]
        before = np.minimum(times - delay, 0.0) * values[0], np.minimum(times + step.max() - delay, 0.0) * values[0]
        own[:] = (ends[1] + before[1] - ends[0] - before[0]) / step.max()
    return delayed


def _shape(posterior: Posterior, field: str) -> tuple[int, ...]:
    """Return the shape of a field of `Changes`."""
    likelihood: Any = posterior.likelihood
    model, (trials, n) = likelihood.model, posterior.data.step.shape
    shapes = {
        "force": (len(model.disturbance_axes), trials, n),
        "control": (len(model.controls), trials, n),
        "start": (len(model.states), trials),
    }
    return shapes.get(field, (len(likelihood.channels),))


def _nothing(posterior: Posterior, *ways: int) -> Changes:
    return Changes(*(np.zeros((*_shape(posterior, field), *ways)) for field in Changes._fields))


def _changes(posterior: Posterior, columns: Sequence[Column], sizes: Any) -> Changes:
    changes = _nothing(posterior)
    for column, size in zip(columns, sizes, strict=True):
        changes.add(column, size)
    return changes


@lru_cache(maxsize=64)
def _pushed(model: VehicleModel) -> VehicleModel:
    """Return the model with a force from outside on each axis among its controls."""
    axes, own = model.disturbance_axes, len(model.controls)

    def pushed(function: Any) -> Any:
        def value(params: Any, state: tuple, control: tuple) -> Any:
            names = (outside_force(axis) for axis in axes)
            pushes = {name: params.get(name, 0.0) + force for name, force in zip(names, control[own:], strict=True)}
            return function({**params, **pushes}, state, control[:own])

        return value

    controls = (*model.controls, *(f"outside {axis}" for axis in axes))
    outputs = {channel: pushed(view) for channel, view in model.outputs.items()}
    return replace(model, controls=controls, derivative=pushed(model.derivative), outputs=outputs)


def _shown(posterior: Posterior, sensors: tuple[Sensor, ...], changes: Changes, z: Array) -> tuple[Array, ...]:
    """Return what each sensor shows with such changes, shape (trials, n), and before those of its own scale and offset."""
    likelihood: Any = posterior.likelihood
    simulator = replace(likelihood.simulator, model=_pushed(likelihood.model), sensors=sensors)
    values = dict(zip(posterior.names, posterior.constrain(z), strict=True))

    def of_one_trial(apart: dict, trial: Any, begin: Array, force: Array, change: Array, start: Array) -> tuple:
        moved = tuple(column + change[i] for i, column in enumerate(trial.control))
        return simulator.simulate({**values, **apart}, begin + start, (*moved, *force), trial.step).kept

    starts = likelihood.starts(values, posterior.data)
    each = jax.vmap(of_one_trial, (0, 0, 0, 1, 1, 1))
    return each(likelihood.apart(values), posterior.data, starts, *changes[:3])


@program(static_argnums=1)
def _follow(posterior: Posterior, states: tuple[str, ...], changes: Changes, z: Array) -> tuple[Array, ...]:
    """Return each state of the motion, shape (trials, n)."""
    return _shown(posterior, tuple(map(Sensor, states)), changes, z)


@program
def _shown_and_slopes(
    posterior: Posterior, changes: Changes, z: Array, ways: Array, along: Changes
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return what every sensor shows, shape (trials, n), and its slopes along k ways of z and of the changes, shape (trials, n, k)."""

    def shown(z: Array, changes: Changes) -> tuple[Array, ...]:
        plain = _shown(posterior, posterior.likelihood.simulator.sensors, changes, z)
        return tuple(x * (1.0 + changes.scale[i]) + changes.offset[i] for i, x in enumerate(plain))

    return jax.vmap(lambda *way: jax.jvp(shown, (z, changes), way), (0, -1), (None, -1))(ways, along)
