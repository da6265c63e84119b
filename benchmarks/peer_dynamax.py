"""dynamax's unscented filter on the surge vehicle, in an environment of its own: the problem comes as JSON on stdin, findings go to stdout.

Speed and coefficients are the state, u and udot are measured; points, prior and noise are ours. dynamax gives the step to a sample that
sample's input, so its inputs hold the last control beside the present one. It filters one record, and many of them mapped.
"""

import json
import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams  # pyright: ignore[reportMissingImports]
from dynamax.nonlinear_gaussian_ssm import unscented_kalman_filter as ukf  # pyright: ignore[reportMissingImports]
from timing import processor_seconds

REPEATS = 5
POINTS = UKFHyperParams(alpha=1.0, beta=2.0, kappa=0.0)


def surge_filter(problem: dict):
    """Return a function of control, shape (n,), and measurements, shape (n, 2), that gives filtered means and covariances."""
    h, mass, share, scales = problem["step"], problem["mass"], problem["share"], jnp.array(problem["scales"])

    def rate(u, coefficients, control):
        linear, quadratic, thrust = coefficients * scales
        return (linear * u + quadratic * u * jnp.abs(u) + share * thrust * control * jnp.abs(control)) / mass

    def move(x, inputs):
        u, c, n = x[0], x[1:], inputs[1]
        k1 = rate(u, c, n)
        k2 = rate(u + 0.5 * h * k1, c, n)
        k3 = rate(u + 0.5 * h * k2, c, n)
        k4 = rate(u + h * k3, c, n)
        return x.at[0].add(h / 6 * (k1 + 2 * (k2 + k3) + k4))

    def observe(x, inputs):
        return jnp.array([x[0], rate(x[0], x[1:], inputs[0])])

    parameters = ParamsNLGSSM(
        initial_mean=jnp.array(problem["mean"]),
        initial_covariance=jnp.array(problem["cov"]),
        dynamics_function=move,
        dynamics_covariance=jnp.diag(jnp.array(problem["process_sd"]) ** 2),
        emission_function=observe,
        emission_covariance=jnp.diag(jnp.array(problem["measurement_sd"]) ** 2),
    )

    def run(control, measured):
        inputs = jnp.stack([control, jnp.roll(control, 1)], -1)
        found = ukf(parameters, measured, POINTS, inputs, ["filtered_means", "filtered_covariances"])
        return found.filtered_means, found.filtered_covariances

    return run


def main() -> None:
    """Filter one record and many."""
    jax.config.update("jax_enable_x64", True)
    problem = json.load(sys.stdin)
    run, control, measured = surge_filter(problem), jnp.array(problem["control"]), jnp.array(problem["measured"])
    one, many = jax.jit(run), jax.jit(jax.vmap(lambda n, y: run(n, y)[1][-1]))
    lanes, samples = problem["lanes"], problem["lane_samples"]
    rows = jnp.tile(control[:samples], (lanes, 1)), jnp.tile(measured[:samples], (lanes, 1, 1))
    (means, covs), first, again = processor_seconds(lambda: jax.block_until_ready(one(control, measured)), REPEATS)
    _, _, mapped = processor_seconds(lambda: jax.block_until_ready(many(*rows)), REPEATS)
    found = {
        "version": version("dynamax"),
        "means": np.asarray(means).tolist(),
        "sds": np.sqrt(np.diagonal(np.asarray(covs), axis1=1, axis2=2)).tolist(),
        "first": first,
        "again": again.tolist(),
        "mapped": mapped.tolist(),
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
