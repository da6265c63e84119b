"""Messages about posteriors: the step of the simulation, priors, and terms that the data separate."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.display_units import listed
from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.diagnostics import known, prior_checks
    from seatrial.estimation.posterior import prior_bounds, step_shift

    files = (step_shift, prior_bounds, prior_checks, known)
    return {name: value for file in files for name, value in vars(file).items() if isinstance(value, float)}


def _moved(values: Mapping[str, Any]) -> str:
    moved = [f"{name} by {shift:+.1f} sd" for name, shift in zip(values["subject"], values["shifts"], strict=True)]
    more = values["more"]
    text = ", ".join(moved) + f" and {more} more" if more else listed(moved)
    return "the simulation's steps of {step:.2g} s are too long: half of them moves " + text


def _lost(values: Mapping[str, Any]) -> str:
    example = ", ".join(f"{name} = {x:.4g}" for name, x in values["example"])
    side = "above" if values.get("is_above") else "below"
    where = f", nearly always with {{parameter}} {side} {{value:.4g}} {{unit}}" if "parameter" in values else ""
    return f"the model cannot be simulated in {{share:.0%}} of the prior, for example at {example}{where}; these values are excluded"


def _excluding(values: Mapping[str, Any]) -> str:
    gain = "over 10 000" if values["gain"] > 1e4 else "{gain:.0f}"
    return (
        "the data push {subject[0]} against its bound {value:.4g} {unit}; at {beyond:.4g} {unit} they are "
        f"{gain} nats more likely"
    )


_WHAT_TO_CHECK = 'units, signs, clocks (a control that was measured: between = "line"), the channel map, and the masses under [vehicle]'
_WHAT_TO_CHECK_PYTHON = "units, signs, clocks, the channels that were read, and the masses of the vehicle"
ENTRIES = {
    "prior-excludes-data": Entry(
        title="Data outside a prior",
        sentence=_excluding,
        meaning="The prior excludes the value that the data support. Nothing is computed, because the bound would bias "
        "all other values.",
        decided="The mode lies within {EDGE:.0%} of the width from a bound. With this parameter a tenth of the width "
        "outside, and the others fitted again, the data are over {MIN_GAIN:.0f} nats more likely.",
        example=Finding(
            "prior-excludes-data",
            "alarm",
            ("X_u",),
            {"value": 0.0, "unit": "kg/s", "beyond": 2.0, "gain": 60.0, "channel": "u"},
            ("widen-or-check-record",),
        ),
        remedies=(
            "widen-or-check-record",
            "check-record-first",
            "explain-channel",
            "smaller-noise",
            "no-lag",
            "no-memory",
        ),
    ),
    "at-prior-bound": Entry(
        title="Mode at a bound of its prior",
        sentence="{subject[0]} lies at the bound {value:.4g} {unit} of its prior, which sets its value and ±",
        meaning="The bound sets the value, not the data.",
        decided="The mode lies within {MAX_BESIDE:.1%} of the width of the prior from a bound, or within {EDGE:.0%} of it and within "
        "{MAX_REACH_SDS:g} standard deviations.",
        example=Finding("at-prior-bound", "caution", ("X_u",), {"value": 0.0, "unit": "kg/s"}, ("widen-prior",)),
    ),
    "prior-contradicted": Entry(
        title="Prior and data contradict each other",
        sentence="prior and data contradict each other: the data pull {subject[0]} to {value:.4g} {unit}, for which its prior gives less "
        "than one chance in 10 000",
        meaning="The result is a compromise between a prior and data that exclude each other.",
        decided="The mode is more than {MAX_PRIOR_SDS:g} standard deviations from the middle of a prior without bounds.",
        example=Finding("prior-contradicted", "caution", ("X_u",), {"value": 7.2, "unit": "kg/s"}, ("widen-or-check",)),
    ),
    "posterior-cut-off": Entry(
        title="Posterior at a bound of its prior",
        sentence="the bound {value:.4g} {unit} of its prior cuts off the posterior of {subject[0]} ({share:.0%} of it lies there), so "
        "the prior decides too",
        meaning="The bound ends the interval, not the data.",
        decided="More than {MIN_LEANING_SHARE:.0%} of the posterior within {EDGE:.0%} of the width of the prior from a bound.",
        example=Finding(
            "posterior-cut-off", "caution", ("X_u",), {"value": 0.0, "unit": "kg/s", "share": 0.3}, ("widen-prior",)
        ),
    ),
    "prior-not-simulated": Entry(
        title="Prior without a simulation",
        sentence=_lost,
        meaning="Part of the prior describes vehicles that cannot be simulated, such as those without damping.",
        decided="The likelihood is not finite in more than {MIN_LOST_SHARE:.0%} of the draws from the prior. A parameter is named if its "
        "mean rank in these draws differs by {MIN_RANK_GAP:g}.",
        example=Finding(
            "prior-not-simulated",
            "caution",
            ("X_u",),
            {
                "share": 0.2,
                "example": (("X_u", 3.1),),
                "parameter": "X_u",
                "is_above": True,
                "value": 0.5,
                "unit": "kg/s",
            },
            ("narrow-prior",),
        ),
    ),
    "steps-too-long": Entry(
        title="Simulation steps too long",
        sentence=_moved,
        meaning="The error of the integration is as large as the ±, which does not contain it.",
        decided="The sensors are simulated again at the mode with half the step. One linear step of the posterior "
        "gives the shift of each parameter. Shifts from {MIN_SHIFT:g} standard deviation are reported; the ± covers smaller ones.",
        example=Finding(
            "steps-too-long",
            "caution",
            ("X_u", "X_uabsu"),
            {"shifts": (-2.4, 1.3), "more": 0, "step": 0.1, "shorter": 0.025},
            ("shorter-step",),
        ),
    ),
    "speeds-not-separated": Entry(
        title="Terms that only the speed separates",
        sentence="{subject:and} differ only by a factor u, and these runs do not separate them: the ± of {subject[0]} is "
        "{relative:.0%} of its value",
        meaning="At one speed two such terms have the same effect. The data then do not show how the force grows with the speed; "
        "most hydrodynamic forces do.",
        decided="The ± of the term without u exceeds {UNSURE:.0%} of its value.",
        example=Finding("speeds-not-separated", "caution", ("N_v", "N_uv"), {"relative": 0.63}, ("keep-speed-scaled",)),
    ),
}
REMEDIES = {
    "keep-speed-scaled": Remedy(
        command="keep {subject[1]}, which scales with the speed, and leave {subject[0]} out, or fit runs at another speed too"
    ),
    "no-memory": Remedy(
        command='set estimation.residuals = "white" and remove this prior, because the residuals have no memory',
        python='give the sensor noise="white", and no prior of {subject[0]}, because the residuals have no memory',
    ),
    "no-lag": Remedy(
        command="set sensors.{channel}.lag = false and remove this prior, because {channel} has no delay",
        python="give the sensor no lag, and no prior of {subject[0]}, because {channel} has no delay",
    ),
    "smaller-noise": Remedy(
        command=lambda values: (
            f"lower the lower bound of [prior.{{subject[0]}}] to {values['value'] / 10:.4g} {{unit}}, because the noise of "
            "{channel} is smaller"
        ),
        python=lambda values: (
            f"give {{subject[0]}} a prior with lower bound {values['value'] / 10:.4g} {{unit}}, because the noise of {{channel}} is smaller"
        ),
    ),
    "explain-channel": Remedy(
        command="check units, signs, the channel map, the mount of the sensor, outliers of {channel} "
        '(residuals = "heavy" tolerates them) and the other priors. Noise does not explain the error of {channel}. Only if '
        "{channel} is so noisy, widen [prior.{subject[0]}] or, without that table, raise noise under [sensors.{channel}]",
        python="check units, signs, the channels read, the mount of the sensor, outliers of {channel} "
        '(a sensor with noise="heavy" tolerates them) and the other priors. Noise does not explain the error of {channel}. Widen the '
        "prior of {subject[0]} only if {channel} is so noisy",
    ),
    "check-record-first": Remedy(
        command=f"check {_WHAT_TO_CHECK} first, by `seatrial check`; widen the prior only if they are right",
        python=f"check {_WHAT_TO_CHECK_PYTHON} first; widen the prior only if they are right",
    ),
    "widen-or-check-record": Remedy(
        command=f"widen the prior, or check {_WHAT_TO_CHECK}",
        python=f"widen the prior, or check {_WHAT_TO_CHECK_PYTHON}",
    ),
    "widen-or-check": Remedy(command="widen the prior, or check units and signs"),
    "widen-prior": Remedy(command="widen the prior, or give a reason for the bound"),
    "narrow-prior": Remedy(command="narrow the prior if you did not intend this"),
    "shorter-step": Remedy(
        command='set step = "{shorter:.2g} s" under [import]',
        python="read the log again with step={shorter:.2g}",
        page="set the step to {shorter:.2g} s under Import",
        view="import",
    ),
}
