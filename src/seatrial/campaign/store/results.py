"""Every stored result of a campaign, typed: to read a campaign's folder without JAX, and without the campaign.

    results = Results(Path("outputs/remus100"))
    results.summary().coefficients[0].mean
    results.posterior("M-0").draws(["X_u"])

Whether a result still belongs to the campaign file is not asked: `seatrial.campaign.workflow.status` says so. Each reader raises
`InputError` where the result is missing or damaged, and names what makes it.
"""

from dataclasses import dataclass
from pathlib import Path

from seatrial.campaign.rehearsal.result import Rehearsal
from seatrial.campaign.store.baselines import FittedBaselines
from seatrial.campaign.store.calibration import Calibrated
from seatrial.campaign.store.cross_validation import CrossValidation
from seatrial.campaign.store.designs import FreeTrial, Measures, RelayTrial, Searched, SweptDesigns
from seatrial.campaign.store.estimates import Estimate, Known
from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.stored_result import Result, Store, read_result
from seatrial.campaign.store.structures import Contenders, Screened, StoredCriteria, StoredMode, Summary
from seatrial.core.dataset import Dataset
from seatrial.core.record import Record
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.selection.verdict import Selection


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
        return self._read(Summary, self.store.summary, "run")

    def mode(self) -> StoredMode:
        """Read the posterior mode of the most probable structure."""
        return self._read(StoredMode, self.store.mode, "estimate --by mode")

    def design(self) -> SweptDesigns:
        """Read every design of the first trial."""
        return self._read(SweptDesigns, self.store.design, "design")

    def next_design(self) -> SweptDesigns:
        """Read every design of the next trial."""
        return self._read(SweptDesigns, self.store.next_design, "next")

    def free_form(self) -> FreeTrial:
        """Read the free-form trial."""
        return self._read(FreeTrial, self.store.free_design, "design")

    def relay(self) -> RelayTrial:
        """Read the self-oscillating test."""
        return self._read(RelayTrial, self.store.relay_design, "design")

    def searched(self) -> Searched:
        """Read the design found by a global search."""
        return self._read(Searched, self.store.searched, "design")

    def measures(self) -> Measures:
        """Read every measure of some designs."""
        return self._read(Measures, self.store.measures, "design")

    def rehearsal(self) -> Rehearsal:
        """Read how many trials each strategy needed on vehicles drawn from the priors."""
        return self._read(Rehearsal, self.store.rehearsal, "plan --vehicles 20")

    def record(self, run: str) -> Record:
        """Read the record of one trial."""
        return self._read(Record, self.store.record(run), "import")

    def screening(self) -> Screened:
        """Read the screening of every structure."""
        return self._read(Screened, self.store.screening, "select")

    def posterior(self, label: str) -> Estimate:
        """Read the posterior of one structure."""
        return self._read(Estimate, self.store.posterior(label), "estimate")

    def selection(self) -> Selection:
        """Read evidences, probabilities and verdicts."""
        return self._read(Selection, self.store.selection, "select")

    def contenders(self) -> Contenders:
        """Read the comparison of the best structure with the runner-up."""
        return self._read(Contenders, self.store.contenders, "select")

    def criteria(self, label: str) -> StoredCriteria:
        """Read the information criteria of one structure."""
        return self._read(StoredCriteria, self.store.criteria(label), "criteria")

    def future(self, label: str) -> StoredCriteria:
        """Read the leave-future-out of one structure."""
        return self._read(StoredCriteria, self.store.future(label), "criteria")

    def cross_validation(self) -> CrossValidation:
        """Read how well each structure and model of the error predicts runs left out."""
        return self._read(CrossValidation, self.store.cross_validation, "crossvalidate")

    def known(self, label: str) -> Known:
        """Read what the data tell about each parameter of one structure."""
        return self._read(Known, self.store.known(label), "estimate")

    def profiles(self, label: str) -> Profiles:
        """Read the profile likelihoods of one structure's parameters."""
        return self._read(Profiles, self.store.profiles(label), "profile")

    def calibration(self, method: str) -> Calibrated:
        """Read the ranks of a calibration by one method."""
        return self._read(Calibrated, self.store.calibration(method), "calibrate")

    def predictions(self) -> Predictions:
        """Read how well each record is predicted."""
        return self._read(Predictions, self.store.predictions, "run")

    def baselines(self) -> FittedBaselines:
        """Read what baselines say of the held-back records."""
        return self._read(FittedBaselines, self.store.baselines, "run")

    def filter(self) -> Dataset:
        """Read the traces of the filter, the records one after another on `sample`."""
        return self._read(Dataset, self.store.filter, "run")

    def _read(self, kind: type[Result], path: Path, command: str) -> Result:
        return read_result(kind, path, f"seatrial {command} {self.folder}")
