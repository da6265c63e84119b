"""Says of a fit to imported records by how much the length of its steps moves the parameters."""

from collections.abc import Sequence

import numpy as np

from seatrial.core.findings import Finding
from seatrial.core.record import SIMULATED, Record
from seatrial.estimation.posterior.mode import Mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.step_shift import check_step, shorter_step, step_shift


def long_steps(posterior: Posterior, mode: Mode, records: Sequence[Record]) -> list[Finding]:
    """Return which parameters the steps of the records move by more than a standard deviation, and which step helps.

    Args:
        posterior: of the records.
        mode: its mode, with the parameters that are absent.
        records: fitted; of simulated ones, which the same steps have made, nothing is said.
    """
    if any(record.provenance.source == SIMULATED for record in records):
        return []
    counts = [record.provenance.options.get("averaged", {}) for record in records]
    averaged = np.array([[of_one.get(name, 1.0) for name in posterior.likelihood.channels] for of_one in counts])
    shift = step_shift(posterior, mode, averaged)
    if shift is None:
        return []
    step = max(float(np.median(np.diff(record.time))) for record in records)
    return check_step(posterior, shift, step, shorter_step(step, averaged))
