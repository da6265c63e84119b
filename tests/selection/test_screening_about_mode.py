"""The regression that a likelihood is about its mode, against the inverse of the whole information."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.estimation.priors import Normal
from seatrial.selection import screening
from seatrial.selection.rule_masks import RuleMasks
from seatrial.selection.rules import CompiledRules
from seatrial.selection.subsets.gram import Gram


def test_the_rest_is_integrated_out_under_its_own_prior(monkeypatch):
    """With the priors' precision added for the rest alone, the covariance of the terms is a block of the inverse of all."""
    rng = np.random.default_rng(7)
    names, terms = ("X_u", "sigma_u", "X_uabsu", "u_0", "T_nabsn"), ("T_nabsn", "X_u", "X_uabsu")
    at, rest = np.array([4, 0, 2]), np.array([1, 3])
    slopes, sds, values = rng.normal(size=(40, 5)), np.array([2.0, 0.7, 1.5, 0.4, 3.0]), rng.normal(size=5)
    information, gradient = slopes.T @ slopes, rng.normal(size=5)
    monkeypatch.setattr(screening, "likelihood_information", lambda *_: information)
    monkeypatch.setattr(screening, "slopes_of_present", lambda *_: SimpleNamespace(gradient=gradient))
    posterior = SimpleNamespace(
        present_names=names,
        present_parameters=[SimpleNamespace(prior=Normal(0.0, sd)) for sd in sds],
        data=SimpleNamespace(channels=[SimpleNamespace(present=np.ones(40))]),
    )
    stats, best, sd = screening._quadratic(posterior, SimpleNamespace(values=values), terms)
    whole = information + np.diag(np.where(np.isin(np.arange(5), rest), sds**-2.0, 0.0))
    cov = np.linalg.inv(whole)[np.ix_(at, at)]
    np.testing.assert_allclose(sd, np.sqrt(np.diag(cov)), rtol=1e-9)
    np.testing.assert_allclose(best, values[at] + cov @ gradient[at], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(stats.matrix), cov, rtol=1e-9)


@pytest.mark.parametrize("g", [None, "rows", 3.0])
def test_the_prior_is_the_stated_one_or_a_g_prior_of_the_size_that_is_asked_for(monkeypatch, g):
    """All eight structures, against Gaussian integrals of the quadratic under each prior, noise 1."""
    names, rows = ("X_u", "X_uabsu", "T_nabsn"), 40
    rng = np.random.default_rng(3)
    slopes = 0.2 * rng.normal(size=(rows, 3))
    matrix, moment = slopes.T @ slopes, np.array([1.0, -2.0, 3.0])
    best = np.linalg.solve(matrix, moment)
    stats = Gram(matrix, moment, rows + float(best @ moment), rows)
    monkeypatch.setattr(screening, "_quadratic", lambda *_: (stats, best, np.ones(3)))
    priors = {"X_u": Normal(-2.0, 1.0), "X_uabsu": Normal(0.5, 2.0), "T_nabsn": Normal(1.0, 0.5)}
    posterior = SimpleNamespace(parameters=[SimpleNamespace(name=name, prior=one) for name, one in priors.items()])
    rules = CompiledRules((), names, (), RuleMasks())
    screened = screening.screen_about_mode(posterior, SimpleNamespace(), rules, g)

    def inclusion(size):
        structures = np.array(list(product((False, True), repeat=3)))
        logs = np.array([log_integral(np.flatnonzero(one), size) for one in structures])
        weights = np.exp(logs - logs.max())
        return weights @ structures / weights.sum()

    def log_integral(at, size):
        if size is None:
            means = np.array([float(one.mean) for one in priors.values()])[at]
            precision = np.diag([float(one.sd) ** -2 for one in priors.values()])[np.ix_(at, at)]
        else:
            means, precision = np.zeros(at.size), matrix[np.ix_(at, at)] / size
        total, pull = matrix[np.ix_(at, at)] + precision, moment[at] + precision @ means
        gained = 0.5 * (pull @ np.linalg.solve(total, pull) - means @ precision @ means)
        return gained + 0.5 * (np.linalg.slogdet(precision)[1] - np.linalg.slogdet(total)[1])

    sizes = {None: None, "rows": rows}
    np.testing.assert_allclose(screened.posterior.inclusion, inclusion(sizes.get(g, g)), rtol=1e-5)
    np.testing.assert_allclose(screened.unit_information, inclusion(rows), rtol=1e-5)
