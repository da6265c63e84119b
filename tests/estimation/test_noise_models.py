"""Residuals of one channel, sample by sample, against the joint density of all of them."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.simulation.noise_models import Coloured, Drifting, Heavy, White
from seatrial.estimation.simulation.trial_data import FOREVER, channel_data


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_slow_residuals_are_jointly_normal(complete, noise):
    """Against the dense covariance sd^2 exp(-|t - s| / tau), white noise added where it drifts, of the samples that are there."""
    random = np.random.default_rng(2)
    present = np.ones(30) if complete else (random.uniform(size=30) < 0.6).astype(float)
    present[0] = 1.0
    time, e, sd, tau = np.arange(30) * 0.2, random.normal(size=30), 0.7, 0.5
    at = np.flatnonzero(present)
    gaps = np.append(np.inf, np.diff(time[at]))
    distinct, kinds = np.unique(gaps.round(9), return_inverse=True)
    memory = np.exp(-distinct / tau)
    kind = np.zeros(30, int)
    kind[at] = kinds
    shape = Drifting(noise, sd, memory) if noise else Coloured(sd, np.bincount(kinds), memory, 1 / (1 - memory**2))
    carry = shape.empty()
    for k in range(30):
        carry = shape.absorb(carry, e[k], present[k], kind[k])
    cov = sd**2 * np.exp(-np.abs(np.subtract.outer(time[at], time[at])) / tau)
    cov += noise**2 * np.eye(at.size)
    exact = stats.multivariate_normal(np.zeros(at.size), cov).logpdf(e[at])
    assert float(shape.log_likelihood(carry)) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("complete", [True, False])
@pytest.mark.parametrize(
    ("shape", "law"),
    [
        (White(0.7, np.array([2.0, 5.0])), stats.norm(0, 0.7)),
        (Heavy(0.7, 3.5, np.array([2.0, 5.0])), stats.t(3.5, 0, 0.7)),
    ],
    ids=["white", "heavy"],
)
def test_independent_residuals_are_sums_of_their_log_densities(shape, law, complete):
    """Of seven measurements, in two groups by the gap before them; what is missing does not count."""
    e = np.random.default_rng(3).normal(size=10)
    present = np.ones(10) if complete else (np.arange(10) % 3 != 1).astype(float)
    e, present = (e[:7], present[:7]) if complete else (e, present)
    total = shape.empty()
    for one, there in zip(e, present, strict=True):
        total = shape.absorb(total, one, there, 0)
    assert int(present.sum()) == 7
    assert float(shape.log_likelihood(total)) == pytest.approx(law.logpdf(e[present > 0]).sum(), rel=1e-12)


def test_gaps_that_agree_to_the_nanosecond_are_one():
    """Of gaps 1, 1 + 0.3 ns, 1 + 3 ns and 2 s the first two are one, their mean."""
    time = np.cumsum([0.0, 1.0, 1.0 + 3e-10, 1.0 + 3e-9, 2.0])
    found = channel_data(time, np.zeros(5))
    assert found.counts.tolist() == [2.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(found.gaps - [1.0, 1.0, 2.0, FOREVER], [1.5e-10, 3e-9, 0.0, 0.0], atol=1e-12)
    assert found.kind.tolist() == [3, 0, 0, 1, 2]
