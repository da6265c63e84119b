"""Filter error: the marginal likelihood of the innovations, against dense covariance algebra and against output error."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.filter_error import filter_error
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from tests.cases import MASS, TRUTH, U0, paper_model, surge_rate
from tests.estimation.test_output_error import evaluate as compiled
from tests.estimation_cases import make_trial, naive_speed

RNG = np.random.default_rng(31)
N = 40
TIME = np.cumsum(RNG.uniform(0.05, 0.3, N))
REV = RNG.uniform(8, 17, N)
SPEED = naive_speed(REV, np.diff(TIME))
MEASURED = SPEED + 0.05 * RNG.normal(size=N)
VALUES = {**TRUTH, "sigma_u": 0.05, "process_u": 0.02}


def record(label="trial", u=MEASURED):
    return make_trial(TIME, REV, label, u=u)


def evaluate(likelihood, data, values):
    return float(compiled(likelihood, {name: jnp.asarray(float(x)) for name, x in values.items()}, data))


def log_likelihood(values, records=None, sensor="u", start=U0, initial_sd=0.05, **options):
    records = [record()] if records is None else records
    likelihood, data = filter_error(
        paper_model(), records, [sensor], [(start,)] * len(records), [initial_sd], **options
    )
    return evaluate(likelihood, data, values)


LINEAR = {**VALUES, "X_u": -20.0, "X_uabsu": 0.0}


def dense(u, q=0.02, sd=0.05, initial_sd=0.05, moments=False):
    """Log density, or mean and covariance, of the measurements; the linear vehicle's motion is u' = a u + b + noise."""
    step = np.diff(TIME)
    mean = naive_speed(REV, step, x_u=-20.0, x_uu=0.0)
    gain = [np.polyval([h**4 / 24, h**3 / 6, h**2 / 2, h, 1.0], -20.0 / 31.4) for h in step]
    cov = np.zeros((N, N))
    cov[0, 0] = initial_sd**2
    for k, (a, h) in enumerate(zip(gain, step, strict=True), start=1):
        cov[k, :k] = a * cov[k - 1, :k]
        cov[:k, k] = cov[k, :k]
        cov[k, k] = a * a * cov[k - 1, k - 1] + q * q * h
    there = np.isfinite(u)
    mean, cov = mean[there], (cov + sd**2 * np.eye(N))[np.ix_(there, there)]
    return (mean, cov) if moments else stats.multivariate_normal(mean, cov).logpdf(u[there])


@pytest.mark.parametrize("method", [{}, {"method": SquareRootUnscentedKalmanFilter()}], ids=["EKF", "SRUKF"])
@pytest.mark.parametrize("gaps", [(), (0, 1, 7, 20, 39)], ids=["complete", "gaps"])
def test_linear_vehicle_in_closed_form(gaps, method):
    u = MEASURED.copy()
    u[list(gaps)] = np.nan
    assert log_likelihood(LINEAR, [record(u=u)], **method) == pytest.approx(dense(u), abs=1e-8)


def test_without_process_noise_it_is_output_error():
    likelihood, data = output_error(paper_model(), [record()], ["u"], [(U0,)])
    values = {**VALUES, "process_u": 1e-9}
    assert log_likelihood(values, initial_sd=1e-9) == pytest.approx(evaluate(likelihood, data, values), abs=1e-5)


def test_trials_of_different_length_add_up():
    short = make_trial(TIME[:17], REV[:17], "short", u=MEASURED[:17])
    apart = log_likelihood(VALUES) + log_likelihood(VALUES, [short])
    assert log_likelihood(VALUES, [record(), short]) == pytest.approx(apart, abs=1e-9)


def test_bias_and_current_move_the_measurements():
    shifted = [record(u=MEASURED + 0.2)]
    plain = log_likelihood(VALUES)
    assert log_likelihood({**VALUES, "bias_u": 0.2}, shifted, Sensor("u", bias=True)) == pytest.approx(plain, abs=1e-9)
    options = {"current": True, "starts_over_ground": True, "start": U0 + 0.2}
    assert log_likelihood({**VALUES, "current": 0.2}, shifted, **options) == pytest.approx(plain, abs=1e-9)


def test_forward_derivatives():
    likelihood, data = filter_error(
        paper_model(), [record(u=np.where(RNG.random(N) < 0.3, np.nan, MEASURED))], ["u"], [(U0,)], [0.05]
    )
    names = list(VALUES)

    @jax.jit
    def value(x):
        return likelihood(dict(zip(names, x, strict=True)), data)

    at = jnp.array(list(VALUES.values()))
    slope = jax.jit(jax.jacfwd(value))(at)
    for i in range(len(names)):
        h = 1e-5 * abs(float(at[i]))
        numeric = (float(value(at.at[i].add(h))) - float(value(at.at[i].add(-h)))) / (2 * h)
        assert float(slope[i]) == pytest.approx(numeric, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("change", [{"X_uabsu": 4e4}, {"sigma_u": 0.0}, {"X_u": float("nan")}], ids=str)
def test_divergence_is_minus_infinity(change):
    assert log_likelihood({**VALUES, **change}) == -np.inf


def test_what_is_refused():
    for sensor, said in ((Sensor("u", lag=True), "a lag"), (Sensor("u", "coloured"), "coloured noise")):
        with pytest.raises(InputError, match=said):
            filter_error(paper_model(), [record()], [sensor], [(U0,)], [0.05])
    with pytest.raises(InputError, match="initial spread"):
        filter_error(paper_model(), [record()], ["u"], [(U0,)], [0.0])


def test_two_channels_of_one_state_in_closed_form():
    """Speed and acceleration, which is a u + b: their joint covariance is that of u, seen twice."""
    (mean, cov), slope = dense(MEASURED, moments=True, sd=0.0), -20.0 / MASS
    rate = surge_rate(mean, REV, x_u=-20.0, x_uu=0.0)
    shown = np.concatenate([MEASURED, rate + 0.1 * np.random.default_rng(3).normal(size=N)])
    joint = np.kron([[1.0, slope], [slope, slope**2]], cov) + np.diag(np.repeat([0.05**2, 0.1**2], N))
    likelihood, data = filter_error(
        paper_model(), [make_trial(TIME, REV, u=shown[:N], udot=shown[N:])], ["u", "udot"], [(U0,)], [0.05]
    )
    exact = stats.multivariate_normal(np.concatenate([mean, rate]), joint).logpdf(shown)
    assert evaluate(likelihood, data, {**LINEAR, "sigma_udot": 0.1}) == pytest.approx(exact, abs=1e-8)
