"""Several logs of one run made into a record: velocities along the body, one time axis, and the part of it that counts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError, located
from seatrial.core.record import Record, Role
from seatrial.core.signals import QUATERNION
from seatrial.logs.align import align
from seatrial.logs.body_frame import to_body
from seatrial.logs.run_conditions import longest, parse_condition, spans_of
from seatrial.logs.schedule_match import match_schedule
from seatrial.logs.source import LogSource, LogTable


@dataclass(frozen=True)
class Condition:
    """What a run must meet, by columns of a log of it.

    Attributes:
        source: that log and its clock.
        when: comparisons joined by `and`, see `parse_condition`.
        place: of the condition, for errors.
    """

    source: LogSource
    when: str
    place: str


@dataclass(frozen=True, eq=False)
class Commanded:
    """The schedule that a run was to follow.

    Attributes:
        name: of its file.
        time: of its samples, evenly from 0, s, shape (m,).
        controls: by name, held from each sample to the next, SI, shape (m,).
        place: of it, for errors.
    """

    name: str
    time: Float[np.ndarray, " m"]
    controls: Mapping[str, Float[np.ndarray, " m"]]
    place: str


def body_tables(
    tables: Sequence[LogTable], roles: Mapping[str, Role], wanted: Sequence[str] | None = None
) -> list[LogTable]:
    """Return the logs of a run with velocities along the body.

    Args:
        tables: of `read_log_table`.
        roles: channels to keep, and whether each drives the vehicle or observes it.
        wanted: measurements that are of use even if they never move; others that do not are left out; None to keep all.

    Raises:
        InputError: as `to_body`.
    """
    turned = to_body(tables, roles)
    return turned if wanted is None else [one for table in turned if (one := _without_idle(table, wanted)).channels]


def join_logs(
    tables: Sequence[LogTable],
    *,
    step: float | None = None,
    start: float | None = None,
    end: float | None = None,
    label: str = "trial",
    conditions: Sequence[Condition] = (),
    commanded: Commanded | None = None,
) -> Record:
    """Put the logs of a run on one axis between its ends: if none are stated, those of what was commanded.

    Args:
        tables: of `body_tables`.
        step: see `align`, as the three that follow.
        start: where to begin.
        end: where to end.
        label: short name of the record.
        conditions: the record is cut to the longest stretch in which every one holds.
        commanded: schedule that the run was to follow.

    Raises:
        InputError: as `align`; a condition that never holds, or a schedule that was not followed.
    """
    ends = {name: value for name, value in (("start", start), ("end", end)) if value is not None}
    if conditions:
        ends = _kept(conditions, align(unchecked(tables), step=step, **ends, label=label))
    if commanded is None:
        return align(tables, step=step, **ends, label=label)
    with located(commanded.place):
        whole = align(unchecked(tables), step=step, label=label)
        followed = match_schedule(whole, commanded.time, commanded.controls, commanded.name)
    record = align(tables, step=step, **(ends or followed.ends), label=label)
    options = record.provenance.options
    cautions = [*options["cautions"], *followed.cautions]
    updated = {**options, "followed": f"{commanded.name}: {followed.words}", "cautions": cautions}
    return replace(record, provenance=replace(record.provenance, options=updated))


def unchecked(tables: Sequence[LogTable]) -> list[LogTable]:
    """Return the logs with rows that no curve reaches, for a look at all of them before some are cut away."""
    return [replace(table, curved={}) for table in tables]


def _kept(conditions: Sequence[Condition], whole: Record) -> dict[str, float]:
    """Return where the longest stretch of a record begins and ends in which every condition holds, s from the beginning of the record.

    Raises:
        InputError: a log or column that cannot be read, or no such stretch.
    """
    options = whole.provenance.options
    begin = Decimal(options["begins_at"])
    spans = []
    for one in conditions:
        with located(one.place):
            spans.append(spans_of(one.source, parse_condition(one.when, one.place)))
    stretch = longest(spans, (begin, begin + Decimal(f"{whole.time[-1]:.9f}")))
    if stretch is None:
        words = " and ".join(one.when for one in conditions)
        raise InputError(
            conditions[0].place,
            found=f'run "{whole.label}", in which {words} never holds',
            expected="a stretch in which every condition holds",
            remedy="correct the condition, `start` and `end`; `seatrial inspect` shows the range of each column",
        )
    first, last = (float(instant - begin) + options["start"] for instant in stretch)
    return {"start": first, "end": last}


def _without_idle(table: LogTable, wanted: Sequence[str]) -> LogTable:
    """Leave out measurements that never move and that are not wanted, and say so."""
    idle = {
        one.name: float(known[0])
        for one in table.channels
        if one.role == "measurement" and one.name not in (*wanted, *QUATERNION)
        if (known := table.columns[one.name][np.isfinite(table.columns[one.name])]).size and np.ptp(known) == 0
    }
    notes = (
        f'channel "{name}": {value:g} in every sample; no sensor reads it: left out' for name, value in idle.items()
    )
    return replace(
        table,
        channels=tuple(one for one in table.channels if one.name not in idle),
        columns={name: column for name, column in table.columns.items() if name not in idle},
        notes=(*table.notes, *notes),
    )
