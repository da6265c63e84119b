"""Disturbances: forces with a memory against dense covariance algebra, against process noise, and drawn again."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from seatrial.core.errors import InputError
from seatrial.core.record import Channel, make_record
from seatrial.estimation.posterior.filter_error import filter_error
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.posterior.replicate import replicate
from seatrial.estimation.posterior.simulated_record import simulate
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.estimation.simulation.disturbance import over_step
from seatrial.filters.extended import ExtendedKalmanFilter, LargeExtendedKalmanFilter
from seatrial.filters.square_root import LargeUnscentedKalmanFilter, SquareRootUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import MASS, PROVENANCE, U0, paper_model
from tests.estimation.test_filter_error import LINEAR, MEASURED, REV, TIME, N, evaluate, log_likelihood, record
from tests.estimation_cases import make_trial, naive_speed

STEP = np.diff(TIME)
SD, TAU = 3.0, 0.7
PUSHED = {**{name: value for name, value in LINEAR.items() if name != "process_u"}, "disturbance_X": SD}
PUSHED["disturbance_time_X"] = TAU


def mean_force_cov(sd=SD, tau=TAU):
    """Covariance of the mean forces over all steps, by the integrals of sd^2 exp(-|t - t'| / tau) over their pairs."""
    begin, end = TIME[:-1], TIME[1:]
    cov = np.zeros((N - 1, N - 1))
    for i in range(N - 1):
        h = STEP[i]
        cov[i, i] = 2 * tau * (h - tau * (1 - np.exp(-h / tau))) / h**2
        for j in range(i):
            gaps = (begin[i] - end[j], end[i] - begin[j], begin[i] - begin[j], end[i] - end[j])
            near, far, one, other = (np.exp(-gap / tau) for gap in gaps)
            cov[i, j] = cov[j, i] = tau**2 * (near + far - one - other) / (h * STEP[j])
    return sd**2 * cov


def dense(slope, by_force, force_covs, initial_sd, noise_sd):
    """Covariance of the measured states of x' = slope x + by_force f, sample by sample, f held over each step by RK4; all states shown."""
    d = len(slope)
    steps = [_rk4_matrices(slope, by_force, h) for h in STEP]
    total = np.zeros((N * d, N * d))
    at_start = [np.eye(d)]
    for grow, _ in steps:
        at_start.append(grow @ at_start[-1])
    start = np.vstack(at_start) * initial_sd
    total += start @ start.T
    for axis, cov in enumerate(force_covs):
        response = np.zeros((N, d, N - 1))
        for k, (grow, push) in enumerate(steps):
            response[k + 1] = grow @ response[k]
            response[k + 1, :, k] = push[:, axis]
        flat = response.reshape(N * d, N - 1)
        total += flat @ cov @ flat.T
    return total + np.kron(np.eye(N), np.diag(np.square(noise_sd)))


def _rk4_matrices(slope, by_force, h):
    one, a = np.eye(len(slope)), slope * h
    return one + a + a @ a / 2 + a @ a @ a / 6 + a @ a @ a @ a / 24, h * (
        one + a / 2 + a @ a / 6 + a @ a @ a / 24
    ) @ by_force


def surge_law(sd=SD, tau=TAU):
    """Mean and covariance of the measured speed of the linear vehicle."""
    slope = np.array([[LINEAR["X_u"] / MASS]])
    cov = dense(slope, np.array([[1 / MASS]]), [mean_force_cov(sd, tau)], [0.05], [0.05])
    return naive_speed(REV, STEP, x_u=LINEAR["X_u"], x_uu=0.0), cov


FILTERS = (ExtendedKalmanFilter(), LargeExtendedKalmanFilter(), UnscentedKalmanFilter())
FILTERS += (SquareRootUnscentedKalmanFilter(), LargeUnscentedKalmanFilter())


@pytest.mark.parametrize("method", FILTERS, ids=lambda method: type(method).__name__)
@pytest.mark.parametrize("gaps", [(), (0, 1, 7, 20, 39)], ids=["complete", "gaps"])
def test_linear_vehicle_in_closed_form(gaps, method):
    u = MEASURED.copy()
    u[list(gaps)] = np.nan
    mean, cov = surge_law()
    there = np.isfinite(u)
    expected = stats.multivariate_normal(mean[there], cov[np.ix_(there, there)]).logpdf(u[there])
    assert log_likelihood(PUSHED, [record(u=u)], disturbed=["X"], method=method) == pytest.approx(expected, abs=1e-8)


def test_beside_process_noise():
    """Both at once: variances add up."""
    mean, cov = surge_law()
    gain = np.array([_rk4_matrices(np.array([[LINEAR["X_u"] / MASS]]), np.eye(1), h)[0][0, 0] for h in STEP])
    white = np.zeros((N, N))
    for k in range(1, N):
        white[k, :k] = white[:k, k] = gain[k - 1] * white[k - 1, :k]
        white[k, k] = gain[k - 1] ** 2 * white[k - 1, k - 1] + 0.02**2 * STEP[k - 1]
    expected = stats.multivariate_normal(mean, cov + white).logpdf(MEASURED)
    found = log_likelihood({**PUSHED, "process_u": 0.02}, disturbed=["X"])
    assert found == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("tau", [1e-3, 1e-5])
def test_without_memory_it_is_process_noise(tau):
    """Without damping, so that it does not matter when within a step the vehicle is pushed: the difference falls with tau."""
    still = {**PUSHED, "X_u": 0.0, "disturbance_time_X": tau, "disturbance_X": 0.02 * MASS / np.sqrt(2 * tau)}
    white = {**LINEAR, "X_u": 0.0, "process_u": 0.02}
    assert log_likelihood(still, disturbed=["X"]) == pytest.approx(log_likelihood(white), abs=5e2 * tau)


def test_over_step_against_small_steps():
    """The moments of a step are those of a thousand steps, each of which is short: series and closed form agree."""
    for r in (0.0999, 0.1001, 3.0):
        whole = over_step(2.0, 1.0, r)
        n = 1000
        e = np.exp(-np.abs(np.subtract.outer(np.arange(n) + 0.5, np.arange(n) + 0.5)) * r / n)
        variance = 4 * e.mean()
        from_whole = whole.mean**2 * 4 + (whole.with_gained * whole.gained) ** 2 + whole.apart**2
        assert float(from_whole) == pytest.approx(variance, rel=1e-5)  # a sum in place of an integral
    short, long = (over_step(1.0, 1.0, r) for r in (0.1 - 1e-9, 0.1 + 1e-9))
    assert np.allclose(short, long, rtol=1e-8)
    assert all(float(x) == y for x, y in zip(over_step(1.0, 1.0, 0.0), (1, 0, 0, 0, 0), strict=True))


def test_derivatives_are_finite_over_padding():
    """A trial of 17 samples is filled up with samples that take no time."""
    likelihood, data = filter_error(paper_model(), [record()], ["u"], [(U0,)], [0.05], disturbed=["X"])
    names = list(PUSHED)
    at = jnp.array(list(PUSHED.values()))

    @jax.jit
    def value(x):
        return likelihood(dict(zip(names, x, strict=True)), data)

    slope = jax.jit(jax.jacfwd(value))(at)
    for i in range(len(names)):
        h = 1e-5 * max(abs(float(at[i])), 1e-2)
        numeric = (float(value(at.at[i].add(h))) - float(value(at.at[i].add(-h)))) / (2 * h)
        assert float(slope[i]) == pytest.approx(numeric, rel=1e-5, abs=1e-6)


TURNING = {"Y_v": -60.0, "Y_r": 12.0, "N_v": -7.0, "N_r": -20.0, "Y_delta_r": 0.0}
HULL = Hull(
    "turning", 40.0, inertia=(1.0, 8.0, 8.0), fixed={"Y_vdot": -30.0, "Y_rdot": 2.0, "N_vdot": 2.0, "N_rdot": -5.0}
)


def turning_model():
    return whole_vehicle(HULL, list(TURNING), moves=["v", "r"])


def turning_record(v, r):
    channels = tuple(Channel(*one) for one in (("delta_r", "rad", "control"), ("v", "m/s", "measurement")))
    channels = (*channels, Channel("r", "rad/s", "measurement"))
    return make_record(TIME, {"delta_r": np.zeros(N), "v": v, "r": r}, channels, PROVENANCE, "turning")


@pytest.mark.parametrize(
    "method", [None, LargeUnscentedKalmanFilter(), pytest.param(ExtendedKalmanFilter(), marks=pytest.mark.proof)]
)
def test_two_axes_of_a_coupled_vehicle(method):
    """Sway and yaw, joined by added mass and by damping, each pushed on its own."""
    rng = np.random.default_rng(5)
    v, r = 0.05 * rng.normal(size=(2, N))
    v[7] = r[11] = np.nan
    inertia = np.array([[70.0, -2.0], [-2.0, 13.0]])
    slope = np.linalg.solve(inertia, [[-60.0, 12.0], [-7.0, -20.0]])
    covs = [mean_force_cov(3.0, 0.7), mean_force_cov(0.8, 2.5)]
    cov = dense(slope, np.linalg.inv(inertia), covs, [0.05, 0.03], [0.02, 0.01])
    seen = np.column_stack([v, r]).ravel()
    there = np.isfinite(seen)
    expected = stats.multivariate_normal(np.zeros(there.sum()), cov[np.ix_(there, there)]).logpdf(seen[there])
    values = {**TURNING, "sigma_v": 0.02, "sigma_r": 0.01, "disturbance_Y": 3.0, "disturbance_time_Y": 0.7}
    values |= {"disturbance_N": 0.8, "disturbance_time_N": 2.5}
    likelihood, data = filter_error(
        turning_model(), [turning_record(v, r)], ["v", "r"], [(0.0, 0.0)], [0.05, 0.03], method=method, disturbed="YN"
    )
    assert evaluate(likelihood, data, values) == pytest.approx(expected, abs=1e-8)


def test_an_accelerometer_feels_it():
    """At a start that is known, its variance is that of force over mass, and of its noise."""
    first = make_trial(TIME, REV, udot=np.where(np.arange(N) == 0, 0.3, np.nan))
    likelihood, data = filter_error(paper_model(), [first], ["udot"], [(U0,)], [1e-6], disturbed="X")
    values = {**PUSHED, "sigma_udot": 0.01}
    force = LINEAR["X_u"] * U0 + 0.9 * LINEAR["T_nabsn"] * (2 * np.pi * REV[0]) ** 2
    expected = stats.norm(force / MASS, np.hypot(SD / MASS, 0.01)).logpdf(0.3)
    assert evaluate(likelihood, data, values) == pytest.approx(expected, abs=1e-6)


def test_it_is_drawn_as_the_likelihood_says():
    """Squared lengths of whitened measurements follow the chi-squared law, and their mean is zero."""
    likelihood, data = filter_error(paper_model(), [record()], ["u"], [(U0,)], [0.05], disturbed=["X"])
    values = {name: jnp.asarray(float(value)) for name, value in PUSHED.items()}
    keys = jax.random.split(jax.random.key(4), 300)
    sample = jax.vmap(lambda key: replicate(likelihood, values, data, key).channels[0].measured)(keys)
    mean, cov = surge_law()
    white = np.linalg.solve(np.linalg.cholesky(cov), (np.asarray(sample)[:, 0, :N] - mean).T)
    assert stats.kstest((white**2).sum(0), stats.chi2(N).cdf).pvalue > 1e-3
    assert np.abs(white.mean()) < 4 / np.sqrt(white.size)


PRIORS = {
    "X_u": Uniform(-40.0, 0.0),
    "X_uabsu": Uniform(-20.0, 0.0),
    "T_nabsn": LogUniform(1e-4, 1e-2),
    "disturbance_X": LogUniform(0.01, 10.0),
    "disturbance_time_X": LogUniform(0.05, 20.0),
    "sigma_u": LogUniform(0.005, 0.5),
}


@pytest.mark.parametrize(
    "more", [(), pytest.param(("process_u",), marks=pytest.mark.proof)], ids=["alone", "process noise"]
)
def test_a_prior_asks_for_it(more):
    posterior = make_posterior(paper_model(), record(), PRIORS | {name: LogUniform(1e-4, 0.1) for name in more})
    assert set(posterior.names) == {*PRIORS, *more}
    assert posterior.likelihood.disturbed == ("X",)
    units = {parameter.name: parameter.unit for parameter in posterior.parameters}
    assert units["disturbance_X"] == "kg m/s^2"
    assert units["disturbance_time_X"] == "s"
    z = posterior.sample_prior(jax.random.key(0), 8)
    assert np.isfinite(np.asarray(jax.vmap(posterior.log_density)(z))).any()


def test_an_offset_of_each_trial():
    """A constant force that varies between trials, or is each trial's own, beside a disturbance."""
    model = paper_model("X_u", "T_nabsn", "X_0")
    records = [record("a"), record("b")]
    priors = {name: prior for name, prior in PRIORS.items() if name != "X_uabsu"} | {"X_0": Normal(0.0, 5.0)}
    varying = make_posterior(model, records, priors | {"spread_X_0": LogUniform(0.01, 10.0)})
    assert varying.likelihood.varying == ("X_0",)
    own = make_posterior(model, records, priors, own=["X_0"])
    assert {"X_0[a]", "X_0[b]"} <= set(own.names)
    shared = {
        "X_u": -20.0,
        "T_nabsn": LINEAR["T_nabsn"],
        "sigma_u": 0.05,
        "disturbance_X": 3.0,
        "disturbance_time_X": 0.7,
    }
    offset = {"X_0": 1.0, "spread_X_0": 2.0, "dev_X_0[a]": 0.5, "dev_X_0[b]": -1.0}
    of_varying = evaluate(varying.likelihood, varying.data, shared | offset)
    of_own = evaluate(own.likelihood, own.data, shared | {"X_0[a]": 2.0, "X_0[b]": -1.0})
    assert of_varying == pytest.approx(of_own, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "said"),
    [("disturbance_Y", "disturbance_Y"), ("disturbance_Q", "disturbance_Q"), ("process_v", "process_v")],
)
def test_a_prior_that_nothing_uses(name, said):
    with pytest.raises(InputError, match=said):
        make_posterior(paper_model(), record(), {**PRIORS, name: LogUniform(0.01, 10.0)})


@pytest.mark.parametrize("left", ["disturbance_X", "disturbance_time_X"])
def test_both_priors_are_needed(left):
    with pytest.raises(InputError, match=f"none of {left}"):
        make_posterior(paper_model(), record(), {name: prior for name, prior in PRIORS.items() if name != left})


def test_an_axis_that_does_not_move():
    with pytest.raises(InputError, match="axis Y"):
        filter_error(paper_model(), [record()], ["u"], [(U0,)], [0.05], disturbed=["Y"])


def test_a_simulated_trial_is_pushed():
    """Without other forces the speed wanders about its mean by what the force allows: sd / -X_u where its memory is long."""
    schedule = Schedule(np.arange(4000) * 0.5, {"n": np.zeros(4000)})
    values = {
        "X_u": -20.0,
        "X_uabsu": 0.0,
        "T_nabsn": 0.0,
        "sigma_u": 1e-6,
        "disturbance_X": 3.0,
        "disturbance_time_X": 20.0,
    }
    u = simulate(paper_model(), values, schedule, ["u"], start={"u": 0.0}, key=2).channel("u")
    tau_u = MASS / 20.0
    expected = 3.0 / 20.0 * np.sqrt(20.0 / (20.0 + tau_u))
    # about 2000 s / (2 * 20 s) = 50 values of their own
    assert u.std() == pytest.approx(expected, rel=4 / np.sqrt(2 * 50))
    with pytest.raises(InputError, match="disturbance_time_X"):
        simulate(paper_model(), {**values, "disturbance_time_X": 0.0}, schedule, ["u"], start={"u": 0.0})
