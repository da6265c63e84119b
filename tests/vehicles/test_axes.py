"""A vehicle from equations of axes, against hand-written equations integrated by SciPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.simulate import simulate

SWAY = axis_equation("Y", ("Y_v", "Y_ur", "Y_uudelta_r", "Y_vabsv"), inertia=40.0)
YAW = axis_equation("N", ("N_r", "N_uv", "N_uudelta_r"), inertia=5.0, known={"N_0": 0.2})
VALUES = {"Y_v": -30.0, "Y_ur": -35.0, "Y_uudelta_r": 9.0, "Y_vabsv": -60.0}
VALUES |= {"N_r": -8.0, "N_uv": -4.0, "N_uudelta_r": -6.0}


def test_sway_and_yaw_against_another_integrator():
    model = axes_vehicle("hull", (SWAY, YAW), per_unit_inertia=False)
    assert model.states == ("v", "r")
    assert model.controls == ("u", "delta_r")
    u, rudder = 1.5, 0.3

    def rate(_, state):
        v, r = state
        sway = VALUES["Y_v"] * v + VALUES["Y_ur"] * u * r + VALUES["Y_uudelta_r"] * u**2 * rudder
        yaw = VALUES["N_r"] * r + VALUES["N_uv"] * u * v + VALUES["N_uudelta_r"] * u**2 * rudder + 0.2
        return (sway + VALUES["Y_vabsv"] * abs(v) * v) / 40.0, yaw / 5.0

    time = np.linspace(0.0, 10.0, 201)
    control = jnp.tile(jnp.array([u, rudder]), (201, 1))
    found = simulate(model, VALUES, control, jnp.full(201, 0.05), jnp.array([0.1, -0.05]))
    peer = solve_ivp(rate, (0.0, 10.0), (0.1, -0.05), t_eval=time, rtol=1e-10, atol=1e-12).y.T
    assert np.abs(np.asarray(found) - peer).max() < 1e-6


def test_units_by_an_unknown_inertia():
    model = axes_vehicle("hull", (axis_equation("Y", ("Y_v",)), axis_equation("N", ("N_r",))))
    units = [model.unit_of(CoefficientName.parse(name)) for name in ("Y_v", "N_r")]
    assert units == ["1/s", "1/s"]


@pytest.mark.parametrize(
    ("equations", "words"),
    [
        ((), "no equation"),
        ((YAW, YAW), "each axis once"),
        ((axis_equation("Y", ("Y_v", "Y_rdot")),), "an acceleration"),
    ],
)
def test_what_is_refused(equations, words):
    with pytest.raises(InputError, match=words):
        axes_vehicle("hull", equations)
