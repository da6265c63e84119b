"""A trial on its way out: one control over time, in SI and in the operator's unit, with the limits of its campaign; neutral at its end."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.schedule import damaged_about, find_schedules, read_about
from seatrial.campaign.workflow.steps import LOOP, Workflow
from seatrial.compiled.random_keys import random_key
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import SET, SIGNALS, signal_unit
from seatrial.estimation.simulation.starts import level_start
from seatrial.export.from_campaign import stored_estimate
from seatrial.export.manoeuvre import DEFAULT_SPEED
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import read_rows
from seatrial.vehicles.model import VehicleModel

# Which stick stands for a control, and which way it is moved for a positive one: that in which the vehicle's own
# equations go.
#
#     x ahead   y to starboard   z up, nose up   r to starboard      of MANUAL_CONTROL, as ArduSub reads it (joystick.cpp)
#
# A positive rudder turns one vehicle to port and another to starboard, so the sign is that of a difference of
# accelerations: between the largest and the smallest value of the trial, neutral included, at trim.

_DRAWS = 400
# Stick of a control, the velocity that it stands for, and the sign of that velocity on a positive stick.
_STICKS = {
    "n": ("x", "u", 1),
    "tau_X": ("x", "u", 1),
    "tau_Y": ("y", "v", 1),
    "tau_Z": ("z", "w", -1),
    "tau_N": ("r", "r", 1),
    "delta_r": ("r", "r", 1),
    "delta_s": ("z", "q", 1),
}


class Stick(NamedTuple):
    """Axis of MANUAL_CONTROL, and 1 or -1: its sign for a positive control."""

    axis: str
    sign: int


def campaign_stick(campaign: Campaign, control: str, value: Float[np.ndarray, " n"]) -> Stick:
    """Return the stick of a campaign's control: by its prior, or by its estimate where the prior allows both ways.

    Args:
        campaign: with its prior or estimate of what the control does.
        control: name.
        value: of it over the trial, SI, shape (n,).

    Raises:
        InputError: no stick stands for the control, it does not move the vehicle as the stick would, or either way is possible.
    """
    _, rate, _ = _row(control)
    model, key = campaign.model(campaign.full), random_key(campaign.seed, "stick")
    drawn = {
        term.text: np.asarray(campaign.prior(term.text).draw(key, (_DRAWS,)), float) for term in model.coefficients
    }
    known = {"u": DEFAULT_SPEED, **campaign.hull.trim}
    try:
        return stick_of(model, drawn, control, value, known)
    except EitherWayError:
        try:
            estimate = stored_estimate(campaign)
        except InputError as cause:
            raise _undecided(campaign.model(campaign.full), campaign.path, control, rate, "its prior") from cause
    model = campaign.model(estimate.structure)
    names = tuple(term.text for term in model.coefficients)
    draws = dict(zip(names, estimate.draws([campaign.in_next_trial(name) for name in names]).T, strict=True))
    try:
        return stick_of(model, draws, control, value, known)
    except EitherWayError as cause:
        raise _undecided(campaign.model(campaign.full), campaign.path, control, rate, "its estimate") from cause


def stick_of(
    model: VehicleModel,
    params: Mapping[str, Any],
    control: str,
    value: Float[np.ndarray, " n"],
    known: Mapping[str, float],
) -> Stick:
    """Return the stick of a control of a vehicle; `params` may be arrays of draws, which then must all agree.

    Args:
        model: the vehicle.
        params: value of each free coefficient, SI.
        control: its name.
        value: values of the trial, SI.
        known: trim of states and of the other controls, SI; 0 for the rest.

    Raises:
        InputError: no stick stands for the control, or it does not move the vehicle as the stick would.
        EitherWayError: draws of both signs.
    """
    axis, rate, sign = _row(control)
    if rate not in model.states:
        raise _unfit(
            control,
            f"a vehicle of the states {', '.join(model.states)}",
            f"one that moves in {rate}, for which stick {axis} stands",
        )
    high, low = (
        _acceleration(model, params, {**known, control: end}, rate)
        for end in (max(0.0, float(value.max())), min(0.0, float(value.min())))
    )
    change = np.atleast_1d(np.asarray(high - low, float))
    if not (change != 0).any():
        raise _unfit(control, f"no effect on {rate} at trim", "a control that moves the vehicle like its stick")
    ways = set(np.sign(change[change != 0]))
    if len(ways) > 1:
        raise EitherWayError
    return Stick(axis, round(sign * ways.pop()))


class EitherWayError(Exception):
    """Draws of the coefficients differ in the way that a control moves the vehicle."""


def _row(control: str) -> tuple[str, str, int]:
    if control not in _STICKS:
        others = "a set-point of the autopilot" if control.endswith(SET) else "one thruster of several"
        what = SIGNALS[control].meaning if control in SIGNALS else others
        raise _unfit(
            control,
            f"{control}, {what}",
            "a control of a whole motion, with a stick: " + ", ".join(_STICKS),
        )
    return _STICKS[control]


def _acceleration(model: VehicleModel, params: Mapping[str, Any], known: Mapping[str, float], rate: str) -> Any:
    state, control = level_start(model, known), tuple(known.get(name, 0.0) for name in model.controls)
    return model.derivative(params, state, control)[model.states.index(rate)]


def _undecided(model: VehicleModel, path: Path, control: str, rate: str, by: str) -> InputError:
    terms = [term.text for term in model.coefficients if control in CoefficientName.parse(term.text).signals]
    return InputError(
        f"{path}, trial of {control} as a MAVLink script",
        found=f"a positive {control} that may turn {rate} either way, by {by} of {', '.join(terms)}",
        expected="a vehicle with a known direction of motion under a positive control",
        remedy="bound the prior to one sign, run the campaign, or export with --to csv",
    )


def _unfit(control: str, found: str, expected: str) -> InputError:
    return InputError(
        f"trial of {control} as a MAVLink script",
        found=found,
        expected=expected,
        remedy="export it with --to csv, json, ros2 or mcap, and let your own driver apply it",
    )


NEUTRAL = 0.0  # Control with which every export ends, whatever the trim and the lower limit of the trial are
_ROUNDING = 1e-6


class Trial(NamedTuple):
    """A trial.

    Attributes:
        campaign: its name.
        source: name of the schedule's file.
        manoeuvre: in words.
        control: name of the control.
        time: of each bend, s; between bends the control is a straight line.
        value: at each bend, SI.
        lower: least value, SI; None for no limit.
        upper: greatest value, SI.
        rate: greatest speed of change, SI; a step between two rows is the operator's, and not limited.
        motion: other limits of the campaign, in words.
        rule: what a closed-loop trial does; its schedule only foresees it.
        find_stick: finds the stick of a remote control that stands for the control; raises InputError where none does.
        caution: why nobody knows whether it keeps the limits of the motion; empty if that is known.
    """

    campaign: str
    source: str
    manoeuvre: str
    control: str
    time: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    lower: float | None
    upper: float | None
    rate: float | None
    motion: tuple[str, ...]
    rule: str
    find_stick: Callable[[], Stick]
    caution: str = ""

    @property
    def unit(self) -> str:
        """SI unit of the control."""
        return signal_unit(self.control)

    @property
    def shown(self) -> tuple[float, str]:
        """Factor to the operator's unit, and that unit."""
        return shown_unit(self.control)

    @property
    def ending_neutral(self) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Time and value, SI, of every bend and of the way to neutral, at once at the end."""
        if self.value[-1] == NEUTRAL:
            return self.time, self.value
        return np.append(self.time, self.time[-1]), np.append(self.value, NEUTRAL)

    @property
    def lines(self) -> tuple[str, ...]:
        """What every file says at its head."""
        factor, unit = self.shown
        ends = ["none" if bound is None else f"{bound * factor:.6g} {unit}" for bound in (self.lower, self.upper)]
        rate = "none" if self.rate is None else f"{self.rate * factor:.6g} {unit}/s"
        return (
            f"trial of {self.campaign}: {self.manoeuvre} in {self.control}, {self.time[-1]:.6g} s, from {self.source}",
            f"limits of {self.control}: lower {ends[0]}, upper {ends[1]}, rate {rate}",
            f"at its end {self.control} goes to neutral, {NEUTRAL:g} {unit}{self._outside}",
            *(f"limit of the motion: {text}" for text in self.motion),
            *([f"caution: {self.caution}"] if self.caution else []),
            *([f"closed loop; this is its forecast: {self.rule}"] if self.rule else []),
        )

    @property
    def _outside(self) -> str:
        """Report that neutral lies outside the limits, if it does: they are those of the trial, which is then over."""
        below = self.lower is not None and self.lower > NEUTRAL
        if not below and (self.upper is None or self.upper >= NEUTRAL):
            return ""
        which = "below its lower" if below else "above its upper"
        return f": this is {which} limit, and intended: the limits end with the trial"


def read_trial(folder: Path | str, schedule: str | None = None) -> Trial:
    """Read a schedule of a campaign, the one to run next if none is named.

    Raises:
        InputError: no schedule, none of that name, a damaged one, one that was changed, or one that breaks today's limits.
    """
    campaign = load_campaign(folder)
    schedules = find_schedules(campaign.folder)
    if not schedules or (schedule is not None and schedule not in schedules):
        raise InputError(
            f"{campaign.folder}, schedule {schedule or ''}".rstrip(),
            found="no schedule" if not schedules else f'"{schedule}"',
            expected="one of " + ", ".join(schedules) if schedules else "a designed trial under results/",
            remedy=nearest(schedule, schedules)
            if schedules and schedule
            else f"run `seatrial design {campaign.folder}` first",
        )
    name = schedule or next(iter(schedules))
    path = schedules[name]
    content = read_about(path, _again(campaign.folder))
    try:
        trial = _trial(campaign, path, content)
    except (ValueError, KeyError, TypeError, AttributeError) as cause:
        raise damaged_about(path, cause, _again(campaign.folder)) from cause
    _check(trial, path)
    _check_table(trial, path, _again(campaign.folder))
    flow = Workflow(campaign)
    is_stale = any(step.listed == name and flow.state(step.name) == "stale" for step in LOOP)
    return (
        trial._replace(
            caution=f"chosen before a change of the campaign, and not checked after it: {_again(campaign.folder)}"
        )
        if is_stale
        else trial
    )


def value_at(trial: Trial, time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the control at any time of the trial, SI, within its limits."""
    value = np.interp(time, trial.time, trial.value)
    return np.clip(
        value, -np.inf if trial.lower is None else trial.lower, np.inf if trial.upper is None else trial.upper
    )


def _trial(campaign: Campaign, path: Path, content: dict[str, Any]) -> Trial:
    if "controls" in content:
        raise InputError(
            str(path),
            found=", ".join(str(one["control"]) for one in content["controls"]),
            expected="one control, because an exported trial moves one",
            remedy=f"let your own driver read {path}, which has a column for each",
        )
    control = content["control"]
    factor, unit = shown_unit(control)
    if content["unit"] != unit:
        raise ValueError(f"unit {content['unit']!r} of {control}, which is shown in {unit}")
    limits = campaign.control_limits.get(control, Limits())
    motion = tuple(limit.words for limit in campaign.motion_limits)
    time, value = np.array(content["time_s"], float), np.array(content["value"], float) / factor
    whole = time.ndim == 1 and time.shape == value.shape and time.size > 1 and np.isfinite([*time, *value]).all()
    if not (whole and (np.diff(time) >= 0).all()):
        raise ValueError("times and values that are no schedule")
    bounds = limits.lower, limits.upper, limits.rate
    rule = content.get("rule", "")
    find_stick = partial(campaign_stick, campaign, control, value)
    manoeuvre = content["manoeuvre"]
    return Trial(campaign.name, path.name, manoeuvre, control, time, value, *bounds, motion, rule, find_stick)


def _again(folder: Path) -> str:
    return f"run `seatrial design {folder}` or `seatrial next {folder}` again"


def _check_table(trial: Trial, path: Path, remedy: str) -> None:
    """Compare the CSV that people read with the JSON that is exported."""
    try:
        rows, cause = read_rows(path, (trial.control,)), None
        read = np.stack([rows.time, rows.controls[trial.control] * trial.shown[0]])
    except InputError as error:
        read, cause = np.empty((2, 0)), error
    wanted = np.stack([trial.time, trial.value * trial.shown[0]])
    if read.shape != wanted.shape or not np.allclose(read, wanted, rtol=_ROUNDING, atol=_ROUNDING):
        raise InputError(
            str(path),
            found=f"other rows than in {path.with_suffix('.json').name}, which is exported",
            expected="both as they were written",
            remedy=f"{remedy}; your own trial needs no export",
        ) from cause


def _check(trial: Trial, path: Path) -> None:
    factor, unit = trial.shown
    for bound, end, sign in ((trial.lower, trial.value.min(), -1), (trial.upper, trial.value.max(), 1)):
        if bound is not None and sign * (end - bound) > _ROUNDING * max(1.0, abs(bound)):
            raise InputError(
                str(path),
                found=f"{trial.control} of {end * factor:.6g} {unit}",
                expected=f"within the campaign's limit of {bound * factor:.6g} {unit}",
                remedy="design the trial again: the limits have changed since",
            )
