"""Posteriors from records and priors are those of a campaign of the same content; simulated records are what a plain loop makes."""

import hashlib
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.estimation.posterior.simulated_record import _would_act
from seatrial.estimation.prediction.prediction import noise_sd, slow_noise
from seatrial.estimation.prediction.prediction_scores import SlowNoise
from tests.campaign.small import write_small

RPM = 2 * np.pi / 60
VEHICLE = st.load_vehicle("remus100_surge")
TERMS = ["X_uabsu", "T_nabsn"]
MODEL = VEHICLE.build(free=["X_u", "X_uabsu", "T_nabsn"])
TRUTH = {"X_u": -6.0, "X_uabsu": -2.93, "T_nabsn": 6.28e-4, "sigma_u": 0.02}
FAMILY = st.Family("n", 1200 * RPM, duration=12.0, active=10.0, sample_time=0.05, kind="doublet")
SCHEDULE, START = FAMILY.schedule(200 * RPM, 8.0), {"u": 1.5}
PRIORS = {
    "X_u": st.Uniform(-20.0, 0.0),
    "X_uabsu": st.half_normal(10.0, upper=0.0),
    "T_nabsn": st.LogNormal(6e-4, 1.5),
    "sigma_u": st.LogUniform(0.002, 0.2),
}


@pytest.fixture(scope="module")
def record():
    return st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start=START, rates={"u": 10.0}, key=1)


def test_a_simulated_record_against_a_plain_loop(record):
    """Motion by a loop of RK4 over the published equation, and noise of the stated size on every second sample."""
    n = SCHEDULE.controls["n"]
    effective = VEHICLE.hull.mass - VEHICLE.hull.fixed["X_udot"]
    share = 1 - VEHICLE.hull.thrust_deduction

    def rate(u, n):
        thrust = share * TRUTH["T_nabsn"] * n * abs(n)
        return (TRUTH["X_u"] * u + TRUTH["X_uabsu"] * u * abs(u) + thrust) / effective

    speed = [START["u"]]
    for held in n[:-1]:
        u, h = speed[-1], 0.05
        a = rate(u, held)
        b = rate(u + h / 2 * a, held)
        c = rate(u + h / 2 * b, held)
        speed.append(u + h / 6 * (a + 2 * b + 2 * c + rate(u + h * c, held)))
    left = record.channel("u") - np.array(speed)
    assert np.isnan(left[1::2]).all()
    assert np.isfinite(left[::2]).all()
    assert left[::2].std() == pytest.approx(TRUTH["sigma_u"], rel=0.2)
    assert np.array_equal(record.channel("n"), n)
    exact = st.simulate(MODEL, TRUTH | {"sigma_u": 0.0}, SCHEDULE, ["u"], start=START)
    np.testing.assert_allclose(exact.channel("u"), speed, rtol=1e-12)


def test_what_a_sensor_adds_is_in_the_record():
    """A bias shifts, a current shows over ground, a delay moves the command; coloured noise is correlated."""
    still = TRUTH | {"sigma_u": 0.0}
    exact, late, biased, carried = (
        st.simulate(MODEL, still | more, SCHEDULE, [sensor], start=START).channel("u")
        for more, sensor in (
            ({}, "u"),
            ({"delay": 0.5}, "u"),
            ({"bias_u": 0.1}, st.Sensor("u", bias=True)),
            ({"current": 0.2}, "u"),
        )
    )
    np.testing.assert_allclose(biased, exact + 0.1, rtol=1e-12)
    np.testing.assert_allclose(carried, exact + 0.2, rtol=1e-12)
    np.testing.assert_allclose(late[30 + 10 : 200], late[40:200])
    assert np.abs(late - exact).max() > 0.01
    coloured = st.simulate(MODEL, TRUTH | {"tau_u": 1.0}, SCHEDULE, [st.Sensor("u", "coloured")], start=START, key=3)
    left = coloured.channel("u") - exact
    assert np.corrcoef(left[1:], left[:-1])[0, 1] > 0.8


@pytest.fixture(scope="module")
def posterior(record):
    return st.make_posterior(MODEL, record, PRIORS, start=START)


@pytest.mark.parametrize(
    "kind",
    [
        "",
        pytest.param('initial = "estimated"', marks=pytest.mark.proof),
        pytest.param('likelihood = "filter-error"', marks=pytest.mark.proof),
    ],
)
def test_a_campaign_has_the_same_posterior(tmp_path, kind):
    """Also with priors of one trial alone, and the spread of a filter's start, for both kinds of likelihood."""
    folder = write_small(tmp_path / "small")
    text = (folder / "campaign.toml").read_text().replace("[estimation]", f"[estimation]\n{kind}")
    text += '\n[prior.process_u]\ndistribution = "log-uniform"\nlower = 1e-4\nupper = 1.0\n' * ("filter" in kind)
    (folder / "campaign.toml").write_text(text)
    campaign = load_campaign(folder)
    records, structure = get_trials(campaign).fit, campaign.structures[0]
    theirs = build_posterior(campaign, structure, records)
    priors = {parameter.name: parameter.prior for parameter in theirs.parameters}
    start = {} if "estimated" in kind else {"u": float(theirs.data.initial[0, 0])}
    spread = {"start_sd": {"u": 0.05}} if kind else {}
    ours = st.make_posterior(campaign.model(structure), records, priors, start=start, **spread)
    assert ours.parameters == theirs.parameters
    z = ours.sample_prior(jax.random.key(0), 5)
    assert np.array_equal(jax.vmap(ours.log_density)(z), jax.vmap(theirs.log_density)(z))


def test_names_of_priors_say_what_is_modelled(record):
    """Everything at once: two trials, one coefficient that differs between them, a bias of each, delay, free starts."""
    other = st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start=START, key=2, label="other")
    more = {
        "delay": st.Uniform(0.0, 1.0),
        "bias_u": st.Normal(0.0, 0.1),
        "tau_u": st.LogUniform(0.05, 10.0),
        "spread_X_u": st.half_normal(1.0, lower=0.0),
        "u_0": st.Normal(1.5, 0.5),
    }
    sensors = [st.Sensor("u", "coloured", bias=True)]
    found = st.make_posterior(MODEL, [record, other], PRIORS | more, sensors, own=["bias_u"])
    assert found.names == (
        *("X_u", "X_uabsu", "T_nabsn", "spread_X_u", "delay", "sigma_u", "tau_u", "bias_u[trial]", "bias_u[other]"),
        *("dev_X_u[trial]", "dev_X_u[other]", "u_0[trial]", "u_0[other]"),
    )
    assert np.isfinite(found.log_density(jnp.zeros(found.dim)))
    noisy = st.make_posterior(MODEL, record, PRIORS | {"process_u": st.LogUniform(1e-4, 1.0)})
    assert type(noisy.likelihood).__name__ == "FilterError"


def test_what_cannot_be_simulated_is_refused():
    with pytest.raises(st.InputError, match="nothing about u"):
        st.simulate(MODEL, TRUTH, SCHEDULE, ["u"])
    with pytest.raises(st.InputError, match="none of sigma_u"):
        st.simulate(MODEL, {name: TRUTH[name] for name in ("X_u", "X_uabsu", "T_nabsn")}, SCHEDULE, ["u"], start=START)
    with pytest.raises(st.InputError, match="n among them"):
        st.simulate(MODEL, TRUTH, st.Schedule(SCHEDULE.time, {"delta_r": SCHEDULE.time}), ["u"], start=START)
    with pytest.raises(st.NumericalError, match="the simulated vehicle diverges: u is no number from"):
        st.simulate(MODEL, TRUTH | {"X_uabsu": 900.0}, SCHEDULE, ["u"], start=START)


@pytest.fixture(scope="module")
def draws(posterior):
    return st.sample(posterior, settings=st.ChainSettings(chains=8, warmup=200, draws=200))


@pytest.mark.proof
def test_a_prediction_holds_what_it_says(posterior, draws, record):
    """Held-back trials lie inside the stated bands as often as stated, and the exact motion within its own."""
    schedule = FAMILY.schedule(-250 * RPM, 6.0)
    held = st.simulate(MODEL, TRUTH, schedule, ["u"], start=START, key=9, label="held")
    exact = st.simulate(MODEL, TRUTH | {"sigma_u": 0.0}, schedule, ["u"], start=START).channel("u")
    found = st.predict(posterior, draws, held, start=START)
    assert found.mean.shape == found.motion_sd.shape == (240, 1)
    assert (np.abs(found.mean[:, 0] - exact) < 4 * found.motion_sd[:, 0] + 1e-9).all()
    assert found.noise_sd == pytest.approx(np.full((240, 1), TRUTH["sigma_u"]), rel=0.2)
    score = found.score("u")
    assert score.explained > 0.9
    assert score.coverage == pytest.approx(0.9, abs=0.06)
    with pytest.raises(st.InputError, match='channel "v"'):
        found.score("v")


@pytest.mark.proof
def test_a_trial_that_was_not_fitted_begins_about_its_first_measurement(record):
    """Where initial states are unknown, that of a fitted trial comes from its draws, that of another from its own first sample."""
    posterior = st.make_posterior(MODEL, record, PRIORS | {"u_0": st.Normal(1.5, 0.5)})
    draws = st.sample(posterior, settings=st.ChainSettings(chains=8, warmup=200, draws=200))
    other = st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start={"u": 0.8}, key=4, label="other")
    same, new = (st.predict(posterior, draws, one) for one in (record, other))
    assert same.mean[0, 0] == pytest.approx(draws["u_0[trial]"].mean(), abs=0.01)
    assert new.mean[0, 0] == pytest.approx(other.channel("u")[0], abs=0.01)
    assert new.motion_sd[0, 0] == pytest.approx(TRUTH["sigma_u"], rel=0.3)


def test_a_density_of_ones_own_predicts_no_record(draws, record):
    own = st.posterior_of_density(lambda p: p["a"], {"a": st.Normal(0.0, 1.0)})
    with pytest.raises(st.InputError, match="your log density"):
        st.predict(own, draws, record)


def test_a_simulated_record_tells_what_made_it(record):
    told = {"values": TRUTH, "start": START, "rates": {"u": 10.0}}
    assert record.provenance.source == "simulated"
    assert record.provenance.options == told
    assert record.provenance.sha256 == hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
    assert record.label == "trial"


@pytest.mark.parametrize(("given", "kept"), [(9, [0, 2, 4, 6]), (7, [0, 1, 2, 3]), (3, [0, 1, 2])])
def test_a_prediction_is_that_of_draws_spread_over_all(record, given, kept):
    """Means and deviations over the motion of each, and the root mean square of their noise; the median memory of it."""
    priors = PRIORS | {"tau_u": st.LogUniform(0.05, 10.0)}
    posterior = st.make_posterior(MODEL, record, priors, [st.Sensor("u", "coloured")], start=START)
    spread = np.linspace(0.7, 1.4, given)[:, None]
    table = np.array([TRUTH.get(name, 0.5) for name in posterior.names]) * np.where(spread > 1, spread**2, spread)
    draws = st.Draws(table[None], np.zeros((1, given)), 1.0, 0, posterior.names, ("1",) * table.shape[1], table[None])
    found = st.predict(posterior, draws, record, start=START, n=4)
    drawn = [dict(zip(posterior.names, row, strict=True)) for row in table[kept]]
    still = [{name: one[name] for name in TRUTH} | {"sigma_u": 0.0} for one in drawn]
    motion = np.array([st.simulate(MODEL, one, SCHEDULE, ["u"], start=START).channel("u") for one in still])
    np.testing.assert_allclose(found.mean[:, 0], motion.mean(0), rtol=1e-9)
    np.testing.assert_allclose(found.motion_sd[:, 0], motion.std(0), rtol=1e-6, atol=1e-12)
    noise = np.sqrt(np.mean([one["sigma_u"] ** 2 for one in drawn]))
    assert found.noise_sd == pytest.approx(np.full(found.mean.shape, noise))
    assert found.slow == (SlowNoise(pytest.approx(np.median([one["tau_u"] for one in drawn])), 1.0),)
    np.testing.assert_allclose(found.sd, np.hypot(found.motion_sd, noise))


def test_noise_with_heavy_tails_is_that_of_student_s_t():
    """Of three degrees of freedom at least, for below it would have hardly any."""
    values = {"sigma_u": np.array([0.1, 0.2]), "dof_u": np.array([5.0, 2.5])}
    expected = [0.1 * stats.t(5).std(), 0.2 * stats.t(3).std()]
    np.testing.assert_allclose(noise_sd(st.Sensor("u", "heavy"), values, 0.0), expected)
    np.testing.assert_array_equal(noise_sd(st.Sensor("u"), values, 0.0), [0.1, 0.2])


def test_noise_that_drifts_is_that_of_both_its_parts():
    sensor = st.Sensor("u", "drifting")
    values = {"sigma_u": np.array([0.3, 0.6]), "drift_u": np.array([0.4, 0.8]), "drift_time_u": np.array([20.0, 30.0])}
    np.testing.assert_allclose(noise_sd(sensor, values, 0.0), [0.5, 1.0])
    assert slow_noise(sensor, values) == pytest.approx((25.0, 0.64))
    assert slow_noise(st.Sensor("u"), values) is None


@pytest.mark.parametrize(("rate", "every"), [(20.0, 1), (10.0, 2), (6.7, 3), (1 / 11.95, 239)])
def test_slower_sensors_measure_every_so_many_samples(rate, every):
    """From one at every time of the schedule, 20 a second, to two in the whole trial."""
    made = st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start=START, rates={"u": rate})
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(made.channel("u"))), np.arange(0, 240, every))
    for wrong in (20.1, 1 / 12.1):
        with pytest.raises(st.InputError, match=r"from 0\.0837, two in the whole trial, to 20,"):
            st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start=START, rates={"u": wrong})


@pytest.mark.parametrize(
    ("name", "acts"),
    [("X_uu", True), ("T_nu", True), ("X_w", False), ("N_r", False), ("X_udelta_r", False), ("no coefficient", True)],
)
def test_values_of_terms_without_a_part_in_the_motion_are_ignored(name, acts):
    """Of a vehicle of surge and propeller, terms of sway, yaw or a rudder may be given; others are asked about."""
    assert _would_act(MODEL, name) == acts


def test_constants_are_those_that_the_vehicle_was_built_with():
    given = TRUTH | {"X_udot": VEHICLE.hull.fixed["X_udot"]}
    same, without = (st.simulate(MODEL, values, SCHEDULE, ["u"], start=START) for values in (given, TRUTH))
    np.testing.assert_array_equal(same.channel("u"), without.channel("u"))
    with pytest.raises(st.InputError, match="which the vehicle was built with"):
        st.simulate(MODEL, given | {"X_udot": -0.94}, SCHEDULE, ["u"], start=START)
