"""What sensors do to the motion they show: lag, bias, current, heavy tails, and values that differ between trials."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.simulation.sensor_errors import Sensor, lags_before
from tests.cases import TRUTH, U0, paper_model
from tests.estimation_cases import make_trial, naive_speed

RNG = np.random.default_rng(21)
N = 50
TIME = np.cumsum(RNG.uniform(0.05, 0.3, N))
REV = RNG.uniform(5, 20, N)
SPEED = naive_speed(REV, np.diff(TIME))
MEASURED = SPEED + 0.05 * RNG.normal(size=N)
VALUES = {**TRUTH, "sigma_u": 0.05}


def record(label="trial", u=MEASURED):
    return make_trial(TIME, REV, label, u=u)


def log_likelihood(sensor, values, records=None, starts=None, **options):
    records = [record()] if records is None else records
    likelihood, data = output_error(paper_model(), records, [sensor], starts or [(U0,)] * len(records), **options)
    return float(likelihood({name: jnp.asarray(float(value)) for name, value in values.items()}, data))


def normal(residual, sd=0.05):
    return stats.norm(0, sd).logpdf(residual[np.isfinite(residual)]).sum()


def test_bias_is_added():
    found = log_likelihood(Sensor("u", bias=True), {**VALUES, "bias_u": 0.2})
    assert found == pytest.approx(normal(MEASURED - SPEED - 0.2), abs=1e-9)


def lagged(tau):
    """The sensor's own differential equation along straight lines between the samples, by scipy."""
    shown = [SPEED[0]]
    for k in range(N - 1):
        line = np.poly1d(np.polyfit(TIME[k : k + 2], SPEED[k : k + 2], 1))
        leg = solve_ivp(lambda t, y, f=line: (f(t) - y) / tau, TIME[k : k + 2], [shown[-1]], rtol=1e-10, atol=1e-12)
        shown.append(leg.y[0, -1])
    return np.array(shown)


@pytest.mark.parametrize("tau", [0.1, 0.7, 5.0])
def test_lag(tau):
    found = log_likelihood(Sensor("u", lag=True), {**VALUES, "lag_u": tau})
    assert found == pytest.approx(normal(MEASURED - lagged(tau)), abs=1e-5)


def test_no_lag_to_speak_of():
    assert log_likelihood(Sensor("u", lag=True), {**VALUES, "lag_u": 1e-9}) == pytest.approx(normal(MEASURED - SPEED))


def test_lag_is_smooth_where_its_formula_changes():
    """Around r = 1e-4, and over a step of no length, as in the padding of shorter trials."""
    below, above = (lags_before(jnp.array([r, 1.0]), 1.0) for r in (0.999999e-4, 1.000001e-4))
    assert np.allclose([x[1] for x in below], [x[1] for x in above], rtol=1e-5, atol=1e-11)
    assert [float(x[1]) for x in lags_before(jnp.array([0.0, 1.0]), 1.0)] == [1.0, 0.0, 0.0]


def test_current_moves_what_is_measured_over_ground():
    values = {**VALUES, "current": 0.3}
    assert log_likelihood(Sensor("u"), values, current=True) == pytest.approx(normal(MEASURED - SPEED - 0.3), abs=1e-9)
    start = {"starts": [(U0 + 0.3,)], "starts_over_ground": True}
    found = log_likelihood(Sensor("u"), values, current=True, **start)
    assert found == pytest.approx(normal(MEASURED - SPEED - 0.3), abs=1e-9)


@pytest.mark.parametrize(
    ("sensor", "said"), [(Sensor("u", bias=True), "look alike"), (Sensor("u", over_ground=False), "over ground")]
)
def test_a_current_that_nothing_shows(sensor, said):
    with pytest.raises(InputError, match=said):
        output_error(paper_model(), [record()], [sensor], [(U0,)], current=True)


@pytest.mark.parametrize("dof", [1.5, 4.0, 80.0])
def test_heavy_tails(dof):
    wild = np.where(np.arange(N) % 17 == 3, np.nan, MEASURED + np.where(np.arange(N) % 11 == 2, 2.0, 0.0))
    residual = (wild - SPEED)[np.isfinite(wild)]
    found = log_likelihood(Sensor("u", "heavy"), {**VALUES, "dof_u": dof}, [record(u=wild)])
    assert found == pytest.approx(stats.t(dof, 0, 0.05).logpdf(residual).sum(), abs=1e-9)


def test_noise_in_proportion_to_the_signal():
    """Of the signal that is shown, its bias included, and not of the measured one: so the density integrates to one."""
    wild = np.where(np.arange(N) % 17 == 3, np.nan, MEASURED)
    here = np.isfinite(wild)
    shown = SPEED + 0.3
    sensor, values = Sensor("u", "proportional", bias=True), {**VALUES, "bias_u": 0.3, "share_u": 0.02}
    found = log_likelihood(sensor, values, [record(u=wild)])
    expected = stats.norm(shown, np.hypot(0.05, 0.02 * shown)).logpdf(wild)[here].sum()
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("channel", ["psi", "x", "q_w"])
def test_nothing_is_in_proportion_to_an_angle_or_a_place(channel):
    with pytest.raises(InputError, match="natural zero"):
        Sensor(channel, "proportional")


def test_own_values_of_each_trial():
    records = [record("a"), record("b", MEASURED + 0.4)]
    values = {**VALUES, "bias_u[a]": 0.1, "bias_u[b]": 0.5}
    found = log_likelihood(Sensor("u", bias=True), values, records, own=["bias_u"])
    assert found == pytest.approx(2 * normal(MEASURED - SPEED - 0.1), abs=1e-9)


def test_values_that_vary_between_trials():
    """Coefficients about a common one, and a bias about zero, each in units of its spread."""
    records = [record("a"), record("b"), record("c")]
    values = {**VALUES, "spread_X_u": 0.2, "spread_bias_u": 0.05}
    values |= {f"dev_X_u[{label}]": dev for label, dev in zip("abc", (-1.0, 0.0, 2.0), strict=True)}
    values |= {f"dev_bias_u[{label}]": dev for label, dev in zip("abc", (3.0, 0.0, -1.0), strict=True)}
    expected = 0.0
    for dev, bias in ((-1.0, 0.15), (0.0, 0.0), (2.0, -0.05)):
        speed = naive_speed(REV, np.diff(TIME), x_u=-1.21 + 0.2 * dev)
        expected += normal(MEASURED - speed - bias)
    found = log_likelihood(Sensor("u", bias=True), values, records, varying=["X_u", "bias_u"])
    assert found == pytest.approx(expected, abs=1e-9)


def test_parameters_of_a_sensor():
    assert Sensor("u").parameters == ("sigma_u",)
    assert Sensor("u", "coloured", bias=True).parameters == ("sigma_u", "tau_u", "bias_u")
    assert Sensor("u", "drifting").parameters == ("sigma_u", "drift_u", "drift_time_u")
    assert Sensor("u", "proportional").parameters == ("sigma_u", "share_u")
    assert Sensor("u", "heavy", lag=True).parameters == ("sigma_u", "dof_u", "lag_u")
