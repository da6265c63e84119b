"""Does a record move as its channel map says? Its motion beside that of the vehicle as it is believed to be.

A vehicle simulated from the record's own commands is no prediction yet, but it goes the same way, about as far and about as soon.
A channel that goes the other way has its sign wrong; one that goes 57.3 times as far is in degrees; one that begins before its command
has another clock.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from seatrial.core.findings import Finding, Level
from seatrial.core.signals import ANGLES, POSITIONS
from seatrial.estimation.diagnostics.record_checks import SPIKE, unit_errors
from seatrial.estimation.diagnostics.timing_check import Timing, find_timing

# Correlation with the expected motion below which a channel goes the other way, and from which size and delay can be
# told.
OPPOSED, RELATED = -0.4, 0.5
# Ratio to the expected motion, or its inverse, from which a unit is doubted, and from which it is wrong.
SIZE, WRONG = 3.0, 30.0
# Share of the vehicles drawn from the priors that may move less, or further, than a record whose units are not
# doubted.
RARE = 0.1
SUMMED = (*POSITIONS, *ANGLES)  # Channels in which the errors of velocities, and the net weight, add up over time
ALIKE = 0.5  # Share of the measured motion by which vehicles of the priors may lie apart for them to say how it goes
CUT = 0.02  # Share of the samples that may lie at the very end of a gauge's range while the expected force goes on
OTHER = 2.0  # Times by which the motion of a vehicle may differ from that of the one at the prior means
# Share of the motion by which a mirror has to explain more than a turn; either has to explain twice as much more than
# neither.
APART = 0.1
# Share of the vehicles drawn from the priors that must go one way for the priors to say which, of those that do not
# run away, and share that must be left of them.
AGREED, LEFT = 0.75, 0.25
LATE, LONGEST = 0.1, 2.0  # Seconds from which a shift in time is told, and up to which one is sought within a file
WIDE = 60.0  # Seconds up to which a shift is sought between files, whose clocks may differ
VAGUE = 5.0  # Seconds by which the clocks may differ unseen for the timing to be judged
WITHIN = (0.5, 1.0, 2.0, VAGUE)  # Seconds to which a timing that passes is told, so that channels share a line


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
) -> list[Finding]:
    """Direction, size and timing of a measured channel beside the expected one, NaN if not measured.

    Args:
        name: channel.
        time: of the record, s, shape (n,).
        measured: SI, shape (n,).
        expected: of the vehicle at the prior means, SI, shape (n,).
        drawn: of vehicles drawn from the priors, SI, not finite where they run away, shape (d, n): a slower one may explain a delay.
        has_delay: whether the delay has a prior.
        controls: that make the motion, whose units may be wrong as well.
        by_trim: whether the measured channel contradicts its trim too: of two guesses of one unit only the better is made.
        file: of the channel, where the controls are in another, whose clock may differ; empty if they are in the same.
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
    values = {"correlation": correlation}
    if correlation <= OPPOSED:
        remedies = ("reverse-sign",)
        if timing is not None and timing.likely and not timing.is_in_time:
            values, remedies = {**values, "late": shift}, ("reverse-sign", "shift-clock")
        return [Finding("direction-reversed", "alarm", (name,), {**values, "mirrored": tuple(mirrored)}, remedies)]
    if correlation < RELATED:
        return [Finding("motion-unrelated", "caution", (name,), values, ("check-map-and-clocks",)), *timings]
    there = np.isfinite(measured)
    ratio = float(np.std(measured[there]) / max(np.std(expected[there]), 1e-300))
    least, greatest = np.quantile(np.std(vehicles[:, there], axis=1), (RARE, 1 - RARE)) / np.std(expected[there])
    level = "pass" if least <= ratio <= greatest else _size_level(ratio, 1.0, 1.0)
    return [
        Finding("direction-reversed", "pass", (name,), values),
        _size(name, level, ratio, (name, *controls), by_trim, OTHER),
        *timings,
    ]


def _size(
    name: str, level: Level, ratio: float, signals: Sequence[str], by_trim: bool = False, unlike: float = 1.0
) -> Finding:
    """Return what the size of a motion says of the units of some signals."""
    remedies = () if level == "pass" else ("see-trim",) if by_trim else ("check-unit",)
    return Finding("size-unlike", level, (name,), {"ratio": ratio, **unit_errors(signals, ratio, unlike)}, remedies)


def _size_level(size: float, least: float, greatest: float) -> Level:
    """Return how grave it is that a motion is larger or smaller than the vehicles of the priors show."""
    beyond = max(size / greatest, least / max(size, 1e-300))
    return "pass" if beyond <= SIZE else "caution" if beyond <= WRONG else "alarm"


def check_range(
    name: str, measured: Float[np.ndarray, " n"], expected: Float[np.ndarray, " n"], noise: float
) -> list[Finding]:
    """Return an end of a gauge's range at which many samples lie exactly, while the expected force goes on: it is at its limit.

    Args:
        name: channel.
        measured: SI, NaN if not measured.
        expected: of the vehicle at the prior means, SI.
        noise: standard deviation of the gauge, SI.
    """
    there = np.isfinite(measured)
    x, y = measured[there], expected[there]
    for end, word in ((x.min(initial=np.inf), "least"), (x.max(initial=-np.inf), "greatest")):
        at = x == end
        if at.sum() > CUT * x.size and np.ptp(y[at]) > max(SPIKE * noise, CUT * np.ptp(y)):
            values = {"share": float(at.mean()), "end": float(end), "which": word}
            return [Finding("gauge-at-limit", "alarm", (name,), values, ("leave-out",))]
    return []


def check_turn(
    names: Sequence[str], measured: Float[np.ndarray, "n k"], expected: Float[np.ndarray, "n k"]
) -> list[Finding]:
    """Report whether two or three channels of one sensor show the expected motion turned or mirrored (Kabsch, Acta Cryst. A32, 1976).

    Of the orthogonal Q with measured = Q expected, the best rotation and the best mirror are weighed by the share of both motions that
    they bring together, tr(Q^T C) / (|measured| |expected|), C = sum measured expected^T.

    Args:
        names: channels along the axes of the body, such as u, v and w.
        measured: SI, NaN if not measured.
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
    if best < RELATED or best < plain + 2 * APART:
        return [Finding("axes-wrong", "pass", tuple(names), {"plain": plain})] if plain > RELATED else []
    way = mirror if is_mirror else turn
    values = {
        "matrix": tuple(tuple(map(float, row)) for row in way),
        "mirrored": bool(is_mirror),
        "best": best,
        "plain": plain,
        "angles": () if is_mirror else _mount_angles(names, way),
    }
    is_enu = np.allclose(turn, np.diag([1.0 if name in "up" else -1.0 for name in names]), atol=0.3)
    remedies = ("left-handed",) if is_mirror else ("enu-axes", "mount-or-columns") if is_enu else ("mount-or-columns",)
    return [Finding("axes-wrong", "alarm", tuple(names), values, remedies)]


def _mount_angles(names: Sequence[str], way: Float[np.ndarray, "k k"]) -> tuple[tuple[str, float], ...]:
    """Return the angles, deg, of a mount whose sensor shows R^T of what is there, for the channels along some of the axes."""
    places = ["uvw".find(name) if name in "uvw" else "pqr".find(name) for name in names]
    full = np.eye(3)
    full[np.ix_(places, places)] = way
    r = full.T
    angles = {
        "roll": np.arctan2(r[2, 1], r[2, 2]),
        "pitch": -np.arcsin(np.clip(r[2, 0], -1.0, 1.0)),
        "yaw": np.arctan2(r[1, 0], r[0, 0]),
    }
    return tuple((name, float(np.degrees(value))) for name, value in angles.items() if abs(value) > np.radians(10))


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
) -> list[Finding] | None:
    """Judge a channel in which errors add up by all vehicles of the priors; None if these allow no verdict.

    They allow none if one of them goes as the record does, or where they lie as far apart as it moves. Of a record that goes much
    further than each of them, or much less far, the unit is doubted.

    Args:
        name: channel.
        time: of the record, s, shape (n,).
        measured: SI, NaN if not measured, shape (n,).
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
        return [_size(name, level, ratio, (name,))]
    apart = float(np.median(np.std((left - expected)[:, there], axis=1)))
    most = round(LONGEST / float(np.median(np.diff(time))))
    if apart > ALIKE * size or any(best_lag(measured, one, most)[1] >= RELATED for one in left):
        return None
    return check_motion(name, time, measured, expected, drawn, has_delay)


def _timing_findings(name: str, timing: Timing | None, has_delay: bool, file: str) -> list[Finding]:
    """Report by how much a channel is early or late; of files with separate clocks also that it is not, or that it cannot be judged."""
    is_sharp = timing is not None and all(one.greatest - one.least <= VAGUE for one in timing.likely)
    if timing is not None and timing.likely and not timing.is_in_time and is_sharp:
        best, *others = timing.likely
        late = best.best
        if abs(late) < LATE:
            return []
        values = {
            "late": late,
            "error": max((best.greatest - best.least) / 2, LATE),
            "others": tuple(one.best for one in others),
            "file": file,
            "upper": max(0.5, 2 * late),
        }
        level = "note" if 0 < late <= LONGEST and has_delay else "caution"
        if file and not 0 < late <= LONGEST:
            remedies = ("correct-shift",)
        elif late < 0:
            remedies = ("one-clock",)
        else:
            remedies = ("check-delay-prior" if has_delay else "delay-prior", *(("check-shift",) if file else ()))
        return [Finding("clock-shift", level, (name,), values, remedies)]
    if not file:
        return []
    if timing is not None and timing.is_in_time and len(timing.likely) == 1 and timing.within <= VAGUE:
        within = next(seconds for seconds in WITHIN if timing.within <= seconds)
        return [Finding("clock-shift", "pass", (name,), {"within": within, "file": file})]
    ranges = () if timing is None else tuple((one.least, one.greatest) for one in timing.likely)
    values = {"longest": WIDE, "ranges": ranges, "file": file}
    return [Finding("clock-not-judged", "note", (name,), values, ("compare-clocks",))]


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
