"""Trial after trial: goals that are met, models that are wrong, records that are kept; settling by simulation."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.config.templates import init_campaign
from seatrial.campaign.data import simulate as simulated
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.simulate import Chosen, add_trial, later_trials
from seatrial.campaign.workflow import loop as sequence
from seatrial.campaign.workflow.loop import run_sequence
from seatrial.campaign.workflow.next_trial import Proposal, propose, settling
from seatrial.core.errors import InputError
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.messages.catalogue import ENTRIES
from seatrial.report.sections.summary import answer, summary_section
from tests.campaign.small import SMALL
from tests.report.outcomes import make_outcome, make_pooled

ONE = SMALL.replace('optional = ["X_u"]', "").replace('always = ["X_uabsu"', 'always = ["X_u", "X_uabsu"')


def written(folder, text):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder)


def test_a_sequence_runs_what_is_proposed_until_the_goal_allows_no_more(tmp_path, monkeypatch):
    """The loop and its proposals by name only: every trial proposed is added, and the third is the last."""
    campaign = written(tmp_path, ONE + '\n[goal]\nsd = { X_u = "15 %" }\ntrials = 3\n')

    def run_loop(campaign, reporter):
        return SimpleNamespace(trials=SimpleNamespace(fit=range(1 + len(later_trials(campaign)))))

    monkeypatch.setattr(sequence, "run_loop", run_loop)
    monkeypatch.setattr(
        sequence, "propose", lambda outcome: Proposal(Chosen("step", 5.0, 4.0), ("standing",), ("run it",))
    )
    outcome, proposal = run_sequence(campaign)
    assert len(outcome.trials.fit) == 3
    assert later_trials(campaign) == (Chosen("step", 5.0, 4.0),) * 2
    assert proposal.lines == ("standing", "stop: 3 trials are run, the most that [goal] allows")
    monkeypatch.setattr(sequence, "propose", lambda outcome: Proposal(None, (), ("stop: the goal is met",)))
    assert run_sequence(campaign)[1].trial is None
    assert len(later_trials(campaign)) == 2


@pytest.mark.proof
def test_a_lag_that_no_structure_has_is_told_and_stops_the_sequence(tmp_path):
    """A second of lag in four doublets of 30 s: every coefficient would be wrong by several of its standard deviations."""
    text = ONE.replace("[truth]", "[truth]\nlag_n = 1.0").replace('noise = "0.05 m/s"', 'noise = "0.02 m/s"')
    campaign = written(tmp_path, text + '\n[goal]\nsd = { X_u = "1 %" }\n')
    outcome, proposal = run_sequence(campaign)
    (effect, *_) = outcome.chosen.left_out
    assert ("command lag", "n") in effect.values["effects"]
    assert abs(effect.values["shift"]) > 1
    assert proposal.trial is None
    assert any("the model lacks" in line for line in proposal.lines)
    assert any("the model lacks" in text for text in outcome.summary.cautions)


@pytest.mark.parametrize(("current", "said"), [(2.0, 1), (0.3, 0)])
def test_a_current_faster_than_the_vehicle_is_told(tmp_path, monkeypatch, current, said):
    """By name only: nothing is simulated."""
    campaign, lines = written(tmp_path, ONE.replace("[truth]", f"[truth]\ncurrent = {current}")), []
    monkeypatch.setattr(simulated, "is_current", lambda path, key: True)
    monkeypatch.setattr(simulated, "read_record", lambda path: None)
    monkeypatch.setattr(simulated, "later_trials", lambda campaign: ())
    simulated.simulated_records(campaign, SimpleNamespace(say=lines.append))
    assert len(lines) == said
    assert all(f"current of {current:g} m/s is faster than the vehicle at trim" in line for line in lines)


@pytest.mark.proof
def test_a_changed_campaign_begins_anew(tmp_path):
    campaign = written(tmp_path, ONE)
    assert [record.label for record in get_trials(campaign).fit] == ["trial"]
    add_trial(campaign, Chosen("repeated-doublet", 10.0, 8.0))
    both = get_trials(campaign)
    assert [record.label for record in both.fit] == ["trial", "trial-2"]
    assert both.fit[1].provenance.options["amplitude"] == 10.0
    assert later_trials(campaign) == (Chosen("repeated-doublet", 10.0, 8.0),)
    assert later_trials(written(tmp_path, ONE.replace("X_u = -1.21", "X_u = -1.2"))) == ()


def test_real_logs_cannot_be_run(tmp_path):
    campaign = written(tmp_path, ONE)
    real = replace(campaign, imports=ImportTable.model_construct(fit=("1",), files=()), truth={})
    with pytest.raises(InputError, match="to simulate"):
        add_trial(real, Chosen("step", 1.0, 1.0))


@pytest.mark.parametrize("nats", [0.5, 3.0, 8.0])
def test_settling_by_simulation(nats):
    """Log Bayes factors of two normal means, drawn a hundred thousand times; to four standard errors."""
    found = settling(SimpleNamespace(nats=nats), [0.7, 0.3])
    rng, n = np.random.default_rng(2), 100_000
    sign = np.where(rng.uniform(size=n) < 0.7, 1.0, -1.0)
    odds = np.log(0.7 / 0.3) + sign * nats + np.sqrt(2 * nats) * rng.normal(size=n)
    share = np.mean(np.abs(odds) > np.log(19))
    assert abs(found - share) < 4 * np.sqrt(share * (1 - share) / n)


def strict_lines(outcome):
    return propose(with_goal(outcome, Goal(shares={"X_u": 0.01}))).lines


def with_goal(outcome, goal):
    return replace(outcome, campaign=replace(outcome.campaign, goal=goal))


def test_a_goal_of_trials_alone_is_met_once_they_are_run(tmp_path):
    outcome = make_outcome(tmp_path)
    run = len(outcome.trials.fit)
    for trials, more in ((run, False), (run + 1, True)):
        found = propose(with_goal(outcome, Goal(trials=trials)))
        assert (found.trial is not None) == more
        assert ("as [goal] requires" in found.lines[-1]) != more


def test_proposals_weigh_goal_doubt_and_gain(tmp_path):
    outcome = make_outcome(tmp_path)
    assert propose(outcome).trial is not None
    met = with_goal(outcome, Goal(shares={"X_u": 9.0}))
    assert propose(met).lines[-1] == "stop: the goal is met: X_u to 900 %"
    failed = replace(outcome.chosen, alarms=("the chains disagree about X_u",))
    assert propose(replace(met, chosen=failed)).lines[-2:] == (
        f"first correct the failure: {met.chosen.structure.label}: the chains disagree about X_u",
        "no trial yet: there is an alarm; run again after the correction",
    )
    hurried = propose(replace(outcome, chosen=failed))
    assert hurried.trial is not None
    assert hurried.first[0].startswith("first correct the failure: ")
    assert hurried.first[0].endswith("the chains disagree about X_u")
    shaken = tuple(replace(one, status="in doubt") for one in outcome.selection.evidences)
    selection = replace(outcome.selection, evidences=shaken, alarms=("the evidence of M-0 is not reliable",))
    choice = propose(replace(outcome, selection=selection))
    assert choice.standing[0].endswith(", if the evidences were reliable")
    assert "raise `particles`" in choice.first[0]
    stopped = propose(replace(met, selection=selection)).lines[-1]
    assert stopped == "stop: the goal is met: X_u to 900 %", "which asks for no model"
    mean = {row.name: row.mean for row in outcome.summary.quote}["X_u"]
    other = with_goal(outcome, Goal(sds={"X_u": 9 * abs(mean), "N_r": 1.0}))
    assert propose(other).lines[-1] == "stop: the goal is met: X_u to 900 % and no N_r in the model"
    assert any(line.startswith("X_u is known to") and line.endswith(" 1 % wanted") for line in strict_lines(outcome))
    little = replace(outcome.next.best, gain=outcome.next.best.gain * 1e-3)
    quiet = replace(outcome, next=replace(outcome.next, sweeps=(little,)), contenders=None)
    assert "would give little information" in propose(quiet).lines[-1]


def test_what_is_missing_stands_in_place_of_stop(tmp_path):
    """No run was held back, of one that is fitted or of two; the goal is that of the template, as the loader reads it, or nearly."""
    outcome = make_outcome(tmp_path)
    alone = replace(outcome.trials, predict=())
    for fit, remedy in ((("1",), "record another run, and name it in `predict`"), (("1", "2"), "move a run from fit")):
        imports = outcome.campaign.imports.model_copy(update={"fit": fit})
        met = with_goal(replace(outcome, campaign=replace(outcome.campaign, imports=imports)), Goal({"X_u": 9.0}))
        assert propose(met).lines[-1] == "stop: the goal is met: X_u to 900 %"
        found = propose(replace(met, trials=alone))
        assert found.trial is None
        assert found.lines[-1].startswith(
            "the goal is met: X_u to 900 %; before you stop, test the model, because no run"
        )
        assert remedy in found.lines[-1]
    init_campaign(tmp_path / "own", "design")
    example = load_campaign(tmp_path / "own").goal
    rows = tuple(replace(row, sd=1e-3 * abs(row.mean)) for row in outcome.summary.quote)
    outcome = replace(outcome, summary=replace(outcome.summary, quote=rows))
    told = propose(with_goal(outcome, example)).lines[-1]
    assert told.startswith(
        "the goal is met: X_uabsu to 3 %; before you stop, state the precision that you need in [goal]"
    )
    assert propose(with_goal(outcome, replace(example, trials=6))).lines[-1] == "stop: the goal is met: X_uabsu to 3 %"


def test_no_goal_is_met_by_standard_deviations_that_do_not_hold(tmp_path):
    """Correlated residuals of a fitted run disown them; what is not noise is named, as no trial narrows it."""
    outcome = with_goal(make_outcome(tmp_path), Goal(shares={"X_u": 9.0}))
    slow = tuple(replace(fit, verdict=ENTRIES["residuals-correlated"].example) for fit in outcome.fits)
    found = propose(replace(outcome, fits=slow))
    assert found.trial is None
    assert "only if the ± is right" in found.lines[-1]
    assert ": run 1: residuals of u are correlated: " in found.lines[-1]
    assert "; likewise " in found.lines[-1]
    assert "Its ± is not reliable, and the needed terms may change" in answer(replace(outcome, fits=slow))
    assert "the residuals contradict the model or its noise" in summary_section(replace(outcome, fits=slow))["passed"]
    assert summary_section(outcome)["passed"] == "No health check failed"
    unmet = propose(with_goal(replace(outcome, fits=slow), Goal(shares={"X_u": 1e-3})))
    assert unmet.first[0].startswith("first correct the failure: run 1: residuals of u are correlated: ")
    assert unmet.beside([unmet.quoted]).first == ("first correct the failure: see the caution about it",)
    assert unmet.beside(["another"]) is unmet
    rows = tuple(
        replace(row, sd=20 * abs(row.mean), shares=ErrorShares(0.19, 0.81), cause="the stated inertia along X")
        if row.name == "X_u"
        else row
        for row in outcome.summary.quote
    )
    outcome = replace(outcome, summary=replace(outcome.summary, quote=rows))
    stays = "X_u is known to 2000 %, 900 % wanted; without noise it would be 1800 %: the stated inertia along X"
    assert stays in propose(outcome).lines
    stop = "stop: no trial of this kind meets the goal for X_u: correct the stated inertia along X first"
    assert propose(outcome).lines[-1] == stop


def test_chains_of_a_structure_that_the_data_exclude_are_no_alarm(tmp_path):
    outcome = replace(make_outcome(tmp_path, ("M-1: the chains disagree about X_u",)), cross_validation=None)
    for probability, in_question in (((0.9, 0.1, 0.0, 0.0), True), ((0.97, 0.03, 0.0, 0.0), False)):
        found = replace(outcome, selection=replace(outcome.selection, probability=np.array(probability)))
        said = ["M-1: the chains disagree about X_u"]
        assert (found.other_alarms, found.idle_complaints) == ((said, []) if in_question else ([], said))


def test_a_model_that_fails_on_held_back_runs_stops_the_sequence_and_takes_the_headline(tmp_path):
    """Errors two and a half times those stated: no next trial, neither proposed nor in the summary's words."""
    outcome = replace(make_outcome(tmp_path), pooled=make_pooled(0.05))
    assert propose(outcome).trial is None
    stop = next(line for line in propose(outcome).lines if line.startswith("stop: "))
    assert "the model fails on held-back runs: " in stop
    assert "Widen the bands" in stop
    headline = str(answer(outcome))
    assert headline.startswith("The model fails on held-back runs.")
    assert "Widen the bands" in headline
