"""Cost of trials and when to stop them, against closed forms and brute force over every end."""

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.design.cost import (
    ElectricPower,
    expected_joules,
    gain_per_cost,
)
from seatrial.design.stopping import best_stops
from seatrial.design.trial_plan import plan_trial
from seatrial.manoeuvres.autopilot import Autopilot, Loop
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import N0, RPM, TRUTH, U0, naive_rk4, paper_model, surge_rate

MASS, DRAG, N, STEP = 20.0, 5.0, 120, 0.25
LENGTH = N * STEP
LINEAR = whole_vehicle(Hull("linear", MASS, fixed={"X_tau_X": 1.0}), ["X_u"], moves=("u",))
PLAN = plan_trial(LINEAR, [0.0], {"u": 0.05}, N, STEP)
PAPER = plan_trial(paper_model(), [U0], {"u": 0.05}, N, STEP)
VALUES = np.array([[TRUTH[name] for name in PAPER.names]])
POINT = ElectricPower(10.0, 40.0, 1500 * RPM, "n")
PILOT = Autopilot(("n",), (Loop("u", (("n", 1.0),), 400 * RPM, interval=STEP),), (-np.inf,), (np.inf,))
PILOTED = plan_trial(PAPER.model, [U0], {"u": 0.05}, N, STEP, autopilot=PILOT)


def test_energy_of_a_constant_propeller():
    speeds = np.array([0.0, 750.0, -1500.0, 3000.0]) * RPM
    controls = np.tile(speeds[:, None, None], (1, N, 1))
    found = expected_joules(PAPER, POINT, controls, VALUES)
    np.testing.assert_allclose(found, LENGTH * (10 + 40 * np.array([0.0, 1 / 8, 1.0, 8.0])), rtol=1e-12)


def test_energy_under_an_autopilot_is_that_of_the_controls_it_makes():
    """Over draws of the drag the pilot drives its propeller otherwise: the mean of what each takes, by the controls alone."""
    asked = np.tile([N0, 1.2 * U0], (1, N, 1))
    draws = VALUES * (1 + 0.1 * np.random.default_rng(0).normal(size=(5, 3)))
    found = expected_joules(PILOTED, POINT, asked, draws)
    made = np.stack([np.asarray(PILOTED.applied(draw, asked[0])) for draw in draws])
    assert np.ptp(made) > 50 * RPM
    np.testing.assert_allclose(found, expected_joules(PAPER, POINT, made, VALUES).mean(), rtol=1e-3)


def test_energy_of_a_motion_that_diverges_is_infinite():
    found = expected_joules(PILOTED, POINT, np.tile([N0, U0], (1, N, 1)), np.vstack([VALUES, VALUES * [1, -1e9, 1]]))
    assert found.tolist() == [np.inf]
    assert gain_per_cost(np.array([3.0, 0.0]), np.array([found[0], 90.0])).tolist() == [0.0, 0.0]
    assert gain_per_cost(np.array([3.0]), np.array([60.0])).tolist() == [0.05]


PRIOR = np.diag([0.3, 0.6, 2e-4]) ** 2


def entropy_reduction(information):
    """0.5 ln det(I + P0 F)."""
    return 0.5 * np.linalg.slogdet(np.eye(len(PRIOR)) + PRIOR @ information)[1]


def doublet():
    return np.where(np.arange(N) % 40 < 20, 1.0, -1.0) * 200 * RPM + N0


def test_best_stop_against_brute_force_over_all_ends():
    """Sensitivities by central differences of a plain loop; information and length of every shortened trial by themselves."""
    control = doublet()
    found = best_stops(PAPER, control[None, :, None], VALUES, entropy_reduction, overhead=30.0, ends=N)

    def shown(moved):
        speed = [U0]
        for n in control / (2 * np.pi):
            scaled = {"x_u": moved[0], "x_uu": moved[1], "thrust": moved[2] * (2 * np.pi) ** 2}
            speed.append(naive_rk4(lambda u, n=n, scaled=scaled: surge_rate(u, n, **scaled), speed[-1], STEP))
        return np.array(speed)

    size = 1e-4 * np.abs(VALUES[0])
    slopes = np.stack([(shown(VALUES[0] + d) - shown(VALUES[0] - d)) for d in np.diag(size)], -1)[:N] / (
        2 * size * 0.05
    )
    rates = [entropy_reduction(slopes[:end].T @ slopes[:end]) / (30.0 + end * STEP) for end in range(1, N + 1)]
    best = int(np.argmax(rates))
    assert 0 < best < N - 1
    assert found.samples.tolist() == [best + 1]
    np.testing.assert_allclose(found.rate, [rates[best]], rtol=2e-4)
    np.testing.assert_allclose(found.length, [(best + 1) * STEP])
    masked = plan_trial(PAPER.model, [U0], {"u": 0.05}, N, STEP, (np.arange(N) <= best)[:, None] * 1.0)
    np.testing.assert_allclose(found.information[0, 0], masked.information(VALUES[0], control[:, None]), rtol=1e-9)


def test_best_stop_over_draws_is_by_the_mean_gain():
    draws = VALUES * (1 + 0.2 * np.random.default_rng(2).normal(size=(8, 3)))
    designs = np.stack([doublet(), doublet()[::-1]])[:, :, None]
    found = best_stops(PAPER, designs, draws, entropy_reduction, overhead=30.0, ends=4)
    ends = np.unique(np.linspace(1, N, 4).round().astype(int))
    for i, control in enumerate(designs):
        cut = [plan_trial(PAPER.model, [U0], {"u": 0.05}, N, STEP, (np.arange(N) < e)[:, None] * 1.0) for e in ends]
        gains = [np.mean([entropy_reduction(plan.information(draw, control)) for draw in draws]) for plan in cut]
        rates = np.array(gains) / (30.0 + ends * STEP)
        assert found.samples[i] == ends[rates.argmax()]
        np.testing.assert_allclose(found.rate[i], rates.max(), rtol=1e-9)


def test_without_time_between_trials_the_first_end_is_no_worse_than_the_last():
    rates = [
        best_stops(PAPER, doublet()[None, :, None], VALUES, entropy_reduction, overhead, ends=N).length[0]
        for overhead in (0.0, 1e6)
    ]
    assert rates[0] < rates[1] == N * STEP


def test_gains_that_are_refused():
    with pytest.raises(InputError, match=r"a least gain of -2"):
        gain_per_cost(np.array([1.0, -2.0]), np.array([1.0, 1.0]))
    with pytest.raises(InputError, match=r"a least cost of 0"):
        gain_per_cost(np.array([1.0]), np.array([0.0]))


def test_an_end_by_which_a_motion_diverges_is_no_choice():
    runaway = np.vstack([VALUES, VALUES * [1, -1e6, 1]])
    found = best_stops(PAPER, doublet()[None, :, None], runaway, entropy_reduction, 30.0, ends=4)
    assert found.samples.tolist() == [1]
    assert np.isfinite(found.information).all()


def test_ends_by_which_a_motion_diverges_are_no_choice():
    """Drag that drives lets a trial run away after a while: it is ended before."""
    control = np.full((1, N, 1), 8.0)
    late = best_stops(PLAN, control, np.array([[-DRAG], [600.0]]), lambda f: np.log1p(f[..., 0, 0]), 1.0, ends=N)
    assert 1 <= late.samples[0] < N
    assert np.isfinite(late.rate).all()
