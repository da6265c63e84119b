"""Noise in proportion to the signal from simulation to prediction: found again, with intervals and bands that hold as stated."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import seatrial as st
from seatrial.estimation.posterior.replicate import replicate
from seatrial.manoeuvres.autopilot import Autopilot, Loop

RPM, REPEATS = 2 * np.pi / 60, 40
MODEL = st.load_vehicle("remus100_surge").build(free=["X_u", "X_uabsu", "T_nabsn"])
TRUTH = {"X_u": -6.0, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.004, "share_u": 0.03}
SENSORS = [st.Sensor("u", "proportional")]
PRIORS = {
    "X_u": st.Normal(-6.0, 2.0),
    "X_uabsu": st.Normal(-2.93, 1.0),
    "T_nabsn": st.LogNormal(6e-4, 1.2),
    "sigma_u": st.LogUniform(0.0005, 0.05),
    "share_u": st.LogUniform(0.001, 0.3),
}
TIME = 0.1 * np.arange(600)
SCHEDULE = st.Schedule(TIME, {"n": np.repeat([0.0, 400.0, 1500.0, 900.0, 200.0, 1300.0], 100) * RPM})
START = {"u": 0.0}


@pytest.fixture(scope="module")
def record():
    return st.simulate(MODEL, TRUTH, SCHEDULE, SENSORS, start=START, key=1)


@pytest.fixture(scope="module")
def posterior(record):
    return st.make_posterior(MODEL, record, PRIORS, SENSORS, start=START)


def test_simulated_noise_has_the_stated_law(record):
    still = st.simulate(MODEL, TRUTH | {"sigma_u": 0.0, "share_u": 0.0}, SCHEDULE, SENSORS, start=START).channel("u")
    z = (record.channel("u") - still) / np.hypot(TRUTH["sigma_u"], TRUTH["share_u"] * still)
    assert stats.kstest(z, "norm").pvalue > 0.01


def test_an_autopilot_cannot_feed_it_back():
    pilot = Autopilot(("n",), (Loop("u", (("n", 1.0),), 400 * RPM, interval=0.1),), (-np.inf,), (np.inf,))
    schedule = st.Schedule(TIME, SCHEDULE.controls | {"u_set": np.ones(TIME.size)})
    with pytest.raises(st.InputError, match="feeds back"):
        st.simulate(MODEL, TRUTH, schedule, SENSORS, feedback=pilot, start=START)


@pytest.mark.proof
def test_intervals_hold_the_truth_as_often_as_stated(posterior):
    """Of 40 simulated records: 90 % intervals of the normal approximation, at the mode along the straightened parameters."""
    values = {name: jnp.asarray(value) for name, value in TRUTH.items()}
    truth = np.asarray(posterior.unconstrain(np.array([TRUTH[name] for name in posterior.names])))
    z = []
    for key in jax.random.split(jax.random.key(4), REPEATS):
        mode = st.find_mode(replace(posterior, data=replicate(posterior.likelihood, values, posterior.data, key)))
        z.append((np.asarray(mode.z) - truth) / np.sqrt(np.diag(mode.cov)))
    z = np.array(z)
    inside = np.abs(z) < stats.norm.ppf(0.95)
    assert (inside.sum(0) >= stats.binom(REPEATS, 0.9).ppf(0.002)).all()
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.25)
    assert np.abs(z.mean(0)).max() < 4 / np.sqrt(REPEATS)


def test_bands_of_a_new_record_grow_with_its_signal(posterior):
    draws = st.sample(posterior, settings=st.ChainSettings(chains=8, warmup=200, draws=200))
    assert draws["share_u"].mean() == pytest.approx(TRUTH["share_u"], abs=4 * draws["share_u"].std())
    new = st.simulate(MODEL, TRUTH, SCHEDULE, SENSORS, start=START, key=2, label="new")
    found = st.predict(posterior, draws, new, start=START)
    mean = found.mean[:, 0]
    np.testing.assert_allclose(found.noise_sd[:, 0], np.hypot(TRUTH["sigma_u"], TRUTH["share_u"] * mean), rtol=0.15)
    inside = np.abs(found.measured - found.mean)[:, 0] < stats.norm.ppf(0.95) * found.sd[:, 0]
    for part in (
        mean < np.median(mean),
        mean >= np.median(mean),
    ):  # one band for both would hold all of one and too few of the other
        assert stats.binom(part.sum(), 0.9).cdf(inside[part].sum()) > 0.001
        assert stats.binom(part.sum(), 0.9).sf(inside[part].sum() - 1) > 0.001
