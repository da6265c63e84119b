"""Trials planned together, against all combinations; sensors weighed, against simulations of each; terms told apart."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from seatrial.core.errors import NumericalError
from seatrial.design.batch import plan_batch
from seatrial.design.fisher_utilities import Discrimination, find_criterion
from seatrial.design.sensor_choice import SensorChoice, sensor_worth
from seatrial.design.trial_plan import plan_trial
from tests.cases import TRUTH, U0, paper_model

COV = np.diag([1.0, 4.0, 0.25])


def information(designs=7, draws=3, seed=5):
    """Each design tells mostly of one combination."""
    slopes = np.random.default_rng(seed).normal(size=(designs, draws, 2, 3))
    return np.einsum("dsni,dsnj->dsij", slopes, slopes)


@pytest.mark.parametrize("trials", [1, 2, 3])
def test_trials_together_against_every_combination(trials):
    found, criterion = information(), find_criterion("fisher-d", COV)
    batch = plan_batch(found, criterion, trials)
    every = {c: criterion(found[list(c)].sum(0)).mean() for c in combinations_with_replacement(range(7), trials)}
    assert batch.utility[-1] == pytest.approx(max(every.values()), rel=1e-12)
    assert sorted(batch.designs) == sorted(max(every, key=lambda c: every[c]))
    assert list(batch.utility) == sorted(batch.utility)
    alone = max(range(7), key=lambda d: criterion(found[d]).mean())
    assert batch.repeated == pytest.approx(criterion(trials * found[alone]).mean(), rel=1e-12)


def test_evidence_against_the_hardest_rival_by_least_squares():
    """Half the squared difference that a rival cannot make up for with its own terms, which it pays for by its prior."""
    random = np.random.default_rng(2)
    slopes, draws = random.normal(size=(4, 9, 3)), random.normal(size=(4, 3))
    absent = np.array([[True, False, False], [False, True, True], [False, False, True]])
    expected = []
    for s, theta in zip(slopes, draws, strict=True):
        left = []
        for lost in absent:
            made_by, free = s[:, lost] @ theta[lost], s[:, ~lost]
            stacked = np.vstack([free, np.linalg.cholesky(np.linalg.inv(COV[np.ix_(~lost, ~lost)])).T])
            rest = np.concatenate([made_by, np.zeros((~lost).sum())])
            left.append(0.5 * (rest - stacked @ np.linalg.lstsq(stacked, rest, rcond=None)[0]) @ rest)
        expected.append(min(left))
    criterion = Discrimination(draws, absent, COV)
    np.testing.assert_allclose(criterion(np.einsum("sni,snj->sij", slopes, slopes)), expected, rtol=1e-10)
    np.testing.assert_array_equal(criterion(np.zeros((2, 4, 3, 3))), 0.0)


def test_a_rival_without_any_term():
    draws = np.array([[1.0, 0.0, 0.0]])
    criterion = Discrimination(draws, np.ones((1, 3), bool), COV)
    assert criterion(np.diag([8.0, 1.0, 1.0])[None]) == pytest.approx(4.0)


def test_sensors_are_worth_the_information_of_the_samples_they_take():
    """Each choice by a plan of its own, with those samples and that noise; deviations are root mean squares over the draws."""
    noise, n = {"u": 0.05, "udot": 0.1}, 60
    values = np.array(list(TRUTH.values()))
    draws = values * (1 + 0.1 * np.random.default_rng(6).normal(size=(3, 3)))
    cov, control = np.diag((0.3 * values) ** 2), 70.0 + 20.0 * (-1.0) ** (np.arange(n) // 10)[:, None]
    criterion = find_criterion("fisher-d", cov)
    choices = [
        SensorChoice((1, 1), (1.0, 1.0)),
        SensorChoice((3, 0), (1.0, 1.0)),
        SensorChoice((2, 5), (0.5, 3.0)),
        SensorChoice((0, 0), (1.0, 1.0)),
    ]
    whole = plan_trial(paper_model(), [U0], noise, n, 0.5)
    for choice, found in zip(choices, sensor_worth(whole, control, draws, cov, criterion, choices), strict=True):
        taken = np.column_stack([(np.arange(n) % every == 0) * 1.0 if every else np.zeros(n) for every in choice.every])
        sds = {name: sd * factor for (name, sd), factor in zip(noise.items(), choice.noise, strict=True)}
        plan = plan_trial(paper_model(), [U0], sds, n, 0.5, taken)
        information = np.stack([np.asarray(plan.information(draw, control)) for draw in draws])
        assert found.utility == pytest.approx(criterion(information).mean(), rel=1e-8, abs=1e-12)
        after = np.linalg.inv(information + np.linalg.inv(cov))
        np.testing.assert_allclose(found.sd, np.sqrt(np.diagonal(after, axis1=1, axis2=2).mean(0)), rtol=1e-8)
    with pytest.raises(NumericalError, match="diverges"):
        sensor_worth(whole, control, np.array([[1e300, 1.0, 1.0]]), cov, criterion, choices)


def test_trials_that_are_only_good_together_are_found_by_exchange():
    """By ln det(I + F) the even design is the best alone and beside any; the two one-sided ones together beat it twice."""
    found = np.array([np.diag(x) for x in ((1.0, 1.0), (2.6, 0.0), (0.0, 2.5))])[:, None]

    def gain(f):
        return np.linalg.slogdet(np.eye(2) + f)[1]

    batch = plan_batch(found, gain, 2)
    assert batch.designs == (1, 2)
    assert batch.utility == pytest.approx((np.log(3.6), np.log(3.6 * 3.5)))
    assert batch.repeated == pytest.approx(2 * np.log(3.0))


def test_fewer_trials_are_the_best_of_those_planned():
    found, criterion = information(9, seed=8), find_criterion("fisher-d", COV)
    batch = plan_batch(found, criterion, 4)
    together = [criterion(found[list(batch.designs[:n])].sum(0)).mean() for n in (1, 2, 3, 4)]
    assert batch.utility == pytest.approx(together, rel=1e-12)
    for n in range(4):
        before = found[list(batch.designs[:n])].sum(0)
        assert together[n] == pytest.approx(max(criterion(before + found[d]).mean() for d in batch.designs[n:]))


def test_trials_are_exchanged_until_no_exchange_helps():
    """Four of nine designs of one direction each: after a round of exchanges another is needed to reach the best of all."""
    slopes = 3 * np.random.default_rng(205).normal(size=(9, 3))
    found = np.einsum("di,dj->dij", slopes, slopes)[:, None]

    def gain(f):
        return np.linalg.slogdet(np.eye(3) + f)[1]

    best = max(gain(found[list(c), 0].sum(0)) for c in combinations_with_replacement(range(9), 4))
    assert plan_batch(found, gain, 4).utility[-1] == pytest.approx(best)
