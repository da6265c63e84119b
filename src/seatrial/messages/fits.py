"""Messages about fits and predictions: each channel of one run, and of all held-back runs together."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.display_units import shown_unit
from seatrial.core.findings import Finding
from seatrial.core.usual_priors import TIME_PRIOR
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.prediction import fit_verdict, pooled_coverage, short_horizon

    return {
        name: value
        for file in (fit_verdict, pooled_coverage, short_horizon)
        for name, value in vars(file).items()
        if isinstance(value, float)
    }


def _explained(values: Mapping[str, Any]) -> str:
    from seatrial.messages.predictions import explained_of

    return explained_of(values["explained"], values["subject"][0])


def _noise(values: Mapping[str, Any]) -> str:
    factor, unit = shown_unit(values["subject"][0])
    slow = f" with a correlation time of {values['correlation_time']:.2g} s" if values["correlation_time"] else ""
    return f"{values['noise_sd'] * factor:.2g} {unit}{slow}"


def _few(values: Mapping[str, Any]) -> str:
    from seatrial.core.display_units import count_below
    from seatrial.estimation.prediction.fit_verdict import MIN_EFFECTIVE_SAMPLES

    count = values["effective"]
    worth = (
        "one independent sample" if count < 1.5 else f"{count_below(count, MIN_EFFECTIVE_SAMPLES)} independent samples"
    )
    if "why" in values:
        template = ENTRIES[values["why"]].template("caution")
        rest = template if isinstance(template, str) else template(values)
    else:
        rest = _explained(values)
    return (
        f"{{subject[0]}} of this run is worth {worth}, too few to judge its band ({MIN_EFFECTIVE_SAMPLES:.0f} are needed, "
        f"{{coverage:.0%}} lies inside); {rest}"
    )


def _sizes(values: Mapping[str, Any]) -> str:
    return (
        "{coverage:.0%} of {subject[0]} lies inside the 90 % band and errors are "
        f"{values['variance'] ** 0.5:.1f} times those stated"
    )


def _residuals(values: Mapping[str, Any]) -> str:
    return (
        "residuals of {subject[0]} are correlated ({correlation:+.2f} over {interval:.2g} s"
        + ", and lasting" * values["faint"]
        + ")"
    )


def _not_normal(values: Mapping[str, Any]) -> str:
    side = f", {values['side']:.0%} of it on one side of the prediction" if values["side"] else ""
    return f"errors of {{subject[0]}} are not spread as stated (off by {{distance:.2f}}{side}): probabilities are rough"


def _inside(values: Mapping[str, Any]) -> str:
    from seatrial.core.display_units import count_below
    from seatrial.estimation.prediction.pooled_coverage import MIN_POOLED_SAMPLES

    runs = f"{values['runs']} held-back run{'s' * (values['runs'] != 1)}"
    by_run = f"; {values['least']:.0%} to {values['most']:.0%} by run" if values["runs"] > 1 else ""
    return (
        f"{{coverage:.0%}} of {{subject[0]}} in {runs} lies inside the 90 % band (95 % range {{lower:.0%}} to {{upper:.0%}} by "
        f"{count_below(values['effective'], MIN_POOLED_SAMPLES)} effective samples{by_run})"
    )


def _needed() -> str:
    from seatrial.estimation.prediction.pooled_coverage import MIN_POOLED_SAMPLES

    return f"{MIN_POOLED_SAMPLES:.0f}"


_WIDEN = "{widen:.1f} times ({widen_lower:.1f} to {widen_upper:.1f})"
_SCORES = {
    "coverage": 0.7,
    "variance": 2.5,
    "explained": 0.3,
    "noise_sd": 0.02,
    "correlation_time": 0.0,
    "effective": 60.0,
}
_RESIDUALS = {"correlation": 0.6, "interval": 0.1, "factor": 2.0, "faint": False, "drifting": False}
_POOLED = {
    "runs": 4,
    "coverage": 0.62,
    "lower": 0.5,
    "upper": 0.73,
    "effective": 60.0,
    "least": 0.55,
    "most": 0.7,
    "p_value": 1e-6,
    "explained": 0.8,
    "widen": 1.9,
    "widen_lower": 1.7,
    "widen_upper": 2.2,
}


def _example(code: str, level: Any, values: Mapping[str, Any], *remedies: str) -> Finding:
    return Finding(code, level, ("u",), values, remedies)


_UNCERTAIN = "the stated uncertainty does not describe new runs"
ENTRIES = {
    "prediction-agrees": Entry(
        title="Prediction agrees",
        sentence=lambda values: f"{_explained(values)} and {{coverage:.0%}} lies inside the 90 % band",
        meaning="Errors have the stated size, most of the motion is explained, and residuals are the noise that is modelled.",
        decided="No other finding of this section applies.",
        example=_example("prediction-agrees", "pass", {**_SCORES, "coverage": 0.91, "explained": 0.97}),
    ),
    "channel-not-measured": Entry(
        title="Not measured",
        sentence="nothing was measured of {subject[0]} in this run, so it cannot be judged",
        meaning="The run does not test this channel.",
        decided="The channel has no sample.",
        example=_example("channel-not-measured", "note", {}, "check-map"),
    ),
    "prediction-diverges": Entry(
        title="Prediction diverges",
        sentence="the simulated {subject[0]} grows without bound: the model cannot move as this trial did",
        meaning="Coefficients drive the vehicle instead of damping it, or a unit is wrong.",
        decided="The prediction is not finite, or far beyond all that was measured.",
        example=_example("prediction-diverges", "alarm", {}, "tame-priors"),
        remedies=("fit-as-far", "tame-priors"),
    ),
    "samples-too-few": Entry(
        title="Too few independent samples",
        sentence=_few,
        meaning="Neighbouring errors are alike, so that one sample more inside the band would change the verdict.",
        decided="Fewer than {MIN_EFFECTIVE_SAMPLES:g} independent samples, and no error that even one sample excludes.",
        example=_example("samples-too-few", "note", {**_SCORES, "effective": 4.0, "explained": 0.9}),
    ),
    "errors-beyond-stated": Entry(
        title="Errors beyond the stated ones",
        sentence=lambda values: f"{_sizes(values)}: do not rely on its stated uncertainty",
        meaning="A sensor fault, a wrong unit, another condition (current, load, trim) or a missing term.",
        decided="Less than {BROKEN:.0%} inside the 90 % band, or a variance above {BURST:g}, by more than chance (p < {RARE:g}).",
        example=_example(
            "errors-beyond-stated", "alarm", {**_SCORES, "coverage": 0.2, "variance": 30.0}, "look-at-trial"
        ),
        remedies=("look-at-trial", "look-at-residuals", "fit-as-far"),
    ),
    "band-too-narrow": Entry(
        title="Band too narrow",
        sentence=lambda values: f"{_sizes(values)}: the stated uncertainty is too small",
        meaning=f"In this run {_UNCERTAIN}.",
        decided="Less than {NARROW:.0%} inside the 90 % band, or a variance above {SPREAD:g}, by more than chance (p < {RARE:g}).",
        example=_example("band-too-narrow", "caution", _SCORES, "more-trials"),
        remedies=("more-trials", "outliers-or-term", "fit-as-far"),
    ),
    "band-too-wide": Entry(
        title="Band too wide",
        sentence=lambda values: f"{_sizes(values)}: this trial was quieter than the stated noise",
        meaning="The model predicts more precisely than its band states.",
        decided="More than {WIDE:.0%} inside the 90 % band and a variance below {TAME:g}, by more than chance (p < {RARE:g}).",
        example=_example("band-too-wide", "caution", {**_SCORES, "coverage": 0.99, "variance": 0.3}, "compare-sensors"),
    ),
    "signal-constant": Entry(
        title="Signal constant",
        sentence="the measured {subject[0]} never changes, so the explained share of its motion is undefined",
        meaning="A run without motion does not test the model.",
        decided="All samples are equal.",
        example=_example("signal-constant", "note", {}, "moving-trial"),
    ),
    "coefficients-uncertain": Entry(
        title="Coefficients uncertain",
        sentence=lambda values: (
            f"{_explained(values)}, as the uncertainty of the coefficients allows: they are not known well enough"
        ),
        meaning="The band has the right size, but the coefficients need another trial.",
        decided="Less than {POOR:.0%} of the variance is explained, and the coefficients make most of the band.",
        example=_example("coefficients-uncertain", "caution", _SCORES, "next-trial"),
    ),
    "noise-hides-motion": Entry(
        title="Noise hides the motion",
        sentence=lambda values: (
            f"{_explained(values)}: the residuals of the fit, {_noise(values)}, are as large as the motion of this run"
        ),
        meaning="The run is a weak test of the model.",
        decided="Less than {POOR:.0%} of the variance is explained, and the noise of the fit is more than half of it.",
        example=_example("noise-hides-motion", "note", _SCORES, "move-more"),
    ),
    "predicted-poorly": Entry(
        title="Predicted poorly",
        sentence=lambda values: (
            f"{_explained(values)}: the model misses most of the motion, and its band is wide because of the residuals of the fit, "
            f"{_noise(values)}, not because the coefficients are uncertain"
        ),
        meaning="The run contains an effect that the model lacks.",
        decided="Less than {POOR:.0%} of the variance is explained, and neither noise nor coefficients account for it.",
        example=_example("predicted-poorly", "caution", _SCORES, "add-term", "add-delay", "add-error-model"),
    ),
    "fitted-poorly": Entry(
        title="Fitted poorly",
        sentence=lambda values: f"{_explained(values)}: the model misses most of the motion",
        meaning="The model lacks an effect that the fitted run contains.",
        decided="Less than {POOR:.0%} of the variance of a fitted run is explained, and noise does not account for it.",
        example=_example("fitted-poorly", "caution", _SCORES, "add-term", "add-delay", "estimated-start"),
    ),
    "course-left": Entry(
        title="Unstable course",
        sentence="{words}",
        meaning="The model has an eigenvalue above 0 about the steady motion of the run, so that controls alone predict no whole run. "
        "It is judged over stretches.",
        decided="A small error grows {MIN_GROWTH:g} times along the run, which is not predicted as a whole. It is an alarm if stretches "
        "are not predicted either: less than {MIN_EXPLAINED:.0%} of the variance, or less than by holding the measured value.",
        example=_example(
            "course-left",
            "caution",
            {
                "words": "the fitted model leaves its course by itself: a small error grows by e in 17 s (eigenvalue +0.06 1/s), so that "
                "controls alone cannot predict 150 s of it",
                "horizon": 8.0,
            },
            "filter-error",
        ),
        remedies=("filter-error", "split-runs"),
    ),
    "residuals-correlated": Entry(
        title="Correlated residuals",
        sentence=lambda values: (
            f"{_residuals(values)}: the stated standard deviations are too small, by a factor of about {{factor:.1f}}"
        ),
        meaning="Neighbouring errors are not independent, so the data hold less information than the fit assumes.",
        decided="A factor on standard deviations above {UNDERSTATED:g}, and a p-value below {LIKELY:g}: of white residuals 0.5 % at most "
        "are called correlated.",
        example=_example("residuals-correlated", "caution", _RESIDUALS, "coloured-noise"),
        remedies=("coloured-noise", "drifting-noise"),
    ),
    "residuals-biased": Entry(
        title="Correlated residuals under an autopilot",
        sentence=lambda values: (
            f"{_residuals(values)}: the autopilot feeds these errors into the controls, which biases the coefficients"
        ),
        meaning="More data do not reduce the bias, because errors and controls are correlated.",
        decided="As residuals-correlated, in trials through an autopilot.",
        example=_example("residuals-biased", "caution", _RESIDUALS, "filter-error"),
    ),
    "residuals-opposite": Entry(
        title="Opposite residuals",
        sentence=lambda values: (
            f"{_residuals(values)}: neighbours have opposite errors, and the stated standard deviations are too large"
        ),
        meaning="A sensor or the import filtered or differenced the channel.",
        decided="A factor on standard deviations below 1/{UNDERSTATED:g}, by more than chance (p < {RARE:g}).",
        example=_example("residuals-opposite", "caution", {**_RESIDUALS, "correlation": -0.4}, "check-filtering"),
    ),
    "residuals-beyond-model": Entry(
        title="Correlation beyond the model",
        sentence=lambda values: (
            f"{_residuals(values)} after the fitted correlation is taken out: they have several time scales, and stated standard "
            "deviations are rough"
        ),
        meaning="The model of the noise is too simple, or the vehicle model lacks a term.",
        decided="As residuals-correlated, with coloured or drifting noise.",
        example=_example("residuals-beyond-model", "caution", _RESIDUALS, "missing-term"),
        remedies=("drifting-noise", "missing-term"),
    ),
    "errors-not-normal": Entry(
        title="Errors not normal",
        sentence=_not_normal,
        meaning="Errors have the right size, but stated probabilities are wrong by this much.",
        decided="Distance of the probability transform from uniform above {MISSHAPEN:g}, and beyond chance for the independent samples.",
        example=_example("errors-not-normal", "caution", {"distance": 0.16, "side": 0.8}, "check-bias"),
    ),
    "bands-too-narrow": Entry(
        title="Bands too narrow on new runs",
        sentence=lambda values: f"{_inside(values)}: the stated bands do not hold (p = {{p_value:.1g}})",
        meaning=f"On all held-back runs together {_UNCERTAIN}; do not rely on the ± of the coefficients either.",
        decided="Less than {NARROWER:.0%} inside and the 95 % range excludes 90 %, or one run below {BROKEN:.0%} with p < {RARE:g}.",
        example=_example("bands-too-narrow", "alarm", _POOLED, "widen-bands", "add-term"),
    ),
    "runs-too-few": Entry(
        title="Too few held-back samples",
        sentence=lambda values: f"{_inside(values)}: too few to judge the bands ({_needed()} are needed)",
        meaning="The samples are too few to test the bands on new runs.",
        decided="Fewer than {MIN_POOLED_SAMPLES:g} effective samples in all held-back runs.",
        example=_example("runs-too-few", "note", {**_POOLED, "effective": 8.0}, "hold-back-more"),
    ),
    "motion-not-predicted": Entry(
        title="Motion not predicted",
        sentence=lambda values: f"{_inside(values)}, but {_explained(values)}: the model does not predict this motion",
        meaning="The run's own mean predicts better than the model.",
        decided="The explained share is below zero, and neither noise nor coefficients account for it.",
        example=_example("motion-not-predicted", "alarm", {**_POOLED, "explained": -0.3}, "add-term"),
    ),
    "little-motion-predicted": Entry(
        title="Little motion predicted",
        sentence=lambda values: (
            f"{_inside(values)}, but {_explained(values)}: the bands are as wide as all motion of these runs"
        ),
        meaning="These runs do not show that the model predicts.",
        decided="The explained share is below zero, and noise or coefficients account for it.",
        example=_example("little-motion-predicted", "caution", {**_POOLED, "explained": -0.3}, "hold-back-moving"),
    ),
    "bands-doubtful": Entry(
        title="Bands in doubt",
        sentence=lambda values: (
            f"{_inside(values)}: too few inside, but this may be chance; bands {_WIDEN} as wide would have held 90 %"
        ),
        meaning="The bands may be too narrow; more samples will decide.",
        decided="Less than {NARROWER:.0%} inside, while the 95 % range contains 90 %.",
        example=_example("bands-doubtful", "note", {**_POOLED, "upper": 0.92}, "hold-back-more"),
    ),
    "bands-too-wide": Entry(
        title="Bands too wide on new runs",
        sentence=lambda values: (
            f"{_inside(values)}: bands {_WIDEN} as wide are enough; these runs are quieter than the fitted noise"
        ),
        meaning="The model predicts more precisely than its bands state.",
        decided="More than {WIDE:.0%} inside, the 95 % range above 90 %, and a variance below {TAME:g}.",
        example=_example("bands-too-wide", "caution", {**_POOLED, "coverage": 0.995, "widen": 0.6}),
    ),
    "bands-agree": Entry(
        title="Bands agree",
        sentence=lambda values: f"{_inside(values)}, which does not contradict 90 %",
        meaning="The stated bands hold on runs that were not fitted.",
        decided="No other finding of all held-back runs applies.",
        example=_example("bands-agree", "pass", {**_POOLED, "coverage": 0.9}),
    ),
    "runs-not-measured": Entry(
        title="Held-back runs not measured",
        sentence="nothing was measured of {subject[0]} in held-back runs, so it cannot be judged",
        meaning="The held-back runs do not test this channel.",
        decided="No sample in any held-back run.",
        example=_example("runs-not-measured", "note", {}),
    ),
    "runs-leave-course": Entry(
        title="Unstable course",
        sentence="the bands of {subject[0]} over whole runs cannot be judged, as the vehicle leaves its course by itself",
        meaning="See course-left.",
        decided="Every held-back run leaves its course.",
        example=_example("runs-leave-course", "note", {}),
    ),
    "runs-diverge": Entry(
        title="Held-back runs diverge",
        sentence="the simulated {subject[0]} grows without bound on held-back runs: the model cannot move as they did",
        meaning="Coefficients drive the vehicle instead of damping it, or a unit is wrong.",
        decided="The prediction of a held-back run is not finite.",
        example=_example("runs-diverge", "alarm", {}, "tame-priors"),
    ),
}
REMEDIES = {
    "check-map": Remedy(command="check the channel map"),
    "fit-as-far": Remedy(command="fit a run that goes as far"),
    "look-at-trial": Remedy(
        command="look at this trial for a sensor fault, a wrong unit or another condition (current, load, trim), then add a term or fit "
        "it too"
    ),
    "look-at-residuals": Remedy(command="look at its residuals for outliers, a wrong unit or a missing term"),
    "more-trials": Remedy(command="fit more trials like it, or add a term"),
    "outliers-or-term": Remedy(command="look for outliers or a missing term"),
    "compare-sensors": Remedy(command="check whether the trials have the same sensors"),
    "moving-trial": Remedy(command="test on a trial that moves"),
    "next-trial": Remedy(command="run the next trial that is proposed"),
    "move-more": Remedy(command="use a run that moves more, or add a term if the sensor is better than that"),
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
    "coloured-noise": Remedy(
        command='set estimation.residuals = "coloured", and for each channel add a section of its correlation time in s, here '
        f"[prior.tau_{{subject[0]}}], for example with {TIME_PRIOR}",
        python='give the sensors noise="coloured", and a prior of tau_{subject[0]}',
        page="choose coloured residuals on the model page",
    ),
    "drifting-noise": Remedy(
        command='set estimation.residuals = "drifting", white noise on a slow error; remove [prior.tau_{subject[0]}] where there is one',
        python='give the sensors noise="drifting"',
        page="choose drifting residuals on the model page",
    ),
    "missing-term": Remedy(command="look for a missing term"),
    "check-filtering": Remedy(command="check whether the sensor or the import filtered or differenced the channel"),
    "check-bias": Remedy(command="look for a bias of the sensor or outliers"),
    "widen-bands": Remedy(
        command=f"widen the bands {_WIDEN}, and do not rely on the standard deviations of the coefficients either"
    ),
    "hold-back-more": Remedy(command="hold back more or longer runs"),
    "hold-back-moving": Remedy(command="hold back runs that move more"),
}
