"""Which terms do the data support? Every structure that the rules allow, in closed form: a screening before anything is simulated.

Rows in weak form, whitened, make the equation of motion a linear regression; its evidence is known in closed form for every subset of
the terms. Rows whose residuals still follow one another at the widest windows count for as many as they are worth. Noise of the
sensors is in the regressors too: the bias that is left is estimated, and the shortlist goes to evidence by simulation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.estimation.posterior.information import likelihood_information, slopes_of_present
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.regression.regressor_noise import RegressorBias, regressor_noise_bias
from seatrial.estimation.regression.row_fit import RowFit, independent_rows
from seatrial.estimation.regression.rows import WhitenedRows
from seatrial.selection.rules import CompiledRules
from seatrial.selection.subsets.average import SubsetPosterior
from seatrial.selection.subsets.conjugate import Prior, evidence_of, physical_prior, unit_information
from seatrial.selection.subsets.gram import LEAST_INDEPENDENT, Gram, gram
from seatrial.selection.subsets.sampler import subset_posterior
from seatrial.vehicles.axis_equation import AxisEquation

PRIOR_SCALES = (0.1, 0.3, 1.0, 3.0, 10.0)  # Factors on the prior standard deviations along which the answer is repeated
# Structures on a shortlist at most, and the probability that is enough for it to be shorter.
MAX_SHORTLIST, MIN_COVERED = 8, 0.95
BIAS_PAIRS = 8  # Pairs of simulated repetitions that estimate the bias


class Sensitivity(NamedTuple):
    """Along factors on the prior standard deviations of the coefficients.

    Attributes:
        scales: factors, shape (s,).
        inclusion: inclusion probabilities, shape (s, d).
        mean: averaged coefficients, shape (s, d).
        log_bayes_factor: of the most probable structure at factor 1 against the next, nats, shape (s,); empty if there is one only.
    """

    scales: Float[np.ndarray, " s"]
    inclusion: Float[np.ndarray, "s d"]
    mean: Float[np.ndarray, "s d"]
    log_bayes_factor: Float[np.ndarray, " s"]


class TermPrior(NamedTuple):
    """Prior of a coefficient where its term is present, SI."""

    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class Screening:
    """Posterior over all structures, in closed form.

    Attributes:
        rules: which terms are optional and how they may stand together.
        rows: regression rows with every term.
        fit: their fit with every term; its `status` says whether residuals are independent.
        posterior: over the structures; its terms are the optional ones, then those always there.
        sensitivity: the same along prior widths.
        unit_information: inclusion of each term under a g-prior about zero that is worth one row, whatever was believed, shape (k,).
        bias: of the fit with every term, by noise in the regressors.
    """

    rules: CompiledRules
    rows: WhitenedRows
    fit: RowFit
    posterior: SubsetPosterior
    sensitivity: Sensitivity
    unit_information: Float[np.ndarray, " k"]
    bias: RegressorBias

    @property
    def inclusion(self) -> dict[str, float]:
        """Probability of each optional term."""
        return {term: float(p) for term, p in zip(self.rules.optional, self.posterior.inclusion, strict=False)}

    def shortlist(self, most: int = MAX_SHORTLIST, covered: float = MIN_COVERED) -> tuple[tuple[str, ...], ...]:
        """Return the terms of the most probable structures, until they hold this probability together or are this many."""
        enough = int(np.searchsorted(np.cumsum(self.posterior.probability), covered)) + 1
        return tuple(self.posterior.terms(rank) for rank in range(min(enough, most, self.posterior.structures.size)))


def sensitivity(
    stats: Gram, prior: Prior, names: Sequence[str], scales: Sequence[float], **options: Any
) -> Sensitivity:
    """Repeat `subset_posterior` along prior scales: a Bayes factor never forgets the width of the prior.

    Args:
        stats: of the regression on all terms.
        prior: of its coefficients and noise, at factor 1.
        names: of the terms, one for each column.
        scales: factors on the prior standard deviations of the coefficients.
        options: of `subset_posterior`, except `top`.

    Returns:
        Inclusion and coefficients at each factor.

    Raises:
        InputError, NumericalError: as `subset_posterior`.
    """
    options = {**options, "top": 2}
    base = subset_posterior(stats, prior, names, **options)
    pair = [base.numbers(rank) for rank in range(base.structures.size)]
    results, factors = [], []
    for scale in scales:
        scaled = prior.scaled(scale)
        results.append(subset_posterior(stats, scaled, names, **options))
        logs = [evidence_of(stats, scaled, structure).log_evidence for structure in pair]
        factors += [logs[0] - logs[1]] if len(logs) == 2 else []
    return Sensitivity(
        np.asarray(scales, float),
        np.array([one.inclusion for one in results]),
        np.array([one.mean for one in results]),
        np.array(factors),
    )


def screen(
    equations: Sequence[AxisEquation],
    rules: CompiledRules,
    records: Sequence[Record],
    noise: Mapping[str, float],
    prior: Mapping[str, TermPrior],
    key: jax.Array,
    narrowest: float = 1.0,
    g: float | Literal["rows"] | None = None,
    log_prior: Float[np.ndarray, " k1"] | None = None,
) -> Screening:
    """Screen every structure of one or several axes.

    Args:
        equations: with every candidate term.
        rules: compiled for exactly these terms.
        records: trials.
        noise: standard deviation of each measured channel, SI.
        prior: of each term.
        key: random key of the simulated repetitions.
        narrowest: width of the first windows, s.
        g: of a g-prior about zero in place of `prior`; "rows" for as many as the rows are worth, the information of one of them.
        log_prior: as of `all_subsets`.

    Raises:
        InputError: rows that cannot tell the terms apart.
    """
    names = (*rules.optional, *rules.always)
    rows, fit = independent_rows(equations, records, noise, narrowest)
    columns = [rows.names.index(name) for name in names]
    stats = worth(gram(rows.design[:, columns], rows.target), float(fit.effective.sum()))
    means, sds = np.array([prior[name] for name in names]).T
    one_row = unit_information(stats, 1.0)
    stated = physical_prior(sds, 1.0, mean=means)
    believed = stated if g is None else one_row if g == "rows" else replace(one_row, g=g)
    options = {"always": rules.always, "rules": rules.masks, "log_prior": log_prior}
    return Screening(
        rules,
        rows,
        fit,
        subset_posterior(stats, believed, names, **options),
        sensitivity(stats, believed, names, PRIOR_SCALES, **options),
        subset_posterior(stats, one_row, names, **options).inclusion,
        regressor_noise_bias(rows, key, BIAS_PAIRS),
    )


def worth(stats: Gram, rows: float) -> Gram:
    """Return the statistics that say as much as this many independent rows."""
    share = min(rows / stats.n, 1.0)
    return Gram(share * stats.matrix, share * stats.moment, share * stats.square, max(round(share * stats.n), 1))


# Which terms do the data support, of a vehicle whose axes are coupled: every structure, in closed form, about the mode of all terms.
#
# There the log-likelihood is a quadratic in the coefficients c, and whatever else is unknown is integrated out of it under its own prior,
#
#     log p(y | c) = g^T (c - c0) - 1/2 (c - c0)^T S (c - c0) + constant,    S = I_cc - I_cr (I_rr + P_rr)^-1 I_rc
#
# with I the expected information, P the priors' precision and g the gradient at the mode c0. That is a linear regression of known noise,
# whose evidence is known for every subset of the terms. It holds as far as the quadratic does: the shortlist goes to evidence by
# simulation.

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
    posterior: Posterior,
    mode: Mode,
    rules: CompiledRules,
    g: float | Literal["rows"] | None = None,
    log_prior: Float[np.ndarray, " k1"] | None = None,
) -> ModeScreening:
    """Screen every structure of a vehicle about the mode of all terms.

    Args:
        posterior: of records, with every term.
        mode: of that posterior.
        rules: compiled for exactly its terms.
        g: of a g-prior about zero in place of the posterior's priors; "rows" for as many as there are measurements.
        log_prior: as of `all_subsets`.

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
    options = {"always": rules.always, "rules": rules.masks, "log_prior": log_prior}
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
            found="coefficients that these data determine only together, or not at all",
            expected="terms that the data separate if all are included",
            remedy="`seatrial estimate --by mode` names them: take one of them out, fix it, or add a trial that excites it",
        )
    moment = matrix @ mode.values[at] + gradient
    cov = np.linalg.inv(matrix)
    best = cov @ moment
    count = int(sum(np.asarray(channel.present).sum() for channel in posterior.data.channels))
    return Gram(matrix, moment, count + float(best @ moment), count), best, np.sqrt(np.diag(cov))
