"""The campaign file of a vehicle, published or one's own: of a log of it, whose columns are mapped, or before there is any."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.campaign.config.templates import template_text
from seatrial.campaign.config.toml_edit import Key, with_values
from seatrial.core.coefficients import CoefficientName
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.signals import ANGLES, OVER_EARTH, POSITIONS, PROPULSION, QUATERNION, RATES, thruster_controls
from seatrial.core.usual_priors import USUAL_SHARE
from seatrial.logs.guess import COMMAND, best
from seatrial.logs.inspect import LogSummary, inspect_log
from seatrial.vehicles.catalogue import PublishedVehicle, load_surge, load_vehicle, surge_names
from seatrial.vehicles.thrusters import controls_of

# What is believed of a sensor before anything is known of it; up to five times as much is found by the fit.
_NOISE = {
    **dict.fromkeys("uvw", "0.02 m/s"),
    **dict.fromkeys("pqr", "0.5 deg/s"),
    **dict.fromkeys((*ANGLES, "attitude"), "1 deg"),
    **dict.fromkeys("xy", "0.05 m"),
    "z": "0.02 m",
}
# Of a next trial, by the first letter of the control.
_AMPLITUDES = {"f": ("5 N", "20 N"), "n": ("50 rpm", "200 rpm"), "d": ("2 deg", "10 deg"), "t": ("5 N", "20 N")}
# First line of a campaign file, by which editors with Taplo find what `seatrial schema` prints.
SCHEMA_LINE = "#:schema campaign.schema.json"
_FINEST, _COARSEST = 0.02, 0.2  # Steps of a record, s
# In the template of a log, if a force is commanded and no speed of a propeller.
_OF_FORCE = (
    ('n = "1000 rpm"', 'tau_X = "0 N"'),
    ("thrust_deduction = 0.1\n", ""),
    ('"T_nabsn"', '"X_tau_X"'),
    ("# `unit` converts: thrust of a propeller is easier to state per revolution.\n[prior.T_nabsn]", "[prior.X_tau_X]"),
    ("[limits.n]", "[limits.tau_X]"),
    ('control = "n"', 'control = "tau_X"'),
    ('from = "50 rpm", to = "300 rpm"', 'from = "5 N", to = "20 N"'),
)
_LAW = """# Thrust of a command in N, by powers of the pulse width less neutral: a guess, about a common thruster of small ROVs at 16 V.
# Replace polynomial, neutral, dead_zone and reverse by the maker's table: curve = "thrust.csv".
# It has two columns with a header, the command and the thrust in N.
# A reversed propeller has a falling curve: give it a separate law.
[vehicle.thrust_laws.all]
polynomial = [0.0, 0.081, 0.0, 2.9e-7]
neutral = 1500
dead_zone = [1475, 1525]
reverse = 0.8
lag = "0.1 s\""""
_BELIEVED = """[prior.gain_f]                  # of all thrusters: the actual thrust divided by that of the law
distribution = "log-normal"
median = 1.0
factor = 1.3

[prior.lag_f]
distribution = "log-normal"
median = 0.1
factor = 2.0"""
_TRIM = {
    "w": """[prior.net_weight]              # weight minus buoyancy, N
distribution = "normal"
mean = 0.0
sd = 5.0""",
    "pq": """[prior.z_b]                     # height of the centre of buoyancy: -z_b is the metacentric height, m
distribution = "normal"
mean = -0.01
sd = 0.01""",
}


def vehicle_campaign_text(folder: Path, vehicle: str = "", log: Path | None = None, named: str = "") -> str:
    """Return the campaign file of a vehicle, commented: of a log of it, or before there is any.

    Args:
        folder: of the campaign, which need not be there yet.
        vehicle: name in the catalogue; empty for a vehicle of one's own, whose numbers are those of a template.
        log: of a trial; the file names it relative to its folder, so that both can be moved together.
        named: path of the log from the folder, if it will lie elsewhere than now.

    Raises:
        InputError: a vehicle without named coefficients, or of surge alone with a log; a log that cannot be read, or one in which no
            control or nothing that a published vehicle does can be told.
    """
    if log is None:
        return _before_any_log(vehicle) if vehicle else template_text("design")
    if not vehicle:
        return _of_own_log(inspect_log(log.resolve()), named or _named(folder, log))
    if vehicle in surge_names():
        raise InputError(
            f"--vehicle {vehicle}",
            found="a vehicle that moves in surge only",
            expected="a whole vehicle, whose axes are those that the log shows",
            remedy="leave --vehicle out: the campaign is then that of your own vehicle in surge",
        )
    body, summary = load_vehicle(vehicle), inspect_log(log.resolve())
    controls = _controls(body, summary)
    sensors = _sensors(summary, body.moves)
    if body.thrusters and not controls:
        _say_too_few(vehicle, body, summary, log)
    if missing := [what for what, names in (("control", controls), ("sensor", sensors)) if not names]:
        raise InputError(
            str(log),
            found="no column that may be a " + " nor a ".join(missing),
            expected=f"one of {', '.join(body.controls)}, and a speed, rate, angle or position",
            remedy="`seatrial inspect` lists the columns of the log; map them in a campaign file by hand",
        )
    positions = [axis for axis in POSITIONS if axis in sensors]
    commanded = any(guess.unit == COMMAND for guess in best(summary.guesses, controls))
    mapped = [*controls, *(name for name in sensors if name != "attitude"), *(ANGLES if "attitude" in sensors else ())]
    parts = [
        file_head(
            f"{vehicle}, {log.stem}",
            f"from the log {log.name}: check the map at the end, the thrust, and the noise of the sensors",
            "seatrial import DIR; seatrial check DIR; seatrial estimate DIR --by mode. `seatrial inspect LOG` lists its columns",
        ),
        _vehicle(vehicle, positions),
        *([_LAW] if commanded else []),
        "[structure]\nalways = " + json.dumps(list(body.terms(body.moves))),
        *([_BELIEVED] if commanded else []),
        *(text for axis, text in _TRIM.items() if body.thrusters and set(axis) & {*body.moves}),
        sensor_lines(sensors),
        '# The log determines the initial state.\n[estimation]\ninitial = "estimated"',
        _next_trial(controls[0]),
        f'[import]\nfit = ["1"]\nstep = "{_step(summary, controls)} s"',
        summary.as_toml(mapped, named or _named(folder, log)).rstrip("\n"),
    ]
    return "\n\n".join(parts) + "\n"


def _of_own_log(summary: LogSummary, named: str) -> str:
    """Return the template of a log with the map of a log; its trim and the limits of the control are those that the log shows."""
    guessed = {one.channel: one for one in best(summary.guesses, ("u", *PROPULSION))}
    control = next((one for one in PROPULSION if one in guessed), PROPULSION[0])
    columns = {(table.info.name, one.name): one for table in summary.tables for one in table.columns}

    def shown(channel: str, number: str) -> str:
        one = guessed[channel]
        return f"{one.scale * getattr(columns[one.table, one.column], number):.4g} {one.unit}"

    head = template_text("log").partition("[[import.files]]")[0]
    values: dict[Key, Any] = {("vehicle", "trim", one): shown(one, "mean") for one in guessed if one in ("u", control)}
    if control != PROPULSION[0]:
        for old, new in _OF_FORCE:
            head = head.replace(old, new)
        values[("prior", f"X_{control}")] = {"distribution": "normal", "mean": 1.0, "sd": 0.3}
    if control in guessed:
        ends = sorted((shown(control, end) for end in ("least", "greatest")), key=lambda end: float(end.split()[0]))
        values |= {("limits", control, key): end for key, end in zip(("lower", "upper"), ends, strict=True)}
    return with_values(head, values) + summary.as_toml(("u", control), named)


def _before_any_log(vehicle: str) -> str:
    """Return the campaign file of a vehicle of which nothing was recorded: the trial begins at rest unless a trim is published."""
    if vehicle in surge_names():
        entry = load_surge(vehicle)
        terms, controls, axes, trim = tuple(entry.coefficients), ("n",), ("u",), {}
    else:
        body = load_vehicle(vehicle)
        axes, terms = body.moves, body.terms(body.moves)
        named = [CoefficientName.parse(term) for term in terms]
        controls = controls_of(body.thrusters, named, axes) if body.thrusters else body.controls
        at_rest = {"u": "0 m/s"} | {one: f"0 {shown_unit(one)[1]}" for one in controls}
        trim = {one: value for one, value in at_rest.items() if one not in body.hull.trim}
        if not terms:
            raise InputError(
                f"--vehicle {vehicle}",
                found="a vehicle with forces that are no sum of named coefficients",
                expected="a vehicle with coefficients to estimate",
                remedy="choose another one: `seatrial vehicle` lists them",
            )
    sensors = [axis for axis in axes if axis not in "w"] + ["z"] * ("w" in axes)
    angles = [angle for angle, rate in zip(ANGLES, "pqr", strict=True) if rate in axes]
    sensors += ["attitude"] if len(angles) == len(ANGLES) else angles
    return (
        "\n\n".join(
            (
                file_head(
                    f"{vehicle}, first trial",
                    "without data: check the trim, the noise of the sensors and the trial",
                    "seatrial prior DIR; seatrial design DIR. A trial begins at the trim; limits are under [limits.NAME]",
                ),
                _vehicle(vehicle, ["z"] * ("z" in sensors), trim),
                "[structure]\nalways = " + json.dumps(list(terms)),
                sensor_lines(sensors),
                '# The log determines the initial state.\n[estimation]\ninitial = "estimated"',
                _next_trial(controls[0]),
            )
        )
        + "\n"
    )


def _named(folder: Path, log: Path) -> str:
    """Return the path of a log from the campaign's folder; absolute if none leads there, as to another drive."""
    try:
        return Path(os.path.relpath(log.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return log.resolve().as_posix()


def file_head(name: str, subject: str, commands: str) -> str:
    """Return the first lines of a campaign file: its schema, its subject, the commands that follow, and its name."""
    return (
        f"{SCHEMA_LINE}\n# A campaign {subject}.\n# {commands}."
        f"\n\n[campaign]\nname = {json.dumps(name, ensure_ascii=False)}\nseed = 1"
    )


def _vehicle(vehicle: str, positions: list[str], trim: Mapping[str, str] | None = None) -> str:
    stated = ", ".join(f'{name} = "{value}"' for name, value in (trim or {}).items())
    lines = [
        "# Priors are about the published coefficients; published_prior_sd is their sd. `seatrial vehicle NAME` shows the coefficients.",
        "[vehicle]",
        f'catalogue = "{vehicle}"',
        *([f"positions = {json.dumps(positions)}"] if positions else []),
        f'published_prior_sd = "{100 * USUAL_SHARE:.0f} %"',
        *([f"trim = {{ {stated} }}"] if stated else []),
    ]
    return "\n".join(lines)


def _controls(body: PublishedVehicle, summary: LogSummary) -> list[str]:
    """Return the controls of the vehicle that the log shows: all thrusters, or none of them."""
    guessed = {guess.channel for guess in summary.guesses}
    if body.thrusters:
        thrusters = thruster_controls(len(body.thrusters), commanded_force=True)
        return list(thrusters) if len(best(summary.guesses, thrusters)) == len(thrusters) else []
    return [name for name in body.controls if name in guessed]


def _say_too_few(vehicle: str, body: PublishedVehicle, summary: LogSummary, log: Path) -> None:
    """Refuse a log with fewer outputs than the vehicle has thrusters."""
    count = len(body.thrusters)
    thrusters = thruster_controls(count, commanded_force=True)
    guesses = best(summary.guesses, thrusters)
    outputs = ", ".join(f"{guess.column} ({guess.channel})" for guess in guesses)
    raise InputError(
        str(log),
        found=f"{len(guesses)} outputs to thrusters: {outputs}"
        if guesses
        else "no column that may be an output to a thruster",
        expected=f"{count}, one for each thruster of {vehicle}: pulse widths about 1500 us, in columns such as out1 to out{count}",
        remedy="name the columns so, in the order of the thrusters. If the vehicle has others, use --template log, the map of "
        "`seatrial inspect LOG --map`, and describe its thrusters under [[vehicle.thrusters]] (docs/how-to/ros2_bag.md)",
    )


def _sensors(summary: LogSummary, axes: tuple[str, ...]) -> list[str]:
    """Return what is measured of what moves: speeds, rates, the attitude, depth, and the place if there is no speed."""
    guessed = {guess.channel for guess in summary.guesses}
    speeds = [axis for axis in RATES if axis in axes and axis in guessed]
    if {*OVER_EARTH} <= guessed:
        speeds = [axis for axis in RATES if axis in axes and (axis in guessed or axis in "uvw")]
    angles = [angle for angle, rate in zip(ANGLES, "pqr", strict=True) if rate in axes and angle in guessed]
    if set("pqr") <= {*axes} and ({*QUATERNION} <= guessed or len(angles) == len(ANGLES)):
        angles = ["attitude"]
    places = [axis for axis in "xy" if axis in guessed and not set("uv") & {*speeds}]
    return [*speeds, *(["z"] if "z" in guessed and "w" in axes else []), *places, *angles]


def sensor_lines(sensors: list[str]) -> str:
    """Return the table of sensors by channel, with the usual noise of each."""
    lines = ["# Assumed noise of one sample; the fit can find up to five times as much."]
    return "\n".join([*lines, "[sensors]", *(f'{name} = {{ noise = "{_NOISE[name]}" }}' for name in sensors)])


def _next_trial(control: str) -> str:
    low, high = _AMPLITUDES[control[0]]
    return "\n".join(
        (
            "# A trial that `seatrial next` may propose.",
            "[design]",
            f'control = "{control}"',
            'duration = "60 s"',
            'active = "40 s"',
            'sample_time = "0.1 s"',
            f'amplitude = {{ from = "{low}", to = "{high}", points = 3 }}',
            'period = { from = "4 s", to = "12 s", points = 3 }',
        )
    )


def _step(summary: LogSummary, controls: list[str]) -> str:
    """Return the step of the record, s: the usual one of the controls, of one digit and between bounds."""
    tables = {guess.table for guess in best(summary.guesses, controls)}
    rates = [table.clock.rate for table in summary.tables if table.info.name in tables and table.clock]
    return f"{float(np.clip(1 / max(rates), _FINEST, _COARSEST)):.1g}"
