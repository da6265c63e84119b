"""Expected information gain against closed forms of linear-Gaussian models, against quadrature, and the golden numbers."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, NumericalError
from seatrial.design import expected_gain
from seatrial.design.expected_gain import (
    FREEDOM,
    MAX_CURVATURE,
    MAX_POOR_SHARE,
    MIN_ESS,
    Explained,
    GainSettings,
    _log_student,
    _refusal,
    _student,
    _with_prior,
    explain,
    importance_gain,
    noise_of,
)
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.prior_belief import draw_values, entropies, log_priors, normal_belief, prior_cov
from seatrial.design.trial_plan import plan_trial
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform, half_normal
from seatrial.numerics.gaussian import Gaussian
from seatrial.vehicles.model import VehicleModel
from tests.cases import TRUTH, U0, paper_model
from tests.estimation_cases import SIGMA, naive_doublets

KEY = jax.random.key(11)
SMALL = GainSettings(draws=80, outer=80, inner=32)


N_DECAY, DECAY_STEP, DECAY_SD = 9, 0.125, 0.05
"""The last of 9 samples is at 1 s."""


def decay_rate(params, state, control):
    return (params["X_u"] * control[0] * state[0],)


def decay_plan(n=N_DECAY):
    """u' = c n u from u = 1, seen only at its last sample."""
    model = VehicleModel("decay", ("u",), ("n",), (CoefficientName.parse("X_u"),), (("decay", 1.0),), False, decay_rate)
    last = (np.arange(n) == n - 1)[:, None]
    return plan_trial(model, [1.0], {"u": DECAY_SD}, n, DECAY_STEP, measured=last)


def decay_end(c, push):
    """u at the end by the growth of a Runge-Kutta step."""
    x = c * push * DECAY_STEP
    return (1 + x + x**2 / 2 + x**3 / 6 + x**4 / 24) ** (N_DECAY - 1)


def decay_slope(c, push):
    """Its derivative in c."""
    x = c * push * DECAY_STEP
    growth = 1 + x + x**2 / 2 + x**3 / 6 + x**4 / 24
    return (N_DECAY - 1) * growth ** (N_DECAY - 2) * (1 + x + x**2 / 2 + x**3 / 6) * push * DECAY_STEP


def linear_rate(params, state, control):
    return (params["X_u"] * control[0] + params["X_uabsu"] * control[0] ** 2,)


N_LINEAR = 40
PUSH = np.sin(np.arange(N_LINEAR))[:, None]
BELIEF = Gaussian(jnp.array([1.0, -2.0]), jnp.linalg.cholesky(jnp.array([[0.5, 0.2], [0.2, 2.0]])))


def linear_plan(sd=0.3):
    """u' = a n + b n^2: linear in the coefficients."""
    names = tuple(map(CoefficientName.parse, ("X_u", "X_uabsu")))
    model = VehicleModel("linear", ("u",), ("n",), names, (("linear", 1.0),), False, linear_rate)
    return plan_trial(model, [0.0], {"u": sd}, N_LINEAR, 0.2)


def linear_gain(cov, sd=0.3):
    """Mutual information in closed form: what the covariance of the data is more than the noise."""
    slope = 0.2 * np.vstack([np.zeros(2), np.cumsum(np.hstack([PUSH, PUSH**2]), 0)[:-1]]) / sd
    return 0.5 * np.linalg.slogdet(np.eye(N_LINEAR) + slope @ cov @ slope.T)[1]


INDEPENDENT = (Normal(1.0, 0.7), Normal(-2.0, 1.4))
beliefs = pytest.mark.parametrize(
    "belief",
    [BELIEF, pytest.param(INDEPENDENT, marks=pytest.mark.proof)],
    ids=["joint", "independent"],
)


@beliefs
def test_linear_gaussian_closed_form(belief):
    exact = linear_gain(prior_cov(belief))
    found = importance_gain(linear_plan(), belief, PUSH, KEY, SMALL)
    assert abs(found.value - exact) < 4 * found.std_error
    assert found.std_error < 0.02
    assert found.status == ""
    assert found.diagnostics["low_ess"] > 24
    assert found.diagnostics["laplace"] == pytest.approx(exact, rel=1e-9)


def test_gain_is_the_entropy_utility_of_a_linear_model():
    information = jax.jit(linear_plan().information)(BELIEF.mean, jnp.asarray(PUSH))
    local = importance_gain(linear_plan(), BELIEF, PUSH, KEY, SMALL).diagnostics["laplace"]
    assert local == pytest.approx(float(find_criterion("fisher-d", prior_cov(BELIEF))(information)), rel=1e-9)


PRIORS = {
    "normal": Normal(-1.0, 0.3),
    "uniform": Uniform(-1.8, -0.2),
    "log-normal": LogNormal(-1.0, 1.6),
    "log-uniform": LogUniform(0.2, 2.0),
}


@cache
def quadrature_gain(name, push=1.0):
    """h(y) - h(noise) by two plain quadratures."""
    prior = PRIORS[name]
    z = np.linspace(-8, 8, 2001)
    shown = decay_end(np.asarray(prior.constrain(jnp.asarray(z))), push) / DECAY_SD
    mass = np.exp(np.asarray(prior.log_density(jnp.asarray(z)))) * (z[1] - z[0])
    y = np.linspace(shown[mass > 1e-12].min() - 8, shown[mass > 1e-12].max() + 8, 2001)
    density = sum(mass[i : i + 200] @ np.exp(-0.5 * (y - shown[i : i + 200, None]) ** 2) for i in range(0, z.size, 200))
    density = density / np.sqrt(2 * np.pi)
    assert density.sum() * (y[1] - y[0]) == pytest.approx(1.0, abs=1e-6)
    return -np.sum(density * np.log(density)) * (y[1] - y[0]) - 0.5 * np.log(2 * np.pi * np.e)


@pytest.mark.parametrize(
    "name", ["uniform", *(pytest.param(name, marks=pytest.mark.proof) for name in PRIORS if name != "uniform")]
)
def test_nonlinear_against_quadrature(name):
    """The noise at the unseen samples must not count, and a box cuts the posterior of one draw in four."""
    push = -1.0 if name == "log-uniform" else 1.0
    found = importance_gain(
        decay_plan(), (PRIORS[name],), np.full((N_DECAY, 1), push), KEY, GainSettings(draws=1600, outer=800)
    )
    exact = quadrature_gain(name, push)
    assert abs(found.value - exact) < 4 * found.std_error
    assert found.std_error < 0.02 * exact
    assert found.status == ""
    assert found.diagnostics["laplace"] == pytest.approx(exact, abs=0.15)


def test_error_is_that_of_repeats():
    """Estimates under 24 keys spread as each says; a spread of 24 has a relative error of 0.15."""
    found = [importance_gain(linear_plan(), BELIEF, PUSH, jax.random.key(i), SMALL) for i in range(24)]
    values, told = np.array([x.value for x in found]), np.mean([x.std_error for x in found])
    assert values.std(ddof=1) == pytest.approx(told, rel=0.45)
    assert abs(values.mean() - linear_gain(prior_cov(BELIEF))) < 4 * told / np.sqrt(24)


def test_one_key_gives_the_same_bits_and_sharper_differences():
    first, again = (importance_gain(linear_plan(), BELIEF, PUSH, KEY, SMALL) for _ in range(2))
    assert first == again
    keys = [jax.random.key(i) for i in range(8)]
    gains = [[importance_gain(linear_plan(), BELIEF, s * PUSH, key, SMALL).value for s in (1, 1.1)] for key in keys]
    apart = np.diff(gains, axis=1)[:, 0].std()
    assert apart < 0.5 * np.std(gains)


@pytest.mark.proof
def test_too_few_inner_draws_are_refused():
    found = importance_gain(linear_plan(), BELIEF, PUSH, KEY, GainSettings(draws=80, outer=80, inner=4))
    assert found.status.startswith("refused: 100% of 80 outer draws rest on fewer than 8 effective of 4 inner draws")


def test_priors_whose_draws_diverge():
    """Eight steps of a factor of (1e11 / 8)^4 / 24 and more pass the largest number for all but a few draws."""
    with pytest.raises(NumericalError, match=r"diverges for \d+ of \d+ draws from the prior, first at X_u = "):
        importance_gain(decay_plan(), (Uniform(-1.0, 1e12),), np.ones((N_DECAY, 1)), KEY)


@pytest.mark.parametrize(
    "prior",
    [PRIORS["uniform"], pytest.param(half_normal(2.0, upper=0.0), marks=pytest.mark.proof)],
    ids=["uniform", "half-normal"],
)
def test_entropy_of_z_against_draws(prior):
    z = prior.sample(KEY, (20000,))
    told = -np.asarray(prior.log_density(z))
    assert abs(entropies((prior,))[0] - told.mean()) < 4 * told.std() / np.sqrt(20000)


def test_belief_of_posterior_draws():
    draws = np.asarray(draw_values(BELIEF, KEY, 2000))
    belief = normal_belief(draws)
    np.testing.assert_allclose(belief.mean, draws.mean(0), rtol=1e-12)
    np.testing.assert_allclose(prior_cov(belief), np.cov(draws.T), rtol=1e-9)
    np.testing.assert_allclose(prior_cov(INDEPENDENT), np.diag([0.49, 1.96]), rtol=1e-12)
    drawn = draw_values(INDEPENDENT, KEY, 2000)
    np.testing.assert_allclose(drawn.mean(0), [1.0, -2.0], atol=4 * 1.4 / np.sqrt(2000))
    np.testing.assert_allclose(drawn.std(0), [0.7, 1.4], rtol=4 / np.sqrt(4000))
    for bad in (draws[:2], draws * [1.0, 0.0]):
        with pytest.raises(InputError, match="draws of the coefficients"):
            normal_belief(bad)


@pytest.mark.proof
def test_golden_gain_of_the_paper_doublet():
    """Normal priors of 15 % about the truth; 8.481(15) by Laplace and 8.42(12) by nested Monte Carlo, measured elsewhere."""
    plan = plan_trial(paper_model(), [U0], {"u": SIGMA}, 6000, 0.01)
    control = 2 * np.pi * naive_doublets(np.arange(6000) * 0.01, 200, 10)[:, None]
    found = importance_gain(plan, tuple(Normal(x, 0.15 * abs(x)) for x in TRUTH.values()), control, KEY)
    assert found.std_error < 0.01 * found.value
    assert found.diagnostics["laplace"] == pytest.approx(8.481, abs=3 * np.hypot(0.015, 0.0075))
    assert found.value == pytest.approx(8.42, abs=3 * 0.12)
    assert found.diagnostics["correction"] == pytest.approx(0.0, abs=0.08)


def test_correction_and_its_error_from_given_explanations(monkeypatch):
    """Gains of the outer draws less the local ones and what chance made; errors of both parts and what they have in common."""
    rng = np.random.default_rng(8)
    gain, chance, ess = rng.normal(3.0, 1.0, 40), rng.normal(2.0, 0.5, 40), rng.uniform(9.0, 30.0, 40)
    monkeypatch.setattr(
        expected_gain, "explain", lambda *given: Explained(*(x[np.asarray(given[4])] for x in (gain, chance, ess)))
    )
    prior = (Normal(-1.0, 0.3),)
    found = importance_gain(
        decay_plan(), prior, np.ones((N_DECAY, 1)), KEY, GainSettings(draws=100, outer=40, inner=32)
    )
    slopes = decay_slope(draw_values(prior, KEY, 100)[:, 0], 1.0) / DECAY_SD
    local = 0.5 * np.log1p(0.09 * slopes**2)
    correction = gain - local[:40] - chance + 0.5 * np.log(2 * np.pi * np.e)
    assert found.value == pytest.approx(local.mean() + correction.mean(), rel=1e-6)
    cov = np.cov(local[:40], correction)
    variance = local.var(ddof=1) / 100 + cov[1, 1] / 40 + 2 * cov[0, 1] / 100
    assert found.std_error == pytest.approx(np.sqrt(variance), rel=1e-6)
    told = found.diagnostics
    assert told["laplace"] == pytest.approx(local.mean(), rel=1e-6)
    assert (told["correction"], told["correction_error"]) == pytest.approx(
        (correction.mean(), correction.std(ddof=1) / np.sqrt(40)), rel=1e-6
    )
    assert (told["draws"], told["outer"], told["inner"]) == (100, 40, 32)
    assert (told["median_ess"], told["low_ess"]) == pytest.approx((np.median(ess), np.quantile(ess, MAX_POOR_SHARE)))
    assert found.status == ""


@pytest.mark.parametrize(("few", "refused"), [(MAX_POOR_SHARE - 0.01, False), (MAX_POOR_SHARE + 0.01, True)])
@pytest.mark.parametrize("low", [MIN_ESS - 0.01, np.nan])
def test_gains_are_refused_where_too_many_draws_rest_on_too_few(few, refused, low):
    ess = np.full(200, MIN_ESS + 0.01)
    ess[: round(200 * few)] = low
    said = _refusal(ess, 32)
    assert bool(said) == refused
    assert not refused or said.endswith("use more of them")
    assert _refusal(np.full(200, MIN_ESS), 32) == ""


def test_importance_draws_are_student_s_and_cancel_in_pairs():
    t = _student(np.random.default_rng(1), 4000, 3)
    np.testing.assert_array_equal(t[:2000], -t[2000:])
    law = stats.multivariate_t(np.zeros(3), np.eye(3), FREEDOM)
    np.testing.assert_allclose(_log_student(jnp.asarray(t[:50])), law.logpdf(t[:50]), rtol=1e-10)
    square = (t[:2000] ** 2).sum(1) / 3
    assert stats.kstest(square, stats.f(3, FREEDOM).cdf).pvalue > 1e-4


def test_explanations_of_a_linear_model_are_exact():
    """Normal posteriors: the gain is log p(y | c) - log p(y) at the data that the noise makes, whatever the importance draws."""
    rng = np.random.default_rng(4)
    z = rng.normal(size=(5, 2))
    plan, which = linear_plan(), np.arange(3, 8)
    found = explain(plan, BELIEF, jnp.asarray(PUSH), KEY, which, jnp.asarray(z), 64, 3)
    noise = noise_of(jax.random.split(KEY)[0], which, N_LINEAR)
    np.testing.assert_array_equal(noise[2:], noise_of(jax.random.split(KEY)[0], which[2:], N_LINEAR))
    slope = 0.2 * np.vstack([np.zeros(2), np.cumsum(np.hstack([PUSH, PUSH**2]), 0)[:-1]]) / 0.3
    values = np.asarray(BELIEF.mean) + z @ np.asarray(BELIEF.chol_cov).T
    measured = values @ slope.T + noise
    cov = np.eye(N_LINEAR) + slope @ np.asarray(BELIEF.cov) @ slope.T
    exact = stats.multivariate_normal(np.zeros(N_LINEAR)).logpdf(noise) - stats.multivariate_normal(
        slope @ np.asarray(BELIEF.mean), cov
    ).logpdf(measured)
    np.testing.assert_allclose(found.gain, exact, atol=0.15)
    assert ((found.ess > 40) & (found.ess <= 64)).all()


def test_precision_and_slope_of_the_prior_against_differences():
    """A box bends by hundreds near its ends, of which a normal follows ten; inside not at all, where the precision is taken as one."""
    belief, z = (PRIORS["uniform"], PRIORS["uniform"], PRIORS["normal"]), np.array([1.7, 0.3, -2.0])
    information = np.array([[2.0, 0.5, 0.1], [0.5, 3.0, 0.2], [0.1, 0.2, 1.0]])
    precision, rise = _with_prior(belief, jnp.asarray(z), jnp.asarray(information))
    below, here, above = (np.asarray(log_priors(belief, jnp.asarray(z + h))) for h in (-3e-5, 0.0, 3e-5))
    bend = (2 * here - below - above) / 9e-10
    assert bend[0] > 100 > 1 > bend[1]
    np.testing.assert_allclose(rise, (above - below) / 6e-5, atol=1e-5)
    np.testing.assert_allclose(precision, information + np.diag([MAX_CURVATURE, 1.0, 1.0]), rtol=1e-6)


def test_draws_that_cannot_be_simulated_count_as_impossible():
    """u' = sqrt(c), seen once after 2 s: p(y) by quadrature over the c that have a root, a sixth of the prior having none."""
    name = CoefficientName.parse("X_u")
    model = VehicleModel("root", ("u",), ("n",), (name,), (("root", 1.0),), False, lambda p, *_: (jnp.sqrt(p["X_u"]),))
    plan, prior = plan_trial(model, [0.0], {"u": 1.0}, 2, 2.0, measured=np.array([[0], [1]])), Normal(0.3, 0.3)
    z, which = np.array([[-0.5], [0.0], [1.0]]), np.arange(3)
    found = explain(plan, (prior,), jnp.zeros((2, 1)), KEY, which, jnp.asarray(z), 20_000, 3)
    noise = noise_of(jax.random.split(KEY)[0], which, 2)[:, 1]
    measured = 2 * np.sqrt(0.3 + 0.3 * z[:, 0]) + noise
    c = np.linspace(0.0, 3.0, 30_001)
    shown = stats.norm.pdf(measured[:, None] - 2 * np.sqrt(c)) * stats.norm(0.3, 0.3).pdf(c)
    exact = stats.norm.logpdf(noise) - np.log(shown.sum(1) * c[1])
    np.testing.assert_allclose(found.gain, exact, atol=0.05)
