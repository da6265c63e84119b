"""Criteria side by side: differences with their errors, clear differences, and what is kept on disk."""

import numpy as np
import pytest

from seatrial.campaign.store.stored_result import StoredResult
from seatrial.messages.criteria import criteria_cautions, criteria_lines, pair_line
from seatrial.selection.criterion import (
    Criteria,
    DevianceCriteria,
    MonteCarloValue,
    NestedPair,
    PredictiveCriterion,
    differences,
)
from seatrial.selection.structures import Structure

POINTS = np.random.default_rng(3).normal(-2.0, 1.0, 400)


def made(label, behind, missing=(), status=""):
    """Criteria of a structure that is behind the best by so much, evenly over the measurements."""
    noise = 0.02 * np.random.default_rng(len(label) + int(behind)).normal(size=POINTS.size)
    points = POINTS + behind / POINTS.size + noise - noise.mean()
    deviance = DevianceCriteria(*(MonteCarloValue(float(points.sum()) + extra, 0.3) for extra in (0.0, 4.0, 4.0, 8.0)))
    predictive = {
        name: PredictiveCriterion(
            name,
            MonteCarloValue(float(points.sum()), 0.1),
            float(np.sqrt(points.size) * points.std()),
            4.0,
            points,
            np.full(points.size, 0.3) if name == "PSIS-LOO" else np.empty(0),
            status,
        )
        for name in ("AIC", "BIC", "WAIC", "PSIS-LOO")
        if name not in missing
    }
    refused = tuple(f"no {name} of {label}: it diverges" for name in missing)
    return Criteria(Structure(label, ("X_u", label)), deviance, predictive, refused)


def test_differences_are_to_the_best_with_the_error_of_the_difference():
    found = [made("M-0", 1.0), made("M-1", 0.0), made("M-2", 90.0)]
    table = differences(found)
    for name in ("WAIC", "PSIS-LOO"):
        assert table[name][1] == (0.0, 0.0)
        gap = found[2].predictive[name].pointwise - found[1].predictive[name].pointwise
        assert table[name][2].delta == pytest.approx(90.0)
        assert table[name][2].error == pytest.approx(np.hypot(np.sqrt(400) * gap.std(ddof=1), np.hypot(0.1, 0.1)))
    assert table["DIC"][2] == pytest.approx((90.0, np.hypot(0.3, 0.3)))
    said = "\n".join(criteria_lines(found))
    assert "M-2 is worse by DIC, BPIC, AIC, BIC, WAIC, PSIS-LOO; the others cannot be separated" in said
    assert "DIC and BPIC decide little" in said
    assert said.count("best ") + said.count("best\n") >= 6


def test_what_is_missing_or_doubtful_is_said_once():
    found = [made("M-0", 1.0, missing=("AIC",)), made("M-1", 0.0, status="2 of 400 measurements are too influential")]
    assert not np.isfinite(differences(found)["AIC"][0].delta)
    said = criteria_cautions(found)
    assert said[0] == "no AIC of M-0: it diverges"
    assert "M-1, WAIC: 2 of 400 measurements are too influential" in said
    nothing = [made("M-0", 0.0, missing=("AIC", "BIC", "WAIC", "PSIS-LOO"))]
    assert "no comparison is possible" in "\n".join(criteria_lines(nothing))


def test_criteria_survive_the_disk(tmp_path):
    criteria = made("M-0", 2.0)
    file = StoredResult(tmp_path / "M-0.json", "key", Criteria)
    file.write(criteria)
    assert (file.read().structure, file.read().deviance) == (criteria.structure, criteria.deviance)
    back = file.read().predictive
    assert back.keys() == criteria.predictive.keys()
    for name, one in criteria.predictive.items():
        assert back[name].value == one.value
        assert back[name].effective == pytest.approx(one.effective, nan_ok=True)
        np.testing.assert_array_equal(back[name].pointwise, one.pointwise)
        np.testing.assert_array_equal(back[name].k_hat, one.k_hat)
    file.write(Criteria(criteria.structure, criteria.deviance, {}, ("because",)))
    assert (file.read().predictive, file.read().refused) == ({}, ("because",))


@pytest.mark.parametrize(
    ("value", "evidence", "status", "agrees", "words"),
    [
        (1.5, (1.4, 0.05), "", True, "by evidence +1.40 ± 0.05, agreed"),
        (1.5, (-1.5, 0.05), "", False, "NOT agreed"),
        (1.5, None, "", True, "log Bayes factor +1.50 ± 0.05"),
        (np.nan, (9.0, 0.05), "no draw near 0", True, "none; by evidence +9.00 ± 0.05; no draw near 0"),
    ],
)
def test_a_pair_says_whether_both_ways_agree(value, evidence, status, agrees, words):
    pair = NestedPair("X_u", "M-0", "M-1", value, 0.05, evidence, status)
    assert pair.agrees == agrees
    assert words in pair_line(pair)
