import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.sensors import Sensor
from seatrial.estimation.simulation import Simulator, delay_control
from tests.cases import TRUTH, U0, paper_model, surge_rate
from tests.estimation_cases import naive_speed

RNG = np.random.default_rng(8)
REV = RNG.uniform(-5, 20, 50)
CONTROL = 2 * np.pi * REV[:, None]


def shown(step, delayed=False, **extra):
    simulator = Simulator(paper_model(), (Sensor("udot"), Sensor("u")), delayed)
    return simulator.outputs({**TRUTH, **extra}, jnp.array([U0]), (jnp.asarray(CONTROL[:, 0]),), jnp.asarray(step))


def test_outputs_are_those_of_the_plain_loop():
    step = RNG.uniform(0.02, 0.3, 50)
    speed = naive_speed(REV, step)
    assert np.allclose(shown(step), np.column_stack([surge_rate(speed, REV), speed]), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("samples", [1, 3, 70])
def test_delay_of_whole_samples_is_a_shift(samples):
    late = np.concatenate([np.full(samples, REV[0]), REV])[:50]
    speed = naive_speed(late, np.full(50, 0.1))
    expected = np.column_stack([surge_rate(speed, late), speed])
    assert np.allclose(shown(np.full(50, 0.1), True, delay=0.1 * samples), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 4.75, 60.0])
def test_delayed_control_is_the_mean_over_each_step(samples):
    """By brute force: a thousand points of the held command in each step."""
    grid = np.arange(50)[:, None] + (np.arange(1000) + 0.5)[None, :] / 1000 - samples
    held = REV[np.clip(np.floor(grid).astype(int), 0, 49)]
    assert np.allclose(delay_control(jnp.asarray(REV), jnp.asarray(samples)), held.mean(1), rtol=1e-10)


def test_delayed_control_is_continuous_in_the_delay():
    below, above = (np.asarray(delay_control(jnp.asarray(REV), jnp.asarray(s))) for s in (2 - 1e-9, 2 + 1e-9))
    assert np.allclose(below, above, atol=1e-7)
