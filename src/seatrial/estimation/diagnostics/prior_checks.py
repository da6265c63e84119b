"""What every estimate must answer: does the prior hold the data's answer, do the data say more, and where can nothing be said?"""

from math import isfinite

import numpy as np
import scipy
from jaxtyping import Bool, Float

from seatrial.compiled.random_keys import seeded_key
from seatrial.core.coefficients import is_coefficient
from seatrial.core.findings import Finding, Value
from seatrial.estimation.posterior.information import slopes_of_present
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Parameter, Posterior, values_of
from seatrial.estimation.posterior.prior_bounds import EDGE, leaning_bounds, scaled_bounds
from seatrial.sampling.target import AT_ONCE, evaluate

MIN_GAIN = 10.0
# Gain beyond a bound, nats, from which a slip in the log or its map is likelier than a prior that is too narrow.
HUGE_GAIN = 1000.0
# Standard deviations from the middle of a prior without bounds beyond which it says the opposite of the data
MAX_PRIOR_SDS = 4.0
# Least curvature of the likelihood, over that of each parameter alone, along which other parameters are followed.
MIN_CURVATURE = 1e-9
MIN_LOST_SHARE = 0.01  # Share of the prior without a finite likelihood of which a reader is told
# Remedies for a time or a size that the data find smaller than its prior allows, by the beginning of its name.
NOT_NEEDED = {"tau": "no-memory", "lag": "no-lag", "sigma": "smaller-noise"}
MIN_RANK_GAP = 0.25  # Difference of mean ranks, 0.5 at most, from which a parameter is said to set what is lost apart


def prior_excluding_data(posterior: Posterior, mode: Mode) -> Finding | None:
    """Report a prior against whose bound the data push; None if each contains what they say.

    A mode within 2 % of a bound is suspect, in shares of the width, or where one side is open of that of a uniform of the same
    standard deviation; if a step of a tenth of the width beyond the bound, the other parameters following
    along the ridge of the likelihood, makes the data more likely by over 10 nats, the prior excludes them.

    Args:
        posterior: of a model with every term in question. One that lacks a real term calls it noise or lets others stand for it, which may
            push these against a bound; its evidence judges it.
        mode: its mode, of the parameters that are present.
    """
    for index, parameter in enumerate(posterior.present_parameters):
        for bound, beyond in _suspect_bounds(parameter, float(mode.values[index])):
            gain = _gain_beyond(posterior, mode.values, index, beyond)
            if gain > MIN_GAIN:
                further = {"beyond": parameter.shown_value(beyond)["value"], "gain": gain}
                values = {**parameter.shown_value(bound), **further, "channel": parameter.name.partition("_")[2]}
                return Finding(
                    "prior-excludes-data", "alarm", (parameter.name,), values, (_remedy(parameter, bound, gain),)
                )
    return None


def _remedy(parameter: Parameter, bound: float, gain: float) -> str:
    kind = parameter.name.partition("_")[0]
    if bound == parameter.prior.bounds[0] and kind in NOT_NEEDED:
        return NOT_NEEDED[kind]
    if kind == "sigma" and bound == parameter.prior.bounds[1]:
        return "explain-channel"
    return "check-record-first" if gain > HUGE_GAIN else "widen-or-check-record"


def prior_findings(posterior: Posterior, mode: Mode, draws: Float[np.ndarray, "n d"]) -> list[Finding]:
    """Report where a prior and the data disagree, where a bound cuts the posterior off, and where the prior has no model.

    Args:
        posterior: posterior.
        mode: its mode, of the parameters that are present.
        draws: posterior draws in the parameters' own units.
    """
    findings = []
    at_bounds = {one.subject[0]: one for one in mode.at_bounds}
    for parameter, column in zip(posterior.present_parameters, draws.T, strict=True):
        leaning = [
            Finding(
                "posterior-cut-off",
                "caution",
                (parameter.name,),
                {"share": share, **parameter.shown_value(bound)},
                ("widen-prior",),
            )
            for bound, share in leaning_bounds(parameter, column)
        ]
        findings += leaning or filter(None, [at_bounds.get(parameter.name)])
    return [*findings, *prior_contradictions(posterior, mode), *_lost_region(posterior)]


def prior_contradictions(posterior: Posterior, mode: Mode) -> list[Finding]:
    """Return the priors without bounds that the data pull far from their middle; z is standard normal under them."""
    return [
        Finding("prior-contradicted", "caution", (parameter.name,), parameter.shown_value(value), ("widen-or-check",))
        for parameter, value, z in zip(posterior.present_parameters, mode.values, mode.z, strict=True)
        if not all(map(isfinite, parameter.prior.bounds)) and abs(z) > MAX_PRIOR_SDS
    ]


def _lost_region(posterior: Posterior) -> list[Finding]:
    """Return where the prior allows values whose likelihood is not finite: how much of it, and the parameter that sets it apart."""
    z = np.asarray(posterior.sample_prior(seeded_key(0), AT_ONCE))
    lost = ~np.isfinite(evaluate(posterior, z))
    if not MIN_LOST_SHARE < lost.mean() < 1.0:
        return []
    values = values_of(posterior, z)[:, posterior.places]
    example = tuple((name, float(x)) for name, x in zip(posterior.present_names, values[lost][0], strict=True))
    stated = {"share": float(lost.mean()), "example": example, **_where(posterior, values, lost)}
    return [Finding("prior-not-simulated", "caution", posterior.present_names, stated, ("narrow-prior",))]


def _where(posterior: Posterior, values: Float[np.ndarray, "n d"], lost: Bool[np.ndarray, " n"]) -> dict[str, Value]:
    """Return the parameter that best sets apart what is lost, if one does: its chance to be the larger in a pair, one lost, one not."""
    ranks = scipy.stats.rankdata(values, axis=0)
    apart = (ranks[lost].mean(0) - ranks[~lost].mean(0)) / lost.size
    worst = int(np.argmax(np.abs(apart)))
    if abs(apart[worst]) < MIN_RANK_GAP:
        return {}
    parameter, column, above = posterior.present_parameters[worst], values[lost, worst], apart[worst] > 0
    edge = np.quantile(column, 0.05 if above else 0.95)
    return {"parameter": parameter.name, "is_above": bool(above), **parameter.shown_value(float(edge))}


def _suspect_bounds(parameter: Parameter, value: float) -> list[tuple[float, float]]:
    """Bounds near which the mode lies, each with a point a tenth of the width beyond it; sizes have no point below 0."""
    there, back, bounds, width = scaled_bounds(parameter)
    near = [(at, sign) for at, sign in zip(bounds, (-1.0, 1.0), strict=True) if abs(there(value) - at) <= EDGE * width]
    pairs = [(float(back(at)), float(back(at + sign * 0.1 * width))) for at, sign in near]
    size = parameter.prior.bounds[0] >= 0 and not is_coefficient(parameter.name.partition("@")[0])
    return [(bound, beyond) for bound, beyond in pairs if not (size and beyond <= 0)]


def _gain_beyond(posterior: Posterior, values: Float[np.ndarray, " d"], index: int, beyond: float) -> float:
    """Return the gain in log-likelihood of moving one parameter, the others following where the likelihood is quadratic."""
    move = np.zeros(values.size)
    move[index] = beyond - values[index]
    others = np.arange(values.size) != index
    here = slopes_of_present(posterior, values)
    hessian = -here.information
    candidates = [values + move]
    if np.isfinite(hessian).all():
        size = np.sqrt(np.abs(np.diag(hessian)))[others]
        scale = np.outer(size, size)
        curvature = np.divide(-hessian[np.ix_(others, others)], scale, out=np.zeros_like(scale), where=scale > 0)
        if np.linalg.eigvalsh(curvature).min(initial=1.0) > MIN_CURVATURE:
            follow = np.linalg.solve(curvature, hessian[others, index] / size) / size * move[index]
            candidates.append(candidates[0] + np.insert(follow, index, 0.0))
    return max(float(slopes_of_present(posterior, one).value) for one in candidates) - float(here.value)
