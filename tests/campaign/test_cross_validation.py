"""Runs left out, as a stored command: what is said first, which error model is recommended, and campaigns that cannot have it."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.cross_validation import best_campaign, cross_validate, current_cross_validation
from seatrial.campaign.inference.error_models import error_models, with_error_model
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.core.errors import NumericalError
from seatrial.core.findings import Finding
from seatrial.core.serialise import from_plain, to_plain
from seatrial.estimation.prediction.fit_verdict import judge_runs
from seatrial.estimation.prediction.prediction_scores import DIVERGES, unscored
from seatrial.messages.cross_validation import complaints, cross_validation_lines, disagreement, rows
from seatrial.messages.render import sentence
from seatrial.messages.selection import ERROR_MODELS
from seatrial.selection.cross_validation import (
    OWN,
    Candidate,
    CrossValidation,
    LeaveOneRunOut,
    LeftOutRun,
    advice_tried,
    gap,
)
from seatrial.selection.structures import Structure
from tests.campaign.small import write_small


def candidate(label, elpd, evidence, crps, error=OWN, lines=()):
    """One structure of three runs."""
    runs = tuple(
        LeftOutRun(name, value, 0.1, 0.2, False, {"u": replace(unscored(100, ""), crps=score, coverage=0.88)})
        for name, value, score in zip("abc", elpd, crps, strict=False)
    )
    left = LeaveOneRunOut(runs, {"u": judge_runs([], "u")}, evidence, "")
    return Candidate(Structure(label, ("X_u", label)), error, tuple(lines), left)


def with_elpd(one, elpd):
    """The same candidate with other scores of its runs."""
    runs = tuple(replace(run, elpd=value) for run, value in zip(one.result.runs, elpd, strict=True))
    return replace(one, left=replace(one.result, runs=runs))


LIKELY = candidate("M-0", (10.0, 11.0, 12.0), -100.0, (0.020, 0.021, 0.022))
BETTER = candidate("M-1", (20.0, 22.0, 23.0), -104.0, (0.020, 0.021, 0.021))


def found(*candidates):
    return CrossValidation(("a", "b", "c"), candidates, ())


def test_contradiction_is_said_first():
    both = found(LIKELY, BETTER)
    first = cross_validation_lines(both)[0]
    assert first == disagreement(both)
    assert "evidence and runs left out disagree: M-0 has probability 0.982" in first
    assert "M-1 predicts runs left out better by 32.0 ± 1.0 nats" in first


def test_disagreement_by_crps_alone():
    closer = candidate("M-1", (10.0, 11.0, 12.5), -104.0, (0.010, 0.012, 0.011))
    said = disagreement(found(LIKELY, closer))
    assert "simulates u of runs left out more closely" in said
    assert "nats" not in said


def test_one_run_that_is_predicted_much_better_contradicts_an_exclusion():
    """Ten nats have a chance of 5e-5 if the preferred structure is right; five may be chance among three runs."""
    lucky = candidate("M-1", (20.0, 11.0, 12.0), -104.0, (0.020, 0.021, 0.022))
    said = disagreement(found(LIKELY, lucky))
    assert "M-1, which it excludes, predicts a better by 10.0 nats (a chance of at most 5e-05 if M-0 is right)" in said
    assert not disagreement(found(LIKELY, with_elpd(lucky, (15.0, 11.0, 12.0))))
    assert not disagreement(found(LIKELY, replace(lucky, left=replace(lucky.result, log_evidence=-101.0))))


def test_differences_are_paired_by_run():
    apart = gap(candidate("M-1", (3.0, 5.0, 4.0), 0.0, (1.0,) * 3), candidate("M-0", (1.0,) * 3, 0.0, (1.0,) * 3))
    assert (apart.delta, apart.std_error) == pytest.approx((9.0, np.sqrt(3.0)))


def test_clearly_better_error_model_is_recommended_with_its_lines():
    lines = ("[estimation]", 'residuals = "coloured"', "[prior.tau_u]", 'distribution = "log-uniform"', "lower = 0.05")
    slow = candidate("M-0", (40.0, 42.0, 41.0), -60.0, (0.02, 0.02, 0.02), "coloured", lines)
    said = cross_validation_lines(found(LIKELY, slow))
    assert found(LIKELY, slow).chosen is slow
    assert said[0] == "recommended: M-0 (X_u M-0), error coloured: it predicts best"
    assert "    residuals" in "\n".join(said)
    assert "by 90.0 ± 1.7 nats" in complaints(found(LIKELY, slow))[0]
    close = found(LIKELY, with_elpd(slow, (10.1, 11.2, 12.1)))
    assert close.chosen is LIKELY
    assert "which 3 parts cannot resolve" in cross_validation_lines(close)[0]
    assert not complaints(close)


def test_forecasts_and_whole_runs_may_need_different_models():
    """By density the force with memory predicts better; its free simulation of a whole run is worse by a quarter."""
    force = candidate("M-0", (40.0, 42.0, 41.0), -60.0, (0.025, 0.026, 0.028), "disturbance", ("[estimation]",))
    force = replace(force, parameters=(("disturbance_X", 1.0, 0.1), ("disturbance_N", 1.0, 0.1)))
    both = found(LIKELY, force)
    assert (both.chosen, both.whole_run) == (force, LIKELY)
    assert both.stack is not None
    assert [one.crps for one in both.stack.members] == pytest.approx([79 / 63, 1.0])
    said = cross_validation_lines(both)
    assert said[0] == "recommended for forecasts from now: M-0 (X_u M-0), error disturbance: it predicts best"
    assert said[1].startswith(
        "recommended for predictions of a whole run: M-0 (X_u M-0), error as stated: its CRPS is 25% ±"
    )
    assert "(a force with memory along X and N)" in complaints(both)[0]
    assert "and M-0 (error as stated) for predictions of a whole run" in complaints(both)[0]
    as_close = replace(force, left=replace(force.result, runs=LIKELY.result.runs))
    again = found(LIKELY, with_elpd(as_close, (40.0, 42.0, 41.0)))
    assert again.whole_run is again.chosen is again.candidates[1]


def test_a_model_that_diverges_is_for_no_whole_run():
    first, *others = LIKELY.result.runs
    lost = replace(first, scores={"u": unscored(100, DIVERGES)})
    own = replace(LIKELY, left=replace(LIKELY.result, runs=(lost, *others)))
    bounded = candidate("M-0", (1.0, 1.0, 1.0), -60.0, (0.04, 0.04, 0.04), "heavy", ("[estimation]",))
    both = found(own, bounded)
    assert (both.chosen, both.whole_run) == (own, bounded)
    said = cross_validation_lines(both)
    assert said[1].endswith("error heavy: it does not diverge")
    assert rows(both)[0][3] == "diverges"
    assert "the other diverges" in complaints(both)[0]


def test_a_model_for_whole_runs_alone_is_recommended_for_them():
    closer = candidate("M-0", (10.0, 11.0, 12.0), -60.0, (0.012, 0.011, 0.013), "drifting", ("[estimation]",))
    said = complaints(found(LIKELY, closer))
    assert "simulates runs left out more closely than as stated: the CRPS of a whole run is 43% ±" in said[0]
    assert "    [estimation]" in cross_validation_lines(found(LIKELY, closer))


def test_advice_is_tried_or_says_that_it_was_not():
    slow = [Finding("residuals-correlated", "caution", ("u",), {}, ("drifting-noise",))]
    (none,) = advice_tried(slow, None)
    assert sentence(none).endswith("Try it, and also a force with memory, by `seatrial crossvalidate`")
    drifting = candidate("M-0", (10.1, 11.2, 12.1), -60.0, (0.02, 0.02, 0.02), "drifting", ("[estimation]",))
    (tried,) = advice_tried(slow, found(LIKELY, drifting))
    assert '"drifting", by +0.4 ± 0.1 nats' in sentence(tried)
    better = with_elpd(drifting, (40.0, 42.0, 41.0))
    assert not advice_tried(slow, found(LIKELY, better))
    assert not advice_tried(["another caution"], None)


def test_table_has_the_weights():
    stack = found(LIKELY, BETTER).stack
    assert stack is not None
    assert [one.model for one in stack.members] == ["M-1", "M-0"]
    assert [one.weight for one in stack.members] == pytest.approx([1.0, 0.0], abs=1e-3)
    assert (stack.members[1].delta, stack.contradicts) == (-32.0, True)
    assert rows(found(LIKELY, BETTER))[0][2:5] == ("1.00", "1.00", "best")


def test_what_was_refused_is_told_and_not_scored():
    none = Candidate(Structure("M-0", ("X_u",)), "process noise", ("[estimation]",), refused="a lag")
    all_of = found(LIKELY, none)
    assert complaints(all_of) == ["M-0, process noise: a lag"]
    assert len(rows(all_of)) == 1


def test_cross_validation_survives_json():
    both = found(LIKELY, BETTER)
    again = from_plain(CrossValidation, to_plain(both))
    assert again == both
    assert np.isclose(again.probability(LIKELY), 1 / (1 + np.exp(-4.0)))


@pytest.mark.parametrize(
    ("code", "level", "kind"), [("prediction-diverges", "alarm", "fail"), ("channel-not-measured", "note", "unjudged")]
)
def test_bands_are_judged(code, level, kind):
    bands = replace(LIKELY.result.bands["u"], verdict=Finding(code, level, ("u",)))
    judged = replace(LIKELY, left=replace(LIKELY.result, bands={"u": bands}))
    assert f"each left out in turn: {kind};" in cross_validation_lines(found(judged))[1]


RPM = 2 * np.pi / 60


def three_runs(count=3):
    """Runs of the small campaign's true vehicle, each with another input, and noise that is white."""
    model = st.load_vehicle("remus100_surge").build(free=["X_u", "X_uabsu", "T_nabsn"])
    truth = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.05}
    records = []
    for i in range(count):
        family = st.Family("n", 750 * RPM, duration=30.0, active=20.0, sample_time=0.1, kind="doublet")
        schedule = family.schedule((100 + 50 * i) * RPM, 10.0)
        record = st.simulate(model, truth, schedule, ["u"], start={"u": 1.542}, key=i)
        records.append(replace(record, label=f"run {i}"))
    return Trials(tuple(records), (), "three runs")


def test_lines_of_every_error_model_are_what_it_does(tmp_path):
    """The lines read as TOML are the settings and priors with which it was computed; nobody has to guess a prior."""
    campaign, trials = load_campaign(write_small(tmp_path)), three_runs()
    values = {"X_u": -1.2, "X_uabsu": -2.9, "T_nabsn": 6e-4}
    found = {one.name: one for one in error_models(campaign, campaign.full, trials.fit, values)}
    assert list(found) == ["coloured", "drifting", "heavy", "process noise", "disturbance"]
    assert found.keys() < ERROR_MODELS.keys()
    for error in found.values():
        tables = tomllib.loads("\n".join(error.lines()))
        changed = with_error_model(campaign, campaign.full, error)
        for key, value in tables["estimation"].items():
            assert getattr(changed.estimation, key) == value
        added = set(changed.priors) - set(campaign.priors)
        assert added == set(tables.get("prior", {}))
        build_posterior(changed, campaign.full, trials.fit)
    # the vehicle of 31.4 kg is pushed to its own speed's spread in one second
    speeds = np.mean([np.nanstd(record.channel("u")) for record in trials.fit])
    assert found["disturbance"].priors["disturbance_X"]["upper"] == pytest.approx(31.4 * speeds, rel=0.05)


def test_the_best_campaign_has_one_structure_and_another_error_model_only_where_that_is_clearly_better(tmp_path):
    campaign, trials = load_campaign(write_small(tmp_path)), three_runs()
    parameters = (("X_u", -1.2, 0.3), ("X_uabsu", -2.9, 0.2), ("T_nabsn", 6e-4, 1e-5))
    likely, better = (
        replace(one, structure=Structure(one.structure.label, structure.terms), parameters=parameters)
        for one, structure in zip((LIKELY, BETTER), campaign.structures, strict=True)
    )
    stated = best_campaign(campaign, trials, found(likely, better))
    assert [one.label for one in stated.structures] == ["M-1"]
    assert stated.estimation == campaign.estimation
    slow = with_elpd(replace(likely, error_model="coloured"), (40.0, 42.0, 41.0))
    changed = best_campaign(campaign, trials, found(likely, better, slow))
    assert [one.label for one in changed.structures] == ["M-0"]
    assert changed.estimation.residuals == "coloured"
    assert "tau_u" in changed.priors
    chance = with_elpd(slow, (20.1, 22.1, 23.1))
    assert best_campaign(campaign, trials, found(likely, better, chance)).estimation == campaign.estimation
    with pytest.raises(NumericalError, match="no mode"):
        best_campaign(campaign, trials, found(replace(likely, refused="no mode")))


@pytest.mark.proof
def test_white_noise_recommends_nothing_else(tmp_path):
    campaign = load_campaign(write_small(tmp_path))
    made = cross_validate(campaign, three_runs())
    assert [one.name for one in made.own] == ["M-0", "M-1"]
    assert {one.error_model for one in made.candidates} == {
        OWN,
        "coloured",
        "drifting",
        "heavy",
        "process noise",
        "disturbance",
    }
    assert made.chosen is not None
    assert made.chosen.error_model == OWN
    assert not disagreement(made)
    assert max(one.result.k_hat for one in made.own) < 0.7
    again = current_cross_validation(campaign, three_runs())
    assert again is not None
    assert again.candidates == made.candidates
