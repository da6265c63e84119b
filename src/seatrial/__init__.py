"""seatrial: design trials, estimate hydrodynamic coefficients with their uncertainty, select the terms.

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
    "run_loop": "seatrial.campaign.workflow.loop",
    "write_report": "seatrial.report.page",
    "configure": "seatrial.compiled.engine",
    "CoefficientName": "seatrial.core.coefficients",
    "Record": "seatrial.core.record",
    "SeatrialError": "seatrial.core.errors",
    "NumericalError": "seatrial.core.errors",
    "make_record": "seatrial.logs.record_of_columns:record_of_columns",
    "InputError": "seatrial.core.errors",
    "find_mode": "seatrial.estimation.posterior.mode",
    "sample": "seatrial.estimation.posterior.sample_posterior",
    "NestedSettings": "seatrial.estimation.posterior.sample_posterior",
    "ChainSettings": "seatrial.sampling.run",
    "Draws": "seatrial.sampling.run",
    "SMCSettings": "seatrial.sampling.tempered_smc",
    "posterior_of_density": "seatrial.estimation.posterior.posterior",
    "Posterior": "seatrial.estimation.posterior.posterior",
    "Mode": "seatrial.estimation.posterior.mode",
    "Normal": "seatrial.estimation.priors",
    "LogNormal": "seatrial.estimation.priors",
    "Uniform": "seatrial.estimation.priors",
    "LogUniform": "seatrial.estimation.priors",
    "half_normal": "seatrial.estimation.priors",
    "truncated_normal": "seatrial.estimation.priors",
    "log_evidence": "seatrial.selection.log_evidence:log_evidence",
    "Evidence": "seatrial.selection.verdict",
    "EvidenceSettings": "seatrial.selection.evidence",
    "compare": "seatrial.selection.compare",
    "Selection": "seatrial.selection.verdict",
    "load_vehicle": "seatrial.vehicles.catalogue",
    "vehicle_names": "seatrial.vehicles.catalogue",
    "make_vehicle": "seatrial.vehicles.catalogue",
    "Vehicle": "seatrial.vehicles.catalogue:PublishedVehicle",
    "Actuator": "seatrial.vehicles.actuators",
    "Family": "seatrial.manoeuvres.family",
    "Limits": "seatrial.manoeuvres.manoeuvre",
    "Schedule": "seatrial.manoeuvres.schedule",
    "simulate": "seatrial.estimation.posterior.simulated_record",
    "Sensor": "seatrial.estimation.simulation.sensor_errors",
    "read_log": "seatrial.logs.read_log:read_log",
    "Channel": "seatrial.core.record",
    "Provenance": "seatrial.core.record",
    "make_posterior": "seatrial.estimation.posterior.record_posterior",
    "predict": "seatrial.estimation.prediction.prediction",
    "Prediction": "seatrial.estimation.prediction.prediction",
    "design_trial": "seatrial.design.trial_design",
    "TrialDesign": "seatrial.design.trial_design",
    "export_vehicle": "seatrial.export.to_target:export_to",
    "Campaign": "seatrial.campaign.config.campaign",
    "Prior": "seatrial.estimation.priors",
    "EngineWarning": "seatrial.compiled.engine",
    "profile_likelihood": "seatrial.estimation.posterior.profile",
    "inspect_log": "seatrial.logs.inspect",
    "predict_from_prior": "seatrial.campaign.prior.predictive",
    "to_arviz": "seatrial.arviz_tree",
}
"""Module of every public name, and its name there where that is another."""
_MODULES = {"plot": "seatrial.plot"}
"""Modules that are names themselves."""
_LIGHT = ("seatrial.core.", "seatrial.logs.", "seatrial.compiled.engine")
"""Where nothing computes with JAX."""
__all__ = [
    "Actuator",
    "Campaign",
    "ChainSettings",
    "Channel",
    "CoefficientName",
    "Draws",
    "EngineWarning",
    "Evidence",
    "EvidenceSettings",
    "Family",
    "InputError",
    "Limits",
    "LogNormal",
    "LogUniform",
    "Mode",
    "NestedSettings",
    "Normal",
    "NumericalError",
    "Posterior",
    "Prediction",
    "Prior",
    "Provenance",
    "Record",
    "SMCSettings",
    "Schedule",
    "SeatrialError",
    "Selection",
    "Sensor",
    "TrialDesign",
    "Uniform",
    "Vehicle",
    "__version__",
    "compare",
    "configure",
    "design_first",
    "design_trial",
    "estimate_all",
    "export_vehicle",
    "find_mode",
    "get_trials",
    "half_normal",
    "init_campaign",
    "inspect_log",
    "load_campaign",
    "load_vehicle",
    "log_evidence",
    "make_posterior",
    "make_record",
    "make_vehicle",
    "plot",
    "posterior_of_density",
    "predict",
    "predict_from_prior",
    "profile_likelihood",
    "read_log",
    "run_loop",
    "sample",
    "select_structure",
    "simulate",
    "to_arviz",
    "truncated_normal",
    "vehicle_names",
    "write_report",
]

if TYPE_CHECKING:
    from seatrial import plot
    from seatrial.arviz_tree import to_arviz
    from seatrial.campaign.config.campaign import Campaign
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.config.templates import init_campaign
    from seatrial.campaign.data.import_logs import get_trials
    from seatrial.campaign.design.sweep import design_first
    from seatrial.campaign.inference.estimate import estimate_all
    from seatrial.campaign.prior.predictive import predict_from_prior
    from seatrial.campaign.selection.evidence import select_structure
    from seatrial.campaign.workflow.loop import run_loop
    from seatrial.compiled.engine import EngineWarning, configure
    from seatrial.core.coefficients import CoefficientName
    from seatrial.core.errors import InputError, NumericalError, SeatrialError
    from seatrial.core.record import Channel, Provenance, Record
    from seatrial.design.trial_design import TrialDesign, design_trial
    from seatrial.estimation.posterior.mode import Mode, find_mode
    from seatrial.estimation.posterior.posterior import Posterior, posterior_of_density
    from seatrial.estimation.posterior.profile import profile_likelihood
    from seatrial.estimation.posterior.record_posterior import make_posterior
    from seatrial.estimation.posterior.sample_posterior import NestedSettings, sample
    from seatrial.estimation.posterior.simulated_record import simulate
    from seatrial.estimation.prediction.prediction import Prediction, predict
    from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Prior, Uniform, half_normal, truncated_normal
    from seatrial.estimation.simulation.sensor_errors import Sensor
    from seatrial.export.to_target import export_to as export_vehicle
    from seatrial.logs.inspect import inspect_log
    from seatrial.logs.read_log import read_log
    from seatrial.logs.record_of_columns import record_of_columns as make_record
    from seatrial.manoeuvres.family import Family
    from seatrial.manoeuvres.manoeuvre import Limits
    from seatrial.manoeuvres.schedule import Schedule
    from seatrial.report.page import write_report
    from seatrial.sampling.run import ChainSettings, Draws
    from seatrial.sampling.tempered_smc import SMCSettings
    from seatrial.selection.compare import compare
    from seatrial.selection.evidence import EvidenceSettings
    from seatrial.selection.log_evidence import log_evidence
    from seatrial.selection.verdict import Evidence, Selection
    from seatrial.vehicles.actuators import Actuator
    from seatrial.vehicles.catalogue import PublishedVehicle as Vehicle
    from seatrial.vehicles.catalogue import load_vehicle, make_vehicle, vehicle_names


def __dir__() -> list[str]:
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name not in _HOME:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    module, _, there = _HOME[name].partition(":")
    if not module.startswith(_LIGHT):
        from seatrial.compiled import engine

        engine.prepare(tell=True)
    return getattr(import_module(module), there or name)
