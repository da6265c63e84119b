"""Does a record say what its channel map says? Its motion beside that of the vehicle as it is believed to be, and its samples alone.

A vehicle simulated from the record's own commands is no prediction yet, but it goes the same way, about as far and about as soon.
A channel that goes the other way has its sign wrong; one that goes 57.3 times as far is in degrees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import pi
from typing import Literal

import numpy as np
from jaxtyping import Float

from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.signals import ANGLE, ANGLES, ANGULAR_RATE, FORCE, MOMENT, POSITIONS, RATES, SPEED, signal_unit
from seatrial.estimation.remedies import listed
from seatrial.manoeuvres.manoeuvre import Limits

RecordLevel = Literal["pass", "note", "caution", "fail"]
"""A note says what was not judged, and why; it casts no doubt on the record."""
OPPOSED, RELATED = -0.4, 0.5
"""Correlation with the expected motion below which a channel goes the other way, and from which size and delay can be told."""
SIZE = 3.0
"""Ratio to the expected motion, or its inverse, from which a unit is doubted."""
_LENGTHS = {
    "knots taken for m/s, or the reverse": 1.94384,
    "feet taken for metres, or the reverse": 3.28084,
    "km/h taken for m/s, or the reverse": 3.6,
    "centimetres taken for metres, or the reverse": 100.0,
    "millimetres taken for metres, or the reverse": 1000.0,
}
_DEGREES = "degrees taken for radians, or the reverse"
_ANGLES = {_DEGREES: 180 / pi, "revolutions taken for radians, or the reverse": 2 * pi}
_TURNS = {
    **_ANGLES,
    "rpm taken for rad/s, or the reverse": 30 / pi,
    "minutes taken for seconds, or the reverse": 60.0,
}
_FORCES = {
    "kilograms-force taken for newtons, or the reverse": 9.80665,
    "pounds-force taken for newtons, or the reverse": 4.44822,
}
CONFUSED = {
    str(SPEED): _LENGTHS,
    str(ANGULAR_RATE): _TURNS,
    str(ANGLE): _ANGLES,
    str(FORCE): _FORCES,
    str(MOMENT): _FORCES,
}
"""Factors of unit errors by the SI unit of what is measured or commanded."""
SUMMED = (*POSITIONS, *ANGLES)
"""Channels in which the errors of velocities, and the net weight, add up over time."""
ALIKE = 0.5
"""Share of the measured motion by which vehicles of the priors may lie apart for them to say how it goes."""
UNLIKE, AT = 1.5, 0.1
"""Ratio to the stated trim, or its inverse, from which a record contradicts it, and share by which a control may be off its trim there."""
SELDOM = 0.01
"""Share of the samples in which a control must come near its trim."""
CUT = 0.02
"""Share of the samples that may lie at the very end of a gauge's range while the expected force goes on."""
BEYOND = 0.01
"""Share of how far a control moves by which it may lie beyond a limit without being told."""
OTHER = 2.0
"""Times by which the motion of a vehicle may differ from that of the one at the prior means."""
HARDLY = 1 / 30
"""Share of its limits within which a control stays whose unit is doubted."""
APART = 0.1
"""Share of the motion by which a mirror has to explain more than a turn; either has to explain twice as much more than neither."""
SIGN = 4.0
"""Standard deviations of one sample beyond zero from which a signal has changed its sign."""
SPIKE = 8.0
"""Robust standard deviations beyond its neighbours from which a sample stands out."""
SPIKES = 0.002
"""Share of samples that stand out from which it is told."""
TOGETHER = 3
"""Neighbouring samples that may be one spike."""
AROUND = 25
"""Samples on either side that tell how much a signal scatters where it is."""
QUARTILE = 0.3186
"""A quarter of a standard normal variable's sizes are below."""
AGREED, LEFT = 0.75, 0.25
"""Share of the vehicles drawn from the priors that must go one way for the priors to say which, of those that do not run away, and
share that must be left of them."""
LATE, LONGEST = 0.1, 2.0
"""Seconds from which a shift in time is told, and up to which one is sought."""
TOLD = 0.9
"""Correlation with the shifted motion from which a shift can be told."""


@dataclass(frozen=True)
class RecordFinding:
    """One judgement of a record.

    Attributes:
        signal: channel it is about.
        check: what was looked at.
        level: pass, note, caution or fail.
        value: what was found, with its unit.
        threshold: from where it counts.
        remedy: what to do; empty for a pass.
    """

    signal: str
    check: str
    level: RecordLevel
    value: str
    threshold: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """In one line."""
        end = f"; {self.remedy}" if self.remedy else ""
        return f"{self.level:<7} {self.signal:<10} {self.check}: {self.value} ({self.threshold}){end}"


def check_motion(
    name: str,
    step: float,
    measured: Float[np.ndarray, " n"],
    expected: Float[np.ndarray, " n"],
    drawn: Float[np.ndarray, "d n"],
    has_delay: bool = False,
    controls: Sequence[str] = (),
    by_trim: bool = False,
) -> list[RecordFinding]:
    """Direction, size and delay of a measured channel beside the expected one, NaN where not measured.

    Args:
        name: channel.
        step: of the record, s.
        measured: SI, shape (n,).
        expected: of the vehicle at the prior means, SI, shape (n,).
        drawn: of vehicles drawn from the priors, SI, not finite where they run away, shape (d, n): a slower one may explain a delay.
        has_delay: whether the delay has a prior.
        controls: that make the motion, whose units may be wrong as well.
        by_trim: whether the measured channel contradicts its trim too: of two guesses of one unit only the better is made.
    """
    most = round(LONGEST / step)
    lag, correlation = best_lag(measured, expected, most)
    against = f"below {OPPOSED:g} it goes the other way"
    if correlation <= OPPOSED:
        remedy = (
            f"the sign of {name} or of its command is reversed: set scale = -1 in the channel map, "
            "or check the axes (east-north-up or north-east-down)"
        )
        value = f"correlation {correlation:+.2f} with the motion expected"
        return [RecordFinding(name, "direction", "fail", value, against, remedy)]
    if correlation < RELATED:
        remedy = "the motion hardly follows the commands: check the channel map, the clocks and the priors"
        usual = f"{RELATED:g} or more is usual"
        return [RecordFinding(name, "direction", "caution", f"correlation {correlation:+.2f}", usual, remedy)]
    results = [
        RecordFinding(name, "direction", "pass", f"correlation {correlation:+.2f} with the motion expected", against)
    ]
    there = np.isfinite(measured)
    ratio = float(np.std(measured[there]) / max(np.std(expected[there]), 1e-300))
    limits = f"between 1/{SIZE:g} and {SIZE:g}"
    fits = 1 / SIZE <= ratio <= SIZE
    value, told = f"{ratio:.3g} times the motion expected", (name, *controls)
    remedy = f"{_unit_guess(told, ratio, OTHER)}check the units of {listed(told)} in the channel map, and the priors"
    remedy = "" if fits else "see its trim, which tells the unit better" if by_trim else remedy
    results.append(RecordFinding(name, "size", "pass" if fits else "caution", value, limits, remedy))
    late = lag * step
    if abs(late) >= LATE:
        others = [best_lag(measured, one, most)[0] * step for one in drawn if np.isfinite(one).all()]
        if any(one * late < LATE * abs(late) for one in others):
            return results
    return [*results, *_delay(name, late, correlation, _correlation(measured, expected), has_delay)]


def check_range(
    name: str, measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], noise: float
) -> list[RecordFinding]:
    """Return an end of a gauge's range at which many samples lie exactly, while the expected force goes on: it is at its limit.

    Args:
        name: channel.
        measured: SI, NaN where not measured.
        expected: of the vehicle at the prior means, SI.
        noise: standard deviation of the gauge, SI.
    """
    there = np.isfinite(measured)
    x, y = measured[there], expected[there]
    for end, word in ((x.min(initial=np.inf), "least"), (x.max(initial=-np.inf), "greatest")):
        at = x == end
        if at.sum() > CUT * x.size and np.ptp(y[at]) > max(SPIKE * noise, CUT * np.ptp(y)):
            value = f"{at.mean():.0%} of the samples are {end:.4g}, its {word} value, while the expected force goes on"
            remedy = "the gauge is at its limit, a rope is slack, or the value is frozen: leave these samples out, or measure them again"
            return [RecordFinding(name, "range", "fail", value, f"usual: under {CUT:.0%}", remedy)]
    return []


def check_limits(
    name: str, column: Float[np.ndarray, " n"], limits: Limits, factor: float, unit: str
) -> list[RecordFinding]:
    """Return the bound of a control that a record goes beyond, by more than a hundredth of how far it moves.

    Args:
        name: control.
        column: SI.
        limits: that designs of this control keep, SI.
        factor: from SI to the unit in which the control is shown.
        unit: that unit.
    """
    least, greatest = float(column.min()), float(column.max())
    slack, results = BEYOND * (greatest - least) + 1e-9 * max(abs(least), abs(greatest)), []
    for key, bound, end, is_beyond in (
        ("lower", limits.lower, least, limits.lower is not None and least < limits.lower - slack),
        ("upper", limits.upper, greatest, limits.upper is not None and greatest > limits.upper + slack),
    ):
        if bound is not None and is_beyond:
            limit = f"limits.{name}.{key} is {bound * factor:.4g} {unit}"
            remedy = "designs stay inside the limit: correct it if the vehicle may go so far, else check the unit in the channel map"
            value = f"the record reaches {end * factor:.4g} {unit}"
            results.append(RecordFinding(name, "limits", "caution", value, limit, remedy))
    farthest = max((abs(bound) for bound in (limits.lower, limits.upper) if bound is not None), default=0.0)
    reached = max(abs(least), abs(greatest))
    if 0 < reached < HARDLY * farthest:
        value, limit = (
            f"the record reaches {reached * factor:.4g} {unit}",
            f"limits.{name} go to {farthest * factor:.4g} {unit}",
        )
        remedy = _unit_guess((name,), reached / farthest) + "check the unit in the channel map, or correct the limits"
        results.append(RecordFinding(name, "limits", "caution", value, limit, remedy))
    return results


def check_angle(name: str, column: Float[np.ndarray, " n"], factor: float, unit: str) -> list[RecordFinding]:
    """Return the doubt of a rudder or fin that turns by more than a quarter turn: its degrees are read as radians.

    Args:
        name: control.
        column: SI.
        factor: from SI to the unit in which the control is shown.
        unit: that unit.
    """
    reached = float(np.abs(column).max())
    if signal_unit(name) != str(ANGLE) or reached <= pi / 2:
        return []
    value, limit = f"the record reaches {reached * factor:.4g} {unit}", f"usual: up to {pi / 2 * factor:.4g} {unit}"
    return [RecordFinding(name, "size", "caution", value, limit, f"{_DEGREES}? check the unit in the channel map")]


def check_trim(
    trim: Mapping[str, float],
    controls: Mapping[str, Float[np.ndarray, " n"]],
    measured: Mapping[str, Float[np.ndarray, " n"]],
) -> list[RecordFinding]:
    """Return what contradicts the trim: a control that never comes near its value, a speed of another size where all controls do.

    Args:
        trim: of controls and velocities that belong together, SI.
        controls: of the record by name, SI.
        measured: velocities of the record by name, SI, NaN where not measured.
    """
    results = []
    for name in (one for one in controls if trim.get(one)):
        share = controls[name] / trim[name]
        if np.mean((share > 1 / UNLIKE) & (share < UNLIKE)) < SELDOM and np.any(share):
            size = np.median(np.abs(share[share != 0]))
            results.append(_unlike_trim(name, trim[name], float(size if share.max() > 0 else -size), "of about"))
    for name in (one for one in measured if one in RATES[:3] and trim.get(one)):
        ratio = speed_over_trim(name, trim, controls, measured[name])
        if ratio is not None and not 1 / UNLIKE <= ratio <= UNLIKE:
            results.append(_unlike_trim(name, trim[name], ratio, "with the controls at trim about"))
    return results


def speed_over_trim(
    name: str,
    trim: Mapping[str, float],
    controls: Mapping[str, Float[np.ndarray, " n"]],
    measured: Float[np.ndarray, " n"],
) -> float | None:
    """Return the median of a velocity over its trim where all controls are at trim; None where too few samples are.

    Args:
        name: of the velocity, whose trim is not 0.
        trim: as `check_trim`.
        controls: likewise.
        measured: velocity, SI, NaN where not measured.
    """
    is_there = np.isfinite(measured)
    for one in (one for one in controls if trim.get(one)):
        is_there = is_there & (np.abs(controls[one] / trim[one] - 1) < AT)
    share = measured[is_there] / trim[name]
    return float(np.median(share)) if share.size >= AROUND else None


def _unlike_trim(name: str, trim: float, ratio: float, when: str) -> RecordFinding:
    factor, unit = shown_unit(name)
    value, limit = f"{when} {ratio * trim * factor:.4g} {unit}", f"vehicle.trim.{name} is {trim * factor:.4g} {unit}"
    if 1 / UNLIKE <= -ratio <= UNLIKE:
        remedy = f"the sign of {name} is reversed: set scale = -1 in the channel map, or correct the trim"
    else:
        remedy = _unit_guess((name,), ratio) + "check column, unit and sign in the channel map, or correct the trim"
    return RecordFinding(name, "trim", "caution", value, limit, remedy)


def check_turn(
    names: Sequence[str], measured: Float[np.ndarray, "n k"], expected: Float[np.ndarray, "n k"]
) -> list[RecordFinding]:
    """Say whether two or three channels of one sensor show the expected motion turned or mirrored (Kabsch, Acta Cryst. A32, 1976).

    Of the orthogonal Q with measured = Q expected, the best rotation and the best mirror are weighed by the share of both motions that
    they bring together, tr(Q^T C) / (|measured| |expected|), C = sum measured expected^T.

    Args:
        names: channels along the axes of the body, such as u, v and w.
        measured: SI, NaN where not measured.
        expected: of the vehicle at the prior means, SI.
    """
    there = np.isfinite(measured).all(1)
    size = np.linalg.norm(measured[there]) * np.linalg.norm(expected[there])
    if there.sum() < 25 or not size > 0:
        return []
    left, worth, right = np.linalg.svd(measured[there].T @ expected[there] / size)
    flip = np.ones(len(names))
    flip[-1] = -1.0
    ways = {(np.linalg.det(left * s @ right) < 0): (left * s @ right, float(worth @ s)) for s in (np.abs(flip), flip)}
    (turn, turned), (mirror, mirrored) = ways[False], ways[True]
    is_mirror = mirrored > turned + APART
    best, plain = max(turned, mirrored), float(np.trace(left * worth @ right))
    limit = f"as it is they agree by {plain:+.2f}; reported if other axes agree by {2 * APART:g} more"
    if best < RELATED or best < plain + 2 * APART:
        return (
            [RecordFinding(", ".join(names), "axes", "pass", "as the channel map says", limit)]
            if plain > RELATED
            else []
        )
    if is_mirror:
        value = f"mirrored: {_axes_words(names, mirror)} would agree by {mirrored:+.2f}"
        remedy = "the sensor's axes are left-handed, or one is reversed: correct columns and signs (scale = -1) in the channel map"
    else:
        value = f"turned: {_axes_words(names, turn)} would agree by {turned:+.2f}"
        remedy = f"swap columns in the channel map, or state how it is mounted, about {_mount_words(names, turn)} under [mounts.NAME]"
        if np.allclose(turn, np.diag([1.0 if name in "up" else -1.0 for name in names]), atol=0.3):
            remedy = f'the log has body axes forward, left, up: axes = "ENU" under [[import.files]]; or {remedy}'
    return [RecordFinding(", ".join(names), "axes", "fail", value, limit, remedy)]


def _axes_words(names: Sequence[str], way: Float[np.ndarray, "k k"]) -> str:
    """Say what each channel shows: `u = v, v = -u` for a quarter turn, `u = 0.87 u + 0.50 v, ...` for others."""
    said = []
    for name, row in zip(names, way, strict=True):
        large = [(x, other) for x, other in zip(row, names, strict=True) if abs(x) > 0.17]
        parts = [f"{x:+.2f} {other}" if abs(x) < 0.98 else f"{'-' if x < 0 else '+'}{other}" for x, other in large]
        said.append(f"{name} = {' '.join(parts).removeprefix('+')}")
    return ", ".join(said)


def _mount_words(names: Sequence[str], way: Float[np.ndarray, "k k"]) -> str:
    """Return the angles of a mount whose sensor shows R^T of what is there, for the channels along some of the axes."""
    places = ["uvw".find(name) if name in "uvw" else "pqr".find(name) for name in names]
    full = np.eye(3)
    full[np.ix_(places, places)] = way
    r = full.T
    angles = {
        "roll": np.arctan2(r[2, 1], r[2, 2]),
        "pitch": -np.arcsin(np.clip(r[2, 0], -1.0, 1.0)),
        "yaw": np.arctan2(r[1, 0], r[0, 0]),
    }
    told = [f'{name} = "{np.degrees(value):.0f} deg"' for name, value in angles.items() if abs(value) > np.radians(10)]
    return ", ".join(told)


def says_direction(expected: Float[np.ndarray, " n"], drawn: Float[np.ndarray, "d n"], noise: float) -> bool:
    """Return whether the priors say which way a channel goes: vehicles drawn from them nearly all go the way of the one at their means.

    Those that run away say nothing. Where none moves by more than the noise, the priors say that the channel stays still.

    Args:
        expected: of the vehicle at the prior means, SI, shape (n,).
        drawn: of d vehicles drawn from the priors, SI, not finite where they run away, shape (d, n).
        noise: standard deviation of the sensor, SI.
    """
    lost = ~np.isfinite(drawn).all(1)
    if not lost.any() and np.ptp(drawn, axis=1).max() <= noise:
        return True
    if lost.mean() > 1 - LEFT:
        return False
    return float(np.mean([_correlation(one, expected) > 0 for one in drawn[~lost]])) >= AGREED


def check_sum(
    name: str,
    step: float,
    measured: Float[np.ndarray, " n"],
    expected: Float[np.ndarray, " n"],
    drawn: Float[np.ndarray, "d n"],
    noise: float,
    has_delay: bool = False,
) -> list[RecordFinding] | None:
    """Judge a channel in which errors add up by all vehicles of the priors; None where these allow no verdict.

    They allow none where one of them goes as the record does, or where they lie as far apart as it moves. Of a record that goes much
    further than each of them, or much less far, the unit is doubted.

    Args:
        name: channel.
        step: of the record, s.
        measured: SI, NaN where not measured, shape (n,).
        expected: of the vehicle at the prior means, SI, shape (n,).
        drawn: of d vehicles drawn from the priors, SI, not finite where they run away, shape (d, n).
        noise: standard deviation of the sensor, SI.
        has_delay: whether the delay has a prior.
    """
    left, there = drawn[np.isfinite(drawn).all(1)], np.isfinite(measured)
    if not left.size or there.sum() < 2:
        return None
    sizes, size = np.hypot(np.std(left[:, there], axis=1), noise), float(np.std(measured[there]))
    if not sizes.min() / SIZE <= size <= sizes.max() * SIZE:
        ratio = size / float(np.median(sizes))
        remedy = _unit_guess((name,), ratio) + "check the units in the channel map, and the priors"
        value = f"{ratio:.3g} times the motion of most vehicles of the priors"
        return [RecordFinding(name, "size", "caution", value, f"within {SIZE:g} times that of one of them", remedy)]
    apart, most = float(np.median(np.std((left - expected)[:, there], axis=1))), round(LONGEST / step)
    if apart > ALIKE * size or any(best_lag(measured, one, most)[1] >= RELATED for one in left):
        return None
    return check_motion(name, step, measured, expected, drawn, has_delay)


def not_judged_sum(names: Sequence[str]) -> RecordFinding:
    """Return the note about channels in which errors add up, and which the priors allow."""
    value = "not judged, nor size and delay; errors of velocities, and the net weight, add up in it, and the priors allow it"
    return RecordFinding(
        ", ".join(names), "direction", "note", value, "judged where they do not; the velocities are judged"
    )


def not_judged(names: Sequence[str]) -> RecordFinding:
    """Return the note about channels of which the priors do not say which way they go."""
    value = "not judged, like size and delay: vehicles drawn from the priors go in both directions or diverge"
    remedy = "use priors of known sign, such as half-normal"
    return RecordFinding(
        ", ".join(names), "direction", "note", value, f"judged if {AGREED:.0%} go in one direction", remedy
    )


def _delay(name: str, late: float, shifted: float, direct: float, has_delay: bool) -> list[RecordFinding]:
    """Return a shift in time that explains most of what is not explained without it; a slower vehicle looks late too."""
    limit = f"reported from {LATE:g} s on, if a shift in time explains most of the difference"
    if abs(late) < LATE or shifted < TOLD or (1.0 - direct) < 2.0 * (1.0 - shifted):
        return []
    if late > 0 and has_delay:
        remedy = "the delay is estimated: check that its prior, [prior.delay], includes this value"
        return [RecordFinding(name, "delay", "note", f"about {late:.2g} s late", limit, remedy)]
    if late > 0:
        remedy = "give the delay a prior, [prior.delay], unless the vehicle is slower than the priors say"
        return [RecordFinding(name, "delay", "caution", f"about {late:.2g} s late", limit, remedy)]
    remedy = (
        "the response comes before its command: put command and response on one clock, unless the vehicle is quicker than "
        "the priors say"
    )
    return [RecordFinding(name, "delay", "caution", f"about {-late:.2g} s early", limit, remedy)]


def check_samples(name: str, values: Float[np.ndarray, " n"], noise: float, sensor: str) -> list[RecordFinding]:
    """Return the samples that stand out from both of their sides, alone or up to three together.

    Args:
        name: channel.
        values: SI, NaN where not measured.
        noise: standard deviation of the sensor, SI; neighbours of a steep but quiet signal differ by less.
        sensor: whose channel it is, as the campaign names it.
    """
    x = values[np.isfinite(values)]
    if x.size < 25:
        return []
    share = float((_standing_out(x) > SPIKE * np.maximum(_scatter(x), noise)).mean())
    limit = f"usual: under {SPIKES:.1%} beyond {SPIKE:g} robust standard deviations"
    if share < SPIKES:
        return [RecordFinding(name, "outliers", "pass", f"{share:.2%} of the samples", limit)]
    remedy = f'residuals = "heavy" under [sensors.{sensor}] tolerates them; look at the raw plot first'
    return [RecordFinding(name, "outliers", "caution", f"{share:.2%} of the samples", limit, remedy)]


def _standing_out(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return how far each sample lies beyond both sides, and beyond where the straight lines of both sides lead.

    A slope or a step leads away on one side only, and a turn no further than its neighbours bend. For each way to count up to two
    neighbours to the same spike, the sides are the two samples before it and the two after.
    """
    reach = TOGETHER + 1
    padded, here, result = np.pad(x, reach, mode="edge"), np.arange(x.size) + reach, np.zeros(x.size)
    for before, after in ((i, j) for i in range(1, reach) for j in range(1, reach + 1 - i)):
        sides = [(padded[here - before], padded[here - before - 1], before)]
        sides += [(padded[here + after], padded[here + after + 1], after)]
        beyond = np.stack([x - led for near, far, steps in sides for led in (near, near + steps * (near - far))])
        result = np.maximum(result, np.maximum(beyond.min(0), -beyond.max(0)))
    return result


def _scatter(x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the standard deviation of white noise that bends as the samples around each do: by a quartile, which spikes leave alone."""
    bend = np.abs(np.diff(x, 2)) / np.sqrt(6.0)
    around = min(AROUND, bend.size // 2)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(bend, around + 1, mode="reflect"), 2 * around + 1)
    return np.quantile(near, 0.25, axis=1)[: x.size] / QUARTILE


def check_excitation(
    names: Sequence[str], before: Float[np.ndarray, " k"], after: Float[np.ndarray, " k"], about: str = ""
) -> list[RecordFinding]:
    """Return what the record's input can tell of each coefficient at most, as the share of the prior's deviation that is left.

    Args:
        names: coefficients.
        before: standard deviations of the priors, SI.
        after: of what would be left, SI.
        about: where that was linearised, in words; empty for the prior means.
    """
    results = []
    check = f"excitation ({about})" if about else "excitation"
    for name, prior, left in zip(names, before, after, strict=True):
        share = float(left / prior)
        value, limit = f"{share:.0%} of the prior's sd would be left", "below 70 % it is excited"
        if share < 0.7:
            results.append(RecordFinding(name, check, "pass", value, limit))
        else:
            remedy = "this record cannot determine it: excite it more, fix it, or design a trial (`seatrial design`)"
            results.append(RecordFinding(name, check, "caution", value, limit, remedy))
    return results


def check_signs(
    names: Sequence[str], columns: Mapping[str, Float[np.ndarray, " n"]], noise: Mapping[str, float]
) -> list[RecordFinding]:
    """Return a caution for every two terms that are one in a record, because no signal that tells them apart changes its sign.

    Args:
        names: coefficients.
        columns: signals of the record by name, SI; of what is in none, nothing is said.
        noise: standard deviation of one sample of those that are measured, SI.
    """
    results = []
    for first, second in combinations(map(CoefficientName.parse, names), 2):
        signals = first.parted_by_sign(second)
        if signals and all(name in columns and _keeps_sign(columns[name], noise.get(name, 0.0)) for name in signals):
            value = f"one and the same in this record, in which {' and '.join(signals)} never changes its sign"
            remedy = "leave one of them out, or run a trial in which it does"
            pair = f"{first.text}, {second.text}"
            results.append(RecordFinding(pair, "told apart", "caution", value, "only that tells them apart", remedy))
    return results


def _keeps_sign(column: Float[np.ndarray, " n"], noise: float) -> bool:
    """Whether a signal stays on one side of zero, as far as its noise shows."""
    known = column[np.isfinite(column)]
    return bool((known > -SIGN * noise).all() or (known < SIGN * noise).all())


def best_lag(measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], most: int) -> tuple[int, float]:
    """Return the steps by which the measured is behind the expected, and the correlation there, that of largest size; 0 on a tie."""
    n = measured.size
    most = min(most, n // 4)
    results = {
        lag: _correlation(measured[max(lag, 0) : n + min(lag, 0)], expected[max(-lag, 0) : n - max(lag, 0)])
        for lag in range(-most, most + 1)
    }
    lag = max(results, key=lambda key: (abs(results[key]), -abs(key)))
    return lag, results[lag]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    there = np.isfinite(a) & np.isfinite(b)
    if there.sum() < 10 or np.ptp(a[there]) == 0 or np.ptp(b[there]) == 0:
        return 0.0
    return float(np.corrcoef(a[there], b[there])[0, 1])


def _unit_guess(names: Sequence[str], ratio: float, unlike: float = 1.0) -> str:
    """Ask of each signal for the unit error whose factor is nearest to a ratio; empty if none is near.

    Args:
        names: of the signals.
        ratio: of what is there to what is expected.
        unlike: times by which the vehicle itself may differ from the one that is expected: of speeds, whose units are hardly farther
            apart, every error is asked for whose factor is so near.
    """
    size = max(abs(ratio), 1 / max(abs(ratio), 1e-300))
    near: dict[str, list[str]] = {}
    for name in names:
        factors = CONFUSED.get(signal_unit(name), {})
        far = {words: abs(np.log(size / factor)) for words, factor in factors.items()}
        first, *others = sorted(far, key=lambda one: far[one]) or [""]
        if not first or far[first] >= np.log(1.6):
            continue
        also = [words for words in others if factors is _LENGTHS and far[words] < np.log(unlike)]
        for words in (first, *also):
            near.setdefault(words, []).append(name)
    said = [words + (f", in {' or '.join(some)}" if len(names) > 1 else "") for words, some in near.items()]
    return f"{'; or '.join(said)}? " if said else ""
