"""MuJoCo's system identification of the surge vehicle, in an environment of its own: the log comes as JSON on stdin, findings go to stdout.

The vehicle is a mass on a slide: linear and quadratic drag are the polynomial damping of its joint, a motor pushes with n|n|, and the
classical Runge-Kutta steps are ours. `mujoco.sysid` fits the three coefficients by its own least squares, with finite differences, from
the middle of their priors, and gives confidence intervals.
"""

import contextlib
import json
import logging
import sys
from functools import partial

import mujoco  # pyright: ignore[reportMissingImports]
import numpy as np
from mujoco import sysid  # pyright: ignore[reportMissingImports]
from timing import processor_seconds

REPEATS = 5
MODEL = """
<mujoco>
  <option timestep="{step}" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="vehicle">
      <joint name="surge" type="slide" axis="1 0 0"/>
      <geom type="sphere" size="0.1" mass="{mass}"/>
    </body>
  </worldbody>
  <actuator><motor name="thruster" joint="surge"/></actuator>
</mujoco>
"""


def fit(question: dict) -> dict[str, list[float]]:
    """Return coefficients and half the widths of their 95 % intervals, SI."""
    spec = mujoco.MjSpec.from_string(MODEL.format(**question))  # pyright: ignore[reportAttributeAccessIssue]
    model = spec.compile()
    control, speed = np.array(question["control"]), np.array(question["measured"])
    times = question["step"] * np.arange(speed.size)
    push = sysid.TimeSeries.from_control_names(times, (control * np.abs(control))[:, None], model)
    measured = sysid.TimeSeries.from_names(times, speed[:, None], model, ["surge_qvel"])
    start = sysid.create_initial_state(model, np.zeros(1), np.array([question["initial"]]))
    sequences = sysid.ModelSequences("surge", spec, "trial", start, push, measured, allow_missing_sensors=True)
    parameters = sysid.ParameterDict()
    for i, name in enumerate(question["names"]):
        low, high = question["lower"][i], question["upper"][i]
        modifier = partial(_write, name, question["share"])
        parameters.add(sysid.Parameter(name, 0.5 * (low + high), low, high, modifier=modifier))
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    found, result = sysid.optimize(parameters, residual, verbose=False, x_scale="jac")
    left, _, _ = residual(result.x, found)
    _, widths = sysid.calculate_intervals(left, result.jac)
    return {"values": result.x.tolist(), "half_widths": np.asarray(widths).tolist()}


def _write(name: str, share: float, spec, parameter) -> None:
    """Put a coefficient into the model."""
    value = float(parameter.value[0])
    if name == "T_nabsn":
        spec.actuator("thruster").gear[0] = share * value
    else:
        spec.joint("surge").damping[("X_u", "X_uabsu").index(name)] = -value


def main() -> None:
    """Answer."""
    logging.disable(logging.WARNING)
    question = json.load(sys.stdin)
    with contextlib.redirect_stdout(sys.stderr):
        found, first, again = processor_seconds(lambda: fit(question), REPEATS)
    json.dump(found | {"version": mujoco.__version__, "first": first, "again": again.tolist()}, sys.stdout)


if __name__ == "__main__":
    main()
