"""Limits of free-form inputs without a search: the unit of the levels, projections, active limits and what a status says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.free_form import ACTIVE_SHARE, EQUAL_GAIN, ClimbOutcome, _active, _change, _status
from seatrial.design.free_form_objective import Course, _blocks
from seatrial.design.free_form_optimise import ROUNDING, Climb, gentled
from seatrial.design.free_form_problem import FreeFormProblem, Room, check_problem
from seatrial.design.motion_limits import MotionLimit
from seatrial.design.sweep import LANES
from seatrial.design.trial_plan import plan_trial
from seatrial.manoeuvres.free_form import SteppedInput
from seatrial.manoeuvres.manoeuvre import Limits
from tests.cases import TRUTH, U0, paper_model

TRIM, LOW, HIGH = 70.0, 60.0, 95.0
NAMES = ("X_u", "X_uabsu", "T_nabsn")
VALUES = np.array([TRUTH[name] for name in NAMES])


def problem(form=None, rate=None, n=60, **settings):
    """A minute in samples of one second and levels of five: 10 rad/s below trim and 25 above."""
    plan = plan_trial(paper_model(*NAMES), [U0], {"u": 0.05}, n, 60.0 / n)
    form = form or SteppedInput("n", TRIM, 60.0, 0.0, 60.0, 12)
    given = {"limits": Limits(LOW, HIGH, rate), "points": VALUES[None], "prior_cov": np.diag(VALUES**2)}
    return FreeFormProblem(plan, form, **given | settings)


def climb_of(target, kept=None):
    draws = target.safe_for.shape[0]
    return Climb(target, target.setup(), target.watched(), (), np.ones(draws, bool) if kept is None else kept)


def test_levels_count_in_the_larger_way_to_a_bound():
    target = problem()
    assert target.span == 25.0
    assert target.box == pytest.approx((-0.4, 1.0))
    assert problem(limits=Limits(40.0, HIGH)).span == 30.0
    assert target.block == 5
    assert problem(n=120).block == 10
    setup = target.setup()
    assert (float(setup.trim[0]), float(setup.span[0])) == (TRIM, 25.0)
    factor = np.asarray(setup.factor)
    np.testing.assert_allclose(factor @ factor.T, target.prior_cov)


@pytest.mark.parametrize(("risk", "left_out"), [(0.0, 0), (0.1, 2), (0.149, 2), (0.15, 3), (0.99, 19)])
def test_draws_that_may_break_a_bound_are_the_share_rounded_down(risk, left_out):
    draws = np.tile(VALUES, (20, 1))
    assert problem(draws=draws, risk=risk).left_out == left_out
    assert problem(draws=draws).safe_for.shape == (20, 3)
    np.testing.assert_array_equal(problem().safe_for, VALUES[None])


def test_limits_of_ramps_in_rows():
    """Every rate below its limit, as a share of it."""
    form = SteppedInput("n", TRIM, 60.0, 0.0, 57.0, 8, edge=3.0)
    target = problem(form, rate=2.0)
    rows, most = target.linear()
    rates = form.rates()
    assert rows.shape == (2 * len(rates), form.size)
    x = np.random.default_rng(0).uniform(-0.4, 1.0, form.size)
    slope = rates @ x * 25.0
    broken = rows @ x > most + 1e-12
    assert 0 < broken.sum() < len(rates)
    expected = np.concatenate([slope > 2.0, -slope > 2.0])
    np.testing.assert_array_equal(broken, expected)
    assert problem().linear()[0].shape == (0, 12)


def test_gentled_inputs_are_inside_and_near():
    """Inside inputs stay; others come within a few percent of the nearest point inside, found by a general solver."""
    form = SteppedInput("n", TRIM, 60.0, 0.0, 57.0, 8, edge=3.0)
    target = problem(form, rate=2.0)
    rows, most = target.linear()
    low, high = target.box
    rng = np.random.default_rng(1)
    small = 0.01 * rng.uniform(-1, 1, form.size)
    np.testing.assert_allclose(gentled(target, small), small, atol=1e-12)
    for x in rng.uniform(-2.0, 2.0, (4, form.size)):
        found = gentled(target, x)
        assert (rows @ found <= most + 1e-9).all()
        assert (found >= low - 1e-12).all()
        assert (found <= high + 1e-12).all()
        clipped = np.clip(x, low, high)
        nearest = minimize(
            lambda y, c=clipped: ((y - c) ** 2).sum(),
            np.zeros(form.size),
            bounds=[(low, high)] * form.size,
            constraints=[{"type": "ineq", "fun": lambda y: most - rows @ y}],
            method="SLSQP",
        ).x
        assert np.linalg.norm(found - nearest) < 0.1 * np.linalg.norm(nearest) + 1e-6
    both = rng.uniform(-2.0, 2.0, (3, form.size))
    np.testing.assert_allclose(gentled(target, both), [gentled(target, one) for one in both], atol=1e-12)


def test_a_limit_is_active_where_next_to_nothing_of_its_room_is_left():
    """Levels at the upper bound of the control, or short of it by more or less than the share; a bound of u that is far."""
    target = problem(motion=(MotionLimit("u", upper=9.0),))
    climb = replace(climb_of(target), rooms=check_problem(target))
    for short, active in ((0.0, True), (0.9 * ACTIVE_SHARE, True), (1.1 * ACTIVE_SHARE, False)):
        assert _active(climb, np.full(12, 1.0 - short)) == ("upper limit of n",) * active
    speed = float(np.max(climb.course(np.full(12, 0.5)).highest))
    near = replace(target, motion=(MotionLimit("u", upper=speed * (1 + 1e-9)),))
    assert len(_active(replace(climb_of(near), rooms=check_problem(near)), np.full(12, 0.5))) == 1


def test_status_counts_starts_that_end_alike_and_those_that_did_not_settle():
    outcomes = tuple(
        ClimbOutcome(name, 1.0, utility, np.zeros(1), 3, name != "c")
        for name, utility in (("a", 5.0), ("b", 5.0 - 0.9 * EQUAL_GAIN), ("c", 5.0 - 1.1 * EQUAL_GAIN), ("d", 4.0))
    )
    said = _status(outcomes[0], outcomes)
    assert said.startswith("5.000 nats from a; 2 of 4 starts end within")
    assert "the worst 1.000 below" in said
    assert said.endswith("has not converged from c: more steps may help")
    assert _status(outcomes[0], outcomes[:1]) == "5.000 nats from a"


def test_starts_as_changes_from_trim_over_the_span():
    target = problem()
    np.testing.assert_allclose(_change(target, "mine", np.full(12, 82.5)), 0.5)
    with pytest.raises(InputError, match="12 finite levels"):
        _change(target, "mine", np.zeros(11))
    with pytest.raises(InputError, match="1 not finite"):
        _change(target, "mine", np.append(np.zeros(11), np.nan))


def test_excess_is_the_share_beyond_the_worst_limit():
    """Of levels, of which each is its own bound, and of rates; what a share of draws may break does not count."""
    climb = climb_of(problem())
    x = np.zeros((3, 12))
    x[0, 3], x[1, 5], x[2, :] = 1.2, -0.7, 0.3
    np.testing.assert_allclose(climb.excess(x), [0.2, 0.3, -0.7])
    assert (climb.draw_excess(x[0]) == -np.inf).all()
    pulled = climb.pulled_in(1.3 * np.ones(12))
    np.testing.assert_allclose(pulled, 1.0)


def test_excess_of_motion_over_the_draws_that_are_kept():
    """u at most 2 m/s over two draws, the slower of which is kept or not."""
    draws = np.stack([VALUES, VALUES * [1.0, 0.8, 1.0]])
    target = problem(draws=draws, motion=(MotionLimit("u", upper=2.5),), risk=0.5)
    rooms, x = check_problem(target), np.full(12, 0.4)
    everyone = replace(climb_of(target), rooms=rooms)
    course = everyone.course(x)
    (room,) = rooms
    speeds = np.asarray(course.highest)[..., 0].max(1)
    beyond = (speeds - 2.5) / room.scale
    np.testing.assert_allclose(everyone.draw_excess(x), beyond, rtol=1e-6)
    levels = np.max([x - 1.0, -0.4 - x])
    assert everyone.excess(x[None])[0] == pytest.approx(max(beyond.max(), levels))
    one = replace(everyone, kept=np.array([True, False]))
    assert one.excess(x[None])[0] == pytest.approx(max(beyond[0], levels))
    assert one.course(x).highest.shape[0] == 1


def test_shortfall_of_a_bound():
    course = Course(*(np.array([[3.0, 7.0], [4.0, 6.0]]) for _ in range(2)))
    upper, lower = Room("u", 1, 1.0, 6.5, 2.0), Room("l", 0, -1.0, 3.5, 0.5)
    np.testing.assert_allclose(upper.shortfall(course), [0.25, -0.25])
    np.testing.assert_allclose(lower.shortfall(course), [1.0, -1.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"limits": Limits(LOW, None)}, "upper limit None"),
        ({"limits": Limits(75.0, HIGH)}, "lower limit 75 above trim 70 by 5"),
        ({"limits": Limits(LOW, 65.0)}, "trim 70 above upper limit 65 by 5"),
        ({"limits": Limits(LOW, HIGH, 5.0)}, "edges of 0 s"),
        ({"limits": Limits(LOW, HIGH, 5.0)}, "edges of 7 s for the full swing of 35"),
        ({"motion": (MotionLimit("u", upper=1.0),)}, "trim breaks the upper bound 1 m/s of u by"),
        ({"motion": (MotionLimit("u", lower=1.6),)}, "trim breaks the lower bound 1.6 m/s of u by"),
        ({"motion": (MotionLimit("distance", upper=50.0),)}, "trim breaks the upper bound 50 m of distance by"),
        ({"motion": (MotionLimit("w", upper=1.5),)}, "states: u"),
    ],
)
def test_problems_that_admit_nothing(change, words):
    with pytest.raises(InputError) as caught:
        check_problem(problem(**change))
    assert words in str(caught.value)


def test_rooms_are_the_distances_to_the_course_at_trim():
    """Both bounds of u, the upper as far from the highest speed at trim as the lower from the lowest."""
    target = problem(motion=(MotionLimit("u", 1.0, 3.0),))
    upper, lower = check_problem(target)
    course = climb_of(target).course(np.zeros(12))
    assert (upper.side, upper.bound, lower.side, lower.bound) == (1.0, 3.0, -1.0, 1.0)
    assert upper.scale == pytest.approx(3.0 - float(np.max(course.highest)))
    assert lower.scale == pytest.approx(float(np.min(course.lowest)) - 1.0)
    assert ROUNDING < 1e-6


@pytest.mark.parametrize("samples", [8, 9, 11])
def test_blocks_hold_the_samples_in_order_and_are_filled_with_none_that_last_or_are_measured(samples):
    """Two controls and three sensors, in blocks of four."""
    rng = np.random.default_rng(6)
    control, step, weight = rng.normal(size=(samples, 2)), rng.uniform(1, 2, samples), rng.uniform(1, 2, (samples, 3))
    plan = replace(problem().plan, step=step, weight=weight)
    columns, steps, weights = _blocks(plan, control, 4)
    assert steps.shape[1:] == (4,)
    assert weights.shape[1:] == (4, 3)
    fill = -samples % 4
    for found, wanted in zip(columns, control.T, strict=True):
        np.testing.assert_array_equal(np.ravel(found), np.append(wanted, np.full(fill, wanted[-1])))
    np.testing.assert_array_equal(np.ravel(steps), np.append(step, np.zeros(fill)))
    np.testing.assert_array_equal(np.reshape(weights, (-1, 3)), np.vstack([weight, np.zeros((fill, 3))]))


def stand_in(gain=None, beyond=lambda x: np.full(len(x), -1.0)):
    """What a climb asks of its problem: a box from -1 to 0.5, utilities and excesses."""
    return SimpleNamespace(problem=SimpleNamespace(box=(-1.0, 0.5)), utilities=gain, excess=beyond)


def test_levels_go_to_their_nearer_bounds_at_once_where_none_may_go_alone():
    """Only all three together gain, the middle of the box being -0.25; where that breaks a limit, nothing moves."""
    start, there = np.array([-0.2, -0.3, 0.4]), np.array([0.5, -1.0, 0.5])
    climb = stand_in(lambda x: (np.abs(x - there) < 1e-12).all(1) - 0.5)
    found, gain = Climb.rounded(climb, start)
    np.testing.assert_array_equal(found, there)
    assert gain == 0.5
    climb.excess = lambda x: np.where((x == there).all(1), 1e-6, -1.0)
    np.testing.assert_array_equal(Climb.rounded(climb, start)[0], start)


def test_levels_go_to_bounds_one_by_one_as_long_as_that_gains():
    """A slope of 1 up, one of 3 down and a peak of 2 nats at 0.1: two levels go to their bounds, the dearest first, and one stays."""
    seen = []

    def gain(x):
        seen.append(len(x))
        return x[:, 0] - 3 * x[:, 1] - 2 * (np.abs(x[:, 2] - 0.1) > 1e-9)

    found, best = Climb.rounded(stand_in(gain), np.array([0.0, 0.0, 0.1]))
    np.testing.assert_array_equal(found, [0.5, -1.0, 0.1])
    assert best == pytest.approx(3.5)
    assert seen == [1, 7, 6, 5]


def test_an_input_is_drawn_in_no_further_than_the_limits_ask():
    """Steps of drawing in grow by the 78th root of 10^12 each; trim itself may break no limit."""
    climb = stand_in(beyond=lambda x: x[:, 0] - 0.2)
    found = Climb.pulled_in(climb, np.array([9.0, -0.3]))
    assert found[1] / found[0] == pytest.approx(-0.3 / 0.5)
    assert 0.6 <= 1 - found[0] / 0.5 < 0.6 * 10 ** (12 / (LANES - 2))
    step = 10 ** (-36 / 78)
    at_a_step = stand_in(beyond=lambda x: x[:, 0] - 0.5 * (1 - step))
    assert 1 - Climb.pulled_in(at_a_step, np.array([9.0, -0.3]))[0] / 0.5 == pytest.approx(step, rel=1e-6)
    np.testing.assert_array_equal(Climb.pulled_in(climb, np.array([0.2, -2.0])), [0.2, -1.0])
    climb.excess = lambda x: np.full(len(x), 2 * ROUNDING)
    with pytest.raises(NumericalError, match="trim breaks a limit"):
        Climb.pulled_in(climb, np.zeros(2))
