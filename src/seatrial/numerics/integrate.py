"""One-step integrators on tuples of scalars, with the input held over the step."""

from collections.abc import Callable
from typing import Any

State = tuple[Any, ...]
Rate = Callable[[State], State]
Integrator = Callable[[Rate, State, Any], State]


def rk4_step(rate: Rate, state: State, step: Any) -> State:
    """Classical fourth-order Runge-Kutta step (Kutta, 1901).

    Args:
        rate: time derivative of the state, the input being constant.
        state: scalars.
        step: time step, s.
    """
    k1 = rate(state)
    k2 = rate(_moved(state, k1, 0.5 * step))
    k3 = rate(_moved(state, k2, 0.5 * step))
    k4 = rate(_moved(state, k3, step))
    return tuple(x + step / 6.0 * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True))


def euler_step(rate: Rate, state: State, step: Any) -> State:
    """Explicit Euler step, first order: for comparison with published results that used it."""
    return _moved(state, rate(state), step)


def _moved(state: State, rate: State, step: Any) -> State:
    return tuple(x + step * r for x, r in zip(state, rate, strict=True))
