"""The route of `seatrial select` where the evidence of its structures is known."""

from collections import deque
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.special import softmax

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.selection import evidence
from seatrial.campaign.selection.evidence import select_structure
from seatrial.estimation.priors import Normal, Uniform
from seatrial.messages.structures import agreement_counts, agreement_words
from seatrial.sampling.nested import NestedRun
from seatrial.selection import log_evidence
from seatrial.selection.log_evidence import EvidenceRun, EvidenceTask, MethodResult
from seatrial.selection.verdict import Evidence
from tests.campaign.small import write_small
from tests.estimation_cases import posterior
from tests.selection.targets import one_peak, peaks


def selection_of(folder: Path, monkeypatch, full, without):
    """Selection of a campaign whose two structures have these posteriors."""
    campaign = load_campaign(write_small(folder))
    trials = get_trials(campaign)
    monkeypatch.setattr(Study, "posterior", lambda _, structure: full if "X_u" in structure.terms else without)
    return select_structure(campaign, trials)


def test_what_decides_nothing_is_not_checked(tmp_path, monkeypatch):
    """Its peak is twelve standard deviations of the prior away: 72 nats, which importance sampling alone finds."""
    (full, exact), (without, other) = one_peak(), peaks((12.0, 12.0))
    found = selection_of(tmp_path, monkeypatch, full, without)
    assert [one.log_value for one in found.evidences] == pytest.approx([exact, other], abs=0.02)
    assert [list(one.diagnostics["methods"]) for one in found.evidences] == [["importance"]] * 2
    assert agreement_words(found.evidences[1], found.rows[1].log_evidence_needed) == (
        "by importance sampling, without another method; a decision on a term changes if it is wrong by 69 nat"
    )
    assert agreement_counts(["M-0", "M-1"], found.evidences).startswith(
        "Importance sampling gave every evidence. No other"
    )
    assert (found.alarms, found.chosen) == ((), 0)


class Known:
    """Workers that know every evidence: 20 nats for each optional term."""

    def run(self, work, shared, items, done, on_progress):
        del work, shared, on_progress
        for index, (structure, piece) in enumerate(items):
            value = 20.0 * len({"X_u", "X_uabsu"}.intersection(structure.terms))
            done(index, MethodResult(piece.method, Evidence(value, 0.01, piece.method)))


def test_probabilities_have_the_prior_of_the_campaign(tmp_path, monkeypatch):
    """Of two optional terms: 1/3, 1/6, 1/6 and 1/3 by multiplicity; evidences do not depend on it."""
    monkeypatch.setattr(evidence, "workers_of", lambda *_: Known())
    optional = (
        'always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]',
        'always = ["T_nabsn"]\noptional = ["X_u", "X_uabsu"]',
    )
    found = {}
    for prior in ("equal", "multiplicity"):
        stated = ("repeats = 2", f'repeats = 2\nstructure_prior = "{prior}"')
        campaign = load_campaign(write_small(tmp_path, optional, stated))
        found[prior] = select_structure(campaign, get_trials(campaign))
    equal, other = found["equal"], found["multiplicity"]
    logs = np.array([one.weighed for one in equal.evidences])
    assert [one.weighed for one in other.evidences] == logs.tolist()
    assert equal.probability == pytest.approx(softmax(logs))
    assert other.probability == pytest.approx(softmax(logs + np.log([1 / 3, 1 / 6, 1 / 6, 1 / 3])))
    assert (equal.structure_prior, other.structure_prior) == ("equal", "multiplicity")


@pytest.mark.proof
def test_a_structure_is_no_lower_than_one_that_it_contains(tmp_path, monkeypatch):
    """Only the structure without X_u is told of the narrow peak, 40 nats high; by itself the full one ends at a bound of X_u."""

    def ridge(values, data):
        extra, drag = values.get("X_u", 0.0), values["X_uabsu"]
        sharp = 40.0 - 0.5 * (((drag + 2.0) / 1e-4) ** 2 + (extra / 1e-4) ** 2)
        return jnp.logaddexp(sharp, -0.5 * ((drag - 1.0) ** 2 + (extra + 5.0) ** 2))

    drag, extra = Normal(0.0, 5.0), Uniform(-5.0, 1.0)
    full = posterior({"X_uabsu": drag, "X_u": extra}, ridge)
    without = replace(posterior({"X_uabsu": drag}, ridge), guess=np.array([-2.0]))
    monkeypatch.setattr(log_evidence, "MAX_NESTED_DIM", 0)  # it would miss the peak too, for half a minute
    found = selection_of(tmp_path, monkeypatch, full, without)
    width, density = np.log(1e-4 * np.sqrt(2 * np.pi)), stats.norm(0.0, 5.0).logpdf(-2.0)
    exact = [40.0 + 2 * width + density - np.log(6.0), 40.0 + width + density]
    assert [one.log_value for one in found.evidences] == pytest.approx(exact, abs=0.05)
    assert "one of them misses part of the posterior" in found.alarms[0]


class InTurn:
    """Workers that do one piece after another, each told at its half: tempered SMC fails, so that nested sampling decides."""

    def __init__(self, last=None):
        self.last, self.asked = last, []

    def run(self, work, shared, items, done, on_progress):
        del work, shared
        waiting = deque(enumerate(items))
        while waiting:
            index, (_, piece) = waiting.popleft()
            self.asked.append(piece)
            if piece == self.last:
                raise KeyboardInterrupt
            on_progress(index, 1, 2)
            found = MethodResult(piece.method, Evidence(0.0, 0.1, piece.method, status="in doubt"))
            if piece.method == "smc":
                found = EvidenceRun("smc", piece.repeat, None, "lost")
            if piece.method == "nested":
                found = EvidenceRun(
                    "nested", piece.repeat, NestedRun(0.0, 5.0, 1000, 1.0, 0.0, np.empty((0, 3)), np.empty(0))
                )
            following = done(index, found)
            if following is not None:
                waiting.appendleft((index, following))


def test_progress_is_that_of_the_method_that_runs(tmp_path, monkeypatch):
    campaign = load_campaign(write_small(tmp_path))
    trials, bars = get_trials(campaign), {}

    class Told:
        def say(self, text):
            del text

        def progress(self, title):
            return lambda done, total: bars.setdefault(title, []).append(done / total)

    monkeypatch.setattr(evidence, "workers_of", lambda *_: InTurn())
    select_structure(campaign, trials, Told())
    nested = bars["evidence M-1: nested sampling decides, because no two methods agree"]
    assert nested == sorted(nested)
    assert (nested[:3], nested[-1]) == ([0.0, 0.125, 0.25], 1.0)
    assert len(list((tmp_path / "results" / "checkpoints").glob("*"))) == 0
    smc = bars["evidence M-1: check by tempered SMC, because it is in doubt or a decision depends on it"]
    assert smc == sorted(smc)
    assert bars["evidence M-1: X_uabsu T_nabsn"][:3] == [0.0, 0.5, 1.0]


def test_nested_sampling_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    campaign = load_campaign(write_small(tmp_path))
    trials, stopped, resumed = get_trials(campaign), InTurn(EvidenceTask("nested", 2)), InTurn()
    monkeypatch.setattr(evidence, "workers_of", lambda *_: stopped)
    with pytest.raises(KeyboardInterrupt):
        select_structure(campaign, trials)
    monkeypatch.setattr(evidence, "workers_of", lambda *_: resumed)
    select_structure(campaign, trials)
    assert [one.repeat for one in resumed.asked if one.method == "nested"] == [2, 3, 0, 1, 2, 3]
