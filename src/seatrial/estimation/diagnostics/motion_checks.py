"""Does a record move as its channel map says? Its motion beside that of the vehicle as it is believed to be.

A vehicle simulated from the record's own commands is no prediction yet, but it goes the same way, about as far and about as soon.
A channel that goes the other way has its sign wrong; one that goes 57.3 times as far is in degrees; one that begins before its command
has another clock.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.core.signals import ANGLES, POSITIONS
from seatrial.estimation.diagnostics.record_checks import SPIKE, RecordFinding, RecordLevel, unit_guess
from seatrial.estimation.diagnostics.timing_check import Timing, find_timing
from seatrial.estimation.prediction.remedies import delay_prior, listed

OPPOSED, RELATED = -0.4, 0.5
"""Correlation with the expected motion below which a channel goes the other way, and from which size and delay can be told."""
SIZE, WRONG = 3.0, 30.0
"""Ratio to the expected motion, or its inverse, from which a unit is doubted, and from which it is wrong."""
RARE = 0.1
"""Share of the vehicles drawn from the priors that may move less, or further, than a record whose units are not doubted."""
SUMMED = (*POSITIONS, *ANGLES)
"""Channels in which the errors of velocities, and the net weight, add up over time."""
ALIKE = 0.5
"""Share of the measured motion by which vehicles of the priors may lie apart for them to say how it goes."""
CUT = 0.02
"""Share of the samples that may lie at the very end of a gauge's range while the expected force goes on."""
OTHER = 2.0
"""Times by which the motion of a vehicle may differ from that of the one at the prior means."""
APART = 0.1
"""Share of the motion by which a mirror has to explain more than a turn; either has to explain twice as much more than neither."""
AGREED, LEFT = 0.75, 0.25
"""Share of the vehicles drawn from the priors that must go one way for the priors to say which, of those that do not run away, and
share that must be left of them."""
LATE, LONGEST = 0.1, 2.0
"""Seconds from which a shift in time is told, and up to which one is sought within a file."""
WIDE = 60.0
"""Seconds up to which a shift is sought between files, whose clocks may differ."""
VAGUE = 5.0
"""Seconds by which the clocks may differ unseen for the timing to be judged."""
WITHIN = (0.5, 1.0, 2.0, VAGUE)
"""Seconds to which a timing that passes is told, so that channels share a line."""


def check_motion(
    name: str,
    time: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, " n"],
    expected: Float[np.ndarray, " n"],
    drawn: Float[np.ndarray, "d n"],
    has_delay: bool = False,
    controls: Sequence[str] = (),
    by_trim: bool = False,
    file: str = "",
    mirrored: Sequence[str] = (),
) -> list[RecordFinding]:
    """Direction, size and timing of a measured channel beside the expected one, NaN where not measured.

    Args:
        name: channel.
        time: of the record, s, shape (n,).
        measured: SI, shape (n,).
        expected: of the vehicle at the prior means, SI, shape (n,).
        drawn: of vehicles drawn from the priors, SI, not finite where they run away, shape (d, n): a slower one may explain a delay.
        has_delay: whether the delay has a prior.
        controls: that make the motion, whose units may be wrong as well.
        by_trim: whether the measured channel contradicts its trim too: of two guesses of one unit only the better is made.
        file: of the channel, where the controls are in another, whose clock may differ; empty where they are in the same.
        mirrored: thrusters of which some drive the channel forwards and some backwards, so that it goes the other way if they are swapped.
    """
    step = float(np.median(np.diff(time)))
    correlation = best_lag(measured, expected, round(LONGEST / step))[1]
    vehicles = np.vstack([expected[None], drawn[np.isfinite(drawn).all(1)]])
    timing = find_timing(time, measured, vehicles, WIDE if file else LONGEST)
    timings = _timing_findings(name, timing, has_delay, file)
    shift = timing.likely[0].best if timing is not None and timing.likely else 0.0
    if timing is not None and not timing.is_in_time and not timing.is_reversed and abs(shift) > LONGEST:
        correlation = _correlation(measured, np.interp(time - shift, time, expected, left=np.nan, right=np.nan))
    against = f"below {OPPOSED:g} it goes the other way"
    if correlation <= OPPOSED:
        swapped = f"the order of the thruster columns {listed(mirrored)} is wrong (port and starboard swapped); or "
        remedy = (
            f"{swapped if mirrored else ''}the sign of {name} or of its command is reversed: set scale = -1 in the channel map, "
            "or check the axes (east-north-up or north-east-down)"
        )
        if timing is not None and timing.likely and not timing.is_in_time:
            remedy += (
                f"; or the clocks of the files differ: the motion repeats, and {_late(shift)} would explain it as well"
            )
        value = f"correlation {correlation:+.2f} with the motion expected"
        return [RecordFinding(name, "direction", "fail", value, against, remedy)]
    if correlation < RELATED:
        remedy = "the motion hardly follows the commands: check the channel map, the clocks and the priors"
        usual = f"{RELATED:g} or more is usual"
        return [RecordFinding(name, "direction", "caution", f"correlation {correlation:+.2f}", usual, remedy), *timings]
    results = [
        RecordFinding(name, "direction", "pass", f"correlation {correlation:+.2f} with the motion expected", against)
    ]
    there = np.isfinite(measured)
    ratio = float(np.std(measured[there]) / max(np.std(expected[there]), 1e-300))
    limits = f"between 1/{SIZE:g} and {SIZE:g}, or as vehicles of the priors"
    least, greatest = np.quantile(np.std(vehicles[:, there], axis=1), (RARE, 1 - RARE)) / np.std(expected[there])
    level = "pass" if least <= ratio <= greatest else _size_level(ratio, 1.0, 1.0)
    value, told = f"{ratio:.3g} times the motion expected", (name, *controls)
    remedy = f"{unit_guess(told, ratio, OTHER)}check the units of {listed(told)} in the channel map, and the priors"
    remedy = "" if level == "pass" else "see its trim, which tells the unit better" if by_trim else remedy
    results.append(RecordFinding(name, "size", level, value, limits, remedy))
    return [*results, *timings]


def _size_level(size: float, least: float, greatest: float) -> RecordLevel:
    """Return how grave it is that a motion is larger or smaller than the vehicles of the priors show."""
    beyond = max(size / greatest, least / max(size, 1e-300))
    return "pass" if beyond <= SIZE else "caution" if beyond <= WRONG else "fail"


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
    time: Float[np.ndarray, " n"],
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
        time: of the record, s, shape (n,).
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
    level = _size_level(size, float(sizes.min()), float(sizes.max()))
    if level != "pass":
        ratio = size / float(np.median(sizes))
        remedy = unit_guess((name,), ratio) + "check the units in the channel map, and the priors"
        value = f"{ratio:.3g} times the motion of most vehicles of the priors"
        return [RecordFinding(name, "size", level, value, f"within {SIZE:g} times that of one of them", remedy)]
    apart = float(np.median(np.std((left - expected)[:, there], axis=1)))
    most = round(LONGEST / float(np.median(np.diff(time))))
    if apart > ALIKE * size or any(best_lag(measured, one, most)[1] >= RELATED for one in left):
        return None
    return check_motion(name, time, measured, expected, drawn, has_delay)


def not_judged_sum(names: Sequence[str]) -> RecordFinding:
    """Return the note about channels in which errors add up, and which the priors allow."""
    value = "not judged, nor size and timing; errors of velocities, and the net weight, add up in it, and the priors allow it"
    return RecordFinding(
        ", ".join(names), "direction", "note", value, "judged where they do not; the velocities are judged"
    )


def not_judged(names: Sequence[str]) -> RecordFinding:
    """Return the note about channels of which the priors do not say which way they go."""
    value = "not judged, like size and timing: vehicles drawn from the priors go in both directions or diverge"
    remedy = "use priors of known sign, such as half-normal"
    return RecordFinding(
        ", ".join(names), "direction", "note", value, f"judged if {AGREED:.0%} go in one direction", remedy
    )


def _timing_findings(name: str, timing: Timing | None, has_delay: bool, file: str) -> list[RecordFinding]:
    """Say by how much a channel is early or late; of files with clocks of their own also that it is not, or that it cannot be judged."""
    limit = "no vehicle of the priors explains it without a shift"
    is_sharp = timing is not None and all(one.greatest - one.least <= VAGUE for one in timing.likely)
    if timing is not None and timing.likely and not timing.is_in_time and is_sharp:
        best, *others = timing.likely
        late = best.best
        if abs(late) < LATE:
            return []
        value = f"about {_late(late)}, ± {max((best.greatest - best.least) / 2, LATE):.1g} s"
        value += "".join(f"; or about {_late(one.best)}" for one in others)
        level = "note" if 0 < late <= LONGEST and has_delay else "caution"
        remedy = _timing_remedy(late, has_delay, file)
        remedy = (
            f"the motion repeats and fits with each of these shifts; if it is the first, {remedy}" if others else remedy
        )
        return [RecordFinding(name, "timing", level, value, limit, remedy)]
    if not file:
        return []
    if timing is not None and timing.is_in_time and len(timing.likely) == 1 and timing.within <= VAGUE:
        value = f"in time with its commands, or off by at most {timing.within:.2g} s"
        within = next(seconds for seconds in WITHIN if timing.within <= seconds)
        return [RecordFinding(name, f"timing (within {within:g} s)", "pass", value, limit)]
    if timing is None or not timing.likely:
        value = f"not judged: no shift up to {WIDE:g} s, or half the record, explains half of the motion"
    else:
        ends = [f"{_late(one.least)} to {_late(one.greatest)}" for one in timing.likely]
        value = f"not judged: the motion fits with every shift from {', and from '.join(ends)}"
    limit = f"judged if shifts of more than {VAGUE:g} s can be excluded"
    remedy = f"compare the clock of {file} with that of the commands in another way, before you believe a result"
    return [RecordFinding(name, "timing", "note", value, limit, remedy)]


def _timing_remedy(late: float, has_delay: bool, file: str) -> str:
    """Return what to do about a channel that is late by so many seconds, or early by as many below zero."""
    if file and not 0 < late <= LONGEST:
        wrong = "large" if late > 0 else "small"
        return f"`shift` of {file} under [[import.files]] is too {wrong} by about {abs(late):.2g} s: correct it, and check again"
    if late < 0:
        return (
            "the response comes before its command: put command and response on one clock, unless the vehicle is quicker than "
            "the priors say"
        )
    clock = f", or `shift` of {file} is too large" if file else ""
    if has_delay:
        return f"the delay is estimated: check that its prior, [prior.delay], includes this value{clock}"
    return f"give the delay a prior, [prior.delay] with {delay_prior(late)}, unless the vehicle is slower than the priors say{clock}"


def _late(seconds: float) -> str:
    return f"{abs(seconds):.2g} s {'late' if seconds > 0 else 'early'}"


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
