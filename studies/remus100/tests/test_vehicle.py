"""The longitudinal vehicle of Section II against hand-written forces, differenced and integrated by plain loops."""

import numpy as np
import pytest

from studies.remus100.tests.studies import study
from tests.cases import RPM, U0, naive_rk4
from tests.vehicles.test_longitudinal import forces, matrix_by_hand


def rate(x, control):
    u, w, q, _, theta = x
    body = np.linalg.solve(matrix_by_hand(), forces(u, w, q, theta, *control))
    return np.array([*body, w * np.cos(theta) - u * np.sin(theta), q])


def differences(f, x, h=1e-8):
    """Jacobian by central differences."""
    return np.column_stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))])


def motion(f, start):
    states = [np.asarray(start, float)]
    for _ in range(999):
        states.append(naive_rk4(f, states[-1], 0.01))
    return np.array(states)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return study(tmp_path_factory.mktemp("vehicle")).part("vehicle")


@pytest.fixture(scope="module")
def level(data):
    """Trim state and control, where the fin holds level flight."""
    trim = data["trim"].values
    return trim, np.array([125.0, _fin(trim)])


def _fin(trim):
    """Fin angle that balances the pitch moment, in which it is linear."""
    u, w, q, _, theta = trim
    moment = [forces(u, w, q, theta, 125.0, delta)[2] for delta in (0.0, 1.0)]
    return moment[0] / (moment[0] - moment[1])


def test_trim_is_an_equilibrium(level):
    assert np.abs(rate(*level)).max() < 1e-9


def test_linear_model_by_differences(data, level):
    """At q = 0 the differences of M_qabsq q |q| are off by 188 h / 8.33 = 2e-7."""
    trim, control = level
    by_state = differences(lambda x: rate(x, control), trim)
    by_control = differences(lambda c: rate(trim, c), control)
    np.testing.assert_allclose(data["a"], by_state, atol=1e-6)
    np.testing.assert_allclose(data["b"], by_control, atol=1e-6)
    found = data["eigenvalues"].values @ [1, 1j]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(np.linalg.eigvals(by_state)), abs=1e-5)


def test_motions_by_plain_loops(data, level):
    """10 s after n rose by 50 rpm: the whole vehicle, its linear model, and the surge model, which started from the same speed."""
    trim, control = level
    pushed = control + np.array([50 * RPM, 0.0])
    np.testing.assert_allclose(data["full"], motion(lambda x: rate(x, pushed), trim), atol=1e-9)
    a, b = data["a"].values, data["b"].values
    linear = motion(lambda x: a @ (x - trim) + b @ (pushed - control), trim)
    np.testing.assert_allclose(data["linear"], linear, atol=1e-7)
    thrust = 0.9 * 6.28e-4 * pushed[0] ** 2
    surge = motion(lambda u: (-1.21 * u - 2.93 * u * abs(u) + thrust) / 31.41, trim[:1])
    np.testing.assert_allclose(data["surge"], surge[:, 0], atol=1e-9)
    assert data.attrs["surge_trim"] == pytest.approx(U0, abs=1e-9)
