import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.simulation.delayed_control import delay_control
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import Feedback, Simulator
from seatrial.manoeuvres.pilot import Moment
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle

RNG = np.random.default_rng(8)
REV = RNG.uniform(-5, 20, 50)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 4.75, 60.0])
def test_delayed_control_is_the_mean_over_each_step(samples):
    """By brute force: a thousand points of the held command in each step."""
    grid = np.arange(50)[:, None] + (np.arange(1000) + 0.5)[None, :] / 1000 - samples
    held = REV[np.clip(np.floor(grid).astype(int), 0, 49)]
    assert np.allclose(delay_control(jnp.asarray(REV), jnp.asarray(samples)), held.mean(1), rtol=1e-10)


FORCED = whole_vehicle(Hull("forced", 2.0, fixed={"X_tau_X": 1.0}), ["X_u"], moves=("u",))
FREE = {"X_u": 0.0}
"""Without drag the speed is the integral of the force, so that it shows the mean of what acts over each step, and its rate what acts at
each sample."""


@pytest.mark.parametrize(
    ("actuator", "error", "of_mean"),
    [(Actuator(0.7), 2e-4, 2e-4), (Actuator(0.02), 5e-3, 0.1), (Actuator(0.3, -1.0, 1.0, rate=2.0), 1e-3, 2e-2)],
)
def test_an_actuator_that_is_late_follows_its_equation(actuator, error, of_mean):
    """Against Euler steps of a thousandth of the sample time of a held random command, also where its lag is a fifth of the sample time.

    It stands where the equation has it; its mean over a step is by the integrator's three stages.
    """
    command, step = RNG.normal(size=30), 0.1
    late = with_actuators(FORCED, {"tau_X": actuator})
    start, columns = jnp.array([0.0, command[0]]), (jnp.asarray(command),)
    shown = Simulator(late, (Sensor("udot"), Sensor("u"))).outputs(FREE, start, columns, jnp.full(30, step))
    x, found = command[0], []
    for held in command:
        inner = []
        for _ in range(1000):
            inner.append(x)
            rate = (np.clip(held, actuator.lower, actuator.upper) - x) / actuator.time_constant
            x += 1e-3 * step * np.clip(rate, -actuator.rate, actuator.rate)
        found.append((inner[0], np.mean(inner)))
    acting, mean = 2.0 * shown[:, 0], 2.0 * np.diff(shown[:, 1]) / step
    np.testing.assert_allclose(acting, [one for one, _ in found], atol=error)
    np.testing.assert_allclose(mean, [one for _, one in found][:-1], atol=of_mean)


class TurnsRound:
    """A pilot whose force turns round where the speed has gone far enough."""

    outputs = ("u",)

    def begin(self):
        return 1.0

    def decide(self, side, time, seen, told):
        return jnp.where(seen[0] >= 0.1, -1.0, jnp.where(seen[0] <= -0.1, 1.0, side))

    def controls(self, side, told):
        return (side * 0.7,)


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.35])
def test_a_feedback_sees_what_its_sensor_shows(delay):
    """By a plain loop: a force that turns round where the biased, noisy, sometimes missing speed has gone far enough."""
    n, h, bias = 60, 0.1, 0.03
    error = np.where(np.arange(n) % 4 == 1, np.nan, RNG.normal(size=n) * 0.01)
    feedback = Feedback(TurnsRound(), Moment(jnp.arange(n) * h, (), (jnp.asarray(error),)))
    simulator = Simulator(FORCED, (Sensor("u", bias=True), Sensor("udot")), delay=delay > 0)
    found = simulator.simulate({**FREE, "bias_u": bias, "delay": delay}, jnp.zeros(1), feedback, jnp.full(n, h))
    u, side, forces, speed = 0.0, 1.0, [0.7] * 10, []
    for k in range(n):
        seen = u + bias + error[k]
        side = -1.0 if seen >= 0.1 else 1.0 if seen <= -0.1 else side
        forces.append(0.7 * side)
        speed.append(u)
        whole, share = int(delay / h), delay / h - int(delay / h)
        u += h / 2.0 * ((1 - share) * forces[-1 - whole] + share * forces[-2 - whole])
    np.testing.assert_array_equal(found.command[0], forces[10:])
    np.testing.assert_allclose(found.kept[0], np.array(speed) + bias, atol=1e-12)
    assert len(set(forces[10:])) == 2
