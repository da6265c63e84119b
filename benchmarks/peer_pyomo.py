"""Pyomo.DoE on a D-optimal input, in an environment of its own: the problem comes as JSON on stdin, levels and seconds go to stdout.

Speeds are those of the trapezoidal rule on a grid coarser than the samples, each grid point measured as well as the samples it
stands for; sensitivities are central differences of whole models, which is how Pyomo.DoE works. IPOPT cannot be installed by pip;
the interior-point solver here is POUNCE, which reads the same files.
"""

import contextlib
import json
import logging
import sys
import time
from importlib.metadata import version

import numpy as np
import pyomo.environ as pyo  # pyright: ignore[reportMissingImports]
import pyomo_pounce  # noqa: F401  # pyright: ignore[reportMissingImports]
from pyomo.contrib.doe import DesignOfExperiments  # pyright: ignore[reportMissingImports]
from pyomo.contrib.parmest.experiment import Experiment  # pyright: ignore[reportMissingImports]


class Surge(Experiment):
    """The surge trial: speed at every grid point is measured, and the levels of the propeller speed are to be chosen."""

    def __init__(self, question: dict):
        self.question, self.model = question, None

    def get_labeled_model(self):
        """Build it once."""
        if self.model is None:
            self.model = _model(self.question)
        return self.model


def _model(question: dict):
    m = pyo.ConcreteModel()
    n, levels = question["grid"], question["levels"]
    step, per = question["duration"] / n, n // len(levels)
    m.points, m.intervals = pyo.RangeSet(0, n - 1), pyo.RangeSet(0, len(levels) - 1)
    m.control = pyo.Var(m.intervals, bounds=tuple(question["limits"]), initialize=dict(enumerate(levels)))
    m.x_u, m.x_uu, m.thrust = (pyo.Var(initialize=value) for value in question["coefficients"])
    for each in (m.x_u, m.x_uu, m.thrust):
        each.fix()
    speed = _speeds(question, n, step, per)
    m.u = pyo.Var(m.points, initialize=dict(enumerate(speed)), bounds=(0.1, 5.0))

    def rate(i: int, interval: int):
        force = m.x_u * m.u[i] + m.x_uu * m.u[i] ** 2 + question["share"] * m.thrust * m.control[interval] ** 2
        return force / question["mass"]

    m.begins = pyo.Constraint(expr=m.u[0] == question["start"])
    m.moves = pyo.Constraint(
        pyo.RangeSet(0, n - 2),
        rule=lambda _, i: m.u[i + 1] - m.u[i] == 0.5 * step * (rate(i, i // per) + rate(i + 1, i // per)),
    )
    for name in ("experiment_outputs", "measurement_error", "experiment_inputs", "unknown_parameters"):
        setattr(m, name, pyo.Suffix(direction=pyo.Suffix.LOCAL))
    for i in m.points:
        m.experiment_outputs[m.u[i]] = None
        m.measurement_error[m.u[i]] = question["sd"]
    for i in m.intervals:
        m.experiment_inputs[m.control[i]] = None
    for each, value in zip((m.x_u, m.x_uu, m.thrust), question["coefficients"], strict=True):
        m.unknown_parameters[each] = value
    return m


def _speeds(question: dict, n: int, step: float, per: int) -> list[float]:
    """First guess: explicit Euler."""
    x_u, x_uu, thrust = question["coefficients"]
    speed = [question["start"]]
    for i in range(n - 1):
        u, c = speed[-1], question["levels"][i // per]
        speed.append(u + step * (x_u * u + x_uu * u**2 + question["share"] * thrust * c**2) / question["mass"])
    return speed


def main() -> None:
    """Answer."""
    question = json.load(sys.stdin)
    logging.disable(logging.WARNING)
    begin = time.perf_counter()
    with contextlib.redirect_stdout(sys.stderr):
        solver = pyo.SolverFactory("pounce")
        solver.options["max_wall_time"] = question["cap"]
        solver.options["max_iter"] = 3000
        scale = np.array(question["coefficients"])
        doe = DesignOfExperiments(
            Surge(question),
            fd_formula="central",
            step=1e-3,
            objective_option="determinant",
            scale_nominal_param_value=True,
            prior_FIM=np.diag(scale**2 / np.array(question["prior_sd"]) ** 2),
            solver=solver,
            tee=bool(question.get("tee")),
        )
        status = "solved"
        try:
            doe.run_doe()
        except Exception as error:  # what ends it is reported beside what it had reached
            status = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        scenario = doe.model.scenario_blocks[0]
        levels = [float(pyo.value(scenario.control[i])) for i in scenario.intervals]
    names = f"Pyomo.DoE {version('pyomo')}, POUNCE {version('pounce-solver')}"
    json.dump({"name": names, "levels": levels, "seconds": time.perf_counter() - begin, "status": status}, sys.stdout)


if __name__ == "__main__":
    main()
