"""What the remarks of Section III on P, Q and R claim: the square-root UKF with each of them made too large, and R from the data."""

import json

import numpy as np
import xarray as xr

from seatrial.core.gaussian import Gaussian
from seatrial.filters.noise import noise_from_high_pass
from seatrial.filters.run import FilterTrace
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.filters.tuning import check_tuning
from studies.remus100.compute.filters import (
    N_STEPS,
    STEP,
    filter_space,
    in_printed_units,
    make_trials,
    run_over_seeds,
)
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES

CHANGES = {"as printed": {}, "P x 1e4": {"p": 1e4}, "Q x 1e4": {"q": 1e4}, "R x 100": {"r": 100.0}}


def tuning_part(study: Study) -> xr.Dataset:
    """Errors, stated standard deviations, how the state is followed, how far the estimates travel, and what the check says."""
    reading, seeds = study.reading, study.sizes.tuning_seeds
    trials, truth = make_trials(reading, seeds), np.array([reading.printed_truth[name] for name in NAMES])
    report, rows, said = study.progress("tuning of P, Q and R"), [], {}
    for done, (change, factors) in enumerate(CHANGES.items()):
        report(done, len(CHANGES))
        space = filter_space(reading, **factors)
        trace = run_over_seeds(SquareRootUnscentedKalmanFilter(), space, trials)
        means, sds = (in_printed_units(reading, x[..., 1:]) for x in (trace.means, trace.sds))
        u = np.asarray(trace.means)[..., 0]
        rows.append(
            xr.Dataset(
                {
                    "error": (("seed", "coefficient"), means[:, -1] - truth),
                    "sd": (("seed", "coefficient"), sds[:, -1]),
                    "error_at_3_s": (("seed", "coefficient"), means[:, 299] - truth),
                    "travelled": (("seed", "coefficient"), np.abs(np.diff(means, axis=1)).sum(1)),
                    "residual": ("seed", np.sqrt(np.mean((u - trials.measured[..., 0]) ** 2, 1))),
                    "state_error": ("seed", np.sqrt(np.mean((u - trials.true[..., 0]) ** 2, 1))),
                }
            )
        )
        said[change] = [finding.words for finding in check_tuning(_one(trace), space).findings]
    report(len(CHANGES), len(CHANGES))
    stamps = STEP * np.arange(N_STEPS)
    noise = [noise_from_high_pass(stamps, trials.measured[0, :, i]) for i in range(2)]
    dataset = xr.concat(rows, xr.IndexVariable("change", list(CHANGES))).assign_coords(coefficient=list(NAMES))
    return dataset.assign(
        noise=("channel", [one.sd for one in noise]), noise_error=("channel", [one.std_error for one in noise])
    ).assign_attrs(findings=json.dumps(said))


def _one(trace: FilterTrace) -> FilterTrace:
    """The first of a batch of traces."""
    final = Gaussian(*(np.asarray(part)[0] for part in trace.final))
    return FilterTrace(trace.log_likelihood[0], final, *(np.asarray(part)[0] for part in trace[2:]))
