"""The narrow waist between vehicles and filters: a discrete-time state space with additive noise."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxtyping import Array, Float

from seatrial.compiled.pytrees import compiled_tree
from seatrial.numerics.gaussian import Gaussian

State = tuple[Any, ...]
Transition = Callable[[State, tuple[Any, ...], Any], State]
Observe = Callable[[State, tuple[Any, ...]], tuple[Any, ...]]
Shocks = Callable[[State, tuple[Any, ...], Any], tuple[State, ...]]


@compiled_tree("states", "outputs", "n_dynamic", "transition", "observe", "shocks")
@dataclass(frozen=True)
class StateSpace:
    """x_{k+1} = transition(x_k, c_k, h_k) + w + G e, y_k = observe(x_k, c_k) + v, with independent Gaussian w, e and v.

    The first `n_dynamic` states move; the others are parameters, which the transition leaves alone, and filters may
    rely on it. Functions take and return tuples of scalars. A pytree: arrays may be batched, names and functions are static.

    Attributes:
        initial: distribution of the state at the first sample, before its measurement.
        process_sd: standard deviation of w for one sample, shape (n,).
        measurement_sd: standard deviation of v, shape (m,).
        states: names, dynamic states first.
        outputs: names of the measured channels.
        n_dynamic: number of states that move.
        transition: `(state, control, step) -> ` the dynamic states one step later.
        observe: `(state, control) -> ` the outputs.
        shocks: `(state, control, step) -> ` columns of G over the dynamic states, one for each standard normal e, which moves several
            states at once; None for none.
    """

    initial: Gaussian
    process_sd: Float[Array, " n"]
    measurement_sd: Float[Array, " m"]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    n_dynamic: int
    transition: Transition
    observe: Observe
    shocks: Shocks | None = None
