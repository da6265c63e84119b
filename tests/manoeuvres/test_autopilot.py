"""An autopilot against a plain loop in Python: gains, limits, rates, own intervals, gaps in what is measured, cascades and angles."""

from math import inf, pi

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.manoeuvres.autopilot import Autopilot, Loop
from seatrial.manoeuvres.pilot import Moment, close_loop
from seatrial.numerics.integrate import time_loop

H, N = 0.1, 400
RANDOM = np.random.default_rng(3)


class PlainLoop:
    """A PID loop as a textbook has it."""

    def __init__(self, kp, ki, kd, limit, rate, interval, turns=False):
        self.gains, self.limit, self.rate, self.interval, self.turns = (kp, ki, kd), limit, rate, interval, turns
        self.total = self.seen = self.slope = self.output = 0.0
        self.begun = False

    def turned(self, angle):
        return np.arctan2(np.sin(angle), np.cos(angle)) if self.turns else angle

    def decide(self, wanted, y, slope):
        kp, ki, kd = self.gains
        y = self.seen if np.isnan(y) else y
        if slope is None:
            self.slope = self.turned(y - self.seen) / self.interval if self.begun else 0.0
        elif not np.isnan(slope):
            self.slope = slope
        error = self.turned(wanted - y)
        ahead = kp * error + ki * (self.total + error * self.interval) - kd * self.slope
        if not (abs(ahead) > self.limit and np.sign(ahead) == np.sign(ki * error)):
            self.total += error * self.interval
        wished = kp * error + ki * self.total - kd * self.slope
        wished = min(max(wished, -self.limit), self.limit)
        step = min(max(wished - self.output, -self.rate * self.interval), self.rate * self.interval)
        self.output, self.seen, self.begun = self.output + step, y, True


def follow(autopilot, told, error, move, start):
    """States and controls of a loop closed by `time_loop`; the channels are the first states."""
    moments = Moment(jnp.arange(N) * H, tuple(map(jnp.asarray, told)), tuple(map(jnp.asarray, error)))
    law = close_loop(autopilot, lambda state, held: state[: len(autopilot.outputs)])
    steps = jnp.full(N, H)

    def look(state, memory, held, moment):
        return memory, (state, held)

    _, (states, controls) = time_loop(move, start, law, steps, look, autopilot.begin(), moments)
    return np.array(states), np.array(controls)


def heading(state, held, h):
    """A heading and its rate under a moment."""
    psi, r = state
    return psi + h * r, r + h * (-0.4 * r + held[0])


@pytest.mark.parametrize("derivative", ["r", None])
@pytest.mark.parametrize("every", [1, 3])
def test_a_loop_is_the_plain_loop(derivative, every):
    gains = {"kp": 1.5, "ki": 0.4, "kd": 2.0}
    loop = Loop(
        "psi", (("tau", 0.7),), **gains, derivative=derivative, limit=0.3, rate=0.5, every=every, interval=every * H
    )
    autopilot = Autopilot(("tau",), (loop,), (-0.08,), (0.15,))
    told = np.where(np.sin(np.arange(N) / 30) > 0, 0.02, -0.05), np.where(np.arange(N) < 250, 3.0, -2.9)
    count = len(autopilot.outputs)
    error = RANDOM.normal(size=(count, N)) * 0.02
    error[:, np.arange(N) % 5 == 2] = np.nan
    states, controls = follow(autopilot, told, error, heading, (jnp.zeros(()), jnp.zeros(())))
    plain, (psi, r), found, acted = PlainLoop(*gains.values(), 0.3, 0.5, every * H, turns=True), (0.0, 0.0), [], []
    for k in range(N):
        if k % every == 0:
            plain.decide(told[1][k], psi + error[0, k], None if derivative is None else r + error[1, k])
        held = min(max(told[0][k] + 0.7 * plain.output, -0.08), 0.15)
        found.append((psi, r))
        acted.append(held)
        psi, r = heading((psi, r), (held,), H)
    np.testing.assert_allclose(states.T, found, atol=1e-12)
    np.testing.assert_allclose(controls[0], acted, atol=1e-12)
    assert {-0.08, 0.15} <= set(np.round(acted, 12))
    assert np.abs(states[0]).max() > pi  # the short way from 3.0 to -2.9 rad leads over pi


def test_an_outer_loop_moves_the_set_point_of_an_inner_one():
    outer = Loop("z", (("theta_set", -1.0),), 0.2, 0.01, limit=0.3, every=5, interval=5 * H)
    inner = Loop("theta", (("fin", 1.0),), 2.0, 0.0, 1.0, every=1, interval=H)
    autopilot = Autopilot(("fin",), (outer, inner), (-inf,), (inf,))
    assert autopilot.outputs == ("z", "theta")
    assert autopilot.commands == ("fin", "z_set", "theta_set")
    assert autopilot.cycle == 5

    def move(state, held, h):
        z, theta, q = state
        return z - h * 1.5 * theta, theta + h * q, q + h * (-q + held[0])

    told = np.zeros(N), np.full(N, 2.0), np.full(N, 0.02)
    states, controls = follow(autopilot, told, np.zeros((2, N)), move, (jnp.zeros(()),) * 3)
    depth, pitch = PlainLoop(0.2, 0.01, 0.0, 0.3, inf, 5 * H), PlainLoop(2.0, 0.0, 1.0, inf, inf, H, turns=True)
    state, found = (0.0, 0.0, 0.0), []
    for k in range(N):
        if k % 5 == 0:
            depth.decide(2.0, state[0], None)
        pitch.decide(0.02 - depth.output, state[1], None)
        found.append((*state, pitch.output))
        state = move(state, (pitch.output,), H)
    np.testing.assert_allclose(np.vstack([states, controls]).T, found, atol=1e-12)
    assert states[0, -1] == pytest.approx(2.0, abs=0.2)


def test_the_sum_does_not_wind_up():
    """A step that is too large for the limit: with conditional integration the overshoot is far smaller than the sum alone would make."""

    def overshoot(limit):
        loop = Loop("x", (("f", 1.0),), 1.0, 0.3, 1.2, limit=limit, every=1, interval=H)
        states, _ = follow(
            Autopilot(("f",), (loop,), (-0.3,), (0.3,)),
            (np.zeros(N), np.full(N, 2.0)),
            np.zeros((1, N)),
            lambda state, held, h: (state[0] + h * state[1], state[1] + h * held[0]),
            (jnp.zeros(()), jnp.zeros(())),
        )
        return states[0].max() - 2.0

    assert overshoot(0.3) < 0.6 * overshoot(inf)
