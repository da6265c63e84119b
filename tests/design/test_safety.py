"""Chance constraints against closed forms of a linear vehicle, exact probabilities and plain loops."""

import pickle
from math import exp, inf, sqrt

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.limit_conflicts import (
    GENTLER_REMEDY,
    NoDesignAllowed,
    check_some_allowed,
    conflicting_pairs,
    least_miss,
    remedy_of_any,
)
from seatrial.design.motion_limits import MotionLimit, check_motion_limits
from seatrial.design.safety import Safety, judge_runs, judge_safety, least_rooms, probability_at_least
from seatrial.design.trial_plan import plan_trial
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import trim
from seatrial.vehicles.whole import whole_vehicle

MASS, N, STEP = 20.0, 120, 0.25
LENGTH = N * STEP
LINEAR = whole_vehicle(Hull("linear", MASS, fixed={"X_tau_X": 1.0}), ["X_u"], moves=("u",))
PLAN = plan_trial(LINEAR, [0.0], {"u": 0.05}, N, STEP)
FORCES = np.array([4.0, 8.0, 16.0])
STEPS = np.tile(FORCES[:, None, None], (1, N, 1))
"""Steps from rest under m du/dt = -d u + tau, in closed form u = tau / d (1 - exp(-t d / m))."""
WIDE = (MotionLimit("u", -10.0, 10.0), MotionLimit("distance", upper=1e4))


def drag_draws(count, seed=0, mean=5.0, sd=0.8):
    return -np.random.default_rng(seed).normal(mean, sd, (count, 1))


def top_speed(force, drag):
    return force / drag * (1 - np.exp(-LENGTH * drag / MASS))


def way(force, drag):
    return force / drag * (LENGTH - MASS / drag * (1 - np.exp(-LENGTH * drag / MASS)))


def judge(draws, *limits, controls=STEPS, plan=PLAN, **asked):
    return judge_safety(plan, controls, draws, limits, **asked)


def test_room_is_that_of_the_closed_form():
    """RK4 at a tenth of the shortest time constant errs by less than 1e-5 of the speed."""
    draws = drag_draws(60)
    found = judge(draws, MotionLimit("u", -10.0, 2.0), MotionLimit("distance", upper=40.0))
    drag = -draws[:, 0]
    for i, force in enumerate(FORCES):
        np.testing.assert_allclose(found.room[i, :, 0], 2.0 - top_speed(force, drag), atol=1e-5 * force)
        np.testing.assert_allclose(found.room[i, :, 1], 40.0 - way(force, drag), atol=1e-4 * force)
    assert found.diverged.tolist() == [0, 0, 0]


def test_one_force_there_and_back_is_travelled_but_not_advanced():
    """Back and forth: the integral of |u| splits where u changes sign, in closed form of two steps."""
    control = np.where(np.arange(N) < N // 2, 8.0, -8.0)[None, :, None]
    found = judge(
        np.array([[-5.0]] * 60), MotionLimit("distance", upper=1e3), MotionLimit("advance", -1e3, 1e3), controls=control
    )
    rate, top, half = 5.0 / MASS, 1.6, LENGTH / 2
    first = top * (half - (1 - exp(-rate * half)) / rate)
    peak = top * (1 - exp(-rate * half))
    stop = np.log((peak + top) / top) / rate
    forward = -top * stop + (peak + top) * (1 - exp(-rate * stop)) / rate
    back = top * (half - stop) - top * (1 - exp(-rate * (half - stop))) / rate
    assert 1e3 - found.room[0, 0, 0] == pytest.approx(first + forward + back, abs=1e-3)
    assert 1e3 - found.room[0, 0, 1] == pytest.approx(
        first + forward, abs=1e-2
    )  # largest at the sample next to the stop


def test_slope_of_the_room_is_that_of_the_closed_form():
    """Of the top speed under 8 N with the drag X_u = -d, for searches that climb."""
    limits = (MotionLimit("u", upper=2.0), MotionLimit("distance", upper=40.0))
    slope = jax.jacfwd(lambda values: least_rooms(PLAN, limits, values, jnp.asarray(STEPS[1]))[0])(jnp.array([-5.0]))
    h = 1e-5
    expected = [(of(8.0, 5.0 + h) - of(8.0, 5.0 - h)) / (2 * h) for of in (top_speed, way)]
    np.testing.assert_allclose(slope[:, 0], expected, rtol=1e-4)


def test_share_of_draws_against_the_exact_probability():
    """Normal drag: u stays below a bound where the drag exceeds one number; the share errs by four binomial deviations at most."""
    count, bound = 4000, 1.6
    found = judge(drag_draws(count), MotionLimit("u", upper=bound), MotionLimit("distance", upper=1e4))
    for i, force in enumerate(FORCES):
        needed = brentq(lambda drag, force=force: top_speed(force, drag) - bound, 0.05, 50.0)
        exact = stats.norm(5.0, 0.8).sf(needed)
        assert abs(found.share[i, 0] - exact) <= 4 * sqrt(exact * (1 - exact) / count) + 1e-12
        assert found.at_least[i, 0] <= found.share[i, 0]
    assert 0.2 < found.share[1, 0] < 0.8


def test_bound_of_the_probability_is_that_of_scipy():
    for held, count in ((0, 30), (17, 30), (59, 59), (195, 200)):
        peer = stats.binomtest(held, count, alternative="greater").proportion_ci(0.95, method="exact").low
        assert probability_at_least(np.array(held), count) == pytest.approx(peer, abs=1e-12)


def test_claims_are_true_as_often_as_they_say():
    """P(k >= needed) when the limit truly holds with just the probability asked for: 0.05 at most, by the binomial."""
    for count, probability in ((59, 0.95), (200, 0.95), (400, 0.9)):
        needed = Safety(WIDE, probability, np.zeros((1, count, 2)), np.zeros(1, int)).needed
        assert stats.binom(count, probability).sf(needed - 1) <= 0.05
        assert stats.binom(count, probability).sf(needed - 2) > 0.05


def test_margin_is_what_the_bound_could_give_up():
    """With the bound tightened by the margin the design is just still allowed; by a little more it is not."""
    draws = drag_draws(200)
    margin = judge(draws, MotionLimit("u", upper=3.0)).margin[1, 0]
    for change, allowed in ((margin - 1e-9, True), (margin + 1e-9, False)):
        again = judge(draws, MotionLimit("u", upper=3.0 - change))
        assert again.allowed[1] == allowed == (again.margin[1, 0] >= 0)


def test_all_limits_together():
    """Too much drag breaks one limit, too little the other: the joint share counts draws between two numbers."""
    draws = drag_draws(500, seed=3)
    found = judge(
        draws,
        MotionLimit("u", upper=1.8),
        MotionLimit("advance", lower=-1.0, upper=40.0),
        MotionLimit("distance", upper=30.0),
    )
    fast = top_speed(8.0, -draws[:, 0]) <= 1.8
    short = way(8.0, -draws[:, 0]) <= 30.0
    assert found.joint_share[1] == (fast & short).mean()
    assert found.joint_share[1] < found.share[1].min() + 1e-12
    peer = (
        stats.binomtest(int((fast & short).sum()), 500, alternative="greater").proportion_ci(0.95, method="exact").low
    )
    assert found.joint_at_least[1] == pytest.approx(peer, abs=1e-12)


SHIP = axes_vehicle(
    "ship",
    (
        axis_equation("X", ("X_u", "X_tau_X"), inertia=20.0),
        axis_equation("Y", ("Y_v", "Y_ur"), inertia=40.0),
        axis_equation("N", ("N_r", "N_tau_N"), inertia=5.0),
    ),
    per_unit_inertia=False,
)
SHIP_VALUES = {"X_u": -5.0, "X_tau_X": 1.0, "Y_v": -30.0, "Y_ur": -10.0, "N_r": -8.0, "N_tau_N": 1.0}


def test_track_against_a_plain_loop():
    """Euler steps of a hundredth of the sample time err by their step, 2.5 ms, times rates of about 1."""
    plan = plan_trial(SHIP, [0.2, 0.0, 0.0], {"u": 0.05}, 60, STEP)
    names = list(SHIP.controls)
    control = np.stack(
        [{"tau_X": np.full(60, 8.0), "tau_N": np.where(np.arange(60) < 30, 2.0, -3.0)}[c] for c in names], -1
    )
    draws = np.array(list(SHIP_VALUES.values())) * (1 + 0.1 * np.random.default_rng(1).normal(size=(59, 6)))
    found = judge_safety(
        plan,
        control[None],
        draws,
        [MotionLimit("x", -5.0, 9.0), MotionLimit("y", -4.0, 6.0), MotionLimit("r", -0.3, 0.2)],
    )
    for s in (0, 20, 58):
        x_u, x_f, y_v, y_ur, n_r, n_t = draws[s]
        u, v, r, x, y, psi, ahead, aside, turn, h = 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, inf, inf, inf, STEP / 100
        for k in range(61):
            ahead, aside = min(ahead, 9 - x, x + 5), min(aside, 6 - y, y + 4)
            turn = min(turn, 0.2 - r, r + 0.3)
            for _ in range(100 if k < 60 else 0):
                du = (x_u * u + x_f * 8.0) / 20
                dv = (y_v * v + y_ur * u * r) / 40
                dr = (n_r * r + n_t * (2.0 if k < 30 else -3.0)) / 5
                dx, dy = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
                u, v, r, x, y, psi = u + h * du, v + h * dv, r + h * dr, x + h * dx, y + h * dy, psi + h * r
        assert found.room[0, s] == pytest.approx([ahead, aside, turn], abs=0.01)


def test_depth_and_pitch_of_a_diving_vehicle():
    """Least rooms are those of the states that the plan itself shows, and of the state after its last step."""
    entry = load_vehicle("remus100_longitudinal")
    model = entry.build(positions=("z",))
    u, w, q, _, theta = trim(model, entry.coefficients, n=entry.hull.trim["n"]).state
    start = [u, w, q, 10.0, theta]
    longer, plan = (plan_trial(model, start, {"u": 0.05}, n, 0.1) for n in (51, 50))
    control = np.stack([np.full(51, entry.hull.trim["n"]), np.where(np.arange(51) < 15, 0.1, -0.2)], -1)
    values = np.array(list(entry.coefficients.values()))
    limits = [MotionLimit("z", upper=10.5), MotionLimit("theta", -0.2, 0.2), MotionLimit("z", 9.0)]
    found = judge_safety(plan, control[None, :50], np.tile(values, (59, 1)), limits).room[0, 0]
    motion = np.asarray(longer.motion(values, control))
    z, theta = motion[:, 3], motion[:, 4]
    expected = [10.5 - z.max(), np.minimum(0.2 - theta, theta + 0.2).min(), z.min() - 9.0]
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_draws_that_diverge_break_every_limit_and_are_told():
    """Damping that drives instead of braking grows the speed without end; everything else about these draws is harmless."""
    draws = np.vstack([drag_draws(95), np.full((5, 1), 1e6)])
    found = judge(draws, *WIDE, MotionLimit("u", lower=-1.0))
    assert found.diverged.tolist() == [5, 5, 5]
    assert (found.share == 0.95).all()
    assert (found.joint_share == 0.95).all()
    assert (found.room[:, 95:] == -inf).all()
    assert not found.allowed.any()
    assert "diverges in 5" in found.words(0)[-1]
    with pytest.raises(InputError, match="the motion of 3 designs diverges too often") as caught:
        check_some_allowed(found)
    assert "narrow the priors" in caught.value.remedy


def test_words_of_one_design():
    found = judge(drag_draws(200), MotionLimit("u", upper=10.0), MotionLimit("distance", upper=40.0))
    first, second, together = found.words(1)
    assert first.startswith("u at most 10 m/s: holds in 200 of 200 draws, probability at least 0.985, margin ")
    assert second.startswith("distance travelled at most 40 m: holds in ")
    assert "0.95 asked for" in together


def test_nothing_to_explain_where_a_design_is_allowed():
    check_some_allowed(judge(drag_draws(59), *WIDE))


def test_pair_that_conflicts():
    """Gentle designs keep u low, strong ones advance far; none does both, and the misses are those of the closed form."""
    draws = drag_draws(200, sd=0.1)
    found = judge(
        draws,
        MotionLimit("u", upper=1.2),
        MotionLimit("advance", upper=1e3),
        MotionLimit("u", lower=-1.0),
        MotionLimit("distance", upper=1e4),
    )
    assert found.allowed.tolist() == [True, False, False]
    rooms = found.room.copy()
    rooms[..., 1] = way(FORCES[:, None], -draws[:, 0]) - 30.0  # an advance of 30 m at least by the end
    found = Safety(
        (found.limits[0], MotionLimit("advance", lower=30.0), *found.limits[2:]), 0.95, rooms, found.diverged
    )
    assert conflicting_pairs(found) == [(0, 1)]
    speed, far = top_speed(8.0, -draws[:, 0]), way(4.0, -draws[:, 0])
    tail = found.draws - found.needed
    assert least_miss(found, 0, (1,)) == (pytest.approx(np.sort(speed)[::-1][tail] - 1.2, abs=1e-4), 1)
    assert least_miss(found, 1, (0,)) == (pytest.approx(30.0 - np.sort(far)[tail], abs=1e-9), 0)
    with pytest.raises(InputError) as caught:
        check_some_allowed(found)
    told = caught.value.found
    assert "no design of 3" in told
    assert "u at most 1.2 m/s excludes 2" in told
    assert (
        "u at most 1.2 m/s and advance at least 30 m conflict: separately they leave 1 and 2 designs, together none"
        in told
    )
    assert f"is missed by {least_miss(found, 1, (0,))[0]:.3g} m by design 0" in told
    assert f" or widen u at most 1.2 m/s by {least_miss(found, 0, (1,))[0]:.3g} m/s or more" in caught.value.remedy


def test_two_limits_that_each_exclude_all_must_both_give_way():
    with pytest.raises(InputError) as caught:
        check_some_allowed(
            judge(drag_draws(59, sd=0.1), MotionLimit("u", upper=0.5), MotionLimit("distance", upper=5.0))
        )
    assert " and widen distance travelled at most 5 m by " in caught.value.remedy


def test_limit_that_excludes_all():
    draws = drag_draws(59, sd=0.1)
    found = judge(draws, MotionLimit("u", upper=0.5), MotionLimit("distance", upper=1e4))
    assert conflicting_pairs(found) == []  # a limit that leaves no design conflicts with none
    with pytest.raises(InputError) as caught:
        check_some_allowed(found)
    miss = top_speed(4.0, -draws.max()) - 0.5  # all 59 draws must hold
    assert f"u at most 0.5 m/s is missed by {miss:.3g} m/s by design 0, the gentlest" in caught.value.found
    assert "distance travelled at most 10000 m excludes 0" in caught.value.found
    remedy = caught.value.remedy
    assert f"widen u at most 0.5 m/s by {miss:.3g} m/s or more; or try gentler or shorter designs (" in remedy
    assert remedy.endswith("design.duration)")
    error, travelled = caught.value, pickle.loads(pickle.dumps(caught.value))
    ways = travelled.ways
    wider = NoDesignAllowed("", found="", expected="", ways=ways._replace(widths=(2 * ways.widths[0],)))
    assert remedy_of_any([wider, error]) == remedy_of_any([travelled]) == remedy
    assert remedy_of_any([wider, NumericalError("it diverges"), error]) == (
        f"widen u at most 0.5 m/s by {miss:.3g} m/s or more; or narrow the priors{GENTLER_REMEDY}"
    )


def test_three_limits_of_which_every_two_leave_designs():
    room = np.ones((3, 59, 3))
    for i in range(3):
        room[i, :, i] = -0.25 * (i + 1)
    found = Safety((*WIDE, MotionLimit("advance", upper=9.0)), 0.95, room, np.zeros(3, int))
    with pytest.raises(InputError, match="every two limits leave designs") as caught:
        check_some_allowed(found)
    assert "with all others advance at most 9 m is missed by 0.75 m by design 2" in caught.value.found


def refuse(*limits, controls=STEPS, draws=None, plan=PLAN, **asked):
    with pytest.raises(InputError) as caught:
        judge(drag_draws(59) if draws is None else draws, *limits, controls=controls, plan=plan, **asked)
    return caught.value


def test_states_that_the_vehicle_lacks():
    error = refuse(MotionLimit("theta", upper=0.3))
    assert (error.where, error.expected) == ("limit on theta", "one of its states: u")
    assert '"theta", which is no state of the vehicle "linear"' in error.found
    assert "its states: u" in refuse(MotionLimit("z", upper=27.0)).expected
    error = refuse(MotionLimit("y", -1.0, 1.0))
    assert "has no v to integrate it from" in error.found
    assert "has no r to integrate it from" in refuse(MotionLimit("psi", upper=0.3)).found


@pytest.mark.parametrize(
    ("limits", "asked", "words"),
    [
        (WIDE, {"probability": 1.0}, "1"),
        (WIDE, {"draws": drag_draws(58)}, "58 draws, which show at most a probability of 0.9497"),
        (WIDE, {"draws": np.ones((59, 2))}, "shape (59, 2)"),
        (WIDE, {"controls": STEPS[:, :-1]}, "shape (3, 119, 1)"),
        (WIDE, {"controls": np.where(STEPS > 10, np.nan, STEPS)}, "no finite number in row 2"),
    ],
)  # fmt: skip
def test_what_is_refused(limits, asked, words):
    error = refuse(*limits, **asked)
    assert words in error.found
    if "draws" in error.where and "58" in error.found:
        assert "at least 59 draws" in error.remedy


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (MotionLimit("u"), "from -inf to inf m/s"),
        (MotionLimit("u", 2.0, 1.0), "from 2 to 1 m/s"),
        (MotionLimit("distance", upper=float("nan")), "to nan m"),
        (MotionLimit("y"), "from -inf to inf"),
    ],
)
def test_bounds_that_bound_nothing(limit, words):
    with pytest.raises(InputError) as caught:
        check_motion_limits(SHIP, [limit])
    assert words in caught.value.found


def test_more_designs_than_one_block_are_those_alone():
    controls = np.linspace(1.0, 20.0, 90)[:, None, None] * np.ones((1, N, 1))
    draws = drag_draws(60)
    together = judge(draws, *WIDE, controls=controls)
    np.testing.assert_allclose(judge(draws, *WIDE, controls=controls[85:86]).room[0], together.room[85], rtol=1e-12)


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        (-0.1, 0.2, "theta from -5.72958 to 11.4592 deg"),
        (-np.inf, 0.2, "theta at most 11.4592 deg"),
        (-0.1, np.inf, "theta at least -5.72958 deg"),
    ],
)
def test_limits_are_told_in_the_unit_they_are_shown_in(lower, upper, words):
    assert MotionLimit("theta", lower, upper).words == words


def test_runs_of_a_closed_loop_are_judged_each_with_its_own_control():
    """Draw s with the force s: rooms are those of each alone, and a draw that diverges breaks all limits."""
    draws, forces = drag_draws(60), np.linspace(2.0, 12.0, 60)
    controls = forces[:, None, None] * np.ones((1, N, 1))
    limits = (MotionLimit("u", -10.0, 2.0), MotionLimit("distance", upper=40.0))
    found = judge_runs(PLAN, controls, draws, limits)
    drag = -draws[:, 0]
    assert found.room.shape == (1, 60, 2)
    np.testing.assert_allclose(found.room[0, :, 0], 2.0 - top_speed(forces, drag), atol=1e-4)
    np.testing.assert_allclose(found.room[0, :, 1], 40.0 - way(forces, drag), atol=2e-3)
    assert found.diverged.tolist() == [0]
    assert (found.probability, found.limits) == (0.95, limits)
    wild = np.vstack([draws[:-2], np.full((2, 1), 1e6)])
    found = judge_runs(PLAN, controls, wild, limits)
    assert found.diverged.tolist() == [2]
    assert (found.room[0, 58:] == -inf).all()
    assert np.isfinite(found.room[0, :58]).all()
    with pytest.raises(InputError, match="58 draws"):
        judge_runs(PLAN, controls[:58], draws[:58], limits)
    with pytest.raises(InputError, match="designs of 120 samples"):
        judge_runs(PLAN, controls[:, 1:], draws, limits)


@pytest.mark.parametrize(
    ("left", "pairs"),
    [(([0], [1, 2, 3], [4, 5]), [(1, 2), (0, 1), (0, 2)]), (([1, 2, 3], [0], [4, 5]), [(0, 2), (0, 1), (1, 2)])],
)
def test_pairs_that_leave_most_designs_alone_come_first(left, pairs):
    """Of three limits that share no design: by the fewer of the designs that the two leave."""
    room = -np.ones((6, 59, 3))
    for limit, designs in enumerate(left):
        room[designs, :, limit] = 1.0
    assert conflicting_pairs(Safety((*WIDE, MotionLimit("advance", upper=9.0)), 0.95, room, np.zeros(6, int))) == pairs
