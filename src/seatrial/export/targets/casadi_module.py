"""CasADi: a Python module with the symbolic right side, a Runge-Kutta step and the posterior as arrays; it imports only casadi.

    f(x, u, p, current) -> rate of the state        F(x, u, p, current, dt) -> state one step later

Source: CasADi's documentation of `SX` and `Function` (version 3.8).
"""

from dataclasses import dataclass

from seatrial.export.equations import listed_numbers, python_module
from seatrial.export.target import Exporter, Statement
from seatrial.export.vehicle import UNCERTAINTY, ExportedVehicle
from seatrial.export.xml_text import identifier


@dataclass(frozen=True)
class CasadiModule(Exporter):
    """See the module."""

    name: str = "casadi"
    target: str = "CasADi 3.6 to 3.8, a Python module"
    simulates = "moves"

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        estimated = vehicle.estimated
        rows = "".join(f"    {listed_numbers(row)},\n" for row in estimated.covariance)
        made = {"NAMES": repr(estimated.names), "MEAN": listed_numbers(estimated.mean), "COVARIANCE": f"[\n{rows}]"}
        text = python_module(_TEMPLATE, vehicle, statement.lines, (*_NOTES, UNCERTAINTY), **made)
        return {f"{identifier(vehicle.name)}.py": text}


_NOTES = (
    "f(x, u, p, current) is the rate of the state, F(x, u, p, current, dt) the state after a step of dt seconds with u held (Runge-Kutta).",
    "x, u and p are columns in the order of STATES, CONTROLS and PARAMETERS; P holds the values of PARAMETERS; current is the velocity",
    "of the water, north, east and down. Lagging actuators begin where x says; followed(u) is their part of x if they have followed u.",
    "ESTIMATED names the coefficients of MEAN and COVARIANCE; INDEX is their place in p.",
)
_TEMPLATE = '''"""
@DOC@
"""

import casadi
from casadi import cos, fmax, fmin, sin, tan

@SOURCE@

P = casadi.DM(list(PARAMETERS.values()))
ESTIMATED = @NAMES@
INDEX = [list(PARAMETERS).index(name) for name in ESTIMATED]
MEAN = casadi.DM(@MEAN@)
COVARIANCE = casadi.DM(@COVARIANCE@)


def _functions():
    x, u, p = (casadi.SX.sym(key, len(names)) for key, names in zip("xup", (STATES, CONTROLS, PARAMETERS)))
    current, dt = casadi.SX.sym("current", 3), casadi.SX.sym("dt")
    state, control, parameters, water = ([one[i] for i in range(one.numel())] for one in (x, u, p, current))
    rate = casadi.vertcat(*derivative(state, control, parameters, water))
    after = casadi.vertcat(*runge_kutta(state, control, parameters, dt, water))
    return (
        casadi.Function("f", [x, u, p, current], [rate], ["x", "u", "p", "current"], ["rate"]),
        casadi.Function("F", [x, u, p, current, dt], [after], ["x", "u", "p", "current", "dt"], ["after"]),
    )


f, F = _functions()
'''
