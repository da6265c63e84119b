"""Which terms do the data support, of a vehicle whose axes are coupled: every structure, in closed form, about the mode of all terms.

There the log-likelihood is a quadratic in the coefficients c, and whatever else is unknown is integrated out of it under its own prior,

    log p(y | c) = g^T (c - c0) - 1/2 (c - c0)^T S (c - c0) + constant,    S = I_cc - I_cr (I_rr + P_rr)^-1 I_rc

with I the expected information, P the priors' precision and g the gradient at the mode c0. That is a linear regression of known noise,
whose evidence is known for every subset of the terms. It holds as far as the quadratic does: the shortlist goes to evidence by
simulation.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.information import likelihood_information, slopes_of_present
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.selection.rules import CompiledRules
from seatrial.selection.screening import PRIOR_SCALES, Sensitivity, sensitivity
from seatrial.selection.subsets.average import SubsetPosterior
from seatrial.selection.subsets.conjugate import physical_prior, unit_information
from seatrial.selection.subsets.gram import LEAST_INDEPENDENT, Gram
from seatrial.selection.subsets.sampler import subset_posterior

KNOWN_NOISE = 1e9  # Shape of the noise's inverse gamma that makes it 1: the information has the sensors' noise in it


@dataclass(frozen=True, eq=False)
class ModeScreening:
    """Posterior over all structures, in closed form about a mode.

    Attributes:
        posterior: over the structures; its terms are the optional ones, then those always there.
        sensitivity: the same along prior widths.
        unit_information: inclusion of each term under a g-prior about zero that is worth one measurement, shape (k,).
        values: coefficients of highest likelihood with every term, in the order of the terms, SI, shape (k,).
        sd: their standard deviations by the data alone, shape (k,).
    """

    posterior: SubsetPosterior
    sensitivity: Sensitivity
    unit_information: Float[np.ndarray, " k"]
    values: Float[np.ndarray, " k"]
    sd: Float[np.ndarray, " k"]


def screen_about_mode(
    posterior: Posterior, mode: Mode, rules: CompiledRules, g: float | Literal["rows"] | None = None
) -> ModeScreening:
    """Screen every structure of a vehicle about the mode of all terms.

    Args:
        posterior: of records, with every term.
        mode: of that posterior.
        rules: compiled for exactly its terms.
        g: of a g-prior about zero in place of the posterior's priors; "rows" for as many as there are measurements.

    Raises:
        InputError: data that cannot tell the terms apart.
    """
    names = (*rules.optional, *rules.always)
    stats, values, sd = _quadratic(posterior, mode, names)
    priors = {one.name: one.prior for one in posterior.parameters}
    means, sds = np.array([(float(priors[name].mean), float(priors[name].sd)) for name in names]).T
    known = {"shape": KNOWN_NOISE}
    one_row = unit_information(stats, 1.0, **known)
    stated = physical_prior(sds, 1.0, mean=means, **known)
    believed = stated if g is None else one_row if g == "rows" else replace(one_row, g=g)
    options = {"always": rules.always, "rules": rules.masks}
    return ModeScreening(
        subset_posterior(stats, believed, names, **options),
        sensitivity(stats, believed, names, PRIOR_SCALES, **options),
        subset_posterior(stats, one_row, names, **options).inclusion,
        values,
        sd,
    )


def _quadratic(
    posterior: Posterior, mode: Mode, names: tuple[str, ...]
) -> tuple[Gram, Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the statistics of the regression that the likelihood is about its mode, its solution and standard deviations."""
    own = posterior.present_names
    at = np.array([own.index(name) for name in names])
    rest = np.setdiff1d(np.arange(len(own)), at)
    information = likelihood_information(posterior, mode.values)
    gradient = slopes_of_present(posterior, mode.values).gradient[at]
    prior = np.diag([float(parameter.prior.sd) ** -2 for parameter in posterior.present_parameters])
    inner = (information + prior)[np.ix_(rest, rest)]
    across = information[np.ix_(rest, at)]
    matrix = information[np.ix_(at, at)] - across.T @ np.linalg.solve(inner, across)
    matrix = 0.5 * (matrix + matrix.T)
    size = np.sqrt(np.diag(matrix).clip(0.0))
    if not (size > 0).all() or np.linalg.eigvalsh(matrix / np.outer(size, size))[0] < LEAST_INDEPENDENT:
        raise InputError(
            "screening",
            found="coefficients that these data tell only together, or not at all",
            expected="terms whose coefficients the data tell apart when all are there",
            remedy="`seatrial estimate --by mode` names them: take one of them out, fix it, or add a trial that excites it",
        )
    moment = matrix @ mode.values[at] + gradient
    cov = np.linalg.inv(matrix)
    best = cov @ moment
    count = int(sum(np.asarray(channel.present).sum() for channel in posterior.data.channels))
    return Gram(matrix, moment, count + float(best @ moment), count), best, np.sqrt(np.diag(cov))
