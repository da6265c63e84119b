"""What is said of trials: one verdict for each, one sentence for those with the same trouble, the graver first."""

import json

from seatrial.campaign.inference.predict import MOST_NAMED, fit_complaints, trial_verdicts
from seatrial.campaign.store.estimates import Fit
from seatrial.estimation.fit_verdict import judge_fit
from seatrial.estimation.validation import Score

NUMBERS = {
    "nrmse": 0.5,
    "rmse": 0.1,
    "crps": 0.06,
    "log_score": 1.0,
    "coverage_50": 0.5,
    "pit": (0.1,) * 10,
    "pit_distance": 0.01,
}


def fit(record, *, held_back=False, channel="u", coverage=0.9, variance=1.0, explained=0.9, correlation=0.0, white=0.5):
    score = Score(
        1000,
        500.0,
        explained,
        **NUMBERS,
        coverage=coverage,
        variance=variance,
        correlation=correlation,
        interval=0.1,
        white=white,
        noise_share=0.1,
    )
    verdict = judge_fit(score, channel, held_back, False)
    return Fit(**vars(score), record=record, held_back=held_back, channel=channel, **verdict._asdict())


def test_a_trial_is_as_bad_as_its_worst_channel():
    fits = [fit("1"), fit("1", channel="udot", coverage=0.7, variance=2.5), fit("2")]
    verdicts = trial_verdicts(fits)
    assert {label: verdict.level for label, verdict in verdicts.items()} == {"1": "caution", "2": "pass"}
    assert "udot" in verdicts["1"].reason


def test_complaints_are_few_and_the_gravest_is_first():
    fits = [
        fit("1"),
        fit("2", correlation=0.6, white=1e-9),
        fit("3", correlation=0.7, white=1e-9),
        fit("4", held_back=True, coverage=0.2, variance=30.0),
    ]
    said = fit_complaints(fits)
    assert len(said) == 2
    assert said[0].startswith("held-back run 4: 20% of u lies inside the 90 % band")
    assert said[1].startswith("run 2: residuals of u are correlated (+0.60 over 0.1 s)")
    assert said[1].endswith("; likewise 3")
    assert fit_complaints(fits[:1]) == []


def test_many_trials_with_one_trouble_are_counted_and_not_listed():
    said = fit_complaints([fit(str(i), held_back=True, explained=0.3) for i in range(20)])
    assert len(said) == 1
    assert said[0].endswith(", ".join(map(str, range(1, MOST_NAMED + 1))) + ", others")


def test_a_fit_is_plain_numbers_and_words():
    one = fit("1", held_back=True)
    assert Fit(**{**json.loads(json.dumps(vars(one), allow_nan=False)), "pit": one.pit}) == one
