"""Columns of one's own made into a record: what a control does between its samples is stated, or judged by how it changes."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from seatrial.core.argument_checks import check_choice, check_known, check_mapping
from seatrial.core.record import Channel, Provenance, Record, make_record
from seatrial.logs.measured_control import half_a_step_matters, looks_measured, mean_to_next, taken_as_measured
from seatrial.logs.source import Between


def record_of_columns(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    channels: tuple[Channel, ...],
    provenance: Provenance,
    label: str = "trial",
    *,
    between: Mapping[str, Between] | None = None,
) -> Record:
    """Build a record from columns and check it.

    Args:
        time: seconds, shape (n,).
        columns: one array of shape (n,) for each channel.
        channels: description of the channels; controls and measurements in any order.
        provenance: source, hash and options.
        label: short name.
        between: of controls, "held" for a command, which acts from its sample to the next, or "line" for one that was measured while it
            changed, such as the speed of a propeller: over each step it is the mean of the straight line between its samples. One that is
            not named is taken as measured if it changes at nearly every sample, with a warning, else as a command.

    Returns:
        the record, in SI as the columns are: of n samples, the controls and the measurements each in a table of a column a channel. Its
        provenance has `between` of each control.

    Raises:
        InputError: fewer than three samples, time not strictly increasing, no channel, a name that is no signal, a unit that is not the
            signal's own in SI, a gap in a control, a channel without data, an infinite value, or `between` of no control.
    """
    record = make_record(time, columns, channels, provenance, label)
    where = f"{provenance.source}, record {label!r}, between"
    stated = {} if between is None else check_mapping(between, where, 'write for example {"n": "line"}')
    check_known(stated, record.controls, where)
    for name, choice in stated.items():
        check_choice(choice, get_args(Between), f"{where}, {name}")
    chosen, cautions, control = {}, [], record.control.copy()
    for at, name in enumerate(record.controls):
        measured = looks_measured(record.time, control[:, at])
        chosen[name] = stated.get(name) or ("line" if measured else "held")
        if name not in stated and measured and half_a_step_matters(control[:, at]):
            cautions.append(taken_as_measured(name, "make_record"))
            warnings.warn(f"{provenance.source}, record {label!r}, {cautions[-1]}", stacklevel=2)
        if chosen[name] == "line":
            control[:, at] = mean_to_next(control[:, at])
    options = dict(provenance.options)
    options |= {"between": chosen} if chosen else {}
    options |= {"cautions": [*options.get("cautions", ()), *cautions]} if cautions else {}
    return replace(record, control=control, provenance=replace(provenance, options=options))
