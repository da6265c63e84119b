"""Signals and their rates by smoothing, against dense Gaussian-process regression, a smoothing spline, and simulated truths."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from seatrial.core.errors import InputError
from seatrial.estimation.regression.accelerations import _innovation_complaints, smooth


class Dense(NamedTuple):
    """Signal then rate at every instant; the best noise and the log-likelihood with it, but for a constant."""

    mean: np.ndarray
    sd: np.ndarray
    noise: float
    log_likelihood: float


def integrated(s, t):
    """Covariances of an integrated Wiener process of unit density and of its rate, both zero at 0: x with x, v with x, v with v."""
    low, (s, t) = np.minimum.outer(s, t), np.meshgrid(s, t, indexing="ij")
    return s * t * low - (s + t) * low**2 / 2 + low**3 / 3, t * low - low**2 / 2, low


def dense(time, values, q, noise=None):
    """Regression on an unknown straight line and an integrated Wiener process of density q sigma^2 (Rasmussen and Williams, 2.7)."""
    there = np.isfinite(values)
    t, y = time[there] - time[0], values[there]
    xx, _, _ = integrated(t, t)
    all_x, all_v, all_vv = integrated(time - time[0], time - time[0])
    cov = q * xx + np.eye(t.size)
    line = np.column_stack([np.ones(t.size), t])
    every = np.vstack([np.column_stack([np.ones(time.size), time - time[0]]), [[0.0, 1.0]] * time.size])
    cross = q * np.vstack([all_x, all_v])[:, there]
    prior = q * np.concatenate([np.diag(all_x), np.diag(all_vv)])
    gain = np.linalg.inv(line.T @ np.linalg.solve(cov, line))
    slope = gain @ line.T @ np.linalg.solve(cov, y)
    left = np.linalg.solve(cov, y - line @ slope)
    freedom = t.size - 2
    squares = (y - line @ slope) @ left
    sigma = np.sqrt(squares / freedom) if noise is None else noise
    rest = every - cross @ np.linalg.solve(cov, line)
    var = prior - np.sum(cross * np.linalg.solve(cov, cross.T).T, 1) + np.sum(rest @ gain * rest, 1)
    logs = freedom * np.log(sigma**2) + np.linalg.slogdet(cov)[1] - np.linalg.slogdet(gain)[1] + squares / sigma**2
    return Dense(every @ slope + cross @ left, sigma * np.sqrt(var), sigma, -0.5 * logs)


def wandering(rng, time, q, sigma):
    """A signal whose rate wanders, its rate, and its measurement, by the exact law of each step."""
    x, v, found = 1.0, -0.5, []
    for h in np.diff(time, prepend=time[0]):
        first, second = rng.normal(size=2)
        spread = sigma * np.sqrt(q)
        x += h * v + spread * (h**1.5 / 2 * first + h**1.5 / np.sqrt(12) * second)
        v += spread * np.sqrt(h) * first
        found.append((x, v))
    x, v = np.array(found).T
    return x, v, x + sigma * rng.normal(size=time.size)


def irregular(rng, n=160):
    """Irregular instants, with samples missing at the ends and in a gap."""
    time = 7.0 + np.cumsum(rng.uniform(0.02, 0.3, n))
    missing = rng.random(n) < 0.2
    missing[:4] = missing[-3:] = missing[60:80] = True
    return time, missing


@pytest.mark.parametrize("noise", [None, 0.05])
@pytest.mark.parametrize("tau", [0.02, 0.6, 8.0])
def test_the_posterior_is_that_of_dense_regression(tau, noise):
    rng = np.random.default_rng(1)
    time, missing = irregular(rng)
    _, _, y = wandering(rng, time, 30.0, 0.04)
    y[missing] = np.nan
    usual = np.median(np.diff(time[~missing]))
    found, exact = smooth(time, y, noise, tau), dense(time, y, usual / tau**4, noise)
    assert np.concatenate([found.value, found.rate]) == pytest.approx(exact.mean, rel=1e-6, abs=1e-6)
    assert np.concatenate([found.value_sd, found.rate_sd]) == pytest.approx(exact.sd, rel=1e-5)
    assert found.noise == pytest.approx(exact.noise, rel=1e-7)


@pytest.mark.parametrize("noise", [None, 0.05])
def test_the_time_scale_has_the_greatest_likelihood(noise):
    rng = np.random.default_rng(2)
    time, missing = irregular(rng)
    _, _, y = wandering(rng, time, 30.0, 0.04)
    y[missing] = np.nan
    usual = np.median(np.diff(time[~missing]))
    found = smooth(time, y, noise)
    tried = found.time_scale * np.exp(np.linspace(-4.0, 2.0, 25))
    best = dense(time, y, usual / found.time_scale**4, noise).log_likelihood
    assert best > max(dense(time, y, usual / tau**4, noise).log_likelihood for tau in tried) - 1e-3


def test_the_mean_is_the_smoothing_spline():
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.05, 0.2, 200))
    y = np.sin(time) + 0.1 * rng.normal(size=time.size)
    found = smooth(time, y)
    spline = make_smoothing_spline(time, y, lam=found.time_scale**4 / np.median(np.diff(time)))
    assert found.value == pytest.approx(spline(time), abs=1e-8)
    assert found.rate == pytest.approx(spline.derivative()(time), abs=1e-7)


def test_the_stated_sd_holds_the_truth_as_often_as_it_should():
    """The share of truths inside two standard deviations, 95.4 %; of runs, since errors within one follow one another."""
    shares, rng = [], np.random.default_rng(4)
    for _ in range(60):
        time, missing = irregular(rng, 400)
        x, v, y = wandering(rng, time, 2000.0, 0.02)
        y[missing] = np.nan
        found = smooth(time, y)
        within = [abs(found.value - x) < 2 * found.value_sd, abs(found.rate - v) < 2 * found.rate_sd]
        shares.append(np.mean(within, axis=1))
    error = np.std(shares, axis=0) / np.sqrt(len(shares))
    assert (error < 0.01).all()
    assert (abs(np.mean(shares, axis=0) - 0.9545) < 4 * error + 0.005).all()


def test_white_innovations_are_not_complained_of_and_others_are():
    rng = np.random.default_rng(5)
    time, complained = 0.05 * np.arange(600), 0
    for _ in range(40):
        _, _, y = wandering(rng, time, 500.0, 0.02)
        complained += bool(smooth(time, y).complaints)
    assert complained <= 1
    slow = np.zeros(time.size)
    for i in range(1, time.size):
        slow[i] = 0.9 * slow[i - 1] + 0.02 * rng.normal()
    swaying = np.sin(0.4 * time) + 0.05 * np.sin(25.0 * time) + 0.01 * rng.normal(size=time.size)
    assert "not white" in smooth(time, np.sin(0.3 * time) + np.repeat(slow[::4], 4), 0.02).complaints[0]
    assert "not white" in " ".join(smooth(time, swaying).complaints)


@pytest.mark.parametrize(
    ("values", "options", "told"),
    [
        (np.r_[np.arange(11.0), [np.nan] * 20], {}, "11 measured samples"),
        (np.ones(31), {}, "the same value"),
        (np.arange(31.0), {"noise": 0.0}, "a noise of 0.0"),
        (np.arange(31.0), {"time_scale": np.inf}, "a time scale of inf"),
    ],
)
def test_what_cannot_be_smoothed(values, options, told):
    with pytest.raises(InputError, match=told):
        smooth(np.arange(31.0), values, **options)


def test_clock_and_a_straight_line_do_not_matter():
    """Nothing is known of the line beforehand: one that is added comes back, whenever the clock began."""
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.05, 0.2, 150))
    y = np.sin(time) + 0.05 * rng.normal(size=time.size)
    one, other = smooth(time, y, time_scale=0.4), smooth(time + 500.0, y + 20.0 - 3.0 * time, time_scale=0.4)
    assert other.value == pytest.approx(one.value + 20.0 - 3.0 * time, abs=1e-6)
    assert other.rate == pytest.approx(one.rate - 3.0, abs=1e-6)
    assert other.value_sd == pytest.approx(one.value_sd, rel=1e-6)
    assert other.noise == pytest.approx(one.noise, rel=1e-6)


def complaints(z):
    return " and ".join(_innovation_complaints(z))


def alternating(correlation, n=2000):
    """Innovations with a correlation over three samples."""
    rng = np.random.default_rng(6)
    z = rng.normal(size=n)
    for i in range(3, n):
        z[i] = correlation * z[i - 3] + np.sqrt(1 - correlation**2) * z[i]
    return (z - z.mean()) / z.std()


@pytest.mark.parametrize(
    ("z", "said"),
    [
        (alternating(0.0), ""),
        (alternating(0.3), "at lag 3"),
        (alternating(-0.3), "at lag 3"),
        (alternating(0.07), ""),
        (alternating(0.15, 200), ""),
        (1.15 * alternating(0.0), ""),
        (1.26 * alternating(0.0), "1.3 times as large"),
        (alternating(0.0) / 1.15, ""),
        (alternating(0.0) / 1.25, "0.8 times as large"),
        (1.2 * alternating(0.0, 100), ""),
    ],
)
def test_what_innovations_say(z, said):
    """A memory counts from 0.1 and four standard errors on, a size from a fifth and as many."""
    assert said in complaints(z)
    assert bool(complaints(z)) == bool(said)


def test_outliers_of_the_innovations_are_told_by_their_kurtosis():
    """Of n samples, m of size s: kurtosis about (3 + m s^4 / n) / (1 + m s^2 / n)^2, told from 6 on."""
    for count, told in ((4, False), (40, True)):
        z = alternating(0.0)
        z[np.arange(count) * 47 + 10] = 5.0 * (-1.0) ** np.arange(count)
        z = z / z.std()
        kurtosis = np.mean((z - z.mean()) ** 4) / np.var(z) ** 2
        assert (kurtosis > 6) == told
        assert ("outliers" in complaints(z)) == told


def test_bandwidth_is_where_the_gain_has_fallen_to_a_half():
    """The smoother's gain is 1 / (1 + (omega tau)^4): at omega = 1 / tau, in cycles a second."""
    rng = np.random.default_rng(7)
    found = smooth(np.arange(60) * 0.1, rng.normal(size=60), time_scale=0.4)
    assert found.bandwidth == pytest.approx(1 / (2 * np.pi * 0.4))
