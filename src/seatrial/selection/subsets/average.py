"""What all structures say together: probabilities, and averages whose uncertainty is within and between structures.

    E[c] = sum_S P(S | y) m_S,  Cov[c] = sum_S P(S | y) V_S + sum_S P(S | y) (m_S - E[c]) (m_S - E[c])^T

over all structures, not only the best; m_S and V_S are zero for absent terms. The median-probability model has the terms of
inclusion probability above one half (Barbieri and Berger, Annals of Statistics 32, 2004).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt64


class Averaged(NamedTuple):
    """Coefficients averaged over structures, with their standard deviations, each of shape (n,).

    Attributes:
        mean: posterior mean.
        within: root of the average variance in each structure.
        between: standard deviation of the structures' means.
        total: of both.
    """

    mean: Float[np.ndarray, " n"]
    within: Float[np.ndarray, " n"]
    between: Float[np.ndarray, " n"]
    total: Float[np.ndarray, " n"]


class MonteCarlo(NamedTuple):
    """What is known of the errors of a posterior that was sampled: standard errors from the spread of the chains, or what the averages
    lack where they are over the best structures.

    Attributes:
        covered: estimated probability of these.
        inclusion_error: of the inclusion probabilities, shape (d,).
        renormalised: inclusion probabilities from the evidences of the structures evaluated, as if there were no others, shape (d,).
        r_hat: of each term's presence, between halves of chains, shape (d,).
        mean_error: of the averaged coefficients, shape (d,).
        status: empty if the chains agree, else what is wrong in words.
    """

    covered: float
    inclusion_error: Float[np.ndarray, " d"]
    renormalised: Float[np.ndarray, " d"]
    r_hat: Float[np.ndarray, " d"]
    mean_error: Float[np.ndarray, " d"]
    status: str


@dataclass(frozen=True, eq=False)
class SubsetPosterior:
    """Posterior over all structures of d terms.

    Attributes:
        names: terms.
        structures: the best ones, most probable first, bit i for term i, shape (n,).
        log_evidence: log p(y | S) of these, nats, shape (n,).
        probability: P(S | y) of these, shape (n,).
        count: number of allowed structures.
        inclusion: posterior probability of each term, shape (d,).
        joint: that both of each two are there, shape (d, d).
        mean: averaged coefficients, shape (d,).
        within: average of their covariances in each structure, shape (d, d).
        between: covariance of the structures' means, shape (d, d).
        monte_carlo: errors, if the structures were sampled and not all visited.
    """

    names: tuple[str, ...]
    structures: UInt64[np.ndarray, " n"]
    log_evidence: Float[np.ndarray, " n"]
    probability: Float[np.ndarray, " n"]
    count: int
    inclusion: Float[np.ndarray, " d"]
    joint: Float[np.ndarray, "d d"]
    mean: Float[np.ndarray, " d"]
    within: Float[np.ndarray, "d d"]
    between: Float[np.ndarray, "d d"]
    monte_carlo: MonteCarlo | None = None

    def numbers(self, rank: int) -> list[int]:
        """Return the numbers of the terms of one of the best structures, the best having rank 0."""
        return [i for i in range(len(self.names)) if int(self.structures[rank]) >> i & 1]

    def terms(self, rank: int) -> tuple[str, ...]:
        """Return the names of the terms of one of the best structures."""
        return tuple(self.names[i] for i in self.numbers(rank))

    def coefficients(self) -> Averaged:
        """Return the averaged coefficients; an absent one counts as zero."""
        # rounding leaves the difference of nearly equal squares a little below zero
        within, between = np.diag(self.within), np.maximum(np.diag(self.between), 0.0)
        return Averaged(self.mean, np.sqrt(within), np.sqrt(between), np.sqrt(within + between))
