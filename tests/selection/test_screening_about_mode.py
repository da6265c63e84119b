"""The regression that a likelihood is about its mode, against the inverse of the whole information."""

from types import SimpleNamespace

import numpy as np

from seatrial.estimation.priors import Normal
from seatrial.selection import screening_about_mode


def test_the_rest_is_integrated_out_under_its_own_prior(monkeypatch):
    """With the priors' precision added for the rest alone, the covariance of the terms is a block of the inverse of all."""
    rng = np.random.default_rng(7)
    names, terms = ("X_u", "sigma_u", "X_uabsu", "u_0", "T_nabsn"), ("T_nabsn", "X_u", "X_uabsu")
    at, rest = np.array([4, 0, 2]), np.array([1, 3])
    slopes, sds, values = rng.normal(size=(40, 5)), np.array([2.0, 0.7, 1.5, 0.4, 3.0]), rng.normal(size=5)
    information, gradient = slopes.T @ slopes, rng.normal(size=5)
    monkeypatch.setattr(screening_about_mode, "likelihood_information", lambda *_: information)
    monkeypatch.setattr(screening_about_mode, "slopes_of_present", lambda *_: SimpleNamespace(gradient=gradient))
    posterior = SimpleNamespace(
        present_names=names,
        present_parameters=[SimpleNamespace(prior=Normal(0.0, sd)) for sd in sds],
        data=SimpleNamespace(channels=[SimpleNamespace(present=np.ones(40))]),
    )
    stats, best, sd = screening_about_mode._quadratic(posterior, SimpleNamespace(values=values), terms)
    whole = information + np.diag(np.where(np.isin(np.arange(5), rest), sds**-2.0, 0.0))
    cov = np.linalg.inv(whole)[np.ix_(at, at)]
    np.testing.assert_allclose(sd, np.sqrt(np.diag(cov)), rtol=1e-9)
    np.testing.assert_allclose(best, values[at] + cov @ gradient[at], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(stats.matrix), cov, rtol=1e-9)
