"""How probable structures are before the data: all alike, or every number of optional terms alike.

Of k optional terms a structure with j of them has, by `multiplicity`, the probability 1 / ((k + 1) C(k, j)) (Scott and Berger, Annals of
Statistics 38, 2010). Rules and shortlists leave only some structures: these keep their ratios.
"""

from collections.abc import Collection, Sequence
from math import comb, log
from typing import Literal

import numpy as np
from jaxtyping import Float

from seatrial.selection.structures import Structure

StructurePrior = Literal["equal", "multiplicity"]


def log_prior_by_size(structure_prior: StructurePrior, k: int) -> Float[np.ndarray, " k1"]:
    """Return the log prior of one structure by its number of optional terms, from 0 to k, nats, but for a constant; shape (k+1,)."""
    if structure_prior == "equal":
        return np.zeros(k + 1)
    return np.array([-log((k + 1) * comb(k, j)) for j in range(k + 1)])


def log_priors(
    structures: Sequence[Structure], optional: Collection[str], structure_prior: StructurePrior
) -> Float[np.ndarray, " m"]:
    """Return the log prior of each structure, nats, but for a constant; `optional` are all terms in question."""
    sizes = [len(set(optional).intersection(one.terms)) for one in structures]
    return log_prior_by_size(structure_prior, len(optional))[sizes]
