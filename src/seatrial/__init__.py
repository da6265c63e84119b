"""seatrial: design trials, estimate hydrodynamic coefficients with honest uncertainty, select the terms the data support.

Importing the package is cheap: JAX and the rest load when a name that needs them is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from seatrial.core import engine

engine.configure()

__version__ = "0.1.0"

_HOME = {
    "CoefficientName": "seatrial.core.coefficients",
    "Record": "seatrial.core.record",
    "SeatrialError": "seatrial.core.errors",
    "InputError": "seatrial.core.errors",
}
__all__ = ["CoefficientName", "InputError", "Record", "SeatrialError", "__version__"]

if TYPE_CHECKING:
    from seatrial.core.coefficients import CoefficientName
    from seatrial.core.errors import InputError, SeatrialError
    from seatrial.core.record import Record


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
