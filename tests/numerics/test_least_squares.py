from decimal import Decimal, localcontext
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.numerics.least_squares import least_squares
from tests.numerics.nist import MODELS, digits, problem

QUICK = ("BoxBOD", "MGH10")
"""One that fails for one way of damping, and one whose variables lie between 1e-3 and 1e4."""

X = np.linspace(0.0, 2.0, 30)
NOISE = 0.1 * np.random.default_rng(3).normal(size=30)


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.thorough) for name in MODELS]
)
def test_certified_digits_of_nist(name):
    """From both starts ten digits of the parameters and of the deviations, of the 11 that NIST prints.

    The residuals of Lanczos1 are 1e-13 of its data, so that rounding of the model leaves three digits of its deviations.
    """
    told = problem(name)
    for start in (1, 2):
        answer = told.solve(start)
        found = digits(told, answer)
        assert answer.converged, answer.status
        assert found.parameters > 9.5
        assert found.deviations > (2.8 if name == "Lanczos1" else 9.5)


@pytest.mark.parametrize("name", MODELS)
def test_certified_parameters_have_the_certified_residuals(name):
    """This is what tells the right one of two public values of b1 of Roszman1; Lanczos1 is beyond the digits printed."""
    told = problem(name)
    r = np.asarray(told.residual(jnp.asarray(told.certified), told.data))
    assert (r @ r == pytest.approx(told.certified_rss, rel=1e-10, abs=0)) == (name != "Lanczos1")
    assert told.certified_sd == pytest.approx(np.sqrt(told.certified_rss / (r.size - told.certified.size)), rel=1e-9)


@pytest.mark.thorough
def test_certified_deviations_of_lanczos1_at_our_answer():
    """With forty digits in the residuals, ours give the certified residual standard deviation to more than four digits."""
    text = (Path(__file__).parent / "nist" / "Lanczos1.toml").read_text(encoding="utf-8")
    y, x = (
        [Decimal(word) for word in text.split(f"\n{key} = [")[1].split("]")[0].replace(",", " ").split()]
        for key in "yx"
    )
    told = problem("Lanczos1")
    b = [Decimal(value) for value in told.solve(1).x.tolist()]
    with localcontext() as context:
        context.prec = 40
        rss = sum((v - sum(b[i] * (-b[i + 1] * t).exp() for i in (0, 2, 4))) ** 2 for v, t in zip(y, x, strict=True))
    assert float(rss) == pytest.approx(told.certified_rss, rel=1e-4)


def straight(b, data):
    return data - (b[0] + 1e-9 * b[1] * X + 1e6 * b[2] * X**2)


def test_a_linear_model_against_the_normal_equations():
    design = np.stack([np.ones_like(X), 1e-9 * X, 1e6 * X**2], 1)
    y = design @ [1.0, 2e9, 3e-6] + NOISE
    answer = least_squares(straight, y, np.zeros(3), names=("a", "b", "c"))
    beta, rss = np.linalg.lstsq(design / [1, 1e-9, 1e6], y)[:2]
    scale = np.array([1, 1e9, 1e-6])
    cov = rss / 27 * np.linalg.inv((design * scale).T @ (design * scale)) * np.outer(scale, scale)
    assert answer.x == pytest.approx(beta * scale, rel=1e-12)
    assert answer.rss == pytest.approx(rss[0], rel=1e-12)
    assert np.allclose(answer.cov / np.outer(scale, scale), cov / np.outer(scale, scale), rtol=1e-9, atol=0)
    assert answer.se == pytest.approx(np.sqrt(np.diag(cov)), rel=1e-9)
    assert answer.sd == pytest.approx(np.sqrt(rss[0] / 27), rel=1e-12)
    assert answer.converged
    assert "converged in" in answer.status


def decay(b, data):
    return data - b[0] * jnp.exp(-b[1] * X)


def test_exact_data():
    answer = least_squares(decay, 2 * np.exp(-3 * X), np.array([1.0, 1.0]))
    assert answer.x == pytest.approx([2, 3], rel=1e-13)
    assert answer.converged
    assert answer.sd < 1e-14


def two_valleys(b, data):
    return jnp.stack([b[0] ** 2 - 4, data * (b[0] - 3), 0.0 * b[0]])


def test_the_lowest_of_several_starts():
    left, right = (least_squares(two_valleys, np.array(0.5), np.array([[start]])) for start in (-2.0, 2.0))
    both = least_squares(two_valleys, np.array(0.5), np.array([[-2.0], [2.0]]))
    assert left.x[0] < 0 < right.x[0]
    assert both.rss == right.rss < left.rss
    assert both.x == right.x


def broken(b, data):
    return jnp.sqrt(b[0]) * X + b[1] - data


def test_a_start_without_finite_residuals_is_left_out():
    y = 2 * X + 1 + NOISE
    answer = least_squares(broken, y, np.array([[-1.0, 0.0], [1.0, 0.0]]))
    slope, level = np.polyfit(X, y, 1)
    assert answer.x == pytest.approx([slope**2, level], rel=1e-9)
    with pytest.raises(NumericalError, match=r"none of 1 starts.*root = -1, level = 0.*begin elsewhere"):
        least_squares(broken, y, np.array([-1.0, 0.0]), names=("root", "level"))


def test_too_few_iterations_say_how_far_there_is_to_go():
    told = problem("BoxBOD")
    answer = least_squares(told.residual, told.data, told.starts[0], max_iterations=2)
    assert not answer.converged
    assert "not converged" in answer.status
    assert "would still move by" in answer.status


def confounded(b, data):
    return data - (b[0] + 2 * b[1]) * X - b[2]


def idle(b, data):
    return data - b[0] * X + 0 * b[1]


def test_what_is_not_determined_is_named():
    y = X + NOISE
    with pytest.raises(NumericalError, match=r"do not tell k and m apart: changing k by \+1, m by -0.5 leaves every"):
        least_squares(confounded, y, np.ones(3), names=("k", "m", "c"))
    with pytest.raises(NumericalError, match="do not depend on m at all"):
        least_squares(idle, y, np.ones(2), names=("k", "m"))


@pytest.mark.parametrize(
    ("starts", "names", "found"),
    [
        (np.ones(2), ("a", "b", "c"), r"shape \(1, 2\) for the variables a, b, c"),
        (np.array([1.0, np.nan]), None, "x1, x2"),
        (np.empty((0, 2)), None, r"shape \(0, 2\)"),
        (np.ones((2, 2, 2)), None, r"shape \(2, 2, 2\)"),
    ],
)
def test_bad_starts(starts, names, found):
    with pytest.raises(InputError, match=found):
        least_squares(decay, X, starts, names)


def test_too_few_residuals():
    with pytest.raises(InputError, match="3 residuals for 3 variables: x1, x2, x3"):
        least_squares(lambda b, data: b - data, np.ones(3), np.zeros(3))
