"""A utility of many designs when the coefficients are uncertain, at every draw of them: their mean is that over the prior.

The information of a nonlinear vehicle depends on the very coefficients the trial is to tell, so a design that is best at the
mean may be poor where the truth lies (Pronzato and Walter, Math. Biosci. 75, 1985).
"""

from functools import partial

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.design.fisher_utilities import Criterion
from seatrial.design.sweep import at_every_draw
from seatrial.design.trial_plan import TrialPlan


def utility_table(
    plan: TrialPlan,
    controls: Float[np.ndarray, "D n c"],
    draws: Float[np.ndarray, "S k"],
    criterion: Criterion,
) -> Float[np.ndarray, "D S"]:
    """Return the utility of every design at every draw.

    Args:
        plan: vehicle, start and sensors.
        controls: designs, held from each sample to the next, SI.
        draws: coefficients, SI: of the prior or of a posterior. The same draws for all designs compare them most sharply.
        criterion: utility of an information matrix.

    Raises:
        InputError: shapes that do not fit the plan.
        NumericalError: the simulation diverges; it says for how many draws. None is left out, since those left would look better
            than the prior is.
    """
    table = np.asarray(criterion(information_table(plan, controls, draws)))
    if table.shape != (expected := (len(controls), len(draws))):
        raise InputError(
            "utility",
            found=f"shape {table.shape} for information matrices of shape {(*expected, len(plan.names), len(plan.names))}",
            expected=f"a number for each matrix, shape {expected}",
            remedy="let the function reduce the last two axes, and keep all others",
        )
    return table


def information_table(
    plan: TrialPlan, controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> Float[np.ndarray, "D S k k"]:
    """Fisher information of every design at every draw, SI; arguments and errors as `utility_table`."""
    information = information_or_nan(plan, controls, draws)
    finite = np.isfinite(information).all((2, 3))
    if not finite.all():
        lost, worst = ~finite.all(0), int(np.argmin(finite.sum(1)))
        at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(plan.names, draws[np.argmax(lost)], strict=True))
        raise NumericalError(
            f"the simulation diverges for {lost.sum()} of {len(draws)} draws of the coefficients in {(~finite).any(1).sum()} of "
            f"{len(controls)} designs, most often in design {worst}; the first is {at} (SI). Narrow the prior to damping that "
            f"dissipates, or excite less"
        )
    return information


def information_or_nan(
    plan: TrialPlan, controls: Float[np.ndarray, "D n c"], draws: Float[np.ndarray, "S k"]
) -> Float[np.ndarray, "D S k k"]:
    """Fisher information as `information_table`, not finite where the simulation diverges.

    Raises:
        InputError: shapes that do not fit the plan.
    """
    controls, draws = np.asarray(controls, float), np.asarray(draws, float)
    expected = (plan.step.shape[0], len(plan.commands))
    if controls.ndim != 3 or controls.shape[1:] != expected:
        raise _misfit("controls", controls, f"(designs, {expected[0]} samples, {expected[1]} controls)")
    if draws.ndim != 2 or draws.shape[1] != len(plan.names):
        raise _misfit("draws", draws, f"(draws, {len(plan.names)} coefficients: {', '.join(plan.names)})")
    return at_every_draw(partial(_information, plan), controls, draws)


@program
def _information(plan: TrialPlan, controls: Array, which: Array, values: Array) -> Array:
    return jax.vmap(lambda i, point: plan.information(point, controls[i]))(which, values)


def _misfit(what: str, found: np.ndarray, expected: str) -> InputError:
    return InputError(what, found=f"shape {found.shape}", expected=expected, remedy="one row each, SI")
