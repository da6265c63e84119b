"""Equation error: textbook least squares, what noise in the regressors does to it, and the refinement that undoes it."""

import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.regression.equation_error import (
    MAX_SHIFT_ERRORS,
    Accelerations,
    _complaint,
    _long_run,
    fit_equation_error,
    measured_accelerations,
    smoothed_accelerations,
)
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import TRUTH, paper_model, surge_rate
from tests.estimation_cases import SIGMA, golden_motion, make_trial, naive_speed

TIME, REV, SPEED = golden_motion()
RATE = surge_rate(SPEED, REV)
TRUE = np.array(list(TRUTH.values()))
MODEL = paper_model(*TRUTH)


def trial(u_sd, udot_sd=0.01, seed=1, label="trial"):
    rng = np.random.default_rng(seed)
    return make_trial(
        TIME, REV, label, u=SPEED + u_sd * rng.normal(size=6000), udot=RATE + udot_sd * rng.normal(size=6000)
    )


def fit(record, **options):
    return fit_equation_error(MODEL, [measured_accelerations(MODEL, record)], **options)


def test_plain_fit_is_textbook_least_squares():
    record = trial(0.02)
    u, n = record.channel("u"), record.channel("n")
    phi = np.column_stack([u, u * np.abs(u), 0.9 * n * np.abs(n)]) / 31.4
    expected, residual, *_ = np.linalg.lstsq(phi, record.channel("udot"), rcond=None)
    found = fit(record, refine=False)
    assert found.values == pytest.approx(expected, rel=1e-7)
    cov = residual[0] / (6000 - 3) * np.linalg.inv(phi.T @ phi)
    assert found.sd == pytest.approx(np.sqrt(np.diag(cov)), rel=1e-6)
    assert found.status == ""


@pytest.mark.parametrize(("u_sd", "published"), [(SIGMA, -2.69), (0.02, -1.33)])
def test_noise_in_the_speed_biases_the_plain_fit(u_sd, published):
    """X_u is -1.21; averages over 20 seeds, against numbers measured independently beforehand."""
    found = np.array([fit(trial(u_sd, seed=seed), refine=False).values for seed in range(20)])
    error = found[:, 0].std(ddof=1) / np.sqrt(20)
    assert found[:, 0].mean() == pytest.approx(published, abs=0.06 + 3 * error)
    assert fit(trial(u_sd), refine=False).sd[0] == pytest.approx(0.06 if u_sd == SIGMA else 0.03, abs=0.006)


@pytest.mark.parametrize("u_sd", [0.02, SIGMA])
def test_refined_fit_is_unbiased_and_says_so(u_sd):
    fits = [fit(trial(u_sd, seed=seed)) for seed in range(20)]
    values = np.array([one.values for one in fits])
    error = values.std(0, ddof=1) / np.sqrt(20)
    assert np.all(np.abs(values.mean(0) - TRUE) < 3 * error + 0.02 * np.abs(TRUE))
    assert all("noise in the speed biases" in one.status for one in fits if u_sd == SIGMA)
    if u_sd == SIGMA:  # as docs/how-to/likelihoods.md says of one trial
        assert (values[1, 0], fits[1].sd[0]) == pytest.approx((-1.15, 0.07), abs=0.006)


def test_without_noise_there_is_nothing_to_say():
    speed = naive_speed(REV, np.full(6000, 0.01))
    noise = 1e-3 * np.random.default_rng(3).normal(size=6000)
    found = fit(make_trial(TIME, REV, u=speed, udot=surge_rate(speed, REV) + noise))
    assert np.abs(found.values - TRUE).max() < 4 * found.sd.max()
    assert found.status == ""


def test_smoothed_speeds_of_a_noisy_trial():
    found = fit_equation_error(MODEL, [smoothed_accelerations(MODEL, trial(SIGMA), 1.0)])
    assert np.all(np.abs(found.values - TRUE) < 4 * found.sd)
    assert np.all(found.sd > 3 * fit(trial(SIGMA)).sd)
    plain = [smoothed_accelerations(MODEL, trial(SIGMA, seed=seed), 1.0) for seed in range(20)]
    drag = [fit_equation_error(MODEL, [one], refine=False).values[0] for one in plain]
    assert np.mean(drag) == pytest.approx(TRUE[0], abs=0.1), "without smoothing -2.69, see above"


def test_trials_are_fitted_jointly():
    apart = [measured_accelerations(MODEL, trial(0.0, seed=seed)) for seed in (1, 2)]
    both = fit_equation_error(MODEL, apart, refine=False)
    assert both.sd == pytest.approx(fit_equation_error(MODEL, apart[:1], refine=False).sd / np.sqrt(2), rel=0.05)


def test_regressors_that_cannot_be_told_apart():
    """A vehicle that never leaves its trim."""
    flat = np.full(50, 1.5)
    still = Accelerations("still", flat, 0.0 * flat, np.full((50, 1), 78.5), np.full(50, 0.1))
    with pytest.raises(NumericalError, match="proportional"):
        fit_equation_error(MODEL, [still])


def test_what_is_refused():
    with pytest.raises(InputError, match="unknown added mass"):
        fit_equation_error(whole_vehicle(Hull("free", 30.47), ("X_u", "X_udot"), moves=("u",)), [])
    gappy = trial(0.0).channel("u").copy()
    gappy[7] = np.nan
    with pytest.raises(InputError, match="gaps in u"):
        smoothed_accelerations(MODEL, make_trial(TIME, REV, u=gappy), 1.0)
    with pytest.raises(InputError, match="window"):
        smoothed_accelerations(MODEL, trial(0.0), 0.01)
    with pytest.raises(InputError, match='no channel "udot"'):
        measured_accelerations(MODEL, make_trial(TIME, REV, u=SPEED))


@pytest.mark.parametrize("memory", [1, 3])
def test_covariance_of_a_sum_of_correlated_scores_by_all_pairs(memory):
    """Pairs of samples at a distance of k count 1 - k / (memory + 1), or not at all (Newey and West, Econometrica 55, 1987)."""
    scores = np.random.default_rng(2).normal(size=(12, 2))
    expected = np.zeros((2, 2))
    for i in range(12):
        for j in range(12):
            expected += max(0.0, 1 - abs(i - j) / (memory + 1)) * np.outer(scores[i], scores[j])
    assert _long_run(scores, memory) == pytest.approx(expected, abs=1e-12)


def record_of(speed, step=0.02, jitter=0.0):
    """A record of so many speeds; the step of one sample in the middle differs by a share."""
    time = 3.0 + np.arange(speed.size) * step + jitter * step * (np.arange(speed.size) > speed.size // 2)
    return make_trial(time, np.full(speed.size, 10.0), u=speed)


@pytest.mark.parametrize(("jitter", "even"), [(0.0, True), (2e-7, True), (1e-5, False), (-1e-5, False)])
def test_sliding_windows_need_steps_that_differ_by_less_than_a_millionth(jitter, even):
    record = record_of(np.arange(40.0), jitter=jitter)
    if even:
        assert smoothed_accelerations(MODEL, record, 0.2).acceleration == pytest.approx(50.0, rel=1e-6)
    else:
        with pytest.raises(InputError, match="an uneven time step"):
            smoothed_accelerations(MODEL, record, 0.2)


@pytest.mark.parametrize(
    ("samples", "window", "fits"), [(40, 0.04, False), (40, 0.08, True), (21, 0.4, True), (20, 0.4, False)]
)
def test_window_holds_more_samples_than_a_cubic_and_no_more_than_there_are(samples, window, fits):
    """Five of 0.02 s in 0.08 s, three in 0.04 s, and 21 in 0.4 s."""
    speed = np.random.default_rng(2).normal(size=samples)
    if not fits:
        with pytest.raises(InputError, match=f"of {samples}"):
            smoothed_accelerations(MODEL, record_of(speed), window)
        return
    found, half = smoothed_accelerations(MODEL, record_of(speed), window), round(window / 0.04)
    assert found.speed.size == found.acceleration.size == found.control.shape[0] == samples - 2 * half
    at = 0.02 * np.arange(-half, half + 1)
    for i in (0, samples - 2 * half - 1):
        cubic = np.polyfit(at, speed[i : i + 2 * half + 1], 3)
        assert found.speed[i] == pytest.approx(cubic[3], abs=1e-9)
        assert found.acceleration[i] == pytest.approx(cubic[2], abs=1e-7)


def regressors(u, n):
    return np.column_stack([u, u * np.abs(u), 0.9 * n * np.abs(n)]) / 31.4


def test_refined_fit_has_the_regressors_of_its_own_motion_for_instruments():
    """c = (Z'F)^-1 Z'y and s^2 (Z'F)^-1 Z'Z (F'Z)^-1, F along the measured speed and Z along the motion of c, by a plain loop."""
    record = trial(0.02)
    found, u, n = fit(record), record.channel("u"), record.channel("n")
    x_u, x_uu, thrust = found.values * [1.0, 1.0, (2 * np.pi) ** 2]
    motion = naive_speed(REV, np.full(6000, 0.01), u[0], x_u=x_u, x_uu=x_uu, thrust=thrust)[:6000]
    f, z, y = regressors(u, n), regressors(motion, n), record.channel("udot")
    inverse = np.linalg.inv(z.T @ f)
    assert found.values == pytest.approx(inverse @ z.T @ y, rel=1e-3)
    residual = y - f @ found.values
    assert found.acceleration_sd == pytest.approx(np.sqrt(residual @ residual / 5997), rel=1e-6)
    assert found.sd == pytest.approx(found.acceleration_sd * np.sqrt(np.diag(inverse @ z.T @ z @ inverse.T)), rel=1e-3)
    assert found.plain_sd == pytest.approx(fit(record, refine=False).sd)


@pytest.mark.parametrize(("moved", "told"), [(0.99, False), (-0.99, False), (1.01, True), (-1.01, True)])
def test_a_bias_of_the_plain_fit_is_told_of_the_coefficient_that_moved_most(moved, told):
    plain, sd = np.array([-1.0, 5.0]), np.array([0.1, 0.3])
    said = _complaint(("a", "b"), plain, sd, plain + MAX_SHIFT_ERRORS * sd * [0.5, moved])
    assert bool(said) == told
    assert not told or "b comes out as 5 ± 0.3" in said


@pytest.mark.parametrize(("samples", "enough"), [(5, False), (6, True)])
def test_two_accelerations_for_each_coefficient_are_enough(samples, enough):
    u, rate, n = np.random.default_rng(4).normal([1.5, 0.0, 80.0], [0.3, 0.1, 9.0], (samples, 3)).T
    few = [Accelerations("few", u, rate, n[:, None], np.full(samples, 0.1))]
    if enough:
        assert np.isfinite(fit_equation_error(MODEL, few, refine=False).values).all()
    else:
        with pytest.raises(InputError, match="5 accelerations for 3 coefficients"):
            fit_equation_error(MODEL, few, refine=False)
