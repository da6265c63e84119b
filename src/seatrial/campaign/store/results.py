"""Every stored result of a campaign, typed: to read a campaign's folder without JAX, and without the campaign.

    results = Results(Path("outputs/remus100"))
    results.summary().coefficients[0].mean
    results.posterior("M-0").draws(["X_u"])

Whether a result still belongs to the campaign file is not asked: `seatrial.campaign.workflow.status` says so. Each reader raises
`InputError` where the result is missing or damaged, and names what makes it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic

from seatrial.campaign.rehearsal.result import Rehearsal
from seatrial.campaign.store.estimates import Estimate, StoredMode
from seatrial.campaign.store.predictions import FittedBaselines, Predictions
from seatrial.campaign.store.stored_result import Result, Store, read_result
from seatrial.campaign.store.summary import Summary
from seatrial.core.dataset import Dataset
from seatrial.core.record import Record
from seatrial.design.results import FreeTrial, Measures, RelayTrial, Searched, SweptDesigns
from seatrial.estimation.diagnostics.calibration import Calibration
from seatrial.estimation.diagnostics.known import Known
from seatrial.estimation.posterior.profile_result import Profiles
from seatrial.selection.contenders import Contenders
from seatrial.selection.criterion import Criteria
from seatrial.selection.cross_validation import CrossValidation
from seatrial.selection.screened import Screened
from seatrial.selection.verdict import Selection


class Reader(Generic[Result]):
    """Reads one kind of result of a campaign's folder; of several files by their label."""

    def __init__(
        self, kind: type[Result], place: Callable[[Store], Path | Callable[[object], Path]], command: str
    ) -> None:
        self.kind, self.place, self.command = kind, place, command

    def __get__(self, results: "Results", owner: type) -> Callable[..., Result]:
        def read(*label: str) -> Result:
            place = self.place(Store(results.folder))
            path = place if isinstance(place, Path) else place(*label)
            return read_result(self.kind, path, f"seatrial {self.command} {results.folder}")

        return read


@dataclass(frozen=True)
class Results:
    """What is stored below one campaign's folder; a label is that of a structure, such as `M-0`, a run or a method."""

    folder: Path
    summary = Reader(Summary, lambda store: store.summary, "run")
    mode = Reader(StoredMode, lambda store: store.mode, "estimate --by mode")
    design = Reader(SweptDesigns, lambda store: store.design, "design")
    next_design = Reader(SweptDesigns, lambda store: store.next_design, "next")
    free_form = Reader(FreeTrial, lambda store: store.free_design, "design")
    relay = Reader(RelayTrial, lambda store: store.relay_design, "design")
    searched = Reader(Searched, lambda store: store.searched, "design")
    measures = Reader(Measures, lambda store: store.measures, "design")
    rehearsal = Reader(Rehearsal, lambda store: store.rehearsal, "plan --vehicles 20")
    record = Reader(Record, lambda store: store.record, "import")
    screening = Reader(Screened, lambda store: store.screening, "select")
    posterior = Reader(Estimate, lambda store: store.posterior, "estimate")
    selection = Reader(Selection, lambda store: store.selection, "select")
    contenders = Reader(Contenders, lambda store: store.contenders, "select")
    criteria = Reader(Criteria, lambda store: store.criteria, "criteria")
    cross_validation = Reader(CrossValidation, lambda store: store.cross_validation, "crossvalidate")
    known = Reader(Known, lambda store: store.known, "estimate")
    profiles = Reader(Profiles, lambda store: store.profiles, "profile")
    calibration = Reader(Calibration, lambda store: store.calibration, "calibrate")
    predictions = Reader(Predictions, lambda store: store.predictions, "run")
    baselines = Reader(FittedBaselines, lambda store: store.baselines, "run")
    filter = Reader(Dataset, lambda store: store.filter, "run")
