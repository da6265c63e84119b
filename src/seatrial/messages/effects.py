"""Messages about effects that a model lacks, and about the ± with model error."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.display_units import listed
from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.diagnostics.error_budget import MIN_LOG_ODDS, MIN_SD_RATIO, MIN_SHIFT

    return {"MIN_SHIFT": MIN_SHIFT, "MIN_LOG_ODDS": MIN_LOG_ODDS, "MIN_SD_RATIO": MIN_SD_RATIO}


SLOW_RESIDUALS = "slow errors of the sensors"
# How the sizes of effects are introduced.
MEASURES = {
    "thrust loss": ", by a share of about",
    "start": ", by about",
    "clock": ", by about",
    "smooth force": ", over the force that the model has there about",
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
        "smooth force": f"a force along {of} that no term of the model has",
        "command lag": f"a lag of the actuator of {of}" if of else "a lag of all actuators",
        "delay": "a delay of the actuators",
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
    ((kind, _),) = values["effects"]
    missing = f"{effect_names(values['effects'])}{MEASURES.get(kind, ' of about')} {size}"
    return (
        f"the model lacks {missing}{alike}: with it {{subject[0]}} would move by {abs(values['shift']):.2g} of its standard deviations, so "
        "the stated uncertainty is too small"
    )


def _wide(values: Mapping[str, Any]) -> str:
    cause = effect_names(values["effects"]) or SLOW_RESIDUALS
    return f"{{subject:and}}: most of the ± with model error is from {cause}"


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
        meaning="A coefficient takes the place of the missing effect, which its ± does not contain.",
        decided="Each effect is fitted to the residuals about the mode: log odds above {MIN_LOG_ODDS:g} (20 to 1), and a coefficient that "
        "moves by more than {MIN_SHIFT:g} standard deviation.",
        example=Finding("effect-missing", "caution", ("X_u",), _EXAMPLE, ("actuator-lag", "delay-of-actuators")),
        remedies=(
            "add-force",
            "actuator-lag",
            "delay-of-actuators",
            "measured-command",
            "thrust-loss",
            "correct-zero",
            "sensor-bias",
            "estimated-start",
            "see-selection",
            "compare-runs",
            "wider-structure",
        ),
    ),
    "model-error-wide": Entry(
        title="Model error",
        sentence=_wide,
        meaning="The ± within the model is not enough: effects that the model may lack, runs that differ, or errors of the sensors that "
        "last move the value further.",
        decided="The standard deviation with model error is more than {MIN_SD_RATIO:g} times that within the model.",
        example=Finding(
            "model-error-wide",
            "note",
            ("X_u",),
            {"effects": (("force", "X_uuu"),)},
            ("add-force",),
        ),
        remedies=("better-noise", "add-force", "compare-runs", "compare-blocks"),
    ),
}
REMEDIES = {
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
        command='if the commands were measured and this is half their sampling time, write between = "line" for their channels in '
        "[import]; else correct `shift` of their file",
        python='if the commands were measured and this is half their sampling time, give between="line"',
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
        command="add terms to structure.optional, with priors, or give the axis a force with memory by a prior of `disturbance`",
        python="make further terms free, with priors, or give the axis a force with memory by a prior of `disturbance`",
    ),
    "compare-runs": Remedy(
        command="look for what changed between the runs, or let a coefficient vary by estimation.varying",
        python="look for what changed between the runs, or let a coefficient vary by `own`",
    ),
    "compare-blocks": Remedy(command="look for what changed during the run, or fit more runs"),
}


def with_model_error(wider: float | None, cause: str, factor: float) -> str:
    """Return what follows a value and its standard deviation where a wider one survives an error of the model; empty for none.

    Args:
        wider: that standard deviation, SI.
        cause: what makes most of it.
        factor: from SI to the unit in which it is shown.
    """
    return "" if wider is None else f", ± {factor * wider:.3g} with model error (mostly {cause})"
