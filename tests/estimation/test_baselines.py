"""Baselines on runs that are simulated from exactly their own equations, by another integrator."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.prediction.baselines import BASELINES, fit_baselines
from seatrial.estimation.prediction.lag_response import CubicLag, Run, lag_response

UNITS = {"u": "m/s", "r": "rad/s", "n": "rad/s", "delta_r": "rad"}
LAG = {"T": 4.0, "K": 0.12, "b": 0.004, "d": 0.5}


def irregular_time(n=400, seed=0):
    return np.cumsum(np.random.default_rng(seed).uniform(0.05, 0.35, n)) - 0.05


def commands(time, seed=0, size=0.3, hold=20):
    levels = np.random.default_rng(100 + seed).normal(0.0, size, time.size // hold + 1)
    return np.repeat(levels, hold)[: time.size]


def record_of(time, controls, measurements, label="run"):
    channels = [Channel(name, UNITS[name], "control") for name in controls]
    channels += [Channel(name, UNITS[name], "measurement") for name in measurements]
    return make_record(time, {**controls, **measurements}, tuple(channels), Provenance("test", ""), label)


def integrated(rate, time, control, start, delay):
    """Solve dx/dt = rate(x, c(t - delay)) between the switches of the held control, to a tolerance far below any bound here."""
    switches = np.unique(np.concatenate([time, time + delay]))
    switches = switches[(switches >= time[0]) & (switches <= time[-1])]
    state, values = np.atleast_1d(np.asarray(start, float)), {time[0]: np.atleast_1d(np.asarray(start, float))}
    for begin, end in pairwise(switches):
        held = control[max(0, np.searchsorted(time, 0.5 * (begin + end) - delay, side="right") - 1)]
        found = solve_ivp(lambda _, x, c=held: rate(x, c), (begin, end), state, rtol=1e-9, atol=1e-12)
        state = found.y[:, -1]
        values[end] = state
    return np.array([values[t] for t in time])


def lag_run(seed=0, n=400, noise=0.0, start=0.02, truth=LAG):
    time = irregular_time(n, seed)
    control = commands(time, seed)
    yaw = integrated(lambda x, c: (truth["K"] * c + truth["b"] - x) / truth["T"], time, control, start, truth["d"])[
        :, 0
    ]
    return time, control, yaw + noise * np.random.default_rng(seed).normal(size=n)


def yaw_record(time, control, yaw, label="run"):
    return record_of(time, {"delta_r": control}, {"r": yaw}, label)


def test_response_to_a_step_is_the_closed_form():
    time = irregular_time()
    control = (time >= time[50]).astype(float)[:, None]
    found = lag_response(time, control, 3.0, 0.7, np.arange(time.size))[:, 0]
    since = np.maximum(time - time[50] - 0.7, 0.0)
    np.testing.assert_allclose(found, 1.0 - np.exp(-since / 3.0), atol=1e-12)


def test_response_is_that_of_another_integrator():
    time = irregular_time(120)
    control = commands(time, 3)
    found = lag_response(time, control[:, None], 2.0, 0.43, np.arange(time.size))[:, 0]
    twin = integrated(lambda x, c: (c - x) / 2.0, time, control, control[0], 0.43)[:, 0]
    np.testing.assert_allclose(found, twin, atol=1e-8)


@pytest.mark.parametrize("name", ["lag", "nomoto"])
def test_a_lag_is_found_back_without_noise(name):
    records = [yaw_record(*lag_run(seed)) for seed in range(3)]
    found = BASELINES[name].fit(records[:2], ["r"], ["delta_r"])
    values = list(found.parameters.values())  # T, K, delay, offset in either
    np.testing.assert_allclose(values, [LAG["T"], LAG["K"], LAG["d"], LAG["b"]], rtol=1e-3)
    np.testing.assert_allclose(found.predict(records[2])[:, 0], records[2].channel("r"), atol=1e-6)


def test_gaps_other_lengths_and_rates_do_no_harm():
    """Errors stay within four standard deviations, which 40 repetitions of the noise put at 0.043 s, 0.00083 1/s and 0.00005 rad/s."""
    records = []
    for seed, n in enumerate((400, 150, 500)):
        time, control, yaw = lag_run(seed, n, noise=0.002)
        yaw[seed::3] = np.nan
        yaw[40:90] = np.nan
        yaw[:2] = np.nan
        records.append(yaw_record(time, control, yaw))
    found = BASELINES["lag"].fit(records, ["r"], ["delta_r"])
    assert found.parameters["T[r]"] == pytest.approx(LAG["T"], abs=0.17)
    assert found.parameters["K[r, delta_r]"] == pytest.approx(LAG["K"], abs=0.0033)
    assert found.noise_sd[0] == pytest.approx(0.002, abs=0.0002)


def test_each_velocity_takes_all_controls_that_move():
    time = irregular_time()
    n, rudder = 20 + commands(time, 1, 5.0), commands(time, 2)
    speed = 0.05 * n[:, None] - 0.4 * rudder[:, None]
    u = lag_response(time, speed, 6.0, 0.0, np.arange(time.size))[:, 0]
    record = record_of(time, {"n": n, "delta_r": rudder}, {"u": u, "r": u**2})
    still = record_of(time, {"n": n, "delta_r": np.full(time.size, 0.1)}, {"u": u, "r": u**2})
    found = BASELINES["lag"].fit([record], ["u", "r"], ["n", "delta_r"])
    assert found.channels == ("u", "r")
    assert found.parameters["K[u, n]"] == pytest.approx(0.05, rel=1e-3)
    assert found.parameters["K[u, delta_r]"] == pytest.approx(-0.4, rel=1e-3)
    assert "K[u, delta_r]" not in BASELINES["lag"].fit([still], ["u"], ["n", "delta_r"]).parameters


def test_second_order_nomoto_is_found_back():
    """T1 T2 r'' + (T1 + T2) r' + r = K (c + T3 c'), as two states whose output is r."""
    t1, t2, t3, gain = 9.0, 1.5, 3.0, 0.2
    records = []
    for seed in range(3):
        time = irregular_time(500, seed)
        control = commands(time, seed)
        control[:20] = 0.0

        def rate(x, c):
            return np.array([x[1], (c - x[0] - (t1 + t2) * x[1]) / (t1 * t2)])

        x = integrated(rate, time, control, [0.0, 0.0], 0.0)
        records.append(yaw_record(time, control, gain * (x[:, 0] + t3 * x[:, 1])))
    found = BASELINES["nomoto-2"].fit(records[:2], ["r"], ["delta_r"])
    for name, value in (("T1", t1), ("T2", t2), ("K", gain), ("K T3", gain * t3)):
        assert found.parameters[name] == pytest.approx(value, rel=0.02)
    assert found.score(records[2])["r"].explained > 0.9999
    assert found.score(records[2], start=200)["r"].explained > 0.9999


@pytest.mark.parametrize("linear", [0.2, -0.03])
def test_cubic_lag_is_that_of_another_integrator_and_is_found_back(linear):
    """Also of a ship that does not keep its course. Splitting errs by the square of the step: a quarter for half of it."""
    gain, cubic, delay = 0.05, 40.0, 0.5
    records = []
    for seed in range(3):
        time = 0.1 * np.arange(600)
        control = commands(time, seed, hold=40)
        yaw = integrated(lambda x, c: gain * c - linear * x - cubic * x**3, time, control, 0.01, delay)[:, 0]
        law = CubicLag(gain, 0.0, linear, cubic, delay)
        fast = law.simulate(Run(time, control[:, None], yaw))
        finer = law.simulate(Run(0.05 * np.arange(1200), np.repeat(control, 2)[:, None], np.repeat(yaw, 2)))
        assert np.abs(fast - yaw).max() < 4e-5
        assert np.abs(finer[::2] - yaw).max() < 0.3 * np.abs(fast - yaw).max()
        records.append(yaw_record(time, control, yaw))
    found = BASELINES["norrbin"].fit(records[:2], ["r"], ["delta_r"])
    assert found.parameters["K/T"] == pytest.approx(gain, rel=0.01)
    assert found.parameters["1/T"] == pytest.approx(linear, abs=0.002)
    assert found.parameters["a/T"] == pytest.approx(cubic, rel=0.02)
    assert found.score(records[2])["r"].explained > 0.999


def test_prediction_starts_anywhere_from_what_is_measured_there():
    record = yaw_record(*lag_run(0))
    found = BASELINES["nomoto"].fit([record], ["r"], ["delta_r"])
    later = found.predict(record, start=150)[:, 0]
    assert np.isnan(later[:150]).all()
    np.testing.assert_allclose(later[150:], record.channel("r")[150:], atol=1e-6)
    with pytest.raises(InputError, match="start 400"):
        found.predict(record, start=400)


def test_persistence_and_mean_by_hand():
    time = np.arange(10.0)
    values = np.array([np.nan, 2.0, 1.0, np.nan, 4.0, 1.0, 3.0, 0.0, 5.0, 2.0])
    record = record_of(time, {"n": time}, {"u": values})
    held, mean = (BASELINES[name].fit([record], ["u"], ["n"]) for name in ("persistence", "mean"))
    np.testing.assert_array_equal(held.predict(record)[:, 0], np.full(10, 2.0))
    assert held.noise_sd[0] == pytest.approx(np.sqrt(np.nanmean((values - 2.0) ** 2)))
    np.testing.assert_allclose(mean.predict(record)[:, 0], np.nanmean(values))
    assert held.predict(record, start=3)[-1, 0] == 4.0


@pytest.mark.proof
def test_stated_noise_covers_new_runs():
    """Of ten runs of 400 samples with white noise 90 % lie inside the band, within four binomial errors."""
    fitted = BASELINES["nomoto"].fit([yaw_record(*lag_run(s, noise=0.003)) for s in range(3)], ["r"], ["delta_r"])
    # The start is a single noisy measurement, so what it starts is left out.
    scores = [fitted.score(yaw_record(*lag_run(s, noise=0.003)))["r"] for s in range(3, 13)]
    inside = sum(score.coverage * score.samples for score in scores) / sum(score.samples for score in scores)
    assert inside == pytest.approx(0.9, abs=4 * np.sqrt(0.9 * 0.1 / 4000) + 0.01)


def test_what_cannot_be_fitted_says_why():
    time = irregular_time(60)
    moves, still = commands(time), np.zeros(time.size)
    u = np.sin(time)
    speed = record_of(time, {"n": moves}, {"u": u})
    fitted, refused = fit_baselines([speed], ["u"], ["n"])
    assert [one.name for one in fitted] == ["persistence", "mean", "lag"]
    assert refused["nomoto"] == "no yaw rate r is among the channels u"
    with pytest.raises(InputError, match="there is no run to fit"):
        BASELINES["lag"].fit([], ["u"], ["n"])
    without = record_of(time, {"n": still}, {"u": u, "r": u})
    for name in ("lag", "nomoto", "nomoto-2", "norrbin"):
        with pytest.raises(InputError, match="no control moves"):
            BASELINES[name].fit([without], ["u", "r"], ["n"])
    with pytest.raises(InputError, match="no control moves"):
        BASELINES["lag"].fit([speed], ["u"], [])
    few = np.full(time.size, np.nan)
    few[::10] = u[::10]
    short = record_of(time, {"n": moves}, {"u": few})
    with pytest.raises(InputError, match="u has 6 measured samples, fewer than 5 for each of 4 unknowns"):
        BASELINES["lag"].fit([short], ["u"], ["n"])


def test_a_channel_that_a_run_lacks_is_neither_fitted_nor_predicted_there():
    time, control, yaw = lag_run(0)
    both = record_of(time, {"delta_r": control}, {"r": yaw, "u": 1 + yaw}, "both")
    one = record_of(time, {"delta_r": control}, {"u": 1 + yaw}, "one")
    found = BASELINES["lag"].fit([both, one], ["r", "u"], ["delta_r"])
    scores = found.score(one)
    assert scores["r"].missing == "nothing was measured"
    assert scores["u"].explained > 0.999
