from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from seatrial.manoeuvres.manoeuvre import Limits, check_limits
from seatrial.manoeuvres.relay import RelayFamily, replay, run_relay
from seatrial.numerics.gaussian import independent
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.linearise import trim
from seatrial.vehicles.simulate import simulate
from tests.cases import N0, RPM, SCALES, THRUST, TRUTH, U0, X_U, X_UU, naive_rk4, paper_model, riccati_speed, surge_rate

START = np.array([U0, X_U, X_UU, THRUST])
AMPLITUDE, THRESHOLD = 200 * RPM, 0.35
FAMILY = RelayFamily((("n", N0),), "n", "u", U0, duration=30.0, sample_time=0.05)


def surge_space(outputs=("u", "udot")):
    noise = np.full(len(outputs), 0.1)
    return discretise(paper_model(), outputs, independent(START, np.ones(4)), np.zeros(4), noise, SCALES)


def naive_relay(family, amplitude, threshold, noise=None):
    """Propeller speed (rad/s) and surge speed of the closed loop, said as one would on the bridge."""
    ahead, u, control, speed, switches = True, U0, [], [], 0
    for k, t in enumerate(family.time()):
        acting = family.start - 1e-9 <= t < family.start + family.active - 1e-9
        seen = u - U0 + (0.0 if noise is None else noise[k])
        if acting and ahead and seen >= threshold:
            ahead, switches = False, switches + 1
        elif acting and not ahead and seen <= -threshold:
            ahead, switches = True, switches + 1
        control.append(N0 + (amplitude if ahead else -amplitude) * acting)
        speed.append(u)
        u = naive_rk4(lambda x, n=control[-1]: surge_rate(x, n / (2 * np.pi)), u, family.sample_time)
    return np.array(control), np.array(speed), switches


@pytest.mark.parametrize(
    ("changes", "threshold"),
    [({}, 0.35), ({}, 0.05), ({}, 0.6), ({"start": 1.0, "active": 20.0}, 0.2), ({"start": 29.9}, 0.2)],
)
def test_loop_of_the_bridge(changes, threshold):
    family = replace(FAMILY, **changes)
    run = run_relay(surge_space(), family, AMPLITUDE, threshold, START)
    control, speed, switches = naive_relay(family, AMPLITUDE, threshold)
    assert np.array_equal(run.control[:, 0], control)
    assert np.allclose(run.state[:, 0], speed, rtol=1e-12)
    assert np.allclose(run.outputs, np.column_stack([speed, surge_rate(speed, control / (2 * np.pi))]), atol=1e-12)
    assert run.switches == switches


def test_switching_times_by_riccati():
    """Under either side the speed has a closed form: each crossing of a threshold, up to the next sample."""
    run = run_relay(surge_space(), FAMILY, AMPLITUDE, THRESHOLD, START)
    u, begin, side, expected = U0, 0, 1, []
    while True:
        rev_per_s, goal = 12.5 + side * 200 / 60, U0 + side * THRESHOLD
        if riccati_speed(60.0, u, rev_per_s) * side < goal * side:
            break
        crossing = brentq(lambda t, u=u, n=rev_per_s, y=goal: riccati_speed(t, u, n) - y, 0.0, 60.0, xtol=1e-12)
        samples = int(np.ceil(crossing / FAMILY.sample_time))
        begin, u, side = begin + samples, riccati_speed(samples * FAMILY.sample_time, u, rev_per_s), -side
        if begin >= FAMILY.time().size:
            break
        expected.append(begin)
    assert np.flatnonzero(np.diff(run.control[:, 0])).tolist() == [k - 1 for k in expected]
    assert run.switches == len(expected) > 3
    assert THRESHOLD <= run.reached < THRESHOLD + 0.05 * abs(surge_rate(U0 + THRESHOLD, 12.5 + 200 / 60))


def test_measured_noise_in_the_loop():
    noise = np.random.default_rng(5).normal(size=FAMILY.time().size) * 0.08
    run = run_relay(surge_space(), FAMILY, AMPLITUDE, 0.2, START, noise)
    control, speed, switches = naive_relay(FAMILY, AMPLITUDE, 0.2, noise)
    assert np.array_equal(run.control[:, 0], control)
    assert np.allclose(run.state[:, 0], speed, rtol=1e-12)
    assert run.switches == switches
    assert run.reached == pytest.approx(np.abs(speed - U0 + noise).max(), rel=1e-12)
    assert not np.array_equal(control, naive_relay(FAMILY, AMPLITUDE, 0.2)[0])


def test_samples_without_a_measurement_leave_the_relay_alone():
    noise = np.where(np.arange(FAMILY.time().size) % 10 == 0, 0.0, np.nan)
    run = run_relay(surge_space(), FAMILY, AMPLITUDE, 0.2, START, noise)
    assert np.array_equal(run.control[:, 0], naive_relay(FAMILY, AMPLITUDE, 0.2, noise)[0])
    assert (np.flatnonzero(np.diff(run.control[:, 0])) % 10 == 9).all()
    blind = run_relay(surge_space(), FAMILY, AMPLITUDE, 0.2, START, noise + np.nan)
    assert (blind.switches, blind.reached) == (0, 0)


def test_slow_actuator_keeps_the_rate_and_returns_to_trim():
    family = replace(FAMILY, rate=12.0, start=1.0, active=20.0)
    run = run_relay(surge_space(), family, AMPLITUDE, 0.2, START)
    change = np.diff(run.control[:, 0])
    assert np.abs(change).max() == pytest.approx(12.0 * 0.05, rel=1e-12)
    assert np.abs(run.control[:, 0] - N0).max() <= AMPLITUDE * (1 + 1e-12)
    assert (run.control[:20] == N0).all()
    assert run.control[-1, 0] == pytest.approx(N0, abs=1e-12)
    assert run.switches > 3
    check_limits(replay(family, AMPLITUDE, 0.2, run), Limits(rate=12.0), 0.05)


def test_batch_over_designs_equals_loops():
    space, amplitudes, thresholds = surge_space(), np.array([80.0, 150.0, 200.0]) * RPM, np.array([0.1, 0.2, 0.6])
    noise = np.random.default_rng(6).normal(size=(3, FAMILY.time().size)) * 0.02
    batch = jax.vmap(lambda a, y, e: run_relay(space, FAMILY, a, y, START, e))(amplitudes, thresholds, noise)
    for i in range(3):
        one = run_relay(space, FAMILY, amplitudes[i], thresholds[i], START, noise[i])
        assert np.array_equal(batch.control[i], one.control)
        assert np.allclose(batch.state[i], one.state, rtol=1e-13)
        assert batch.switches[i] == one.switches


def test_replay_is_the_same_trial_in_open_loop():
    run = run_relay(surge_space(), FAMILY, AMPLITUDE, THRESHOLD, START)
    manoeuvre = replay(FAMILY, AMPLITUDE, THRESHOLD, run)
    _, control = manoeuvre.sample(FAMILY.sample_time)
    assert np.array_equal(control, run.control[:, 0])
    speed = simulate(paper_model(), TRUTH, control[:, None], np.full(control.size, 0.05), [U0])
    assert np.allclose(speed, run.state, rtol=1e-12)
    assert (manoeuvre.control, manoeuvre.parameters["threshold"]) == ("n", THRESHOLD)
    between = manoeuvre.signal(FAMILY.time() + 0.02)
    assert np.array_equal(between, control)


def test_pitch_zigzag_of_the_longitudinal_vehicle():
    """Down stern plane lowers the nose: with the effect said, pitch swings about trim at a depth that hardly changes."""
    entry = load_vehicle("remus100_longitudinal")
    level = trim(entry.build(positions=("z",)), entry.coefficients, n=125.0)
    start, pitch_trim, stern_plane = jnp.array(level.state), level.state[4], level.control[1]
    model = entry.build(positions=("z",), free=())
    space = discretise(model, ("q", "theta"), independent(start, np.ones(5)), np.zeros(5), np.ones(2))
    controls = (("n", 125.0), ("delta_s", stern_plane))
    family = RelayFamily(controls, "delta_s", "theta", pitch_trim, duration=40.0, sample_time=0.05, effect=-1.0)
    run = run_relay(space, family, 0.15, 0.2, start)
    assert (run.control[:, 0] == 125.0).all()
    assert np.unique(run.control[:, 1]) == pytest.approx(stern_plane + np.array([-0.15, 0.15]))
    assert run.switches >= 8
    assert 0.2 <= run.reached < 0.3
    pitch = np.asarray(run.outputs[:, 1]) - pitch_trim
    assert pitch.max() > 0.2
    assert pitch.min() < -0.2
    assert np.abs(run.state[:, 3]).max() < 1.5
    assert run_relay(space, replace(family, effect=1.0), 0.15, 0.2, start).switches == 0
