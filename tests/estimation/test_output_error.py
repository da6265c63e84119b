from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError
from seatrial.estimation.posterior.output_error import _check_even, output_error
from seatrial.estimation.simulation.sensor_errors import Sensor
from tests.cases import TRUTH, U0, naive_rk4, paper_model, surge_rate
from tests.estimation_cases import SIGMA, golden_motion, make_trial, naive_midpoint, naive_speed

RNG = np.random.default_rng(11)
N = 60
TIME = np.cumsum(RNG.uniform(0.02, 0.3, N))
"""Uneven on purpose."""
EVEN = 0.1 * np.arange(N)
REV = RNG.uniform(-5, 20, N)
NOISE = {"sigma_u": 0.05, "sigma_udot": 0.02}
VALUES = {**TRUTH, **NOISE}
COLOURED = {**VALUES, "tau_u": 0.4, "tau_udot": 1.5}
SHIFTED = {"X_u": -1.5, "X_uabsu": -2.5, "T_nabsn": 0.9 * TRUTH["T_nabsn"]}


def trial(time=TIME, seed=0, gaps=(), channels=("u", "udot"), label="trial"):
    """Noisy record of both channels; `gaps` are rows without u."""
    rng = np.random.default_rng(seed)
    speed = naive_speed(REV, np.diff(time))
    measured = {"u": speed + 0.05 * rng.normal(size=N), "udot": surge_rate(speed, REV) + 0.02 * rng.normal(size=N)}
    measured["u"][list(gaps)] = np.nan
    return make_trial(time, REV, label, **{name: measured[name] for name in channels})


def residuals(record, start=U0, rev=None, **coefficients):
    """Measured minus simulated, both channels, by the plain loop; thrust in N/(rev/s)^2."""
    rev = REV if rev is None else rev
    speed = naive_speed(rev, np.diff(record.time), start, **coefficients)
    return {"u": record.channel("u") - speed, "udot": record.channel("udot") - surge_rate(speed, rev, **coefficients)}


def white(residual, sd):
    return stats.norm(0, sd).logpdf(residual[np.isfinite(residual)]).sum()


def coloured(residual, time, sd, tau):
    """Dense multivariate normal of the samples that are there."""
    there = np.isfinite(residual)
    cov = sd**2 * np.exp(-np.abs(np.subtract.outer(time[there], time[there])) / tau)
    return stats.multivariate_normal(cov=cov).logpdf(residual[there])


def sensors(channels=("u", "udot"), **settings):
    return [Sensor(channel, **settings) for channel in channels]


def made(records, channels=("u", "udot"), initial=((U0,),), noise="white", **options):
    return output_error(paper_model(), records, sensors(channels, noise=noise), initial, **options)


def log_likelihood(records, values, channels=("u", "udot"), initial=((U0,),), **options):
    likelihood, data = made(records, channels, initial, **options)
    return float(evaluate(likelihood, {name: float(value) for name, value in values.items()}, data))


@partial(jax.jit, static_argnums=0)
def evaluate(likelihood, values, data):
    return likelihood(values, data)


GAPS = {"complete": (), "first": (0, 1), "middle": (20, 21, 22, 40), "last": (59,), "most": range(3, 58)}
each_gap = pytest.mark.parametrize("gaps", GAPS.values(), ids=GAPS)


@each_gap
def test_white_residuals(gaps):
    record = trial(gaps=gaps)
    naive = residuals(record)
    expected = sum(white(naive[name], NOISE[f"sigma_{name}"]) for name in ("u", "udot"))
    assert log_likelihood([record], VALUES) == pytest.approx(expected, abs=1e-9)


@each_gap
@pytest.mark.parametrize("time", [TIME, EVEN], ids=["uneven", "even"])
def test_coloured_residuals(time, gaps):
    record = trial(time, gaps=gaps)
    naive = residuals(record)
    expected = coloured(naive["u"], time, 0.05, 0.4) + coloured(naive["udot"], time, 0.02, 1.5)
    assert log_likelihood([record], COLOURED, noise="coloured") == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("tau", [1e-3, 0.1, 10.0, 1e5])
def test_coloured_residuals_from_nearly_white_to_nearly_constant(tau):
    record = trial(channels=("u",), gaps=(5, 6))
    naive = record.channel("u") - naive_speed(REV, np.diff(TIME))
    found = log_likelihood([record], {**VALUES, "tau_u": tau}, ("u",), noise="coloured")
    assert found == pytest.approx(coloured(naive, TIME, 0.05, tau), rel=1e-8)


def test_one_channel_of_two():
    record = trial()
    naive = residuals(record)
    assert log_likelihood([record], VALUES, ("udot",)) == pytest.approx(white(naive["udot"], 0.02), abs=1e-9)


def test_exact_solution_of_the_equation():
    """Against scipy's integrator at tight tolerance, so that the step itself, and not only its coding, is checked."""
    from scipy.integrate import solve_ivp

    rev = 12.5 + 5 * np.sign(np.sin(EVEN))
    speed = [U0]
    for n in rev[:-1]:
        leg = solve_ivp(lambda t, u, n=n: surge_rate(u, n), (0, 0.1), [speed[-1]], rtol=1e-12, atol=1e-13)
        speed.append(leg.y[0, -1])
    record = make_trial(EVEN, rev, u=np.array(speed) + 0.05 * np.random.default_rng(1).normal(size=N))
    expected = white(record.channel("u") - speed, 0.05)
    assert log_likelihood([record], VALUES, ("u",)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("colour", ["white", "coloured"])
def test_trials_add_up(colour):
    records = [trial(seed=1, gaps=(3,), label="a"), trial(EVEN, seed=2, label="b"), trial(seed=3, label="c")]
    starts = [(U0,), (1.2,), (0.4,)]
    alone = [
        log_likelihood([record], COLOURED, initial=[start], noise=colour)
        for record, start in zip(records, starts, strict=True)
    ]
    together = log_likelihood(records, COLOURED, initial=starts, noise=colour)
    assert together == pytest.approx(sum(alone), abs=1e-9)
    assert alone[1] != pytest.approx(log_likelihood([records[1]], COLOURED, noise=colour), abs=1)


def test_free_initial_speed_of_each_trial():
    records = [trial(seed=1, label="out"), trial(EVEN, seed=2, label="back")]
    values = {**VALUES, "u_0[out]": 1.1, "u_0[back]": 1.8}
    expected = 0.0
    for record, start in zip(records, (1.1, 1.8), strict=True):
        naive = residuals(record, start)
        expected += white(naive["u"], 0.05) + white(naive["udot"], 0.02)
    found = log_likelihood(records, values, initial=[(9.0,), (9.0,)], free_initial=True)
    assert found == pytest.approx(expected, abs=1e-9)


def delayed_command(delay, step=0.1):
    """Mean of the held command over each step, `delay` ago, from its integral; held at its first value before."""
    edges = np.append(EVEN, EVEN[-1] + step)
    integral = np.concatenate([[0.0], np.cumsum(REV * step)])

    def total(t):
        return np.where(t < 0, REV[0] * t, np.interp(t, edges, integral))

    return (total(EVEN + step - delay) - total(EVEN - delay)) / step


@pytest.mark.parametrize("delay", [0.0, 0.04, 0.1, 0.25, 0.4999, 0.5, 5.83, 99.0])
def test_delay(delay):
    record = trial(EVEN)
    naive = residuals(record, rev=delayed_command(delay))
    expected = white(naive["u"], 0.05) + white(naive["udot"], 0.02)
    found = log_likelihood([record], {**VALUES, "delay": delay}, delay=True)
    assert found == pytest.approx(expected, abs=1e-8)


def test_delay_needs_an_even_step():
    with pytest.raises(InputError, match="uniform step") as caught:
        output_error(paper_model(), [trial()], ["u"], [(U0,)], delay=True)
    assert "import the record with a fixed `step`" in caught.value.remedy


def test_missing_channel():
    with pytest.raises(InputError, match='no channel "udot"'):
        output_error(paper_model(), [trial(channels=("u",))], ["udot"], [(U0,)])


DIVERGING = [{"X_uabsu": 400.0}, {"X_u": 1e4, "X_uabsu": 0.0}, {"X_u": float("nan")}, {"sigma_u": 0.0}]


@pytest.mark.parametrize("colour", ["white", "coloured"])
@pytest.mark.parametrize("change", DIVERGING, ids=str)
@pytest.mark.parametrize("gaps", [(), range(3, 58)], ids=["complete", "gaps"])
def test_divergence_is_minus_infinity(change, gaps, colour):
    found = log_likelihood([trial(gaps=gaps, channels=("u",))], {**COLOURED, **change}, ("u",), noise=colour)
    assert found == -np.inf


@pytest.mark.parametrize("options", [{}, {"noise": "coloured"}, {"delay": True}, {"free_initial": True}], ids=str)
def test_batch_equals_loop(options):
    rng = np.random.default_rng(5)
    likelihood, data = made([trial(EVEN, gaps=(4, 5))], **options)
    values = {**COLOURED, "delay": 0.17, "u_0[trial]": 1.4}
    batch = {name: value * rng.uniform(0.9, 1.1, 6) for name, value in values.items()}
    together = jax.vmap(lambda v: evaluate(likelihood, v, data))(batch)
    alone = [evaluate(likelihood, {name: value[i] for name, value in batch.items()}, data) for i in range(6)]
    assert np.allclose(together, alone, rtol=1e-12)


@pytest.mark.parametrize("options", [{}, {"noise": "coloured"}, {"delay": True}, {"free_initial": True}], ids=str)
def test_forward_derivatives(options):
    likelihood, data = made([trial(EVEN, gaps=(4, 5))], **options)
    values = {**COLOURED, **SHIFTED, "delay": 0.17, "u_0[trial]": 1.4}
    centre = jnp.array(list(values.values()))
    scaled = jax.jit(lambda r: likelihood(dict(zip(values, r * centre, strict=True)), data))
    slope = jax.jacfwd(scaled)(jnp.ones(centre.size))
    for i, h in enumerate(1e-6 * np.eye(centre.size)):
        assert float(slope[i]) == pytest.approx(float(scaled(1 + h) - scaled(1 - h)) / 2e-6, rel=1e-5, abs=1e-3)


@pytest.mark.parametrize("colour", ["white", "coloured"])
def test_derivatives_where_it_diverges_are_finite(colour):
    likelihood, data = made([trial()], ("u",), noise=colour)
    value, slope = jax.jvp(lambda x: likelihood({**COLOURED, "X_uabsu": x}, data), (400.0,), (1.0,))
    assert value == -np.inf
    assert np.isfinite(slope)


def test_golden_log_likelihood():
    """7001.011008 was computed with the midpoint rule; RK4 is closer to the equation, which adds 3.65e-4."""
    time, rev, speed = golden_motion()
    k = np.arange(6000)
    measured = speed + SIGMA * np.sqrt(2) * np.sin((1.3 * k**2) % (2 * np.pi))
    midpoint, fourth_order = (
        white(measured - naive_speed(rev, np.full(6000, 0.01), method=method), SIGMA)
        for method in (naive_midpoint, naive_rk4)
    )
    found = log_likelihood([make_trial(time, rev, u=measured)], {**TRUTH, "sigma_u": SIGMA}, ("u",))
    assert speed.sum() == pytest.approx(9444.227220583, abs=1e-6)
    assert midpoint == pytest.approx(7001.011008, abs=1e-6)
    assert found == pytest.approx(fourth_order, abs=1e-7)
    assert found - midpoint == pytest.approx(3.65e-4, abs=1e-6)


def test_trials_of_the_same_label():
    with pytest.raises(InputError, match="a different label for each"):
        output_error(paper_model(), [trial(), trial()], ["u"], [(U0,)] * 2, free_initial=True)


@pytest.mark.parametrize(("change", "even"), [(0.0, True), (2e-7, True), (1e-5, False), (-1e-5, False)])
def test_a_delay_needs_steps_that_differ_by_less_than_a_millionth(change, even):
    """Of 0.02 s each, of which one is longer or shorter by a share."""
    time = 5.0 + 0.02 * np.arange(50) + 0.02 * change * (np.arange(50) > 20)
    record = make_trial(time, np.full(50, 10.0), u=np.linspace(1.0, 1.5, 50))
    if even:
        _check_even(record, "the delay is a parameter")
    else:
        with pytest.raises(InputError, match="uniform step"):
            _check_even(record, "the delay is a parameter")
