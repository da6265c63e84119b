"""PyMC on the surge posterior, in an environment of its own: the problem comes as JSON on stdin, draws go to stdout.

The likelihood is a scan over the steps. Compilation is not timed, tuning is. How PyTensor compiles the scan changes the time
of an iteration and nothing else: each sampler makes its draws in the fast mode, and a few iterations time the default one.
"""

import json
import logging
import sys
import time

import numpy as np
import pymc as pm  # pyright: ignore[reportMissingImports]
import pytensor  # pyright: ignore[reportMissingImports]
import pytensor.tensor as pt  # pyright: ignore[reportMissingImports]

MODES = {"Numba": "NUMBA", "default": None}
"""The scan as one compiled loop, and what PyTensor does unasked: a compiled step that is called for each sample."""
TIMED = (20, 80)
"""Tuning steps and draws that time the default mode."""
GRADIENTS = 10
"""Gradients that are timed."""


def surge_model(problem: dict) -> pm.Model:
    """Uniform priors, output-error likelihood, classical Runge-Kutta with the input held."""
    h, mass, control = problem["step"], problem["mass"], np.array(problem["control"])
    with pm.Model() as model:
        bounds = zip(problem["names"], problem["lower"], problem["upper"], strict=True)
        linear, quadratic, thrust, sd = [pm.Uniform(name, lower, upper) for name, lower, upper in bounds]

        def step(drive, u, a, b, c):
            def rate(v):
                return v * (a + b * pt.abs(v)) + c * drive

            k1 = rate(u)
            k2 = rate(u + 0.5 * h * k1)
            k3 = rate(u + 0.5 * h * k2)
            k4 = rate(u + h * k3)
            return u + h / 6 * (k1 + 2 * (k2 + k3) + k4)

        speed = pytensor.scan(
            step,
            sequences=pt.constant(control[:-1] * np.abs(control[:-1])),
            outputs_info=pt.constant(problem["initial"], dtype="float64"),
            non_sequences=[linear / mass, quadratic / mass, thrust * problem["share"] / mass],
            return_updates=False,
        )
        trajectory = pt.concatenate([[problem["initial"]], speed])
        pm.Normal("u", trajectory, sd, observed=np.array(problem["measured"]))
    return model


def log_densities(problem: dict, mode: str | None) -> list[float]:
    """Log densities of the parameters at the problem's points."""
    density = surge_model(problem).compile_logp(jacobian=False, mode=mode)
    lower, upper = np.array(problem["lower"]), np.array(problem["upper"])
    names = [f"{name}_interval__" for name in problem["names"]]
    points = [np.log((x - lower) / (upper - x)) for x in np.array(problem["points"])]
    return [float(density(dict(zip(names, point, strict=True)))) for point in points]


def gradient_seconds(problem: dict, mode: str | None) -> float:
    """Seconds of one log density with its gradient, as NUTS takes them: the median of several."""
    model = surge_model(problem)
    function = model.logp_dlogp_function(ravel_inputs=True, mode=mode)
    function.set_extra_values({})
    lower, upper, x = (np.array(problem[name]) for name in ("lower", "upper", "start"))
    z, seconds = np.log((x - lower) / (upper - x)), []
    for _ in range(GRADIENTS + 1):
        start = time.perf_counter()
        function(z)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds[1:]))


def sample(problem: dict, method: str, mode: str | None, tune: int, draws: int) -> tuple[np.ndarray, float]:
    """Draws of one chain, shape (draws, d), and seconds per iteration."""
    names, compiled = problem["names"], {"mode": mode}
    with surge_model(problem):
        trace = pm.sample(
            draws,
            tune=tune,
            chains=1,
            cores=1,
            step=getattr(pm, method)(compile_kwargs=compiled),
            initvals=dict(zip(names, problem["start"], strict=True)),
            random_seed=0,
            progressbar=False,
            compute_convergence_checks=False,
            return_inferencedata=False,
            compile_kwargs=compiled,
        )
    return np.stack([trace.get_values(name) for name in names], -1), trace.report.t_sampling / (tune + draws)


def measure(problem: dict, method: str, tune: int, draws: int) -> dict:
    """A long run in the fast mode, and the time of an iteration in each."""
    values, fast = sample(problem, method, MODES["Numba"], tune, draws)
    _, default = sample(problem, method, MODES["default"], *TIMED)
    return {"values": values.tolist(), "seconds": {"Numba": fast, "default": default}}


def main() -> None:
    """Evaluate the density and time its gradient in each mode, and measure each sampler asked for."""
    problem = json.load(sys.stdin)
    logging.disable(logging.INFO)
    found = {
        "version": pm.__version__,
        "log_densities": {name: log_densities(problem, mode) for name, mode in MODES.items()},
        "gradient_seconds": {name: gradient_seconds(problem, mode) for name, mode in MODES.items()},
        "methods": {method: measure(problem, method, *sizes) for method, sizes in problem["methods"].items()},
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
