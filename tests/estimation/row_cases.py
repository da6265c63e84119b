"""Trials for regression rows: the golden surge trial with fresh noise, and a linear ship of sway and yaw solved exactly."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.linalg import expm

from seatrial.core.record import Channel, make_record
from seatrial.estimation.regression.weak_form import weak_trials
from seatrial.vehicles.axis_equation import axis_equation
from tests.cases import DEDUCTION, MASS, PROVENANCE, TRUTH
from tests.estimation_cases import SIGMA, golden_motion, make_trial, naive_speed

SURGE = (axis_equation("X", tuple(TRUTH), MASS, DEDUCTION),)
TRUE = np.array(list(TRUTH.values()))
SHIP = np.array([[-0.3, -0.5], [-0.2, -0.6]])
RUDDER = np.array([0.1, -0.25])
SHIP_CHANNELS = (
    Channel("delta_r", "rad", "control"),
    Channel("v", "m/s", "measurement"),
    Channel("r", "rad/s", "measurement"),
)
SHIP_EQUATIONS = (axis_equation("Y", ("Y_v", "Y_r", "Y_delta_r")), axis_equation("N", ("N_v", "N_r", "N_delta_r")))
SHIP_TRUE = np.column_stack([SHIP, RUDDER]).ravel()


@cache
def exact_speed():
    """Speed of the golden trial without the term X_du3, by Runge-Kutta."""
    return naive_speed(golden_motion()[1], np.full(6000, 0.01))


def surge_record(seed, sd=SIGMA):
    time, rev, _ = golden_motion()
    return make_trial(time, rev, u=exact_speed() + sd * np.random.default_rng(seed).normal(size=time.size))


@cache
def surge_trial(width):
    return weak_trials([surge_record(0)], SURGE, width)[0]


def noisy_surge(width, seed, sd=SIGMA):
    """Trial of the golden motion with fresh noise, its windows computed once."""
    trial = surge_trial(width)
    noise = sd * np.random.default_rng(seed).normal(size=exact_speed().size)
    return replace(trial, signals={**trial.signals, "u": exact_speed() + noise})


def rudder_of(time):
    return 0.3 * np.sign(np.sin(0.4 * time + 0.1)) + 0.1 * np.sin(1.1 * time)


def ship_motion(time):
    """Sway and yaw of the linear ship at each time, rudder held between them: exact, steps of any length."""
    state, states = np.zeros(2), [np.zeros(2)]
    transitions = {}
    for h, rudder in zip(np.diff(time), rudder_of(time), strict=False):
        if h not in transitions:
            block = np.zeros((3, 3))
            block[:2, :2], block[:2, 2] = SHIP * h, RUDDER * h
            transitions[h] = expm(block)
        state = transitions[h][:2, :2] @ state + transitions[h][:2, 2] * rudder
        states.append(state)
    return np.array(states)


def ship_record(time, states, label="ship"):
    columns = {"delta_r": rudder_of(time), "v": states[:, 0], "r": states[:, 1]}
    return make_record(time, columns, SHIP_CHANNELS, PROVENANCE, label)


def driven_ship(time, seed, force, correlation=-0.6):
    """The linear ship under white forces that correlate, by Euler's rule at a tenth of the step."""
    rng = np.random.default_rng(seed)
    factor = force * np.linalg.cholesky([[1, correlation], [correlation, 1]])
    h, state, states = (time[1] - time[0]) / 10, np.zeros(2), [np.zeros(2)]
    for rudder in rudder_of(time)[:-1]:
        for push in np.sqrt(h) * rng.normal(size=(10, 2)) @ factor.T:
            state = state + h * (SHIP @ state + RUDDER * rudder) + push
        states.append(state)
    return np.array(states) + 0.001 * rng.normal(size=(time.size, 2))
