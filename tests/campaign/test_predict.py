"""What is said of trials: one verdict for each, one sentence for those with the same trouble, the graver first."""

import json
from dataclasses import replace

import numpy as np

from seatrial.campaign.inference.judge_predictions import (
    HeldBack,
    disowned,
    fit_complaints,
    held_back_alarms,
    held_back_lines,
    trial_verdicts,
)
from seatrial.campaign.store.predictions import Fit
from seatrial.core.serialise import from_plain, to_plain
from seatrial.estimation.prediction.fit_verdict import judge_fit, judge_runs
from seatrial.estimation.prediction.prediction_scores import PredictedRun, Score
from seatrial.messages.render import MAX_RUNS_NAMED, remedy, sentences

NUMBERS = {
    "nrmse": 0.5,
    "rmse": 0.1,
    "crps": 0.06,
    "log_score": 1.0,
    "coverage_50": 0.5,
    "lower": 0.6,
    "upper": 0.9,
    "widen": 1.3,
    "widen_lower": 1.2,
    "widen_upper": 1.4,
    "pit": (0.1,) * 10,
}


def fit(record, *, held_back=False, channel="u", coverage=0.9, variance=1.0, explained=0.9, factor=1.0):
    score = Score(
        1000,
        500.0,
        explained,
        **NUMBERS,
        coverage=coverage,
        p_value=0.5 if coverage > 0.85 else 1e-9,
        variance=variance,
        white=0.5 if factor == 1.0 else 1e-9,
        sd_factor=factor,
        noise_share=0.1,
        noise_sd=0.02,
        coefficient_share=0.1,
    )
    verdict = judge_fit(score, channel, held_back, "white")
    return Fit(**vars(score), record=record, held_back=held_back, channel=channel, verdict=verdict)


def test_a_trial_is_as_bad_as_its_worst_channel():
    fits = [fit("1"), fit("1", channel="udot", coverage=0.7, variance=2.5), fit("2")]
    verdicts = trial_verdicts(fits)
    assert {label: verdict.level for label, verdict in verdicts.items()} == {"1": "caution", "2": "pass"}
    assert verdicts["1"].subject == ("udot",)


def test_complaints_are_few_and_the_gravest_is_first():
    fits = [
        fit("1"),
        fit("2", factor=2.0),
        fit("3", factor=2.4),
        fit("4", held_back=True, coverage=0.2, variance=30.0),
    ]
    (alarm,) = sentences(held_back_alarms(fits, []))
    assert alarm.startswith("held-back run 4: 20% of u lies inside the 90 % band")
    (said,) = sentences(fit_complaints(fits))
    assert said.startswith("run 2: residuals of u are correlated: ")
    assert "by a factor of about 2.0; likewise 3. Set estimation.residuals" in said
    assert fit_complaints(fits[:1]) == []


def test_correlated_residuals_of_all_channels_are_one_caution():
    fits = [fit(run, channel=channel, factor=2.0) for run in ("a", "b") for channel in ("u", "r", "udot")]
    (said,) = sentences(fit_complaints(fits))
    assert said.startswith("run a: residuals of u are correlated: ")
    assert "; likewise b; likewise r of a, b; likewise udot of a, b. Set estimation.residuals" in said
    assert disowned(fits) == said
    assert disowned(fits[:0]) == ""


def test_what_to_do_is_told_once_for_all_channels_and_runs():
    narrow = [fit(run, channel=channel, coverage=0.7, variance=2.5) for channel in ("u", "r") for run in ("a", "b")]
    (said,) = sentences(fit_complaints(narrow))
    assert said.endswith(
        "; likewise b; likewise r of a, b. Look in its residuals for outliers, a wrong unit or a missing term"
    )
    assert narrow[0].finding == narrow[0].statement
    assert narrow[0].reason == f"{narrow[0].statement}; {narrow[0].advice}"


def test_where_a_run_leaves_the_fitted_range_is_told_once():
    outside = ("u up to 2 m/s (fitted up to 1)",)
    poor = replace(fit("a", held_back=True, explained=0.3), outside=outside)
    (first, left) = sentences(fit_complaints([poor, replace(fit("b", held_back=True), outside=outside)]))
    assert "; outside the fitted range: u up to 2 m/s (fitted up to 1). Add a term" in first
    assert left == "held-back run b leaves the fitted range: u up to 2 m/s (fitted up to 1)"


def pooled(scale):
    """Four held-back runs of independent errors of this size."""
    time, random = np.arange(300) * 0.1, np.random.default_rng(1)
    motion, none = np.sin(time), np.zeros(300)
    return judge_runs(
        [PredictedRun(time, motion + scale * random.normal(size=300), motion, none, 0.1) for _ in range(4)], "u"
    )


def test_held_back_runs_that_fail_together_are_an_alarm_even_where_none_fails_alone():
    fits = [fit(str(i), held_back=True, coverage=0.75) for i in range(4)]
    (alarm,) = held_back_alarms(fits, [pooled(0.2)])
    assert (alarm.code, alarm.level) == ("band-too-narrow", "alarm")
    assert "widen the bands 2.0 times" in remedy(alarm)
    assert held_back_alarms(fits, [pooled(0.1)]) == []


def test_what_could_not_be_judged_is_said_and_is_no_alarm():
    time = np.arange(3) * 0.1
    few = judge_runs([PredictedRun(time, np.array([0.1, -0.1, 0.1]), np.zeros(3), np.zeros(3), 0.1)], "u")
    assert held_back_alarms([], [few]) == []
    (found,) = fit_complaints([], [few])
    assert found.level == "note"


def test_lines_say_worse_than_the_mean_and_by_how_much_where_a_percentage_would_be_negative():
    lines = held_back_lines(HeldBack((fit("5", held_back=True, explained=-1.84),), (pooled(0.1),)))
    assert (
        lines[0] == "held-back run 5: u        caution; worse than the run's own mean (-184%), 90% inside the 90 % band"
    )
    assert lines[1].startswith("held-back runs together: pass; ")


def test_many_trials_with_one_trouble_are_counted_and_not_listed():
    said = sentences(fit_complaints([fit(str(i), held_back=True, explained=0.3) for i in range(20)]))
    assert len(said) == 1
    assert "; likewise " + ", ".join(map(str, range(1, MAX_RUNS_NAMED + 1))) + ", others. Add " in said[0]


def test_a_fit_is_plain_numbers_and_words():
    one = fit("1", held_back=True)
    assert from_plain(Fit, json.loads(json.dumps(to_plain(one), allow_nan=False))) == one
