"""Messages about fits and predictions: each channel of one run, and of all held-back runs together."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.display_units import count_below, shown_unit
from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.prediction import fit_verdict, short_horizon

    return {
        name: value
        for file in (fit_verdict, short_horizon)
        for name, value in vars(file).items()
        if isinstance(value, float)
    }


def _explained(values: Mapping[str, Any]) -> str:
    from seatrial.messages.predictions import explained_of

    return explained_of(values["explained"], values["subject"][0])


def _noise(values: Mapping[str, Any]) -> str:
    factor, unit = shown_unit(values["subject"][0])
    return f"{values['noise_sd'] * factor:.2g} {unit}"


def _inside(values: Mapping[str, Any]) -> str:
    from seatrial.estimation.prediction.fit_verdict import MIN_EFFECTIVE_SAMPLES

    runs = values.get("runs", 0)
    where = f" in {runs} held-back run{'s' * (runs != 1)}" if runs else ""
    by_run = f"; {values['least']:.0%} to {values['most']:.0%} by run" if runs > 1 else ""
    count = count_below(values["effective"], MIN_EFFECTIVE_SAMPLES)
    return (
        f"{{coverage:.0%}} of {{subject[0]}}{where} lies inside the 90 % band (95 % range {{lower:.0%}} to {{upper:.0%}} by {count} "
        f"independent sample{'s' * (count != '1')}{by_run})"
    )


def _missed(values: Mapping[str, Any]) -> str:
    first = f"{_inside(values)}, but " if "runs" in values else ""
    return f"{first}{_explained(values)}: the model misses most of the motion"


_WIDEN = "{widen:.1f} times ({widen_lower:.1f} to {widen_upper:.1f})"
_SCORES = {
    "coverage": 0.7,
    "lower": 0.57,
    "upper": 0.81,
    "p_value": 1e-5,
    "effective": 60.0,
    "variance": 2.5,
    "explained": 0.3,
    "noise_sd": 0.02,
    "widen": 1.6,
    "widen_lower": 1.3,
    "widen_upper": 1.8,
}
_POOLED = {**_SCORES, "runs": 4, "least": 0.55, "most": 0.78}


def _example(code: str, level: Any, values: Mapping[str, Any], *remedies: str) -> Finding:
    return Finding(code, level, ("u",), values, remedies)


ENTRIES = {
    "prediction-agrees": Entry(
        title="Prediction agrees",
        sentence=lambda values: f"{_explained(values)}, and {_inside(values)}",
        meaning="Errors have the stated size, most of the motion is explained, and residuals are the noise that is modelled.",
        decided="No other finding of this section applies.",
        example=_example(
            "prediction-agrees", "pass", {**_SCORES, "coverage": 0.91, "lower": 0.81, "upper": 0.97, "explained": 0.97}
        ),
    ),
    "channel-not-measured": Entry(
        title="Not measured",
        sentence="nothing was measured of {subject[0]}, so it cannot be judged",
        meaning="The run does not test this channel.",
        decided="The channel has no sample.",
        example=_example("channel-not-measured", "note", {}, "check-map"),
    ),
    "prediction-diverges": Entry(
        title="Prediction diverges",
        sentence="the simulated {subject[0]} grows without bound, so the model cannot describe this motion",
        meaning="Coefficients drive the vehicle instead of damping it, or a unit is wrong.",
        decided="The prediction is not finite, or far beyond all measurements.",
        example=_example("prediction-diverges", "alarm", {}, "tame-priors"),
        remedies=("fit-as-far", "tame-priors"),
    ),
    "samples-too-few": Entry(
        title="Too few independent samples",
        sentence=lambda values: f"{_inside(values)}: too few to judge the band",
        meaning="Neighbouring errors are alike, so that one sample more inside the band would change the verdict.",
        decided="Fewer than {MIN_EFFECTIVE_SAMPLES:g} independent samples. Of held-back runs also less than {NARROW:.0%} inside the band, "
        "if chance explains it.",
        example=_example(
            "samples-too-few", "note", {**_SCORES, "effective": 4.0, "lower": 0.21, "upper": 0.98}, "hold-back-more"
        ),
    ),
    "band-too-narrow": Entry(
        title="Band too narrow",
        sentence=lambda values: (
            f"{_inside(values)}, and errors are {values['variance'] ** 0.5:.1f} times those stated: the bands are too narrow "
            "(p = {p_value:.1g})"
        ),
        meaning="The stated uncertainty does not describe these runs; do not rely on the ± of the coefficients either.",
        decided="Less than {NARROW:.0%} inside the 90 % band, or a variance above {BURST:g}, by more than chance (p < {CHANCE:g}). It is "
        "an alarm for all held-back runs together, and for one run with less than {BROKEN:.0%} inside or such a variance.",
        example=_example("band-too-narrow", "alarm", _POOLED, "widen-bands", "add-term"),
        remedies=(
            "widen-bands",
            "look-at-trial",
            "look-at-residuals",
            "more-trials",
            "fit-as-far",
            "add-term",
            "add-delay",
            "add-error-model",
        ),
    ),
    "band-too-wide": Entry(
        title="Band too wide",
        sentence=lambda values: (
            f"{_inside(values)}: bands {_WIDEN} as wide are enough, because these runs have less noise than the fitted ones"
        ),
        meaning="The model predicts more precisely than its band states.",
        decided="More than {WIDE:.0%} inside the 90 % band, by more than chance (p < {CHANCE:g}).",
        example=_example(
            "band-too-wide",
            "caution",
            {
                **_SCORES,
                "coverage": 0.99,
                "lower": 0.92,
                "upper": 1.0,
                "widen": 0.6,
                "widen_lower": 0.5,
                "widen_upper": 0.7,
            },
            "compare-sensors",
        ),
    ),
    "coefficients-uncertain": Entry(
        title="Coefficients uncertain",
        sentence=lambda values: f"{_explained(values)}, because the coefficients are not known well enough",
        meaning="The band has the right size, but the coefficients need another trial.",
        decided="Less than {POOR:.0%} of the variance is explained (of all held-back runs together: nothing), and the coefficients make "
        "most of the band.",
        example=_example("coefficients-uncertain", "caution", _SCORES, "next-trial"),
    ),
    "noise-hides-motion": Entry(
        title="Noise hides the motion",
        sentence=lambda values: (
            f"{_explained(values)}: the residuals of the fit, {_noise(values)}, are as large as the motion"
        ),
        meaning="The run is a weak test of the model.",
        decided="Less than {POOR:.0%} of the variance is explained (of all held-back runs together: nothing), and the noise makes more "
        "than half of it. Or the measurement never changes.",
        example=_example("noise-hides-motion", "note", _SCORES, "move-more"),
    ),
    "motion-not-predicted": Entry(
        title="Motion not predicted",
        sentence=_missed,
        meaning="The run contains an effect that the model lacks.",
        decided="Less than {POOR:.0%} of the variance is explained, and neither noise nor coefficients account for it. It is an alarm if "
        "nothing is explained of all held-back runs together.",
        example=_example("motion-not-predicted", "alarm", {**_POOLED, "explained": -0.3}, "add-term"),
        remedies=("add-term", "add-delay", "add-error-model", "estimated-start"),
    ),
    "course-left": Entry(
        title="Unstable course",
        sentence="{words}",
        meaning="The model has a positive eigenvalue about the steady motion of the run, so that controls do not determine a whole run. "
        "Stretches of it are judged instead.",
        decided="A small error grows by a factor of {MIN_GROWTH:g} along the run, and the whole run is not predicted. It is an alarm if "
        "stretches are not predicted either: less than {MIN_EXPLAINED:.0%} of the variance, or less than a constant value explains.",
        example=_example(
            "course-left",
            "caution",
            {
                "words": "the fitted model is unstable, so controls do not determine 150 s: a small error grows by e in 17 s "
                "(eigenvalue +0.06 1/s)",
                "horizon": 8.0,
            },
            "filter-error",
        ),
        remedies=("filter-error", "split-runs"),
    ),
    "residuals-correlated": Entry(
        title="Correlated residuals",
        sentence=lambda values: (
            "residuals of {subject[0]} are correlated"
            + " although the fit models a correlation" * values["modelled"]
            + ": the stated standard deviations are too small, by a factor of about {factor:.1f}"
            + ". The autopilot feeds these errors into the controls, which biases the coefficients" * values["feedback"]
        ),
        meaning="Neighbouring errors are not independent, so the data hold less information than the fit assumes.",
        decided="Sums of residuals of fitted runs vary as if standard deviations were {UNDERSTATED:g} times those stated, by more than "
        "chance (p < {LIKELY:g}).",
        example=_example(
            "residuals-correlated", "caution", {"factor": 2.0, "modelled": False, "feedback": False}, "drifting-noise"
        ),
        remedies=("drifting-noise", "missing-term", "filter-error"),
    ),
    "runs-leave-course": Entry(
        title="Unstable course",
        sentence="the bands of {subject[0]} over whole runs cannot be judged, because the fitted model is unstable",
        meaning="See course-left.",
        decided="Every held-back run has the finding course-left.",
        example=_example("runs-leave-course", "note", {}),
    ),
}
REMEDIES = {
    "check-map": Remedy(command="check the channel map"),
    "fit-as-far": Remedy(command="fit a run that goes as far"),
    "look-at-trial": Remedy(
        command="look for a sensor fault, a wrong unit or another condition of this trial (current, load, trim); or add a term; or "
        "fit it too"
    ),
    "look-at-residuals": Remedy(command="look in its residuals for outliers, a wrong unit or a missing term"),
    "more-trials": Remedy(command="fit more trials like it, or add a term"),
    "compare-sensors": Remedy(command="check whether the trials have the same sensors"),
    "next-trial": Remedy(command="run the proposed next trial"),
    "move-more": Remedy(command="use a run with more motion, or add a term if the sensor has less noise"),
    "add-term": Remedy(command="add a term"),
    "add-delay": Remedy(command="add a delay"),
    "add-error-model": Remedy(
        command='set estimation.residuals = "drifting"',
        python='give the sensors noise="drifting"',
        page="choose drifting residuals on the model page",
    ),
    "estimated-start": Remedy(
        command='set estimation.initial = "estimated"',
        python="give priors of the start (u_0, …)",
        page="estimate the start on the model page",
    ),
    "filter-error": Remedy(
        command='set estimation.likelihood = "filter-error"',
        python="give priors of process noise (process_u, …), which makes the likelihood filter-error",
        page="choose the likelihood filter-error on the model page",
    ),
    "split-runs": Remedy(
        command='cut the runs by [import] split = "{horizon:.2g} s"', python="cut the records into {horizon:.2g} s"
    ),
    "drifting-noise": Remedy(
        command='set estimation.residuals = "drifting" (white noise plus a slow error), and remove [prior.tau_{subject[0]}] if the file '
        "has it",
        python='give the sensors noise="drifting"',
        page="choose drifting residuals on the model page",
    ),
    "missing-term": Remedy(command="look for a missing term"),
    "widen-bands": Remedy(command=f"widen the bands {_WIDEN}, and do not rely on the ± of the coefficients either"),
    "hold-back-more": Remedy(command="hold back more or longer runs"),
}
