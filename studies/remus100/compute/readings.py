"""Both readings of the paper's units side by side: the numbers that tell them apart, and that the verdicts do not."""

import jax
import numpy as np
import xarray as xr

from seatrial.design.sweep import sweep_family
from seatrial.estimation.mode import find_mode
from seatrial.filters.square_root import SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.numerics.integrate import euler_step
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from studies.remus100.compute.designs import ACTIVE, PERIODS, POINTS, design_space, true_state
from studies.remus100.compute.filters import filter_space, in_printed_units, make_trials, run_over_seeds
from studies.remus100.compute.trial import DURATION, STEP, around, paper_posterior, paper_trial, wide
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES, READINGS, Reading

WEIGHING = ImportanceSettings(draws=8192, pilot=2048)


def readings_part(study: Study) -> xr.Dataset:
    """Standard deviations of filter and fit, entropy reductions, and the probability of M-0, under both readings."""
    report, rows = study.progress("both readings of the units"), []
    for done, reading in enumerate(READINGS.values()):
        report(done, len(READINGS))
        rows.append(_numbers(study, reading))
    report(len(READINGS), len(READINGS))
    return xr.concat(rows, xr.IndexVariable("reading", list(READINGS))).assign_coords(coefficient=list(NAMES))


def _numbers(study: Study, reading: Reading) -> xr.Dataset:
    trials = make_trials(reading, study.sizes.tuning_seeds)
    trace = run_over_seeds(SquareRootUnscentedKalmanFilter(), filter_space(reading), trials)
    family = Family("n", reading.trim, duration=DURATION, active=ACTIVE["medium"], sample_time=STEP)
    sweep = sweep_family(
        design_space(reading, euler_step),
        family,
        np.linspace(reading.lowest, reading.highest, POINTS),
        PERIODS,
        truth=true_state(reading),
    )
    scale = np.array([reading.print_scales[name] for name in NAMES])
    fitted = find_mode(paper_posterior(reading, [paper_trial(reading, None)], None), study.random_key("readings")).sd
    small = paper_trial(reading, reading.source.doubted.values[0])
    full = find_mode(paper_posterior(reading, [small], wide(reading)), study.random_key("readings")).sd
    probability, logs = [], []
    for value in reading.source.doubted.values:
        record = paper_trial(reading, value)
        pair = [
            importance_evidence(
                paper_posterior(reading, [record], prior),
                jax.random.fold_in(study.random_key("odds"), 0),
                settings=WEIGHING,
            )
            for prior in (around(value), None)
        ]
        logs.append([one.log_value for one in pair])
        probability.append(1.0 / (1.0 + np.exp(pair[1].log_value - pair[0].log_value)))
    return xr.Dataset(
        {
            "filter_sd": ("coefficient", in_printed_units(reading, trace.sds[:, -1, 1:]).mean(0)),
            "fit_sd": ("coefficient", fitted[: len(NAMES)] / scale),
            "full_fit_sd": ("coefficient", full[: len(NAMES)] / scale),
            "gain_10_s": ((), float(sweep.gain[-1, np.searchsorted(PERIODS, 10.0)])),
            "gain_20_s": ((), float(sweep.gain[-1, -1])),
            "probability": ("value", probability),
            "log_value": (("value", "model"), logs),
        },
        {"value": list(reading.source.doubted.values)},
    )
