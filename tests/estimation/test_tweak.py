"""Values moved by hand: the ridge and the distance in closed form, likelihoods against the posterior and a plain loop, another mass."""

import numpy as np
import pytest
from scipy import stats

import seatrial as st
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from tests.cases import TRUTH, U0, naive_rk4, paper_model
from tests.estimation_cases import make_trial, naive_doublets

STEP, NOISE = 0.1, 0.02
INERTIA, DEDUCTION = 31.4, 0.1
PUSHED = axes_vehicle("pushed", [axis_equation("X", ["X_0", "X_tau_X"])])
CHANNELS = (Channel("tau_X", "N", "control"), Channel("u", "m/s", "measurement"))


@pytest.fixture(scope="module")
def linear():
    """A speed that is linear in both coefficients: its posterior and mode, the record, the design matrix and the measurements."""
    random, n = np.random.default_rng(2), 200
    force = 0.4 + np.sin(0.05 * np.arange(n)) ** 2
    before = np.concatenate([[0.0], np.cumsum(force[:-1])])
    design = STEP * np.column_stack([np.arange(n), before])
    speed = design @ [0.05, 0.3] + NOISE * random.normal(size=n)
    record = make_record(np.arange(n) * STEP, {"tau_X": force, "u": speed}, CHANNELS, Provenance("own", ""), "1")
    priors = {"X_0": Normal(0.0, 0.1), "X_tau_X": Normal(0.2, 0.2), "sigma_u": LogUniform(1e-3, 1.0)}
    posterior = st.make_posterior(PUSHED, record, priors, start={"u": 0.0})
    return posterior, st.find_mode(posterior), record, design, speed


def closed_form(mode, design, measured):
    """Mean and covariance of both coefficients at the noise of the mode, by the normal equations."""
    precision = design.T @ design / mode.by_name["sigma_u"] ** 2 + np.diag([1 / 0.1**2, 1 / 0.2**2])
    cov = np.linalg.inv(precision)
    return cov @ (design.T @ measured / mode.by_name["sigma_u"] ** 2 + [0.0, 0.2 / 0.2**2]), cov


def test_the_others_follow_along_the_ridge_of_a_linear_model(linear):
    posterior, mode, record, design, speed = linear
    mean, cov = closed_form(mode, design, speed)
    moved = mean[0] + 2.5 * np.sqrt(cov[0, 0])
    followed = st.tweak(posterior, mode, record, {"X_0": moved}, follow=True)
    assert abs(cov[0, 1]) / np.sqrt(cov[0, 0] * cov[1, 1]) > 0.9
    assert followed.values["X_tau_X"] == pytest.approx(mean[1] + cov[0, 1] / cov[0, 0] * (moved - mean[0]), rel=1e-4)
    assert followed.distance == pytest.approx(2.5, rel=1e-3)
    assert followed.probability == pytest.approx(2 * stats.norm.sf(2.5), rel=1e-2)
    stayed = st.tweak(posterior, mode, record, {"X_0": moved})
    assert stayed.values["X_tau_X"] == mode.by_name["X_tau_X"]
    assert stayed.distance == pytest.approx((moved - mean[0]) * np.sqrt(np.linalg.inv(cov)[0, 0]), rel=1e-3)
    assert stayed.tweaked.log_likelihood < followed.tweaked.log_likelihood < followed.best.log_likelihood
    assert np.allclose(stayed.tweaked.mean[:, 0], design @ [moved, mode.by_name["X_tau_X"]], atol=1e-12)
    wider = st.tweak(posterior, mode, record, {"X_0": moved}, follow=True, sd={"X_0": 2 * np.sqrt(cov[0, 0])})
    assert wider.distance == pytest.approx(1.25, rel=1e-3)
    assert "2.5 standard deviations from the best values" in repr(followed)


@pytest.fixture(scope="module")
def surge():
    """A trial of the paper's vehicle, and one that is not fitted."""
    random, time = np.random.default_rng(5), np.arange(600) * STEP
    rev_per_s = naive_doublets(time, 200, 10, active=50)
    speed = naive_speed(rev_per_s, **TRUTH)
    fitted, other = (make_trial(time, rev_per_s, name, u=speed + NOISE * random.normal(size=600)) for name in "ab")
    priors = {name: Uniform(*sorted((0.2 * value, 4.0 * value))) for name, value in TRUTH.items()}
    priors |= {"sigma_u": LogUniform(1e-3, 1.0), "bias_u": Normal(0.01, 0.005)}
    sensors = [st.Sensor("u", bias=True)]
    posterior = st.make_posterior(paper_model(*TRUTH), fitted, priors, sensors, start={"u": U0}, own=["bias_u"])
    return posterior, st.find_mode(posterior), fitted, other, rev_per_s


def naive_speed(rev_per_s, X_u, X_uabsu, T_nabsn, inertia=INERTIA):
    """Speed at every sample by a plain loop."""
    speed = [U0]
    for n in 2 * np.pi * rev_per_s[:-1]:
        push = (1 - DEDUCTION) * T_nabsn * n * abs(n)
        speed.append(naive_rk4(lambda u, push=push: (push + X_u * u + X_uabsu * u * abs(u)) / inertia, speed[-1], STEP))
    return np.array(speed)


def test_likelihoods_are_those_of_the_posterior_and_of_a_plain_loop(surge):
    posterior, mode, fitted, _, rev_per_s = surge
    values = {"X_u": 1.3 * mode.by_name["X_u"], "mass": 35.0}
    result = st.tweak(posterior, mode, fitted, values)
    at_mode = float(posterior.log_likelihood(mode.z))
    assert result.best.fitted_log_likelihood == pytest.approx(at_mode, rel=1e-12)
    assert result.best.log_likelihood == pytest.approx(at_mode, rel=1e-12)
    moved = {name: {**mode.by_name, **values}[name] for name in TRUTH}
    speed = naive_speed(rev_per_s, **moved, inertia=35.0 + 0.93) + mode.by_name["bias_u[a]"]
    measured = fitted.channel("u")
    twin = stats.norm.logpdf(measured, speed, mode.by_name["sigma_u"]).sum()
    assert result.tweaked.log_likelihood == pytest.approx(twin, rel=1e-9)
    assert result.tweaked.fitted_log_likelihood == pytest.approx(twin, rel=1e-9)
    assert np.allclose(result.tweaked.mean[:, 0], speed, atol=1e-11)
    explained = 1 - ((measured - speed) ** 2).sum() / ((measured - measured.mean()) ** 2).sum()
    assert result.tweaked.explained[0] == pytest.approx(explained, abs=1e-10)
    assert np.allclose(result.residual[:, 0], measured - speed, atol=1e-11)


def test_with_another_mass_the_coefficients_follow_in_proportion(surge):
    """Inertia and all coefficients of the axis times one number are the same motion."""
    posterior, mode, fitted, *_ = surge
    result = st.tweak(posterior, mode, fitted, {"mass": 32.0}, follow=True)
    for name in TRUTH:
        ratio = result.values[name] / mode.by_name[name]
        assert ratio == pytest.approx((32.0 + 0.93) / INERTIA, rel=2e-3), name
    assert result.tweaked.log_likelihood == pytest.approx(result.best.log_likelihood, abs=0.5)
    assert st.tweak(posterior, mode, fitted, {"mass": 32.0}).tweaked.log_likelihood < result.best.log_likelihood - 20.0
    assert result.probability == 1.0  # of coefficients, none of which was moved


def test_a_record_that_was_not_fitted_has_the_mean_of_what_is_its_own(surge):
    posterior, mode, _, other, rev_per_s = surge
    result = st.tweak(posterior, mode, other, {}, start={"u": U0})
    at_best = naive_speed(rev_per_s, **{name: mode.by_name[name] for name in TRUTH}) + 0.01
    assert np.allclose(result.best.mean[:, 0], at_best, atol=1e-6)
    assert np.array_equal(result.best.mean, result.tweaked.mean)


def test_what_cannot_be_moved_is_refused_by_name(surge, linear):
    posterior, mode, fitted, *_ = surge
    for values, found in (({"X_v": 1.0}, "X_v"), ({"mass": -1.0}, "-1"), ({"X_u": np.nan}, "nan")):
        with pytest.raises(InputError, match=found):
            st.tweak(posterior, mode, fitted, values)
    with pytest.raises(InputError, match="mass"):  # an inertia that is unknown
        st.tweak(linear[0], linear[1], linear[2], {"mass": 30.0})
    with pytest.raises(InputError, match="find_mode"):
        st.tweak(posterior, linear[1], fitted, {})
    diverging = st.tweak(posterior, mode, fitted, {"X_uabsu": 40.0})
    assert diverging.tweaked.log_likelihood == -np.inf
