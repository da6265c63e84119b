"""Messages about records: findings of the check of a log, before a fit."""

from collections.abc import Mapping, Sequence
from typing import Any

from seatrial.core.display_units import listed, shown_unit
from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy

UNIT_ERRORS = {
    "knots": "knots taken for m/s",
    "feet": "feet taken for metres",
    "km/h": "km/h taken for m/s",
    "centimetres": "centimetres taken for metres",
    "millimetres": "millimetres taken for metres",
    "degrees": "degrees taken for radians",
    "revolutions": "revolutions taken for radians",
    "rpm": "rpm taken for rad/s",
    "rpm for rev/s": "rpm taken for revolutions per second",
    "kgf": "kilograms-force taken for newtons",
    "lbf": "pounds-force taken for newtons",
}
"""Confusions of units, each of which may be the reverse."""
_AXES = ("forward", "starboard", "vertical")


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.diagnostics import excitation_checks, feedback_check, motion_checks, record_checks

    files = (record_checks, motion_checks, excitation_checks, feedback_check)
    return {name: value for file in files for name, value in vars(file).items() if isinstance(value, float)}


def quoted(name: str) -> str:
    """Return a name as TOML has it."""
    return f'"{name}"'


def _names_of(code: str, signals: Sequence[str]) -> str:
    return f"the {ENTRIES[code].title.lower()} of {listed(signals)}"


def _not_yet(values: Mapping[str, Any]) -> str:
    wrong: dict[str, list[str]] = {}
    for code, signal in values["wrong"]:
        wrong.setdefault(code, []).append(signal)
    faults = " and ".join(_names_of(code, signals) for code, signals in wrong.items())
    return f"{_names_of(values['check'], values['subject'])} cannot be judged before {faults} is right"


def _unit(values: Mapping[str, Any]) -> str:
    """Ask for the unit errors that explain a size."""
    several = len(values["signals"]) > 1
    guesses = [
        UNIT_ERRORS[error] + (f" in {listed(names, 'or')}" if several else "") for error, names in values["errors"]
    ]
    question = f" ({' or '.join(guesses)}, or the reverse?)" if guesses else ""
    return f"check the unit of {{signals:and}} in the channel map{question}"


def _axes(values: Mapping[str, Any]) -> str:
    rows = []
    for name, row in zip(values["subject"], values["matrix"], strict=True):
        large = [(x, other) for x, other in zip(row, values["subject"], strict=True) if abs(x) > 0.17]
        parts = [f"{x:+.2f} {other}" if abs(x) < 0.98 else f"{'-' if x < 0 else '+'}{other}" for x, other in large]
        rows.append(f"{name} = {' '.join(parts).removeprefix('+')}")
    how = "mirrored" if values["mirrored"] else "turned"
    return (
        f"the axes of {{subject:and}} look {how}: with {', '.join(rows)} measured and expected motion agree by "
        "{best:+.2f}, without that by {plain:+.2f}"
    )


def _mounted(values: Mapping[str, Any]) -> str:
    return ", ".join(f'{name} = "{degrees:.0f} deg"' for name, degrees in values["angles"])


def _shift(values: Mapping[str, Any]) -> str:
    others = "".join(f" or {abs(late):.2g} s {'late' if late > 0 else 'early'}" for late in values["others"])
    repeats = "; the motion repeats and fits each of these shifts" if others else ""
    return f"{{subject:and}} is about {{late:late}} (± {{error:.1g}} s){others} against its command{repeats}"


def _not_clocked(values: Mapping[str, Any]) -> str:
    if not values["ranges"]:
        return "the clock of {subject:and} cannot be judged: no shift up to {longest:g} s explains half of the motion"
    ranges = " and ".join(f"from {a:.2g} s to {b:.2g} s" for a, b in values["ranges"])
    return f"the clock of {{subject:and}} cannot be judged: the motion fits every shift {ranges} late"


def _uncommanded(values: Mapping[str, Any]) -> str:
    mirrored = values.get("mirrored", ())
    order = f"check the order of the thruster columns {listed(mirrored)} (port and starboard swapped?), then " * bool(
        mirrored
    )
    return f"{order}set scale = -1 for {{subject:and}} or its command in the channel map, or check the axes (east-north-up?)"


def _unlike_trim(values: Mapping[str, Any]) -> str:
    how = {"median": "is", "controls": "with the controls at trim is", "coefficients": "by the coefficients at trim is"}
    return f"{{subject:and}} {how[values['by']]} about {{size:signal}}, but the stated trim is {{trim:signal}}"


def _remaining(values: Mapping[str, Any]) -> str:
    about = " (at a fit of the measured motion)" if values["about"] == "fit" else ""
    return "{subject:and} is not excited by this record: {remaining:.0%} of the prior's sd would remain" + about


def _constant(values: Mapping[str, Any]) -> str:
    factor, unit = shown_unit(values["subject"][0])
    return f"{{subject:and}} is {values['value'] * factor:g} {unit} in every sample, so it excites nothing"


ENTRIES = {
    "direction-reversed": Entry(
        title="Direction",
        sentence={
            "alarm": "{subject:and} moves against the expected motion (correlation {correlation:+.2f})",
            "pass": "direction",
        },
        meaning="The vehicle at the prior means, driven by the commands of the record, moves the other way. A sign in the channel map "
        "is reversed, or the axes differ.",
        decided="Correlation with the expected motion below {OPPOSED:g} at the best lag. It needs priors that agree in direction "
        "({AGREED:.0%} of the vehicles drawn from them).",
        example=Finding("direction-reversed", "alarm", ("r",), {"correlation": -0.93, "late": 10.0}, ("reverse-sign",)),
        remedies=("reverse-sign", "shift-clock"),
    ),
    "motion-unrelated": Entry(
        title="Direction",
        sentence="{subject:and} hardly follows the commands (correlation {correlation:+.2f} with the expected motion)",
        meaning="The measured motion does not come from these commands, or the priors are far from the vehicle.",
        decided="Correlation with the expected motion below {RELATED:g}, but not below {OPPOSED:g}.",
        example=Finding("motion-unrelated", "caution", ("u",), {"correlation": 0.12}, ("check-map-and-clocks",)),
    ),
    "motion-diverges": Entry(
        title="Motion",
        sentence="the vehicle at the prior means diverges over this record, so its motion cannot be judged",
        meaning="Direction, size and timing are compared with a simulation at the prior means, which must stay finite.",
        decided="The simulation with the commands of the record is not finite.",
        example=Finding("motion-diverges", "caution", ("motion",), {}, ("tame-priors",)),
    ),
    "direction-not-judged": Entry(
        title="Direction",
        sentence="direction, size and timing of {subject:and} are not judged: vehicles drawn from the priors go in both directions "
        "or diverge",
        meaning="The check cannot detect a wrong sign of this channel.",
        decided="Fewer than {AGREED:.0%} of the vehicles drawn from the priors move in one direction.",
        example=Finding("direction-not-judged", "note", ("r",), {}, ("signed-priors",)),
    ),
    "sum-not-judged": Entry(
        title="Direction",
        sentence="direction, size and timing of {subject:and} are not judged: it accumulates errors of velocities, and the priors "
        "allow this motion",
        meaning="Positions and angles drift with small errors of velocities; the velocities are judged instead.",
        decided="A vehicle drawn from the priors moves as the record does, or these vehicles differ by as much as the "
        "record moves.",
        example=Finding("sum-not-judged", "note", ("z",)),
    ),
    "size-unlike": Entry(
        title="Size",
        sentence={
            "caution": "{subject:and} moves {ratio:.3g} times as far as expected",
            "alarm": "{subject:and} moves {ratio:.3g} times as far as expected",
            "pass": "size",
        },
        meaning="A unit is probably wrong, or the priors are far from the vehicle.",
        decided="A caution from {SIZE:g} times and an alarm from {WRONG:g} times the expected motion, or their inverses. It needs "
        "that at most {RARE:.0%} of the vehicles drawn from the priors reach the motion.",
        example=Finding(
            "size-unlike",
            "alarm",
            ("r",),
            {"ratio": 57.3, "signals": ("r",), "errors": (("degrees", ("r",)),)},
            ("check-unit",),
        ),
        remedies=("check-unit", "see-trim"),
    ),
    "clock-shift": Entry(
        title="Timing",
        sentence={"caution": _shift, "pass": "timing (within {within:g} s)"},
        meaning="Command and response are not on one clock, or the delay of the vehicle is not modelled. Damping and added mass are "
        "biased by it.",
        decided="Reported from {LATE:g} s if no vehicle of the priors explains the motion without a shift.",
        example=Finding(
            "clock-shift",
            "caution",
            ("u",),
            {"late": -7.2, "error": 0.4, "others": (), "file": "dvl.csv", "upper": 0.5},
            ("correct-shift",),
        ),
        remedies=("correct-shift", "delay-prior", "check-delay-prior", "one-clock", "check-shift"),
    ),
    "clock-not-judged": Entry(
        title="Timing",
        sentence=_not_clocked,
        meaning="This channel and its commands come from two files, whose clocks may differ unnoticed.",
        decided="Judged if shifts of more than {VAGUE:g} s can be excluded.",
        example=Finding(
            "clock-not-judged", "note", ("u",), {"longest": 60.0, "ranges": (), "file": "dvl.csv"}, ("compare-clocks",)
        ),
    ),
    "axes-wrong": Entry(
        title="Axes",
        sentence={"alarm": _axes, "pass": "axes"},
        meaning="The sensor is mounted along other axes, its columns are swapped, or the log has another convention of axes.",
        decided="With the best rotation or mirror of the channels (Kabsch), the agreement with the expected motion is at "
        "least {RELATED:g}. It exceeds that of the channel map by twice {APART:g}.",
        example=Finding(
            "axes-wrong",
            "alarm",
            ("u", "v"),
            {
                "matrix": ((0.0, 1.0), (-1.0, 0.0)),
                "mirrored": False,
                "best": 0.97,
                "plain": 0.02,
                "angles": (("yaw", 90.0),),
            },
            ("mount-or-columns",),
        ),
        remedies=("enu-axes", "mount-or-columns", "left-handed"),
    ),
    "sensor-turned": Entry(
        title="Mounting",
        sentence=lambda values: (
            "the sensor of {subject:and} looks turned by {degrees:.0f} ± {sd:.0f} deg about the "
            f"{_AXES[values['axis']]} axis ({{sds:.1f}} sd)" + " more than its mount states" * values["has_mount"]
        ),
        meaning="A turned sensor mixes its channels, which biases coupled terms.",
        decided="A turn about each axis is fitted to the motion; reported from 5 deg and {MIN_TURN_SDS:g} sd, an"
        " alarm from {ALARM_TURN_SDS:g} sd.",
        example=Finding(
            "sensor-turned",
            "alarm",
            ("u", "v"),
            {
                "degrees": 12.0,
                "sd": 1.5,
                "sds": 8.0,
                "axis": 2,
                "has_mount": False,
                "part": "yaw",
                "mount": "dvl",
                "prior_sd": 3.0,
            },
            ("state-mount",),
        ),
        remedies=("state-mount", "correct-mount"),
    ),
    "gauge-at-limit": Entry(
        title="Range",
        sentence="{share:.0%} of the samples of {subject:and} are {end:.4g}, its {which} value, although the expected force changes",
        meaning="The gauge is at its limit, a rope is slack, or the value is frozen.",
        decided="More than {CUT:.0%} of the samples are at one end of the range, and the expected force changes during them.",
        example=Finding(
            "gauge-at-limit", "alarm", ("force_X",), {"share": 0.12, "end": 50.0, "which": "greatest"}, ("leave-out",)
        ),
    ),
    "limits-exceeded": Entry(
        title="Limits",
        sentence={
            "caution": "{subject:and} reaches {reached:signal}, but limits.{subject[0]}.{end} is {bound:signal}",
            "note": "{subject:and} is at rest outside the limits of designs (limits.{subject[0]}.{end} is {bound:signal})",
        },
        meaning="Designs stay inside the limits. A record outside them has another unit, or the limits are too narrow.",
        decided="{BEYOND:.0%} of its range outside the limit; a note if only the vehicle at rest lies outside.",
        example=Finding(
            "limits-exceeded",
            "caution",
            ("delta_r",),
            {"reached": 0.5, "bound": 0.35, "end": "upper"},
            ("correct-limits",),
        ),
    ),
    "limits-hardly-used": Entry(
        title="Limits",
        sentence="{subject:and} reaches only {reached:signal}, but limits.{subject[0]} go to {bound:signal}",
        meaning="The record hardly moves the control, or its unit is wrong.",
        decided="The record reaches less than a thirtieth of the limits.",
        example=Finding(
            "limits-hardly-used",
            "caution",
            ("delta_r",),
            {"reached": 0.005, "bound": 0.35, "signals": ("delta_r",), "errors": (("degrees", ("delta_r",)),)},
            ("check-unit",),
        ),
    ),
    "angle-too-large": Entry(
        title="Size",
        sentence="{subject:and} reaches {reached:signal}, more than a quarter turn",
        meaning="No rudder or fin turns by such an angle: degrees are read as radians.",
        decided="More than 90 deg.",
        example=Finding(
            "angle-too-large",
            "caution",
            ("delta_r",),
            {"reached": 14.3, "signals": ("delta_r",), "errors": (("degrees", ("delta_r",)),)},
            ("check-unit",),
        ),
    ),
    "trim-contradicted": Entry(
        title="Trim",
        sentence=_unlike_trim,
        meaning="Record and stated trim differ in size or sign. Designs and linear checks start from the trim.",
        decided="A ratio of {UNLIKE:g}, or its inverse.",
        example=Finding(
            "trim-contradicted",
            "caution",
            ("u",),
            {"size": 2.9, "trim": 1.5, "by": "controls", "signals": ("u",), "errors": (("knots", ("u",)),)},
            ("check-unit-or-trim",),
        ),
        remedies=("check-unit-or-trim", "reverse-or-trim"),
    ),
    "outliers": Entry(
        title="Outliers",
        sentence={
            "caution": "{share:.2%} of the samples of {subject:and} are outliers",
            "note": "{share:.2%} of the samples of {subject:and} are outliers, which heavy residuals tolerate",
            "pass": "outliers",
        },
        meaning="Normal errors give outliers a large weight, which biases coefficients and their ±.",
        decided="A sample stands out from both sides by {SPIKE:g} robust standard deviations; reported from {SPIKES:.1%} of the samples.",
        example=Finding("outliers", "caution", ("u",), {"share": 0.013, "sensor": "u"}, ("heavy-residuals",)),
    ),
    "cells-empty": Entry(
        title="Empty cells",
        sentence=lambda values: (
            '{count} of {rows} rows of {source}, column "{column}", are empty or NaN; '
            + ("each holds the value before it" if values["role"] == "control" else "the other rows are used")
        ),
        meaning="Empty cells of a control keep the last command; those of a measurement are not used.",
        decided="Every column is counted.",
        example=Finding(
            "cells-empty",
            "note",
            ("u",),
            {"count": 12, "rows": 900, "source": "log.csv", "column": "speed", "role": "measurement"},
        ),
    ),
    "channel-unused": Entry(
        title="Sensor",
        sentence="{subject:and} is mapped but has no [sensors.{subject[0]}], so it is not used",
        meaning="A velocity in the log would reduce the uncertainty of the coefficients.",
        decided="A channel is used if it has a sensor.",
        example=Finding("channel-unused", "caution", ("v",), {}, ("add-sensor",)),
    ),
    "control-constant": Entry(
        title="Control",
        sentence=_constant,
        meaning="A control that never moves does not determine its coefficients. Often its column is wrong.",
        decided="All samples of a whole real trial are equal.",
        example=Finding("control-constant", "caution", ("delta_r",), {"value": 0.0}, ("check-column",)),
    ),
    "steps-too-coarse": Entry(
        title="Time step",
        sentence=lambda values: (
            "the steps of {step:.2g} s are too long for this vehicle's fastest motion: in steps half as long {subject:and} "
            + ("differs by up to {differs:size} times its noise" if values["differs"] else "does not diverge")
        ),
        meaning="The simulation is not accurate to the noise of the sensor, so that errors of the integration bias the fit.",
        decided="The root mean square change in steps half as long, divided by the noise, exceeds {MAX_STEP_CHANGE:g}.",
        example=Finding(
            "steps-too-coarse", "caution", ("u",), {"step": 0.1, "differs": 1.4, "shorter": 0.025}, ("shorter-step",)
        ),
    ),
    "not-excited": Entry(
        title="Excitation",
        sentence={
            "caution": _remaining,
            "pass": lambda values: "excitation" + " (at a fit of the measured motion)" * (values["about"] == "fit"),
        },
        meaning="The record cannot determine this coefficient: the posterior will be nearly the prior.",
        decided="{MAX_REMAINING:.0%} or more of the prior's standard deviation would remain.",
        example=Finding("not-excited", "caution", ("Y_r",), {"remaining": 0.95, "about": ""}, ("excite-or-fix",)),
    ),
    "rate-not-measured": Entry(
        title="Excitation",
        sentence="this record cannot determine {subject:and}, because no sensor measures {rate}",
        meaning="The coefficients of an axis act on its velocity.",
        decided="{MAX_REMAINING:.0%} or more of the prior's standard deviation would remain, and the velocity has no sensor.",
        example=Finding("rate-not-measured", "caution", ("Y_v", "Y_r"), {"rate": "v"}, ("measure-rate",)),
    ),
    "excitation-not-judged": Entry(
        title="Excitation",
        sentence=lambda values: (
            "excitation is not judged: the motion at the prior means differs from the measured one, and "
            + (
                "a fit of the measured motion diverges"
                if values["fitted"]
                else "too few velocities are measured for a fit"
            )
        ),
        meaning="The check of excitation needs a simulated motion like the measured one.",
        decided="Neither the prior means nor a fit of the measured motion can be simulated.",
        example=Finding("excitation-not-judged", "note", ("all",), {"fitted": True}, ("signed-priors",)),
    ),
    "terms-alike": Entry(
        title="Separate terms",
        sentence="{subject:and} are the same in this record, in which {signals:and} never changes its sign",
        meaning="Two terms that differ only by a sign have the same effect while that sign does not change.",
        decided="The signal stays on one side of zero, to {SIGN:g} standard deviations of its noise.",
        example=Finding("terms-alike", "caution", ("X_uu", "X_uabsu"), {"signals": ("u",)}, ("drop-or-change-sign",)),
    ),
    "closed-loop": Entry(
        title="Closed loop",
        sentence="{subject:and} is computed from {channels:and}: the noise of the sensor is in the command",
        meaning="Disturbances move both the vehicle and the command, which biases coefficients and hides wrong signs and clocks.",
        decided="A linear law of three changes of command and measurement explains {TYPICAL:.0%} of the changes. The "
        "residual lacks the noise that the law passes on.",
        example=Finding("closed-loop", "note", ("tau_X",), {"channels": ("u",)}, ("held-command",)),
    ),
    "not-judged-yet": Entry(
        title="Order",
        sentence=_not_yet,
        meaning="Because of the fault that another check found, this check would report a wrong cause.",
        decided="Another check of the same record fails.",
        example=Finding(
            "not-judged-yet",
            "note",
            ("all",),
            {"check": "not-excited", "wrong": (("direction-reversed", "r"),)},
            ("check-again",),
        ),
    ),
    "axis-not-driven": Entry(
        title="Thrusters",
        sentence="no thruster pushes along or about {subject:and}",
        meaning="Only releases and coasting determine the coefficients of this axis.",
        decided="The row of the allocation matrix is zero; a caution if neither weight nor righting moment moves the axis.",
        example=Finding("axis-not-driven", "caution", ("Y",), {}, ("drop-axis",)),
    ),
    "thruster-reversed": Entry(
        title="Thruster",
        sentence="{subject:and} pushes the wrong way: {gain:.2f} ± {sd:.2f} of its stated thrust",
        meaning="The direction of the thruster, its command or its propeller is reversed, or the columns are in another order.",
        decided="The gain of the thruster, by least squares on the measured motion, is negative by two standard deviations.",
        example=Finding("thruster-reversed", "alarm", ("f_2",), {"gain": -0.97, "sd": 0.05}, ("turn-thruster",)),
    ),
    "thruster-gain": Entry(
        title="Thruster",
        sentence={
            "caution": "{subject:and} gives {gain:.2f} ± {sd:.2f} of its stated thrust by the measurements",
            "pass": "thruster",
        },
        meaning="All coefficients of the axes that it drives scale with the thrust.",
        decided="The gain differs from 1 by {MIN_GAIN_ERROR:g} and two standard deviations.",
        example=Finding("thruster-gain", "caution", ("f_2",), {"gain": 0.31, "sd": 0.06}, ("check-thrust-law",)),
    ),
    "thruster-gain-unknown": Entry(
        title="Thruster",
        sentence="the gain of {subject:and} is not determined: {gain:.2f} ± {sd:.2f} of the stated thrust",
        meaning="This record does not show whether the thruster gives the stated thrust.",
        decided="The standard deviation of the gain is above {MAX_GAIN_SD:g}.",
        example=Finding("thruster-gain-unknown", "note", ("f_2",), {"gain": 0.82, "sd": 0.75}, ("move-apart",)),
    ),
}
REMEDIES = {
    "reverse-sign": Remedy(
        command=_uncommanded,
        python=lambda values: (
            _uncommanded(values)
            .replace("set scale = -1", "give scale=-1.0")
            .replace("in the channel map", "in read_log")
        ),
        page="set the scale of the channel to -1 in the import form",
        view="import",
    ),
    "shift-clock": Remedy(
        command="compare the clocks of the files: {late:late} would explain it as well", view="import"
    ),
    "check-map-and-clocks": Remedy(command="check the channel map, the clocks and the priors", view="import"),
    "tame-priors": Remedy(
        command="check units and signs, or narrow the priors to damping that dissipates", view="model"
    ),
    "signed-priors": Remedy(command="use priors of known sign, such as half-normal", view="model"),
    "check-unit": Remedy(command=_unit, page="check the unit of {signals:and} in the import form", view="import"),
    "see-trim": Remedy(command="see the finding about its trim, which shows the unit better", view="file"),
    "check-unit-or-trim": Remedy(
        command=lambda values: _unit(values) + ", its column and its sign, or correct vehicle.trim",
        python=lambda values: _unit(values) + ", its column and its sign, or correct the trim of the vehicle",
        view="import",
    ),
    "reverse-or-trim": Remedy(
        command="set scale = -1 for {subject:and} in the channel map, or correct vehicle.trim",
        python="give scale=-1.0 for {subject:and} in read_log, or correct the trim of the vehicle",
        page="set the scale of {subject:and} to -1 in the import form, or correct the trim",
        view="import",
    ),
    "correct-shift": Remedy(
        command=lambda values: (
            "correct `shift` of {file} under [[import.files]], which is too "
            + ("large" if values["late"] > 0 else "small")
            + f" by about {abs(values['late']):.2g} s, then check again"
        ),
        python="correct the shift of {file} in read_log by about {late:.2g} s",
        page="correct the shift of {file} in the import form",
        view="import",
    ),
    "delay-prior": Remedy(
        command='give the delay a prior, [prior.delay] with distribution = "uniform", lower = 0.0 and upper = {upper:.2g}, unless the '
        "vehicle is slower than the priors assume",
        python="give `delay` a prior that includes {late:.2g} s",
        page="add the prior of the delay on the model page",
        view="model",
    ),
    "check-delay-prior": Remedy(command="check that the prior of the delay includes {late:.2g} s", view="model"),
    "one-clock": Remedy(
        command="put command and response on one clock, unless the vehicle is faster than the priors assume",
        view="import",
    ),
    "check-shift": Remedy(
        command="check `shift` of {file}, which may be too large",
        page="check the shift of {file} in the import form",
        view="import",
    ),
    "compare-clocks": Remedy(
        command="compare the clock of {file} with that of the commands before you rely on a result", view="import"
    ),
    "enu-axes": Remedy(
        command='set axes = "ENU" under [[import.files]] if the log has body axes forward, left, up',
        python='give axes="ENU" to read_log if the log has body axes forward, left, up',
        page="choose the axes ENU in the import form",
        view="import",
    ),
    "mount-or-columns": Remedy(
        command=lambda values: (
            f"swap columns in the channel map, or state the mount: {_mounted(values)} under [mounts.NAME]"
        ),
        python=lambda values: f"swap columns in read_log, or state a mount with {_mounted(values)}",
        view="import",
    ),
    "left-handed": Remedy(
        command="correct columns and signs (scale = -1) in the channel map: the axes are left-handed", view="import"
    ),
    "state-mount": Remedy(
        command=lambda values: (
            f"state the mount, [mounts.{{mount}}] with channels = [{', '.join(map(quoted, values['subject']))}] and "
            '{part} = "{degrees:.0f} deg", or estimate it, [prior.{part}_{mount}] with distribution = "normal", '
            'mean = {degrees:.1f}, sd = {prior_sd:.1f} and unit = "deg"'
        ),
        python="give the sensor a mount with {part} = {degrees:.0f} deg, or a prior of {part}_{mount}",
        view="file",
    ),
    "correct-mount": Remedy(
        command='correct {part} under [mounts.{mount}], or estimate it, [prior.{part}_{mount}] with distribution = "normal", '
        'mean = {degrees:.1f}, sd = {prior_sd:.1f} and unit = "deg"',
        python="correct {part} of the mount, or give {part}_{mount} a prior",
        view="file",
    ),
    "leave-out": Remedy(command="leave these samples out, or measure them again", view="import"),
    "correct-limits": Remedy(
        command="correct the limit if the vehicle may go so far, otherwise check the unit in the channel map",
        view="design",
    ),
    "heavy-residuals": Remedy(
        command='look at the raw plot; residuals = "heavy" under [sensors.{sensor}] tolerates outliers',
        python='look at the raw signal; noise "heavy" of the sensor {sensor} tolerates outliers',
        page="look at the raw plot; heavy residuals of the sensor {sensor} tolerate outliers",
        view="model",
    ),
    "add-sensor": Remedy(
        command="add [sensors.{subject[0]}] with its noise, or take {subject:and} out of the channel map",
        python="give {subject:and} a sensor with its noise, or leave its column out",
        view="file",
    ),
    "check-column": Remedy(command="check its column in the channel map", view="import"),
    "excite-or-fix": Remedy(
        command="excite it more, fix it, or design a trial (`seatrial design`)",
        python="excite it more, fix it, or design a trial (design_trial)",
        page="excite it more, fix it, or design a trial on the design page",
        view="design",
    ),
    "measure-rate": Remedy(
        command="add [sensors.{rate}] with its noise and map its column, or take these terms out of the model",
        python="give {rate} a sensor with its noise, or take these terms out of the model",
        view="file",
    ),
    "drop-or-change-sign": Remedy(
        command="leave one of them out, or run a trial in which the sign changes", view="model"
    ),
    "held-command": Remedy(
        command='write between = "held", not "line", for this command; prefer runs whose commands are set beforehand',
        python='give between="held" for this command; prefer runs whose commands are set beforehand',
        view="file",
    ),
    "open-loop-run": Remedy(command="judge it by a run whose commands are set beforehand"),
    "check-again": Remedy(command="correct that first, then check again"),
    "drop-axis": Remedy(command="take the axis from `moves`, or correct the thrusters", view="file"),
    "turn-thruster": Remedy(
        command="reverse its direction or set scale = -1 in its channel, and check that commands are in the order of the thrusters",
        python="reverse its direction or give scale=-1.0, and check that commands are in the order of the thrusters",
        view="file",
    ),
    "check-thrust-law": Remedy(
        command="check its law of thrust, its place and the order of the commands; [prior.gain_{subject[0]}] estimates the gain",
        python="check its law of thrust, its place and the order of the commands; a prior of gain_{subject[0]} estimates the gain",
        view="file",
    ),
    "move-apart": Remedy(command="move it apart from the others for some seconds"),
}
