"""Frame of the conformance laboratory: an exported vehicle in the target's own code, beside our simulation of what the export keeps.

    thrust step | turn | heave | roll release:  largest |target - kept| of each channel over 60 s, or over the span that means something

What the export keeps is `Exporter.carries`; what it loses is stated by the export itself, and stands beside the difference. A driver of
a target (`gz.py`, `stonefish.py`, ...) builds a `Twin` from the exported files and calls `run`. `python release/simulators/laboratory.py`
prints the table of all results, and with `--write` keeps its numbers in docs/dev/exports.json and puts it into docs/dev/exports.md. None of
it runs in CI: the targets' sources stay outside.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.signals import RATES, signal_unit
from seatrial.export.manoeuvre import STILL, Controls, Current, plan_for, simulate
from seatrial.export.motion import motion_of
from seatrial.export.target import Carried, Exporter
from seatrial.export.vehicle import ExportedVehicle
from seatrial.export.write import of_catalogue
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.thrusters import allocation

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
import study_numbers  # pyright: ignore[reportMissingImports]

VEHICLES = (
    "remus100_hall_anstee",
    "remus100_prestero",
    "bluerov2_heavy",
    "remus100_fossen",
    "remus100_surge",
    "remus100_longitudinal",
    "mariner",
)
"""Vehicles that are tried in every target; those that its exporter refuses are listed with its reason."""
CHANNELS = (*RATES, "phi", "theta")
DURATION, SAMPLE, STEP = 60.0, 0.1, 0.02
"""Of each scenario, between two compared rows, and of our own simulation, s."""
EXACT = 0.02
"""Share of a channel's range within which a target has to follow what its export keeps: steps of time take that much."""
FLOOR = 1e-3
"""Difference, m/s, rad/s and rad, below which nothing is said."""
ABEAM: Current = (0.0, 0.36, 0.0)
"""Current of the scenario in one, m/s north, east, down."""
RESULTS = Path(__file__).parent / "results"
COMMAND = "python release/simulators/laboratory.py --write"
NO_EXPORT = "MSS (Octave)"
"""Target that only has the same vehicles."""
_TILT, _START, _END = np.radians(10.0), 1.0, 25.0
"""Angle of the roll release, and when controls change and change back, s."""
_STEPS = {"n": 0.2, "delta_r": np.radians(4.0), "delta_s": np.radians(2.0)}
"""Of the propeller as a share of what holds the speed; of the fins in radians."""
_FORCES = {"thrust step": (0, 10.0), "turn": (5, 2.0), "heave": (2, 5.0)}
"""Axis and force of an open frame, N and N m."""
_SEED, _GROWN = 1e-7, 300.0
"""A disturbance of the start, and its growth at which the comparison ends: beyond it the target's rounding is what is seen."""
_NUDGE = {"n": 0.05, "delta_r": np.radians(1.0), "delta_s": np.radians(1.0), "f": 2.0}
_NUDGED, _RESPONDING = 1.0, 0.3
"""Seconds of a sign test; share of the largest response above which a channel counts as responding."""

State = Float[np.ndarray, " 8"]
History = Float[np.ndarray, "n 8"]


class Twin(Protocol):
    """One vehicle in one target, built from the exported files.

    Attributes:
        target: name of the target.
        version: of what ran: release or commit.
    """

    target: str
    version: str

    def run(self, start: State, controls: Controls, duration: float) -> History:
        """Run freely from a state (CHANNELS, SI, forward-starboard-down) and return it every SAMPLE s, the start first.

        `controls` gives our commands (SI, our signs) at a time; NaN from where the target runs away.
        """
        ...


@dataclass(frozen=True)
class Subject:
    """A vehicle, what a target keeps of it, and the controls that it has.

    Attributes:
        label: name in the catalogue.
        vehicle: as published.
        carried: what the target's exporter says it keeps.
    """

    label: str
    vehicle: ExportedVehicle
    carried: Carried


@dataclass(frozen=True)
class Scenario:
    """A start and controls by time; `words` say what happens; velocities are through the water of a current, m/s north, east, down."""

    name: str
    start: State
    controls: Controls
    words: str
    current: Current = STILL


@dataclass(frozen=True)
class Row:
    """One channel of one scenario.

    Attributes:
        span: s that were compared.
        largest: difference between the target and what the export keeps.
        range: of the channel in what the export keeps.
        stated: largest difference between the vehicle and what the export keeps, over the same span: the loss that is stated.
        allowed: difference up to which the export's statement holds.
        note: why the span ends early, or nothing.
    """

    target: str
    version: str
    vehicle: str
    scenario: str
    channel: str
    unit: str
    span: float
    largest: float
    range: float
    stated: float
    allowed: float
    note: str = ""

    @property
    def inside(self) -> bool:
        """Whether the difference is within what the export states."""
        return self.largest <= self.allowed


@dataclass(frozen=True)
class SignRow:
    """Response of one channel to a nudge of one control, ours and the target's."""

    target: str
    vehicle: str
    control: str
    channel: str
    ours: float
    theirs: float

    @property
    def same(self) -> bool:
        """Whether both move the same way."""
        return bool(np.isfinite(self.theirs)) and self.ours * self.theirs > 0


@dataclass
class Results:
    """What one command found.

    Attributes:
        command: that finds it again.
        commit: of the code that found it.
        left_out: vehicles and scenarios that were not compared, with the reason.
    """

    command: str
    commit: str
    rows: list[Row] = field(default_factory=list)
    signs: list[SignRow] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    @property
    def failures(self) -> int:
        """Rows outside their statement, and responses of the wrong sign."""
        return sum(not row.inside for row in self.rows) + sum(not sign.same for sign in self.signs)


def run(
    name: str,
    exporter: Exporter,
    build: Callable[[ExportedVehicle], Twin],
    command: str,
    vehicles: Sequence[str] = VEHICLES,
    in_current: Callable[[ExportedVehicle, Current], Twin] | None = None,
) -> int:
    """Compare every vehicle that the exporter takes, print and store the results; returns the number of failures.

    Args:
        name: of the file of results.
        exporter: of the target.
        build: twin of a vehicle, from the files that the exporter writes of it.
        command: that is printed in the table.
        vehicles: names of the catalogue.
        in_current: twin of a vehicle in a current, for a target that has one.
    """
    found = Results(command, study_numbers.commit())
    for label in vehicles:
        try:
            subject = subject_of(label, exporter)
        except InputError as error:
            found.left_out.append(f"{label}: {error.found}")
            print(f"-- {label}: refused: {error.found}", flush=True)
            continue
        add_vehicle(found, subject, build(subject.vehicle))
        if in_current is not None:
            scenario = scenario_in_current(subject.vehicle)
            rows = compare(subject, in_current(subject.vehicle, scenario.current), scenario)
            found.rows += rows
            print_rows(rows)
    store(name, found)
    return found.failures


def subject_of(label: str, exporter: Exporter) -> Subject:
    """A vehicle of the catalogue and what an exporter keeps of it.

    Raises:
        InputError: the exporter refuses it.
    """
    vehicle, _ = of_catalogue(label)
    exporter.check(vehicle)
    return Subject(label, vehicle, exporter.carries(vehicle))


def add_vehicle(found: Results, subject: Subject, twin: Twin) -> None:
    """Run all scenarios and the sign test of one vehicle, add them to the results and print them."""
    scenarios, absent = scenarios_of(subject.vehicle)
    found.left_out += [f"{subject.label}: {line}" for line in absent]
    for line in absent:
        print(f"-- {subject.label}: {line}", flush=True)
    for scenario in scenarios:
        rows = compare(subject, twin, scenario)
        found.rows += rows
        print_rows(rows)
    signs = sign_test(subject, twin)
    found.signs += signs
    print_signs(signs)


def scenarios_of(vehicle: ExportedVehicle) -> tuple[list[Scenario], list[str]]:
    """The scenarios that a vehicle can do, and in words those that it cannot."""
    names, moves = vehicle.controls, vehicle.moves
    speed, hold = _steady(vehicle)
    start = np.zeros(8)
    start[0] = speed
    found, absent = [], []
    for name, control in (("thrust step", "n"), ("turn", "delta_r"), ("heave", "delta_s")):
        change = _change(vehicle, name, control, hold)
        if change is None:
            absent.append(f"{name} left out: the vehicle has no {control}")
            continue
        words = f"{speed:.2f} m/s ahead, {_words(change)} from {_START:g} to {_END:g} s"
        found.append(Scenario(name, start, _pulse(hold, change, _START, _END), words))
    if "p" in moves:
        tilted = start.copy()
        tilted[CHANNELS.index("phi")] = _TILT
        words = f"{speed:.2f} m/s ahead, released at {np.degrees(_TILT):.0f} deg of roll"
        found.append(Scenario("roll release", tilted, lambda t: hold, words))
    else:
        absent.append("roll release left out: the vehicle does not roll")
    assert set(hold) == set(names)
    return found, absent


def scenario_in_current(vehicle: ExportedVehicle) -> Scenario:
    """Ahead and turning, in a current from abeam."""
    speed, hold = _steady(vehicle)
    start = np.zeros(8)
    start[0] = speed
    parts = [_change(vehicle, name, control, hold) for name, control in (("thrust step", "n"), ("turn", "delta_r"))]
    change: dict[str, float] = {}
    for part in parts:
        change = {key: change.get(key, 0.0) + (part or {}).get(key, 0.0) for key in {*change, *(part or {})}}
    words = f"{speed:.2f} m/s ahead, {_words(change)} from {_START:g} to {_END:g} s, {ABEAM[1]:g} m/s of current to the east"
    return Scenario("turn in a current", start, _pulse(hold, change, _START, _END), words, ABEAM)


def compare(subject: Subject, twin: Twin, scenario: Scenario) -> list[Row]:
    """Run a scenario in the target and beside it; a row for each channel."""
    span, note = meaningful_span(subject.carried.motion, subject.carried.actuators, scenario)
    theirs = twin.run(scenario.start, scenario.controls, span)
    kept = _ours(subject.carried.motion, subject.carried.actuators, scenario, span)
    own = _ours(motion_of(subject.vehicle), subject.vehicle.actuators, scenario, span)
    return rows_of(twin.target, twin.version, subject.label, scenario.name, (theirs, kept, own), span, note)


def rows_of(
    target: str,
    version: str,
    vehicle: str,
    scenario: str,
    histories: tuple[History, History, History],
    span: float,
    note: str = "",
) -> list[Row]:
    """Rows of (target's, what the export keeps, the vehicle's own) histories that were sampled at the same times."""
    theirs, kept, own = histories
    if theirs.shape != kept.shape:
        raise ValueError(f"{target}, {vehicle}, {scenario}: {theirs.shape} samples where {kept.shape} were expected")
    found = []
    for i, channel in enumerate(CHANNELS):
        reach = float(np.ptp(kept[:, i]))
        largest, stated = _largest(theirs[:, i], kept[:, i]), _largest(own[:, i], kept[:, i])
        allowed = max(EXACT * reach, FLOOR)
        unit = signal_unit(channel)
        found.append(
            Row(target, version, vehicle, scenario, channel, unit, span, largest, reach, stated, allowed, note)
        )
    return found


def meaningful_span(
    motion: Callable[..., Any], actuators: Mapping[str, Actuator], scenario: Scenario
) -> tuple[float, str]:
    """Seconds over which a comparison says something of the target, and why they end before DURATION.

    A vehicle that is unstable without control magnifies the rounding of any integrator: the span ends where a disturbance of the start
    has grown 300 times.
    """
    kept = _ours(motion, actuators, scenario, DURATION)
    moved = _ours(motion, actuators, replace(scenario, start=scenario.start + _SEED), DURATION)
    apart = np.abs(moved - kept).max(axis=1)
    grown = np.flatnonzero(~(apart < _GROWN * _SEED))
    if grown.size == 0:
        return DURATION, ""
    span = SAMPLE * max(1, int(grown[0]) - 1)
    return span, f"{span:.1f} s: unstable, a disturbance has grown {_GROWN:g} times by then"


def sign_test(subject: Subject, twin: Twin) -> list[SignRow]:
    """Nudge every control, free-running, and compare the sign of each responding motion of the target with ours."""
    speed, hold = _steady(subject.vehicle)
    start = np.zeros(8)
    start[0] = speed

    def response(run_one: Callable[[State, Controls, float], History], change: dict[str, float]) -> State:
        pushed = run_one(start, _pulse(hold, change, 0.0, np.inf), _NUDGED)[-1]
        return pushed - run_one(start, lambda t: hold, _NUDGED)[-1]

    def ours_run(start: State, controls: Controls, duration: float) -> History:
        return _run(subject.carried.motion, subject.carried.actuators, controls, start, duration)

    found = []
    for control in subject.vehicle.controls:
        nudge = _NUDGE[control.split("_")[0] if control.startswith(("n_", "f_")) else control]
        change = {control: nudge * hold[control] if control.startswith("n") and hold[control] else nudge}
        ours = response(ours_run, change)[:6]
        if not np.abs(ours).max() > 0:
            continue
        theirs = response(twin.run, change)[:6]
        responding = np.flatnonzero(np.abs(ours) >= _RESPONDING * np.abs(ours).max())
        found += [
            SignRow(twin.target, subject.label, control, CHANNELS[i], float(ours[i]), float(theirs[i]))
            for i in responding
        ]
    return found


def print_rows(rows: Sequence[Row]) -> None:
    """Print the channels of one scenario."""
    head = rows[0]
    print(f"{head.target} | {head.vehicle} | {head.scenario} | {head.span:g} s {head.note}")
    for row in rows:
        verdict = "inside" if row.inside else "OUTSIDE"
        print(
            f"   {row.channel:6s} differs {row.largest:9.2e} {row.unit:6s} of {row.range:9.2e}; stated loss {row.stated:9.2e}; {verdict}"
        )
    sys.stdout.flush()


def print_signs(signs: Sequence[SignRow]) -> None:
    """Print the sign test."""
    for row in signs:
        verdict = "same sign" if row.same else "WRONG SIGN"
        print(
            f"   {row.control:8s} {row.channel:3s} ours {row.ours:+.2e} theirs {row.theirs:+.2e} {verdict}", flush=True
        )


def store(name: str, found: Results) -> None:
    """Write the results of one target as JSON."""
    RESULTS.mkdir(exist_ok=True)
    content = {
        "command": found.command,
        "commit": found.commit,
        "left_out": found.left_out,
        "rows": [_rounded(asdict(row)) for row in found.rows],
        "signs": [_rounded(asdict(row)) for row in found.signs],
    }
    (RESULTS / f"{name}.json").write_text(line_by_line(content), encoding="utf-8")


def line_by_line(content: Mapping[str, Any]) -> str:
    """Return JSON with every element of a list on a line of its own."""
    parts = []
    for key, value in content.items():
        written = json.dumps(value, allow_nan=False)
        if isinstance(value, list | tuple) and value:
            written = "[\n  " + ",\n  ".join(json.dumps(one, allow_nan=False) for one in value) + "\n ]"
        parts.append(f" {json.dumps(key)}: {written}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def load(path: Path) -> Results:
    """Read the results of one target."""
    content = json.loads(path.read_text(encoding="utf-8"))
    rows, signs = (
        [kind(**{key: np.inf if value is None else value for key, value in row.items()}) for row in content[part]]
        for kind, part in ((Row, "rows"), (SignRow, "signs"))
    )
    return Results(content["command"], content["commit"], rows, signs, content["left_out"])


def numbers_of(results: Sequence[Results]) -> dict[str, Any]:
    """Return a row for each vehicle in each target, and how many exported vehicles are inside their statement, by target and of all."""
    rows = []
    for found in results:
        for target, version, vehicle in dict.fromkeys((row.target, row.version, row.vehicle) for row in found.rows):
            own = [row for row in found.rows if (row.target, row.vehicle) == (target, vehicle)]
            signs = [row.same for row in found.signs if (row.target, row.vehicle) == (target, vehicle)]
            rows.append(
                {
                    "target": target,
                    "version": version,
                    "commit": found.commit,
                    "vehicle": vehicle,
                    "spans, s": {row.scenario: row.span for row in own},
                    "largest": {row.channel: [row.largest, row.range] for row in _largest_rows(own)},
                    "signs": [sum(signs), len(signs)],
                    "inside": all(row.inside for row in own) and all(signs),
                }
            )
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        for name in (row["target"], "all") if row["target"] != NO_EXPORT else ():
            one = counts.setdefault(name, {"vehicles": 0, "inside": 0})
            one["vehicles"] += 1
            one["inside"] += row["inside"]
    return {"counts": counts, "rows": rows}


def tables(numbers: Mapping[str, Any]) -> str:
    """The table of docs/dev/exports.md."""
    lines = [
        "| target | vehicle | scenarios | largest difference from what the export keeps | signs | inside the statement |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in numbers["rows"]:
        spans = ", ".join(f"{name} {span:.3g} s" for name, span in row["spans, s"].items())
        largest = ", ".join(
            f"{channel} {one:.1e} of {reach:.2g} {signal_unit(channel)}"
            for channel, (one, reach) in row["largest"].items()
        )
        same, asked = row["signs"]
        cells = [f"{row['target']} {row['version']}", row["vehicle"], spans, largest, f"{same} of {asked}"]
        lines.append(f"| {' | '.join(cells)} | {'yes' if row['inside'] else 'no'} |")
    return "\n".join([*lines, ""])


def all_results() -> list[Results]:
    """The stored results of every target, by name."""
    return [load(path) for path in sorted(RESULTS.glob("*.json"))]


def _steady(vehicle: ExportedVehicle) -> tuple[float, dict[str, float]]:
    """Speed ahead at which scenarios begin, and the controls that hold it."""
    plan = plan_for(vehicle, motion_of(vehicle))
    return plan.speed, {name: float(value) for name, value in plan.controls(0.0).items()}


def _change(
    vehicle: ExportedVehicle, scenario: str, control: str, hold: Mapping[str, float]
) -> dict[str, float] | None:
    """What a scenario adds to the controls; None where the vehicle has no such control."""
    if vehicle.thrusters and vehicle.controls[-1].startswith("f_"):
        axis, force = _FORCES[scenario]
        wanted = np.zeros(6)
        wanted[axis] = force
        matrix = allocation(vehicle.thrusters)
        found = np.linalg.pinv(matrix) @ wanted
        assert np.allclose(matrix @ found, wanted), f"no thrusts make {scenario}"
        return {f"f_{number}": float(part) for number, part in enumerate(found, 1)}
    if control not in hold:
        return None
    return {control: _STEPS[control] * (hold[control] if control == "n" else 1.0)}


def _pulse(hold: Mapping[str, float], change: Mapping[str, float], start: float, end: float) -> Controls:
    """Controls that are changed from a start to an end."""
    changed = {name: value + change.get(name, 0.0) for name, value in hold.items()}
    return lambda t: changed if start - 1e-9 <= t < end - 1e-9 else hold


def _words(change: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:+.3g} {signal_unit(name)}" for name, value in change.items() if abs(value) > 1e-9)


def _ours(motion: Callable[..., Any], actuators: Mapping[str, Actuator], scenario: Scenario, span: float) -> History:
    return _run(motion, actuators, scenario.controls, scenario.start, span, scenario.current)


def _run(
    motion: Callable[..., Any],
    actuators: Mapping[str, Actuator],
    controls: Controls,
    start: State,
    duration: float,
    current: Current = STILL,
) -> History:
    """Our simulation, every SAMPLE s."""
    return simulate(motion, actuators, controls, start, duration, STEP, current)[:: round(SAMPLE / STEP)]


def _largest(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"]) -> float:
    """Largest difference, infinite where one of them runs away."""
    apart = np.abs(one - other)
    return float(apart.max()) if np.isfinite(apart).all() else float("inf")


def _largest_rows(rows: Sequence[Row]) -> list[Row]:
    """Rows of the velocity and the angle that differ most by their range, of those that move."""
    found = []
    for channels in (("u", "v", "w"), ("p", "q", "r"), ("phi", "theta")):
        moving = [row for row in rows if row.channel in channels and row.range > FLOOR]
        if moving:
            found.append(max(moving, key=lambda row: row.largest / row.range))
    return found


def _rounded(row: dict[str, Any]) -> dict[str, Any]:
    """A row with three digits a number, and null for what is infinite."""
    found = {}
    for key, value in row.items():
        if isinstance(value, float):
            value = float(f"{value:.3g}") if np.isfinite(value) else None
        found[key] = value
    return found


if __name__ == "__main__":
    numbers = numbers_of(all_results())
    print(tables(numbers), end="")
    if "--write" in sys.argv:
        study_numbers.keep("exports", numbers)
        study_numbers.show("exports", tables(numbers), COMMAND)
