import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.manoeuvres.family import Family
from seatrial.numerics.integrate import euler_step
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.simulate import simulate
from tests.cases import N0, RPM, TERMS, TRUTH, U0, naive_rk4, paper_model, riccati_speed, surge_rate

TIME = np.arange(501) * 0.01
STEP = np.full(501, 0.01)
FASTER = 200 / 60
"""The golden step of propeller speed, 200 rpm in rev/s."""


def constant(rev_per_s):
    return np.full((501, 1), 2 * np.pi * rev_per_s)


@pytest.mark.parametrize(("second", "speed"), [(1, 1.686264488293), (5, 1.937776516357)])
def test_golden_step_response(second, speed):
    exact = riccati_speed(float(second), U0, 12.5 + FASTER)
    fourth_order = simulate(paper_model(), TRUTH, constant(12.5 + FASTER), STEP, [U0])[100 * second, 0]
    first_order = simulate(paper_model(), TRUTH, constant(12.5 + FASTER), STEP, [U0], euler_step)[100 * second, 0]
    assert exact == pytest.approx(speed, abs=1e-12)
    assert fourth_order == pytest.approx(speed, abs=1e-9)
    assert 2e-5 < abs(first_order - speed) < 2.5e-4


@pytest.mark.parametrize(("start", "rev_per_s"), [(0.3, 12.5), (2.5, 5.0), (1.0, 20.0)])
def test_riccati_solution(start, rev_per_s):
    states = simulate(paper_model(), TRUTH, constant(rev_per_s), STEP, [start])
    assert np.allclose(states[:, 0], riccati_speed(TIME, start, rev_per_s), atol=1e-9)


def test_golden_sum_over_a_doublet():
    def midpoint_step(rate, state, h):
        (u,) = state
        return (u + h * rate((u + 0.5 * h * rate(state)[0],))[0],)

    doublet = Family("n", N0, duration=60.0, active=40.0, sample_time=0.01)
    time, control = doublet.manoeuvre(200 * RPM, 10.0).sample(0.01)
    model, params, step = paper_model(*TERMS, "X_du3"), {**TRUTH, "X_du3": 0.1}, np.full(6000, 0.01)
    speed = simulate(model, params, control[:, None], step, [U0], midpoint_step)
    assert time.size == 6000
    assert float(speed.sum()) == pytest.approx(9444.227220583, abs=1e-6)


def test_uneven_steps_and_a_varying_control_agree_with_a_loop():
    rng = np.random.default_rng(2)
    step, rev_per_s, u = rng.uniform(0.01, 0.2, 80), rng.uniform(-5, 20, 80), 0.2
    expected = []
    for h, n in zip(step, rev_per_s, strict=True):
        expected.append(u)
        u = naive_rk4(lambda x, n=n: surge_rate(x, n), u, h)
    states = simulate(paper_model(), TRUTH, 2 * np.pi * rev_per_s[:, None], step, [0.2])
    assert np.allclose(states[:, 0], expected, rtol=1e-12)


def test_batch_over_parameters_and_controls_equals_loops():
    rng = np.random.default_rng(3)
    params = {name: value * rng.uniform(0.8, 1.2, 5) for name, value in TRUTH.items()}
    controls = N0 + 10 * rng.normal(size=(5, 60, 1))
    start = rng.uniform(0.5, 2.0, (5, 1))
    batch = jax.vmap(lambda p, c, x: simulate(paper_model(), p, c, STEP[:60], x))(params, controls, start)
    for i in range(5):
        own = {name: value[i] for name, value in params.items()}
        one = simulate(paper_model(), own, controls[i], STEP[:60], start[i])
        assert np.allclose(batch[i], one, rtol=1e-13)


def test_sensitivity_to_drag_is_exact():
    """At trim, d(speed)/d(X_u) = -u / (X_u + 2 X_uu |u|) once the transient has died out."""
    step, control = np.full(2000, 0.05), np.full((2000, 1), N0)

    def end(x_u):
        return simulate(paper_model(), {**TRUTH, "X_u": x_u}, control, step, jnp.array([U0]))[-1, 0]

    speed = trim_speed(paper_model(), TRUTH, [N0])
    assert float(jax.grad(end)(-1.21)) == pytest.approx(-speed / (-1.21 + 2 * -2.93 * speed), rel=1e-9)
