"""Every stored result of a campaign, typed: to read a campaign's folder without JAX, and without the campaign.

    results = Results(Path("outputs/remus100"))
    results.summary().coefficients[0].mean
    results.posterior("M-0").draws(["X_u"])

Whether a result still belongs to the campaign file is not asked: `seatrial.campaign.workflow.status` says so. Each reader raises
`InputError` where the result is missing or damaged, and names what makes it.
"""

from dataclasses import dataclass
from pathlib import Path

from seatrial.campaign.rehearsal.result import Rehearsal, read_rehearsal
from seatrial.campaign.store.baselines import FittedBaselines, read_baselines
from seatrial.campaign.store.calibration import Calibrated, read_calibration
from seatrial.campaign.store.cross_validation import CrossValidation, read_cross_validation
from seatrial.campaign.store.designs import (
    FreeTrial,
    Measures,
    RelayTrial,
    Searched,
    SweptDesigns,
    read_free_trial,
    read_measures,
    read_relay_trial,
    read_searched,
    read_sweeps,
)
from seatrial.campaign.store.estimates import Estimate, Known, StoredProfile, read_estimate, read_known, read_profiles
from seatrial.campaign.store.predictions import Predictions, read_predictions
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.store.structures import (
    Contenders,
    Screened,
    StoredCriteria,
    StoredSelection,
    Summary,
    read_contenders,
    read_criteria,
    read_screening,
    read_selection,
    read_summary,
)
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset
from seatrial.core.record import Record
from seatrial.core.record_file import read_record


@dataclass(frozen=True)
class Results:
    """What is stored below one campaign's folder; `label` is that of a structure, such as `M-0`."""

    folder: Path

    @property
    def store(self) -> Store:
        """Places of the files."""
        return Store(self.folder)

    def summary(self) -> Summary:
        """Read everything that an engineer copies out."""
        return read_summary(self.store.summary, self._by("run"))

    def design(self) -> SweptDesigns:
        """Read every design of the first trial."""
        return read_sweeps(self.store.design)

    def next_design(self) -> SweptDesigns:
        """Read every design of the next trial."""
        return read_sweeps(self.store.next_design)

    def free_form(self) -> FreeTrial:
        """Read the free-form trial."""
        return read_free_trial(self.store.free_design, self._by("design"))

    def relay(self) -> RelayTrial:
        """Read the self-oscillating test."""
        return read_relay_trial(self.store.relay_design, self._by("design"))

    def searched(self) -> Searched:
        """Read the design found by a global search."""
        return read_searched(self.store.searched, self._by("design"))

    def measures(self) -> Measures:
        """Read every measure of some designs."""
        return read_measures(self.store.measures)

    def rehearsal(self) -> Rehearsal:
        """Read how many trials each strategy needed on vehicles drawn from the priors."""
        return read_rehearsal(self.store.rehearsal)

    def record(self, run: str) -> Record:
        """Read the record of one trial."""
        return read_record(self.store.record(run))

    def screening(self) -> Screened:
        """Read the screening of every structure."""
        return read_screening(self.store.screening)

    def posterior(self, label: str) -> Estimate:
        """Read the posterior of one structure."""
        return read_estimate(self.store.posterior(label))

    def selection(self) -> StoredSelection:
        """Read evidences, probabilities and verdicts."""
        return read_selection(self.store.selection, self._by("select"))

    def contenders(self) -> Contenders:
        """Read the comparison of the best structure with the runner-up."""
        return read_contenders(self.store.contenders)

    def criteria(self, label: str) -> StoredCriteria:
        """Read the information criteria of one structure."""
        return read_criteria(self.store.criteria(label))

    def future(self, label: str) -> StoredCriteria:
        """Read the leave-future-out of one structure."""
        return read_criteria(self.store.future(label))

    def cross_validation(self) -> CrossValidation:
        """Read how well each structure and model of the error predicts runs left out."""
        return read_cross_validation(self.store.cross_validation, self._by("crossvalidate"))

    def known(self, label: str) -> Known:
        """Read what the data tell about each parameter of one structure."""
        return read_known(self.store.known(label), self._by("estimate"))

    def profiles(self, label: str) -> dict[str, StoredProfile]:
        """Read the profile likelihoods of one structure's parameters."""
        return read_profiles(self.store.profiles(label), self._by("profile"))

    def calibration(self, method: str) -> Calibrated:
        """Read the ranks of a calibration by one method."""
        return read_calibration(self.store.calibration(method))

    def predictions(self) -> Predictions:
        """Read how well each record is predicted."""
        return read_predictions(self.store.predictions)

    def baselines(self) -> FittedBaselines:
        """Read what baselines say of the held-back records."""
        return read_baselines(self.store.baselines)

    def filter(self) -> Dataset:
        """Read the traces of the filter, the records one after another on `sample`."""
        return open_dataset(self.store.filter)

    def _by(self, command: str) -> str:
        return f"seatrial {command} {self.folder}"
