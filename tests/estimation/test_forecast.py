"""Forecasts by a filter of motion, force and sensor errors, against the joint normal distribution of a linear case."""

import jax
import numpy as np
import pytest
import scipy

from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.prediction.forecast import Forecaster, make_forecaster
from seatrial.estimation.prediction.linear_filter import errors_over, without_memory
from seatrial.estimation.prediction.prediction import offsets_at_zero
from seatrial.estimation.priors import LogUniform, Normal
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation

STEP, N = 0.5, 60
DRAG, GAIN = -0.3, 0.5
ERRORS = {
    "sigma_u": 0.02, "drift_u": 0.05, "drift_time_u": 6.0, "disturbance_X": 0.1, "disturbance_time_X": 4.0, "process_u": 0.0,
}  # fmt: skip
FIRST_SD, HELD = 0.2, 2.0  # of the start, and time between changes of the command, s
SURGE = axes_vehicle("surge", [axis_equation("X", ["X_u", "X_tau_X"])])
PRIORS = {"X_u": Normal(DRAG, 0.1), "X_tau_X": Normal(GAIN, 0.1), "sigma_u": LogUniform(1e-3, 1.0)}
CHANNELS = (Channel("tau_X", "N", "control"), Channel("u", "m/s", "measurement"))


def joint(force):
    """Mean and covariance of all measurements, by exact steps of state, force and sensor error under every unit noise."""
    fades = np.array([DRAG, -1 / ERRORS["disturbance_time_X"], -1 / ERRORS["drift_time_u"]])
    rates = np.diag(fades)
    rates[0, 1] = 1.0
    level = np.array([ERRORS["process_u"], *(np.sqrt(2 * -fades[1:]) * [ERRORS["disturbance_X"], ERRORS["drift_u"]])])
    over = scipy.linalg.expm(rates * STEP)
    # Van Loan 1978: the covariance that a step adds.
    both = scipy.linalg.expm(np.block([[-rates, np.diag(level**2)], [np.zeros((3, 3)), rates.T]]) * STEP)
    added = np.linalg.cholesky(over @ both[:3, 3:])
    state = np.zeros((3, 3 + 3 * N + N))
    state[:, :3] = np.diag([FIRST_SD, ERRORS["disturbance_X"], ERRORS["drift_u"]])
    mean, rows, means = 0.0, [], []
    for k in range(N):
        row = state[0] + state[2]
        row[3 + 3 * N + k] = ERRORS["sigma_u"]
        rows.append(row.copy())
        means.append(mean)
        state = over @ state
        state[:, 3 + 3 * k : 6 + 3 * k] += added
        mean = np.exp(DRAG * STEP) * mean + GAIN * force[k] * np.expm1(DRAG * STEP) / DRAG
    rows = np.array(rows)
    return np.array(means), rows @ rows.T


@pytest.fixture(scope="module")
def surge():
    random = np.random.default_rng(2)
    force = np.repeat(random.normal(size=N // 4), 4)
    mean, cov = joint(force)
    measured = mean + np.linalg.cholesky(cov) @ random.standard_normal(N)
    measured[7:10] = np.nan
    record = make_record(np.arange(N) * STEP, {"tau_X": force, "u": measured}, CHANNELS, Provenance("own", ""), "1")
    return record, mean, cov, make_posterior(SURGE, record, PRIORS, start={"u": 0.0})


def test_forecasts_are_those_of_the_joint_normal_distribution(surge):
    record, mean, cov, posterior = surge
    draws = {"X_u": np.full(2, DRAG), "X_tau_X": np.full(2, GAIN), "sigma_u": np.full(2, 0.02)}
    begins, steps = [5, 9, 30, 50], 12
    ahead = Forecaster(posterior, draws, (ERRORS,), {"u": FIRST_SD}).forecast(record, begins, steps, start={"u": 0.0})
    for place, begin in enumerate(begins):
        seen = np.flatnonzero(np.isfinite(record.channel("u")[: begin + 1]))
        later = np.arange(begin + 1, min(begin + 1 + steps, N))
        gain = np.linalg.solve(cov[np.ix_(seen, seen)], cov[np.ix_(seen, later)]).T
        expected = mean[later] + gain @ (record.channel("u")[seen] - mean[seen])
        variance = np.diag(cov[np.ix_(later, later)] - gain @ cov[np.ix_(seen, later)])
        np.testing.assert_allclose(ahead.mean[place, : later.size, 0], expected, atol=2e-4)
        np.testing.assert_allclose(ahead.sd[place, : later.size, 0], np.sqrt(variance), rtol=1e-3)
    assert np.isnan(ahead.mean[-1, -1])
    assert np.isnan(ahead.measured[-1, -1])


def test_what_was_forecast_better_before_has_the_weight(surge):
    """Errors that are a hundred times too large lose it to the right ones, though they come first."""
    record, _, _, posterior = surge
    draws = {"X_u": np.full(2, DRAG), "X_tau_X": np.full(2, GAIN), "sigma_u": np.full(2, 0.02)}
    wide = ERRORS | {"drift_u": 5.0, "disturbance_X": 10.0}
    both, right = (
        Forecaster(posterior, draws, sets, {"u": FIRST_SD}).forecast(record, [2, 40], 5, start={"u": 0.0})
        for sets in ((wide, ERRORS), (ERRORS,))
    )
    np.testing.assert_allclose(both.mean[1], right.mean[1], rtol=1e-2)
    assert (both.sd[0] > 5 * right.sd[0]).all()


def test_another_estimate_that_forecast_better_before_has_the_weight(surge):
    """Draws of half the gain lose it to the right coefficients, which are not among them."""
    record, _, _, posterior = surge
    right = {"X_u": DRAG, "X_tau_X": GAIN}
    draws, wrong = (
        {"X_u": np.full(2, DRAG), "X_tau_X": np.full(2, gain), "sigma_u": np.full(2, 0.02)} for gain in (GAIN, 0.1)
    )
    both, alone, expected = (
        Forecaster(posterior, table, (ERRORS,), {"u": FIRST_SD}, others).forecast(record, [40], 5, start={"u": 0.0})
        for table, others in ((wrong, (right,)), (wrong, ()), (draws, ()))
    )
    off, without = (np.abs(one.mean - expected.mean).max() for one in (both, alone))
    assert off < 0.1 * without


def test_errors_are_found_by_which_held_values_are_beaten(surge):
    record, _, _, posterior = surge
    draws = {"X_u": np.full(2, DRAG), "X_tau_X": np.full(2, GAIN), "sigma_u": np.full(2, 0.02)}
    forecaster = make_forecaster(posterior, draws, 3.0, {"u": FIRST_SD})
    ahead = forecaster.forecast(record, np.arange(10, N - 6), 6, start={"u": 0.0}, key=jax.random.key(1))
    held = ahead.measured - record.channel("u")[ahead.begins][:, None, None]
    left = ahead.measured - ahead.mean
    assert np.nanmean(left**2) < 0.5 * np.nanmean(held**2)
    assert 0.7 < np.nanmean((left / ahead.sd) ** 2) < 1.5


def test_a_constant_force_that_may_be_zero_is_zero_on_another_day():
    """The others are where the joint normal distribution has them given that; one that is clearly not zero stays."""
    cov = np.array([[0.04, 0.03, 0.01], [0.03, 0.09, 0.02], [0.01, 0.02, 0.01]])
    drawn = np.random.default_rng(1).multivariate_normal([0.1, -1.0, 0.5], cov, 200_000).T
    draws = dict(zip(("X_0", "X_u", "N_0"), drawn, strict=True))
    moved = offsets_at_zero(draws)
    assert moved["X_0"].mean() == pytest.approx(0.0, abs=1e-9)
    assert moved["X_0"].std() == pytest.approx(0.2, rel=0.01)
    assert moved["X_u"].mean() == pytest.approx(-1.0 - 0.03 / 0.04 * 0.1, abs=0.005)
    assert moved["N_0"].mean() == pytest.approx(0.5 - 0.01 / 0.04 * 0.1, abs=0.005)
    assert offsets_at_zero({"X_0": draws["X_0"] + 1.0})["X_0"].mean() == pytest.approx(1.1, abs=0.005)


def test_errors_of_each_trial_fade_over_its_own_steps(surge):
    """A shorter trial that is filled up with no time, beside one of other steps."""
    simulator = without_memory(surge[3].likelihood.output.simulator)
    rows = {name: np.array([value, 2.0 * value]) for name, value in ERRORS.items()}
    steps = np.array([[0.5, 0.2], [0.5, 0.4], [0.0, 0.2]])
    together = errors_over(simulator, rows, steps)
    for place in range(2):
        alone = errors_over(simulator, rows, steps[:, [place]])
        for name in ("memory", "gained", "mean", "with_gained", "apart", "process"):
            np.testing.assert_array_equal(getattr(together, name)[:, place], getattr(alone, name)[:, 0])
    times = [ERRORS["disturbance_time_X"], ERRORS["drift_time_u"]]
    np.testing.assert_allclose(together.memory[:, 1, 0], np.exp(-steps[:, 1:] / times), rtol=1e-12)
    assert (together.gained[2, 0] == 0.0).all()
