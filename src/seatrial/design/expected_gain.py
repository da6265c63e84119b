"""Expected information gain of one design under the whole prior: mutual information of the coefficients c and the data y, nats.

    EIG = E[log p(y | c) - log p(y)],  c from the prior, y = outputs(c) + noise          Lindley, Ann. Math. Stat. 27, 1956

The noise is normal and white, of the standard deviations that the plan states, which are known. Two estimates, of the same prior draws:

- Laplace: the posterior taken as normal at each prior draw, E[0.5 ln det(I + N F)] (Long et al., CMAME 259, 2013), with F
  the information about z and N the entropy power of its prior; for one coefficient that y shows linearly it is a lower bound for
  any prior, and exact for a normal one.
- nested Monte Carlo: log p(y) of simulated data by importance draws about its posterior mode (Ryan, J. Comput. Graph. Stat. 12,
  2003; Beck et al., CMAME 334, 2018). The Laplace gain, whose mean is known far better, takes most of the noise out of it.

The same key gives the same coefficients and the same noise for every design.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.core.errors import InputError, NumericalError
from seatrial.core.gaussian import Gaussian
from seatrial.design.prior_belief import Belief, draw_z, entropies, values_of
from seatrial.design.simulated_evidence import explain
from seatrial.design.sweep import in_blocks
from seatrial.design.trial_plan import TrialPlan

LEAST_ESS, FEW = 8.0, 0.05
"""An estimate is refused if more than this share of its outer draws rest on fewer than so many effective inner draws."""


@dataclass(frozen=True)
class Gain:
    """Expected information gain of one design.

    Attributes:
        value: estimate, nats.
        std_error: its Monte Carlo standard error.
        method: how it was computed.
        diagnostics: numbers that say whether to trust it.
        status: empty if healthy, else why not to use it.
    """

    value: float
    std_error: float
    method: str
    diagnostics: dict[str, Any] = field(default_factory=dict)
    status: str = ""


@dataclass(frozen=True)
class GainSettings:
    """Size of a run.

    Attributes:
        draws: prior draws of the Laplace gain.
        outer: of these, how many are simulated with noise, a multiple of `sweep.LANES` for speed.
        inner: importance draws for each of them, an even number.
        climbs: Gauss-Newton steps from the generating coefficients to the posterior mode.
    """

    draws: int = 1600
    outer: int = 160
    inner: int = 64
    climbs: int = 8


def importance_gain(
    plan: TrialPlan,
    belief: Belief,
    control: Float[np.ndarray, "n c"],
    key: jax.Array,
    settings: GainSettings = GainSettings(),
) -> Gain:
    """Expected information gain by nested Monte Carlo with importance draws about each posterior mode.

    What it cannot see: a second mode of a posterior, far from the coefficients that made the data; the gain is then too large, by
    ln 2 at most where there are two.

    Args:
        plan: vehicle, start and sensors; the standard deviations of the noise are taken as known.
        belief: what is known of the coefficients before the trial.
        control: every control, held from each sample to the next, SI.
        key: random key of the prior draws.
        settings: sizes; the first of the prior draws are those that are simulated with noise.

    Raises:
        InputError: a belief or a control that does not fit the plan.
        NumericalError: the simulation diverges for some of the prior draws; it says how many.

    Returns:
        The gain. Its diagnostics hold `laplace`, the Laplace gain of the same draws, the `correction` to it with its error, and
        the effective inner draws of the median outer draw and of the one at the share `FEW` from below.
    """
    _check(plan, belief, control)
    _check_sizes(settings)
    z, local = _local_gains(plan, belief, control, key, settings.draws)
    m, held = settings.outer, jnp.asarray(control, float)
    key = jax.random.fold_in(key, 1)
    found, chance, ess = in_blocks(
        lambda which, point: explain(plan, belief, held, key, which, point, settings.inner, settings.climbs),
        np.arange(m),
        z[:m],
    )
    if not np.isfinite(found).all():
        raise NumericalError(
            f"for {np.sum(~np.isfinite(found))} of {m} simulated trials no importance draw about the posterior mode can be "
            "simulated: narrow the prior, or excite less"
        )
    correction = found - (local[:m] + chance - np.sum(entropies(belief)))
    value, joint = float(local.mean() + correction.mean()), np.cov(local[:m], correction)
    variance = local.var(ddof=1) / settings.draws + joint[1, 1] / m + 2.0 * joint[0, 1] / settings.draws
    diagnostics = {
        "draws": settings.draws,
        "outer": m,
        "inner": settings.inner,
        "laplace": float(local.mean()),
        "correction": float(correction.mean()),
        "correction_error": float(np.sqrt(joint[1, 1] / m)),
        **_of_weights(ess),
    }
    name = "nested Monte Carlo, importance draws about each mode"
    return Gain(value, float(np.sqrt(variance)), name, diagnostics, _refusal(ess, settings.inner, "use more of them"))


def _local_gains(
    plan: TrialPlan, belief: Belief, control: np.ndarray, key: jax.Array, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Prior draws z, shape (n, k), and 0.5 ln det(I + N F) at each."""
    z, held = draw_z(belief, key, n), jnp.asarray(control, float)
    information = in_blocks(lambda point: (_information(plan, belief, held, point),), z)[0]
    _refuse_divergence(belief, plan, z, np.isfinite(information).all((1, 2)))
    width = np.exp(entropies(belief)) / np.sqrt(2.0 * np.pi * np.e)
    return z, 0.5 * np.linalg.slogdet(np.eye(len(width)) + information * np.outer(width, width))[1]


@jax.jit
def _information(plan: TrialPlan, belief: Belief, control: Array, z: Array) -> Array:
    """Information about z."""

    def one(z: Array) -> Array:
        slope = jax.jacfwd(partial(values_of, belief))(z)
        return slope.T @ plan.information(values_of(belief, z), control) @ slope

    return jax.vmap(one)(z)


def _of_weights(ess: np.ndarray) -> dict[str, float]:
    return {"median_ess": float(np.median(ess)), "low_ess": float(np.quantile(ess, FEW))}


def _refusal(ess: np.ndarray, inner: int, remedy: str) -> str:
    share = float(np.mean(~(ess >= LEAST_ESS)))
    if share <= FEW:
        return ""
    return (
        f"refused: {share:.0%} of {ess.size} outer draws rest on fewer than {LEAST_ESS:.0f} effective of {inner} inner draws "
        f"(median {np.median(ess):.1f}): {remedy}"
    )


def _refuse_divergence(belief: Belief, plan: TrialPlan, z: np.ndarray, finite: np.ndarray) -> None:
    if finite.all():
        return
    first = np.asarray(values_of(belief, jnp.asarray(z[np.argmin(finite)])))
    at = ", ".join(f"{name} = {x:.4g}" for name, x in zip(plan.names, first, strict=True))
    raise NumericalError(
        f"the simulation diverges for {np.sum(~finite)} of {finite.size} draws from the prior, first at {at} (SI): the gain of this "
        "design is not defined; narrow the prior to damping that dissipates, or excite less"
    )


def _check(plan: TrialPlan, belief: Belief, control: np.ndarray) -> None:
    k = belief.mean.size if isinstance(belief, Gaussian) else len(belief)
    if k != len(plan.names):
        raise InputError(
            "belief before the trial",
            found=f"{k} coefficients",
            expected=f"{len(plan.names)}: {', '.join(plan.names)}",
            remedy="give the priors of the plan's coefficients in its order",
        )
    expected = (plan.step.shape[0], len(plan.model.controls))
    if np.shape(control) != expected:
        raise InputError(
            "control",
            found=f"shape {np.shape(control)}",
            expected=f"{expected}: samples and controls",
            remedy="sample the design at the plan's times",
        )


def _check_sizes(settings: GainSettings) -> None:
    sizes = settings.draws, settings.outer, settings.inner
    if not 2 <= settings.outer <= settings.draws or settings.inner < 2 or settings.inner % 2:
        raise InputError(
            "expected information gain, settings",
            found="{} prior draws, {} outer, {} inner".format(*sizes),
            expected="two outer draws at least, no more than prior draws, and an even number of inner ones",
            remedy="leave them out for the usual sizes",
        )
