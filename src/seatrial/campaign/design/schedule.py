"""A design as the operator runs it: its schedule as CSV, and as JSON with what else is to be said of it; and those that a campaign has."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.campaign.store.stored_result import Store
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.files import is_there, read_bytes, write_json, write_text
from seatrial.core.signals import thruster_controls
from seatrial.logs.curve import read_curve
from seatrial.manoeuvres.manoeuvre import Manoeuvre
from seatrial.manoeuvres.schedule import Schedule, schedule_of, table_text

# The commands that make the thrusts of a schedule: laws of thrust read backwards, in the unit of each law, such as
# microseconds.

Command = Callable[[float], float]
"""Gives the command of a thrust, N; NaN if no command makes it."""


def commands_of(campaign: Campaign) -> dict[str, Command]:
    """Return the command of each control that has a law of thrust.

    Raises:
        InputError: the table of a law that cannot be read.
    """
    laws = campaign.vehicle.laws if isinstance(campaign.vehicle, WholeVehicle) else ()
    commands: dict[str, Command] = {}
    for control, law in zip(thruster_controls(len(laws), commanded_force=True), laws, strict=True):
        where = campaign.where("vehicle.thrust_laws")
        table = read_curve(find(campaign.folder, law.table, where), where) if law.table else None
        commands[control] = partial(law.command, points=None if table is None else (table.logged, table.value))
    return commands


NO_COMMANDS: Mapping[str, Command] = {}  # Of a vehicle without laws of thrust

# Designs in words, in the units of the boundary.


def write_schedule(
    path: Path,
    manoeuvre: Manoeuvre,
    sample_time: float,
    rule: str = "",
    about: Mapping[str, Any] | None = None,
    commands: Mapping[str, Command] = NO_COMMANDS,
) -> Path:
    """Write a schedule as CSV and beside it as JSON, if they are missing or not the same; returns the CSV file.

    A trial that is ended away from trim goes back to it, as fast as its edges are, or in one sample. A closed-loop trial has a `rule`,
    which its schedule only foresees; `about` is kept beside it. A thrust has a second column if `commands` has its control.
    """
    rows = schedule_of(manoeuvre, sample_time).bends()
    back = _way_back(manoeuvre, sample_time, {name: float(values[-1]) for name, values in rows.controls.items()})
    time = [*map(float, rows.time), *(t for t, _ in back)]
    columns = {name: [*map(float, values), *(at[name] for _, at in back)] for name, values in rows.controls.items()}
    # NaN where no command makes a thrust.
    commanded = {name: [commands[name](thrust) for thrust in columns[name]] for name in columns if name in commands}
    text = table_text(time, columns, commanded)
    settings = {name: float(value) for name, value in manoeuvre.parameters.items()}
    content = {
        "manoeuvre": manoeuvre.name,
        "settings_si": settings,
        **({"rule": rule} if rule else {}),
        **(about or {}),
    }
    return _write(path, text, tuple(columns), content)


def write_own(path: Path, schedule: Schedule, name: str) -> Path:
    """Write a schedule of one's own, by the name of its file, where designs are, so that it goes out as they do; returns the CSV file."""
    rows = schedule.bends()
    text = table_text([*map(float, rows.time)], {one: [*map(float, x)] for one, x in rows.controls.items()})
    return _write(path, text, tuple(rows.controls), {"manoeuvre": f"schedule {name}"})


def _write(path: Path, text: str, controls: Sequence[str], content: Mapping[str, Any]) -> Path:
    """Write a table, and its columns with what else is said of it as JSON: of several controls each by its name."""
    if not is_there(path) or path.read_bytes() != text.encode():
        write_text(path, text)
    rows = [line for line in text.splitlines()[1:] if not line.startswith("#")]
    time, *values = zip(*(map(float, line.split(",")) for line in rows), strict=True)
    columns = [
        {"control": name, "unit": shown_unit(name)[1], "value": value}
        for name, value in zip(controls, values[: len(controls)], strict=True)
    ]
    driven = columns[0] if len(columns) == 1 else {"controls": columns}
    write_json(path.with_suffix(".json"), {**content, **driven, "time_s": time})
    return path


def _way_back(
    manoeuvre: Manoeuvre, sample_time: float, last: Mapping[str, float]
) -> list[tuple[float, Mapping[str, float]]]:
    """Rows that hold the last values to the end and lead back to trim; none if the trial ends there."""
    known = {name: manoeuvre.parameters.get("trim" if name == manoeuvre.control else f"trim {name}") for name in last}
    trim = {name: last[name] if value is None else value for name, value in known.items()}
    if all(abs(last[name] - value) <= 1e-9 * max(1.0, abs(value)) for name, value in trim.items()):
        return []
    end, edge = round(manoeuvre.duration / sample_time) * sample_time, manoeuvre.parameters.get("ramp", 0.0)
    return [(end, last), (end + edge, trim)] if edge > 0 else [(end, trim)]


def find_schedules(folder: Path) -> dict[str, Path]:
    """Return the schedules of a campaign's results by name, the one to run next first."""
    store = Store(folder)
    known = {
        "proposed": store.proposed,
        "next": store.schedule(store.next_design),
        "own": store.schedule(store.own_design),
        "design": store.schedule(store.design),
        "free_form": store.schedule(store.free_design),
    }
    others = {path.stem.removesuffix("_schedule"): path for path in sorted(store.results.glob("*_schedule.csv"))}
    return {name: path for name, path in {**known, **others}.items() if path.is_file()}


def read_about(path: Path, remedy: str) -> dict[str, Any]:
    """Read the JSON beside a schedule.

    Raises:
        InputError: it is missing or damaged.
    """
    try:
        content = json.loads(read_bytes(path.with_suffix(".json")))
        if not isinstance(content, dict):
            raise TypeError("no table")
        return content
    except (OSError, InputError, ValueError, TypeError, RecursionError) as cause:
        raise damaged_about(path, cause, remedy) from cause


def damaged_about(path: Path, cause: Exception, remedy: str) -> InputError:
    """Return the error of a damaged JSON beside a schedule."""
    return InputError(
        str(path.with_suffix(".json")),
        found=f"no schedule ({type(cause).__name__}: {cause})",
        expected="a schedule by `seatrial design`, with its CSV",
        remedy=remedy,
    )
