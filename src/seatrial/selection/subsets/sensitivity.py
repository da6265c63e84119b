"""How the choice of structure hangs on the width of the prior, which a Bayes factor never forgets."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt64

from seatrial.selection.subsets.conjugate import evidence_of
from seatrial.selection.subsets.gram import Gram
from seatrial.selection.subsets.prior import Prior
from seatrial.selection.subsets.sampler import subset_posterior

SCALES = tuple(float(x) for x in np.geomspace(0.01, 100.0, 9))


class Sensitivity(NamedTuple):
    """Along factors on the prior standard deviations of the coefficients.

    Attributes:
        names: terms.
        scales: factors, shape (s,).
        inclusion: inclusion probabilities, shape (s, d).
        mean: averaged coefficients, shape (s, d).
        top: most probable structure at each factor, bit i for term i, shape (s,).
        probability: its probability, shape (s,).
        pair: the two most probable structures at factor 1, best first, or one if there is no other.
        log_bayes_factor: of the first of `pair` against the second, nats, shape (s,); empty if there is one only.
    """

    names: tuple[str, ...]
    scales: Float[np.ndarray, " s"]
    inclusion: Float[np.ndarray, "s d"]
    mean: Float[np.ndarray, "s d"]
    top: UInt64[np.ndarray, " s"]
    probability: Float[np.ndarray, " s"]
    pair: tuple[tuple[str, ...], ...]
    log_bayes_factor: Float[np.ndarray, " s"]


def sensitivity(
    stats: Gram, prior: Prior, names: Sequence[str], scales: Sequence[float] = SCALES, **options: Any
) -> Sensitivity:
    """Repeat `subset_posterior` along prior scales, with its options.

    Raises:
        InputError, NumericalError: as `subset_posterior`.
    """
    options = {**options, "top": 2}
    base = subset_posterior(stats, prior, names, **options)
    pair = [base.numbers(rank) for rank in range(base.structures.size)]
    found, factors = [], []
    for scale in scales:
        scaled = prior.scaled(scale)
        found.append(subset_posterior(stats, scaled, names, **options))
        logs = [evidence_of(stats, scaled, structure).log_evidence for structure in pair]
        factors += [logs[0] - logs[1]] if len(logs) == 2 else []
    return Sensitivity(
        base.names,
        np.asarray(scales, float),
        np.array([one.inclusion for one in found]),
        np.array([one.mean for one in found]),
        np.array([one.structures[0] for one in found]),
        np.array([one.probability[0] for one in found]),
        tuple(base.terms(rank) for rank in range(len(pair))),
        np.array(factors),
    )
