import numpy as np
import pytest

from seatrial.numerics.integrate import euler_step, rk4_step


def oscillator_and_growth(state):
    """x'' = -x and, beside it, the logistic equation: both have closed forms."""
    x, v, y = state
    return v, -x, y * (1 - y)


def error(integrator, n_steps, duration=2.0):
    state = (1.0, 0.0, 0.1)
    for _ in range(n_steps):
        state = integrator(oscillator_and_growth, state, duration / n_steps)
    exact = np.cos(duration), -np.sin(duration), 1 / (1 + 9 * np.exp(-duration))
    return np.abs(np.subtract(state, exact))


@pytest.mark.parametrize(("integrator", "order"), [(rk4_step, 4), (euler_step, 1)])
def test_order_of_convergence(integrator, order):
    assert np.log2(error(integrator, 100) / error(integrator, 200)) == pytest.approx(order, abs=0.1)


def test_rk4_is_exact_for_cubics_in_time():
    def rate(state):
        time, _ = state
        return 1.0, 4 * time**3 - 2 * time

    assert rk4_step(rate, (0.5, 0.0), 0.8)[1] == pytest.approx((1.3**4 - 1.3**2) - (0.5**4 - 0.5**2), rel=1e-13)
