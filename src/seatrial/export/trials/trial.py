"""A trial on its way out: one control over time, in SI and in the operator's unit, with the limits of its campaign; neutral at its end."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.campaign.load import load_campaign
from seatrial.campaign.standing import Step, standing
from seatrial.campaign.store import Store
from seatrial.core.errors import InputError, nearest
from seatrial.core.shown import shown_unit
from seatrial.core.signals import signal_unit
from seatrial.export.trials.stick import Stick, campaign_stick

NEUTRAL = 0.0
"""Control with which every export ends, whatever the trim and the lower limit of the trial are."""
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
        caution: why nobody knows whether it keeps the limits of the motion; empty where that is known.
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
            f"at its end {self.control} goes to neutral, {NEUTRAL:g} {unit}",
            *(f"limit of the motion: {text}" for text in self.motion),
            *([f"caution: {self.caution}"] if self.caution else []),
            *([f"closed loop, of which this is a forecast: {self.rule}"] if self.rule else []),
        )


def schedules(folder: Path | str) -> dict[str, Path]:
    """Schedules of a campaign by name, the one to run next first."""
    store = Store(Path(folder))
    known = {
        "proposed": store.proposed,
        "next": store.schedule(store.next_design),
        "design": store.schedule(store.design),
        "free_form": store.schedule(store.free_design),
    }
    others = {path.stem.removesuffix("_schedule"): path for path in sorted(store.results.glob("*_schedule.csv"))}
    return {name: path for name, path in {**known, **others}.items() if path.is_file()}


def read_trial(folder: Path | str, schedule: str | None = None) -> Trial:
    """Read a schedule of a campaign, the one to run next if none is named.

    Raises:
        InputError: no schedule, none of that name, a damaged one, one that was changed, or one that breaks today's limits.
    """
    campaign = load_campaign(folder)
    found = schedules(campaign.folder)
    if not found or (schedule is not None and schedule not in found):
        raise InputError(
            f"{campaign.folder}, schedule {schedule or ''}".rstrip(),
            found="no schedule" if not found else f'"{schedule}"',
            expected="one of " + ", ".join(found) if found else "a designed trial under results/",
            remedy=nearest(schedule, found) if found and schedule else f"run `seatrial design {campaign.folder}` first",
        )
    name = schedule or next(iter(found))
    path = found[name]
    beside = path.with_suffix(".json")
    try:
        content = json.loads(beside.read_text(encoding="utf-8"))
        trial = _trial(campaign, path, content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as cause:
        raise InputError(
            str(beside),
            found=f"no schedule ({type(cause).__name__}: {cause})",
            expected="a schedule as `seatrial design` writes it, beside its CSV",
            remedy=_again(campaign),
        ) from cause
    _check(trial, path)
    _check_table(trial, path, _again(campaign))
    is_stale = Step(name, "stale", name) in standing(campaign.folder)
    return (
        trial._replace(caution=f"chosen before the campaign was changed, and not judged since: {_again(campaign)}")
        if is_stale
        else trial
    )


def value_at(trial: Trial, time: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """The control at any time of the trial, SI, within its limits."""
    value = np.interp(time, trial.time, trial.value)
    return np.clip(
        value, -np.inf if trial.lower is None else trial.lower, np.inf if trial.upper is None else trial.upper
    )


def _trial(campaign: Campaign, path: Path, content: dict[str, Any]) -> Trial:
    control = content["control"]
    factor, unit = shown_unit(control)
    if content["unit"] != unit:
        raise ValueError(f"unit {content['unit']!r} of {control}, which is shown in {unit}")
    limits = campaign.limits()
    motion = [
        f"{name} " + ", ".join(f"{key} {value}" for key, value in table.model_dump().items() if value is not None)
        for name, table in campaign.source.limits.items()
        if name != control
    ]
    time, value = np.array(content["time_s"], float), np.array(content["value"], float) / factor
    whole = time.ndim == 1 and time.shape == value.shape and time.size > 1 and np.isfinite([*time, *value]).all()
    if not (whole and (np.diff(time) >= 0).all()):
        raise ValueError("times and values that are no schedule")
    own = control == campaign.source.design.control
    lower, upper, rate = (getattr(limits, key) if own else None for key in ("lower", "upper", "rate"))
    name = campaign.source.campaign.name
    rule = content.get("rule", "")
    find_stick = partial(campaign_stick, campaign, control, value)
    manoeuvre = content["manoeuvre"]
    return Trial(name, path.name, manoeuvre, control, time, value, lower, upper, rate, tuple(motion), rule, find_stick)


def _again(campaign: Campaign) -> str:
    return f"run `seatrial design {campaign.folder}` or `seatrial next {campaign.folder}` again"


def _check_table(trial: Trial, path: Path, remedy: str) -> None:
    """Compare the CSV that people read with the JSON that is exported."""
    factor, _ = trial.shown
    try:
        lines = path.read_text(encoding="utf-8").splitlines()[1:]
        rows = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    except ValueError:  # cells that are no numbers, or rows of several lengths
        rows = np.empty((0, 2))
    wanted = np.column_stack([trial.time, trial.value * factor])
    if rows.shape != wanted.shape or not np.allclose(rows, wanted, rtol=_ROUNDING, atol=_ROUNDING):
        raise InputError(
            str(path),
            found=f"other rows than in {path.with_suffix('.json').name}, which is exported",
            expected="both as they were written",
            remedy=f"{remedy}; a trial of your own needs no export",
        )


def _check(trial: Trial, path: Path) -> None:
    factor, unit = trial.shown
    for bound, least, beyond in (
        (trial.lower, trial.value.min(), lambda x, bound: x < bound),
        (trial.upper, trial.value.max(), lambda x, bound: x > bound),
    ):
        if bound is not None and beyond(least, bound) and abs(least - bound) > _ROUNDING * max(1.0, abs(bound)):
            raise InputError(
                str(path),
                found=f"{trial.control} of {least * factor:.6g} {unit}",
                expected=f"within the campaign's limit of {bound * factor:.6g} {unit}",
                remedy="design the trial again: the limits have changed since",
            )
