"""Utilities from Fisher information against explicit inverses, and the information itself against differences and repeats."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg, stats

from seatrial.core.errors import InputError
from seatrial.design.fisher_utilities import CRITERIA, SINGULAR, find_criterion
from seatrial.design.trial_plan import plan_trial
from tests.cases import THRUST, TRUTH, U0, X_U, X_UU, paper_model
from tests.estimation_cases import naive_doublets, naive_speed

SD = np.array([2.0, 0.3, 1e-4])
P0 = np.array([[1.0, 0.6, -0.2], [0.6, 1.0, 0.1], [-0.2, 0.1, 1.0]]) * np.outer(SD, SD)
GRADIENT = np.array([1.0, -2.0, 3e3])
NOTHING = {"fisher-d": 0.0, "fisher-a": -1.0, "fisher-e": 1.0, "fisher-me": np.log(SINGULAR), "fisher-c": 0.0}


def random_information(*shape, seed=0):
    slope = np.random.default_rng(seed).normal(size=(*shape, 3, 5)) * 3 / SD[:, None]
    return slope @ slope.swapaxes(-1, -2)


def explicit(name, information, cov=P0, gradient=GRADIENT):
    """The textbook formula with every inverse written out."""
    after = np.linalg.inv(information + np.linalg.inv(cov))
    values = linalg.eigvalsh(information, np.linalg.inv(cov))
    return {
        "fisher-d": 0.5 * np.log(np.linalg.det(information + np.linalg.inv(cov)) * np.linalg.det(cov)),
        "fisher-a": -np.mean(np.diag(after) / np.diag(cov)),
        "fisher-e": 1 + values[0],
        "fisher-me": -np.log(values[-1] / values[0]),
        "fisher-c": 0.5 * np.log((gradient @ cov @ gradient) / (gradient @ after @ gradient)),
    }[name]


def criterion(name, cov=P0, gradient=GRADIENT):
    return find_criterion(name, cov, gradient)


every = pytest.mark.parametrize("name", CRITERIA)


@every
def test_explicit_formulas(name):
    information = random_information(2, 3)
    found = criterion(name)(information)
    assert isinstance(found, np.ndarray)
    expected = [[explicit(name, one) for one in row] for row in information]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_traced_as_on_arrays():
    information, all_of_them = random_information(4), [criterion(name) for name in CRITERIA]
    traced = jax.jit(lambda x: [one(x) for one in all_of_them])(jnp.asarray(information))
    np.testing.assert_allclose(traced, [one(information) for one in all_of_them], rtol=1e-8)


@every
def test_what_a_trial_without_information_is_worth(name):
    found = criterion(name)
    assert found(np.zeros((3, 3))) == pytest.approx(NOTHING[name], abs=1e-12)
    one_direction = np.outer([1.0, 2.0, 1e4], [1.0, 2.0, 1e4])
    assert np.isfinite(found(one_direction))


@every
def test_more_data_never_teach_less(name):
    if name == "fisher-me":
        pytest.skip("it is of balance, not of amount")
    some, more = random_information(20), random_information(20, seed=1)
    assert (criterion(name)(some + more) > criterion(name)(some)).all()


@pytest.mark.parametrize("name", [name for name in CRITERIA if name != "fisher-a"])
def test_other_coefficients_of_the_same_vehicle_change_nothing(name):
    """c = M b: information M^T F M, covariance M^-1 P0 M^-T, gradient M^T g."""
    information, mixed = random_information(4), np.random.default_rng(5).normal(size=(3, 3)) + 2 * np.eye(3)
    back = np.linalg.inv(mixed)
    moved = find_criterion(name, back @ P0 @ back.T, mixed.T @ GRADIENT)(mixed.T @ information @ mixed)
    np.testing.assert_allclose(moved, criterion(name)(information), rtol=1e-7)


def test_units_change_nothing_in_mean_variance():
    information, units = random_information(4), np.diag([1e3, 1.0, 1e-5])
    moved = find_criterion("fisher-a", np.linalg.inv(units) @ P0 @ np.linalg.inv(units))(units @ information @ units)
    np.testing.assert_allclose(moved, criterion("fisher-a")(information), rtol=1e-9)


def test_entropy_is_the_mutual_information_of_a_linear_gaussian_model():
    slope, noise = np.random.default_rng(2).normal(size=(7, 3)) / SD, 0.4
    data = stats.multivariate_normal(np.zeros(7), slope @ P0 @ slope.T + noise**2 * np.eye(7))
    expected = data.entropy() - 7 * stats.norm(0, noise).entropy()
    assert criterion("fisher-d")(slope.T @ slope / noise**2) == pytest.approx(expected, rel=1e-9)


@pytest.mark.proof
def test_gradient_of_entropy_is_half_the_covariance_after():
    information = random_information()
    slope = jax.grad(criterion("fisher-d"))(jnp.asarray(information))
    after = np.linalg.inv(information + np.linalg.inv(P0))
    np.testing.assert_allclose(slope / np.outer(SD, SD), 0.5 * after / np.outer(SD, SD), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "cov", "gradient", "words"),
    [
        ("fisher-b", P0, None, "fisher-b"),
        ("fisher-c", P0, None, "none"),
        ("fisher-c", P0, np.ones(2), "1"),
        ("fisher-c", P0, np.zeros(3), "0"),
        ("fisher-d", np.ones((3, 3)), None, "smallest eigenvalue"),
        ("fisher-d", np.diag([1.0, 0.0]), None, "variances"),
    ],
)
def test_what_cannot_be_used_is_refused(name, cov, gradient, words):
    with pytest.raises(InputError) as caught:
        find_criterion(name, cov, gradient)
    assert words in caught.value.found


STEP = np.full(60, 0.5)
PUSHED = naive_doublets(np.arange(60) * 0.5, 200, 10, active=20)
NOISE = {"u": 0.02, "udot": 0.05}
TO_SI = np.array([1.0, 1.0, (2 * np.pi) ** -2])


def surge_plan(noise):
    return plan_trial(paper_model(), [U0], noise, 60, 0.5)


def surge_information(noise):
    control = jnp.asarray(2 * np.pi * PUSHED[:, None])
    return np.asarray(jax.jit(surge_plan(noise).information)(jnp.array(list(TRUTH.values())), control))


def test_information_against_differences_of_the_outputs():
    """Central differences of 1e-4 of each coefficient leave relative errors of 1e-8 in the slopes."""
    values, control = np.array(list(TRUTH.values())), jnp.asarray(2 * np.pi * PUSHED[:, None])
    moved = values + 1e-4 * np.vstack([np.diag(values), -np.diag(values)])
    shown = jax.jit(jax.vmap(surge_plan(NOISE).outputs, in_axes=(0, None)))(jnp.asarray(moved), control)
    slope = (shown[:3] - shown[3:]).reshape(3, -1) / (2e-4 * values[:, None])
    found = surge_information(NOISE)
    scale = np.sqrt(np.diag(found))
    np.testing.assert_allclose(found / np.outer(scale, scale), slope @ slope.T / np.outer(scale, scale), atol=1e-6)


@pytest.mark.proof
def test_information_against_the_spread_of_estimates_over_1000_repeats():
    """Least squares by Gauss-Newton on a plain loop; a variance of 1000 repeats has a relative error of 0.045."""
    sd, truth = 0.01, np.array([X_U, X_UU, THRUST])

    def speed(values):
        return naive_speed(PUSHED, STEP, np.full(values.shape[1:], U0), x_u=values[0], x_uu=values[1], thrust=values[2])

    measured = speed(np.tile(truth[:, None], 1000)) + sd * np.random.default_rng(7).normal(size=(60, 1000))
    estimate = np.tile(truth[:, None], 1000)
    for _ in range(6):
        here = speed(estimate)
        slope = np.stack([(speed(estimate * (1 + 1e-6 * np.eye(3)[i][:, None])) - here) for i in range(3)], -1)
        slope = slope / (1e-6 * estimate.T)
        estimate = estimate + np.stack(
            [np.linalg.lstsq(slope[:, j], measured[:, j] - here[:, j], rcond=None)[0] for j in range(1000)], -1
        )
    root = np.linalg.cholesky(surge_information({"u": sd}))
    spread = root.T @ np.cov(estimate * TO_SI[:, None]) @ root
    np.testing.assert_allclose(spread, np.eye(3), atol=4 * 0.045)
