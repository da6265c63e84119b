"""seatrial: design trials, estimate hydrodynamic coefficients with honest uncertainty, select the terms.

Importing the package is cheap and sets nothing: JAX and the rest load when a name that needs them is first used, and JAX is then set to
float64 (`configure`).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "load_campaign": "seatrial.campaign.config.load",
    "init_campaign": "seatrial.campaign.config.templates",
    "design_first": "seatrial.campaign.design.sweep",
    "get_trials": "seatrial.campaign.data.import_logs",
    "estimate_all": "seatrial.campaign.inference.estimate",
    "select_structure": "seatrial.campaign.selection.evidence",
    "run_loop": "seatrial.campaign.workflow.run",
    "write_report": "seatrial.report.page",
    "configure": "seatrial.core.engine",
    "CoefficientName": "seatrial.core.coefficients",
    "Record": "seatrial.core.record",
    "SeatrialError": "seatrial.core.errors",
    "NumericalError": "seatrial.core.errors",
    "make_record": "seatrial.core.record",
    "InputError": "seatrial.core.errors",
}
"""Module of every public name."""
_LIGHT = ("seatrial.core.", "seatrial.logs.")
"""Where nothing computes with JAX."""
__all__ = [
    "CoefficientName",
    "InputError",
    "NumericalError",
    "Record",
    "SeatrialError",
    "__version__",
    "configure",
    "design_first",
    "estimate_all",
    "get_trials",
    "init_campaign",
    "load_campaign",
    "make_record",
    "run_loop",
    "select_structure",
    "write_report",
]

if TYPE_CHECKING:
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.config.templates import init_campaign
    from seatrial.campaign.data.import_logs import get_trials
    from seatrial.campaign.design.sweep import design_first
    from seatrial.campaign.inference.estimate import estimate_all
    from seatrial.campaign.selection.evidence import select_structure
    from seatrial.campaign.workflow.run import run_loop
    from seatrial.core.coefficients import CoefficientName
    from seatrial.core.engine import configure
    from seatrial.core.errors import InputError, NumericalError, SeatrialError
    from seatrial.core.record import Record, make_record
    from seatrial.report.page import write_report


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    if not _HOME[name].startswith(_LIGHT):
        from seatrial.core import engine

        engine.prepare(tell=True)
    return getattr(import_module(_HOME[name]), name)
