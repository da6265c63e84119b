"""What an estimate keeps for figures: prior densities, against scipy."""

import numpy as np
import pytest
from scipy import stats

from seatrial.campaign.inference.estimate import prior_curves
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform, half_normal
from tests.estimation_cases import posterior

PRIORS = {
    "a": (Uniform(-3.0, 1.0), stats.uniform(-3.0, 4.0)),
    "b": (Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
    "c": (LogUniform(0.1, 10.0), stats.loguniform(0.1, 10.0)),
    "d": (LogNormal(-3.0, 1.5), None),
    "e": (half_normal(0.7, lower=0.0), stats.halfnorm(0.0, 0.7)),
}


def test_prior_densities():
    target = posterior({name: prior for name, (prior, _) in PRIORS.items()}, lambda values, data: 0.0)
    curves = prior_curves(target)
    for name, (_, law) in PRIORS.items():
        value, density = curves[name]
        assert np.all(np.diff(value) >= 0)
        assert np.trapezoid(density, value) == pytest.approx(1.0, abs=0.02)
        if law is not None:
            inside = slice(20, -20)
            assert density[inside] == pytest.approx(law.pdf(value[inside]), rel=1e-4)
