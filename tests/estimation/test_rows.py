"""Whitened rows: covariance against a naive Jacobian, least squares against a dense textbook one, errors that are what they say."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.estimation.regression.row_fit import fit_rows, independent_rows
from seatrial.estimation.regression.rows import check_regressors, row_covariances, solve, whitened_rows
from seatrial.estimation.regression.weak_form import RawRows, pointwise_trials, raw_rows, weak_trials
from seatrial.vehicles.axis_equation import axis_equation
from tests.cases import U0
from tests.estimation.row_cases import (
    RUDDER,
    SHIP,
    SHIP_EQUATIONS,
    SHIP_TRUE,
    SURGE,
    TRUE,
    driven_ship,
    noisy_surge,
    rudder_of,
    ship_motion,
    ship_record,
    surge_record,
)
from tests.estimation_cases import SIGMA, make_trial

TIME = np.arange(0.0, 9.0, 0.05)
CROSSED = (
    axis_equation("Y", ("Y_v", "Y_vabsr", "Y_rdot", "Y_delta_r"), 3.0, known={"Y_r": 0.4}),
    axis_equation("N", ("N_vr", "N_r", "N_delta_r")),
)
VALUES = {"Y_v": -0.7, "Y_vabsr": 0.5, "Y_rdot": 0.2, "Y_delta_r": 1.0, "N_vr": 0.4, "N_r": -0.6, "N_delta_r": -0.2}


def dense(band):
    lower = sum(np.diag(band[k, : band.shape[1] - k], -k) for k in range(len(band)))
    return lower + np.tril(lower, -1).T


def residual(equations, trial):
    raw = raw_rows(equations, trial)
    return raw.target - raw.design @ np.array(list(VALUES.values()))


def test_covariance_is_that_of_a_naive_jacobian():
    """Move every sample of every sensor by a little and see how the residuals move."""
    trial = weak_trials([ship_record(TIME, ship_motion(TIME) + 0.1)], CROSSED, 1.5)[0]
    noise = {"v": 1e-4, "r": 3e-4}
    expected = np.zeros((2, trial.windows.centre.size, trial.windows.centre.size))
    for name, sd in noise.items():
        for sample in range(TIME.size):
            moved = []
            for sign in (1, -1):
                column = trial.signals[name].copy()
                column[sample] += sign * sd
                moved.append(residual(CROSSED, replace(trial, signals={**trial.signals, name: column})))
            slope = (moved[0] - moved[1]) / 2
            expected += slope[:, :, None] * slope[:, None, :]
    for found, naive in zip(row_covariances(CROSSED, trial, VALUES, noise), expected, strict=True):
        assert dense(found.sensors) == pytest.approx(naive, abs=1e-6 * naive.max())


def test_two_axes_are_a_dense_regression_with_both_covariances():
    rng = np.random.default_rng(3)
    record = ship_record(TIME, ship_motion(TIME) + 0.002 * rng.normal(size=(TIME.size, 2)))
    trials = weak_trials([record], SHIP_EQUATIONS, 1.0, overlap=False)
    rows = whitened_rows(SHIP_EQUATIONS, trials, {"v": 0.002, "r": 0.002})
    m = trials[0].windows.centre.size
    factors = [np.tril(dense(factor)) for factor in rows.factors[0]]
    blocks = np.block([[factors[0], np.zeros((m, m))], [np.zeros((m, m)), factors[1]]])
    cov = blocks @ np.kron(rows.mixing @ rows.mixing.T, np.eye(m)) @ blocks.T
    raw = raw_rows(SHIP_EQUATIONS, trials[0])
    phi, y = raw.design.reshape(2 * m, -1), raw.target.ravel()
    precision = phi.T @ np.linalg.solve(cov, phi)
    values, spread = solve(rows.design, rows.target)
    assert values == pytest.approx(np.linalg.solve(precision, phi.T @ np.linalg.solve(cov, y)), rel=1e-6)
    assert spread == pytest.approx(np.linalg.inv(precision), rel=1e-6)
    left = (rows.target - rows.design @ values).reshape(2, m)
    assert left @ left.T / (m - 3) == pytest.approx(np.eye(2), abs=1e-3)


def test_samples_are_plain_least_squares():
    rng = np.random.default_rng(1)
    u, rev = U0 + 0.3 * rng.normal(size=400), 12.5 + 2 * rng.normal(size=400)
    n = 2 * np.pi * rev
    rate = (-1.2 * u + 0.05 * n * np.abs(n)) / 30 + 0.01 * rng.normal(size=400)
    equation = axis_equation("X", ("X_u", "T_nabsn"), 30.0)
    trials = pointwise_trials([make_trial(np.arange(400) * 0.1, rev, u=u, udot=rate)], [equation])
    fit = fit_rows(whitened_rows([equation], trials, {"u": 0.0, "udot": 0.02}))
    phi = np.column_stack([u, n * np.abs(n)])
    values, ss, *_ = np.linalg.lstsq(phi, 30 * rate, rcond=None)
    assert fit.values == pytest.approx(values, rel=1e-9)
    assert fit.cov == pytest.approx(ss[0] / 398 * np.linalg.inv(phi.T @ phi), rel=1e-6)


def golden_scores(width, seeds):
    values, z = [], []
    for seed in range(seeds):
        trial = noisy_surge(width, seed)
        fit = fit_rows(whitened_rows(SURGE, [trial], {"u": SIGMA}))
        values.append(fit.values)
        z.append((fit.values - TRUE) / fit.sd)
    return np.array(values), np.array(z)


def check_golden(values, z):
    """Bias of X_u under a quarter of its sd where samples have a dozen sds, and scores of about unit variance."""
    seeds = len(z)
    assert np.all(np.abs(z.mean(0)) < 0.25 + 3 / np.sqrt(seeds))
    assert np.all(np.abs(z.std(0) - 1) < 3 / np.sqrt(2 * seeds) + 0.05)
    assert values[:, 0].std() == pytest.approx(0.108, rel=3 / np.sqrt(2 * seeds))


def test_golden_surge_coefficients_are_nearly_unbiased_with_honest_errors():
    """Output error, which uses everything the record tells, has an sd of X_u of 0.103."""
    check_golden(*golden_scores(2.0, 30))


@pytest.mark.proof
@pytest.mark.parametrize("width", [0.5, 1.0, 2.0, 5.0])
def test_golden_surge_over_widths(width):
    check_golden(*golden_scores(width, 120))


def test_white_forces_are_found_and_errors_count_them():
    time = np.arange(0.0, 60.0, 0.1)
    scores, found = [], []
    for seed in range(10):
        trials = weak_trials([ship_record(time, driven_ship(time, seed, 0.004))], SHIP_EQUATIONS, 2.0)
        rows = whitened_rows(SHIP_EQUATIONS, trials, {"v": 0.001, "r": 0.001})
        fit = fit_rows(rows)
        scores.append((fit.values - SHIP_TRUE) / fit.sd)
        found.append([*rows.force_sd, rows.correlation[0, 1]])
    assert np.mean(found, axis=0) == pytest.approx([0.004, 0.004, -0.6], rel=0.15)
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.4)


def test_coloured_forces_are_noticed_and_wider_windows_taken():
    time, rng = np.arange(0.0, 400.0, 0.1), np.random.default_rng(2)
    force, states, slow = np.zeros(2), [np.zeros(2)], np.exp(-0.1 / 3.0)
    for rudder, push in zip(rudder_of(time)[:-1], rng.normal(size=(time.size, 2)), strict=False):
        force = slow * force + 0.003 * np.sqrt(1 - slow**2) * push
        states.append(states[-1] + 0.1 * (SHIP @ states[-1] + RUDDER * rudder + force))
    record = ship_record(time, np.array(states) + 0.001 * rng.normal(size=(time.size, 2)))
    noise = {"v": 0.001, "r": 0.001}
    narrow = fit_rows(whitened_rows(SHIP_EQUATIONS, weak_trials([record], SHIP_EQUATIONS, 2.0), noise))
    assert "residuals of axis N are correlated" in narrow.status
    assert narrow.correlation.min() > 0.2
    assert narrow.effective.max() < 0.7 * 399
    rows, fit = independent_rows(SHIP_EQUATIONS, [record], noise, 2.0)
    assert fit.status == ""
    assert rows.trials[0].windows.centre[0] == pytest.approx(8.0), "three doublings of 2 s"
    assert np.all(np.abs(fit.values - SHIP_TRUE) < 4 * fit.sd)


def test_what_rows_cannot_be_made_of():
    trial = noisy_surge(2.0, 1)
    with pytest.raises(InputError, match=r'noise of channel "u"\n  found:    none given'):
        whitened_rows(SURGE, [trial], {})
    with pytest.raises(InputError, match="above zero"):
        whitened_rows(SURGE, [trial], {"u": 0.0})
    record = surge_record(1)
    twice = (axis_equation("X", ("X_u", "X_uabsu", "X_uu"), 30.0),)
    with pytest.raises(InputError, match=r"regressors of X_uabsu and X_uu with correlation \+1\.0000000000"):
        whitened_rows(twice, weak_trials([record], twice, 2.0), {"u": SIGMA})
    powers = (axis_equation("X", ("X_0", "X_u", "X_uu", "X_du2"), 30.0, trim={"u": U0}),)
    with pytest.raises(InputError, match=r"X_0, X_u, X_uu.* of which one is a combination"):
        whitened_rows(powers, weak_trials([record], powers, 2.0), {"u": SIGMA})
    still = make_trial(record.time, np.zeros(6000), u=record.channel("u"))
    with pytest.raises(InputError, match=r"(?s)term T_nabsn.*zero in every row"):
        whitened_rows(SURGE, weak_trials([still], SURGE, 2.0), {"u": SIGMA})


def test_two_rows_for_each_term_are_enough():
    rows = np.random.default_rng(0).normal(size=(1, 6, 3))
    check_regressors(SURGE, RawRows(rows, rows[..., 0]))
    with pytest.raises(InputError, match="5 rows for 3 terms"):
        check_regressors(SURGE, RawRows(rows[:, 1:], rows[:, 1:, 0]))
