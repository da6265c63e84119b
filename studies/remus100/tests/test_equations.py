"""Every equation of the study against formulas written out again here, in the printed units."""

import numpy as np
import pytest
from scipy import stats

from studies.remus100.tests.studies import A, B, study
from tests.cases import DEDUCTION, MASS, THRUST, U0, X_U, X_UU, surge_rate
from tests.estimation_cases import SIGMA, golden_noise, naive_doublets, naive_speed

U, REV_PER_S = 1.2 * U0, 1.1 * 12.5
COV = np.array([[2.0, 0.6, 0.1], [0.6, 1.0, -0.2], [0.1, -0.2, 0.5]])
THRUST_SI = THRUST / (2 * np.pi) ** 2


def log_likelihood():
    """Residuals at 97 % of the true coefficients, normal with 110 % of the true sigma, of data without the doubted term."""
    rev_per_s, step = naive_doublets(np.arange(6000) * 0.01, 200, 10), np.full(6000, 0.01)
    measured = naive_speed(rev_per_s, step) + golden_noise()
    fitted = naive_speed(rev_per_s, step, x_u=0.97 * X_U, x_uu=0.97 * X_UU, thrust=0.97 * THRUST)
    return stats.norm.logpdf(measured - fitted, 0, 1.1 * SIGMA).sum()


EXPECTED = {
    "du/dt [m/s^2]": surge_rate(U, REV_PER_S),
    "d(du/dt)/du [1/s], divided by m - X_udot": surge_rate(U + 1e-30j, REV_PER_S).imag / 1e-30,
    "d(du/dt)/dX_u": U / MASS,
    "d(du/dt)/dX_uabsu": U**2 / MASS,
    "d(du/dt)/dT_nabsn": (1 - DEDUCTION) * (2 * np.pi * REV_PER_S) ** 2 / MASS,
    "H = 1/2 ln((2 pi e)^n |P|) [nat]": stats.multivariate_normal(cov=COV).entropy(),
    "H = -E[log p] of a normal, by 200 000 draws [nat]": 0.5 * np.log((2 * np.pi * np.e) ** 3 * np.linalg.det(COV)),
    "gain = H(prior) - H(posterior) [nat]": -1.5 * np.log(0.3),
    "log prior density": -np.log([4 * 1.21, 4 * 2.93, 4 * THRUST_SI, 2 * SIGMA]).sum(),
}


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    data = study(tmp_path_factory.mktemp("equations")).part("equations")
    columns = (data[name].values for name in ("what", "ours", "independent"))
    return {str(what): pair for what, *pair in zip(*columns, strict=True)}


@pytest.mark.parametrize("what", EXPECTED)
def test_both_columns_are_right(rows, what):
    """The sampled entropy has a standard error of sqrt(3 / 2 / 200 000) = 0.003 nat."""
    ours, independent = rows[what]
    assert ours == pytest.approx(EXPECTED[what], rel=1e-9)
    assert independent == pytest.approx(EXPECTED[what], rel=1e-9, abs=4 * 0.003 if "draws" in what else 0)


def test_likelihood_by_a_plain_loop(rows):
    ours, independent = rows["log likelihood"]
    assert [ours, independent] == pytest.approx([log_likelihood()] * 2, rel=1e-9)


def test_every_row_is_tested(rows):
    assert set(rows) == {*EXPECTED, "log likelihood"}


def test_prior_scales_with_the_unit_of_thrust(tmp_path):
    """Under reading B only the width of the prior of T changes."""
    data = study(tmp_path, reading=B).part("equations")
    found = data["ours"].values[list(data["what"].values).index("log prior density")]
    shift = np.log(A.truth["T_nabsn"] / B.truth["T_nabsn"])
    assert found == pytest.approx(EXPECTED["log prior density"] + shift, rel=1e-9)
