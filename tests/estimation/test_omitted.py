"""Score test of effects left out, against least squares with the effect put in, and its size where nothing is missing."""

import numpy as np
import pytest

from seatrial.estimation.omitted_effects import score_effects

RNG = np.random.default_rng(5)
N = 400
J = RNG.normal(size=(N, 3))
EFFECT = J @ [0.5, -1.0, 0.2] + RNG.normal(size=N)


def fitted(measured):
    """Residuals of least squares, and the covariance of its parameters."""
    values = np.linalg.lstsq(J, measured, rcond=None)[0]
    return measured - J @ values, np.linalg.inv(J.T @ J), values


def test_size_and_shift_are_those_of_the_wider_fit():
    measured = J @ [1.0, 2.0, 3.0] + 0.3 * EFFECT + RNG.normal(size=N)
    residual, cov, values = fitted(measured)
    (found,) = score_effects(residual, J, cov, {"effect": EFFECT})
    wide = np.column_stack([J, EFFECT])
    exact = np.linalg.lstsq(wide, measured, rcond=None)[0]
    assert found.size == pytest.approx(exact[3], rel=1e-9)
    assert found.sd == pytest.approx(np.sqrt(np.linalg.inv(wide.T @ wide)[3, 3]), rel=1e-9)
    assert values + found.shift == pytest.approx(exact[:3], rel=1e-9)
    assert found.p_value < 1e-6


def test_p_values_are_uniform_where_nothing_is_missing():
    """The share of 2000 data sets below 5 %, to four standard errors."""
    values = []
    for _ in range(2000):
        residual, cov, _ = fitted(RNG.normal(size=N))
        values.append(score_effects(residual, J, cov, {"effect": EFFECT})[0].p_value)
    assert abs(np.mean(np.array(values) < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 2000)


def test_what_the_parameters_imitate_is_not_tested():
    residual, cov, _ = fitted(RNG.normal(size=N))
    assert score_effects(residual, J, cov, {"same": J @ [1.0, 0.0, 2.0], "nothing": np.zeros(N)}) == []


def test_correlated_residuals_are_worth_less():
    residual, cov, _ = fitted(RNG.normal(size=N))
    whole, quarter = (score_effects(residual, J, cov, {"e": EFFECT}, worth)[0] for worth in (1.0, 0.25))
    assert quarter.sd == pytest.approx(2 * whole.sd)
    assert quarter.size == whole.size


@pytest.mark.parametrize(("left", "tested"), [(0.9e-4, False), (1.1e-4, True)])
def test_an_effect_is_tested_of_which_the_parameters_leave_a_ten_thousandth(left, tested):
    direction = np.linalg.qr(np.column_stack([J, RNG.normal(size=N)]))[0]
    inside, outside = J[:, 0] / np.linalg.norm(J[:, 0]), direction[:, 3]
    signature = np.sqrt(1 - left) * inside + np.sqrt(left) * outside
    found = score_effects(outside, J, np.linalg.inv(J.T @ J), {"effect": signature})
    assert len(found) == tested
    assert all(one.size == pytest.approx(1 / np.sqrt(left), rel=1e-6) for one in found)
