"""Messages about evidences and the choice between structures."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.display_units import shown_unit
from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.selection.contenders import STANDING
    from seatrial.selection.cross_validation import CLEAR, EXCLUDED, MAX_CHANCE, SMALL_CRPS
    from seatrial.selection.method_agreement import MAX_JOINT_ERRORS
    from seatrial.selection.stack import SMALL

    return {
        "MAX_JOINT_ERRORS": MAX_JOINT_ERRORS,
        "CLEAR": CLEAR,
        "EXCLUDED": EXCLUDED,
        "MAX_CHANCE": MAX_CHANCE,
        "SMALL": SMALL,
        "STANDING": STANDING,
        "SMALL_CRPS": SMALL_CRPS,
    }


def _contradicted(values: Mapping[str, Any]) -> str:
    text = "evidence and runs left out disagree: {subject:and} has probability {probability:.3f} by its evidence, but "
    text += {
        "all": "{other} predicts runs left out better by {delta:.1f} ± {std_error:.1f} nats",
        "channel": "{other} simulates {where} of runs left out more closely, by a mean CRPS of {delta:.2g} ± {std_error:.2g}",
        "run": "{other}, which it excludes, predicts {where} better by {delta:.1f} nats (a chance of at most {chance:.0e} "
        "if {subject:and} is right)",
    }[values["kind"]]
    return f"{text}: do not rely on that probability"


ERROR_MODELS = {
    "white": "independent errors of each sample",
    "coloured": "errors correlated in time",
    "drifting": "white noise plus a slow error",
    "heavy": "independent errors with outliers",
    "proportional": "independent errors, a part of them in proportion to the signal",
    "process noise": "random forces on every state",
    "disturbance": "a force with memory along {axes:and}",
}


def _better(values: Mapping[str, Any]) -> str:
    text = '{subject:and} with the error model "{error_model}"' + f" ({ERROR_MODELS[values['error_model']]}) "
    closer = (
        "the CRPS of a whole run is {closer:.0%} ± {closer_error:.0%} smaller"
        if values["bounded"]
        else "the other diverges"
    )
    if not values["forecasts"]:
        return f"{text}simulates runs left out more closely than as stated: {closer}. Forecasts from now do not need it"
    text += "predicts runs left out better than the best structure as stated, by {delta:.1f} ± {std_error:.1f} nats"
    apart = f". Use it for forecasts from now, and {{whole_run}} for predictions of a whole run: {closer}"
    return text + apart * bool(values["whole_run"])


def _blocks(values: Mapping[str, Any]) -> str:
    runs = "run" if values["runs"] == 1 else "runs"
    return f"blocks of time of {{runs}} {runs} were left out, not runs: another run may be predicted worse"


def _disagree(values: Mapping[str, Any]) -> str:
    factor, unit = shown_unit(values["subject"][0])
    spread, stated = (f"{values[name] * factor:.2g} {unit}" for name in ("spread", "stated"))
    place = " in {trial}" if "trial" in values else ""
    return (
        f"{{labels:and}}, which the data do not separate, predict {{subject[0]}} differently{place}: the standard deviation "
        f"between them is {spread}, that of {{labels[0]}} is {stated}"
    )


ENTRIES = {
    "evidence-contradicted": Entry(
        title="Runs left out contradict the evidence",
        sentence=_contradicted,
        meaning="The evidence assumes that the model of the error is right. If it is wrong, the evidence can strongly prefer a structure "
        "that predicts another run worse.",
        decided="Another structure predicts runs left out better: by {CLEAR:g} standard errors and {SMALL:g} nats, or by {CLEAR:g} "
        "standard errors of the CRPS. Or a structure with a probability below {EXCLUDED:g} predicts one run better, with a chance of "
        "at most {MAX_CHANCE:g} in any run.",
        example=Finding(
            "evidence-contradicted",
            "alarm",
            ("M-0",),
            {
                "probability": 0.982,
                "other": "M-1",
                "kind": "all",
                "where": "",
                "delta": 32.0,
                "std_error": 1.0,
                "chance": 1e-14,
            },
        ),
    ),
    "error-model-better": Entry(
        title="Another model of the error predicts better",
        sentence=_better,
        meaning="Each ± and probability depends on the model of the error, and another one describes runs left out better.",
        decided="The difference exceeds its standard error over runs and {SMALL:g} nats. The difference of the CRPS, relative to the "
        "setting of the campaign and averaged over channels, exceeds its standard error and {SMALL_CRPS:.0%}.",
        example=Finding(
            "error-model-better",
            "caution",
            ("M-1",),
            {
                "error_model": "disturbance",
                "axes": ("X", "N"),
                "delta": 85.0,
                "std_error": 12.0,
                "forecasts": True,
                "whole_run": "M-1 (error as stated)",
                "bounded": True,
                "closer": 0.12,
                "closer_error": 0.05,
            },
            ("take-error-model",),
        ),
    ),
    "advice-not-tried": Entry(
        title="Advice not tried",
        sentence="advice to change the model of the error was not tried on runs left out",
        meaning="The best model of the error differs from record to record.",
        decided="Residuals are slow or bands fail, and there is no current result of runs left out.",
        example=Finding("advice-not-tried", "note", (), {}, ("try-error-models",)),
    ),
    "advice-tried": Entry(
        title="Advice tried without gain",
        sentence="no other model of the error predicts runs left out clearly better, so keep the present one. The best other one is "
        '"{error_model}", by {delta:+.1f} ± {std_error:.1f} nats',
        meaning="Advice to change the model of the error does not improve predictions of this vehicle.",
        decided="Residuals are slow or bands fail, and no other model of the error is recommended (error-model-better).",
        example=Finding("advice-tried", "note", (), {"error_model": "drifting", "delta": 3.0, "std_error": 12.0}),
    ),
    "structures-disagree": Entry(
        title="Structures disagree",
        sentence=_disagree,
        meaning="Outside the fitted range each structure continues as its terms do, and the band of one does not include the others. "
        "Predictions of held-back runs average over all of them.",
        decided="The standard deviation between structures within {STANDING:g} nats of the best exceeds the stated one, including noise.",
        example=Finding(
            "structures-disagree",
            "caution",
            ("r",),
            {"labels": ("M-0", "M-2"), "spread": 0.02, "stated": 0.008, "run": "circle"},
            ("decide-structure",),
        ),
    ),
    "runs-in-pieces": Entry(
        title="Pieces of the same runs",
        sentence="{subject:and} are pieces of the same long runs, so they share conditions with the pieces that are fitted",
        meaning="Another run has other conditions, so it may be predicted worse.",
        decided="A run that was left out is a piece of one that `[import] split` cuts.",
        example=Finding("runs-in-pieces", "caution", ("a 1", "a 2")),
    ),
    "blocks-left-out": Entry(
        title="Blocks of time instead of runs",
        sentence=_blocks,
        meaning="Blocks of one run share its trim, its current and its errors of the start.",
        decided="There are too few fitted runs to leave whole runs out.",
        example=Finding("blocks-left-out", "caution", (), {"runs": 2, "needed": 3}, ("fit-more-runs",)),
    ),
    "evidence-check-blunt": Entry(
        title="Check of an evidence too coarse",
        sentence="the decision on {subject:and} would change if the evidence of {label} were wrong by {needed:.2g} nat; its check resolves "
        "{resolution:.2g} nat",
        meaning="A second method confirms the evidence, but with a larger error than the decision allows.",
        decided="The probability of a term passes the one that decides within {MAX_JOINT_ERRORS:g} joint errors of the two methods.",
        example=Finding(
            "evidence-check-blunt",
            "caution",
            ("X_u",),
            {"label": "M-1", "resolution": 0.8, "needed": 0.4},
            ("sharpen-evidence",),
        ),
    ),
    "evidence-within-model": Entry(
        title="Probabilities within the model",
        sentence="the probabilities of models and terms hold only if the noise and everything stated are right",
        meaning="With process noise, or with your density, evidences cannot include every error. A slow error of a sensor, a wrong mass or "
        "a lag can then look like a term.",
        decided="The evidence with every error is not known for these models.",
        example=Finding("evidence-within-model", "caution"),
    ),
}
REMEDIES = {
    "decide-structure": Remedy(command="fit a run like it, which separates the structures"),
    "try-error-models": Remedy(
        command="try it, and also a force with memory, by `seatrial crossvalidate`",
        python="compare models of the error by `leave_one_run_out`",
    ),
    "fit-more-runs": Remedy(command="fit at least {needed} runs, so that whole runs can be left out"),
    "take-error-model": Remedy(
        command="put the lines that `seatrial crossvalidate` prints into campaign.toml",
        python="give its priors and sensors to make_posterior",
    ),
    "sharpen-evidence": Remedy(
        command="raise `particles` or `repeats` of [selection]",
        python="raise `repeats`, or the particles of `smc`, of EvidenceSettings",
    ),
}
