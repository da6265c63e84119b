"""AIC and BIC against the least-squares answer of a linear model, whose likelihood has its maximum there whatever the prior."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.priors import LogUniform, Normal
from seatrial.selection.criteria import aic, bic, maximise_likelihood
from seatrial.selection.criterion import compare
from tests.estimation_cases import linear_gaussian, posterior


def log_likelihood(values, data):
    design, measured = data
    *coefficients, sd = values.values()
    residual = (measured - design @ jnp.stack(coefficients)) / sd
    return -0.5 * jnp.sum(residual**2) - measured.size * (jnp.log(sd) + 0.5 * jnp.log(2 * jnp.pi))


@pytest.fixture(scope="module")
def regression():
    """A linear model of unknown noise whose tight priors pull the mode away from least squares."""
    problem = linear_gaussian(2)
    priors = {"a": Normal(0.0, 0.3), "b": Normal(0.0, 0.3), "sd": LogUniform(0.01, 10.0)}
    target = posterior(priors, log_likelihood, (jnp.asarray(problem.design), jnp.asarray(problem.measured)))
    best = np.linalg.lstsq(problem.design, problem.measured, rcond=None)[0]
    residual = problem.measured - problem.design @ best
    sd = np.sqrt(np.mean(residual**2))
    return target, find_mode(target, key=jax.random.key(0)), np.array([*best, sd]), stats.norm(0, sd).logpdf(residual)


def test_the_maximum_is_least_squares_whatever_the_prior(regression):
    target, mode, best, pointwise = regression
    found = maximise_likelihood(target, mode)
    np.testing.assert_allclose(found.values, best, atol=1e-4)
    assert found.log_likelihood == pytest.approx(pointwise.sum(), abs=1e-6)
    assert np.abs(mode.values - best).max() > 0.02


def test_a_mode_of_another_posterior_is_refused(regression):
    target, mode, *_ = regression

    def nowhere(values, data):
        return -jnp.inf

    with pytest.raises(NumericalError, match="not of this posterior"):
        maximise_likelihood(posterior({p.name: p.prior for p in target.parameters}, nowhere), mode)


def test_criteria_by_hand(regression):
    *_, pointwise = regression
    residual_form = 20 * np.log(2 * np.pi * np.exp(-2 * pointwise.mean() - 1 - np.log(2 * np.pi))) + 20
    assert aic(pointwise, 3).value.value == pytest.approx(residual_form + 6)
    assert bic(pointwise, 3).value.value == pytest.approx(residual_form + 3 * np.log(20))
    assert aic(pointwise, 3).effective == 3
    assert aic(pointwise, 3).value.error == 0
    assert "20 measurements for 3" in bic(pointwise, 3).status
    assert aic(np.tile(pointwise, 10), 3).status == ""
    assert aic(np.resize(pointwise, 119), 3).status != "" == aic(np.resize(pointwise, 120), 3).status, "40 for each"


def test_a_needed_term_is_told_and_an_idle_one_only_priced(regression):
    *_, pointwise = regression
    problem = linear_gaussian(2)
    less = np.linalg.lstsq(problem.design[:, :1], problem.measured, rcond=None)[0]
    residual = problem.measured - problem.design[:, :1] @ less
    short = stats.norm(0, np.sqrt(np.mean(residual**2))).logpdf(residual)
    found = compare(aic(pointwise, 3), aic(short, 2))
    assert "first model predicts better" in found.verdict
    assert found.std_error == pytest.approx(2 * np.sqrt(20) * (pointwise - short).std(ddof=1))
    idle = compare(bic(pointwise, 4), bic(pointwise, 3))
    assert idle.delta == pytest.approx(np.log(20))
    assert idle.std_error == pytest.approx(0.0, abs=1e-9)
    assert "do not separate" in idle.verdict


def test_sums_are_refused():
    with pytest.raises(InputError, match="not their sum"):
        aic(np.array([-12.0]), 3)
    with pytest.raises(InputError, match="0 parameters"):
        bic(np.zeros(5), 0)
    with pytest.raises(InputError, match="AIC of 5 measurements and BIC of 5"):
        compare(aic(np.zeros(5), 1), bic(np.zeros(5), 1))
