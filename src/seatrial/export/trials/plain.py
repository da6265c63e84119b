"""A trial as CSV and as JSON, its limits at the head."""

import json

from seatrial.export.trials.trial import Trial

FORMAT = 1


def trial_csv(trial: Trial) -> str:
    """Return time and control at every bend and neutral at the end, in the operator's unit; lines with # repeat the limits."""
    factor, unit = trial.shown
    rows = (f"{t:.10g},{x * factor:.10g}\n" for t, x in zip(*trial.ending_neutral, strict=True))
    return "".join(f"# {line}\n" for line in trial.lines) + f"time_s,{trial.control}_{unit}\n" + "".join(rows)


def trial_json(trial: Trial) -> str:
    """Return the same with SI values beside, format 1."""
    factor, unit = trial.shown
    time, value = trial.ending_neutral
    content = {
        "format": FORMAT,
        "about": list(trial.lines),
        "control": trial.control,
        "interpolation": "straight lines between rows",
        "time_s": [float(t) for t in time],
        "value": [float(x * factor) for x in value],
        "unit": unit,
        "value_si": [float(x) for x in value],
        "unit_si": trial.unit,
        "limits_si": {"lower": trial.lower, "upper": trial.upper, "rate": trial.rate},
        "limits_of_motion": list(trial.motion),
        "rule": trial.rule,
    }
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
