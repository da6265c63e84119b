"""What the priors of the full structure mean as motion: vehicles drawn from them before any data are used.

Each draw of the coefficients and nuisances is simulated over one control; see Gelman et al., Bayesian Workflow,
arXiv:2011.01808, section 2.4.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from zlib import crc32

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import EstimationTable
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import FIRST, record_keys
from seatrial.campaign.design.sweep import design_first, is_designed
from seatrial.campaign.inference.posterior import build_posterior, initial_state
from seatrial.campaign.store.stored_result import Store
from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.argument_checks import check_kind
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_as_written, shown_unit
from seatrial.core.files import is_there
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter
from seatrial.core.result_table import text_html
from seatrial.core.signals import GAUGE_CHANNELS, QUATERNION, RATES
from seatrial.design.prior_belief import MAX_LOST_SHARE, QUANTILE_LEVELS, most_have
from seatrial.estimation.posterior.output_error import initial_name, own_name
from seatrial.estimation.priors import Prior, physical_support
from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.estimation.simulation.sensor_errors import bias_name, noise_name, share_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre, check_limits
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.messages.priors import prior_alarms, prior_cautions, prior_lines
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate

# Motions of many vehicles at once: speeds over time, and the steady speed and time constant under a constant control.
#
# From du/dt = f(u): f(u*) = 0 and T = -1 / f'(u*).

FASTEST = 20.0  # m/s or rad/s; a vehicle beyond it has run away
FINER = 10  # Times as many steps in which a vehicle is simulated again that has run away
VEHICLES_AT_ONCE = 100  # Vehicles simulated at once, so that a long record fits in memory


def speeds(
    model: VehicleModel,
    channels: Sequence[str],
    params: Mapping[str, Float[np.ndarray, " d"]],
    delay: Float[np.ndarray, " d"] | None,
    start: Float[np.ndarray, "d n_states"],
    control: Float[np.ndarray, "n n_controls"],
    step: Float[np.ndarray, " n"],
    keep: Sequence[int],
) -> tuple[Float[np.ndarray, "d k m"], np.ndarray]:
    """Speeds of each vehicle at the samples to keep, SI, and whether one leaves `FASTEST` or is no number at any sample.

    Args:
        model: vehicle.
        channels: which m of its speeds, or forces on a gauge, which have no such limit.
        params: coefficients and other unknowns of each, SI.
        delay: between command and action of each, s; None for none.
        start: state of each at the first sample, SI.
        control: held from each sample to the next, SI.
        step: time to the next sample, s; uniform if there is a delay.
        keep: indices of samples.
    """
    count, chosen, delayed = len(start), np.asarray(keep), delay is not None
    late, size = np.zeros(count) if delay is None else delay, bucket_length(len(control))
    control, step = filled(control, size), filled(step[:-1], size, 0.0)  # no time passes after the last sample
    kept, lost = np.empty((count, chosen.size, len(channels))), np.empty(count, bool)
    for i in range(0, count, VEHICLES_AT_ONCE):
        part = np.minimum(np.arange(i, i + VEHICLES_AT_ONCE), count - 1)  # the last vehicle fills the last batch
        values = {name: column[part] for name, column in params.items()}
        speed, whole = _batch(model, tuple(channels), delayed, values, late[part], start[part], control, step)
        kept[part], lost[part] = np.asarray(speed)[:, chosen], ~np.asarray(whole)
    return kept, lost


@program(static_argnums=(0, 1, 2))
def _batch(
    model: VehicleModel,
    channels: tuple[str, ...],
    delayed: bool,
    values: dict,
    late: Array,
    starts: Array,
    control: Array,
    step: Array,
) -> tuple[Array, Array]:
    def one(values: dict, late: Array, start: Array) -> tuple[Array, Array]:
        held = jax.vmap(delay_control, in_axes=(1, None), out_axes=1)(control, late / step[0]) if delayed else control
        states = simulate(model, values, held, step, start)
        if channels[0] in model.states:
            moved = states[:, jnp.array([model.states.index(name) for name in channels])]
            return moved, (jnp.abs(moved) <= FASTEST).all()

        def gauges(state: Array, told: Array) -> Array:
            return jnp.stack([model.output(name, values, tuple(state), tuple(told)) for name in channels])

        shown = jax.vmap(gauges)(states, held)
        return shown, jnp.isfinite(shown).all()

    return jax.vmap(one)(values, late, starts)


def steady_motion(
    model: VehicleModel,
    params: Mapping[str, Float[np.ndarray, " d"]],
    control: Sequence[float],
    start: float = 0.0,
    held: Mapping[str, float] | None = None,
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
    """Speed ahead, m/s, in which each vehicle settles, and the time constant there, s; NaN if there is none.

    As `trim_speed`: the first zero of du/dt on the side to which the vehicle sets off, up to `FASTEST` away.

    Args:
        model: vehicle that moves ahead.
        params: coefficients of each, SI.
        control: held, SI.
        start: speed from which it sets off, m/s. Terms in the change from trim hold near trim only, so rest may be too far.
        held: states beside u, which stay as they are, SI; 0 if nothing is said.
    """
    state = tuple(float(start if name == "u" else (held or {}).get(name, 0.0)) for name in model.states)
    speed, slope, is_steady = map(np.asarray, _settled(model, dict(params), state, tuple(map(float, control))))
    is_steady = is_steady & (slope < 0)
    return np.where(is_steady, speed, np.nan), np.where(is_steady, -1.0 / np.where(is_steady, slope, 1.0), np.nan)


@program(static_argnums=0)
def _settled(model: VehicleModel, params: dict, state: tuple, control: tuple) -> tuple[Array, Array, Array]:
    """First zero of du/dt, its slope there, 1/s, and whether there is one."""
    at = model.states.index("u")

    def one(values: dict) -> tuple[Array, Array, Array]:
        def rate(u: Array) -> Array:
            return model.derivative(values, (*state[:at], u, *state[at + 1 :]), control)[at] + 0.0 * u

        side = jnp.sign(rate(state[at]))
        grid = jnp.linspace(0.0, FASTEST, 401)
        opposed = jax.vmap(rate)(state[at] + grid * side) * side <= 0
        beyond = opposed.argmax()

        def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = 0.5 * (low + high)
            ahead = rate(state[at] + middle * side) * side > 0
            return jnp.where(ahead, middle, low), jnp.where(ahead, high, middle)

        _, high = jax.lax.fori_loop(0, 50, halve, (grid[jnp.maximum(beyond - 1, 0)], grid[beyond]))
        speed = state[at] + high * side
        return speed, jax.jvp(rate, (speed,), (jnp.ones_like(speed),))[1], opposed.any()

    return jax.vmap(one)(params)


# The trial over which a campaign's priors are shown: its control, where it starts, and the priors that belong to it.


@dataclass(frozen=True, eq=False)
class PriorTrial:
    """What is simulated.

    Attributes:
        words: what it is.
        label: of the record; empty without one.
        time: s, shape (n,).
        control: SI, in the model's order, shape (n, n_controls).
        start: state at the first sample, SI.
        measured: channels as measured, SI, NaN if not, shape (n,) each; empty without a record.
        priors: of the full structure's coefficients and nuisances.
        units: SI unit of each.
    """

    words: str
    label: str
    time: Float[np.ndarray, " n"]
    control: Float[np.ndarray, "n n_controls"]
    start: tuple[float, ...]
    measured: Mapping[str, Float[np.ndarray, " n"]]
    priors: Mapping[str, Prior]
    units: Mapping[str, str]

    @property
    def step(self) -> Float[np.ndarray, " n"]:
        """Time to the next sample, s; the last is not used."""
        gaps = np.diff(self.time)
        return np.append(gaps, gaps[-1])


def prior_trial(campaign: Campaign, reporter: Reporter = SILENT) -> PriorTrial:
    """First fitted record; where a campaign has none yet, its best design if there is one, else its largest.

    Raises:
        InputError: logs that cannot be read, or no design inside the limits.
    """
    model = campaign.model(campaign.full)
    record = _record(campaign, reporter)
    if record is None:
        return _designed(campaign, model, reporter)
    parameters = build_posterior(campaign, campaign.full, [record]).parameters
    return PriorTrial(
        f"the control of record {record.label}",
        record.label,
        record.time,
        np.column_stack([record.channel(name) for name in model.controls]),
        initial_state(campaign, model, record),
        {name: record.channel(name) for name in campaign.channels if name in record.measured},
        {parameter.name: parameter.prior for parameter in parameters},
        {parameter.name: parameter.unit for parameter in parameters},
    )


def _record(campaign: Campaign, reporter: Reporter) -> Record | None:
    """First fitted record: logs are read, but nothing is designed or simulated for the sake of it."""
    first = next(iter(record_keys(campaign)), FIRST) if campaign.is_simulated else FIRST
    is_run = (first != FIRST or is_designed(campaign)) and is_there(Store(campaign.folder).record(first))
    if not campaign.has_records or (campaign.is_simulated and not is_run):
        return None
    return get_trials(campaign, reporter).fit[0]


def _designed(campaign: Campaign, model: VehicleModel, reporter: Reporter) -> PriorTrial:
    """A member of a designed family from trim; other controls are held at theirs."""
    manoeuvre, words = (
        (design_first(campaign, reporter).best.best_manoeuvre(), "the best design")
        if is_designed(campaign)
        else (
            _largest(campaign.families[0], campaign.limits, *campaign.design.grid()),
            "the largest input of [design] inside the limits",
        )
    )
    driven, held = schedule_of(manoeuvre, campaign.family.sample_time), campaign.hull.trim
    time = driven.time
    columns = driven.columns([(name, held.get(name, 0.0)) for name in model.controls])
    priors = {term.text: (campaign.prior(term.text), model.unit_of(term)) for term in model.coefficients}
    priors |= {one.name: (campaign.prior(one.name), one.unit) for one in model.unknowns}
    if campaign.has_delay:
        priors["delay"] = campaign.prior("delay"), "s"
    return PriorTrial(
        words,
        "",
        time,
        np.column_stack(list(columns.values())),
        campaign.state_trim(model),
        {},
        {name: prior for name, (prior, _) in priors.items()},
        {name: unit for name, (_, unit) in priors.items()},
    )


def _largest(family: Family, limits: Limits, amplitudes: np.ndarray, periods: np.ndarray) -> Manoeuvre:
    """Member of a family of the largest amplitude inside the limits, and of the longest period that fits."""
    fitting = periods[family.fits(periods)]
    period = float(fitting.max() if fitting.size else periods.min())
    members = [family.manoeuvre(float(amplitude), period) for amplitude in amplitudes[::-1]]
    for member in members:
        if not limits.excess(member.sample(family.sample_time)[1], family.sample_time):
            return member
    check_limits(members[-1], limits, family.sample_time)
    return members[-1]


N_DRAWS = 2000
SHOWN_INSTANTS, SINGLE_MOTIONS = 600, 6  # Instants kept of each motion, at most; motions kept whole, to be drawn


@dataclass(frozen=True)
class Reach:
    """Effect of one parameter on a channel if only this one varies and the others are at their medians.

    Attributes:
        channel: which.
        low: the lesser of the values at the parameter's 5 and 95 %, SI: the steady speed of a surge vehicle, the largest value in the
            trial of any other.
        high: the greater; of a surge vehicle the 5 and 95 % of the steady speed, NaN if most draws have none.
    """

    channel: str
    low: float
    high: float


@dataclass(frozen=True)
class Believed:
    """One parameter's prior, and its effect if only this parameter varies.

    Attributes:
        name: of the parameter.
        unit: SI.
        quantiles: 5, 50 and 95 % of its prior, SI.
        alone: the motion that it changes, of a vehicle of several axes the one that changes most. None for parameters without motion, such
            as noise.
        blame: how much larger it is among draws that run away than among the others, in standard deviations; 0 if none do.
    """

    name: str
    unit: str
    quantiles: tuple[float, float, float]
    alone: Reach | None
    blame: float


@dataclass(frozen=True, eq=False)
class Expected:
    """One channel as the priors expect it.

    Attributes:
        channel: a speed of the vehicle through the water, or the force on a gauge.
        bands: its quantiles at `QUANTILE_LEVELS` among draws that do not diverge, SI, shape (5, n); NaN if most do.
        single: of a few draws, SI, shape (k, n); NaN if they have diverged.
        measured: as measured, SI, NaN if not, shape (n,); None if it is not.
        held: share of the measured values inside the 90 % range of what the prior expects to be measured, with noise, bias and current;
            NaN if nothing can be compared.
    """

    channel: str
    bands: Float[np.ndarray, "5 n"]
    single: Float[np.ndarray, "k n"]
    measured: Float[np.ndarray, " n"] | None
    held: float


@dataclass(frozen=True, eq=False)
class Settled:
    """Where surge vehicles settle.

    Attributes:
        at: steady control, in words.
        speed: in which each draw settles at that control from the trial's first, m/s, NaN if it does not, shape (draws,).
        time_constant: there, s, likewise.
    """

    at: str
    speed: Float[np.ndarray, " draws"]
    time_constant: Float[np.ndarray, " draws"]


@dataclass(frozen=True, eq=False)
class PriorPredictive:
    """Motions under the prior.

    Attributes:
        over: the simulated trial, in words.
        time: s, shape (n,).
        control: name to values, SI, shape (n,).
        channels: outputs of the vehicle over time.
        settled: steady speeds; None of a vehicle of other axes.
        diverged: which draws leave `FASTEST`, shape (draws,).
        stiff: which of them do so only because of the steps: in steps a tenth as long they do not, shape (draws,).
        step: median step, s.
        believed: the parameters.
        unphysical: coefficients with priors that allow unphysical values.
    """

    over: str
    time: Float[np.ndarray, " n"]
    control: Mapping[str, np.ndarray]
    channels: tuple[Expected, ...]
    settled: Settled | None
    diverged: np.ndarray
    stiff: np.ndarray
    step: float
    believed: tuple[Believed, ...]
    unphysical: tuple[str, ...]

    def __repr__(self) -> str:
        """Print what the priors mean as motion, and what to correct."""
        lines = prior_lines(self, shown_as_written({}))
        return "\n".join([*lines, *(f"- {one}" for one in (*prior_alarms(self), *prior_cautions(self)))])

    _repr_html_ = text_html

    @property
    def lost(self) -> np.ndarray:
        """Draws that run away: they diverge, or have no steady speed, shape (draws,)."""
        return self.diverged if self.settled is None else self.diverged | np.isnan(self.settled.speed)


def predict_from_prior(campaign: Campaign, reporter: Reporter = SILENT) -> PriorPredictive:
    """Draw from the full structure's prior and simulate over the trial that `prior_trial` finds.

    Args:
        campaign: of `load_campaign`.
        reporter: told how far it has come.

    Returns:
        motions over the time of that trial, SI, and what the priors allow that physics does not.

    Raises:
        InputError: no campaign, logs that cannot be read, no design inside the limits, or trials through an autopilot.
    """
    check_kind(campaign, Campaign, "campaign", "read it with `load_campaign`")
    campaign.check_no_autopilot("the prior predictive check")
    model = campaign.model(campaign.full)
    trial = prior_trial(campaign, reporter)
    key = random_key(campaign.seed, "prior predictive")
    draws = _draw(dict(trial.priors), key)
    drawn = {name: np.asarray(draws[name]) for name in trial.priors}
    moved_by = (*(term.text for term in model.coefficients), *(one.name for one in model.unknowns))
    params = {name: drawn[name] for name in moved_by}
    start, current = _starts(campaign.estimation, model, trial, drawn), _of_trial(drawn, CURRENT, trial.label)
    keep = np.unique(np.linspace(0, trial.time.size - 1, SHOWN_INSTANTS).round().astype(int))
    names = [name for name in RATES if name in model.states] or [
        name for name in GAUGE_CHANNELS if name in campaign.channels
    ]
    moved, diverged = speeds(
        model, names, params, drawn.get("delay"), np.column_stack(start), trial.control, trial.step, keep
    )
    stiff, lost = np.zeros_like(diverged), np.flatnonzero(diverged)
    if lost.size:
        finer = np.repeat(trial.control, FINER, 0), np.repeat(trial.step / FINER, FINER)
        late = drawn["delay"][lost] if "delay" in drawn else None
        values = {name: column[lost] for name, column in params.items()}
        stiff[lost] = ~speeds(model, names, values, late, np.column_stack(start)[lost], *finer, keep[:1])[1]
    channels = []
    for at, name in enumerate(names):
        shown, measured = moved[:, :, at], trial.measured.get(name)
        measured, moving = None if measured is None else measured[keep], shown[~diverged]
        usable, held = diverged.mean() <= MAX_LOST_SHARE, float("nan")
        if usable and measured is not None:
            size, share = drawn[noise_name(name)], drawn.get(share_name(name), np.zeros(diverged.size))
            noise = np.hypot(size[~diverged, None], share[~diverged, None] * moving)
            noise = noise * np.asarray(jax.random.normal(key, moving.shape))
            beside = _of_trial(drawn, bias_name(name), trial.label) + (current if name == "u" else 0.0)
            held = _held(measured, moving + beside[~diverged, None] + noise)
        bands = (
            np.quantile(moving, QUANTILE_LEVELS, axis=0)
            if usable
            else np.full((len(QUANTILE_LEVELS), keep.size), np.nan)
        )
        near = (
            np.abs(shown[:SINGLE_MOTIONS]) <= FASTEST if name in model.states else np.isfinite(shown[:SINGLE_MOTIONS])
        )
        channels.append(Expected(name, bands, np.where(near, shown[:SINGLE_MOTIONS], np.nan), measured, held))
    if campaign.vehicle.is_surge:
        control, at = _steady_control(campaign.hull.trim, campaign.family, model, trial)
        cruise = trial.start[model.states.index("u")]
        settled = Settled(at, *steady_motion(model, params, control, cruise))
        lost, alone = diverged | np.isnan(settled.speed), partial(_steady_alone, model, params, control, cruise)
    else:
        settled, lost, alone = None, diverged, _moved_alone(model, names, params, trial).get
    mass = 1.0 if campaign.hull.mass is None else campaign.hull.mass
    return PriorPredictive(
        trial.words,
        trial.time[keep],
        {name: trial.control[keep, i] for i, name in enumerate(model.controls)},
        tuple(channels),
        settled,
        diverged,
        stiff,
        float(np.median(trial.step)),
        tuple(_believed(name, drawn[name], trial.units[name], alone(name), lost) for name in drawn),
        tuple(term.text for term in model.coefficients if _reaches_beyond(mass, term, trial.priors[term.text])),
    )


def _starts(
    estimation: EstimationTable, model: VehicleModel, trial: PriorTrial, drawn: Mapping[str, np.ndarray]
) -> list[np.ndarray]:
    """Return the first state of every draw, by state; an attitude's quaternion is that of the trial, so that its length is one."""
    names = {state: initial_name(state, trial.label) for state in model.states if state not in QUATERNION}
    fixed = dict(zip(model.states, trial.start, strict=True))
    start = {state: drawn.get(names.get(state, ""), np.full(N_DRAWS, value)) for state, value in fixed.items()}
    if trial.label and estimation.initial != "trim" and "u" in start:
        start["u"] = start["u"] - _of_trial(drawn, CURRENT, trial.label)
    return list(start.values())


@program
def _draw(priors: Mapping[str, Prior], key: jax.Array) -> dict[str, Float[Array, " draws"]]:
    return {
        name: prior.draw(jax.random.fold_in(key, crc32(name.encode())), (N_DRAWS,)) for name, prior in priors.items()
    }


def _of_trial(drawn: Mapping[str, np.ndarray], name: str, label: str) -> Float[np.ndarray, " draws"]:
    """A nuisance that trials share or that each has of its own; 0 if it is none."""
    return drawn.get(name, drawn.get(own_name(name, label), np.zeros(N_DRAWS)))


def _held(measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, "draws n"]) -> float:
    """Share of the measured values inside the 90 % range of what is expected; NaN if none are measured."""
    there = np.isfinite(measured)
    if not there.any():
        return float("nan")
    low, high = np.quantile(expected[:, there], (QUANTILE_LEVELS[0], QUANTILE_LEVELS[-1]), axis=0)
    return float(np.mean((measured[there] >= low) & (measured[there] <= high)))


def _steady_control(
    known: Mapping[str, float], family: Family, model: VehicleModel, trial: PriorTrial
) -> tuple[list[float], str]:
    """Controls at trim; if none is known, the medians of the trial's."""
    trim = {**known, family.control: family.trim}
    control = [trim.get(name, 0.0) for name in model.controls]
    if not any(control):
        control = [float(value) for value in np.median(trial.control, axis=0)]
    shown = [(name, value, *shown_unit(name)) for name, value in zip(model.controls, control, strict=True)]
    return control, ", ".join(f"{name} = {value * factor:.4g} {unit}" for name, value, factor, unit in shown)


def _steady_alone(
    model: VehicleModel, params: Mapping[str, np.ndarray], control: list[float], cruise: float, name: str
) -> Reach | None:
    """Return the steady speeds of surge vehicles that differ in one parameter."""
    if name not in params:
        return None
    medians = {other: np.full(N_DRAWS, np.median(values)) for other, values in params.items()}
    steady, _ = steady_motion(model, {**medians, name: params[name]}, control, cruise)
    ends = np.nanquantile(steady, (0.05, 0.95)) if most_have(steady) else (np.nan, np.nan)
    return Reach("u", float(ends[0]), float(ends[1]))


def _moved_alone(
    model: VehicleModel, channels: Sequence[str], params: Mapping[str, np.ndarray], trial: PriorTrial
) -> dict[str, Reach]:
    """Return of each parameter the channel whose largest value in the trial it changes most, as a share of that."""
    names = list(params)
    ends = np.array([np.quantile(params[name], (0.05, 0.5, 0.95)) for name in names])
    values = np.repeat(ends[:, 1:2], 2 * len(names), axis=1)
    for i in range(len(names)):
        values[i, 2 * i : 2 * i + 2] = ends[i, [0, 2]]
    start = np.tile(trial.start, (2 * len(names), 1))
    keep = range(trial.time.size)
    moved, lost = speeds(
        model, channels, dict(zip(names, values, strict=True)), None, start, trial.control, trial.step, keep
    )
    largest = np.where(lost[:, None], np.nan, np.abs(moved).max(axis=1)).reshape(len(names), 2, len(channels))
    share = np.abs(largest[:, 1] - largest[:, 0]) / np.maximum(np.nanmax(largest, axis=(0, 1)), np.finfo(float).tiny)
    most = np.nan_to_num(share, nan=-1.0).argmax(axis=1)
    return {
        name: Reach(channels[at], float(largest[i, :, at].min()), float(largest[i, :, at].max()))
        for i, (name, at) in enumerate(zip(names, most, strict=True))
    }


def _believed(name: str, values: np.ndarray, unit: str, alone: Reach | None, lost: np.ndarray) -> Believed:
    low, middle, high = (float(value) for value in np.quantile(values, (0.05, 0.5, 0.95)))
    is_comparable = alone is not None and 0 < lost.sum() < lost.size
    blame = (values[lost].mean() - values[~lost].mean()) / values.std() if is_comparable else 0.0
    return Believed(name, unit, (low, middle, high), alone, float(blame))


def _reaches_beyond(mass: float, term: CoefficientName, prior: Prior) -> bool:
    support = physical_support(term, mass)
    return support is not None and not (support[0] <= prior.bounds[0] and prior.bounds[1] <= support[1])
