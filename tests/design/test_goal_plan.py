"""Trials chosen for a goal, beside closed forms."""

import numpy as np
import pytest
from scipy.special import ndtr

from seatrial.design.goal_plan import PlannedTrial, StageGoal, choose_trials, goals_met

ONE = np.array([0])
DRAWS = 20_000


def goal(share=np.inf, sd=np.inf, prior_sd=1.0):
    return StageGoal(ONE, np.array([share]), np.array([sd]), np.array([[prior_sd**-2.0]]))


def test_the_chance_of_a_share_is_that_of_a_large_enough_estimate():
    mean, spread, information, share = 2.0, 0.5, 30.0, 0.1
    random = np.random.default_rng(1)
    values = mean + spread * random.standard_normal((DRAWS, 1))
    each = {0: np.full((DRAWS, 1, 1), information)}
    trials = [PlannedTrial(0, 0)]
    met = goals_met([goal(share, prior_sd=spread)], values, each, trials, random.standard_normal((DRAWS, 1)))
    sd = (information + spread**-2) ** -0.5
    about = np.hypot(spread, sd)  # the estimate lies about the value with its sd
    expected = 1 - ndtr((sd / share - mean) / about) + ndtr((-sd / share - mean) / about)
    assert met.mean() == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / DRAWS))


def test_as_many_trials_are_taken_as_the_closed_form_says():
    values, information = np.ones((8, 1)), np.full((2, 8, 1, 1), 10.0)
    information[1] = 25.0
    stage = goal(sd=0.1)

    def is_enough(trials):
        sums = sum(information[one.design, 0, 0, 0] for one in trials)
        return (1.0 + sums) ** -0.5 <= 0.1

    for seconds, better in (([1.0, 1.0], 1), ([1.0, 9.0], 0)):
        found = choose_trials([stage], values, information, np.array(seconds), 30, is_enough)
        assert {one.design for one in found} == {better}
        assert len(found) == np.ceil(99.0 / information[better, 0, 0, 0])


def test_trials_that_teach_nothing_are_not_taken():
    found = choose_trials([goal(sd=0.1)], np.ones((4, 1)), np.zeros((3, 4, 1, 1)), np.ones(3), 5, lambda trials: False)
    assert found == []


def test_what_other_stages_seek_is_taken_as_known():
    """Two coefficients that one trial cannot tell apart: one by one each is known, together neither."""
    information = np.array([[50.0, 50.0], [50.0, 50.0]])[None, None].repeat(4, 1)
    inf = np.full(2, np.inf)
    sds, precision = np.full(2, 0.2), np.eye(2)
    both = StageGoal(np.array([0, 1]), inf, sds, precision)
    alone = StageGoal(np.array([1]), inf, sds, precision)
    values, normal, trial = np.ones((4, 2)), np.zeros((4, 2)), [PlannedTrial(0, 0)]
    assert not goals_met([both], values, {0: information[0]}, trial, normal).any()
    assert goals_met([alone], values, {0: information[0]}, trial, normal).all()
