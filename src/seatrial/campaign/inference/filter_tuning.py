"""Whether the campaign's filter is tuned, record by record, and the noise of its sensors as the records show it."""

from dataclasses import dataclass

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.truth import true_coefficients
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.inference.filter_trace import filter_record, prior_belief
from seatrial.campaign.inference.posterior import initial_state
from seatrial.campaign.store.estimates import Estimate
from seatrial.core.errors import InputError
from seatrial.core.record import Record
from seatrial.core.signals import signal_unit
from seatrial.filters.noise_from_differences import NoiseEstimate, noise_from_high_pass
from seatrial.filters.tuning import TuningReport, check_tuning
from seatrial.messages.render import sentence
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.simulate import simulate

# Which keys of the campaign's file the findings are about.
WHERE = "P_0 of a coefficient is its [prior], Q is [filter] process_noise, R is the noise in [sensors]"


@dataclass(frozen=True, eq=False)
class RecordTuning:
    """The check along one record.

    Attributes:
        record: trial.
        constants: names of the coefficients.
        report: of a filter that began with the priors.
        noise: of each channel by high-pass filtering; where it cannot be had, why.
    """

    record: Record
    constants: tuple[str, ...]
    report: TuningReport
    noise: dict[str, NoiseEstimate | str]

    @property
    def tuned(self) -> bool:
        """Whether P, Q and R can stay as they are."""
        return all(finding.code == "not-settled" for finding in self.report.findings)

    def lines(self) -> list[str]:
        """Return the check in lines of text: numbers, their ranges by chance, and recommended changes."""
        report = self.report
        messages = [f"  NIS {report.nis:.3g} for each measurement, {_band(report.nis_band)} if tuned"]
        for i, name in enumerate(self.record.measured):
            messages.append(
                f"  innovations of {name}: correlation {report.correlation[i]:+.2f}, p-value of whiteness {report.whiteness[i]:.2g}"
            )
        if np.isfinite(report.nees):
            messages.append(f"  NEES {report.nees:.3g} for each state, {_band(report.nees_band)} if tuned")
        if np.isfinite(report.moved):
            messages.append(
                f"  coefficients moved {report.moved:.3g} times as far as P_0 allows, squared, {_band(report.moved_band)} if tuned"
            )
        for i, name in enumerate(self.constants):
            messages.append(
                f"  {name}: sd {report.settling[i] - 1:+.0%} in the last quarter, "
                f"estimates travel {report.erratic[i]:.2f} times as far as those of a tuned filter"
            )
        for name, result in self.noise.items():
            unit = signal_unit(name)
            words = (
                result
                if isinstance(result, str)
                else f"{result.sd:.3g} ± {result.std_error:.1g} {unit}, by differences of order {result.order}"
            )
            messages.append(f"  noise of {name} from the record: {words}")
        findings = [f"  -> {sentence(finding)}" for finding in report.findings]
        return [*messages, *(findings or ["  -> nothing to change"])]


def check_filter(campaign: Campaign, estimate: Estimate, trials: Trials) -> list[RecordTuning]:
    """Check the campaign's filter along each fitted record, from the priors each time.

    Args:
        campaign: configuration.
        estimate: of the full structure.
        trials: records.

    Raises:
        NumericalError: the filter failed.
        InputError: too short a record to check.
    """
    model = campaign.model(estimate.structure)
    belief, scales = prior_belief(campaign.coefficient_priors(model))
    checks = []
    for record in trials.fit:
        space, trace = filter_record(campaign, estimate, record, belief, scales)
        report = check_tuning(trace, space, _true_state(campaign, model, record, scales))
        noise = {name: _noise_of(record, name) for name in campaign.channels}
        checks.append(RecordTuning(record, tuple(term.text for term in model.coefficients), report, noise))
    return checks


def _true_state(campaign: Campaign, model: VehicleModel, record: Record, scales: np.ndarray) -> np.ndarray | None:
    """State at the last sample of a simulated record, coefficients in units of `scales`; None for a real one."""
    if campaign.imports is not None:
        return None
    truth = true_coefficients(campaign, model)
    control = np.column_stack([record.channel(name) for name in model.controls])
    start = np.array(initial_state(campaign, model, record))
    states = np.asarray(simulate(model, truth, control, record.step, start))
    return np.concatenate([states[-1], np.array(list(truth.values())) / scales])


def _noise_of(record: Record, channel: str) -> NoiseEstimate | str:
    try:
        return noise_from_high_pass(record.time, record.channel(channel))
    except InputError as error:
        return f"cannot be found: {error.sentence()}"


def _band(band: tuple[float, float]) -> str:
    return f"{band[0]:.3g} to {band[1]:.3g}"
