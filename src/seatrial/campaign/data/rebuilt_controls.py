"""The controls of a log that holds set-points alone, made again by the stated autopilot from these and from what the sensors showed.

Given what was measured, the autopilot's output is known without any coefficient: it enters a likelihood as a logged control does.
"""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from seatrial.campaign.config.campaign import Campaign
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Record, make_record
from seatrial.core.signals import signal_unit
from seatrial.manoeuvres.autopilot import Autopilot
from seatrial.manoeuvres.pilot import Moment

MAX_UNEVEN_SHARE = 1e-3  # Share of an interval by which it may differ from whole samples of a log


def with_rebuilt_controls(campaign: Campaign, record: Record) -> Record:
    """Return a record with the controls that it lacks and that the autopilot moves; as it is where none is missing.

    Args:
        campaign: with its autopilot.
        record: of a log.

    Raises:
        InputError: a log without a set-point, samples that do not fit the autopilot's interval, or a fed-back channel that is missing.
    """
    controls = campaign.model(campaign.full).controls
    autopilot = campaign.pilot(controls)
    if autopilot is None or all(name in record.controls for name in controls):
        return record
    missing = [name for name in controls if name in campaign.autopilot.moved and name not in record.controls]
    where = f'record "{record.label}"'
    _check_logged(where, record, [loop.set_point for loop in autopilot.loops], "set-point of the autopilot")
    _check_logged(where, record, autopilot.outputs, "channel that the autopilot feeds back")
    autopilot = _sampled(where, autopilot, record)
    trim = dict(campaign.control_trim(campaign.model(campaign.full)))
    set_points = tuple(
        record.channel(name) if name in record.controls else np.full(record.time.size, trim[name])
        for name in autopilot.commands
    )
    made = _replayed(autopilot, set_points, tuple(record.channel(name) for name in autopilot.outputs))
    columns = {channel.name: record.channel(channel.name) for channel in record.channels}
    columns |= {name: np.asarray(made[controls.index(name)]) for name in missing}
    channels = (*(Channel(name, signal_unit(name), "control") for name in missing), *record.channels)
    options = record.provenance.options
    caution = (
        f"{', '.join(missing)} made again by [autopilot] from {', '.join(autopilot.commands[len(controls) :])}: exact if the "
        "autopilot used the logged values and began with the log"
    )
    told_options = {**options, "cautions": [*options.get("cautions", []), caution]}
    provenance = replace(record.provenance, options=told_options)
    return make_record(record.time, columns, channels, provenance, record.label)


def _check_logged(where: str, record: Record, names: Sequence[str], what: str) -> None:
    for name in names:
        if name not in (*record.controls, *record.measured):
            raise InputError(
                where,
                found=f"neither the controls nor {name}",
                expected=f"every {what}: " + ", ".join(names),
                remedy=f"map {name} to its column in [import], or the controls to theirs",
            )


def _sampled(where: str, autopilot: Autopilot, record: Record) -> Autopilot:
    """Return the autopilot with its intervals in samples of a record."""
    step, loops = float(np.median(np.diff(record.time))), []
    for loop in autopilot.loops:
        every = round(loop.interval / step)
        if every < 1 or abs(every * step - loop.interval) > MAX_UNEVEN_SHARE * loop.interval:
            raise InputError(
                where,
                found=f"samples of {step:g} s, with an interval of {loop.interval:g} s of [autopilot.{loop.holds}]",
                expected="an interval of whole samples",
                remedy=f'set import.step = "{loop.interval:g} s"',
            )
        loops.append(replace(loop, every=every))
    return replace(autopilot, loops=tuple(loops))


@program
def _replayed(autopilot: Autopilot, told: tuple[Array, ...], seen: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return every control, made from what is told and seen at each sample."""

    def advance(memory: tuple, moment: Moment) -> tuple:
        decided = autopilot.decide(memory, moment.time, moment.error, moment.told)
        return decided, autopilot.controls(decided, moment.told)

    return jax.lax.scan(advance, autopilot.begin(), Moment(jnp.zeros(seen[0].shape), told, seen))[1]
