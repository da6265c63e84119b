"""Section V: the iteration the paper proposes. Select, redesign to tell the structures apart, re-estimate with both trials.

Every second trial is judged beforehand by the standard deviation it would leave for the doubted coefficient, from the Fisher
information of both trials together; the best is simulated and fitted jointly with the first. For as much sea time, the
first trial is also run a second time.
"""

import jax
import numpy as np
import xarray as xr

from seatrial.design.fisher import fisher_information
from seatrial.selection.importance import ImportanceSettings, evidence_of, importance_sample, weighted_sd
from studies.remus100.compute.trial import (
    STEP,
    doublets,
    paper_posterior,
    paper_trial,
    stamps,
    wide,
)
from studies.remus100.study import Study

LONGER = 58.0
"""Window of the redesigned doublets, s."""
PERIODS = (5.0, 8.0, 10.0, 14.0, 19.0, 29.0, 58.0)
WEIGHING = ImportanceSettings(draws=8192, pilot=2048)
FITS = ("one trial", "the same trial twice", "redesigned second trial")


def iteration_part(study: Study) -> xr.Dataset:
    """Predicted gain of each second trial, and what the fits say before and after the best of them."""
    reading, report = study.reading, study.progress("iteration")
    value, model = reading.source.doubted.values[0], reading.model(reading.doubted)
    truth = {**reading.truth, reading.doubted: value}
    relay = study.part("relay")
    first = doublets(reading)
    candidates = {f"doublets of {period:g} s": doublets(reading, period, LONGER) for period in PERIODS}
    candidates["self-oscillating test"] = relay["n"].values
    report(0, 4)
    information = fisher_information(
        model,
        truth,
        np.stack([first, *candidates.values()])[..., None],
        STEP,
        [reading.hull.trim["u"]],
        {"u": reading.sigma},
    )
    names = tuple(term.text for term in model.coefficients)
    scale = np.array([reading.print_scales[name] for name in names])
    alone, both = _sds(information[1:]) / scale, _sds(information[0] + information[1:]) / scale
    doubted = names.index(reading.doubted)
    best = int(np.argmin(both[:, doubted]))
    control = list(candidates.values())[best]
    report(1, 4)
    one = paper_trial(reading, value)
    seconds = {
        FITS[0]: [one],
        FITS[1]: [one, paper_trial(reading, value, 2, label="second")],
        FITS[2]: [one, paper_trial(reading, value, 2, control, label="second")],
    }
    rows, key = [], study.random_key("iteration")
    for done, records in enumerate(seconds.values()):
        full, reduced = (paper_posterior(reading, records, prior) for prior in (wide(reading), None))
        weighted = [
            importance_sample(posterior, jax.random.fold_in(key, done), settings=WEIGHING)
            for posterior in (full, reduced)
        ]
        evidences = [evidence_of(weights) for weights in weighted]
        odds = evidences[1].log_value - evidences[0].log_value
        p = 1.0 / (1.0 + np.exp(odds))
        by_name = [
            dict(zip(posterior.names, weighted_sd(posterior, weights), strict=True))
            for posterior, weights in zip((full, reduced), weighted, strict=True)
        ]
        rows.append(
            xr.Dataset(
                {
                    "probability": ((), p),
                    "error": ((), p * (1 - p) * np.hypot(evidences[0].std_error, evidences[1].std_error)),
                    "full_sd": ("coefficient", [by_name[0][name] / s for name, s in zip(names, scale, strict=True)]),
                    "reduced_sd": (
                        "coefficient",
                        [by_name[1].get(name, np.nan) / s for name, s in zip(names, scale, strict=True)],
                    ),
                }
            )
        )
        report(done + 2, 4)
    return (
        xr.concat(rows, xr.IndexVariable("fit", list(FITS)))
        .assign(
            alone=(("design", "coefficient"), alone),
            both=(("design", "coefficient"), both),
            first_sd=("coefficient", _sds(information[:1])[0] / scale),
            first=("time", first),
            second=("time", control),
        )
        .assign_coords(design=list(candidates), coefficient=list(names), time=stamps())
    )


def _sds(information: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))
