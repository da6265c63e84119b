"""Free-form inputs: levels to choose, held and joined by ramps; linear in the levels.

    control(t) = trim + sum_i basis_i(t) (level_i - trim)

The control leaves trim at `start` and is back at it at the end. Its extremes are its levels, and those of its rate are linear in them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, too_few
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.shapes import NANOSECOND


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
        self._check_timing()
        if not 0 <= self.edge <= self.active / self.size * (1 + 1e-9):
            raise InputError(
                "manoeuvre free form, edge",
                found=f"{self.edge:g} s in intervals of {self.active / self.size:g} s",
                expected="0 or more and at most the interval, so that each level is reached",
                remedy="shorten the edge, or choose fewer intervals",
            )

    def basis(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n m"]:
        """Return the shares of each interval's level at given times, s; between two levels they are those of a straight line."""
        elapsed = np.asarray(time, float) - self.start + NANOSECOND
        length = self.active / self.size
        index = np.floor(elapsed / length).astype(int)
        since = elapsed - np.clip(index, 0, self.size) * length
        share = np.clip(since / self.edge, 0.0, 1.0) if self.edge > 0 else np.ones(elapsed.size)
        column = np.arange(self.size)
        now, before = np.clip(index, -1, self.size)[:, None], np.clip(index - 1, -1, self.size)[:, None]
        # After the last interval the level is trim, and so is the one before it once the last ramp is over.
        return share[:, None] * (column == now) + (1.0 - share[:, None]) * (column == before)

    def rates(self) -> Float[np.ndarray, "r m"]:
        """Return the rows that map changes of the levels to rates of the control, per s; none if it has steps.

        They are the differences of neighbouring levels, trim at both ends, over the edge.
        """
        ends = np.vstack([np.eye(self.size), np.zeros(self.size)]) - np.vstack([np.zeros(self.size), np.eye(self.size)])
        return ends / self.edge if self.edge > 0 else np.zeros((0, self.size))

    def manoeuvre(self, levels: Float[np.ndarray, " m"]) -> Manoeuvre:
        """Return the input at given levels, SI.

        Raises:
            InputError: levels that are not m finite numbers.
        """
        chosen = np.array(levels, float)
        if chosen.shape != (self.size,) or not np.isfinite(chosen).all():
            raise InputError(
                "manoeuvre free-form levels, levels",
                found=f"shape {chosen.shape}, {int((~np.isfinite(chosen)).sum())} not finite",
                expected=f"{self.size} finite numbers",
                remedy="give one level for each interval",
            )
        settings = {"trim": self.trim, "start": self.start, "active": self.active, "edge": self.edge}
        settings |= {f"level {i + 1}": float(level) for i, level in enumerate(chosen)}

        def signal(time: np.ndarray) -> np.ndarray:
            time = np.asarray(time, float)
            return self.trim + (self.basis(time.ravel()) @ (chosen - self.trim)).reshape(time.shape)

        return Manoeuvre("free-form levels", self.control, self.duration, settings, signal)

    def _check_timing(self) -> None:
        where = "manoeuvre free form"
        if self.size < 1:
            raise too_few(where, f"{self.size} levels", 1, "choose more levels")
        if not (self.start >= 0 and self.active > 0):
            raise InputError(
                where,
                found=f"start {self.start:g} s, active {self.active:g} s",
                expected="a start of 0 or later and a positive active time",
                remedy="correct the timing",
            )
        end = self.start + self.active + self.edge
        if not end <= self.duration * (1 + 1e-9):
            raise InputError(
                f"{where}, return to trim",
                found=f"start {self.start:g} s + active {self.active:g} s + last edge {self.edge:g} s "
                f"against duration {self.duration:g} s",
                expected=f"an end within the duration; it is {end - self.duration:.6g} s late",
                remedy="shorten the active time or the edge, or lengthen the trial",
            )


def nearest_levels(form: SteppedInput, time: Float[np.ndarray, " n"], control: Float[np.ndarray, " n"]) -> np.ndarray:
    """Return the levels whose input is nearest to a sampled control in the mean square, SI, shape (m,).

    Args:
        form: whose m levels are sought.
        time: of the samples, s.
        control: at these times, SI.
    """
    change = np.linalg.lstsq(form.basis(time), np.asarray(control, float) - form.trim, rcond=None)[0]
    return form.trim + change
