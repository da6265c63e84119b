from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from seatrial.core.errors import NumericalError
from seatrial.estimation.posterior.mode import Mode
from seatrial.sampling.target import evaluate
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings
from seatrial.selection import further_modes as search
from seatrial.selection import log_evidence as module
from seatrial.selection.evidence import EvidenceSettings, combine_runs
from seatrial.selection.importance import NO_EDGES
from seatrial.selection.log_evidence import (
    EvidenceRun,
    EvidenceSchedule,
    EvidenceTask,
    Keys,
    MethodResult,
    log_evidence,
    run_task,
)
from seatrial.selection.method_agreement import judge
from seatrial.selection.verdict import Evidence
from tests.estimation_cases import linear_gaussian
from tests.selection.targets import far_peaks, one_peak, peaks, spike_on_slab, unlike_peaks, wide_regression
from tests.selection.test_evidence import parabola, runs

KEYS = Keys(*jax.random.split(jax.random.key(1)))
SMALL = EvidenceSettings(repeats=4, smc=SMCSettings(particles=512))


def evidences(**given):
    return {name: Evidence(value, error, name, status=status) for name, (value, error, status) in given.items()}


@pytest.mark.proof
def test_agreement_on_a_known_evidence():
    (target, exact), told = one_peak(), []
    found = log_evidence(target, key=KEYS, settings=SMALL, progress=lambda done, total: told.append(done / total))
    assert told[-1] == 1.0
    assert 0.0 < told[0] < 0.25  # within the first task of four or more
    assert found.status == ""
    assert (found.diagnostics["checks"], found.diagnostics["modes"]) == (1, 1)
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.05


@pytest.mark.proof
def test_a_peak_that_all_methods_miss_lies_within_what_the_check_resolves():
    """The narrow peak holds a fifth of Z, log 0.8 = -0.22; no particle meets it, and the check says how little it shows."""
    target, exact = unlike_peaks()
    found = log_evidence(target, key=0)
    assert found.log_value - exact == pytest.approx(np.log(0.8), abs=4 * found.std_error)
    assert found.std_error < 0.01
    assert abs(np.log(0.8)) < found.resolution < 2.0


@pytest.mark.proof
def test_draws_of_the_importance_sampling_are_those_asked_for():
    """Four times the draws halve its error, and no random number of tempered SMC moves."""
    target, _ = one_peak()
    few, many = (
        log_evidence(target, key=KEYS, settings=replace(SMALL, draws=n)).diagnostics["methods"] for n in (2048, 8192)
    )
    (importance, smc) = few
    assert few[importance]["std_error"] / many[importance]["std_error"] == pytest.approx(2.0, rel=0.1)
    assert few[smc]["log_value"] == many[smc]["log_value"]


def test_second_peak_that_the_search_for_the_mode_misses_is_weighed_too():
    """Half of Z lies in each peak, 66 standard deviations apart: the particles of tempered SMC are in both."""
    target, exact = far_peaks()
    found = log_evidence(target, key=KEYS, settings=SMALL)
    assert (found.status, found.diagnostics["modes"]) == ("", 2)
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.05


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(3))
def test_phase_transition_is_weighed_and_alarms(seed):
    """All particles and the search for the mode are on the slab, a hundredth of Z: only cold ones meet the spike."""
    target, exact = spike_on_slab()
    found = log_evidence(target, key=Keys(*jax.random.split(jax.random.key(seed))), settings=SMALL)
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.05
    assert "adaptive tempered SMC finds -4." in found.status
    assert "one of them misses part of the posterior" in found.status
    assert found.diagnostics["methods"]["nested"]["difference"] < -3


def test_a_higher_peak_that_importance_sampling_does_not_have_alarms(monkeypatch):
    """Cold particles at a peak whose mode cannot be climbed to."""
    target, _ = peaks((-0.2, 1.0))
    high = np.array([[1.0, 0.0]])
    low = np.array([[-0.2, 1.5]])
    monkeypatch.setattr(module, "further_modes", lambda *_: ())

    def lost(*_, **__):
        raise NumericalError("no mode")

    monkeypatch.setattr(module, "find_mode", lost)
    smc = SMCResult(0.0, low, np.ones(1), np.ones(1), 1.0, 0.0)
    found = run_task(target, EvidenceTask("importance", first=EvidenceRun("smc", 0, smc, cold=high)), KEYS, SMALL)
    above = float(np.diff(evaluate(target, np.concatenate([low, high])))[0])
    assert found.failure == "no mode"
    assert f"a point {above - 0.5 * 0.002001:.1f} nats above the highest peak" in found.alarms[0]
    same = run_task(
        target,
        EvidenceTask("importance", first=EvidenceRun("smc", 0, smc._replace(particles=high), cold=high)),
        KEYS,
        SMALL,
    )
    assert same.alarms == ()
    (said,) = run_task(target, EvidenceTask("importance", first=EvidenceRun("smc", 0, smc)), KEYS, SMALL).alarms
    assert "could not be cooled" in said


@pytest.mark.proof
def test_value_is_the_next_methods_where_importance_sampling_complains():
    target, exact = parabola()
    found = log_evidence(target, key=KEYS)
    assert (found.status, found.method) == ("", "adaptive tempered SMC")
    assert abs(found.log_value - exact) < 4 * found.std_error
    (note,) = found.diagnostics["notes"]
    assert note.startswith("importance sampling is not counted (the sum depends on a few draws")


@pytest.mark.proof
def test_a_third_method_confirms_where_tempered_smc_fails():
    """Wide priors and unknown noise: at N b of few every scale of the residuals holds as much, and few particles meet the narrow ones."""
    target, exact = wide_regression()
    found = log_evidence(target, key=KEYS, settings=SMALL)
    assert abs(found.log_value - exact) < 4 * found.std_error < 0.1
    assert (found.status, found.method) == ("", "importance sampling about the mode")
    table = found.diagnostics["methods"]
    assert abs(table["nested"]["joint_errors"]) < 3
    assert table["smc"]["difference"] < -1
    assert "tempered SMC is not counted (" in found.diagnostics["notes"][0]


def numbered(*logs, expected_variance=0.0):
    return [EvidenceRun("smc", i, run) for i, run in enumerate(runs(*logs, expected_variance=expected_variance))]


IMPORTANCE = MethodResult("importance", Evidence(0.7, 0.01, "importance"))
MODE: Any = SimpleNamespace(at_bounds=())


def test_pieces_follow_what_is_known():
    """Importance sampling waits for the first repeat; repeats that check too bluntly are followed by more, four times as many at most."""
    schedule = EvidenceSchedule(2)
    assert [task.repeat for task in schedule.begin()] == [0, 1]
    one, other, third = numbered(0.0, 0.9, 0.7, expected_variance=0.9)
    assert schedule.add(other) is None
    assert schedule.add(one) == EvidenceTask("importance", first=one)
    assert schedule.add(IMPORTANCE) == EvidenceTask("smc", 2)
    following = [schedule.add(third._replace(repeat=number)) for number in range(2, 8)]
    more = [task for task in following if task]
    assert more == [EvidenceTask("smc", number) for number in range(3, 3 + len(more))]
    assert len(schedule.runs) <= schedule.max_repeats == 8


@pytest.mark.parametrize(
    ("alone", "is_doubtful"),
    [
        (MethodResult("importance", Evidence(0.7, 0.01, "importance"), modes=(MODE,)), False),
        (MethodResult("importance", Evidence(0.7, 0.01, "importance"), modes=(MODE, MODE)), True),
        (MethodResult("importance", Evidence(0.7, 0.01, "importance", {}, "k-hat"), modes=(MODE,)), True),
        (MethodResult("importance", None, "no mode"), True),
    ],
)
def test_a_second_method_is_asked_afterwards(alone, is_doubtful):
    """The first is done again then, about the modes that are known, with the particles of the first repeat."""
    schedule = EvidenceSchedule(0, alone.modes)
    assert schedule.begin() == [EvidenceTask("importance", modes=alone.modes)]
    assert schedule.add(alone) is None
    assert schedule.is_doubtful == is_doubtful
    if not is_doubtful:
        assert (schedule.evidence().status, list(schedule.evidence().diagnostics["methods"])) == ("", ["importance"])
    schedule.check(2)
    assert schedule.begin() == [EvidenceTask("smc", 0), EvidenceTask("smc", 1)]
    one, other = numbered(0.66, 0.74)
    assert schedule.add(one) == EvidenceTask("importance", first=one, modes=alone.modes)
    assert schedule.add(IMPORTANCE) is None
    assert schedule.add(other) is None
    assert (schedule.evidence().status, schedule.evidence().diagnostics["checks"]) == ("", 1)


@pytest.mark.parametrize("late", [False, True])
def test_nested_sampling_is_asked_once_where_tempered_smc_does_not_confirm(late):
    """More repeats of what complains are not asked; in whatever order the results came."""
    schedule = EvidenceSchedule(2)
    schedule.begin()
    one, other = numbered(-3.0, -5.0)
    results = [one, other, IMPORTANCE] if late else [one, IMPORTANCE, other]
    assert [schedule.add(result) for result in results] == [
        EvidenceTask("importance", first=one),
        None,
        EvidenceTask("nested"),
    ]
    assert schedule.add(MethodResult("nested", Evidence(0.5, 0.2, "nested"))) is None
    evidence = schedule.evidence()
    assert (evidence.log_value, evidence.status) == (0.7, "")
    assert "tempered SMC is not counted (repeats differ by 1.4 nats" in evidence.diagnostics["notes"][0]


def test_repeats_are_added_where_a_verdict_depends_on_what_they_do_not_resolve():
    """The error of repeats goes with the root of their number; four times those asked for are the most."""
    schedule, pairs = EvidenceSchedule(2), numbered(*[0.66, 0.74] * 4)
    schedule.begin()
    for one in (*pairs[:2], IMPORTANCE):
        schedule.add(one)
    error = combine_runs([one.result for one in pairs[:2]]).std_error
    evidence = schedule.evidence()
    assert evidence.resolution == pytest.approx(3.0 * np.hypot(error, IMPORTANCE.evidence.std_error))
    assert f"the check resolves {evidence.resolution:.2g} nat" in repr(evidence)
    assert schedule.sharpen()
    wanted = min(8, int(np.ceil(2 * (error / 0.1) ** 2)))
    assert schedule.begin() == [EvidenceTask("smc", repeat) for repeat in range(2, wanted)]
    for one in pairs[2:wanted]:
        assert schedule.add(one) is None
    assert schedule.evidence().resolution < evidence.resolution
    assert not schedule.sharpen() or schedule.asked <= 8


def test_nested_sampling_is_not_begun_in_many_parameters():
    wide = SimpleNamespace(dim=module.MAX_NESTED_DIM + 1)
    found = run_task(wide, EvidenceTask("nested"), KEYS, SMALL)  # pyright: ignore[reportArgumentType]
    assert found == EvidenceRun("nested", 0, None, "it is done up to 10 parameters only, and these are 11")


def test_what_is_there_is_not_done_again():
    """In whatever order it came: the evidence is that of the repeats in order."""
    found = numbered(0.0, 0.1, 0.05)
    schedule = EvidenceSchedule(2)
    schedule.runs = {0: found[0], 2: found[2]}
    assert schedule.begin() == [EvidenceTask("smc", 1), EvidenceTask("importance", first=found[0])]
    assert schedule.add(MethodResult("importance", None, "no mode", ("a higher peak",))) is None
    assert schedule.add(found[1]) == EvidenceTask("nested")
    evidence = schedule.evidence()
    assert evidence.diagnostics["log_values"] == [0.0, 0.1]
    assert evidence.status.startswith("a higher peak; importance sampling failed: no mode; the value is that of")


@pytest.mark.parametrize(
    ("given", "chosen", "words"),
    [
        ({"importance": (0.0, 0.01, ""), "smc": (0.05, 0.01, "")}, "importance", ""),
        ({"importance": (0.0, 0.01, ""), "smc": (-3.0, 0.3, "bad"), "nested": (0.3, 0.2, "")}, "importance", ""),
        ({"importance": (0.0, 0.01, ""), "smc": (-3.0, 0.3, ""), "nested": (0.3, 0.2, "")}, "importance", ""),
        (
            {"importance": (0.0, 0.01, ""), "smc": (3.0, 0.3, ""), "nested": (0.3, 0.2, "")},
            "importance",
            "smc finds +3.00 nats against importance, 10 joint errors",
        ),
        (
            {"importance": (0.0, 0.01, ""), "smc": (-3.0, 0.3, ""), "nested": (-3.0, 0.2, "")},
            "importance",
            "nested finds -3.00 nats against importance",
        ),
        ({"importance": (0.0, 0.01, "bad"), "smc": (0.05, 0.1, ""), "nested": (0.0, 0.2, "")}, "smc", ""),
        ({"importance": (0.0, 0.05, ""), "smc": (0.29, 0.10, "")}, "importance", ""),
        (
            {"importance": (0.0, 0.05, ""), "smc": (0.36, 0.10, "")},
            "importance",
            "+0.36 nats against importance, 3 joint errors",
        ),
        (
            {"importance": (0.0, 0.01, "bad"), "smc": (0.05, 0.01, "")},
            "smc",
            "importance complains: bad; the value is that of smc",
        ),
        ({"importance": (0.0, 0.01, "bad"), "smc": (0.05, 0.01, "worse")}, "importance", "smc complains: worse"),
        ({"importance": (0.0, 0.01, ""), "smc": (0.5, 0.6, "")}, "importance", "checks to 0.60 nats only"),
        ({"importance": (0.0, 0.01, ""), "smc": (np.nan, 0.1, "")}, "importance", "nan nats"),
        ({"importance": (0.0, 0.01, "")}, "importance", "no healthy independent"),
    ],
)
def test_judgement(given, chosen, words):
    found = judge(evidences(**given), {})
    assert found.method == chosen
    assert words in found.status
    assert bool(words) == bool(found.status)


def test_judgement_with_a_failure_and_another_alarm():
    found = judge(evidences(importance=(0.0, 0.01, "")), {"smc": "no way"}, ["a higher peak"])
    assert found.status.startswith("a higher peak; tempered SMC failed: no way; the value is that of importance")


@pytest.mark.parametrize("known", [[], [-100.0]])
@pytest.mark.parametrize(("above", "alarms"), [(2.9, False), (3.1, True)])
def test_a_point_three_nats_above_all_that_is_known_alarms(known, above, alarms):
    """Of 512 particles of a normal posterior the highest lies below its mode by half the one-in-a-thousand point of chi-square."""
    problem = linear_gaussian(8)
    centre = np.asarray(problem.posterior.unconstrain(problem.moments[0]))
    top, rim = (float(evaluate(problem.posterior, at[None])[0]) for at in (centre, centre + 0.6))
    assert top - rim > 5
    reach = top - above - 0.5 * stats.chi2(8).ppf(1e-3)
    share = brentq(lambda s: float(evaluate(problem.posterior, (centre + s * 0.6)[None])[0]) - reach, 0.0, 1.0)
    warm = np.stack([centre + share * 0.6, centre + 0.9])
    cold = np.stack([centre + 0.9, centre])
    assert bool(module._missed_peak(problem.posterior, cold, warm, known)) == alarms
    assert module._missed_peak(problem.posterior, cold, warm, [*known, top - 2.9]) == []
    assert bool(module._missed_peak(problem.posterior, cold, warm[1:], [*known, top - 3.1]))


def test_table_of_the_methods_by_hand():
    """Differences from the value that is chosen, in joint errors; a method without an error counts with the other's alone."""
    found = judge(evidences(importance=(1.0, 0.3, ""), smc=(1.6, 0.4, ""), nested=(0.7, float("nan"), "blind")), {})
    table = found.diagnostics["methods"]
    assert found.diagnostics["checks"] == 1
    assert [table[name]["difference"] for name in table] == pytest.approx([0.0, 0.6, -0.3])
    assert [table[name]["joint_errors"] for name in table] == pytest.approx([0.0, 1.2, -1.0])
    assert [table[name]["status"] for name in table] == ["", "", "blind"]
    assert (table["smc"]["log_value"], table["smc"]["std_error"]) == (1.6, 0.4)
    same = judge(evidences(importance=(1.0, 0.0, ""), smc=(1.0, 0.0, "")), {})
    assert same.diagnostics["methods"]["smc"]["joint_errors"] == 0.0


@pytest.mark.parametrize(
    ("difference", "error", "words"),
    [
        (0.09, 0.0, ""),
        (0.11, 0.0, "joint errors"),
        (0.29, 0.1, ""),
        (-0.29, 0.1, ""),
        (0.31, 0.1, "3 joint errors"),
        (-0.31, 0.1, "finds -0.31 nats"),
        (0.2, 0.49, ""),
        (0.2, 0.51, "checks to 0.51 nats only"),
    ],
)
def test_methods_differ_from_three_errors_and_a_tenth_of_a_nat_on(difference, error, words):
    found = judge(evidences(importance=(0.0, 0.0, ""), smc=(difference, error, "")), {})
    assert words in found.status
    assert bool(words) == bool(found.status)
    assert found.diagnostics["checks"] == (not words)


def test_a_repeat_that_fails_is_told_and_costs_nothing_else():
    """With one repeat left there is no error of it, so that the value is importance sampling's, unconfirmed."""
    one, _ = numbered(0.0, 0.1)
    lost = EvidenceRun("smc", 1, None, "stopped at temperature 1e-30")
    schedule = EvidenceSchedule(2)
    schedule.begin()
    asked = [schedule.add(found) for found in (one, IMPORTANCE, lost, MethodResult("nested", None, "no way"))]
    assert asked == [EvidenceTask("importance", first=one), None, EvidenceTask("nested"), None]
    evidence = schedule.evidence()
    assert evidence.log_value == 0.7
    assert "tempered SMC failed: stopped at temperature 1e-30; nested sampling failed: no way" in evidence.status
    assert "no healthy independent method" in evidence.status


def test_repeats_that_cannot_leave_the_prior_are_told(monkeypatch):
    """Nested sampling, made to fail too, so that nothing confirms the value."""

    def stopped(*_, **__):
        raise NumericalError("stopped at temperature 1e-30")

    target, exact = one_peak()
    monkeypatch.setattr(module, "sample_warm", stopped)
    monkeypatch.setattr(module, "sample_nested", stopped)
    found = log_evidence(target, key=KEYS, settings=SMALL)
    assert abs(found.log_value - exact) < 4 * found.std_error
    assert "tempered SMC failed: stopped at temperature 1e-30" in found.status


def test_alone_importance_sampling_gives_the_value():
    target, exact = one_peak()
    schedule = EvidenceSchedule(0)
    (task,) = schedule.begin()
    assert schedule.add(run_task(target, task, KEYS, SMALL)) is None
    found = schedule.evidence()
    assert abs(found.log_value - exact) < 4 * found.std_error
    assert found.status == ""


@pytest.mark.parametrize(
    ("away", "above", "new"),
    [(3.7, 0.0, False), (3.75, 0.0, True), (0.0, 0.09, False), (0.0, 0.11, True), (6.2, 0.0, True), (6.4, 0.0, False)],
)
def test_a_mode_is_new_where_it_is_far_off_or_higher_than_rounding_explains(away, above, new):
    """Far is sqrt(13.8) = 3.72 deviations from every mode, of which there is one more at 10; higher is a tenth of a nat above them."""
    first, second = (
        Mode(np.array([x, 0.0]), 4 * np.eye(2), np.eye(2) / 4, height, 0.0, np.zeros(2), np.ones(2), False)
        for x, height in ((0.0, -3.0), (5.0, -7.0))
    )
    (found,) = search._is_new([first, second], NO_EDGES, np.array([[away / 2, 0.0]]), np.array([-3.0 + above]))
    assert found == new
