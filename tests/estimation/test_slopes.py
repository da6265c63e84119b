"""Slopes of a filter-error likelihood against second derivatives by JAX, and its information against that of a dense normal density."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.posterior.filter_error import filter_error
from seatrial.estimation.posterior.information import expand_likelihood
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.posterior.replicate import replicate
from seatrial.estimation.posterior.simulated_record import simulate
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.prediction.prediction import outputs_of_draws
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.filters.extended import LargeExtendedKalmanFilter
from seatrial.manoeuvres.schedule import Schedule
from tests.cases import N0, U0, paper_model
from tests.estimation.test_disturbance import PUSHED, surge_law
from tests.estimation.test_filter_error import MEASURED, REV, TIME, N, record
from tests.estimation_cases import make_trial

pytestmark = pytest.mark.proof


def posterior_of(values, records, **options):
    """A posterior whose priors do not matter, at its parameters' order."""
    starts = [(U0,)] * len(records)
    likelihood, data = filter_error(paper_model(), records, ["u"], starts, [0.05], disturbed=["X"], **options)
    parameters = tuple(Parameter(name, "1", name, Normal(0.0, 1.0)) for name in values)
    return Posterior(parameters, likelihood, data)


CASES = {
    "two trials, one with gaps": ({}, {}),
    "on arrays": ({"method": LargeExtendedKalmanFilter()}, {}),
    "current": ({"current": True, "starts_over_ground": True}, {"current": 0.1}),
    "own": ({"own": ["T_nabsn"]}, {"T_nabsn[a]": PUSHED["T_nabsn"], "T_nabsn[b]": 1.1 * PUSHED["T_nabsn"]}),
}


@pytest.mark.parametrize("name", CASES)
def test_gradient(name):
    options, more = CASES[name]
    gaps = np.where(np.arange(N) % 5 == 3, np.nan, MEASURED)
    values = {**PUSHED, **more}
    posterior = posterior_of(values, [record("a"), record("b", gaps)], **options)
    point = np.array(list(values.values()))

    def value(x):
        return posterior.likelihood(dict(zip(posterior.names, x, strict=True)), posterior.data)

    found = likelihood_slopes(posterior, point)
    assert float(found.value) == pytest.approx(float(jax.jit(value)(point)), abs=1e-9)
    scale = np.sqrt(np.diag(found.information))
    scale = np.where(scale > 0, scale, 1.0)
    assert np.allclose(np.asarray(found.gradient) / scale, jax.jit(jax.jacfwd(value))(point) / scale, atol=1e-7)


@pytest.mark.proof
def test_hessian():
    """Differences of exact gradients."""
    short = make_trial(TIME[:17], REV[:17], u=MEASURED[:17])
    posterior = posterior_of(PUSHED, [short])
    point = np.array(list(PUSHED.values()))

    def value(x):
        return posterior.likelihood(dict(zip(posterior.names, x, strict=True)), posterior.data)

    scale = np.sqrt(np.diag(likelihood_slopes(posterior, point).information))
    exact = np.asarray(jax.jit(jax.jacfwd(jax.jacfwd(value)))(point))
    found = expand_likelihood(posterior, point).hessian
    assert np.allclose(found / np.outer(scale, scale), exact / np.outer(scale, scale), atol=1e-5)


def test_a_delay_has_a_slope():
    time = np.arange(60) * 0.1
    rev = 12.5 + 4 * np.sin(1.3 * time)
    values = {**PUSHED, "delay": 0.234}
    posterior = posterior_of(values, [make_trial(time, rev, u=1.5 + 0.1 * np.sin(time))], delay=True)
    point = np.array(list(values.values()))

    def value(x):
        return posterior.likelihood(dict(zip(posterior.names, x, strict=True)), posterior.data)

    assert np.allclose(
        likelihood_slopes(posterior, point).gradient, jax.jit(jax.jacfwd(value))(point), rtol=1e-8, atol=1e-8
    )


def test_information_is_that_of_the_normal_density():
    """On average over data that the model makes: 200 replicates, within five standard errors of their mean."""
    values, varied = dict(PUSHED), ("disturbance_X", "disturbance_time_X", "sigma_u")
    posterior = posterior_of(values, [record()])
    at = [posterior.names.index(name) for name in varied]
    point = jnp.array(list(values.values()))
    named = {name: jnp.asarray(float(x)) for name, x in values.items()}

    def of_replicate(key):
        data = replicate(posterior.likelihood, named, posterior.data, key)
        return likelihood_slopes(Posterior(posterior.parameters, posterior.likelihood, data), point).information

    found = np.asarray(jax.lax.map(of_replicate, jax.random.split(jax.random.key(1), 200)))[:, at][:, :, at]
    cov = surge_law()[1]
    solved = []
    for name in ("sd", "tau"):
        size = {"sd": values["disturbance_X"], "tau": values["disturbance_time_X"]}
        up, down = ({**size, name: size[name] * (1 + sign * 1e-5)} for sign in (1, -1))
        change = (surge_law(**up)[1] - surge_law(**down)[1]) / (2e-5 * size[name])
        solved.append(np.linalg.solve(cov, change))
    solved.append(np.linalg.solve(cov, 2 * values["sigma_u"] * np.eye(N)))
    expected = np.array([[0.5 * np.trace(a @ b) for b in solved] for a in solved])
    error = found.std(0) / np.sqrt(len(found))
    assert (np.abs(found.mean(0) - expected) < 5 * error + 1e-6 * np.abs(expected)).all()


TRUE = {"X_u": -1.2, "X_uabsu": -2.9, "T_nabsn": 0.00159, "sigma_u": 0.01}
PUSHES = {"disturbance_X": 1.0, "disturbance_time_X": 3.0}
PRIORS = {
    "X_u": Normal(-1.2, 0.5),
    "X_uabsu": Uniform(-10.0, 0.0),
    "T_nabsn": LogUniform(5e-4, 5e-3),
    "sigma_u": LogUniform(1e-3, 0.3),
}
OF_PUSHES = {"disturbance_X": LogUniform(0.05, 20.0), "disturbance_time_X": LogUniform(0.1, 60.0)}


def pushed_run(seed, label):
    time = np.arange(400) * 0.25
    rng = np.random.default_rng(seed)
    n = N0 * (1 + 0.3 * np.repeat(rng.uniform(-1, 1, 20), 20))
    schedule = Schedule(time, {"n": n})
    return simulate(paper_model(), TRUE | PUSHES, schedule, ["u"], start={"u": U0}, key=seed, label=label)


@pytest.mark.proof
def test_bands_hold_where_the_vehicle_is_pushed():
    """60 vehicles: 90 % of the intervals of the drag hold it, and 90 % of a new run lies in the band; with white residuals far fewer."""
    inside = {}
    for name, priors in (("filter", PRIORS | OF_PUSHES), ("white", PRIORS)):
        drag, band = [], []
        for seed in range(60):
            posterior = make_posterior(paper_model(), pushed_run(2 * seed, "fit"), priors)
            mode = find_mode(posterior, key=seed)
            at = mode.names.index("X_uabsu")
            drag.append(abs(mode.values[at] - TRUE["X_uabsu"]) < 1.645 * mode.sd[at])
            new = pushed_run(2 * seed + 1, "new")
            beyond = make_posterior(paper_model(), new, priors)
            z = np.random.default_rng(seed).multivariate_normal(mode.z, mode.cov, 200)
            values = dict(zip(posterior.names, np.asarray(posterior.constrain(z)).T, strict=True))
            shown = np.asarray(outputs_of_draws(beyond.likelihood)(values, beyond.data, jax.random.key(seed)))
            shown = shown[:, : new.time.size, 0]
            sd = np.hypot(shown.std(0), values["sigma_u"].mean())
            band.append(np.mean(np.abs(new.channel("u") - shown.mean(0)) < 1.645 * sd))
        inside[name] = np.array(drag), np.array(band)
    drag, band = inside["filter"]
    assert abs(drag.mean() - 0.9) < 3 * np.sqrt(0.9 * 0.1 / 60)
    assert abs(band.mean() - 0.9) < 3 * band.std() / np.sqrt(60) + 0.01
    drag, band = inside["white"]
    assert drag.mean() < 0.9 - 3 * np.sqrt(0.9 * 0.1 / 60)
