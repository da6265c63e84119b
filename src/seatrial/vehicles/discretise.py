"""The one bridge from a vehicle to a state space: RK4 over each sample, coefficients as constant states."""

from collections.abc import Sequence
from functools import lru_cache

from jaxtyping import Array, Float

from seatrial.numerics.gaussian import Gaussian
from seatrial.numerics.integrate import Integrator, rk4_step
from seatrial.numerics.state_space import Observe, StateSpace, Transition
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import move_by


def discretise(
    model: VehicleModel,
    outputs: Sequence[str],
    initial: Gaussian,
    process_sd: Float[Array, " n"],
    measurement_sd: Float[Array, " m"],
    scales: Sequence[float] = (),
    integrator: Integrator = rk4_step,
) -> StateSpace:
    """Return the joint state space of the vehicle's states and its free coefficients, the paper's eqs. (15) and (16).

    Args:
        model: vehicle.
        outputs: measured channels: states (`u`) or their rates (`udot`).
        initial: joint distribution at the first sample; coefficients in units of `scales`.
        process_sd: standard deviation of the process noise for one sample, same order.
        measurement_sd: standard deviation of each output's noise.
        scales: SI value of one filter unit of each coefficient (1e-4 for T_nabsn in 1e-4 kg m/rad^2); empty for all 1.
        integrator: step of the dynamic states.
    """
    transition, observe = _functions(
        model, tuple(outputs), tuple(scales) or (1.0,) * len(model.coefficients), integrator
    )
    names = model.states + tuple(coefficient.text for coefficient in model.coefficients)
    return StateSpace(
        initial, process_sd, measurement_sd, names, tuple(outputs), len(model.states), transition, observe
    )


@lru_cache(maxsize=64)
def _functions(
    model: VehicleModel, outputs: tuple[str, ...], scales: tuple[float, ...], integrator: Integrator
) -> tuple[Transition, Observe]:
    """Return the functions, cached so that the same model gives the same objects and compiled code is found again."""
    n = len(model.states)

    def split(state: tuple) -> tuple[tuple, dict]:
        values = (value if scale == 1.0 else value * scale for value, scale in zip(state[n:], scales, strict=True))
        return state[:n], dict(zip((coefficient.text for coefficient in model.coefficients), values, strict=True))

    def transition(state: tuple, control: tuple, step: object) -> tuple:
        dynamic, params = split(state)
        return move_by(model, params, integrator)(dynamic, control, step)

    def observe(state: tuple, control: tuple) -> tuple:
        dynamic, params = split(state)
        return tuple(model.output(name, params, dynamic, control) for name in outputs)

    return transition, observe
