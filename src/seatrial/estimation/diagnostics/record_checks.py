"""Does a record say what its channel map says? Its samples alone, and beside limits and trim that the campaign states."""

from collections.abc import Mapping, Sequence
from math import pi, radians

import numpy as np
from jaxtyping import Float

from seatrial.core.findings import Finding, Value
from seatrial.core.signals import ANGLE, ANGULAR_RATE, FORCE, MOMENT, RATES, SPEED, signal_unit
from seatrial.manoeuvres.manoeuvre import Limits

_LENGTHS = {"knots": 1.94384, "feet": 3.28084, "km/h": 3.6, "centimetres": 100.0, "millimetres": 1000.0}
_ANGLES = {"degrees": 180 / pi, "revolutions": 2 * pi}
_RPM = {"rpm": 30 / pi}
_PROPELLER = {**_RPM, "revolutions": 2 * pi, "rpm for rev/s": 60.0}
_FORCES = {"kgf": 9.80665, "lbf": 4.44822}
# Factors of unit errors by name or SI unit of a signal; nobody counts a propeller in degrees.
_CONFUSED = {
    str(SPEED): _LENGTHS,
    str(ANGULAR_RATE): _PROPELLER,
    str(ANGLE): _ANGLES,
    str(FORCE): _FORCES,
    str(MOMENT): _FORCES,
    **{rate: {**_ANGLES, **_RPM} for rate in RATES[3:]},
}
# Times by which the factor of a unit error may be off a ratio for the error to be named; the second if none is so
# close as the first.
CLOSE, ABOUT = 1.6, 3.0
# Ratio to the stated trim, or its inverse, from which a record contradicts it; share by which a control may be off its
# trim there, and within which a straight line through samples on both sides of trim tells the speed at trim.
UNLIKE, AT, NEAR = 1.5, 0.1, 0.5
# Share by which the distance from trim shrinks, from the first half of such samples to the second, while the vehicle
# is on its way.
SETTLED = 0.05
SELDOM = 0.01  # Share of the samples in which a control must come near its trim
BEYOND = 0.01  # Share of how far a control moves by which it may lie beyond a limit without being told
HARDLY = 1 / 30  # Share of its limits within which a control stays whose unit is doubted
SPIKE = 8.0  # Robust standard deviations beyond its neighbours from which a sample stands out
SPIKES = 0.002  # Share of samples that stand out from which it is told
TOGETHER = 3  # Neighbouring samples that may be one spike
AROUND = 25  # Samples on either side that tell how much a signal scatters where it is
QUARTILE = 0.3186  # A quarter of a standard normal variable's sizes are below
# Angle from which a turned sensor is reported, and standard deviations from which it is a caution and an alarm.
MIN_TURN, MIN_TURN_SDS, ALARM_TURN_SDS = radians(5.0), 3.0, 5.0
# Standard deviation of a thruster's gain above which it is unknown, and how far from 1 it is doubted.
MAX_GAIN_SD, MIN_GAIN_ERROR = 0.3, 0.5
# Root mean square change of a rate in steps half as long, over its noise, from which steps are too long.
MAX_STEP_CHANGE = 0.5


def not_judged_yet(subject: Sequence[str], check: str, wrong: Sequence[Finding]) -> Finding:
    """Return the note that something else is to be corrected before this can be judged.

    Args:
        subject: signals that are not judged.
        check: code of the check that is not made.
        wrong: what is to be corrected first.
    """
    faults = tuple((one.code, name) for one in wrong for name in one.subject)
    return Finding("not-judged-yet", "note", tuple(subject), {"check": check, "wrong": faults}, ("check-again",))


def unit_errors(names: Sequence[str], ratio: float, unlike: float = 1.0) -> dict[str, Value]:
    """Return the signals whose units are doubted, and the unit errors whose factor is nearest to a ratio.

    Args:
        names: of the signals.
        ratio: of what is there to what is expected.
        unlike: times by which the vehicle itself may differ from the one that is expected: of speeds, whose units are hardly farther
            apart, every error is named whose factor is so near.

    Returns:
        `signals` and `errors`, values of a finding; no errors if none is within three times of the ratio.
    """
    size = max(abs(ratio), 1 / max(abs(ratio), 1e-300))
    factors = {name: _CONFUSED.get(name, _CONFUSED.get(signal_unit(name), {})) for name in names}
    off = {
        name: {error: max(size / x, x / size) for error, x in some.items()} for name, some in factors.items() if some
    }
    reach = CLOSE if any(min(some.values()) < CLOSE for some in off.values()) else ABOUT
    near: dict[str, list[str]] = {}
    for name, some in off.items():
        first, *others = sorted(some, key=lambda error: some[error])
        if some[first] < reach:
            also = [error for error in others if factors[name] is _LENGTHS and some[error] < unlike]
            for error in (first, *also):
                near.setdefault(error, []).append(name)
    return {"signals": tuple(names), "errors": tuple((error, tuple(some)) for error, some in near.items())}


def check_limits(name: str, column: Float[np.ndarray, " n"], limits: Limits) -> list[Finding]:
    """Return the bound of a control that a record goes beyond, by more than a hundredth of how far it moves; rest is only noted.

    Args:
        name: control.
        column: SI.
        limits: that designs of this control keep, SI.
    """
    least, greatest = float(column.min()), float(column.max())
    slack, results = BEYOND * (greatest - least) + 1e-9 * max(abs(least), abs(greatest)), []
    for key, bound, end, is_beyond, is_rest in (
        ("lower", limits.lower, least, limits.lower is not None and least < limits.lower - slack, least >= -slack),
        (
            "upper",
            limits.upper,
            greatest,
            limits.upper is not None and greatest > limits.upper + slack,
            greatest <= slack,
        ),
    ):
        if bound is not None and is_beyond:
            values = {"reached": end, "bound": bound, "end": key}
            level, remedies = ("note", ()) if is_rest else ("caution", ("correct-limits",))
            results.append(Finding("limits-exceeded", level, (name,), values, remedies))
    farthest = max((abs(bound) for bound in (limits.lower, limits.upper) if bound is not None), default=0.0)
    reached = max(abs(least), abs(greatest))
    if 0 < reached < HARDLY * farthest:
        values = {"reached": reached, "bound": farthest, **unit_errors((name,), reached / farthest)}
        results.append(Finding("limits-hardly-used", "caution", (name,), values, ("check-unit",)))
    return results


def check_angle(name: str, column: Float[np.ndarray, " n"]) -> list[Finding]:
    """Return the doubt of a rudder or fin that turns by more than a quarter turn: its degrees are read as radians.

    Args:
        name: control.
        column: SI.
    """
    reached = float(np.abs(column).max())
    if signal_unit(name) != str(ANGLE) or reached <= pi / 2:
        return []
    values = {"reached": reached, "signals": (name,), "errors": (("degrees", (name,)),)}
    return [Finding("angle-too-large", "caution", (name,), values, ("check-unit",))]


def check_trim(
    trim: Mapping[str, float],
    controls: Mapping[str, Float[np.ndarray, " n"]],
    measured: Mapping[str, Float[np.ndarray, " n"]],
) -> list[Finding]:
    """Return what contradicts the trim: a control that never comes near its value, a speed of another size where all controls do.

    Args:
        trim: of controls and velocities that belong together, SI.
        controls: of the record by name, SI.
        measured: velocities of the record by name, SI, NaN if not measured.
    """
    results = []
    for name in (one for one in controls if trim.get(one)):
        share = controls[name] / trim[name]
        if np.mean((share > 1 / UNLIKE) & (share < UNLIKE)) < SELDOM and np.any(share):
            size = np.median(np.abs(share[share != 0]))
            results.append(unlike_trim(name, trim[name], float(size if share.max() > 0 else -size), "median"))
    for name in (one for one in measured if one in RATES[:3] and trim.get(one)):
        ratio = _speed_over_trim(name, trim, controls, measured[name])
        if ratio is not None and not 1 / UNLIKE <= ratio <= UNLIKE:
            results.append(unlike_trim(name, trim[name], ratio, "controls"))
    return results


def _speed_over_trim(
    name: str,
    trim: Mapping[str, float],
    controls: Mapping[str, Float[np.ndarray, " n"]],
    measured: Float[np.ndarray, " n"],
) -> float | None:
    """Return a velocity over its trim when all controls are at trim; None if too few samples tell it.

    A trial often changes a control to both sides of its trim and is never at it: the velocity is taken as a straight line in the controls.
    Nothing is said of a vehicle that is still on its way to trim, as from rest.

    Args:
        name: of the velocity, whose trim is not 0.
        trim: as `check_trim`.
        controls: likewise.
        measured: velocity, SI, NaN if not measured.
    """
    driving = [one for one in controls if trim.get(one)]
    off = np.array([controls[one] / trim[one] - 1 for one in driving]).reshape(len(driving), measured.size)
    is_there = np.isfinite(measured) & (np.abs(off) < NEAR).all(axis=0)
    off, share = off[:, is_there], measured[is_there] / trim[name]
    if share.size < AROUND or not ((off.min(axis=1) < AT) & (off.max(axis=1) > -AT)).all():
        return None
    line = np.linalg.lstsq(np.vstack([np.ones(share.size), off]).T, share, rcond=None)[0]
    at_trim = share - line[1:] @ off
    first, second = (abs(float(np.median(half)) - 1) for half in np.array_split(at_trim, 2))
    is_unlike = not 1 / UNLIKE <= (ratio := float(np.median(at_trim))) <= UNLIKE
    return None if is_unlike and second < (1 - SETTLED) * first else ratio


def unlike_trim(name: str, trim: float, ratio: float, by: str) -> Finding:
    """Return a caution for a signal that is not at its trim where it should be.

    Args:
        name: of the signal.
        trim: its value, SI.
        ratio: of what it is to that.
        by: where it was seen: `median` of a control, a speed with the `controls` at trim, or by the `coefficients`.
    """
    is_reversed = 1 / UNLIKE <= -ratio <= UNLIKE
    values = {"size": ratio * trim, "trim": trim, "by": by, **unit_errors((name,), ratio, UNLIKE)}
    remedy = "reverse-or-trim" if is_reversed else "check-unit-or-trim"
    return Finding("trim-contradicted", "caution", (name,), values, (remedy,))


def check_samples(
    name: str, values: Float[np.ndarray, " n"], noise: float, sensor: str, is_heavy: bool = False
) -> list[Finding]:
    """Return the samples that stand out from both of their sides, alone or up to three together.

    Args:
        name: channel.
        values: SI, NaN if not measured.
        noise: standard deviation of the sensor, SI; neighbours of a steep but quiet signal differ by less.
        sensor: whose channel it is, as the campaign names it.
        is_heavy: whether its residuals have heavy tails, which tolerate such samples.
    """
    x = values[np.isfinite(values)]
    if x.size < 25:
        return []
    share = float((_standing_out(x) > SPIKE * np.maximum(_scatter(x), noise)).mean())
    level = "pass" if share < SPIKES else "note" if is_heavy else "caution"
    remedies = ("heavy-residuals",) if level == "caution" else ()
    return [Finding("outliers", level, (name,), {"share": share, "sensor": sensor}, remedies)]


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
