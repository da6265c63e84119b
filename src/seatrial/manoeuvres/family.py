"""A family of open-loop trials: one shape on one control, of which a design chooses amplitude and period."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float

from seatrial.core.argument_checks import as_number, check_choice, check_count, check_number, check_text, shown
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.schedule import MAX_SAMPLES, Schedule, schedule_of
from seatrial.manoeuvres.shapes import SHAPES, Part, Shape
from seatrial.numerics.array_module import array_module


@dataclass(frozen=True)
class Beside:
    """A control that moves together with the driven one, SI.

    Attributes:
        control: channel.
        trim: its trim value.
        ratio: its amplitude over that of the driven control.
        period: its period over that of the driven control.
    """

    control: str
    trim: float
    ratio: float
    period: float = 1.0


@dataclass(frozen=True)
class Family:
    """Timing and shape of a trial, which all members share; SI.

    Attributes:
        control: driven channel; others stay at trim.
        trim: its trim value.
        duration: of the trial, s.
        active: time from the start in which the control may differ from trim, s; the tail at trim is informative too.
        sample_time: s.
        start: when the control first leaves trim, s.
        ramp: time every edge takes, from one level to the next, s; 0 for steps.
        kind: shape, such as `step`, `doublet`, `repeated-doublet`, `multistep-3211`, `random-steps`, `multisine` or `chirp`; the reference
            of the campaign file lists all of them.
        seed: of random levels.
        ended: end of the trial, s, possibly before the end of the input; None for its whole duration.
        beside: other controls that run the same shape at the same time, each so that they can be separated (see `Shape.part`).

    Raises:
        InputError: an unknown shape, an invalid time, or times that contradict each other.
    """

    control: str
    trim: float
    duration: float
    active: float
    sample_time: float
    start: float = 1.0
    ramp: float = 0.0
    kind: str = "repeated-doublet"
    seed: int = 0
    ended: float | None = None
    beside: tuple[Beside, ...] = ()

    def __post_init__(self) -> None:
        """Refuse settings that no trial has."""
        check_text(self.control, "Family, control", 'name the driven control, for example "n"')
        check_number(self.trim, "Family, trim")
        check_choice(self.kind, SHAPES, "Family, kind")
        for name in ("duration", "active"):
            check_number(getattr(self, name), f"Family, {name}", above=0.0, remedy="give a time in s, for example 40.0")
        for name in ("start", "ramp"):
            check_number(getattr(self, name), f"Family, {name}", least=0.0, remedy="give a time in s, or leave it out")
        check_count(self.seed, "Family, seed", least=0)
        moved = [self.control, *(one.control for one in self.beside)]
        if len(set(moved)) < len(moved):
            raise InputError(
                "Family, beside",
                found=", ".join(moved),
                expected="each control once",
                remedy="leave the repetition out",
            )
        if self.ended is not None:
            check_number(self.ended, "Family, ended", above=0.0, remedy="give a time in s, or leave it out")
        _check_times(self)

    @property
    def shape(self) -> Shape:
        """The shape of the input."""
        return SHAPES[self.kind]

    @property
    def words(self) -> str:
        """Name of the kind in a sentence."""
        return self.kind.replace("-", " ").replace("multistep 3211", "3-2-1-1")

    @property
    def end(self) -> float:
        """When the trial ends, s."""
        return self.duration if self.ended is None else self.ended

    def time(self) -> Float[np.ndarray, " n"]:
        """Sample times, s."""
        return np.arange(round(self.end / self.sample_time)) * self.sample_time

    def signal(self, amplitude: Any, period: Any, time: Any) -> Array:
        """Return the driven control at given times, SI; arguments as `signals`."""
        return self.signals(amplitude, period, time)[self.control]

    @property
    def parts(self) -> tuple[Part, ...]:
        """Shape of each control, the driven one first."""
        if not self.beside:
            return (Part(self.shape),)
        longer = (1.0, *(one.period for one in self.beside))
        return tuple(self.shape.part(k, longer) for k in range(len(longer)))

    def signals(self, amplitude: Any, period: Any, time: Any) -> dict[str, Array]:
        """Return every control that moves, by name, at given times, SI; settings and times broadcast.

        Args:
            amplitude: change of the driven control from trim, SI.
            period: s.
            time: s from the beginning of the trial.
        """
        moved = (Beside(self.control, self.trim, 1.0), *self.beside)
        return {
            one.control: one.trim + one.ratio * amplitude * self._share(part, period, time)
            for one, part in zip(moved, self.parts, strict=True)
        }

    def _share(self, part: Part, period: Any, time: Any) -> Array:
        levels, xp = part.shape.draw(self.seed + part.seed), array_module(period, time)
        period = xp.asarray(period)
        elapsed = xp.asarray(time) - self.start - part.delay * period
        with np.errstate(all="ignore"):  # a period that is none is nothing that fits
            return part.shape.share(elapsed, part.period * period, self._acting(period), self.ramp, levels)

    def _acting(self, period: Any) -> Any:
        """Time for which each control acts, s: the last to begin ends with the active time."""
        return self.active - max(part.delay for part in self.parts) * period if self.beside else self.active

    def fits(self, period: Float[np.ndarray, "*p"]) -> Bool[np.ndarray, "*p"]:
        """Return whether the whole shape fits into the active time, and its edges and samples between its turns."""
        period = np.asarray(period, float)
        turns = self._turns * period * (1 + 1e-9)
        within = (period > 0) & (self._longest * period <= self.shape.longest(self._acting(period)) * (1 + 1e-9))
        return within & (turns >= max(self.ramp, self.sample_time))

    @property
    def _longest(self) -> float:
        """Longest period of any control, as a share of that of the driven one."""
        return max(part.period for part in self.parts)

    @property
    def _turns(self) -> float:
        """Shortest time between two turns of any control, as a share of the period."""
        return min(float(part.shape.shortest(part.period)) for part in self.parts)

    def manoeuvre(self, amplitude: float, period: float) -> Manoeuvre:
        """Return one member; arguments and errors as `schedule`."""
        check_number(amplitude, f"manoeuvre {self.words}, amplitude")
        if not self.fits(np.array(as_number(period))):
            raise InputError(f"manoeuvre {self.words}, period", found=f"{shown(period)} s", **self.expected())
        settings = {
            "trim": self.trim,
            "amplitude": amplitude,
            "period": period,
            "start": self.start,
            "active": self.active,
            "ramp": self.ramp,
            "seed": float(self.seed),
            **{f"trim {one.control}": one.trim for one in self.beside},
            **{f"amplitude {one.control}": one.ratio * amplitude for one in self.beside},
        }

        def of(control: str) -> Callable[[np.ndarray], np.ndarray]:
            return lambda time: np.asarray(self.signals(amplitude, period, time)[control])

        others = {one.control: of(one.control) for one in self.beside}
        return Manoeuvre(self.words, self.control, self.end, settings, of(self.control), others)

    def schedule(self, amplitude: float, period: float, **held: float) -> Schedule:
        """Return one member as controls over time.

        Args:
            amplitude: change of the control from trim, SI.
            period: of the shape, s.
            held: values at which other controls are held, SI.

        Raises:
            InputError: an invalid amplitude, a period that does not fit, or a value for the driven control.
        """
        driven = schedule_of(self.manoeuvre(amplitude, period), self.sample_time)
        for name in driven.controls:
            if name in held:
                raise InputError(
                    f"manoeuvre {self.words}, {name}",
                    found="a constant value",
                    expected="only other controls, because this one is driven",
                    remedy="set `trim` of the family",
                )
        size = driven.time.size
        others = {name: np.full(size, check_number(value, f"schedule, {name}")) for name, value in held.items()}
        return Schedule(driven.time, {**driven.controls, **others})

    def expected(self) -> dict[str, str]:
        """Return the condition of a period and its remedy, for errors."""
        shortest = max(self.ramp, self.sample_time) / self._turns
        whole = float(self.shape.longest(1.0))
        longest = whole * self.active / (self._longest + whole * max(part.delay for part in self.parts))
        return {
            "expected": f"a {self.shape.period_is} from {shortest:.4g} s, where its edges take {self.ramp:g} s and samples "
            f"{self.sample_time:g} s, to {longest:.4g} s, so that it fits into {self.active:g} s",
            "remedy": "choose other periods, or change `active` or `ramp`",
        }


def _check_times(family: Family) -> None:
    """Check that samples and the active time fit into the duration."""
    step = check_number(
        family.sample_time, "Family, sample_time", above=0.0, remedy="give a time in s, for example 0.1"
    )
    if step > family.duration / 10 or family.duration > MAX_SAMPLES * step:
        raise InputError(
            "Family, sample_time",
            found=f"{step:g} s, of a trial of {family.duration:g} s",
            expected=f"a tenth of the duration at most, and at most {MAX_SAMPLES} samples in all",
            remedy="a hundredth of the fastest time constant is short enough",
        )
    if family.start + family.active > family.duration * (1 + 1e-9):
        raise InputError(
            "Family, active",
            found=f"start {family.start:g} s + active {family.active:g} s",
            expected=f"an end within the duration, {family.duration:g} s",
            remedy="lengthen the duration or shorten `active`: the quiet tail after the input is informative too",
        )


def design_words(family: Family, amplitude: float, period: float) -> str:
    """Name one member of a family: `repeated doublet of ±200 rpm about 1194 rpm in n, period 10 s`."""
    factor, unit = shown_unit(family.control)
    others = []
    for one in family.beside:
        own, its = shown_unit(one.control)
        slower = f", {one.period:g} times as slowly" if one.period != 1 else ""
        others.append(f" and {family.shape.sides}{one.ratio * amplitude * own:.4g} {its} in {one.control}{slower}")
    return (
        f"{family.words} of {family.shape.sides}{amplitude * factor:.4g} {unit} about {family.trim * factor:.4g} {unit} "
        f"in {family.control}{''.join(others)}, {family.shape.period_is} {period:.3g} s"
    )
