"""CasADi: a Python module with the symbolic right side, a Runge-Kutta step and the posterior as arrays; it imports only casadi.

    f(x, u, p, current) -> rate of the state        F(x, u, p, current, dt) -> state one step later

Source: CasADi's documentation of `SX` and `Function` (version 3.8).
"""

from dataclasses import dataclass

from seatrial.export.equations import check_mass, docstring_line, listed_numbers, source_of, state_lines
from seatrial.export.motion import motion_of
from seatrial.export.stability import check_stable
from seatrial.export.target import Carried, Statement
from seatrial.export.vehicle import UNCERTAINTY, ExportedVehicle
from seatrial.export.xml_text import identifier


@dataclass(frozen=True)
class CasadiModule:
    """See the module."""

    name: str = "casadi"
    target: str = "CasADi 3.6 to 3.8, a Python module"

    def check(self, vehicle: ExportedVehicle) -> None:
        """See `Exporter`."""
        check_mass(vehicle, self.name)
        check_stable(vehicle, self.name)

    def carries(self, vehicle: ExportedVehicle) -> Carried:
        """See `Exporter`: everything, since its code is written out."""
        return Carried(motion_of(vehicle), actuators=vehicle.actuators)

    def write(self, vehicle: ExportedVehicle, statement: Statement) -> dict[str, str]:
        """See `Exporter`."""
        estimated = vehicle.estimated
        parts = {
            "DOC": "\n".join(map(docstring_line, [*statement.lines, "", *state_lines(vehicle), *_NOTES, UNCERTAINTY])),
            "SOURCE": source_of(vehicle),
            "NAMES": repr(estimated.names),
            "MEAN": listed_numbers(estimated.mean),
            "COVARIANCE": "[\n" + "".join(f"    {listed_numbers(row)},\n" for row in estimated.covariance) + "]",
        }
        text = _TEMPLATE
        for key, value in parts.items():
            text = text.replace(f"@{key}@", value)
        return {f"{identifier(vehicle.name)}.py": text}


_NOTES = (
    "f(x, u, p, current) is the rate of the state, F(x, u, p, current, dt) the state after a step of dt seconds with u held (Runge-Kutta).",
    "x, u and p are columns in the order of STATES, CONTROLS and PARAMETERS; P holds the values of PARAMETERS; current is the velocity",
    "of the water, north, east and down. ESTIMATED names the coefficients of MEAN and COVARIANCE; INDEX is their place in p.",
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
