"""Does a record say what its channel map says? Its motion beside that of the vehicle as it is believed to be, and its samples alone.

A vehicle simulated from the record's own commands is no prediction yet, but it goes the same way, about as far and about as soon.
A channel that goes the other way has its sign wrong; one that goes 57.3 times as far is in degrees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np
from jaxtyping import Float

Level = Literal["pass", "caution", "fail"]
OPPOSED, RELATED = -0.4, 0.5
"""Correlation with the expected motion below which a channel goes the other way, and from which size and delay can be told."""
SIZE = 3.0
"""Ratio to the expected motion, or its inverse, from which a unit is doubted."""
CONFUSED = {
    "degrees taken for radians, or the reverse": 180 / pi,
    "rpm taken for rad/s, or the reverse": 30 / pi,
    "millimetres taken for metres, or the reverse": 1000.0,
    "revolutions taken for radians, or the reverse": 2 * pi,
    "minutes taken for seconds, or the reverse": 60.0,
}
"""Factors of unit errors."""
SPIKE = 8.0
"""Robust standard deviations from a running median beyond which a sample stands out."""
SPIKES = 0.002
"""Share of samples that stand out from which it is told."""
LATE, LONGEST = 0.1, 2.0
"""Seconds from which a shift in time is told, and up to which one is sought."""
TOLD = 0.9
"""Correlation with the shifted motion from which a shift can be told."""


@dataclass(frozen=True)
class Finding:
    """One judgement of a record.

    Attributes:
        signal: channel it is about.
        check: what was looked at.
        level: pass, caution or fail.
        value: what was found, with its unit.
        threshold: from where it counts.
        remedy: what to do; empty for a pass.
    """

    signal: str
    check: str
    level: Level
    value: str
    threshold: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """In one line."""
        end = f"; {self.remedy}" if self.remedy else ""
        return f"{self.level:<7} {self.signal:<10} {self.check}: {self.value} ({self.threshold}){end}"


def check_motion(
    name: str, step: float, measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"]
) -> list[Finding]:
    """Direction, size and delay of a measured channel beside the expected one, NaN where not measured.

    Args:
        name: channel.
        step: of the record, s.
        measured: SI, shape (n,).
        expected: of the vehicle at the prior means, SI, shape (n,).
    """
    lag, correlation = best_lag(measured, expected, round(LONGEST / step))
    against = f"below {OPPOSED:g} it goes the other way"
    if correlation <= OPPOSED:
        remedy = (
            f"the sign of {name} or of its command is turned round: set scale = -1 in the channel map, "
            "or check the axes (east-north-up or north-east-down)"
        )
        value = f"correlation {correlation:+.2f} with the motion expected"
        return [Finding(name, "direction", "fail", value, against, remedy)]
    if correlation < RELATED:
        remedy = "the motion is hardly that of the commands: check the channel map, the clocks and the priors"
        usual = f"{RELATED:g} or more is usual"
        return [Finding(name, "direction", "caution", f"correlation {correlation:+.2f}", usual, remedy)]
    found = [Finding(name, "direction", "pass", f"correlation {correlation:+.2f} with the motion expected", against)]
    there = np.isfinite(measured)
    ratio = float(np.std(measured[there]) / max(np.std(expected[there]), 1e-300))
    limits = f"between 1/{SIZE:g} and {SIZE:g}"
    fits = 1 / SIZE <= ratio <= SIZE
    value, remedy = f"{ratio:.3g} times the motion expected", "" if fits else _unit_guess(ratio)
    found.append(Finding(name, "size", "pass" if fits else "caution", value, limits, remedy))
    return [*found, *_delay(name, lag * step, correlation, _correlation(measured, expected))]


def _delay(name: str, late: float, shifted: float, direct: float) -> list[Finding]:
    """A shift in time that explains most of what is not explained without it; a slower vehicle looks late too."""
    limit = f"under {LATE:g} s, where a shift explains most of the rest"
    if abs(late) < LATE or shifted < TOLD or (1.0 - direct) < 2.0 * (1.0 - shifted):
        return []
    if late > 0:
        remedy = "give the delay a prior, [prior.delay], unless the vehicle is but slower than believed"
        return [Finding(name, "delay", "caution", f"about {late:.2g} s late", limit, remedy)]
    remedy = "the response comes before its command: put command and response on one clock, unless the vehicle is but quicker than believed"
    return [Finding(name, "delay", "caution", f"about {-late:.2g} s early", limit, remedy)]


def check_samples(name: str, values: Float[np.ndarray, " n"], noise: float) -> list[Finding]:
    """Samples that stand out from their neighbours.

    Args:
        name: channel.
        values: SI, NaN where not measured.
        noise: standard deviation of the sensor, SI; neighbours of a steep but quiet signal differ by less.
    """
    x = values[np.isfinite(values)]
    if x.size < 25:
        return []
    near = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(x, 3, mode="edge"), 7), axis=1)
    away = x - near
    scale = max(1.4826 * float(np.median(np.abs(away))), noise)
    share = float((np.abs(away) > SPIKE * scale).mean())
    limit = f"under {SPIKES:.1%} beyond {SPIKE:g} robust standard deviations"
    if share < SPIKES:
        return [Finding(name, "outliers", "pass", f"{share:.2%} of the samples", limit)]
    remedy = f'residuals = "heavy" under [sensors.{name}] bears them; look at the raw plot first'
    return [Finding(name, "outliers", "caution", f"{share:.2%} of the samples", limit, remedy)]


def check_excitation(
    names: Sequence[str], before: Float[np.ndarray, " k"], after: Float[np.ndarray, " k"]
) -> list[Finding]:
    """What the record's input can tell of each coefficient at most, as the share of the prior's deviation that is left."""
    found = []
    for name, prior, left in zip(names, before, after, strict=True):
        share = float(left / prior)
        limit = "below 70 % it is excited"
        if share < 0.7:
            found.append(Finding(name, "excitation", "pass", f"{share:.0%} of the prior's sd would be left", limit))
        else:
            remedy = "this record cannot tell it: move what it depends on further, fix it, or design a trial (`seatrial design`)"
            found.append(
                Finding(name, "excitation", "caution", f"{share:.0%} of the prior's sd would be left", limit, remedy)
            )
    return found


def best_lag(measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], most: int) -> tuple[int, float]:
    """Steps by which the measured is behind the expected, and the correlation there, that of largest size; 0 on a tie."""
    n = measured.size
    most = min(most, n // 4)
    found = {
        lag: _correlation(measured[max(lag, 0) : n + min(lag, 0)], expected[max(-lag, 0) : n - max(lag, 0)])
        for lag in range(-most, most + 1)
    }
    lag = max(found, key=lambda key: (abs(found[key]), -abs(key)))
    return lag, found[lag]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    there = np.isfinite(a) & np.isfinite(b)
    if there.sum() < 10 or np.ptp(a[there]) == 0 or np.ptp(b[there]) == 0:
        return 0.0
    return float(np.corrcoef(a[there], b[there])[0, 1])


def _unit_guess(ratio: float) -> str:
    size = max(ratio, 1 / ratio)
    near = [words for words, factor in CONFUSED.items() if 0.6 < size / factor < 1.6]
    return (
        f"{near[0]}? check the unit in the channel map"
        if near
        else "check the units in the channel map, and the priors"
    )
