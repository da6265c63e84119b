"""pyPESTO's profile likelihoods of the surge problem, in an environment of its own: JSON comes on stdin, intervals go to stdout.

The negative log-likelihood is what a user writes in JAX: a `lax.scan` over the steps, float64, with its gradient in forward mode, which
here takes a fraction of the time of reverse mode. Parameters are given in shares of their prior's range, and steps are relative to it:
the default steps of absolute size are longer than the range of the thrust. The optimiser is TNC, begun once, at the middle of the priors:
with L-BFGS-B, which comes unasked, profiles leave the ridge, and two of the eight ends are wrong. The rest is as it comes.
"""

import json
import logging
import sys
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pypesto  # pyright: ignore[reportMissingImports]
import pypesto.optimize  # pyright: ignore[reportMissingImports]
import pypesto.profile  # pyright: ignore[reportMissingImports]
from timing import processor_seconds

REPEATS = 2


def objective(problem: dict) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
    """Return the negative log-likelihood of parameters in shares of their range, shape (4,), and its gradient."""
    h, mass, share = problem["step"], problem["mass"], problem["share"]
    control, measured = jnp.array(problem["control"]), jnp.array(problem["measured"])
    lower, upper = jnp.array(problem["lower"]), jnp.array(problem["upper"])

    def value(x):
        linear, quadratic, thrust, sd = lower + x * (upper - lower)

        def advance(u, n):
            def rate(v):
                return (linear * v + quadratic * v * jnp.abs(v) + share * thrust * n * jnp.abs(n)) / mass

            k1 = rate(u)
            k2 = rate(u + 0.5 * h * k1)
            k3 = rate(u + 0.5 * h * k2)
            k4 = rate(u + h * k3)
            return u + h / 6 * (k1 + 2 * (k2 + k3) + k4), u

        _, speed = jax.lax.scan(advance, jnp.array(problem["initial"]), control)
        return 0.5 * jnp.sum(((measured - speed) / sd) ** 2) + measured.size * jnp.log(sd)

    compiled = jax.jit(lambda x: (value(x), jax.jacfwd(value)(x)))

    def both(x: np.ndarray) -> tuple[float, np.ndarray]:
        height, gradient = compiled(x)
        return float(height), np.array(gradient)

    return both


def profiles(problem: dict, function: Callable) -> dict[str, list[float]]:
    """Return the ends of the intervals by name, SI: where the log-likelihood has fallen by `drop`, on straight lines of the fall's root."""
    lower, upper, names = np.array(problem["lower"]), np.array(problem["upper"]), problem["names"]
    asked = pypesto.Problem(
        pypesto.Objective(fun=function, grad=True), np.full(lower.size, 1e-6), np.ones(lower.size), x_names=names
    )
    asked.set_x_guesses(np.full((1, lower.size), 0.5))
    optimizer = pypesto.optimize.ScipyOptimizer("TNC")
    options = pypesto.profile.ProfileOptions(default_step_size_absolute=0.0)
    result = pypesto.optimize.minimize(asked, optimizer, n_starts=1, progress_bar=False)
    result = pypesto.profile.parameter_profile(asked, result, optimizer, profile_options=options, progress_bar=False)
    ends = {}
    for i, name in enumerate(names):
        path = result.profile_result.get_profiler_result(i_par=i)
        x, root = path.x_path[i], np.sqrt(np.maximum(-2 * np.log(path.ratio_path), 0.0))
        best, at = int(np.argmin(root)), np.sqrt(2 * problem["drop"])
        shares = [np.interp(at, root[side], x[side]) for side in (slice(best, None, -1), slice(best, None))]
        ends[name] = (lower[i] + np.array(shares) * (upper[i] - lower[i])).tolist()
    return ends


def main() -> None:
    """Answer: the first time with the compilation of the likelihood."""
    jax.config.update("jax_enable_x64", True)
    logging.disable(logging.WARNING)
    problem = json.load(sys.stdin)
    function = objective(problem)
    ends, first, again = processor_seconds(lambda: profiles(problem, function), REPEATS)
    json.dump({"version": pypesto.__version__, "ends": ends, "first": first, "again": again.tolist()}, sys.stdout)


if __name__ == "__main__":
    main()
