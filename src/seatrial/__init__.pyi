"""Public names of seatrial and their modules: `seatrial.__getattr__` loads each from here when it is first used."""

from seatrial import plot as plot
from seatrial.arviz_tree import to_arviz as to_arviz
from seatrial.campaign.config.campaign import Campaign as Campaign
from seatrial.campaign.config.load import load_campaign as load_campaign
from seatrial.campaign.config.templates import init_campaign as init_campaign
from seatrial.campaign.data.import_logs import get_trials as get_trials
from seatrial.campaign.design.sweep import design_first as design_first
from seatrial.campaign.inference.estimate import estimate_all as estimate_all
from seatrial.campaign.prior.predictive import predict_from_prior as predict_from_prior
from seatrial.campaign.selection.evidence import select_structure as select_structure
from seatrial.campaign.workflow.loop import run_loop as run_loop
from seatrial.compiled.engine import EngineWarning as EngineWarning
from seatrial.compiled.engine import configure as configure
from seatrial.core.coefficients import CoefficientName as CoefficientName
from seatrial.core.errors import (
    InputError as InputError,
)
from seatrial.core.errors import (
    NumericalError as NumericalError,
)
from seatrial.core.errors import (
    SeatrialError as SeatrialError,
)
from seatrial.core.record import Channel as Channel
from seatrial.core.record import Provenance as Provenance
from seatrial.core.record import Record as Record
from seatrial.design.batch import BatchSearch as BatchSearch
from seatrial.design.free_form import FreeFormSearch as FreeFormSearch
from seatrial.design.global_search import GlobalSearch as GlobalSearch
from seatrial.design.relay_sweep import RelaySearch as RelaySearch
from seatrial.design.trial_design import TrialDesign as TrialDesign
from seatrial.design.trial_design import design_trial as design_trial
from seatrial.design.trial_design import make_design_problem as make_design_problem
from seatrial.estimation.diagnostics.error_budget import ErrorBudget as ErrorBudget
from seatrial.estimation.diagnostics.error_budget import error_budget as error_budget
from seatrial.estimation.diagnostics.error_sources import StatedErrors as StatedErrors
from seatrial.estimation.posterior.configurations import ConfigurationDifference as ConfigurationDifference
from seatrial.estimation.posterior.configurations import configuration_differences as configuration_differences
from seatrial.estimation.posterior.mode import Mode as Mode
from seatrial.estimation.posterior.mode import find_mode as find_mode
from seatrial.estimation.posterior.posterior import Posterior as Posterior
from seatrial.estimation.posterior.posterior import posterior_of_density as posterior_of_density
from seatrial.estimation.posterior.profile import profile_likelihood as profile_likelihood
from seatrial.estimation.posterior.record_posterior import make_posterior as make_posterior
from seatrial.estimation.posterior.sample_posterior import NestedSettings as NestedSettings
from seatrial.estimation.posterior.sample_posterior import sample as sample
from seatrial.estimation.posterior.simulated_record import simulate as simulate
from seatrial.estimation.posterior.simulated_record import simulate_motion as simulate_motion
from seatrial.estimation.prediction.prediction import Prediction as Prediction
from seatrial.estimation.prediction.prediction import predict as predict
from seatrial.estimation.prediction.tweak import Tweak as Tweak
from seatrial.estimation.prediction.tweak import tweak as tweak
from seatrial.estimation.priors import (
    LogNormal as LogNormal,
)
from seatrial.estimation.priors import (
    LogUniform as LogUniform,
)
from seatrial.estimation.priors import (
    Normal as Normal,
)
from seatrial.estimation.priors import (
    Prior as Prior,
)
from seatrial.estimation.priors import (
    Uniform as Uniform,
)
from seatrial.estimation.priors import (
    half_normal as half_normal,
)
from seatrial.estimation.priors import (
    truncated_normal as truncated_normal,
)
from seatrial.estimation.priors.from_shape import ShapePriors as ShapePriors
from seatrial.estimation.priors.from_shape import priors_from_shape as priors_from_shape
from seatrial.estimation.simulation.sensor_errors import Sensor as Sensor
from seatrial.export.from_campaign import export_to
from seatrial.logs.inspect import inspect_log as inspect_log
from seatrial.logs.read_log import read_log as read_log
from seatrial.logs.read_log import record_of_columns, record_of_table
from seatrial.manoeuvres.family import Family as Family
from seatrial.manoeuvres.manoeuvre import Limits as Limits
from seatrial.manoeuvres.schedule import Schedule as Schedule
from seatrial.report.page import write_report as write_report
from seatrial.sampling.run import ChainSettings as ChainSettings
from seatrial.sampling.run import Draws as Draws
from seatrial.sampling.tempered_smc import SMCSettings as SMCSettings
from seatrial.selection.compare import compare as compare
from seatrial.selection.evidence import EvidenceSettings as EvidenceSettings
from seatrial.selection.leave_one_run_out import leave_one_run_out as leave_one_run_out
from seatrial.selection.log_evidence import log_evidence as log_evidence
from seatrial.selection.stack import stacking_weights as stacking_weights
from seatrial.selection.verdict import Evidence as Evidence
from seatrial.selection.verdict import Selection as Selection
from seatrial.vehicles.actuators import Actuator as Actuator
from seatrial.vehicles.catalogue import PublishedVehicle
from seatrial.vehicles.catalogue import (
    load_vehicle as load_vehicle,
)
from seatrial.vehicles.catalogue import (
    make_vehicle as make_vehicle,
)
from seatrial.vehicles.catalogue import (
    vehicle_names as vehicle_names,
)
from seatrial.vehicles.model import VehicleModel as VehicleModel
from seatrial.vehicles.model import make_model as make_model

__all__: list[str]
__version__: str
export_vehicle = export_to
make_record = record_of_columns
record = record_of_table
Vehicle = PublishedVehicle
