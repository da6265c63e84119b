"""Coefficients by least squares on the measured motion: no estimate, but a place from which the posterior's mode is found.

    x_i(t_b) - x_i(t_a) = integral over (t_a, t_b) of f_i(x, c; coefficients) dt

for the measured velocities x_i over windows, the states between samples on straight lines; of a vehicle that is held, the impulse of each
measured force instead of the change of x_i. Forces are linear in all coefficients but added masses, and in gains, net weight, centre of
buoyancy and drag of a tether, so few Gauss-Newton steps end it; noise in the states draws it aside, which a place to start from may be.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.batching import filled
from seatrial.compiled.programs import program
from seatrial.core.record import Record
from seatrial.core.signals import ACTUAL, ANGLES, GAUGE_CHANNELS, QUATERNION, RATES
from seatrial.estimation.priors import Prior
from seatrial.numerics.rotations import quaternion_of_angles
from seatrial.vehicles.model import VehicleModel

SAMPLES = 8  # Samples in a window
STEPS = 4  # Gauss-Newton steps, each with every velocity weighed anew by what is left of it
# Angles of a turn that are tried; distance of angles between which the misfit bends, rad; least step of a motion in
# which it is looked for, s.
GRID, BEND, STEP = 12, 0.1, 0.1
_INDEPENDENT = 0.1  # Rows that are worth one, as neighbours share their noise


def first_guess(
    model: VehicleModel,
    records: Sequence[Record],
    starts: Sequence[Sequence[float]],
    priors: Mapping[str, Prior],
    terms: Sequence[str] | None = None,
) -> dict[str, float]:
    """Return the coefficients that explain the measured velocities or forces of several trials, drawn to the means of their priors.

    Unknowns of the vehicle beside them are among them if they have a prior.

    Args:
        model: vehicle.
        records: trials.
        starts: a state of each, SI, whose value is taken for what is not measured.
        priors: of every coefficient.
        terms: coefficients that are not zero; None for all.

    Returns:
        each coefficient inside the support of its prior; none if no velocity or force is measured, or where the motion has no end.
    """
    result = fit_motion(model, records, starts, priors, terms)
    return {name: _inside(value, priors[name]) for name, (value, _) in result.items()}


def fit_motion(
    model: VehicleModel,
    records: Sequence[Record],
    starts: Sequence[Sequence[float]],
    priors: Mapping[str, Prior],
    terms: Sequence[str] | None = None,
) -> dict[str, tuple[float, float]]:
    """Return the value of every coefficient and its standard deviation as least squares has them; arguments as `first_guess`."""
    sought, rates = _sought(model, priors, terms), _explained(model, records)
    trials = [_motion(model, record, start, rates) for record, start in zip(records, starts, strict=True)]
    fit = _fit(model, rates, trials, priors, sought)
    return (
        {}
        if fit is None
        else dict(zip(sought, zip(fit.values.tolist(), fit.spread.tolist(), strict=True), strict=True))
    )


class Turn(NamedTuple):
    """A rotation about one of the body's axes (0 to 2) by which a sensor may be turned in the body, rad, its standard deviation, and by
    how many nats the motion that it shows is then better explained."""

    axis: int
    angle: float
    sd: float
    gain: float
    missed: float
    """What the fit then leaves of the change of a velocity over a window, as a share of that change; the largest."""


def turn_of_sensor(
    model: VehicleModel,
    record: Record,
    start: Sequence[float],
    priors: Mapping[str, Prior],
    channels: Sequence[str],
) -> Turn | None:
    """Return the rotation about one axis after which the velocities of one sensor agree best with the forces of the vehicle.

    The coefficients are fitted anew for each angle, so that what is wrong in them is no rotation.

    Args:
        model: vehicle.
        record: trial.
        start: a state, SI, whose value is taken for what is not measured.
        priors: of every coefficient and unknown to be fitted.
        channels: of the sensor, of u, v, w or of p, q, r: two or three that move and are measured.

    Returns:
        the best about any axis across which two of them lie; None if nothing can be fitted.
    """
    sought, rates = _sought(model, priors, None), _explained(model, [record])
    if not sought or not set(channels) <= {*rates} & {*model.states}:
        return None
    motion = _coarser(_motion(model, record, start, rates))
    group = RATES[:3] if channels[0] in RATES[:3] else RATES[3:]
    result = []
    for axis in range(3):
        names = [group[(axis + 1) % 3], group[(axis + 2) % 3]]
        if not set(names) <= {*channels}:
            continue
        states, shown = [model.states.index(name) for name in names], [rates.index(name) for name in names]

        def fitted(angle: float, states: list[int] = states, shown: list[int] = shown) -> _Fit | None:
            turned = motion._replace(state=motion.state.copy(), explained=motion.explained.copy())
            way = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            turned.state[:, states] = motion.state[:, states] @ way
            turned.explained[:, shown] = motion.explained[:, shown] @ way
            return _fit(model, rates, [turned], priors, sought)

        result.append(_least(axis, fitted))
    best = max(result, key=lambda one: one.gain, default=None)
    return best if best is not None and np.isfinite([best.angle, best.sd, best.gain]).all() else None


def _least(axis: int, fitted: Callable[[float], "_Fit | None"]) -> Turn:
    """Return the angle of least misfit, from a grid over the whole turn on, and its standard deviation by the bend of the misfit there."""
    from scipy.optimize import fminbound

    def misfit(angle: float) -> float:
        fit = fitted(angle)
        return np.inf if fit is None else fit.misfit

    step = 2 * np.pi / GRID
    nearest = min(np.arange(-GRID // 2, GRID // 2) * step, key=misfit)
    angle = float(fminbound(misfit, nearest - step, nearest + step, xtol=1e-4))
    fit = fitted(angle)
    bend = (misfit(angle - BEND) - 2.0 * misfit(angle) + misfit(angle + BEND)) / BEND**2
    if fit is None or not bend > 0:
        return Turn(axis, angle, np.inf, 0.0, np.inf)
    return Turn(axis, angle, float(1.0 / np.sqrt(bend)), misfit(0.0) - fit.misfit, fit.missed)


def _coarser(motion: "_Motion") -> "_Motion":
    """Return a motion at steps of a tenth of a second or more, over which controls are the mean: noise counts less in longer windows."""
    stride = max(1, round(STEP / float(np.median(np.diff(motion.time)))))
    begins = np.arange(0, motion.time.size, stride)
    counts = np.diff(np.append(begins, motion.time.size))[:, None]
    control = np.add.reduceat(motion.control, begins, axis=0) / counts
    return _Motion(motion.time[begins], motion.state[begins], control, motion.explained[begins])


class _Fit(NamedTuple):
    """What least squares found: values, standard deviations, the negative logarithm of the posterior there, up to a constant, and the
    largest share that is left of the change of a velocity."""

    values: Float[np.ndarray, " k"]
    spread: Float[np.ndarray, " k"]
    misfit: float
    missed: float


def _sought(model: VehicleModel, priors: Mapping[str, Prior], terms: Sequence[str] | None) -> tuple[str, ...]:
    beside = {one.name for one in model.unknowns}
    return tuple(
        name for name in _names(model) if name in priors and (terms is None or name in terms or name in beside)
    )


def _explained(model: VehicleModel, records: Sequence[Record]) -> tuple[str, ...]:
    """Return the velocities or forces that every record measures."""
    known = (
        *(state for state in model.states if state in RATES),
        *(view for view in model.outputs if view in GAUGE_CHANNELS),
    )
    return tuple(name for name in known if all(name in record.measured for record in records))


def _fit(
    model: VehicleModel,
    rates: tuple[str, ...],
    trials: Sequence["_Motion"],
    priors: Mapping[str, Prior],
    names: tuple[str, ...],
) -> _Fit | None:
    """Return the coefficients that explain some motions; None if they tell too little, or where the fit has no end."""
    if not rates or not names:
        return None
    every = _names(model)
    at = [every.index(name) for name in names]
    mean, sd = (np.array([float(getattr(priors[name], key)) for name in names]) for key in ("mean", "sd"))
    values, spread, misfit, left = mean, sd, np.inf, np.full(len(rates), np.inf)
    for _ in range(STEPS):
        parts = [_rows(model, rates, trial, values, at) for trial in trials]
        target, design = (np.concatenate(column, axis=0) for column in zip(*parts, strict=True))
        known = np.isfinite(target).all(1) & np.isfinite(design).all((1, 2))
        target, design = target[known], design[known]
        if len(target) * len(rates) < len(names):
            return None
        left = np.sqrt(np.mean((target - design @ values) ** 2, axis=0)) + 1e-12
        weight = np.sqrt(_INDEPENDENT) / left
        a = np.concatenate([(design * weight[:, None]).reshape(-1, len(names)) * sd, np.eye(len(names))])
        b = np.concatenate([((target - design @ mean) * weight).ravel(), np.zeros(len(names))])
        information = a.T @ a  # of which the priors are at least one
        z = np.linalg.solve(information, a.T @ b)
        values = mean + sd * z
        if not np.isfinite(values).all():
            return None
        spread = sd * np.sqrt(np.diag(np.linalg.inv(information)))
        left = np.sqrt(np.mean((target - design @ values) ** 2, axis=0)) + 1e-12
        misfit = float(_INDEPENDENT * len(target) * np.log(left).sum() + 0.5 * z @ z)
    change = np.sqrt(np.mean(np.concatenate([_change(rates, trial) for trial in trials]) ** 2, axis=0))
    return _Fit(values, spread, misfit, float((left / np.maximum(change, 1e-12)).max()))


def _names(model: VehicleModel) -> tuple[str, ...]:
    return (*(str(term) for term in model.coefficients), *(one.name for one in model.unknowns))


def _inside(value: float, prior: Prior) -> float:
    """Return a value a hair inside the support."""
    lower, upper = prior.bounds
    hair = 1e-3 * float(prior.sd)
    return min(max(value, lower + hair), upper - hair)


class _Motion(NamedTuple):
    """Time, shape (n,), states, controls and what is explained of one trial at every sample, by straight lines between measured ones."""

    time: Float[np.ndarray, " n"]
    state: Float[np.ndarray, "n s"]
    control: Float[np.ndarray, "n c"]
    explained: Float[np.ndarray, "n r"]


def _motion(model: VehicleModel, record: Record, start: Sequence[float], rates: Sequence[str]) -> _Motion:
    columns, turned = [], {}
    if set(ANGLES) <= set(record.measured):
        angles = (_joined(record, angle) for angle in ANGLES)
        turned = dict(zip(QUATERNION, quaternion_of_angles(*angles), strict=True))
    for name, value in zip(model.states, start, strict=True):
        if name in record.measured:
            columns.append(_joined(record, name))
        elif name in turned:
            columns.append(turned[name])
        elif name.removesuffix(ACTUAL) in record.controls:
            columns.append(record.channel(name.removesuffix(ACTUAL)))
        else:
            columns.append(np.full(record.time.size, value))
    control = np.column_stack([record.channel(name) for name in model.controls])
    explained = np.column_stack([_joined(record, name) for name in rates] or [np.empty((record.time.size, 0))])
    return _Motion(record.time, np.column_stack(columns), control, explained)


def _joined(record: Record, name: str) -> Float[np.ndarray, " n"]:
    """Return a measured channel at every sample, by straight lines between those that are there."""
    there = np.isfinite(record.channel(name))
    return np.interp(record.time, record.time[there], record.channel(name)[there])


def _rows(
    model: VehicleModel, rates: tuple[str, ...], motion: _Motion, values: np.ndarray, at: Sequence[int]
) -> tuple[Float[np.ndarray, "w r"], Float[np.ndarray, "w r k"]]:
    """Change of each velocity, or impulse of each force, over each window less what no coefficient makes, and its derivatives.

    `values` are at `at`, the rest 0.
    """
    everywhere = np.array([0.0] * len(model.coefficients) + [one.stated for one in model.unknowns])
    everywhere[at] = values
    step = np.diff(motion.time)
    size = 1 << step.size.bit_length()  # records of like lengths share a program
    rate, slope = _linearised(model, rates)(everywhere, filled(motion.state, size), filled(motion.control, size))
    rate, slope = np.asarray(rate)[: step.size], np.asarray(slope)[: step.size][..., at]
    begins = np.arange(0, step.size, SAMPLES)
    made = np.add.reduceat(step[:, None] * rate, begins)
    design = np.add.reduceat(step[:, None, None] * slope, begins)
    return _change(rates, motion) - made + design @ values, design


def _change(rates: tuple[str, ...], motion: _Motion) -> Float[np.ndarray, "w r"]:
    """Return the change of each velocity over each window, or the impulse of each force."""
    step = np.diff(motion.time)
    begins = np.arange(0, step.size, SAMPLES)
    if rates[0] in GAUGE_CHANNELS:
        return np.add.reduceat(step[:, None] * motion.explained[:-1], begins)
    return np.diff(motion.explained[np.append(begins, step.size)], axis=0)


@lru_cache(maxsize=16)
def _linearised(model: VehicleModel, rates: tuple[str, ...]):
    names = _names(model)

    def rate(values: Array, state: Array, control: Array) -> Array:
        known = dict(zip(names, values, strict=True))
        if rates[0] in GAUGE_CHANNELS:
            result = [model.output(name, known, tuple(state), tuple(control)) for name in rates]
        else:
            change = model.derivative(known, tuple(state), tuple(control))
            result = [change[model.states.index(name)] for name in rates]
        return jnp.stack([jnp.asarray(one) for one in result])

    @program
    def along(values: Array, state: Array, control: Array) -> tuple[Array, Array]:
        middle = 0.5 * (state[1:] + state[:-1])  # the control holds over the step
        each = jax.vmap(rate, (None, 0, 0))(values, middle, control[:-1])
        return each, jax.vmap(jax.jacfwd(rate), (None, 0, 0))(values, middle, control[:-1])

    return along
