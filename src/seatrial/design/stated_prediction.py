"""A stated prediction that coefficients are wanted for: a signal some time after the control is set, and its slope in them.

With gradient g of the prediction in the coefficients and their covariance P its variance is g^T P g: the criterion c
(Atkinson, Donev and Tobias, Optimum Experimental Designs, 2007, section 10.3) makes it small.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import NumericalError
from seatrial.design.integrals import follow_joint, integrals_for
from seatrial.design.trial_plan import TrialPlan, plan_trial
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False)
class Prediction:
    """A signal some time after the control is set. Build it with `prediction`.

    Attributes:
        of: a state, `distance` or `advance`.
        after: s.
        plan: start, and the steps to that time.
        control: every control from the start on, SI.
    """

    of: str
    after: float
    plan: TrialPlan
    control: tuple[float, ...]

    def at(self, values: Float[np.ndarray, " k"]) -> tuple[float, Float[np.ndarray, " k"]]:
        """Value, SI, and gradient in the coefficients at some values of them, SI.

        Raises:
            NumericalError: the motion diverges there.
        """
        value, gradient = _value_and_slope(
            self.of, self.plan, np.asarray(self.control, float), np.asarray(values, float)
        )
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            raise NumericalError(f"the prediction of {self.of} diverges at the mean of the priors: narrow them")
        return float(value), np.asarray(gradient)


def prediction(
    model: VehicleModel, of: str, start: Sequence[float], control: Sequence[float], after: float, step: float
) -> Prediction:
    """State a prediction.

    Args:
        model: vehicle.
        of: a state, `distance` travelled or `advance`.
        start: state at time 0, SI.
        control: every control from then on, SI.
        after: s.
        step: of the integration, about, s.

    Raises:
        InputError: something the vehicle cannot predict.
    """
    n = max(1, round(after / step))
    integrals_for(model, (of,), "prediction")
    return Prediction(of, after, plan_trial(model, start, {}, n, after / n), tuple(control))


@program(static_argnums=0)
def _value_and_slope(name: str, plan: TrialPlan, control: Array, values: Array) -> tuple[Array, Array]:
    def of_values(values: Array) -> Array:
        integrals = integrals_for(plan.model, (name,), "prediction")
        held = jnp.broadcast_to(control, (plan.step.shape[0], control.shape[0]))
        return follow_joint(plan, integrals, values, held, lambda memory, _: (memory, None))[0][name]

    return of_values(values), jax.jacfwd(of_values)(values)
