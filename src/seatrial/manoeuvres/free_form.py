"""Free-form inputs: levels to choose, held and joined by ramps, or knots of a cubic spline; linear in the levels.

    control(t) = trim + sum_i basis_i(t) (level_i - trim)

Both leave trim at `start` and are back at it at the end. Extremes of value and rate over all time are linear in the levels too:
of a spline they lie in the hull of its Bézier points (Farin, Curves and Surfaces for CAGD, 2002).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from seatrial.core.errors import InputError
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.shapes import NANOSECOND


class FreeForm(Protocol):
    """An input of one control with m levels to choose."""

    @property
    def control(self) -> str:
        """Control channel it drives."""
        ...

    @property
    def trim(self) -> float:
        """Control before and after, SI."""
        ...

    @property
    def duration(self) -> float:
        """Of the whole trial, s."""
        ...

    @property
    def start(self) -> float:
        """When the control may first leave trim, s."""
        ...

    @property
    def active(self) -> float:
        """Time for which the levels act, s."""
        ...

    @property
    def size(self) -> int:
        """Number of levels."""
        ...

    def basis(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n m"]:
        """Return the change of control from trim at given times, s, for a change of one of each level."""
        ...

    def values(self) -> Float[np.ndarray, "v m"]:
        """Return the rows that map changes of the levels to bounds of the change of control: at all times it is within them."""
        ...

    def rates(self) -> Float[np.ndarray, "r m"]:
        """Return the rows that map changes of the levels to bounds of the rate of the control, per s; none where it has steps."""
        ...

    def manoeuvre(self, levels: Float[np.ndarray, " m"]) -> Manoeuvre:
        """Return the input at given levels, SI."""
        ...


@dataclass(frozen=True)
class SteppedInput:
    """Levels held over equal intervals; build it directly, SI.

    Attributes:
        control: control channel.
        trim: its value before the first interval and after the last.
        duration: of the whole trial, s.
        start: begin of the first interval, s.
        active: length of all intervals together, s.
        size: number m of intervals.
        edge: time of the straight ramp from each level to the next, at the begin of its interval, s; 0 for steps. The way back
            to trim takes it once more after the last interval.
    """

    control: str
    trim: float
    duration: float
    start: float
    active: float
    size: int
    edge: float = 0.0

    def __post_init__(self):
        """Check the timing."""
        _check_timing(self, self.edge)
        if not 0 <= self.edge <= self.active / self.size * (1 + 1e-9):
            raise InputError(
                "manoeuvre free form, edge",
                found=f"{self.edge:g} s in intervals of {self.active / self.size:g} s",
                expected="0 or more and at most the interval, so that each level is reached",
                remedy="shorten the edge, or choose fewer intervals",
            )

    def basis(self, time: np.ndarray) -> Float[np.ndarray, "n m"]:
        """Return the shares of each interval's level; between two levels they are those of a straight line."""
        elapsed = np.asarray(time, float) - self.start + NANOSECOND
        length = self.active / self.size
        index = np.floor(elapsed / length).astype(int)
        since = elapsed - np.clip(index, 0, self.size) * length
        share = np.clip(since / self.edge, 0.0, 1.0) if self.edge > 0 else np.ones(elapsed.size)
        column = np.arange(self.size)
        now, before = np.clip(index, -1, self.size)[:, None], np.clip(index - 1, -1, self.size)[:, None]
        # After the last interval the level is trim, and so is the one before it once the last ramp is over.
        return share[:, None] * (column == now) + (1.0 - share[:, None]) * (column == before)

    def values(self) -> Float[np.ndarray, "m m"]:
        """Return the levels themselves."""
        return np.eye(self.size)

    def rates(self) -> Float[np.ndarray, "r m"]:
        """Return the differences of neighbouring levels, trim at both ends, over the edge."""
        ends = np.vstack([np.eye(self.size), np.zeros(self.size)]) - np.vstack([np.zeros(self.size), np.eye(self.size)])
        return ends / self.edge if self.edge > 0 else np.zeros((0, self.size))

    def manoeuvre(self, levels: Float[np.ndarray, " m"]) -> Manoeuvre:
        """Return the input at given levels, SI."""
        return _manoeuvre(self, "free-form levels", levels, {"edge": self.edge})


@dataclass(frozen=True)
class SplineInput:
    """Cubic spline through equally spaced knots, at trim with no slope at both ends; build it directly, SI.

    Attributes:
        control: control channel.
        trim: its value before `start` and from `start` + `active` on.
        duration: of the whole trial, s.
        start: first time away from trim, s.
        active: time away from trim, s.
        size: number m of knots between the two ends.
    """

    control: str
    trim: float
    duration: float
    start: float
    active: float
    size: int

    def __post_init__(self):
        """Check the timing."""
        _check_timing(self, 0.0)

    @cached_property
    def _spline(self) -> CubicSpline:
        knots = np.linspace(0.0, self.active, self.size + 2)
        ends = np.zeros((1, self.size))
        return CubicSpline(knots, np.vstack([ends, np.eye(self.size), ends]), bc_type="clamped")

    def basis(self, time: np.ndarray) -> Float[np.ndarray, "n m"]:
        """Return the splines that are 1 at one knot and 0 at all others."""
        return self._spline(np.clip(np.asarray(time, float) - self.start, 0.0, self.active))

    def values(self) -> Float[np.ndarray, "v m"]:
        """Return the Bézier points of every piece: its ends, and a third of a piece along the tangents there."""
        knots = self._spline.x
        level, along = self._spline(knots), self._spline(knots, 1) * (knots[1] - knots[0]) / 3
        return np.concatenate([level[1:-1], (level + along)[:-1], (level - along)[1:]])

    def rates(self) -> Float[np.ndarray, "r m"]:
        """Return the Bézier points of the derivative of every half of a piece: of a whole one they may be three times too far out."""
        ends = np.linspace(0.0, self.active, 2 * self.size + 3)
        slope, along = self._spline(ends, 1), self._spline(ends, 2) * (ends[1] - ends[0]) / 2
        return np.concatenate([slope[1:-1], (slope + along)[:-1]])

    def manoeuvre(self, levels: Float[np.ndarray, " m"]) -> Manoeuvre:
        """Return the input at given levels, SI."""
        return _manoeuvre(self, "free-form spline", levels, {})


def nearest_levels(form: FreeForm, time: Float[np.ndarray, " n"], control: Float[np.ndarray, " n"]) -> np.ndarray:
    """Return the levels whose input is nearest to a sampled control in the mean square, SI, shape (m,).

    Args:
        form: whose m levels are sought.
        time: of the samples, s.
        control: at these times, SI.
    """
    change = np.linalg.lstsq(form.basis(time), np.asarray(control, float) - form.trim, rcond=None)[0]
    return form.trim + change


def _manoeuvre(form: FreeForm, name: str, levels: np.ndarray, settings: dict[str, float]) -> Manoeuvre:
    chosen = np.array(levels, float)
    if chosen.shape != (form.size,) or not np.isfinite(chosen).all():
        raise InputError(
            f"manoeuvre {name}, levels",
            found=f"shape {chosen.shape}, {int((~np.isfinite(chosen)).sum())} not finite",
            expected=f"{form.size} finite numbers",
            remedy="give one level for each interval or knot",
        )
    settings = {"trim": form.trim, "start": form.start, "active": form.active} | settings
    settings |= {f"level {i + 1}": float(level) for i, level in enumerate(chosen)}

    def signal(time: np.ndarray) -> np.ndarray:
        time = np.asarray(time, float)
        return form.trim + (form.basis(time.ravel()) @ (chosen - form.trim)).reshape(time.shape)

    return Manoeuvre(name, form.control, form.duration, settings, signal)


def _check_timing(form: FreeForm, edge: float) -> None:
    where = "manoeuvre free form"
    if form.size < 1:
        raise InputError(where, found=f"{form.size} levels", expected="at least 1", remedy="choose more levels")
    if not (form.start >= 0 and form.active > 0):
        raise InputError(
            where,
            found=f"start {form.start:g} s, active {form.active:g} s",
            expected="a start of 0 or later and a positive active time",
            remedy="correct the timing",
        )
    end = form.start + form.active + edge
    if not end <= form.duration * (1 + 1e-9):
        raise InputError(
            f"{where}, return to trim",
            found=f"start {form.start:g} s + active {form.active:g} s + last edge {edge:g} s against duration {form.duration:g} s",
            expected=f"an end within the duration; it is {end - form.duration:.6g} s late",
            remedy="shorten the active time or the edge, or lengthen the trial",
        )
