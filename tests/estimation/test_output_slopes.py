"""Slopes of an output-error likelihood against derivatives by JAX, and its information against the Hessian of data without residuals."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.signals import QUATERNION
from seatrial.estimation.posterior.information import _simulated_data, expand_likelihood
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.posterior import Parameter, Posterior
from seatrial.estimation.posterior.simulated_record import simulate
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.priors import Normal
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.manoeuvres.schedule import Schedule
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.catalogue import load_vehicle
from tests.cases import U0
from tests.estimation.test_output_error import VALUES, made, trial

KINDS = {
    "white": {},
    "heavy": {"dof_u": 5.0, "dof_udot": 9.0},
    "proportional": {"share_u": 0.05, "share_udot": 0.1},
    "coloured": {"tau_u": 0.4, "tau_udot": 1.5},
    "drifting": {"drift_u": 0.03, "drift_udot": 0.02, "drift_time_u": 0.7, "drift_time_udot": 2.0},
}


@pytest.fixture(
    scope="module",
    params=[
        "white",
        "proportional",
        *(pytest.param(kind, marks=pytest.mark.proof) for kind in ("drifting", "heavy", "coloured")),
    ],
)
def case(request):
    """Two trials, one with gaps and both with a start of their own, at a point off the mode."""
    values = {**VALUES, **KINDS[request.param], "u_0[a]": U0 + 0.01, "u_0[b]": U0}
    values["X_u"] *= 1.05
    records = [trial(label="a", gaps=(3, 17, 18)), trial(seed=1, label="b")]
    likelihood, data = made(records, initial=[(U0,)] * 2, noise=request.param, free_initial=True)
    parameters = tuple(Parameter(name, "1", name, Normal(0.0, 1.0)) for name in values)
    return Posterior(parameters, likelihood, data), np.array(list(values.values()))


@jax.jit
def exact(posterior, point):
    """Value, gradient and Hessian by JAX."""

    def value(x):
        return posterior.likelihood(dict(zip(posterior.names, x, strict=True)), posterior.data)

    return value(point), jax.jacfwd(value)(point), jax.hessian(value)(point)


def test_value_gradient_and_hessian(case):
    posterior, point = case
    value, gradient, hessian = map(np.asarray, exact(posterior, point))
    found = expand_likelihood(posterior, point)
    size = np.sqrt(np.abs(np.diag(hessian)))
    assert found.value == pytest.approx(value, abs=1e-9)
    np.testing.assert_allclose(found.gradient / size, gradient / size, atol=1e-9)
    np.testing.assert_allclose(found.hessian / np.outer(size, size), hessian / np.outer(size, size), atol=1e-5)


@pytest.mark.proof
def test_hessian_of_a_whole_vehicle():
    """Central differences of gradients of the plain likelihood: attitude by quaternion, late thrusters, starts sought."""
    vehicle, rng = load_vehicle("bluerov2_heavy"), np.random.default_rng(3)
    values = {"X_u": -11.0, "X_uabsu": -120.0, "Z_wabsw": -150.0, "M_q": -0.6, "N_rabsr": -1.9}
    model = vehicle.build(free=list(values), attitude="quaternion", positions=("z",))
    model = with_actuators(model, {name: Actuator(0.15) for name in model.controls})
    n, begin = 1000, {**dict.fromkeys("uvwpqr", 0.1), "z": 2.0}  # at rest drag has a kink
    push = {name: np.repeat(rng.uniform(-15, 15, n // 25), 25) for name in model.controls}
    noise = dict(zip((*"uvwpqrz", *QUATERNION), [0.01] * 3 + [0.005] * 3 + [0.02] + [0.005] * 4, strict=True))
    values |= {f"sigma_{name}": sd for name, sd in noise.items()}
    record = simulate(
        model,
        values,
        Schedule(0.02 * np.arange(n), push),
        list(noise),
        start=begin,
        key=1,
        label="a",
    )
    sensors = [Sensor(name) for name in noise]
    start = [1.0 if name == "q_w" else begin.get(name, 0.0) for name in model.states]
    likelihood, data = output_error(model, [record], sensors, [start], free_initial=True)
    values |= {f"{name}_0[a]": start[model.states.index(name)] for name in ("u", "q", "z", "q_x")}
    posterior = Posterior(tuple(Parameter(name, "1", name, Normal(0.0, 1.0)) for name in values), likelihood, data)
    point = np.array(list(values.values()))
    found = expand_likelihood(posterior, point)

    @jax.jit
    def gradient(point):
        return jax.jacfwd(lambda x: likelihood(dict(zip(values, x, strict=True)), data))(point)

    size = np.sqrt(np.diag(-found.hessian))
    steps = np.diag(1e-3 / size)
    dense = np.array([np.asarray(gradient(point + one) - gradient(point - one)) / (2 * one.sum()) for one in steps])
    np.testing.assert_allclose(found.gradient / size, gradient(point) / size, atol=1e-8)
    np.testing.assert_allclose(found.hessian / np.outer(size, size), dense / np.outer(size, size), atol=1e-5)


def test_information_is_minus_the_hessian_where_no_residual_is_left(case):
    posterior, point = case
    still = replace(posterior, data=_simulated_data(posterior, jnp.asarray(point)))
    information = likelihood_slopes(still, point).information
    hessian = exact(still, point)[2]
    size = np.sqrt(np.abs(np.diag(hessian)))
    # Where noise is in proportion to the signal, the bend of the motion has a slope of the logarithm of the noise for a factor.
    atol = 0.01 if "share_u" in posterior.names else 1e-9
    np.testing.assert_allclose(information / np.outer(size, size), -hessian / np.outer(size, size), atol=atol)
