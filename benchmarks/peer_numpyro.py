"""NumPyro's NUTS on the surge posterior, in an environment of its own: the problem comes as JSON on stdin, findings go to stdout.

The model is what a user writes: a `lax.scan` over the steps, float64, four chains, everything else as it comes. How XLA compiles
the loop, and whether gradients go back through it or forward, change the time of a gradient and nothing else. So asked for
`draws` this program, compiled the fastest way, makes draws and counts their gradients; asked for `times` it times gradients.
"""

import json
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import numpyro  # pyright: ignore[reportMissingImports]
import numpyro.distributions as dist  # pyright: ignore[reportMissingImports]
from numpyro.infer import NUTS, init_to_value  # pyright: ignore[reportMissingImports]
from numpyro.infer.util import log_density  # pyright: ignore[reportMissingImports]

CHAINS = 4
TIMED = 4
"""Transitions that are timed."""


def surge_model(problem: dict):
    """Uniform priors, output-error likelihood, classical Runge-Kutta with the input held."""
    h, mass, share = problem["step"], problem["mass"], problem["share"]
    control, measured = jnp.array(problem["control"]), jnp.array(problem["measured"])
    bounds = list(zip(problem["names"], problem["lower"], problem["upper"], strict=True))

    def model():
        linear, quadratic, thrust, sd = (numpyro.sample(name, dist.Uniform(low, high)) for name, low, high in bounds)

        def advance(u, n):
            def rate(v):
                return (linear * v + quadratic * v * jnp.abs(v) + share * thrust * n * jnp.abs(n)) / mass

            k1 = rate(u)
            k2 = rate(u + 0.5 * h * k1)
            k3 = rate(u + 0.5 * h * k2)
            k4 = rate(u + h * k3)
            return u + h / 6 * (k1 + 2 * (k2 + k3) + k4), u

        _, speed = jax.lax.scan(advance, jnp.array(problem["initial"]), control)
        numpyro.sample("u", dist.Normal(speed, sd), obs=measured)

    return model


def log_densities(problem: dict) -> list[float]:
    """Log densities of the parameters at the problem's points."""
    model = surge_model(problem)
    density = jax.jit(lambda point: log_density(model, (), {}, dict(zip(problem["names"], point, strict=True)))[0])
    return [float(density(jnp.array(point))) for point in problem["points"]]


def draws(problem: dict) -> dict:
    """Draws of four chains, shape (chains, draws, d), their seconds, and the gradients in them: of all chains and of the longest."""
    warmup, kept = problem["warmup"], problem["draws"]
    advance, state, values = _chains(problem, CHAINS, warmup, forward_mode_differentiation=True)
    start, states = time.perf_counter(), []
    for _ in range(warmup + kept):
        state = advance(state)
        states.append(jax.tree.map(np.asarray, {"z": state.z, "steps": state.num_steps}))
    seconds = time.perf_counter() - start
    steps = np.stack([one["steps"] for one in states], -1)
    samples = [values(one["z"]) for one in states[warmup:]]
    drawn = np.stack([np.stack([x[name] for name in problem["names"]], -1) for x in samples], 1)
    return {
        "version": numpyro.__version__,
        "log_densities": log_densities(problem),
        "values": drawn.tolist(),
        "seconds": seconds,
        "gradients": {"in turn": int(steps.sum()), "side by side": int(steps.max(0).sum())},
    }


def times(problem: dict) -> dict:
    """Seconds of one gradient inside the sampler, compiled as it comes: of one chain, and of four side by side."""
    found = {}
    for way, chains in (("in turn", 1), ("side by side", CHAINS)):
        advance, state, _ = _chains(problem, chains, 0, step_size=1e-3, max_tree_depth=5)
        start, steps = time.perf_counter(), 0
        for _ in range(TIMED):
            state = advance(state)
            steps += int(np.max(state.num_steps))
        found[way] = (time.perf_counter() - start) / steps
    return found


def _chains(problem: dict, chains: int, warmup: int, **options):
    """One transition of all chains, compiled, the state before the first, and values from positions."""
    begin = init_to_value(values=dict(zip(problem["names"], problem["start"], strict=True)))
    kernel = NUTS(surge_model(problem), init_strategy=begin, **options)
    state = kernel.init(jax.random.split(jax.random.key(0), chains), warmup, None, (), {})
    # Types that no transition changes: it would be compiled twice.
    state = jax.tree.map(lambda x: jnp.asarray(x, jnp.asarray(x).dtype), state)
    advance = jax.jit(lambda state: kernel.sample(state, (), {}))
    advance(state)
    return advance, state, jax.vmap(kernel.postprocess_fn((), {}))


def main() -> None:
    """Do what the problem asks for."""
    numpyro.enable_x64()
    problem = json.load(sys.stdin)
    print(json.dumps({"draws": draws, "times": times}[problem["task"]](problem)))


if __name__ == "__main__":
    main()
