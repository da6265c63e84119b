"""Where in a log a commanded trial was run, and how well it was followed.

With the correlation of what was commanded and what the controls did, from a start s on,

    r(s) = sum_k <c_k, x_k(. + s)> / sqrt(sum_k |c_k|^2 sum_k |x_k(. + s)|^2),

over what the log holds of the trial, about the means there, each control k in units of its commanded standard deviation, the start is
that which explains most motion of the log, r^2 sum_k |x_k|^2, among those whose correlation is nearly the largest (in size: a control
may be logged the other way round). One that follows late is found late by as much: only a common clock could separate the two.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

import numpy as np
import scipy
from jaxtyping import Float

from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.logs.clock_shift import sums_between, vertex
from seatrial.numerics.integrate import held_mean

MIN_MOTION_SHARE = 0.5  # Share of the commanded motion that a log has to hold
NEAR_BEST_SHARE = 0.9  # Share of the largest correlation from which on the explained motion decides
MIN_CORRELATION = 0.6  # Correlation below which a log is none of the trial
GOOD_CORRELATION = 0.9  # Correlation below which a reader is told
USUAL_GAINS = (0.8, 1.25)  # Ratio of the logged to the commanded amplitude outside which a reader is told
_MISREAD = {
    60 / (2 * pi): "rpm read as rad/s",
    2 * pi / 60: "rad/s read as rpm",
    180 / pi: "degrees read as radians",
    pi / 180: "radians read as degrees",
    60.0: "rev/min read as rev/s",
    1 / 60: "rev/s read as rpm",
    2 * pi: "rad/s read as rev/s",
    1 / (2 * pi): "rev/s read as rad/s",
    1e3: "a unit a thousand times too large",
    1e-3: "a unit a thousand times too small",
}


@dataclass(frozen=True)
class ControlMatch:
    """How one control followed, SI.

    Attributes:
        name: of it.
        correlation: with what was commanded.
        gain: amplitude over the commanded one, by least squares.
        rms: root mean square of the difference.
        largest: difference.
    """

    name: str
    correlation: float
    gain: float
    rms: float
    largest: float

    @property
    def words(self) -> str:
        """In a sentence."""
        factor, unit = shown_unit(self.name)
        return (
            f"{self.name} within {self.rms * factor:.3g} {unit} (rms; at most {self.largest * factor:.3g}) of the command, "
            f"{self.gain:.0%} of its amplitude"
        )


@dataclass(frozen=True)
class ScheduleMatch:
    """Where a commanded trial was run, and how well.

    Attributes:
        start: of it on the clock of the record, s; below 0 if it had begun before.
        duration: of it, s.
        length: of the record, s.
        controls: that the record has.
    """

    start: float
    duration: float
    length: float
    controls: tuple[ControlMatch, ...]

    @property
    def ends(self) -> dict[str, float]:
        """Begin and end of what the record holds of it, s."""
        return {"start": max(self.start, 0.0), "end": min(self.start + self.duration, self.length)}

    @property
    def words(self) -> str:
        """In a sentence."""
        missing = [
            f"its {which} {lost:.3g} s are not in the log"
            for which, lost in (("first", -self.start), ("last", self.start + self.duration - self.length))
            if lost > 0.05 * self.duration
        ]
        return "; ".join([f"begun {self.start:.4g} s into the log", *missing, *(one.words for one in self.controls)])

    @property
    def cautions(self) -> list[str]:
        """What a reader must know before believing that this was the trial."""
        return [
            f"{one.name} did not follow the command well: correlation {one.correlation:.2f}, {one.words}; the fit uses the logged values"
            for one in self.controls
            if one.correlation < GOOD_CORRELATION or not USUAL_GAINS[0] <= one.gain <= USUAL_GAINS[1]
        ]


def match_schedule(
    record: Record, time: Float[np.ndarray, " m"], controls: Mapping[str, Float[np.ndarray, " m"]], source: str
) -> ScheduleMatch:
    """Find a commanded trial in a record.

    Args:
        record: all that the log holds.
        time: of the commanded samples, evenly from 0, s.
        controls: commanded, held from each sample to the next, SI.
        source: name of the schedule's file.

    Raises:
        InputError: no control of both that was to move, a control that was never moved as commanded, or one that was but turned round
            or in another unit.
    """
    names = [name for name, values in controls.items() if name in record.controls and np.ptp(values) > 0]
    if not names:
        raise InputError(
            f'record "{record.label}"',
            found=f"the controls {', '.join(record.controls) or 'none'}",
            expected=f"one that {source} moves: {', '.join(controls)}",
            remedy="map its column, or name the schedule of this run",
        )
    step = float(time[1] - time[0])
    logged = {name: _sampled(record, name, 0.0, step, int(record.time[-1] / step)) for name in names}
    start, correlation = _start([controls[name] for name in names], list(logged.values()), step)
    every = tuple(_compared(record, name, controls[name], time + start) for name in names)
    result = ScheduleMatch(start, float(time[-1] + step), float(record.time[-1]), every)
    if abs(correlation) < MIN_CORRELATION:
        raise InputError(
            f'record "{record.label}"',
            found=f"no stretch in which {', '.join(names)} moves as in {source}; the likeliest begins at {start:.4g} s, "
            f"correlation {correlation:.2f}",
            expected=f"a log of that trial, correlation {MIN_CORRELATION:g} or more",
            remedy="name the schedule of this run, or check the columns of the controls",
        )
    for one in every:
        _check_reading(record, one, source)
    return result


def _sampled(record: Record, name: str, start: float, step: float, count: int) -> Float[np.ndarray, " n"]:
    """Mean of a control over each of so many steps from a start on."""
    return held_mean(record.time, record.channel(name), start + step * np.arange(count + 1))


def _start(commanded: list[np.ndarray], logged: list[np.ndarray], step: float) -> tuple[float, float]:
    """Time at which a trial began on the clock of a log, s, and the correlation there."""
    m, n = commanded[0].size, logged[0].size
    shift = np.arange(-m, n + 1)  # of the first commanded sample on the grid of the log
    first, last = np.clip(-shift, 0, m), np.clip(n - shift, 0, m)
    count = np.maximum(last - first, 1)
    joint, of_command, of_log, whole = np.zeros(shift.size), np.zeros(shift.size), np.zeros(shift.size), 0.0
    for c, x in zip(commanded, logged, strict=True):
        scale = float(c.std())
        c, x = (c - c.mean()) / scale, (x - x.mean()) / scale
        sums = sums_between(c, first, last), sums_between(x, first + shift, last + shift)
        joint += scipy.signal.correlate(np.pad(x, m), c, mode="valid", method="fft") - sums[0] * sums[1] / count
        of_command += sums_between(c**2, first, last) - sums[0] ** 2 / count
        of_log += sums_between(x**2, first + shift, last + shift) - sums[1] ** 2 / count
        whole += float(c @ c)
    moves = (of_command >= MIN_MOTION_SHARE * whole) & (of_log > 1e-9 * whole)
    r = np.where(moves, joint / np.sqrt(np.where(moves, of_command * of_log, 1.0)), 0.0)
    explained = np.where(np.abs(r) >= NEAR_BEST_SHARE * np.abs(r).max(), r**2 * of_log, 0.0)
    at = int(np.argmax(explained))
    return float(shift[at] + vertex(np.abs(r[max(at - 1, 0) : at + 2]))) * step, float(r[at])


def _compared(record: Record, name: str, commanded: np.ndarray, time: np.ndarray) -> ControlMatch:
    step = float(time[1] - time[0])
    inside = (time >= -1e-9) & (time + step <= record.time[-1] + 1e-9)
    c, x = commanded[inside], _sampled(record, name, float(time[0]), step, time.size)[inside]
    about, moved = c - c.mean(), x - x.mean()
    size = float(np.linalg.norm(about) * np.linalg.norm(moved))
    return ControlMatch(
        name,
        float(about @ moved) / size if size > 0 else 0.0,
        float(about @ moved) / max(float(about @ about), 1e-300),
        float(np.sqrt(np.mean((x - c) ** 2))),
        float(np.abs(x - c).max()),
    )


def _check_reading(record: Record, match: ControlMatch, source: str) -> None:
    """Check that a control is neither turned round nor in another unit."""
    place = f'record "{record.label}", channel "{match.name}"'
    if match.correlation < -MIN_CORRELATION:
        raise InputError(
            place,
            found=f"the opposite of the commands of {source} commands, correlation {match.correlation:.2f}",
            expected="a control in the direction of its command",
            remedy="reverse the column with scale = -1, or the schedule",
        )
    misread = [text for ratio, text in _MISREAD.items() if abs(match.gain / ratio - 1) < 0.1]
    if match.correlation > GOOD_CORRELATION and misread:
        raise InputError(
            place,
            found=f"{match.gain:.4g} times what {source} commands: {misread[0]}?",
            expected="the unit of the column",
            remedy="correct `unit` of the column in [import.files], or the unit in the header of the schedule",
        )
