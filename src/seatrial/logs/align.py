"""Several logs on one time axis: controls held from sample to sample, measurements left where they were taken.

On a coarser grid a control is the mean over each step of what was held, which is what moves the vehicle and has no aliases.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from seatrial.core.display_units import plain
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import sha256_of_json
from seatrial.core.record import Channel, Provenance, Record, Role, make_record
from seatrial.core.signals import ANGLES
from seatrial.logs.source import LogTable, given_twice
from seatrial.logs.time_stamps import hole_from, unit_doubt
from seatrial.numerics.integrate import held_mean

_MOST_ACROSS = 10_000  # Most instants that are put into a hole
_MAX_INSTANTS = 50_000_000
_NANOSECOND = 1e-9
# Steps of the grid for each sample of the quickest channel, from which the unit of time is doubted
_DOUBTFUL_STEPS = 100.0
_ROUNDING_SHARE = 1e-6  # Share of a step by which rounding may shift a stamp without making it early or late
# Shares of a step: below the first, stamps of two logs are one instant; up to the second, a constant difference may be
# one of clocks
_SAME_SHARE, _NEAR_SHARE = 1e-3, 0.25
_MIN_STAMP_SHARE = 0.98  # Share of the stamps that must differ by the same time: a few may be lost from one log
_MIN_STAMPS = 10
# By how much moved samples may be off, in units of their noise: from here on they are told. It adds 4 % to that noise.
_MAX_BLUR = 0.3

_END_INSTANTS = 2  # Instants at the ends of a record


@dataclass(frozen=True, eq=False)
class _Track:
    """One channel on the common clock, without its empty samples."""

    channel: Channel
    source: str
    time: Float[np.ndarray, " m"]
    values: Float[np.ndarray, " m"]


def align(
    tables: Sequence[LogTable],
    *,
    channels: Sequence[str] | None = None,
    step: float | None = None,
    start: float | None = None,
    end: float | None = None,
    label: str = "trial",
) -> Record:
    """Put logs on one time axis.

    The common interval is where every control is known and something is measured. Controls are held from the last
    known sample, and averaged over a `step` in which several fall. Nothing is interpolated: with `step` each measurement
    goes to the nearest grid instant, and those that meet there are averaged, but for those midway to the next; without, the
    axis is the union of all stamps, of which those of two logs that differ by less than a thousandth of a step are one. An instant at
    which a channel was not measured holds NaN. Roll, pitch and heading go on over full turns, so that none jumps.

    Args:
        tables: logs as `read_log_table` gives them.
        channels: names to take; all by default.
        step: of a uniform grid over the interval, s; None for the union of all stamps.
        start: where to begin, s from the beginning of the common interval; None for the beginning.
        end: where to end, s from the same; None for the end of the interval.
        label: short name of the record.

    Returns:
        a record whose time starts at 0. Its provenance tells each file, how it was read and what was done to it.

    Raises:
        InputError: no overlap, a trim that leaves nothing, a channel missing or given twice, a step that is no step,
            a row in it that a curve does not reach, or a column that cannot be what the map says (see `make_record`).
    """
    if not tables:
        raise InputError("tables to align", found="none", expected="at least one log", remedy="read it with `read_log`")
    origin = min(table.epoch for table in tables)
    times, notes, shifted = _united(tables, origin)
    tracks = _tracks(tables, times, channels)
    doubts = [
        f"{table.source} has {doubt}"
        for table in tables
        if (doubt := unit_doubt(table.time, table.options.get("time_unit") or "s"))
    ]
    first, last = _interval(tracks, doubts)
    begin = first + max(start or 0.0, 0.0)
    stop = last if end is None else min(first + end, last)
    instants = _instants(tracks, begin, stop, step, label) if stop > begin else np.empty(0)
    if instants.size < 3:
        raise InputError(
            f'record "{label}", start and end',
            found=f"start {start or 0.0:g} s, end {'of the interval' if end is None else f'{end:g} s'}: "
            f"{instants.size} samples",
            expected=f"at least 3 samples between 0 s and {last - first:.6g} s, the overlap of the files",
            remedy=_unit_first(doubts)
            or "correct start and end, in seconds from the beginning of the overlap, or the step",
        )

    columns, averaged, blurred = {}, {}, []
    cautions = [*(text for table in tables for text in table.cautions), *shifted]
    slack = _NANOSECOND / 2 if step is None else _ROUNDING_SHARE * step
    reach = _NANOSECOND if step is None else step / 2 + slack
    _check_curves(tables, {track.channel.name for track in tracks}, origin, (begin, begin + instants[-1]), slack, reach)
    for track in tracks:
        time, name = track.time - begin, track.channel.name
        if track.channel.role == "control":
            # Hold each control from its stamp to the next; the mean over a step within which one begins, so that none
            # acts late.
            index = np.searchsorted(time, instants + slack, side="right") - 1
            within = np.flatnonzero(np.searchsorted(time, instants[1:] - slack) - 1 > index[:-1])
            held = track.values[index]
            if within.size:
                held[within] = held_mean(time, track.values, instants)[within]
            columns[name] = held
            note = f"{within.size} instants have the mean of the value held until the next" if within.size else ""
        else:
            columns[name], note, blur, count = _place(time, track, instants, slack, reach)
            averaged |= {name: count} if count > 1 else {}
            blurred += [f"{name} {blur}"] if blur and step is not None else []
        notes += [f"{name}: {note}"] if note else []
    controls = [track.channel.name for track in tracks if track.channel.role == "control"]
    holes = [_hole(track.channel.name, track.time - begin, instants[-1]) for track in tracks]
    cautions += [_of_hole(one, controls) for one in _joined(one for one in holes if one is not None)]
    cautions += _sparse(tracks, step)
    if blurred:
        cautions.append(
            f"step = {step:g} s under [import] blurs the record, which may shift values: {'; '.join(blurred)}; leave step out, so that "
            f"every stamp is kept, or shorten it"
        )
    hashes = [table.sha256 for table in tables]
    options = {
        "files": [{**table.options, "sha256": table.sha256, "notes": list(table.notes)} for table in tables],
        "step": step,
        "start": begin - first,
        "end": stop - first,
        "available": last - first,
        "begins_at": str(origin + Decimal(f"{begin:.9f}")),
        "notes": notes,
        "cautions": cautions,
        **({"averaged": averaged} if averaged else {}),
    }
    provenance = Provenance(
        ", ".join(dict.fromkeys(table.source for table in tables)),
        hashes[0] if len(hashes) == 1 else sha256_of_json(hashes),
        options,
    )
    return make_record(instants, columns, tuple(track.channel for track in tracks), provenance, label)


def common_interval(spans: Sequence[tuple[float, float, Role]]) -> tuple[float, float]:
    """Return the first and last instant at which every control is known and something is measured; the first is later if there is none.

    Args:
        spans: of each channel its first and last instant, s on the common clock, and its role; one channel at least.
    """
    controls = [(a, b) for a, b, role in spans if role == "control"]
    measured = [(a, b) for a, b, role in spans if role == "measurement"]
    first, last = max((a for a, _ in controls), default=-math.inf), min((b for _, b in controls), default=math.inf)
    if measured:
        first, last = max(first, min(a for a, _ in measured)), min(last, max(b for _, b in measured))
    return first, last


def _united(tables: Sequence[LogTable], origin: Decimal) -> tuple[list[Float[np.ndarray, " n"]], list[str], list[str]]:
    """Return the stamps of each log on the common clock, s from `origin`, notes and cautions.

    Stamps of two logs that rounding alone may have parted become one. Clocks of the same step that differ by a constant part of it stay as
    they are, with a caution: whether samples were taken together, no stamp shows.
    """
    times: list[np.ndarray] = []
    notes, cautions = [], []
    for table in tables:
        time, before = table.time + float(table.epoch - origin), list(zip(tables, times, strict=False))
        for other, known in before:
            step, usual = float(np.median(np.diff(time))), float(np.median(np.diff(known)))
            middles = (known[1:] + known[:-1]) / 2
            nearest = known[np.searchsorted(middles, time)]
            apart = time - nearest
            united = np.where(np.abs(apart) < _SAME_SHARE * min(step, usual), nearest, time)
            if (moved := float(np.abs(united - time).max())) > _NANOSECOND and (np.diff(united) > 0).all():
                notes.append(f"{table.place}: stamps moved by at most {moved:.2g} s onto those of {other.place}")
                time = united
            if abs(step - usual) < _SAME_SHARE * usual and (shift := _constant(apart, step)):
                cautions.append(_of_shift(table, other, shift, step))
        times.append(time)
    return times, notes, cautions


def _constant(apart: Float[np.ndarray, " n"], step: float) -> float:
    """Return by how much nearly all stamps differ from the nearest of another log, s; 0 if not by a constant small part of a step."""
    near = apart[np.abs(apart) <= _NEAR_SHARE * step]
    if near.size < max(_MIN_STAMPS, apart.size / 2):
        return 0.0
    shift = float(np.median(near))
    constant = np.mean(np.abs(near - shift) < _SAME_SHARE * step) >= _MIN_STAMP_SHARE
    return shift if constant and abs(shift) >= _SAME_SHARE * step else 0.0


def _of_shift(table: LogTable, other: LogTable, shift: float, step: float) -> str:
    """Report that the clocks of two logs differ by a constant, and what to do if this is a difference of clocks alone."""
    total = Decimal(f"{table.options.get('shift', 0.0) - shift:.9f}").normalize()
    return (
        f"{table.place}: each stamp is {abs(shift):.4g} s {'after' if shift > 0 else 'before'} one of {other.place}, and both logs have a "
        f"sample every {step:.4g} s. If the samples are simultaneous, one log is late by this, which may change the choice of terms: "
        f'write shift = "{total:f} s" under [[import.files]] of {table.place}. Otherwise change nothing'
    )


def _tracks(
    tables: Sequence[LogTable], times: Sequence[Float[np.ndarray, " n"]], wanted: Sequence[str] | None
) -> list[_Track]:
    tracks: dict[str, _Track] = {}
    for table, time in zip(tables, times, strict=True):
        for channel in table.channels:
            if wanted is not None and channel.name not in wanted:
                continue
            if channel.name in tracks:
                raise given_twice(table.place, channel.name, tracks[channel.name].source)
            known = np.isfinite(table.columns[channel.name])
            if not known.any():
                raise InputError(
                    f'{table.place}, channel "{channel.name}"',
                    found="no number in any row",
                    expected="samples",
                    remedy="map another column; if the channel is made of several files, choose those of one run and one clock",
                )
            values = table.columns[channel.name][known]
            if channel.name in ANGLES:
                values = np.unwrap(values)
            tracks[channel.name] = _Track(channel, table.place, time[known], values)
    for name in wanted or ():
        if name not in tracks:
            offered = [channel.name for table in tables for channel in table.channels]
            raise InputError(
                "align, channels", found=f'"{name}"', expected="a channel of the maps", remedy=nearest(name, offered)
            )
    return [tracks[name] for name in wanted] if wanted is not None else list(tracks.values())


def _unit_first(doubts: Sequence[str]) -> str:
    """Return the remedy where units of time are doubted; empty if none is."""
    return f"correct the unit of time first: {', and '.join(doubts)}" if doubts else ""


def _interval(tracks: Sequence[_Track], doubts: Sequence[str]) -> tuple[float, float]:
    """Return the first and last instant at which every control is known and something is measured, s on the common clock.

    Args:
        tracks: the channels.
        doubts: about the units of their clocks, in words.

    Raises:
        InputError: there is no such time.
    """
    spans = [(float(track.time[0]), float(track.time[-1]), track.channel.role) for track in tracks]
    first, last = common_interval(spans)
    if not first < last:
        text = "; ".join(
            f"{track.channel.name} of {track.source}: {a:.12g} s to {b:.12g} s"
            for track, (a, b, _) in zip(tracks, spans, strict=True)
        )
        raise InputError(
            ", ".join(dict.fromkeys(track.source for track in tracks)),
            found=f"no common time ({text}, counted from the earliest stamp)",
            expected="files that overlap on one clock",
            remedy=_unit_first(doubts)
            or "choose files of the same run, and time columns of the same unit. If their clocks differ, add shift under "
            "[[import.files]] of one, which `seatrial inspect` of these files estimates",
        )
    return first, last


def _spacing(tracks: Sequence[_Track]) -> float:
    """Return the usual spacing of the quickest channel, s; 0 if none has two samples."""
    return min((float(np.median(np.diff(track.time))) for track in tracks if track.time.size > 1), default=0.0)


def _filled(time: np.ndarray, usual: float) -> np.ndarray:
    """Return instants with steps of the usual length across holes: one step over a hole would be too long to simulate."""
    steps = np.diff(time)
    holes = np.flatnonzero(steps > hole_from(usual)) if usual > 0 else np.empty(0, int)
    if not holes.size:
        return time
    between = [
        np.linspace(time[at], time[at + 1], min(round(steps[at] / usual), _MOST_ACROSS) + 1)[1:-1] for at in holes
    ]
    return np.sort(np.concatenate([time, *between]))


def _instants(tracks: Sequence[_Track], begin: float, stop: float, step: float | None, label: str) -> np.ndarray:
    """Return the time axis of the record from 0 on: a grid, or every stamp to the nanosecond."""
    if step is None:
        stamps = [track.time[(track.time >= begin) & (track.time <= stop)] - begin for track in tracks]
        counts = np.sort(np.rint(np.concatenate([np.zeros(1), *stamps]) / _NANOSECOND), kind="stable")
        return _filled(counts[np.diff(counts, prepend=-1.0) > 0] / 1e9, _spacing(tracks))
    if not (math.isfinite(step) and step > 0 and (stop - begin) / step < _MAX_INSTANTS):
        raise InputError(
            f'record "{label}", step',
            found=f"{step!r} s over {stop - begin:.6g} s",
            expected=f"a positive number that makes at most {_MAX_INSTANTS} samples",
            remedy="give the sampling time of the record, in seconds",
        )
    return step * np.arange(math.floor((stop - begin) / step + _ROUNDING_SHARE) + 1)


def _check_curves(
    tables: Sequence[LogTable],
    used: Collection[str],
    origin: Decimal,
    ends: tuple[float, float],
    slack: float,
    reach: float,
) -> None:
    """Check that curves reach what a record is made of: controls held before its last instant, and measurements at its instants.

    Raises:
        InputError: a number that they do not reach.
    """
    begin, end = ends
    for table in tables:
        for channel in (one for one in table.channels if one.name in used and one.name in table.curved):
            rows = np.flatnonzero(np.isfinite(table.columns[channel.name]))
            time = table.time[rows] + float(table.epoch - origin)
            if channel.role == "control":
                first, stop = np.searchsorted(time, begin + slack, side="right") - 1, np.searchsorted(time, end - slack)
            else:
                first, stop = np.searchsorted(time, begin - reach), np.searchsorted(time, end + reach, side="right")
            for one in table.curved[channel.name]:
                one.curve.check(one.cells[rows[first:stop]], table.time[rows[first:stop]], one.where)


def _sparse(tracks: Sequence[_Track], step: float | None) -> list[str]:
    """Report that even the quickest channel has far fewer samples than the grid, as where its stamps are read in too large a unit."""
    spacing = _spacing(tracks)
    if step is None or spacing < _DOUBTFUL_STEPS * step:
        return []
    return [
        f"even the fastest channel has a sample only every {spacing:.4g} s, and the record one every {step:g} s. Check the unit of time "
        "in the channel map. If it is right, make step under [import] longer"
    ]


class _Hole(NamedTuple):
    """Where channels fell silent, s from the begin of the record, and their usual spacing, s."""

    begin: float
    end: float
    usual: float
    names: tuple[str, ...]


def _hole(name: str, time: np.ndarray, last: float) -> _Hole | None:
    """Return where a channel fell silent for longest, if that is over a second and twenty times its usual spacing."""
    inside = time[(time >= 0) & (time <= last)]
    gaps = np.diff(inside)
    if gaps.size == 0 or gaps.max() < hole_from(float(np.median(gaps))):
        return None
    at = int(np.argmax(gaps))
    return _Hole(float(inside[at]), float(inside[at + 1]), float(np.median(gaps)), (name,))


def _joined(holes: Iterable[_Hole]) -> list[_Hole]:
    """Return holes that overlap as one of all their channels."""
    joined: list[_Hole] = []
    for hole in sorted(holes):
        if joined and hole.begin < joined[-1].end:
            before = joined.pop()
            usual = min(before.usual, hole.usual)
            hole = _Hole(before.begin, max(before.end, hole.end), usual, (*before.names, *hole.names))
        joined.append(hole)
    return joined


def _of_hole(hole: _Hole, controls: Collection[str]) -> str:
    """Return which channels fell silent, and what that does."""
    held = [name for name in hole.names if name in controls]
    gap = f"no sample of {', '.join(hole.names)} from {hole.begin:.2f} s to {hole.end:.2f} s, but usually one every {hole.usual:.3g} s"
    if not held:
        return f"{gap}: nothing was measured, and the motion is simulated across it"
    return (
        f"{gap}: the motion is simulated across it with the last value of {', '.join(held)}, which may be wrong. End the run there, "
        f'end = "{hole.begin:.6g} s" in [import.trim.RUN], and give the rest a different label in fit, with start = "{hole.end:.6g} s" '
        "and the same file, or a copy if its path has {run}"
    )


def _place(
    time: np.ndarray, track: _Track, instants: np.ndarray, slack: float, reach: float
) -> tuple[np.ndarray, str, str, float]:
    """Put each measurement at its nearest instant, average those that meet; also a note, what is blurred, and how many meet at the median.

    One midway between two is put at the earlier, where that has none of its own; else it is left out.
    """
    index = np.searchsorted((instants[1:] + instants[:-1]) / 2 + slack, time)
    shift = np.abs(time - instants[index])
    near = shift <= reach
    if not near.any():
        raise InputError(
            f'{track.source}, channel "{track.channel.name}"',
            found=f"samples from {time[0]:.6g} s to {time[-1]:.6g} s, none of them within the record",
            expected=f"samples between 0 s and {instants[-1]:.6g} s, the range of the controls",
            remedy="choose files of the same run, or move start and end. If their clocks differ, add shift under [[import.files]] of one, "
            "which `seatrial inspect` of these files estimates",
        )
    midway = near & (shift > reach - 4 * slack) & (reach > 4 * slack)
    has_own = np.zeros(instants.size, bool)
    has_own[index[near & ~midway]] = True
    doubled = midway & has_own[index]  # half a step late, they would make every mean late by a quarter of it
    near &= ~doubled
    values = track.values[near]
    used, firsts, counts = np.unique(index[near], return_index=True, return_counts=True)
    deviation = values - np.repeat(values[firsts], counts)
    column = np.full(instants.size, np.nan)
    column[used] = values[firsts] + np.add.reduceat(deviation, firsts) / counts
    met, usual = int((counts > 1).sum()), float(np.median(counts))
    moved = np.add.reduceat((instants[index] - time)[near], firsts) / counts
    moved = moved[1:-1] if moved.size > _END_INSTANTS else moved  # at an end there are samples on one side alone
    blur = float(np.sqrt(np.mean(moved**2) * usual)) * _rate_over_noise(time[near], values)
    return (
        column,
        f"{values.size} samples, moved by at most {shift[near].max():.3g} s"
        + (f"; {met} instants have the mean of two or more" if met else "")
        + (f"; {doubled.sum()} midway between two instants were left out" if doubled.any() else ""),
        f"is moved in time by up to {np.abs(moved).max():.2g} s, which changes it by {plain(blur)} times its noise"
        if blur > _MAX_BLUR and np.abs(moved).max() > slack
        else "",
        usual,
    )


def _rate_over_noise(time: np.ndarray, values: np.ndarray) -> float:
    """Return the root mean square rate of a channel over the standard deviation of its noise, 1/s; 0 if no rate stands out.

    The noise is what a sample differs by from the line between its neighbours, the rate that of these lines; both variances are
    corrected for the noise of the neighbours.
    """
    if values.size < 3:
        return 0.0
    span = time[2:] - time[:-2]
    share = (time[1:-1] - time[:-2]) / span
    apart = values[1:-1] - values[:-2] - share * (values[2:] - values[:-2])
    variance = float(np.mean(apart**2 / (1 + share**2 + (1 - share) ** 2)))
    rate = float(np.mean(((values[2:] - values[:-2]) / span) ** 2) - variance * np.mean(2 / span**2))
    return math.sqrt(rate / variance) if rate > 0 < variance else 0.0
