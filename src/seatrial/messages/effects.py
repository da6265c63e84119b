"""Messages about effects that a model lacks, and about the parts of a ±."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from seatrial.core.display_units import listed, percent
from seatrial.core.findings import Finding
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.messages.entry import Entry, Remedy

if TYPE_CHECKING:
    from seatrial.estimation.diagnostics.error_budget import ErrorBudget
    from seatrial.estimation.diagnostics.error_sources import StatedErrors


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.diagnostics.error_budget import MIN_CONTRADICTION, MIN_LOG_ODDS, MIN_SHIFT, MIN_SLOW_RATIO
    from seatrial.estimation.diagnostics.linear_model import MAX_LEFT

    return {
        "MIN_SHIFT": MIN_SHIFT,
        "MIN_LOG_ODDS": MIN_LOG_ODDS,
        "MIN_SLOW_RATIO": MIN_SLOW_RATIO,
        "MIN_CONTRADICTION": MIN_CONTRADICTION,
        "MAX_LEFT": MAX_LEFT,
    }


# Names of the parts of a ±, by the fields of `ErrorShares`.
NAMES_OF_ORIGINS = {
    "noise": "noise",
    "stated": "stated inputs",
    "runs": "differences between runs",
    "model": "model",
    "terms": "choice of terms",
}
MOSTLY, MIN_SHARE = 0.95, 0.005  # Share of noise from which nothing else is named, and share from which a part is
SLOW_RESIDUALS = "slow errors of the sensors"
# How the sizes of effects are introduced.
MEASURES = {
    "thrust loss": ", by a share of about",
    "start": ", by about",
    "clock": ", by about",
}


def effect_name(kind: str, of: str) -> str:
    """Return the name of an effect that a model may lack.

    Args:
        kind: of `Effect` of `estimation.diagnostics.error_sources`.
        of: axis, coefficient, control, channel or state; empty for all commands.
    """
    return {
        "force": f"a force {of}",
        "inertia": f"the stated inertia along {of}",
        "scale": f"the scale of the sensor of {of}",
        "clock": "commands that act before their stamps",
        "run force": f"a force {of}_0 that differs from run to run",
        "smooth force": f"forces along {of} that depart from their formulas",
        "command lag": f"a lag of the actuator of {of}" if of else "a lag of all actuators",
        "delay": "a delay of the actuators",
        "backlash": f"half of a backlash of the actuator of {of},",
        "thrust loss": "a thrust that falls with the speed",
        "command offset": f"an offset of the command {of}",
        "sensor offset": f"an offset of {of}, a bias of the sensor or a current,",
        "start": f"a start of {of} that differs from the assumed one",
    }[kind]


def effect_names(effects: Any) -> str:
    """Return alternatives among effects, each a kind and what it is of."""
    return listed([effect_name(*one).rstrip(",") for one in effects], "or")


def _missing(values: Mapping[str, Any]) -> str:
    alike = f" (or {effect_names(values['alike'])}: the data cannot separate them)" if values["alike"] else ""
    error = f" ± {values['sd']:.1g}" if values["sd"] else ""  # a force of many columns has no one size
    size = f"{values['size']:.2g}{error} {values['unit']}".removesuffix(" 1")
    ((kind, of),) = values["effects"]
    shift = f"{abs(values['shift']):.{3 if abs(values['shift']) >= 100 else 2}g}"
    if kind == "smooth force":
        missing = f"forces along {of} depart from their formulas by about {percent(values['size'])}{alike}: with that"
    else:
        missing = (
            f"the model lacks {effect_names(values['effects'])}{MEASURES.get(kind, ' of about')} {size}{alike}: with it"
        )
    return f"{missing} {{subject[0]}} would move by {shift} standard deviations of noise, which its ± contains"


def _main(values: Mapping[str, Any]) -> str:
    return f"{{subject:and}}: most of the ± is from {effect_names(values['effects']) or SLOW_RESIDUALS}"


def _contradicted(values: Mapping[str, Any]) -> str:
    (((kind, of),), size) = values["effects"], values["size"]
    error, stated = (percent(values[key]) for key in ("sd", "stated"))
    if kind == "clock":
        way = "later" if size > 0 else "earlier"
        return (
            f"by the data, commands act {abs(size):.2g} samples {way}, but ± {values['stated']:g} is stated; or the model "
            "lacks an effect that looks alike"
        )
    what = f"the inertia along {of}" if kind == "inertia" else f"the scale of the sensor of {of}"
    more = "larger" if size > 0 else "smaller"
    return (
        f"by the data, {what} is {percent(abs(size))} (± {error}) {more} than stated, but its stated error is {stated}; or the model "
        "lacks an effect that looks alike"
    )


def _of(kind: str, values: Mapping[str, Any]) -> list[str]:
    return [of for one, of in values["effects"] if one == kind]


def _lag(values: Mapping[str, Any]) -> str:
    tables = listed([f"[vehicle.actuators.{of or 'NAME'}]" for of in _of("command lag", values)])
    return f'if [vehicle] has `moves`, add {tables} with its lag, for example lag = "0.3 s"'


_EXAMPLE = {"effects": (("command lag", "n"),), "alike": (), "size": 0.9, "sd": 0.1, "unit": "s", "shift": 4.0}
ENTRIES = {
    "effect-missing": Entry(
        title="Missing effect",
        sentence=_missing,
        meaning="A coefficient takes the place of the missing effect: its ± contains the error, and its value is off.",
        decided="Each effect is fitted to the residuals about the mode. Its log odds exceed {MIN_LOG_ODDS:g} (20 to 1), and a "
        "coefficient moves by more than {MIN_SHIFT:g} standard deviation.",
        example=Finding("effect-missing", "caution", ("X_u",), _EXAMPLE, ("actuator-lag", "delay-of-actuators")),
        remedies=(
            "add-force",
            "actuator-lag",
            "delay-of-actuators",
            "measured-command",
            "measured-actuator",
            "thrust-loss",
            "correct-zero",
            "sensor-bias",
            "estimated-start",
            "see-selection",
            "compare-runs",
            "wider-structure",
        ),
    ),
    "main-error": Entry(
        title="Main error",
        sentence=_main,
        meaning="More data of the same kind would hardly reduce this ±: its largest part is not the noise, or is slow noise.",
        decided="Noise makes less than half of the variance, or slow noise makes the ± more than {MIN_SLOW_RATIO:g} times as wide.",
        example=Finding("main-error", "note", ("X_u", "T_nabsn"), {"effects": (("inertia", "X"),)}, ("weigh-vehicle",)),
        remedies=("weigh-vehicle", "calibrate-sensor", "better-noise", "add-force", "compare-runs"),
    ),
    "model-describes-nothing": Entry(
        title="Model describes nothing",
        sentence="this model does not describe the vehicle: most of the motion remains as slow residuals, so each ± is as wide as "
        "the prior",
        meaning="The coefficients are not estimated: a channel, a sign, a unit or the vehicle differs from that of the model.",
        decided="Slow residuals have more than {MAX_LEFT:.0%} of the variance of each channel, even with the best effect. Forces that "
        "depart from formulas are not among these effects.",
        example=Finding("model-describes-nothing", "alarm", (), {}, ("check-inputs",)),
        remedies=("check-inputs",),
    ),
    "input-contradicted": Entry(
        title="Input contradicted",
        sentence=_contradicted,
        meaning="The data determine a stated input, and its stated value is improbable.",
        decided="The value by the data is more than {MIN_CONTRADICTION:g} stated standard deviations from the stated one.",
        example=Finding(
            "input-contradicted",
            "caution",
            (),
            {"effects": (("inertia", "X"),), "size": -0.16, "sd": 0.012, "stated": 0.05},
            ("weigh-vehicle",),
        ),
        remedies=("weigh-vehicle", "calibrate-sensor", "measured-command"),
    ),
}
REMEDIES = {
    "check-inputs": Remedy(
        command="compare channels, signs, units and times in [import], run `seatrial check`, and look for other forces on the vehicle "
        "than its commands",
        python="compare channels, signs, units and times of the records, and look for other forces on the vehicle than its commands",
    ),
    "weigh-vehicle": Remedy(
        command="weigh the vehicle with the water in it, correct [vehicle], and set estimation.inertia_error to the error of the scales, "
        "such as 0.01",
        python="weigh the vehicle with the water in it, correct its mass, and state `StatedErrors(inertia=...)`",
    ),
    "calibrate-sensor": Remedy(
        command="compare the sensor with a known distance or another sensor, and set estimation.scale_error to the error of the "
        "comparison, such as 0.002",
        python="compare the sensor with a known distance or another sensor, and state `StatedErrors(scale=...)`",
    ),
    "add-force": Remedy(
        command=lambda values: f"add {listed(_of('force', values), 'or')} to structure.optional, with a prior",
        python=lambda values: f"make the coefficient {listed(_of('force', values), 'or')} free, with a prior",
    ),
    "actuator-lag": Remedy(command=_lag, python="give the actuator a lag"),
    "delay-of-actuators": Remedy(
        command='give `delay` a prior, [prior.delay] with distribution = "uniform", lower = 0.0 and upper = 0.5',
        python="give `delay` a prior",
    ),
    "measured-command": Remedy(
        command='if the commands were measured and this is half their sampling time, set between = "line" for their channels; '
        "otherwise correct `shift` of their file",
        python='if the commands were measured and this is half their sampling time, give between="line"',
    ),
    "measured-actuator": Remedy(
        "use the measured speed or angle of the actuator instead of its command, or remove its backlash"
    ),
    "thrust-loss": Remedy(
        command="add the loss of thrust to structure.optional, with a prior: T_un for a propeller, T_f and T_uabsf for thrusters, "
        "X_utau_X for a force",
        python="make the loss of thrust free, with a prior: T_un for a propeller, T_f and T_uabsf for thrusters, X_utau_X for a force",
    ),
    "correct-zero": Remedy(
        command=lambda values: (
            f"check the zero of {listed(_of('command offset', values))}; `offset` of its channel in [import] corrects it"
        ),
        python="check the zero of the command",
    ),
    "sensor-bias": Remedy(
        command=lambda values: (
            " or ".join(f'set sensors.{of}.bias = "own"' for of in _of("sensor offset", values))
            + ' or estimation.current = "own", with a prior'
        ),
        python="give each trial its bias or its current by `own`, with a prior",
    ),
    "see-selection": Remedy(
        command="see `seatrial select`, as other structures have this force",
        python="compare the structures, as others have this force",
    ),
    "better-noise": Remedy(
        command='set estimation.residuals = "drifting": the residuals are correlated',
        python='give the sensors noise="drifting": the residuals are correlated',
    ),
    "wider-structure": Remedy(
        command="add terms with priors to structure.optional, give the axis a force with memory by a prior of `disturbance`, or reduce "
        "estimation.force_error if tests support that",
        python="make further terms free, with priors, give the axis a force with memory by a prior of `disturbance`, or state "
        "`StatedErrors(force=...)`",
    ),
    "compare-runs": Remedy(
        command="look for a change between the runs, or let a coefficient vary by estimation.varying",
        python="look for a change between the runs, or let a coefficient vary by `own`",
    ),
}


def contents_text(budget: "ErrorBudget", stated: "StatedErrors") -> str:
    """Return the errors that a ± contains."""
    if not budget.tried:
        return "± contains noise only: with process noise, other errors are not computed"
    words = {
        "inertia": f"inertia {percent(stated.inertia)}",
        "scale": f"speed scale {percent(stated.scale)}",
        "clock": f"time {stated.clock:g} sample{'s' * (stated.clock > 1)}",
    }
    kinds = {one.kind for one in budget.stated}
    inputs = ", ".join(one for kind, one in words.items() if kind in kinds)
    parts = ["noise"]
    parts += [f"stated inputs ({inputs})"] if inputs else []
    parts += [f"force formulas ({percent(stated.force)})"] if stated.force else []
    parts += ["differences between runs"] * any(one.kind == "run force" for one in budget.tried)
    exact = "" if inputs else "; stated inputs are assumed exact"
    return f"± contains {listed([*parts, f'{len(budget.tried)} possible missing effects'])}{exact}"


def shares_text(shares: ErrorShares, cause: str) -> str:
    """Return the parts of a ±: `stated inputs 82 %, noise 18 %: the stated inertia along X`; empty if it is mostly noise."""
    parts = {NAMES_OF_ORIGINS[one.name]: getattr(shares, one.name) for one in fields(shares)}
    if shares.noise > MOSTLY and not cause:
        return ""
    ordered = sorted(parts.items(), key=lambda part: -part[1])
    words = ", ".join(f"{name} {share:.0%}".replace("%", " %") for name, share in ordered if share >= MIN_SHARE)
    return f"{words}: {cause}" if cause else words
