"""Bias by noise in the regressors: its sign and size on the golden trial, and words where it matters."""

import jax
import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.estimation.regression.regressor_noise import LEVELS, _extrapolation, _solved, regressor_noise_bias
from seatrial.estimation.regression.rows import whitened_rows
from seatrial.estimation.regression.weak_form import pointwise_trials, weak_trials
from seatrial.vehicles.axis_equation import axis_equation
from tests.cases import surge_rate
from tests.estimation.row_cases import SHIP_EQUATIONS, SURGE, TRUE, driven_ship, exact_speed, noisy_surge, ship_record
from tests.estimation_cases import SIGMA, golden_motion, make_trial

TIME, REV, _ = golden_motion()


def pointwise(seed, u_sd):
    """Rows of measured accelerations: the fit that noise in u halves or doubles."""
    rng, u = np.random.default_rng(seed), exact_speed()
    rate = surge_rate(u, REV) + 0.01 * rng.normal(size=u.size)
    record = make_trial(TIME, REV, u=u + u_sd * rng.normal(size=u.size), udot=rate)
    return whitened_rows(SURGE, pointwise_trials([record], SURGE), {"u": u_sd, "udot": 0.01})


def test_a_quadratic_change_is_carried_on_to_less_noise_exactly():
    level = np.array(LEVELS)
    assert _extrapolation() @ (3.0 * level) == pytest.approx(-3.0)
    assert _extrapolation() @ level**2 == pytest.approx(1.0)


@pytest.mark.parametrize("u_sd", [0.02, SIGMA])
def test_sign_and_size_on_samples(u_sd):
    """True biases of X_u, in a fit whose weights differ little: -0.12 and -1.5, that is 4 and 27 of its standard errors."""
    found = [regressor_noise_bias(pointwise(seed, u_sd), jax.random.key(seed), pairs=4) for seed in range(4)]
    bias, actual = (
        np.mean(part, axis=0) for part in zip(*[(one.bias, one.values - TRUE) for one in found], strict=True)
    )
    assert bias[:2] == pytest.approx(actual[:2], abs=3 * np.max([one.sd[:2] for one in found]), rel=0.05)
    assert np.sign(bias[0]) < 0 < np.sign(bias[1])
    assert abs(bias[0]) > (1.3 if u_sd == SIGMA else 0.08)
    assert all("in the regressors biases X_u" in one.status for one in found)


def test_little_is_left_in_windows():
    """Over 200 seeds the mean of X_u is 0.015 ± 0.008 too high."""
    rows = whitened_rows(SURGE, [noisy_surge(1.0, 3)], {"u": SIGMA})
    found = regressor_noise_bias(rows, jax.random.key(0))
    assert found.bias[0] == pytest.approx(0.014, abs=0.006)
    assert np.abs(found.bias / found.sd).max() < 0.3
    assert found.error[0] < 0.003
    assert found.status == ""
    assert "screening" in found.verdict


def test_monte_carlo_error_is_what_repetitions_spread_by():
    rows = whitened_rows(SURGE, [noisy_surge(5.0, 3)], {"u": SIGMA})
    found = [regressor_noise_bias(rows, jax.random.key(seed), pairs=4) for seed in range(12)]
    spread = np.std([one.bias for one in found], axis=0, ddof=1)
    assert np.sqrt(np.mean([one.error**2 for one in found], axis=0)) == pytest.approx(spread, rel=0.7)


def test_the_error_of_two_pairs_is_half_of_what_they_differ_by():
    random = np.random.default_rng(7)
    slopes, right, scale = random.uniform(1.0, 2.0, (2, 1)), random.normal(size=(2, 1)), np.array([3.0])
    _, error = _solved(np.stack([slopes, right], -1), scale)
    assert error == pytest.approx(0.5 * abs(np.subtract(*(right / slopes / scale))))


def test_motion_that_no_control_made_is_named():
    """Damping comes out too small where a force that no term explains makes much of the motion."""
    time = np.arange(0.0, 120.0, 0.1)
    signs = []
    for seed in range(2):
        trials = weak_trials([ship_record(time, driven_ship(time, seed, 0.02))], SHIP_EQUATIONS, 2.0)
        rows = whitened_rows(SHIP_EQUATIONS, trials, {"v": 0.001, "r": 0.001})
        found = regressor_noise_bias(rows, jax.random.key(seed), pairs=8)
        signs.append(found.bias[[3, 4]])
        assert "unexplained motion" in found.status
        sensors = regressor_noise_bias(rows, jax.random.key(seed), pairs=2, forces=False)
        assert np.abs(sensors.bias / sensors.sd).max() < 0.1
    assert np.min(signs) > 0


def test_a_signal_of_noise_alone():
    """Speed that hardly moves cannot tell two forms of drag apart: noise is all by which they differ."""
    rng = np.random.default_rng(1)
    equation = axis_equation("X", ("X_u", "X_uabsu", "T_nabsn"), 30.0)
    u = 1.5 + 0.05 * rng.normal(size=2000)
    record = make_trial(np.arange(2000) * 0.05, np.full(2000, 12.0), u=u)
    rows = whitened_rows([equation], weak_trials([record], [equation], 1.0), {"u": 0.06})
    found = regressor_noise_bias(rows, jax.random.key(0))
    assert "cannot be estimated" in found.status
    assert np.isnan(found.bias).all()


def test_one_pair_has_no_error():
    rows = whitened_rows(SURGE, [noisy_surge(2.0, 3)], {"u": SIGMA})
    with pytest.raises(InputError, match="at least 2"):
        regressor_noise_bias(rows, jax.random.key(0), pairs=1)
