"""A term given probability 0.8 is there 80 % of the time: truths from the prior, data from them."""

import numpy as np
import pytest

from seatrial.selection.rule_masks import RuleMasks
from seatrial.selection.structure_prior import log_prior_by_size
from seatrial.selection.subsets.all_subsets import all_subsets
from seatrial.selection.subsets.conjugate import IndependentPrior
from seatrial.selection.subsets.gram import gram

NAMES = tuple("abcde")
MEAN = np.array([1.0, 0.0, 0.0, -0.5, 0.0])
PRIOR = IndependentPrior(np.array([0.02, 0.05, 0.1, 0.2, 0.5]), 3.0, 2.0, MEAN)
RULES = RuleMasks(parents=(0, 0, 0b11))
"""The third term requires the first two."""
REPLICATES = 600


@pytest.mark.parametrize("structure_prior", ["equal", "multiplicity"])
def test_inclusion_probabilities_are_shares_of_truths(structure_prior):
    """Each bin within 4 standard errors of its mean probability; the Brier score as calibrated probabilities would have it."""
    random = np.random.default_rng(5)
    allowed = np.flatnonzero(RULES.allowed(np.arange(32, dtype=np.uint64)))
    log_prior = log_prior_by_size(structure_prior, 5)
    chance = np.exp(log_prior[np.bitwise_count(allowed)])
    said, there = [], []
    for _ in range(REPLICATES):
        structure = random.choice(allowed, p=chance / chance.sum())
        present = (structure >> np.arange(5) & 1).astype(float)
        variance = PRIOR.rate / random.gamma(PRIOR.shape)
        values = MEAN + random.normal(size=5) * np.sqrt(variance / PRIOR.precision)
        phi = random.normal(size=(12, 5)) + random.normal(size=(12, 1))
        y = phi @ (present * values) + np.sqrt(variance) * random.normal(size=12)
        found = all_subsets(gram(phi, y), PRIOR, NAMES, rules=RULES, log_prior=log_prior, threads=1)
        said.append(found.inclusion)
        there.append(present)
    probability, truth = np.concatenate(said), np.concatenate(there)
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (probability >= low) & (probability < low + 0.1)
        error = np.sqrt((probability * (1 - probability))[inside].sum()) / max(inside.sum(), 1)
        assert inside.sum() > 30
        assert abs(truth[inside].mean() - probability[inside].mean()) < 4 * error
    brier, expected = np.mean((probability - truth) ** 2), np.mean(probability * (1 - probability))
    spread = np.std((probability - truth) ** 2 - probability * (1 - probability)) / np.sqrt(probability.size)
    assert abs(brier - expected) < 4 * spread
