"""Velocities over the earth turned into the body's by the attitude, and quaternions into angles, whichever files of a run hold them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Role
from seatrial.core.signals import ANGLES, OVER_EARTH, QUATERNION, SPECIFIC_FORCE
from seatrial.logs.axes import complete
from seatrial.logs.source import LogTable, given_twice
from seatrial.numerics.rotations import angles_of_quaternion, matrix_of_angles, quaternion_of_angles

# Doubts about an attitude: a heading that turns otherwise than the yaw rate says, or too far from sample to sample.

# Change of an angle from sample to sample from which it is too slow to turn velocities by
_LARGE_CHANGE = np.radians(15.0)
# Ratio of the heading's turns to those of the yaw rate from which one of them is doubted, or its inverse
_MAX_RATIO = 1.5
_MIN_TURN = np.radians(20.0)  # Turn from which they are compared
_MIN_SAMPLES = 10
_MIN_FORCE = 5.0  # Length, m/s^2, of a specific force below which it is in units of gravity, or gravity was taken off
_GYRO = ("p", "q", "r")
_IN_DEGREES = {
    "phi, theta and psi are in degrees": (True, True, True),
    "psi is in degrees": (False, False, True),
    "phi and theta are in degrees": (True, True, False),
}
# What a quaternion may be instead: which of its columns are w, x, y and z, and their signs
_OTHER_READINGS = {
    "q_w, q_x, q_y and q_z of the map are x, y, z and w": ((3, 0, 1, 2), (1, 1, 1, 1)),
    "q_w, q_x, q_y and q_z of the map are z, w, x and y": ((1, 2, 3, 0), (1, 1, 1, 1)),
    "it turns the earth's axes into the body's (scale = -1 for q_x, q_y and q_z)": ((0, 1, 2, 3), (1, -1, -1, -1)),
}
_JUMP_ANGLE = np.radians(45.0)  # Turn in one window beyond that of the gyro from which it is a jump
_MAX_JUMP_SHARE = 0.1  # Share of windows up to which jumps are exceptions
_WINDOW_LENGTH = 0.2  # Length of a window in which turns are compared, s


def check_specific_force(tables: Sequence[LogTable]) -> None:
    """Refuse an accelerometer in units of gravity, or one whose gravity was taken off.

    Raises:
        InputError: three components whose length is far below that of gravity.
    """
    for table in tables:
        if set(SPECIFIC_FORCE) <= set(table.columns):
            size = float(np.nanmedian(np.sqrt(sum(table.columns[name] ** 2 for name in SPECIFIC_FORCE))))
            if size < _MIN_FORCE:
                raise InputError(
                    f"{table.place}, channels {', '.join(SPECIFIC_FORCE)}",
                    found=f"a specific force of {size:.3g} m/s^2 at the median",
                    expected="about 9.8 m/s^2, the output of an accelerometer at rest",
                    remedy='unit = "m/s^2" with scale = 9.81 if it is in units of gravity; drop the channels if gravity was removed',
                )


def with_doubts(table: LogTable, tables: Sequence[LogTable]) -> LogTable:
    """Return the log with a caution where its heading turns otherwise than the yaw rate of the same run.

    Args:
        table: a log.
        tables: all of its run.
    """
    rates = next((one for one in tables if "r" in one.columns), None)
    if "psi" not in table.columns or rates is None:
        return table
    has_heading, known = np.isfinite(table.columns["psi"]), np.isfinite(rates.columns["r"])
    psi, at = np.unwrap(table.columns["psi"][has_heading]), table.time[has_heading]
    clock = rates.time[known] + float(rates.epoch - table.epoch)
    inside = (at >= clock[:1].sum()) & (at <= clock[-1:].sum())
    if inside.sum() < _MIN_SAMPLES:
        return table
    turned = np.concatenate([[0.0], np.cumsum(np.diff(clock) * rates.columns["r"][known][:-1])])
    expected, measured = np.diff(np.interp(at[inside], clock, turned)), np.diff(psi[inside])
    if np.ptp(np.cumsum(expected)) < _MIN_TURN:
        return table
    ratio = float(measured @ expected / (expected @ expected))
    if 1 / _MAX_RATIO < ratio < _MAX_RATIO:
        return table
    caution = (
        f'channel "psi" of {table.place}: it turns {ratio:.3g} times as fast as r of {rates.place}. Check its unit, its sign and '
        "`axes`, the order of a quaternion, and the clocks"
    )
    return replace(table, cautions=(*table.cautions, caution))


def doubts_of_gyro(tables: Sequence[LogTable]) -> list[str] | None:
    """Return where body rates are not those with which the attitude of the same run turns: unit, sign or axes of one of them are wrong.

    Over windows the gyro's turn is a matrix times that of the attitude: near 1 if they agree. None if that cannot be told.
    """
    attitude = next((one for one in tables if set(ANGLES) <= set(one.columns)), None)
    gyro = next((one for one in tables if set(_GYRO) <= set(one.columns)), None)
    if attitude is None or gyro is None:
        return None
    angles = np.stack([attitude.columns[name] for name in ANGLES])
    doubts = _doubts(attitude, gyro, np.stack(quaternion_of_angles(*angles)))
    for words, parts in _other_readings(angles) if doubts else ():
        if _doubts(attitude, gyro, parts) == []:
            return [
                f"the attitude of {attitude.place} turns as the gyro of {gyro.place} does if {words}: correct the channel map"
            ]
    return doubts


def _other_readings(angles: Float[np.ndarray, "3 n"]) -> Iterator[tuple[str, Float[np.ndarray, "4 n"]]]:
    """Yield what an attitude may be instead, in words, and its quaternion."""
    for words, units in _IN_DEGREES.items():
        yield words, np.stack(quaternion_of_angles(*(angles * np.where(units, np.pi / 180, 1.0)[:, None])))
    parts = np.stack(quaternion_of_angles(*angles))
    for words, (order, signs) in _OTHER_READINGS.items():
        yield words, parts[list(order)] * np.array(signs)[:, None]


def _doubts(attitude: LogTable, gyro: LogTable, parts: Float[np.ndarray, "4 n"]) -> list[str] | None:
    """Say the same of an attitude by its quaternion, w, x, y, z, shape (4, n)."""
    turns, shown, start = _turns(attitude, gyro, parts)
    if len(turns) < _MIN_SAMPLES or np.sqrt(np.linalg.eigvalsh(turns.T @ turns)[0]) < _MIN_TURN:
        return None  # it hardly turned about some axis
    # How far each turn of the attitude is from what most windows make of the gyro's: least absolute deviations, rad.
    far = np.ones(len(turns))
    for _ in range(20):
        weight = np.maximum(far, 1e-3)[:, None] ** -0.5
        far = np.linalg.norm(turns - shown @ np.linalg.lstsq(weight * shown, weight * turns, rcond=None)[0], axis=1)
    jumps = far > _JUMP_ANGLE
    if jumps.mean() > _MAX_JUMP_SHARE:
        jumps[:] = False  # no exceptions: unit, sign or axes
    messages = []
    if jumps.any():
        messages.append(
            f"the attitude of {attitude.place} jumps {jumps.sum()} times when the gyro of {gyro.place} does not, by up to "
            f"{np.degrees(far[jumps].max()):.0f} deg, first at {start[jumps][0]:.1f} s. Are angles averaged or interpolated over a full "
            'turn? Import the quaternion, or set residuals = "heavy" for the attitude'
        )
    matrix = np.linalg.lstsq(turns[~jumps], shown[~jumps], rcond=None)[0].T
    for i, row in enumerate(matrix):
        largest = int(np.argmax(np.abs(row)))
        if largest == i and 1 / _MAX_RATIO < row[i] < _MAX_RATIO:
            continue
        message = f'channel "{_GYRO[i]}" of {gyro.place}: the attitude of {attitude.place} turns as if it were '
        if largest != i:
            message += f"{row[largest]:+.2g} times {_GYRO[largest]}: the axes of one of them are exchanged"
        elif row[i] < 0 and 1 / _MAX_RATIO < -row[i] < _MAX_RATIO:
            message += (
                "its opposite: forward, left, up or forward, right, down? give `axes` of both logs, or scale = -1"
            )
        else:
            size = max(abs(row[i]), 1 / max(abs(row[i]), 1e-12))
            unit = (
                ": degrees taken for radians, or the reverse? check its unit"
                if _MAX_RATIO > size * np.pi / 180 > 1 / _MAX_RATIO
                else ""
            )
            message += f"{1 / row[i]:.3g} times it{unit}"
        messages.append(message)
    main = np.argmax(np.abs(matrix), axis=1)
    signs = np.zeros((3, 3))
    signs[range(3), main] = np.sign(matrix[range(3), main])
    if np.linalg.det(signs) < -0.5:
        messages.append(
            f'channels "p", "q", "r" of {gyro.place}: compared with the attitude of {attitude.place} their axes are left-handed: one '
            "sign is wrong, or two axes are exchanged"
        )
    return messages


def _turns(
    attitude: LogTable, gyro: LogTable, parts: Float[np.ndarray, "4 n"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Return by how much the attitude turns about the body's axes in windows, what the gyro says of these, rad, and when they begin, s."""
    known = np.isfinite(parts).all(axis=0)
    rates = np.stack([gyro.columns[name] for name in _GYRO], axis=1)
    is_present = np.isfinite(rates).all(axis=1)
    clock, rates = gyro.time[is_present] + float(gyro.epoch - attitude.epoch), rates[is_present]
    if not (known.any() and is_present.any()):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    time, parts = attitude.time[known], parts[:, known]
    inside = (time >= clock[0]) & (time <= clock[-1])
    time, parts = time[inside], parts[:, inside]
    if time.size < 2:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    chosen = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _WINDOW_LENGTH)))
    time, (w, x, y, z) = time[chosen], parts[:, chosen]
    before, after = np.stack([w, -x, -y, -z])[:, :-1], np.stack([w, x, y, z])[:, 1:]
    scalar = before[0] * after[0] - np.sum(before[1:] * after[1:], axis=0)
    vector = before[0] * after[1:] + after[0] * before[1:] + np.cross(before[1:].T, after[1:].T).T
    length = np.linalg.norm(vector, axis=0)
    angle = 2.0 * np.arctan2(length, np.abs(scalar)) * np.where(scalar < 0, -1.0, 1.0)
    turns = (vector * np.where(length > 0, angle / np.where(length > 0, length, 1.0), 0.0)).T
    summed = np.concatenate([np.zeros((1, 3)), np.cumsum(np.diff(clock)[:, None] * rates[:-1], axis=0)])
    shown = np.diff(np.stack([np.interp(time, clock, one) for one in summed.T], axis=1), axis=0)
    short = np.diff(time) < 3 * _WINDOW_LENGTH
    return turns[short], shown[short], time[:-1][short]


def doubts_of_speed(source: LogTable, angle: str) -> list[str]:
    """Return where an angle changes much from one of its samples to the next, so that what lies between is doubtful."""
    change = np.abs(np.diff(np.unwrap(source.columns[angle][np.isfinite(source.columns[angle])])))
    most = float(np.quantile(change, 0.99)) if change.size else 0.0
    if most < _LARGE_CHANGE:
        return []
    return [
        f'channel "{angle}" of {source.place}: it changes by {np.degrees(most):.0f} deg from one sample to the next, and velocities over '
        "the earth are turned by interpolated angles. Use a faster log of the attitude"
    ]


SOURCES = (*OVER_EARTH, *QUATERNION, *ANGLES)  # Channels of which others are made
_BODY = ("u", "v", "w")
# Time between two samples of the attitude over which it is still interpolated, s; twenty usual steps where that is
# more
_LONGEST_GAP = 1.0


def to_body(tables: Sequence[LogTable], roles: Mapping[str, Role]) -> list[LogTable]:
    """Make angles of quaternions, and velocities along the body of those over the earth.

    The attitude is interpolated at the instants of the velocities: linearly, the heading over its full turns, and not across holes.

    Args:
        tables: the logs of one run.
        roles: channels to keep, and whether each drives the vehicle or observes it.

    Returns:
        the logs with those channels only; logs left without one are dropped.

    Raises:
        InputError: components or attitude that are missing, a number that is no unit quaternion, or a channel given twice.
    """
    keeps_quaternion = set(QUATERNION) <= set(roles)
    with_angles = [_with_angles(table, keeps_quaternion) for table in tables]
    for angle in ANGLES:
        if len(places := [table.place for table in with_angles if angle in table.columns]) > 1:
            raise given_twice(places[-1], angle, places[0])
    check_specific_force(with_angles)
    gyro = doubts_of_gyro(with_angles)
    with_angles = [
        with_doubts(table, with_angles)
        if gyro is None
        else replace(table, cautions=(*table.cautions, *(gyro if "p" in table.columns else ())))
        for table in with_angles
    ]
    turned = [_with_body_velocities(table, with_angles) for table in with_angles]
    kept = [_only(table, roles) for table in turned]
    left = [table for table in kept if table.channels]
    gone = tuple(text for table in kept if not table.channels for text in table.cautions)
    return [replace(left[0], cautions=(*left[0].cautions, *gone)), *left[1:]] if left else []


def _with_angles(table: LogTable, keeps_quaternion: bool) -> LogTable:
    """Replace a quaternion by its three angles; if it is kept it stands beside them, or is made of them, without a jump of sign."""
    if QUATERNION[0] not in table.columns:
        return _with_quaternion(table) if keeps_quaternion and set(ANGLES) <= set(table.columns) else table
    parts = np.stack([table.columns[name] for name in QUATERNION])
    length = np.sqrt(np.sum(parts**2, axis=0))
    wrong = np.flatnonzero(np.isfinite(length) & ~(np.abs(length - 1.0) < 0.1))
    if wrong.size:
        raise InputError(
            f"{table.place}, channels {', '.join(QUATERNION)}",
            found=f"a length of {length[wrong[0]]:.3g} at {table.time[wrong[0]]:g} s; {wrong.size} such rows",
            expected="unit quaternions",
            remedy="map q_w to the scalar part and q_x, q_y, q_z to the others. Leave out rows before the start of the filter, and "
            "averages or interpolations across a change of sign",
        )
    w, x, y, z = parts
    angles = {name: np.asarray(one) for name, one in zip(ANGLES, angles_of_quaternion((w, x, y, z)), strict=True)}
    turned = _exchange(table, QUATERNION, angles, "rad", "phi, theta and psi are those of the quaternion")
    return _with_quaternion(turned, parts / length) if keeps_quaternion else turned


def _with_quaternion(table: LogTable, parts: Float[np.ndarray, "4 n"] | None = None) -> LogTable:
    """Add the attitude as a quaternion, that of the angles where none is given: q and -q turn alike, and each sample has the nearer one."""
    made = quaternion_of_angles(*(table.columns[name] for name in ANGLES)) if parts is None else parts
    parts = np.array(made)
    known = np.flatnonzero(np.isfinite(parts).all(axis=0))
    turns = np.sum(parts[:, known[1:]] * parts[:, known[:-1]], axis=0) < 0
    parts[:, known[1:]] *= np.where(np.cumsum(turns) % 2, -1.0, 1.0)
    return _exchange(
        table, (), dict(zip(QUATERNION, parts, strict=True)), "1", "the sign of the quaternion does not jump"
    )


def _with_body_velocities(table: LogTable, tables: Sequence[LogTable]) -> LogTable:
    """Replace velocities over the earth by those along the body."""
    velocities = [name for name in OVER_EARTH if name in table.columns]
    if not velocities:
        return table
    sources = {angle: next((one for one in tables if angle in one.columns), None) for angle in ANGLES}
    is_level = sources["phi"] is None and sources["theta"] is None
    needed = OVER_EARTH[:2] if is_level and "v_down" not in velocities else OVER_EARTH
    complete(velocities, needed, table.place)
    if sources["psi"] is None:
        raise InputError(
            f"{table.place}, channels {', '.join(velocities)}",
            found="no heading in any file of the run",
            expected="psi, or a quaternion, to turn them into the body's axes",
            remedy="map the heading too; if the model does not use it, it only turns these velocities",
        )
    angles = [np.zeros(table.time.size) if one is None else _at(one, angle, table) for angle, one in sources.items()]
    earth = [table.columns.get(name, np.zeros(table.time.size)) for name in OVER_EARTH]
    rows = matrix_of_angles(*angles)
    body = {name: sum(np.asarray(rows[j][i]) * earth[j] for j in range(3)) for i, name in enumerate(_BODY)}
    body = {name: body[name] for name in _BODY[: len(needed)]}
    cautions = [text for angle, one in sources.items() if one is not None for text in doubts_of_speed(one, angle)]
    by = ", ".join(f"{angle} {'= 0' if one is None else f'of {one.place}'}" for angle, one in sources.items())
    turned = _exchange(table, OVER_EARTH, body, "m/s", f"{', '.join(body)} are over the earth, turned by {by}")
    return replace(turned, cautions=(*turned.cautions, *cautions))


def _at(source: LogTable, angle: str, table: LogTable) -> Float[np.ndarray, " n"]:
    """Return an angle at the instants of another log, NaN outside of what is known and in holes."""
    known = np.isfinite(source.columns[angle])
    time = source.time[known] + float(source.epoch - table.epoch)
    if time.size < 2 or time[0] > table.time[-1] or time[-1] < table.time[0]:
        raise InputError(
            f'{source.place}, channel "{angle}"',
            found=f"{time.size} samples" if time.size < 2 else f"samples from {time[0]:.6g} s to {time[-1]:.6g} s",
            expected=f"samples around 0 s to {table.time[-1]:.6g} s, where {table.place} has velocities to be turned",
            remedy="choose files of the same run, and time columns of the same clock and unit",
        )
    values = np.interp(table.time, time, np.unwrap(source.columns[angle][known]), left=np.nan, right=np.nan)
    steps = np.diff(time)
    longest = max(_LONGEST_GAP, 20.0 * float(np.median(steps)))
    after = np.clip(np.searchsorted(time, table.time), 1, time.size - 1)
    between = (table.time != time[after]) & (table.time != time[after - 1])
    return np.where(between & (steps[after - 1] > longest), np.nan, values)


def _exchange(
    table: LogTable, old: Sequence[str], new: dict[str, Float[np.ndarray, " n"]], unit: str, note: str
) -> LogTable:
    """Return a log with some measurements instead of others."""
    if both := [name for name in new if name in table.columns]:
        raise InputError(
            f"{table.place}, channels {', '.join(both)}",
            found=f"their columns, and {', '.join(one for one in old if one in table.columns)} that give them too",
            expected="one or the other",
            remedy="drop one from the map",
        )
    kept = {name: values for name, values in table.columns.items() if name not in old}
    channels = (
        *(channel for channel in table.channels if channel.name not in old),
        *(Channel(name, unit, "measurement") for name in new),
    )
    return replace(table, columns=kept | new, channels=channels, notes=(*table.notes, note))


def _only(table: LogTable, roles: Mapping[str, Role]) -> LogTable:
    channels = tuple(replace(one, role=roles[one.name]) for one in table.channels if one.name in roles)
    return replace(table, channels=channels, columns={one.name: table.columns[one.name] for one in channels})
